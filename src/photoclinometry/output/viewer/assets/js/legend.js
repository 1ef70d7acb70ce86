// What explains the picture: colour bar, scale bar, arrows to north and to the Sun, and a line of words.

/** A number with as many digits as its neighbours on a scale need. */
function digits(value, step) {
  const places = clamp(-Math.floor(Math.log10(step || 1) + 1e-9), 0, 8);
  return Math.abs(value) >= 1e6 || (Math.abs(step) < 1e-5 && step !== 0) ? value.toPrecision(3) : value.toFixed(places);
}

/** A number in four significant digits. */
const four = (value) => (Number.isFinite(value) ? String(Number(value.toPrecision(4))) : "–");

/** A value with its standard deviation in two digits, and as many places as that has. */
function withSigma(value, sigma, unitName) {
  if (!Number.isFinite(value) || !(sigma > 0) || !Number.isFinite(sigma)) return `${four(value)}${unitName}`;
  const places = clamp(1 - Math.floor(Math.log10(sigma)), 0, 8);
  return `${value.toFixed(places)} ± ${sigma.toFixed(places)}${unitName}`;
}

/** The colour bar at the right edge: a table's colours between two values, with ticks and the unit above. */
function drawColourBar(pen, size, table, limits, title) {
  const r = pen.ratio;
  const [width, height] = [16 * r, Math.min(260 * r, 0.45 * size[1])];
  const [left, top] = [size[0] - 84 * r, size[1] - height - 28 * r];
  pen.fillStyle = "rgba(10, 13, 16, 0.72)";
  pen.fillRect(left - 10 * r, top - 34 * r, 84 * r, height + 50 * r);
  for (let i = 0; i < height; i++) {
    const at = 3 * Math.round((1 - i / height) * (table.length / 3 - 1));
    pen.fillStyle = `rgb(${[0, 1, 2].map((k) => Math.round(255 * table[at + k])).join(",")})`;
    pen.fillRect(left, top + i, width, 1.5);
  }
  pen.strokeStyle = "#fff";
  pen.lineWidth = r;
  pen.strokeRect(left, top, width, height);
  const step = roundStep(limits[1] - limits[0], 5);
  pen.textBaseline = "middle";
  pen.textAlign = "left";
  for (let value = Math.ceil(limits[0] / step - 1e-6) * step; value <= limits[1] + 1e-6 * step; value += step) {
    const y = top + height * (1 - (value - limits[0]) / (limits[1] - limits[0]));
    pen.fillStyle = "#fff";
    pen.fillRect(left + width, y - 0.5 * r, 4 * r, r);
    pen.fillText(digits(Math.abs(value) < 1e-9 * step ? 0 : value, step), left + width + 7 * r, y);
  }
  pen.textAlign = "right";
  outlined(pen, title, size[0] - 12 * r, top - 18 * r);
  pen.textAlign = "left";
}

/** Length of ground of one pixel of the picture, in the middle of it. */
const groundPerPixel = (map, camera, size) => map.ground.depthInMiddle(map, camera, size) / camera.focal[0];

function drawScaleBar(pen, size, camera, map) {
  const { scene } = map;
  const r = pen.ratio;
  const perPixel = groundPerPixel(map, camera, size);
  const bar = roundStep(perPixel * 160 * r, 1.6);
  const pixels = bar / perPixel;
  const [x, y] = [20 * r, size[1] - 24 * r];
  pen.fillStyle = "#000";
  pen.fillRect(x - 2 * r, y - 2 * r, pixels + 4 * r, 8 * r);
  pen.fillStyle = "#fff";
  pen.fillRect(x, y, pixels, 4 * r);
  const words = scene.unit === "m" && bar >= 1000 ? `${bar / 1000} km` : `${Number(bar.toPrecision(6))} ${scene.unit}`;
  pen.textAlign = "left";
  pen.textBaseline = "alphabetic";
  outlined(pen, words, x, y - 7 * r);
}

/** An arrow from the middle of a small dial along a direction, as the camera sees it. */
function drawArrow(pen, camera, from, direction, name, colour, length) {
  const r = pen.ratio;
  const here = projected(camera, [0, 0, 0]);
  const there = projected(camera, times(direction, 1e-3 * here[2]));
  const [du, dv] = [there[0] - here[0], there[1] - here[1]];
  const size = Math.hypot(du, dv);
  if (!(size > 1e-9)) return;
  const [x, y] = [du / size, dv / size];
  const tip = [from[0] + x * length, from[1] + y * length];
  for (const [ink, width] of [
    ["rgba(0, 0, 0, 0.8)", 5],
    [colour, 2.5],
  ]) {
    pen.strokeStyle = ink;
    pen.lineWidth = width * r;
    pen.beginPath();
    pen.moveTo(...from);
    pen.lineTo(...tip);
    pen.moveTo(tip[0] - 8 * r * (x - 0.5 * y), tip[1] - 8 * r * (y + 0.5 * x));
    pen.lineTo(...tip);
    pen.lineTo(tip[0] - 8 * r * (x + 0.5 * y), tip[1] - 8 * r * (y - 0.5 * x));
    pen.stroke();
  }
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  outlined(pen, name, from[0] + x * (length + 13 * r), from[1] + y * (length + 13 * r), colour);
}

function drawArrows(pen, camera, { scene, ground }, state) {
  const r = pen.ratio;
  const from = [68 * r, 92 * r];
  const north = ground.northOf(scene);
  drawArrow(pen, camera, from, north.direction, north.name, "#fff", 32 * r);
  const sun = ground.arrowToSun(sunOf(state), camera);
  drawArrow(pen, camera, from, sun.direction, "Sun", INK, (10 + 26 * sun.across) * r);
}
