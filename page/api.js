// SPDX-License-Identifier: Apache-2.0
// The REST interface of hexad. The page may lie below a path prefix, so addresses are relative to its own.

const root = new URL("..", import.meta.url);

export const urlOf = path => new URL(path.replace(/^\//, ""), root);

/** An answer that says what is wrong: a problem document, or no answer at all (status 0). */
export class Problem extends Error {
  constructor(status, body, retryAfter = null) {
    super(body.detail || body.title || `The service answered ${status}.`);
    this.status = status;
    this.retryAfter = retryAfter; // seconds, where asking again helps
    this.code = body.code;
    this.errors = body.errors || [];
    this.checks = body.checks;
  }
}

/** The seconds after which one may ask again for what is missing in the answer, or null. */
export const retryAfterOf = response => Number(response.headers.get("Retry-After")) || null;

/** Resolves after this time; rejects as soon as the signal is aborted, also when it already is. */
export const wait = (seconds, signal) => new Promise((done, fail) => {
  signal.throwIfAborted();
  const stop = () => {
    clearTimeout(timer);
    fail(signal.reason);
  };
  const timer = setTimeout(() => {
    signal.removeEventListener("abort", stop);
    done();
  }, 1000 * seconds);
  signal.addEventListener("abort", stop);
});

/** Sends a request and returns the response; throws a Problem. */
export async function send(method, path, {body, headers, signal} = {}) {
  let response;
  try {
    response = await fetch(urlOf(path), {method, body, headers, signal, credentials: "same-origin"});
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Problem(0, {detail: "hexad does not answer. Try again; if this persists, ask the administrator whether hexad runs."});
  }
  if (response.ok) return response;
  const text = await response.text();
  let problem = {};
  try {
    problem = JSON.parse(text);
  } catch {
    problem = {detail: text};
  }
  if (response.status === 401) dispatchEvent(new Event("signed-out"));
  throw new Problem(response.status, problem, retryAfterOf(response));
}

export async function get(path, options) {
  return (await send("GET", path, options)).json();
}

export async function call(method, path, document, signal) {
  const options = document === undefined ? {} : {
    body: JSON.stringify(document), headers: {"Content-Type": "application/json"}};
  const response = await send(method, path, {...options, signal});
  return response.status === 204 ? null : response.json();
}

/** "?a=1&b=2" of the members that have a value. */
export function query(members) {
  const given = Object.entries(members).filter(([, value]) => value !== "" && value !== null && value !== undefined);
  return given.length ? `?${new URLSearchParams(given)}` : "";
}

const RETRY_MS = 2000;
const EVENTS = ["state", "task", "started", "ended", "edited", "progress"];

/**
 * Follows a stream of events until the returned function is called. `onEvent(type, data)` gets each event. `onOpen()` is
 * called whenever a stream begins: read the state then, since the stream does not repeat earlier events. `onGap()` is called when
 * events are missing, or none come: read again. A hidden page holds no connection, since a browser has six of them for all
 * its pages of one service.
 */
export function follow(path, {onOpen, onEvent, onGap}) {
  let source, timer;

  function open() {
    source = new EventSource(urlOf(path));
    source.onopen = onOpen;
    source.onerror = () => {
      close();
      onGap();
      timer = setTimeout(open, RETRY_MS);
    };
    source.addEventListener("position", event => {
      if (JSON.parse(event.data).removed_up_to) onGap();
    });
    for (const type of EVENTS) source.addEventListener(type, event => onEvent(type, JSON.parse(event.data)));
  }

  function close() {
    clearTimeout(timer);
    if (source) source.close();
  }

  function watchVisibility() {
    close();
    if (!document.hidden) open();
  }

  document.addEventListener("visibilitychange", watchVisibility);
  if (!document.hidden) open();
  return () => {
    document.removeEventListener("visibilitychange", watchVisibility);
    close();
  };
}
