// The page: reads the map, joins state, picture and controls, and draws when something has changed.

const BLINK_MS = 700;

/** Follows the state: decodes images, measures, shows, draws. */
function follow(viewer, showControls) {
  const { store, map } = viewer;
  store.listen(async (changes) => {
    showControls();
    if ("points" in changes || "tool" in changes) showMeasure(viewer, (viewer.measured = measured(map, store.state)));
    schedule(viewer);
    if (store.state.camera === "image" && !map.pictures[store.state.view] && (await pictureOf(map, store.state.view)))
      schedule(viewer);
  });
  setInterval(() => {
    if (store.state.compare !== "blink") return;
    viewer.blink = !viewer.blink;
    schedule(viewer);
  }, BLINK_MS);
  new ResizeObserver(() => schedule(viewer)).observe(byId("stage"));
  addEventListener("hashchange", () => store.update(linked(map, viewer.layers, viewer.size())));
}

/** The changes of the address's fragment; a view's camera that is named alone shows its image under its Sun. */
function linked(map, layers, size) {
  const found = stateOf(location.hash, map, layers);
  return found.camera === "image" && "view" in found ? { ...asIn(map, found.view, size), ...found } : found;
}

async function open() {
  const started = performance.now();
  byId("message").textContent = "Reading the map …";
  const about = JSON.parse(byId("data").textContent);
  const map = await readMap(about.scene);
  const layers = layersOf(map);
  const [picture, overlay] = [byId("picture"), byId("overlay")];
  const ratio = pictureRatio();
  const size = [picture, overlay].map((canvas) => fitted(canvas, ratio))[0];
  const store = storeOf(firstState(map, layers, size));
  const viewer = {
    map,
    layers,
    store,
    picture,
    overlay,
    renderer: rendererOf(picture, map, about),
    blink: false,
  };
  Object.assign(viewer, actionsOf(viewer));
  follow(viewer, panelOf(viewer));
  picture.addEventListener(
    "webglcontextlost",
    () => (byId("message").textContent = "The graphics stopped; reload the page."),
  );
  listenToPointer(overlay, viewer);
  listenToSky(byId("sky"), store, map.ground.sky);
  listenToKeys(viewer);
  keepLink(store);
  store.update(linked(map, layers, size));
  showMeasure(viewer, (viewer.measured = measured(map, store.state)));
  draw(viewer);
  byId("message").textContent = "";
  viewer.openedIn = performance.now() - started;
  window.viewer = Object.assign(viewer, {
    sunFromAngles,
    laterSun: laterSunByDay,
    draw: (level) => draw(viewer, level),
    surfaceAt: (pixel) => surfaceAt(viewer.renderer, pixel),
    groundPerPixel: () => groundPerPixel(map, viewer.camera(), viewer.size()),
    labels: () => labelsOf(map.scene.views),
    cameraMarks: () => map.scene.views.map((view) => projected(viewer.camera(), cameraMark(map, view)).slice(0, 2)),
    contourLabels: (interval) => contourLabels(viewer.renderer, interval, viewer.ratio()),
    labelledCrossings,
    renderingOf: (k, azimuth, elevation, shadows) =>
      renderingOf(viewer.renderer, k, sunFromAngles(azimuth, elevation), shadows),
  });
}

open().catch((error) => {
  byId("message").textContent = `The map cannot be shown. ${error.message}`;
  throw error;
});
