// Marks on the map: outlines of images, directions of cameras, and points of measurements.

const INK = "#ffcc33";
const OTHER_INK = "#7fd4ff";

/** A line through points (x, y, z) of the local frame; those behind the camera break it. Dark at both sides, to be seen on any ground. */
function line(pen, camera, points, closed = false) {
  const path = new Path2D();
  let started = false;
  for (const point of closed ? [...points, points[0]] : points) {
    const [u, v, depth] = projected(camera, point);
    if (depth <= 0) started = false;
    else if (started) path.lineTo(u, v);
    else path.moveTo(u, v);
    started = depth > 0;
  }
  const [ink, width] = [pen.strokeStyle, pen.lineWidth];
  [pen.strokeStyle, pen.lineWidth] = ["rgba(0, 0, 0, 0.6)", width + 2 * pen.ratio];
  pen.stroke(path);
  [pen.strokeStyle, pen.lineWidth] = [ink, width];
  pen.stroke(path);
}

/** Text with an outline, so that it is read on dark and bright ground. */
function outlined(pen, text, x, y, colour = "#fff") {
  pen.lineJoin = "round";
  pen.strokeStyle = "rgba(0, 0, 0, 0.85)";
  pen.lineWidth = 3.5 * pen.ratio;
  pen.strokeText(text, x, y);
  pen.fillStyle = colour;
  pen.fillText(text, x, y);
}

/** Name of a view without folders and suffix. */
const shortName = (name) =>
  name
    .split("/")
    .pop()
    .replace(/\.[^.]*$/, "");

/** Outline of a view's image on the mean plane: (x, y, 0) of its corners; null where it does not meet the plane. */
function footprintOf(view) {
  const camera = wholeImage(view);
  const corners = [
    [0, 0],
    [view.width, 0],
    [view.width, view.height],
    [0, view.height],
  ].map((pixel) => onPlane(camera, pixel, [0, 0, 0], [0, 0, 1]));
  return corners.every(Boolean) ? corners : null;
}

function drawFootprints(pen, camera, map, chosen) {
  map.scene.views.forEach((view, k) => {
    const corners = footprintOf(view);
    if (!corners) return;
    pen.strokeStyle = k === chosen ? INK : OTHER_INK;
    pen.lineWidth = (k === chosen ? 2 : 1) * pen.ratio;
    line(pen, camera, corners, true);
  });
}

/** Where a view's camera is marked: in its direction, so near the map that the first pictures of it show the mark. */
const cameraMark = (map, view) => times(unit(view.center), map.ground.cameraMarks * map.radius);

/** Names of views in few letters: without what all begin and end with, up to a separator. */
function labelsOf(views) {
  const names = views.map((view) => shortName(view.name));
  if (names.length < 2) return names;
  const reversed = (text) => [...text].reverse().join("");
  const start = sharedStart(names);
  const end = sharedStart(names.map((name) => reversed(name.slice(start))));
  return names.map((name) => name.slice(start, name.length - end));
}

/** How many characters all texts begin with, up to their last separator. */
function sharedStart(texts) {
  let count = 0;
  while (count < texts[0].length && texts.every((text) => text[count] === texts[0][count])) count++;
  return texts[0].slice(0, count).search(/[^_\-. ]*$/);
}

/** Names of views to the right of points (x, y, z), where no other name is; the chosen view's always. */
function drawNames(pen, camera, map, chosen, pointOf) {
  const { views } = map.scene;
  const [labels, taken, height] = [labelsOf(views), [], 15 * pen.ratio];
  const order = views.length > MANY_VIEWS ? [] : views.map((_, k) => k).filter((k) => k !== chosen);
  pen.textAlign = "left";
  pen.textBaseline = "middle";
  for (const k of [chosen, ...order]) {
    const [u, v, depth] = projected(camera, pointOf(views[k]));
    const [left, right] = [u + 7 * pen.ratio, u + 7 * pen.ratio + pen.measureText(labels[k]).width];
    if (depth <= 0 || taken.some(([a, b, y]) => left < b && a < right && Math.abs(v - y) < height)) continue;
    taken.push([left, right, v]);
    outlined(pen, labels[k], left, v, k === chosen ? INK : OTHER_INK);
  }
  pen.textBaseline = "alphabetic";
}

/** Directions from the middle of the map to the cameras, each with a small picture frame and the view's name. */
function drawCameras(pen, camera, map, chosen) {
  map.scene.views.forEach((view, k) => {
    const middle = cameraMark(map, view);
    const axes = view.local_from_cam;
    const half = 0.05 * map.radius;
    const corner = (x, y) =>
      add(
        middle,
        [0, 1, 2].map((i) => half * (x * axes[i][0] + y * axes[i][1])),
      );
    pen.strokeStyle = k === chosen ? INK : OTHER_INK;
    pen.lineWidth = (k === chosen ? 2 : 1) * pen.ratio;
    line(pen, camera, [times(middle, 0.03), middle]);
    line(pen, camera, [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)], true);
  });
  const side = (view) => add(cameraMark(map, view), times(view.local_from_cam.map((row) => row[0]), 0.05 * map.radius));
  drawNames(pen, camera, map, chosen, side);
}

/** The points of a measurement on the ground, joined along it. */
function drawMeasure(pen, camera, map, state) {
  const places = state.points;
  const grounds = places.map((place) => vectorAt(map, map.position, place));
  if (!grounds.length || grounds.some((point) => !point)) return;
  pen.strokeStyle = INK;
  pen.lineWidth = 2 * pen.ratio;
  const joined = state.tool === "area" && places.length > 2 ? [...grounds, grounds[0]] : grounds;
  if (state.tool === "profile" && places.length === 2) {
    line(
      pen,
      camera,
      map.ground
        .profileOf(map, places)
        .filter((step) => step.position)
        .map((step) => step.position),
    );
  } else line(pen, camera, joined);
  grounds.forEach((point, i) => {
    if (map.ground.isHidden(camera, point, vectorAt(map, map.normal, places[i]))) return;
    const [u, v] = projected(camera, point);
    pen.beginPath();
    pen.arc(u, v, 5 * pen.ratio, 0, 2 * Math.PI);
    pen.fillStyle = INK;
    pen.fill();
    pen.strokeStyle = "#000";
    pen.lineWidth = pen.ratio;
    pen.stroke();
    outlined(pen, "ABCDEFGHIJKLMNOPQRSTUVWXYZ"[i % 26], u + 8 * pen.ratio, v - 8 * pen.ratio, INK);
  });
}
