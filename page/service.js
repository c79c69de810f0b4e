// SPDX-License-Identifier: Apache-2.0
// For administrators: what each user holds and uses, what runs on each host, and the tokens.
import {html, useEffect, useState} from "./preact.js";
import {get} from "./api.js";
import {Trouble, useTitle} from "./parts.js";
import {bytesOf, countOf} from "./words.js";

const READ_MS = 5000;

const limited = (value, limit, show) => `${show(value)}${limit === null ? "" : ` of ${show(limit)}`}`;

/** Users of results and of running attempts: {user, results, bytes, upload_bytes, attempts, threads, memory_mb}. */
function usersOf({users}, workers) {
  const all = new Map(users.map(user => [user.user, {...user, attempts: 0, threads: 0, memory_mb: 0}]));
  for (const {owner, threads, memory_mb} of workers) {
    const user = all.get(owner) || {user: owner, results: 0, results_limit: null, bytes: 0, bytes_limit: null, upload_bytes: null, upload_bytes_limit: null, attempts: 0, threads: 0, memory_mb: 0};
    all.set(owner, {...user, attempts: user.attempts + 1, threads: user.threads + threads, memory_mb: user.memory_mb + memory_mb});
  }
  return [...all.values()];
}

/** Hosts of running attempts: {host, attempts, threads, memory_mb}. */
function hostsOf(workers) {
  const all = new Map();
  for (const {host, threads, memory_mb} of workers) {
    const sums = all.get(host) || {host, attempts: 0, threads: 0, memory_mb: 0};
    all.set(host, {host, attempts: sums.attempts + 1, threads: sums.threads + threads, memory_mb: sums.memory_mb + memory_mb});
  }
  return [...all.values()].sort((a, b) => (a.host ?? "\uffff").localeCompare(b.host ?? "\uffff"));
}

export function Service() {
  const [found, setFound] = useState(null);
  const [error, setError] = useState(null);
  useTitle("Service");
  useEffect(() => {
    const read = () => document.hidden || Promise.all([get("v1/usage"), get("v1/workers"), get("v1/tokens")]).then(([usage, {workers}, {tokens}]) => {
      setFound({usage, workers, tokens});
      setError(null);
    }, setError);
    read();
    const timer = setInterval(read, READ_MS);
    return () => clearInterval(timer);
  }, []);
  const row = ({user, results, results_limit: most, bytes, bytes_limit: limit, upload_bytes: uploads, upload_bytes_limit: uploadLimit, attempts, threads, memory_mb: memory}) => html`<tr><td>${user}</td>
    <td class="number">${countOf(attempts)}</td><td class="number">${countOf(threads)}</td><td class="number">${bytesOf(memory * 2 ** 20)}</td>
    <td class="number">${limited(results, most, countOf)}</td><td class="number">${limited(bytes, limit, bytesOf)}</td>
    <td class="number">${limited(uploads, uploadLimit, bytesOf)}</td>
    <td><a href=${`#/?owner=${encodeURIComponent(user)}`}>Jobs</a></td></tr>`;
  const hostRow = ({host, attempts, threads, memory_mb: memory}) => html`<tr><td>${host ?? html`<span class="dim">not known yet</span>`}</td>
    <td class="number">${countOf(attempts)}</td><td class="number">${countOf(threads)}</td><td class="number">${bytesOf(memory * 2 ** 20)}</td></tr>`;
  const tokenRow = ({id, user, scopes, created, max_priority: most}) => html`<tr><td>${user}</td><td>${scopes.join(", ")}</td>
    <td class="number">${most ?? "any"}</td><td>${created.slice(0, 10)}</td><td><code>${id}</code></td></tr>`;
  return html`<h1>Service</h1><${Trouble} error=${error} />
    ${!found ? !error && html`<p class="loading" role="status">Loading …</p>` : html`
      ${found.usage.full && html`<p class="notice">The results of all jobs have reached a limit: submissions are refused. Download or delete results.</p>`}
      <h2>Users</h2><div class="scroll" tabindex="0" role="region" aria-label="Users"><table class="users"><thead><tr><th scope="col">User</th>
        <th scope="col" class="number">Running</th><th scope="col" class="number">Threads</th><th scope="col" class="number">Memory</th>
        <th scope="col" class="number">Results</th><th scope="col" class="number">Disk</th><th scope="col" class="number">Uploads</th><th scope="col"><span class="hidden">Jobs</span></th></tr></thead>
        <tbody>${usersOf(found.usage, found.workers).map(row)}</tbody></table></div>
      <p class="hint">Results of all users: ${limited(found.usage.all.results, found.usage.all.results_limit, countOf)}; ${limited(found.usage.all.bytes, found.usage.all.bytes_limit, bytesOf)}. Uploads: ${limited(found.usage.all.upload_bytes, found.usage.all.upload_bytes_limit, bytesOf)}.</p>
      <h2>Hosts</h2>${found.workers.length === 0 ? html`<p class="dim">Nothing runs.</p>` : html`<div class="scroll" tabindex="0" role="region" aria-label="Hosts"><table class="hosts"><thead><tr>
        <th scope="col">Host</th><th scope="col" class="number">Running</th><th scope="col" class="number">Threads</th><th scope="col" class="number">Memory</th></tr></thead>
        <tbody>${hostsOf(found.workers).map(hostRow)}</tbody></table></div>`}
      <h2>Tokens</h2>${found.tokens.length === 0 ? html`<p class="dim">There are none.</p>` : html`<div class="scroll" tabindex="0" role="region" aria-label="Tokens"><table class="tokens"><thead><tr>
        <th scope="col">User</th><th scope="col">Permissions</th><th scope="col" class="number">Highest priority</th><th scope="col">Created</th><th scope="col">ID</th></tr></thead>
        <tbody>${found.tokens.map(tokenRow)}</tbody></table></div>
      <p class="hint"><code>hexadctl token add USER</code> creates one, and <code>hexadctl token revoke ID</code> revokes one.</p>`}`}`;
}
