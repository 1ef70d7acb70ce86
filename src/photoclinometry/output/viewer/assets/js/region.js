// The ground of a region: landmarks on a grid above a mean plane, z upwards. What bodies have otherwise is in body.js,
// under the same names: a map's `ground` is one of the two.

const REGION = {
  isGrid: true, // whether there is ground between neighbouring cells
  heightName: "height",
  slopeName: "slope",
  footprints: true,
  margin: 1.8, // of the first picture: its shorter side over the map's half diagonal
  cameraMarks: 0.65, // distance of cameras' marks from the origin, over the map's half diagonal
  mostTilt: 85, // degrees from the vertical
  lowestSun: 0, // degrees of elevation
  heightOf: (position) => position[2],
  upAt: () => [0, 0, 1], // of a point: the vertical that slopes are against
  // Headings and tilts of the free camera: the first, and those of buttons.
  firstLook: () => ({ heading: 0, tilt: 0 }),
  looks: () => [
    ["above", "from above", { tilt: 0 }],
    ["oblique", "oblique", { tilt: 60 }],
  ],
  angleNames: () => ["azimuth", "elevation"],
  shownAzimuth: (azimuth) => azimuth, // of the state, as people are told it; and back
  laterSun: (scene, sun, turn) => laterSunByDay(axisOfDay(scene), sun, turn),
  northOf,
  arrowToSun: ([x, y]) => ({ direction: unit([x, y, 1e-9]), across: Math.hypot(x, y) }),
  planeNormal: () => [0, 0, 1], // of the plane in which the ground follows the pointer
  depthInMiddle: (map, camera, size) =>
    projected(camera, onPlane(camera, [size[0] / 2, size[1] / 2], [0, 0, 0], [0, 0, 1]) ?? [0, 0, 0])[2],
  isHidden: () => false, // whether a mark on the ground is on its far side
  shadeSun: () => SHADE_SUN,
  shadeMean: (map) => meanCosine(map, SHADE_SUN),
  cornersAt: cornersOnGrid, // landmarks and weights of a place
  placeRows(scene, place, position) {
    const { grid, unit: name } = scene;
    const [col, row] = [grid.col + 0.5 + grid.stride * place[0], grid.row + 0.5 + grid.stride * place[1]];
    return [
      ["reference column, row", `${four(col)}, ${four(row)} px`],
      ["x, y", `${four(position[0])}, ${four(position[1])} ${name}`],
      ...(scene.place.body_fixed ? onBody(scene, position) : []),
    ];
  },
  profileOf: profileOverPlane,
  profileRows: rowsOverPlane,
  upOf: () => [0, 0, 1], // of the corners of an area: across what plane it is seen
  planeName: "mean plane",
  isOver: () => () => true, // whether ground over that polygon belongs to the area
  shadowPasses: shadowsByDepths,
  castShadows: castByDepths,
  // Shadows are averaged over so many landmarks on each side, as render does.
  cellsOfPenumbra: (scene) => (scene.grid.stride === 1 ? 1 : 0),
  sky: SKY_DISC,
};

/** The axis about which a day turns the Sun: the body's where it is known, else "up in the reference image". */
function axisOfDay(scene) {
  const body = scene.place.body_from_local;
  return scene.place.body_fixed ? [body[2][0], body[2][1], body[2][2]] : [0, 1, 0];
}

/** Direction of north along the mean plane, and its name: the body's, or "up in the reference image". */
function northOf(scene) {
  if (!scene.place.body_fixed) return { direction: [0, 1, 0], name: "up" };
  const [x, y] = axisOfDay(scene);
  return { direction: unit([x, y, 1e-12]), name: "N" };
}
