# SPDX-License-Identifier: Apache-2.0
"""A daemon to be killed, clients that load it, and the book of what they were told, which must hold for ever."""
import hashlib
import http.client
import json
import os
import pathlib
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
import zlib

sys.path[:0] = [str(pathlib.Path(__file__).parent.parent / "service"), str(pathlib.Path(__file__).parent.parent)]
import setclock  # noqa: E402
from calls import Supervisor  # noqa: E402
from service import PATIENCE_S, Service, UnixConnection, processes, wait_until  # noqa: E402

FRAMES = (1, 2)
FINAL = ("succeeded", "failed", "cancelled", "timed_out")
MOST_UNFINISHED = 8  # clients wait when so many jobs have not ended, so that jobs end between two kills

MANY = 100  # attempts of a job that is to succeed however often its workers are killed
# reasons of attempts that were given back, since it was not their doing that they ended
GIVEN_BACK = ("the daemon ended", "the host restarted", "drained: ", "not started: ")


class Violation(Exception):
    """What must never be was seen."""


def spec(name, count=100, preview=False, **parts):
    """Of a job that takes a moment; the name says which it is, and makes it another than those that were run before."""
    return {"version": 1, "name": name, "sampling": {"count": count}, "solver": {"seed": zlib.crc32(name.encode())},
            "surface": {"analytic": {"shape": "sphere", "center": [0, 0, 0], "radius": 1}},
            "output": {"preview": {"size": [64, 64]} if preview else False}, **parts}


def make_footage(build, where):
    """Files for sequences(); the directory."""
    where.mkdir(parents=True, exist_ok=True)
    first, *others = [where / f"a.{frame:04d}.vdb" for frame in FRAMES]
    subprocess.run([build / "hexad-worker", "make-example", first], check=True, timeout=PATIENCE_S)
    for other in others:
        shutil.copyfile(first, other)
    return where


def sequence(name, footage):
    """Of a job with a task for each frame."""
    return {**spec(name), "surface": {"vdb": {"path": f"{footage}/a.####.vdb"}},
            "queue": {"frames": f"{FRAMES[0]}-{FRAMES[-1]}"}}


class Daemon(Service):
    """Serves a Unix socket, so that what connects after a kill never meets another program on a port."""

    def __init__(self, build, base, *options):
        base = pathlib.Path(base)
        base.mkdir(parents=True, exist_ok=True)
        self.socket = base / "socket"
        # what dies is tried again at once and without end, so that much dies in little time
        super().__init__(build, base.resolve(), "--listen", f"unix:{self.socket.resolve()}", "--retry_s", 0.02,
                         "--retry_most_s", 0.1, "--max_interruptions", 0, "--log_level", "info", *options)
        self.log = self.base / "log"

    def words(self):
        return [str(w) for w in (self.build / "hexad", "--port_file", self.port_file, "--state_dir", self.state,
                                 *self.options)]

    def backup(self, path):
        """Has a copy of the database made, whether it runs or not; the completed process."""
        return subprocess.run([*self.words(), "--backup", path], capture_output=True, text=True, timeout=PATIENCE_S)

    def spawn(self, judge=None, *more):
        """Starts it and does not wait; under supervision (calls.py) when there is a judge."""
        self.port_file.unlink(missing_ok=True)
        with open(self.log, "ab") as log:
            if judge:
                self.supervisor = Supervisor(self.state, judge, self.words(), stderr=log, stdin=subprocess.DEVNULL)
                self.process = self.supervisor.process
            else:
                self.process = subprocess.Popen([*self.words(), *more], stderr=log, stdin=subprocess.DEVNULL,
                                                env=self.clock and self.clock.environment)
        return self

    def await_served(self):
        """True once it serves; False when it ended instead."""
        wait_until(lambda: self.port_file.exists() or self.dead(), "the daemon")
        return not self.dead()

    def start(self, *more):
        self.spawn(None, *more)
        if not self.await_served():
            raise Violation(f"the daemon does not start (exit status {self.process.returncode}):"
                            f" {self.log.read_text()[-2000:]}")
        return self

    def connection(self):
        return UnixConnection(str(self.socket))

    def ask(self, method, path, document=None, headers=None):
        """A reply that came whole; None when none did."""
        try:
            body = None if document is None else json.dumps(document)
            return self.request(method, path, body, {"Content-Type": "application/json", **(headers or {})})
        except (OSError, http.client.HTTPException):
            return None

    def dead(self):
        return self.process is None or self.process.poll() is not None

    def kill(self):
        self.process.kill()
        self.process.wait(PATIENCE_S)

    def end_by_drain(self):
        status = self.end()
        if status != 0:
            raise Violation(f"a drain ended with exit status {status}: {self.log.read_text()[-1000:]}")

    def family(self, below=""):
        """Processes that were given a path below the state directory."""
        found = []
        for pid, (_, state, _) in processes().items():
            try:
                words = pathlib.Path(f"/proc/{pid}/cmdline").read_bytes()
            except OSError:
                continue
            if state != "Z" and os.fsencode(self.state / below) in words:
                found.append(pid)
        return found

    def workers(self):
        return self.family("attempts")

    def await_nobody(self):
        """After a kill: nothing of it may live on."""
        try:
            wait_until(lambda: not self.family(), "the workers' end", 30)
        except AssertionError:
            left = [f"{pid} {pathlib.Path(f'/proc/{pid}/cmdline').read_bytes()!r}" for pid in self.family()]
            for pid in self.family():
                os.kill(pid, signal.SIGKILL)
            if left:
                raise Violation(f"processes outlive the daemon: {left}") from None

    def check_database(self, query="SELECT 1"):
        """On a copy: to open it is to recover it, which is the daemon's to do. The rows of a query of it."""
        with tempfile.TemporaryDirectory(dir=self.base) as copy:
            for path in self.state.glob("queue.db*"):
                shutil.copyfile(path, pathlib.Path(copy) / path.name)
            database = sqlite3.connect(f"file:{copy}/queue.db?mode=rw", uri=True) \
                if (self.state / "queue.db").exists() else sqlite3.connect(":memory:")
            found = database.execute("PRAGMA integrity_check").fetchall()
            broken = database.execute("PRAGMA foreign_key_check").fetchall()
            rows = database.execute(query).fetchall()
            database.close()
        if found != [("ok",)] or broken:
            raise Violation(f"the database is damaged: {found[:3]} {broken[:3]}")
        return rows


class Moments:
    """How long changes of each kind take, so that kills hit any moment of one."""

    def __init__(self):
        self.seconds = {}

    def reach(self, kind, rng, lasts, look):
        """Calls look() until a random moment of a change that has just begun; whether it still lasted then. The moment is the random
        thing that is tested, so it is not waited for by a condition."""
        begun, usual = time.monotonic(), self.seconds.get(kind, 1)
        moment, passed = rng.uniform(0, 1.1) * usual, 0
        while passed < moment and lasts():
            look()
            time.sleep(0.005)
            passed = time.monotonic() - begun
        lasted = lasts()
        self.seconds[kind] = 1.2 * usual if lasted else passed
        return lasted


class Book:
    """Thread-safe. What was sent, accepted, and told to have ended; acceptances are on disk before they count. Where
    faults are made on purpose the book is `tolerant`: an answer may be that the service failed, in these words; and
    `forgiving`: any job may fail."""

    def __init__(self, journal=None, tolerant=False, forgiving=False):
        self.tolerant, self.forgiving = tolerant, forgiving
        self.mutex = threading.Lock()
        self.sent, self.accepted, self.ended, self.cancelled = {}, {}, {}, set()
        self.doubtful, self.deleted = set(), set()  # deletions that were asked for, and those that were answered
        self.unanswered = []  # to be sent again under their keys
        self.replies = {}
        self.restored = False  # whether an older database was put back, so that results may lie in lost+found
        self.untidy = False  # whether attempts may have left more than their logs: an fsync failed that would tell
        self.files = 0  # fetched and compared
        self.journal = journal and open(journal, "a", encoding="ascii")

    def close(self):
        if self.journal:
            self.journal.close()

    def accept(self, job, name):
        if self.journal:
            with self.mutex:
                self.journal.write(f"{job} {name}\n")
                self.journal.flush()
            os.fsync(self.journal.fileno())
        with self.mutex:
            if name in self.accepted.values() and self.accepted.get(job) != name:
                raise Violation(f"the job {name} was accepted twice, the second time as {job}")
            self.accepted[job] = name

    def unfinished(self):
        with self.mutex:
            return [job for job in self.accepted if job not in self.ended and job not in self.deleted]

    def count_reply(self, status):
        with self.mutex:
            self.replies[status] = self.replies.get(status, 0) + 1

    def submit(self, daemon, document):
        """Sends one job; its id when it was accepted. One without an answer is to be sent again: `unanswered`."""
        name = document["name"]
        with self.mutex:
            again = name in self.sent
            self.sent[name] = document
        reply = daemon.ask("POST", "/v1/jobs", document, {"Idempotency-Key": name})
        self.count_reply("no answer" if reply is None else f"{reply.status} again" if again else str(reply.status))
        if reply is None or reply.status >= 500:
            with self.mutex:
                self.unanswered.append(document)
        if reply is None:
            return None
        if reply.status == 201:
            self.accept(reply.json["id"], name)
            return reply.json["id"]
        if reply.status < 500 or not reply.json.get("code") or not reply.json.get("detail"):
            raise Violation(f"a good job is refused with {reply.status} {reply.body!r}")
        return None

    def is_no_answer(self, reply):
        if reply is None:
            return True
        is_stopping = reply.status == 503 and reply.json["detail"].startswith("the service is stopping")
        return is_stopping or self.tolerant and reply.status >= 500 and bool(reply.json["detail"])

    def look(self, daemon, job):
        """Reads a job and holds it against what is known; its document, None without an answer. Of one that
        succeeded all results are fetched."""
        known, cancelled = self.ended.get(job), job in self.cancelled  # before it is asked
        deleted = job in self.deleted
        reply = daemon.ask("GET", f"/v1/jobs/{job}")
        if self.is_no_answer(reply):
            return None
        if reply.status == 404 and job in self.doubtful:
            with self.mutex:
                self.deleted.add(job)
            return {"state": "deleted"}
        if deleted:
            raise Violation(f"the deleted job {job} is there: {reply.status} {reply.body!r}")
        if reply.status != 200:
            raise Violation(f"the accepted job {job} is not there: {reply.status} {reply.body!r}")
        now = reply.json
        if now["name"] != self.accepted[job]:
            raise Violation(f"the job {job} is {now['name']}, not {self.accepted[job]}")
        state = now["state"]
        if known and known[0] != state:
            raise Violation(f"the job {job} was {known[0]} and is {state}")
        if cancelled and state in ("failed", "timed_out"):
            raise Violation(f"the cancelled job {job} is {state}: {now['error']}")
        if state in FINAL:
            self.check_end(daemon, now, known)
        return now

    def check_end(self, daemon, now, known):
        job, digest = now["id"], None
        if now["state"] == "succeeded":
            if now["outcome"] not in ("converged", "unresolved", "not_converged"):
                raise Violation(f"the job {job} succeeded without an outcome")
            document = self.sent[now["name"]]
            queries = [f"?frame={frame}" for frame in FRAMES] if "queue" in document else [""]
            digest = [self.fetch(daemon, job, document["sampling"]["count"], query) for query in queries]
            if None in digest:
                return
        elif now["state"] != "cancelled" and not (now["error"] and now["error"]["code"] and now["error"]["message"]):
            raise Violation(f"the job {job} is {now['state']} and does not say why")
        if now["state"] == "failed" and not self.forgiving and not self.check_failure(daemon, now):
            return
        if known and known[1] != digest:
            raise Violation(f"the job {job} has another result than before")
        with self.mutex:
            self.ended[job] = (now["state"], digest)

    def check_failure(self, daemon, now):
        """A job fails when the attempts that count are spent, no sooner and no later; False without an answer."""
        attempts, after = [], ""
        while after is not None:
            reply = daemon.ask("GET", f"/v1/jobs/{now['id']}/attempts?limit=500{after}")
            if self.is_no_answer(reply) or reply.status == 404 and now["id"] in self.doubtful:
                return False
            attempts += reply.json["attempts"]
            after = reply.json["next"] and f"&after={reply.json['next']}"
        most, spent = self.sent[now["name"]]["limits"]["max_attempts"], {}
        for attempt in attempts:
            if not attempt["reason"].startswith(GIVEN_BACK):
                spent[attempt.get("frame")] = spent.get(attempt.get("frame"), 0) + 1
        if max(spent.values(), default=0) != most:
            raise Violation(f"the job {now['id']} failed with {spent} of {most} attempts spent: {now['error']},"
                            f" {attempts}")
        return True

    def fetch(self, daemon, job, count, query):
        """Every file of a result, held against its listing; the hash of the report. None without an answer."""
        listing = daemon.ask("GET", f"/v1/jobs/{job}/results{query}")
        if listing is not None and listing.status == 404 and job in self.doubtful:
            return None
        if self.is_no_answer(listing):
            return None
        if listing.status != 200:
            raise Violation(f"the results of {job} are not served: {listing.status} {listing.body!r}")
        digests = {}
        for item in listing.json["results"]:
            reply = daemon.ask("GET", item["href"])
            if self.is_no_answer(reply) or reply.status == 404 and job in self.doubtful:
                return None
            digests[item["name"]] = hashlib.sha256(reply.body).hexdigest()
            if reply.status != 200 or len(reply.body) != item["bytes"] or digests[item["name"]] != item["sha256"]:
                raise Violation(f"{item['href']} is served as {reply.status}, {len(reply.body)} bytes: {item}")
            if item["name"] == "points.ply" and f"element vertex {count}\n".encode() not in reply.body:
                raise Violation(f"{item['href']} has not {count} points")
            with self.mutex:
                self.files += 1
        if not {"points.ply", "report.json"} <= set(digests):
            raise Violation(f"the results of {job} are {sorted(digests)}")
        return digests["report.json"]

    def settle(self, daemon):
        """Until every accepted job has ended."""
        def all_ended():
            for job in self.unfinished():
                self.look(daemon, job)
            return not self.unfinished() or daemon.dead()
        wait_until(all_ended, f"the end of {len(self.unfinished())} jobs", 2 * PATIENCE_S)
        if daemon.dead():
            raise Violation(f"the daemon ended with {daemon.process.returncode}: {daemon.log.read_text()[-1000:]}")

    def listed(self, daemon):
        """All jobs that the daemon knows: id -> document. More than were accepted: whose answers were cut off."""
        found, cursor = {}, ""
        while cursor is not None:
            reply = daemon.ask("GET", f"/v1/jobs?limit=100{cursor and '&cursor='}{cursor}")
            if reply is None or reply.status != 200:
                raise Violation(f"jobs are not listed: {reply and reply.body!r}")
            for job in reply.json["jobs"]:
                if job["id"] in found:
                    raise Violation(f"the job {job['id']} is listed twice")
                found[job["id"]] = job
            cursor = reply.json["next"]
        return found

    def adopt(self, daemon):
        """Takes up jobs that were stored although their answers did not arrive; none twice, none from nowhere. How
        many there were."""
        names, before = {}, len(self.accepted)
        for job, document in self.listed(daemon).items():
            name = document["name"]
            if job in self.deleted or name in names or name not in self.sent:
                raise Violation(f"the job {job} is there twice, or deleted, or was never sent: {name}")
            names[name] = job
            self.accepted.setdefault(job, name)
        return len(self.accepted) - before

    def places(self, daemon, job):
        """The names in `results` that the job is to have, each for a task that succeeded."""
        if "queue" not in self.sent[self.accepted[job]]:
            return [job] if self.ended[job][0] == "succeeded" else []
        tasks = daemon.ask("GET", f"/v1/jobs/{job}/tasks").json["tasks"]
        return [f"{job}.{task['frame']}" for task in tasks if task["state"] == "succeeded"]

    def check_all(self, daemon):
        """At rest: every job again, and the state directory as it has to be."""
        for job in list(self.accepted):
            if self.look(daemon, job) is None:
                raise Violation(f"the job {job} is not shown at rest")
        wanted = {place for job in self.accepted if job not in self.deleted for place in self.places(daemon, job)}

        def differ():
            return wanted ^ {path.name for path in (daemon.state / "results").iterdir()}
        try:
            wait_until(lambda: not differ(), "the removal of what was deleted", 30)
        except AssertionError:
            raise Violation(f"results without a job, or jobs without a result: {differ()}") from None
        if (daemon.state / "lost+found").exists() and not self.untidy and not self.restored:
            raise Violation(f"put aside: {[str(p) for p in (daemon.state / 'lost+found').rglob('*')][:9]}")
        for attempt in (daemon.state / "attempts").iterdir():
            left = {path.name for path in attempt.iterdir()} - {"worker.log"}
            if left and not self.untidy:
                raise Violation(f"{attempt.name} still holds {left}")


class Load:
    """Clients that submit, look, fetch and cancel from their own threads until they are stopped."""

    def __init__(self, daemon, book, seed, footage=None, submitters=2, outputs=None, uploads=None):
        """`outputs` is a directory for copies of results, which some jobs then ask for; `uploads` (uploads.py) a client of its own."""
        self.daemon, self.book, self.footage, self.outputs, self.uploads = daemon, book, footage, outputs, uploads
        self.over, self.failures = threading.Event(), []
        self.threads = [threading.Thread(target=self.guard, args=(self.submit, f"{seed}.{k}"), daemon=True)
                        for k in range(submitters)]
        self.threads.append(threading.Thread(target=self.guard, args=(self.read, f"{seed}.r"), daemon=True))
        if uploads:
            self.threads.append(threading.Thread(target=self.guard, args=(self.send, f"{seed}.u"), daemon=True))
        for thread in self.threads:
            thread.start()

    def guard(self, act, seed):
        try:
            act(random.Random(seed), seed)
        except Exception as e:
            self.failures.append(e)

    def submit(self, rng, seed):
        k = 0
        while not self.over.is_set() and not self.daemon.dead():
            if len(self.book.unfinished()) >= MOST_UNFINISHED:
                self.over.wait(0.01)
                continue
            with self.book.mutex:
                document = self.book.unanswered.pop() if self.book.unanswered else None
            document, k = document or self.invent(f"{seed}.{k}", rng), k + 1
            sent = self.uploads and self.uploads.be_read(self.daemon, self.book, document, rng)
            job = self.book.submit(self.daemon, document)
            if job and sent:
                self.uploads.change(self.daemon, self.book, sent, "DELETE")
            if job is None:
                self.over.wait(0.02)
            elif rng.random() < 0.08:
                self.cancel(job)

    def invent(self, name, rng):
        kind = rng.random()
        if self.footage and kind < 0.03:
            return {**sequence(name, self.footage), "limits": {"max_attempts": MANY}}
        document = spec(name, count=1500 if kind < 0.08 else rng.choice((60, 100, 200)), preview=kind > 0.85)
        if rng.random() < 0.2:
            document["solver"]["seed"] = 1  # its result may be there already
        document["limits"] = {"max_attempts": 1 if rng.random() < 0.25 else MANY}
        if self.outputs and rng.random() < 0.3:
            document["output"]["directory"] = f"{self.outputs}/{name}"
        return document

    def send(self, rng, seed):
        k = 0
        while not self.over.is_set() and not self.daemon.dead():
            self.uploads.act(self.daemon, self.book, f"{seed}.{k}", rng)
            k += 1
            self.over.wait(0.01)

    def cancel(self, job):
        reply = self.daemon.ask("POST", f"/v1/jobs/{job}/cancel")
        if reply is not None and reply.status in (200, 202) and reply.json["state"] == "cancelled":
            with self.book.mutex:
                self.book.ended.setdefault(job, ("cancelled", None))
        elif reply is not None and reply.status == 202:
            with self.book.mutex:
                self.book.cancelled.add(job)
        elif not self.book.is_no_answer(reply) and reply.status != 409 and not (self.book.forgiving and reply.status >= 500):
            raise Violation(f"a cancellation is answered with {reply.status} {reply.body!r}")

    def read(self, rng, _):
        while not self.over.is_set() and not self.daemon.dead():
            jobs = self.book.unfinished()
            if self.book.ended and rng.random() < 0.2:
                jobs = jobs + [rng.choice(list(self.book.ended))]
            for job in jobs:
                now = self.book.look(self.daemon, job)
                if now and now["state"] in FINAL and rng.random() < 0.05:
                    self.delete(job)
            self.over.wait(0.03)

    def delete(self, job):
        with self.book.mutex:
            self.book.doubtful.add(job)
        reply = self.daemon.ask("DELETE", f"/v1/jobs/{job}")
        if reply is not None and reply.status == 204:
            with self.book.mutex:
                self.book.deleted.add(job)
        elif not self.book.is_no_answer(reply) and reply.status not in (404, 409) and not self.book.forgiving:
            raise Violation(f"a deletion is answered with {reply.status} {reply.body!r}")

    def stop(self):
        self.over.set()
        for thread in self.threads:
            thread.join(PATIENCE_S)
        if self.failures:
            raise self.failures[0]
