// Measurements on the map. Points are places on the grid; lengths are in the page's unit.

const STEP_SHARE = 0.5; // of the landmarks' spacing: distance of a profile's points
const MOST_STEPS = 4000;

/** Points along the straight line between two places on the mean plane, each as profilePoint has it. */
function profileOf(map, [first, last]) {
  const [from, to] = [first, last].map((place) => vectorAt(map, map.position, place));
  if (!from || !to) return [];
  const along = Math.hypot(to[0] - from[0], to[1] - from[1]);
  const count = clamp(Math.ceil(along / (STEP_SHARE * map.scene.spacing)), 1, MOST_STEPS);
  const found = [];
  let near = first;
  for (let i = 0; i <= count; i++) {
    const t = i / count;
    const [x, y] = [from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1])];
    const guess = [first[0] + t * (last[0] - first[0]), first[1] + t * (last[1] - first[1])];
    const place = placeAbove(map, x, y, near) ?? placeAbove(map, x, y, guess);
    near = place ?? guess;
    found.push(profilePoint(map, t * along, x, y, place));
  }
  return found;
}

function profilePoint(map, distance, x, y, place) {
  const of = (values) => (place && values ? valueAt(map, values, place) : NaN);
  const position = place && vectorAt(map, map.position, place);
  return {
    distance,
    x,
    y,
    position,
    height: of(map.height),
    sigma: of(map.sigma_height),
    albedo: of(map.albedo),
    slope: of(map.slope),
  };
}

/** Length along the surface of a profile; NaN where it has gaps. */
function pathLength(profile) {
  let sum = 0;
  for (let i = 1; i < profile.length; i++) {
    sum +=
      profile[i].position && profile[i - 1].position
        ? length(subtract(profile[i].position, profile[i - 1].position))
        : NaN;
  }
  return sum;
}

/** Area of a polygon of points (x, y) by the shoelace formula. */
function polygonArea(points) {
  let twice = 0;
  points.forEach(([x, y], i) => {
    const [nextX, nextY] = points[(i + 1) % points.length];
    twice += x * nextY - nextX * y;
  });
  return Math.abs(twice) / 2;
}

function isInside(x, y, points) {
  let inside = false;
  points.forEach(([ax, ay], i) => {
    const [bx, by] = points[(i + 1) % points.length];
    if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) inside = !inside;
  });
  return inside;
}

/** Area of the map's triangles whose middle lies above a polygon (x, y): of the surface, and across the vertical. */
function areaOfSurface(map, points) {
  const count = map.faces.length / 3;
  let [surface, plane] = [0, 0];
  for (let f = 0; f < count; f++) {
    const [a, b, c] = [0, 1, 2].map((i) => positionOf(map, map.faces[i * count + f]));
    if (!isInside((a[0] + b[0] + c[0]) / 3, (a[1] + b[1] + c[1]) / 3, points)) continue;
    const normal = cross(subtract(b, a), subtract(c, a));
    surface += length(normal) / 2;
    plane += Math.abs(normal[2]) / 2;
  }
  return { surface, plane };
}

/** Rows [quantity, value] of a measurement, and its profile where it is one. */
function measured(map, state) {
  const { tool, points } = state;
  const grounds = points.map((place) => vectorAt(map, map.position, place));
  if (grounds.some((point) => !point)) return { rows: [], profile: null };
  if (tool === "profile" && points.length === 2) return profileRows(map, grounds, profileOf(map, points));
  if (tool === "angle" && points.length === 3) return { rows: angleRows(map, grounds), profile: null };
  if (tool === "area" && points.length > 2) return { rows: areaRows(map, grounds), profile: null };
  return { rows: [], profile: null };
}

function profileRows(map, [a, b], profile) {
  const { unit: name } = map.scene;
  const across = Math.hypot(b[0] - a[0], b[1] - a[1]);
  const [first, last] = [profile[0], profile[profile.length - 1]];
  const sigma = Math.hypot(first.sigma, last.sigma);
  const rows = [
    ["distance", `${four(length(subtract(b, a)))} ${name}`],
    ["along the mean plane", `${four(across)} ${name}`],
    ["along the surface", `${four(pathLength(profile))} ${name}`],
    ["height of B above A", withSigma(b[2] - a[2], sigma, ` ${name}`)],
    ["slope from A to B", `${four(Math.atan2(b[2] - a[2], across) / DEGREE)}°`],
    ["azimuth from A to B", `${four(anglesFromSun([b[0] - a[0], b[1] - a[1], 0]).azimuth)}°`],
  ];
  return { rows, profile };
}

function angleRows(map, [a, b, c]) {
  const flat = (v) => [v[0], v[1], 0];
  const [to, from] = [subtract(a, b), subtract(c, b)];
  return [
    ["angle at B", `${four(angleBetween(to, from) / DEGREE)}°`],
    ["in the mean plane", `${four(angleBetween(flat(to), flat(from)) / DEGREE)}°`],
    ["A to B", `${four(length(to))} ${map.scene.unit}`],
    ["B to C", `${four(length(from))} ${map.scene.unit}`],
  ];
}

function areaRows(map, grounds) {
  const square = `${map.scene.unit}²`;
  const { surface, plane } = areaOfSurface(map, grounds);
  const round = grounds.reduce((sum, point, i) => sum + length(subtract(grounds[(i + 1) % grounds.length], point)), 0);
  return [
    ["area in the mean plane", `${four(polygonArea(grounds))} ${square}`],
    ["of it mapped", `${four(plane)} ${square}`],
    ["area of the surface", `${four(surface)} ${square}`],
    ["circumference", `${four(round)} ${map.scene.unit}`],
  ];
}
