// SPDX-License-Identifier: Apache-2.0
// The report of a job as tables, with a sentence for each measure.
import {get} from "./api.js";
import {html, useEffect, useState} from "./preact.js";
import {bytesOf, durationOf, numberOf} from "./words.js";

/** Path in the report, word, sentence, and the ideal value where there is one. */
export const MEASURES = [
  ["count", "Points", "How many points were delivered."],
  ["spacing", "Spacing", "The distance between neighbours that an ideal packing of these points has, in world units."],
  ["surface.area", "Area", "The area of the surface that was sampled, in world units squared."],
  ["quality.hex_fraction", "Six neighbours", "The share of points with the ideal number of neighbours: six, fewer at corners and at borders.", 1],
  ["quality.edge_cv", "Spread of distances", "How much the distances between neighbours vary, each divided by the requested spacing.", 0],
  ["quality.area_cv", "Spread of areas", "How much the Voronoi areas of points vary, each divided by the requested spacing squared.", 0],
  ["quality.energy_excess", "Energy excess", "Mean energy over that of an ideal packing, less one.", 0],
  ["quality.disorder", "Disorder", "The same against perfect order with cells as large and the same grading.", 0],
  ["quality.defect_share", "Defects", "The share of points without the ideal number of neighbours, less those that the topology requires.", 0],
  ["quality.min_spacing_ratio", "Closest pair", "The smallest distance between two points, in spacings.", 1],
  ["quality.close_share", "Close points", "The share of points with another within 0.25 spacings on the same side.", 0],
  ["quality.coincident", "Coincident points", "Points with another within 0.001 spacings on the same side.", 0],
  ["quality.thin_count", "Points on thin walls", "Points with another on an opposite wall within 1.2 spacings.", 0],
  ["quality.coverage", "Farthest place", "The largest distance of a place of the surface from the nearest point, in spacings.", 0.58],
  ["quality.missing_share", "Missing area", "The share of the area that has no point of its own side within 1.2 spacings.", 0],
  ["quality.parts_without_points.area_share", "Parts without points", "The share of the area in parts of the surface that have no points.", 0],
  ["quality.unmeasured_share", "Not measured", "The share of points with fewer than three neighbours, or with a cell that meets itself.", 0],
  ["quality.max_residual", "Off the surface", "The largest distance of a point from the surface, in spacings.", 0],
  ["quality.rms_residual", "Off the surface, rms", "The root mean square of the distances of the points from the surface, in spacings.", 0],
  ["quality.lost", "Lost points", "Points that ended off the surface.", 0],
  ["quality.euler", "Euler characteristic", "From the numbers of neighbours: 2 for a sphere, 0 for a torus."],
  ["quality.grading.cv", "Spread of grading", "How much achieved over requested spacing varies.", 0],
  ["quality.grading.exponent", "Grading exponent", "The exponent of achieved against requested spacing.", 1],
  ["diagnostics.mean_neighbours", "Neighbours in reach", "Points within the support of a point, on average."],
  ["diagnostics.sigma", "Support", "Points farther apart than this do not interact, in world units."],
  ["mesh.triangles", "Triangles", "Triangles between the points (mesh.ply)."],
  ["mesh.boundary_edges", "Open edges", "Edges of that mesh with one triangle.", 0],
  ["mesh.radius_ratio", "Shape of triangles", "Twice the inscribed over the circumscribed radius, on average.", 1],
];

/** "0.937 (good)": the value of a measure, and the rating that the report gives to it. */
function ratedAt(report, path) {
  const {rating} = report.ratings && report.ratings[path.replace("quality.", "")] || {};
  return numberOf(valueAt(report, path)) + (rating ? ` (${rating})` : "");
}

/** The value at a path. Reports of early builds have the members of `diagnostics` beside it. */
export function valueAt(report, path) {
  const value = path.split(".").reduce((at, key) => (at === null || at === undefined ? undefined : at[key]), report);
  return value === undefined && path.startsWith("diagnostics.") ? valueAt(report, path.slice("diagnostics.".length)) : value;
}

function Timing({report}) {
  const phases = {load: "Reading", start: "First points", relax: "Relaxing", measure: "Measuring", curvature: "Curvature", weights: "Weights", write: "Writing", total: "Together"};
  return html`<h3>Time and memory</h3><table class="facts"><tbody>
    ${Object.entries(phases).map(([key, word]) => report.timing_s && key in report.timing_s &&
      html`<tr><th scope="row">${word}</th><td class="number">${durationOf(report.timing_s[key])}</td></tr>`)}
    <tr><th scope="row">Largest memory</th><td class="number">${bytesOf(report.peak_memory_bytes)}</td></tr>
    <tr><th scope="row">Threads</th><td class="number">${valueAt(report, "diagnostics.threads")}</td></tr></tbody></table>`;
}

/** The path of an input. Of an upload, its sender sees the name. */
function InputName({path}) {
  const [name, setName] = useState(null);
  const sent = /^sha256:([0-9a-f]{64})/.exec(path);
  useEffect(() => {
    let live = true; // an answer for a former path is ignored
    setName(null);
    if (sent) get(`v1/inputs/${sent[1]}`).then(upload => live && setName(upload.name), () => {}); // it may have expired
    return () => { live = false; };
  }, [path]);
  return html`<td class="name" title=${path}>${name ?? path}</td>`;
}

function Inputs({inputs}) {
  if (!inputs || !inputs.length) return null;
  return html`<h3>Inputs</h3><div class="scroll" tabindex="0" role="region" aria-label="Inputs"><table><thead><tr>
    <th scope="col">File</th><th scope="col" class="number">Size</th><th scope="col">SHA-256</th></tr></thead><tbody>
    ${inputs.map(input => html`<tr><${InputName} path=${input.path} /><td class="number">${bytesOf(input.bytes)}</td>
      <td><code class="hash">${input.sha256}</code></td></tr>`)}</tbody></table></div>`;
}

export function Report({report}) {
  const rows = MEASURES.filter(([path]) => valueAt(report, path) !== undefined);
  return html`<section aria-label="Report"><h2>Report</h2>
    ${(report.surface && report.surface.warnings || []).map(text => html`<p class="notice">${text}</p>`)}
    <div class="scroll" tabindex="0" role="region" aria-label="Measures"><table class="measures"><thead><tr><th scope="col">Measure</th>
      <th scope="col" class="number">Value</th><th scope="col" class="number">Ideal</th></tr></thead><tbody>
      ${rows.map(([path, word, sentence, ideal]) => html`<tr><th scope="row">${word}<span class="hint">${sentence}</span></th>
        <td class="number">${ratedAt(report, path)}</td><td class="number dim">${ideal === undefined ? "" : ideal}</td></tr>`)}</tbody></table></div>
    <${Timing} report=${report} /><${Inputs} inputs=${report.inputs} /></section>`;
}

/** The measures of two reports side by side. */
export function Measures({reports, words}) {
  const rows = MEASURES.filter(([path]) => reports.some(report => report && valueAt(report, path) !== undefined));
  return html`<div class="scroll" tabindex="0" role="region" aria-label="Measures"><table class="measures"><thead><tr><th scope="col">Measure</th>
    ${words.map(word => html`<th scope="col" class="number">${word}</th>`)}<th scope="col" class="number">Ideal</th></tr></thead><tbody>
    ${rows.map(([path, word, , ideal]) => html`<tr><th scope="row">${word}</th>
      ${reports.map(report => html`<td class="number">${report ? ratedAt(report, path) : "–"}</td>`)}
      <td class="number dim">${ideal === undefined ? "" : ideal}</td></tr>`)}</tbody></table></div>`;
}
