// SPDX-License-Identifier: Apache-2.0
/**
 * A service.
 * @extends {WebClient<Job>}
 */
export class Client extends WebClient<Job> {
    /**
     * @param {Options} options `server`: unix:PATH too; by default HEXAD_SERVER, or the socket of the system's service.
     *   `token`: by default HEXAD_TOKEN
     */
    constructor({ server, token, ...rest }?: Options);
}
/** A job. */
export class Job extends WebJob {
    /**
     * Brings all files of a result here, each verified by its hash, report.json last; returns their paths. Frames go into
     * directories of their own below; files that are here already are not brought again.
     * @param {string} directory
     * @param {number} [frame] only this one
     */
    fetch(directory: string, frame?: number | undefined): Promise<string[]>;
    /**
     * Brings one file here, verified by its hash, unless it is here. It has a temporary name until it is whole.
     * @param {Result} result
     * @param {string} path
     * @param {number} [frame]
     */
    fetchFile(result: Result, path: string, frame?: number | undefined): Promise<void>;
}
export type Spec = import("./hexad.js").Spec;
export type Event = import("./hexad.js").Event;
export type Result = import("./hexad.js").Result;
export type Options = import("./hexad.js").Options;
import { Client as WebClient } from "./hexad.js";
import { Job as WebJob } from "./hexad.js";
export { Damaged, HexadError, JobFailed, Problem, Unreachable, WaitTimeout } from "./hexad.js";
