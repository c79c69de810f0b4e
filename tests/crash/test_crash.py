# SPDX-License-Identifier: Apache-2.0
"""Short runs of the crash tests, and tests of their parts. `make crashtest` runs the full length."""
import errno
import os
import pathlib
import re
import sqlite3
import subprocess
import sys
import threading

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import arrays  # noqa: E402
import calls  # noqa: E402
import damage  # noqa: E402
import disk  # noqa: E402
import farm  # noqa: E402
import faults  # noqa: E402
import kills  # noqa: E402
import mutations  # noqa: E402
import power  # noqa: E402
import reboots  # noqa: E402
import restores  # noqa: E402
import shortage  # noqa: E402
import space  # noqa: E402
import tables  # noqa: E402
import upgrades  # noqa: E402
import volume  # noqa: E402

pytestmark = pytest.mark.extended

SEED = os.environ.get("HEXAD_CRASH_SEED", "check")  # of a run that is to be seen again


@pytest.fixture
def supervision():
    missing = calls.why_not()
    if missing:
        pytest.skip(missing)


def test_kills(build, tmp_path, diagnose):
    figures = kills.run(build, tmp_path, 6, SEED, lambda text: diagnose(f"seed {SEED}: {text}"))
    assert sum(figures["cycles"].values()) == 6 and figures["ended"]["succeeded"]


def test_kills_with_clock_steps(build, tmp_path, diagnose):
    if farm.setclock.why_not():
        pytest.skip(farm.setclock.why_not())
    figures = kills.run_with_steps(build, tmp_path, 6, SEED, lambda text: diagnose(f"seed {SEED}: {text}"))
    assert figures["clock steps"] == 6 and figures["ended"]["succeeded"]


def test_deaths_of_daemon_and_host(build, tmp_path, diagnose, monkeypatch):
    monkeypatch.setattr(reboots, "DEATHS_A_ROUND", 3)
    monkeypatch.setattr(reboots, "BOUNDS", (0, 1))
    monkeypatch.setattr(reboots, "COUNT", 10000)
    figures = reboots.run(build, tmp_path, 6, SEED, lambda text: diagnose(f"seed {SEED}: {text}"))
    assert figures["jobs"]["succeeded"] and figures["jobs"]["failed"] and figures["interruptions"]


def test_full_disks(build, tmp_path, diagnose):
    missing = volume.why_not()
    if missing:
        pytest.skip(missing)
    figures = space.run(build, tmp_path, 2, SEED, lambda text: diagnose(f"seed {SEED}: {text}"))
    assert figures["filled"]["state"] and figures["ended"]["succeeded"]
    assert figures["readyz said that the disk is full"] and figures["readyz said that it has room"]


def test_backups_put_back(build, tmp_path, diagnose):
    figures = restores.run(build, tmp_path, 3, SEED, lambda text: diagnose(f"seed {SEED}: {text}"))
    assert figures["backups"] >= 3 and figures["backups put back"] and figures["ended"]["succeeded"]


def test_shortages_of_descriptors(build, tmp_path, diagnose):
    figures = shortage.run(build, tmp_path, 4, SEED, lambda text: diagnose(f"seed {SEED}: {text}"))
    assert figures["tries"] == 4 and figures["jobs accepted"]


def test_damage(build, tmp_path, diagnose):
    figures = damage.run(build, tmp_path, 1, SEED, lambda text: diagnose(f"seed {SEED}: {text}"))
    assert sum(sum(row.values()) for row in figures["damage"].values()) == figures["backups"]


def test_kills_during_changes_of_arrays(build, tmp_path, diagnose, monkeypatch):
    monkeypatch.setattr(arrays, "FRAMES", 5000)
    monkeypatch.setattr(arrays, "FILES", 3000)
    figures = arrays.run(build, tmp_path, 8, SEED, lambda text: diagnose(f"seed {SEED}: {text}"))
    assert figures["kills"] >= 8 and sum(sum(count.values()) for count in figures["changes"].values()) > 2


def test_kills_during_an_upgrade(build, tmp_path, diagnose, monkeypatch):
    monkeypatch.setattr(upgrades, "BUILDS", ("7218b1f7",))
    figures = upgrades.run(build, tmp_path, 1, SEED, lambda text: diagnose(f"seed {SEED}: {text}"))
    assert figures["kills"] >= 4


def test_a_log_that_held_the_whole_database(build, tmp_path):
    """Is lost before there are results: that is a start with nothing."""
    daemon, book = farm.Daemon(build, tmp_path, "--check_interval_s", damage.CHECK_S), farm.Book()
    daemon.start()
    daemon.kill()
    assert not sqlite3.connect(f"file:{daemon.state}/queue.db?immutable=1", uri=True).execute(
        "SELECT 1 FROM sqlite_master").fetchall()
    (daemon.state / "queue.db-wal").unlink()
    assert damage.start_damaged(daemon, book, damage.Opinion(daemon.state), {}) == "harmless"
    daemon.kill()


def test_faults(supervision, build, tmp_path, diagnose):
    figures = faults.run(build, tmp_path, SEED, diagnose, every=60)
    assert figures["faults"] > 10 and any("went on" in row for row in figures["table"].values())


def test_power_losses(supervision, build, tmp_path, diagnose):
    figures = power.run(build, tmp_path / "power", 4, SEED, lambda text: diagnose(f"seed {SEED}: {text}"))
    assert figures["syncs"] and sum(figures["losses"].values()) == 4


def test_mutations_are_seen(supervision, build, tmp_path, diagnose):
    """One fault of the database and one of the results; `make crashtest` makes all of them."""
    assert len(mutations.run(build, tmp_path, SEED, diagnose, some=(0, 9))) == 2


def test_results_have_a_row_for_each_quantity(tmp_path):
    about = {"seed": "1", "minutes": 3.2, "kernel": "6.1", "every": 1}
    figures = {"damage": {"kills": 3, "drains": 1, "about": about, "damage": {"truncated": {"harmless": 2, "served and said so": 1}}},
               "faults": {"calls": 10, "faults": 2, "about": about, "table": {"read|EIO": {"went on": 1}, "fsync|EIO": {"said so": 1}}}}
    tables.write(figures, tmp_path / "crash.csv")
    assert {row["quantity"]: row["measured"] for row in tables.results.read(tmp_path / "crash.csv")} == {
        "all: kills of the daemon or its workers": "3", "damage: kills": "3", "damage: drains": "1", "damage: seed": "1", "damage: minutes": "3",
        "damage: kernel": "Linux 6.1", "faults: system calls from the start to a served result": "10", "faults: runs": "2",
        "faults: one in so many calls was tried": "1", "faults: seed": "1", "faults: minutes": "3", "faults: kernel": "Linux 6.1"}
    assert (tmp_path / "crash_damage.csv").read_text() == "damage,refused_to_start,reported,harmless\ntruncated,0,1,2\n"
    assert (tmp_path / "crash_faults.csv").read_text().splitlines()[1:] == ["fsync EIO,0,1,0,0", "read EIO,1,0,0,0", "all,1,1,0,0"]
    assert not (tmp_path / "crash_mutations.csv").exists()


def test_a_claim_that_could_not_be_stored(supervision, build, tmp_path):
    """Is tried again although nothing else happens that would wake the daemon."""
    accepted, failed = [], []

    def judge(call):
        if not any(call.paths):
            accepted.extend(re.findall(rb"^HTTP/1.1 201 ", call.data()))
        elif accepted and not failed and call.paths == ["queue.db-wal"] and call.name in calls.WRITES:
            failed.append(call.name)
            return "error", errno.ENOSPC
        return None
    daemon, book = farm.Daemon(build, tmp_path), farm.Book()
    daemon.state.mkdir()
    daemon.spawn(judge)
    with daemon.supervisor:
        assert daemon.await_served()
        job = book.submit(daemon, farm.spec("first"))
        book.settle(daemon)
        daemon.end_by_drain()
    assert failed and book.ended[job][0] == "succeeded" and not daemon.supervisor.failure


def test_a_disk_that_fails_once_in_an_attempt(supervision, build, tmp_path):
    """Is the host's fault, and costs the job nothing."""
    failed = []

    def judge(call):
        if not failed and call.program == "worker" and call.name in calls.WRITES and "points.ply" in str(call.paths[0]):
            failed.append(call.name)
            return "error", errno.EIO
        return None
    daemon, book = farm.Daemon(build, tmp_path), farm.Book()
    daemon.state.mkdir()
    daemon.spawn(judge)
    with daemon.supervisor:
        assert daemon.await_served()
        job = book.submit(daemon, farm.spec("once", limits={"max_attempts": 1}))
        book.settle(daemon)
        attempts = daemon.ask("GET", f"/v1/jobs/{job}/attempts").json["attempts"]
        daemon.end_by_drain()
    assert failed and book.ended[job][0] == "succeeded" and not daemon.supervisor.failure
    assert [a["exit_status"] for a in attempts] == [7, 0] and "storage_failed" in attempts[0]["reason"]


def test_a_kill_in_the_middle_of_a_copy(supervision, build, tmp_path):
    """Leaves a file that the next start removes, and no other; a directory that is away is waited for."""
    show, away = tmp_path / "state" / "show", tmp_path / "away"
    half, killed = threading.Event(), threading.Event()

    def judge(call):
        if call.program == "daemon" and call.name in calls.WRITES and ".hexad" in str(call.paths[0]):
            call.write_part(10)
            half.set()
            killed.wait(farm.PATIENCE_S)
            return "value", 10
        return None
    daemon, book = farm.Daemon(build, tmp_path, "--output_roots", show), farm.Book()
    show.mkdir(parents=True)
    film = show / "film"
    daemon.spawn(judge)
    with daemon.supervisor:
        assert daemon.await_served()
        job = book.submit(daemon, farm.spec("copied", output={"preview": False, "directory": str(film)}))
        assert half.wait(farm.PATIENCE_S)
        daemon.kill()
        killed.set()
    left = list(film.glob(".*"))
    assert [p.stat().st_size for p in left] == [10]
    others = [film / name for name in (".points.ply.123.hexad", f".{job}.7.hexad-tmp", ".hexad-tmp", "report.json.x")]
    for other in others:
        other.write_text("of somebody")
    film.rename(away)
    daemon.start()
    book.settle(daemon)
    assert (away / left[0].name).exists() and "and tries again" in daemon.log.read_text()
    daemon.end_by_drain()
    for path in film.iterdir():
        path.rename(away / path.name)
    film.rmdir()
    away.rename(film)
    daemon.start()
    farm.wait_until(lambda: not left[0].exists(), "the removal")
    assert {p.name for p in film.iterdir()} == {"points.ply", "report.json", *(o.name for o in others)}
    assert all(other.read_text() == "of somebody" for other in others)
    listing = daemon.ask("GET", f"/v1/jobs/{job}/results").json["results"]
    for item in listing:
        assert (film / item["name"]).read_bytes() == daemon.ask("GET", item["href"]).body
    daemon.end_by_drain()
    database = sqlite3.connect(daemon.state / "queue.db")
    assert database.execute("SELECT count(*) FROM copy").fetchone() == (0,)
    database.close()


def test_a_copy_that_cannot_be_read_is_no_damage(supervision, build, tmp_path):
    """To SQLite a schema that it cannot read is malformed. The database is not for that."""
    opened, failed = [], []

    def judge(call):
        if call.paths[0] != "copies/0.db":
            return None
        if call.name in calls.OPENS:
            opened.append(call.flags())
        elif call.name == "pread64" and call.arguments[3] and len(opened) == 3:  # made, made one file, checked
            failed.append(call.arguments[3])
            return "error", errno.EIO
        return None
    daemon, book = farm.Daemon(build, tmp_path), farm.Book()
    daemon.state.mkdir()
    daemon.spawn(judge)
    with daemon.supervisor:
        assert daemon.await_served()
        farm.wait_until(lambda: "database checked" in daemon.log.read_text(), "the quick check")
        ready = daemon.ask("GET", "/readyz")
        assert failed and ready.status == 200, ready.body
        book.submit(daemon, farm.spec("first"))
        book.settle(daemon)
        daemon.end_by_drain()
    assert "damaged" not in daemon.log.read_text() and not daemon.supervisor.failure


def test_a_removal_is_on_disk_before_the_queue_ends_the_attempt(supervision, build, tmp_path):
    """Else a power loss brings back what nobody looks for any more."""
    daemon, book, record = farm.Daemon(build, tmp_path), farm.Book(), power.Record(SEED)
    daemon.state.mkdir()
    daemon.spawn(record)
    with daemon.supervisor:
        assert daemon.await_served()
        endless = {"max_sweeps": 1000000, "step_tolerance": 1e-12, "energy_tolerance": 1e-12}
        job = book.submit(daemon, farm.spec("killed", count=20000, solver=endless, limits={"max_attempts": 1}))
        farm.wait_until(daemon.workers, "the worker")
        kills.kill_all(daemon.workers())
        book.settle(daemon)
        daemon.end_by_drain()
    assert book.ended[job][0] == "failed" and not daemon.supervisor.failure
    after = record.entries[record.entries.index(("remove", f"attempts/{job}.1")):]
    ended = next(k for k, entry in enumerate(after) if entry[:2] == ("write", "queue.db-wal"))
    assert any(entry[:2] == ("sync", "attempts") for entry in after[:ended]), after[:ended]


def test_every_call_is_seen(supervision, tmp_path):
    """Of a child of a child, too, and through the buffers of the C library."""
    seen = []
    script = "mkdir b; (echo hello > a; mv a b/c); rmdir b 2>&-; cat b/c > /dev/null; rm b/c"

    def judge(call):
        seen.append((call.name.removesuffix("at").removesuffix("at2"), call.paths))
        if call.name in calls.WRITES:
            assert call.data() == b"hello\n" and call.offset() == 0
    with calls.Supervisor(tmp_path, judge, ["/bin/sh", "-c", script], cwd=tmp_path) as s:
        assert s.process.wait() == 0
    assert not s.failure
    wanted = [("mkdir", ["b"]), ("open", ["a"]), ("write", ["a"]), ("rename", ["a", "b/c"]), ("rmdir", ["b"]),
              ("open", ["b/c"]), ("unlink", ["b/c"])]
    assert [entry for entry in seen if entry in wanted] == wanted


def test_what_a_judge_says_is_done(supervision, tmp_path):
    def judge(call):
        if call.name not in calls.WRITES:
            return None
        if call.paths == ["part"]:
            return "value", call.write_part(3)
        return ("error", errno.EIO) if call.paths == ["error"] else ("value", 6)
    for name, says, left in (("error", "I/O error", b""), ("claim", "", b""), ("part", "", b"hello\n")):
        said = subprocess.PIPE
        with calls.Supervisor(tmp_path, judge, ["/bin/sh", "-c", f"echo hello > {name}"], cwd=tmp_path, stderr=said) as s:
            assert says.encode() in s.process.communicate()[1]
        assert not s.failure and (tmp_path / name).read_bytes() == left


def lost(entries, where, loss="nothing is left", seed=1):
    """path -> content after a loss; directories end in a slash."""
    model = disk.Disk()
    for entry in entries:
        model.apply(entry)
    model.lose_power(where, loss, seed)
    return {f"{p.relative_to(where)}/" if p.is_dir() else str(p.relative_to(where)): None if p.is_dir() else p.read_bytes()
            for p in where.rglob("*")}


def test_a_disk_keeps_what_was_synced(tmp_path):
    entries = [("create", "a"), ("write", "a", 0, b"old"), ("sync", "a", 1), ("synced", 1), ("sync", ".", 2),
               ("write", "a", 0, b"NEW"), ("create", "b"), ("synced", 2), ("sync", "a", 3)]
    assert lost(entries, tmp_path / "nothing") == {"a": b"old"}
    assert lost(entries, tmp_path / "all", "all is left") == {"a": b"NEW", "b": b""}
    assert lost([*entries, ("synced", 3)], tmp_path / "synced") == {"a": b"NEW"}
    some = [lost(entries, tmp_path / f"{seed}", "any of it is left", seed) for seed in range(40)]
    assert {s["a"] for s in some} == {b"old", b"NEW"} and {"b" in s for s in some} == {True, False}


def test_a_disk_forgets_what_an_fsync_failed_for(tmp_path):
    entries = [("create", "a"), ("sync", ".", 1), ("synced", 1), ("write", "a", 0, b"one"), ("write", "a", 5, b"two"),
               ("unsynced", "a"), ("write", "a", 5, b"TWO"), ("sync", "a", 2), ("synced", 2)]
    assert lost(entries, tmp_path / "nothing") == {"a": bytes(5) + b"TWO"}
    some = {lost(entries, tmp_path / f"{seed}", "any of it is left", seed)["a"] for seed in range(40)}
    assert some == {bytes(5) + b"TWO", b"one" + bytes(2) + b"TWO"}


def test_a_disk_renames_as_a_whole(tmp_path):
    entries = [("mkdir", "a"), ("mkdir", "b"), ("create", "a/x"), ("sync", ".", 1), ("synced", 1), ("sync", "a", 2),
               ("synced", 2), ("rename", "a/x", "b/y")]
    assert lost(entries, tmp_path / "before") == {"a/": None, "a/x": b"", "b/": None}
    for directory in "ab":
        after = [*entries, ("sync", directory, 3), ("synced", 3)]
        assert lost(after, tmp_path / directory) == {"a/": None, "b/": None, "b/y": b""}
    some = [lost(entries, tmp_path / f"{seed}", "any of it is left", seed) for seed in range(40)]
    assert {("a/x" in s) + ("b/y" in s) for s in some} == {1} and {"b/y" in s for s in some} == {True, False}


def test_a_disk_tears_pages(tmp_path):
    page = bytes(range(1, 9)) * 512
    entries = [("create", "a"), ("sync", ".", 1), ("synced", 1), ("write", "a", 0, 3 * page)]
    left = {lost(entries, tmp_path / f"{seed}", "any of it is left", seed)["a"] for seed in range(60)}
    assert b"" in left and 3 * page in left
    assert bytes(disk.PAGE) + page in left
    assert any(0 < len(content) % disk.PAGE for content in left)
    assert all(len(content) % disk.SECTOR == 0 for content in left)
