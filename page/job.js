// SPDX-License-Identifier: Apache-2.0
// A job: its state in words, its tasks and attempts, plots while it runs and afterwards, report and results.
import {html, useEffect, useLayoutEffect, useMemo, useRef, useState} from "./preact.js";
import {call, follow, get, query, send, urlOf} from "./api.js";
import {Charts, rowsOfReport} from "./chart.js";
import {inOrder, Progress, State, throttled, Trouble, useAction, useClock, useTitle} from "./parts.js";
import {LivePoints} from "./points.js";
import {Report} from "./report.js";
import {bytesOf, countOf, durationOf, isFinal, nameOf, PHASES, spentOf, stateOf, STATES, timeOf, warningsOf} from "./words.js";

const FRAMES = 500; // of an array, in one request
const READ_MS = 500; // however fast events come, the job is read no more often; its log and frames:
const SLOW_MS = 2000;
const ROWS_MOST = 4000; // of progress; of more, every second one is kept
const LOG_MOST = 200000; // characters, from the end
const AHEAD_MOST = 100; // the service counts no more jobs ahead of a job
const NEAR_END_PX = 40; // a log that is read to here goes on with its end

/**
 * The job, kept right by its events, with its newest progress; the progress lines of its current attempt, or of that of the
 * chosen frame: {job, rows, lines, error, reload}. `lines` counts all that have come.
 */
function useJob(id, frame, own) {
  const [job, setJob] = useState(null);
  const [error, setError] = useState(null);
  const [, redraw] = useState(0);
  const live = useMemo(() => ({attempt: 0, rows: [], newest: null, lines: 0}), [id, frame]);
  const read = useMemo(() => inOrder(() => get(`v1/jobs/${id}`).catch(problem => problem), answer => {
    const failed = answer instanceof Error;
    setError(failed ? answer : null);
    if (!failed) setJob(answer);
  }), [id]);
  useEffect(() => {
    read();
  }, [read]);

  function take({attempt, progress}) {
    if (attempt < live.attempt) return;
    if (attempt > live.attempt) Object.assign(live, {attempt, rows: []});
    live.newest = progress;
    const {rows} = live, last = rows.length ? rows[rows.length - 1].sweep : 0;
    if (progress.sweep > last) rows.push(progress); // a new stream repeats the lines of a lost one
    if (rows.length > ROWS_MOST) live.rows = rows.filter((_, i) => i % 2 || i === rows.length - 1);
  }

  const stream = job && !isFinal(job.state) && (own(job) ? `v1/jobs/${id}/events` : `v1/events?all=1&progress=1&job=${id}`);
  useEffect(() => {
    if (!stream) return undefined;
    const readSoon = throttled(read, READ_MS);
    let drawing = null;
    const stop = follow(stream, {
      onOpen: readSoon,
      onEvent(type, event) {
        if (type !== "progress") {
          readSoon();
          return;
        }
        live.lines++;
        if ((event.frame ?? null) === frame) take(event);
        drawing = drawing || requestAnimationFrame(time => {
          drawing = null;
          redraw(time);
        });
      },
      onGap: readSoon,
    });
    return () => {
      stop();
      readSoon.cancel();
      cancelAnimationFrame(drawing);
    };
  }, [id, frame, stream]);
  const progress = job && (!job.array && live.attempt === job.attempt && live.newest || job.progress);
  return {job: job && {...job, progress}, rows: live.rows, lines: live.lines, error, reload: read};
}

/** The report of a job, or of one frame; null while there is none. */
export function useReport(job, frame) {
  const [report, setReport] = useState(null);
  const there = job && job.links.results && (!job.array || frame !== null);
  useEffect(() => {
    setReport(null);
    if (there) get(`v1/jobs/${job.id}/results/report.json${query({frame})}`).then(setReport, () => setReport(null));
  }, [there, job && job.id, frame, job && job.revision]);
  return report;
}

/** What one can do when a job has failed for a reason that is not in its spec or its files. */
const REMEDIES = {
  limit_memory: "Submit a changed copy with more memory under limits, or with fewer points.",
  limit_time: "Submit a changed copy with more time under limits, or with fewer points.",
  limit_file: "Submit a changed copy with fewer points or files; file_mb in the settings bounds each file.",
  stalled: "The last lines of the log show where the worker stalled. Retry runs the job again.",
  dependency_failed: "First retry the job or the frame that the message names.",
  storage_full: "Retry the job when the disk has free space.",
  storage_failed: "Retry the job when the administrator has repaired the disk.",
  interrupted: "Ask the administrator why hexad or the machine of the worker stopped, then retry the job.",
  internal: "The log of the job may show the cause. Retry runs the job again.",
};

/** What the state means and what one can do, in sentences. */
function explain(job, report) {
  if (job.error) return [REMEDIES[job.error.code] || "Submit a changed copy: with the same spec, the job ends in the same way."];
  const reasons = report && report.outcome_reasons || [];
  if (reasons.length) return reasons.map(reason => reason.message);
  switch (job.state) {
    case "queued": return [job.paused ? "The job is paused: resume it." : `The job starts as soon as there is room${
      job.ahead ? `, after ${countOf(job.ahead)}${job.ahead === AHEAD_MOST ? " or more" : ""} earlier or more urgent jobs of ${job.owner}` : ""}. Users take turns.`];
    case "blocked": return ["The job starts when the jobs that it depends on have ended."];
    case "succeeded": return job.outcome === "converged" ? ["The solve has converged, and the points represent the surface."] : [];
    case "cancelled": return ["A user cancelled the job. Retry runs it again."];
    default: return [];
  }
}

function Buttons({job, frame, onChange}) {
  const [others, setOthers] = useState([]); // dependents that were not retried
  const [run, error, busy] = useAction(async (method, path) => {
    const answer = await call(method, `v1/jobs/${job.id}${path}`);
    setOthers(answer?.dependents?.others ?? []);
    if (method === "DELETE") location.hash = "#/";
    else await onChange();
  });
  const button = (word, path) => html`<button disabled=${busy} onClick=${() => run("POST", path)}>${word}</button>`;
  const ended = isFinal(job.state);
  return html`<div class="buttons">
    ${job.links.results && html`<a class="button main" href=${`#/jobs/${job.id}/points${query({frame})}`}>Points in 3-D</a>`}
    ${!ended && button("Cancel", "/cancel")}
    ${!ended && (job.paused ? button("Resume", "/resume") : button("Pause", "/pause"))}
    ${ended && (job.state !== "succeeded") && button("Retry", "/retry")}
    ${ended && (job.state !== "succeeded") && button("Retry with dependents", "/retry?dependents=1")}
    ${ended && job.delivery && job.delivery.state !== "pending" && button("Deliver again", "/deliver")}
    ${job.spec && html`<a class="button" href=${`#/submit?from=${job.id}`}>Submit a changed copy</a>`}
    ${ended && html`<button disabled=${busy} onClick=${() => confirm(`Delete ${nameOf(job)} and its results?`) && run("DELETE", "")}>Delete …</button>`}
  </div><${Trouble} error=${error} />
  ${others.length > 0 && html`<p role="status">${others.length} dependent jobs are not retried: they depend on another job that
    failed.</p>`}`;
}

/** Notifies the user when the job ends, where the browser permits it. */
function useNotification(job) {
  const [asked, setAsked] = useState(false);
  const ended = job && isFinal(job.state);
  useEffect(() => {
    if (asked && ended) new Notification(`${nameOf(job)}: ${stateOf(job).word}`);
  }, [asked && ended]);
  if (!window.isSecureContext || !("Notification" in window)) return null;
  return [asked, async () => setAsked(await Notification.requestPermission() === "granted")];
}

/** A link to another job, by its name. */
function JobLink({id}) {
  const [job, setJob] = useState({id});
  useEffect(() => {
    get(`v1/jobs/${id}`).then(setJob, () => {}); // it may have been deleted
  }, [id]);
  return html`<a href=${`#/jobs/${id}`}>${nameOf(job)}</a>`;
}

function Facts({job, now}) {
  const {depends_on: first = [], after = [], after_frames: frames = []} = job.spec && job.spec.queue || {};
  const others = [...new Set([...first, ...after, ...frames])];
  const rows = [
    [isFinal(job.state) ? "Waited for" : "Waits for", others.length > 0 && others.map((id, i) => html`${i > 0 && ", "}<${JobLink} key=${id} id=${id} />`)],
    ["Owner", job.owner], ["Submitted", timeOf(job.created)], ["Started", timeOf(job.started)], ["Ended", timeOf(job.finished)],
    ["Ran", spentOf(job, now)], ["Attempt", !job.array && (job.max_attempts ? `${job.attempt} of ${job.max_attempts}` : job.attempt)], ["Priority", job.priority],
    ["Threads", job.threads], ["Memory", `${job.memory_mb} MiB`], ["Labels", job.labels.join(", ")],
    ["Accepted", job.accepted === false && "no: queue.accept excludes the outcome"],
    ["Delivery", job.delivery && (job.delivery.message || job.delivery.state)],
    ["Result of", job.cached_from && html`<a href=${`#/jobs/${job.cached_from}`}>${job.cached_from}</a>`], ["Id", html`<code>${job.id}</code>`],
  ];
  return html`<dl class="card facts-list">${rows.map(([word, value]) => (value || value === 0) && html`<div><dt>${word}</dt><dd>${value}</dd></div>`)}</dl>`;
}

const COUNTED = ["succeeded", "failed", "timed_out", "cancelled", "running", "waiting"];

/** Seconds that an array has left if the other frames take as long as those that have ended; null: not known. */
function leftOf({tasks, started}, now) {
  const ended = tasks.all - tasks.waiting - tasks.running;
  return started && ended > 0 && ended < tasks.all ? (now - new Date(started)) / 1000 / ended * (tasks.all - ended) : null;
}

/** How many frames of an array have which state. */
function FramesBar({job, now}) {
  const some = COUNTED.filter(state => job.tasks[state] > 0), left = leftOf(job, now);
  const words = some.map(state => `${countOf(job.tasks[state])} ${(STATES[state] || STATES.queued).word.toLowerCase()}`).join(", ");
  return html`<div class="bar" role="img" aria-label=${words}>${some.map(state => html`<span class=${state} style=${{flexGrow: job.tasks[state]}}></span>`)}</div>
    <p class="hint">${words}${left !== null && !isFinal(job.state) ? `; about ${durationOf(left)} left` : ""}</p>`;
}

/** The frames of an array as cells; a chosen one shows its results. */
function Tasks({job, frame, now, onChoose}) {
  const [tasks, setTasks] = useState([]);
  const [error, setError] = useState(null);
  const readSoon = useMemo(() => throttled(async () => {
    const all = [];
    try {
      for (let after = null; after !== undefined;) {
        const page = await get(`v1/jobs/${job.id}/tasks${query({after, limit: FRAMES})}`);
        all.push(...page.tasks);
        after = page.next ?? undefined;
      }
      setTasks(all);
    } catch (e) {
      setError(e);
    }
  }, SLOW_MS), [job.id]);
  useEffect(readSoon, [job.id, job.revision, job.tasks.succeeded, job.tasks.running]);
  useEffect(() => readSoon.cancel, [readSoon]);
  const pictures = job.spec && (job.spec.output || {}).preview !== false;
  return html`<section aria-label="Frames"><h2>Frames</h2><${FramesBar} job=${job} now=${now} /><${Trouble} error=${error} /><div class="frames">${tasks.map(task => {
    const {word, sign, kind} = stateOf(task);
    const waits = task.waits ? `, waits for this frame of ${task.waits === 1 ? "another job" : `${task.waits} other jobs`}` : "";
    return html`<button key=${task.frame} class=${`frame ${kind}`} aria-pressed=${task.frame === frame}
      title=${`Frame ${task.frame}${task.file ? ` (${task.file})` : ""}: ${word}${waits}${task.error ? `: ${task.error.message}` : ""}`} onClick=${() => onChoose(task.frame)}
      >${pictures && task.state === "succeeded" && html`<img loading="lazy" alt="" src=${urlOf(`v1/jobs/${job.id}/thumbnail.png?frame=${task.frame}`).href} onError=${e => { e.target.hidden = true; }} />`}<span aria-hidden="true">${sign}</span>${task.frame}<span class="hidden">: ${word}</span></button>`;
  })}</div>${warningsOf(tasks).map(text => html`<p class="notice">${text}</p>`)}</section>`;
}

/** `lines` changes as long as the attempt says something. */
function Log({job, attempt, lines}) {
  const [text, setText] = useState(null);
  const [error, setError] = useState(null);
  const place = useRef(null), follows = useRef(true); // until the reader scrolls back
  const readSoon = useMemo(() => throttled(() => send("GET", `v1/jobs/${job.id}/log${query({frame: attempt.frame, attempt: attempt.number})}`)
    .then(response => response.text()).then(found => {
      setText(found.slice(-LOG_MOST));
      setError(null);
    }, setError), SLOW_MS), [job.id, attempt.number, attempt.frame]);
  useEffect(readSoon, [readSoon, job.revision, attempt.finished || lines]);
  useEffect(() => readSoon.cancel, [readSoon]);
  useLayoutEffect(() => {
    if (follows.current) place.current.scrollTop = place.current.scrollHeight;
  }, [text]);
  const noteScroll = ({target}) => {
    follows.current = target.scrollTop + target.clientHeight + NEAR_END_PX >= target.scrollHeight;
  };
  const early = !attempt.finished && error && error.status === 404; // it has no log yet
  return html`<${Trouble} error=${early ? null : error} /><pre class="log" ref=${place} onScroll=${noteScroll} tabindex="0" aria-label="Log">${text === null ? "…" : text || "The log is empty."}</pre>`;
}

/** How a worker ended, by its exit status. */
const ENDS = {0: "converged", 10: "not converged", 11: "unresolved", 2: "spec refused", 3: "file refused", 4: "no surface", 5: "limit exceeded", 6: "stopped", 7: "disk failed"};

/** The attempts of a job, or of one of its frames. */
function Attempts({job, frame, lines}) {
  const attempts = (job.attempts || []).filter(attempt => frame === null || attempt.frame === frame);
  const keyOf = attempt => `${attempt.frame ?? ""}.${attempt.number}`;
  const [chosen, setOpen] = useState(undefined);
  if (!attempts.length) return null;
  const running = attempts.find(attempt => !attempt.finished);
  const open = chosen !== undefined ? chosen : running ? keyOf(running) : null; // the log of what runs is open at first
  const farm = attempts.some(attempt => attempt.host), waited = attempts.some(attempt => attempt.waited_ms);
  const endOf = ({reason, exit_status: status, finished}) =>
    (reason === `exit status ${status}` && ENDS[status]) || reason || (finished ? `exit status ${status}` : "running");
  return html`<section aria-label="Attempts"><h2>Attempts</h2><div class="scroll" tabindex="0" role="region" aria-label="List of attempts"><table class="attempts"><thead><tr>
    ${job.array && html`<th scope="col" class="number">Frame</th>`}<th scope="col" class="number">No.</th><th scope="col">Started</th>
    ${waited && html`<th scope="col" class="number">Waited</th>`}<th scope="col" class="number">Ran</th><th scope="col">End</th><th scope="col"><span class="hidden">Log</span></th>
    ${farm && html`<th scope="col">Host</th>`}<th scope="col" class="number">Memory</th></tr></thead><tbody>
    ${attempts.map(attempt => html`<tr>${job.array && html`<td class="number">${attempt.frame}</td>`}<td class="number">${attempt.number}</td>
      <td class="when">${timeOf(attempt.started)}</td>${waited && html`<td class="number">${durationOf(attempt.waited_ms / 1000)}</td>`}
      <td class="number">${spentOf(attempt)}</td><td>${endOf(attempt)}</td>
      <td><button aria-expanded=${open === keyOf(attempt)} onClick=${() => setOpen(open === keyOf(attempt) ? null : keyOf(attempt))}>Log</button></td>
      ${farm && html`<td>${attempt.host}</td>`}<td class="number">${bytesOf(attempt.peak_memory_bytes)}</td></tr>
      ${open === keyOf(attempt) && html`<tr><td colspan="9"><${Log} job=${job} attempt=${attempt} lines=${lines} /></td></tr>`}`)}
    </tbody></table></div></section>`;
}

function Results({job, frame}) {
  const [results, setResults] = useState([]);
  const chosen = !job.array || frame !== null;
  useEffect(() => {
    if (chosen) get(`v1/jobs/${job.id}/results${query({frame})}`).then(found => setResults(found.results), () => setResults([]));
  }, [job.id, frame, job.revision]);
  if (!chosen) return html`<p class="hint">Choose a frame to see its results.</p>`;
  if (!results.length) return null;
  const preview = results.find(result => result.name === "preview.png");
  return html`<section aria-label="Results"><h2>Results</h2><div class="results">
    ${preview && html`<img class="preview" src=${urlOf(preview.href).href} alt=${`Preview of the points of ${nameOf(job)}`} />`}
    <div class="scroll" tabindex="0" role="region" aria-label="Files"><table><thead><tr><th scope="col">File</th><th scope="col" class="number">Size</th><th scope="col">SHA-256</th></tr></thead><tbody>
    ${results.map(result => html`<tr><td><a href=${urlOf(result.href).href} download=${result.name}>${result.name}</a></td>
      <td class="number">${bytesOf(result.bytes)}</td><td><code class="hash" title=${result.sha256}>${result.sha256}</code></td></tr>`)}
    </tbody></table></div></div></section>`;
}

function Spec({spec}) {
  const text = JSON.stringify(spec, null, 2);
  const [copy, error] = useAction(() => navigator.clipboard.writeText(text));
  return html`<details><summary>Spec</summary><button onClick=${copy}>Copy</button><${Trouble} error=${error} /><pre class="log" tabindex="0">${text}</pre></details>`;
}

export function Job({ids: [id], search, session}) {
  const owns = job => session.scopes.includes("admin") || job.owner === session.user || job.spec !== null;
  const asked = search.get("frame");
  const [frame, setFrame] = useState(asked === null ? null : Number(asked));
  const {job, rows, lines, error, reload} = useJob(id, frame, owns);
  const report = useReport(job && owns(job) ? job : null, frame);
  const now = useClock(1000);
  const notification = useNotification(job);
  useTitle(job ? nameOf(job) : "Job");
  if (!job) return error ? html`<${Trouble} error=${error} />` : html`<p class="loading" role="status">Loading …</p>`;

  const own = owns(job), progress = !isFinal(job.state) && job.progress, lives = own && !isFinal(job.state) && rows.length > 0;
  return html`<p class="back"><a href="#/">Queue</a></p>
    <h1>${nameOf(job)} <${State} job=${job} /></h1>
    <${Trouble} error=${error} />
    ${job.error && html`<p class="trouble">${job.error.message}</p>`}
    ${explain(job, report).map(text => html`<p class="lead">${text}</p>`)}
    ${progress && html`<div class="live" aria-live="off"><${Progress} fraction=${progress.fraction} label="Progress" />
      <span>${PHASES[progress.phase]}${progress.eta_s >= 1 ? `, about ${durationOf(progress.eta_s)} left` : ""}</span>
      ${notification && html`<button class="plain" disabled=${notification[0]} onClick=${notification[1]}>${notification[0] ? "A notification follows" : "Notify me at the end"}</button>`}</div>`}
    ${own && session.scopes.includes("cancel") && html`<${Buttons} job=${job} frame=${frame} onChange=${reload} />`}
    <div class=${lives ? "beside" : ""}>${lives && html`<${LivePoints} key=${frame} job=${job} frame=${frame} />`}
      <${Facts} job=${job} now=${now} /></div>
    ${own && job.array && html`<${Tasks} job=${job} frame=${frame} now=${now} onChoose=${setFrame} />`}
    ${!own && html`<p class="hint">Only ${job.owner} and administrators see the rest of this job. You are signed in as ${session.user}.</p>`}
    ${own && job.links.results && html`<${Results} job=${job} frame=${frame} />`}
    ${report ? html`<h2>Convergence</h2><${Charts} key="whole" runs=${[rowsOfReport(report)]} words=${[nameOf(job)]} />`
      : rows.length > 1 && html`<h2>Convergence</h2><${Charts} key="live" live=${true} runs=${[rows]} words=${[nameOf(job)]} />`}
    ${report && html`<${Report} report=${report} />`}
    ${own && html`<${Attempts} job=${job} frame=${frame} lines=${lines} />`}
    ${job.spec && html`<${Spec} spec=${job.spec} />`}`;
}
