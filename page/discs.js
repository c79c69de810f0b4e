// SPDX-License-Identifier: Apache-2.0
// Draws points with WebGL 2 as discs in their tangent planes: one call for all of them, a quad for each.
import {spacingOf} from "./ply.js";

const DISC_VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in float spacing;
layout(location = 3) in float value;
uniform mat4 matrix;
uniform vec3 eye;
uniform vec4 plane; // what is behind it is not drawn
uniform float pixel; // what a pixel covers at distance one
uniform float size; // factor of the radii of discs
uniform int picked;
out vec2 place;
out float shade, amount;
flat out int id;
flat out float sunk; // how much deeper the rim is drawn, so that neighbours meet half-way
void main() {
  vec2 side_of_quad = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
  vec3 side = normalize(abs(normal.z) < 0.9 ? cross(normal, vec3(0, 0, 1)) : cross(normal, vec3(1, 0, 0)));
  vec3 to = eye - position;
  float radius = max(0.58 * size * spacing, 0.6 * pixel * length(to)); // no disc falls between pixels; neighbours touch
  if (gl_InstanceID == picked) radius *= 1.6;
  place = side_of_quad * (1.0 + pixel * length(to) / radius); // room for the pixels of the rim
  vec3 corner = position + radius * (place.x * side + place.y * cross(normal, side));
  gl_Position = dot(plane, vec4(position, 1)) < 0.0 ? vec4(2, 2, 2, 1) : matrix * vec4(corner, 1);
  vec4 middle = matrix * vec4(position, 1), deeper = matrix * vec4(position - 0.2 * radius * normalize(to), 1);
  sunk = 0.5 * (deeper.z / deeper.w - middle.z / middle.w);
  shade = dot(normal, normalize(to));
  amount = value;
  id = gl_InstanceID;
}`;

const DISC_FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
in vec2 place;
in float shade, amount;
flat in int id;
flat in float sunk;
uniform sampler2D map;
uniform vec2 range;
uniform int picked;
uniform bool picking;
out vec4 colour;
void main() {
  float off = dot(place, place), distance = sqrt(off);
  float coverage = clamp((1.0 - distance) / fwidth(distance) + 1.0, 0.0, 1.0); // the pixels around the disc are covered in part
  if (coverage == 0.0) discard;
  gl_FragDepth = gl_FragCoord.z + sunk * off;
  if (picking) {
    int n = id + 1;
    colour = vec4(n & 255, (n >> 8) & 255, (n >> 16) & 255, (n >> 24) & 255) / 255.0;
    return;
  }
  vec3 base = texture(map, vec2(clamp((amount - range.x) / max(range.y - range.x, 1e-30), 0.0, 1.0), 0.5)).rgb;
  if (id == picked) base = vec3(1.0, 0.25, 0.6);
  float light = shade > 0.0 ? 0.55 + 0.45 * shade : 0.4 - 0.2 * shade; // the inside is darker
  colour = vec4(base * light * (1.0 - 0.35 * smoothstep(0.55, 0.9, off)), coverage); // a darker rim separates discs
}`;

const WIRE_VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
uniform mat4 matrix;
uniform vec4 plane;
void main() {
  gl_Position = dot(plane, vec4(position, 1)) < 0.0 ? vec4(2, 2, 2, 1) : matrix * vec4(position, 1);
}`;

const WIRE_FRAGMENT = `#version 300 es
precision highp float;
uniform vec3 ink;
out vec4 colour;
void main() { colour = vec4(ink, 1); }`;

function compile(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [type, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS))
    throw new Error(`${gl.getProgramInfoLog(program)} ${gl.getAttachedShaders(program).map(shader => gl.getShaderInfoLog(shader)).join(" ")}`);
  const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
  const at = {};
  for (let i = 0; i < count; i++) {
    const {name} = gl.getActiveUniform(program, i);
    at[name] = gl.getUniformLocation(program, name);
  }
  return {program, at};
}

const GEOMETRY = 7; // numbers of a point: position, normal, spacing

export class Discs {
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", {antialias: true, alpha: false});
    if (!gl) throw new Error("This browser has no WebGL 2, which the view of points needs.");
    this.gl = gl;
    this.canvas = canvas;
    this.count = 0;
    this.edgeCount = 0;
    this.showWire = false;
    this.showDiscs = true;
    this.picked = -1;
    this.size = 1;
    this.plane = [0, 0, 0, 1];
    this.range = [0, 1];
    this.discs = compile(gl, DISC_VERTEX, DISC_FRAGMENT);
    this.wire = compile(gl, WIRE_VERTEX, WIRE_FRAGMENT);
    this.map = gl.createTexture();
    this.pickFrame = gl.createFramebuffer();
    this.pickColour = gl.createRenderbuffer();
    this.pickDepth = gl.createRenderbuffer();
    gl.enable(gl.DEPTH_TEST);
  }

  /** Allocates buffers for `count` points; their previous content is discarded. */
  allocate(count) {
    const gl = this.gl;
    for (const buffer of [this.geometry, this.values, this.edges]) gl.deleteBuffer(buffer || null);
    gl.deleteVertexArray(this.layout || null);
    gl.deleteVertexArray(this.wireLayout || null);
    this.edges = null;
    this.edgeCount = this.count = 0;
    this.picked = -1;
    this.geometry = gl.createBuffer();
    this.values = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.values);
    gl.bufferData(gl.ARRAY_BUFFER, count * 4, gl.STATIC_DRAW);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.geometry);
    gl.bufferData(gl.ARRAY_BUFFER, count * GEOMETRY * 4, gl.STATIC_DRAW);
    const attribute = (index, size, at, stride, divisor) => {
      gl.enableVertexAttribArray(index);
      gl.vertexAttribPointer(index, size, gl.FLOAT, false, stride, at);
      gl.vertexAttribDivisor(index, divisor);
    };
    this.layout = gl.createVertexArray();
    gl.bindVertexArray(this.layout);
    attribute(0, 3, 0, GEOMETRY * 4, 1);
    attribute(1, 3, 12, GEOMETRY * 4, 1);
    attribute(2, 1, 24, GEOMETRY * 4, 1);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.values);
    attribute(3, 1, 0, 4, 1);
    this.wireLayout = gl.createVertexArray();
    gl.bindVertexArray(this.wireLayout);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.geometry);
    attribute(0, 3, 0, GEOMETRY * 4, 0);
    this.bytes = count * (GEOMETRY + 1) * 4;
  }

  /** Takes over the points that have come since the last call. */
  extend(points) {
    const {columns, count} = points, first = this.count;
    if (count <= first) return;
    const block = new Float32Array((count - first) * GEOMETRY);
    ["x", "y", "z", "nx", "ny", "nz"].forEach((name, k) => {
      const column = columns[name];
      for (let i = first, to = k; i < count; i++, to += GEOMETRY) block[to] = column[i];
    });
    const spacing = spacingOf(points);
    for (let i = first, to = 6; i < count; i++, to += GEOMETRY) block[to] = spacing(i);
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, this.geometry);
    this.gl.bufferSubData(this.gl.ARRAY_BUFFER, first * GEOMETRY * 4, block);
    this.count = count;
  }

  colourBy(column) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, this.values);
    this.gl.bufferSubData(this.gl.ARRAY_BUFFER, 0, column.subarray(0, this.count));
  }

  /** 256 colours, four bytes each. */
  setMap(colours) {
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, this.map);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, colours);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  }

  setEdges(edges) {
    const gl = this.gl;
    this.edges = gl.createBuffer();
    gl.bindVertexArray(this.wireLayout);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.edges);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, edges, gl.STATIC_DRAW);
    this.edgeCount = edges.length;
  }

  setCommon({program, at}, camera) {
    const {gl, canvas} = this;
    gl.useProgram(program);
    gl.uniformMatrix4fv(at.matrix, false, camera.matrix(canvas.width / canvas.height));
    gl.uniform4fv(at.plane, this.plane);
  }

  drawDiscs(camera, picking) {
    const {gl, canvas, discs: {at}} = this;
    this.setCommon(this.discs, camera);
    gl.uniform3fv(at.eye, camera.eye());
    gl.uniform1f(at.pixel, camera.pixel(canvas.width, canvas.height));
    gl.uniform2fv(at.range, this.range);
    gl.uniform1f(at.size, this.size);
    gl.uniform1i(at.picked, this.picked);
    gl.uniform1i(at.picking, picking ? 1 : 0);
    gl.bindTexture(gl.TEXTURE_2D, this.map);
    gl.bindVertexArray(this.layout);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.count);
  }

  /** Draws a frame and returns the number of draw calls. */
  draw(camera, ground, ink) {
    const {gl, canvas} = this;
    let calls = 0;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(...ground, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (!this.count) return calls;
    if (this.showDiscs) {
      gl.enable(gl.SAMPLE_ALPHA_TO_COVERAGE);
      this.drawDiscs(camera, false);
      gl.disable(gl.SAMPLE_ALPHA_TO_COVERAGE);
      calls++;
    }
    if (this.showWire && this.edgeCount) {
      this.setCommon(this.wire, camera);
      gl.uniform3fv(this.wire.at.ink, ink);
      gl.bindVertexArray(this.wireLayout);
      gl.drawElements(gl.LINES, this.edgeCount, gl.UNSIGNED_INT, 0);
      calls++;
    }
    return calls;
  }

  /** The point whose disc is seen at a pixel of the canvas, -1 for none. */
  pick(camera, x, y) {
    const {gl, canvas} = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.pickFrame);
    for (const [buffer, format, where] of [[this.pickColour, gl.RGBA8, gl.COLOR_ATTACHMENT0], [this.pickDepth, gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT]]) {
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.renderbufferStorage(gl.RENDERBUFFER, format, canvas.width, canvas.height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, where, gl.RENDERBUFFER, buffer);
    }
    const below = canvas.height - 1 - y, found = new Uint8Array(4);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(x, below, 1, 1);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (this.count) this.drawDiscs(camera, true);
    gl.readPixels(x, below, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, found);
    gl.disable(gl.SCISSOR_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return (found[0] | found[1] << 8 | found[2] << 16 | found[3] << 24) - 1;
  }

  /** The graphics card, as far as the browser tells. */
  get card() {
    const known = this.gl.getExtension("WEBGL_debug_renderer_info");
    return known ? this.gl.getParameter(known.UNMASKED_RENDERER_WEBGL) : "";
  }

  free() {
    const lose = this.gl.getExtension("WEBGL_lose_context");
    if (lose) lose.loseContext();
  }
}
