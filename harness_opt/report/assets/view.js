// Drawing with WebGL 2, and the camera that is turned about the scene.

const SOLID_VERTEX = `#version 300 es
in vec3 position; in vec3 normal; in vec3 colour;
uniform mat4 camera, model; uniform vec3 tint; uniform bool tinted;
out vec3 n, c, p;
void main() {
  vec4 world = model * vec4(position, 1.0);
  n = mat3(model) * normal; c = tinted ? tint : colour; p = world.xyz;
  gl_Position = camera * world;
}`;
// two lights over the eye's shoulders and the sky; both sides of a face are lit
const SOLID_FRAGMENT = `#version 300 es
precision highp float;
in vec3 n, c, p;
uniform vec3 eye, right, up, back; uniform float alpha, shine;
out vec4 pixel;
void main() {
  vec3 way = normalize(eye - p), m = normalize(n);
  m = dot(m, way) < 0.0 ? -m : m;
  vec3 key = normalize(-0.6 * right + 0.9 * up + back), fill = normalize(0.9 * right + 0.1 * up + 0.8 * back);
  float light = 0.5 + 0.42 * max(dot(m, key), 0.0) + 0.2 * max(dot(m, fill), 0.0) + 0.1 * m.z;
  float gloss = shine * pow(max(dot(m, normalize(key + way)), 0.0), 40.0);
  pixel = vec4(c * light + gloss, alpha);
}`;
const LINE_VERTEX = `#version 300 es
in vec3 position; uniform mat4 camera, model;
void main() { gl_Position = camera * model * vec4(position, 1.0); gl_Position.z -= 2e-4 * gl_Position.w; }`;
const LINE_FRAGMENT = `#version 300 es
precision highp float;
uniform vec4 ink; out vec4 pixel;
void main() { pixel = ink; }`;

class Renderer {
  constructor(canvas) {
    this.canvas = canvas;
    // kept after drawing, so that a page can be printed
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("This browser has no WebGL 2");
    this.gl = gl;
    this.solids = this.program(SOLID_VERTEX, SOLID_FRAGMENT);
    this.lines = this.program(LINE_VERTEX, LINE_FRAGMENT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.SCISSOR_TEST);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  program(...sources) {
    const gl = this.gl, program = gl.createProgram();
    [gl.VERTEX_SHADER, gl.FRAGMENT_SHADER].forEach((kind, k) => {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, sources[k]);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    });
    ["position", "normal", "colour"].forEach((name, k) => gl.bindAttribLocation(program, k, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const uniforms = {};
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
      const { name } = gl.getActiveUniform(program, i);
      uniforms[name] = gl.getUniformLocation(program, name);
    }
    return { program, uniforms };
  }

  /** Buffers of {positions, normals?, colours?, indices?}, to be filled again by `fill`. */
  mesh(data) {
    const gl = this.gl, mesh = { vao: gl.createVertexArray(), buffers: {}, count: 0 };
    this.fill(mesh, data);
    return mesh;
  }

  fill(mesh, data) {
    const gl = this.gl;
    gl.bindVertexArray(mesh.vao);
    ["positions", "normals", "colours"].forEach((name, k) => {
      if (!data[name]) return;
      mesh.buffers[name] ??= gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, mesh.buffers[name]);
      gl.bufferData(gl.ARRAY_BUFFER, data[name], gl.DYNAMIC_DRAW);
      gl.enableVertexAttribArray(k);
      gl.vertexAttribPointer(k, 3, gl.FLOAT, false, 0, 0);
    });
    if (data.indices) {
      mesh.buffers.indices ??= gl.createBuffer();
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, mesh.buffers.indices);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, data.indices, gl.DYNAMIC_DRAW);
    }
    mesh.indexed = Boolean(data.indices);
    mesh.count = data.indices ? data.indices.length : data.positions.length / 3;
  }

  /** Clear a part of the canvas, in pixels from its lower left, and draw there. */
  begin([x, y, width, height], camera, paper) {
    const gl = this.gl;
    gl.viewport(x, y, width, height);
    gl.scissor(x, y, width, height);
    gl.clearColor(...paper, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const { solids, lines } = this, seen = camera.look(width / height);
    gl.useProgram(solids.program);
    for (const name of ["eye", "right", "up", "back"]) gl.uniform3fv(solids.uniforms[name], seen[name]);
    gl.uniformMatrix4fv(solids.uniforms.camera, false, seen.matrix);
    gl.useProgram(lines.program);
    gl.uniformMatrix4fv(lines.uniforms.camera, false, seen.matrix);
    return seen;
  }

  draw(mesh, { model = IDENTITY, colour = null, alpha = 1, shine = 0.12, above = false }) {
    const gl = this.gl, { program, uniforms } = this.solids;
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.model, false, model);
    gl.uniform1i(uniforms.tinted, colour ? 1 : 0);
    gl.uniform3fv(uniforms.tint, colour ?? [0, 0, 0]);
    gl.uniform1f(uniforms.alpha, alpha);
    gl.uniform1f(uniforms.shine, shine);
    this.blend(alpha < 1);
    if (above) gl.disable(gl.DEPTH_TEST);
    this.elements(mesh, gl.TRIANGLES);
    gl.enable(gl.DEPTH_TEST);
  }

  drawLines(mesh, { model = IDENTITY, colour, alpha = 1, above = false }) {
    const gl = this.gl, { program, uniforms } = this.lines;
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.model, false, model);
    gl.uniform4fv(uniforms.ink, [...colour, alpha]);
    this.blend(alpha < 1);
    if (above) gl.disable(gl.DEPTH_TEST);
    this.elements(mesh, gl.LINES);
    gl.enable(gl.DEPTH_TEST);
  }

  blend(wanted) {
    const gl = this.gl;
    if (wanted) gl.enable(gl.BLEND);
    else gl.disable(gl.BLEND);
    gl.depthMask(!wanted);
  }

  elements(mesh, kind) {
    const gl = this.gl;
    gl.bindVertexArray(mesh.vao);
    if (mesh.indexed) gl.drawElements(kind, mesh.count, gl.UNSIGNED_INT, 0);
    else gl.drawArrays(kind, 0, mesh.count);
    gl.depthMask(true);
  }
}

const TANGENT = Math.tan((9 * Math.PI) / 180); // half the picture's height at depth 1: a long lens, sizes compare
const MARGIN = 0.86; // share of the picture that the scene fills
const STEEPEST = 1.55; // rad, that the eye stands above or below

class Camera {
  /** `view`: axes to begin with, and the points to hold. */
  constructor(view) {
    this.view = view;
    this.reset();
  }

  reset() {
    this.face(this.view.back);
  }

  /** Look along -`back`, far enough off to see all, or what is `near` the cables. */
  face(back, near = false) {
    this.held = near ? this.view.near : this.view.hold;
    this.azimuth = Math.atan2(back[1], back[0]);
    this.elevation = Math.asin(Math.max(-1, Math.min(1, back[2])));
    this.target = null;
    this.zoom = 1;
  }

  axes() {
    const level = Math.cos(this.elevation);
    const back = [level * Math.cos(this.azimuth), level * Math.sin(this.azimuth), Math.sin(this.elevation)];
    const right = [-Math.sin(this.azimuth), Math.cos(this.azimuth), 0];
    return { right, up: cross(back, right), back };
  }

  look(aspect) {
    const { right, up, back } = this.axes();
    const flat = this.held.map((p) => [dot(p, right), dot(p, up), dot(p, back)]);
    const middle = [0, 1, 2].map((k) => 0.5 * (Math.min(...flat.map((p) => p[k])) + Math.max(...flat.map((p) => p[k]))));
    this.target ??= add(add(scale(right, middle[0]), up, middle[1]), back, middle[2]);
    const wide = TANGENT * aspect * MARGIN, high = TANGENT * MARGIN;
    const fitting = flat.map(([x, y, z]) =>
      z - middle[2] + Math.max(Math.abs(x - middle[0]) / wide, Math.abs(y - middle[1]) / high));
    this.reach = Math.max(...fitting);
    this.distance = this.reach / this.zoom;
    const eye = add(this.target, back, this.distance);
    // the whole scene is drawn, however near the eye is
    const deep = this.view.hold.map((p) => this.distance - dot(add(p, this.target, -1), back));
    const far = Math.max(this.distance + this.reach, ...deep) * 1.5;
    const matrix = projection(eye, right, up, back, TANGENT, aspect, 0.02 * this.distance, far);
    return { eye, right, up, back, matrix };
  }

  turn(x, y) {
    this.azimuth -= x;
    this.elevation = Math.max(-STEEPEST, Math.min(STEEPEST, this.elevation + y));
  }

  /** Shift by a share of the picture's height. */
  shift(x, y) {
    const { right, up } = this.axes(), height = 2 * TANGENT * this.distance;
    this.target = add(add(this.target, right, -x * height), up, y * height);
  }

  nearer(factor) {
    this.zoom = Math.max(0.2, Math.min(60, this.zoom * factor));
  }
}
