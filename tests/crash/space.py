# SPDX-License-Identifier: Apache-2.0
"""Disks that fill and empty at random moments under load, with kills between: nothing fails of it for good."""
import random
import shutil
import time

import kills
import restores
from farm import Book, Daemon, Load, Violation, make_footage, wait_until
from volume import MIB, PAGE, Volume

CYCLES_A_ROUND = 25  # then the disks are emptied, all jobs end, everything is looked at, and the next round begins
STATE_MIB, OUTPUT_MIB = 96, 16
FLOOR_MIB, RESERVE_MIB = 8, 4
MARGIN = 2 * MIB  # what running jobs may take while a look at the free space is compared with another
STEPS, STEP_S = (2, 3, 4), 0.15  # changes of a disk in a cycle, and the longest time between two
ENDS, DRAINS = 0.8, 0.2  # chances: the daemon ends in a cycle; it is no kill that ends it
CANCELS = 0.2  # the chance of a cancellation at each look at a full disk


class StrictBook(Book):
    """No worker is killed here: whatever a full disk does to an attempt, the job is to be tried again."""

    def check_failure(self, daemon, now):
        raise Violation(f"the job {now['id']} failed: {now['error']}")


class Disks:
    """That of the state directory and that of the copies (output.directory)."""

    def __init__(self, base):
        self.state, self.output = Volume(base / "disk", STATE_MIB), Volume(base / "outputs", OUTPUT_MIB)
        self.all = {"state": self.state, "output": self.output}

    def __enter__(self):
        self.state.__enter__()
        self.output.__enter__()
        return self

    def __exit__(self, *_):
        self.output.__exit__()
        self.state.__exit__()

    def is_full(self):
        """Whether less is free for the state directory than there has to be."""
        return self.state.free() < FLOOR_MIB * MIB

    def empty(self):
        for volume in self.all.values():
            volume.empty()


def new_daemon(build, base):
    daemon = Daemon(build, base, "--workers", 2, "--input_roots", base.parent / "footage", "--output_roots", base / "outputs",
                    "--free_space_mb", FLOOR_MIB, "--reserve_mb", RESERVE_MIB, "--storage_retries", 1000000)
    daemon.state = base.resolve() / "disk" / "state"
    return daemon


# ---- what is to be while a disk is full

def says_so(daemon, disks):
    """Whether /readyz says that the disk is full exactly when it is; None when that cannot be told."""
    before = disks.is_full()
    reply = daemon.ask("GET", "/readyz")
    if reply is None or disks.is_full() != before:
        return None
    if reply.status not in (200, 503) or (reply.status == 503) != (b"storage_full" in reply.body):
        raise Violation(f"/readyz is answered with {reply.status} {reply.body!r}")
    return (reply.status == 503) == before


def check_readiness(daemon, disks, figures):
    try:
        wait_until(lambda: says_so(daemon, disks) or daemon.dead(), "/readyz to tell of the disk", 30)
    except AssertionError:
        raise Violation(f"/readyz does not tell of the disk, {disks.state.free()} bytes of which are free and"
                        f" {FLOOR_MIB * MIB} are wanted: {daemon.ask('GET', '/readyz').body!r}") from None
    figures["readyz said that the disk is full" if disks.is_full() else "readyz said that it has room"] += 1


def check_changes(daemon, book, load, rng, figures):
    """Cancelling and deleting; the load holds the answers against what they may be."""
    ended = [job for job in list(book.ended) if job not in book.doubtful]
    if ended:
        job = rng.choice(ended)
        load.delete(job)
        figures["deleted on a full disk"] += job in book.deleted
    waiting = book.unfinished()
    if waiting and rng.random() < CANCELS:
        load.cancel(rng.choice(waiting))
        figures["cancelled on a full disk"] += 1


def choose_room(rng, name):
    """How much is to be left free."""
    if name == "output":
        return rng.choice((0, PAGE, rng.randrange(16) * PAGE, MIB))
    return rng.choice((0, 0, rng.randrange(1, 9) * PAGE, rng.randrange(RESERVE_MIB * MIB), RESERVE_MIB * MIB + MARGIN,
                       FLOOR_MIB * MIB - MARGIN, FLOOR_MIB * MIB + MARGIN))


def step(daemon, book, load, disks, rng, figures):
    name, volume = rng.choice(list(disks.all.items()))
    if rng.random() < 0.3:
        volume.empty()
        figures["emptied"][name] += 1
    else:
        volume.leave(choose_room(rng, name))
        figures["filled"][name] += 1
    check_readiness(daemon, disks, figures)
    if disks.is_full():
        check_changes(daemon, book, load, rng, figures)


# ---- cycles

def cycle(daemon, book, disks, seed, footage, figures):
    rng = random.Random(seed)
    if daemon.dead():
        full = disks.is_full()
        daemon.start()
        figures["started on a full disk"] += full
        check_readiness(daemon, disks, figures)
    load = Load(daemon, book, seed, footage, outputs=disks.output.where)
    try:
        for _ in range(rng.choice(STEPS)):
            time.sleep(rng.uniform(0, STEP_S))
            step(daemon, book, load, disks, rng, figures)
        time.sleep(rng.uniform(0, STEP_S))
        if rng.random() < ENDS:
            restores.end_somehow(daemon, rng, DRAINS, figures)
    finally:
        load.stop()
    if daemon.dead():
        kills.check_dead(daemon, figures)
    if rng.random() < 0.5:
        disks.empty()
        if daemon.dead():
            daemon.start()
        check_readiness(daemon, disks, figures)
        wanted = len(book.ended) + 1
        wait_until(lambda: [book.look(daemon, job) for job in book.unfinished()] == [] or len(book.ended) >= wanted,
                   "jobs to end")


def leave_exactly(volume, room):
    volume.leave(room)
    return volume.free() == room


def check_edge(daemon, disks, figures):
    """To the page. All jobs have ended, but the daemon may still write of that, and remove what was deleted."""
    for room in (FLOOR_MIB * MIB, FLOOR_MIB * MIB - PAGE, 0, FLOOR_MIB * MIB):
        wait_until(lambda room=room: leave_exactly(disks.state, room), f"{room} bytes to be free")
        check_readiness(daemon, disks, figures)
    disks.empty()


def finish(daemon, book, disks, figures):
    disks.empty()
    if daemon.dead():
        daemon.start()
    book.settle(daemon)
    check_edge(daemon, disks, figures)
    kills.finish(daemon, book, figures)


def new_figures():
    each = {"state": 0, "output": 0}
    return {**kills.new_figures(), "filled": dict(each), "emptied": dict(each), "kills": 0, "drains": 0,
            "started on a full disk": 0, "deleted on a full disk": 0, "cancelled on a full disk": 0,
            "readyz said that the disk is full": 0, "readyz said that it has room": 0}


def run(build, where, times, seed, say, new_daemon=new_daemon):
    """So many kills, and a few drains; the figures. Raises Violation with the seed and the place."""
    figures, done, footage = new_figures(), 0, make_footage(build, where / "footage")
    while figures["kills"] < times:
        base, first = where / f"round.{done}", done
        shutil.rmtree(base, ignore_errors=True)
        base.mkdir(parents=True)
        with Disks(base) as disks:
            daemon, book = new_daemon(build, base), StrictBook(base / "accepted")
            try:
                while figures["kills"] < times and (done == first or done % CYCLES_A_ROUND):
                    cycle(daemon, book, disks, f"{seed}.{done}", footage, figures)
                    done += 1
                finish(daemon, book, disks, figures)
            except Exception as e:
                raise Violation(f"full disk {seed}.{done} in {base}: {e}") from e
            finally:
                if daemon.process and not daemon.dead():
                    daemon.kill()
                book.close()
        say(f"{figures['kills']} of {times} kills with full disks, {sum(figures['ended'].values())} jobs ended")
        shutil.rmtree(base)
    return figures
