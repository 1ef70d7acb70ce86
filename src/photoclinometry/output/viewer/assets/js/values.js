// The values under the cursor, with their standard deviations.

/** Rows [quantity, value] at a place of the map. center: of the camera. */
function valuesAt(map, place, state, center) {
  const { scene, ground } = map;
  const of = (values) => (values ? valueAt(map, values, place) : NaN);
  const position = vectorAt(map, map.position, place);
  if (!position) return [];
  const { unit: name } = scene;
  const rows = [
    ...ground.placeRows(scene, place, position),
    [ground.heightName, withSigma(ground.heightOf(position), of(map.sigma_height), ` ${name}`)],
    // A slope is one of the two axes of a normal's error.
    [ground.slopeName, withSigma(of(map.slope), of(map.sigma_normal) / Math.SQRT2, "°")],
  ];
  const albedo = of(map.knownAlbedo);
  if (map.albedo) rows.push(["albedo", withSigma(albedo, (albedo * of(map.sigma_albedo)) / 100, "")]);
  rows.push(...anglesAt(map, place, position, state, center));
  if (map.residual) rows.push(["photometric residual", `${four(of(map.residual))} %`]);
  if (map.views) rows.push(["views", four(of(map.views))]);
  if (map.tile && Number.isFinite(of(map.tile))) rows.push(["tile", four(of(map.tile))]);
  return rows;
}

/** The row of what the picture shows, where no other row has it. */
function shownValue(layer, value) {
  const listed = ["height", "slope", "albedo", "views", "tile", "residual"].includes(layer.key);
  return listed ? [] : [[layer.title, `${four(value)} ${layer.unit}`]];
}

/** Rows of a point of the local frame: east longitude, planetocentric latitude, and distance from the centre [m]. */
function onBody(scene, position) {
  const { body_from_local: rotation, origin } = scene.place;
  const [x, y, z] = add(turned(rotation.flat(), position), origin);
  return [lonLatRow([x, y, z]), ["distance from centre", `${length([x, y, z]).toFixed(1)} m`]];
}

/** East longitude and planetocentric latitude of a point about the origin. */
function lonLatRow([x, y, z]) {
  const longitude = (Math.atan2(y, x) / DEGREE + 360) % 360;
  const latitude = Math.atan2(z, Math.hypot(x, y)) / DEGREE;
  return ["longitude, latitude", `${longitude.toFixed(4)}° E, ${latitude.toFixed(4)}°`];
}

/** Incidence, emission and phase under the Sun and the camera of the picture. */
function anglesAt(map, place, position, state, center) {
  const normal = vectorAt(map, map.normal, place);
  const [sun, camera] = [sunOf(state), unit(subtract(center, position))];
  const names = ["incidence", "emission", "phase"];
  const angles = [angleBetween(normal, sun), angleBetween(normal, camera), angleBetween(sun, camera)];
  return [[names.join(", "), angles.map((angle) => `${(angle / DEGREE).toFixed(1)}°`).join(", ")]];
}
