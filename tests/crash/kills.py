# SPDX-License-Identifier: Apache-2.0
"""Cycles of kill -9 at random moments under load, in one part with a wall clock that is set by hours."""
import os
import random
import shutil
import signal
import time

import copies
from farm import Book, Daemon, Load, Violation, make_footage, setclock, wait_until
from uploads import Uploads

GOOD = (0, 10, 11)  # exit statuses of a worker that has a result
CYCLES_A_ROUND = 50  # then all jobs end, everything is looked at, and the next round begins with nothing
# what is killed, and how often
TARGETS = {"daemon": 4, "daemon while it starts": 2, "workers": 2, "both": 3, "daemon while it drains": 1}
STEP_S = 10 * 3600  # the longest step of the wall clock, in both directions
START_S, LOAD_S, DRAIN_S = 0.12, 0.5, 0.2  # the longest time from the start of that phase to the kill


def kill_all(pids):
    for pid in pids:
        try:
            os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            pass


def act(daemon, target, rng, book):
    """Kills once. The moments are the random thing that is tested, so they are slept for, not waited for."""
    if target == "daemon while it starts":
        daemon.kill()
        daemon.await_nobody()
        daemon.spawn()
        time.sleep(rng.uniform(0, START_S))
        daemon.kill()
        return
    if rng.random() < 0.25:  # lest a slow machine never gets to an end
        enough = len(book.ended) + rng.randrange(1, 3)
        wait_until(lambda: len(book.ended) >= enough or daemon.dead(), "jobs to end")
    time.sleep(rng.uniform(0, LOAD_S))
    if target == "workers":
        kill_all(daemon.workers())
        time.sleep(rng.uniform(0, DRAIN_S))
        return
    if target == "both" and rng.random() < 0.5:
        kill_all(daemon.workers())
    if target == "daemon while it drains":
        daemon.process.send_signal(signal.SIGTERM)
        time.sleep(rng.uniform(0, DRAIN_S))
    if target == "both":
        workers = daemon.workers()
        daemon.process.kill()
        kill_all(workers)
    daemon.kill()


def check_dead(daemon, figures):
    """What a daemon that has ended somehow leaves."""
    daemon.await_nobody()
    daemon.check_database()
    copies.check_whole(daemon.base / "outputs")
    figures["temporary files left by kills"] += len(copies.find_temporaries(daemon.base / "outputs"))


def cycle(daemon, book, uploads, seed, footage, figures):
    rng = random.Random(seed)
    target = rng.choices(list(TARGETS), TARGETS.values())[0]
    if daemon.dead():
        daemon.start()
    uploads.check(daemon)
    load = Load(daemon, book, seed, footage, outputs=daemon.base / "outputs", uploads=uploads)
    if daemon.clock:
        time.sleep(rng.uniform(0, LOAD_S))
        daemon.clock.step(rng.uniform(-STEP_S, STEP_S))
        figures["clock steps"] = figures.get("clock steps", 0) + 1
    act(daemon, target, rng, book)
    load.stop()
    if daemon.dead():
        check_dead(daemon, figures)
    figures["cycles"][target] = figures["cycles"].get(target, 0) + 1


def finish(daemon, book, figures, uploads=None):
    """Lets all jobs end and looks at everything, before and after one more start."""
    if daemon.dead():
        daemon.start()
    for document in book.unanswered[:]:
        book.unanswered.remove(document)
        book.submit(daemon, document)
    if book.adopt(daemon):
        raise Violation("a job is stored that was not accepted under its key")
    book.settle(daemon)
    book.check_all(daemon)
    daemon.end_by_drain()
    daemon.start()
    book.check_all(daemon)
    if uploads:
        uploads.check(daemon)
    for job, document in book.listed(daemon).items():
        figures["served from the cache"] += document["cached_from"] is not None
        attempts = daemon.ask("GET", f"/v1/jobs/{job}/attempts").json["attempts"]
        good = [a.get("frame") for a in attempts if a.get("exit_status") in GOOD and "storage_full" not in a["reason"]]
        if len(good) != len(set(good)):
            raise Violation(f"of the job {job} two attempts were taken for good: {attempts}")
        figures["sequences"] += "frame" in attempts[0] if attempts else 0
        figures["attempts"] += len(attempts)
        figures["most attempts of a job"] = max(figures["most attempts of a job"], len(attempts))
        figures["results found at a start"] += sum("found at the start" in (a.get("reason") or "") for a in attempts)
    daemon.end_by_drain()
    daemon.await_nobody()
    daemon.check_database()
    figures["copies in output.directory"] += copies.check_at_rest(daemon.base / "outputs", book)
    for job, (state, _) in book.ended.items():
        figures["ended"][state] = figures["ended"].get(state, 0) + 1
    for status, times in book.replies.items():
        figures["submissions"][status] = figures["submissions"].get(status, 0) + times
    figures["files fetched"] += book.files
    figures["deleted"] += len(book.deleted)
    for what, number in uploads.figures.items() if uploads else ():
        figures[what] += number


def new_figures():
    return {"cycles": {}, "submissions": {}, "ended": {}, "deleted": 0, "sequences": 0, "served from the cache": 0, "attempts": 0,
            "most attempts of a job": 0, "results found at a start": 0, "files fetched": 0,
            "copies in output.directory": 0, "temporary files left by kills": 0, "uploads sent": 0, "uploads deleted": 0}


def run_with_steps(build, where, cycles, seed, say):
    """As run(), with a step of the wall clock in each cycle."""
    where.mkdir(parents=True, exist_ok=True)
    clock = setclock.Clock(where)

    def new_daemon(*words):
        daemon = Daemon(*words)
        daemon.clock = clock
        return daemon
    return run(build, where, cycles, seed, say, new_daemon)


def run(build, where, cycles, seed, say, new_daemon=Daemon):
    """So many kills; the figures. Raises Violation with the seed and the place."""
    figures, done, footage = new_figures(), 0, make_footage(build, where / "footage")
    while done < cycles:
        base = where / f"round.{done}"
        shutil.rmtree(base, ignore_errors=True)
        (base / "outputs").mkdir(parents=True)
        daemon = new_daemon(build, base, "--workers", 2, "--input_roots", footage, "--output_roots", base / "outputs")
        book, uploads = Book(base / "accepted"), Uploads(reads=True)
        try:
            for _ in range(min(CYCLES_A_ROUND, cycles - done)):
                cycle(daemon, book, uploads, f"{seed}.{done}", footage, figures)
                done += 1
            finish(daemon, book, figures, uploads)
        except Exception as e:
            raise Violation(f"kill cycle {seed}.{done} in {base}: {e}") from e
        finally:
            if daemon.process and not daemon.dead():
                daemon.kill()
            book.close()
        say(f"{done} of {cycles} kills, {sum(figures['ended'].values())} jobs ended")
        shutil.rmtree(base)
    return figures
