// Files that the page writes: pictures as PNG, profiles as CSV.

function download(blob, name) {
  const anchor = document.createElement("a");
  anchor.href = URL.createObjectURL(blob);
  anchor.download = name;
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(anchor.href), 10000);
}

const safeName = (text) => text.replace(/[^\w.-]+/g, "_");

/** The picture with what is drawn above it. */
function joined(canvases) {
  const whole = document.createElement("canvas");
  [whole.width, whole.height] = [canvases[0].width, canvases[0].height];
  const pen = whole.getContext("2d");
  canvases.forEach((canvas) => pen.drawImage(canvas, 0, 0));
  return whole;
}

const savePng = (canvas, name) => canvas.toBlob((blob) => download(blob, safeName(name)), "image/png");

/** A profile as CSV; names of columns end in the unit. */
function profileCsv(profile, unitName) {
  const lengths = ["distance", "x", "y", ...("z" in profile[0] ? ["z"] : []), "height", "sigma"];
  const columns = lengths.map((name) => `${name === "sigma" ? "height_sigma" : name}_${unitName.toLowerCase()}`);
  const rows = profile.map((p) => [...lengths.map((name) => p[name]), p.slope, p.albedo]);
  const cell = (value) => (Number.isFinite(value) ? String(Number(value.toPrecision(8))) : "");
  return (
    [[...columns, "slope_deg", "albedo"].join(","), ...rows.map((row) => row.map(cell).join(","))].join("\n") + "\n"
  );
}

const MEASURED = /^([-–\d]\S*?)(?: ± (\S+?))?(?: ([^\d]+)|(°))?$/; // a value, its standard deviation, its unit

/** Rows [quantity, value] of a measurement as CSV. */
function rowsCsv(rows) {
  const parts = rows.map(([name, text]) => [name, ...(text.match(MEASURED) ?? [, text]).slice(1)]);
  const lines = parts.map(([name, value, sigma, unit, degree]) => [name, value, sigma, unit ?? degree]);
  return [["quantity", "value", "sigma", "unit"], ...lines].map((line) => line.join(",")).join("\n") + "\n";
}

const saveCsv = (text, name) => download(new Blob([text], { type: "text/csv" }), safeName(name));
