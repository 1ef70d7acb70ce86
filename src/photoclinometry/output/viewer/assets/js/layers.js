// What can be shown of the map: name, unit, colours, limits and values of each layer.

const STEEP_SHARE = 0.98; // share of values below the colour scale's end; the largest few saturate
const STRETCH = [0.005, 0.995]; // shares of brightness that are shown black and white

/** The layers of a map. values: array (J,), or null for those that depend on the Sun and the camera. */
function layersOf(map) {
  const { scene } = map;
  const length = scene.unit;
  const absolute = scene.brightness === "iof";
  const found = [];
  const layer = (key, title, unit, table, values, options = {}) => {
    if (values !== undefined) found.push({ key, title, unit, table, values, ...options });
  };
  if (scene.reflectance) layer("rendering", "rendering", absolute ? "I/F" : "DN", "gray", null);
  layer("relief", "shaded relief", "cosine of incidence", "gray", null, { limits: [0, 1] });
  layer("albedo", absolute ? "normal albedo" : "relative albedo", "", "gray", map.knownAlbedo, { spread: [0.01, 0.99] });
  const asHeight = { spread: [0.01, 0.99], shaded: true, contours: true };
  layer("height", map.ground.heightName, length, "viridis", map.height, asHeight);
  layer("slope", "slope", "°", "magma", map.slope, { shaded: true });
  layer("sigma_height", "sigma of height", length, "cividis", map.sigma_height);
  layer("sigma_position", "sigma of position", length, "cividis", map.sigma_position);
  layer("sigma_normal", "sigma of normal", "°", "cividis", map.sigma_normal);
  layer("sigma_albedo", "sigma of albedo", "%", "cividis", map.sigma_albedo);
  layer("sigma_albedo_relative", "sigma of relative albedo", "%", "cividis", map.sigma_albedo_relative);
  layer("views", "views per landmark", "views", "viridis", map.views, { limits: [0, scene.views.length] });
  layer("tile", "tile", "", "viridis", map.tile);
  layer("residual", "photometric residual", "% of brightness", "magma", map.residual);
  return found;
}

/** Values at the ends of a layer's colours. */
function limitsOf(layer) {
  if (layer.limits) return layer.limits;
  const [low, high] = layer.spread ?? [null, STEEP_SHARE];
  const bottom = low === null ? 0 : percentile(layer.values, low);
  const top = percentile(layer.values, high);
  layer.limits = top > bottom ? [bottom, top] : [bottom || 0, (bottom || 0) + 1e-6];
  return layer.limits;
}

/** Cosine of incidence (J,), 0 where the ground is turned away from the Sun. */
function cosines(map, sun) {
  const found = new Float32Array(map.count);
  for (let j = 0; j < map.count; j++) found[j] = Math.max(dot(normalOf(map, j), sun), 0);
  return found;
}

/** Black and white of a rendering: 0, and the brightest but for a few. target: as brightnessOf draws it. */
function exposureOf(renderer, target, factors) {
  const read = readBack(renderer.gl, target);
  const values = [];
  const step = 4 * Math.max(1, Math.floor(read.length / 80000));
  for (let i = 0; i < read.length; i += step)
    if (read[i + 1] > 0) values.push((factors[0] * read[i]) / read[i + 1] + factors[1]);
  const top = percentile(values, STRETCH[1]);
  return [Math.min(0, factors[1]), top > 0 ? top : 1];
}

/** Black, white and mean of a picture's brightness. */
function stretchOf(picture) {
  if (!picture.stretch) {
    const [low, high] = STRETCH.map((share) => percentile(picture.values, share));
    let [sum, count] = [0, 0];
    for (const value of picture.values) if (Number.isFinite(value)) [sum, count] = [sum + value, count + 1];
    picture.stretch = { limits: high > low ? [low, high] : [0, 1], mean: count ? sum / count : 1 };
  }
  return picture.stretch;
}

/** A round number near a tenth of a range: 1, 2 or 5 times a power of ten. */
function roundStep(range, parts = 10) {
  const raw = range / parts;
  const power = 10 ** Math.floor(Math.log10(raw));
  return power * ([1, 2, 5, 10].find((factor) => factor * power >= raw * 0.999) ?? 10);
}
