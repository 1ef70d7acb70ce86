// The values under the cursor, with their standard deviations.

/** Rows [quantity, value] at a place of the map. center: of the camera; value: what the picture shows. */
function valuesAt(map, place, state, center) {
  const { scene } = map;
  const of = (values) => (values ? valueAt(map, values, place) : NaN);
  const position = vectorAt(map, map.position, place);
  if (!position) return [];
  const { grid, unit: length } = scene;
  const rows = [
    [
      "reference column, row",
      `${four(grid.col + 0.5 + grid.stride * place[0])}, ${four(grid.row + 0.5 + grid.stride * place[1])} px`,
    ],
    ["x, y", `${four(position[0])}, ${four(position[1])} ${length}`],
    ["height", withSigma(position[2], of(map.sigma_height), ` ${length}`)],
    ["slope", withSigma(of(map.slope), of(map.sigma_normal), "°")],
  ];
  if (map.albedo) rows.push(["albedo", withSigma(of(map.albedo), (of(map.albedo) * of(map.sigma_albedo)) / 100, "")]);
  if (scene.place.body_fixed) rows.push(...onBody(scene, position));
  rows.push(...anglesAt(map, place, position, state, center));
  if (map.residual) rows.push(["photometric residual", `${four(of(map.residual))} %`]);
  rows.push(["views", four(of(map.views))]);
  return rows;
}

/** The row of what the picture shows, where no other row has it. */
function shownValue(layer, value) {
  const listed = ["height", "slope", "albedo", "views", "residual"].includes(layer.key);
  return listed ? [] : [[layer.title, `${four(value)} ${layer.unit}`]];
}

/** East longitude and planetocentric latitude [degrees] and distance from the body's centre [m]. */
function onBody(scene, position) {
  const { body_from_local: rotation, origin } = scene.place;
  const [x, y, z] = add(turned(rotation.flat(), position), origin);
  const longitude = (Math.atan2(y, x) / DEGREE + 360) % 360;
  const latitude = Math.atan2(z, Math.hypot(x, y)) / DEGREE;
  return [
    ["longitude, latitude", `${longitude.toFixed(4)}° E, ${latitude.toFixed(4)}°`],
    ["distance from centre", `${Math.hypot(x, y, z).toFixed(1)} m`],
  ];
}

/** Incidence, emission and phase under the Sun and the camera of the picture. */
function anglesAt(map, place, position, state, center) {
  const normal = vectorAt(map, map.normal, place);
  const [sun, camera] = [sunOf(state), unit(subtract(center, position))];
  const names = ["incidence", "emission", "phase"];
  const angles = [angleBetween(normal, sun), angleBetween(normal, camera), angleBetween(sun, camera)];
  return [[names.join(", "), angles.map((angle) => `${(angle / DEGREE).toFixed(1)}°`).join(", ")]];
}
