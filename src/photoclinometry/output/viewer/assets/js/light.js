// The Sun in the local frame: x right and y up in the reference image, z out of the ground; of a whole body the body's
// frame. Angles in degrees.

/** Unit vector from azimuth, clockwise from y, and elevation above the mean plane. */
function sunFromAngles(azimuth, elevation) {
  const flat = Math.cos(elevation * DEGREE);
  return [flat * Math.sin(azimuth * DEGREE), flat * Math.cos(azimuth * DEGREE), Math.sin(elevation * DEGREE)];
}

function anglesFromSun(sun) {
  const azimuth = Math.atan2(sun[0], sun[1]) / DEGREE;
  return { azimuth: (azimuth + 360) % 360, elevation: Math.atan2(sun[2], Math.hypot(sun[0], sun[1])) / DEGREE };
}

/** The Sun a little later: from east to west about the axis. turn: [rad]. */
const laterSun = (axis, sun, turn) => turnedAbout(axis, sun, -turn);

/** The same where the Sun rises and sets: nights are left out. */
function laterSunByDay(axis, sun, turn) {
  let later = laterSun(axis, sun, turn);
  for (let i = 0; later[2] <= 0 && i < 2000; i++) later = turnedAbout(axis, later, -0.005);
  return later[2] > 0 ? later : sun;
}
