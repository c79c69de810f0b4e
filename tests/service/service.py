# SPDX-License-Identifier: Apache-2.0
"""A daemon in a state directory of its own, specs of jobs for it, and what tests ask of it over HTTP."""
import hashlib
import http.client
import json
import os
import pathlib
import shlex
import signal
import socket
import subprocess
import time

# what the setting tcp_without_tokens wants to hear
OPEN_TCP = "anyone-on-this-machine-may-submit-and-cancel"
PATIENCE_S = 300  # for a loaded machine and sanitizers; a test that works never waits that long
# words in front of the daemon's own: a program that runs it and looks on (tests/valgrind/run)
UNDER = shlex.split(os.environ.get("HEXAD_UNDER", ""))
# Tools that report leaks at the end of a process: a daemon is then ended by a signal, not killed.
CHECKED = bool(UNDER) or os.environ.get("HEXAD_TIER") == "sanitized"


def wait_until(condition, what, seconds=PATIENCE_S, interval=0.01):
    """The first true value of condition(), which is evaluated every `interval` seconds until then; after a while rarer, as an
    evaluation is work for the test and often for the daemon: the end is seen a twentieth of the time that passed late."""
    start = time.monotonic()
    while True:
        value = condition()
        if value:
            return value
        passed = time.monotonic() - start
        assert passed < seconds, f"waited in vain for {what}"
        time.sleep(max(interval, min(passed / 20, 0.2)))  # between two evaluations, not a guess at a duration


def aged(path):
    """A file that was changed long before now is what the cache trusts; the time of change of an inode cannot be set,
    so the test waits until it is old enough."""
    wait_until(lambda: time.time() - path.stat().st_ctime > 3, "the file to be older than the clocks' doubt")


def sphere(count=200, **parts):
    """A spec of a job that takes a moment."""
    spec = {
        "version": 1,
        "surface": {"analytic": {"shape": "sphere", "center": [0, 0, 0], "radius": 1}},
        "sampling": {"count": count},
        "output": {"preview": {"size": [64, 64]}},
    }
    spec.update(parts)
    return spec


def long_sphere(count=20000, **parts):
    """A spec of a job that runs until it is stopped."""
    solver = {"max_sweeps": 1000000, "step_tolerance": 1e-12, "energy_tolerance": 1e-12}
    return sphere(count=count, solver=solver, **parts)


# the rings of frames 2, 4 and 5 are too thin for so few points to have six neighbours
PARTLY_UNRESOLVED = sphere(
    100, surface={"analytic": {"shape": "torus", "center": [0, 0, 0], "major_radius": 1, "minor_radius": 0.4}},
    outcome={"require": {"hex_fraction": 0.5}}, output={"preview": False},
    queue={"frames": "1-5", "by_frame": {"/surface/analytic/minor_radius": [0.4, 0.02, 0.4, 0.02, 0.02]}})

# The contract of a worker, held by one that runs until its gate opens: a file beside the state directory. Like the worker, it
# writes into its directory also if that is renamed.
GATED_WORKER = """#!/bin/sh
%s
spec=$(cat)
D="$4"
job=${D##*/}
base=${D%%/*/*/*}
cd "$D"
echo '{"phase":"relax","fraction":0.5}' >&3
while ! [ -e "$base/open.${job%%.*}" ]; do sleep 0.01; done
printf x > points.ply
printf '{"outcome":"converged","count":7,"outputs":[{"name":"points.ply","bytes":1,"sha256":"%s"}]}' > report.json
"""


def last_words(done):
    """Of a worker that failed: the JSON object at the end of its standard error."""
    words = json.loads(done.stderr.splitlines()[-1])
    assert set(words) <= {"code", "message", "errors"} and words["message"]
    return words


def gated_worker(where, deaf=False):
    """A program to be given as --worker: no job ends before Service.open_gate. A deaf one does not hear SIGTERM."""
    path = pathlib.Path(where) / "gated-worker"
    path.write_text(GATED_WORKER % ("trap '' TERM" if deaf else ":", hashlib.sha256(b"x").hexdigest()))
    path.chmod(0o700)
    return path


def processes():
    """pid -> (parent, state, command) of all processes."""
    found = {}
    for entry in pathlib.Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            command, _, rest = (entry / "stat").read_text().partition("(")[2].rpartition(")")
        except OSError:
            continue
        fields = rest.split()
        found[int(entry.name)] = (int(fields[1]), fields[0], command)
    return found


def cpu_seconds(pid):
    """Processor time of a process, and of its children that it has waited for."""
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    ticks = os.sysconf("SC_CLK_TCK")
    return sum(map(int, fields[11:13])) / ticks, sum(map(int, fields[13:15])) / ticks


class Reply:
    def __init__(self, status, headers, body):
        self.status, self.headers, self.body = status, headers, body

    @property
    def json(self):
        return json.loads(self.body)


class UnixConnection(http.client.HTTPConnection):
    def __init__(self, path):
        super().__init__("localhost", timeout=PATIENCE_S)
        self.path = path

    def connect(self):
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(self.timeout)
        self.sock.connect(self.path)


class Service:
    """One daemon; may be started again in the same state directory."""

    def __init__(self, build, base, *options):
        self.build, self.base = build, pathlib.Path(base)
        self.options = [str(o) for o in options]
        for key, value in (("--listen", "127.0.0.1:0"), ("--tcp_without_tokens", OPEN_TCP), ("--workers", "2"),
                           ("--reserve_mb", "1"), ("--estimate_timeout_s", str(PATIENCE_S)), ("--log_level", "debug")):
            if key not in self.options:
                self.options += [key, value]
        self.state = self.base / "state"
        self.port_file = self.base / "port"
        self.process = None
        self.clock = None  # of setclock.py, or what else has an `environment` that preloads a library
        self.under = UNDER
        self.starts = 0

    def start(self, *more):
        self.port_file.unlink(missing_ok=True)
        self.starts += 1
        self.log = self.base / f"log.{self.starts}"
        with open(self.log, "wb") as log:
            self.process = subprocess.Popen(
                [*self.under, self.build / "hexad", "--port_file", self.port_file, "--state_dir", self.state,
                 *self.options, *map(str, more)],
                stderr=log, stdin=subprocess.DEVNULL, env=self.clock and self.clock.environment)
        wait_until(lambda: self.port_file.exists() or self.process.poll() is not None, "the daemon")
        assert self.process.poll() is None, self.log.read_text()
        self.address = self.port_file.read_text().strip()
        return self

    def end(self, number=signal.SIGTERM):
        """Sends a signal and waits; returns the exit status."""
        self.process.send_signal(number)
        return self.process.wait(PATIENCE_S)

    def clean_up(self):
        if CHECKED and self.process and self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)  # the second one cuts the drain short
            self.process.send_signal(signal.SIGINT)
            wait_until(lambda: self.process.poll() is not None, "the daemon's end")
            log = self.log.read_text(errors="replace")
            assert "LeakSanitizer" not in log, log[log.index("LeakSanitizer"):]
        if self.process and self.process.poll() is None:
            self.process.kill()
            self.process.wait()

    def children(self):
        return [pid for pid, (parent, state, _) in processes().items()
                if parent == self.process.pid and state != "Z"]

    def workers_of(self, job):
        """Worker processes, whoever their parent is, that run the job."""
        found = []
        for pid, (_, state, _) in processes().items():
            try:
                words = pathlib.Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
            except OSError:
                continue
            if state != "Z" and any(f"/attempts/{job}.".encode() in w for w in words):
                found.append(pid)
        return found

    def connection(self):
        if self.address.startswith("unix:"):
            return UnixConnection(self.address.removeprefix("unix:"))
        host, _, port = self.address.rpartition(":")
        return http.client.HTTPConnection(host.strip("[]"), int(port), timeout=PATIENCE_S)

    def request(self, method, path, body=None, headers=None):
        connection = self.connection()
        try:
            connection.request(method, path, body, headers or {})
            reply = connection.getresponse()
            return Reply(reply.status, reply.headers, reply.read())
        finally:
            connection.close()

    def get(self, path):
        return self.request("GET", path)

    def post(self, path, document=None, raw=None):
        body = raw if raw is not None else json.dumps(document) if document is not None else None
        return self.request("POST", path, body, {"Content-Type": "application/json"})

    def submit(self, spec):
        reply = self.post("/v1/jobs", spec)
        assert reply.status == 201, reply.body
        return reply.json["id"]

    def job(self, job):
        reply = self.get(f"/v1/jobs/{job}")
        assert reply.status == 200, reply.body
        return reply.json

    def wait_state(self, job, *states, seconds=PATIENCE_S):
        final = ("succeeded", "failed", "cancelled", "timed_out")
        # for a final state the daemon answers when the job has ended, at the latest after this time
        headers = {"Prefer": "wait=0.5"} if set(states) <= set(final) else {}

        def look():
            reply = self.request("GET", f"/v1/jobs/{job}", headers=headers)
            assert reply.status == 200, reply.body
            now = reply.json
            if now["state"] in states:
                return now
            over = now["state"] in final
            assert not over, f"wanted {states}, got {now}\n{self.log.read_text()}"
            return None
        return wait_until(look, f"{job} to be one of {states}", seconds)

    def wait_worker(self, job):
        """The pid of the worker that runs the job, once it reports progress."""
        wait_until(lambda: self.job(job)["progress"], "progress")
        return wait_until(lambda: self.workers_of(job), "the worker")[0]

    def open_gate(self, job):
        """Lets a job of the gated worker end."""
        (self.base / f"open.{job}").touch()

    def remove_jobs(self):
        """Cancels and deletes all jobs."""
        def remove():
            jobs = self.get("/v1/jobs?limit=500").json["jobs"]
            for job in jobs:
                if self.request("DELETE", f"/v1/jobs/{job['id']}").status == 409:
                    self.post(f"/v1/jobs/{job['id']}/cancel")
            return not jobs
        wait_until(remove, "the removal of all jobs")

    def environment(self):
        address = self.address if self.address.startswith("unix:") else f"http://{self.address}"
        return {**os.environ, "HEXAD_SERVER": address}


class Stream:
    """An open stream of events."""

    def __init__(self, service, path, last=None, token=None):
        self.socket = service.connection()
        headers = {"Accept": "text/event-stream"}
        if last is not None:
            headers["Last-Event-ID"] = str(last)
        if token is not None:
            headers["Authorization"] = f"Bearer {token}"
        self.socket.request("GET", path, headers=headers)
        self.reply = self.socket.getresponse()

    def __iter__(self):
        """The events: (id or None, type, document). The id of progress is a text, of others a number."""
        event = {}
        for line in self.reply:
            name, _, value = line.decode().rstrip("\n").partition(": ")
            if name:
                event[name] = value
            elif event:
                if "data" in event:
                    number = event.get("id")
                    if number and event["event"] != "progress":
                        number = int(number)
                    yield number, event["event"], json.loads(event["data"])
                event = {}

    def close(self):
        self.socket.close()


def expect_problem(reply, status, code, pointer=None):
    assert reply.status == status, reply.body
    assert reply.headers["Content-Type"] == "application/problem+json"
    problem = reply.json
    assert problem["status"] == status and problem["code"] == code, problem
    assert problem["title"] and problem["detail"] and problem["type"]
    if pointer is not None:
        assert pointer in [e["pointer"] for e in problem["errors"]], problem
        assert all(e["detail"] for e in problem["errors"])
    return problem


def exchange(service, data):
    """Sends bytes as they are, but for the address for "Host: x", and returns all that comes until the server closes."""
    data = data.replace(b"Host: x\r\n", f"Host: {service.address}\r\n".encode())
    host, _, port = service.address.rpartition(":")
    with socket.create_connection((host, int(port)), timeout=PATIENCE_S) as s:
        try:
            s.sendall(data)
        except (BrokenPipeError, ConnectionResetError):
            pass
        got = b""
        try:
            while piece := s.recv(65536):
                got += piece
        except ConnectionResetError:
            pass
        return got
