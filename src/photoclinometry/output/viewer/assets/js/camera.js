// Cameras are pinholes: x right, y down, z forward. All are in one form, in pixels of the picture:
//   pixel = focal * (x, y) / z + principal,   (x, y, z) = camFromLocal * point + offset

const FIELD = 1.8; // focal length of the free camera over the picture's height: 31 degrees

function pinhole(camFromLocal, center, focal, principal) {
  return { camFromLocal, center, offset: times(turned(camFromLocal, center), -1), focal, principal };
}

/** The free camera: it looks at state.target from a distance, tilted from the z axis towards its heading. */
function freeCamera(state, size) {
  const [heading, tilt] = [state.heading * DEGREE, state.tilt * DEGREE];
  const ahead = [Math.sin(heading), Math.cos(heading), 0];
  const right = [Math.cos(heading), -Math.sin(heading), 0];
  const forward = add(times(ahead, Math.sin(tilt)), [0, 0, -Math.cos(tilt)]);
  const down = cross(forward, right);
  const center = subtract(state.target, times(forward, state.distance));
  const focal = FIELD * size[1];
  return pinhole([...right, ...down, ...forward], center, [focal, focal], [size[0] / 2, size[1] / 2]);
}

/** The camera of a view; its pixel `state.middle` is in the middle of the picture, `state.zoom` times as large. */
function cameraOfView(view, state, size) {
  const camFromLocal = transposed(view.local_from_cam.flat());
  const focal = view.focal.map((f) => f * state.zoom);
  const principal = view.principal.map((c, i) => (c - state.middle[i]) * state.zoom + size[i] / 2);
  return pinhole(camFromLocal, view.center, focal, principal);
}

/** The view's camera with its own image as the picture. */
const wholeImage = (view) =>
  cameraOfView(view, { zoom: 1, middle: [view.width / 2, view.height / 2] }, [view.width, view.height]);

/** Pixel and depth of a point; depth is not above 0 behind the camera. */
function projected(camera, point) {
  const [x, y, z] = add(turned(camera.camFromLocal, point), camera.offset);
  return [(camera.focal[0] * x) / z + camera.principal[0], (camera.focal[1] * y) / z + camera.principal[1], z];
}

/** Unit vector in the local frame through a pixel. */
function rayThrough(camera, pixel) {
  const inCam = [
    (pixel[0] - camera.principal[0]) / camera.focal[0],
    (pixel[1] - camera.principal[1]) / camera.focal[1],
    1,
  ];
  return unit(turned(transposed(camera.camFromLocal), inCam));
}

/** Where a pixel's ray meets the plane through a point across a normal; null where it does not. */
function onPlane(camera, pixel, point, normal) {
  const ray = rayThrough(camera, pixel);
  const along = dot(subtract(point, camera.center), normal) / dot(ray, normal);
  return along > 0 && Number.isFinite(along) ? add(camera.center, times(ray, along)) : null;
}

/** State of the free camera that shows the whole map, from where the ground is looked at first. */
function wholeMap(map, size) {
  const distance = (map.ground.margin * map.radius * FIELD * size[1]) / Math.min(size[0], size[1]);
  return { target: [0, 0, 0], distance, ...map.ground.firstLook(map) };
}

/** Zoom and middle that show a view's picture, or the map in it. */
function wholePicture(map, k, size) {
  const view = map.scene.views[k];
  const picture = map.scene.pictures[k];
  const [left, top, width, height] = picture
    ? [picture.col, picture.row, picture.cols * picture.block, picture.rows * picture.block]
    : boundsInView(map, view);
  return { zoom: 0.96 * Math.min(size[0] / width, size[1] / height), middle: [left + width / 2, top + height / 2] };
}

/** Left, top, width and height of the map in a view [px]. */
function boundsInView(map, view) {
  const camera = wholeImage(view);
  const [low, high] = [
    [Infinity, Infinity],
    [-Infinity, -Infinity],
  ];
  for (let j = 0; j < map.count; j += 7) {
    const pixel = projected(camera, positionOf(map, j));
    for (const i of [0, 1]) [low[i], high[i]] = [Math.min(low[i], pixel[i]), Math.max(high[i], pixel[i])];
  }
  return [low[0], low[1], high[0] - low[0], high[1] - low[1]];
}
