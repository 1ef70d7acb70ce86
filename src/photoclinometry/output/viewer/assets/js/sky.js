// The sky above the map: the zenith in the middle, the horizon at the edge. The Sun is dragged on it.

const SKY_EDGE = 0.92; // of the disc's radius: the horizon
const MANY_VIEWS = 40; // from which on their marks become smaller, to cover no more of the sky

const SKY_DISC = {
  size: [300, 300],
  label: "The sky above the map: drag the Sun, or use the arrow keys.",
  place: onSky,
  angles: fromSky,
  drawGrid(pen, canvas) {
    const half = 0.5 * canvas.width;
    for (const elevation of [0, 30, 60]) {
      pen.beginPath();
      pen.arc(half, half, half * SKY_EDGE * (1 - elevation / 90), 0, 2 * Math.PI);
      pen.stroke();
    }
  },
};

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
  const { sky } = map.ground;
  pen.clearRect(0, 0, canvas.width, canvas.height);
  pen.strokeStyle = "#4a5866";
  pen.lineWidth = 2;
  sky.drawGrid(pen, canvas);
  const { views } = map.scene;
  const size = Math.min(1, Math.sqrt(MANY_VIEWS / views.length));
  views.forEach((view, k) => k !== state.view && drawView(pen, canvas, sky, view, OTHER_INK, size));
  drawView(pen, canvas, sky, views[state.view], INK, 1);
  const [x, y] = sky.place(canvas, state.azimuth, state.elevation);
  pen.beginPath();
  pen.arc(x, y, 13, 0, 2 * Math.PI);
  pen.fillStyle = state.elevation > map.ground.lowestSun ? INK : "#806a30";
  pen.fill();
  pen.strokeStyle = "#000";
  pen.stroke();
}

/** The Sun of a view as a circle, and its camera as a triangle. size: 1 where there are few. */
function drawView(pen, canvas, sky, view, ink, size) {
  const [sx, sy] = sky.place(canvas, view.sun_azimuth_deg, view.sun_elevation_deg);
  pen.strokeStyle = ink;
  pen.lineWidth = ink === INK ? 4 : 2 * size;
  pen.beginPath();
  pen.arc(sx, sy, 6 * size, 0, 2 * Math.PI);
  pen.stroke();
  const angles = anglesFromSun(unit(view.center));
  const [x, y] = sky.place(canvas, angles.azimuth, angles.elevation);
  pen.fillStyle = ink;
  pen.beginPath();
  pen.moveTo(x, y - 8 * size);
  pen.lineTo(x + 7 * size, y + 6 * size);
  pen.lineTo(x - 7 * size, y + 6 * size);
  pen.fill();
}

/** Dragging on the sky, or on the map of longitudes and latitudes, moves the Sun. */
function listenToSky(canvas, store, sky) {
  [canvas.width, canvas.height] = sky.size;
  canvas.setAttribute("aria-label", sky.label);
  canvas.parentElement.classList.toggle("wide", sky.size[0] > sky.size[1]);
  const move = (event) => {
    const box = canvas.getBoundingClientRect();
    const scale = canvas.width / box.width;
    store.update(sky.angles(canvas, (event.clientX - box.left) * scale, (event.clientY - box.top) * scale));
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    move(event);
  });
  canvas.addEventListener("pointermove", (event) => event.buttons && move(event));
}
