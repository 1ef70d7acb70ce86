// The Sun over a body: a map of longitudes (west to east, 0 to 360) and latitudes, on which the Sun is dragged.

const SUN_MAP = {
  size: [640, 320],
  label: "Longitudes and latitudes: drag the Sun, or use the arrow keys.",
  place: (canvas, azimuth, elevation) => [
    (BODY.shownAzimuth(azimuth) / 360) * canvas.width,
    (0.5 - elevation / 180) * canvas.height,
  ],
  angles: (canvas, x, y) => ({
    azimuth: BODY.shownAzimuth(clamp(x / canvas.width, 0, 0.99999) * 360),
    elevation: 180 * (0.5 - clamp(y / canvas.height, 0, 1)),
  }),
  drawGrid(pen, canvas) {
    pen.beginPath();
    for (let i = 0; i <= 6; i++) {
      const [x, y] = [(i / 6) * canvas.width, (i / 6) * canvas.height];
      pen.moveTo(x, 0);
      pen.lineTo(x, canvas.height);
      pen.moveTo(0, y);
      pen.lineTo(canvas.width, y);
    }
    pen.stroke();
  },
};
