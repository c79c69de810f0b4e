// SPDX-License-Identifier: Apache-2.0
// The queue: a page of jobs, kept right by the stream of events.
import {html, useEffect, useMemo, useRef, useState} from "./preact.js";
import {call, follow, get, query, urlOf} from "./api.js";
import {inOrder, Progress, State, throttled, Trouble, useAction, useClock, useTitle} from "./parts.js";
import {ageOf, bytesOf, isFinal, nameOf, PHASES, spentOf, stateOf, STATES, timeOf} from "./words.js";

const ROWS = 50;
/** However fast events come, the list is read again no more often. */
const READ_MS = 500;
/** The list follows a filter when nothing has been typed for this time. */
const TYPED_MS = 150;

/** The service counts no more jobs ahead of a job than these. */
const AHEAD_MOST = 100;

/** Between the bar of the queue and what is scrolled below it. */
const BAR_GAP_PX = 8;

/** Columns by which the service sorts, and in which direction first. */
const COLUMNS = [["name", "Job", ""], ["state", "State", ""], ["owner", "Owner", ""], ["priority", "Priority", "-"], ["created", "Submitted", "-"]];
const NEWEST = "-created";

/** The filter and the order of an address, and the address of these. */
const filterOf = search => Object.fromEntries(["state", "text", "owner", "label"].map(key => [key, search.get(key) || ""]));
const sortOf = search => search.get("sort") || NEWEST;
const addressOf = (filter, sort) => `#/${query({...filter, sort: sort === NEWEST ? "" : sort})}`;

/** Runs an action for each, a few at a time; returns the errors. */
async function forEach(jobs, action) {
  const waiting = [...jobs], errors = [];
  await Promise.all(Array.from({length: 4}, async () => {
    for (let job = waiting.shift(); job; job = waiting.shift())
      await action(job).catch(error => errors.push(`${nameOf(job)}: ${error.message}`));
  }));
  return errors;
}

/** The next ROWS jobs of a list: a page of the service may be short, though there are more. */
async function readJobs(asked, cursor) {
  const jobs = [];
  let next = cursor;
  do {
    const page = await get(`v1/jobs${query({...asked, limit: ROWS - jobs.length, cursor: next})}`);
    jobs.push(...page.jobs);
    next = page.next;
  } while (next && jobs.length < ROWS);
  return {jobs, next};
}

/** The jobs of the filter, the load and the readiness of the service: [data, reload]. */
function useQueue(filter, sort, cursor) {
  const [data, setData] = useState({jobs: null, next: null, load: null, workers: [], checks: null, error: null});
  const [, redraw] = useState(0);
  const asked = useRef();
  asked.current = [{...filter, sort}, cursor];
  const newest = useRef(new Map()).current; // of each job that runs: its newest progress, which a list may lack

  const read = useMemo(() => inOrder(async () => {
    try {
      const [page, workers, ready] = await Promise.all([
        readJobs(...asked.current), get("v1/workers"), get("readyz").catch(problem => problem)]);
      return {...page, ...workers, checks: ready.checks || {}, error: null};
    } catch (error) {
      return {error};
    }
  }, answer => setData(old => ({...old, ...answer}))), []);

  const first = useRef(true);
  useEffect(() => {
    const timer = setTimeout(read, first.current ? 0 : TYPED_MS);
    first.current = false;
    return () => clearTimeout(timer);
  }, [query({...filter, sort, cursor})]);
  useEffect(() => {
    const readSoon = throttled(read, READ_MS);
    let frame = null;
    const stop = follow("v1/events?all=1&progress=1", {
      onOpen() {
        newest.clear();
        readSoon();
      },
      onEvent(type, event) {
        if (type !== "progress") {
          if (isFinal(event.state)) newest.delete(event.job);
          readSoon();
          return;
        }
        newest.set(event.job, event);
        frame = frame || requestAnimationFrame(time => {
          frame = null;
          redraw(time);
        });
      },
      onGap: readSoon,
    });
    return () => {
      stop();
      cancelAnimationFrame(frame);
      readSoon.cancel();
    };
  }, []);

  const withProgress = job => {
    const event = newest.get(job.id);
    return event && job.state === "running" && !job.array && event.attempt === job.attempt ? {...job, progress: event.progress} : job;
  };
  return [{...data, jobs: data.jobs && data.jobs.map(withProgress)}, read];
}

function Filter({filter, sort, onChange, onSort}) {
  const set = (key, value) => onChange({...filter, [key]: value});
  const field = (key, word) => html`<label>${word}<input type="search" value=${filter[key]} onInput=${e => set(key, e.target.value)} /></label>`;
  return html`<form class="filter" role="search" aria-label="Filter" onSubmit=${e => e.preventDefault()}>
    <label>State<select value=${filter.state} onChange=${e => set("state", e.target.value)}>
      <option value="">All</option>
      ${Object.entries(STATES).map(([key, {word}]) => html`<option value=${key} selected=${key === filter.state}>${word}</option>`)}
    </select></label>
    ${field("text", "Name has")}${field("owner", "Owner")}${field("label", "Label")}
    <label class="narrow">Sorted by<select value=${sort} onChange=${e => onSort(e.target.value)}>${COLUMNS.map(([key, word, first]) =>
      html`<option value=${first + key} selected=${sort.replace("-", "") === key}>${word}</option>`)}</select></label>
  </form>`;
}

function Meter({word, used, limit, show = String}) {
  return html`<div class="meter"><span id=${`meter-${word}`}>${word}</span>
    <meter aria-labelledby=${`meter-${word}`} value=${used} max=${limit || 1}></meter><span>${show(used)} of ${show(limit)}</span></div>`;
}

/** What the host or the farm is busy with, and the switches of administrators. */
function Load({load, workers, checks, admin, now, onChange}) {
  const [turn, error, busy] = useAction(async action => {
    await call("POST", `v1/admin/${action}`);
    await onChange();
  });
  if (!load) return null;
  const draining = checks.jobs === "draining", held = checks.queue === "held";
  const warnings = [
    draining && "hexad accepts and starts no jobs: an administrator drains it. Running jobs continue. Submit new jobs later.",
    held && "hexad accepts jobs and starts none: an administrator holds the queue. Running jobs continue.",
    checks.storage === "full" && "The disk of hexad is full: no job starts. Delete jobs that are not needed.",
    checks.results === "full" && "The results of all jobs have reached a limit: no job starts. Download results, so that hexad may delete them.",
    checks.database === "damaged" && "The database is damaged: no job is accepted, started or changed. Ask the administrator to restore it.",
  ].filter(Boolean);
  return html`<section class="load card" aria-label="Load">
    <${Meter} word="Attempts" used=${load.attempts} limit=${load.attempts_limit} />
    <${Meter} word="Threads" used=${load.threads} limit=${load.threads_limit} />
    <${Meter} word="Memory" used=${load.memory_mb} limit=${load.memory_mb_limit} show=${mib => bytesOf(mib * 2 ** 20)} />
    ${admin && html`<span class="buttons">
      <button disabled=${busy} onClick=${() => turn(held ? "release" : "hold")}>${held ? "Release" : "Hold"}</button>
      <button disabled=${busy} onClick=${() => turn(draining ? "resume" : "drain")}>${draining ? "Undrain" : "Drain"}</button></span>`}
    ${workers.length > 0 && html`<details class="busy"><summary>Running now</summary><ul>${workers.slice(0, ROWS).map(({job: id, name, ...attempt}) =>
      html`<li key=${`${id}.${attempt.frame}`}><a href=${`#/jobs/${id}`}>${nameOf({id, name})}</a>${attempt.frame !== undefined ? ` frame ${attempt.frame}` : ""}<span class="dim">
        ${attempt.owner}, ${spentOf(attempt, now)}, ${attempt.threads} thread${attempt.threads === 1 ? "" : "s"}, ${bytesOf(attempt.memory_mb * 2 ** 20)}</span></li>`)}</ul>
      ${workers.length > ROWS && html`<p class="dim">and ${workers.length - ROWS} more</p>`}</details>`}
    ${warnings.map(text => html`<p class="notice" role="status">${text}</p>`)}
    <${Trouble} error=${error} /></section>`;
}

/** All of the page may be chosen here; two jobs with results may be compared by everyone. */
function Actions({jobs, chosen, mayChange, onChooseAll, onDone}) {
  const [errors, setErrors] = useState([]);
  const bar = useRef(null);
  useEffect(() => { // what gets the focus is scrolled to a place below the bar, whose height depends on the width
    const {style} = document.documentElement;
    const watcher = new ResizeObserver(() => {
      style.scrollPaddingTop = `${bar.current.offsetHeight + BAR_GAP_PX}px`;
    });
    watcher.observe(bar.current);
    return () => {
      watcher.disconnect();
      style.scrollPaddingTop = "";
    };
  }, []);
  const [run, , busy] = useAction(async (method, path, body) => {
    setErrors(await forEach(chosen, job => call(method, `v1/jobs/${job.id}${path}`, body)));
    onDone();
  });
  const setPriority = () => {
    const text = prompt(`Priority of ${chosen.length === 1 ? nameOf(chosen[0]) : `${chosen.length} jobs`} (-1000 to 1000):`, chosen[0].priority);
    if (text !== null && /^-?\d+$/.test(text.trim())) run("PATCH", "", {priority: Number(text)});
  };
  const remove = () => confirm(`Delete ${chosen.length} jobs and their results?`) && run("DELETE", "");
  const button = (word, path) => html`<button disabled=${busy || !chosen.length} onClick=${() => run("POST", path)}>${word}</button>`;
  return html`<div class="actions" ref=${bar} role="toolbar" aria-label="Selected jobs">
    <label class="all"><input type="checkbox" aria-label="Select all" checked=${chosen.length > 0 && chosen.length === jobs.length}
      onChange=${e => onChooseAll(e.target.checked)} /><span role="status">${chosen.length} selected</span></label>
    ${mayChange && html`${button("Cancel", "/cancel")}${button("Pause", "/pause")}${button("Resume", "/resume")}${button("Retry", "/retry")}
    <button disabled=${busy || !chosen.length} onClick=${setPriority}>Priority …</button>
    <button disabled=${busy || !chosen.length} onClick=${remove}>Delete …</button>`}
    ${chosen.length === 2 && chosen.every(job => job.links.results) && html`<a class="button" href=${`#/compare/${chosen[0].id}/${chosen[1].id}`}>Compare</a>`}
    ${errors.length > 0 && html`<div class="trouble" role="alert"><ul>${errors.slice(0, 5).map(text => html`<li>${text}</li>`)}</ul>
      ${errors.length > 5 && html`<p>and ${errors.length - 5} more</p>`}</div>`}</div>`;
}

const RATINGS = ["good", "fair", "poor"];

/** The worst rating of the notes of a result, or null. */
const worstOf = notes => RATINGS.findLast(word => Object.values(notes?.ratings ?? {}).some(({rating}) => rating === word)) ?? null;

/** By the id and the revision of a job: {preview, rating}. */
const details = new Map();

/** Whether the spec of a job requests a preview, and the worst rating of its result. */
function readDetails(key, id) {
  if (!details.has(key))
    details.set(key, get(`v1/jobs/${id}`).then(({spec, notes}) => ({preview: Boolean(spec) && (spec.output || {}).preview !== false, rating: worstOf(notes)}), () => {
      details.delete(key); // the next view requests it again
      return null;
    }));
  return details.get(key);
}

/** The details of a job whose results the reader may see; null: there are none, or not yet. */
function useDetails(job, own) {
  const [found, setFound] = useState(null);
  const key = own && job.links.results ? `${job.id}.${job.revision}` : null;
  useEffect(() => {
    if (key) readDetails(key, job.id).then(setFound);
    else setFound(null);
  }, [key]);
  return found;
}

/** What a row says of a job that waits for its turn. */
const turnOf = ({ahead, owner}) => (ahead === 0 ? `next of ${owner}` : `after ${ahead}${ahead === AHEAD_MOST ? " or more" : ""} of ${owner}`);

function RowState({job, rating, hrefOf}) {
  const {all, succeeded} = job.tasks;
  const fraction = job.array ? succeeded / all : job.progress ? job.progress.fraction : 0;
  return html`<${State} job=${job} href=${hrefOf({state: stateOf(job).state})} />
    ${!isFinal(job.state) && (job.progress || (job.array && job.started)) && html`<${Progress} fraction=${fraction} label=${`Progress of ${nameOf(job)}`} />`}
    ${job.progress && job.state === "running" && html`<span class="detail">${PHASES[job.progress.phase]}</span>`}
    ${job.ahead !== null && html`<span class="detail">${turnOf(job)}</span>`}
    ${job.array && html`<span class="detail">${succeeded} of ${all} frames${job.tasks.failed ? `, ${job.tasks.failed} failed` : ""}</span>`}
    ${job.state === "succeeded" && html`<span class="detail">${[job.outcome === "converged" && "converged", rating && `packing ${rating}`].filter(Boolean).join(", ")}</span>`}
    ${job.error && html`<span class="detail why">${job.error.message}</span>`}`;
}

/** A reduced preview of a job, of an array that of its first frame; an empty place where there is none. */
function Thumbnail({job, shown}) {
  const [failed, setFailed] = useState(false);
  return shown && !failed ? html`<img class="thumbnail" loading="lazy" alt="" src=${urlOf(`v1/jobs/${job.id}/thumbnail.png`).href} onError=${() => setFailed(true)} />`
    : html`<span class="thumbnail" aria-hidden="true"></span>`;
}

function Row({job, now, chosen, own, hrefOf, onChoose}) {
  const found = useDetails(job, own);
  return html`<tr class=${chosen ? "chosen" : ""}>
    <td class="choose"><input type="checkbox" aria-label=${`Select ${nameOf(job)}`} checked=${chosen} onChange=${() => onChoose(job)} /></td>
    <td class="name">${own && job.links.results && html`<${Thumbnail} job=${job} shown=${found && found.preview} />`}<a href=${`#/jobs/${job.id}`}>${nameOf(job)}</a>
      ${job.labels.map(label => html`<a class="label" href=${hrefOf({label})} title="Only jobs with this label">${label}</a>`)}</td>
    <td class="row-state"><${RowState} job=${job} rating=${found && found.rating} hrefOf=${hrefOf} /></td>
    <td>${job.owner}</td><td class="number priority">${job.priority}</td>
    <td title=${timeOf(job.created)}>${ageOf(job.created, now)}</td>
    <td class="number">${spentOf(job, now)}</td></tr>`;
}

export function Queue({session, search}) {
  const [filter, setFilter] = useState(filterOf(search));
  const [cursors, setCursors] = useState([null]); // of the pages so far; the last one is shown
  const [sort, setSort] = useState(sortOf(search));
  const [selection, setSelection] = useState(new Set());
  const asked = Object.fromEntries(Object.entries(filter).map(([key, text]) => [key, text.trim()]));
  const [data, reload] = useQueue(asked, sort, cursors[cursors.length - 1]);
  const now = useClock();
  useTitle("Queue");
  const jobs = data.jobs || [];
  const chosen = jobs.filter(job => selection.has(job.id));
  const choose = job => setSelection(old => {
    const next = new Set(old);
    if (!next.delete(job.id)) next.add(job.id);
    return next;
  });
  const chooseAll = all => setSelection(new Set(all ? jobs.map(job => job.id) : []));
  const show = (newFilter, newSort) => {
    setFilter(newFilter);
    setSort(newSort);
    setCursors([null]);
  };
  useEffect(() => show(filterOf(search), sortOf(search)), [search]); // an address that was opened
  const change = (newFilter, newSort) => {
    show(newFilter, newSort);
    history.replaceState(null, "", addressOf(newFilter, newSort)); // without an event: the view stays as it is
  };
  const sortBy = by => change(filter, by);
  const hrefOf = part => addressOf({...asked, ...part}, sort);
  const heading = ([key, word, first]) => {
    const by = sort.replace("-", "") === key, falls = sort.startsWith("-");
    return html`<th scope="col" class=${key === "priority" ? "number" : ""} aria-sort=${by ? (falls ? "descending" : "ascending") : null}>
      <button class="plain" onClick=${() => sortBy(by ? `${falls ? "" : "-"}${key}` : first + key)}>${word}</button></th>`;
  };
  return html`<h1>Queue</h1>
    <${Load} load=${data.load} workers=${data.workers} now=${now} checks=${data.checks} admin=${session.scopes.includes("admin")} onChange=${reload} />
    <${Filter} filter=${filter} sort=${sort} onChange=${next => change(next, sort)} onSort=${sortBy} />
    <${Trouble} error=${data.error} />
    ${jobs.length > 0 && html`<${Actions} jobs=${jobs} chosen=${chosen} mayChange=${session.scopes.includes("cancel")} onChooseAll=${chooseAll} onDone=${reload} />
    <div class="scroll" tabindex="0" role="region" aria-label="Jobs"><table class="jobs"><thead><tr>
      <td class="choose"></td>
      ${COLUMNS.map(heading)}<th scope="col" class="number">Ran</th></tr></thead>
      <tbody>${jobs.map(job => html`<${Row} key=${job.id} job=${job} now=${now} chosen=${selection.has(job.id)} own=${session.scopes.includes("admin") || job.owner === session.user} hrefOf=${hrefOf} onChoose=${choose} />`)}</tbody></table></div>`}
    ${data.jobs && !jobs.length && html`<p class="empty">No jobs${Object.values(filter).some(Boolean) ? " like these" : " yet"}.
      ${session.scopes.includes("submit") && html` <a href="#/submit">Submit one</a>`}</p>`}
    <nav class="pages" aria-label="Pages">
      <button disabled=${cursors.length < 2} onClick=${() => setCursors(cursors.slice(0, -1))}>Back</button>
      <span>Page ${cursors.length}</span>
      <button disabled=${!data.next} onClick=${() => setCursors([...cursors, data.next])}>More</button></nav>`;
}
