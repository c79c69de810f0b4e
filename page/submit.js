// SPDX-License-Identifier: Apache-2.0
// A new job: a form of the spec, checked by the service as one types, with the JSON beside it.
import {html, useEffect, useRef, useState} from "./preact.js";
import {call, get, query, retryAfterOf, send, wait} from "./api.js";
import {endingOf, Files, Uploads} from "./files.js";
import {byRank, Node, titleOf} from "./form.js";
import {inspect, Inspection} from "./inspection.js";
import {Progress, Trouble, useAction, useTitle} from "./parts.js";
import {Sha256} from "./sha256.js";
import {Sketch} from "./sketch.js";
import {bytesOf, countOf, durationOf, numberOf} from "./words.js";

const CHECK_MS = 500;
const FIRST = {version: 1, surface: {analytic: {shape: "sphere", center: [0, 0, 0], radius: 1}}, sampling: {count: 10000}};
const VOLUMES = ["nrrd", "nhdr", "nii", "gz"];

/** The surface of a spec that a file is. */
function surfaceOf(name, path) {
  const ending = name.split(".").pop().toLowerCase();
  if (ending === "vdb") return {vdb: {path}};
  return VOLUMES.includes(ending) ? {volume: {path}} : {mesh: {path}};
}

/** A surface of one file, as that of a sequence of such files. EXR images are the slices of one volume, which the service finds itself. */
function ofSequence(surface, sequence) {
  const [[kind, body]] = Object.entries(surface);
  return sequence && kind !== "exr" ? {[kind]: {...body, path: sequence.pattern}} : surface;
}

/** The members `queue` of a spec whose files are a sequence, or are not any more. */
function framesOf({queue: {frames, ...rest} = {}}, surface, sequence) {
  if (sequence && !surface.exr) return {queue: {...rest, frames: sequence.frames}};
  return {queue: Object.keys(rest).length ? rest : undefined};
}

/** The hash of a file; `onProgress` gets the share that is done. */
async function hashOf(file, onProgress) {
  const hash = new Sha256();
  const reader = file.stream().getReader();
  for (let piece = await reader.read(); !piece.done; piece = await reader.read()) {
    hash.update(piece.value);
    onProgress(hash.count / file.size);
  }
  return hash.hex();
}

/** Longest name of a file in the service, in bytes. */
const NAME_MOST = 255;

/** Whether the service has the file of this hash from this user. */
const isKnown = (hash, signal) => get(`v1/inputs/${hash}`, {signal}).then(() => true, problem => {
  if (problem.status === 404) return false;
  throw problem;
});

/** Sends a file, or only its name if the service has it; returns the path by which a spec names it. */
async function upload(file, signal, onProgress) {
  const hash = await hashOf(file, share => onProgress(`Reading ${file.name}`, share));
  onProgress(`Sending ${file.name}`, null);
  const body = await isKnown(hash, signal) ? "" : file, options = {body, headers: {"Content-Type": "application/octet-stream"}, signal};
  const name = new TextEncoder().encode(file.name).length <= NAME_MOST ? file.name : null;
  const {path} = await (await send("PUT", `v1/inputs/${hash}${query({name})}`, options)).json();
  return path + endingOf(file.name);
}

/** What the service says of the spec: [faults by pointer, error, estimate, busy]. */
function useCheck(spec) {
  const [answer, setAnswer] = useState({faults: new Map(), error: null, validation: null});
  const [busy, setBusy] = useState(false);
  useEffect(() => {
    const stop = new AbortController(), {signal} = stop;
    const options = {body: JSON.stringify(spec), headers: {"Content-Type": "application/json"}, signal};
    setBusy(true);
    (async () => {
      try {
        for (let seconds = CHECK_MS / 1000; seconds;) { // again, when the estimate has to wait for those of others
          await wait(seconds, signal);
          const response = await send("POST", "v1/jobs:validate", options);
          setAnswer({faults: new Map(), error: null, validation: await response.json()});
          seconds = retryAfterOf(response);
        }
      } catch (error) {
        if (error.name === "AbortError") return;
        setAnswer({faults: new Map((error.errors || []).map(({pointer, detail}) => [pointer, detail])), error, validation: null});
      }
      setBusy(false);
    })();
    return () => stop.abort();
  }, [JSON.stringify(spec)]);
  return [answer, busy];
}

function Estimate({validation, busy}) {
  const estimate = validation && validation.estimate;
  return html`<div class="card estimate" role="status" aria-busy=${busy}>
    ${!validation ? html`<p class="dim">${busy ? "Checking …" : "Not checked yet"}</p>`
      : !estimate ? html`<p>The spec is good. ${busy ? "Its estimate comes after those of others …" : `There is no estimate: ${validation.estimate_missing}.`}</p>`
      : html`<dl><div><dt>Points</dt><dd>${countOf(estimate.count)}</dd></div><div><dt>Surface area</dt><dd>${numberOf(estimate.area)}</dd></div>
        <div><dt>Memory</dt><dd>${bytesOf(estimate.memory_bytes)}</dd></div><div><dt>Time, about</dt><dd>${durationOf(estimate.seconds)}</dd></div></dl>`}</div>`;
}

/** `fault` says why the text is not JSON; the spec is then that of the last text that was. */
function Json({spec, fault, onChange, onFault}) {
  const [text, setText] = useState(JSON.stringify(spec, null, 2));
  const written = useRef(spec);
  useEffect(() => {
    if (spec === written.current) return;
    setText(JSON.stringify(spec, null, 2));
    onFault(null);
  }, [spec]);
  const change = e => {
    setText(e.target.value);
    try {
      const read = JSON.parse(e.target.value);
      if (read === null || typeof read !== "object") throw new Error("A spec is a JSON object.");
      written.current = read;
      onFault(null);
      onChange(read);
    } catch (error) {
      onFault(error);
    }
  };
  const [copy, copyError] = useAction(() => navigator.clipboard.writeText(text));
  return html`<label class="json" for="json">The spec as JSON</label><textarea id="json" rows="22" spellcheck="false" value=${text} onInput=${change} aria-invalid=${fault ? "true" : null}></textarea>
    <${Trouble} error=${fault || copyError} /><button type="button" onClick=${copy}>Copy</button>`;
}

export function Submit({search}) {
  const [schema, setSchema] = useState(null);
  const [spec, setSpec] = useState(search.has("from") ? null : FIRST);
  const [error, setError] = useState(null);
  const [sending, setSending] = useState(null);
  const [unread, setUnread] = useState(null); // why the JSON cannot be read
  const [look, setLook] = useState(null); // into the file that was chosen: {name, sequence, found, chosen}
  const [over, setOver] = useState(false);
  const [{faults, error: fault, validation}, busy] = useCheck(spec || FIRST);
  useTitle("New job");

  useEffect(() => {
    get("v1/schema.json").then(setSchema, setError);
    if (search.has("from")) get(`v1/jobs/${search.get("from")}`).then(job => setSpec(job.spec), setError);
  }, []);

  const suggest = (suggestion, sequence) => {
    setLook(old => ({...old, chosen: suggestion}));
    // how many points it takes is not known of a surface that was not measured
    setSpec(old => ({...old, ...suggestion.spec, surface: ofSequence(suggestion.spec.surface, sequence), name: old.name,
      sampling: suggestion.count ? suggestion.spec.sampling : old.sampling}));
  };
  const useFile = async (name, path, sequence, signal) => {
    setLook(null);
    setSending({word: `Looking into ${name}`, share: null});
    const found = await inspect(path, signal, () => setSending({word: `The service looks into other files; ${name} waits`, share: null}));
    const first = found && found.suggestions.find(suggestion => suggestion.spec);
    const surface = first ? first.spec.surface : surfaceOf(name, path);
    setSpec(old => ({...old, surface: ofSequence(surface, sequence), ...framesOf(old, surface, sequence)}));
    if (found) setLook({name, sequence, found, chosen: null});
    if (first) suggest(first, sequence);
  };
  const taking = useRef(new AbortController()); // the file that was chosen last; an earlier one is given up
  useEffect(() => () => taking.current.abort(), []);
  const [take, takeError] = useAction(async (name, find, sequence) => {
    taking.current.abort();
    taking.current = new AbortController();
    const {signal} = taking.current;
    try {
      await useFile(name, await find(signal), sequence, signal);
    } finally {
      if (!signal.aborted) setSending(null);
    }
  });
  const takeFile = file => take(file.name, signal => upload(file, signal, (word, share) => signal.throwIfAborted() || setSending({word, share})));
  const [submit, submitError, submitting] = useAction(async () => {
    const job = await call("POST", "v1/jobs", spec);
    location.hash = `#/jobs/${job.id}`;
  });
  useEffect(() => {
    const at = submitError && submitError.errors && submitError.errors.length && document.getElementById(`f${submitError.errors[0].pointer}`);
    if (!at) return;
    for (let part = at.parentElement.closest("details"); part; part = part.parentElement.closest("details")) part.open = true;
    at.focus(); // which scrolls it into view
  }, [submitError]);
  const drop = e => {
    e.preventDefault();
    setOver(false);
    if (e.dataTransfer.files.length) takeFile(e.dataTransfer.files[0]);
  };
  if (!schema || !spec) return html`<${Trouble} error=${error} />`;

  const {properties} = schema;
  const group = (name, picture) => html`<fieldset class="card" key=${name}><legend>${titleOf(name, properties[name])}</legend>${picture}<div class="fields">
    <${Node} name=${name} schema=${properties[name]} value=${spec[name]} pointer=${`/${name}`} faults=${faults} onChange=${next => setSpec({...spec, [name]: next})} /></div></fieldset>`;
  const rest = byRank(Object.keys(properties).filter(name => !["version", "name", "surface", "sampling"].includes(name)), properties);
  return html`<div class=${`submit ${over ? "over" : ""}`} onDragOver=${e => {
    e.preventDefault();
    setOver(true);
  }} onDragLeave=${() => setOver(false)} onDrop=${drop}>
    <h1>New job</h1>
    <div class="drop card"><p>Drop a mesh or a volume here, or choose a file:</p>
      <span class="buttons"><label class="button" for="file">From this computer</label><input id="file" class="hidden" type="file" onChange=${e => e.target.files.length && takeFile(e.target.files[0])} /></span>
      <${Files} onChoose=${(name, path, sequence) => take(name, () => path, sequence)} />
      <${Uploads} onChoose=${(name, path) => take(name, () => path)} />
      ${sending && html`<p role="status">${sending.word} … ${sending.share !== null && html`<${Progress} fraction=${sending.share} label=${sending.word} />`}</p>`}
      ${look && html`<${Inspection} ...${look} onChoose=${suggestion => suggest(suggestion, look.sequence)} />`}<${Trouble} error=${takeError} /></div>
    <form class="columns" onSubmit=${e => {
      e.preventDefault();
      submit();
    }}><div>
      <fieldset class="card"><legend>Job</legend><div class="fields"><${Node} name="name" schema=${properties.name} value=${spec.name} pointer="/name" faults=${faults}
        onChange=${next => setSpec({...spec, name: next})} /></div></fieldset>
      ${group("surface", html`<${Sketch} formula=${spec.surface && spec.surface.analytic} />`)}${group("sampling")}
      <details class="more"><summary>More: ${rest.map(name => titleOf(name, properties[name])).join(", ")}</summary>${rest.map(name => group(name))}</details></div>
    <aside aria-label="Check">${fault ? html`<${Trouble} error=${fault} />` : html`<${Estimate} validation=${validation} busy=${busy} />`}
      <button class="main" disabled=${submitting || Boolean(fault || sending || unread || takeError)}>Submit</button><${Trouble} error=${submitError} />
      <${Json} spec=${spec} fault=${unread} onChange=${setSpec} onFault=${setUnread} /></aside></form></div>`;
}
