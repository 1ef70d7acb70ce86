// The map: landmarks with their values, on a grid of the reference image's pixels, or vertices of a closed surface.

/** All that the page holds of a map, decoded. Arrays (J,) have one number per landmark; vectors are three columns. */
async function readMap(scene) {
  const stored = scene.landmarks;
  const names = Object.keys(stored).filter((name) => name !== "cell");
  const [cell, faces, coarseFaces, around, ...columns] = await Promise.all([
    wholeNumbers(stored.cell),
    wholeNumbers(scene.faces),
    scene.coarse_faces ? wholeNumbers(scene.coarse_faces) : null,
    scene.surroundings ? numbers(scene.surroundings.depth) : null,
    ...names.map((name) => numbers(stored[name])),
  ]);
  const map = { ...Object.fromEntries(names.map((name, i) => [name, columns[i]])), scene, cell, faces, around };
  Object.assign(map, { coarseFaces, ground: scene.kind === "body" ? BODY : REGION });
  map.count = cell.length;
  map.rows = scene.grid.rows;
  map.cols = scene.grid.cols;
  map.landmarkAt = new Int32Array(map.rows * map.cols).fill(-1);
  cell.forEach((at, j) => (map.landmarkAt[at] = j));
  map.height = Float32Array.from(cell, (at, j) => map.ground.heightOf(positionOf(map, j)));
  map.anyAlbedo = map.albedo ? percentile(map.albedo, 0.5) : 1;
  map.slope = unlessMarked(slopes(map), map.unknown_normal);
  map.knownAlbedo = map.albedo && unlessMarked(map.albedo, map.unknown_albedo);
  map.radius = halfSize(map);
  map.pictures = scene.pictures.map(() => undefined);
  return map;
}

const positionOf = (map, j) => [map.position[j], map.position[map.count + j], map.position[2 * map.count + j]];
const normalOf = (map, j) => [map.normal[j], map.normal[map.count + j], map.normal[2 * map.count + j]];

/** Albedo of a landmark in renderings: the median where it is not known. */
const albedoOf = (map, j) => (map.albedo && Number.isFinite(map.albedo[j]) ? map.albedo[j] : map.anyAlbedo);

/** Values (J,), NaN for marked landmarks, whose values nothing determines. */
const unlessMarked = (values, marks) => (marks ? values.map((value, j) => (marks[j] > 0 ? NaN : value)) : values);

/** Angle of the normals to the ground's vertical [degrees]. */
function slopes(map) {
  const found = new Float32Array(map.count);
  for (let j = 0; j < map.count; j++)
    found[j] = angleBetween(normalOf(map, j), map.ground.upAt(positionOf(map, j))) / DEGREE;
  return found;
}

/** Distance of the farthest landmark from the origin. */
function halfSize(map) {
  let most = 0;
  for (let j = 0; j < map.count; j++) most = Math.max(most, length(positionOf(map, j)));
  return most;
}

/** Brightness of a view's picture, decoded at its first use; null where the page holds none. */
async function pictureOf(map, view) {
  const stored = map.scene.pictures[view];
  if (stored && !map.pictures[view]) map.pictures[view] = { ...stored, values: await numbers(stored.brightness) };
  return map.pictures[view] || null;
}
