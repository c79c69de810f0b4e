# SPDX-License-Identifier: Apache-2.0
"""Power losses: a loaded daemon's changes are recorded, and what a loss at a random point may leave is started from."""
import errno
import json
import os
import random
import re
import shutil
import threading

from calls import OPENS, SYNCS, WRITES
from disk import LOSSES, Disk
from faults import MAKES_NAMES
from farm import FINAL, Book, Daemon, Load, Violation, wait_until

RENAME_EXCHANGE = 2
KEEP_SIZE = 1
LOSSES_A_RECORD = 20
JOBS_A_RECORD = 10
FAILING = 0.1  # of the fsyncs, in the second half of the records
CHANGES = OPENS | WRITES | MAKES_NAMES | {"truncate", "ftruncate", "unlink", "unlinkat", "rmdir"}


class Record:
    """A judge that writes down what Disk wants to know, and what the daemon told its clients meanwhile. Once there is a
    `chance` so many fsyncs fail."""

    def __init__(self, seed):
        self.entries, self.mutex, self.tokens = [], threading.Lock(), 0
        self.chance, self.rng = 0, random.Random(seed)
        self.last = {}  # of each thread, the paths of its last call: a kill may have come before it was done

    def note(self, *entry):
        with self.mutex:
            self.entries.append(entry)

    def __call__(self, call):
        name, path = call.name, call.paths[0]
        self.last[call.tid] = [p for p in call.paths if p and name in CHANGES]
        if name in SYNCS and path:
            return self.sync(call, path)
        if not any(call.paths):
            if name != "mmap":
                self.listen(call.data())
        elif name in WRITES:
            self.note("write", path, call.offset(), call.data())
        elif name in OPENS:
            if call.creates():
                self.note("create", path)
            if call.flags() & os.O_TRUNC:
                self.note("truncate", path, 0)
        elif name in ("truncate", "ftruncate"):
            self.note("truncate", path, call.arguments[1])
        elif name in ("mkdir", "mkdirat"):
            self.note("mkdir", path)
        elif name in ("unlink", "unlinkat", "rmdir"):
            self.note("remove", path)
        elif name.startswith(("rename", "link")):
            if not all(call.paths) or name == "renameat2" and call.arguments[4] & RENAME_EXCHANGE:
                raise NotImplementedError(f"{name} {call.paths}")
            self.note("rename" if name.startswith("rename") else "link", *call.paths)
        elif name == "fallocate" and call.arguments[1] == KEEP_SIZE:
            pass  # room for later, and nothing that can be read
        elif name in ("mmap", "symlink", "symlinkat", "fallocate", "copy_file_range", "sendfile"):
            raise NotImplementedError(f"{name} {call.paths}")
        return None

    def sync(self, call, path):
        """The fsync is done here, so that the moment is known at which it has come back: not before then may anybody
        rely on it."""
        if self.rng.random() < self.chance:
            self.note("unsynced", path)
            return "error", errno.EIO
        with self.mutex:
            self.tokens += 1
            token = self.tokens
            self.entries.append(("sync", path, token))
        fd = call.borrow()

        def flush():
            try:
                os.fsync(fd)
                self.note("synced", token)
            finally:
                os.close(fd)
        return "call", flush

    def listen(self, data):
        """Replies that begin to leave. What they say must outlast any loss from now on."""
        head, _, body = data.partition(b"\r\n\r\n")
        accepted = re.match(rb"HTTP/1\.1 201 .*^Location: /v1/jobs/(\w+)\r?$", head, re.S | re.M)
        if accepted:
            self.note("accepted", accepted[1].decode())
        try:
            job = json.loads(body) if head.startswith(b"HTTP/1.1 2") and body.startswith(b"{") else {}
        except ValueError:
            return  # a part of a longer one
        if job.get("state") in FINAL:
            self.note("ended", job["id"], job["state"])


def record(daemon, book, model, seed, chance):
    """Runs a load until some jobs have ended, and ends the daemon; the record, held against a model of the disk at its
    beginning. `chance` is of an fsync to fail."""
    rng, entries = random.Random(seed), Record(seed)
    daemon.spawn(entries)
    with daemon.supervisor:
        if not daemon.await_served():
            raise Violation(f"the daemon does not start: {daemon.log.read_text()[-1000:]}")
        entries.chance = chance
        before, load = len(book.ended), Load(daemon, book, seed)
        wait_until(lambda: len(book.ended) >= before + JOBS_A_RECORD or load.failures or daemon.dead(), "jobs to end")
        if rng.random() < 0.5:
            daemon.kill()
        load.stop()
        if not daemon.dead():
            daemon.end_by_drain()
        wait_until(lambda: not daemon.supervisor.thread.is_alive(), "the end of all its processes")
    if daemon.supervisor.failure:
        raise RuntimeError(daemon.supervisor.failure)
    check_model(model, entries, daemon.state)
    return entries.entries


def check_model(disk, record, state):
    """Whether the record is all that happened."""
    for entry in record.entries:
        disk.apply(entry)
    undone = [p for paths in record.last.values() for p in paths]
    # under all their names: the queue's log has two
    files = {os.stat(state / p).st_ino for p in undone if (state / p).is_file()}
    undone += [p.name for p in state.iterdir() if p.stat().st_ino in files]
    different = [path for path in disk.compare(state) if not any(f"{path}/".startswith(f"{p}/") for p in undone)]
    if different:
        raise RuntimeError(f"the record is not what happened: {different}")


def book_at(before, after, entries):
    """What clients had been told when the record had come so far."""
    book = Book()
    book.sent, book.cancelled = dict(after.sent), set(before.cancelled)
    book.doubtful, book.forgiving, book.untidy = set(after.doubtful), after.forgiving, after.untidy
    book.accepted, book.ended = dict(before.accepted), dict(before.ended)
    for entry in entries:
        if entry[0] == "accepted":
            # its client may have been cut off and not know the name; adopt() finds it
            book.accepted[entry[1]] = after.accepted.get(entry[1], "?")
        elif entry[0] == "ended" and entry[1] in after.ended:
            book.ended[entry[1]] = after.ended[entry[1]]
    return book


def copy_book(book):
    return book_at(book, book, [])


def survive(build, base, book):
    """A start from what was left, and everything as it has to be."""
    daemon = Daemon(build, base, "--workers", 2)
    try:
        daemon.check_database()
        daemon.start()
        names = {job: document["name"] for job, document in book.listed(daemon).items()}
        book.accepted.update((job, names.get(job, name)) for job, name in book.accepted.items())
        book.adopt(daemon)
        book.settle(daemon)
        book.check_all(daemon)
        daemon.end_by_drain()
        daemon.await_nobody()
        daemon.check_database()
    finally:
        if not daemon.dead():
            daemon.kill()


class Rounds:
    """A record, losses at points of it, and from one of them on the next record, so that recovery is recorded, too."""

    def __init__(self, build, where, seed, deaf):
        self.build, self.where, self.seed, self.deaf = build, where, seed, deaf
        self.base, self.book, self.number = None, Book(), 0
        self.figures = {"losses": dict.fromkeys(LOSSES, 0), "records": 0, "calls": 0, "syncs": 0,
                        "failed syncs": 0, "jobs": 0}

    def disk(self):
        disk = Disk(self.deaf)
        if self.base:
            disk.load(self.base / "state")
        return disk

    def round(self, losses, chance):
        seed = f"{self.seed}.{self.number}"
        rng = random.Random(seed)
        place = self.where / f"record.{self.number}"
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        if self.base:
            shutil.copytree(self.base / "state", place / "state")
        else:
            (place / "state").mkdir()
        if chance:  # a job may fail of an fsync, too
            self.book.forgiving = self.book.untidy = True
        after = copy_book(self.book)
        entries = record(Daemon(self.build, place, "--workers", 2), after, self.disk(), seed, chance)
        self.count(entries)
        shutil.rmtree(place)
        points = sorted(rng.randrange(len(entries) + 1) for _ in range(losses))
        keep, disk, done = rng.randrange(losses), self.disk(), 0
        for k, point in enumerate(points):
            for entry in entries[done:point]:
                disk.apply(entry)
            done = point
            self.lose(disk, book_at(self.book, after, entries[:point]), f"{seed}.{k}", k == keep)
        if self.base:
            shutil.rmtree(self.base)
        self.base, self.book = self.kept
        self.number += 1

    def count(self, entries):
        self.figures["records"] += 1
        self.figures["calls"] += sum(entry[0] not in ("synced", "accepted", "ended") for entry in entries)
        self.figures["syncs"] += sum(entry[0] in ("sync", "unsynced") for entry in entries)
        self.figures["failed syncs"] += sum(entry[0] == "unsynced" for entry in entries)
        self.figures["jobs"] += sum(entry[0] == "accepted" for entry in entries)

    def lose(self, disk, book, seed, keep):
        loss = random.Random(seed).choice(LOSSES)
        base = self.where / f"loss.{seed}"
        shutil.rmtree(base, ignore_errors=True)
        base.mkdir(parents=True)
        disk.lose_power(base / "state", loss, seed)
        if keep:
            kept = self.where / f"kept.{seed}"
            shutil.rmtree(kept, ignore_errors=True)
            shutil.copytree(base, kept)
            self.kept = kept, copy_book(book)
        try:
            survive(self.build, base, book)
        except Exception as e:
            raise Violation(f"power loss {seed} ({loss}) in {base}: {e}") from e
        self.figures["losses"][loss] += 1
        shutil.rmtree(base)


def run(build, where, losses, seed, say, deaf=lambda path: False):
    """So many losses; the figures. Raises Violation with the seed and the place."""
    shutil.rmtree(where, ignore_errors=True)
    rounds, done = Rounds(build, where, seed, deaf), 0
    while done < losses:
        rounds.round(min(LOSSES_A_RECORD, losses - done), 0 if done < losses / 2 else FAILING)
        done += min(LOSSES_A_RECORD, losses - done)
        say(f"{done} of {losses} power losses")
    shutil.rmtree(where)
    return rounds.figures
