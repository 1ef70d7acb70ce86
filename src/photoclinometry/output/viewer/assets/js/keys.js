// The keyboard. The table of the page's help lists the same.

const SUN_STEP = 2; // degrees; a tenth of it with Shift
const CAMERA_STEP = 5; // degrees
const MOVE_SHARE = 0.05; // of the picture's height

function keysOf(viewer) {
  const { store, map, layers } = viewer;
  const { state, update } = store;
  const middle = () => viewer.size().map((s) => s / 2);
  const flip = (name) => () => update({ [name]: !state[name] });
  const sun = (da, de) => (event) => {
    const step = event.shiftKey ? 0.1 * SUN_STEP : SUN_STEP;
    update({
      azimuth: (state.azimuth + da * step + 360) % 360,
      elevation: clamp(state.elevation + de * step, -90, 90),
    });
  };
  const tool = (name) => () => update({ tool: name, points: [] });
  const move = (right, down) => () => {
    const [from, by] = [middle(), MOVE_SHARE * viewer.size()[1]];
    pan(viewer, from, [from[0] - by * right, from[1] - by * down]);
  };
  const turn = (right, up) => () => {
    if (state.camera === "image") move(right, -up)();
    else turnCamera(viewer, CAMERA_STEP * right, CAMERA_STEP * up);
  };
  const layer = (by) => () => {
    const at = layers.findIndex((one) => one.key === state.layer) + by;
    update({ layer: layers[(at + layers.length) % layers.length].key });
  };
  const count = map.scene.views.length;
  const step = (by) => () => viewer.takeCamera((state.view + by + count) % count);
  const found = {
    ArrowLeft: sun(-1, 0),
    ArrowRight: sun(1, 0),
    ArrowUp: sun(0, 1),
    ArrowDown: sun(0, -1),
    j: turn(-1, 0),
    l: turn(1, 0),
    i: turn(0, 1),
    k: turn(0, -1),
    J: move(-1, 0),
    L: move(1, 0),
    I: move(0, -1),
    K: move(0, 1),
    "+": () => zoomBy(viewer, 1.25, middle()),
    "=": () => zoomBy(viewer, 1.25, middle()),
    "-": () => zoomBy(viewer, 0.8, middle()),
    0: () => viewer.whole(),
    PageUp: layer(-1),
    PageDown: layer(1),
    Enter: () => viewer.click(middle()),
    "[": step(-1),
    "]": step(1),
    v: () => viewer.takeCamera(state.camera === "image" ? null : state.view),
    c: () => viewer.compare(COMPARE[(COMPARE.indexOf(state.compare) + 1) % COMPARE.length]),
    s: flip("shadows"),
    o: flip("cameras"),
    f: flip("footprints"),
    m: flip("moves"),
    " ": () => viewer.play(),
    p: tool("profile"),
    a: tool("angle"),
    r: tool("area"),
    Escape: () => update({ tool: "look", points: [] }),
    "?": () => byId("help").showModal(),
  };
  layers.slice(0, 9).forEach((layer, i) => (found[i + 1] = () => update({ layer: layer.key })));
  return found;
}

/** Keys work wherever no control uses them itself. */
function listenToKeys(viewer) {
  const keys = keysOf(viewer);
  document.addEventListener("keydown", (event) => {
    const own =
      event.target.closest("input, select, dialog") || (event.target.closest("button") && " Enter".includes(event.key));
    const action = keys[event.key];
    if (own || !action || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    action(event);
  });
}
