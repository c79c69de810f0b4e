// SPDX-License-Identifier: Apache-2.0
// Files to choose one from: those of the service's input roots, or a sequence of numbered ones, and the uploads of the user.
import {html, useEffect, useState} from "./preact.js";
import {call, get, query} from "./api.js";
import {Trouble, useAction} from "./parts.js";
import {bytesOf, countOf, timeOf} from "./words.js";

const PAGE = 500; // files in one request
const ROWS = 50; // are read before "More"
const REQUESTS_MOST = 20; // before "More": a sequence may have many files

/** "1-3, 7" as a spec has it: "1-3,7". */
function rangesOf(numbers) {
  const ranges = [];
  for (const number of numbers) {
    const last = ranges[ranges.length - 1];
    if (last && number === last[1] + 1) last[1] = number;
    else ranges.push([number, number]);
  }
  return ranges.map(([first, last]) => (first === last ? first : `${first}-${last}`)).join(",");
}

/** What a name has before its number, the number's digits, and what comes behind: that of "smoke.0007.vdb", not of "part.3mf". */
function partsOf(name) {
  const dot = name.lastIndexOf("."), [stem, ending] = dot > 0 ? [name.slice(0, dot), name.slice(dot)] : [name, ""];
  const match = /^(.*?)(\d{1,9})(\D*)$/.exec(stem);
  return match && {before: match[1], digits: match[2], behind: match[3] + ending};
}

/**
 * Entries of a directory as rows, in their order. Files whose names differ in a number are one row with a `sequence`:
 * {pattern, frames, files}; `name` is that of the first one.
 */
export function rowsOf(files) {
  const groups = new Map(), rows = [];
  for (const file of files) {
    const parts = file.directory ? null : partsOf(file.name);
    const key = parts && `${parts.before}\n${parts.behind}`;
    if (!groups.has(key) || !key) {
      rows.push({...file, members: [{file, parts}]});
      if (key) groups.set(key, rows[rows.length - 1]);
    } else groups.get(key).members.push({file, parts});
  }
  return rows.flatMap(({members, ...row}) => {
    if (members.length === 1) return [row];
    const width = Math.min(...members.map(({parts}) => parts.digits.length));
    const padded = ({digits}) => String(Number(digits)).padStart(width, "0") === digits;
    if (!members.every(({parts}) => padded(parts))) return members.map(({file}) => file);
    members.sort((a, b) => a.parts.digits - b.parts.digits);
    const {before, behind} = members[0].parts, numbers = members.map(({parts}) => Number(parts.digits));
    const bytes = members.reduce((sum, {file}) => sum + file.bytes, 0), last = files[files.length - 1];
    return [{...members[0].file, bytes, grows: members.some(({file}) => file === last),
      sequence: {pattern: `${before}${"#".repeat(width)}${behind}`, frames: rangesOf(numbers), files: members.length}}];
  });
}

/** The entries behind a cursor, as far as they make ROWS rows. */
async function readOn(path, known, cursor) {
  const files = [...known], before = rowsOf(known).length;
  let page = null, next = cursor;
  for (let i = 0; i < REQUESTS_MOST && (!page || next); i++) {
    page = await get(`v1/files${query({path, cursor: next, limit: PAGE})}`);
    files.push(...page.files);
    next = page.next;
    if (rowsOf(files).length - before >= ROWS) break;
  }
  return {...page, files, next};
}

function Row({row, more, onOpen, onChoose}) {
  const {sequence} = row;
  return html`<tr><td class="name"><button type="button" class="plain" onClick=${row.directory ? onOpen : onChoose}
      >${sequence ? sequence.pattern : row.name}${row.directory ? "/" : ""}</button>
      ${sequence && html`<span class="detail">${countOf(sequence.files)} files: ${sequence.frames.replace(/,/g, ", ")}${more ? ", and more" : ""}</span>`}</td>
    <td class="number">${row.directory ? "" : bytesOf(row.bytes)}</td><td class="dim">${timeOf(row.modified)}</td></tr>`;
}

function Listing({path, onOpen, onChoose}) {
  const [page, setPage] = useState(null);
  const [error, setError] = useState(null);
  const read = after => readOn(path, after ? page.files : [], after).then(setPage, setError);
  useEffect(() => {
    setPage(null);
    setError(null);
    read(null);
  }, [path]);
  if (!page) return html`<${Trouble} error=${error} />`;
  const inside = name => (path ? `${path}/${name}` : name);
  const choose = ({name, sequence}) => onChoose(name.split("/").pop(), inside(name),
    sequence && {...sequence, pattern: inside(sequence.pattern)});
  return html`<p class="dim"><code>${path || "Input roots"}</code></p>
    <div class="scroll files" tabindex="0" role="region" aria-label="Files"><table><tbody>
    ${path && html`<tr><td colspan="3"><button type="button" class="plain" onClick=${() => onOpen(page.parent)}>↑ up</button></td></tr>`}
    ${rowsOf(page.files).map(row => html`<${Row} key=${row.name} row=${row} more=${row.grows && page.next} onOpen=${() => onOpen(inside(row.name))} onChoose=${() => choose(row)} />`)}</tbody></table></div>
    ${!page.files.length && html`<p class="dim">Nothing is here.</p>`}<${Trouble} error=${error} />
    ${page.next && html`<button type="button" onClick=${() => read(page.next)}>More</button>`}`;
}

/** `onChoose(name, path, sequence)`: of a sequence its first file, and its pattern and frames. */
export function Files({onChoose}) {
  const [open, setOpen] = useState(false);
  const [path, setPath] = useState("");
  return html`<details onToggle=${e => setOpen(e.target.open)}><summary>From the service</summary>
    ${open && html`<${Listing} path=${path} onOpen=${setPath} onChoose=${onChoose} />`}</details>`;
}

/** The end of a name that identifies a format, such as ".obj" or ".nii.gz"; of other names "". */
export const endingOf = name => /(\.nii)?\.[A-Za-z0-9]+$/i.exec(name)?.[0] ?? "";

function Upload({upload, onChoose, onDeleted}) {
  const {sha256, name, path, bytes, sent, job_count: jobs, unfinished_count: unfinished} = upload;
  const word = name ?? `${sha256.slice(0, 12)}…`;
  const question = `Delete the upload ${word}?${unfinished ? ` Your ${countOf(unfinished)} unfinished jobs can still read it.` : ""}`;
  const [remove, error, busy] = useAction(async () => {
    await call("DELETE", `v1/inputs/${sha256}`);
    onDeleted();
  });
  return html`<tr><td class="name"><button type="button" class="plain" onClick=${() => onChoose(word, path + endingOf(name ?? ""))}>${word}</button>
      ${jobs > 0 && html`<span class="detail">${countOf(jobs)} job${jobs === 1 ? "" : "s"}${unfinished ? `, ${countOf(unfinished)} unfinished` : ""}</span>`}<${Trouble} error=${error} /></td>
    <td class="number">${bytesOf(bytes)}</td><td class="dim">${timeOf(sent)}</td>
    <td><button type="button" disabled=${busy} aria-label=${`Delete ${word}`} onClick=${() => confirm(question) && remove()}>Delete …</button></td></tr>`;
}

function UploadListing({onChoose}) {
  const [page, setPage] = useState(null);
  const [error, setError] = useState(null);
  const read = cursor => get(`v1/inputs${query({cursor, limit: ROWS})}`).then(
    ({inputs, next}) => setPage(old => ({inputs: cursor ? [...old.inputs, ...inputs] : inputs, next})), setError);
  useEffect(() => {
    read(null);
  }, []);
  if (!page) return html`<${Trouble} error=${error} />`;
  const drop = sha256 => setPage(old => ({...old, inputs: old.inputs.filter(upload => upload.sha256 !== sha256)}));
  return html`<div class="scroll files" tabindex="0" role="region" aria-label="Your uploads"><table><tbody>
    ${page.inputs.map(upload => html`<${Upload} key=${upload.sha256} upload=${upload} onChoose=${onChoose} onDeleted=${() => drop(upload.sha256)} />`)}</tbody></table></div>
    ${!page.inputs.length && !page.next && html`<p class="dim">You have no uploads.</p>`}<${Trouble} error=${error} />
    ${page.next && html`<button type="button" onClick=${() => read(page.next)}>More</button>`}`;
}

/** The uploads of the user. `onChoose(name, path)` */
export function Uploads({onChoose}) {
  const [open, setOpen] = useState(false);
  return html`<details class="uploads" onToggle=${e => setOpen(e.target.open)}><summary>Your uploads</summary>${open && html`<${UploadListing} onChoose=${onChoose} />`}</details>`;
}
