# SPDX-License-Identifier: Apache-2.0
"""A damaged database is noticed and told, nothing more is written to it, and a backup brings all jobs back."""
import os
import pathlib
import random
import shutil
import sqlite3
import subprocess
import threading

import pytest

from accounts import new_token
from service import PATIENCE_S, Service, gated_worker, sphere, wait_until

PAGE = 4096  # bytes, SQLite's default
JOBS = 60
SEEDS = [int(s) for s in os.environ.get("HEXAD_DAMAGE_SEEDS", "1 2 3 4").split()]
SEEDS[2:] = [pytest.param(seed, marks=pytest.mark.extended) for seed in SEEDS[2:]]


def on_socket(service):
    """On a Unix socket, where who runs the tests is an administrator."""
    for word in ("--listen", "--tcp_without_tokens"):
        at = service.options.index(word)
        del service.options[at:at + 2]
    return service


@pytest.fixture
def service(new_service):
    return on_socket(new_service()).start()


@pytest.fixture(scope="module")
def filled(build, tmp_path_factory):
    """A state directory with paused jobs, of which nothing runs, so that a start changes nothing in it; and their ids."""
    service = on_socket(Service(build, tmp_path_factory.mktemp("filled"))).start()
    try:
        service.wait_state(service.submit(sphere()), "succeeded")
        assert service.post("/v1/admin/hold").status == 200
        jobs = []
        for i in range(JOBS):
            job = service.submit(sphere(count=1000 + i, queue={"labels": [f"label {i} " + "x" * 40]}))
            service.post(f"/v1/jobs/{job}/pause")
            jobs.append(job)
        assert service.post("/v1/admin/release").status == 200
    finally:
        service.end()
    return service.state, jobs


@pytest.fixture
def place(new_service, filled):
    """A service that has not been started, in a copy of that directory."""
    def make(*options):
        service = on_socket(new_service(*options))
        shutil.copytree(filled[0], service.state)
        (service.state / "lock").unlink()
        return service
    return make


def overwrite(database, page, seed):
    """Random bytes in the place of a page, counted from 1."""
    with open(database, "r+b") as file:
        file.seek((page - 1) * PAGE)
        file.write(random.Random(seed).randbytes(PAGE))


def pages(database):
    return database.stat().st_size // PAGE


def refusal(service):
    """What a start says that fails; it is one line, and the exit status that of a failure."""
    service.log = service.base / "log.refused"
    with open(service.log, "wb") as log:
        done = subprocess.run([service.build / "hexad", "--state_dir", service.state, "--port_file", service.port_file,
                               *service.options], stderr=log, stdin=subprocess.DEVNULL, timeout=PATIENCE_S)
    lines = [line for line in service.log.read_text().splitlines() if " error " in line]
    assert done.returncode == 1, service.log.read_text()
    assert len(lines) == 1, lines
    return lines[0]


def says_the_way_out(line):
    return "queue.db" in line and "damaged" in line and "last backup" in line and "doc/operations.md" in line


def readiness(service):
    return service.get("/readyz")


def await_damage(service):
    """The problem that /readyz tells once damage was found."""
    reply = wait_until(lambda: (r := readiness(service)).status == 503 and r, "word of the damage")
    assert reply.headers["Content-Type"] == "application/problem+json"
    problem = reply.json
    assert problem["code"] == "database_damaged" and "last backup" in problem["detail"]
    assert problem["checks"]["database"] == "damaged"
    return problem


def figure(service, name):
    text = service.get("/metrics").body.decode()
    return float(next(line for line in text.splitlines() if line.startswith(name + " ")).split()[1])


def check_refuses(service, job):
    """Nothing is written any more, and who asks for it is told why; what can be read is read."""
    for method, path, body in (("POST", "/v1/jobs", sphere()), ("POST", f"/v1/jobs/{job}/resume", None),
                               ("DELETE", f"/v1/jobs/{job}", None)):
        reply = service.post(path, body) if method == "POST" else service.request(method, path)
        assert reply.status == 503, (method, path, reply.body)
        assert reply.json["code"] == "database_damaged" and "last backup" in reply.json["detail"]
    assert figure(service, "hexad_database_damaged") == 1
    assert service.get("/healthz").status == 200
    assert sum("the database is damaged" in line for line in service.log.read_text().splitlines()) == 1


def expect_all(service, jobs):
    for job in jobs:
        assert service.job(job)["id"] == job


# ---- damage that is there at the start

@pytest.mark.sanitized
@pytest.mark.parametrize("seed", SEEDS)
def test_a_page_overwritten_before_the_start(place, filled, seed):
    """The start refuses it in a clear line, or serves until the quick check finds it."""
    service = place()
    database = service.state / "queue.db"
    page = random.Random(seed).randrange(2, pages(database) + 1)
    overwrite(database, page, seed)
    try:
        service.start()
    except AssertionError:
        assert service.process.returncode == 1
        assert any(says_the_way_out(line) for line in service.log.read_text().splitlines())
        return
    await_damage(service)
    check_refuses(service, filled[1][0])
    assert service.end() == 0


@pytest.mark.parametrize("what", ["magic", "page size", "zeros"])
def test_a_damaged_header_is_refused(place, what):
    service = place()
    with open(service.state / "queue.db", "r+b") as file:
        if what == "page size":
            file.seek(16)
        file.write({"magic": b"no database here", "page size": b"\x12\x34", "zeros": bytes(PAGE)}[what])
    assert says_the_way_out(refusal(service))


@pytest.mark.parametrize("left", ["half", "a part of a page", "a page", "ten bytes"])
def test_a_truncated_database_is_refused(place, left):
    service = place()
    database = service.state / "queue.db"
    size = database.stat().st_size
    os.truncate(database, {"half": size // 2 // PAGE * PAGE, "a part of a page": size - 100, "a page": PAGE,
                           "ten bytes": 10}[left])
    assert says_the_way_out(refusal(service))


@pytest.mark.sanitized
@pytest.mark.parametrize("statement, named", [
    ("DROP TABLE label", "table label"),
    ("DROP INDEX event_by_job", "index event_by_job"),
    ("ALTER TABLE job DROP COLUMN trace", "trace"),
    ("DROP INDEX job_expiring; CREATE INDEX job_expiring ON job (seq)", "index job_expiring"),
    ("PRAGMA user_version = 0", "database"),
])
def test_a_schema_that_is_not_whole_is_refused(place, statement, named):
    service = place()
    connection = sqlite3.connect(service.state / "queue.db")
    connection.executescript(statement)
    connection.close()
    line = refusal(service)
    assert says_the_way_out(line) and named in line, line


# ---- damage that comes while it runs

@pytest.mark.parametrize("seed", SEEDS)
def test_a_page_overwritten_while_it_runs(place, filled, seed):
    service = place("--check_interval_s", 1)
    service.start()
    wait_until(lambda: readiness(service).json["checks"]["database"] == "ok" and
               figure(service, "hexad_database_last_check_timestamp_seconds"), "the quick check")
    assert readiness(service).status == 200 and figure(service, "hexad_database_damaged") == 0
    database = service.state / "queue.db"
    page = random.Random(seed).randrange(2, pages(database) + 1)
    overwrite(database, page, seed)
    await_damage(service)
    check_refuses(service, filled[1][0])
    assert service.end() == 0


def test_the_header_overwritten_while_it_runs(place, filled):
    service = place("--check_interval_s", 1)
    service.start()
    overwrite(service.state / "queue.db", 1, 1)
    await_damage(service)
    check_refuses(service, filled[1][0])
    assert service.end() == 0
    assert says_the_way_out(refusal(service))


@pytest.mark.sanitized
def test_what_runs_is_settled_from_its_result(new_service, tmp_path):
    """An attempt that ends on a damaged database keeps its result, and the stop does not wait for it."""
    service = on_socket(new_service("--check_interval_s", 1, "--worker", gated_worker(tmp_path), "--workers", 1)).start()
    job = service.submit(sphere())
    service.wait_worker(job)
    backup = service.base / "backup.db"
    assert tool(service, "--backup", backup).returncode == 0
    for page in range(1, pages(service.state / "queue.db") + 1):
        overwrite(service.state / "queue.db", page, page)
    # what is in the write-ahead log is read from there; without it nothing is left that can be read
    os.truncate(service.state / "queue.db-wal", 0)
    await_damage(service)
    service.open_gate(job)
    assert service.end() == 0
    restore(service, backup)
    service.start()
    service.wait_state(job, "succeeded")


# ---- backups

def tool(service, *words):
    """hexad with the service's own options, for what is done once."""
    return subprocess.run([service.build / "hexad", "--state_dir", service.state, "--port_file", service.port_file,
                           *service.options, *map(str, words)], capture_output=True, text=True, timeout=PATIENCE_S)


def restore(service, backup):
    """As doc/operations.md says: the old files away, all of them, and the backup in their place."""
    aside = service.state / "damaged"
    aside.mkdir()
    for file in service.state.glob("queue.db*"):
        file.rename(aside / file.name)
    shutil.copy(backup, service.state / "queue.db")


def jobs_in(backup):
    """Of a whole backup, looked at by SQLite's own means."""
    connection = sqlite3.connect(f"file:{backup}?mode=ro&immutable=1", uri=True)
    assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
    found = {row[0] for row in connection.execute("SELECT id FROM job")}
    connection.close()
    return found


def left_beside(backup):
    return {p.name for p in backup.parent.iterdir() if p.name.startswith(("backup", ".backup"))} - {backup.name}


def test_a_backup_of_a_service_that_stands_still(place, filled, tmp_path):
    service = place()
    backup = tmp_path / "backup.db"
    before = {p.name: p.read_bytes() for p in service.state.glob("queue.db*")}
    done = tool(service, "--backup", backup)
    assert done.returncode == 0, done.stderr
    assert set(filled[1]) <= jobs_in(backup)
    assert backup.stat().st_mode & 0o777 == 0o600
    assert not left_beside(backup)
    assert {p.name: p.read_bytes() for p in service.state.glob("queue.db*")} == before


def test_a_backup_of_a_service_that_was_killed(service, tmp_path):
    """What stands in the write-ahead log only is in the backup, and nothing is changed by making it."""
    jobs = [service.submit(sphere(count=100 + i)) for i in range(5)]
    service.process.kill()
    service.process.wait()
    before = {p.name: p.read_bytes() for p in service.state.glob("queue.db*")}
    assert len(before["queue.db-wal"]) > 0
    backup = tmp_path / "backup.db"
    assert tool(service, "--backup", backup).returncode == 0
    assert set(jobs) <= jobs_in(backup)
    assert {p.name: p.read_bytes() for p in service.state.glob("queue.db*")} == before


def test_no_backup_is_taken_of_another_service(new_service, tmp_path, monkeypatch):
    """HEXAD_SERVER names one service, the settings another."""
    own, other = on_socket(new_service()).start(), on_socket(new_service()).start()
    monkeypatch.setenv("HEXAD_SERVER", f"unix:{other.state}/hexad.sock")
    backup = tmp_path / "backup.db"
    done = tool(own, "--backup", backup)
    assert done.returncode == 1 and "belongs to instance" in done.stderr and "unset HEXAD_SERVER" in done.stderr
    assert not backup.exists()


@pytest.mark.parametrize("jobs", [60, pytest.param(300, marks=pytest.mark.extended)])
def test_backups_while_many_submit(new_service, tmp_path, jobs):
    """Each is whole and has every job that was acknowledged before it was asked for."""
    service = on_socket(new_service("--worker", gated_worker(tmp_path), "--workers", 1)).start()
    acknowledged, enough = [], threading.Event()

    def submit():
        while not enough.is_set():
            acknowledged.append(service.submit(sphere()))

    clients = [threading.Thread(target=submit) for _ in range(8)]
    for client in clients:
        client.start()
    try:
        for i in range(3):
            wait_until(lambda: len(acknowledged) > jobs * (i + 1), "submissions")
            known = set(acknowledged)
            done = tool(service, "--backup", tmp_path / "backup.db")
            assert done.returncode == 0, done.stderr
            assert known <= jobs_in(tmp_path / "backup.db")
    finally:
        enough.set()
        for client in clients:
            client.join()
    assert not list((service.state / "copies").iterdir())


def test_a_backup_brings_all_jobs_back(place, filled, tmp_path):
    service = place().start()
    backup = tmp_path / "backup.db"
    assert tool(service, "--backup", backup).returncode == 0
    assert service.end() == 0
    for page in range(1, pages(service.state / "queue.db") + 1):
        overwrite(service.state / "queue.db", page, page)
    assert says_the_way_out(refusal(service))
    restore(service, backup)
    service.start()
    expect_all(service, filled[1])
    wait_until(lambda: readiness(service).json["checks"]["database"] == "ok", "the quick check")


@pytest.mark.parametrize("words", [["--check"], ["--backup", "backup.db"]])
def test_a_state_directory_that_does_not_exist_is_named_with_the_options(build, tmp_path, words):
    done = subprocess.run([build / "hexad", "--state_dir", tmp_path / "none", *words], capture_output=True, text=True,
                          timeout=PATIENCE_S, cwd=tmp_path)
    assert done.returncode == 1 and not list(tmp_path.iterdir())
    for part in (f"the state directory {tmp_path}/none", "--config FILE", "--state_dir DIRECTORY"):
        assert part in done.stderr, done.stderr


def test_a_backup_asks_for_the_settings_of_a_daemon_at_another_address(new_service, build, tmp_path):
    service = new_service().start()  # at a port that only its own options name
    done = subprocess.run([build / "hexad", "--state_dir", service.state, "--listen", f"unix:{tmp_path}/none",
                           "--backup", tmp_path / "backup.db"], capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 1 and not (tmp_path / "backup.db").exists()
    assert "--config FILE" in done.stderr and "HEXAD_SERVER" in done.stderr and "--server" not in done.stderr, done.stderr


@pytest.mark.parametrize("runs", [True, False])
def test_a_backup_that_fails_leaves_the_one_before(place, tmp_path, runs):
    """Of a damaged database no backup is made over a good one."""
    service = place()
    backup = tmp_path / "backup.db"
    assert tool(service, "--backup", backup).returncode == 0
    good = backup.read_bytes()
    if runs:
        service.start()
    for page in range(2, pages(service.state / "queue.db") + 1):
        overwrite(service.state / "queue.db", page, page)
    done = tool(service, "--backup", backup)
    assert done.returncode == 1 and "damaged" in done.stderr, done.stderr
    assert backup.read_bytes() == good
    assert not left_beside(backup)


@pytest.mark.parametrize("words, status, said", [
    (["--backup", "{tmp}/none/backup.db"], 1, "none"),
    (["--backup", "{tmp}"], 1, "is not a regular file"),
    (["--backup", ""], 2, "--backup"),
    (["--backup"], 2, "--backup"),
])
def test_a_backup_that_cannot_be_written(place, tmp_path, words, status, said):
    done = tool(place(), *(w.format(tmp=tmp_path) for w in words))
    assert done.returncode == status and said in done.stderr, done.stderr


@pytest.mark.sanitized
def test_a_backup_without_a_database(build, tmp_path):
    done = subprocess.run([build / "hexad", "--state_dir", tmp_path / "none", "--backup", tmp_path / "backup.db"],
                          capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 1 and "none" in done.stderr
    assert not (tmp_path / "backup.db").exists() and not (tmp_path / "none").exists()


@pytest.mark.sanitized
def test_only_administrators_are_given_a_backup(closed_service, tmp_path, monkeypatch):
    backup = tmp_path / "backup.db"
    monkeypatch.setenv("HEXAD_TOKEN", new_token(closed_service, "carol"))
    done = tool(closed_service, "--backup", backup)
    assert done.returncode == 1 and "scope admin" in done.stderr and not backup.exists()
    monkeypatch.delenv("HEXAD_TOKEN")
    done = tool(closed_service, "--backup", backup)
    assert done.returncode == 1 and "HEXAD_TOKEN" in done.stderr and not backup.exists()
    monkeypatch.setenv("HEXAD_TOKEN", closed_service.token)
    done = tool(closed_service, "--backup", backup)
    assert done.returncode == 0 and jobs_in(backup) == set(), done.stderr


# ---- --check

@pytest.mark.sanitized
def test_a_sound_service_is_sound(service):
    job = service.submit(sphere())
    service.wait_state(job, "succeeded")
    for runs in (True, False):
        if not runs:
            assert service.end() == 0
        done = tool(service, "--check")
        assert done.returncode == 0, done.stdout + done.stderr
        assert "no faults in the database" in done.stdout.splitlines()[-1]


@pytest.mark.parametrize("runs", [True, False])
def test_damage_is_found_on_demand(place, runs):
    service = place("--check_interval_s", 0)
    if runs:
        service.start()
        wait_until(lambda: figure(service, "hexad_database_last_check_timestamp_seconds"), "the quick check")
    database = service.state / "queue.db"
    before = pathlib.Path(shutil.copy(database, service.base / "before")).stat().st_size
    overwrite(database, before // PAGE // 2, 5)
    content = database.read_bytes()
    done = tool(service, "--check")
    assert done.returncode == 1, done.stdout + done.stderr
    assert "damaged" in done.stdout and "faults found" in done.stdout.splitlines()[-1]
    assert database.read_bytes() == content


@pytest.mark.sanitized
@pytest.mark.parametrize("bytes_left", [-100, 0, pytest.param(PAGE, marks=pytest.mark.extended),
                                        pytest.param(10, marks=pytest.mark.extended)])
def test_a_truncated_database_is_found_on_demand(place, tmp_path, bytes_left):
    service = place()
    database = service.state / "queue.db"
    os.truncate(database, bytes_left if bytes_left >= 0 else database.stat().st_size + bytes_left)
    done = tool(service, "--check")
    found, told = done.stdout.splitlines()
    assert done.returncode == 1 and found.startswith("database damaged: ") and told.startswith("1 fault found;")
    assert tool(service, "--backup", tmp_path / "backup.db").returncode == 1
    assert not (tmp_path / "backup.db").exists()


@pytest.mark.sanitized
def test_results_that_are_missing_or_unknown(service):
    jobs = [service.submit(sphere(count=200 + i)) for i in range(4)]
    for job in jobs:
        service.wait_state(job, "succeeded")
    assert service.end() == 0
    results = service.state / "results"
    shutil.rmtree(results / jobs[0])
    (results / jobs[1] / "report.json").write_text("{")
    os.truncate(results / jobs[2] / "points.ply", 10)
    stranger = "01arypyb610000000000000000"
    shutil.copytree(results / jobs[3], results / stranger)
    done = tool(service, "--check")
    assert done.returncode == 1
    for job in [*jobs[:3], stranger]:
        assert sum(job in line for line in done.stdout.splitlines()) == 1, done.stdout
    assert jobs[3] not in done.stdout
    assert "4" in done.stdout.splitlines()[-1]
