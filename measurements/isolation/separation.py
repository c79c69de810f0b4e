#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Whether a user gets to see what another user put into jobs.

    measurements/isolation/separation.py --built BUILD [--operations 10000] [--seed 1] [--place DIRECTORY] [--output FILE.csv]

Two accounts, ann and ben, do what the OpenAPI document offers, in random order; half of it after a restart of the daemon. What ann puts
into values of specs, paths, webhooks, output directories, uploads, logs, error messages, progress and results has a marker, of letters or
of digits. Names and labels, which every reader may see (doc/http.md), have a marker of another kind. Every answer with
its headers, event stream, webhook call and file that ben gets is searched for both, and each JSON of ben's for ids of ann's jobs. Specs are
never equal, but for pairs: there, ben gets the same points and a report with ben's own spec. Threads run the operations, so the seed gives
the same operations, but in another order.

Relations: jobs of ben wait for jobs of ann that end in every way, and jobs of ann for ben's. What hexad then says to ben must be the same
text for all jobs of ann that did not succeed as required, and for all whose frames ben's job cannot wait for.

Prints the results; --output has a row for each run, and the row of this run is written there. Ends with 1 when ben found a marker, or when ann did not find it where it must be.
"""
import argparse
import collections
import hashlib
import http.client
import http.server
import json
import pathlib
import random
import re
import sys
import tempfile
import threading
import time
import traceback

from isolation import Client, Daemon, User, ball, results

SECRET = re.compile(rb"mkr7x\w*|86753091\d+", re.I)
COLUMNS = ["run", "operations", "seed", "searched_mb", "leaks", "pairs_of_equal_specs", "pairs_from_the_cache"]
PUBLIC = re.compile(rb"pub7x\w*", re.I)
PUBLIC_KEYS = ("name", "labels", "next")  # a cursor of a list sorted by name has a name
THREADS = {"ann": 2, "ben": 4}
SCOPES = ("read", "submit", "cancel")
PATIENCE_S = 120
PLACES = ("submitJob", "getJob", "of stub", "of path", "of out", "of hook", "webhook")  # where ann finds markers
ENOUGH = 2000  # operations, for each of these
PAIRS = 0.02  # of the operations; and as many relations
RELATIONS = ("depends_on", "after", "after_frames", "retry")
FRAMES = "867530914-867530916"  # of arrays of ann
ID = re.compile(r"\b01[0-9a-z]{24}\b")
OFF = "OFF\n# {}\n4 4 0\n1 1 1\n1 -1 -1\n-1 1 -1\n-1 -1 1\n3 0 1 2\n3 0 3 1\n3 0 2 3\n3 1 3 2\n"

# The real worker, but for jobs of certain names: their spec goes into the results, the log, the progress, and the error message.
WORKER = """#!/bin/sh
[ "$1" = run ] || exec %(real)s "$@"
spec=$(cat)
case "$spec" in
*stub-result*|*stub-unresolved*|*stub-failure*) ;;
*) printf %%s "$spec" | %(real)s "$@"; exit $?;;
esac
marker=$(printf %%s "$spec" | grep -o 'Mkr7x[0-9a-z]*' | head -n 1)
echo "the log has $marker" >&2
echo "{\\"phase\\":\\"$marker\\",\\"fraction\\":0.5}" >&3
case "$spec" in *stub-failure*) echo "{\\"code\\":\\"input_damaged\\",\\"message\\":\\"$marker.vdb is damaged\\"}" >&2; exit 3;; esac
printf %%s "$spec" > "$4/points.ply"
set -- "$4" $(sha256sum < "$4/points.ply") $(wc -c < "$4/points.ply")
case "$spec" in *stub-unresolved*) outcome=unresolved;; *) outcome=converged;; esac
printf '{"outcome":"%%s","count":7,"outputs":[{"name":"points.ply","bytes":%%d,"sha256":"%%s"}],"surface":{"warnings":["%%s"]}}' \\
    "$outcome" "$4" "$2" "$marker" > "$1/report.json"
"""


def find_ids(value):
    """The ids in a JSON, without the documents of events and of other users' jobs."""
    if isinstance(value, str):
        return set(ID.findall(value))
    if isinstance(value, list):
        return set().union(*map(find_ids, value))
    if not isinstance(value, dict) or value.get("owner", "ben") != "ben" or "seq" in value:
        return set()
    return set().union(*map(find_ids, value.values()))


class Tally:
    """What both found; any thread."""

    def __init__(self):
        self.lock = threading.Lock()
        self.searched, self.bytes, self.seen = collections.Counter(), 0, collections.Counter()
        self.leaks, self.faults, self.pairs, self.cached = [], [], 0, 0
        self.related, self.texts = collections.Counter(), collections.defaultdict(dict)

    def leak(self, what, found):
        with self.lock:
            self.leaks.append(f"{what}: {found}")

    def fault(self, text):
        with self.lock:
            self.faults.append(text)

    def search(self, what, data, public=False):
        """Of what ben got. public: names and labels of others may be in the JSON."""
        with self.lock:
            self.searched[what.split()[0]] += 1
            self.bytes += len(data)
        for found in SECRET.findall(data):
            self.leak(what, f"{found!r} in {data[:3000]!r}")
            return
        if PUBLIC.search(data) and not (public and self.are_public(json.loads(data))):
            self.leak(what, f"a name or label in {data[:3000]!r}")

    def search_ids(self, what, asked, answer, shared):
        """Of a JSON that ben got: jobs of ann that neither this request nor a spec of ben's has named."""
        try:
            found = find_ids(answer.json) & shared.of_ann - set(ID.findall(asked)) - shared.named
        except ValueError:
            return
        if found:
            self.leak(what, f"the jobs {found} of ann in {answer.body[:3000]!r}")

    def expect_one_text(self, kind, text):
        """All texts of a kind must be equal but for ids."""
        with self.lock:
            self.texts[kind].setdefault(ID.sub("ID", text), text)
        if len(self.texts[kind]) > 1:
            self.leak(kind, f"different texts: {self.texts[kind]}")

    def are_public(self, value, key=None):
        if isinstance(value, dict):
            return all(self.are_public(v, k) for k, v in value.items())
        if isinstance(value, list):
            return all(self.are_public(v, key) for v in value)
        return key in PUBLIC_KEYS or not (isinstance(value, str) and PUBLIC.search(value.encode()))


class Shared:
    """What both know of each other: ids, hashes of uploads, directories without a marker; and what must stay ann's."""

    def __init__(self, base, host):
        self.base, self.host = base, host
        self.ids, self.uploads, self.guessed = (collections.deque(maxlen=100) for _ in range(3))
        self.secrets = collections.deque(maxlen=1000)
        self.of_ann, self.named = set(), set()  # jobs of ann, and jobs in specs of ben
        self.counter, self.lock = 0, threading.Lock()

    def number(self):
        with self.lock:
            self.counter += 1
            return self.counter

    def secret(self, place):
        made = f"Mkr7x{place}{self.number()}"
        self.secrets.append(made)
        return made

    def digits(self):
        return int(f"867530914{self.number():06d}")


class Recorder(Client):
    """A client of ben; `asked` is its last request."""

    def __init__(self, address, token, shared):
        super().__init__(address, token)
        self.shared, self.asked = shared, ""

    def ask(self, method, path, document=None, *more, **named):
        self.asked = f"{path} {document}"
        if method == "POST" and path == "/v1/jobs":
            self.shared.named.update(ID.findall(self.asked))
        return super().ask(method, path, document, *more, **named)


class Account(User):
    def __init__(self, address, name, thread, token, seed, shared, tally):
        super().__init__(address, f"{name}{thread}", token, SCOPES, seed, [str(shared.base / "inputs"), str(shared.base / "inputs" / "of-ben")], [])
        self.name, self.shared, self.tally, self.own = name, shared, tally, []
        self.uploads = shared.uploads
        self.asked = []

    def one_id(self):
        known = self.rng.choice([self.own, list(self.shared.ids)])
        return self.rng.choice(known) if known else "01" + "a" * 24

    def value(self, schema, name="", depth=0):
        if name == "owner":
            return self.rng.choice(["ann", "ben"])
        return super().value(schema, name, depth)

    def keep(self, name, answer):
        if name == "submitJob" and answer.status == 201:
            job = answer.json["id"]
            self.own.append(job)
            self.shared.ids.append(job)
            if self.name == "ann":
                self.shared.of_ann.add(job)

    def wait(self, client, job):
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            answer = client.ask("GET", f"/v1/jobs/{job}", headers={"Prefer": "wait=10"})
            if answer.status != 200 or answer.json["finished"]:
                return answer
        raise TimeoutError(job)

    def results(self, client, job):
        """name -> answer."""
        listed = client.ask("GET", f"/v1/jobs/{job}/results")
        if listed.status != 200:
            return {}
        return {r["name"]: client.ask("GET", r["href"]) for r in listed.json["results"]}


class Ann(Account):
    """Who has secrets."""

    def public(self, kind):
        return f"Pub7x{kind}-{self.shared.number()}"

    def private(self, spec, kind="job"):
        """The data of the owner of a job, all with markers."""
        rng, shared = self.rng, self.shared
        spec["name"] = self.public(kind)
        queue = {"labels": [self.public("label")], "retention_s": shared.digits() // 10**6}
        if rng.random() < 0.5:
            queue["webhook"] = f"http://{shared.host}/ann/{shared.secret('hook')}?key={shared.secret('key')}"
        if rng.random() < 0.3:
            where = shared.base / "outputs" / rng.choice([shared.secret("out"), f"guess{shared.number()}"])
            spec["output"]["directory"] = str(where)
            if where.name.startswith("guess"):
                shared.guessed.append(where)
        if rng.random() < 0.3:
            queue["accept"] = ["converged"]
        spec["queue"] = {**spec.get("queue", {}), **queue}
        return spec

    def stub(self, kind):
        """A job with a result or a failure of the stub worker, which the name of the job determines."""
        path = self.shared.base / "inputs" / "of-ann" / f"{self.shared.secret('stub')}.off"
        path.write_text(OFF.format("any"))
        return self.private({**ball(self.shared.digits()), "surface": {"mesh": {"path": str(path)}}}, kind)

    def array(self):
        return {"frames": FRAMES, "by_frame": {"/solver/seed": [self.shared.digits() for _ in range(3)]}}

    def spec(self):
        spec = self.any_spec()
        if self.shared.ids and self.rng.random() < 0.2:
            spec["queue"][self.rng.choice(["after", "depends_on"])] = [self.rng.choice(self.shared.ids)]
        return spec

    def any_spec(self):
        rng, shared = self.rng, self.shared
        kind = rng.choice(["job", "job", "stub-result", "stub-result", "stub-unresolved", "stub-failure", "missing", "file", "damaged", "upload",
                           "array", "attribute"])
        spec = ball(shared.digits())
        spec["surface"]["analytic"]["radius"] = float(f"1.{shared.digits()}")
        spec["outcome"] = {"require": {"hex_fraction": -float(f"0.{shared.digits()}")}}
        path = shared.base / "inputs" / "of-ann" / f"{shared.secret('path')}.off"
        if kind.startswith("stub"):
            return self.stub(kind)
        if kind == "file":
            path.write_text(OFF.format(shared.secret("file")))
        elif kind == "damaged":
            path.write_text(f"OFF\n4 {shared.secret('damage')}\n")
        elif kind == "upload" and self.mine:
            spec["surface"] = {"mesh": {"path": f"sha256:{rng.choice(self.mine)}.off"}}
        elif kind == "array":
            spec["queue"] = self.array()
        elif kind == "attribute":
            spec["attributes"] = [{"from": str(path), "name": shared.secret("grid")}]
        if kind in ("missing", "file", "damaged"):
            spec["surface"] = {"mesh": {"path": str(path)}}
        return self.private(spec, kind)

    mine = []

    def headers(self, operation):
        found = super().headers(operation)
        if "Idempotency-Key" in found:
            found["Idempotency-Key"] = self.shared.secret("idem")
        if "traceparent" in found:
            found["traceparent"] = f"00-867530914{self.shared.number():023d}-{'5' * 16}-01"
        return found

    def step(self, client):
        rng = self.rng
        if rng.random() < 0.1:
            data = OFF.format(self.shared.secret("upload")).encode()
            digest = hashlib.sha256(data).hexdigest()
            answer = client.ask("PUT", f"/v1/inputs/{digest}", raw=data, headers={"Content-Type": "application/octet-stream"})
            if answer.status in (200, 201):
                self.mine.append(digest)
                self.shared.uploads.append(digest)
            return
        if rng.random() < 0.3:
            name, answer = "submitJob", client.ask("POST", "/v1/jobs", self.spec(), headers=self.headers(
                self.document["paths"]["/v1/jobs"]["post"]))
        elif rng.random() < 0.05 and self.own:
            name, answer = "getJob", client.ask("GET", f"/v1/jobs/{rng.choice(self.own)}")
        else:
            name, answer = self.offered(client)
        self.keep(name, answer)
        if SECRET.search(answer.body):
            with self.tally.lock:
                self.tally.seen[name] += 1
                for place in set(re.findall(rb"Mkr7x([a-z]+)", answer.body)):
                    self.tally.seen["of " + place.decode()] += 1


class Ben(Account):
    """Who must not see them."""

    def private(self, spec):
        rng, shared = self.rng, self.shared
        spec["name"] = f"ben-{shared.number()}"
        queue = {"labels": ["of-ben"], "retention_s": 100000}
        if rng.random() < 0.5:
            queue["webhook"] = f"http://{shared.host}/ben/{shared.number()}"
        if rng.random() < 0.3:
            spec["output"]["directory"] = str(shared.base / "outputs" / f"ben{shared.number()}")
        elif shared.guessed and rng.random() < 0.4:
            spec["output"]["directory"] = str(rng.choice(shared.guessed))  # one of ann's
        if shared.ids and rng.random() < 0.3:
            kind = rng.choice(["after", "depends_on", "after_frames"])
            queue[kind] = [rng.choice(shared.ids)]
            if kind == "after_frames":
                queue |= {"frames": "1-2", "by_frame": {"/solver/seed": [shared.number(), shared.number()]}}
        spec["queue"] = {**spec.get("queue", {}), **queue}
        return spec

    def spec(self):
        rng, shared = self.rng, self.shared
        spec = ball(5 * 10**8 + shared.number())
        if shared.uploads and rng.random() < 0.3:
            spec["surface"] = {"mesh": {"path": f"sha256:{rng.choice(shared.uploads)}.off"}}
        elif rng.random() < 0.2:
            spec["surface"] = {"mesh": {"path": rng.choice(["/etc/hostname", "missing.off", str(shared.base / "inputs" / "of-ben")])}}
        return self.private(spec)

    def ask_all(self, what, answer, public=False, asked=""):
        head = f"{answer.status}\n{answer.headers}".encode()
        self.tally.search(f"{what} headers", PUBLIC.sub(b"", head) if what == "listJobs" else head)  # Link has a cursor
        self.tally.search(what, answer.body, public)
        self.tally.search_ids(what, asked, answer, self.shared)

    def step(self, client):
        rng = self.rng
        if rng.random() < 0.05 and self.shared.secrets:  # a filter is no way to guess
            secret = rng.choice(self.shared.secrets)
            name = rng.choice(["text", "name", "label"])
            cursor, found = "", []
            while cursor is not None:
                answer = client.ask("GET", f"/v1/jobs?{name}={secret}{cursor and '&cursor='}{cursor}")
                if answer.status != 200:
                    self.ask_all("listJobs", answer)
                    return
                found, cursor = found + answer.json["jobs"], answer.json["next"]
            if found:
                self.tally.leak(f"the filter {name}", found[:2])
            return
        if rng.random() < 0.1:
            name, answer = "submitJob", client.ask("POST", "/v1/jobs", self.spec())
        elif rng.random() < 0.1 and self.own:
            job = rng.choice(self.own)
            for result in self.results(client, job).values():
                self.ask_all("result of ben", result)
            name, answer = "getLog", client.ask("GET", f"/v1/jobs/{job}/log")
        else:
            name, answer = self.offered(client)
        self.keep(name, answer)
        self.ask_all(name, answer, name not in ("followJob", "followJobs", "getResult", "getLog"), client.asked)


def pair(ann, ben, clients, tally, shared):
    """Equal specs of both, in either order or at once."""
    rng = ann.rng
    seed, count = 10**9 + shared.number(), rng.randrange(40, 80)
    specs = {ann: ann.private(ball(seed, count)), ben: ben.private(ball(seed, count))}
    specs[ben]["queue"] = {"labels": ["of-ben"]}
    order, at_once, jobs, reports, points = rng.sample([ann, ben], 2), rng.random() < 0.3, {}, {}, {}
    for user in order:
        made = clients[user].ask("POST", "/v1/jobs", urgent(specs[user]))
        if made.status == 409:  # another job has delivered into the directory since it was chosen
            if user is ben:
                ben.ask_all("pair", made)
            return
        if made.status != 201:
            raise ValueError(f"{user.name}: {made.status} {made.body[:500]!r}")
        jobs[user] = made.json["id"]
        user.own.append(jobs[user])
        if user is ann:
            shared.of_ann.add(jobs[user])
        if not at_once:
            user.wait(clients[user], jobs[user])
    for user in order:
        job = user.wait(clients[user], jobs[user])
        found = user.results(clients[user], jobs[user])
        if job.status == 404 or not found or any(f.status == 404 for f in found.values()):
            return  # cancelled or deleted by another thread of the same user
        if "report.json" not in found or job.json["state"] != "succeeded":
            return
        reports[user], points[user] = found["report.json"].json, found["points.ply"].body
        if user is ben:
            ben.ask_all("pair", job)
            for result in found.values():
                ben.ask_all("pair", result)
                if jobs[ann].encode() in result.body:
                    tally.leak("pair", "a result names the job of ann")
            if reports[ben]["spec"] != job.json["spec"]:
                tally.leak("pair", "the report's spec is not that of ben's job")
            log = clients[ben].ask("GET", f"/v1/jobs/{jobs[ben]}/log")
            ben.ask_all("pair", log, asked=clients[ben].asked)
            with tally.lock:
                tally.cached += log.status == 404 and "equal job" in log.json["detail"]
    if points[ann] != points[ben]:
        tally.leak("pair", "the points differ")
    if reports[ann]["spec"]["name"] != specs[ann]["name"]:
        tally.leak("pair", "ann's report is not ann's")
    with tally.lock:
        tally.pairs += 1


def urgent(spec):
    """Before all other jobs, which may wait for longer than PATIENCE_S."""
    return {**spec, "queue": {**spec["queue"], "priority": 100}}


def submit_need(ann, client, shared):
    """A job of ann that succeeds, fails, has an outcome that it does not accept, or is cancelled, and has ended, or not; None: it was refused."""
    kind = ann.rng.choice(["stub-result", "stub-unresolved", "stub-failure", "array", "cancelled"])
    spec = ann.private({**ball(shared.digits()), "queue": ann.array()}, kind) if kind == "array" else ann.stub(kind)
    if kind == "stub-unresolved":
        spec["queue"]["accept"] = ["converged"]
    made = client.ask("POST", "/v1/jobs", urgent(spec))
    if made.status != 201:
        return None
    job = made.json["id"]
    shared.of_ann.add(job)
    if kind == "cancelled":
        client.ask("POST", f"/v1/jobs/{job}/cancel")
    if ann.rng.random() < 0.5:
        ann.wait(client, job)
    return job


def relate(ann, ben, clients, tally, shared):
    """A job of ben that waits for one of ann: all that ben can ask about both."""
    client, kind = clients[ben], ben.rng.choice(["depends_on", "depends_on", "after", "after_frames"])
    need = submit_need(ann, clients[ann], shared)
    if not need:
        return
    spec = {**ball(5 * 10**8 + shared.number()), "queue": {kind: [need]}}
    if kind == "after_frames":
        frames = ben.rng.choice([[1, 2, 3], [2], [0, 7]])
        spec["queue"] |= {"frames": ",".join(map(str, frames)), "by_frame": {"/solver/seed": frames}}

    def ask(method, path, document=None):
        answer = client.ask(method, path, document)
        ben.ask_all(f"relation {kind} {path.rpartition('/')[2]}", answer, asked=client.asked)
        return answer

    made = ask("POST", "/v1/jobs", urgent(spec))
    if kind == "after_frames" and made.status != 403 and "does not exist" not in made.json.get("detail", ""):
        tally.leak(kind, f"the frames of ann were compared: {made.body!r}")
    elif made.status != 201:
        tally.expect_one_text(f"{kind} {made.status}", made.json["detail"])
    else:
        ann.wait(clients[ann], need)
        job = made.json["id"]
        ended = ben.wait(client, job)
        for path in ("", "/tasks", "/attempts", "/events?after=0", "/log", "/results"):
            ask("GET", f"/v1/jobs/{job}{path}")
        ask("GET", f"/v1/jobs?depends_on={need}&owner=ben")
        ask("POST", f"/v1/jobs/{job}/retry")
        if (ended.json["error"] or {}).get("code") == "dependency_failed":
            tally.expect_one_text(kind, ended.json["error"]["message"])
    with tally.lock:
        tally.related[kind] += 1


def relate_back(ann, ben, clients, tally, shared):
    """A job of ann that waits for one of ben that fails: what ben's retry with dependents answers."""
    number = shared.number()
    made = clients[ben].ask("POST", "/v1/jobs", urgent({**ball(5 * 10**8 + number), "name": f"stub-failure-{number}", "queue": {}}))
    job = made.json["id"]
    spec = ann.private(ball(shared.digits()))
    behind = clients[ann].ask("POST", "/v1/jobs", urgent({**spec, "queue": {**spec["queue"], "depends_on": [job]}}))
    if behind.status != 201:
        return
    shared.of_ann.add(behind.json["id"])
    ben.wait(clients[ben], job)
    ann.wait(clients[ann], behind.json["id"])
    for path in ("/retry?dependents=1", "/retry"):
        ben.ask_all("relation retry", clients[ben].ask("POST", f"/v1/jobs/{job}{path}"), asked=clients[ben].asked)
    with tally.lock:
        tally.related["retry"] += 1


def receiver(tally):
    """Both users' webhooks; what ben's get is searched."""
    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self):
            body = self.rfile.read(int(self.headers["Content-Length"]))
            if self.path.startswith("/ben/"):
                tally.search("webhook", f"{self.path}\n{self.headers}".encode())
                tally.search("webhook", body)
            else:
                tally.seen["webhook"] += 1
            self.send_response(204)
            self.end_headers()

        def log_message(self, *words):
            pass
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server, f"127.0.0.1:{server.server_address[1]}"


def follow(address, token, over, tally):
    """All events that ben may get, and the progress of what ben may follow."""
    client = Client(address, token)
    while not over.is_set():
        try:
            answer = client.ask("GET", "/v1/events?all=1&progress=1&after=0", headers={"Accept": "text/event-stream"}, stream_s=5)
            tally.search("stream", answer.body)
        except (http.client.HTTPException, OSError):
            client.close()


def phase(daemon, tokens, shared, tally, options, round_number):
    """Half of the operations."""
    over, left = threading.Event(), [options.operations // 2]
    lock, threads = threading.Lock(), []

    def take():
        with lock:
            left[0] -= 1
            return left[0] >= 0

    def new_client(name):
        return Client(daemon.address, tokens[name]) if name == "ann" else Recorder(daemon.address, tokens[name], shared)

    def work(kind, name, thread):
        user = kind(daemon.address, name, thread + 100 * round_number, tokens[name], options.seed, shared, tally)
        client = new_client(name)
        while take():
            try:
                user.step(client)
            except Exception:  # whatever it is, it is a fault
                client.close()
                tally.fault(f"{name}: {traceback.format_exc()}")
        client.close()

    def work_pairs(acts, thread):
        both = [kind(daemon.address, name, thread + 100 * round_number, tokens[name], options.seed, shared, tally)
                for kind, name in ((Ann, "ann"), (Ben, "ben"))]
        clients = {user: new_client(user.name) for user in both}
        for i in range(round(options.operations // 2 * PAIRS)):
            try:
                acts[i % len(acts)](*both, clients, tally, shared)
            except Exception:
                tally.fault(f"{acts}: {traceback.format_exc()}")

    for kind, name in ((Ann, "ann"), (Ben, "ben")):
        threads += [threading.Thread(target=work, args=(kind, name, i)) for i in range(THREADS[name])]
    threads += [threading.Thread(target=work_pairs, args=([pair], 50)),
                threading.Thread(target=work_pairs, args=([relate, relate, relate, relate_back], 60))]
    follower = threading.Thread(target=follow, args=(daemon.address, tokens["ben"], over, tally))
    for thread in threads + [follower]:
        thread.start()
    for thread in threads:
        thread.join()
    over.set()
    follower.join()


def campaign(options, base):
    tally = Tally()
    server, host = receiver(tally)
    options.real_workers = False
    daemon = Daemon(options, base)
    (base / "worker").write_text(WORKER % {"real": daemon.build / "hexad-worker"})
    (base / "secret").write_text("0" * 64)
    (base / "secret").chmod(0o600)
    for name in ("of-ann", "of-ben"):
        (base / "inputs" / name).mkdir()
    daemon.words += ["--webhook_hosts", host, "--webhook_secret_file", base / "secret", "--webhook_tries", "2", "--estimate_timeout_s", "2"]
    tokens = {name: daemon.token(name, SCOPES) for name in ("ann", "ben")}
    shared = Shared(base, host)
    try:
        for round_number in range(2):
            daemon.start()
            phase(daemon, tokens, shared, tally, options, round_number)
            status = daemon.end()
            if daemon.process.returncode:
                tally.faults.append(f"exit status {daemon.process.returncode} after {status:.0f} s")
    finally:
        if daemon.process and daemon.process.poll() is None:
            daemon.process.kill()
            daemon.process.wait()
        server.shutdown()
    for path in sorted((base / "outputs").glob("ben*/*")):
        tally.search("file", path.read_bytes())
    report(options, tally)
    blind = [place for place in PLACES if not tally.seen[place] and options.operations >= ENOUGH]
    for place in blind:
        print(f"missed: ann did not find a marker: {place}")
    for relation in RELATIONS:
        if not tally.related[relation] and options.operations >= ENOUGH:
            blind.append(relation)
            print(f"missed: no job was related by {relation}")
    return 1 if tally.leaks or tally.faults or blind or not tally.pairs else 0


def report(options, tally):
    print(f"measurements/isolation/separation.py --operations {options.operations} --seed {options.seed}\n")
    print("what ben got, searched")
    for what, count in sorted(tally.searched.items()):
        print(f"{what}, {count}")
    print(f"\n{tally.bytes / 1e6:.0f} MB were searched: {len(tally.leaks)} leaks. {tally.pairs} pairs of equal specs, {tally.cached} of ben's from the"
          f" cache. ann found markers in: " + ", ".join(f"{k}: {n}" for k, n in sorted(tally.seen.items())) + ".")
    print("\nJobs of ben related to jobs of ann: " + ", ".join(f"{kind}: {tally.related[kind]}" for kind in RELATIONS) + ".")
    if options.output:
        name = f"{options.operations} operations, seed {options.seed}"
        others = [list(row.values()) for row in results.read(options.output) if row["run"] != name]
        results.write(options.output, COLUMNS, [*others, [name, options.operations, options.seed, f"{tally.bytes / 1e6:.0f}", len(tally.leaks),
                                                          tally.pairs, tally.cached]])
    for kind, count in collections.Counter(leak.partition(":")[0] for leak in tally.leaks).items():
        print(f"missed: {count} leaks: {kind}")
    for text in tally.leaks[:20] + tally.faults[:20]:
        print("missed:", text[:4000])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--built", type=pathlib.Path, required=True)
    parser.add_argument("--operations", type=int, default=10000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--place", type=pathlib.Path)
    parser.add_argument("--output", type=pathlib.Path)
    options = parser.parse_args()
    options.built = options.built.resolve()
    print(f"seed {options.seed}", flush=True)
    with tempfile.TemporaryDirectory(dir=options.place) as where:
        return campaign(options, pathlib.Path(where))


if __name__ == "__main__":
    sys.exit(main())
