// The picture of the present state: what is drawn with which camera, colours and limits.

const MOST_RATIO = 2; // pixels of the picture per pixel of the page, at most
const SHADING = 1; // of coloured layers by the hillshade
const SLOW_MS = 60; // a frame that takes longer is drawn coarser while things move
const REST_MS = 250; // after the last change all is drawn at its finest

/** What drawing needs of the present state: the camera and what drawColours takes. level: of detail, 0 the finest. */
function shownNow(viewer, size, level = 0) {
  const { map, store } = viewer;
  const { state } = store;
  const view = map.scene.views[state.view];
  const camera = cameraNow(map, state, size);
  const picture = state.camera === "image" ? map.pictures[state.view] : null;
  const compare = picture ? (state.compare === "blink" ? (viewer.blink ? "image" : "map") : state.compare) : "map";
  const layer =
    viewer.layers.find(
      (one) => one.key === (compare === "map" && state.compare !== "blink" ? state.layer : "rendering"),
    ) ?? viewer.layers[0];
  const factors = state.camera === "image" && layer.key === "rendering" ? [view.scale, view.bias] : [1, 0];
  const stretch = picture ? stretchOf(picture) : { limits: [0, 1], mean: 1 };
  const asImage = picture && (state.compare !== "map" || viewer.viewOfSun() === state.view);
  const values = layerValues(viewer, layer, camera, factors, asImage ? stretch.limits : null, level === 0);
  const block = picture ? picture.block : 1;
  const zoom = state.zoom * block;
  const origin = picture ? [picture.col, picture.row] : [0, 0];
  const shown = {
    table: layer.table,
    limits: values.limits,
    shading: layer.shaded && state.shading ? SHADING : 0,
    contour: layer.contours ? state.contour : 0,
    compare,
    block,
    view: state.view,
    swipe: state.swipe * size[0],
    imageFromScreen: [
      1 / zoom,
      1 / zoom,
      ...[0, 1].map((i) => (state.middle[i] - origin[i]) / block - size[i] / 2 / zoom),
    ],
    imageLimits: stretch.limits,
    imageUnit: map.scene.brightness === "iof" ? "I/F" : "DN",
    difference: [1 / stretch.mean, state.difference / 100],
  };
  return { camera, layer, factors, values: values.shown, shown };
}

/** What drawSurface takes of a layer, and its limits; a rendering's are imageLimits where these are given. smooth: whether
 * a rendering is to be interpolated by a spline. */
function layerValues(viewer, layer, camera, factors, imageLimits, smooth) {
  const { renderer, map, store } = viewer;
  const { state } = store;
  const { passes } = renderer;
  if (layer.key === "rendering") {
    const sigma = state.camera === "image" ? map.scene.views[state.view].averaging : 0;
    const target = brightnessOf(passes, sunOf(state), camera.center, state.shadows, sigma, smooth);
    return { shown: target, limits: imageLimits ?? exposureOf(renderer, target, factors) };
  }
  if (layer.key === "relief") {
    if (viewer.relief) renderer.gl.deleteTexture(viewer.relief);
    viewer.relief = valuesTexture(passes, cosines(map, sunOf(state)));
    return { shown: { texture: viewer.relief }, limits: layer.limits };
  }
  layer.texture ??= valuesTexture(passes, layer.values);
  return { shown: { texture: layer.texture }, limits: limitsOf(layer) };
}

/** Draws all: the picture at a level of detail, what is above it, and the sky. */
function draw(viewer, level = 0) {
  const { renderer, map, picture, overlay, store } = viewer;
  useLevel(renderer, level);
  const ratio = viewer.ratio();
  const size = [picture, overlay].map((canvas) => fitted(canvas, ratio))[0];
  const now = shownNow(viewer, size, level);
  drawSurface(renderer, surfaceTarget(renderer), now.camera, now.values, now.factors);
  if (now.shown.compare === "difference") {
    const k = store.state.view;
    drawOfPicture(renderer, map.scene.views[k], map.pictures[k], now.values, now.factors);
  }
  drawColours(renderer, now.shown);
  drawOverlay(overlay, renderer, store.state, now.layer, now.shown, now.camera, ratio);
  drawSky(byId("sky"), map, store.state);
  viewer.drawn = now;
}

const pictureRatio = () => Math.min(window.devicePixelRatio || 1, MOST_RATIO);

/** Makes a canvas as large as it is shown; returns width and height. */
function fitted(canvas, ratio) {
  const size = [canvas.clientWidth, canvas.clientHeight].map((x) => Math.max(1, Math.round(x * ratio)));
  if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
  return size;
}

/** Draws with the next frame of the browser: coarser where changes follow each other faster than the finest is drawn. */
function schedule(viewer) {
  viewer.waiting ??= requestAnimationFrame(() => {
    viewer.waiting = null;
    const moves = performance.now() - (viewer.drawnAt ?? -REST_MS) < REST_MS;
    if (viewer.isSlow && moves) drawCoarse(viewer);
    else drawTimed(viewer);
    viewer.drawnAt = performance.now();
  });
}

function drawCoarse(viewer) {
  draw(viewer, 1);
  clearTimeout(viewer.resting);
  viewer.resting = setTimeout(() => drawTimed(viewer), REST_MS);
}

/** Draws the finest level, and notes whether that takes long. */
function drawTimed(viewer) {
  const started = performance.now();
  draw(viewer);
  readBack(viewer.renderer.gl, viewer.renderer.target, 0, 0, 1, 1); // waits until all is drawn
  viewer.isSlow = performance.now() - started > SLOW_MS;
}
