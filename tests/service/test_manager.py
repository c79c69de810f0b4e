# SPDX-License-Identifier: Apache-2.0
"""The daemon under a service manager, which these tests play: readiness, status, signs of life that end when the
supervisor is stuck, a socket handed over, settings read again. A real systemd is tests/boot."""
import contextlib
import ctypes
import os
import pathlib
import signal
import socket
import sqlite3
import subprocess
import sys

import pytest

from service import OPEN_TCP, PATIENCE_S, expect_problem, gated_worker, sphere, wait_until
from shared_service import Farm

WATCHDOG_S = 0.2  # of a manager in a hurry: two signs of life in that time


class Manager:
    """Takes what is told on a socket like systemd's."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(path))
        self.socket.settimeout(PATIENCE_S)

    def hear(self, wanted):
        """The messages up to the first that has the wanted beginning."""
        heard = []
        while not heard or not any(line.startswith(wanted) for line in heard[-1].splitlines()):
            heard.append(self.socket.recv(4096).decode())
        return heard


@pytest.fixture
def manager(tmp_path, monkeypatch):
    path = tmp_path / "notify"
    made = Manager(path)
    monkeypatch.setenv("NOTIFY_SOCKET", str(path))
    monkeypatch.setenv("WATCHDOG_USEC", str(int(WATCHDOG_S * 1e6)))
    yield made
    made.socket.close()


def test_ready_status_and_signs_of_life(new_service, manager, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path), "--workers", "1", base=tmp_path).start()
    assert manager.hear("READY=1") == ["READY=1"]
    manager.hear("WATCHDOG=1")
    manager.hear("STATUS=0 queued, 0 running")
    jobs = [service.submit(sphere()) for _ in range(3)]
    manager.hear("STATUS=2 queued, 1 running")
    manager.hear("WATCHDOG=1")
    service.process.send_signal(signal.SIGTERM)
    told = manager.hear("STOPPING=1")[-1]
    assert "EXTEND_TIMEOUT_USEC=45000000" in told  # drain_s, grace_s and what comes after
    manager.hear("STATUS=draining: 2 queued, 1 running")
    service.open_gate(jobs[0])
    assert service.process.wait(PATIENCE_S) == 0


def test_a_start_that_corrects_reports_asks_for_time(new_service, manager, monkeypatch):
    service = new_service()
    with monkeypatch.context() as alone:
        alone.delenv("NOTIFY_SOCKET")
        service.start()
    for _ in range(2):
        done = service.wait_state(service.submit(sphere(60, output={"preview": False})), "succeeded")
    assert done["cached_from"]
    service.end()
    with sqlite3.connect(service.state / "queue.db") as database:
        database.execute("UPDATE service SET linked_reports = 1")
    database.close()
    service.start()
    assert manager.hear("EXTEND_TIMEOUT_USEC=60000000") and manager.hear("READY=1")


PTRACE_SEIZE, PTRACE_INTERRUPT, PTRACE_DETACH = 0x4206, 0x4207, 17


def thread_of(service, name):
    """Its directory in /proc. It gives itself its name, some time after it began."""
    tasks = pathlib.Path(f"/proc/{service.process.pid}/task")

    def named():
        return [task for task in tasks.iterdir() if (task / "comm").read_text().strip() == name]
    wait_until(named, f"a thread called {name}")
    return named()[0]


@contextlib.contextmanager
def stopped(task):
    """A thread that waits is stopped: one that works might hold what the others wait for."""
    libc, thread = ctypes.CDLL(None, use_errno=True), int(task.name)
    wait_until(lambda: (task / "stat").read_text().rpartition(")")[2].split()[0] == "S", "a thread that waits")
    for request in (PTRACE_SEIZE, PTRACE_INTERRUPT):
        if libc.ptrace(request, thread, None, None) != 0:
            pytest.skip(f"threads cannot be stopped here: {os.strerror(ctypes.get_errno())}")
    os.waitpid(thread, 0x40000000)  # __WALL
    try:
        yield
    finally:
        assert libc.ptrace(PTRACE_DETACH, thread, None, None) == 0


@pytest.mark.parametrize("thread, called", [("supervisor", "the supervisor"), ("serving", "the serving thread")])
def test_a_stuck_thread_gives_no_sign(new_service, manager, thread, called):
    service = new_service().start()
    manager.hear("WATCHDOG=1")
    with stopped(thread_of(service, thread)):
        manager.hear("STATUS=stuck")
        for _ in range(3):
            assert manager.hear("STATUS=stuck") == ["STATUS=stuck"]  # and nothing in between
        assert service.log.read_text().count(f"{called} has not advanced for ") == 1
    manager.hear("WATCHDOG=1")
    assert service.get("/healthz").status == 200
    assert f"{called} advances again, after " in service.log.read_text()
    assert service.end() == 0


@pytest.mark.extended
def test_without_a_manager_the_log_says_that_a_thread_is_stuck(new_service):
    service = new_service().start()
    with stopped(thread_of(service, "serving")):
        wait_until(lambda: "the serving thread has not advanced for " in service.log.read_text(), "a line about the stall")
    wait_until(lambda: "the serving thread advances again, after " in service.log.read_text(), "a line about its end")


def test_settings_are_read_again(new_service, manager, tmp_path):
    file = tmp_path / "hexad.conf"
    file.write_text("stall_s = 1000\nmax_attempts = 3\n")
    service = new_service("--config", file, "--worker", gated_worker(tmp_path, deaf=True)).start()
    manager.hear("READY=1")
    file.write_text("stall_s = 0.1\ngrace_s = 0\nmax_attempts = 1\n")
    service.process.send_signal(signal.SIGHUP)
    assert "MONOTONIC_USEC=" in manager.hear("RELOADING=1")[-1]
    manager.hear("READY=1")
    log = service.log.read_text()
    assert "setting stall_s has changed\n" in log and "setting grace_s has changed\n" in log
    assert "setting max_attempts has changed: restart hexad to apply it" in log
    assert log.count(" setting ") == 3
    job = service.submit(sphere())
    assert service.wait_state(job, "failed", "timed_out")["error"]["code"] == "stalled"
    file.write_text("stall_s = soon\n")
    service.process.send_signal(signal.SIGHUP)
    manager.hear("READY=1")
    assert f"cannot reload the settings, which are unchanged: {file}:1: stall_s" in service.log.read_text()
    assert service.end() == 0


def reload(service, manager, file, text):
    file.write_text(text)
    service.process.send_signal(signal.SIGHUP)
    manager.hear("RELOADING=1")
    manager.hear("READY=1")


def test_weights_are_read_again(new_service, manager, tmp_path):
    file = tmp_path / "hexad.conf"
    file.write_text("user_weights = eve:50\n")
    shared = Farm(new_service, tmp_path, "--config", file)
    manager.hear("READY=1")
    reload(shared.service, manager, file, "user_weights = ann:2\nuser_weights = *:1\n")
    for _ in range(8):
        for user in ("ann", "bob", "eve"):
            shared.submit(user)
    order = [shared.running()[0], *(shared.next()[0] for _ in range(7))]
    assert {user: order.count(user) for user in order} == {"ann": 4, "bob": 2, "eve": 2}


@pytest.mark.sanitized
def test_bounds_of_priorities_are_read_again(new_service, manager, tmp_path):
    file = tmp_path / "hexad.conf"
    file.write_text("user_priorities = *:5\n")
    service = new_service("--config", file).start()
    manager.hear("READY=1")

    def submit(priority):
        return service.post("/v1/jobs", sphere(queue={"priority": priority}))

    expect_problem(submit(6), 403, "priority_forbidden")
    reload(service, manager, file, "user_priorities = *:7\n")
    assert submit(7).status == 201
    expect_problem(submit(8), 403, "priority_forbidden")
    reload(service, manager, file, "user_weights = anyone:2\nuser_priorities = *:high\n")
    log = service.log.read_text()
    assert f"cannot reload the settings, which are unchanged: {file}:2: user_priorities: *:high" in log and "setting user_weights" not in log
    expect_problem(submit(8), 403, "priority_forbidden")
    reload(service, manager, file, "")
    assert submit(8).status == 201


def test_bounds_of_results_are_read_again(new_service, manager, tmp_path):
    file = tmp_path / "hexad.conf"
    file.write_text("results_count = 1\n")
    service = new_service("--config", file, "--cache", 0, "--worker", gated_worker(tmp_path), "--workers", 1).start()
    manager.hear("READY=1")

    def expect_full(setting):
        refused = service.post("/v1/jobs", sphere())
        expect_problem(refused, 507, "results_full")
        assert f"{setting})" in refused.json["detail"]

    first, second = service.submit(sphere()), service.submit(sphere())
    service.open_gate(first)
    service.wait_state(first, "succeeded")
    expect_full(" results_count")
    reload(service, manager, file, "user_results_count = 1\n")
    expect_full(" user_results_count")
    reload(service, manager, file, "results_count = 2\n")
    service.wait_worker(second)
    service.open_gate(second)
    service.wait_state(second, "succeeded")
    expect_full(" results_count")
    reload(service, manager, file, "results_count = 2\ndelete_undelivered = 1\n")
    wait_until(lambda: service.get(f"/v1/jobs/{first}").status == 404, "the deletion of the first result")
    service.submit(sphere())


@pytest.mark.parametrize("key, spec", [
    ("input_roots", lambda path: {**sphere(), "surface": {"vdb": {"path": f"{path}/a.vdb"}}}),
    ("output_roots", lambda path: sphere(output={"directory": f"{path}/a"}))])
def test_a_refused_path_mentions_the_setting_that_a_restart_applies(new_service, manager, tmp_path, key, spec):
    file = tmp_path / "hexad.conf"
    (tmp_path / "old").mkdir()
    (tmp_path / "new").mkdir()
    file.write_text(f"{key} = {tmp_path}/old\n")
    service = new_service("--config", file).start()
    manager.hear("READY=1")

    def refused():
        answer = service.post("/v1/jobs", spec(tmp_path / "new"))
        expect_problem(answer, 403, "path_forbidden")
        return answer.json["errors"][0]["detail"]

    assert key in refused() and "changed" not in refused()
    reload(service, manager, file, f"{key} = {tmp_path}/new\n")
    assert f"restart hexad, which applies the changed setting {key}" in refused()
    reload(service, manager, file, f"{key} = {tmp_path}/old\n")
    assert "changed" not in refused()


# Puts the descriptors that are named where systemd puts them, from 3 on, and becomes the program behind them.
HAND_OVER = """
import fcntl, os, sys
for to, number in enumerate([fcntl.fcntl(int(n), fcntl.F_DUPFD, 100) for n in sys.argv[1].split(",")], 3):
    os.dup2(number, to)
os.environ.update(LISTEN_PID=str(os.getpid()), LISTEN_FDS=str(len(sys.argv[1].split(","))))
os.execv(sys.argv[2], sys.argv[2:])
"""


def start_with_sockets(build, where, *sockets):
    numbers = [s.fileno() for s in sockets]
    return subprocess.Popen(
        [sys.executable, "-c", HAND_OVER, ",".join(map(str, numbers)), build / "hexad", "--state_dir", where / "state",
         "--port_file", where / "port", "--listen", "127.0.0.1:0, unix:", "--tcp_without_tokens", OPEN_TCP],
        pass_fds=numbers, stderr=subprocess.PIPE, text=True)


@pytest.mark.sanitized
@pytest.mark.parametrize("families", [("inet",), ("unix",), ("unix", "inet", "inet")], ids="-".join)
def test_sockets_are_handed_over(build, tmp_path, families):
    ours, addresses = [], []
    for family in families:
        if family == "inet":
            ours.append(socket.create_server(("127.0.0.1", 0)))
            addresses.append("127.0.0.1:%d" % ours[-1].getsockname()[1])
        else:
            ours.append(socket.socket(socket.AF_UNIX))
            ours[-1].bind(str(tmp_path / "socket"))
            ours[-1].listen()
            addresses.append(f"unix:{tmp_path / 'socket'}")
    process = start_with_sockets(build, tmp_path, *ours)
    try:
        wait_until(lambda: (tmp_path / "port").exists() or process.poll() is not None, "the daemon")
        assert process.poll() is None, process.stderr.read()
        assert (tmp_path / "port").read_text().splitlines() == addresses
        for each, address in zip(ours, addresses):
            with socket.socket(each.family) as client:
                client.settimeout(PATIENCE_S)
                client.connect(each.getsockname())
                client.sendall(f"GET /healthz HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n".encode())
                assert client.recv(4096).startswith(b"HTTP/1.1 200 ")
        process.send_signal(signal.SIGTERM)
        told = process.communicate(timeout=PATIENCE_S)[1]
        assert f"listen = 127.0.0.1:0, unix: is ignored: systemd opens the sockets, {', '.join(addresses)}. Remove" in told
        assert "`hexad --open-port USER`, or set ListenStream= and IPAddressAllow= in" in told
        assert process.returncode == 0
        assert "unix" not in families or (tmp_path / "socket").exists()  # which is not the daemon's to remove
    finally:
        process.kill()
        process.communicate()
        for each in ours:
            each.close()


def test_a_socket_that_cannot_be_served(build, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as listening, socket.socket() as silent:
        process = start_with_sockets(build, tmp_path, listening, silent)
        assert "not a listening stream socket" in process.communicate(timeout=PATIENCE_S)[1]
        assert process.returncode == 2
