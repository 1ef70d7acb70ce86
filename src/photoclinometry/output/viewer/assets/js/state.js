// What is shown, as plain values: a permalink holds them, controls change them, drawing reads them.

const COMPARE = ["map", "image", "swipe", "blink", "difference"];
const FIRST_DIFFERENCE = 10; // percent of the mean brightness at the ends of the colours
const TOOLS = ["look", "profile", "angle", "area"];

/** The state of a page that was just opened: the reference image's Sun, the whole map from above. */
function firstState(map, layers, size) {
  const k = map.scene.reference;
  const view = map.scene.views[k];
  return {
    layer: layers[0].key,
    azimuth: view.sun_azimuth_deg,
    elevation: view.sun_elevation_deg,
    shadows: true,
    view: k,
    camera: "free",
    ...wholeMap(map, size),
    ...wholePicture(map, k, size),
    compare: "map",
    swipe: 0.5,
    difference: FIRST_DIFFERENCE,
    shading: true,
    contour: roundStep(limitsOf(layers.find((layer) => layer.key === "height")).reduce((a, b) => b - a)),
    cameras: false,
    footprints: false,
    moves: false,
    tool: "look",
    points: [],
  };
}

/** The viewer's state with listeners: update(changes) tells all of them. */
function storeOf(state) {
  const listeners = [];
  return {
    state,
    listen: (listener) => listeners.push(listener),
    update(changes) {
      Object.assign(state, changes);
      listeners.forEach((listener) => listener(changes));
    },
  };
}

const sunOf = (state) => sunFromAngles(state.azimuth, state.elevation);

/** Changes that take the Sun of a view. */
const sunAsIn = (view) => ({ azimuth: view.sun_azimuth_deg, elevation: view.sun_elevation_deg });

/** Changes that take camera and Sun of a view. */
function asIn(map, k, size) {
  return { view: k, camera: "image", ...sunAsIn(map.scene.views[k]), ...wholePicture(map, k, size) };
}

const cameraNow = (map, state, size) =>
  state.camera === "image" ? cameraOfView(map.scene.views[state.view], state, size) : freeCamera(state, size);
