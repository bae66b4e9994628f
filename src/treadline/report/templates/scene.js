"use strict";
// Three-dimensional scene of a run: WebGL 2, flat shading with one light and its shadow, edges of the solids as lines.

const VERTEX = `#version 300 es
in vec3 position; uniform mat4 model, camera, light; out vec3 world; out vec4 lit;
void main() { vec4 p = model * vec4(position, 1.0); world = p.xyz; lit = light * p; gl_Position = camera * p; }`;
const FRAGMENT = `#version 300 es
precision highp float; precision highp sampler2DShadow;
in vec3 world; in vec4 lit; uniform vec3 colour, sun, eye; uniform float opacity, flatness; uniform sampler2DShadow depth; out vec4 pixel;
float sunlight(vec3 n) {
  vec3 p = lit.xyz / lit.w * 0.5 + 0.5;
  if (any(lessThan(p, vec3(0.0))) || any(greaterThan(p, vec3(1.0)))) return 1.0;
  float sum = 0.0, texel = 1.0 / float(textureSize(depth, 0).x), bias = 0.0012 + 0.003 * (1.0 - abs(dot(n, sun)));
  for (int i = -1; i <= 1; i++) for (int j = -1; j <= 1; j++) sum += texture(depth, vec3(p.xy + texel * vec2(i, j), p.z - bias));
  return sum / 9.0;
}
void main() {
  vec3 n = normalize(cross(dFdx(world), dFdy(world)));
  if (dot(n, eye - world) < 0.0) n = -n;
  float direct = max(dot(n, sun), 0.0) * sunlight(n), sky = 0.5 + 0.5 * n.z;
  vec3 shaded = colour * (0.42 + 0.22 * sky + 0.46 * direct);
  pixel = vec4(mix(shaded, colour, flatness), opacity);
}`;
const SHADOW_FRAGMENT = `#version 300 es
precision highp float; void main() {}`;
const MARK_VERTEX = `#version 300 es
in vec3 position; in vec4 tint; uniform mat4 camera; out vec4 shade;
void main() { shade = tint; gl_Position = camera * vec4(position, 1.0); }`;
const MARK_FRAGMENT = `#version 300 es
precision highp float; in vec4 shade; out vec4 pixel; void main() { pixel = shade; }`;

const FIELD_RAD = 0.62, FAR_M = 120;  // field of view across the height, and farthest drawn point
const SHADOW_PX = 2048, SHADOW_REACH_M = 3.2, SUN = normalised([-0.45, -0.62, 1.0]);

function normalised(v) { const l = Math.hypot(...v); return v.map((x) => x / l); }
function cross(a, b) { return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]; }
function along(p, v, s) { return [p[0] + s * v[0], p[1] + s * v[1], p[2] + s * v[2]]; }
function dot(a, b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/** Product of two 4×4 matrices stored by columns. */
function times(a, b) {
  const c = new Float32Array(16);
  for (let j = 0; j < 4; j++) for (let i = 0; i < 4; i++) {
    let sum = 0;
    for (let k = 0; k < 4; k++) sum += a[4 * k + i] * b[4 * j + k];
    c[4 * j + i] = sum;
  }
  return c;
}
function lookAt(eye, target, up = [0, 0, 1]) {
  const z = normalised([eye[0] - target[0], eye[1] - target[1], eye[2] - target[2]]);
  const x = normalised(cross(up, z)), y = cross(z, x);
  return new Float32Array([x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, -dot(x, eye), -dot(y, eye), -dot(z, eye), 1]);
}
function perspective(fov, aspect, near, far) {
  const f = 1 / Math.tan(fov / 2), d = 1 / (near - far);
  return new Float32Array([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) * d, -1, 0, 0, 2 * far * near * d, 0]);
}
function orthographic(across, up, near, far) {
  return new Float32Array([1 / across, 0, 0, 0, 0, 1 / up, 0, 0, 0, 0, -2 / (far - near), 0, 0, 0, -(far + near) / (far - near), 1]);
}
/** Rigid transform from a position and a quaternion (w, x, y, z). */
function rigid(p, q) {
  const [w, x, y, z] = q;
  return new Float32Array([
    1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y), 0,
    2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x), 0,
    2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y), 0, p[0], p[1], p[2], 1]);
}
function turnedAboutY(x, y, z, angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return new Float32Array([c, 0, -s, 0, 0, 1, 0, 0, s, 0, c, 0, x, y, z, 1]);
}
function point(m, p) {
  return [0, 1, 2].map((i) => m[i] * p[0] + m[4 + i] * p[1] + m[8 + i] * p[2] + m[12 + i]);
}
function direction(m, v) { return [0, 1, 2].map((i) => m[i] * v[0] + m[4 + i] * v[1] + m[8 + i] * v[2]); }
const IDENTITY = rigid([0, 0, 0], [1, 0, 0, 0]);

/** Table of poses over an angle: x, y, z and the rotation about y. */
class PoseTable {
  constructor(table) {
    this.low = table.low;
    this.high = table.high;
    this.poses = Object.fromEntries(Object.entries(table.poses).map(([name, value]) => [name, unpack(value)]));
  }
  at(name, angle) {
    const rows = this.poses[name], n = rows.length / 4;
    const f = share(angle, this.low, this.high) * (n - 1), k = Math.min(Math.floor(f), n - 2), r = f - k;
    const v = [0, 1, 2, 3].map((i) => rows[4 * k + i] * (1 - r) + rows[4 * k + 4 + i] * r);
    return turnedAboutY(...v);
  }
}
function share(value, low, high) { return high > low ? Math.min(Math.max((value - low) / (high - low), 0), 1) : 0; }

/** Belt path tabulated over flipper angle and share of its length. */
class Belt {
  constructor(value, table) {
    this.path = unpack(value.path);
    this.points = value.points;
    this.lengths = value.lengths_m;
    this.count = value.count;
    this.y = value.y_m;
    this.table = table;
  }
  /** Poses of the lugs of one side (0 left, 1 right) in B. */
  lugs(side, travel, flipper) {
    const n = this.lengths.length, f = share(flipper, this.table.low, this.table.high) * (n - 1);
    const k = Math.min(Math.floor(f), Math.max(n - 2, 0)), r = n > 1 ? f - k : 0, next = Math.min(k + 1, n - 1);
    const length = this.lengths[k] * (1 - r) + this.lengths[next] * r, poses = [];
    for (let i = 0; i < this.count; i++) {
      let s = (travel / length + i / this.count) % 1;
      if (s < 0) s += 1;
      const at = s * this.points, a = Math.floor(at) % this.points, b = (a + 1) % this.points, u = at - Math.floor(at);
      const v = [0, 1, 2, 3].map((c) =>
        (1 - r) * ((1 - u) * this.path[4 * (k * this.points + a) + c] + u * this.path[4 * (k * this.points + b) + c]) +
        r * ((1 - u) * this.path[4 * (next * this.points + a) + c] + u * this.path[4 * (next * this.points + b) + c]));
      const l = Math.hypot(v[2], v[3]) || 1, c = v[2] / l, d = v[3] / l;
      poses.push(new Float32Array([c, 0, d, 0, 0, -1, 0, 0, -d, 0, c, 0, v[0], this.y[side], v[1], 1]));
    }
    return poses;
  }
}

/** Renderer of one scene on a canvas. */
class Scene {
  constructor(canvas, data) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("no WebGL 2");
    this.canvas = canvas;
    this.gl = gl;
    this.solid = this.program(VERTEX, FRAGMENT, ["model", "camera", "light", "colour", "sun", "eye", "opacity", "flatness", "depth"]);
    this.dark = this.program(VERTEX, SHADOW_FRAGMENT, ["model", "camera", "light"]);
    this.marked = this.program(MARK_VERTEX, MARK_FRAGMENT, ["camera"]);
    this.parts = data.parts.map((part) => this.mesh(part));
    this.lug = data.lug;
    this.lugVertices = unpack(data.lug.vertices);
    this.lugFaces = unpackIndices(data.lug.faces);
    this.lugEdges = unpackIndices(data.lug.edges);
    this.seatTable = new PoseTable(data.bodies.seat);
    this.flipperTable = new PoseTable(data.bodies.flipper);
    this.belt = new Belt(data.belt, this.flipperTable);
    this.lugMesh = this.lugBuffers();
    this.marks = { vao: gl.createVertexArray(), buffer: gl.createBuffer() };
    gl.bindVertexArray(this.marks.vao);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.marks.buffer);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 28, 0);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 4, gl.FLOAT, false, 28, 12);
    this.shadowTarget();
    this.view = { azimuth: -1.15, elevation: 0.28, distance: 4.2, target: [0, 0, 0.8], pan: [0, 0, 0] };
    this.background = [1, 1, 1];
    this.edgeColour = [0.15, 0.17, 0.2];
  }
  program(vertex, fragment, names) {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.bindAttribLocation(program, 0, "position");
    gl.bindAttribLocation(program, 1, "tint");
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return { program, at: Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(program, name)])) };
  }
  buffers(vertices, faces, edges) {
    const gl = this.gl, vao = gl.createVertexArray(), lines = gl.createVertexArray(), buffer = gl.createBuffer();
    for (const [array, indices] of [[vao, faces], [lines, edges]]) {
      gl.bindVertexArray(array);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      if (array === vao) gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.DYNAMIC_DRAW);
      gl.enableVertexAttribArray(0);
      gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    }
    gl.bindVertexArray(null);
    return { vao, lines, buffer, faces: faces.length, edges: edges.length };
  }
  mesh(part) {
    const made = this.buffers(unpack(part.vertices), unpackIndices(part.faces), unpackIndices(part.edges));
    return { ...made, name: part.name, body: part.body, colour: part.colour, opacity: part.opacity };
  }
  lugBuffers() {
    const n = 2 * this.belt.count, per = this.lugVertices.length / 3;
    const repeated = (indices) => Uint16Array.from({ length: n * indices.length }, (_, i) =>
      indices[i % indices.length] + per * Math.floor(i / indices.length));
    return { ...this.buffers(new Float32Array(3 * n * per), repeated(this.lugFaces), repeated(this.lugEdges)),
      body: "chair", colour: this.lug.colour, opacity: 1 };
  }
  moveLugs(state) {
    const v = this.lugVertices, all = new Float32Array(2 * this.belt.count * v.length);
    let at = 0;
    for (const side of [0, 1]) for (const m of this.belt.lugs(side, state.travel[side], state.flipper)) {
      for (let i = 0; i < v.length; i += 3) for (let c = 0; c < 3; c++) {
        all[at++] = m[c] * v[i] + m[4 + c] * v[i + 1] + m[8 + c] * v[i + 2] + m[12 + c];
      }
    }
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, this.lugMesh.buffer);
    this.gl.bufferSubData(this.gl.ARRAY_BUFFER, 0, all);
  }
  shadowTarget() {
    const gl = this.gl;
    this.depth = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.depth);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOW_PX, SHADOW_PX);
    for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR],
      [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE],
      [gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE]]) gl.texParameteri(gl.TEXTURE_2D, name, value);
    this.shadow = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadow);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.depth, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }
  /** Transform of each body in W. */
  bodies(state) {
    const chair = rigid(state.p, state.q), found = { chair, world: IDENTITY };
    for (const name of Object.keys(this.seatTable.poses)) found[name] = times(chair, this.seatTable.at(name, state.seat));
    for (const name of Object.keys(this.flipperTable.poses)) found[name] = times(chair, this.flipperTable.at(name, state.flipper));
    return found;
  }
  eyeAndTarget() {
    const v = this.view, target = [0, 1, 2].map((i) => v.target[i] + v.pan[i]), c = Math.cos(v.elevation);
    const eye = [target[0] + v.distance * c * Math.cos(v.azimuth), target[1] + v.distance * c * Math.sin(v.azimuth),
      target[2] + v.distance * Math.sin(v.elevation)];
    return [eye, target];
  }
  /** Least distance from which a box about the target is in the picture, at the azimuth and elevation of the view. */
  distanceFor(low, high) {
    const v = this.view, middle = v.target, c = Math.cos(v.elevation), s = Math.sin(v.elevation);
    const back = [c * Math.cos(v.azimuth), c * Math.sin(v.azimuth), s], up = [-s * Math.cos(v.azimuth), -s * Math.sin(v.azimuth), c], right = cross(up, back);
    const tangent = Math.tan(FIELD_RAD / 2), aspect = this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1);
    let least = 0;
    for (const x of [low[0], high[0]]) for (const y of [low[1], high[1]]) for (const z of [low[2], high[2]]) {
      const p = [x - middle[0], y - middle[1], z - middle[2]];
      least = Math.max(least, dot(p, back) + Math.max(Math.abs(dot(p, right)) / aspect, Math.abs(dot(p, up))) / tangent);
    }
    return least;
  }
  resize() {
    const scale = Math.min(window.devicePixelRatio || 1, 2), c = this.canvas;
    const w = Math.max(1, Math.round(c.clientWidth * scale)), h = Math.max(1, Math.round(c.clientHeight * scale));
    if (c.width !== w || c.height !== h) { c.width = w; c.height = h; }
  }
  /** Draw the scene at a state: pose p, q, seat, flipper, travel; null draws the stair alone. marks: [x, y, z, r, g, b, a] … */
  draw(state, marks) {
    const gl = this.gl;
    this.resize();
    const bodies = state ? this.bodies(state) : { world: IDENTITY };
    if (state) this.moveLugs(state);
    const shown = [...this.parts, this.lugMesh].filter((part) => part.body in bodies);
    const [eye, target] = this.eyeAndTarget();
    const centre = state ? point(bodies.chair, [0, 0, 0.4]) : target;
    const light = times(orthographic(SHADOW_REACH_M, SHADOW_REACH_M, 0.1, 14), lookAt([0, 1, 2].map((i) => centre[i] + 7 * SUN[i]), centre));
    const aspect = this.canvas.width / this.canvas.height;
    const v = this.view, reach = v.distance * Math.tan(FIELD_RAD / 2), se = Math.sin(v.elevation);
    const up = [-se * Math.cos(v.azimuth), -se * Math.sin(v.azimuth), Math.cos(v.elevation)];
    const lens = v.orthogonal ? orthographic(reach * aspect, reach, -FAR_M, FAR_M) : perspective(FIELD_RAD, aspect, 0.05, FAR_M);
    const camera = times(lens, lookAt(eye, target, up));
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.depthMask(true);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadow);
    gl.viewport(0, 0, SHADOW_PX, SHADOW_PX);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.dark.program);
    gl.uniformMatrix4fv(this.dark.at.camera, false, light);
    gl.uniformMatrix4fv(this.dark.at.light, false, light);
    for (const part of shown) if (part.opacity === 1) this.triangles(this.dark, part, bodies);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(...this.background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.solid.program);
    const at = this.solid.at;
    gl.uniformMatrix4fv(at.camera, false, camera);
    gl.uniformMatrix4fv(at.light, false, light);
    gl.uniform3fv(at.sun, SUN);
    gl.uniform3fv(at.eye, v.orthogonal ? along(target, normalised(along(eye, target, -1)), FAR_M) : eye);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.depth);
    gl.uniform1i(at.depth, 0);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 1);
    gl.uniform1f(at.flatness, 0);
    for (const part of shown) if (part.opacity === 1) this.triangles(this.solid, part, bodies);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    gl.uniform1f(at.flatness, 1);
    gl.uniform3fv(at.colour, this.edgeColour);
    for (const part of shown) {
      gl.uniformMatrix4fv(at.model, false, bodies[part.body]);
      gl.uniform1f(at.opacity, part.opacity === 1 ? 0.4 : 0.25);
      gl.bindVertexArray(part.lines);
      gl.drawElements(gl.LINES, part.edges, gl.UNSIGNED_SHORT, 0);
    }
    gl.uniform1f(at.flatness, 0);
    gl.enable(gl.CULL_FACE);  // of a wall, the inner face alone: the near wall does not veil the chair
    gl.cullFace(gl.FRONT);
    for (const part of shown) if (part.opacity < 1) this.triangles(this.solid, part, bodies);
    gl.disable(gl.CULL_FACE);
    if (marks && marks.length) {
      gl.useProgram(this.marked.program);
      gl.uniformMatrix4fv(this.marked.at.camera, false, camera);
      gl.bindVertexArray(this.marks.vao);
      gl.bindBuffer(gl.ARRAY_BUFFER, this.marks.buffer);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(marks), gl.DYNAMIC_DRAW);
      gl.drawArrays(gl.TRIANGLES, 0, marks.length / 7);
    }
    gl.depthMask(true);
    gl.bindVertexArray(null);
  }
  triangles(program, part, bodies) {
    const gl = this.gl;
    gl.uniformMatrix4fv(program.at.model, false, bodies[part.body]);
    if (program.at.colour) {
      gl.uniform3fv(program.at.colour, part.colour);
      gl.uniform1f(program.at.opacity, part.opacity);
    }
    gl.bindVertexArray(part.vao);
    gl.drawElements(gl.TRIANGLES, part.faces, gl.UNSIGNED_SHORT, 0);
  }
  /** Let mouse and touch turn, move and zoom the view; changed() is called after each change. */
  listen(changed) {
    const c = this.canvas, held = new Map();
    const pan = (dx, dy) => {
      const v = this.view, k = v.distance / c.clientHeight * 0.64;
      const right = [-Math.sin(v.azimuth), Math.cos(v.azimuth), 0];
      for (let i = 0; i < 3; i++) v.pan[i] -= k * dx * right[i];
      v.pan[2] += k * dy * Math.cos(v.elevation);
    };
    const zoom = (factor) => { this.view.distance = Math.min(Math.max(this.view.distance * factor, 0.6), 60); };
    c.addEventListener("pointerdown", (e) => { c.setPointerCapture(e.pointerId); held.set(e.pointerId, [e.clientX, e.clientY]); });
    c.addEventListener("pointermove", (e) => {
      if (!held.has(e.pointerId)) return;
      const [x, y] = held.get(e.pointerId), dx = e.clientX - x, dy = e.clientY - y;
      if (held.size === 2) {
        const other = [...held].find(([id]) => id !== e.pointerId)[1];
        const before = Math.hypot(x - other[0], y - other[1]), after = Math.hypot(e.clientX - other[0], e.clientY - other[1]);
        if (after > 1) zoom(before / after);
        pan(dx / 2, dy / 2);
      } else if (e.shiftKey || e.buttons & 6) {
        pan(dx, dy);
      } else {
        this.view.orthogonal = false;
        this.view.azimuth -= 0.008 * dx;
        this.view.elevation = Math.min(Math.max(this.view.elevation + 0.006 * dy, -0.25), 1.5);
      }
      held.set(e.pointerId, [e.clientX, e.clientY]);
      changed();
    });
    for (const name of ["pointerup", "pointercancel"]) c.addEventListener(name, (e) => held.delete(e.pointerId));
    c.addEventListener("wheel", (e) => { e.preventDefault(); zoom(Math.exp(0.0012 * e.deltaY)); changed(); }, { passive: false });
    c.addEventListener("contextmenu", (e) => e.preventDefault());
  }
}
