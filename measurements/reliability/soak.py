#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A daemon under mixed load for long: what a job costs it, and what it holds, at the end as after the first tenth.

    measurements/reliability/soak.py --built BUILD [--minutes 60] [--more 10000] [--rate 4] [--followers 100] [--untimed] [--seed 1]
                  [--output measurements/reliability/soak.csv] [--figures soak.json] [--place DIRECTORY]

Prints a line for each tenth, then all of them and the verdicts. Writes the figures as JSON and, after a whole run, the verdicts to
--output and the tenths to a file beside it (soak_tenths.csv). --more: jobs that are in the queue at the end and wait; by default as many of 10 000 as the minutes are of an hour.
--rate: jobs a second that run. --untimed: neither processor time nor latencies are judged. SIGINT or SIGTERM ends the run at
once; what is whole of it is still judged and printed. Ends with 1 when a verdict is missed, else with 2 when it was
broken off.
"""
import argparse
import collections
import datetime
import hashlib
import http.client
import json
import os
import pathlib
import random
import re
import selectors
import signal
import socket
import sqlite3
import statistics
import subprocess
import sys
import tempfile
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1] / "tests" / "service"), str(HERE.parent / "common")]

import results  # noqa: E402
import verdicts  # noqa: E402
from service import PATIENCE_S, Service, UnixConnection, cpu_seconds, long_sphere  # noqa: E402

PARTS = 10
SLICES = 10  # of a part, each with percentiles of its own
LOOKS_A_SECOND, LISTS_A_SECOND = 10, 4
BEHIND = 20  # a job is looked at when so many were submitted after it
FINAL = ("succeeded", "failed", "cancelled", "timed_out")
KEPT_DOCUMENTS = 64

# Of twenty jobs in turn: what they are.
KINDS = ("small", "preview", "small", "array", "small", "damaged", "small", "small", "cancelled", "small",
         "small", "again", "small", "array", "small", "memory", "small", "small", "preview", "refused")
# How they end: state, and code of the error.
ENDS = {"small": ("succeeded", None), "preview": ("succeeded", None), "array": ("succeeded", None), "again": ("succeeded", None),
        "damaged": ("failed", "input_damaged"), "memory": ("failed", "limit_memory"), "cancelled": ("cancelled", "cancelled")}


class Broken(Exception):
    """The run was broken off."""


def percentile(values, share):
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def yardstick_ms():
    """Processor time of a fixed piece of work: memory that is walked through, and arithmetic."""
    before = time.thread_time()
    document = json.dumps([{"number": i, "text": str(i) * 4} for i in range(2000)])
    for _ in range(3):
        json.loads(document)
    hashlib.sha256(document.encode() * 20).digest()
    return 1000 * (time.thread_time() - before)


def poll(condition, what, seconds=PATIENCE_S):
    """As wait_until; seldom, since the answers are the daemon's work."""
    end = time.monotonic() + seconds
    while not (value := condition()):
        if time.monotonic() > end:
            raise TimeoutError(f"waited in vain for {what}")
        time.sleep(0.1)
    return value


class Tally:
    """What all clients note; any thread."""

    def __init__(self):
        self.lock = threading.Lock()
        self.answers, self.faults = collections.Counter(), []
        self.times = collections.defaultdict(list)  # of a part: (moment, ms)
        self.followers = 0
        self.over = False  # the run was broken off: what fails from now on says nothing

    def answer(self, status):
        with self.lock:
            self.answers[status] += 1

    def fault(self, text):
        if self.over:
            return
        with self.lock:
            if len(self.faults) < 100:
                print(f"soak: {text}", file=sys.stderr, flush=True)
            self.faults.append(text)

    def take_times(self):
        with self.lock:
            taken, self.times = self.times, collections.defaultdict(list)
        return taken


class Client:
    """One connection that is kept. A request that met a connection which the daemon had closed is sent again: those
    that make something carry a key."""

    def __init__(self, service, tally):
        self.path, self.tally = service.address.removeprefix("unix:"), tally
        self.connection = None

    def close(self):
        if self.connection:
            self.connection.close()
        self.connection = None

    def exchange(self, method, path, body, headers):
        if not self.connection:
            self.connection = UnixConnection(self.path)
        self.connection.request(method, path, body, headers)
        reply = self.connection.getresponse()
        return reply.status, reply.read()

    def ask(self, method, path, document=None, expected=(200,), key=None, note=None):
        """Status and body. An answer with another status than the expected is a fault."""
        body = None if document is None else json.dumps(document)
        headers = {"Content-Type": "application/json"} if body else {}
        if key:
            headers["Idempotency-Key"] = key
        for again in (False, True):
            began = time.monotonic()
            try:
                status, text = self.exchange(method, path, body, headers)
                break
            except (http.client.HTTPException, OSError):
                self.close()
                if again:
                    raise
        if note:
            with self.tally.lock:
                self.tally.times[note].append((began, 1000 * (time.monotonic() - began)))
        self.tally.answer(status)
        if status not in expected:
            self.tally.fault(f"{method} {path}: {status} {text[:300]!r}")
        return status, text

    def get(self, path, **more):
        return json.loads(self.ask("GET", path, **more)[1])


class Follower:
    """An event stream, read without waiting. HTTP/1.0, so that the body is not in chunks."""

    def __init__(self, service, path, leaves, tally, last=None):
        self.path, self.leaves, self.tally = path, leaves, tally
        self.of_job, self.last, self.first, self.text = path.startswith("/v1/jobs/"), last, True, b""
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.settimeout(PATIENCE_S)
        self.socket.connect(service.address.removeprefix("unix:"))
        resume = "" if last is None else f"Last-Event-ID: {last}\r\n"
        self.socket.sendall(f"GET {path} HTTP/1.0\r\nHost: localhost\r\nAccept: text/event-stream\r\n{resume}\r\n".encode())
        self.socket.setblocking(False)

    def read(self):
        """Takes what has come; False at the end."""
        try:
            data = self.socket.recv(65536)
        except BlockingIOError:
            return True
        self.text += data
        while b"\n\n" in self.text or b"\r\n\r\n" in self.text:
            at = [i for i in (self.text.find(b"\n\n"), self.text.find(b"\r\n\r\n")) if i >= 0]
            block, self.text = self.text[:min(at)], self.text[min(at):].lstrip(b"\r\n")
            self.take(block.decode())
        if not data:
            self.tally.fault(f"{self.path}: the stream has ended")
        return bool(data)

    def take(self, block):
        if block.startswith("HTTP/"):
            status = int(block.split()[1])
            self.tally.answer(status)
            if status != 200:
                self.tally.fault(f"{self.path}: {block}")
            return
        fields = dict(line.split(": ", 1) for line in block.splitlines() if ": " in line)
        if "data" not in fields or "id" not in fields:
            return
        number, position = int(fields["id"]), fields["event"] == "position"
        if self.first and not self.of_job and not position:
            self.tally.fault(f"{self.path}: begins with {block!r}")
        if self.last is not None and (number < self.last or (number == self.last and not position)):
            self.tally.fault(f"{self.path}: {number} after {self.last}")
        self.first, self.last = False, number


class Soak:
    def __init__(self, options, where):
        self.options, self.where = options, where
        self.rng = random.Random(options.seed)
        self.tally = Tally()
        self.parts, self.stored, self.deleted, self.held = [], 0, 0, 0
        self.submitted = 0  # jobs of KINDS, of all parts
        self.jobs = []  # of this part: (kind, id)
        self.recent = collections.deque(maxlen=500)  # ids that are looked at
        self.whole = {}  # kind: hash of the points of a job of it
        self.position = None
        self.load_s = 0.0  # of this part: what has been submitted, at the pace that was asked for; the pace of the other clients
        self.service, self.stop = None, threading.Event()

    def begin(self):
        roots = self.where / "inputs"
        roots.mkdir()
        subprocess.run([self.options.built / "hexad-worker", "make-example", roots / "a.0001.vdb"], check=True,
                       timeout=PATIENCE_S)
        for frame in (2, 3):
            os.link(roots / "a.0001.vdb", roots / f"a.{frame:04d}.vdb")
        (roots / "damaged.ply").write_bytes(b"ply\nformat ascii 1.0\nelement vertex 3\nend_header\n1 2")
        self.inputs = roots
        self.service = Service(self.options.built, self.where, "--listen", f"unix:{self.where}/socket", "--workers", 2,
                               "--threads", 2, "--log_level", "info", "--input_roots", roots, "--kept_documents",
                               KEPT_DOCUMENTS)
        self.service.start()
        self.client = Client(self.service, self.tally)
        # it is paused before it runs, as both workers are busy; its labels let events of it reach every follower
        busy = [self.submit("cancelled") for _ in range(2)]
        for job in busy:
            self.wait_for(job, lambda d: d["state"] == "running")
        self.gate = self.submit("small", {"labels": ["array", "nothing"]})
        self.hold(self.gate)
        for job in busy:
            self.client.ask("POST", f"/v1/jobs/{job}/cancel", expected=(200, 202))

    # ---- jobs

    def spec(self, kind, name):
        spec = {"version": 1, "name": name, "sampling": {"count": 100}, "output": {"preview": False},
                "solver": {"seed": self.rng.randrange(1 << 30)},
                "surface": {"analytic": {"shape": "sphere", "center": [0, 0, 0], "radius": 1}},
                "queue": {"labels": [kind, f"label-{self.stored % 7}"]}}
        if kind == "preview":
            spec["output"] = {"preview": {"size": [64, 64]}}
        elif kind == "array":
            spec["surface"] = {"vdb": {"path": f"{self.inputs}/a.####.vdb"}}
            spec["queue"]["frames"] = "1-3"
        elif kind == "damaged":
            spec["surface"] = {"mesh": {"path": f"{self.inputs}/damaged.ply"}}
        elif kind == "memory":
            spec["sampling"], spec["limits"] = {"count": 10**7}, {"memory_mb": 64}
        elif kind == "again":
            spec["solver"]["seed"] = 1
        elif kind == "cancelled":
            spec |= {key: long_sphere()[key] for key in ("sampling", "solver")}
        return spec

    def submit(self, kind, queue=None):
        name = f"{kind}-{self.stored}"
        spec = self.spec(kind, name)
        spec["queue"] |= queue or {}
        document = json.loads(self.client.ask("POST", "/v1/jobs", spec, (201,), key=name, note="submit")[1])
        self.stored += 1
        self.recent.append(document["id"])
        return document["id"]

    def hold(self, job):
        self.client.ask("POST", f"/v1/jobs/{job}/pause", expected=(200,))
        self.held += 1

    def submit_waiting(self):
        """One that stays in the queue: it depends on what never ends, or it is paused before that could matter."""
        if self.held % 2:
            self.submit("waiting", {"depends_on": [self.gate]})
            self.held += 1
        else:
            self.hold(self.submit("waiting", {"depends_on": [self.gate]}))

    def submit_next(self):
        kind = KINDS[self.submitted % len(KINDS)]
        self.submitted += 1
        if kind == "refused":
            self.client.ask("POST", "/v1/jobs", {"version": 1, "surface": {}}, (422,))
        else:
            self.jobs.append((kind, self.submit(kind)))
            if kind == "cancelled":  # at once: two of them would keep both workers from those that are waited for
                self.cancel_running(self.jobs[-1][1])

    def cancel_running(self, job):
        self.wait_for(job, lambda d: d["state"] in ("running", *FINAL))
        self.client.ask("POST", f"/v1/jobs/{job}/cancel", expected=(200, 202))

    def wait_for(self, job, done):
        def look():
            self.check_stopped()
            document = self.client.get(f"/v1/jobs/{job}")
            return done(document) and document
        return poll(look, f"the job {job}")

    def follow_up(self, index):
        """What is done with a job that was submitted a while ago."""
        kind, job = self.jobs[index]
        if kind == "cancelled":
            return
        if index % 4 == 0:
            if self.wait_for(job, lambda d: d["state"] in FINAL)["state"] == "succeeded":
                self.fetch(kind, job)
        elif index % 4 == 1:
            self.wait_for(job, lambda d: d["state"] in FINAL)
            self.check_end(kind, job)
            self.client.ask("DELETE", f"/v1/jobs/{job}", expected=(204,))
            self.jobs[index] = ("deleted", job)
            self.deleted += 1

    def fetch(self, kind, job):
        """All files of a result, each of the length and with the hash that its listing has."""
        frame = "?frame=2" if kind == "array" else ""
        listed = self.client.get(f"/v1/jobs/{job}/results{frame}")["results"]
        if not {"points.ply", "report.json"} <= {r["name"] for r in listed}:
            self.tally.fault(f"the result of {job} is not whole: {listed}")
        for result in listed:
            data = self.client.ask("GET", result["href"])[1]
            if len(data) != result["bytes"] or hashlib.sha256(data).hexdigest() != result["sha256"]:
                self.tally.fault(f"{result['href']} is not what its listing says")
            if kind == "again" and result["name"] == "points.ply":
                if self.whole.setdefault(kind, result["sha256"]) != result["sha256"]:
                    self.tally.fault(f"{job} has other points than a job with the same spec")

    def check_end(self, kind, job):
        if kind == "deleted":
            self.client.ask("GET", f"/v1/jobs/{job}", expected=(404,))
            return
        document = self.client.get(f"/v1/jobs/{job}")
        found = document["state"], (document["error"] or {}).get("code")
        if found != ENDS[kind]:
            self.tally.fault(f"the job {document['name']} ({job}) ended as {found}")

    # ---- clients beside them, in threads of their own

    def watched(self, work):
        try:
            work()
        except Exception as e:  # noqa: BLE001: a client that dies is a fault of the run, whatever it died of
            self.tally.fault(f"{work.__name__}: {e!r}")

    def look(self):
        """Looks at jobs, lists them, and asks for events since the last time."""
        client, rng = Client(self.service, self.tally), random.Random(self.options.seed)
        queries = ("limit=50", "limit=50&state=blocked", "limit=20&label=array", "limit=20&state=failed")
        number = 0
        while not self.stop.wait(0.02):
            if number >= self.load_s * LOOKS_A_SECOND:
                continue
            number += 1
            client.ask("GET", f"/v1/jobs/{rng.choice(self.recent)}", expected=(200, 404), note="status")
            if number % LOOKS_A_SECOND in range(0, LOOKS_A_SECOND, LOOKS_A_SECOND // LISTS_A_SECOND):
                client.ask("GET", f"/v1/jobs?{queries[number % len(queries)]}", note="list")
            if number % (2 * LOOKS_A_SECOND) == 0:
                after = "" if self.position is None else f"?after={self.position}"
                self.position = client.get(f"/v1/events{after}")["position"]
        client.close()

    def follow(self):
        """Followers come, stay for a while, and go; some go on where another stopped."""
        rng, open_ones, last = random.Random(self.options.seed), selectors.DefaultSelector(), None
        stay = min(20, 6 * self.options.minutes)
        while not self.stop.is_set():
            now = time.monotonic()
            if self.tally.followers < self.load_s * self.options.followers / 60:
                self.tally.followers += 1
                path = rng.choice(("/v1/events", "/v1/events", "/v1/events?label=array", "/v1/events?label=nothing",
                                   f"/v1/jobs/{self.gate}/events"))
                resumes = last if path == "/v1/events" and rng.random() < 0.4 else None
                one = Follower(self.service, path, now + rng.uniform(0.25, 1) * stay, self.tally, resumes)
                open_ones.register(one.socket, selectors.EVENT_READ, one)
            for key, _ in open_ones.select(0.05):
                if not key.data.read():
                    key.data.leaves = 0
            for key in [k for k in open_ones.get_map().values() if k.data.leaves < time.monotonic()]:
                open_ones.unregister(key.data.socket)
                key.data.socket.close()
                last = key.data.last or last
        for key in open_ones.get_map().values():
            key.data.socket.close()

    def measure_machine(self):
        while not self.stop.wait(0.5):
            self.yardsticks.append(yardstick_ms())

    # ---- parts

    def check_stopped(self):
        self.tally.over = self.options.broken
        if self.options.broken:
            raise Broken

    def figure(self, name):
        text = self.client.ask("GET", "/metrics")[1].decode()
        return float(re.search(rf"^{name} (\S+)$", text, re.MULTILINE).group(1))

    def settle(self):
        """Until nothing runs."""
        def look():
            self.check_stopped()
            return not any(self.client.get(f"/v1/jobs?state={state}&limit=1")["jobs"]
                           for state in ("queued", "running", "cancelling"))
        poll(look, "all jobs to end", 5 * PATIENCE_S)

    def levels(self):
        """What the daemon holds when nobody else is connected. It notices that a follower is gone when it has something to
        send: an event that passes every filter."""
        self.client.ask("PATCH", f"/v1/jobs/{self.gate}", {"priority": len(self.parts)})
        poll(lambda: self.figure("hexad_http_connections") == 1, "the followers' connections to be closed")
        proc = pathlib.Path(f"/proc/{self.service.process.pid}")
        status = dict(line.split(":\t", 1) for line in (proc / "status").read_text().splitlines() if ":\t" in line)
        database = [self.service.state / f"queue.db{end}" for end in ("", "-wal")]
        return {"rss_mb": int(status["VmRSS"].split()[0]) / 1024, "anonymous_mb": int(status["RssAnon"].split()[0]) / 1024,
                "descriptors": len(os.listdir(proc / "fd")), "threads": int(status["Threads"]),
                "database_mb": sum(f.stat().st_size for f in database if f.exists()) / 2**20,
                "events": self.client.get("/v1/events")["position"], "held": self.held, "stored": self.stored - self.deleted}

    def run_load(self, count, waiting):
        """Submits that many jobs at an even pace, and as many that wait beside them."""
        began, first_held = time.monotonic(), self.held
        for number in range(count + BEHIND):
            self.check_stopped()
            if number < count:
                delay = began + number / self.options.rate - time.monotonic()
                if delay > 0:
                    time.sleep(delay)  # the pace of the load
                self.submit_next()
                self.load_s = (number + 1) / self.options.rate
                while self.held - first_held < waiting * (number + 1) // count:
                    self.submit_waiting()
            if BEHIND <= number < BEHIND + len(self.jobs):
                self.follow_up(number - BEHIND)

    def run_part(self, waiting):
        count = round(60 * self.options.minutes * self.options.rate / PARTS)
        self.jobs, self.yardsticks, self.tally.followers = [], [yardstick_ms()], 0
        self.tally.take_times()
        self.load_s = 0.0
        self.stop.clear()
        before, began = cpu_seconds(self.service.process.pid)[0], time.monotonic()
        clients = [threading.Thread(target=self.watched, args=[work]) for work in (self.look, self.follow, self.measure_machine)]
        for thread in clients:
            thread.start()
        try:
            self.run_load(count, waiting)
            self.settle()
        finally:
            self.stop.set()
            for thread in clients:
                thread.join()
        cpu, took = cpu_seconds(self.service.process.pid)[0] - before, time.monotonic() - began
        part = {"jobs": len(self.jobs), "seconds": took, "cpu_s": cpu, "followers": self.tally.followers,
                "cpu_ms_a_job": 1000 * cpu / len(self.jobs), "yardstick_ms": statistics.median(self.yardsticks)}
        part["cost"] = part["cpu_ms_a_job"] / part["yardstick_ms"]
        part |= self.latencies(began, took)
        for kind, job in self.jobs:
            self.check_stopped()
            self.check_end(kind, job)
        part |= self.levels()
        self.parts.append(part)
        print(f"tenth {len(self.parts)}: " + ", ".join(
            f"{name} {form.format(part[key])}" for key, name, form in verdicts.COLUMNS), flush=True)

    def latencies(self, began, took):
        """Of submit, status and list: the median of all, and that of the slices' 99th percentiles."""
        found = {}
        for what, samples in self.tally.take_times().items():
            slices = collections.defaultdict(list)
            for moment, ms in samples:
                slices[min(SLICES - 1, int((moment - began) / took * SLICES))].append(ms)
            found[f"{what}_p50_ms"] = statistics.median(ms for _, ms in samples)
            found[f"{what}_p99_ms"] = statistics.median(percentile(s, 0.99) for s in slices.values())
        return found

    def check_all(self):
        """At the end every job is there once, as often as was counted."""
        ids, cursor = [], ""
        while cursor is not None:
            page = self.client.get(f"/v1/jobs?limit=500{cursor}")
            ids += [job["id"] for job in page["jobs"]]
            cursor = f"&cursor={page['next']}" if page["next"] else None
        if len(ids) != len(set(ids)) or len(ids) != self.stored - self.deleted:
            self.tally.fault(f"{len(set(ids))} jobs in {len(ids)} places of the listing, where {self.stored - self.deleted}"
                             " are in the queue")

    def end(self):
        if not self.service or not self.service.process:
            return
        self.client.close()
        if self.service.process.poll() is not None:
            self.tally.fault(f"the daemon ended by itself: {self.service.process.returncode}")
        elif not self.tally.over and self.service.end() != 0:
            self.tally.fault(f"the daemon ended with {self.service.process.returncode}")
        self.service.clean_up()
        if self.tally.over:
            return
        with sqlite3.connect(self.service.state / "queue.db") as database:
            if database.execute("PRAGMA integrity_check").fetchone() != ("ok",):
                self.tally.fault("the database is damaged")
        database.close()

    def run(self):
        """Whether it came to its end."""
        try:
            self.begin()
            for part in range(PARTS):
                self.run_part(self.options.more * (part + 1) // PARTS - self.options.more * part // PARTS)
            self.check_all()
        except Exception as e:  # noqa: BLE001: what was measured before is still judged and printed
            if not self.options.broken:  # a signal of a terminal ends the daemon, too
                self.tally.fault(f"the run could not go on: {e!r}")
            return False
        finally:
            self.end()
        return True


def about(options):
    model = re.search(r"^model name\s*: (.*)$", pathlib.Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return {"cpu": model.group(1) if model else "unknown", "cores": len(os.sched_getaffinity(0)), "load": os.getloadavg()[0],
            "when": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%MZ"), "minutes": options.minutes,
            "rate": options.rate, "followers": options.followers, "more": options.more, "seed": options.seed}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--built", type=pathlib.Path, required=True)
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--more", type=int, default=None)
    parser.add_argument("--rate", type=float, default=4)
    parser.add_argument("--followers", type=float, default=100)
    parser.add_argument("--untimed", action="store_true")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=pathlib.Path, default=HERE / "soak.csv")
    parser.add_argument("--figures", type=pathlib.Path, default=pathlib.Path("soak.json"))
    parser.add_argument("--place", type=pathlib.Path, default=None)
    options = parser.parse_args()
    options.built = options.built.resolve()
    options.more = round(10000 * options.minutes / 60) if options.more is None else options.more
    options.broken = False

    def break_off(number, frame):
        options.broken = True  # clients look at it between two requests

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, break_off)
    told = about(options)
    with tempfile.TemporaryDirectory(dir=options.place) as where:
        soak = Soak(options, pathlib.Path(where))
        whole = soak.run()
    judged = verdicts.judge(soak.parts, soak.tally.answers, soak.tally.faults, not options.untimed,
                            options.more if whole else None, b"__asan_init" in (options.built / "hexad").read_bytes())
    options.figures.write_text(json.dumps(
        {"about": told, "whole": whole, "parts": soak.parts, "answers": soak.tally.answers, "faults": soak.tally.faults,
         "verdicts": [v._asdict() for v in judged]}, indent=1) + "\n")
    tenths, found = verdicts.rows_of_parts(soak.parts), [*verdicts.rows_of_verdicts(judged), *verdicts.rows_about(told)]
    for row in (verdicts.PART_NAMES, *tenths, verdicts.VERDICT_NAMES, *found):
        print(*row, sep=", ")
    missed = any(v.met is False for v in judged)
    if not whole:
        print("broken off: no results were written")
        return 1 if missed else 2
    results.write(options.output, verdicts.VERDICT_NAMES, found)
    results.write(options.output.with_name(f"{options.output.stem}_tenths.csv"), verdicts.PART_NAMES, tenths)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
