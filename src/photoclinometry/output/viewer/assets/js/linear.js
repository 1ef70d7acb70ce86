// Vectors are arrays of three numbers; matrices are nine, row by row.

const DEGREE = Math.PI / 180;

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const times = (a, factor) => [a[0] * factor, a[1] * factor, a[2] * factor];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const length = (a) => Math.hypot(a[0], a[1], a[2]);
const unit = (a) => times(a, 1 / length(a));
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** Matrix times vector. */
const turned = (m, v) => [dot(m.slice(0, 3), v), dot(m.slice(3, 6), v), dot(m.slice(6, 9), v)];

const transposed = (m) => [m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]];

/** Angle [rad] between vectors, exact near 0 and pi. */
const angleBetween = (a, b) => Math.atan2(length(cross(a, b)), dot(a, b));

/** A vector turned about a unit axis by an angle [rad] (Rodrigues). */
function turnedAbout(axis, vector, angle) {
  const along = times(axis, dot(axis, vector) * (1 - Math.cos(angle)));
  return add(add(times(vector, Math.cos(angle)), times(cross(axis, vector), Math.sin(angle))), along);
}

const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

/** The value below which a share of finite numbers lies; of many numbers, of an even choice of them. */
function percentile(values, share, most = 20000) {
  const step = Math.max(1, Math.floor(values.length / most));
  const chosen = [];
  for (let i = 0; i < values.length; i += step) if (Number.isFinite(values[i])) chosen.push(values[i]);
  chosen.sort((a, b) => a - b);
  return chosen.length ? chosen[Math.round(share * (chosen.length - 1))] : NaN;
}
