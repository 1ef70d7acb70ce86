// Pose changes: how the estimate moved the cameras from their pose priors.

const LONGEST_MOVE = 0.3; // of the map's radius: the longest arrow

/** Of a view with a prior [the page's unit]. */
const moved = (view) => subtract(view.center, view.prior.center);

/** Of a view with a prior: its move [the page's unit], its turn [degrees], and by how much that shifts the middle of the
 * map in its image [px]; else null. */
function poseChange(view) {
  if (!view.prior) return null;
  const [now, then] = [view, { ...view, ...view.prior }].map((each) => projected(wholeImage(each), [0, 0, 0]));
  const [a, b] = [view, view.prior].map((each) => each.local_from_cam.flat());
  const apart = Math.sqrt(a.reduce((sum, value, i) => sum + (value - b[i]) ** 2, 0)); // 2 sqrt(2) sin(half the turn)
  return {
    move: moved(view),
    turn: (2 * Math.asin(Math.min(apart / Math.sqrt(8), 1))) / DEGREE,
    shift: [now[0] - then[0], now[1] - then[1]],
  };
}

const hasMoves = (map) => map.scene.views.some((view) => view.prior);

/** By how much moves are drawn too long. */
function moveFactor(map) {
  const longest = Math.max(...map.scene.views.map((view) => (view.prior ? length(moved(view)) : 0)));
  return longest > 0 ? (LONGEST_MOVE * map.radius) / longest : 1;
}

/** Of each view with a prior an arrow from there to where it is, where cameras are marked, and too long by a factor. */
function drawMoves(pen, camera, map, { view: chosen, cameras }) {
  const factor = moveFactor(map);
  map.scene.views.forEach((view, k) => {
    const change = poseChange(view);
    if (!change) return;
    const tip = cameraMark(map, view);
    const from = subtract(tip, times(change.move, factor));
    pen.strokeStyle = k === chosen ? INK : OTHER_INK;
    pen.lineWidth = (k === chosen ? 3 : 1.5) * pen.ratio;
    line(pen, camera, [from, tip]);
    const [u, v, depth] = projected(camera, tip);
    if (depth <= 0) return;
    pen.beginPath();
    pen.arc(u, v, 3.5 * pen.ratio, 0, 2 * Math.PI);
    pen.fillStyle = pen.strokeStyle;
    pen.fill();
  });
  if (!cameras) drawNames(pen, camera, map, chosen, (view) => cameraMark(map, view)); // else they have theirs
}

/** Rows [quantity, value] of the chosen view's pose change. */
function moveRows(map, k) {
  const view = map.scene.views[k];
  const change = poseChange(view);
  const name = shortName(view.name);
  if (!change) return [["image", name], ["pose prior", "none"]];
  const { center_sigma: ofCenter, rotation_sigma: ofRotation } = view.prior;
  const stated = (sigma, words) => (sigma === null ? "" : ` (prior ± ${four(sigma)}${words})`);
  return [
    ["image", name],
    ["moved", `${four(length(change.move))} ${map.scene.unit}${stated(ofCenter, "")}`],
    ["turned", `${four(change.turn)}°${stated(ofRotation === null ? null : ofRotation / DEGREE, "")}`],
    ["moves the map in it by", `${four(Math.hypot(...change.shift))} px`],
    ["arrows are longer by", four(moveFactor(map))],
  ];
}
