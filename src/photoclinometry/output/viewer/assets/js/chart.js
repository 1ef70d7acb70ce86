// The chart of a profile: height over distance, with the band of one standard deviation, dark on white for print.

const CHART_MARGIN = { left: 84, right: 16, top: 16, bottom: 74 };

/** Draws a profile; `unit` is that of both axes. */
function drawChart(canvas, profile, unitName) {
  const pen = canvas.getContext("2d");
  pen.fillStyle = "#fff";
  pen.fillRect(0, 0, canvas.width, canvas.height);
  pen.font = '25px system-ui, "DejaVu Sans", sans-serif';
  const known = profile.filter((point) => Number.isFinite(point.height));
  if (!known.length) return;
  const spread = (point) => (Number.isFinite(point.sigma) ? point.sigma : 0);
  const low = Math.min(...known.map((point) => point.height - spread(point)));
  const high = Math.max(...known.map((point) => point.height + spread(point)));
  const pad = 0.06 * (high - low) || 1;
  const axes = axesOf(canvas, [0, profile[profile.length - 1].distance || 1], [low - pad, high + pad]);
  drawAxes(pen, canvas, axes, unitName);
  for (const run of runsOf(profile)) {
    pen.beginPath();
    run.forEach((point) => pen.lineTo(axes.x(point.distance), axes.y(point.height + spread(point))));
    [...run].reverse().forEach((point) => pen.lineTo(axes.x(point.distance), axes.y(point.height - spread(point))));
    pen.fillStyle = "rgba(0, 114, 178, 0.3)";
    pen.fill();
    pen.beginPath();
    run.forEach((point) => pen.lineTo(axes.x(point.distance), axes.y(point.height)));
    pen.strokeStyle = "#003a5c";
    pen.lineWidth = 2.5;
    pen.stroke();
  }
}

/** Parts of a profile without gaps. */
function runsOf(profile) {
  const runs = [[]];
  for (const point of profile) {
    if (Number.isFinite(point.height)) runs[runs.length - 1].push(point);
    else runs.push([]);
  }
  return runs.filter((run) => run.length);
}

function axesOf(canvas, across, up) {
  const { left, right, top, bottom } = CHART_MARGIN;
  const [width, height] = [canvas.width - left - right, canvas.height - top - bottom];
  return {
    across,
    up,
    x: (value) => left + (width * (value - across[0])) / (across[1] - across[0]),
    y: (value) => top + height * (1 - (value - up[0]) / (up[1] - up[0])),
  };
}

function drawAxes(pen, canvas, axes, unitName) {
  const { left, right, top, bottom } = CHART_MARGIN;
  pen.fillStyle = "#222";
  pen.strokeStyle = "#ddd";
  pen.lineWidth = 1;
  const ticks = ([low, high], parts, draw) => {
    const step = roundStep(high - low, parts);
    for (let value = Math.ceil(low / step) * step; value <= high; value += step)
      draw(Math.abs(value) < 1e-9 * step ? 0 : value, step);
  };
  const rule = (...points) => {
    pen.beginPath();
    points.forEach((point) => pen.lineTo(...point));
    pen.stroke();
  };
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  ticks(axes.up, 4, (value, step) => {
    rule([left, axes.y(value)], [canvas.width - right, axes.y(value)]);
    pen.fillText(digits(value, step), left - 8, axes.y(value));
  });
  pen.textAlign = "center";
  pen.textBaseline = "top";
  ticks(axes.across, 5, (value, step) => {
    rule([axes.x(value), top], [axes.x(value), canvas.height - bottom]);
    pen.fillText(digits(value, step), axes.x(value), canvas.height - bottom + 6);
  });
  pen.fillText(`distance from A; height ± sigma [${unitName}]`, (left + canvas.width - right) / 2, canvas.height - 34);
}
