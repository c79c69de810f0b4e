// SPDX-License-Identifier: Apache-2.0
// The client for Node: over Unix sockets too, with results as files.
import {createHash, randomUUID} from "node:crypto";
import {createReadStream} from "node:fs";
import {mkdir, open, rename, rm, stat} from "node:fs/promises";
import http from "node:http";
import https from "node:https";
import {join} from "node:path";
import {Client as WebClient, HexadError, Job as WebJob} from "./hexad.js";

export {Damaged, HexadError, JobFailed, Problem, Unreachable, WaitTimeout} from "./hexad.js";

/** @typedef {import("./hexad.js").Spec} Spec */
/** @typedef {import("./hexad.js").Event} Event */
/** @typedef {import("./hexad.js").Result} Result */
/** @typedef {import("./hexad.js").Options} Options */

const DEFAULT_SERVER = "unix:/run/hexad/hexad.sock";
let files = 0; // for names of files that are being written

/** @type {(server: string) => import("./hexad.js").Exchange} */
const overNode = server => (path, {method, headers, body, signal}) => new Promise((resolve, reject) => {
  const {request} = server.startsWith("https:") ? https : http;
  const options = {method, headers, signal, agent: false};
  const sent = server.startsWith("unix:") ? request({...options, socketPath: server.slice("unix:".length), path, host: "hexad"})
    : request(new URL(server + path), options);
  sent.on("response", answer => resolve({status: answer.statusCode ?? 0, chunks: answer}));
  sent.on("error", reject);
  sent.end(body);
});

/** @param {string} path */
async function hashFile(path) {
  const hash = createHash("sha256");
  for await (const chunk of createReadStream(path)) hash.update(chunk);
  return hash.digest("hex");
}

/**
 * A service.
 * @extends {WebClient<Job>}
 */
export class Client extends WebClient {
  /**
   * @param {Options} options `server`: unix:PATH too; by default HEXAD_SERVER, or the socket of the system's service.
   *   `token`: by default HEXAD_TOKEN
   */
  constructor({server = process.env.HEXAD_SERVER || DEFAULT_SERVER, token = process.env.HEXAD_TOKEN, ...rest} = {}) {
    if (!/^(unix:\/|https?:\/\/[^/])/.test(server))
      throw new TypeError(`${server}: a server is unix:PATH, http://HOST:PORT or https://HOST:PORT`);
    super({server: server.startsWith("unix:") ? "http://hexad" : server, token, ...rest});
    if (server.startsWith("unix:")) this.server = server;
    this.exchange = overNode(this.server);
  }

  /** @returns {import("./hexad.js").Hasher} */
  hasher() {
    const hash = createHash("sha256");
    return {update: bytes => void hash.update(bytes), hex: () => hash.digest("hex")};
  }

  makeKey() {
    return randomUUID();
  }

  /** @type {(document: import("./api.js").Job | import("./api.js").JobSummary) => Job} */
  makeJob(document) {
    return new Job(this, document);
  }
}

/** A job. */
export class Job extends WebJob {
  /**
   * Brings all files of a result here, each verified by its hash, report.json last; returns their paths. Frames go into
   * directories of their own below, and the USD stage of all frames into the directory itself; files that are here already are
   * not brought again.
   * @param {string} directory
   * @param {number} [frame] only this one
   */
  async fetch(directory, frame) {
    const paths = [];
    for (const each of frame === undefined ? await this.frames() : [frame]) {
      const place = each === undefined ? directory : join(directory, String(each));
      await mkdir(place, {recursive: true});
      for (const result of await this.results(each)) {
        if (result.name.startsWith(".") || /[/\\]/.test(result.name))
          throw new HexadError(`job ${this.id} has a result whose name contains a path, ${JSON.stringify(result.name)}: report this as a fault`);
        const path = join(result.name.endsWith("_stage.usda") ? directory : place, result.name);
        await this.fetchFile(result, path, each);
        paths.push(path);
      }
    }
    return paths;
  }

  /**
   * Brings one file here, verified by its hash, unless it is here. It has a temporary name until it is whole.
   * @param {Result} result
   * @param {string} path
   * @param {number} [frame]
   */
  async fetchFile(result, path, frame) {
    const found = await stat(path).catch(() => null);
    if (found?.isFile() && found.size === result.bytes && await hashFile(path) === result.sha256) {
      // the service keeps undelivered results longer, so it is notified of a file that is here already
      await this.client.call("getResult", {
        id: this.id, name: result.name, ...(frame === undefined ? {} : {frame}), "If-None-Match": `"${result.sha256}"`});
      return;
    }
    const part = `${path}.${process.pid}.${++files}`;
    const file = await open(part, "w");
    try {
      await this.receive(result, frame, () => file.truncate(0), async chunk => {
        await file.writeFile(chunk);
      });
      await file.close();
      await rename(part, path);
    } catch (error) {
      await file.close().catch(() => {});
      await rm(part, {force: true});
      throw error;
    }
  }
}
