// What is computed for every landmark on the graphics processor: one texel per cell of the map's grid.

const FAR = 1e30; // depth where there is no ground: nothing lies behind it

/** Textures of the map, and the programs over its grid. */
function gridPasses(gl, map, shaders) {
  const reference = wholeImage(map.scene.views[map.scene.reference]);
  const passes = { gl, map, reference, textures: mapTextures(gl, map) };
  passes.shadows = map.ground.shadowPasses(passes, shaders);
  passes.average = programOf(gl, shaders["grid.vert"], shaders["average.frag"]);
  const model = map.scene.reflectance;
  if (model) {
    const rho = `${shaders.reflectance}
      float reflectance(float mu0, float mu, float phase) {
        return mu0 <= 0.0 || mu <= 0.0 ? 0.0 : ${model.shader};
      }\n`;
    passes.brightness = programOf(gl, shaders["grid.vert"], rho + shaders["brightness.frag"]);
  }
  if (map.ground.isGrid) passes.spline = splinePasses(gl, map, shaders);
  passes.lit = targetOf(gl, "R32F", map.cols, map.rows);
  passes.values = [0, 1, 2].map(() => targetOf(gl, "RG32F", map.cols, map.rows));
  passes.empty = gl.createVertexArray();
  return passes;
}

function mapTextures(gl, map) {
  const cells = map.rows * map.cols;
  const [position, normal] = [new Float32Array(4 * cells), new Float32Array(4 * cells)];
  for (let j = 0; j < map.count; j++) {
    position.set([...positionOf(map, j), 1], 4 * map.cell[j]);
    normal.set([...normalOf(map, j), albedoOf(map, j)], 4 * map.cell[j]);
  }
  return {
    position: textureOf(gl, "RGBA32F", map.cols, map.rows, position),
    normal: textureOf(gl, "RGBA32F", map.cols, map.rows, normal),
  };
}

/** What shadows on a region take: the program, and depths of the map and of its surroundings in the reference camera,
 * less that of the local frame's origin. */
function shadowsByDepths({ gl, map, reference }, shaders) {
  const depth = new Float32Array(map.rows * map.cols).fill(FAR);
  const down = reference.camFromLocal.slice(6, 9);
  let [nearest, farthest] = [Infinity, -Infinity];
  const note = (value) => {
    nearest = Math.min(nearest, value);
    farthest = Math.max(farthest, value);
    return value;
  };
  for (let j = 0; j < map.count; j++) depth[map.cell[j]] = note(dot(down, positionOf(map, j)));
  const around = map.scene.surroundings || { rows: 1, cols: 1, stride: 1 };
  const values = Float32Array.from(map.around || [NaN], (d) => (Number.isNaN(d) ? FAR : note(d - reference.offset[2])));
  return {
    program: programOf(gl, shaders["grid.vert"], shaders["shadow.frag"]),
    depth: textureOf(gl, "R32F", map.cols, map.rows, depth),
    around: textureOf(gl, "R32F", around.cols, around.rows, values),
    aroundStride: around.stride,
    depths: [nearest, farthest],
  };
}

function overGrid(passes, program, target, uniforms, textures) {
  const { gl } = passes;
  drawInto(gl, target);
  gl.disable(gl.DEPTH_TEST);
  gl.bindVertexArray(passes.empty);
  use(gl, program, uniforms, textures);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
}

/** Fills passes.lit: where no ground hides the Sun (unit vector in the local frame). Once per Sun. */
function castShadows(passes, sun) {
  if (passes.sunOfShadows && passes.sunOfShadows.every((x, i) => x === sun[i])) return;
  passes.sunOfShadows = sun;
  passes.map.ground.castShadows(passes, sun);
}

/** By rays over the depths of the reference camera. */
function castByDepths(passes, sun) {
  const { map, reference, shadows } = passes;
  const { grid, spacing } = map.scene;
  const uniforms = {
    u_cam_from_local: ["Matrix3fv", reference.camFromLocal],
    u_offset: ["3f", ...reference.offset],
    u_towards: ["3f", ...turned(reference.camFromLocal, sun)],
    u_intrinsics: ["4f", ...reference.focal, ...reference.principal],
    u_first: ["3f", grid.row, grid.col, grid.stride],
    u_around_stride: ["1f", shadows.aroundStride],
    u_depths: ["2f", ...shadows.depths],
    u_step: ["1f", spacing],
  };
  const { position } = passes.textures;
  overGrid(passes, shadows.program, passes.lit, uniforms, {
    u_position: position,
    u_depth: shadows.depth,
    u_around: shadows.around,
  });
}

/** Programs and targets of the cubic spline through values of the grid, and the landmark nearest to each cell. */
function splinePasses(gl, map, shaders) {
  const nearest = new Float32Array(2 * map.rows * map.cols);
  for (let at = 0; at < map.rows * map.cols; at++) {
    const [row, col] = [Math.floor(at / map.cols), at % map.cols];
    [nearest[2 * at + 1], nearest[2 * at]] = map.landmarkAt[at] >= 0 ? [row, col] : nearestLandmark(map, row, col);
  }
  return {
    filled: programOf(gl, shaders["grid.vert"], shaders["filled.frag"]),
    along: programOf(gl, shaders["grid.vert"], shaders["spline.frag"]),
    nearest: textureOf(gl, "RG32F", map.cols, map.rows, nearest),
    values: targetOf(gl, "R32F", map.cols, map.rows),
    ofRows: targetOf(gl, "R32F", map.cols + 3, map.rows),
    coefficients: targetOf(gl, "R32F", map.cols + 3, map.rows + 3),
  };
}

/** Row and column of the cell with a landmark that is nearest to a cell. */
function nearestLandmark(map, row, col) {
  let [best, found] = [Infinity, [row, col]];
  for (let ring = 0; ring * ring < best && ring < Math.max(map.rows, map.cols); ring++) {
    for (let i = -ring; i <= ring; i++) {
      for (let j = -ring; j <= ring; j += Math.abs(i) === ring ? 1 : 2 * ring) {
        const [r, c] = [row + i, col + j];
        const inside = r >= 0 && c >= 0 && r < map.rows && c < map.cols;
        if (inside && map.landmarkAt[r * map.cols + c] >= 0 && i * i + j * j < best)
          [best, found] = [i * i + j * j, [r, c]];
      }
    }
  }
  return found;
}

/** Texture of the spline's coefficients through the values of a target like brightnessOf's. */
function coefficientsOf(passes, values) {
  const { filled, along, nearest, values: whole, ofRows, coefficients } = passes.spline;
  overGrid(passes, filled, whole, {}, { u_values: values.texture, u_nearest: nearest });
  overGrid(passes, along, ofRows, { u_along: ["2i", 1, 0] }, { u_values: whole.texture });
  overGrid(passes, along, coefficients, { u_along: ["2i", 0, 1] }, { u_values: ofRows.texture });
  return coefficients.texture;
}

/** Brightness = albedo * rho for a camera's centre, averaged by a Gaussian of sigma [cells] if above 0: a target and, if
 * it is to be smooth and the map is a grid, the coefficients of the spline that render interpolates with. */
function brightnessOf(passes, sun, center, shadows, sigma = 0, smooth = true) {
  const target = landmarkBrightness(passes, sun, center, shadows, sigma);
  return smooth && passes.spline ? { ...target, coefficients: coefficientsOf(passes, target) } : target;
}

function landmarkBrightness(passes, sun, center, shadows, sigma) {
  const model = passes.map.scene.reflectance;
  if (shadows) castShadows(passes, sun);
  const uniforms = {
    u_sun: ["3f", ...sun],
    u_center: ["3f", ...center],
    u_around: ["1i", shadows ? passes.map.ground.cellsOfPenumbra(passes.map.scene) : -1],
    p: ["1fv", new Float32Array(model.parameter_vector)],
    p_count: ["1i", model.parameter_vector.length],
  };
  const [first, second, third] = passes.values;
  overGrid(passes, passes.brightness, first, uniforms, {
    u_position: passes.textures.position,
    u_normal: passes.textures.normal,
    u_lit: passes.lit.texture,
  });
  if (!(sigma > 0)) return first;
  const along = (columns, rows) => ({ u_sigma: ["1f", sigma], u_along: ["2i", columns, rows] });
  overGrid(passes, passes.average, second, along(1, 0), { u_values: first.texture });
  overGrid(passes, passes.average, third, along(0, 1), { u_values: second.texture });
  return third;
}

/** A texture like brightnessOf's, of values (J,): weight 1 where they are finite. */
function valuesTexture(passes, values) {
  const { map, gl } = passes;
  const cells = new Float32Array(2 * map.rows * map.cols);
  for (let j = 0; j < map.count; j++) if (Number.isFinite(values[j])) cells.set([values[j], 1], 2 * map.cell[j]);
  return textureOf(gl, "RG32F", map.cols, map.rows, cells);
}
