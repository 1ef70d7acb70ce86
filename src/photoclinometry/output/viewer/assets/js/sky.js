// The sky above the map: the zenith in the middle, the horizon at the edge. The Sun is dragged on it.

const SKY_EDGE = 0.92; // of the disc's radius: the horizon

/** Place on the disc of a direction; below the horizon it lies at the edge. */
function onSky(canvas, azimuth, elevation) {
  const radius = 0.5 * canvas.width * SKY_EDGE * (1 - Math.max(elevation, 0) / 90);
  const half = 0.5 * canvas.width;
  return [half + radius * Math.sin(azimuth * DEGREE), half - radius * Math.cos(azimuth * DEGREE)];
}

/** Azimuth and elevation of a place on the disc. */
function fromSky(canvas, x, y) {
  const half = 0.5 * canvas.width;
  const [right, up] = [x - half, half - y];
  const share = Math.min(Math.hypot(right, up) / (half * SKY_EDGE), 1);
  return { azimuth: (Math.atan2(right, up) / DEGREE + 360) % 360, elevation: 90 * (1 - share) };
}

function drawSky(canvas, map, state) {
  const pen = canvas.getContext("2d");
  const half = 0.5 * canvas.width;
  pen.clearRect(0, 0, canvas.width, canvas.height);
  pen.strokeStyle = "#4a5866";
  pen.lineWidth = 2;
  for (const elevation of [0, 30, 60]) {
    pen.beginPath();
    pen.arc(half, half, half * SKY_EDGE * (1 - elevation / 90), 0, 2 * Math.PI);
    pen.stroke();
  }
  map.scene.views.forEach((view, k) => drawView(pen, canvas, view, k === state.view));
  const [x, y] = onSky(canvas, state.azimuth, state.elevation);
  pen.beginPath();
  pen.arc(x, y, 13, 0, 2 * Math.PI);
  pen.fillStyle = state.elevation > 0 ? INK : "#806a30";
  pen.fill();
  pen.strokeStyle = "#000";
  pen.stroke();
}

function drawView(pen, canvas, view, chosen) {
  const ink = chosen ? INK : OTHER_INK;
  const [sx, sy] = onSky(canvas, view.sun_azimuth_deg, view.sun_elevation_deg);
  pen.strokeStyle = ink;
  pen.lineWidth = chosen ? 4 : 2;
  pen.beginPath();
  pen.arc(sx, sy, 6, 0, 2 * Math.PI);
  pen.stroke();
  const angles = anglesFromSun(unit(view.center));
  const [x, y] = onSky(canvas, angles.azimuth, angles.elevation);
  pen.fillStyle = ink;
  pen.beginPath();
  pen.moveTo(x, y - 8);
  pen.lineTo(x + 7, y + 6);
  pen.lineTo(x - 7, y + 6);
  pen.fill();
}

/** Dragging on the disc moves the Sun. */
function listenToSky(canvas, store) {
  const move = (event) => {
    const box = canvas.getBoundingClientRect();
    const scale = canvas.width / box.width;
    store.update(fromSky(canvas, (event.clientX - box.left) * scale, (event.clientY - box.top) * scale));
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    move(event);
  });
  canvas.addEventListener("pointermove", (event) => event.buttons && move(event));
}
