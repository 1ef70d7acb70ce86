// Measurements on the map. Points are places; lengths are in the page's unit.

const STEP_SHARE = 0.5; // of the landmarks' spacing: distance of a profile's points
const MOST_STEPS = 4000;

/** Points along the straight line between two places on the mean plane, each as profilePoint has it. */
function profileOverPlane(map, [first, last]) {
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
    albedo: of(map.knownAlbedo),
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

/** Coordinates (x, y) across a direction. */
function flattener(up) {
  const right = unit(cross(Math.abs(up[1]) < 0.9 ? [0, 1, 0] : [0, 0, -1], up));
  const ahead = cross(up, right);
  return (point) => [dot(point, right), dot(point, ahead)];
}

/** Area of the ground's triangles whose middle lies over a polygon: of the surface, and across a direction. */
function areaOfSurface(map, grounds, up) {
  const count = map.faces.length / 3;
  const flat = flattener(up);
  const corners = grounds.map(flat);
  const isOver = map.ground.isOver(grounds, up);
  let [surface, plane] = [0, 0];
  for (let f = 0; f < count; f++) {
    const [a, b, c] = [0, 1, 2].map((i) => positionOf(map, map.faces[i * count + f]));
    const middle = times(add(add(a, b), c), 1 / 3);
    if (!isInside(...flat(middle), corners)) continue;
    const normal = cross(subtract(b, a), subtract(c, a));
    if (!isOver(middle, normal)) continue;
    surface += length(normal) / 2;
    plane += Math.abs(dot(normal, up)) / 2;
  }
  return { surface, plane };
}

/** Rows [quantity, value] of a measurement, and its profile where it is one. */
function measured(map, state) {
  const { tool, points } = state;
  const grounds = points.map((place) => vectorAt(map, map.position, place));
  if (grounds.some((point) => !point)) return { rows: [], profile: null };
  if (tool === "profile" && points.length === 2) {
    const profile = map.ground.profileOf(map, points);
    if (!profile.length) return { rows: [["no profile", "no ground joins A and B"]], profile: null };
    return { rows: map.ground.profileRows(map, grounds, profile), profile };
  }
  if (points.length < 3) return { rows: [], profile: null };
  const up = map.ground.upOf(map, points);
  if (tool === "angle" && points.length === 3) return { rows: angleRows(map, grounds, up), profile: null };
  return { rows: tool === "area" ? areaRows(map, grounds, up) : [], profile: null };
}

function rowsOverPlane(map, [a, b], profile) {
  const { unit: name } = map.scene;
  const across = Math.hypot(b[0] - a[0], b[1] - a[1]);
  const [first, last] = [profile[0], profile[profile.length - 1]];
  const sigma = Math.hypot(first.sigma, last.sigma);
  return [
    ["distance", `${four(length(subtract(b, a)))} ${name}`],
    ["along the mean plane", `${four(across)} ${name}`],
    ["along the surface", `${four(pathLength(profile))} ${name}`],
    ["height of B above A", withSigma(b[2] - a[2], sigma, ` ${name}`)],
    ["slope from A to B", `${four(Math.atan2(b[2] - a[2], across) / DEGREE)}°`],
    ["azimuth from A to B", `${four(anglesFromSun([b[0] - a[0], b[1] - a[1], 0]).azimuth)}°`],
  ];
}

function rowsOfSection(map, [a, b], profile) {
  const { unit: name } = map.scene;
  const heights = profile.map((point) => point.height);
  const [low, high] = [Math.min(...heights), Math.max(...heights)];
  const sigma = Math.hypot(profile[0].sigma, profile[profile.length - 1].sigma);
  return [
    ["distance", `${four(length(subtract(b, a)))} ${name}`],
    ["along the surface", `${four(pathLength(profile))} ${name}`],
    ["lowest and highest above A to B", `${four(low)}, ${four(high)} ${name}`],
    ["radius of B less that of A", withSigma(length(b) - length(a), sigma, ` ${name}`)],
  ];
}

function angleRows(map, [a, b, c], up) {
  const flat = (v) => subtract(v, times(up, dot(v, up)));
  const [to, from] = [subtract(a, b), subtract(c, b)];
  return [
    ["angle at B", `${four(angleBetween(to, from) / DEGREE)}°`],
    [`in the ${map.ground.planeName}`, `${four(angleBetween(flat(to), flat(from)) / DEGREE)}°`],
    ["A to B", `${four(length(to))} ${map.scene.unit}`],
    ["B to C", `${four(length(from))} ${map.scene.unit}`],
  ];
}

function areaRows(map, grounds, up) {
  const square = `${map.scene.unit}²`;
  const { surface, plane } = areaOfSurface(map, grounds, up);
  const round = grounds.reduce((sum, point, i) => sum + length(subtract(grounds[(i + 1) % grounds.length], point)), 0);
  return [
    [`area in the ${map.ground.planeName}`, `${four(polygonArea(grounds.map(flattener(up))))} ${square}`],
    ["of it mapped", `${four(plane)} ${square}`],
    ["area of the surface", `${four(surface)} ${square}`],
    ["circumference", `${four(round)} ${map.scene.unit}`],
  ];
}
