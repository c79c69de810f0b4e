// SPDX-License-Identifier: Apache-2.0
// Two jobs side by side: measures, plots and points.
import {html, useEffect, useMemo, useState} from "./preact.js";
import {get} from "./api.js";
import {Charts, rowsOfReport} from "./chart.js";
import {useReport} from "./job.js";
import {State, Trouble, useTitle} from "./parts.js";
import {PointCloud} from "./points.js";
import {Measures} from "./report.js";
import {nameOf} from "./words.js";

export function Compare({ids}) {
  const [jobs, setJobs] = useState(null);
  const [error, setError] = useState(null);
  const scenes = useMemo(() => new Set(), []); // their cameras move together
  const first = useReport(jobs && jobs[0], null), second = useReport(jobs && jobs[1], null);
  useTitle("Compare");
  useEffect(() => {
    Promise.all(ids.map(id => get(`v1/jobs/${id}`))).then(setJobs, setError);
  }, ids);
  if (!jobs) return html`<${Trouble} error=${error} />`;
  const words = jobs.map(nameOf), reports = [first, second];
  return html`<p class="back"><a href="#/">Queue</a></p><h1>${words[0]} and ${words[1]}</h1>
    <div class="pair">${jobs.map((job, i) => html`<section key=${i} aria-label=${`${i ? "Second" : "First"}: ${nameOf(job)}`}>
      <h2><a href=${`#/jobs/${job.id}`}>${nameOf(job)}</a> <${State} job=${job} /></h2>
      ${job.links.results && html`<${PointCloud} job=${job} frame=${null} scenes=${scenes} />`}</section>`)}</div>
    <h2>Measures</h2><${Measures} reports=${reports} words=${words} />
    ${first && second && html`<h2>Convergence</h2><p class="hint">${words[0]} is the solid line, ${words[1]} the dashed one.</p>
      <${Charts} runs=${reports.map(rowsOfReport)} words=${words} />`}`;
}
