# SPDX-License-Identifier: Apache-2.0
"""Cancelling, crashes of workers and of the daemon, draining, and what the daemon refuses at the start."""
import os
import pathlib
import pwd
import re
import resource
import signal
import sqlite3
import subprocess
import threading

import pytest

from service import PATIENCE_S, gated_worker, long_sphere, processes, sphere, wait_until


def assert_one_result(service, job):
    """Exactly one result, whole, and no attempt's directory beside it that claims to be one."""
    assert [p.name for p in (service.state / "results").iterdir() if p.name.startswith(job)] == [job]
    assert (service.state / "results" / job / "report.json").is_file()
    for attempt in (service.state / "attempts").glob(f"{job}.*"):
        assert [p.name for p in attempt.iterdir()] == ["worker.log"]
    assert service.get(f"/v1/jobs/{job}/results/report.json").json["count"]


@pytest.fixture
def service(clean_service):
    """One daemon for the tests of this file, without jobs of other tests."""
    return clean_service


def test_cancel_of_a_queued_job(new_service):
    service = new_service("--workers", 1).start()
    running = service.submit(long_sphere())
    service.wait_state(running, "running")
    queued = service.submit(sphere())
    reply = service.post(f"/v1/jobs/{queued}/cancel")
    assert reply.status == 200 and reply.json["state"] == "cancelled"
    assert service.job(queued)["attempts"] == []
    again = service.post(f"/v1/jobs/{queued}/cancel")
    assert again.status == 409 and again.json["code"] == "conflict"


def test_cancel_of_a_running_job(service):
    job = service.submit(long_sphere())
    worker = service.wait_worker(job)
    reply = service.post(f"/v1/jobs/{job}/cancel")
    assert reply.status == 202 and reply.json["state"] in ("cancelling", "cancelled")
    done = service.wait_state(job, "cancelled")
    assert done["error"]["code"] == "cancelled" and len(done["attempts"]) == 1
    assert worker not in processes() or processes()[worker][1] == "Z"
    assert service.get(f"/v1/jobs/{job}/results").status == 404
    assert service.wait_state(service.submit(sphere()), "succeeded")


def test_a_higher_priority_runs_first(new_service):
    service = new_service("--workers", 1).start()
    first = service.submit(long_sphere())
    service.wait_state(first, "running")
    low = service.submit(sphere(queue={"priority": -1}))
    high = service.submit(sphere(queue={"priority": 1}))
    service.post(f"/v1/jobs/{first}/cancel")
    low, high = service.wait_state(low, "succeeded"), service.wait_state(high, "succeeded")
    assert high["finished"] <= low["started"]


def test_a_killed_worker_is_tried_again(new_service, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path)).start()
    other = service.submit(sphere(name="other"))
    job = service.submit(sphere())
    os.kill(service.wait_worker(job), signal.SIGKILL)
    service.open_gate(job)
    done = service.wait_state(job, "succeeded")
    assert [a.get("signal") for a in done["attempts"]] == [signal.SIGKILL, None]
    assert done["attempt"] == 2
    assert_one_result(service, job)
    undisturbed = service.job(other)
    assert undisturbed["state"] == "running" and undisturbed["attempt"] == 1


def test_a_worker_that_always_dies_ends_the_job(service):
    job = service.submit(long_sphere(limits={"max_attempts": 2}))
    first = service.wait_worker(job)
    os.kill(first, signal.SIGKILL)
    second = wait_until(lambda: [p for p in service.workers_of(job) if p != first], "the second attempt")[0]
    os.kill(second, signal.SIGSEGV)
    done = service.wait_state(job, "failed")
    assert done["error"]["code"] == "internal"
    assert "SIGSEGV" in done["error"]["message"] and "2 of 2" in done["error"]["message"]
    ends = wait_until(lambda: [line for line in service.log.read_text().splitlines()
                               if f"attempt ended job={job}" in line and "state=failed" in line], "the end in the log")
    assert " warning " in ends[0] and done["error"]["message"] in ends[0], ends


@pytest.mark.sanitized
def test_a_timeout(service):
    done = service.wait_state(service.submit(long_sphere(limits={"timeout_s": 0.5})), "timed_out")
    assert done["error"]["code"] == "limit_time"


def test_a_killed_daemon_loses_nothing(new_service, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path)).start()
    running = [service.submit(sphere(name=f"r{i}")) for i in range(2)]
    waiting = [service.submit(sphere(name=f"w{i}")) for i in range(3)]
    workers = [service.wait_worker(job) for job in running]
    service.end(signal.SIGKILL)
    # its workers die with it
    wait_until(lambda: all(processes().get(w, (0, "Z", ""))[1] == "Z" for w in workers), "the workers' end")
    service.start()
    for job in running + waiting:
        service.open_gate(job)
        service.wait_state(job, "succeeded")
        assert_one_result(service, job)
    assert len(service.get("/v1/jobs").json["jobs"]) == 5
    assert [service.job(job)["attempt"] for job in running] == [2, 2]
    assert [service.job(job)["attempt"] for job in waiting] == [1, 1, 1]


def set_boot_id(service, boot_id):
    """As if the host had been started again since: the boot id that the dead daemon has left is another."""
    with sqlite3.connect(service.state / "queue.db") as database:
        assert database.execute("UPDATE instance SET boot_id = ?", (boot_id,)).rowcount == 1
    database.close()


def test_another_program_is_kept_out_of_the_database(new_service):
    """Neither reading nor writing: it would keep the log of the database from being emptied, or hold up changes. A start waits until it has left."""
    service = new_service().start()
    service.end()
    other = sqlite3.connect(service.state / "queue.db", timeout=0, check_same_thread=False)
    assert other.execute("SELECT count(*) FROM job").fetchone() == (0,)
    leaving = threading.Timer(0.3, other.close)
    leaving.start()
    service.start()
    leaving.join()
    service.submit(sphere())
    for statement in ("SELECT count(*) FROM job", "BEGIN IMMEDIATE"):
        other = sqlite3.connect(service.state / "queue.db", timeout=0)
        with pytest.raises(sqlite3.OperationalError, match="locked"):
            other.execute(statement)
        other.close()
    service.submit(sphere())


def test_deaths_of_the_daemon_do_not_count(new_service, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path), "--retry_s", 0).start()
    job = service.submit(sphere(limits={"max_attempts": 2}))
    worker = service.wait_worker(job)
    os.kill(worker, signal.SIGKILL)  # counts
    wait_until(lambda: service.get(f"/v1/jobs/{job}/tasks").json["tasks"][0]["attempt"] == 2, "the second attempt")
    for kills in range(1, 4):
        service.end(signal.SIGKILL)
        wait_until(lambda: not service.workers_of(job), "the worker's end")
        if kills == 3:
            set_boot_id(service, "another")
        service.start()
        service.wait_worker(job)
        task, = service.get(f"/v1/jobs/{job}/tasks").json["tasks"]
        assert (task["attempt"], task["spent"], task["interrupted"]) == (2 + kills, 2, kills)
        assert re.search(r"attempt ended .* code=interrupted$", service.log.read_text(), re.M), "the code has no message"
    service.open_gate(job)
    done = service.wait_state(job, "succeeded")
    assert [a["reason"] for a in done["attempts"]][1:] == ["the daemon ended during the attempt"] * 2 + \
        ["the host restarted during the attempt", "exit status 0"]


def test_too_many_deaths_of_the_daemon_end_a_job(new_service, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path), "--max_interruptions", 1).start()
    job = service.submit(sphere(limits={"max_attempts": 1}))
    for _ in range(2):
        service.wait_worker(job)
        service.end(signal.SIGKILL)
        service.start()
    done = service.wait_state(job, "failed")
    assert done["error"]["code"] == "interrupted"
    assert "stopped 2 times" in done["error"]["message"] and "max_interruptions" in done["error"]["message"]
    assert service.post(f"/v1/jobs/{job}/retry").status == 200
    service.wait_worker(job)
    service.end(signal.SIGKILL)
    service.start()
    service.open_gate(job)
    service.wait_state(job, "succeeded")


def test_a_daemon_killed_between_rename_and_commit(new_service):
    """The one moment in which the result is in place and the queue does not know: made by hand from
    a job that ended, by putting the queue back to what it was before."""
    service = new_service().start()
    job = service.submit(sphere())
    service.wait_state(job, "succeeded")
    service.end()
    back = ("UPDATE job SET state = 'running', outcome = NULL, finished_ms = NULL, succeeded = 0, running = 1,"
            " not_converged = 0, unresolved = 0; UPDATE task SET state = 'running', outcome = NULL, finished_ms = NULL;"
            "INSERT INTO owner (name, unfinished, running, pass) VALUES ('', 1, 1, 0);"
            "UPDATE attempt SET finished_ms = NULL, exit_status = NULL;")
    with sqlite3.connect(service.state / "queue.db") as database:
        database.executescript(back)
    database.close()
    service.start()
    done = service.job(job)  # settled before the daemon serves
    assert done["state"] == "succeeded" and done["outcome"] and done["attempt"] == 1
    assert_one_result(service, job)


def test_a_drain_lets_jobs_end(new_service, tmp_path):
    service = new_service("--workers", 1, "--worker", gated_worker(tmp_path)).start()
    running = service.submit(sphere())
    waiting = service.submit(sphere())
    service.wait_worker(running)
    service.process.send_signal(signal.SIGTERM)
    wait_until(lambda: service.get("/healthz").json["status"] == "draining", "the drain")
    refused = service.post("/v1/jobs", sphere())
    assert refused.status == 503 and refused.json["code"] == "unavailable" and refused.headers["Retry-After"]
    service.open_gate(running)
    assert service.process.wait(PATIENCE_S) == 0
    assert not service.workers_of(running) and not service.workers_of(waiting)
    service.start()
    assert service.job(running)["attempt"] == 1
    service.open_gate(waiting)
    service.wait_state(running, "succeeded")
    service.wait_state(waiting, "succeeded")


def test_a_drain_that_takes_too_long_puts_back(new_service):
    service = new_service("--drain_s", "0.2", "--workers", 1).start()
    job = service.submit(long_sphere(limits={"max_attempts": 1}))
    service.wait_worker(job)
    assert service.end() == 0
    assert not service.workers_of(job)
    service.start()
    service.wait_state(job, "running")  # had the attempt counted, it would have failed
    service.post(f"/v1/jobs/{job}/cancel")
    done = service.wait_state(job, "cancelled")
    assert [a["number"] for a in done["attempts"]] == [1, 2]
    assert service.end() == 0
    assert " error " not in service.log.read_text()


def test_a_second_signal_ends_at_once(new_service):
    service = new_service("--drain_s", 1000, "--workers", 1).start()
    job = service.submit(long_sphere())
    service.wait_worker(job)
    service.process.send_signal(signal.SIGINT)
    wait_until(lambda: service.get("/healthz").json["status"] == "draining", "the drain")
    assert service.end(signal.SIGINT) == 0
    assert not service.workers_of(job)


def test_a_second_signal_waits_for_no_deaf_worker(new_service, tmp_path):
    """The first signal has asked the worker already; grace_s is longer than the test's patience."""
    service = new_service("--drain_s", 0, "--grace_s", 3600, "--worker", gated_worker(tmp_path, deaf=True)).start()
    job = service.submit(sphere(limits={"max_attempts": 1}))
    service.wait_worker(job)
    service.process.send_signal(signal.SIGTERM)
    wait_until(lambda: "stop requested" in service.log.read_text(), "the worker to be asked")
    assert service.end(signal.SIGTERM) == 0
    assert not service.workers_of(job)
    service.start()
    service.wait_state(job, "running")  # put back, not counted
    service.open_gate(job)
    service.wait_state(job, "succeeded")


def test_a_full_disk(new_service, tmp_path):
    """A limit on the size of files stands for it: what is stored fails, then works again."""
    service = new_service("--workers", 1, "--worker", gated_worker(tmp_path)).start()
    job = service.submit(sphere())
    service.wait_worker(job)
    pid, free = service.process.pid, resource.prlimit(service.process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (1 << 18, free[1]))
    for _ in range(1000):
        reply = service.post("/v1/jobs", sphere())
        if reply.status != 201:
            break
    assert reply.status == 503 and reply.json["code"] == "unavailable" and reply.headers["Retry-After"], reply.body
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (1 << 17, free[1]))  # nor has the smallest change room now
    service.open_gate(job)  # its end cannot be stored, and is tried again and again

    def lines(words):
        return [line for line in service.log.read_text().splitlines() if words in line]

    wait_until(lambda: len(lines("attempt not settled")) >= 3, "the settlement to be tried again")
    for _ in range(3):
        assert service.post("/v1/jobs", sphere()).status == 503
    assert len(lines(" error attempt not settled")) == 1
    assert len(lines("cannot store")) == 1, lines("cannot store")
    resource.prlimit(pid, resource.RLIMIT_FSIZE, free)
    service.wait_state(job, "succeeded")
    assert service.post("/v1/jobs", sphere()).status == 201
    assert len(lines("stores changes again")) == 1


def run_hexad(build, *options):
    return subprocess.run([build / "hexad", *map(str, options)], capture_output=True, text=True, timeout=PATIENCE_S)


@pytest.mark.sanitized
def test_closed_standard_descriptors(build, tmp_path):
    """They must not become the log's, the lock's or the database's."""
    port = tmp_path / "other-port"
    words = [build / "hexad", "--state_dir", tmp_path / "other", "--port_file", port]
    process = subprocess.Popen(["/bin/sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", *words])
    try:
        wait_until(lambda: port.exists() or process.poll() is not None, "the daemon")
        assert process.poll() is None
        assert [os.readlink(f"/proc/{process.pid}/fd/{n}") for n in range(3)] == ["/dev/null"] * 3
    finally:
        process.terminate()
        assert process.wait(PATIENCE_S) == 0


def test_two_daemons_on_one_state_directory(service, build):
    second = run_hexad(build, "--state_dir", service.state)
    assert second.returncode == 1
    assert "another hexad" in second.stderr and str(service.process.pid) in second.stderr
    assert service.get("/healthz").status == 200


@pytest.mark.sanitized
@pytest.mark.parametrize("where", ["0.0.0.0:0", "[::]:0", ":8642", "nonsense", "unix:relative", "127.0.0.1:99999"])
def test_addresses_that_are_refused(build, tmp_path, where):
    tried = run_hexad(build, "--listen", where, "--state_dir", tmp_path / "state")
    assert tried.returncode == 2, tried.stderr
    assert where in tried.stderr


@pytest.mark.sanitized
def test_settings_that_are_refused(build, tmp_path):
    bad = tmp_path / "bad.conf"
    bad.write_text("workers = 2\nwrokers = 3\n")
    tried = run_hexad(build, "--config", bad)
    assert tried.returncode == 2 and f"{bad}:2" in tried.stderr and "wrokers" in tried.stderr
    tried = run_hexad(build, "--worker", "/nonexistent", "--state_dir", tmp_path / "state")
    assert tried.returncode == 1 and "/nonexistent" in tried.stderr
    tried = run_hexad(build, "--input_roots", "/nonexistent", "--state_dir", tmp_path / "state")
    assert tried.returncode == 1 and "/nonexistent" in tried.stderr


@pytest.mark.parametrize("setting", [
    "user_weights = alice:200", "user_priorities = alice:5000", "output_mode = 9", "output_group = no-such-group", "output_roots = relative",
    "input_roots = /nonexistent", "path_mappings = a", "trusted_proxies = a", "page_origins = a", "webhook_hosts = a b", "engine = a",
    "worker = /nonexistent", "listen = 0.0.0.0:0"])
def test_a_setting_with_a_value_that_the_service_refuses_is_named_with_its_line(build, tmp_path, setting):
    bad = tmp_path / "bad.conf"
    bad.write_text(f"# a comment\nworkers = 2\n{setting}\n")
    tried = run_hexad(build, "--config", bad, "--state_dir", tmp_path / "state")
    assert tried.returncode in (1, 2) and f"error hexad: {bad}:3: {setting.split()[0]}" in tried.stderr, tried.stderr
    key, value = setting.split(" = ")
    tried = run_hexad(build, "--config", bad, "--state_dir", tmp_path / "state", f"--{key}={value}")
    assert tried.returncode in (1, 2) and f"error hexad: {key}" in tried.stderr, tried.stderr


def test_less_memory_for_all_jobs_than_for_one_is_warned_of(new_service):
    service = new_service("--host_memory_mb", 2048, "--memory_mb", 4096).start()
    assert " warning memory_mb (4096) is more than host_memory_mb (2048)" in service.log.read_text()
    refused = service.post("/v1/jobs", sphere(limits={"memory_mb": 4096}))
    assert refused.status >= 400 and "host_memory_mb" in refused.body.decode()


@pytest.mark.sanitized
def test_help_and_sample(build, source):
    text = run_hexad(build, "--help", "all").stdout
    assert "--listen" in text and "--state_dir" in text and "Default: 3 attempts" in text
    assert run_hexad(build, "--print-config").stdout == pathlib.Path(source / "etc/hexad.conf").read_text()
    assert run_hexad(build, "--version").stdout.startswith("hexad ")


@pytest.mark.sanitized
def test_a_config_file(new_service, build, tmp_path):
    root = tmp_path / "root"
    root.mkdir()
    file = tmp_path / "hexad.conf"
    file.write_text(f"# a comment\ninput_roots = {root}\nbody_limit_bytes = 77\n")
    service = new_service("--config", file).start()
    assert service.post("/v1/jobs", raw=" " * 78).status == 413


def test_settings_are_checked_without_a_start(build, tmp_path):
    """Faults that a start refuses end with status 2; what a start or a reload accepts is warned of. Nothing is created."""
    file = tmp_path / "hexad.conf"
    here = pwd.getpwuid(os.geteuid()).pw_name

    def check(text):
        file.write_text(text)
        done = run_hexad(build, "--config", file, "--state_dir", tmp_path / "state", "--check-settings")
        assert not (tmp_path / "state").exists()
        return done.returncode, done.stdout + done.stderr

    assert check(f"user_weights = {here}:2, *:1\nunix_users = {here}\ninput_roots = {tmp_path}\noutput_roots = {tmp_path}\n") == \
        (0, f"no faults in the settings of {file}\n")
    for text in ("user_weights = alice:200", "output_group = no-such-group", "wrokers = 2", "user_priorities = a", "input_roots = relative",
                 "path_mappings = a", "trusted_proxies = a", "page_origins = a", "webhook_hosts = a b"):
        status, told = check(f"workers = 2\n{text}\n")
        assert status == 2 and f"hexad: {file}:2: " in told, told
    status, told = check(f"user_weights = no-such-user:2\nuser_priorities = gone:1\nunix_users = left\n"
                         f"input_roots = {tmp_path}/none\noutput_roots = {tmp_path}/none\n")
    assert status == 0, told
    for part in ("user_weights: this machine has no user no-such-user", "user_priorities: this machine has no user gone", "unix_users: ",
                 f"output_roots: cannot open the output root {tmp_path}/none"):
        assert f"hexad: warning: {part}" in told, told


def test_a_check_of_settings_says_that_hexad_would_not_start(build, tmp_path):
    """As it then does not; only --strict changes the exit status."""
    file = tmp_path / "hexad.conf"
    file.write_text(f"input_roots = {tmp_path}/none, {tmp_path}\noutput_roots = {tmp_path}/away\n")
    where = ("--config", file, "--state_dir", tmp_path / "state")
    for words, status in (((), 0), (("--strict",), 1)):
        done = run_hexad(build, *where, "--check-settings", *words)
        assert done.returncode == status and "no faults" not in done.stdout
        assert done.stdout.startswith(f"hexad would not start: {file}:1: input_roots: cannot open the input root {tmp_path}/none: No such file or directory")
    assert run_hexad(build, *where).returncode == 1
    told = run_hexad(build, "--state_dir", tmp_path / "state", "--check-settings").stdout
    assert told == "no settings file was read; no faults in the options and the defaults\n"
    told = run_hexad(build, *where, "--check-settings", "--input_roots", f"{tmp_path}/none1:{tmp_path}:{tmp_path}/none2").stdout
    assert told.count("cannot open the input root") == 2 and all(f"cannot open the input root {tmp_path}/{name}: No such file" in told
                                                                 for name in ("none1", "none2")), told
    (tmp_path / "none").mkdir()
    assert run_hexad(build, *where, "--check-settings", "--strict").stdout == f"no faults in the settings of {file}; 1 warning\n"
    assert run_hexad(build, *where, "--strict").returncode == 2


WRONG_SETTINGS = {  # names of settings and values -> the message; {root}: an existing directory
    "webhooks without a secret": ({"webhook_hosts": "example.org"}, "webhook_hosts requires webhook_secret_file: set it"),
    "a secret that is missing": ({"webhook_hosts": "example.org", "webhook_secret_file": "{root}/none"},
                                 "webhook_secret_file: cannot read {root}/none: No such file or directory"),
    "a secret that is too short": ({"webhook_hosts": "example.org", "webhook_secret_file": "{root}/file"},
                                   "webhook_secret_file {root}/file: the secret must have"),
    "a secret that is a pipe": ({"webhook_hosts": "example.org", "webhook_secret_file": "{root}/pipe"}, "{root}/pipe is not a regular file"),
    "a host of webhooks that is none": ({"webhook_hosts": "a b"}, "webhook_hosts: "),
    "an engine that is none": ({"engine": "pbs"}, "engine: must be local or slurm"),
    "slurm without work_dir": ({"engine": "slurm"}, "engine = slurm requires work_dir"),
    "an option of slurm without dashes": ({"engine": "slurm", "work_dir": "{root}/work", "slurm_options": "qos"}, "slurm_options: must be --OPTION"),
    "an account of slurm without a user": ({"engine": "slurm", "work_dir": "{root}/work", "slurm_accounts": "a"}, "slurm_accounts: must be user"),
    "state_dir below a file": ({"state_dir": "{root}/file/state"}, "state_dir: cannot write to {root}/file/state: Not a directory"),
    "state_dir that is a file": ({"state_dir": "{root}/file"}, "state_dir: cannot write to {root}/file: Not a directory"),
    "state_dir that is a link to nothing": ({"state_dir": "{root}/link"}, "state_dir: cannot write to {root}/link: No such file or directory"),
    "work_dir below a file": ({"work_dir": "{root}/file/deep/work"}, "work_dir: cannot write to {root}/file/deep/work: Not a directory"),
    "work_dir that is a link to nothing": ({"work_dir": "{root}/link"}, "work_dir: cannot write to {root}/link: No such file or directory"),
    "port_file without its directory": ({"port_file": "{root}/none/port"},
                                        "port_file: cannot create {root}/none/port: the directory {root}/none: No such file or directory: create it"),
    "a socket without its directory": ({"listen": "unix:{root}/none/socket"}, "listen unix:{root}/none/socket: the directory {root}/none: No such"),
    "a socket at the path of a file": ({"listen": "unix:{root}/file"}, "listen unix:{root}/file: the path exists and is not a socket"),
    "a relative socket": ({"listen": "unix:beside"}, "listen unix:beside: the path must be absolute"),
    "a port without tokens": ({"listen": "127.0.0.1:0"}, "listen 127.0.0.1:0: every user of this machine can reach this address"),
    "tokens that others can read": ({"token_file": "{root}/open"}, "{root}/open: other users can access the file"),
    "an input root that is missing": ({"input_roots": "{root}/none"}, "input_roots: cannot open the input root {root}/none: No such file"),
    "a relative input root": ({"input_roots": "none"}, "input_roots: must be absolute paths (given none)"),
    "a relative output root": ({"output_roots": "none"}, "output_roots: must be absolute paths (given none)"),
    "a group that is missing": ({"output_group": "no-such-group"}, "output_group: the group no-such-group does not exist"),
    "a worker that is missing": ({"worker": "{root}/none"}, "worker: cannot run the program {root}/none: No such file or directory"),
    "a proxy that is none": ({"trusted_proxies": "a"}, "trusted_proxies: "),
    "a page that is none": ({"page_origins": "a"}, "page_origins: "),
    "a mapping that is none": ({"path_mappings": "a"}, "path_mappings: "),
    "a weight that is too high": ({"user_weights": "alice:200"}, "user_weights: "),
}


@pytest.mark.parametrize("name", WRONG_SETTINGS)
def test_a_check_of_settings_and_a_start_agree(build, tmp_path, name):
    """The check finds what a start refuses, in the same words, and the check creates nothing."""
    settings, message = WRONG_SETTINGS[name]
    (tmp_path / "file").write_text("short\n")
    (tmp_path / "file").chmod(0o600)
    (tmp_path / "open").touch(mode=0o644)
    (tmp_path / "link").symlink_to(tmp_path / "nothing")
    os.mkfifo(tmp_path / "pipe")
    settings = {"state_dir": "{root}/state", **settings}
    file = tmp_path / "hexad.conf"
    file.write_text("".join(f"{key} = {value.format(root=tmp_path)}\n" for key, value in settings.items()))
    before = sorted(tmp_path.rglob("*"))
    told = run_hexad(build, "--config", file, "--check-settings", "--strict")
    assert sorted(tmp_path.rglob("*")) == before
    begun = run_hexad(build, "--config", file)
    assert told.returncode in (1, 2) and begun.returncode in (1, 2), (told, begun)
    for text in told.stdout + told.stderr, begun.stderr:
        assert message.format(root=tmp_path) in text, text
    assert "no faults" not in told.stdout


def test_a_start_that_creates_the_queue_says_so_once(new_service):
    service = new_service().start()
    assert service.log.read_text().count(f" info a new queue is created in {service.state}\n") == 1
    service.end()
    service.start()
    assert "new queue" not in service.log.read_text()


def test_a_check_of_settings_counts_its_warnings(build, tmp_path):
    file = tmp_path / "hexad.conf"
    for text, end in ("unix_users = alice bob", "; 1 warning"), ("unix_users = alice bob\nunix_groups = no-such", "; 2 warnings"):
        file.write_text(f"{text}\n")
        done = run_hexad(build, "--config", file, "--state_dir", tmp_path / "state", "--check-settings", "--strict")
        assert done.returncode == 0 and done.stdout == f"no faults in the settings of {file}{end}\n"
        assert re.search("warning: unix_users: .*alice bob.*; separate names by a colon or a comma\n", done.stderr), done.stderr


def test_a_check_of_settings_accepts_directories_that_a_start_creates(build, tmp_path):
    state = tmp_path / "deep/state"
    words = ("--state_dir", state, "--work_dir", tmp_path / "work", "--port_file", state / "port", "--listen", f"unix:{state}/socket")
    done = run_hexad(build, *words, "--check-settings", "--strict")
    assert done.returncode == 0 and "no faults" in done.stdout and not list(tmp_path.iterdir()), done
