// Files of the service's input roots, to choose one from.
import {html, useEffect, useState} from "./preact.js";
import {get, query} from "./api.js";
import {Trouble} from "./parts.js";
import {bytesOf, timeOf} from "./words.js";

function Listing({path, onOpen, onChoose}) {
  const [page, setPage] = useState(null);
  const [error, setError] = useState(null);
  const read = after => get(`v1/files${query({path, cursor: after})}`).then(
    found => setPage(old => ({...found, files: [...(after ? old.files : []), ...found.files]})), setError);
  useEffect(() => {
    setPage(null);
    setError(null);
    read(null);
  }, [path]);
  if (!page) return html`<${Trouble} error=${error} />`;
  const inside = name => (path ? `${path}/${name}` : name);
  return html`<p class="dim"><code>${path || "Input roots"}</code></p>
    <div class="scroll files" tabindex="0" role="region" aria-label="Files"><table><tbody>
    ${path && html`<tr><td colspan="3"><button type="button" class="plain" onClick=${() => onOpen(page.parent)}>↑ up</button></td></tr>`}
    ${page.files.map(file => html`<tr key=${file.name}><td class="name"><button type="button" class="plain"
      onClick=${() => (file.directory ? onOpen(inside(file.name)) : onChoose(file.name.split("/").pop(), inside(file.name)))}>${file.name}${file.directory ? "/" : ""}</button></td>
      <td class="number">${file.directory ? "" : bytesOf(file.bytes)}</td><td class="dim">${timeOf(file.modified)}</td></tr>`)}</tbody></table></div>
    ${!page.files.length && html`<p class="dim">Nothing is here.</p>`}
    ${page.next && html`<button type="button" onClick=${() => read(page.next)}>More</button>`}`;
}

export function Files({onChoose}) {
  const [open, setOpen] = useState(false);
  const [path, setPath] = useState("");
  return html`<details onToggle=${e => setOpen(e.target.open)}><summary>From the service</summary>
    ${open && html`<${Listing} path=${path} onOpen=${setPath} onChoose=${onChoose} />`}</details>`;
}
