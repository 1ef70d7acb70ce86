// The page: reads the map, joins state, picture and controls, and draws when something has changed.

const MOST_RATIO = 2;       // pixels of the picture per pixel of the page, at most
const BLINK_MS = 700;
const DAY_SECONDS = 16;     // of a day that is played
const SHADING = 1;          // of coloured layers by the hillshade

/** What drawing needs of the present state: the camera and what drawColours takes. */
function shownNow(viewer, size) {
  const { map, renderer, store } = viewer;
  const { state } = store;
  const view = map.scene.views[state.view];
  const camera = cameraNow(map, state, size);
  const picture = state.camera === "image" ? map.pictures[state.view] : null;
  const compare = picture ? (state.compare === "blink" ? (viewer.blink ? "image" : "map") : state.compare) : "map";
  const layer = viewer.layers.find((one) => one.key === (compare === "map" && state.compare !== "blink" ? state.layer : "rendering")) ?? viewer.layers[0];
  const factors = state.camera === "image" && layer.key === "rendering" ? [view.scale, view.bias] : [1, 0];
  const stretch = picture ? stretchOf(picture) : { limits: [0, 1], mean: 1 };
  const values = layerTexture(viewer, layer, camera, factors, picture && stretch.limits);
  const block = picture ? picture.block : 1;
  const zoom = state.zoom * block;
  const origin = picture ? [picture.col, picture.row] : [0, 0];
  const shown = {
    table: layer.table,
    limits: values.limits,
    shading: layer.shaded && state.shading ? SHADING : 0,
    contour: layer.contours ? state.contour : 0,
    compare,
    view: state.view,
    swipe: state.swipe * size[0],
    imageFromScreen: [1 / zoom, 1 / zoom, ...[0, 1].map((i) => (state.middle[i] - origin[i]) / block - size[i] / 2 / zoom)],
    imageLimits: stretch.limits,
    imageUnit: map.scene.brightness === "iof" ? "I/F" : "DN",
    difference: [1 / stretch.mean, state.difference / 100],
  };
  return { camera, layer, factors, texture: values.texture, shown };
}

/** A layer's texture and limits. */
function layerTexture(viewer, layer, camera, factors, imageLimits) {
  const { renderer, map, store } = viewer;
  const { state } = store;
  const { passes } = renderer;
  if (layer.key === "rendering") {
    const sigma = state.camera === "image" ? map.scene.views[state.view].averaging : 0;
    const target = brightnessOf(passes, sunOf(state), camera.center, state.shadows, sigma);
    return { texture: target.texture, limits: imageLimits ?? exposureOf(renderer, target, factors) };
  }
  if (layer.key === "relief") {
    if (viewer.relief) renderer.gl.deleteTexture(viewer.relief);
    viewer.relief = valuesTexture(passes, cosines(map, sunOf(state)));
    return { texture: viewer.relief, limits: layer.limits };
  }
  layer.texture ??= valuesTexture(passes, layer.values);
  return { texture: layer.texture, limits: limitsOf(layer) };
}

function draw(viewer) {
  const { renderer, picture, overlay, store } = viewer;
  const ratio = viewer.ratio();
  const size = [picture, overlay].map((canvas) => fitted(canvas, ratio))[0];
  const now = shownNow(viewer, size);
  drawSurface(renderer, surfaceTarget(renderer), now.camera, now.texture, now.factors);
  drawColours(renderer, now.shown);
  drawOverlay(overlay, renderer, store.state, now.layer, now.shown, now.camera, ratio);
  drawSky(byId("sky"), viewer.map, store.state);
  viewer.drawn = now;
  viewer.frames += 1;
}

/** Makes a canvas as large as it is shown; returns width and height. */
function fitted(canvas, ratio) {
  const size = [canvas.clientWidth, canvas.clientHeight].map((x) => Math.max(1, Math.round(x * ratio)));
  if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
  return size;
}

/** Draws with the next frame of the browser. */
function schedule(viewer) {
  viewer.waiting ??= requestAnimationFrame(() => {
    viewer.waiting = null;
    draw(viewer);
  });
}

/** What controls do: methods of the viewer, each a change of the state. */
function actionsOf(viewer) {
  const { map, store } = viewer;
  const { state, update } = store;
  return {
    ratio: () => Math.min(window.devicePixelRatio || 1, MOST_RATIO),
    size: () => [viewer.overlay.width, viewer.overlay.height],
    camera: () => cameraNow(map, state, viewer.size()),
    free: (changes) => update({ camera: "free", compare: "map", ...changes }),
    takeCamera(k) {
      if (k === null) return viewer.free({});
      const compare = map.scene.pictures[k] ? state.compare : "map";
      update({ ...asIn(map, k, viewer.size()), compare });
    },
    compare(name) {
      const changes = name === "map" || state.camera === "image" ? {} : asIn(map, state.view, viewer.size());
      if (name === "map" || map.scene.pictures[state.view]) update({ ...changes, compare: name });
    },
    whole: () => update(state.camera === "image" ? wholePicture(map, state.view, viewer.size()) : wholeMap(map, viewer.size())),
    play() {
      viewer.playing = viewer.playing ? null : performance.now();
      if (viewer.playing) requestAnimationFrame((now) => playOn(viewer, now));
      update({});
    },
    viewOfSun() {
      const same = (view) => Math.abs(view.sun_azimuth_deg - state.azimuth) + Math.abs(view.sun_elevation_deg - state.elevation) < 1e-6;
      const k = same(map.scene.views[state.view]) ? state.view : map.scene.views.findIndex(same);
      return k < 0 ? null : k;
    },
    ...actionsOnPoints(viewer),
  };
}

/** What the pointer points at, and what is saved. */
function actionsOnPoints(viewer) {
  const { map, store } = viewer;
  const { state, update } = store;
  const most = { look: 0, profile: 2, angle: 3, area: MOST_POINTS };
  return {
    hover(pixel) {
      const found = pixel && viewer.drawn && surfaceAt(viewer.renderer, pixel);
      const rows = found ? valuesAt(map, found.place, state, viewer.drawn.camera.center) : [];
      fillTable(byId("values"), found ? [...shownValue(viewer.drawn.layer, found.value), ...rows] : []);
    },
    click(pixel) {
      const found = surfaceAt(viewer.renderer, pixel);
      if (!most[state.tool]) return viewer.hover(pixel);
      if (found) update({ points: [...(state.points.length < most[state.tool] ? state.points : []), found.place] });
    },
    savePng() {
      draw(viewer);
      savePng(joined([viewer.picture, viewer.overlay]), `${map.scene.name}-${viewer.drawn.layer.key}.png`);
    },
    saveCsv: () => saveCsv(profileCsv(viewer.measured.profile, map.scene.unit), `${map.scene.name}-profile.csv`),
    async copyLink() {
      const address = location.href.replace(/#.*/, "") + fragmentOf(state);
      await navigator.clipboard.writeText(address).catch(() => window.prompt("The link:", address));
    },
  };
}

function playOn(viewer, now) {
  if (!viewer.playing) return;
  const { state, update } = viewer.store;
  const seconds = clamp((now - viewer.playing) / 1000, 0, 0.25);
  viewer.playing = now;
  update(anglesFromSun(laterSun(axisOfDay(viewer.map.scene), sunOf(state), (2 * Math.PI * seconds) / DAY_SECONDS)));
  requestAnimationFrame((later) => playOn(viewer, later));
}

/** Follows the state: decodes images, measures, shows, draws. */
function follow(viewer, showControls) {
  const { store, map } = viewer;
  store.listen(async (changes) => {
    showControls();
    if ("points" in changes || "tool" in changes) showMeasure(viewer, (viewer.measured = measured(map, store.state)));
    schedule(viewer);
    if (store.state.camera === "image" && !map.pictures[store.state.view] && (await pictureOf(map, store.state.view))) schedule(viewer);
  });
  setInterval(() => {
    if (store.state.compare !== "blink") return;
    viewer.blink = !viewer.blink;
    schedule(viewer);
  }, BLINK_MS);
  new ResizeObserver(() => schedule(viewer)).observe(byId("stage"));
  addEventListener("hashchange", () => store.update(stateOf(location.hash, map, viewer.layers)));
}

async function open() {
  const started = performance.now();
  byId("message").textContent = "Reading the map …";
  const about = JSON.parse(byId("data").textContent);
  const map = await readMap(about.scene);
  const layers = layersOf(map);
  const [picture, overlay] = [byId("picture"), byId("overlay")];
  const ratio = Math.min(window.devicePixelRatio || 1, MOST_RATIO);
  const size = [picture, overlay].map((canvas) => fitted(canvas, ratio))[0];
  const store = storeOf(firstState(map, layers, size));
  const viewer = { map, layers, store, picture, overlay, renderer: rendererOf(picture, map, about), frames: 0, blink: false };
  Object.assign(viewer, actionsOf(viewer));
  follow(viewer, panelOf(viewer));
  listenToPointer(overlay, viewer);
  listenToSky(byId("sky"), store);
  listenToKeys(viewer);
  keepLink(store);
  store.update({ ...stateOf(location.hash, map, layers) });
  showMeasure(viewer, (viewer.measured = measured(map, store.state)));
  draw(viewer);
  byId("message").textContent = "";
  viewer.openedIn = performance.now() - started;
  window.viewer = Object.assign(viewer, { sunFromAngles, laterSun, draw: () => draw(viewer), renderingOf: (k, azimuth, elevation, shadows) => renderingOf(viewer.renderer, k, sunFromAngles(azimuth, elevation), shadows) });
}

open().catch((error) => {
  byId("message").textContent = `The map cannot be shown. ${error.message}`;
  throw error;
});
