// Mouse, pen and touch on the picture.

const CLICK_PX = 4; // a pointer that moved less was clicked
const TURN = 0.35; // degrees per pixel

/** Listens to the canvas. Pixels are those of the picture. */
function listenToPointer(canvas, viewer) {
  const held = new Map();
  let moved = 0;
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [
      ((event.clientX - box.left) * canvas.width) / box.width,
      ((event.clientY - box.top) * canvas.height) / box.height,
    ];
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, at(event));
    if (held.size === 1) moved = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    const now = at(event);
    if (!before) return viewer.hover(now);
    const others = [...held].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    held.set(event.pointerId, now);
    moved += Math.hypot(now[0] - before[0], now[1] - before[1]);
    if (others.length) pinch(viewer, others[0], before, now);
    else drag(viewer, event, before, now);
  });
  for (const name of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(name, (event) => {
      const was = held.delete(event.pointerId);
      if (was && name === "pointerup" && moved < CLICK_PX * viewer.ratio() && !held.size) viewer.click(at(event));
    });
  }
  canvas.addEventListener("pointerleave", () => viewer.hover(null));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      zoomBy(viewer, Math.exp(-0.0015 * event.deltaY), at(event));
    },
    { passive: false },
  );
}

function drag(viewer, event, before, now) {
  const { state } = viewer.store;
  const [du, dv] = [now[0] - before[0], now[1] - before[1]];
  if (event.altKey) dragSun(viewer, du, dv);
  else if (state.compare === "swipe" && Math.abs(before[0] / viewer.size()[0] - state.swipe) < 0.03) {
    viewer.store.update({ swipe: clamp(now[0] / viewer.size()[0], 0, 1) });
  } else if (event.shiftKey || event.buttons === 2 || state.camera === "image") pan(viewer, before, now);
  else turnCamera(viewer, (TURN / viewer.ratio()) * du, (-TURN / viewer.ratio()) * dv);
}

/** Turns and tilts the free camera [degrees]. */
function turnCamera(viewer, heading, tilt) {
  const { state, update } = viewer.store;
  update({ heading: state.heading + heading, tilt: clamp(state.tilt + tilt, 0, viewer.map.ground.mostTilt) });
}

/** The Sun follows the pointer: across changes its azimuth, upwards raises it. */
function dragSun(viewer, du, dv) {
  const { state, update } = viewer.store;
  const turn = TURN / viewer.ratio();
  const lowest = viewer.map.ground.lowestSun;
  const elevation = clamp(state.elevation - turn * dv, lowest, 90);
  update({ azimuth: (state.azimuth + turn * du + 360) % 360, elevation });
}

/** Ground, or the image, follows the pointer. */
function pan(viewer, before, now) {
  const { state, update } = viewer.store;
  if (state.camera === "image") {
    update({ middle: state.middle.map((m, i) => m - (now[i] - before[i]) / state.zoom) });
    return;
  }
  const camera = viewer.camera();
  const normal = viewer.map.ground.planeNormal(camera);
  const [from, to] = [before, now].map((pixel) => onPlane(camera, pixel, state.target, normal));
  if (from && to)
    update({
      target: add(state.target, subtract(from, to)).map((x) => clamp(x, -3 * viewer.map.radius, 3 * viewer.map.radius)),
    });
}

const NEAREST = 0.02; // the camera comes no nearer to the ground [radii of the map]

/** Zooms so that what is under a pixel stays there. */
function zoomBy(viewer, factor, pixel) {
  const { state, update } = viewer.store;
  const size = viewer.size();
  if (state.camera === "image") {
    const zoom = clamp(state.zoom * factor, 0.02, 200);
    const shift = 1 / state.zoom - 1 / zoom;
    update({ zoom, middle: state.middle.map((m, i) => m + (pixel[i] - size[i] / 2) * shift) });
    return;
  }
  const { radius, ground: kind } = viewer.map;
  const camera = viewer.camera();
  const height = kind.depthInMiddle(viewer.map, camera, size); // of the camera over the ground
  const distance = state.distance - height + clamp(height / factor, NEAREST * radius, 40 * radius);
  const ground = onPlane(camera, pixel, state.target, kind.planeNormal(camera));
  const share = 1 - distance / state.distance;
  const near = ground && length(subtract(ground, state.target)) < 3 * radius;
  update({ distance, target: near ? add(state.target, times(subtract(ground, state.target), share)) : state.target });
}

/** Two fingers: their distance zooms, their middle moves, their direction turns. */
function pinch(viewer, other, before, now) {
  const span = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
  const middle = (a, b) => [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
  const angle = (a, b) => Math.atan2(a[1] - b[1], a[0] - b[0]) / DEGREE;
  zoomBy(viewer, clamp(span(now, other) / Math.max(span(before, other), 1), 0.5, 2), middle(now, other));
  pan(viewer, middle(before, other), middle(now, other));
  const { state, update } = viewer.store;
  const turn = ((angle(now, other) - angle(before, other) + 540) % 360) - 180;
  if (state.camera === "free") update({ heading: state.heading - turn });
}
