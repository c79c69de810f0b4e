// SPDX-License-Identifier: Apache-2.0
// Submits, follows, waits and fetches as users do, in Node and in a browser. It returns what the test compares.
const sphere = (count, rest) => ({
  surface: {union: [{analytic: {shape: "sphere", radius: 1}}, {analytic: {shape: "sphere", center: [4, 0, 0], radius: 1}}]},
  sampling: {count}, output: {preview: false}, ...rest,
});

async function codeOf(promise) {
  try {
    await promise;
  } catch (error) {
    return `${error.name} ${error.code} ${error.errors?.[0]?.pointer ?? ""}`.trim();
  }
  return "none";
}

export async function session({Client}, options, label) {
  const client = new Client(options);
  const labelled = {queue: {labels: [label]}};
  const job = await client.submit(sphere(300, labelled), {key: `key ${label}`});
  const again = await client.submit(sphere(300, labelled), {key: `key ${label}`});
  const states = [];
  for await (const {type, data} of job.events()) if (type === "state") states.push(data.state);
  await job.wait();
  const found = [];
  for await (const each of client.jobs({label, state: ["succeeded", "failed"]})) found.push(each.id);
  const bytes = await job.read("points.ply");
  const path = await client.upload(new TextEncoder().encode(`a file of ${label}`), ".obj");
  const failed = await client.submit({surface: {mesh: {path}}, sampling: {count: 100}});
  const later = await client.submit(sphere(310, {queue: {labels: [`late ${label}`]}}));
  await later.cancel();
  return {
    same: again.id === job.id, ended: states.at(-1), outcome: job.outcome, found: found.length === 1 && found[0] === job.id,
    count: (await job.report()).count, head: new TextDecoder().decode(bytes.subarray(0, 4)), names: (await job.results()).map(r => r.name),
    sphere: (await client.call("getJob", {id: job.id})).spec.surface.union[0].analytic, path: /^[^ ]+\.obj$/.test(path),
    refused: await codeOf(client.submit(sphere(-1))), failed: await codeOf(failed.wait()), missing: await codeOf(client.job("0".repeat(26))),
    none: await codeOf(job.read("none.ply")), cancelled: (await later.wait({check: false})).state,
    version: typeof (await client.call("getVersion", {})).version, log: typeof (await client.call("getLog", {id: job.id})),
  };
}
