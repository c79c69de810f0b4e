// SPDX-License-Identifier: Apache-2.0
/** Any fault that this module finds. */
export class HexadError extends Error {
    /** @param {string} message */
    constructor(message: string);
}
/** There was no answer within `patience` seconds. */
export class Unreachable extends HexadError {
}
/** The bytes of a file do not have the hash that was announced. */
export class Damaged extends HexadError {
}
/** A job has not ended in the time that a caller wanted to wait. */
export class WaitTimeout extends HexadError {
}
/** The service refuses a request. */
export class Problem extends HexadError {
    /**
     * @param {number} status
     * @param {{code?: string, title?: string, detail?: string, errors?: Fault[]}} document
     */
    constructor(status: number, document: {
        code?: string | undefined;
        title?: string | undefined;
        detail?: string | undefined;
        errors?: Fault[] | undefined;
    });
    status: number;
    /** What is wrong, in a word that does not change. */
    code: "unknown" | import("./api.js").ProblemCode;
    /** What is wrong here, and what to do. */
    detail: string;
    /** The faults of a spec. */
    errors: Fault[];
}
/** A job has ended without a result. */
export class JobFailed extends HexadError {
    /** @param {JobSummary} document */
    constructor({ id, state, error }: JobSummary);
    job: string;
    state: import("./api.js").State;
    /** The code of its error, such as `no_surface`; null: it was cancelled before it ran. */
    code: string | null;
}
/**
 * A service.
 * @template {Job} [J=Job]
 */
export class Client<J extends Job = Job> {
    /** @param {Options} options */
    constructor({ server, token, timeout, patience }?: Options);
    server: string;
    token: string | undefined;
    timeout: number;
    patience: number;
    exchange: Exchange;
    /** @returns {Hasher} */
    hasher(): Hasher;
    /** A key that no other submission has. crypto.randomUUID needs https. */
    makeKey(): string;
    /** @type {(document: JobDocument | JobSummary) => J} */
    makeJob(document: import("./api.js").JobSummary | import("./api.js").Job): J;
    /**
     * Any request of the OpenAPI document, by its name there. Repeated without an answer, unless that would do something
     * twice.
     * @template {keyof Operations} Name
     * @param {Name} name
     * @param {Operations[Name]["parameters"]} parameters of path, query and header by their names, and the `body`
     * @param {{signal?: AbortSignal}} options
     * @returns {Promise<Operations[Name]["answer"]>}
     */
    call<Name extends keyof import("./api.js").Operations>(name: Name, parameters: import("./api.js").Operations[Name]["parameters"], { signal }?: {
        signal?: AbortSignal | undefined;
    }): Promise<import("./api.js").Operations[Name]["answer"]>;
    /**
     * Submits a job. A spec with a fault is a Problem; its `errors` name the places.
     * @param {Spec} spec
     * @param {{wait?: boolean | number, key?: string, signal?: AbortSignal}} options `wait`: true waits for the end of the job,
     *   as Job.wait does; a number is a limit in seconds. `key`: a name for this submission; when it is repeated, it returns
     *   the same job
     */
    submit(spec: Spec, { wait, key, signal }?: {
        wait?: boolean | number;
        key?: string;
        signal?: AbortSignal;
    }): Promise<J>;
    /** @param {string} id */
    job(id: string): Promise<J>;
    /**
     * The jobs, the newest first.
     * @param {Omit<Operations["listJobs"]["parameters"], "limit" | "cursor">} filters
     */
    jobs(filters?: Omit<Operations["listJobs"]["parameters"], "limit" | "cursor">): AsyncGenerator<J, void, unknown>;
    /**
     * What happens to the caller's jobs, from now on or after the event with the id `after`; without an end.
     * @param {{after?: string, signal?: AbortSignal} & Omit<Operations["followJobs"]["parameters"], "after" | "limit" |
     *   "Last-Event-ID">} options
     */
    events({ after, signal, ...filters }?: {
        after?: string;
        signal?: AbortSignal;
    } & Omit<Operations["followJobs"]["parameters"], "after" | "limit" | "Last-Event-ID">): AsyncGenerator<Event, void, unknown>;
    /**
     * Makes bytes readable for jobs; returns the path by which a spec names them. The service may have them already.
     * @param {Uint8Array} bytes
     * @param {string} suffix such as ".obj"
     * @param {boolean} again sends them also if the service has them, and replaces its file if that is damaged
     */
    upload(bytes: Uint8Array, suffix?: string, again?: boolean): Promise<string>;
    /** The uploads of the caller, the newest first, with the caller's jobs that read them. */
    uploads(): AsyncGenerator<import("./api.js").Input & {
        used: string | null;
        jobs: string[];
        job_count: number;
        unfinished_count: number;
    }, void, undefined>;
    /**
     * Deletes an upload of the caller. Jobs that have not ended can still read it.
     * @param {string} path the path by which a spec names it
     */
    deleteUpload(path: string): Promise<void>;
    /**
     * Sends a request once. The caller closes the answer.
     * @param {{method: string, path: string, headers?: {[name: string]: unknown}, body?: string | Uint8Array, signal?: AbortSignal}}
     *   request
     */
    openOnce({ method, path, headers, body, signal }: {
        method: string;
        path: string;
        headers?: {
            [name: string]: unknown;
        } | undefined;
        body?: string | Uint8Array | undefined;
        signal?: AbortSignal | undefined;
    }): Promise<{
        status: number;
        chunks: AsyncGenerator<Uint8Array, any, any>;
        close: () => void;
    }>;
    /**
     * What `once` returns. It is repeated while the service refuses it for now or, if `repeat`, does not answer.
     * @template T
     * @param {() => Promise<T>} once
     * @param {boolean} repeat
     * @param {AbortSignal} [signal]
     * @returns {Promise<T>}
     */
    patiently<T>(once: () => Promise<T>, repeat: boolean, signal?: AbortSignal | undefined): Promise<T>;
    /**
     * What `read` makes of the answer to a request.
     * @template T
     * @param {Parameters<Client<any>["openOnce"]>[0] & {repeat?: boolean}} request
     * @param {(status: number, chunks: AsyncIterable<Uint8Array>) => Promise<T>} read
     */
    ask<T_1>({ repeat, ...request }: {
        method: string;
        path: string;
        headers?: {
            [name: string]: unknown;
        } | undefined;
        body?: string | Uint8Array | undefined;
        signal?: AbortSignal | undefined;
    } & {
        repeat?: boolean | undefined;
    }, read: (status: number, chunks: AsyncIterable<Uint8Array>) => Promise<T_1>): Promise<T_1>;
    /**
     * The events of a stream. When the connection is lost, another one continues after the last event. The stream of one job
     * ends with it; others do not end.
     * @param {string} path
     * @param {string | undefined} last
     * @param {boolean} isOneJob
     * @param {AbortSignal} [signal]
     */
    follow(path: string, last: string | undefined, isOneJob: boolean, signal?: AbortSignal | undefined): AsyncGenerator<Event, void, unknown>;
}
/** A job. Its `document` is that of the last look; `refresh` and `wait` look again. */
export class Job {
    /**
     * @param {Client<any>} client
     * @param {JobDocument | JobSummary} document
     */
    constructor(client: Client<any>, document: JobDocument | JobSummary);
    client: Client<any>;
    document: import("./api.js").JobSummary | import("./api.js").Job;
    get id(): string;
    get state(): import("./api.js").State;
    /** The outcome of a succeeded job: `converged`, `unresolved` or `not_converged`; else null. */
    get outcome(): import("./api.js").Outcome;
    /** Whether `queue.accept` of its spec contains the outcomes of all frames; null: it has not succeeded. */
    get accepted(): boolean | null;
    get hasEnded(): boolean;
    /** Looks again. */
    refresh(): Promise<Job>;
    /**
     * Waits until the job has ended. WaitTimeout: it has not in this time. JobFailed: it has no result, if `check`.
     * @param {{timeout?: number, check?: boolean, signal?: AbortSignal}} options `timeout`: in seconds
     */
    wait({ timeout, check, signal }?: {
        timeout?: number;
        check?: boolean;
        signal?: AbortSignal;
    }): Promise<Job>;
    /**
     * What happens to the job, and its progress, until its end.
     * @param {{after?: string, signal?: AbortSignal}} options `after`: the id of the last event that is known
     */
    events({ after, signal }?: {
        after?: string;
        signal?: AbortSignal;
    }): AsyncGenerator<Event, void, unknown>;
    /** Ends it. Problem `conflict`: it has ended otherwise. */
    cancel(): Promise<Job>;
    /** The frames that have results; of a job without frames `undefined`, once it has some. */
    frames(): Promise<(number | undefined)[]>;
    /**
     * The files of a result.
     * @param {number} [frame]
     */
    results(frame?: number | undefined): Promise<{
        name: string;
        bytes: number;
        sha256: string;
        content_type: string;
        href: string;
    }[]>;
    /**
     * Gives the bytes of a file to `take`, in pieces, and verifies them by their hash. `begin` is called before the first
     * piece, and again if the connection was lost.
     * @param {Result} result
     * @param {number | undefined} frame
     * @param {() => Promise<void>} begin
     * @param {(chunk: Uint8Array) => Promise<void>} take
     */
    receive({ name, sha256 }: Result, frame: number | undefined, begin: () => Promise<void>, take: (chunk: Uint8Array) => Promise<void>): Promise<void>;
    /**
     * The bytes of one file of a result, verified by their hash.
     * @param {string} name
     * @param {number} [frame]
     */
    read(name: string, frame?: number | undefined): Promise<Uint8Array>;
    /**
     * report.json: how good the points are.
     * @param {number} [frame]
     * @returns {Promise<any>}
     */
    report(frame?: number | undefined): Promise<any>;
}
export type Operations = import("./api.js").Operations;
export type JobDocument = import("./api.js").Job;
export type JobSummary = import("./api.js").JobSummary;
/**
 * a file of a result: `name`, `bytes`, `sha256`
 */
export type Result = import("./api.js").Results["results"][number];
export type Spec = Omit<import("./api.js").JobSpec, "version"> & {
    version?: 1;
};
/**
 * a place in a spec, and what is wrong there
 */
export type Fault = {
    pointer: string;
    detail: string;
};
export type EventType = "state" | "task" | "started" | "ended" | "edited" | "progress" | "position";
/**
 * What has happened to a job.
 */
export type Event = {
    /**
     * where a stream may continue; empty: nowhere
     */
    id: string;
    /**
     * `position` says that events are missing (`data`: why)
     */
    type: EventType;
    data: Partial<import("./api.js").Event> & {
        progress?: import("./api.js").Progress | undefined;
    } & {
        [name: string]: unknown;
    };
};
export type Request = {
    method: string;
    headers: {
        [name: string]: string;
    };
    body?: string | Uint8Array | undefined;
    signal: AbortSignal;
};
export type Answer = {
    status: number;
    chunks: AsyncIterable<Uint8Array>;
};
/**
 * SHA-256 in pieces
 */
export type Hasher = {
    update: (bytes: Uint8Array) => void;
    hex: () => string;
};
/**
 * one request; it rejects if the connection is lost
 */
export type Exchange = (path: string, request: Request) => Promise<Answer>;
export type Options = {
    /**
     * the address, such as http://HOST:8642; in a page by default its own origin
     */
    server?: string | undefined;
    /**
     * for TCP. A page that has signed in needs none
     */
    token?: string | undefined;
    /**
     * seconds without a byte after which a connection is given up; default 60
     */
    timeout?: number | undefined;
    /**
     * seconds for which a request without an answer is repeated; default 60. A submission has a
     * key, so that there is one job
     */
    patience?: number | undefined;
};
