# SPDX-License-Identifier: Apache-2.0
"""What one user can do to others through the limits of the service."""
import contextlib
import hashlib
import json
import os
import shutil
import socket
import sqlite3
import subprocess
import threading

import pytest

from accounts import new_token, with_token
from service import PATIENCE_S, gated_worker, sphere, wait_until


def connect(service):
    host, _, port = service.address.rpartition(":")
    return socket.create_connection((host.strip("[]"), int(port)), timeout=PATIENCE_S)


def send_head(service, *lines):
    connection = connect(service)
    connection.sendall("".join(line + "\r\n" for line in (*lines, f"Host: {service.address}", "")).encode())
    return connection


def read_all(connection):
    answer = b""
    while more := connection.recv(65536):
        answer += more
    return answer


def read_until(connection, wanted):
    answer = b""
    while wanted not in answer:
        more = connection.recv(65536)
        assert more, answer
        answer += more


def test_a_stranger_is_refused_before_the_body(closed_service):
    """The answer comes, and the connection ends, though no byte of the body was sent."""
    for length in ("Content-Length: 100", "Transfer-Encoding: chunked"):
        connection = send_head(closed_service, "POST /v1/jobs HTTP/1.1", "Content-Type: application/json", length)
        answer = read_all(connection)
        assert answer.startswith(b"HTTP/1.1 401 "), answer
        assert b"\r\nconnection: close\r\n" in answer.lower()
        connection.close()


def test_bodies_of_strangers_that_do_not_come_shut_no_one_out(closed_service):
    """Signing in needs no token."""
    service = closed_service
    service.end()
    service.start("--client_connection_limit", 2)
    held = [send_head(service, "POST /v1/session HTTP/1.1", "Content-Type: application/json", "Content-Length: 100",
                      "Expect: 100-continue") for _ in range(2)]
    assert all(one.recv(25).startswith(b"HTTP/1.1 100 ") for one in held)  # the service waits for the bodies
    for _ in range(2):
        assert service.get("/healthz").status == 200
    for one in held:
        one.close()


def upload_head(token, name, length):
    return (f"PUT /v1/inputs/{name} HTTP/1.1", f"Authorization: Bearer {token}", f"Content-Length: {length}")


def test_idle_uploads_of_one_user_leave_room_for_others(closed_service):
    service = closed_service
    service.end()
    service.start("--upload_total_bytes", 4000, "--user_uploads", 2)
    tokens = {user: new_token(service, user, "--scopes", "submit,read") for user in ("ann", "bob")}

    def put(user, data):
        return service.request("PUT", f"/v1/inputs/{hashlib.sha256(data).hexdigest()}", data,
                               {"Authorization": f"Bearer {tokens[user]}"})

    idle = [send_head(service, *upload_head(tokens["ann"], hashlib.sha256(b"%d" % i).hexdigest(), 1000)) for i in range(2)]
    wait_until(lambda: put("ann", b"a").status == 429, "the uploads to begin")
    assert put("bob", b"b" * 1000).status == 201
    full = put("bob", b"c")  # a quarter of the total is the user's
    assert full.status == 507 and "user_upload_bytes" in full.json["detail"]
    for one in idle:
        one.close()
    wait_until(lambda: put("ann", b"a").status in (200, 201), "the end of the uploads")
    assert put("ann", b"d" * 999).status == 201


def test_a_state_counts_once(new_service):
    service = new_service("--workers", 1).start()
    jobs = {service.submit(sphere()) for _ in range(3)}
    for job in jobs:
        service.wait_state(job, "succeeded")
    listed = service.get("/v1/jobs?state=" + ",".join(["succeeded", "queued"] * 200)).json["jobs"]
    assert sorted(job["id"] for job in listed) == sorted(jobs)


def post_head(token, length):
    return ("POST /v1/jobs:validate HTTP/1.1", f"Authorization: Bearer {token}", "Content-Type: application/json",
            f"Content-Length: {length}")


def validate(service, token, body):
    return service.request("POST", "/v1/jobs:validate", body,
                           {"Authorization": f"Bearer {token}", "Content-Type": "application/json"})


def test_bodies_of_one_user_leave_memory_for_others(closed_service):
    """Bodies of which all but the end has come are held back; a body of another user has room."""
    service = closed_service
    service.end()
    service.start("--body_limit_bytes", 10000, "--user_body_bytes", 25000, "--body_total_bytes", 40000)
    tokens = {user: new_token(service, user, "--scopes", "read") for user in ("ann", "bob")}
    spec = json.dumps(sphere()).encode()

    def ask(user, body):
        return validate(service, tokens[user], body)

    held = []
    for _ in range(2):
        held.append(send_head(service, *post_head(tokens["ann"], 10000)))
        held[-1].sendall(b" " * 9999)
    wait_until(lambda: ask("ann", b" " * 6000 + spec).status == 429, "the bodies to arrive")
    assert ask("bob", b" " * 6000 + spec).status == 200
    held[0].close()
    wait_until(lambda: ask("ann", b" " * 6000 + spec).status == 200, "the room of a body that was given up")
    held[1].close()


def test_a_short_body_has_room_when_other_users_take_all_memory_for_bodies(closed_service):
    service = closed_service
    service.end()
    service.start("--body_limit_bytes", 30000, "--user_body_bytes", 40000, "--body_total_bytes", 40000)
    tokens = {user: new_token(service, user, "--scopes", "read") for user in ("ann", "bob")}
    spec = json.dumps(sphere()).encode()

    def ask(user, body):
        return validate(service, tokens[user], body)

    held = [send_head(service, *post_head(tokens["ann"], 30000))]
    held[0].sendall(b" " * 29999)
    wait_until(lambda: ask("ann", b" " * 15000 + spec).status == 429, "the long body to arrive")
    while ask("ann", spec).status != 429:
        held.append(send_head(service, *post_head(tokens["ann"], 1000)))
        held[-1].sendall(b" " * 50)
    refused = ask("bob", b" " * 20000 + spec)
    assert refused.status == 503 and "body_total_bytes" in refused.json["detail"]
    assert ask("bob", spec).status == 200
    for one in held:
        one.close()


FLUSHES = """#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>
static int is_held(int fd)
{
    const char *held = getenv("HEXAD_TEST_FLUSHED");
    char link[32], path[4096];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    path[length > 0 ? length : 0] = 0;
    const char *name = strrchr(path, '/');
    return name && strcmp(name + 1, held) == 0;
}
int fdatasync(int fd)
{
    while (is_held(fd) && access(getenv("HEXAD_TEST_GATE"), F_OK) != 0) {
        close(open(getenv("HEXAD_TEST_WAITS"), O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
        usleep(1000);
    }
    return (int)syscall(SYS_fdatasync, fd);
}
"""


class Disk:
    """One whose flushes of the file `flushed` end only while the gate is there."""

    def __init__(self, where, flushed):
        self.gate, self.waits, library, source = (where / name for name in ("gate", "waits", "flushes.so", "flushes.c"))
        source.write_text(FLUSHES)
        subprocess.run(["cc", "-shared", "-fPIC", "-o", library, source], check=True)
        self.environment = {**os.environ, "LD_PRELOAD": str(library), "HEXAD_TEST_GATE": str(self.gate), "HEXAD_TEST_WAITS": str(self.waits),
                            "HEXAD_TEST_FLUSHED": flushed}
        self.gate.touch()


@pytest.mark.skipif(not shutil.which("cc"), reason="no cc")
def test_while_a_change_is_flushed_all_reads_are_answered(new_service, tmp_path):
    """They show the state before the change, which is answered after its flush."""
    disk, answers = Disk(tmp_path, "queue.db-wal"), []
    service = new_service()
    service.clock = disk
    service.start()
    job = service.submit(sphere())
    disk.gate.unlink()
    submission = threading.Thread(target=lambda: answers.append(service.post("/v1/jobs", sphere()).status))
    submission.start()
    wait_until(disk.waits.exists, "a flush")
    try:
        for path in (f"/v1/jobs/{job}", f"/v1/jobs/{job}/tasks", "/v1/usage", "/v1/events?after=0", "/metrics", "/readyz", "/healthz"):
            assert service.get(path).status == 200, path
        assert service.request("GET", f"/v1/jobs/{job}", headers={"Prefer": "wait=0.001"}).status == 200
        stream = send_head(service, "GET /v1/events?after=0 HTTP/1.1", "Accept: text/event-stream")
        read_until(stream, job.encode())
        assert [one["id"] for one in service.get("/v1/jobs").json["jobs"]] == [job]
        assert not answers
    finally:
        disk.gate.touch()
    submission.join()
    assert answers == [201]
    assert len(service.get("/v1/jobs").json["jobs"]) == 2


@pytest.mark.skipif(not shutil.which("cc"), reason="no cc")
def test_while_the_log_is_written_back_changes_are_stored(new_service, tmp_path):
    """The log of the database becomes long by submissions; the flush of the database itself is held."""
    disk = Disk(tmp_path, "queue.db")
    service = new_service("--worker", gated_worker(tmp_path))
    service.clock = disk
    service.start()
    disk.gate.unlink()
    try:
        for _ in range(1000):
            service.submit(sphere())
            if disk.waits.exists():
                break
        assert disk.waits.exists()
        job = service.submit(sphere())
        assert service.job(job)["id"] == job
    finally:
        disk.gate.touch()


# The real worker, except that it makes no thumbnail before the gate is opened.
WAITING_READER = """#!/bin/sh
[ "$1" = read-picture ] && {{ echo x >>{where}/calls; while ! [ -e {where}/gate ]; do sleep 0.01; done; }}
exec {worker} "$@"
"""


def test_long_requests_of_a_user_hold_up_no_short_one(new_service, build, tmp_path):
    """Of three thumbnails two are made at once, and the third waits for them. Another request of the same user does not."""
    worker, calls = tmp_path / "waiting-reader", tmp_path / "calls"
    worker.write_text(WAITING_READER.format(where=tmp_path, worker=build / "hexad-worker"))
    worker.chmod(0o700)
    service = new_service("--worker", worker).start()
    job = service.submit(sphere(output={"preview": {"size": 64}}))
    service.wait_state(job, "succeeded")
    drawn = [send_head(service, f"GET /v1/jobs/{job}/thumbnail.png HTTP/1.1", "Connection: close") for _ in range(3)]
    try:
        wait_until(lambda: calls.exists() and calls.read_text().count("x") == 2, "two thumbnails")
        for _ in range(5):
            assert service.get("/v1/usage").status == 200
        assert calls.read_text().count("x") == 2
    finally:
        (tmp_path / "gate").touch()
    for one in drawn:
        assert read_all(one).startswith(b"HTTP/1.1 200 ")


def job_with_long_document(service, token):
    """The path of a job whose document has 0.3 MB."""
    spec = sphere()
    spec["surface"] = {"union": [sphere()["surface"]] * 10}
    frames = 4000
    spec["queue"] = {"frames": f"1-{frames}", "by_frame": {
        f"/surface/union/{i}/analytic/radius": [round(1 + k / frames, 5) for k in range(frames)] for i in range(10)}}
    made = with_token(service, token, "POST", "/v1/jobs", spec)
    assert made.status == 201, made.body
    return f"/v1/jobs/{made.json['id']}"


def test_answers_that_a_user_does_not_read_take_bounded_memory(new_service, tmp_path):
    """Another user gets answers all the same, and so does the first one when the connections are closed. On a Unix socket, since
    the kernel keeps little of what is sent there."""
    service = new_service("--listen", f"unix:{tmp_path / 'socket'}", "--user_answer_bytes", 700_000).start()
    tokens = {user: new_token(service, user) for user in ("ann", "bob")}
    assert service.request("POST", "/v1/admin/hold").status == 200  # the jobs need not run
    path = {user: job_with_long_document(service, tokens[user]) for user in tokens}
    unread = []
    for _ in range(2):
        one = socket.socket(socket.AF_UNIX)
        one.connect(str(tmp_path / "socket"))
        one.sendall(f"GET {path['ann']} HTTP/1.1\r\nHost: hexad\r\nAuthorization: Bearer {tokens['ann']}\r\n\r\n".encode())
        assert one.recv(12) == b"HTTP/1.1 200"
        unread.append(one)
    refused = with_token(service, tokens["ann"], "GET", path["ann"])
    assert refused.status == 429 and "user_answer_bytes" in refused.json["detail"] and refused.headers["Retry-After"]
    assert with_token(service, tokens["ann"], "GET", "/v1/usage").status == 200
    assert with_token(service, tokens["bob"], "GET", path["bob"]).status == 200
    for one in unread:
        one.close()
    wait_until(lambda: with_token(service, tokens["ann"], "GET", path["ann"]).status == 200, "an answer")


# The real worker, except that it never ends when it has to make a thumbnail.
HANGING_READER = """#!/bin/sh
[ "$1" = read-picture ] && exec {hang}
exec {worker} "$@"
"""


@pytest.mark.sanitized
@pytest.mark.parametrize("hang", ["sleep 1000000", "sleep 1000000 >&-"], ids=["silent", "closed"])
def test_a_thumbnail_is_given_up_however_slow_its_process_is(new_service, build, tmp_path, hang):
    """The process neither writes nor ends, or closes its output and does not end."""
    worker = tmp_path / "hanging-reader"
    worker.write_text(HANGING_READER.format(hang=hang, worker=build / "hexad-worker"))
    worker.chmod(0o700)
    service = new_service("--worker", worker, "--thumbnail_timeout_s", 0.05).start()
    job = service.submit(sphere(output={"preview": {"size": 64}}))
    service.wait_state(job, "succeeded")
    for _ in range(2):
        reply = service.get(f"/v1/jobs/{job}/thumbnail.png")
        assert reply.status == 503 and reply.json["code"] == "unavailable" and "thumbnail_timeout_s" in reply.json["detail"]
        assert int(reply.headers["Retry-After"]) > 0
    assert service.get("/v1/jobs").status == 200


def test_a_request_that_waits_too_long_for_a_thread_is_refused(new_service, build, tmp_path):
    """The third thumbnail waits while the first two are made. A list of jobs does not wait for thumbnails."""
    worker, calls = tmp_path / "waiting-reader", tmp_path / "calls"
    worker.write_text(WAITING_READER.format(where=tmp_path, worker=build / "hexad-worker"))
    worker.chmod(0o700)
    service = new_service("--worker", worker, "--thread_wait_s", 1, "--thumbnail_timeout_s", 1000).start()
    job = service.submit(sphere(output={"preview": {"size": 64}}))
    service.wait_state(job, "succeeded")
    drawn = [send_head(service, f"GET /v1/jobs/{job}/thumbnail.png HTTP/1.1", "Connection: close") for _ in range(2)]
    try:
        wait_until(lambda: calls.exists() and calls.read_text().count("x") == 2, "two thumbnails")
        reply = service.get(f"/v1/jobs/{job}/thumbnail.png")
        assert reply.status == 503 and "thread_wait_s" in reply.json["detail"] and int(reply.headers["Retry-After"]) > 0
        assert service.get("/v1/jobs").status == 200
    finally:
        (tmp_path / "gate").touch()
    for one in drawn:
        assert read_all(one).startswith(b"HTTP/1.1 200 ")


SUMMARY_WORKER = """#!/bin/sh
cat > /dev/null
printf x > "$4/points.ply"
printf '{"outcome":"converged","count":7,"report_bytes":%%d,"surface":{"warnings":["short"]},"outputs":[{"name":"points.ply","bytes":1,"sha256":"%s"}]}' %d > "$4/summary.json"
printf '%s' > "$4/report.json"
"""


def worker_with_report(tmp_path, report, told_bytes):
    path = tmp_path / "summary-worker"
    path.write_text(SUMMARY_WORKER % (hashlib.sha256(b"x").hexdigest(), told_bytes, report))
    path.chmod(0o700)
    return path


def test_of_a_result_the_summary_is_read_and_the_report_is_a_file(new_service, tmp_path):
    """However long a report is, the daemon does not parse it: this one is no JSON."""
    report = "a report that no one parses"
    service = new_service("--worker", worker_with_report(tmp_path, report, len(report))).start()
    job = service.submit(sphere())
    service.wait_state(job, "succeeded")
    assert service.job(job)["notes"]["warnings"] == ["short"]
    listed = service.get(f"/v1/jobs/{job}/results").json["results"]
    assert [(one["name"], one["bytes"]) for one in listed] == [("points.ply", 1), ("report.json", len(report))]
    sent = service.get(f"/v1/jobs/{job}/results/report.json")
    assert sent.status == 200 and sent.body == report.encode()
    assert service.get("/v1/jobs?limit=1").json["jobs"][0]["outcome"] == "converged"


def test_a_summary_of_another_report_is_not_believed(new_service, tmp_path):
    service = new_service("--worker", worker_with_report(tmp_path, "short", 1000)).start()
    job = service.submit(sphere(limits={"max_attempts": 1}))
    service.wait_state(job, "failed")


def test_sweeps_of_a_long_report_of_an_earlier_version_are_not_parsed(new_service, tmp_path):
    """A result without a summary, with a report of 4 MB whose rows are no JSON."""
    path = tmp_path / "old-worker"
    rows = "\n".join(["    no row"] * 400000)
    report = json.dumps({"outcome": "converged", "count": 7, "sweeps": ["@"], "outputs": [
        {"name": "points.ply", "bytes": 1, "sha256": hashlib.sha256(b"x").hexdigest()}]}, indent=2)
    (tmp_path / "report").write_text(report.replace('    "@"', rows))
    path.write_text(f'#!/bin/sh\ncat >/dev/null\nprintf x >"$4/points.ply"\ncp {tmp_path}/report "$4/report.json"\n')
    path.chmod(0o700)
    service = new_service("--worker", path).start()
    job = service.submit(sphere())
    service.wait_state(job, "succeeded")
    sent = service.get(f"/v1/jobs/{job}/results/report.json")
    assert sent.status == 200 and len(sent.body) > 4e6


def fill(state, count):
    """Puts ended jobs of one user into the database of a daemon that is not running; the oldest has failed."""
    with contextlib.closing(sqlite3.connect(state / "queue.db")) as database:
        ended = [(n, f"{n:026d}", "failed" if n == 1 else "succeeded", n != 1, n == 1, n) for n in range(1, count + 1)]
        database.executemany(
            "INSERT INTO job (seq, id, owner, state, priority, threads, memory_mb, max_attempts, tasks, ready, succeeded,"
            " failed, created_ms, finished_ms, labels) VALUES (?, ?, 'ann', ?, 0, 1, 1, 1, 1, 0, ?, ?, ?, 1, '[]')", ended)
        database.execute("INSERT INTO spec (job, spec) SELECT seq, '{}' FROM job")
        database.commit()


@pytest.mark.extended
def test_clients_go_on_over_short_pages(new_service, build, source, monkeypatch):
    service = new_service("--listen", "127.0.0.1:0", "--results_count", 0, "--user_results_count", 0).start()
    service.end()
    fill(service.state, 9000)
    service.start()
    asked = "/v1/jobs?owner=ann&state=failed&limit=5"
    first = service.get(asked).json
    assert first["jobs"] == [] and first["next"]
    done = subprocess.run([build / "hexadctl", "--server", f"http://{service.address}", "list", "--owner", "ann", "--state",
                           "failed", "--limit", "1", "--json"], capture_output=True, text=True, check=True)
    assert [job["id"] for job in json.loads(done.stdout)["jobs"]] == [f"{1:026d}"]
    monkeypatch.syspath_prepend(source / "clients" / "python")
    import hexad
    client = hexad.Client(f"http://{service.address}")
    assert [job.id for job in client.jobs(owner="ann", state="failed")] == [f"{1:026d}"]
