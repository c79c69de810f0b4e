// SPDX-License-Identifier: Apache-2.0
// A small picture of a surface that is given by a formula, by rays through it. It shows the shape; points show the surface.
import {html, useEffect, useRef} from "./preact.js";

const SIDE = 128, STEPS = 48, HALVINGS = 5; // pixels; looks along a ray; between two of them
const YAW = 0.6, PITCH = 0.45;

const square = x => x * x;
const norm = ([x, y, z]) => Math.hypot(x, y, z);

/** A shape about the z axis, turned onto another axis. */
function turned(axis = [0, 0, 1], half, value) {
  const w = axis.map(x => x / norm(axis)), far = norm(half);
  return [[far, far, far], p => {
    const z = p[0] * w[0] + p[1] * w[1] + p[2] * w[2];
    return value([Math.sqrt(Math.max(0, square(norm(p)) - z * z)), 0, z]);
  }];
}

/** For each shape the extent along x, y and z, and a function that is negative inside; both around its centre. */
const SHAPES = {
  sphere: ({radius}) => [[radius, radius, radius], p => norm(p) - radius],
  torus({major_radius: major, minor_radius: minor, axis = [0, 0, 1]}) {
    const far = major + minor, a = axis.map(x => x / norm(axis));
    return [[far, far, far], p => {
      const z = p[0] * a[0] + p[1] * a[1] + p[2] * a[2];
      return Math.hypot(Math.sqrt(Math.max(0, square(norm(p)) - z * z)) - major, z) - minor;
    }];
  },
  cylinder({radius, height, rounding = 0, axis}) {
    return turned(axis, [radius, radius, height / 2], ([x, y, z]) => {
      const u = Math.hypot(x, y) - radius + rounding, v = Math.abs(z) - height / 2 + rounding;
      return Math.hypot(Math.max(u, 0), Math.max(v, 0)) + Math.min(0, Math.max(u, v)) - rounding;
    });
  },
  cone({radius, height, top_radius: top = 0, axis}) {
    const far = Math.max(radius, top);
    return turned(axis, [far, far, height / 2], ([x, y, z]) =>
      Math.max(Math.abs(z) - height / 2, Math.hypot(x, y) - radius - (top - radius) * (z / height + 0.5)));
  },
  capsule: ({radius, height, axis}) => turned(axis, [radius, radius, height / 2 + radius], ([x, y, z]) =>
    norm([x, y, Math.max(0, Math.abs(z) - height / 2)]) - radius),
  box({half_size: half, rounding = 0}) {
    return [half, p => {
      const q = p.map((x, k) => Math.abs(x) - half[k] + rounding);
      return norm(q.map(x => Math.max(x, 0))) + Math.min(0, Math.max(...q)) - rounding;
    }];
  },
  ellipsoid: ({radii}) => [radii, p => norm(p.map((x, k) => x / radii[k])) - 1],
  quartic({r = 0.13}) {
    const far = 3.7 * r;
    return [[far, far, far], ([x, y, z]) => x ** 4 + y ** 4 + z ** 4 - 10 * r * r * (x * x + y * y + z * z)];
  },
  gyroid({size = [1, 1, 1], period}) {
    const k = 2 * Math.PI / period, {sin, cos} = Math;
    return [size.map(x => x / 2), ([x, y, z]) => sin(k * x) * cos(k * y) + sin(k * y) * cos(k * z) + sin(k * z) * cos(k * x)];
  },
};

/** How bright the surface is at each pixel; 0: it is not there. */
function shade([half, value]) {
  const far = norm(half), picture = new Float32Array(SIDE * SIDE);
  const [sy, cy, sp, cp] = [Math.sin(YAW), Math.cos(YAW), Math.sin(PITCH), Math.cos(PITCH)];
  const right = [cy, sy, 0], up = [-sp * sy, sp * cy, cp], toEye = [cp * sy, -cp * cy, sp];
  const at = (u, v, w) => [0, 1, 2].map(k => u * right[k] + v * up[k] + w * toEye[k]);
  const inBox = p => p.every((x, k) => Math.abs(x) <= 1.001 * half[k]);
  for (let i = 0; i < picture.length; i++) {
    const u = far * (2 * (i % SIDE + 0.5) / SIDE - 1), v = far * (1 - 2 * (Math.floor(i / SIDE) + 0.5) / SIDE);
    let before = null;
    for (let step = 0; step <= STEPS; step++) {
      const w = far * (1 - 2 * step / STEPS), p = at(u, v, w), now = inBox(p) ? value(p) : null;
      if (before !== null && now !== null && before * now <= 0) {
        let outer = w + 2 * far / STEPS, inner = w;
        for (let k = 0; k < HALVINGS; k++) {
          const middle = (outer + inner) / 2;
          if (value(at(u, v, middle)) * before > 0) outer = middle;
          else inner = middle;
        }
        const q = at(u, v, inner), d = 1e-3 * far;
        const slope = [0, 1, 2].map(k => value(q.map((x, j) => x + (j === k ? d : 0))) - value(q.map((x, j) => x - (j === k ? d : 0))));
        picture[i] = 0.3 + 0.7 * Math.abs(slope.reduce((sum, x, k) => sum + x * toEye[k], 0)) / (norm(slope) || 1);
        break;
      }
      before = now;
    }
  }
  return picture;
}

/** Nothing for a surface that is not a formula, or whose numbers are missing. */
export function Sketch({formula}) {
  const place = useRef(null);
  const shape = formula && SHAPES[formula.shape] && Object.values(formula).flat().every(x => typeof x !== "number" || Number.isFinite(x))
    ? formula.shape : null;
  useEffect(() => {
    if (!shape) return undefined;
    const paint = () => {
      const context = place.current.getContext("2d"), image = context.createImageData(SIDE, SIDE);
      const colour = getComputedStyle(place.current).color.match(/[\d.]+/g);
      try {
        shade(SHAPES[shape](formula)).forEach((light, i) => image.data.set([...colour.slice(0, 3).map(c => c * light), light ? 255 : 0], 4 * i));
      } catch { /* numbers are missing: an empty picture */ }
      context.putImageData(image, 0, 0);
    };
    paint();
    addEventListener("theme", paint);
    return () => removeEventListener("theme", paint);
  }, [JSON.stringify(formula)]);
  return shape && html`<canvas ref=${place} class="sketch" width=${SIDE} height=${SIDE} role="img" aria-label=${`Sketch of the ${shape}`}></canvas>`;
}
