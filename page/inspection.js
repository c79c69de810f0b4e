// What lies in a file that was chosen, and the surfaces in it that may be sampled.
import {html} from "./preact.js";
import {call} from "./api.js";
import {countOf, numberOf} from "./words.js";

/** Has the service look into a file; null when it has no time for that. */
export async function inspect(path) {
  try {
    return await call("POST", "v1/inputs:inspect", {path});
  } catch (problem) {
    if (problem.status === 503) return null;
    throw problem;
  }
}

/** "isovalue 12.5, area 6.28, 3 400 points resolve it" */
function describe({spec, area, count}) {
  const [surface] = Object.values(spec.surface);
  const chosen = Object.entries(surface).filter(([name, value]) => name !== "path" && typeof value !== "object")
    .map(([name, value]) => `${name} ${typeof value === "number" ? numberOf(value) : value}`);
  return [...chosen, area && `area ${numberOf(area)}`, count && `${countOf(count)} points resolve it`].filter(Boolean).join(", ");
}

/** `chosen` is one of the suggestions. */
export function Inspection({found, chosen, onChoose}) {
  const ready = found.suggestions.filter(suggestion => suggestion.spec);
  const refused = found.suggestions.filter(suggestion => suggestion.error);
  return html`<section class="inspection" aria-label="What lies in the file">
    ${ready.length > 1 ? html`<label>Surface<select onChange=${e => onChoose(ready[e.target.selectedIndex])}>${ready.map(suggestion =>
      html`<option selected=${suggestion === chosen}>${describe(suggestion)}</option>`)}</select></label>`
      : ready.map(suggestion => html`<p>${describe(suggestion)}</p>`)}
    ${!ready.length && refused.map(({error}) => html`<p class="trouble" role="alert">${error.message}</p>`)}
    ${chosen && (chosen.warnings || []).map(text => html`<p class="notice">${text}</p>`)}
    <details><summary>All that is in it</summary><pre class="log" tabindex="0">${found.text}</pre></details></section>`;
}
