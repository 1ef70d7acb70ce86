// Values of the map between landmarks, and places above the mean plane. A place is [column, row] of the grid.

/** Landmarks and weights of bilinear interpolation at a place of the grid; null where one of the four is missing. */
function cornersOnGrid(map, place) {
  const col = clamp(Math.floor(place[0]), 0, map.cols - 2);
  const row = clamp(Math.floor(place[1]), 0, map.rows - 2);
  const [u, v] = [place[0] - col, place[1] - row];
  if (!(u >= -1e-3 && u <= 1.001 && v >= -1e-3 && v <= 1.001)) return null;
  const cells = [
    row * map.cols + col,
    row * map.cols + col + 1,
    (row + 1) * map.cols + col,
    (row + 1) * map.cols + col + 1,
  ];
  const found = cells.map((cell) => map.landmarkAt[cell]);
  return found.every((j) => j >= 0)
    ? { landmarks: found, weights: [(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v] }
    : null;
}

/** An array (J,) between landmarks; NaN where there is none. */
function valueAt(map, values, place) {
  const at = map.ground.cornersAt(map, place);
  return at ? at.landmarks.reduce((sum, j, i) => sum + at.weights[i] * values[j], 0) : NaN;
}

/** Three columns (J,) between landmarks; null where there are none. */
function vectorAt(map, values, place) {
  const at = map.ground.cornersAt(map, place);
  if (!at) return null;
  return [0, 1, 2].map((k) => at.landmarks.reduce((sum, j, i) => sum + at.weights[i] * values[k * map.count + j], 0));
}

const NEWTON_STEPS = 8;

/** The place above a point (x, y) of the mean plane, by Newton's method from a place near it; null: there is none. */
function placeAbove(map, x, y, start) {
  let place = [...start];
  for (let i = 0; i < NEWTON_STEPS; i++) {
    const here = vectorAt(map, map.position, place);
    if (!here) return null;
    const miss = [x - here[0], y - here[1]];
    if (Math.hypot(...miss) < 1e-3 * map.scene.spacing) return place;
    const side = (value, last) => (value + 0.5 <= last ? 0.5 : -0.5);
    const [du, dv] = [side(place[0], map.cols - 1), side(place[1], map.rows - 1)];
    const right = vectorAt(map, map.position, [place[0] + du, place[1]]);
    const down = vectorAt(map, map.position, [place[0], place[1] + dv]);
    if (!right || !down) return null;
    const a = [(right[0] - here[0]) / du, (right[1] - here[1]) / du];
    const b = [(down[0] - here[0]) / dv, (down[1] - here[1]) / dv];
    const area = a[0] * b[1] - a[1] * b[0];
    place = [place[0] + (miss[0] * b[1] - miss[1] * b[0]) / area, place[1] + (a[0] * miss[1] - a[1] * miss[0]) / area];
    place = [clamp(place[0], 0, map.cols - 1), clamp(place[1], 0, map.rows - 1)];
  }
  return null;
}
