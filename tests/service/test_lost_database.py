# SPDX-License-Identifier: Apache-2.0
"""A queue.db that is lost, empty, older or another's, and what stands in the state directory and nobody knows: nothing is
deleted that was not asked for, and nothing that was delivered is lost."""
import functools
import hashlib
import http.client
import os
import pathlib
import shutil
import signal
import sqlite3
import subprocess
import sys

import pytest

from service import PATIENCE_S, Service, gated_worker, sphere, wait_until

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "crash"))
import calls  # noqa: E402


def some(seed, **parts):
    """A spec of a job that is not given another's result."""
    return sphere(count=60, solver={"seed": seed}, output={"preview": False}, **parts)


def finished(service, count=3, first=1, **parts):
    """Submits so many jobs and waits for their ends."""
    jobs = [service.submit(some(first + k, **parts)) for k in range(count)]
    for job in jobs:
        service.wait_state(job, "succeeded")
    return jobs


def tree(where):
    """path -> content of all files below, links as what they are."""
    found = {}
    for path in sorted(pathlib.Path(where).rglob("*")):
        name = str(path.relative_to(where))
        if path.name == ".listing.json":  # made when somebody asks
            continue
        if path.is_symlink():
            found[name] = f"-> {os.readlink(path)}"
        elif path.is_file():
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def served(service, job, query=""):
    """name -> hash of the files of a result, each fetched and held against its listing."""
    listing = service.get(f"/v1/jobs/{job}/results{query}")
    assert listing.status == 200, listing.body
    found = {}
    for item in listing.json["results"]:
        reply = service.get(item["href"])
        assert reply.status == 200
        found[item["name"]] = hashlib.sha256(reply.body).hexdigest()
        assert found[item["name"]] == item["sha256"]
    assert {"points.ply", "report.json"} <= set(found)
    return found


def save(service, where):
    """A backup of the database of a service that has ended, however."""
    where.mkdir()
    for path in service.state.glob("queue.db*"):
        shutil.copy(path, where)


def put_back(service, where):
    lose(service)
    for path in where.iterdir():
        shutil.copy(path, service.state)


def lose(service):
    for path in service.state.glob("queue.db*"):
        path.unlink()


def refused(service, *more):
    """The words of a start that is refused: one line."""
    done = subprocess.run([service.build / "hexad", "--port_file", service.port_file, "--state_dir", service.state,
                           *service.options, *map(str, more)], capture_output=True, text=True, timeout=PATIENCE_S)
    lines = [line for line in done.stderr.splitlines() if " error " in line]
    assert done.returncode == 1 and len(lines) == 1, done.stderr
    return lines[0]


def logged(service, words):
    return [line for line in service.log.read_text().splitlines() if words in line]


def moved(service):
    """How many things the start says that it has put into lost+found; 0 without a word."""
    lines = logged(service, "were moved to")
    assert len(lines) <= 1
    if not lines:
        return 0
    assert " warning " in lines[0] and f"{service.state}/lost+found" in lines[0]
    return int(lines[0].partition("count=")[2].partition(":")[0])


@pytest.fixture(scope="module")
def templates(build, tmp_path_factory):
    """Returns a stopped service with the given number of succeeded jobs, and their ids; made once for each number."""
    @functools.cache
    def make(count):
        service = Service(build, tmp_path_factory.mktemp("template")).start()
        try:
            jobs = finished(service, count)
            service.end()
        finally:
            service.clean_up()
        return service, jobs
    return make


@pytest.fixture
def place(new_service, templates):
    """Makes stopped services with the given number of succeeded jobs, from a copy of one state directory."""
    def make(count):
        template, jobs = templates(count)
        service = new_service()
        service.log = service.base / "log"
        shutil.copytree(template.state, service.state)
        return service, jobs
    return make


@pytest.mark.sanitized
@pytest.mark.parametrize("how", ["removed", "removed after a kill", "empty"])
def test_a_lost_database_beside_results_is_refused(place, how):
    service, _ = place(1)
    if "kill" in how:
        service.start()
        service.end(signal.SIGKILL)
    before = tree(service.state / "results")
    assert len({name.partition("/")[0] for name in before}) == 1
    if how == "empty":
        for path in service.state.glob("queue.db*"):
            path.unlink() if path.suffix != ".db" else os.truncate(path, 0)
    else:
        lose(service)
    for _ in range(2):  # nor does a refusal make what the next start takes for a database
        words = refused(service)
        assert "queue.db" in words and str(service.state) in words
        assert "restore a backup" in words and "--adopt" in words
        assert tree(service.state / "results") == before
    assert not (service.state / "lost+found").exists()


def test_a_lost_database_without_results_is_made_anew(new_service):
    service = new_service().start()
    name = (service.state / "instance").read_text()
    service.end()
    lose(service)
    service.start()
    assert len(logged(service, "was missing or empty, so a new queue starts")) == 1
    assert (service.state / "instance").read_text() == name
    finished(service, 1)
    service.end()
    service.start()
    assert not logged(service, " warning ")


def test_an_older_database_puts_what_it_does_not_know_aside(place, tmp_path):
    service, (known,) = place(1)
    service.start()
    result = served(service, known)
    service.end()
    save(service, tmp_path / "backup")
    service.start()
    later = finished(service, 2, first=10)
    service.end()
    before = tree(service.state / "results")
    put_back(service, tmp_path / "backup")
    service.start()
    assert moved(service) == 2
    for job in later:
        assert service.get(f"/v1/jobs/{job}").status == 404
    assert served(service, known) == result
    found = tree(service.state / "lost+found" / "results")
    assert {**found, **tree(service.state / "results")} == before
    assert {name.partition("/")[0] for name in found} == set(later)
    service.end()
    service.start()  # and stays there without another word
    assert moved(service) == 0 and tree(service.state / "lost+found" / "results") == found
    # what an administrator moves back is moved aside again, and beside nothing that is there
    copy = service.state / "results" / later[0]
    shutil.copytree(service.state / "lost+found" / "results" / later[0], copy)
    service.end()
    service.start()
    assert moved(service) == 1
    assert tree(service.state / "lost+found" / "results" / f"{later[0]}~1") == \
        tree(service.state / "lost+found" / "results" / later[0])


def sequence(frames, **parts):
    return sphere(count=60, output={"preview": False}, queue={"frames": frames, "by_frame": {
        "/surface/analytic/radius": {"from": 1, "to": 2}}}, **parts)


def test_an_older_database_takes_the_results_of_jobs_that_wait(new_service, tmp_path):
    """In each state in which a job waits, when the backup is of a daemon that was killed."""
    worker = gated_worker(tmp_path)
    options = ("--worker", worker, "--retry_s", 3600, "--retry_most_s", 3600)
    service = new_service(*options, "--workers", 2).start()
    delayed, running = service.submit(some(1)), service.submit(some(2))
    os.kill(service.wait_worker(delayed), signal.SIGKILL)
    wait_until(lambda: service.job(delayed)["state"] == "queued", "the crash to be noticed")
    service.wait_worker(running)
    frames = service.submit(sequence("1-2"))
    service.wait_worker(frames)
    queued, paused = service.submit(some(5)), service.submit(some(3))
    blocked = service.submit(some(4, queue={"depends_on": [running]}))
    assert service.post(f"/v1/jobs/{paused}/pause").json["state"] == "paused"
    service.end(signal.SIGKILL)
    wait_until(lambda: not service.workers_of(frames), "the workers' end")
    save(service, tmp_path / "backup")
    jobs = {"delayed": delayed, "running": running, "paused": paused, "blocked": blocked, "frames": frames,
            "queued": queued}
    # goes on where nothing waits for its time, until all is delivered
    for gate in [*jobs.values(), *(f"{frames}.{k}" for k in (1, 2))]:
        service.open_gate(gate)
    service.options[service.options.index("--retry_s") + 1] = "0"
    service.start()
    assert service.post(f"/v1/jobs/{paused}/resume").status == 200
    with_result = [job for name, job in jobs.items() if name != "delayed"]
    for job in with_result:
        service.wait_state(job, "succeeded")
    service.end()
    with sqlite3.connect(service.state / "queue.db") as database:  # it has waited for an hour
        database.execute("UPDATE task SET not_before_ms = 1 WHERE state = 'delayed'")
    database.close()
    service.start()
    service.wait_state(delayed, "succeeded")
    queries = {job: [f"?frame={k}" for k in (1, 2)] if job == frames else [""] for job in jobs.values()}
    results = {job: [served(service, job, query) for query in queries[job]] for job in jobs.values()}
    before = tree(service.state / "results")
    attempts = {job: service.job(job)["attempt"] for job in jobs.values()}
    service.end()
    put_back(service, tmp_path / "backup")
    log = service.state / "attempts" / f"{running}.1" / "worker.log"  # of the attempt that runs in the backup
    log.parent.mkdir(exist_ok=True)
    log.write_text("the first attempt")
    (tmp_path / "no-worker").write_text("#!/bin/sh\nexit 1\n")  # nothing is made again
    (tmp_path / "no-worker").chmod(0o700)
    service.options[service.options.index("--worker") + 1] = str(tmp_path / "no-worker")
    service.start()
    for name, job in jobs.items():
        now = service.job(job)  # before it serves
        assert now["state"] == "succeeded" and now["outcome"], (name, now, service.log.read_text())
        assert now["tasks"]["succeeded"] == now["tasks"]["all"]
        assert now["attempt"] <= attempts[job]
        assert [served(service, job, query) for query in queries[job]] == results[job]
    assert tree(service.state / "results") == before
    assert not (service.state / "lost+found" / "results").exists()
    assert log.read_text() == "the first attempt"
    service.end()
    with sqlite3.connect(service.state / "queue.db") as database:
        assert database.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert database.execute("SELECT count(*) FROM owner").fetchone() == (0,)
    database.close()


def test_an_older_database_does_not_give_numbers_twice(new_service, tmp_path):
    """Attempts that it has not heard of are out of the way when their numbers are given again."""
    service = new_service("--worker", gated_worker(tmp_path), "--workers", 1, "--retry_s", 0).start()
    job = service.submit(some(1))
    service.wait_worker(job)
    service.end(signal.SIGKILL)
    save(service, tmp_path / "backup")
    service.start()
    os.kill(service.wait_worker(job), signal.SIGKILL)
    third = service.state / "attempts" / f"{job}.3"
    wait_until(third.is_dir, "the third attempt")
    service.end(signal.SIGKILL)
    (third / "mark").write_text("of the third attempt")
    put_back(service, tmp_path / "backup")
    service.start()
    assert moved(service) == 1  # of the one that crashed without a word nothing is left
    assert (service.state / "lost+found" / "attempts" / f"{job}.3" / "mark").read_text()
    service.open_gate(job)
    assert service.wait_state(job, "succeeded")["attempt"] == 2
    assert not (service.state / "results" / job / "mark").exists()


@pytest.mark.sanitized
def test_a_result_that_is_none_of_a_job_that_waits(new_service, tmp_path):
    """Is put aside, and the job is run."""
    service = new_service("--worker", gated_worker(tmp_path), "--workers", 1).start()
    running, waiting = service.submit(some(1)), service.submit(some(2))
    service.wait_worker(running)
    service.end(signal.SIGKILL)
    for job in (running, waiting):
        (service.state / "results" / job).mkdir()
        (service.state / "results" / job / "kept.txt").write_text(job)
    service.start()
    for job in (running, waiting):
        service.open_gate(job)
        service.wait_state(job, "succeeded")
        assert (service.state / "lost+found" / "results" / job / "kept.txt").read_text() == job
        assert not (service.state / "results" / job / "kept.txt").exists()
    assert any(running in line for line in logged(service, "lost+found"))


def test_another_instances_database_is_refused(new_service):
    ours, theirs = new_service().start(), new_service().start()
    finished(ours, 2), finished(theirs, 1, first=10)
    ours.end(), theirs.end()
    names = [(service.state / "instance").read_text().strip() for service in (ours, theirs)]
    before = tree(ours.state / "results")
    lose(ours)
    shutil.copy(theirs.state / "queue.db", ours.state)
    words = refused(ours)
    assert all(name in words for name in names) and str(ours.state) in words and "--adopt" in words
    assert tree(ours.state / "results") == before and not (ours.state / "lost+found").exists()
    ours.start("--adopt")
    assert (ours.state / "instance").read_text().strip() == names[0]
    assert len(ours.get("/v1/jobs").json["jobs"]) == 3  # theirs, without a result, and what is here
    ours.end()
    ours.start()


def test_a_damaged_instance_file_is_refused(place):
    service, _ = place(1)
    before = tree(service.state / "results")
    for content in ("", "nonsense\n", "x" * 1000):
        (service.state / "instance").write_text(content)
        words = refused(service)
        assert f"{service.state}/instance" in words and "--adopt" in words
    service.start("--adopt")
    service.end()
    service.start()
    assert tree(service.state / "results") == before


ODD = ["a file", ".hidden", "new\nline", "\udcff\udcfe", "x" * 255, "0123456789abcdefghjkmnpqrs.01",
       "0123456789abcdefghjkmnpqrs.1.2.3", "zzzzzzzzzzzzzzzzzzzzzzzzzz", "0123456789abcdefghjkmnpqrs.4294967297"]


def test_foreign_things_are_put_aside(place):
    service, jobs = place(1)
    before = tree(service.state / "results")
    for part in ("results", "attempts"):
        for name in ODD:
            (service.state / part / name).write_text(f"{part} {name!r}")
        (service.state / part / "a directory" / "below").mkdir(parents=True)
        (service.state / part / "a directory" / "below" / "file").write_text(part)
        (service.state / part / "0123456789abcdefghjkmnpqrs.7").mkdir()
        os.mkfifo(service.state / part / "a pipe")
    there = len(ODD) + 3
    service.start()
    assert moved(service) == 2 * there
    for part in ("results", "attempts"):
        where = service.state / "lost+found" / part
        assert len(os.listdir(where)) == there
        for name in ODD:
            assert (where / name).read_text() == f"{part} {name!r}"
        assert (where / "a directory" / "below" / "file").read_text() == part
    assert tree(service.state / "results") == before
    assert served(service, jobs[0])


def test_adoption(new_service, tmp_path):
    """Nobody knows whose the jobs were: they are shown to administrators, which we are on our own socket."""
    service = new_service("--listen", f"unix:{tmp_path}/socket").start()
    jobs = finished(service, 3, name="the name", queue={"labels": ["a", "b"], "priority": 3, "retention_s": 10000})
    shown = {job: service.job(job) for job in jobs}
    frames = service.submit(sequence("1-2", name="frames"))
    service.wait_state(frames, "succeeded")
    results = {job: served(service, job) for job in jobs}
    frame_results = {k: served(service, frames, f"?frame={k}") for k in (1, 2)}
    service.end(signal.SIGKILL)
    lose(service)
    broken = [service.state / "results" / "0123456789abcdefghjkmnpqrs", service.state / "results" / f"{jobs[2]}.7",
              service.state / "results" / "0123456789abcdefghjkmnpqrt"]
    broken[0].mkdir()
    (broken[0] / "report.json").write_text('{"outcome": "converged"}')
    shutil.copytree(service.state / "results" / jobs[2], broken[1])  # no frame of a job that has none
    broken[2].symlink_to(service.state / "results" / jobs[0])
    before = tree(service.state / "results")
    service.start("--adopt")
    assert len(logged(service, "jobs adopted from their results count=4")) == 1
    assert moved(service) == 3
    for again in (False, True):
        listed = {job["id"]: job for job in service.get("/v1/jobs").json["jobs"]}
        assert set(listed) == {*jobs, frames}
        for job in jobs:
            now, then = service.job(job), shown[job]
            for key in ("name", "labels", "priority", "spec", "outcome", "state", "created", "threads", "links"):
                assert now[key] == then[key], key
            assert now["retention_s"] == 0 and not now["owner"] and now["attempts"] == []
            assert now["finished"] and now["finished"][:10] == then["finished"][:10]
            assert served(service, job) == results[job]
        now = service.job(frames)
        assert now["array"] and now["name"] == "frames" and now["tasks"]["succeeded"] == 2
        assert {k: served(service, frames, f"?frame={k}") for k in (1, 2)} == frame_results
        assert {job["id"] for job in service.get("/v1/jobs?label=a").json["jobs"]} == set(jobs)
        assert service.get(f"/v1/jobs/{jobs[0]}/log").status == 404
        assert {**tree(service.state / "lost+found" / "results"), **tree(service.state / "results")} == before
        service.end()
        service.start(*(["--adopt"] if not again else []))
        assert not logged(service, "adopted") and moved(service) == 0
    # they are jobs like others
    assert service.request("DELETE", f"/v1/jobs/{jobs[0]}").status == 204
    assert service.request("DELETE", f"/v1/jobs/{frames}").status == 204
    assert {path.name for path in (service.state / "results").iterdir()} == set(jobs[1:])
    finished(service, 1, first=100)


@pytest.mark.sanitized
def test_an_adoption_that_was_cut_short_goes_on(new_service, tmp_path):
    """Killed when the jobs are in the queue and the queue is not yet this directory's."""
    service = new_service("--listen", f"unix:{tmp_path}/socket").start()
    jobs = finished(service, 2)
    results = {job: served(service, job) for job in jobs}
    service.end()
    lose(service)
    (service.state / "instance").unlink()
    service.start("--adopt")
    service.end()
    (service.state / "instance").unlink()
    with sqlite3.connect(service.state / "queue.db") as database:  # as if its last step had not come
        database.execute("DELETE FROM instance")
    database.close()
    assert "--adopt" in refused(service)
    service.start("--adopt")
    service.end()
    service.start()
    assert {job: served(service, job) for job in jobs} == results
    assert len(service.get("/v1/jobs").json["jobs"]) == 2


def test_symbolic_links_are_not_followed(new_service, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path), "--workers", 1).start()
    running, waiting, unknown = service.submit(some(1)), service.submit(some(2)), "0123456789abcdefghjkmnpqrs"
    service.wait_worker(running)
    service.end(signal.SIGKILL)
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "file").write_text("precious")
    for part, name in (("results", unknown), ("results", running), ("results", waiting), ("attempts", f"{unknown}.1"),
                       ("attempts", f"{waiting}.1")):
        (service.state / part / name).symlink_to(outside)
    service.start()
    for job in (running, waiting):
        service.open_gate(job)
        service.wait_state(job, "succeeded")
        assert not (service.state / "results" / job).is_symlink()
    assert tree(outside) == {"file": hashlib.sha256(b"precious").hexdigest()}
    kept = tree(service.state / "lost+found")
    assert set(kept) == {f"results/{n}" for n in (unknown, running, waiting)} | \
        {f"attempts/{n}.1" for n in (unknown, waiting)}
    assert set(kept.values()) == {f"-> {outside}"}


def test_a_deleted_job_whose_result_is_a_link(place, tmp_path):
    service, (job,) = place(1)
    moved_to = tmp_path / "elsewhere"
    (service.state / "results" / job).rename(moved_to)
    (service.state / "results" / job).symlink_to(moved_to)
    before = tree(moved_to)
    service.start()
    assert served(service, job)
    assert service.request("DELETE", f"/v1/jobs/{job}").status == 204
    assert not (service.state / "results" / job).is_symlink()
    assert {name: tree(moved_to)[name] for name in before} == before


def test_results_is_a_link(place, tmp_path):
    """It is written to as ever, and nothing is taken out of a directory that may be anybody's."""
    service, (job,) = place(1)
    (service.state / "results").rename(tmp_path / "elsewhere")
    (service.state / "results").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere" / "letters").mkdir()
    (tmp_path / "elsewhere" / "letters" / "a.txt").write_text("dear")
    service.start()
    lines = logged(service, "without a job in the queue remain in")
    assert len(lines) == 1 and "count=1:" in lines[0] and "symbolic link" in lines[0]
    assert (tmp_path / "elsewhere" / "letters" / "a.txt").read_text() == "dear"
    assert served(service, job)
    finished(service, 1, first=10)
    service.end()
    lose(service)
    assert "--adopt" in refused(service)


def test_lost_and_found_cannot_be_made(place):
    """Something else has its name: all stays, and the start says so."""
    service, (job,) = place(1)
    (service.state / "lost+found").write_text("a file")
    (service.state / "results" / "unknown").mkdir()
    before = tree(service.state)
    service.start()
    lines = logged(service, "without a job in the queue remain in")
    assert len(lines) == 1 and " warning " in lines[0] and "lost+found" in lines[0]
    assert (service.state / "results" / "unknown").is_dir() and served(service, job)
    assert tree(service.state / "results") == {name.removeprefix("results/"): content for name, content in before.items()
                                               if name.startswith("results/")}


READ_ONLY = """
mount --bind "$1" "$1" && mount -o remount,bind,ro "$1" || exit 77
shift
exec "$@"
"""


def test_results_cannot_be_written(place, tmp_path):
    """A read-only mount: unknown results stay, what was to be removed is removed later, and nothing else."""
    service, (kept, deleted) = place(2)
    results = service.state / "results"
    (results / "unknown").mkdir()
    before = tree(results)
    under = ["unshare", "-m", "sh", "-c", READ_ONLY, "sh", str(results)]
    if not shutil.which("unshare") or subprocess.run([*under, "true"], capture_output=True).returncode:
        pytest.skip("mounting needs root")
    hexad, service.build = service.build / "hexad", tmp_path / "mounted"
    service.build.mkdir()
    (service.build / "hexad").write_text(f"#!/bin/sh\nexec {' '.join(f'{w!r}' for w in under[:4])} '{READ_ONLY}'"
                                         f" sh '{results}' '{hexad}' \"$@\"\n")
    (service.build / "hexad").chmod(0o700)
    service.start()
    lines = logged(service, "without a job in the queue remain in")
    assert len(lines) == 1 and " warning " in lines[0] and "lost+found" in lines[0]
    assert service.request("DELETE", f"/v1/jobs/{deleted}").status == 204
    assert service.get(f"/v1/jobs/{deleted}").status == 404
    assert tree(results) == before and served(service, kept)
    wait_until(lambda: logged(service, "cannot remove the files"), "the trouble to be said")
    service.end()
    service.build = hexad.parent
    service.start()
    wait_until(lambda: not (results / deleted).exists(), "the removal")
    assert moved(service) == 1 and served(service, kept)
    assert (service.state / "lost+found" / "results" / "unknown").is_dir()


@pytest.fixture
def supervision():
    missing = calls.why_not()
    if missing:
        pytest.skip(missing)


def test_a_kill_between_forgetting_and_removing(supervision, place):
    """At the first removal of a file of the result, which is not done."""
    service, (kept, deleted) = place(2)
    result = service.state / "results" / deleted
    stranger = service.state / "attempts" / f"{kept}.1"  # what a job has left and nobody asked to remove
    stranger.mkdir(exist_ok=True)
    (stranger / "worker.log").write_text("kept")
    killed = []

    def judge(call):
        if call.name in ("unlink", "unlinkat", "rmdir") and any((p or "").startswith(f"results/{deleted}") for p in call.paths):
            killed.append(call.paths)
            os.kill(call.supervisor.process.pid, signal.SIGKILL)
        return None
    before = tree(service.state / "results")
    port = service.port_file
    port.unlink(missing_ok=True)
    words = [service.build / "hexad", "--port_file", port, "--state_dir", service.state, *service.options]
    with open(service.log, "wb") as log, calls.Supervisor(service.state, judge, words, stderr=log,
                                                          stdin=subprocess.DEVNULL) as supervisor:
        service.process = supervisor.process
        wait_until(lambda: port.exists() or service.process.poll() is not None, "the daemon")
        service.address = port.read_text().strip()
        with pytest.raises((OSError, http.client.HTTPException)):
            service.request("DELETE", f"/v1/jobs/{deleted}")
        service.process.wait(PATIENCE_S)
    assert killed and not supervisor.failure
    assert tree(service.state / "results") == before
    with sqlite3.connect(service.state / "queue.db") as database:
        assert database.execute("SELECT id FROM removal").fetchall() == [(deleted,)]
    database.close()
    service.start()
    wait_until(lambda: not result.exists(), "the removal")
    assert moved(service) == 0 and served(service, kept)
    assert (stranger / "worker.log").read_text() == "kept"
    service.end()
    with sqlite3.connect(service.state / "queue.db") as database:
        assert database.execute("SELECT * FROM removal").fetchall() == []
    database.close()
