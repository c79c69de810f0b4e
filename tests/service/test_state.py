# SPDX-License-Identifier: Apache-2.0
"""The state directory: its loss is noticed before anything is stored in it, directories that cannot be written are reported,
and no temporary file outlives a kill."""
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess

import pytest

from service import Service, UnixConnection, gated_worker, sphere, wait_until

HEX = "0123456789abcdef"
BYTES = b"some bytes"


def small(seed=1, **parts):
    return sphere(50, solver={"seed": seed}, output={"preview": False}, **parts)


@pytest.fixture
def gated(new_service, tmp_path):
    """A service whose jobs end when their gate is opened. Its socket is not in the state directory, and its caller is an
    administrator."""
    return new_service("--worker", gated_worker(tmp_path), "--retry_s", 0.05, "--listen", f"unix:{tmp_path}/socket",
                       "--tcp_without_tokens", "").start()


def readiness(service):
    return service.get("/readyz")


def is_lost(service):
    reply = readiness(service)
    return reply.status == 503 and reply.json["code"] == "state_lost" and reply.json["checks"]["state"] == "lost"


def is_ready(service):
    reply = readiness(service)
    return reply.status == 200 and all(reply.json["checks"].get(name, "ok") == "ok" for name in ("state", "storage"))


def log_lines(service, text):
    return [line for line in service.log.read_text().splitlines() if text in line]


def figure(service, name):
    return float(re.search(rf"^{name} (\S+)$", service.get("/metrics").body.decode(), re.M)[1])


def upload(service, content=BYTES):
    return service.request("PUT", f"/v1/inputs/{hashlib.sha256(content).hexdigest()}", content)


def remove(service):
    shutil.rmtree(service.state)


def rename(service):
    service.state.rename(service.base / "elsewhere")


def replace(service):
    rename(service)
    shutil.copytree(service.base / "elsewhere", service.state, ignore=shutil.ignore_patterns("*.sock"))


def replace_database(service):
    shutil.copy(service.state / "queue.db", service.state / "copy")
    (service.state / "copy").rename(service.state / "queue.db")


def remove_lock(service):
    (service.state / "lock").unlink()


def remove_log(service):
    (service.state / "queue.db-wal").unlink()


def mount_over(service):
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", service.state], stderr=subprocess.PIPE, text=True)
    if done.returncode:
        pytest.skip(f"no file system can be mounted: {done.stderr.strip()}")


LOSSES = [remove, rename, replace, replace_database, remove_lock, remove_log, mount_over]


@pytest.mark.sanitized
@pytest.mark.parametrize("lose", LOSSES, ids=lambda f: f.__name__)
def test_nothing_is_accepted_into_a_lost_state_directory(gated, lose):
    """The first request after the loss is refused: nothing has to look at the directory in between."""
    service = gated
    assert is_ready(service)
    assert upload(service).status == 201
    job = service.submit(small(1, queue={"labels": ["kept"]}))
    service.wait_worker(job)
    lose(service)
    try:
        refused = service.post("/v1/jobs", small(2))
        assert refused.status == 503 and refused.json["code"] == "state_lost", refused.body
        assert str(service.state) in refused.json["detail"] and "doc/operations.md" in refused.json["detail"]
        other = hashlib.sha256(b"other").hexdigest()
        for method, path, body in (("PUT", f"/v1/inputs/{other}", b"other"),
                                   ("DELETE", f"/v1/inputs/{hashlib.sha256(BYTES).hexdigest()}", None),
                                   ("POST", f"/v1/jobs/{job}/cancel", None), ("POST", f"/v1/jobs/{job}/pause", None),
                                   ("DELETE", f"/v1/jobs/{job}", None), ("POST", "/v1/admin/hold", None),
                                   ("GET", "/v1/backup", None)):
            reply = service.request(method, path, body)
            assert reply.status == 503 and reply.json["code"] == "state_lost", (method, path, reply.body)
        assert is_lost(service) and figure(service, "hexad_state_lost") == 1
        assert service.get("/healthz").status == 200 and service.job(job)["labels"] == ["kept"]
        said = log_lines(service, " error ")
        assert len([line for line in said if "state directory" in line]) == 1, said
    finally:
        if lose is mount_over:
            subprocess.run(["umount", service.state], check=True)


@pytest.mark.sanitized
def test_a_state_directory_that_returns_is_used_again(gated):
    """A job that ended meanwhile gets its result, one whose worker failed meanwhile is tried again, and nothing is lost."""
    service = gated
    succeeds, fails = [service.submit(small(seed)) for seed in (1, 2)]
    pids = {job: service.wait_worker(job) for job in (succeeds, fails)}
    waits = service.submit(small(3))
    for job in (succeeds, fails):
        wait_until(lambda: service.job(job)["progress"], "a worker at its gate")
    rename(service)
    wait_until(lambda: is_lost(service), "word of the loss")
    os.kill(pids[fails], signal.SIGKILL)
    service.open_gate(succeeds)
    for job in (succeeds, fails):
        wait_until(lambda: any(job in line for line in log_lines(service, "attempt not settled")), "a try to settle")
    (service.base / "elsewhere").rename(service.state)
    wait_until(lambda: is_ready(service), "readiness")
    for job in (fails, waits):
        service.open_gate(job)
    for job in (succeeds, fails, waits):
        service.wait_state(job, "succeeded")
    assert service.post("/v1/jobs", small(4)).status == 201
    assert len(log_lines(service, "the state directory is at its path again")) == 1


def test_an_idle_service_logs_the_loss_by_itself(new_service):
    service = new_service().start()
    rename(service)
    wait_until(lambda: log_lines(service, "state directory"), "a line in the log")


def test_nothing_makes_a_new_directory_at_the_path(new_service):
    """The lost one could not be moved back then."""
    service = new_service().start()
    job = service.submit(small())
    service.wait_state(job, "succeeded")
    rename(service)
    for method, path, body in (("POST", "/v1/jobs:validate", sphere(70)), ("GET", f"/v1/jobs/{job}/results", None),
                               ("GET", f"/v1/jobs/{job}/thumbnail.png", None), ("GET", f"/v1/jobs/{job}/log", None),
                               ("POST", f"/v1/jobs/{job}/retry", None)):
        service.request(method, path, body and json.dumps(body), {"Content-Type": "application/json"})
        assert not service.state.exists(), (method, path)


@pytest.mark.sanitized
def test_a_second_service_on_the_same_path_stays_alone(new_service, build):
    """The first one notices it, stores nothing, and removes neither the log nor the socket of the second one at its end."""
    first = new_service("--listen", "unix:", "--tcp_without_tokens", "").start()
    address = UnixConnection(first.address.removeprefix("unix:"))
    address.connect()  # from now on, the path leads to the second one
    remove(first)
    second = Service(build, first.base, *first.options)
    second.port_file = first.base / "port.second"
    second.state, second.starts = first.state, 10
    try:
        second.start()
        job = second.submit(small())
        second.wait_state(job, "succeeded")
        assert upload(second).status == 201
        assert is_ready(second)
        address.request("POST", "/v1/jobs", json.dumps(small(5)), {"Content-Type": "application/json"})
        reply = address.getresponse()
        assert reply.status == 503 and json.loads(reply.read())["code"] == "state_lost"
        address.close()
        assert first.end() == 0, first.log.read_text()
        assert is_ready(second) and (second.state / "queue.db-wal").exists() and (second.state / "hexad.sock").exists()
        assert second.post("/v1/jobs", small(6)).status == 201
        assert second.get(f"/v1/jobs/{job}/results/points.ply").status == 200
        assert second.get(f"/v1/inputs/{hashlib.sha256(BYTES).hexdigest()}").status == 200
        second.end(signal.SIGKILL)
        second.start()
        assert second.job(job)["state"] == "succeeded"
    finally:
        second.clean_up()


@pytest.mark.sanitized
@pytest.mark.parametrize("part", ["attempts", "results", "inputs"])
def test_readiness_says_that_a_directory_cannot_be_written(new_service, part):
    """Also to root, whom no permissions stop. Jobs wait meanwhile, none fails."""
    service = new_service("--max_attempts", 1).start()
    assert is_ready(service)
    away = service.base / "away"
    (service.state / part).rename(away)
    (service.state / part).write_text("not a directory")
    if part == "inputs":
        assert upload(service).status == 500
    else:
        job = service.submit(small())
    reply = wait_until(lambda: (r := readiness(service)).status == 503 and r, "word of it")
    assert reply.json["code"] == "unavailable" and reply.json["checks"]["storage"] == "unwritable", reply.body
    assert f"{service.state}/{part}" in reply.json["detail"] and "Not a directory" in reply.json["detail"]
    assert figure(service, "hexad_storage_writable") == 0
    (service.state / part).unlink()
    away.rename(service.state / part)
    if part == "inputs":
        assert upload(service).status == 201
    else:
        service.wait_state(job, "succeeded")
    wait_until(lambda: is_ready(service), "readiness")
    assert figure(service, "hexad_storage_writable") == 1
    assert len(log_lines(service, f"cannot write to {service.state}/{part}")) == 1
    assert not [p for p in (service.state / part).iterdir() if p.name.startswith(".")]


# Files that a kill leaves in the state directory: each module that writes a file under a temporary name, at the moment before
# the rename. {} is the directory of a result.
LEFT = ["instance.0123456789abcdef", "session.key.0123456789abcdef", "reserve.new", "copies/3.db", "estimates/0/estimate.json",
        "inputs/sha256:" + 64 * "a" + ".0123456789abcdef", "attempts/.probe", "results/.probe", "inputs/.probe",
        "{}/.listing.json.0123456789abcdef", "{}/report.json.0123456789abcdef"]


@pytest.mark.sanitized
def test_no_temporary_file_outlives_a_kill_and_a_start(new_service):
    service = new_service().start()
    job = service.submit(small())
    service.wait_state(job, "succeeded")
    assert service.get(f"/v1/jobs/{job}/results").status == 200
    service.end(signal.SIGKILL)
    left = [service.state / name.format(f"results/{job}") for name in LEFT]
    left.append(service.port_file.with_name("port.0123456789abcdef"))
    for path in left:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("half")
    before = {p.name for p in (service.state / "results" / job).iterdir()}
    service.start()
    wait_until(lambda: not [p for p in left if p.exists()], "the removal of all temporary files")
    after = {p.name for p in (service.state / "results" / job).iterdir()}
    assert before - after == {".listing.json.0123456789abcdef", "report.json.0123456789abcdef"}
    assert not (service.state / "lost+found").exists()


def settings_check(service):
    return subprocess.run([service.build / "hexad", "--check-settings", "--state_dir", service.state, *service.options],
                          capture_output=True, text=True)


@pytest.mark.parametrize("mode, group, warned", [(0o700, 0, False), (0o755, 1, False), (0o770, 0, False), (0o770, 1, True),
                                                 (0o777, 0, True), (0o1777, 0, True)])
def test_a_state_directory_that_others_can_write_is_warned_of(new_service, mode, group, warned):
    """A group counts unless it is the service's own."""
    service = new_service()
    service.state.mkdir()
    try:
        os.chown(service.state, -1, group if group else os.getegid())
    except PermissionError:
        pytest.skip("only root can give a directory to another group")
    service.state.chmod(mode)
    done = settings_check(service)
    assert done.returncode == 0 and ("hexad: warning: state_dir: " in done.stderr) == warned, done.stderr
    service.start()
    said = log_lines(service, "state_dir: ")
    assert bool(said) == warned, service.log.read_text()
    assert all(" warn" in line and f"chmod go-w {service.state}" in line for line in said)
