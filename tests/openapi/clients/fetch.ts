// A client of openapi-typescript and openapi-fetch: submits, waits and fetches.
import createClient from "openapi-fetch";
import {createHash} from "node:crypto";
import type {components, paths} from "./schema";

type JobSpec = components["schemas"]["JobSpec"];

const client = createClient<paths>({baseUrl: process.argv[2] ?? ""});

/** Nothing is demanded that has a default. */
const spec: JobSpec = {
  version: 1,
  surface: {union: [{analytic: {shape: "sphere", radius: 1}}, {analytic: {shape: "sphere", center: [4, 0, 0], radius: 1}}]},
  sampling: {count: 300},
  output: {preview: false},
};

// @ts-expect-error: a shape that there is not
const wrong: JobSpec = {...spec, surface: {analytic: {shape: "cube", radius: 1}}};

function need<Data>({data, error}: {data?: Data; error?: unknown}): Data {
  if (data === undefined) throw new Error(JSON.stringify(error));
  return data;
}

async function main(): Promise<void> {
  const header = {"Idempotency-Key": "fetch"};
  let job = need(await client.POST("/v1/jobs", {params: {header}, body: spec}));
  const again = need(await client.POST("/v1/jobs", {params: {header}, body: spec}));
  while (["queued", "blocked", "running"].includes(job.state))
    job = need(await client.GET("/v1/jobs/{id}", {params: {path: {id: job.id}, header: {Prefer: "wait=30"}}}));
  const same: JobSpec | null = job.spec; // what is answered may be sent
  const {results} = need(await client.GET("/v1/jobs/{id}/results", {params: {path: {id: job.id}}}));
  const hashes: string[] = [];
  for (const {name} of results) {
    const path = {id: job.id, name};
    const file = need(await client.GET("/v1/jobs/{id}/results/{name}", {params: {path}, parseAs: "arrayBuffer"}));
    hashes.push(createHash("sha256").update(Buffer.from(file as ArrayBuffer)).digest("hex"));
  }
  const refused = await client.POST("/v1/jobs", {body: wrong});
  console.log(JSON.stringify({
    same_job: again.id === job.id, outcome: job.outcome, sphere: same?.surface.union?.[0]?.analytic,
    names: results.map(({name}) => name), whole: results.every(({sha256}, i) => sha256 === hashes[i]), code: refused.error?.code,
  }));
}

main().catch(error => {
  console.error(error);
  process.exitCode = 1;
});
