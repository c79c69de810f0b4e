// SPDX-License-Identifier: Apache-2.0
// How many neighbours points have: edges of the Voronoi cell of each in its tangent plane, from the points near it.
// An estimate for the eye: the report counts on the surface itself.
import {spacingOf} from "./ply.js";

const REACH = 2.2; // in local spacings: farther points do not touch the cell of a point in a good packing
const SLICE_MS = 12; // of the browser's time, before it may do other things

/** Points by cells of a grid: the points of a cell are chained. */
function gridOf({x, y, z}, count, size) {
  const heads = new Map(), next = new Int32Array(count).fill(-1);
  const key = (i, j, k) => ((i + 32768) * 65536 + (j + 32768)) * 65536 + (k + 32768);
  const cell = v => Math.floor(v / size);
  for (let i = 0; i < count; i++) {
    const at = key(cell(x[i]), cell(y[i]), cell(z[i]));
    next[i] = heads.has(at) ? heads.get(at) : -1;
    heads.set(at, i);
  }
  return {next, cell, headOf: (i, j, k) => heads.get(key(i, j, k)) ?? -1};
}

/** Cuts a polygon at the bisector towards (u, v); each corner has the owner of the edge that begins there. */
function cut(polygon, u, v, owner) {
  const half = (u * u + v * v) / 2, result = [];
  for (let i = 0; i < polygon.length; i++) {
    const a = polygon[i], b = polygon[(i + 1) % polygon.length];
    const da = half - a.u * u - a.v * v, db = half - b.u * u - b.v * v;
    if (da >= 0) result.push(a);
    if (da >= 0 === db >= 0) continue;
    const t = da / (da - db);
    result.push({u: a.u + t * (b.u - a.u), v: a.v + t * (b.v - a.v), owner: da >= 0 ? owner : a.owner});
  }
  return result;
}

function degreeOf(i, columns, grid, spacing) {
  const {x, y, z, nx, ny, nz} = columns, reach = REACH * spacing, near = [];
  const side = Math.abs(nz[i]) < 0.9 ? [ny[i], -nx[i], 0] : [0, nz[i], -ny[i]];
  const length = Math.hypot(...side), [ax, ay, az] = side.map(s => s / length);
  const [bx, by, bz] = [ny[i] * az - nz[i] * ay, nz[i] * ax - nx[i] * az, nx[i] * ay - ny[i] * ax];
  const [lx, ly, lz] = [grid.cell(x[i] - reach), grid.cell(y[i] - reach), grid.cell(z[i] - reach)];
  const [hx, hy, hz] = [grid.cell(x[i] + reach), grid.cell(y[i] + reach), grid.cell(z[i] + reach)];
  for (let ci = lx; ci <= hx; ci++) for (let cj = ly; cj <= hy; cj++) for (let ck = lz; ck <= hz; ck++)
    for (let j = grid.headOf(ci, cj, ck); j >= 0; j = grid.next[j]) {
      const [dx, dy, dz] = [x[j] - x[i], y[j] - y[i], z[j] - z[i]];
      const squared = dx * dx + dy * dy + dz * dz;
      if (j === i || squared > reach * reach || nx[i] * nx[j] + ny[i] * ny[j] + nz[i] * nz[j] < 0.2) continue;
      const u = dx * ax + dy * ay + dz * az, v = dx * bx + dy * by + dz * bz, flat = Math.hypot(u, v) || 1;
      const stretch = Math.sqrt(squared) / flat; // the surface bends: distances count, not their shadows
      near.push({u: u * stretch, v: v * stretch, squared, j});
    }
  near.sort((a, b) => a.squared - b.squared);
  let cell = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([u, v]) => ({u: u * reach, v: v * reach, owner: -1}));
  for (const {u, v, j} of near) cell = cut(cell, u, v, j);
  return new Set(cell.map(corner => corner.owner).filter(owner => owner >= 0)).size;
}

/** The number of neighbours of each point, as a column; `wanted()` false ends it with null. */
export async function countNeighbours(points, wanted) {
  const {columns, count} = points, at = spacingOf(points), spacing = Float32Array.from({length: count}, (_, i) => at(i));
  const median = spacing.slice().sort()[count >> 1];
  const grid = gridOf(columns, count, 2 * median);
  const degrees = new Float32Array(count);
  for (let i = 0; i < count;) {
    const end = performance.now() + SLICE_MS;
    for (; i < count && performance.now() < end; i++) degrees[i] = degreeOf(i, columns, grid, spacing[i]);
    await new Promise(resolve => setTimeout(resolve));
    if (!wanted()) return null;
  }
  return degrees;
}
