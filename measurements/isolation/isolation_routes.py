# SPDX-License-Identifier: Apache-2.0
"""Three modes of measurements/isolation/isolation.py, which measure each row of the table of routes.

--routes SECONDS: one client sends the request of each row over 200 connections: anonymously, with a token of scope read, and with one
that may submit. Another user measures GET /healthz, GET of a job and POST of a job beside it. The rows are those of the OpenAPI document,
with streams and long files in addition. Goals: p99 at most 50, 50 and 150 ms above that of the echo.

Pages of tasks and attempts are of an array of 100 000 frames, 500 of which have results. Pages of events and files have 500 elements, too.

--writes: one user makes the largest permitted calls of each writing route whose work grows with its call, 32 at once; another user
measures POST of a job until all are answered. user_tasks is 0. Goal: p99 at most 300 ms above that of the echo.

--serving-thread: the processor time that one request of each row takes in the thread that serves all connections, from
/proc/PID/task/TID/schedstat: the median of 100 requests on one connection. This includes receiving, the head and sending, so the calls of
handlers take less. HEAD shows the time of a GET without sending the body. Goal: no call of a handler, keeper, opener, sink or copy of a stream
takes more than 0.2 ms. A row without such a call is only received and sent there.
"""
import collections
import concurrent.futures
import hashlib
import http.client
import itertools
import json
import multiprocessing
import os
import pathlib
import re
import secrets
import selectors
import shutil
import socket
import sqlite3
import statistics
import sys
import time

from isolation import MEASURED, Client, Daemon, Measured, ball, be_last, fill, outcome, percentile, results

CONNECTIONS = 200
LOADER = "loader"
CLASSES = {"anonymous": None, "reader": ("read",), "submitter": ("read", "submit", "cancel")}
GOALS_MS = {"GET /healthz": 50, "GET /v1/jobs/ID": 50, "POST /v1/jobs": 150}
PAUSE_S = 0.005  # between two rounds of the measuring user
REQUESTS = 100  # of each row, for a median
GOAL_CPU_MS = 0.2
PIECE, SINK_PIECE = 65536, 16384  # of files; of uploads, header_limit_bytes
LONG_BYTES = 16 << 20  # of a result, and of an upload
BACKLOG = 50000  # events
FRAMES, WITH_RESULT = 100000, 500  # of the array
WRITES, NEEDS = 32, 1000  # calls at once; jobs in depends_on and in after
WRITE_GOAL_MS, WRITE_PATIENCE_S = 300, 1800
STREAM_BYTES = 1 << 20  # of a stream, after which the client closes it and begins again
ROUTES_COLUMNS = ["row", "answers_per_s", "echo_p99_ms", "healthz_p99_ms", "status_p99_ms", "post_p99_ms", "goals"]
WRITES_COLUMNS = ["row", "answers", "seconds", "echo_p99_ms", "post_number", "post_p99_ms", "post_longest_ms", "goal"]
THREAD_COLUMNS = ["row", "calls", "status", "answer_bytes", "whole_request_ms", "head_ms"]
SOURCE = pathlib.Path(__file__).resolve().parents[2] / "src/service/api/routes.c"


# ---- the calls in the serving thread, by the table of routes

def serving_calls(text):
    """operation -> the calls that the server makes in the serving thread, for each row of the table in routes.c."""
    calls = {}
    for row in re.split(r"\{\.method = ", text)[1:]:
        word = lambda member: (re.search(rf"\.{member} = (\w+|\"[^\"]*\")", row) or [None, ""])[1]
        name, place = word("name").strip('"'), word("runs_in")
        if not name or not place.startswith("ROUTE_"):
            raise ValueError(f"routes.c: the row {row[:60]!r} does not say where its handler runs: set .runs_in")
        calls[name] = [call for call, found in (("handler", place == "ROUTE_SERVING_THREAD"), ("keeper", word("kept")), ("opener", word("opener")),
                                                ("sink", word("opener")), ("copy of a stream", word("streams") == "true")) if found]
    return calls


# ---- a service with something to ask for

class Scene:
    """The daemon, and a job of the loader with a result, a long file, an upload and a backlog of events."""

    def __init__(self, options, base):
        self.daemon = Daemon(options, base)
        self.tokens = {name: self.daemon.token(LOADER, scopes) if scopes else None for name, scopes in CLASSES.items()}
        self.own = self.daemon.token(MEASURED, ("read", "submit", "cancel"))
        self.admin = self.daemon.token("root", ("read", "submit", "cancel", "admin"))
        self.daemon.start()
        if options.jobs:
            fill(self.daemon, options.jobs, self.tokens["submitter"])
        client = Client(self.daemon.address, self.tokens["submitter"])
        self.document = client.ask("GET", "/v1/openapi.json").json
        self.upload = b"OFF\n# uploaded\n4 4 0\n1 1 1\n1 -1 -1\n-1 1 -1\n-1 -1 1\n3 0 1 2\n3 0 3 1\n3 0 2 3\n3 1 3 2\n"
        client.ask("PUT", f"/v1/inputs/{hashlib.sha256(self.upload).hexdigest()}", raw=self.upload,
                   headers={"Content-Type": "application/octet-stream"})
        self.gone = client.ask("POST", "/v1/jobs", ball(2)).json["id"]  # deleted by the first request that may
        self.job = client.ask("POST", "/v1/jobs", ball(1, name="for-all")).json["id"]
        while client.ask("GET", f"/v1/jobs/{self.job}", headers={"Prefer": "wait=10"}).json["state"] != "succeeded":
            pass
        (base / "inputs" / "a.000001.off").write_bytes(self.upload)
        boss = Client(self.daemon.address, self.admin)
        boss.ask("POST", "/v1/admin/hold")
        self.array = client.ask("POST", "/v1/jobs", frames(0)).json["id"]
        client.ask("POST", f"/v1/jobs/{self.array}/cancel")
        boss.ask("POST", "/v1/admin/release")
        boss.close()
        client.close()
        self.lengthen(base)
        self.page = next((f for f in ("page.js", "main.js", "index.html")
                          if Client(self.daemon.address).ask("GET", f"/page/{f}").status == 200), "index.html")

    def lengthen(self, base):
        """Adds events of the job, and makes its file long, while the daemon is stopped."""
        self.daemon.end()
        with sqlite3.connect(self.daemon.state / "queue.db") as db:
            db.execute("WITH RECURSIVE n (i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < ?2)"
                       " INSERT INTO event (at_ms, job, type, state) SELECT 0, seq, 'edited', 'queued' FROM job, n WHERE id = ?1",
                       (self.job, BACKLOG))
            array, maker = (db.execute("SELECT seq FROM job WHERE id = ?", (i,)).fetchone()[0] for i in (self.array, self.job))
            db.execute("INSERT INTO attempt (job, task, number, started_ms, finished_ms, exit_status, host, reason) SELECT job, number, 1, 0, 1, 0,"
                       " 'here', 'ended' FROM task WHERE job = ?", (array,))
            db.execute("UPDATE task SET attempt = 1, state = iif(number < ?2, 'succeeded', state), outcome = iif(number < ?2, 'converged', NULL)"
                       " WHERE job = ?1", (array, WITH_RESULT))
            db.execute("UPDATE job SET attempts = ?2, succeeded = ?3, cancelled = cancelled - ?3 WHERE seq = ?1", (array, FRAMES, WITH_RESULT))
            db.execute("INSERT INTO event (at_ms, job, type, state, frame, attempt) SELECT 0, job, 'started', 'running', frame, 1 FROM task"
                       " WHERE job = ?", (array,))
        db.close()
        for frame in range(1, WITH_RESULT + 1):
            shutil.copytree(self.daemon.state / "results" / self.job, self.daemon.state / "results" / f"{self.array}.{frame}", copy_function=os.link)
        file = self.daemon.state / "results" / self.job / "points.ply"
        with open(file, "r+b") as out:
            out.truncate(LONG_BYTES)
        for name in ("report.json", "summary.json"):
            path = self.daemon.state / "results" / self.job / name
            if path.exists():
                path.write_text(path.read_text().replace('"bytes":1,', f'"bytes":{LONG_BYTES},'))
        self.daemon.start()

    def rows(self):
        """(name, method, path, operation) of each row, and of what a row can do in addition."""
        for path, methods in self.document["paths"].items():
            for method, operation in methods.items():
                if method != "parameters":
                    yield operation["operationId"], method.upper(), path, operation

    def target(self, name, path):
        values = {"id": self.gone if name == "deleteJob" else self.job, "name": self.page if path.startswith("/page/") else "report.json",
                  "sha256": hashlib.sha256(self.upload).hexdigest()}
        return re.sub(r"\{(\w+)\}", lambda m: values[m[1]], path)

    def body(self, name, number):
        """The body of a request, or None; different each time where equal ones take less."""
        if name in ("submitJob", "validateJob"):
            return json.dumps(ball(10**6 + number, queue={"retention_s": 60})).encode()
        made = {"editJob": {"priority": number % 5}, "signIn": {"token": "hexad_" + "0" * 16},
                "inspectInput": {"path": f"sha256/{hashlib.sha256(self.upload).hexdigest()}"}}
        return json.dumps(made[name]).encode() if name in made else None

    def request(self, row, token, number, method=None, query="", headers=(), body=None):
        """The bytes of a request."""
        name, usual, path, operation = row
        target, lines, body = self.target(name, path), list(headers), body or self.body(name, number)
        if name == "putInput":
            body = secrets.token_bytes(4096)
            target = f"/v1/inputs/{hashlib.sha256(body).hexdigest()}"
            lines.append("Content-Type: application/octet-stream")
        elif body is not None:
            lines.append("Content-Type: application/json")
        if token:
            lines.append(f"Authorization: Bearer {token}")
        if body is not None or (method or usual) not in ("GET", "HEAD"):
            lines.append(f"Content-Length: {len(body or b'')}")
        host = "%s:%d" % self.daemon.address
        return "\r\n".join([f"{method or usual} {target}{query} HTTP/1.1", f"Host: {host}", *lines, "", ""]).encode() + (body or b"")


def loads(scene):
    """(title, row, query, headers) of each row, and of streams, long files and long pages."""
    for row in scene.rows():
        yield row[0], row, "", ()
        if row[0] in ("listTasks", "listAttempts", "followJob"):
            after = "&after=0" if row[0] == "followJob" else ""
            yield row[0] + " (500)", (row[0], row[1], row[2].replace("{id}", scene.array), row[3]), "?limit=500" + after, ()
        elif row[0] == "followJobs":
            yield row[0] + " (500)", row, "?limit=500&after=0&all=1", ()
        elif row[0] == "listFiles":
            yield row[0] + " (500)", row, f"?limit=500&path={scene.daemon.base}/inputs", ()
        if row[0] in ("followJob", "followJobs"):
            all_jobs = "&all=1" if row[0] == "followJobs" else ""
            yield row[0] + " (backlog)", row, "?after=0" + all_jobs, ("Accept: text/event-stream",)
            if all_jobs:
                yield row[0] + " (new events)", row, "?all=1", ("Accept: text/event-stream",)
        if row[0] == "listJobs":
            yield row[0] + " (500)", row, "?limit=500", ()
        elif row[0] == "getResult":
            yield row[0] + f" ({LONG_BYTES >> 20} MiB)", (row[0], row[1], f"/v1/jobs/{scene.job}/results/points.ply", row[3]), "", ()


# ---- the load: one process, 200 connections, each with one request after the other

class Line:
    """A connection of the loader."""

    def __init__(self, address):
        self.address, self.socket = address, None
        self.restart()

    def restart(self):
        if self.socket:
            self.socket.close()
        self.socket = socket.socket()
        self.socket.setblocking(False)
        self.socket.connect_ex(self.address)
        self.out, self.head, self.left, self.got = b"", b"", None, 0

    def take(self, piece, statuses):
        """Takes received bytes. True: the answer has ended; None: the connection has to end, too."""
        self.got += len(piece)
        if self.left is None:
            self.head += piece
            end = self.head.find(b"\r\n\r\n")
            if end < 0:
                return False
            head, body = self.head[:end].lower(), len(self.head) - end - 4
            statuses[self.head[9:12].decode(errors="replace")] += 1
            length = re.search(rb"\ncontent-length: (\d+)", head)
            self.close = b"connection: close" in head
            self.left = (int(length[1]) if length else 0 if head[9:12] in (b"204", b"304") else float("inf")) - body
        else:
            self.left -= len(piece)
        if self.got > STREAM_BYTES and self.left == float("inf"):
            return None
        if self.left > 0:
            return False
        self.head, self.left, self.got = b"", None, 0
        return None if self.close else True


def load(scene, row, token, query, headers, end, pipe):
    """Sends the requests until `end`; reports the first answer, and at the end the number of answers of each status."""
    os.setsid()
    be_last()
    chosen, statuses, number = selectors.DefaultSelector(), collections.Counter(), 0
    lines = [Line(scene.daemon.address) for _ in range(CONNECTIONS)]
    for line in lines:
        chosen.register(line.socket, selectors.EVENT_WRITE, line)

    def begin_again(line):
        try:
            chosen.unregister(line.socket)
        except (KeyError, ValueError):
            pass
        line.restart()
        chosen.register(line.socket, selectors.EVENT_WRITE, line)

    told = False
    while not end.is_set():
        if statuses and not told:
            pipe.send("ready")
            told = True
        for key, events in chosen.select(0.05):
            line = key.data
            try:
                if events & selectors.EVENT_WRITE:
                    if not line.out:
                        number += 1
                        line.out = scene.request(row, token, number, query=query, headers=headers)
                    line.out = line.out[line.socket.send(line.out):]
                    if not line.out:
                        chosen.modify(line.socket, selectors.EVENT_READ, line)
                    continue
                piece = line.socket.recv(262144)
                done = line.take(piece, statuses) if piece else None
            except OSError:
                done = None
            if done is None:
                begin_again(line)
            elif done:
                chosen.modify(line.socket, selectors.EVENT_WRITE, line)
    pipe.send(dict(statuses))
    os._exit(0)


def measure(measured, seconds):
    """name -> times in ms, and the number of faults."""
    times, end, measured.faults = collections.defaultdict(list), time.monotonic() + seconds, []
    while time.monotonic() < end:
        measured.timed(times, "echo", measured.beat)
        measured.timed(times, "GET /healthz", lambda: measured.client.ask("GET", "/healthz"), 200)
        measured.timed(times, "GET /v1/jobs/ID", lambda: measured.client.ask("GET", f"/v1/jobs/{measured.job}"), 200)
        made = measured.timed(times, "POST /v1/jobs", measured.submit, 201)
        measured.job = made.json["id"] if made else measured.job
        time.sleep(PAUSE_S)
    return times


def routes(options, base):
    """The mode --routes."""
    scene = Scene(options, base)
    measured, missed, rows = Measured(scene.daemon, scene.own), [], []
    print(f"measurements/isolation/isolation.py --routes {options.routes:g}: {os.cpu_count()} processors, load average {os.getloadavg()[0]:.1f}\n")
    print(*ROUTES_COLUMNS, sep=", ", flush=True)
    try:
        for title, row, query, headers in loads(scene):
            if options.only and row[0] not in options.only:
                continue
            for caller, token in scene.tokens.items():
                end, (near, far) = multiprocessing.Event(), multiprocessing.Pipe(False)
                loader = multiprocessing.Process(target=load, args=(scene, row, token, query, headers, end, far))
                loader.start()
                near.recv()
                times = measure(measured, options.routes)
                end.set()
                statuses = near.recv() if near.poll(60) else {}
                loader.join(10)
                loader.kill()
                p99 = {name: percentile(values, .99) for name, values in times.items()}
                late = [name for name, most in GOALS_MS.items() if p99.get(name, float("inf")) > p99["echo"] + most]
                faults = measured.faults[:1]
                answers = "; ".join(f"{status}: {count / options.routes:.0f}" for status, count in sorted(statuses.items()))
                rows.append([f"{title} {caller}", answers, *(f"{p99.get(n, float('nan')):.1f}" for n in ("echo", *GOALS_MS)),
                             outcome(not late and not faults)])
                print(*rows[-1], sep=", ", flush=True)
                missed += [f"{title}, {caller}: {name}" for name in late] + [f"{title}, {caller}: {fault}" for fault in faults]
    finally:
        scene.daemon.process.kill()
        scene.daemon.process.wait()
    if options.output:
        results.write(options.output, ROUTES_COLUMNS, rows)
    print("\n" + ("\n".join(f"missed: {text}" for text in missed) or "All goals are met."))
    return 1 if missed else 0


# ---- the largest calls of routes that write

def frames(number, count=FRAMES, **queue):
    """A spec with many frames, which wait behind all other jobs. Only the file of the first one exists."""
    return ball(number, surface={"mesh": {"path": "a.######.off"}}, queue={"frames": f"1-{count}", "priority": -1000, **queue})


def writes_of(scene):
    """(title, calls) in their order; a call is (method, path, document). The jobs of earlier calls are those of later ones."""
    post = lambda documents: [("POST", "/v1/jobs", document) for document in documents]
    tell = lambda made, word: [("POST", f"/v1/jobs/{job}/{word}", None) for job in made]
    client = Client(scene.daemon.address, scene.tokens["submitter"])
    held = client.ask("POST", "/v1/jobs", frames(1, depends_on=[client.ask("POST", "/v1/jobs", frames(2)).json["id"]])).json["id"]
    needs = [client.ask("POST", "/v1/jobs", ball(10 + i, queue={"depends_on": [held]})).json["id"] for i in range(2 * NEEDS)]
    client.close()
    yield "submitJob (100 000 frames)", post(frames(100 + i) for i in range(WRITES))
    arrays = scene.made
    yield "submitJob (a pattern of 100 000 files)", post(
        ball(200 + i, surface={"mesh": {"path": "{file}"}}, queue={"files": "many/*.off", "priority": -1000}) for i in range(WRITES))
    sets = scene.made
    yield "submitJob (2 000 jobs to wait for)", post(
        ball(300 + i, queue={"depends_on": needs[:NEEDS], "after": needs[NEEDS:]}) for i in range(WRITES))
    yield "submitJob (100 000 frames that wait for frames)", post(frames(400 + i, after_frames=[arrays[i]]) for i in range(WRITES))
    waiting = scene.made
    yield "editJob", [("PATCH", f"/v1/jobs/{job}", {"labels": [f"label{i}" for i in range(32)], "priority": -999}) for job in arrays]
    yield "cancelJob (an array for whose frames another one waits)", tell(arrays, "cancel")
    yield "retryJob (100 000 frames)", tell(arrays, "retry")
    yield "cancelJob (again)", tell(arrays, "cancel")
    yield "retryJob (with dependents)", [(m, p + "?dependents=1", d) for m, p, d in tell(arrays, "retry")]
    yield "cancelJob (data sets)", tell(sets, "cancel")
    yield "cancelJob (2 000 jobs wait)", tell([held], "cancel")
    yield "deleteJob (data sets)", [("DELETE", f"/v1/jobs/{job}", None) for job in sets]
    for job in arrays + waiting:
        Client(scene.daemon.address, scene.tokens["submitter"]).ask("POST", f"/v1/jobs/{job}/cancel")
    yield "deleteJob (100 000 frames)", [("DELETE", f"/v1/jobs/{job}", None) for job in arrays + waiting]


def send_all(address, token, calls, pipe):
    """Sends all calls, WRITES of them at once; reports the statuses and the ids of jobs."""
    be_last()

    def send(call):
        client = Client(address, token, WRITE_PATIENCE_S)
        answer = client.ask(*call, headers={"Content-Type": "application/json"} if call[2] else None)
        client.close()
        return answer.status, answer.json.get("id") if answer.status == 201 else answer.body[:200].decode()

    with concurrent.futures.ThreadPoolExecutor(WRITES) as pool:
        pipe.send(list(pool.map(send, calls)))


def writes(options, base):
    """The mode --writes."""
    scene = Scene(options, base)
    (base / "inputs" / "many").mkdir()
    for i in range(FRAMES):
        (base / "inputs" / "many" / f"{i:06}.off").touch()
    measured, missed, rows = Measured(scene.daemon, scene.own), [], []
    print(f"measurements/isolation/isolation.py --writes: {os.cpu_count()} processors, load average {os.getloadavg()[0]:.1f}\n")
    print(*WRITES_COLUMNS, sep=", ", flush=True)
    try:
        for title, calls in writes_of(scene):
            near, far = multiprocessing.Pipe(False)
            sender = multiprocessing.Process(target=send_all, args=(scene.daemon.address, scene.tokens["submitter"], calls, far))
            sender.start()
            times, began, measured.faults = collections.defaultdict(list), time.monotonic(), []
            while not near.poll() and sender.is_alive():
                measured.timed(times, "echo", measured.beat)
                measured.timed(times, "POST", measured.submit, 201)
                time.sleep(PAUSE_S)
            if not near.poll(1):
                raise RuntimeError(f"{title}: the sender has failed")
            answers, seconds = near.recv(), time.monotonic() - began
            sender.join()
            scene.made = [made for status, made in answers if status == 201]
            statuses = collections.Counter(status for status, _ in answers)
            refused = [text for status, text in answers if status >= 300]
            p99 = {name: percentile(values, .99) for name, values in times.items()}
            met = p99["POST"] <= p99["echo"] + WRITE_GOAL_MS and not measured.faults and not refused
            rows.append([title, "; ".join(f"{s}: {n}" for s, n in sorted(statuses.items())), f"{seconds:.1f}", f"{p99['echo']:.1f}",
                         len(times["POST"]), f"{p99['POST']:.1f}", f"{max(times['POST']):.0f}", outcome(met)])
            print(*rows[-1], sep=", ", flush=True)
            missed += [] if met else [f"{title}: {(measured.faults + refused + ['late'])[0]}"]
    finally:
        scene.daemon.process.kill()
        scene.daemon.process.wait()
    if options.output:
        results.write(options.output, WRITES_COLUMNS, rows)
    print("\n" + ("\n".join(f"missed: {text}" for text in missed) or "All goals are met."))
    return 1 if missed else 0


# ---- the times in the serving thread

class Thread:
    """The serving thread of the daemon: the one that works most for each burst of requests that need no other."""

    def __init__(self, scene):
        client, least = Client(scene.daemon.address), {}
        tasks = list(pathlib.Path(f"/proc/{scene.daemon.process.pid}/task").iterdir())
        for _ in range(20):
            before = {task: self.read(task) for task in tasks}
            for _ in range(20):
                client.ask("GET", "/version")
            least = {task: min(self.read(task) - before[task], least.get(task, 10**18)) for task in tasks}
        client.close()
        self.task = max(tasks, key=least.get)
        assert least[self.task] > 0

    @staticmethod
    def read(task):
        return int((task / "schedstat").read_text().split()[0])

    def sleeps(self):
        return (self.task / "stat").read_text().rpartition(")")[2].split()[0] == "S"

    def ns(self):
        """Its processor time, once it has nothing to do."""
        while True:
            seen = self.read(self.task)
            if self.sleeps() and self.read(self.task) == seen:
                return seen


def cpu_ms(thread, act, count=REQUESTS):
    """The median processor time, in ms, of the serving thread for one call of `act`."""
    times = []
    for _ in range(count):
        before = thread.ns()
        act()
        times.append((thread.ns() - before) / 1e6)
    return statistics.median(times)


class Connection:
    """One connection, which sends prepared bytes and reads a whole answer."""

    def __init__(self, address):
        self.address, self.connection = address, None

    def ask(self, data, method):
        if not self.connection:
            self.connection = socket.create_connection(self.address)
        self.connection.sendall(data)
        answer = http.client.HTTPResponse(self.connection, method=method)
        answer.begin()
        length = len(answer.read())
        if answer.will_close:
            self.connection.close()
            self.connection = None
        return answer.status, length


def serving_thread(options, base):
    """The mode --serving-thread."""
    scene, calls = Scene(options, base), serving_calls(SOURCE.read_text())
    missed = [f"{name}: no row of routes.c" for name, *_ in scene.rows() if name not in calls]
    thread, connection, rows = Thread(scene), Connection(scene.daemon.address), []
    print(*THREAD_COLUMNS, sep=", ", flush=True)
    try:
        for row in scene.rows():
            name, method = row[0], row[1]
            token = scene.tokens["submitter"] if "submitter" and name not in ("drain", "resume", "hold", "release", "getBackup") else scene.admin
            sent = []

            def ask(method=method):
                sent.append(connection.ask(scene.request(row, token, len(sent), method=method), method))

            whole = cpu_ms(thread, ask)
            status, length = sent[-1]
            head = cpu_ms(thread, lambda: ask("HEAD")) if method == "GET" else whole
            rows.append([name, ", ".join(calls[name]) or "-", status, length, f"{whole:.3f}", f"{head:.3f}"])
            print(*rows[-1], sep=", ", flush=True)
            if {"handler", "keeper"} & set(calls.get(name, ())) and head > GOAL_CPU_MS:
                missed.append(f"{name}: {head:.3f} ms")
            if name in ("drain", "hold"):
                ask_end = scene.request((name, method, "/v1/admin/" + {"drain": "resume", "hold": "release"}[name], row[3]), token, 0)
                connection.ask(ask_end, method)
        for what, call, ms in long_bodies(scene, thread, connection):
            rows.append([what, call, "", "", f"{ms:.3f}", ""])
            print(*rows[-1], sep=", ", flush=True)
            missed += [f"{what}: {ms:.3f} ms"] if ms > GOAL_CPU_MS else []
        for what, ms in data_sets(scene, thread, connection):
            rows.append([what, "-", 201, "", f"{ms:.3f}", f"{ms:.3f}"])
            print(*rows[-1], sep=", ", flush=True)
    finally:
        scene.daemon.process.kill()
        scene.daemon.process.wait()
    if options.output:
        results.write(options.output, THREAD_COLUMNS, rows)
    print("\n" + ("\n".join(f"missed: {text}" for text in missed) or "All goals are met."))
    return 1 if missed else 0


def long_bodies(scene, thread, connection):
    """(what, call, ms of one call) of the calls that receive or send in pieces."""
    token, row = scene.tokens["submitter"], {r[0]: r for r in scene.rows()}
    head = scene.request(row["putInput"], token, 0).partition(b"\r\n\r\n")[0]
    openers = []

    def put(body):
        """Sends a file; the body after the serving thread has read the head."""
        lines = re.sub(rb"Content-Length: \d+", b"Content-Length: %d" % len(body), head)
        lines = re.sub(rb"/v1/inputs/\w+", b"/v1/inputs/" + hashlib.sha256(body).hexdigest().encode(), lines)
        with socket.create_connection(scene.daemon.address) as one:
            time.sleep(0.002)  # the connection is accepted
            before = now = thread.ns()
            one.sendall(lines + b"\r\n\r\n")
            while now == before:
                now = thread.ns()
            openers.append((now - before) / 1e6)
            one.sendall(body)
            http.client.HTTPResponse(one, method="PUT").begin()

    for _ in range(REQUESTS):
        put(secrets.token_bytes(4096))
    yield "putInput: the head and the opener", "opener", statistics.median(openers)
    upload = secrets.token_bytes(LONG_BYTES)
    yield ("putInput: the sink, for each 16 KiB", "sink",
           cpu_ms(thread, lambda: put(secrets.token_bytes(32) + upload[32:]), 10) * SINK_PIECE / LONG_BYTES)
    file = (*row["getResult"][:2], f"/v1/jobs/{scene.job}/results/points.ply", row["getResult"][3])
    yield ("getResult: for each 64 KiB", "-",
           cpu_ms(thread, lambda: connection.ask(scene.request(file, token, 0), "GET"), 10) * PIECE / LONG_BYTES)
    chunks = []

    def follow():
        one = socket.create_connection(scene.daemon.address)
        one.sendall(scene.request(row["followJobs"], token, 0, query="?after=0&all=1", headers=("Accept: text/event-stream",)))
        got = b""
        while len(got) < 4 * STREAM_BYTES:
            got += one.recv(262144)
        one.close()
        chunks.append(len(re.findall(rb"\r\n[0-9a-fA-F]+\r\n", got)))

    yield ("followJobs: a copy of a stream, with its two resumptions", "copy of a stream",
           cpu_ms(thread, follow, 5) / statistics.median(chunks))


def data_sets(scene, thread, connection):
    """(what, ms) of POST with queue.files. The last measurement: the jobs are held, and their files are no meshes."""
    row, = (r for r in scene.rows() if r[0] == "submitJob")
    connection.ask(scene.request(("hold", "POST", "/v1/admin/hold", None), scene.admin, 0), "POST")
    inputs, numbers = scene.daemon.base / "inputs", itertools.count(2 * 10**6)
    names = sorted(str(path) for path in inputs.glob("empty*"))
    for what, files in (("a pattern of 1 000 files", str(inputs / "empty*")), ("a list of 1 000 files", names)):
        def submit(files=files):
            spec = {**ball(next(numbers)), "surface": {"mesh": {"path": "{file}"}}, "queue": {"files": files, "retention_s": 60}}
            body = json.dumps(spec).encode()
            status, _ = connection.ask(scene.request(row, scene.tokens["submitter"], 0, body=body), "POST")
            assert status == 201, status

        yield f"submitJob: {what}", cpu_ms(thread, submit, 20)
