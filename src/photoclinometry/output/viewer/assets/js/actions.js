// What controls, keys and pointers do: each a change of the state.

const DAY_SECONDS = 16; // of a day that is played

/** What controls do: methods of the viewer, each a change of the state. */
function actionsOf(viewer) {
  const { map, store } = viewer;
  const { state, update } = store;
  return {
    ratio: pictureRatio,
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
    whole: () =>
      update(state.camera === "image" ? wholePicture(map, state.view, viewer.size()) : wholeMap(map, viewer.size())),
    play() {
      viewer.playing = viewer.playing ? null : performance.now();
      if (viewer.playing) requestAnimationFrame((now) => playOn(viewer, now));
      update({});
    },
    viewOfSun() {
      const same = (view) =>
        Math.abs(view.sun_azimuth_deg - state.azimuth) + Math.abs(view.sun_elevation_deg - state.elevation) < 1e-6;
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
      viewer.hover(pixel);
      if (!most[state.tool]) return;
      if (!found || !vectorAt(map, map.position, found.place)) byId("tool-hint").textContent = NO_GROUND;
      else update({ points: [...(state.points.length < most[state.tool] ? state.points : []), found.place] });
    },
    savePng() {
      draw(viewer);
      savePng(joined([viewer.picture, viewer.overlay]), `${map.scene.name}-${viewer.drawn.layer.key}.png`);
    },
    saveCsv() {
      const { rows, profile } = viewer.measured;
      const text = profile ? profileCsv(profile, map.scene.unit) : rowsCsv(rows);
      saveCsv(text, `${map.scene.name}-${state.tool}.csv`);
    },
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
  const { scene, ground } = viewer.map;
  update(anglesFromSun(ground.laterSun(scene, sunOf(state), (2 * Math.PI * seconds) / DAY_SECONDS)));
  requestAnimationFrame((later) => playOn(viewer, later));
}
