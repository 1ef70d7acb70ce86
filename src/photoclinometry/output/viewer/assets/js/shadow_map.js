// Cast shadows of a closed surface: its heights towards the Sun on a plane across it, and every vertex compared with them.

const SHADOW_PX = 2048; // of the map of heights, across and down

/** The programs, and the map of heights. */
function shadowsByMap({ gl }, shaders) {
  return {
    heights: programOf(gl, shaders["sun_heights.vert"], shaders["sun_heights.frag"]),
    program: programOf(gl, shaders["grid.vert"], shaders["sunlit.frag"]),
    target: targetOf(gl, "R32F", SHADOW_PX, SHADOW_PX, true),
  };
}

/** Fills passes.lit: 1 in sunlight, 0 in shadow, between both next to a shadow's edge. sun: unit vector. */
function castByMap(passes, sun) {
  const { gl, map, shadows, textures } = passes;
  const across = unit(cross(Math.abs(sun[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0], sun));
  const uniforms = {
    u_sun_from_local: ["Matrix3fv", [...across, ...cross(sun, across), ...sun]],
    u_radius: ["1f", 1.01 * map.radius],
  };
  drawInto(gl, shadows.target);
  gl.enable(gl.DEPTH_TEST);
  gl.clearColor(-FAR, 0, 0, 0);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  use(gl, shadows.heights, uniforms, { u_position: textures.position });
  drawMesh(gl, passes.mesh);
  overGrid(passes, shadows.program, passes.lit, uniforms, {
    u_position: textures.position,
    u_normal: textures.normal,
    u_heights: shadows.target.texture,
  });
}
