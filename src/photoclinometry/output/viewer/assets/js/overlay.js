// The canvas above the picture: legend and marks.

/** A pen in the canvas's pixels; `pen.ratio` of them are one of the page's. */
function penOf(canvas, ratio) {
  const pen = canvas.getContext("2d");
  pen.ratio = ratio;
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.clearRect(0, 0, canvas.width, canvas.height);
  pen.font = `${13 * ratio}px system-ui, "DejaVu Sans", sans-serif`;
  return pen;
}

/** The words of a picture: layer, Sun, camera. */
function caption(map, state, layer, compare) {
  const view = shortName(map.scene.views[state.view].name);
  const sun = `Sun ${digits(map.ground.shownAzimuth(state.azimuth), 0.1)}° ${digits(state.elevation, 0.1)}°`;
  const what = {
    map: layer.title,
    image: `image ${view}`,
    swipe: `image ${view} | ${layer.title}`,
    difference: "rendering − image",
  };
  return `${what[compare]}  ·  ${sun}  ·  ${state.camera === "image" ? `camera of ${view}` : "free camera"}`;
}

/** Draws all above the picture. shown: as drawColours; camera: of the picture. */
function drawOverlay(canvas, renderer, state, layer, shown, camera, ratio) {
  const { map } = renderer;
  const size = [canvas.width, canvas.height];
  const pen = penOf(canvas, ratio);
  if (shown.contour > 0 && shown.compare === "map") drawContourLabels(pen, renderer, shown.contour);
  if (state.footprints && map.ground.footprints) drawFootprints(pen, camera, map, state.view);
  if (state.cameras) drawCameras(pen, camera, map, state.view);
  if (state.moves && hasMoves(map)) drawMoves(pen, camera, map, state);
  drawMeasure(pen, camera, map, state);
  if (shown.compare === "difference") {
    const top = 100 * shown.difference[1];
    drawColourBar(pen, size, renderer.tables.RdBu_r, [-top, top], "% of mean");
  } else {
    const limits = shown.compare === "image" ? shown.imageLimits : shown.limits;
    const table = renderer.tables[shown.compare === "image" ? "gray" : shown.table];
    drawColourBar(pen, size, table, limits, shown.compare === "image" ? shown.imageUnit : layer.unit);
  }
  drawScaleBar(pen, size, camera, map);
  drawArrows(pen, camera, map, state);
  pen.textAlign = "left";
  pen.textBaseline = "top";
  outlined(pen, caption(map, state, layer, shown.compare), 14 * ratio, 10 * ratio);
}
