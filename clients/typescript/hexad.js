// SPDX-License-Identifier: Apache-2.0
// A client of hexad over fetch, for browsers and other runtimes; node.js adds Unix sockets and files.
import {operations} from "./api.js";
import {Sha256} from "./sha256.js";

/** @typedef {import("./api.js").Operations} Operations */
/** @typedef {import("./api.js").Job} JobDocument */
/** @typedef {import("./api.js").JobSummary} JobSummary */
/** @typedef {import("./api.js").Results["results"][number]} Result a file of a result: `name`, `bytes`, `sha256` */
/** @typedef {Omit<import("./api.js").JobSpec, "version"> & {version?: 1}} Spec */
/** @typedef {{pointer: string, detail: string}} Fault a place in a spec, and what is wrong there */
/** @typedef {"state" | "task" | "started" | "ended" | "edited" | "progress" | "position"} EventType */
/**
 * What has happened to a job.
 * @typedef {object} Event
 * @property {string} id where a stream may continue; empty: nowhere
 * @property {EventType} type `position` says that events are missing (`data`: why)
 * @property {Partial<import("./api.js").Event> & {progress?: import("./api.js").Progress} & {[name: string]: unknown}} data
 */
/**
 * @typedef {object} Request
 * @property {string} method
 * @property {{[name: string]: string}} headers
 * @property {string | Uint8Array} [body]
 * @property {AbortSignal} signal
 */
/** @typedef {{status: number, chunks: AsyncIterable<Uint8Array>}} Answer */
/** @typedef {{update: (bytes: Uint8Array) => void, hex: () => string}} Hasher SHA-256 in pieces */
/** @typedef {(path: string, request: Request) => Promise<Answer>} Exchange one request; it rejects if the connection is lost */
/**
 * @typedef {object} Options
 * @property {string} [server] the address, such as http://HOST:8642; in a page by default its own origin
 * @property {string} [token] for TCP. A page that has signed in needs none
 * @property {number} [timeout] seconds without a byte after which a connection is given up; default 60
 * @property {number} [patience] seconds for which a request without an answer is repeated; default 60. A submission has a
 *   key, so that there is one job
 */

const FIRST_PAUSE_MS = 50, LONGEST_PAUSE_MS = 5000;
const LONGEST_WAIT_S = 30;
const PAGE_ROWS = 500;
const ENDED = ["succeeded", "failed", "cancelled", "timed_out"];
// A request that these refuse may be repeated later: nothing in it is wrong.
const LATER = ["too_many_requests", "too_many_submissions", "unavailable"];

/** Any fault that this module finds. */
export class HexadError extends Error {
  /** @param {string} message */
  constructor(message) {
    super(message);
    this.name = new.target.name;
  }
}

/** There was no answer within `patience` seconds. */
export class Unreachable extends HexadError {}

/** The bytes of a file do not have the hash that was announced. */
export class Damaged extends HexadError {}

/** A job has not ended in the time that a caller wanted to wait. */
export class WaitTimeout extends HexadError {}

/** The service refuses a request. */
export class Problem extends HexadError {
  /**
   * @param {number} status
   * @param {{code?: string, title?: string, detail?: string, errors?: Fault[]}} document
   */
  constructor(status, document) {
    const code = document.code ?? "unknown";
    super(`${code}: ${document.detail || document.title || status}`);
    this.status = status;
    /** What is wrong, in a word that does not change. */
    this.code = /** @type {import("./api.js").ProblemCode | "unknown"} */ (code);
    /** What is wrong here, and what to do. */
    this.detail = document.detail ?? "";
    /** The faults of a spec. */
    this.errors = document.errors ?? [];
  }
}

/** A job has ended without a result. */
export class JobFailed extends HexadError {
  /** @param {JobSummary} document */
  constructor({id, state, error}) {
    super(`job ${id} ended as ${state}${error ? `: ${error.code}: ${error.message}` : ""}`);
    this.job = id;
    this.state = state;
    /** The code of its error, such as `no_surface`; null: it was cancelled before it ran. */
    this.code = error ? error.code : null;
  }
}

/** @type {(ms: number, signal?: AbortSignal) => Promise<void>} */
const sleep = (ms, signal) => new Promise((done, fail) => {
  const stop = () => {
    clearTimeout(timer);
    fail(signal?.reason);
  };
  const timer = setTimeout(() => {
    signal?.removeEventListener("abort", stop);
    done();
  }, ms);
  if (signal?.aborted) stop();
  signal?.addEventListener("abort", stop);
});

/** @type {(chunks: AsyncIterable<Uint8Array>) => Promise<Uint8Array>} */
async function joined(chunks) {
  const parts = [];
  for await (const chunk of chunks) parts.push(chunk);
  const all = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    all.set(part, at);
    at += part.length;
  }
  return all;
}

/** @type {(chunks: AsyncIterable<Uint8Array>) => Promise<string>} */
const textOf = async chunks => new TextDecoder().decode(await joined(chunks));

/** @type {(chunks: AsyncIterable<Uint8Array>) => AsyncGenerator<string>} */
async function* linesOf(chunks) {
  const decoder = new TextDecoder();
  let rest = "";
  for await (const chunk of chunks) {
    const lines = (rest + decoder.decode(chunk, {stream: true})).split("\n");
    rest = lines.pop() ?? "";
    yield* lines;
  }
}

/**
 * The events of a text/event-stream; one that is cut off is left out.
 * @param {AsyncIterable<Uint8Array>} chunks
 * @returns {AsyncGenerator<Event>}
 */
async function* parseEvents(chunks) {
  /** @type {{[name: string]: string}} */
  let fields = {};
  for await (const line of linesOf(chunks)) {
    const [, name, value] = /^([^:]*):? ?(.*)$/.exec(line) ?? ["", "", ""];
    if (name) {
      fields[name] = value;
    } else if (!line) {
      if (fields.data)
        yield {id: fields.id ?? "", type: /** @type {EventType} */ (fields.event), data: JSON.parse(fields.data)};
      fields = {};
    }
  }
}

/** @type {(status: number, chunks: AsyncIterable<Uint8Array>) => Promise<Problem>} */
async function problemOf(status, chunks) {
  const text = await textOf(chunks);
  let document;
  try {
    document = JSON.parse(text);
  } catch {
    document = null;
  }
  return new Problem(status, document && typeof document === "object" ? document : {detail: text.slice(0, 200)});
}

/** @type {(body: ReadableStream<Uint8Array> | null) => AsyncGenerator<Uint8Array>} */
async function* piecesOf(body) {
  if (!body) return;
  const reader = body.getReader();
  for (let piece = await reader.read(); !piece.done; piece = await reader.read()) yield piece.value;
}

/** @type {(server: string) => Exchange} */
const overFetch = server => async (path, request) => {
  const response = await fetch(server + path, {...request, credentials: "same-origin", cache: "no-store"});
  return {status: response.status, chunks: piecesOf(response.body)};
};

/** @type {(given: {[name: string]: unknown}) => [string, string][]} */
const textsOf = given => Object.entries(given).flatMap(([name, value]) =>
  (value === undefined || value === null ? [] : [[name, String(value)]]));

/** @type {(path: string, query: {[name: string]: unknown}) => string} */
const withQuery = (path, query) => {
  const given = textsOf(query);
  return given.length ? `${path}?${new URLSearchParams(given)}` : path;
};

/**
 * A service.
 * @template {Job} [J=Job]
 */
export class Client {
  /** @param {Options} options */
  constructor({server = globalThis.location?.origin, token, timeout = 60, patience = 60} = {}) {
    if (!/^https?:\/\/[^/]/.test(server ?? ""))
      throw new TypeError(`${server}: a server is http://HOST:PORT or https://HOST:PORT`);
    this.server = server.replace(/\/+$/, "");
    this.token = token?.trim();
    this.timeout = timeout;
    this.patience = patience;
    this.exchange = overFetch(this.server);
  }

  /** @returns {Hasher} */
  hasher() {
    return new Sha256();
  }

  /** A key that no other submission has. crypto.randomUUID needs https. */
  makeKey() {
    return [...crypto.getRandomValues(new Uint8Array(16))].map(byte => byte.toString(16).padStart(2, "0")).join("");
  }

  /** @type {(document: JobDocument | JobSummary) => J} */
  makeJob(document) {
    return /** @type {any} */ (new Job(this, document));
  }

  /**
   * Any request of the OpenAPI document, by its name there. Repeated without an answer, unless that would do something
   * twice.
   * @template {keyof Operations} Name
   * @param {Name} name
   * @param {Operations[Name]["parameters"]} parameters of path, query and header by their names, and the `body`
   * @param {{signal?: AbortSignal}} options
   * @returns {Promise<Operations[Name]["answer"]>}
   */
  async call(name, parameters, {signal} = {}) {
    const {method, path, headers, body, answer} = operations[name];
    /** @type {{[name: string]: any}} */
    const {body: document, ...rest} = parameters;
    const target = path.replace(/\{(\w+)\}/g, (_, part) => encodeURIComponent(rest[part]));
    const sent = headers.map(header => [header, rest[header]]);
    const query = Object.entries(rest).filter(([part]) => !headers.includes(part) && !path.includes(`{${part}}`));
    return this.ask({
      method, path: withQuery(target, Object.fromEntries(query)), signal,
      headers: {Accept: "*/*", ...(body ? {"Content-Type": body} : {}), ...Object.fromEntries(sent)},
      body: body === "application/json" ? JSON.stringify(document) : document,
      repeat: method !== "POST" && method !== "DELETE" || "Idempotency-Key" in rest,
    }, async (status, chunks) => {
      const bytes = await joined(chunks);
      if (status === 204 || status === 304) return null;
      if (answer === "bytes") return bytes;
      const text = new TextDecoder().decode(bytes);
      return answer === "text" ? text : JSON.parse(text);
    });
  }

  /**
   * Submits a job. A spec with a fault is a Problem; its `errors` name the places.
   * @param {Spec} spec
   * @param {{wait?: boolean | number, key?: string, signal?: AbortSignal}} options `wait`: true waits for the end of the job,
   *   as Job.wait does; a number is a limit in seconds. `key`: a name for this submission; when it is repeated, it returns
   *   the same job
   */
  async submit(spec, {wait = false, key = this.makeKey(), signal} = {}) {
    const parameters = {body: /** @type {import("./api.js").JobSpec} */ ({version: 1, ...spec}), "Idempotency-Key": key};
    const job = this.makeJob(await this.call("submitJob", parameters, {signal}));
    if (wait !== false) await job.wait({timeout: wait === true ? undefined : wait, signal});
    return job;
  }

  /** @param {string} id */
  async job(id) {
    return this.makeJob(/** @type {JobDocument} */ (await this.call("getJob", {id})));
  }

  /**
   * The jobs, the newest first.
   * @param {Omit<Operations["listJobs"]["parameters"], "limit" | "cursor">} filters
   */
  async *jobs(filters = {}) {
    /** @type {string | null} */
    let cursor = null;
    do {
      /** @type {import("./api.js").JobPage} */
      const page = await this.call("listJobs", {...filters, limit: PAGE_ROWS, ...(cursor ? {cursor} : {})});
      for (const document of page.jobs) yield this.makeJob(document);
      cursor = page.next;
    } while (cursor !== null);
  }

  /**
   * What happens to the caller's jobs, from now on or after the event with the id `after`; without an end.
   * @param {{after?: string, signal?: AbortSignal} & Omit<Operations["followJobs"]["parameters"], "after" | "limit" |
   *   "Last-Event-ID">} options
   */
  events({after, signal, ...filters} = {}) {
    return this.follow(withQuery("/v1/events", filters), after, false, signal);
  }

  /**
   * Makes bytes readable for jobs; returns the path by which a spec names them. The service may have them already.
   * @param {Uint8Array} bytes
   * @param {string} suffix such as ".obj"
   * @param {boolean} again sends them also if the service has them, and replaces its file if that is damaged
   */
  async upload(bytes, suffix = "", again = false) {
    const hasher = this.hasher();
    hasher.update(bytes);
    const sha256 = hasher.hex();
    let body = bytes;
    try {
      const {path, sent} = await this.call("getInput", {sha256});
      if (sent !== null && !again) return path + suffix;
      if (!again) body = new Uint8Array(); // the service has the file; it becomes an upload of the caller
    } catch (error) {
      if (!(error instanceof Problem && error.code === "not_found")) throw error;
    }
    return (await this.call("putInput", {sha256, body})).path + suffix;
  }

  /** The uploads of the caller, the newest first, with the caller's jobs that read them. */
  async *uploads() {
    /** @type {string | null} */
    let cursor = null;
    do {
      /** @type {import("./api.js").InputPage} */
      const page = await this.call("listInputs", {limit: PAGE_ROWS, ...(cursor ? {cursor} : {})});
      yield* page.inputs;
      cursor = page.next;
    } while (cursor !== null);
  }

  /**
   * Deletes an upload of the caller. Jobs that have not ended can still read it.
   * @param {string} path the path by which a spec names it
   */
  async deleteUpload(path) {
    await this.call("deleteInput", {sha256: path.replace(/^sha256:/, "").replace(/\..*/, "")});
  }

  /**
   * Sends a request once. The caller closes the answer.
   * @param {{method: string, path: string, headers?: {[name: string]: unknown}, body?: string | Uint8Array, signal?: AbortSignal}}
   *   request
   */
  async openOnce({method, path, headers = {}, body, signal}) {
    signal?.throwIfAborted();
    const controller = new AbortController();
    const stop = () => controller.abort();
    /** @type {any} */
    let timer;
    const heard = () => {
      clearTimeout(timer);
      timer = setTimeout(stop, 1000 * this.timeout);
    };
    const close = () => {
      clearTimeout(timer);
      signal?.removeEventListener("abort", stop);
      stop();
    };
    /** @type {(error: unknown) => unknown} */
    const faultOf = error => (signal?.aborted ? signal.reason : new Unreachable(`${this.server}: ${method} ${path}: ${
      controller.signal.aborted ? `no byte in ${this.timeout} s` : error instanceof Error ? error.message : error}`));
    /** @type {(chunks: AsyncIterable<Uint8Array>) => AsyncGenerator<Uint8Array>} */
    const watched = async function* (chunks) {
      try {
        for await (const chunk of chunks) {
          heard();
          yield chunk;
        }
      } catch (error) {
        throw faultOf(error);
      }
    };
    signal?.addEventListener("abort", stop);
    heard();
    try {
      const authorization = this.token ? `Bearer ${this.token}` : undefined;
      const answer = await this.exchange(path, {
        method, body, signal: controller.signal, headers: Object.fromEntries(textsOf({...headers, Authorization: authorization})),
      }).catch(error => Promise.reject(faultOf(error)));
      heard();
      const chunks = watched(answer.chunks);
      if (answer.status >= 300 && answer.status !== 304) throw await problemOf(answer.status, chunks);
      return {status: answer.status, chunks, close};
    } catch (error) {
      close();
      throw error;
    }
  }

  /**
   * What `once` returns. It is repeated while the service refuses it for now or, if `repeat`, does not answer.
   * @template T
   * @param {() => Promise<T>} once
   * @param {boolean} repeat
   * @param {AbortSignal} [signal]
   * @returns {Promise<T>}
   */
  async patiently(once, repeat, signal) {
    const end = Date.now() + 1000 * this.patience;
    for (let pause = FIRST_PAUSE_MS; ; pause = Math.min(2 * pause, LONGEST_PAUSE_MS)) {
      try {
        return await once();
      } catch (error) {
        const isUseful = error instanceof Unreachable ? repeat : error instanceof Problem && LATER.includes(error.code);
        if (!isUseful || Date.now() + pause > end) throw error;
      }
      await sleep(pause, signal);
    }
  }

  /**
   * What `read` makes of the answer to a request.
   * @template T
   * @param {Parameters<Client<any>["openOnce"]>[0] & {repeat?: boolean}} request
   * @param {(status: number, chunks: AsyncIterable<Uint8Array>) => Promise<T>} read
   */
  ask({repeat = true, ...request}, read) {
    return this.patiently(async () => {
      const {status, chunks, close} = await this.openOnce(request);
      try {
        return await read(status, chunks);
      } finally {
        close();
      }
    }, repeat, request.signal);
  }

  /**
   * The events of a stream. When the connection is lost, another one continues after the last event. The stream of one job
   * ends with it; others do not end.
   * @param {string} path
   * @param {string | undefined} last
   * @param {boolean} isOneJob
   * @param {AbortSignal} [signal]
   */
  async *follow(path, last, isOneJob, signal) {
    for (;; await sleep(FIRST_PAUSE_MS, signal)) {
      const headers = {Accept: "text/event-stream", "Last-Event-ID": last};
      const open = () => this.openOnce({method: "GET", path, headers, signal});
      const {status, chunks, close} = await this.patiently(open, true, signal);
      try {
        if (status === 204) return; // nothing more will come
        for await (const event of parseEvents(chunks)) {
          if (event.type !== "progress") last = event.id; // the numbers of progress begin anew when the service is restarted
          if (event.type !== "position" || "removed_up_to" in event.data || "reset" in event.data) yield event;
          if (isOneJob && event.type === "state" && ENDED.includes(event.data.state ?? "")) return;
        }
      } catch (error) {
        if (!(error instanceof Unreachable)) throw error;
      } finally {
        close();
      }
    }
  }
}

/** A job. Its `document` is that of the last look; `refresh` and `wait` look again. */
export class Job {
  /**
   * @param {Client<any>} client
   * @param {JobDocument | JobSummary} document
   */
  constructor(client, document) {
    this.client = client;
    this.document = document;
  }

  get id() {
    return this.document.id;
  }

  get state() {
    return this.document.state;
  }

  /** The outcome of a succeeded job: `converged`, `unresolved` or `not_converged`; else null. */
  get outcome() {
    return this.document.outcome;
  }

  /** Whether `queue.accept` of its spec contains the outcomes of all frames; null: it has not succeeded. */
  get accepted() {
    return this.document.accepted;
  }

  get hasEnded() {
    return ENDED.includes(this.state);
  }

  /** Looks again. */
  async refresh() {
    this.document = /** @type {JobDocument} */ (await this.client.call("getJob", {id: this.id}));
    return this;
  }

  /**
   * Waits until the job has ended. WaitTimeout: it has not in this time. JobFailed: it has no result, if `check`.
   * @param {{timeout?: number, check?: boolean, signal?: AbortSignal}} options `timeout`: in seconds
   */
  async wait({timeout = Infinity, check = true, signal} = {}) {
    const end = Date.now() + 1000 * timeout;
    const step = Math.min(LONGEST_WAIT_S, this.client.timeout / 2);
    while (!this.hasEnded) {
      const left = Math.min(step, (end - Date.now()) / 1000);
      if (left < 0) throw new WaitTimeout(`the wait for job ${this.id} ended after ${timeout} s; the job is ${this.state} and goes on: wait again`);
      const parameters = {id: this.id, Prefer: `wait=${Math.max(1, Math.round(left))}`};
      this.document = /** @type {JobDocument} */ (await this.client.call("getJob", parameters, {signal}));
    }
    if (check && this.state !== "succeeded") throw new JobFailed(this.document);
    return this;
  }

  /**
   * What happens to the job, and its progress, until its end.
   * @param {{after?: string, signal?: AbortSignal}} options `after`: the id of the last event that is known
   */
  events({after, signal} = {}) {
    return this.client.follow(`/v1/jobs/${this.id}/events`, after, true, signal);
  }

  /** Ends it. Problem `conflict`: it has ended otherwise. */
  async cancel() {
    try {
      this.document = await this.client.call("cancelJob", {id: this.id});
    } catch (error) {
      if (!(error instanceof Problem && error.code === "conflict") || (await this.refresh()).state !== "cancelled") throw error;
    }
    return this;
  }

  /** The frames that have results; of a job without frames `undefined`, once it has some. */
  async frames() {
    if (!this.document.array) return [undefined];
    const frames = [];
    /** @type {number | null} */
    let after = null;
    do {
      /** @type {import("./api.js").TaskPage} */
      const page = await this.client.call("listTasks", {id: this.id, limit: PAGE_ROWS, ...(after === null ? {} : {after})});
      frames.push(...page.tasks.filter(({state}) => state === "succeeded").map(({frame}) => frame));
      after = page.next;
    } while (after !== null);
    return frames;
  }

  /**
   * The files of a result.
   * @param {number} [frame]
   */
  async results(frame) {
    return (await this.client.call("listResults", {id: this.id, ...(frame === undefined ? {} : {frame})})).results;
  }

  /**
   * Gives the bytes of a file to `take`, in pieces, and verifies them by their hash. `begin` is called before the first
   * piece, and again if the connection was lost.
   * @param {Result} result
   * @param {number | undefined} frame
   * @param {() => Promise<void>} begin
   * @param {(chunk: Uint8Array) => Promise<void>} take
   */
  receive({name, sha256}, frame, begin, take) {
    const path = withQuery(`/v1/jobs/${this.id}/results/${encodeURIComponent(name)}`, {frame});
    return this.client.ask({method: "GET", path}, async (_, chunks) => {
      const hasher = this.client.hasher();
      await begin();
      for await (const chunk of chunks) {
        hasher.update(chunk);
        await take(chunk);
      }
      if (hasher.hex() !== sha256)
        throw new Damaged(`${name}: the received bytes do not have the SHA-256 that the service states: the file is damaged in the service, `
          + "or on the way. Submit the job again, which computes it again; to fetch it again helps only against damage on the way.");
    });
  }

  /**
   * The bytes of one file of a result, verified by their hash.
   * @param {string} name
   * @param {number} [frame]
   */
  async read(name, frame) {
    const result = (await this.results(frame)).find(found => found.name === name);
    if (!result) throw new HexadError(`job ${this.id} has no result ${name}: results() lists its files`);
    const bytes = new Uint8Array(result.bytes);
    let at = 0;
    await this.receive(result, frame, async () => {
      at = 0;
    }, async chunk => {
      if (at + chunk.length <= bytes.length) bytes.set(chunk, at);
      at += chunk.length;
    });
    return bytes;
  }

  /**
   * report.json: how good the points are.
   * @param {number} [frame]
   * @returns {Promise<any>}
   */
  async report(frame) {
    return JSON.parse(new TextDecoder().decode(await this.read("report.json", frame)));
  }
}
