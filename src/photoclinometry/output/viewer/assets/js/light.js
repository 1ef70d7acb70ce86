// The Sun in the local frame: x right and y up in the reference image, z out of the ground. Angles in degrees.

/** Unit vector from azimuth, clockwise from y, and elevation above the mean plane. */
function sunFromAngles(azimuth, elevation) {
  const flat = Math.cos(elevation * DEGREE);
  return [flat * Math.sin(azimuth * DEGREE), flat * Math.cos(azimuth * DEGREE), Math.sin(elevation * DEGREE)];
}

function anglesFromSun(sun) {
  const azimuth = Math.atan2(sun[0], sun[1]) / DEGREE;
  return { azimuth: (azimuth + 360) % 360, elevation: Math.atan2(sun[2], Math.hypot(sun[0], sun[1])) / DEGREE };
}

/** The axis about which a day turns the Sun: the body's where it is known, else "up in the reference image". */
function axisOfDay(scene) {
  const body = scene.place.body_from_local;
  return scene.place.body_fixed ? [body[2][0], body[2][1], body[2][2]] : [0, 1, 0];
}

/** The Sun a little later: from east to west about the axis; nights are left out. turn: [rad]. */
function laterSun(axis, sun, turn) {
  let later = turnedAbout(axis, sun, -turn);
  for (let i = 0; later[2] <= 0 && i < 2000; i++) later = turnedAbout(axis, later, -0.005);
  return later[2] > 0 ? later : sun;
}

/** Direction of north along the mean plane, and its name: the body's, or "up in the reference image". */
function northOf(scene) {
  if (!scene.place.body_fixed) return { direction: [0, 1, 0], name: "up" };
  const [x, y] = axisOfDay(scene);
  return { direction: unit([x, y, 1e-12]), name: "N" };
}
