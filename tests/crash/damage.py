# SPDX-License-Identifier: Apache-2.0
"""The database is damaged at random while the daemon stands still. Then it refuses to start, or it serves and says so, or the
damage harms nothing; and a backup brings back what it knows."""
import collections
import os
import random
import re
import shutil
import sqlite3
import tempfile

import kills
import restores
from farm import FRAMES, Book, Daemon, Violation, make_footage, spec, wait_until

CYCLES_A_ROUND = 10
GLANCES = 10  # jobs that are looked at while it is not known whether the database is damaged
PAGE, SECTOR = 4096, 512
FEW_PAGES = 3
CHECK_S = 1  # between two checks of the whole database; the least that can be set
WORDS = {"refused to start": 0, "served and said so": 0, "harmless": 0}  # how a damage may go


# ---- kinds of damage: each is given the state directory and a random generator, and says what it did

def overwrite(path, offset, content):
    with open(path, "r+b") as file:
        file.seek(offset)
        file.write(content)


def pages_of(path):
    return path.stat().st_size // PAGE


def damage_pages(state, rng):
    path = state / "queue.db"
    chosen = rng.sample(range(1, pages_of(path)), min(pages_of(path) - 1, rng.choice((1, 1, 1, 2, 4, 16))))
    for page in chosen:
        overwrite(path, page * PAGE, rng.randbytes(PAGE))
    return f"random bytes in the pages {chosen}"


def zero_pages(state, rng):
    path = state / "queue.db"
    chosen = rng.sample(range(1, pages_of(path)), min(pages_of(path) - 1, rng.choice((1, 1, 2, 8))))
    for page in chosen:
        overwrite(path, page * PAGE, bytes(PAGE))
    return f"zeros in the pages {chosen}"


def misplace_page(state, rng):
    path = state / "queue.db"
    source, target = rng.sample(range(1, pages_of(path)), 2)
    overwrite(path, target * PAGE, path.read_bytes()[source * PAGE:(source + 1) * PAGE])
    return f"the page {source} also in the place of {target}"


def damage_header(state, rng):
    length = rng.choice((1, 16, 100, PAGE))
    offset = rng.randrange(100) if length == 1 else 0
    overwrite(state / "queue.db", offset, rng.randbytes(length))
    return f"{length} random bytes at {offset}"


def truncate(state, rng):
    path = state / "queue.db"
    before = path.stat().st_size
    after = rng.choice((0, rng.randrange(before), rng.randrange(before // PAGE) * PAGE))
    os.truncate(path, after)
    return f"truncated from {before} to {after} bytes"


def damage_log(state, rng):
    """Where there is none, since the daemon drained, one of random bytes appears."""
    path = state / "queue.db-wal"
    size = path.stat().st_size if path.exists() else 0
    how = rng.choice(("random bytes", "truncated", "removed", "header"))
    if size == 0:
        path.write_bytes(rng.randbytes(rng.randrange(1, 20 * PAGE)))
        return "random bytes for a log"
    if how == "removed":
        path.unlink()
    elif how == "truncated":
        os.truncate(path, rng.randrange(size))
    elif how == "header":
        overwrite(path, 0, rng.randbytes(32))
    else:
        for _ in range(rng.choice((1, 4, 16))):
            overwrite(path, rng.randrange(size), rng.randbytes(min(SECTOR, size)))
    return f"the log of {size} bytes: {how}"


KINDS = {"random pages": (damage_pages, 5), "pages of zeros": (zero_pages, 2), "a misplaced page": (misplace_page, 2),
         "the header": (damage_header, 2), "truncated": (truncate, 2), "the log": (damage_log, 4)}


# ---- what SQLite itself says

class Opinion:
    """Of a copy, as far as it can be read: whether it is sound, and the states of the jobs that it knows."""

    def __init__(self, state):
        self.states, self.sound = {}, False
        with tempfile.TemporaryDirectory(dir=state.parent) as copy:
            for name in ("queue.db", "queue.db-wal"):
                if (state / name).exists():
                    shutil.copyfile(state / name, f"{copy}/{name}")
            database = sqlite3.connect(f"{copy}/queue.db")
            try:
                found = database.execute("PRAGMA integrity_check").fetchall()
                broken = database.execute("PRAGMA foreign_key_check").fetchall()
                # else all of it stood in a log that is lost, which leaves a file of one page
                if database.execute("SELECT 1 FROM sqlite_master").fetchall() or not (state / "queue.db").stat().st_size:
                    self.states = dict(database.execute("SELECT id, state FROM job"))
                self.sound = found == [("ok",)] and not broken
            except sqlite3.Error:
                pass
            finally:
                database.close()


# ---- a start with the damage

def said_since(daemon, size):
    with open(daemon.log, "rb") as log:
        log.seek(size)
        return log.read().decode(errors="replace")


def check_refusal(daemon, said):
    errors = [line for line in said.splitlines() if " error " in line]
    if daemon.process.returncode <= 0 or not errors:
        raise Violation(f"the start with a damaged database ends with {daemon.process.returncode} and {said!r}")
    if "queue.db" not in errors[-1] or "backup" not in errors[-1]:
        raise Violation(f"the refusal does not name the database and the backup: {errors[-1]}")


def is_damaged(daemon):
    reply = daemon.ask("GET", "/readyz")
    return reply is not None and reply.status == 503 and b"database_damaged" in reply.body


def last_check(daemon):
    reply = daemon.ask("GET", "/metrics")
    found = re.search(rb"^hexad_database_last_check_timestamp_seconds (\S+)$", reply.body, re.M)
    return float(found[1]) if found else 0


def await_checks(daemon):
    """Until the damage is told, or the quick check and one of the whole database have found none."""
    seen = set()

    def over():
        seen.add(last_check(daemon))
        return is_damaged(daemon) or len(seen - {0}) >= 2 or daemon.dead()
    wait_until(over, "the checks of the database")
    if daemon.dead():
        raise Violation(f"the daemon with a damaged database ended with {daemon.process.returncode}")


def glance(daemon, book, job):
    """One job while the database may be damaged: what is served of a result is right, whatever else is said."""
    digest = book.ended[job][1]
    frames = FRAMES if len(digest or ()) > 1 else (None,)
    for k, frame in enumerate(frames):
        listing = daemon.ask("GET", f"/v1/jobs/{job}/results" + (f"?frame={frame}" if frame else ""))
        if listing is None or listing.status != 200:
            continue
        told = {item["name"]: item["sha256"] for item in listing.json["results"]}
        if digest and told["report.json"] != digest[k]:
            raise Violation(f"the job {job} is given another result with a damaged database")
        book.fetch(daemon, job, book.sent[book.accepted[job]]["sampling"]["count"], f"?frame={frame}" if frame else "")


def check_refuses_changes(daemon, book):
    document = spec("damaged")
    reply = daemon.ask("POST", "/v1/jobs", document)
    if reply is None or reply.status != 503 or reply.json["code"] != "database_damaged" or not reply.json["detail"]:
        raise Violation(f"a submission to a damaged database is answered with {reply and (reply.status, reply.body)}")


def start_damaged(daemon, book, opinion, figures):
    """How it went, in a word of WORDS."""
    size = daemon.log.stat().st_size
    daemon.spawn()
    if not daemon.await_served():
        check_refusal(daemon, said_since(daemon, size))
        return "refused to start"
    tolerant, book.tolerant = book.tolerant, True
    try:
        for job in sorted(job for job, (state, _) in book.ended.items()
                          if state == "succeeded" and job not in book.doubtful)[-GLANCES:]:
            glance(daemon, book, job)
        await_checks(daemon)
    finally:
        book.tolerant = tolerant
    if is_damaged(daemon):
        check_refuses_changes(daemon, book)
        return "served and said so"
    if not opinion.sound:
        raise Violation("the daemon finds its database sound, and SQLite does not")
    return "harmless"


def check_harmless(daemon, book, opinion, before, figures):
    """The database is a sound one, perhaps an older one, since what stood in a damaged log is lost."""
    restores.check_restored(daemon, book, opinion, before, figures)
    book.settle(daemon)


def check_nothing_removed(before, after, asked):
    """All directories that were there still are, in results or in lost+found."""
    there = collections.Counter([*after.results.values(), *after.kept.values()])
    for name, files in [*before.results.items(), *before.kept.items()]:
        if there[files] <= 0 and name[:restores.ID] not in asked:
            raise Violation(f"the result {name} is gone after a start with a damaged database")
        there[files] -= 1


# ---- cycles

def cycle(daemon, book, seed, footage, figures):
    rng = random.Random(seed)
    backup = restores.be_loaded(daemon, book, None, seed, rng, footage, daemon.base / "backup", figures)
    kind = rng.choices(list(KINDS), [weight for _, weight in KINDS.values()])[0]
    if pages_of(daemon.state / "queue.db") < FEW_PAGES:  # all that there is stands in the log
        kind = "the log"
    did = KINDS[kind][0](daemon.state, rng)
    opinion, before, asked = Opinion(daemon.state), restores.Holdings(daemon), book.deleted | book.doubtful
    remembered = restores.remember(book)
    try:
        went = start_damaged(daemon, book, opinion, figures)
        if went == "harmless":
            check_harmless(daemon, book, opinion, before, figures)
    except Violation as e:
        raise Violation(f"{kind} ({did}): {e}") from e
    figures["damage"].setdefault(kind, dict(WORDS))[went] += 1
    if not daemon.dead():
        restores.end_somehow(daemon, rng, 0.5, figures)
    daemon.await_nobody()
    check_nothing_removed(before, restores.Holdings(daemon), asked)
    restores.move_back(daemon)
    restores.recall(book, remembered)
    restores.start_from(daemon, book, backup, figures)


def run(build, where, times, seed, say, new_daemon=Daemon):
    """So many kills, and a damage for each but a few; the figures. Raises Violation with the seed and the place."""
    figures = {**restores.new_figures(), "damage": {}}
    done, footage = 0, make_footage(build, where / "footage")
    while figures["kills"] < times:
        base, first = where / f"round.{done}", done
        shutil.rmtree(base, ignore_errors=True)
        daemon = new_daemon(build, base, "--workers", 2, "--input_roots", footage, "--check_interval_s", CHECK_S)
        book = Book(base / "accepted")
        try:
            daemon.start()
            while figures["kills"] < times and (done == first or done % CYCLES_A_ROUND):
                cycle(daemon, book, f"{seed}.{done}", footage, figures)
                done += 1
            kills.finish(daemon, book, figures)
        except Exception as e:
            raise Violation(f"damage {seed}.{done} in {base}: {e}") from e
        finally:
            if daemon.process and not daemon.dead():
                daemon.kill()
            book.close()
        say(f"{figures['kills']} of {times} kills, {done} damaged databases")
        shutil.rmtree(base)
    return figures
