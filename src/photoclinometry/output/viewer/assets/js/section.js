// Profiles over a closed surface: its section by the plane through two points that contains the mean of their normals.

/** Points of the section from the first place to the second, the shorter way, each as profilePoint has it.
 *
 * Distances are along the straight line between both, heights are above it. None where the plane cuts the two points'
 * surface into separate curves.
 */
function profileOfSection(map, [first, last]) {
  const [from, to] = [first, last].map((place) => vectorAt(map, map.position, place));
  if (!from || !to || length(subtract(to, from)) === 0) return [];
  const along = unit(subtract(to, from));
  const mean = meanNormal(map, [first, last]);
  const up = unit(subtract(mean, times(along, dot(mean, along))));
  const curve = curveBetween(sectionOf(map, cross(along, up), from), from, to);
  // Where the plane goes through a vertex, all its cut edges have their points there.
  const least = 1e-6 * map.scene.spacing;
  const apart = curve.filter((at, i) => !i || length(subtract(at.position, curve[i - 1].position)) > least);
  return apart.map((at) => sectionPoint(map, at, from, along, up));
}

/** The section by the plane through a point across a normal: points on edges, and their two neighbours along it. */
function sectionOf(map, normal, point) {
  const side = new Float64Array(map.count);
  for (let j = 0; j < map.count; j++) {
    const value = dot(normal, subtract(positionOf(map, j), point));
    side[j] = value === 0 ? Number.MIN_VALUE : value;
  }
  const count = map.faces.length / 3;
  const nodes = new Map();
  const node = (a, b) => {
    const key = Math.min(a, b) * map.count + Math.max(a, b);
    if (!nodes.has(key)) nodes.set(key, { ends: [a, b], share: side[a] / (side[a] - side[b]), next: [] });
    return nodes.get(key);
  };
  for (let f = 0; f < count; f++) {
    const corners = [map.faces[f], map.faces[count + f], map.faces[2 * count + f]];
    const cut = [0, 1, 2].filter((i) => side[corners[i]] > 0 !== side[corners[(i + 1) % 3]] > 0);
    if (cut.length !== 2) continue;
    const [one, other] = cut.map((i) => node(corners[i], corners[(i + 1) % 3]));
    one.next.push(other);
    other.next.push(one);
  }
  for (const at of nodes.values())
    at.position = mixed(positionOf(map, at.ends[0]), positionOf(map, at.ends[1]), at.share);
  return [...nodes.values()];
}

const mixed = (a, b, share) => add(times(a, 1 - share), times(b, share));

/** The nodes from that nearest to one point to that nearest to another, the shorter way round their closed curve. */
function curveBetween(nodes, from, to) {
  const nearest = (point) =>
    nodes.reduce((best, at) =>
      length(subtract(at.position, point)) < length(subtract(best.position, point)) ? at : best,
    );
  if (!nodes.length) return [];
  const [start, end] = [nearest(from), nearest(to)];
  const ways = start.next.map((second) => walk(start, second, end, nodes.length)).filter((way) => way.length);
  return ways.sort((a, b) => pathLength(a) - pathLength(b))[0] ?? [];
}

function walk(start, second, end, most) {
  const way = [start, second];
  while (way[way.length - 1] !== end) {
    const [before, here] = way.slice(-2);
    const next = here.next.find((at) => at !== before);
    if (!next || next === start || way.length > most) return [];
    way.push(next);
  }
  return way;
}

/** What a profile has at a node: values between the ends of its edge. */
function sectionPoint(map, { ends: [a, b], share, position }, from, along, up) {
  const of = (values) => (values ? (1 - share) * values[a] + share * values[b] : NaN);
  const offset = subtract(position, from);
  return {
    distance: dot(offset, along),
    x: position[0],
    y: position[1],
    z: position[2],
    position,
    height: dot(offset, up),
    sigma: of(map.sigma_height),
    albedo: of(map.knownAlbedo),
    slope: of(map.slope),
  };
}
