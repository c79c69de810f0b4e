// SPDX-License-Identifier: Apache-2.0
// The types find mistakes: tsc expects an error in each line behind a @ts-expect-error, and none elsewhere.
import {Client, type Spec} from "hexad";
import type {JobSpec} from "hexad/api";

const good: Spec = {
  surface: {union: [{analytic: {shape: "sphere", radius: 1}}, {vdb: {path: "a.vdb"}}]},
  sampling: {count: 100}, queue: {by_frame: {"/solver/seed": {from: 1, to: 2}}},
};
// @ts-expect-error
const text: Spec = {surface: {union: [{analytic: {shape: "sphere", radius: "1"}}]}, sampling: {}};
// @ts-expect-error
const misspelt: Spec = {surface: {vdb: {path: "a.vdb"}}, sampling: {cuont: 100}};
// @ts-expect-error
const word: Spec = {...good, solver: {method: "newton"}};
// @ts-expect-error
const incomplete: JobSpec = {version: 1, surface: {mesh: {resolution: 64}}, sampling: {}};

export async function main() {
  const client = new Client({server: "unix:/run/hexad/hexad.sock"});
  const job = await client.submit(good, {wait: 60});
  const paths: string[] = await job.fetch("out");
  const bytes: Uint8Array = await job.read("points.ply");
  const spec = (await client.call("getJob", {id: job.id}))?.spec;
  const same: JobSpec | null | undefined = spec; // what is answered may be sent
  for await (const {data} of job.events()) if (data.state === "succeeded") break;
  // @ts-expect-error
  if (job.outcome === "good") return;
  // @ts-expect-error
  await client.call("getJob", {});
  // @ts-expect-error
  await client.call("getJobs", {});
  for await (const found of client.jobs({state: ["failed", "timed_out"]})) await found.fetch("failed");
  return [paths, bytes, same, text, misspelt, word, incomplete];
}
