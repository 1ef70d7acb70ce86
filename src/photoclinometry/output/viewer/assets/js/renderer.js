// The picture: the landmarks' mesh in a camera, then its colours.

const MISSING_VALUE = -1e30; // as in the shaders
const SHADE_SUN = sunFromAngles(315, 35); // of hillshades of a region: from the upper left, as cartographers have it

function rendererOf(canvas, map, about) {
  const gl = graphicsOf(canvas);
  const { shaders } = about;
  const renderer = { gl, canvas, map, passes: gridPasses(gl, map, shaders), images: [] };
  renderer.surface = programOf(gl, shaders["surface.vert"], shaders["surface.frag"]);
  renderer.display = programOf(gl, shaders["grid.vert"], shaders["display.frag"]);
  renderer.levels = [map.faces, map.coarseFaces].filter(Boolean).map((faces) => meshOf(gl, map, faces));
  useLevel(renderer, 0);
  renderer.tables = Object.fromEntries(Object.entries(about.colours).map(([name, text]) => [name, coloursOf(text)]));
  renderer.shadeMean = map.ground.shadeMean(map);
  return renderer;
}

/** Draws with a level of detail from now on: 0 is the finest. */
function useLevel(renderer, number) {
  const mesh = renderer.levels[Math.min(number, renderer.levels.length - 1)];
  if (renderer.mesh === mesh) return;
  renderer.mesh = renderer.passes.mesh = mesh;
  renderer.passes.sunOfShadows = null;
}

function meshOf(gl, map, triangles) {
  const array = gl.createVertexArray();
  gl.bindVertexArray(array);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, new Uint32Array(map.cell), gl.STATIC_DRAW);
  gl.enableVertexAttribArray(0);
  gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_INT, 0, 0);
  const faces = new Uint32Array(triangles.length);
  const count = faces.length / 3;
  for (let f = 0; f < count; f++) for (let i = 0; i < 3; i++) faces[3 * f + i] = triangles[i * count + f];
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
  return { array, indices: faces.length };
}

function drawMesh(gl, mesh) {
  gl.bindVertexArray(mesh.array);
  gl.drawElements(gl.TRIANGLES, mesh.indices, gl.UNSIGNED_INT, 0);
}

/** Colours (n, 3) in [0, 1] of a table's hexadecimal digits. */
const coloursOf = (text) => Float32Array.from(text.match(/../g), (two) => parseInt(two, 16) / 255);

function meanCosine(map, sun) {
  let sum = 0;
  for (let j = 0; j < map.count; j++) sum += Math.max(dot(normalOf(map, j), sun), 0);
  return Math.max(sum / map.count, 1e-6);
}

/** Nearest and farthest depth of the map, with a margin, in a camera. */
function depthsIn(map, camera) {
  const middle = camera.offset[2];
  const nearest = Math.max(middle - 1.1 * map.radius, 1e-3 * map.radius);
  return { nearest, beyondMiddle: 1.1 * map.radius };
}

/** Draws value, shade and place into a target as surface.frag states. values: a texture of the landmarks', and the
 * coefficients of a spline through them where it is to be smooth. factors: value shown = [0] * value + [1]. */
function drawSurface(renderer, target, camera, values, factors) {
  const { gl, map, passes } = renderer;
  const { nearest, beyondMiddle } = depthsIn(map, camera);
  drawInto(gl, target);
  gl.enable(gl.DEPTH_TEST);
  gl.clearColor(0, 0, 0, 0);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  const uniforms = {
    u_closed: ["1i", map.ground.isGrid ? 0 : 1],
    u_smooth: ["1i", values.coefficients ? 1 : 0],
    u_cam_from_local: ["Matrix3fv", camera.camFromLocal],
    u_offset: ["3f", ...camera.offset],
    u_intrinsics: ["4f", ...camera.focal, ...camera.principal],
    u_size: ["2f", target.width, target.height],
    u_depths: ["2f", nearest, beyondMiddle],
    u_factors: ["2f", ...factors],
    u_shade_sun: ["3f", ...map.ground.shadeSun(camera)],
  };
  use(gl, renderer.surface, uniforms, {
    u_position: passes.textures.position,
    u_normal: passes.textures.normal,
    u_values: values.texture,
    u_coefficients: values.coefficients ?? values.texture,
  });
  drawMesh(gl, renderer.mesh);
}

/** The picture's target, as large as the canvas. */
function surfaceTarget(renderer) {
  const { gl, canvas } = renderer;
  const old = renderer.target;
  if (old && old.width === canvas.width && old.height === canvas.height) return old;
  if (old) release(gl, old);
  renderer.target = targetOf(gl, "RGBA32F", canvas.width, canvas.height, true);
  return renderer.target;
}

/** Two colour tables, one per row. */
function tableTexture(renderer, name) {
  renderer.tableTextures ??= {};
  const both = [renderer.tables[name], renderer.tables.RdBu_r];
  const entries = both[0].length / 3;
  const data = new Float32Array(8 * entries);
  both.forEach((table, row) => table.forEach((x, i) => (data[4 * (row * entries + Math.floor(i / 3)) + (i % 3)] = x)));
  return (renderer.tableTextures[name] ??= textureOf(renderer.gl, "RGBA32F", entries, 2, data));
}

/** Texture of a view's decoded picture. */
function imageTexture(renderer, k) {
  const picture = renderer.map.pictures[k];
  if (!picture) return (renderer.noImage ??= textureOf(renderer.gl, "R32F", 1, 1, new Float32Array([MISSING_VALUE])));
  const values = () => Float32Array.from(picture.values, (x) => (Number.isNaN(x) ? MISSING_VALUE : x));
  return (renderer.images[k] ??= textureOf(renderer.gl, "R32F", picture.cols, picture.rows, values()));
}

/** Draws the surface at all pixels of a view's picture, for differences that are exact at any zoom. */
function drawOfPicture(renderer, view, picture, values, factors) {
  const { row, col, block } = picture;
  const size = [picture.cols * block, picture.rows * block];
  const middle = [col + size[0] / 2, row + size[1] / 2];
  const old = renderer.ofPicture;
  if (!old || old.width !== size[0] || old.height !== size[1]) {
    if (old) release(renderer.gl, old);
    renderer.ofPicture = targetOf(renderer.gl, "RGBA32F", ...size, true);
  }
  drawSurface(renderer, renderer.ofPicture, cameraOfView(view, { zoom: 1, middle }, size), values, factors);
}

const COMPARISONS = { map: 0, image: 1, swipe: 2, difference: 3 };

/** Colours the surface onto the canvas. shown: the layer's table, limits and contours, and what it is compared with. */
function drawColours(renderer, shown) {
  const { gl, canvas, passes } = renderer;
  drawInto(gl, null, canvas.width, canvas.height);
  gl.disable(gl.DEPTH_TEST);
  gl.bindVertexArray(passes.empty);
  const uniforms = {
    u_size: ["2f", canvas.width, canvas.height],
    u_image_from_screen: ["4f", ...shown.imageFromScreen],
    u_limits: ["2f", ...shown.limits],
    u_image_limits: ["2f", ...shown.imageLimits],
    u_difference: ["2f", ...shown.difference],
    u_shading: ["1f", shown.shading],
    u_shade_mean: ["1f", renderer.shadeMean],
    u_contour: ["1f", shown.contour],
    u_compare: ["1i", COMPARISONS[shown.compare]],
    u_swipe: ["1f", shown.swipe],
    u_block: ["1i", shown.block],
  };
  const textures = { u_surface: renderer.target.texture, u_colours: tableTexture(renderer, shown.table) };
  const image = imageTexture(renderer, shown.view);
  const drawn = shown.compare === "difference" ? renderer.ofPicture.texture : image;
  use(gl, renderer.display, uniforms, { ...textures, u_image: image, u_drawn: drawn });
  gl.drawArrays(gl.TRIANGLES, 0, 3);
}

/** Value, shade and place of the ground at a pixel of the picture; null where there is none. */
function surfaceAt(renderer, pixel) {
  const { width, height } = renderer.target;
  const [x, y] = [Math.floor(pixel[0]), height - 1 - Math.floor(pixel[1])];
  if (x < 0 || y < 0 || x >= width || y >= height) return null;
  const [value, , col, row] = readBack(renderer.gl, renderer.target, x, y, 1, 1);
  return row > 0 ? { value: value < -1e29 ? NaN : value, place: [col - 1, row - 1] } : null;
}

/** A view's rendering in its own pixels under any Sun: brightness row by row from the top, NaN outside the map. */
function renderingOf(renderer, k, sun, shadows) {
  const { gl, map, passes } = renderer;
  const view = map.scene.views[k];
  const camera = wholeImage(view);
  const values = brightnessOf(passes, sun, camera.center, shadows, view.averaging);
  const target = targetOf(gl, "RGBA32F", view.width, view.height, true);
  drawSurface(renderer, target, camera, values, [view.scale, view.bias]);
  const read = readBack(gl, target);
  release(gl, target);
  const found = new Float32Array(view.width * view.height);
  for (let row = 0; row < view.height; row++) {
    for (let col = 0; col < view.width; col++) {
      const at = 4 * ((view.height - 1 - row) * view.width + col);
      found[row * view.width + col] = read[at + 3] > 0 ? read[at] : NaN;
    }
  }
  return found;
}
