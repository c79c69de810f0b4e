// SPDX-License-Identifier: Apache-2.0
// A camera that circles a point: matrices for the graphics card, and what mouse, fingers and keys do to it.

const NEAR = 0.01, FAR = 100; // in distances of the eye from the point
const FIELD_OF_VIEW = 0.6; // radians
const STEP = 0.12; // of a key

/** Directions from which one looks, as [yaw, pitch] if z is up. */
const PRESETS = {Front: [-Math.PI / 2, 0], Back: [Math.PI / 2, 0], Right: [0, 0], Left: [Math.PI, 0], Top: [-Math.PI / 2, 1.57], Bottom: [-Math.PI / 2, -1.57]};
export const DIRECTIONS = Object.keys(PRESETS);

const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

export class Camera {
  constructor() {
    this.up = "z"; // or "y"
    Object.assign(this, {center: [0, 0, 0], radius: 1, framed: false});
    this.reset();
  }

  /** Looks at the ball from the right and above, as previews do. */
  reset() {
    // `zoom` and `shift` are in radii of the ball, so that they are the same for surfaces of different sizes
    Object.assign(this, {zoom: 1.05 / Math.sin(FIELD_OF_VIEW / 2), shift: [0, 0, 0], yaw: 0.7, pitch: 0.45, moved: false});
  }

  /** Looks from one of DIRECTIONS. */
  look(direction) {
    const [yaw, pitch] = PRESETS[direction];
    Object.assign(this, {yaw: yaw + (this.up === "y" ? Math.PI / 2 : 0), pitch, moved: true});
  }

  /** Turns about this point from now on. */
  centre(point) {
    Object.assign(this, {shift: point.map((p, k) => (p - this.center[k]) / this.radius), moved: true});
  }

  /** Sets the ball to look at; once it has been framed and moved by hand, it stays as it is. */
  frame(center, radius) {
    if (this.moved && this.framed) return;
    Object.assign(this, {center, radius, framed: true});
  }

  /** Looks at its own ball as another camera looks at its ball. */
  follow({zoom, shift, yaw, pitch, moved}) {
    Object.assign(this, {zoom, shift, yaw, pitch, moved});
  }

  get distance() {
    return this.zoom * this.radius;
  }

  get target() {
    return this.center.map((c, k) => c + this.shift[k] * this.radius);
  }

  /** Unit vectors to the right, up and back to the eye. */
  axes() {
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    const stand = ([x, y, z]) => (this.up === "y" ? [y, z, x] : [x, y, z]);
    const back = stand([cy * cp, sy * cp, sp]), right = stand([-sy, cy, 0]);
    return {right, up: cross(back, right), back};
  }

  eye() {
    const {back} = this.axes(), {target, distance} = this;
    return target.map((t, k) => t + back[k] * distance);
  }

  /** World to clip space, by columns. */
  matrix(aspect) {
    const {right, up, back} = this.axes(), eye = this.eye();
    const f = 1 / Math.tan(FIELD_OF_VIEW / 2), [fx, fy] = aspect > 1 ? [f / aspect, f] : [f, f * aspect];
    const near = this.distance * NEAR, far = this.distance * FAR;
    const a = (far + near) / (near - far), b = 2 * far * near / (near - far);
    const [tx, ty, tz] = [-dot(right, eye), -dot(up, eye), -dot(back, eye)];
    const column = k => [fx * right[k], fy * up[k], a * back[k], -back[k]];
    return new Float32Array([...column(0), ...column(1), ...column(2), fx * tx, fy * ty, a * tz + b, -tz]);
  }

  /** World units that one pixel covers, at distance one. */
  pixel(width, height) {
    return 2 * Math.tan(FIELD_OF_VIEW / 2) / Math.min(width, height);
  }

  turn(dx, dy) {
    this.moved = true;
    this.yaw -= dx;
    this.pitch = Math.min(1.57, Math.max(-1.57, this.pitch + dy));
  }

  /** By fractions of the picture's smaller side. */
  pan(dx, dy) {
    this.moved = true;
    const {right, up} = this.axes(), scale = 2 * Math.tan(FIELD_OF_VIEW / 2) * this.zoom;
    this.shift = this.shift.map((s, k) => s + scale * (up[k] * dy - right[k] * dx));
  }

  approach(factor) {
    this.moved = true;
    this.zoom = Math.min(50, Math.max(1e-3, this.zoom * factor));
  }

  key(event) {
    const arrows = {ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, -STEP], ArrowDown: [0, STEP]};
    if (arrows[event.key]) {
      const [dx, dy] = arrows[event.key];
      if (event.shiftKey) this.pan(dx, dy);
      else this.turn(dx, dy);
    } else if (event.key === "+" || event.key === "=") this.approach(1 / 1.15);
    else if (event.key === "-") this.approach(1.15);
    else if (event.key === "Home") this.reset();
    else return false;
    return true;
  }
}

/** Lets mouse, fingers and keys move the camera of a canvas; `onMove()` after each, `onPick(x, y)` for a click, `onCentre(x, y)` for a double click. */
export function steer(canvas, camera, onMove, onPick, onCentre) {
  const fingers = new Map();
  let travelled = 0;
  const middle = () => {
    const all = [...fingers.values()];
    const x = all.reduce((s, p) => s + p.x, 0) / all.length, y = all.reduce((s, p) => s + p.y, 0) / all.length;
    return {x, y, spread: all.length > 1 ? Math.hypot(all[0].x - all[1].x, all[0].y - all[1].y) : 0};
  };
  canvas.onpointerdown = event => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, {x: event.clientX, y: event.clientY});
    travelled = 0;
  };
  canvas.onpointermove = event => {
    if (!fingers.has(event.pointerId)) return;
    const before = middle();
    fingers.set(event.pointerId, {x: event.clientX, y: event.clientY});
    const after = middle(), dx = after.x - before.x, dy = after.y - before.y;
    travelled += Math.hypot(dx, dy);
    const size = Math.min(canvas.clientWidth, canvas.clientHeight);
    if (fingers.size > 1 || event.shiftKey || event.buttons & 6) camera.pan(dx / size, dy / size);
    else camera.turn(dx * 3 / size, dy * 3 / size);
    if (before.spread && after.spread) camera.approach(before.spread / after.spread);
    onMove();
  };
  canvas.onpointerup = canvas.onpointercancel = event => {
    fingers.delete(event.pointerId);
    if (event.type === "pointerup" && travelled < 4) onPick(event.offsetX, event.offsetY);
  };
  canvas.ondblclick = event => onCentre(event.offsetX, event.offsetY);
  canvas.onwheel = event => {
    event.preventDefault();
    camera.approach(Math.exp(event.deltaY * (event.deltaMode ? 0.03 : 0.001)));
    onMove();
  };
  canvas.onkeydown = event => {
    if (!camera.key(event)) return;
    event.preventDefault();
    onMove();
  };
  canvas.oncontextmenu = event => event.preventDefault();
}
