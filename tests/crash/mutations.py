# SPDX-License-Identifier: Apache-2.0
"""Faults of the service that the crash tests must see: each is made on purpose, and the test is to fail of it."""

import shutil
import subprocess
import sys

import damage
import faults
import kills
import power
import reboots
import restores
import space
import volume
from farm import Daemon, Violation

LOSSES, KILLS, HARMS = 40, 60, 30  # a mutation that outlives so many has not been caught
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


# A daemon that removes every result which its database does not know before it starts, as hexad 0.1 did.
SWEEPING = """
import pathlib, shutil, sqlite3
state = pathlib.Path(sys.argv[sys.argv.index("--state_dir") + 1])
if (state / "queue.db").exists():
    database = sqlite3.connect(state / "queue.db")
    known = {row[0] for row in database.execute("SELECT id FROM job")}
    database.close()
    for path in (state / "results").glob("*"):
        if path.name[:26] not in known:
            shutil.rmtree(path)
"""

# A daemon that takes a damaged database away by itself and begins another one.
FORGETTING = """
import pathlib, sqlite3
state = pathlib.Path(sys.argv[sys.argv.index("--state_dir") + 1])
try:
    database = sqlite3.connect(state / "queue.db")
    sound = database.execute("PRAGMA quick_check").fetchall() == [("ok",)]
    database.close()
except sqlite3.Error:
    sound = False
if not sound:
    for path in state.glob("queue.db*"):
        path.unlink()
    sys.argv.append("--adopt")
"""

# A daemon that takes every boot for the same.
TIMELESS = """
import pathlib, sqlite3
state = pathlib.Path(sys.argv[sys.argv.index("--state_dir") + 1])
boot = pathlib.Path("/proc/sys/kernel/random/boot_id").read_text().strip()
if (state / "queue.db").exists():
    database = sqlite3.connect(state / "queue.db")
    with database:
        database.execute("UPDATE instance SET boot_id = ?", (boot,))
    database.close()
"""


class WrappedDaemon(Daemon):
    """Python code is run before each start."""

    code = ""

    def words(self):
        program, *rest = super().words()
        wrapped = f"import os, sys\n{self.code}\nos.execv({program!r}, [{program!r}, *sys.argv[1:]])"
        return [sys.executable, "-IS", "-c", wrapped, *rest]

    def backup(self, path):
        return subprocess.run([*super().words(), "--backup", path], capture_output=True, text=True)


def wrapped(text):
    class Wrapped(WrappedDaemon):
        code = text
    return Wrapped


class CopyingDaemon(Daemon):
    """Its backup is a copy of the file, without what stands in the log only."""

    def backup(self, path):
        return subprocess.run(["cp", self.state / "queue.db", path], capture_output=True, text=True)


def floorless(build, base):
    daemon = space.new_daemon(build, base)
    daemon.options[daemon.options.index("--free_space_mb") + 1] = "0"
    return daemon


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
        ("a start deletes results that are not in the database", "restores",
         lambda where, say: restores.run(build, where, HARMS, seed, say, wrapped(SWEEPING))),
        ("a backup is a copy of the database without its log", "restores",
         lambda where, say: restores.run(build, where, HARMS, seed, say, CopyingDaemon)),
        ("a damaged database is taken away and another one begun", "damage",
         lambda where, say: damage.run(build, where, HARMS, seed, say, wrapped(FORGETTING))),
        ("every boot has the same id", "reboots",
         lambda where, say: reboots.run(build, where, HARMS, seed, say, wrapped(TIMELESS))),
        *([] if volume.why_not() else [
            ("the free space is not checked", "space",
             lambda where, say: space.run(build, where, HARMS, seed, say, floorless))]),
    ]


def run(build, where, seed, say, some=None):
    """What each was caught by. Raises Violation when one was not. `some` are places in the table; None: all."""
    caught, rows = [], table(build, seed)
    for what, part, act in rows if some is None else [rows[k] for k in some]:
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
