# SPDX-License-Identifier: Apache-2.0
"""Backups are made under load and put back later; the database is lost. What the queue then knows is held against what
clients were told, and nothing in `results` may be gone that nobody asked to delete."""
import collections
import hashlib
import random
import shutil
import sqlite3
import time

import kills
from farm import FINAL, FRAMES, Book, Daemon, Load, Violation, make_footage, wait_until
from uploads import Uploads

CYCLES_A_ROUND = 15  # then all jobs end, everything is looked at, and the next round begins with nothing
ID = 26  # characters of a job's id
UNSUCCESSFUL = set(FINAL) - {"succeeded"}
KEPT = 3  # backups that may be put back
LOAD_JOBS, LOAD_S = 4, 0.4  # between two of backup, kill and start fewer jobs end, and then the load goes on for a moment
DRAINS = 0.2  # the chance that it is no kill that ends the daemon
LOSES_DATABASE, STAYS = 0.2, 0.2  # chances: the database is removed; stays as it is


class Backup:
    """A copy of the database that `hexad --backup` made, checked, and the jobs that it knows."""

    def __init__(self, path):
        self.path = path
        database = sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True)
        try:
            found = database.execute("PRAGMA integrity_check").fetchall()
            broken = database.execute("PRAGMA foreign_key_check").fetchall()
            if found != [("ok",)] or broken:
                raise Violation(f"the backup is damaged: {found[:3]} {broken[:3]}")
            self.states = dict(database.execute("SELECT id, state FROM job"))
        except sqlite3.DatabaseError as e:
            raise Violation(f"the backup is no database: {e}") from e
        finally:
            database.close()

    def put_back(self, daemon):
        """As doc/operations.md says, in the state directory of a daemon that has ended."""
        remove_database(daemon)
        shutil.copyfile(self.path, daemon.state / "queue.db")


def move_back(daemon):
    """What was put aside since the database was an older one is given to one that may know it."""
    for path in (daemon.state / "lost+found" / "results").glob("*"):
        if "~" not in path.name and not (daemon.state / "results" / path.name).exists():
            path.rename(daemon.state / "results" / path.name)


def remove_database(daemon):
    for path in daemon.state.glob("queue.db*"):
        path.unlink()


def take_backup(daemon, book, path):
    """Of a running daemon. Holds what was acknowledged before."""
    path.unlink(missing_ok=True)
    with book.mutex:
        before = {job: book.ended.get(job) for job in book.accepted}
    done = daemon.backup(path)
    if done.returncode != 0:
        raise Violation(f"the backup failed with {done.returncode}: {done.stderr}")
    backup = Backup(path)
    for job, end in before.items():
        if job in book.doubtful:  # its deletion may have come first
            continue
        if job not in backup.states:
            raise Violation(f"the job {job} was accepted before the backup and is not in it")
        if end and backup.states[job] != end[0]:
            raise Violation(f"the job {job} was {end[0]} before the backup and is {backup.states[job]} in it")
    return backup


# ---- the directories

def contents(directory):
    """name -> the hash of each file below it, of every directory in a directory; but for the listing that the service makes
    when it is first asked for one, whose name begins with a point."""
    found = {}
    for top in directory.iterdir() if directory.is_dir() else ():
        try:
            found[top.name] = tuple(sorted((str(path.relative_to(top)), hashlib.sha256(path.read_bytes()).hexdigest())
                                           for path in top.rglob("[!.]*") if path.is_file()))
        except FileNotFoundError:
            pass  # its removal, which was asked for, goes on
    return found


class Holdings:
    """All results that stand in a state directory, whether the queue knows them or not."""

    def __init__(self, daemon):
        self.results, self.kept = contents(daemon.state / "results"), \
            contents(daemon.state / "lost+found" / "results")

    def check_after(self, now, known, removable, figures):
        """After a start with a queue that knows the jobs `known`, with their states: results of these are where they were, and
        all else was moved to lost+found, as may be those of jobs that it holds as ended without success; but for jobs whose
        removal was asked for."""
        wanted = collections.Counter(self.kept.values())
        for name, files in self.results.items():
            job = name[:ID]
            stays = now.results.get(name) == files
            if job in removable or stays and job in known:
                continue
            if stays:
                raise Violation(f"the result {name}, which the queue does not know, is still in results")
            if job in known and known[job] not in UNSUCCESSFUL:
                raise Violation(f"the result {name}, which the queue knows, is gone or changed")
            wanted[files] += 1
            figures["results kept in lost+found"] += 1
        missing = wanted - collections.Counter(now.kept.values())
        if missing:
            raise Violation(f"lost+found lacks {sum(missing.values())} of {sum(wanted.values())} directories")


# ---- the book after a restore

def remember(book):
    """What a client knows, for recall()."""
    return {name: type(value)(value) for name, value in vars(book).items() if isinstance(value, (dict, set, list))}


def recall(book, remembered):
    vars(book).update(remembered)


def roll_back(book, known, results):
    """Forgets what the jobs `known` cannot show: jobs that came later, and ends that left no result. What was deleted since
    may be there again; that is given back. `results` are the names that stand in results."""
    book.restored = True
    book.accepted = {job: name for job, name in book.accepted.items() if job in known}
    again = {job for job in book.deleted | book.doubtful if job in known}
    for job in list(book.ended):
        if job not in known or known[job] not in FINAL and not (
                book.ended[job][0] == "succeeded" and is_whole(book, job, results)):
            del book.ended[job]
    book.cancelled = {job for job in book.cancelled if job in known and known[job] == "cancelling"}
    book.deleted, book.doubtful = book.deleted - again, book.doubtful - again
    return again


def is_whole(book, job, results):
    places = [f"{job}.{frame}" for frame in FRAMES] if "queue" in book.sent[book.accepted[job]] else [job]
    return all(place in results for place in places)


def delete_again(daemon, book, jobs):
    """Jobs that were deleted after the backup and are back with it: who puts a backup back deletes them once more."""
    def gone(job):
        reply = daemon.ask("DELETE", f"/v1/jobs/{job}")
        if reply is not None and reply.status == 409:
            daemon.ask("POST", f"/v1/jobs/{job}/cancel")
        elif reply is None or reply.status not in (204, 404):
            raise Violation(f"the deletion of {job} is answered with {reply and (reply.status, reply.body)}")
        return reply.status in (204, 404)
    for job in jobs:
        wait_until(lambda job=job: gone(job), f"the deletion of {job}")
    book.deleted |= jobs
    book.doubtful |= jobs


def start_from(daemon, book, backup, figures):
    """Starts with an older database, and holds all that stands against it."""
    before = Holdings(daemon)
    backup.put_back(daemon)
    daemon.start()
    check_restored(daemon, book, backup, before, figures)


def check_restored(daemon, book, backup, before, figures):
    """A daemon that has just been started with an older database, beside the results `before`."""
    before.check_after(Holdings(daemon), backup.states, book.deleted | book.doubtful, figures)
    figures["jobs that a backup knows"] += len(backup.states)
    figures["jobs that it does not know"] += sum(job not in backup.states for job in book.accepted)
    again = roll_back(book, backup.states, before.results)
    delete_again(daemon, book, again)
    for job, (state, _) in [(job, end) for job, end in book.ended.items() if job not in book.deleted]:
        now = book.look(daemon, job)
        if not now or now["state"] != state:
            raise Violation(f"the job {job} was {state} and is {now and now['state']} with the older database")
        figures["jobs ended from a result that was delivered later"] += backup.states[job] not in FINAL


# ---- a database that is lost

def start_without(daemon, book, figures):
    """The database is lost: the daemon refuses and says how to go on, and goes on so."""
    before = Holdings(daemon)
    remove_database(daemon)
    if before.results:
        check_refusal(daemon, before)
        daemon.start("--adopt")
        figures["databases adopted"] += 1
    else:
        daemon.start()
    adopted = dict.fromkeys(Book().listed(daemon), "succeeded")
    before.check_after(Holdings(daemon), adopted, book.deleted | book.doubtful, figures)
    check_adopted(daemon, book, adopted, before, figures)


def check_refusal(daemon, before):
    size = daemon.log.stat().st_size
    daemon.spawn()
    if daemon.await_served():
        raise Violation("the daemon serves without the database whose results are there")
    with open(daemon.log, "rb") as log:
        log.seek(size)
        said = log.read().decode()
    errors = [line for line in said.splitlines() if " error " in line]
    if daemon.process.returncode <= 0 or len(errors) != 1 or "--adopt" not in errors[0]:
        raise Violation(f"the refusal is {daemon.process.returncode} and {said!r}")
    now = Holdings(daemon)
    if (now.results, now.kept) != (before.results, before.kept):
        raise Violation("a refused start changes results")


def check_adopted(daemon, book, adopted, before, figures):
    """Every job whose success was told is there with the same result."""
    lost = [job for job, (state, _) in book.ended.items()
            if state == "succeeded" and job not in adopted and job not in book.doubtful]
    if lost:
        raise Violation(f"the results of {lost} are not adopted")
    frames = collections.Counter(name[:ID] for name in before.results if len(name) > ID)
    halves = {job for job in adopted if 0 < frames[job] < len(FRAMES)}  # of sequences that had not ended
    again = roll_back(book, adopted, before.results)
    delete_again(daemon, book, again | halves)
    book.adopt(daemon)
    taken = set(book.accepted.values())
    book.unanswered = [document for document in book.unanswered if document["name"] not in taken]
    for job in list(book.accepted):
        if job in book.deleted:
            continue
        now = book.look(daemon, job)
        if not now or now["state"] != "succeeded":
            raise Violation(f"the job {job} is {now and now['state']} after the adoption")
        figures["jobs adopted"] += 1


# ---- cycles

def be_loaded(daemon, book, uploads, seed, rng, footage, path, figures):
    """Runs the load for a random time, makes a backup and runs it for another, until the daemon ends; the backup. The moments
    are the random thing that is tested, so they are slept for, once a number of jobs has ended on however slow a machine."""
    load = Load(daemon, book, seed, footage, uploads=uploads)

    def go_on():
        wanted = len(book.ended) + rng.randrange(LOAD_JOBS)
        wait_until(lambda: len(book.ended) >= wanted or load.failures or daemon.dead(), "jobs to end")
        time.sleep(rng.uniform(0, LOAD_S))
    try:
        go_on()
        backup = take_backup(daemon, book, path)
        go_on()
        end_somehow(daemon, rng, DRAINS, figures)
    finally:
        load.stop()
    daemon.await_nobody()
    figures["backups"] += 1
    return backup


def end_somehow(daemon, rng, drains, figures):
    """`drains` is the chance of a drain; else it is killed."""
    if rng.random() < drains:
        daemon.end_by_drain()
        figures["drains"] += 1
    else:
        daemon.kill()
        figures["kills"] += 1


def cycle(daemon, book, uploads, seed, footage, backups, adopts, figures):
    rng = random.Random(seed)
    path = daemon.base / f"backup.{seed}"
    backups.append(be_loaded(daemon, book, uploads, seed, rng, footage, path, figures))
    for old in backups[:-KEPT]:
        old.path.unlink()
        backups.remove(old)
    what = rng.random()
    if adopts and what < LOSES_DATABASE:
        start_without(daemon, book, figures)
        backups.clear()  # of another database
    elif what > 1 - STAYS:
        daemon.start()
        uploads.check(daemon)
    else:
        chosen = rng.randrange(len(backups))
        start_from(daemon, book, backups[chosen], figures)
        del backups[chosen + 1:]  # they know jobs whose results are now in lost+found
        figures["backups put back"] += 1
    uploads.send_again(daemon, book)


def new_figures():
    return {**kills.new_figures(), "kills": 0, "drains": 0, "backups": 0, "backups put back": 0, "jobs that a backup knows": 0,
            "jobs that it does not know": 0, "results kept in lost+found": 0, "databases adopted": 0, "jobs adopted": 0,
            "jobs ended from a result that was delivered later": 0}


def run(build, where, times, seed, say, new_daemon=Daemon):
    """So many kills and a few drains, each followed by another database; the figures. Raises Violation with the seed and the
    place."""
    figures, done, footage = new_figures(), 0, make_footage(build, where / "footage")
    while figures["kills"] < times:
        base, first = where / f"round.{done}", done
        shutil.rmtree(base, ignore_errors=True)
        # a report names the job that it was made for, which is not the one that was given it by the cache
        adopts = done // CYCLES_A_ROUND % 2 == 0
        daemon = new_daemon(build, base, "--workers", 2, "--input_roots", footage, "--cache", int(not adopts))
        book, uploads, backups = Book(base / "accepted"), Uploads(), []
        try:
            daemon.start()
            while figures["kills"] < times and (done == first or done % CYCLES_A_ROUND):
                cycle(daemon, book, uploads, f"{seed}.{done}", footage, backups, adopts, figures)
                done += 1
            kills.finish(daemon, book, figures, uploads)
        except Exception as e:
            raise Violation(f"restore {seed}.{done} in {base}: {e}") from e
        finally:
            if daemon.process and not daemon.dead():
                daemon.kill()
            book.close()
        say(f"{figures['kills']} of {times} kills, {figures['backups put back']} backups put back,"
            f" {figures['databases adopted']} databases adopted")
        shutil.rmtree(base)
    return figures
