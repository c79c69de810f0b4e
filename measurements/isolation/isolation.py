#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How long one user waits while ten others do all that the OpenAPI document offers, and what is hostile.

    measurements/isolation/isolation.py --built BUILD [--minutes 60] [--seed 1] [--jobs 113000] [--real-workers]
                       [--untimed] [--only large_pages,...] [--place DIRECTORY] [--output FILE.csv]
    measurements/isolation/isolation.py --built BUILD --routes SECONDS | --writes | --serving-thread [--jobs 0] [--only listJobs,...] [--real-workers]
                       [--place DIRECTORY] [--output FILE.csv]

The second form measures each row of the table of routes (measurements/isolation/isolation_routes.py). The first one measures the
answering times of GET /healthz, of status reads and of submissions of one user, before and during the load, and the daemon's RssAnon.
The results are printed; --output writes them, too. Ends with 1 when a goal is missed: 99th percentiles below 50 ms, RssAnon below 300 MB,
no failure of the measured user's requests, no answer 500, an end within drain_s + grace_s + 5 s of SIGTERM under the load.

The ten users run at the lowest priority: they stand for programs on other machines. The daemon has the default one: with a
higher priority, it keeps the kernel's threads, which flush the disk for it, from their processors. Beside each measured request a byte goes
to another process and back; its percentiles show how long processes of this machine wait for a processor, which no daemon can
change. --only: these hostile requests of the class User and operations of the document. --untimed: times are
printed, but not judged. --jobs: cancelled jobs that are in the queue from the beginning.
"""
import argparse
import collections
import hashlib
import http.client
import json
import math
import multiprocessing
import os
import pathlib
import random
import re
import secrets
import selectors
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))

import results  # noqa: E402

USERS = 10
DEPTH = 6  # of surfaces in surfaces
THREADS = 4  # of each user, with a connection each
GOAL_MS, GOAL_MB = 50, 300
DRAIN_S, GRACE_S = 5, 2
END_S = DRAIN_S + GRACE_S + 5
BASELINE_S = 20
ROUND_S = 0.05
PATIENCE_S = 120
LARGE_BYTES = 235_000_000  # of a report
SCOPES = [("read",), ("read", "submit"), ("read", "submit", "cancel"), ("submit",), ("read", "submit", "cancel")] * 2
MEASURED = "measured"

# The contract of a worker: a result at once; a large report for jobs that ask for one; estimates are those of the real one.
WORKER = """#!/bin/sh
case "$1" in run) ;; *) exec %(real)s "$@";; esac
spec=$(cat)
printf x > "$4/points.ply"
head='{"outcome":"converged","count":7,"outputs":[{"name":"points.ply","bytes":1,"sha256":"%(hash)s"}]'
case "$spec" in
*large-report*) { printf '%%s,"sweeps":[' "$head"; yes '{"sweep":1,"energy":0.123456,"moved":12345},' | head -n %(rows)d; echo '{}]}'; } > "$4/report.json";;
*) printf '%%s}' "$head" > "$4/report.json";;
esac
printf '%%s,"report_bytes":%%d}' "$head" $(wc -c < "$4/report.json") > "$4/summary.json"
"""
ROW_BYTES = len('{"sweep":1,"energy":0.123456,"moved":12345},\n')


def percentile(values, share):
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, math.ceil(share * len(ordered)) - 1)] if ordered else float("nan")


# ---- the daemon

class Daemon:
    def __init__(self, options, base):
        self.build, self.base, self.state = options.built, base, base / "state"
        self.state.mkdir(mode=0o700)
        (base / "inputs").mkdir()
        (base / "inputs" / "a.off").write_text("OFF\n4 4 0\n1 1 1\n1 -1 -1\n-1 1 -1\n-1 -1 1\n3 0 1 2\n3 0 3 1\n3 0 2 3\n3 1 3 2\n")
        for i in range(1000):
            (base / "inputs" / f"empty{i}").touch()
        (base / "outputs").mkdir()
        worker = base / "worker"
        real = self.build / "hexad-worker"
        worker.write_text(f'#!/bin/sh\nexec nice -n 19 {real} "$@"\n' if options.real_workers else WORKER % {
            "real": real, "hash": hashlib.sha256(b"x").hexdigest(), "rows": LARGE_BYTES // ROW_BYTES})
        worker.chmod(0o700)
        self.words = [self.build / "hexad", "--port_file", base / "port", "--state_dir", self.state, "--listen", "127.0.0.1:0",
                      "--worker", worker, "--workers", "2", "--log_level", "warning", "--input_roots", base / "inputs",
                      "--output_roots", base / "outputs", "--drain_s", str(DRAIN_S), "--grace_s", str(GRACE_S),
                      "--user_results_mb", "1000", "--delete_undelivered", "1"]
        if getattr(options, "writes", False):
            self.words += ["--user_tasks", "0"]
        self.process = None

    def token(self, user, scopes):
        done = subprocess.run([self.build / "hexadctl", "token", "add", user, "--scopes", ",".join(scopes), "--file",
                               self.state / "tokens"], check=True, capture_output=True, text=True)
        return done.stdout.strip()

    def start(self):
        (self.base / "port").unlink(missing_ok=True)
        with open(self.base / "log", "ab") as log:
            self.process = subprocess.Popen([str(w) for w in self.words], stderr=log, stdin=subprocess.DEVNULL)
        while not (self.base / "port").exists():
            assert self.process.poll() is None, (self.base / "log").read_text()
            time.sleep(0.05)
        host, _, port = (self.base / "port").read_text().strip().rpartition(":")
        self.address = (host, int(port))

    def end(self):
        """Seconds until it has ended after SIGTERM."""
        began = time.monotonic()
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(10 * PATIENCE_S)
        return time.monotonic() - began

    def anonymous_mb(self):
        for line in pathlib.Path(f"/proc/{self.process.pid}/status").read_text().splitlines():
            if line.startswith("RssAnon:"):
                return int(line.split()[1]) * 1024 / 1e6
        return 0


def fill(daemon, count, token):
    """Copies of one cancelled job, in the database while the daemon is stopped."""
    client = Client(daemon.address, token)
    job = client.ask("POST", "/v1/jobs", {**ball(1), "queue": {"labels": ["filling"], "depends_on": [
        client.ask("POST", "/v1/jobs", ball(2)).json["id"]]}}).json["id"]
    client.ask("POST", f"/v1/jobs/{job}/cancel")
    client.close()
    daemon.end()
    with sqlite3.connect(daemon.state / "queue.db") as db:
        source = db.execute("SELECT seq FROM job WHERE id = ?", (job,)).fetchone()[0]
        first = db.execute("SELECT max(seq) FROM job").fetchone()[0] + 1
        numbers = f"WITH RECURSIVE n(i) AS (SELECT {first} UNION ALL SELECT i + 1 FROM n WHERE i + 1 < {first + count}) "
        for table, changed in (("job", {"seq": "i", "id": f"substr('{job}', 1, 16) || printf('%010d', i)", "key": "NULL"}),
                               ("spec", {"job": "i"}), ("task", {"job": "i"}), ("label", {"job": "i"})):
            columns = [row[1] for row in db.execute(f"PRAGMA table_info({table})")]
            values = ", ".join(changed.get(c, c) for c in columns)
            where = "seq" if table == "job" else "job"
            db.execute(f"INSERT INTO {table} ({', '.join(columns)}) {numbers} SELECT {values} FROM n, {table} WHERE {where} = {source}")
    db.close()
    daemon.start()


# ---- requests

class Answer:
    def __init__(self, status, headers, body):
        self.status, self.headers, self.body = status, headers, body

    @property
    def json(self):
        return json.loads(self.body)


class Client:
    """One connection that is kept. What met a connection that was closed is sent again."""

    def __init__(self, address, token=None, patience_s=PATIENCE_S):
        self.address, self.token, self.patience_s, self.connection = address, token, patience_s, None

    def close(self):
        if self.connection:
            self.connection.close()
        self.connection = None

    def ask(self, method, path, document=None, headers=None, raw=None, stream_s=None):
        body = raw if raw is not None else json.dumps(document) if document is not None else None
        headers = dict(headers or {})
        if self.token:
            headers["Authorization"] = f"Bearer {self.token}"
        if body is not None:
            headers.setdefault("Content-Type", "application/json")
        for again in (False, True):
            fresh = self.connection is None
            if fresh:
                self.connection = http.client.HTTPConnection(*self.address, timeout=self.patience_s)
            try:
                self.connection.request(method, path, body, headers)
                reply = self.connection.getresponse()
                if stream_s is not None:
                    return self.follow(reply, stream_s)
                answer = Answer(reply.status, reply.headers, reply.read())
                if reply.will_close:
                    self.close()
                return answer
            except (http.client.HTTPException, OSError):
                self.close()
                if again or fresh:
                    raise
        return None

    def follow(self, reply, seconds):
        """Reads a stream for a while."""
        end, got = time.monotonic() + seconds, b""
        try:
            if self.connection.sock:  # None: the answer ends with the connection
                self.connection.sock.settimeout(seconds)
            while time.monotonic() < end and (piece := reply.read1(65536)):
                got += piece
        except OSError:
            pass
        self.close()
        return Answer(reply.status, reply.headers, got)


def ball(seed, count=60, **parts):
    return {"version": 1, "surface": {"analytic": {"shape": "sphere", "center": [0, 0, 0], "radius": 1}}, "sampling": {"count": count},
            "solver": {"seed": seed}, "output": {"preview": False}, **parts}


class User:
    """What one of the ten does."""

    def __init__(self, address, number, token, scopes, seed, paths, only):
        self.address, self.token, self.scopes, self.paths = address, token, scopes, paths
        self.rng, self.host = random.Random(f"{seed} {number}"), f"{address[0]}:{address[1]}"
        self.number, self.over = number, threading.Event()
        self.lock, self.answers, self.kinds, self.faults = threading.Lock(), collections.Counter(), collections.Counter(), []
        self.ids, self.uploads = collections.deque(maxlen=200), collections.deque(maxlen=20)
        client = Client(address, token)
        self.document = client.ask("GET", "/v1/openapi.json").json
        self.schemas = self.document["components"]["schemas"]
        client.close()
        self.operations = [(method.upper(), path, operation) for path, methods in self.document["paths"].items()
                           for method, operation in methods.items() if method != "parameters"
                           and operation["operationId"] not in ("drain", "hold")]  # they stop others by their purpose
        self.hostile = [self.excluding_members, self.many_frames, self.matches_nothing, self.large_pages, self.repeated_values,
                        self.large_report, self.without_token, self.idle_uploads, self.wrong_frames, self.long_submissions]
        self.offers = 0.85
        if only:
            self.hostile = [act for act in self.hostile if act.__name__ in only]
            self.operations = [o for o in self.operations if o[2]["operationId"] in only]
            self.offers = len(self.operations) / (len(self.operations) + len(self.hostile))

    def note(self, kind, answer):
        with self.lock:
            self.kinds[kind] += 1
            if answer is None:
                return
            code = re.match(rb'\{"type":[^}]*?"code":"(\w+)"', answer.body)
            self.answers[f"{answer.status} {code[1].decode()}" if code else answer.status] += 1
            if answer.status == 500:
                self.faults.append(f"{kind}: {answer.status} {answer.body[:200]!r}")
            if answer.status in (200, 201) and answer.body[:6] in (b'{"id":', b'{"jobs'):
                document = answer.json
                for job in document.get("jobs", [document]):
                    if job.get("owner") != MEASURED:
                        self.ids.append(job["id"])

    def one_id(self):
        with self.lock:
            if self.ids and self.rng.random() < 0.95:
                return self.rng.choice(self.ids)
        return "01" + "a" * 24

    # ---- what the document offers

    def value(self, schema, name="", depth=0):
        """Of a parameter or a member."""
        rng = self.rng
        if "$ref" in schema:
            schema = self.schemas[schema["$ref"].rpartition("/")[2]]
        known = {"id": self.one_id, "job": self.one_id, "name": lambda: rng.choice(["points.ply", "report.json", "ball", "x"]),
                 "sha256": lambda: rng.choice(self.uploads) if self.uploads else "0" * 64, "owner": lambda: f"user{rng.randrange(USERS)}",
                 "label": lambda: rng.choice(["filling", "a", "b"]), "path": lambda: rng.choice(self.paths),
                 "sort": lambda: rng.choice(["created", "-created", "name", "-priority", "state"]), "cursor": lambda: rng.choice(["", "MQ"]),
                 "created_after": lambda: "2026-01-01T00:00:00Z", "created_before": lambda: "2100-01-01T00:00:00Z"}
        if name in known:
            return known[name]()
        if "enum" in schema:
            return rng.choice(schema["enum"])
        kind = schema.get("type")
        if kind in ("integer", "number"):
            low = max(schema.get("minimum", 0), -100)
            return rng.choice([low, min(schema.get("maximum", 1000), low + rng.randrange(1, 500)), 1])
        if kind == "array":
            return [self.value(schema.get("items", {}), "", depth + 1) for _ in range(rng.randrange(4) if depth < DEPTH else 0)]
        if kind == "object" or "properties" in schema:
            members = schema.get("properties", {})
            if depth > DEPTH:
                return {}
            chosen = set(schema.get("required", ())) | set(rng.sample(sorted(members), min(len(members), 2)))
            return {m: self.value(members.get(m, {}), m, depth + 1) for m in chosen}
        for choice in ("oneOf", "anyOf", "allOf"):
            if choice in schema:
                return self.value(rng.choice(schema[choice]), "", depth + 1)
        return rng.choice(["a", "b", "x" * 50])

    def spec(self):
        rng = self.rng
        spec = ball(rng.randrange(1 << 30) if rng.random() < 0.7 else 1, name=rng.choice(["ball", "x", "film"]))
        queue = {"labels": rng.sample(["a", "b", "c"], 2), "priority": rng.randrange(-5, 6), "retention_s": 60}
        if rng.random() < 0.2:
            queue["frames"] = "1-5"
        if rng.random() < 0.2:
            queue["after"] = [self.one_id()]
        if rng.random() < 0.1:
            spec["output"]["directory"] = f"{self.paths[0]}/../outputs/of{self.number}"
        if rng.random() < 0.2:
            spec["surface"] = {"mesh": {"path": f"{self.paths[0]}/a.off"}}
        if rng.random() < 0.1:
            spec["solver"]["max_sweeps"] = -1
        return {**spec, "queue": queue}

    def headers(self, operation):
        rng = self.rng
        values = {"Prefer": f"wait={rng.choice([0.1, 0.5, 2])}", "Idempotency-Key": f"key{rng.randrange(50)}", "If-None-Match": "*",
                  "If-Match": '"1"', "Last-Event-ID": str(rng.randrange(1000)), "Range": "bytes=0-0", "If-Range": '"x"',
                  "traceparent": "00-" + "4" * 32 + "-" + "5" * 16 + "-01"}
        named = [p["name"] for p in operation.get("parameters", []) if p.get("in") == "header"]
        return {name: values.get(name, "x") for name in named if rng.random() < 0.3}

    def offered(self, client):
        rng = self.rng
        method, path, operation = rng.choice(self.operations)
        query = []
        for parameter in operation.get("parameters", []):
            if parameter["in"] == "path":
                path = path.replace("{%s}" % parameter["name"], str(self.value(parameter["schema"], parameter["name"])))
            elif parameter["in"] == "query" and rng.random() < 0.4:
                query.append(f"{parameter['name']}={self.value(parameter['schema'], parameter['name'])}")
        document, raw, headers, name = None, None, self.headers(operation), operation["operationId"]
        if name in ("submitJob", "validateJob"):
            document = self.spec()
        elif name == "signIn":
            document = {"token": self.token}
        elif name == "putInput":
            raw = rng.randbytes(rng.choice([10, 1000, 100000]))
            digest = hashlib.sha256(raw).hexdigest()
            self.uploads.append(digest)
            path, headers["Content-Type"] = f"/v1/inputs/{digest}", "application/octet-stream"
        elif name == "editJob":
            document = rng.choice([{"priority": rng.randrange(-5, 6)}, {"labels": ["a"]}, {"retention_s": 60}, {"x": 1}])
        elif "requestBody" in operation:
            content = operation["requestBody"]["content"]
            document = self.value(content[min(content)]["schema"])
        stream = None
        if name in ("followJob", "followJobs") and rng.random() < 0.5:
            headers["Accept"], stream = "text/event-stream", rng.choice([0.2, 1, 5])
        elif name in ("followJob", "followJobs"):
            query.append("after=0")
        target = path + ("?" + "&".join(query) if query else "")
        try:
            return name, client.ask(method, target.replace(" ", "%20"), document, headers, raw, stream)
        except TimeoutError:
            raise TimeoutError(f"{method} {target[:200]} {headers}") from None

    # ---- what is hostile

    def excluding_members(self, client):
        """Any two members of /surface, one of them long."""
        members = self.schemas["Surface"]["properties"]
        first, second = self.rng.sample(sorted(members), 2)
        surface = {name: self.value(members[name], "") for name in (first, second)}
        if isinstance(surface.get("labels"), dict):
            surface["labels"]["labels"] = list(range(100000))
        if isinstance(surface.get("exr"), dict):
            surface["exr"]["path"] = "x" * 4000
        path = self.rng.choice(["/v1/jobs", "/v1/jobs:validate"])
        return client.ask("POST", path, {**ball(1), "surface": surface})

    def frames_spec(self, frames=10000, surfaces=64):
        rng = self.rng
        spec = ball(rng.randrange(1 << 30))
        spec["surface"] = {"union": [ball(1)["surface"] for _ in range(surfaces)]}
        chosen = rng.sample(range(surfaces), 4)
        spec["queue"] = {"frames": f"1-{frames}", "by_frame": {
            f"/surface/union/{i}/analytic/radius": [round(1 + f / frames, 5) for f in range(frames)] for i in chosen}}
        return spec

    def many_frames(self, client):
        """Forty at once."""
        if self.rng.random() < 0.5:
            return client.ask("POST", "/v1/jobs:validate", self.frames_spec())
        body = json.dumps(self.frames_spec()).encode()
        self.burst(self.request("POST", "/v1/jobs:validate", body), 40)
        return None

    def wrong_frames(self, client):
        spec = self.frames_spec()
        values = next(iter(spec["queue"]["by_frame"].values()))
        values[-1] = -1
        return client.ask("POST", "/v1/jobs", spec)

    def long_submissions(self, client):
        """Jobs whose many frames take processor time to store; they are cancelled and never run."""
        spec = self.frames_spec(frames=2500)
        spec["queue"].update(priority=-100, retention_s=60)
        made = client.ask("POST", "/v1/jobs", spec)
        if made.status == 201:
            client.ask("POST", f"/v1/jobs/{made.json['id']}/cancel")
        return made

    def matches_nothing(self, client):
        query = self.rng.choice(["text=nothing-has-this", "label=nothing", "name=nothing", "owner=nobody", "state=timed_out&label=filling",
                                 "text=zzz&sort=name", "text=zzz&sort=-priority&limit=500", "created_after=2099-01-01T00:00:00Z"])
        if self.rng.random() < 0.5:
            return client.ask("GET", f"/v1/jobs?{query}")
        self.burst(self.request("GET", f"/v1/jobs?{query}"), self.rng.choice([16, 64, 256]))
        return None

    def large_pages(self, client):
        self.burst(self.request("GET", "/v1/jobs?limit=200"), self.rng.choice([16, 128, 512]))

    def repeated_values(self, client):
        name, value = self.rng.choice([("state", "queued"), ("label", "filling"), ("owner", "user1")])
        values = ",".join([value] * 4000)[:30000]
        query = f"{name}={values}" if self.rng.random() < 0.5 else "&".join([f"{name}={value}"] * 2000)[:30000]
        return client.ask("GET", f"/v1/jobs?{query}&limit=500")

    def large_report(self, client):
        """A job with one, whose report is fetched, slowly; seldom, as it fills the disk."""
        if self.rng.random() < 0.9:
            return None
        made = client.ask("POST", "/v1/jobs", ball(self.rng.randrange(1 << 30), name="large-report", queue={"retention_s": 60}))
        if made.status != 201:
            return made
        path = f"/v1/jobs/{made.json['id']}"
        client.ask("GET", path, headers={"Prefer": "wait=20"})
        client.ask("GET", f"{path}/results")
        self.burst(self.request("GET", f"{path}/results/report.json"), 8, read_s=3)
        return client.ask("GET", path)

    def without_token(self, client):
        """POSTs whose bodies never come."""
        head = (f"POST /v1/jobs HTTP/1.1\r\nHost: {self.host}\r\nContent-Type: application/json\r\n"
                "Content-Length: 1000\r\n\r\n").encode()
        self.burst(head, self.rng.choice([16, 128, 300]), read_s=self.rng.choice([1, 5]))

    def idle_uploads(self, client):
        head = (f"PUT /v1/inputs/{secrets.token_hex(32)} HTTP/1.1\r\nHost: {self.host}\r\nAuthorization: Bearer {self.token}\r\n"
                "Content-Type: application/octet-stream\r\nContent-Length: 10000000000\r\n\r\nfirst bytes").encode()
        self.burst(head, self.rng.choice([8, 16]), read_s=self.rng.choice([1, 5]))

    def request(self, method, target, body=b""):
        return (f"{method} {target} HTTP/1.1\r\nHost: {self.host}\r\nAuthorization: Bearer {self.token}\r\nConnection: close\r\n"
                f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n").encode() + body

    def burst(self, request, count, read_s=PATIENCE_S):
        """The request on as many connections at once; all answers are read, for at most that time."""
        chosen, opened, heads = selectors.DefaultSelector(), [], {}
        try:
            for _ in range(count):
                one = socket.socket()
                one.setblocking(False)
                one.connect_ex(self.address)
                opened.append(one)
                chosen.register(one, selectors.EVENT_WRITE, [request])
            left, end = count, time.monotonic() + read_s
            while left and time.monotonic() < end and not self.over.is_set():
                for key, events in chosen.select(0.2):
                    try:
                        if events & selectors.EVENT_WRITE:
                            key.data[0] = key.data[0][key.fileobj.send(key.data[0]):]
                            if not key.data[0]:
                                chosen.modify(key.fileobj, selectors.EVENT_READ, key.data)
                            continue
                        piece = key.fileobj.recv(262144)
                        heads.setdefault(key.fileobj, piece[:12])
                    except OSError:
                        piece = b""
                    if not piece:
                        chosen.unregister(key.fileobj)
                        left -= 1
        finally:
            for one in opened:
                one.close()
            chosen.close()
        with self.lock:
            for head in heads.values():
                status = head[9:12].decode(errors="replace")
                self.answers[int(status) if status.isdigit() else 0] += 1
            self.answers["none"] += count - len(heads)
            if any(head[9:12] == b"500" for head in heads.values()):
                self.faults.append("500 in a burst")

    # ----

    def work(self):
        client = Client(self.address, self.token)
        while not self.over.is_set():
            kind = "?"
            try:
                if self.rng.random() < self.offers:
                    kind, answer = self.offered(client)
                else:
                    act = self.rng.choice(self.hostile)
                    kind, answer = act.__name__, act(client)
                self.note(kind, answer)
            except (http.client.HTTPException, OSError) as e:
                client.close()
                with self.lock:
                    self.answers["broken"] += 1
                    if isinstance(e, TimeoutError) and not self.over.is_set():
                        self.faults.append(f"{kind}: no answer within {PATIENCE_S} s: {e}")
                if isinstance(e, ConnectionRefusedError):  # the daemon has ended
                    break
        client.close()

    def run(self, end, pipe):
        threads = [threading.Thread(target=self.work, daemon=True) for _ in range(THREADS)]
        for thread in threads:
            thread.start()
        end.wait()
        self.over.set()
        for thread in threads:
            thread.join(5)
        with self.lock:
            pipe.send((dict(self.answers), dict(self.kinds), self.faults[:20]))
        os._exit(0)


def be_last():
    """The lowest priority of this process and its children; also of their session, where the kernel shares processors among sessions."""
    os.setpriority(os.PRIO_PROCESS, 0, 19)
    try:
        pathlib.Path("/proc/self/autogroup").write_text("19")
    except OSError:
        pass


def be_users(end, tellers, words):
    """A process of each user, in a session of their own."""
    os.setsid()
    be_last()
    users = []
    for teller, word in zip(tellers, words):
        process = multiprocessing.Process(target=lambda t=teller, w=word: User(*w).run(end, t))
        process.start()
        users.append(process)
    signal.signal(signal.SIGTERM, lambda *_: [u.kill() for u in users])
    for process in users:
        process.join()


# ---- what is measured

def echo(pair):
    while byte := pair.recv(1):
        pair.send(byte)
    os._exit(0)


class Measured:
    """The user whose requests are timed."""

    def __init__(self, daemon, token):
        self.daemon, self.client, self.seed = daemon, Client(daemon.address, token), 10**9
        self.near, far = socket.socketpair()
        process = multiprocessing.Process(target=echo, args=(far,), daemon=True)
        process.start()
        far.close()
        self.faults = []
        self.job = self.submit().json["id"]

    def submit(self):
        self.seed += 1
        return self.client.ask("POST", "/v1/jobs", ball(self.seed, queue={"retention_s": 60, "priority": 100}))

    def beat(self):
        self.near.send(b"x")
        return self.near.recv(1)

    def timed(self, times, name, act, expected=None):
        began = time.monotonic()
        try:
            answer = act()
        except (http.client.HTTPException, OSError) as e:
            self.faults.append(f"{name}: {e!r}")
            return None
        times[name].append(1000 * (time.monotonic() - began))
        if expected and answer.status != expected:
            self.faults.append(f"{name}: {answer.status} {answer.body[:200]!r}")
            return None
        return answer

    def measure(self, seconds):
        """name -> times in ms, and the greatest RssAnon."""
        times, most, end = collections.defaultdict(list), 0, time.monotonic() + seconds
        while time.monotonic() < end and self.daemon.process.poll() is None:
            next_round = time.monotonic() + ROUND_S
            self.timed(times, "echo (no daemon)", self.beat)
            self.timed(times, "GET /healthz", lambda: self.client.ask("GET", "/healthz"), 200)
            self.timed(times, "GET /v1/jobs/ID", lambda: self.client.ask("GET", f"/v1/jobs/{self.job}"), 200)
            made = self.timed(times, "POST /v1/jobs", self.submit, 201)
            if made:
                self.job = made.json["id"]
            most = max(most, self.daemon.anonymous_mb())
            time.sleep(max(0, next_round - time.monotonic()))
        return times, most


COLUMNS = ["request", "number", "p50_before_ms", "p99_before_ms", "p50_ms", "p99_ms", "longest_ms", "goal_p99_ms", "rss_anon_mb", "end_s",
           "outcome"]


def outcome(met):
    return "met" if met else "missed"


def table(before, during, most_mb, ended_s):
    """A row for each request, and one for the daemon's memory and its end."""
    rows = []
    for name, times in during.items():
        judged = not name.startswith("echo")
        rows.append([name, len(times), *(f"{percentile(part, share):.1f}" for part in (before[name], times) for share in (.5, .99)),
                     f"{max(times):.0f}", GOAL_MS if judged else "", "", "",
                     outcome(percentile(times, .99) < GOAL_MS) if judged else ""])
    rows.append(["daemon", *[""] * 7, f"{most_mb:.0f}", f"{ended_s:.1f}", outcome(most_mb < GOAL_MB and ended_s <= END_S)])
    return rows


def show(columns, rows):
    for row in (columns, *rows):
        print(*row, sep=", ", flush=True)


def campaign(options, base):
    daemon = Daemon(options, base)
    tokens = [daemon.token(f"user{i}", SCOPES[i]) for i in range(USERS)]
    tokens[-1] = daemon.token("root", ("read", "submit", "cancel", "admin"))
    own = daemon.token(MEASURED, ("read", "submit", "cancel"))
    daemon.start()
    missed, pipes, crowd = [], [], None
    try:
        fill(daemon, options.jobs, tokens[4])
        measured = Measured(daemon, own)
        before, idle_mb = measured.measure(BASELINE_S)
        end = multiprocessing.Event()
        paths = [str(base / "inputs"), str(base / "inputs" / "a.off"), "/etc/passwd", "x" * 4000]
        words = [(daemon.address, i, token, SCOPES[i], options.seed, paths, options.only) for i, token in enumerate(tokens)]
        pipes = [multiprocessing.Pipe(False) for _ in words]
        crowd = multiprocessing.Process(target=be_users, args=(end, [far for _, far in pipes], words))
        crowd.start()
        during, most_mb = measured.measure(60 * options.minutes)
        load = os.getloadavg()[1]
        ended_s = daemon.end() if daemon.process.poll() is None else math.inf
        end.set()
        answers, kinds, faults = collections.Counter(), collections.Counter(), list(measured.faults)
        for pipe, _ in pipes:
            if pipe.poll(30):
                told = pipe.recv()
                answers.update(told[0])
                kinds.update(told[1])
                faults += told[2]
    finally:
        if crowd:
            crowd.terminate()
        if daemon.process.poll() is None:
            daemon.process.kill()
            daemon.process.wait()
    print(f"measurements/isolation/isolation.py --minutes {options.minutes:g} --seed {options.seed} --jobs {options.jobs}"
          f"{' --real-workers' if options.real_workers else ''}:"
          f" {os.cpu_count()} processors, load average {load:.1f}\n")
    rows = table(before, during, most_mb, ended_s)
    show(COLUMNS, rows)
    if options.output:
        results.write(options.output, COLUMNS, rows)
    print(f"\nRssAnon: {idle_mb:.0f} MB before, at most {most_mb:.0f} MB; the end after SIGTERM took {ended_s:.1f} s of"
          f" {END_S}; exit status {daemon.process.returncode}.")
    print("Answers to the ten users: " + ", ".join(f"{k}: {n}" for k, n in sorted(answers.items(), key=lambda x: str(x[0]))) + ".")
    print("Operations: " + ", ".join(f"{k}: {n}" for k, n in sorted(kinds.items())) + ".")
    for name, times in during.items():
        if not options.untimed and not name.startswith("echo") and percentile(times, .99) >= GOAL_MS:
            missed.append(f"{name}: p99 {percentile(times, .99):.0f} ms")
    if most_mb >= GOAL_MB:
        missed.append(f"RssAnon {most_mb:.0f} MB")
    if ended_s > END_S or daemon.process.returncode:
        missed.append(f"the end took {ended_s:.0f} s, exit status {daemon.process.returncode}")
    missed += faults
    print("\n".join(f"missed: {text}" for text in missed[:40]) or "All goals are met.")
    return 1 if missed else 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--built", type=pathlib.Path, required=True)
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--routes", type=float, metavar="SECONDS")
    parser.add_argument("--writes", action="store_true")
    parser.add_argument("--serving-thread", action="store_true")
    parser.add_argument("--untimed", action="store_true")
    parser.add_argument("--real-workers", action="store_true")
    parser.add_argument("--only", type=lambda text: text.split(","), default=[])
    parser.add_argument("--place", type=pathlib.Path)
    parser.add_argument("--output", type=pathlib.Path)
    options = parser.parse_args()
    options.built = options.built.resolve()
    run = campaign
    if options.jobs is None:
        options.jobs = 0 if options.routes or options.writes or options.serving_thread else 113000
    if options.routes or options.writes or options.serving_thread:
        import isolation_routes
        run = isolation_routes.routes if options.routes else isolation_routes.writes if options.writes else isolation_routes.serving_thread
    else:
        print(f"seed {options.seed}", flush=True)
    with tempfile.TemporaryDirectory(dir=options.place) as where:
        status = run(options, pathlib.Path(where))
        log = (pathlib.Path(where) / "log").read_text(errors="replace").splitlines()
        print(f"log: {len(log)} lines", *collections.Counter(" ".join(line.split()[1:5]) for line in log).most_common(8), sep="\n  ",
              file=sys.stderr)
        return status


if __name__ == "__main__":
    sys.exit(main())
