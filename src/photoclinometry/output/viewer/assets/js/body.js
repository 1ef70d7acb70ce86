// The ground of a whole body: a closed surface about the origin. A place is the column and row of a vertex in the grid
// that holds the vertices; there is nothing between them.

const LIGHT_IN_CAM = [-0.58, -0.58, -0.57]; // of hillshades: from the upper left, behind the camera
const SPHERE_MEAN = 0.44; // cosine of incidence on a sphere in that light, in the mean over its disk (Lambert)

const BODY = {
  isGrid: false,
  heightName: "radius",
  slopeName: "slope against the radius",
  footprints: false,
  margin: 2.3,
  cameraMarks: 1.1,
  mostTilt: 180,
  lowestSun: -90,
  heightOf: length,
  upAt: unit,
  firstLook: (map) => lookAlong(unit(map.scene.views[map.scene.reference].center)),
  looks: ({ place }) => [
    ["north", place.body_fixed ? "north" : "+z", { heading: 0, tilt: 0 }],
    ["equator", place.body_fixed ? "equator" : "across z", { tilt: 90 }],
    ["south", place.body_fixed ? "south" : "-z", { heading: 0, tilt: 180 }],
  ],
  angleNames: ({ place }) => (place.body_fixed ? ["longitude", "latitude"] : ["from x to y", "towards z"]),
  // Azimuths count clockwise from y, east longitudes counter-clockwise from x.
  shownAzimuth: (azimuth) => (450 - azimuth) % 360,
  laterSun: (scene, sun, turn) => laterSun([0, 0, 1], sun, turn),
  northOf: (scene) => ({ direction: [0, 0, 1], name: scene.place.body_fixed ? "N" : "z" }),
  arrowToSun: (sun, camera) => ({ direction: sun, across: Math.hypot(...turned(camera.camFromLocal, sun).slice(0, 2)) }),
  planeNormal: (camera) => camera.camFromLocal.slice(6, 9),
  depthInMiddle: depthOfGround,
  isHidden: (camera, point, normal) => dot(subtract(camera.center, point), normal) < 0,
  shadeSun: (camera) => turned(transposed(camera.camFromLocal), unit(LIGHT_IN_CAM)),
  shadeMean: () => SPHERE_MEAN,
  cornersAt(map, place) {
    const vertex = Math.round(place[1]) * map.cols + Math.round(place[0]);
    return vertex >= 0 && vertex < map.count ? { landmarks: [vertex], weights: [1] } : null;
  },
  placeRows(scene, place, position) {
    const inBody = add(position, scene.place.origin);
    return [
      ["x, y, z", `${inBody.map(four).join(", ")} ${scene.unit}`],
      ...(scene.place.body_fixed ? [lonLatRow(inBody)] : []),
    ];
  },
  profileOf: profileOfSection,
  profileRows: rowsOfSection,
  upOf: meanNormal,
  isOver: closeAndFacing,
  planeName: "plane across the mean normal",
  shadowPasses: shadowsByMap,
  castShadows: castByMap,
  cellsOfPenumbra: () => 0,
  sky: SUN_MAP,
};

const LOOKED_AT = 20000; // vertices, of a larger map evenly chosen
const MIDDLE = 0.1; // share of the picture's smaller side: of vertices within this of the middle, the nearest is the ground

/** Depth of the ground in the middle of the picture, or of what is seen nearest to it. */
function depthOfGround(map, camera, size) {
  const step = Math.max(1, Math.floor(map.count / LOOKED_AT));
  const reach = MIDDLE * Math.min(size[0], size[1]);
  const farthest = projected(camera, [0, 0, 0])[2]; // what lies beyond is on the other side
  let [within, beside, off] = [Infinity, farthest, Infinity];
  for (let j = 0; j < map.count; j += step) {
    const [x, y, depth] = projected(camera, positionOf(map, j));
    if (!(depth > 0 && depth < farthest)) continue;
    const away = Math.hypot(x - size[0] / 2, y - size[1] / 2);
    if (away < reach) within = Math.min(within, depth);
    else if (away < off) [beside, off] = [depth, away];
  }
  return Number.isFinite(within) ? within : beside;
}

/** Heading and tilt of the free camera that looks from a direction (unit vector) towards the middle. */
function lookAlong(from) {
  return { heading: Math.atan2(-from[0], -from[1]) / DEGREE, tilt: Math.acos(clamp(from[2], -1, 1)) / DEGREE };
}

/** The mean of the normals at places, a unit vector. */
function meanNormal(map, places) {
  return unit(places.map((place) => vectorAt(map, map.normal, place)).reduce(add));
}

/** Whether the ground at a point belongs to a region around points: it faces their side and is no farther below or above
 * them than they are from each other. */
function closeAndFacing(grounds, up) {
  const middle = times(grounds.reduce(add), 1 / grounds.length);
  const reach = 2 * Math.max(...grounds.map((point) => length(subtract(point, middle))));
  return (point, normal) => dot(normal, up) > 0 && Math.abs(dot(subtract(point, middle), up)) < reach;
}
