// Labels of contours: their values, where they cross every so many rows of the picture.

const LABEL_ROWS = 84; // rows of the page between rows with labels
const LABEL_APART = 150; // least distance between labels of one row, in pixels of the page
const THICK = 5; // every fifth contour is drawn darker, and labelled where there are several of them
const FEWEST_THICK = 3;

/** Where contours cross rows of the drawn picture: pixel (x, y) from its top left corner, number of the contour. */
function contourCrossings(renderer, interval, rows) {
  const { gl, target } = renderer;
  const { width, height } = target;
  const found = [];
  for (let y = Math.round(rows / 2); y < height; y += Math.round(rows)) {
    const read = readBack(gl, target, 0, height - 1 - y, width, 1);
    const level = (x) => (read[4 * x + 3] > 0 && read[4 * x] > MISSING_VALUE / 10 ? Math.floor(read[4 * x] / interval) : NaN);
    for (let x = 1; x < width; x++) {
      const [before, here] = [level(x - 1), level(x)];
      if (Math.abs(here - before) === 1) found.push({ x, y, number: Math.max(before, here) });
    }
  }
  return found;
}

/** The crossings that get labels: of thick contours where there are several of them, none too near the one before. */
function labelledCrossings(crossings, apart) {
  const thick = crossings.filter(({ number }) => number % THICK === 0);
  const several = new Set(thick.map(({ number }) => number)).size >= FEWEST_THICK;
  const kept = [];
  for (const one of several ? thick : crossings) {
    const last = kept.at(-1);
    if (!last || last.y !== one.y || one.x - last.x >= apart) kept.push(one);
  }
  return kept;
}

/** The labels of the drawn picture. ratio: its pixels per pixel of the page. */
const contourLabels = (renderer, interval, ratio) =>
  labelledCrossings(contourCrossings(renderer, interval, LABEL_ROWS * ratio), LABEL_APART * ratio);

function drawContourLabels(pen, renderer, interval) {
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  for (const { x, y, number } of contourLabels(renderer, interval, pen.ratio)) {
    outlined(pen, digits(number * interval, interval), x, y);
  }
}
