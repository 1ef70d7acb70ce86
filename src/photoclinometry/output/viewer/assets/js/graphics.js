// WebGL 2: programs, textures and targets.

/** The canvas's context; throws an Error in words where the browser lacks what the page needs. */
function graphicsOf(canvas) {
  const gl = canvas.getContext("webgl2", { antialias: false, preserveDrawingBuffer: false });
  if (!gl) throw new Error("This browser has no WebGL 2, or it is switched off.");
  if (!gl.getExtension("EXT_color_buffer_float"))
    throw new Error("The graphics processor cannot draw numbers (EXT_color_buffer_float).");
  return gl;
}

const PRECISION = "#version 300 es\nprecision highp float;\nprecision highp int;\nprecision highp sampler2D;\n";

function compiled(gl, kind, source) {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, PRECISION + source);
  gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost())
    throw new Error(gl.getShaderInfoLog(shader));
  return shader;
}

/** A program with the places of its uniforms by name. */
function programOf(gl, vertex, fragment) {
  const handle = gl.createProgram();
  gl.attachShader(handle, compiled(gl, gl.VERTEX_SHADER, vertex));
  gl.attachShader(handle, compiled(gl, gl.FRAGMENT_SHADER, fragment));
  gl.bindAttribLocation(handle, 0, "a_cell");
  gl.linkProgram(handle);
  if (!gl.getProgramParameter(handle, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(handle));
  const places = {};
  for (let i = 0; i < gl.getProgramParameter(handle, gl.ACTIVE_UNIFORMS); i++) {
    const name = gl.getActiveUniform(handle, i).name.replace("[0]", "");
    places[name] = gl.getUniformLocation(handle, name);
  }
  return { handle, places };
}

/** Makes the program current, and sets its uniforms: setters by name, and textures by name. */
function use(gl, program, uniforms, textures) {
  gl.useProgram(program.handle);
  for (const [name, [kind, ...values]] of Object.entries(uniforms)) {
    const place = program.places[name];
    if (place === undefined) continue;
    if (kind === "Matrix3fv") gl.uniformMatrix3fv(place, true, values[0]);
    else gl[`uniform${kind}`](place, ...values);
  }
  Object.entries(textures).forEach(([name, texture], i) => {
    gl.activeTexture(gl.TEXTURE0 + i);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.uniform1i(program.places[name] ?? null, i);
  });
}

/** Layouts of textures: internal format, format, numbers per texel. */
const FORMATS = { R32F: ["RED", 1], RG32F: ["RG", 2], RGBA32F: ["RGBA", 4] };

/** A texture of numbers, nearest texel, no repetition; data may be null. */
function textureOf(gl, layout, width, height, data) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl[layout], width, height, 0, gl[FORMATS[layout][0]], gl.FLOAT, data);
  for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
    gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
  for (const wrap of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, wrap, gl.CLAMP_TO_EDGE);
  return texture;
}

/** A texture that is drawn into, with a depth buffer if wished. */
function targetOf(gl, layout, width, height, withDepth = false) {
  const target = { width, height, texture: textureOf(gl, layout, width, height, null), frame: gl.createFramebuffer() };
  gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target.texture, 0);
  if (withDepth) {
    target.depth = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, target.depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, width, height);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, target.depth);
  }
  return target;
}

function release(gl, target) {
  gl.deleteFramebuffer(target.frame);
  gl.deleteTexture(target.texture);
  if (target.depth) gl.deleteRenderbuffer(target.depth);
}

/** Makes a target current; null is the canvas. */
function drawInto(gl, target, width = target.width, height = target.height) {
  gl.bindFramebuffer(gl.FRAMEBUFFER, target && target.frame);
  gl.viewport(0, 0, width, height);
}

/** Numbers of a part of a target, four per texel; rows from the bottom. */
function readBack(gl, target, x = 0, y = 0, width = target.width, height = target.height) {
  gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
  const found = new Float32Array(4 * width * height);
  gl.readPixels(x, y, width, height, gl.RGBA, gl.FLOAT, found);
  return found;
}
