"""Faults of the service that the crash tests must see: each is made on purpose, and the test is to fail of it."""

import shutil
import sys

import faults
import kills
import power
from farm import Daemon, Violation

LOSSES, KILLS = 40, 60  # a mutation that outlives so many has not been caught
WAL_WRITES_A_LIE = 40

# A worker that does not end with the daemon that started it, and has long to run when that ends.
DEATHLESS = """#!%s -IS
import ctypes, os, subprocess, sys, time
ctypes.CDLL(None).prctl(1, 0, 0, 0, 0)  # PR_SET_PDEATHSIG
parent = os.getppid()
done = subprocess.call([%r, *sys.argv[1:]], pass_fds=(3,))
if os.getppid() != parent:
    time.sleep(600)
sys.exit(done)
"""

# A worker whose result is not what its report says: a byte of it changes.
FLIPPING = """#!%s -IS
import os, subprocess, sys
done = subprocess.call([%r, *sys.argv[1:]], pass_fds=(3,))
path = os.path.join(sys.argv[sys.argv.index("--output") + 1], "points.ply")
if os.path.exists(path):
    with open(path, "r+b") as file:
        file.seek(-1, 2)
        last = file.read(1)
        file.seek(-1, 2)
        file.write(bytes([last[0] ^ 1]))
sys.exit(done)
"""


class Lie:
    """A judge that claims writes to the database's log which it has not done."""

    def __init__(self):
        self.count = 0

    def __call__(self, call):
        if call.name != "pwrite64" or call.paths != ["queue.db-wal"]:
            return None
        self.count += 1
        return ("value", call.arguments[2]) if self.count % WAL_WRITES_A_LIE == 0 else None


class LyingDaemon(Daemon):
    def spawn(self, judge=None):
        self.state.mkdir(exist_ok=True)
        return super().spawn(Lie())


class LostRename(faults.Fault):
    """The result's rename into its place, claimed and not done."""

    def __init__(self):
        self.hits, self.for_ever = 0, False

    def __call__(self, call):
        if call.name.startswith("rename") and call.paths[1].startswith("results/"):
            self.hits += 1
            return "value", 0
        return None


def with_worker(where, text, *paths):
    where.mkdir(parents=True, exist_ok=True)
    worker = where / "worker"
    worker.write_text(text % (sys.executable, *paths))
    worker.chmod(0o700)
    return lambda *words: Daemon(*words, "--worker", worker)


def unsynced(*names):
    return lambda path: path in names


def table(build, seed):
    """(what is broken, the part that is to see it, how it is run)."""
    real = str(build / "hexad-worker")

    def losses(deaf):
        return lambda where, say: power.run(build, where, LOSSES, seed, say, deaf)

    def killed(new_daemon):
        return lambda where, say: kills.run(build, where / "kills", KILLS, seed, say, new_daemon(where))
    return [
        ("the database's log is not flushed", "power loss", losses(unsynced("queue.db-wal"))),
        ("the names in the state directory are not flushed", "power loss", losses(unsynced("."))),
        ("a result's way into `results` is not flushed", "power loss", losses(unsynced("results", "attempts"))),
        ("a worker's files are not flushed", "power loss", losses(
            lambda path: path.startswith("attempts/") and path.count("/") == 2)),
        ("the names in an attempt's directory are not flushed", "power loss", losses(
            lambda path: path.startswith("attempts/") and path.count("/") == 1)),
        (f"one in {WAL_WRITES_A_LIE} writes to the database's log is not done", "kill -9",
         killed(lambda where: LyingDaemon)),
        ("workers do not end with the daemon", "kill -9",
         killed(lambda where: with_worker(where, DEATHLESS, real))),
        ("a byte of a result changes after it was verified", "kill -9",
         killed(lambda where: with_worker(where, FLIPPING, real))),
        ("a result is not renamed into place", "faults",
         lambda where, say: faults.try_one(build, where, LostRename(), True, tolerant=False)),
    ]


def run(build, where, seed, say, some=None):
    """What each was caught by. Raises Violation when one was not."""
    caught = []
    for what, part, act in table(build, seed)[:some]:
        shutil.rmtree(where / "mutation", ignore_errors=True)
        try:
            act(where / "mutation", lambda text: None)
        except Violation as e:
            seen = str(e).split(": ", 1)[-1]
            caught.append([what, part, seen])
            say(f"caught: {what}: {seen[:100]}")
        else:
            raise Violation(f"the test does not see that {what}")
    return caught
