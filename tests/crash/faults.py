# SPDX-License-Identifier: Apache-2.0
"""Every system call of one job's way from submission to result fails once, in each way that it can."""
import collections
import errno
import itertools
import random
import re
import shutil

from calls import SYNCS, WRITES
from farm import FINAL, Book, Daemon, Violation, spec, wait_until

MAKES_NAMES = {"mkdir", "mkdirat", "rename", "renameat", "renameat2", "link", "linkat", "symlink", "symlinkat"}

MANY_ALIKE, SOME = 60, 10


def plain(path):
    """A path without what differs from run to run: ids and the random part of temporary names."""
    path = re.sub(r"\b[0-9a-hjkmnp-tv-z]{26}\b", "ID", path)
    return re.sub(r"\.[0-9a-f]{16}\b", ".TMP", path)


def makes_name(call):
    return call.name in MAKES_NAMES or call.creates()


class Place:
    """A call among those of a run: the nth of its program with that name and those paths."""

    def __init__(self, call):
        self.program, self.name = call.program, call.name
        self.paths = " -> ".join(plain(p) for p in call.paths if p)
        self.makes = makes_name(call)

    @property
    def key(self):
        return self.program, self.name, self.paths

    def faults(self):
        """(what, how it is done, whether for ever)."""
        if self.name in WRITES:
            yield from (("EIO", False), ("ENOSPC", False), ("a short write", False), ("ENOSPC from then on", True))
        elif self.name in SYNCS:
            yield from (("EIO", False), ("EIO from then on", True))
        elif self.makes or self.name in ("fallocate",):
            yield from (("EIO", False), ("ENOSPC", False), ("ENOSPC from then on", True))
        else:
            yield ("EIO", False)


class Trace:
    """A judge that lets all go on and notes the places."""

    def __init__(self):
        self.places = []
        self.seen = collections.Counter()

    def __call__(self, call):
        if any(call.paths):
            place = Place(call)
            self.places.append((place, self.seen[place.key]))
            self.seen[place.key] += 1


class Fault:
    """A judge that fails one call, or that one and all like it from then on."""

    def __init__(self, place, nth, what, for_ever):
        self.place, self.nth, self.what, self.for_ever = place, nth, what, for_ever
        self.seen, self.hits = 0, 0

    def __str__(self):
        return f"{self.place.program}: {self.place.name} {self.place.paths} #{self.nth}: {self.what}"

    def is_like(self, call):
        """A full disk is full for every file, a broken one does not flush any."""
        return call.name in SYNCS if self.place.name in SYNCS else call.name in WRITES or makes_name(call)

    def __call__(self, call):
        if not any(call.paths):
            return None
        if self.hits and self.for_ever and self.is_like(call):
            self.hits += 1
        elif not self.hits and Place(call).key == self.place.key:
            self.seen += 1
            if self.seen <= self.nth:
                return None
            self.hits += 1
        else:
            return None
        if self.what == "a short write":
            length = max(1, len(call.data()) // 2)
            return "value", call.write_part(length)
        return "error", errno.EIO if self.what.startswith("EIO") else errno.ENOSPC


def submit_patiently(daemon, book, name, fault):
    """As a client does that is told to try again later; None when the fault is there for ever."""
    tries = itertools.count()
    wait_until(lambda: book.submit(daemon, spec(f"{name}.{next(tries)}", preview=True)) or daemon.dead()
               or fault and fault.for_ever and fault.hits, "an acceptance")


def use(daemon, book, fault=None):
    """One job from submission to result, and what a client sees of it. Gives how it went, in a word."""
    if not daemon.await_served():
        if daemon.process.returncode <= 0 or b" error " not in daemon.log.read_bytes():
            raise Violation(f"the start ended with {daemon.process.returncode} and no word")
        return "refused to start"
    submit_patiently(daemon, book, "first", fault)

    def is_over():
        seen = [book.look(daemon, job) for job in book.accepted]
        ended = all(now and now["state"] in FINAL and job in book.ended
                             for now, job in zip(seen, book.accepted))
        return ended or daemon.dead() or fault and fault.for_ever and fault.hits > 6
    wait_until(is_over, "the job's end")
    ends = {book.ended.get(job, ("",))[0] for job in book.accepted}
    unharmed = set(book.replies) == {"201"} and ends == {"succeeded"}
    if fault and fault.hits:
        submit_patiently(daemon, book, "second", fault)
    if daemon.dead():
        raise Violation(f"the daemon died: {daemon.process.returncode}")
    return "went on" if unharmed else "said so"


def recover(daemon, book):
    """A start without faults, and everything as it has to be."""
    daemon.await_nobody()
    daemon.check_database()
    daemon.start()
    book.tolerant = False
    book.adopt(daemon)
    book.settle(daemon)
    book.check_all(daemon)
    daemon.end_by_drain()
    daemon.await_nobody()


def try_one(build, base, judge, drains, tolerant=True):
    """A run under a judge, its end by a drain or by a kill, and the recovery. How it went."""
    shutil.rmtree(base, ignore_errors=True)
    daemon, book = Daemon(build, base, "--workers", 1, "--drain_s", 0.1, "--grace_s", 0.1), Book(None, tolerant, True)
    daemon.state.mkdir()
    fault = judge if isinstance(judge, Fault) else None
    try:
        daemon.spawn(judge)
        with daemon.supervisor:
            went = use(daemon, book, fault)
            if not daemon.dead() and drains and daemon.end() < 0:
                raise Violation(f"the drain died: {daemon.process.returncode}")
            if not daemon.dead():
                daemon.kill()
        if daemon.supervisor.failure:
            raise RuntimeError(daemon.supervisor.failure)
        recover(daemon, book)
        return went
    finally:
        if not daemon.dead():
            daemon.kill()


def list_faults(build, where, seed):
    """All places of a run without faults; of calls that come very often, the pieces in which a picture is written and
    read, SOME chosen by the seed."""
    trace = Trace()
    try_one(build, where / "trace", trace, True)
    rng = random.Random(seed)
    chosen = {key: set(range(n)) if n <= MANY_ALIKE else {0, n - 1, *rng.sample(range(n), SOME)}
              for key, n in trace.seen.items()}
    return len(trace.places), [Fault(place, nth, *how) for place, nth in trace.places if nth in chosen[place.key]
                               for how in place.faults()]


def run(build, where, seed, say, every=1):
    """All faults, or one in `every`; the figures. Raises Violation with the fault and the place."""
    places, faults = list_faults(build, where, seed)
    faults = faults[random.Random(seed).randrange(every)::every]
    table = collections.defaultdict(collections.Counter)
    for k, fault in enumerate(faults):
        base = where / "fault"
        try:
            went = try_one(build, base, fault, k % 2 == 0)
            if not fault.hits:  # perhaps a call of the drain
                fault.seen = 0
                went = try_one(build, base, fault, True)
        except Exception as e:
            raise Violation(f"fault {fault} in {base}: {e}") from e
        went = went if fault.hits else "not reached"
        table[f"{fault.place.name}|{fault.what}"][went] += 1
        if k % 50 == 49:
            say(f"{k + 1} of {len(faults)} faults")
    return {"calls": places, "faults": len(faults), "table": {key: dict(row) for key, row in table.items()}}
