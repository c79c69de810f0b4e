// SPDX-License-Identifier: Apache-2.0
// Reads points.ply and mesh.ply as they arrive, into a column for each property.
import {send} from "./api.js";

const TYPES = {
  float: [4, "getFloat32"], double: [8, "getFloat64"], uchar: [1, "getUint8"], char: [1, "getInt8"],
  uint: [4, "getUint32"], int: [4, "getInt32"], ushort: [2, "getUint16"], short: [2, "getInt16"],
};
const HEADER_MOST = 65536;

function parseHeader(bytes) {
  const text = new TextDecoder("latin1").decode(bytes.subarray(0, HEADER_MOST));
  const end = text.indexOf("end_header\n");
  if (end < 0) return null;
  const elements = [], comments = {};
  let format = "";
  for (const line of text.slice(0, end).split("\n")) {
    const words = line.trim().split(/\s+/);
    if (words[0] === "format") format = words[1];
    if (words[0] === "comment") comments[words[1]] = words[2];
    if (words[0] === "element") elements.push({name: words[1], count: Number(words[2]), properties: []});
    if (words[0] === "property") elements[elements.length - 1].properties.push(
      words[1] === "list" ? {name: words[4], list: words[2], type: words[3]} : {name: words[2], type: words[1]});
  }
  if (format !== "binary_little_endian")
    throw new Error(`The file is ${format || "not a PLY file"}: this view reads binary_little_endian.`);
  return {bytes: end + "end_header\n".length, elements, comments};
}

/** Properties from which the spacing follows, with their multiples of it. A file may have none of them. */
const SPACINGS = [["spacing_local", 1], ["spacing", 1], ["radius", 2], ["pscale", 2]];

export const hasSpacing = ({columns}) => SPACINGS.some(([name]) => columns[name]);

/** The spacing at a point, as a function of its index: of its file, or `even`, the same at all. */
export function spacingOf({columns, even}) {
  const found = SPACINGS.find(([name]) => columns[name]);
  return found ? i => found[1] * columns[found[0]][i] : () => even;
}

/** The pieces of a body, joined so that no record is cut. */
async function* piecesOf(response) {
  const reader = response.body.getReader();
  for (;;) {
    const {done, value} = await reader.read();
    if (done) return;
    yield value;
  }
}

function join(a, b) {
  if (!a.length) return b;
  const both = new Uint8Array(a.length + b.length);
  both.set(a);
  both.set(b, a.length);
  return both;
}

/**
 * Loads the points of a file: `onStart(points)`, which may take time, when the header has come, `onMore(points)` as
 * points arrive. If there are more than `most` points, one of each `step` points is kept. `points` has the `total` of
 * the file, the `step`, the `count` so far, an `origin`, `columns`: a Float32Array for each property, x, y and z less
 * the origin, and `comments` of the header: {up: "y"} of "comment up y".
 */
export async function loadPoints(path, most, {signal, onStart, onMore}) {
  const response = await send("GET", path, {signal});
  let rest = new Uint8Array(0), points = null, fields = null, stride = 0, read = 0;
  for await (const piece of piecesOf(response)) {
    rest = join(rest, piece);
    if (!points) {
      const header = parseHeader(rest);
      if (!header) {
        if (rest.length > HEADER_MOST) throw new Error("points.ply has no PLY header.");
        continue;
      }
      const vertex = header.elements[0];
      fields = vertex.properties.map(({name, type}) => {
        const [size, getter] = TYPES[type];
        stride += size;
        return {name, getter, at: stride - size};
      });
      const step = Math.max(1, Math.ceil(vertex.count / most));
      const kept = Math.ceil(vertex.count / step);
      points = {total: vertex.count, step, kept, count: 0, origin: null, comments: header.comments,
        columns: Object.fromEntries(fields.map(({name}) => [name, new Float32Array(kept)]))};
      rest = rest.subarray(header.bytes);
      await onStart(points);
    }
    const whole = Math.min(Math.floor(rest.length / stride), points.total - read);
    const view = new DataView(rest.buffer, rest.byteOffset);
    const first = (points.step - read % points.step) % points.step;
    if (!points.origin && whole) points.origin = fields.slice(0, 3).map(({getter, at}) => view[getter](at, true));
    const start = points.count;
    fields.forEach(({name, getter, at}, field) => {
      const column = points.columns[name], less = field < 3 ? points.origin && points.origin[field] : 0;
      for (let i = first, to = start; i < whole; i += points.step) column[to++] = view[getter](i * stride + at, true) - less;
    });
    points.count = start + Math.max(0, Math.ceil((whole - first) / points.step));
    read += whole;
    rest = rest.subarray(whole * stride);
    onMore(points);
  }
  if (!points || read < points.total) throw new Error("points.ply ended too early: reload the page.");
  return points;
}

/** The edges of the triangles of a mesh, each once: pairs of indices into its vertices. */
export async function loadEdges(path, {signal}) {
  const bytes = new Uint8Array(await (await send("GET", path, {signal})).arrayBuffer());
  const {bytes: start, elements: [vertex, face]} = parseHeader(bytes);
  const stride = vertex.properties.reduce((sum, {type}) => sum + TYPES[type][0], 0);
  const view = new DataView(bytes.buffer);
  const edges = new Uint32Array(face.count * 6);
  let count = 0, at = start + vertex.count * stride;
  for (let i = 0; i < face.count; i++) {
    const corners = view.getUint8(at);
    const corner = k => view.getUint32(at + 1 + 4 * (k % corners), true);
    for (let k = 0; k < corners && corners === 3; k++)
      if (corner(k) < corner(k + 1)) { // the triangle on the other side has it the other way round
        edges[count++] = corner(k);
        edges[count++] = corner(k + 1);
      }
    at += 1 + 4 * corners;
  }
  return edges.subarray(0, count);
}
