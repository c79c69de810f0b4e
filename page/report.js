// The report of a job as tables, with a sentence for each measure.
import {html} from "./preact.js";
import {bytesOf, durationOf, numberOf} from "./words.js";

/** Path in the report, word, sentence, and the ideal value where there is one. */
export const MEASURES = [
  ["count", "Points", "How many points were delivered."],
  ["spacing", "Spacing", "The distance between neighbours that an ideal packing of these points has, in world units."],
  ["surface.area", "Area", "The area of the surface that was sampled, in world units squared."],
  ["quality.hex_fraction", "Six neighbours", "The share of points with exactly six neighbours.", 1],
  ["quality.edge_cv", "Spread of distances", "How much distances between neighbours vary, over what was requested.", 0],
  ["quality.area_cv", "Spread of areas", "How much the Voronoi areas of points vary, over what was requested.", 0],
  ["quality.energy_excess", "Energy excess", "Mean energy over that of an ideal packing, less one.", 0],
  ["quality.disorder", "Disorder", "The same against perfect order with cells as large and the same grading.", 0],
  ["quality.min_spacing_ratio", "Closest pair", "The smallest distance between two points, in spacings.", 1],
  ["quality.coverage", "Farthest place", "The largest distance of a place of the surface from the nearest point, in spacings.", 0.58],
  ["quality.max_residual", "Off the surface", "The largest distance of a point from the surface, in spacings.", 0],
  ["quality.rms_residual", "Off the surface, rms", "The root mean square of the distances of the points from the surface, in spacings.", 0],
  ["quality.lost", "Lost points", "Points that ended off the surface.", 0],
  ["quality.rim_count", "At boundaries", "Points that these measures leave out because a boundary is near."],
  ["quality.unresolved_count", "Between sheets", "Points that these measures leave out: another sheet is too near to them or to a neighbour."],
  ["quality.euler", "Euler characteristic", "From the numbers of neighbours: 2 for a sphere, 0 for a torus."],
  ["quality.grading.cv", "Spread of grading", "How much achieved over requested spacing varies.", 0],
  ["quality.grading.exponent", "Grading exponent", "The exponent of achieved against requested spacing.", 1],
  ["mean_neighbours", "Neighbours in reach", "Points within the support of a point, on average."],
  ["sigma", "Support", "Points farther apart than this do not interact, in world units."],
  ["mesh.triangles", "Triangles", "Triangles between the points (mesh.ply)."],
  ["mesh.boundary_edges", "Open edges", "Edges of that mesh with one triangle.", 0],
  ["mesh.radius_ratio", "Shape of triangles", "Twice the inscribed over the circumscribed radius, on average.", 1],
];

export function valueAt(report, path) {
  return path.split(".").reduce((at, key) => (at === null || at === undefined ? undefined : at[key]), report);
}

function Timing({report}) {
  const phases = {load: "Reading", start: "First points", relax: "Relaxing", measure: "Measuring", write: "Writing", total: "Together"};
  return html`<h3>Time and memory</h3><table class="facts"><tbody>
    ${Object.entries(phases).map(([key, word]) => report.timing_s && key in report.timing_s &&
      html`<tr><th scope="row">${word}</th><td class="number">${durationOf(report.timing_s[key])}</td></tr>`)}
    <tr><th scope="row">Largest memory</th><td class="number">${bytesOf(report.peak_memory_bytes)}</td></tr>
    <tr><th scope="row">Threads</th><td class="number">${report.threads}</td></tr></tbody></table>`;
}

function Inputs({inputs}) {
  if (!inputs || !inputs.length) return null;
  return html`<h3>Inputs</h3><div class="scroll" tabindex="0" role="region" aria-label="Inputs"><table><thead><tr>
    <th scope="col">File</th><th scope="col" class="number">Size</th><th scope="col">SHA-256</th></tr></thead><tbody>
    ${inputs.map(input => html`<tr><td class="name">${input.path}</td><td class="number">${bytesOf(input.bytes)}</td>
      <td><code class="hash">${input.sha256}</code></td></tr>`)}</tbody></table></div>`;
}

export function Report({report}) {
  const rows = MEASURES.filter(([path]) => valueAt(report, path) !== undefined);
  return html`<section aria-label="Report"><h2>Report</h2>
    ${(report.surface && report.surface.warnings || []).map(text => html`<p class="notice">${text}</p>`)}
    <div class="scroll" tabindex="0" role="region" aria-label="Measures"><table class="measures"><thead><tr><th scope="col">Measure</th>
      <th scope="col" class="number">Value</th><th scope="col" class="number">Ideal</th></tr></thead><tbody>
      ${rows.map(([path, word, sentence, ideal]) => html`<tr><th scope="row">${word}<span class="hint">${sentence}</span></th>
        <td class="number">${numberOf(valueAt(report, path))}</td><td class="number dim">${ideal === undefined ? "" : ideal}</td></tr>`)}</tbody></table></div>
    <${Timing} report=${report} /><${Inputs} inputs=${report.inputs} /></section>`;
}

/** The measures of two reports side by side. */
export function Measures({reports, words}) {
  const rows = MEASURES.filter(([path]) => reports.some(report => report && valueAt(report, path) !== undefined));
  return html`<div class="scroll" tabindex="0" role="region" aria-label="Measures"><table class="measures"><thead><tr><th scope="col">Measure</th>
    ${words.map(word => html`<th scope="col" class="number">${word}</th>`)}<th scope="col" class="number">Ideal</th></tr></thead><tbody>
    ${rows.map(([path, word, , ideal]) => html`<tr><th scope="row">${word}</th>
      ${reports.map(report => html`<td class="number">${report ? numberOf(valueAt(report, path)) : "–"}</td>`)}
      <td class="number dim">${ideal === undefined ? "" : ideal}</td></tr>`)}</tbody></table></div>`;
}
