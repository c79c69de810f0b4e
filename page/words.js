// SPDX-License-Identifier: Apache-2.0
// Words and numbers as people read them. Numbers have one form in all locales; times are in the zone of the viewer.

/** A state in a word, and a sign, so that colour is never alone. */
export const STATES = {
  queued: {word: "Waiting", sign: "○"},
  blocked: {word: "Waiting for jobs", sign: "◔"},
  paused: {word: "Paused", sign: "‖"},
  running: {word: "Running", sign: "▶"},
  cancelling: {word: "Stopping", sign: "◌"},
  succeeded: {word: "Done", sign: "✓"},
  failed: {word: "Failed", sign: "✕"},
  cancelled: {word: "Cancelled", sign: "⊘"},
  timed_out: {word: "Out of time", sign: "⧖"},
};

export const FINAL = ["succeeded", "failed", "cancelled", "timed_out"];
export const isFinal = state => FINAL.includes(state);

export const PHASES = {
  queue: "Waiting for a node", load: "Reading the surface", start: "Placing first points", relax: "Relaxing", measure: "Measuring", write: "Writing files"};

/** The state of a job, with the outcome where that is not the best one. */
export function stateOf(job) {
  const state = job.paused && !isFinal(job.state) ? "paused" : job.state;
  const known = STATES[state] || {word: state, sign: "?"};
  if (job.outcome === "unresolved") return {state, word: "Done, unresolved", sign: "!", kind: "warning"};
  if (job.outcome === "not_converged") return {state, word: "Done, not converged", sign: "!", kind: "warning"};
  return {state, ...known, kind: state};
}

const dateTime = new Intl.DateTimeFormat("en-GB", {dateStyle: "medium", timeStyle: "medium"});

export const timeOf = text => (text ? dateTime.format(new Date(text)) : "–");

/** "3 min ago" */
export function ageOf(text, now = Date.now()) {
  if (!text) return "–";
  const seconds = Math.max(0, (now - new Date(text)) / 1000);
  return seconds < 5 ? "now" : `${durationOf(Math.floor(seconds))} ago`;
}

export function durationOf(seconds) {
  if (seconds === null || seconds === undefined || !isFinite(seconds)) return "–";
  if (seconds < 1) return `${Math.round(seconds * 1000)} ms`;
  if (seconds < 60) return `${seconds < 10 && seconds % 1 ? seconds.toFixed(1) : Math.round(seconds)} s`;
  const [minutes, hours, days] = [seconds / 60, seconds / 3600, seconds / 86400];
  if (minutes < 60) return `${Math.floor(minutes)} min`;
  if (hours < 48) return `${Math.floor(hours)} h ${Math.floor(minutes % 60)} min`;
  return `${Math.floor(days)} days`;
}

/** Ascending numbers as "3, 7-12". */
export function rangesOf(numbers) {
  const ranges = [];
  for (const number of numbers) {
    const last = ranges.at(-1);
    if (last && last[1] === number - 1) last[1] = number;
    else ranges.push([number, number]);
  }
  return ranges.map(([first, last]) => (first === last ? `${first}` : `${first}-${last}`)).join(", ");
}

/** The warnings of the frames of an array, each once with its frames. Texts that differ in their numbers only are one warning. */
export function warningsOf(tasks) {
  const found = new Map();
  for (const {frame, notes} of tasks)
    for (const text of notes?.warnings ?? []) {
      const key = text.replace(/\d+(\.\d+)*/g, "0");
      const warning = found.get(key) || {text, varies: false, frames: []};
      found.set(key, warning);
      warning.varies ||= warning.text !== text;
      if (warning.frames.at(-1) !== frame) warning.frames.push(frame);
    }
  return [...found.values()].map(({text, varies, frames}) =>
    `Frame${frames.length > 1 ? "s" : ""} ${rangesOf(frames)}: ${text}${varies ? " (the numbers are those of the first frame)" : ""}`);
}

/** How long a job ran, or has been running. */
export function spentOf(job, now = Date.now()) {
  if (!job.started) return "–";
  return durationOf(Math.max(0, new Date(job.finished || now) - new Date(job.started)) / 1000); // clocks of two machines
}

/** 1234567 as "1 234 567" (with thin blanks), which no locale reads as a fraction. */
export const countOf = number =>
  number === null || number === undefined ? "–" : String(number).replace(/\B(?=(\d{3})+$)/g, "\u202f");

export function bytesOf(bytes) {
  if (bytes === null || bytes === undefined) return "–";
  const units = ["B", "KiB", "MiB", "GiB", "TiB"];
  let unit = 0;
  while (bytes >= 1024 && unit < 4) {
    bytes /= 1024;
    unit++;
  }
  return `${unit && bytes < 100 ? bytes.toFixed(1) : Math.round(bytes)} ${units[unit]}`;
}

/** Four digits, or a power of ten where these would be noughts. */
export function numberOf(value) {
  if (value === null || value === undefined) return "–";
  if (typeof value !== "number") return String(value);
  if (Number.isInteger(value)) return countOf(value);
  const size = Math.abs(value);
  return size < 1e-3 || size >= 1e6 ? value.toExponential(2) : String(Number(value.toPrecision(4)));
}

export const percentOf = fraction => `${Math.floor(100 * fraction)} %`;

/** A name for people: the job's own, or the end of its id. */
export const nameOf = job => job.name || job.input || `job ${job.id.slice(-6)}`;
