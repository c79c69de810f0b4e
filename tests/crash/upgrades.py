# SPDX-License-Identifier: Apache-2.0
"""Kills while this build converts the database of an earlier one (tests/upgrade), and while its jobs then run. One of the jobs is made an
array of 100 000 frames, and is cancelled and deleted at the end."""
import hashlib
import pathlib
import random
import shutil
import sqlite3
import sys
import time

import arrays
from farm import Daemon, Moments, Violation, wait_until

UPGRADE = pathlib.Path(__file__).parent.parent / "upgrade"
sys.path.insert(0, str(UPGRADE))
import make_state  # noqa: E402

BUILDS = ("d10413d0", "ef072324", "7218b1f7")
ENDED = ("succeeded", "failed", "cancelled")
WAITING = ("runs", "waits", "after", "waits with a sent file", "waits, equal to sent", "waits with defaults")
REFUSED = "waits with a removed member"  # its spec has a member that this build does not have, so it fails
ARRAY = "waiting frames"
CONVERSIONS, RUNS = (1, 2, 3), (1, 2)  # kills of a state during the conversion, and afterwards
RUN_S = 1.0  # the longest time that jobs run before a kill
GROW = f"""
WITH RECURSIVE more (number) AS (SELECT 2 UNION ALL SELECT number + 1 FROM more WHERE number < {arrays.FRAMES} - 1)
INSERT INTO task (job, number, frame) SELECT (SELECT seq FROM job WHERE name = '{ARRAY}'), number, number + 1 FROM more;
UPDATE job SET tasks = {arrays.FRAMES}, ready = {arrays.FRAMES}, is_paused = 1, state = 'paused' WHERE name = '{ARRAY}';
"""


def make_databases(where):
    """A database of each build with a large array."""
    where.mkdir(parents=True, exist_ok=True)
    for build in BUILDS:
        path = where / f"{build}.db"
        path.unlink(missing_ok=True)
        make_state.make_database(UPGRADE / build, path)
        with sqlite3.connect(path) as database:
            database.executescript(GROW)
        database.close()
    return where


def check_dead(daemon, earlier):
    """After a kill: the database is sound and has all jobs, converted or not."""
    daemon.await_nobody()
    jobs = daemon.check_database("SELECT name, id FROM job")
    if dict(jobs) != {name: job["id"] for name, job in earlier.items()}:
        raise Violation(f"after a kill the database has the jobs {sorted(jobs)}")


def read_points(daemon):
    """Of each result. An upgrade may write the report of a job anew that has the result of another one."""
    return {path.parent.name: path.read_bytes() for path in (daemon.state / "results").glob("*/points.ply")}


def check_shown(daemon, earlier, results, ended):
    """What the earlier build has told still holds. `ended`: the states of jobs that have ended since, by name."""
    reply = daemon.ask("GET", "/v1/jobs?limit=100")
    shown = {job["name"]: job for job in reply.json["jobs"]}
    if {name: (job["id"], job["labels"], job["priority"]) for name, job in shown.items()} != \
            {name: (job["id"], job["labels"], job["priority"]) for name, job in earlier.items()}:
        raise Violation(f"other jobs than before the upgrade are shown: {shown}")
    if shown[ARRAY]["tasks"]["all"] != arrays.FRAMES or shown[ARRAY]["tasks"]["waiting"] != arrays.FRAMES:
        raise Violation(f"the array is shown with {shown[ARRAY]['tasks']}")
    for name, job in earlier.items():
        was = ended.get(name) or (job["state"] if job["state"] in ENDED else None)
        now = shown[name]["state"]
        if was and now != was or name in ("paused", ARRAY) and now != "paused" or now in ("failed", "timed_out") and not was and name != REFUSED:
            raise Violation(f"the job {name} was {was or job['state']} and is {now}")
        if now in ENDED:
            ended[name] = now
    held = {file["sha256"] for file in daemon.ask("GET", "/v1/inputs").json["inputs"]}
    if held != {path.name.removeprefix("sha256:") for path in (daemon.state / "inputs").iterdir()} or len(held) != 2:
        raise Violation(f"the uploads of the earlier build are listed as {held}")
    there = read_points(daemon)
    changed = [name for name, points in results.items() if there.get(name) != points]
    if changed:
        raise Violation(f"the results {changed} of the earlier build are gone or changed")
    for name in ended:
        for item in (daemon.ask("GET", f"/v1/jobs/{shown[name]['id']}/results").json or {}).get("results", ()):
            body = daemon.ask("GET", item["href"]).body
            if hashlib.sha256(body).hexdigest() != item["sha256"]:
                raise Violation(f"{item['href']} is not what is listed")


def end_array(daemon, earlier, moments, rng, figures):
    """A cancellation and a deletion of the array, each interrupted by a kill."""
    job = earlier[ARRAY]["id"]
    for action, last in (("cancel", "cancelled"), ("delete", arrays.GONE)):
        records = arrays.Records(daemon)
        array = records.arrays[ARRAY] = arrays.Array({"name": ARRAY}, arrays.FRAMES)
        array.id = job
        array.settle("paused" if action == "cancel" else "cancelled")
        threads, failures = arrays.begin(records, action, array, False)
        moments.reach(action, rng, lambda threads=threads: threads[0].is_alive(), lambda: None)
        daemon.kill()
        threads[0].join()
        if failures:
            raise failures[0]
        figures["kills"] += 1
        daemon.await_nobody()
        daemon.start()

        def state(array=array):
            reply = daemon.ask("GET", f"/v1/jobs/{job}")
            now = reply.json["state"] if reply.status == 200 else arrays.GONE
            if now not in array.may:
                raise Violation(f"after {action} the array is {now}, and may be {sorted(array.may)}")
            if now != arrays.GONE and reply.json["tasks"]["all"] != arrays.FRAMES:
                raise Violation(f"after {action} the array has {reply.json['tasks']}")
            return now
        state()
        arrays.wait_complete(daemon)
        if state() != last:
            records.change(array, action)
        wait_until(lambda last=last: state() == last, f"{action} of the array")


def try_state(daemon, build, databases, moments, rng, figures):
    earlier = make_state.read_jobs(UPGRADE / build)
    make_state.put_back(UPGRADE / build, daemon.state)
    shutil.copyfile(databases / f"{build}.db", daemon.state / "queue.db")
    results = read_points(daemon)
    ended = {}
    for _ in range(rng.choice(CONVERSIONS)):
        daemon.spawn()
        during = moments.reach("start", rng, lambda: not daemon.port_file.exists(), lambda: None)
        daemon.kill()
        figures["kills"] += 1
        figures["kills before the service was ready"] += during
        check_dead(daemon, earlier)
    for _ in range(rng.choice(RUNS)):
        daemon.start()
        check_shown(daemon, earlier, results, ended)
        time.sleep(rng.uniform(0, RUN_S))
        check_shown(daemon, earlier, results, ended)
        daemon.kill()
        figures["kills"] += 1
        check_dead(daemon, earlier)
    daemon.start()

    def all_ended():
        check_shown(daemon, earlier, results, ended)
        return all(name in ended for name in (*WAITING, *({REFUSED} & set(earlier))))
    wait_until(all_ended, "the end of the jobs of the earlier build", interval=0.1)
    if any(ended[name] != "succeeded" for name in WAITING) or ended.get(REFUSED, "failed") != "failed":
        raise Violation(f"jobs of the earlier build ended as {ended}")
    end_array(daemon, earlier, moments, rng, figures)
    arrays.check_rows(daemon)
    daemon.end_by_drain()
    daemon.check_database()
    if (daemon.state / "lost+found").exists():
        raise Violation("lost+found has entries after an upgrade")


def run(build, where, times, seed, say, new_daemon=Daemon):
    """At least that number of kills, over states of all builds in turn; the figures. Raises Violation with the seed and the place."""
    figures = {"kills": 0, "kills before the service was ready": 0, "states": dict.fromkeys(BUILDS, 0)}
    databases, moments, done = make_databases(where / "databases"), Moments(), 0
    while figures["kills"] < times:
        base, earlier = where / f"state.{done}", BUILDS[done % len(BUILDS)]
        shutil.rmtree(base, ignore_errors=True)
        (base / "inputs").mkdir(parents=True)
        make_state.write_frames(base / "inputs")
        daemon = new_daemon(build, base, "--workers", 2, "--input_roots", base / "inputs")
        daemon.state.mkdir(mode=0o700)
        try:
            try_state(daemon, earlier, databases, moments, random.Random(f"{seed}.{done}"), figures)
        except Exception as e:
            raise Violation(f"upgrade {seed}.{done} from {earlier} in {base}: {e}") from e
        finally:
            if daemon.process and not daemon.dead():
                daemon.kill()
        done += 1
        figures["states"][earlier] += 1
        say(f"{figures['kills']} of {times} kills during upgrades, {done} states")
        shutil.rmtree(base)
    return figures
