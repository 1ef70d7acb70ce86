// The controls at the side: each shows a part of the state, and changes it.

const byId = (id) => document.getElementById(id);

const HINTS = {
  look: "Drag to turn, wheel to zoom. Choose a tool to measure.",
  profile: "Click two points on the map.",
  angle: "Click three points: the angle is that at the second.",
  area: "Click the corners of a region, three or more.",
};
const NO_GROUND = "There is no ground: click on the map.";

function fill(select, entries) {
  for (const [value, words] of entries) select.add(new Option(words, value));
}

function fillTable(table, rows) {
  table.replaceChildren(
    ...rows.map((row) => {
      const line = document.createElement("tr");
      line.append(...row.map((text) => Object.assign(document.createElement("td"), { textContent: text })));
      return line;
    }),
  );
}

/** Buttons of which one is chosen. */
function choices(box, names, change) {
  const buttons = names.map((name) => {
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: name });
    button.setAttribute("role", "radio");
    button.dataset.value = name;
    button.addEventListener("click", () => change(name));
    return button;
  });
  box.append(...buttons);
  return (chosen, usable = () => true) =>
    buttons.forEach((button) => {
      button.setAttribute("aria-checked", String(button.dataset.value === chosen));
      button.disabled = !usable(button.dataset.value);
    });
}

/** Fills the panel and listens to it. viewer: store, map, layers, size(), and the actions of main.js. */
function panelOf(viewer) {
  const { map, layers, store } = viewer;
  const { scene } = map;
  byId("title").textContent = scene.name;
  byId("subtitle").textContent = subtitle(map);
  fill(
    byId("layer"),
    layers.map((layer) => [layer.key, layer.title]),
  );
  const views = scene.views.map((view, k) => [k, shortName(view.name)]);
  fill(byId("sun-of"), [["", "– free –"], ...views]);
  fill(byId("camera-of"), [["", "– free –"], ...views]);
  byId("contour-unit").textContent = scene.unit;
  showKind(map);
  byId("moves").parentElement.hidden = !hasMoves(map);
  byId("copy-link").hidden = !hasAddress();
  byId("compare-section").hidden = !scene.reflectance || scene.pictures.every((picture) => !picture);
  const showCompare = choices(byId("compare"), COMPARE, (name) => viewer.compare(name));
  const showTool = choices(byId("tools"), TOOLS, (tool) => store.update({ tool, points: [] }));
  listenToInputs(viewer);
  listenToButtons(viewer);
  return () => showPanel(viewer, showCompare, showTool);
}

function subtitle(map) {
  const { scene } = map;
  const model = scene.reflectance ? scene.reflectance.name : "no reflectance model";
  const facets = map.faces.length / 3;
  const of = scene.facets > facets ? ` of ${scene.facets}` : "";
  const size = scene.kind === "body" ? `${facets}${of} facets` : `${map.count} landmarks`;
  return [scene.body, size, `${scene.views.length} views`, model].filter(Boolean).join(" · ");
}

/** Names of controls that regions and bodies have different ones for. */
function showKind({ ground, scene }) {
  const names = ground.angleNames(scene);
  ["azimuth", "elevation"].forEach((id, i) => (byId(`${id}-name`).textContent = names[i]));
  byId("footprints").parentElement.hidden = !ground.footprints;
  document.querySelectorAll("[data-kind]").forEach((part) => {
    part.hidden = part.dataset.kind !== (ground === BODY ? "body" : "region");
  });
}

function listenToInputs(viewer) {
  const { store, map } = viewer;
  const on = (id, change) => byId(id).addEventListener("input", (event) => change(event.target));
  const number = (id, name) =>
    on(id, (input) => Number.isFinite(input.valueAsNumber) && store.update({ [name]: input.valueAsNumber }));
  on("layer", (input) => store.update({ layer: input.value }));
  for (const name of FLAGS)
    on(name, (input) => store.update({ [name]: input.checked }));
  for (const name of ["elevation", "swipe"]) number(name, name);
  on("azimuth", ({ valueAsNumber: shown }) => {
    if (Number.isFinite(shown)) store.update({ azimuth: map.ground.shownAzimuth(shown) });
  });
  on("difference", (input) => input.valueAsNumber > 0 && store.update({ difference: input.valueAsNumber }));
  on("contour", (input) => store.update({ contour: Math.max(input.valueAsNumber || 0, 0) }));
  on(
    "sun-of",
    (input) => {
      if (input.value === "") return;
      const view = store.state.camera === "image" ? {} : { view: Number(input.value) }; // an image's camera stays
      store.update({ ...view, ...sunAsIn(map.scene.views[input.value]) });
    },
  );
  on("camera-of", (input) => viewer.takeCamera(input.value === "" ? null : Number(input.value)));
}

function listenToButtons(viewer) {
  const { store, map } = viewer;
  const on = (id, action) => byId(id).addEventListener("click", action);
  on("play", () => viewer.play());
  for (const [id, name, look] of map.ground.looks(map.scene)) {
    const button = Object.assign(document.createElement("button"), { id, type: "button", textContent: name });
    button.addEventListener("click", () => viewer.free({ ...wholeMap(map, viewer.size()), ...look }));
    byId("looks").append(button);
  }
  on("clear", () => store.update({ points: [] }));
  on("save-csv", () => viewer.saveCsv());
  on("save-chart", () => savePng(byId("chart"), `${map.scene.name}-profile.png`));
  on("save-png", () => viewer.savePng());
  on("copy-link", () => viewer.copyLink());
  on("show-help", () => byId("help").showModal());
  on("close-help", () => byId("help").close());
}

/** Shows the state in all controls. */
function showPanel(viewer, showCompare, showTool) {
  const { map, store, layers } = viewer;
  const { state } = store;
  const layer = layers.find((one) => one.key === state.layer);
  byId("layer").value = state.layer;
  for (const name of FLAGS) byId(name).checked = state[name];
  const shown = { ...state, azimuth: map.ground.shownAzimuth(state.azimuth) };
  for (const name of ["azimuth", "elevation", "contour", "swipe", "difference"]) {
    if (document.activeElement !== byId(name)) byId(name).value = Number(shown[name].toFixed(4));
  }
  byId("shading").disabled = !layer.shaded;
  byId("contour").disabled = !layer.contours;
  byId("sun-of").value = viewer.viewOfSun() ?? "";
  byId("camera-of").value = state.camera === "image" ? state.view : "";
  byId("swipe-label").hidden = state.compare !== "swipe";
  byId("difference-label").hidden = state.compare !== "difference";
  fillTable(byId("pose"), state.moves && hasMoves(map) ? moveRows(map, state.view) : []);
  byId("play").textContent = viewer.playing ? "stop" : "play a day";
  byId("play").setAttribute("aria-pressed", String(Boolean(viewer.playing)));
  showCompare(state.compare, (name) => name === "map" || Boolean(map.scene.pictures[state.view]));
  showTool(state.tool);
  byId("tool-hint").textContent = HINTS[state.tool];
}

/** Shows a measurement: its table, and its chart where it is a profile; and moves the panel so that both are seen. */
function showMeasure(viewer, { rows, profile }) {
  fillTable(byId("measures"), rows);
  byId("chart").hidden = byId("save-chart").disabled = !profile;
  byId("save-csv").disabled = !rows.length;
  if (profile) drawChart(byId("chart"), profile, viewer.map.scene.unit);
  if (rows.length) byId("save-csv").scrollIntoView({ block: "nearest" });
}
