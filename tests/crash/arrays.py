# SPDX-License-Identifier: Apache-2.0
"""Arrays of 100 000 frames and data sets: kills during their submission, cancellation, retry and deletion, which take many transactions.
No caller sees a part of a job, and the next start completes what was begun."""
import json
import random
import shutil
import sqlite3
import threading
import time

import restores
from farm import FINAL, Book, Daemon, Moments, Violation, spec, wait_until

FRAMES, FILES = 100_000, 20_000
CYCLES_A_ROUND = 20  # then all jobs are deleted, nothing may be left, and the next round begins
MOST_JOBS = 4
PAGE = 500  # most tasks of an answer
UNFINISHED = {"blocked", "queued", "running", "cancelling"}
GONE = "deleted"
ACTIONS = {"submit": {GONE}, "cancel": UNFINISHED, "retry": {"cancelled", "failed"}, "delete": set(FINAL)}  # the states before
CHANGES = {"cancel": ("POST", "/cancel", {"cancelling", "cancelled"}), "retry": ("POST", "/retry", UNFINISHED), "delete": ("DELETE", "", {GONE})}
DUPLICATES = 0.3  # the chance that a client sends its submission twice at the same time
AGAIN, AGAIN_S = 0.3, 0.5  # the chance of a kill while the next start completes a change, and the longest time until then
RESTORES = 0.15  # the chance that a backup which is made during a change is put back
TETRAHEDRON = "OFF\n4 4 0\n1 1 1\n1 -1 -1\n-1 1 -1\n-1 -1 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"

# rows of a copy of the database that contradict each other: what, and a query that counts them
CONTRADICTIONS = {
    "jobs whose counts are not those of their tasks":
        "SELECT count(*) FROM job WHERE (ready, delayed, running, succeeded, failed, cancelled, timed_out, held, tasks) IS NOT"
        " (SELECT count(*) FILTER (WHERE state = 'queued'), count(*) FILTER (WHERE state = 'delayed'),"
        " count(*) FILTER (WHERE state = 'running'), count(*) FILTER (WHERE state = 'succeeded'), count(*) FILTER (WHERE state = 'failed'),"
        " count(*) FILTER (WHERE state = 'cancelled'), count(*) FILTER (WHERE state = 'timed_out'),"
        " count(*) FILTER (WHERE state = 'queued' AND waits > 0), count(*) FROM task WHERE task.job = seq)",
    "users with a wrong number of unfinished tasks":
        "SELECT count(*) FROM owner WHERE tasks != coalesce((SELECT sum(ready + delayed + running) FROM job WHERE job.owner = owner.name), 0)",
    "users with a wrong number of unfinished jobs":
        "SELECT count(*) FROM owner WHERE unfinished != (SELECT count(*) FROM job WHERE owner = owner.name"
        " AND state NOT IN ('succeeded', 'failed', 'cancelled', 'timed_out'))",
    "states with a wrong number of jobs":
        "SELECT count(*) FROM state_count WHERE jobs != (SELECT count(*) FROM job WHERE job.state = state_count.state)",
    "jobs with frames that wait for frames of ended jobs":
        "SELECT count(*) FROM job WHERE held > 0 AND NOT EXISTS (SELECT 1 FROM dependency JOIN job AS need ON need.seq = needs"
        " WHERE dependency.job = job.seq AND by_frame = 1 AND need.state NOT IN ('succeeded', 'failed', 'cancelled', 'timed_out'))",
    "users with a wrong number of results":
        "SELECT count(*) FROM usage WHERE results != (SELECT sum(succeeded + failed + timed_out) FROM job WHERE job.owner = usage.owner)",
}
CHANGES_LEFT = ("SELECT (SELECT count(*) FROM job WHERE tasks = 0 OR target IS NOT NULL OR examine_from IS NOT NULL) +"
                " (SELECT count(*) FROM ended) + (SELECT count(*) FROM removal)")


class Array:
    """An array or a data set that was sent: its last known state, and the states that it may have since. If it waits for the frames of
    the job `need`, it may fail with these at any time."""

    def __init__(self, document, frames, need=None):
        self.document, self.frames, self.need = document, frames, need
        self.name, self.id, self.state, self.may = document["name"], None, GONE, {GONE}

    def permit(self, states):
        self.may = self.may | states | self.failure()

    def require(self, states):
        """A change to one of these states was acknowledged."""
        self.may = self.may & (states | self.failure())

    def failure(self):
        return {"failed"} if self.need else set()

    def settle(self, state):
        self.state, self.may = state, {state}
        if state in UNFINISHED:
            self.may = set(UNFINISHED)
            self.permit(set())


class Records:
    """The arrays of a round by name, and what is shown of them."""

    def __init__(self, daemon):
        self.daemon, self.book = daemon, Book()
        self.arrays, self.deleted, self.position = {}, set(), 0
        self.restored = False  # whether an older database was put back
        self.mutex = threading.Lock()

    def check_shown(self):
        """At any time: no part of a job is shown, and no event of a job that is not. None without an answer."""
        reply = self.daemon.ask("GET", "/v1/jobs?limit=100")
        if self.book.is_no_answer(reply):
            return None
        shown = {}
        for job in reply.json["jobs"]:
            array = self.arrays.get(job["name"])
            if array is None or job["name"] in shown or job["id"] in self.deleted:
                raise Violation(f"the job {job['id']} is shown twice, was deleted or was never sent: {job['name']}")
            counts = dict(job["tasks"])
            if counts.pop("all") != array.frames or sum(counts.values()) != array.frames:
                raise Violation(f"the job {job['id']} is shown with {job['tasks']}, not with {array.frames} tasks")
            shown[job["name"]] = job
        self.check_events()
        return shown

    def next_events(self):
        """The jobs of events since the last call; None without an answer, or if there are no more."""
        reply = self.daemon.ask("GET", f"/v1/events?after={self.position}&limit={PAGE}")
        if self.book.is_no_answer(reply) or not reply.json["events"]:
            return None
        self.position = reply.json["position"]
        return {event["job"] for event in reply.json["events"]}

    def check_events(self):
        for job in self.next_events() or ():
            seen = self.daemon.ask("GET", f"/v1/jobs/{job}")
            if not self.book.is_no_answer(seen) and seen.status != 200 and not self.may_be_deleted(job):
                raise Violation(f"there are events of the job {job}, which is not shown")

    def check_all_events(self, shown):
        """When all changes are complete."""
        self.position = 0
        while jobs := self.next_events():
            if jobs - {job["id"] for job in shown.values()}:
                raise Violation(f"there are events of a job that is not shown: {jobs}")

    def may_be_deleted(self, job):
        return job in self.deleted or any(array.id == job and GONE in array.may for array in self.arrays.values())

    def check_states(self, shown):
        """After a start: each job is there if its submission was acknowledged, and in a state that it may have."""
        for name, array in self.arrays.items():
            state = shown[name]["state"] if name in shown else GONE
            if array.id and name in shown and shown[name]["id"] != array.id:
                raise Violation(f"the job {name} was {array.id} and is {shown[name]['id']}")
            if state not in array.may:
                raise Violation(f"the job {name} ({array.id}) is {state}, and may be {sorted(array.may)}")

    def settle(self, shown):
        """When all changes are complete: what is shown is what happened."""
        for name, array in list(self.arrays.items()):
            if name in shown:
                array.id = shown[name]["id"]
                array.settle(shown[name]["state"])
                continue
            array.settle(GONE)
            if array.id:
                self.deleted.add(array.id)
                del self.arrays[name]
        for name, array in list(self.arrays.items()):
            if array.state == GONE and array.need in self.deleted:
                del self.arrays[name]  # its submission can no longer be repeated

    # ---- changes: what they permit before they are sent, and require after their answer

    def submit(self, array):
        with self.mutex:
            array.permit(UNFINISHED)
        reply = self.daemon.ask("POST", "/v1/jobs", array.document, {"Idempotency-Key": array.name})
        if self.book.is_no_answer(reply):
            return
        if reply.status != 201:
            raise Violation(f"the job {array.name} is refused with {reply.status} {reply.body!r}")
        with self.mutex:
            if array.id not in (None, reply.json["id"]):
                raise Violation(f"the job {array.name} was stored twice, as {array.id} and {reply.json['id']}")
            array.id = reply.json["id"]
            array.require(UNFINISHED)

    def change(self, array, action):
        method, path, then = CHANGES[action]
        array.permit(then)
        reply = self.daemon.ask(method, f"/v1/jobs/{array.id}{path}")
        if self.book.is_no_answer(reply) or reply.status == 409 and array.need:
            return
        if reply.status not in (200, 202, 204):
            raise Violation(f"{action} {array.name}: {reply.status} {reply.body!r}")
        array.require(then)


def make_inputs(where):
    """A mesh for the first frame of the arrays, and the files of the data sets."""
    where.mkdir(parents=True, exist_ok=True)
    first = where / "a.1.off"
    first.write_text(TETRAHEDRON)
    (where / "set").mkdir(exist_ok=True)
    for k in range(FILES):
        path = where / "set" / f"{k:05}.off"
        if not path.exists():
            path.hardlink_to(first)
    return where


def new_array(name, need=None):
    mesh, queue = {"path": "a.#.off", "voxel_size": 0.1}, {"frames": f"1-{FRAMES}", **({"after_frames": [need]} if need else {})}
    return Array({**spec(name, count=60), "surface": {"mesh": mesh}, "queue": queue}, FRAMES, need)


def new_data_set(name):
    mesh = {"path": "{file}", "voxel_size": 0.1}
    return Array({**spec(name, count=60), "surface": {"mesh": mesh}, "queue": {"files": "set/*.off"}}, FILES)


def fill(records, moments, seed):
    """An array, one that waits for its frames, and a data set, without a kill."""
    need = None
    for make in (new_array, lambda name: new_array(name, need), new_data_set):
        array = make(f"array {seed} {len(records.arrays)}")
        records.arrays[array.name] = array
        begun = time.monotonic()
        records.submit(array)
        moments.seconds[f"submit {array.frames}"] = time.monotonic() - begun
        need = array.id
    records.settle(records.check_shown())


def invent(name, rng, records):
    """A new array, perhaps one that waits for the frames of another, or a data set."""
    if rng.random() < 0.3:
        return new_data_set(name)
    needs = [array.id for array in records.arrays.values() if array.state in UNFINISHED and array.frames == FRAMES]
    return new_array(name, rng.choice(needs) if needs and rng.random() < 0.7 else None)


def choose(seed, rng, records):
    """The next change: an action and its array. A submission that a kill undid may be repeated."""
    possible = [(action, array) for action, states in ACTIONS.items() for array in records.arrays.values() if array.state in states]
    if len(records.arrays) < MOST_JOBS and (not possible or rng.random() < 0.3):
        array = invent(f"array {seed}", rng, records)
        records.arrays[array.name] = array
        return "submit", array
    return rng.choice(possible)


def begin(records, action, array, twice):
    """Starts the threads of the clients; their failures."""
    failures = []

    def guard():
        try:
            if action == "submit":
                records.submit(array)
            else:
                records.change(array, action)
        except Exception as e:
            failures.append(e)
    threads = [threading.Thread(target=guard, daemon=True) for _ in range(1 + twice)]
    for thread in threads:
        thread.start()
    return threads, failures


def make_copy(daemon, path):
    path.unlink(missing_ok=True)
    done = daemon.backup(path)
    if done.returncode != 0:
        raise Violation(f"the backup failed: {done.stderr}")


def wait_complete(daemon):
    """Until all begun changes are completed; a copy of the database."""
    copy = daemon.base / "copy.db"

    def is_complete():
        make_copy(daemon, copy)
        return read(copy, CHANGES_LEFT) == [(0,)]
    wait_until(is_complete, "the completion of changes", interval=0.1)
    return copy


def read(copy, query):
    database = sqlite3.connect(f"file:{copy}?mode=ro&immutable=1", uri=True)
    try:
        return database.execute(query).fetchall()
    finally:
        database.close()


def check_rows(daemon):
    """Completes all changes: no row of the database contradicts another one, and no file is without a job. id -> number of tasks."""
    copy = wait_complete(daemon)
    for what, query in CONTRADICTIONS.items():
        ((count,),) = read(copy, query)
        if count:
            raise Violation(f"the database has {count} {what}")
    stored = dict(read(copy, "SELECT id, tasks FROM job"))
    stray = {path.name[:restores.ID] for place in ("results", "attempts") for path in (daemon.state / place).iterdir()} - set(stored)
    if stray:
        raise Violation(f"there are attempts or results of {stray}, which are not stored")
    return stored


def check_complete(records):
    """All begun changes are completed, and the database has exactly what is shown."""
    stored = check_rows(records.daemon)
    shown = records.check_shown()
    if stored != {job["id"]: job["tasks"]["all"] for job in shown.values()}:
        raise Violation(f"the database has the jobs {stored}, and {sorted(job['id'] for job in shown.values())} are shown")
    records.check_all_events(shown)
    return shown


def check_pages(daemon, job, array, rng):
    """The first, the last and another page of tasks."""
    for first in (0, rng.randrange(1, array.frames - PAGE), array.frames - PAGE):
        page = f"limit={PAGE}" + (f"&after={first - 1}" if first else "")
        reply = daemon.ask("GET", f"/v1/jobs/{job}/tasks?{page}")
        numbers = [task["number"] for task in reply.json["tasks"]]
        if numbers != list(range(first, first + PAGE)):
            raise Violation(f"the tasks {page} of {job} are {numbers[:3]} to {numbers[-3:]}, {len(numbers)} in all")


def restart(records, rng):
    """Starts after a kill, looks at once and when all is completed. The number of further kills."""
    daemon, kills = records.daemon, -1
    while kills < 0 or rng.random() < AGAIN:
        if not daemon.dead():
            time.sleep(rng.uniform(0, AGAIN_S))
            daemon.kill()
        daemon.await_nobody()
        daemon.check_database()
        daemon.start()
        records.check_states(records.check_shown())
        kills += 1
    shown = check_complete(records)
    records.check_states(shown)
    records.settle(shown)
    for name, job in shown.items():
        check_pages(daemon, job["id"], records.arrays[name], rng)
    return kills


def put_back(records, backup):
    records.restored = True
    restores.remove_database(records.daemon)
    shutil.copyfile(backup, records.daemon.state / "queue.db")


def cycle(records, moments, seed, figures):
    rng, daemon = random.Random(seed), records.daemon
    action, array = choose(seed, rng, records)
    before, backup = array.may, rng.random() < RESTORES and daemon.base / "backup.db"
    threads, failures = begin(records, action, array, action == "submit" and rng.random() < DUPLICATES)
    was_cut = moments.reach(f"{action} {array.frames}", rng, lambda: any(thread.is_alive() for thread in threads), records.check_shown)
    if backup:
        make_copy(daemon, backup)
    daemon.kill()
    for thread in threads:
        thread.join()
    if failures:
        raise failures[0]
    if backup:
        put_back(records, backup)
        array.may = array.may | before
    figures["kills while a start completed changes"] += (again := restart(records, rng))
    figures["kills"] += 1 + again
    was_undone = array.state in ACTIONS[action]
    if action == "submit" and not was_undone:
        records.submit(array)  # the same key: the same job
        records.settle(records.check_shown())
    how = "restored" if backup else "answered" if not was_cut else "undone" if was_undone else "completed"
    figures["changes"][action][how] += 1
    figures["data sets"] += action == "submit" and array.frames == FILES
    figures["waiting arrays"] += action == "submit" and bool(array.need)


def finish(records):
    """Deletes all jobs: nothing may be left."""
    daemon = records.daemon

    def is_empty():
        for array in list(records.arrays.values()):
            if array.state != GONE:
                records.change(array, "cancel" if array.state in UNFINISHED else "delete")
        records.settle(check_complete(records))
        return all(array.state == GONE for array in records.arrays.values())
    wait_until(is_empty, "the deletion of all jobs")
    usage = daemon.ask("GET", "/v1/usage").json
    if usage["all"]["results"] or usage["all"]["bytes"] or usage["users"]:
        raise Violation(f"usage without jobs: {json.dumps(usage)}")
    if (daemon.state / "lost+found").exists() and not records.restored:
        raise Violation(f"put aside: {[str(path) for path in (daemon.state / 'lost+found').rglob('*')][:9]}")
    daemon.end_by_drain()
    daemon.check_database()


def run(build, where, times, seed, say, new_daemon=Daemon):
    """At least that number of kills; the figures. Raises Violation with the seed and the place."""
    figures = {"kills": 0, "kills while a start completed changes": 0, "data sets": 0, "waiting arrays": 0,
               "changes": {action: dict.fromkeys(("answered", "undone", "completed", "restored"), 0) for action in ACTIONS}}
    moments, done = Moments(), 0
    inputs = make_inputs(where / "inputs")
    while figures["kills"] < times:
        base, first = where / f"round.{done}", done
        shutil.rmtree(base, ignore_errors=True)
        daemon = new_daemon(build, base, "--workers", 1, "--input_roots", inputs)
        records = Records(daemon)
        try:
            daemon.start()
            fill(records, moments, f"{seed}.{done}")
            while figures["kills"] < times and (done == first or done % CYCLES_A_ROUND):
                cycle(records, moments, f"{seed}.{done}", figures)
                done += 1
            finish(records)
        except Exception as e:
            raise Violation(f"arrays {seed}.{done} in {base}: {e}") from e
        finally:
            if daemon.process and not daemon.dead():
                daemon.kill()
        say(f"{figures['kills']} of {times} kills during changes of arrays: {figures['changes']}")
        shutil.rmtree(base)
    return figures
