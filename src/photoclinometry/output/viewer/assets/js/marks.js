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

/** Whether a view's mark has its name beside it. */
const isNamed = (map, k, chosen) => k === chosen || map.scene.views.length <= MANY_VIEWS;

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
    const [u, v, depth] = projected(camera, corner(1, 0));
    if (depth > 0 && isNamed(map, k, chosen)) outlined(pen, shortName(view.name), u + 4 * pen.ratio, v, k === chosen ? INK : OTHER_INK);
  });
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
