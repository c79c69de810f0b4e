// SPDX-License-Identifier: Apache-2.0
// Small parts that several views share.
import {html, useEffect, useRef, useState, useCallback} from "./preact.js";
import {percentOf, stateOf} from "./words.js";

/** With an address: a link to the jobs of that state. */
export function State({job, href}) {
  const {word, sign, kind} = stateOf(job);
  const text = html`<span aria-hidden="true" class="sign">${sign}</span>${word}`;
  return href ? html`<a class=${`state ${kind}`} href=${href} title="Only jobs in this state">${text}</a>`
    : html`<span class=${`state ${kind}`}>${text}</span>`;
}

export function Progress({fraction, label}) {
  return html`<span class="progress"><progress aria-label=${label} value=${fraction} max="1"></progress
    ><span>${percentOf(fraction)}</span></span>`;
}

/** What went wrong, in words; nothing when nothing did. */
export function Trouble({error}) {
  if (!error) return null;
  return html`<div class="trouble" role="alert"><p>${error.message}</p>
    ${error.errors && error.errors.length > 1 && html`<ul>${error.errors.map(e =>
      html`<li><code>${e.pointer}</code> ${e.detail}</li>`)}</ul>`}</div>`;
}

/** A function that runs an asynchronous action and keeps its error: [run, error, busy]. */
export function useAction(action) {
  const [error, setError] = useState(null);
  const [busy, setBusy] = useState(false);
  const latest = useRef(action);
  latest.current = action;
  const run = useCallback(async (...words) => {
    setBusy(true);
    setError(null);
    try {
      return await latest.current(...words);
    } catch (e) {
      if (e.name !== "AbortError") setError(e);
    } finally {
      setBusy(false);
    }
  }, []);
  return [run, error, busy];
}

/**
 * A function that runs an asynchronous action soon, but at most once in `ms` milliseconds and for at most a fifth of
 * the time, which bounds the load of a slow service. Its `cancel` prevents a pending run.
 */
export function throttled(action, ms) {
  let timer = null, quietUntil = -Infinity;
  const soon = () => {
    timer = timer || setTimeout(async () => {
      const begun = performance.now();
      timer = null;
      quietUntil = begun + ms;
      await action();
      quietUntil = Math.max(quietUntil, begun + 5 * (performance.now() - begun));
    }, Math.max(0, quietUntil - performance.now()));
  };
  soon.cancel = () => {
    clearTimeout(timer);
    timer = null;
  };
  return soon;
}

/** A function that reads and shows what it has read; an answer that comes after that of a later call is not shown. */
export function inOrder(read, show) {
  let calls = 0, shown = 0;
  return async () => {
    const call = ++calls;
    const answer = await read();
    if (call < shown) return;
    shown = call;
    show(answer);
  };
}

/** Values that outlive the page, as the theme; without storage they do not. */
export function recall(key) {
  try {
    return localStorage.getItem(`hexad.${key}`);
  } catch {
    return null;
  }
}

export function remember(key, value) {
  try {
    if (value === null) localStorage.removeItem(`hexad.${key}`);
    else localStorage.setItem(`hexad.${key}`, value);
  } catch { /* private windows */ }
}

/** Sets the title of the document while the view is shown. */
export function useTitle(text) {
  useEffect(() => {
    document.title = text ? `${text} · hexad` : "hexad";
  }, [text]);
}

/** Renders again every so often, for ages and times. */
export function useClock(ms = 5000) {
  const [now, setNow] = useState(Date.now());
  useEffect(() => {
    const timer = setInterval(() => document.hidden || setNow(Date.now()), ms);
    return () => clearInterval(timer);
  }, [ms]);
  return now;
}
