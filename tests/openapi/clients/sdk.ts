// A client of @hey-api/openapi-ts: submits, waits and fetches.
import {createHash} from "node:crypto";
import {getJob, getResult, listResults, submitJob, type JobSpec} from "./generated";
import {client} from "./generated/client.gen";

client.setConfig({baseUrl: process.argv[2] ?? ""});

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
  const headers = {"Idempotency-Key": "sdk"};
  let job = need(await submitJob({body: spec, headers}));
  const again = need(await submitJob({body: spec, headers}));
  while (["queued", "blocked", "running"].includes(job.state))
    job = need(await getJob({path: {id: job.id}, headers: {Prefer: "wait=30"}}));
  const same: JobSpec | null = job.spec; // what is answered may be sent
  const {results} = need(await listResults({path: {id: job.id}}));
  const hashes: string[] = [];
  for (const {name} of results) {
    const file = need(await getResult({path: {id: job.id, name}, parseAs: "arrayBuffer"}));
    hashes.push(createHash("sha256").update(Buffer.from(file as ArrayBuffer)).digest("hex"));
  }
  const refused = await submitJob({body: wrong});
  console.log(JSON.stringify({
    same_job: again.id === job.id, outcome: job.outcome, sphere: same?.surface.union?.[0]?.analytic,
    names: results.map(({name}) => name), whole: results.every(({sha256}, i) => sha256 === hashes[i]), code: refused.error?.code,
  }));
}

main().catch(error => {
  console.error(error);
  process.exitCode = 1;
});
