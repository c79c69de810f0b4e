// SPDX-License-Identifier: Apache-2.0
// What lies in a file that was chosen, and the surfaces in it that may be sampled.
import {html} from "./preact.js";
import {call, wait} from "./api.js";
import {countOf, numberOf} from "./words.js";

/** Inspects a file, and repeats the request while the service is busy; null if the service does not inspect files. */
export async function inspect(path, signal, onBusy) {
  for (;;)
    try {
      return await call("POST", "v1/inputs:inspect", {path}, signal);
    } catch (problem) {
      if (problem.status !== 503) throw problem;
      if (!problem.retryAfter) return null;
      onBusy();
      await wait(problem.retryAfter, signal);
    }
}

/** "isovalue 12.5, area 6.28, 3 400 points resolve it" */
function describe({spec, area, count, measured}) {
  const [surface] = Object.values(spec.surface);
  const chosen = Object.entries(surface).filter(([name, value]) => name !== "path" && typeof value !== "object")
    .map(([name, value]) => `${name} ${typeof value === "number" ? numberOf(value) : value}`);
  return [...chosen, area && `surface area ${measured ? "" : "about "}${measured ? numberOf(area) : Number(area.toPrecision(2))}`, count && `${countOf(count)} points resolve it`].filter(Boolean).join(", ");
}

/** `name` is the file's, `chosen` one of the suggestions. */
export function Inspection({name, found, chosen, onChoose}) {
  const ready = found.suggestions.filter(suggestion => suggestion.spec);
  const refused = found.suggestions.filter(suggestion => suggestion.error);
  return html`<section class="inspection" aria-label="What lies in the file">
    ${ready.length > 1 ? html`<label>Surface<select onChange=${e => onChoose(ready[e.target.selectedIndex])}>${ready.map(suggestion =>
      html`<option selected=${suggestion === chosen}>${describe(suggestion)}</option>`)}</select></label>`
      : ready.map(suggestion => html`<p><strong>${name}</strong>: ${describe(suggestion)}</p>`)}
    ${!ready.length && refused.map(({error}) => html`<p class="trouble" role="alert">${error.message}</p>`)}
    ${chosen && (chosen.warnings || []).map(text => html`<p class="notice">${text}</p>`)}
    <details><summary>All that is in it</summary><pre class="log" tabindex="0">${found.text}</pre></details></section>`;
}
