// The permalink: the state as the address's fragment, so that a copied address shows the same again.

const NUMBERS = ["azimuth", "elevation", "heading", "tilt", "distance", "zoom", "swipe", "contour", "difference"];
const VECTORS = { target: 3, middle: 2 };
const FLAGS = ["shadows", "shading", "cameras", "footprints", "moves"];
const WORDS = { camera: ["free", "image"], compare: COMPARE, tool: TOOLS };
const MOST_POINTS = 200;

const short = (value) => String(Number(value.toPrecision(9)));

/** The fragment of a state. */
function fragmentOf(state) {
  const parts = [
    ["layer", state.layer],
    ["view", state.view],
  ];
  for (const name of NUMBERS) parts.push([name, short(state[name])]);
  for (const name of Object.keys(VECTORS)) parts.push([name, state[name].map(short).join(",")]);
  for (const name of FLAGS) parts.push([name, state[name] ? 1 : 0]);
  for (const name of Object.keys(WORDS)) parts.push([name, state[name]]);
  if (state.points.length) parts.push(["points", state.points.map((point) => point.map(short).join(",")).join(";")]);
  return "#" + parts.map(([name, value]) => `${name}=${value}`).join("&");
}

/** The changes that a fragment states. What is unknown or impossible in it is left out. */
function stateOf(fragment, map, layers) {
  const given = Object.fromEntries(
    fragment
      .replace(/^#/, "")
      .split("&")
      .map((part) => part.split("=")),
  );
  const found = {};
  const finite = (text, count) => {
    if (!text) return null;
    const values = text.split(",").map(Number);
    return values.length === count && values.every(Number.isFinite) ? values : null;
  };
  for (const name of NUMBERS) if (finite(given[name], 1)) found[name] = finite(given[name], 1)[0];
  for (const [name, count] of Object.entries(VECTORS))
    if (finite(given[name], count)) found[name] = finite(given[name], count);
  for (const name of FLAGS) if (name in given) found[name] = given[name] === "1";
  for (const [name, words] of Object.entries(WORDS)) if (words.includes(given[name])) found[name] = given[name];
  if (layers.some((layer) => layer.key === given.layer)) found.layer = given.layer;
  if (map.scene.views[given.view]) found.view = Number(given.view);
  const points = (given.points ?? "")
    .split(";")
    .slice(0, MOST_POINTS)
    .map((text) => finite(text, 2));
  if (given.points && points.every(Boolean)) found.points = points;
  return found;
}

/** Whether the page has an address of its own: within another page, as text of a frame, it has none. */
const hasAddress = () => location.protocol !== "about:";

/** Keeps the address's fragment up to date; not oftener than the browser allows. */
function keepLink(store) {
  if (!hasAddress()) return;
  let waiting = null;
  store.listen(() => {
    waiting ??= setTimeout(() => {
      waiting = null;
      const fragment = fragmentOf(store.state);
      if (fragment !== location.hash) history.replaceState(null, "", fragment);
    }, 300);
  });
}
