# SPDX-License-Identifier: Apache-2.0
"""hexadctl, as somebody at a shell or in a script meets it."""
import contextlib
import hashlib
import http.server
import json
import os
import pty
import re
import resource
import select
import shutil
import signal
import subprocess
import threading

import pytest

from service import PATIENCE_S, Service, long_sphere, sphere


@pytest.fixture
def service(clean_service):
    """One daemon for the tests of this file, without jobs of other tests."""
    return clean_service


@pytest.fixture
def run(service, build, tmp_path):
    def call(*words, **more):
        return subprocess.run([build / "hexadctl", *map(str, words)], capture_output=True, text=True,
                              timeout=PATIENCE_S, env=service.environment(), cwd=tmp_path, **more)
    return call


def write(tmp_path, spec):
    path = tmp_path / "spec.json"
    path.write_text(json.dumps(spec))
    return path


@contextlib.contextmanager
def canned(body):
    """The address of a server that gives this answer to all."""
    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body.encode())

        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def read_some(fd):
    """What has come, after a wait that ends."""
    ready, _, _ = select.select([fd], [], [], PATIENCE_S)
    assert ready, "waited in vain for output"
    return os.read(fd, 4096)


def test_submit_wait_fetch(run, tmp_path, service):
    job = run("submit", write(tmp_path, sphere()))
    assert job.returncode == 0
    job = job.stdout.strip()
    waited = run("wait", job)
    assert waited.returncode in (0, 10, 11) and waited.stdout.startswith(f"{job} succeeded")
    fetched = run("fetch", job, "--output", tmp_path / "out")
    assert fetched.returncode == 0, fetched.stderr
    listed = service.get(f"/v1/jobs/{job}/results").json["results"]
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == sorted(r["name"] for r in listed)
    for r in listed:
        assert hashlib.sha256((tmp_path / "out" / r["name"]).read_bytes()).hexdigest() == r["sha256"]
    assert run("fetch", job).returncode == 0  # into ./ID
    assert (tmp_path / job / "report.json").is_file()
    assert run("show", job).stdout.startswith(f"{job} succeeded")
    assert json.loads(run("show", job, "--json").stdout)["spec"]["version"] == 1
    assert job in run("list").stdout
    assert [j["id"] for j in json.loads(run("list", "--json", "--state", "succeeded").stdout)["jobs"]] == [job]


def test_fetch_refuses_a_directory_with_another_result(run, tmp_path, service):
    first, second = (service.submit(sphere(count=count, name=f"ball {count}")) for count in (200, 201))
    array = service.submit(sphere(queue={"frames": "1-2", "by_frame": {"/surface/analytic/radius": [1, 2]}}))
    for job in (first, second, array):
        service.wait_state(job, "succeeded")
    files = len(service.get(f"/v1/jobs/{first}/results").json["results"])
    done = run("fetch", first, "--output", "out")
    assert done.returncode == 0 and re.fullmatch(f"{first} ball 200, submitted [0-9.]+(ms|s|m) ago\n", done.stderr), done.stderr
    again = run("fetch", first, "--output", "out")
    assert again.returncode == 0 and again.stderr.endswith(f" ago\n{files} of {files} files were there already\n")
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    for other in (second, array):
        refused = run("fetch", other, "--output", "out")
        assert refused.returncode == 2 and "out has another result: name another directory with --output" in refused.stderr
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before
    assert run("fetch", array, "--output", "frames").returncode == 0
    others = service.submit(sphere(queue={"frames": "2-3", "by_frame": {"/surface/analytic/radius": [3, 4]}}))
    service.wait_state(others, "succeeded")
    there = {path: path.read_bytes() for path in (tmp_path / "frames").rglob("*") if path.is_file()}
    for other in (first, (others, "--frame", "3"), others):
        refused = run("fetch", *(other if isinstance(other, tuple) else [other]), "--output", "frames")
        assert refused.returncode == 2 and "frames has another result" in refused.stderr, refused.stderr
    assert {path: path.read_bytes() for path in (tmp_path / "frames").rglob("*") if path.is_file()} == there
    assert run("fetch", array, "--output", "part", "--frame", "1").returncode == 0
    assert run("fetch", array, "--output", "part", "--frame", "2").returncode == 0  # of the same job
    (tmp_path / "frames/2/report.json").write_bytes(before["report.json"])
    refused = run("fetch", array, "--output", "frames")
    assert refused.returncode == 2 and "frames/2 has another result" in refused.stderr
    assert run("fetch", second, "--output", "elsewhere").returncode == 0
    assert json.loads((tmp_path / "elsewhere/report.json").read_text())["count"] == 201


def test_a_fetch_by_name_writes_to_the_name(run, tmp_path, service):
    def submit(count, **parts):
        return run("submit", write(tmp_path, {**sphere(count=count), "name": "ball", **parts}), "--wait").stdout.split()[0]
    first = submit(200)
    assert run("fetch", "ball").returncode == 0 and (tmp_path / "ball" / "report.json").exists()
    again = run("fetch", "ball")
    assert again.returncode == 0 and "files were there already" in again.stderr and not (tmp_path / first).exists()
    (tmp_path / "ball" / "report.json").unlink()  # as of a fetch that was interrupted
    assert run("fetch", "ball").returncode == 0 and (tmp_path / "ball" / "report.json").exists() and not (tmp_path / first).exists()

    def interrupt(directory):
        """Leaves what a fetch does that is killed during its first file."""
        shutil.rmtree(directory)
        directory.mkdir()
        (directory / "points.ply.0123456789abcdef").write_bytes(b"ply")
    interrupt(tmp_path / "ball")
    assert run("fetch", "ball").returncode == 0 and (tmp_path / "ball" / "report.json").exists() and not (tmp_path / first).exists()
    assert run("delete", first).returncode == 0
    second = submit(201)
    before = (tmp_path / "ball" / "report.json").read_bytes()
    assert run("fetch", "ball").returncode == 0 and (tmp_path / second / "report.json").exists()
    assert (tmp_path / "ball" / "report.json").read_bytes() == before
    assert run("fetch", "latest").returncode == 0
    shutil.rmtree(tmp_path / "ball")
    shutil.rmtree(tmp_path / second)
    assert run("fetch", second).returncode == 0 and not (tmp_path / "ball").exists()
    assert run("delete", second).returncode == 0
    frames = submit(100, queue={"frames": "1-2", "by_frame": {"/surface/analytic/radius": [1, 2]}})
    for _ in range(2):
        assert run("fetch", "ball").returncode == 0 and not (tmp_path / frames).exists()
    assert (tmp_path / "ball" / "2" / "report.json").exists()
    shutil.rmtree(tmp_path / "ball" / "2")
    interrupt(tmp_path / "ball" / "1")
    assert run("fetch", "ball").returncode == 0 and (tmp_path / "ball" / "1" / "report.json").exists()
    (tmp_path / "ball" / "1" / "report.json").unlink()
    shutil.rmtree(tmp_path / "ball" / "2")
    assert run("fetch", "ball").returncode == 0 and (tmp_path / "ball" / "2" / "report.json").exists() and not (tmp_path / frames).exists()
    shutil.rmtree(tmp_path / "ball")
    (tmp_path / "ball").mkdir()
    (tmp_path / "ball" / "notes.txt").write_text("of the user")
    assert run("fetch", "ball").returncode == 0 and (tmp_path / frames / "1" / "report.json").exists()
    assert [path.name for path in (tmp_path / "ball").iterdir()] == ["notes.txt"]


def test_fetch_before_the_end_names_the_command_that_waits(run, service):
    job = service.submit(long_sphere())
    service.wait_worker(job)
    early = run("fetch", job)
    assert early.returncode == 4 and "has not ended: running" in early.stderr
    assert f"run hexadctl wait {job}\n" in early.stderr
    service.post(f"/v1/jobs/{job}/cancel")


@pytest.mark.sanitized
def test_a_submission_with_a_key_is_repeated_safely(run, tmp_path, service):
    path = write(tmp_path, sphere())
    first = run("submit", path, "--key", "shot 010")
    assert first.returncode == 0, first.stderr
    assert run("submit", path, "--key", "shot 010", "--wait").stdout.startswith(first.stdout.strip())
    assert len(service.get("/v1/jobs").json["jobs"]) == 1
    other = run("submit", path, "--key", "shot 010", "--priority", "1")
    assert other.returncode == 2 and f"for the job {first.stdout.strip()}" in other.stderr
    for key in ("", "a\nHost: b", "a" * 256):
        refused = run("submit", path, "--key", key)
        assert refused.returncode == 2 and "key" in refused.stderr.lower(), refused.stderr
    assert run("delete", first.stdout.strip()).returncode == 0  # and the key with it
    again = run("submit", path, "--key", "shot 010")
    assert again.returncode == 0 and again.stdout != first.stdout


@pytest.mark.sanitized
def test_tokens_name_their_file(run, tmp_path):
    done = run("token", "list", "--file", tmp_path / "tokens")
    assert done.returncode == 0 and f"{tmp_path}/tokens contains no tokens" in done.stderr
    done = run("token", "add", "alice", "--file", tmp_path / "nowhere" / "tokens")
    assert done.returncode == 2 and f"{tmp_path}/nowhere: No such file or directory" in done.stderr, done.stderr
    assert ("sudo" in done.stderr) == (os.geteuid() != 0)
    done = run("token", "add", "alice", "--file", tmp_path / "tokens")
    assert f"of alice was added to {tmp_path}/tokens;" in done.stderr
    assert not run("token", "list", "--file", tmp_path / "tokens").stderr
    done = run("token", "revoke", "0", "--file", tmp_path / "tokens")
    assert done.returncode == 4 and f"run hexadctl token list --file {tmp_path}/tokens for the IDs" in done.stderr


def test_submit_and_wait_from_standard_input(run):
    done = run("submit", "-", "--wait", "--json", input=json.dumps(sphere()))
    job = json.loads(done.stdout)
    assert job["state"] == "succeeded"
    assert done.returncode == {"converged": 0, "not_converged": 10, "unresolved": 11}[job["outcome"]]
    assert "\r" not in done.stderr  # no bar where there is no terminal


@pytest.mark.sanitized
def test_not_converged(run, tmp_path):
    spec = sphere(count=500, solver={"max_sweeps": 1, "step_tolerance": 1e-9})
    done = run("submit", write(tmp_path, spec), "--wait")
    assert done.returncode == 10 and "not_converged" in done.stdout


def test_unresolved(run, tmp_path):
    spec = {**sphere(count=500), "outcome": {"require": {"coverage": 0.1}}}
    done = run("submit", write(tmp_path, spec), "--wait")
    assert done.returncode == 11 and "unresolved" in done.stdout
    assert "outcome: coverage: the measure is " in done.stderr and " (outcome.require: at most 0.1). " in done.stderr


def test_notes_reach_who_waits_and_who_asks(new_service, build, tmp_path):
    """A thin plate with few points: what is said of it, and what to do, is told before the job, after it, and later."""
    service = new_service().start()

    def run(*words):
        return subprocess.run([build / "hexadctl", *map(str, words)], capture_output=True, text=True,
                              timeout=PATIENCE_S, env=service.environment())

    plate = {"analytic": {"shape": "box", "center": [0, 0, 0], "half_size": [1, 1, 0.04]}}
    spec = write(tmp_path, {"version": 1, "surface": plate, "features": True, "sampling": {"count": 100}, "output": {"preview": False}})
    before = run("estimate", spec)
    assert before.returncode == 0 and " % of the surface are walls thinner than 1.2 spacings" in before.stdout
    done = run("submit", spec, "--wait")
    assert done.returncode == 11, done.stderr
    job = service.get("/v1/jobs/" + done.stdout.split()[0]).json
    notes = job["notes"]
    count = notes["advice"][0]["set"]["/sampling/count"]
    (reason,) = notes["outcome_reasons"]
    assert "resolved_share" not in notes and reason["criterion"] == "close_share"
    assert ": set /sampling/count to " in before.stdout
    shown = run("show", job["id"]).stdout
    for told in (done.stderr, shown):
        assert f"outcome: {reason['message']}\n" in told and f" {100 * reason['value']:.3g} % " in reason["message"]
        assert f"warning: {notes['warnings'][0]}\n" in told and f"advice: {notes['advice'][0]['message']}\n" in told
    rated = notes["ratings"]["hex_fraction"]
    found = service.get(f"/v1/jobs/{job['id']}/results/report.json").json
    size = f"100 points, spacing {found['spacing']:.3g}\n"
    assert notes["count"] == found["count"] == 100 and notes["spacing"] == found["spacing"]
    assert f"  points    {size}" in shown and f"\n{size}" in "\n" + done.stderr
    packing = f"hex_fraction {rated['value']:.3g} {rated['rating']}, edge_cv "
    assert f"  packing   {packing}" in shown and f"packing: {packing}" in done.stderr
    spec = write(tmp_path, {**json.loads(open(spec).read()), "sampling": {"count": count}})
    assert run("estimate", spec).stdout.count("warning:") == 0
    done = run("submit", spec, "--wait")
    assert done.returncode == 0 and "advice" not in done.stderr, done.stderr
    assert service.get("/v1/jobs/" + done.stdout.split()[0]).json["notes"]["advice"] == []


@pytest.mark.sanitized
def test_a_bar_on_a_terminal(service, build, tmp_path):
    master, slave = pty.openpty()
    process = subprocess.Popen([build / "hexadctl", "submit", write(tmp_path, long_sphere()), "--wait"],
                               stdout=subprocess.PIPE, stderr=slave, env=service.environment())
    os.close(slave)
    seen = b""
    try:
        while b"\r\x1b[K[" not in seen or b"%" not in seen:
            seen += read_some(master)
        job = service.get("/v1/jobs").json["jobs"][0]["id"]
        service.post(f"/v1/jobs/{job}/cancel")
        process.wait(PATIENCE_S)
        assert process.returncode == 6
        assert b"cancelled" in process.stdout.read()
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        os.close(master)


def test_an_inspection_says_so_on_a_terminal(service, build, run):
    """The line is removed before the answer; elsewhere there is none."""
    master, slave = pty.openpty()
    done = subprocess.run([build / "hexadctl", "inspect", "none.obj"], stdout=subprocess.PIPE, stderr=slave, env=service.environment(), timeout=PATIENCE_S)
    os.close(slave)
    told = read_some(master)
    os.close(master)
    assert done.returncode != 0 and told.startswith(b"\r\x1b[Kinspecting none.obj: the service reads all of it\r\x1b[K"), told
    assert "inspecting" not in run("inspect", "none.obj").stderr


def test_cancel(run, tmp_path, service):
    job = run("submit", write(tmp_path, long_sphere())).stdout.strip()
    service.wait_worker(job)
    assert run("cancel", job).returncode == 0
    waited = run("wait", job)
    assert waited.returncode == 6 and "cancelled" in waited.stdout
    assert run("cancel", job).returncode == 4
    assert run("fetch", job).returncode == 4


def test_a_job_that_fails(run, tmp_path):
    done = run("submit", write(tmp_path, long_sphere(limits={"timeout_s": 0.3})), "--wait")
    assert done.returncode == 1 and "timed_out" in done.stdout and "limit_time" in done.stdout


@pytest.mark.sanitized
def test_a_retry_with_dependents(run, tmp_path, service):
    """As long as the first one fails, all fail."""
    first = service.submit(long_sphere(limits={"timeout_s": 0.1}))
    service.wait_state(first, "failed", "timed_out")
    second = service.submit(sphere(queue={"depends_on": [first]}))
    third = service.submit(sphere(queue={"depends_on": [second]}))
    assert service.job(third)["error"]["code"] == "dependency_failed"
    assert f"depends on {second}" in run("show", third).stdout
    alone = run("retry", third)
    assert alone.returncode == 4 and "--dependents" in alone.stderr
    done = run("retry", first, "--dependents")
    assert done.returncode == 0 and "2 dependent jobs retried" in done.stdout, done
    service.wait_state(third, "failed")
    assert service.job(third)["revision"] > 3
    assert run("retry", first, "--dependents", "--json").stdout.count('"dependents"') == 1
    assert run("pause", first, "--dependents").returncode == 2


def test_a_bad_spec_names_the_place(run, tmp_path):
    done = run("submit", write(tmp_path, sphere(count=-5)))
    assert done.returncode == 2
    assert "/sampling/count" in done.stderr
    assert run("submit", tmp_path / "missing.json").returncode == 2
    (tmp_path / "bad.json").write_text("{")
    assert run("submit", tmp_path / "bad.json").returncode == 2


@pytest.mark.sanitized
def test_a_spec_is_sent_as_it_is(run, tmp_path, service):
    text = json.dumps(sphere()) + "\0more"
    (tmp_path / "nul.json").write_text(text)
    assert run("submit", tmp_path / "nul.json").returncode == 2
    assert run("submit", "-", input=text).returncode == 2
    assert service.get("/v1/jobs").json["jobs"] == []


def test_an_input_that_cannot_be_read(run, tmp_path):
    with open("/proc/self/mem", "rb") as unreadable:  # its first page is nobody's
        done = run("submit", "-", stdin=unreadable)
    assert done.returncode == 2 and "standard input" in done.stderr, done.stderr
    with open(tmp_path / "large", "wb+") as large:  # zeros, which the client reads as it reads a pipe
        large.truncate((64 << 20) + 1)
        done = run("submit", "-", stdin=large)
    assert done.returncode == 2 and "67108864 bytes" in done.stderr, done.stderr


@pytest.mark.sanitized
def test_a_full_local_disk_is_not_the_servers_fault(run, tmp_path, service):
    job = service.submit(sphere())
    service.wait_state(job, "succeeded")

    def no_room():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))

    done = run("fetch", job, "--output", tmp_path / "out", preexec_fn=no_room)
    assert done.returncode == 1 and "cannot be written" in done.stderr, done.stderr


def test_a_state_is_one_word_of_the_query(run):
    assert run("list", "--state", "queued&limit=1").returncode == 2
    assert run("list", "--limit", "1&state=queued").returncode == 2
    assert run("list", "--state", "queued", "--limit", "1").returncode == 0
    assert run("list", "--limit", "1").returncode == 0


@pytest.mark.sanitized
def test_usage(run):
    for words in ([], ["nonsense"], ["show"], ["show", "a", "b"], ["list", "a"], ["show", "--nonsense", "a"],
                  ["--server", "ftp://x", "list"], ["list", "--state", "nonsense"], ["help", "nonsense"]):
        assert run(*words).returncode == 2, words
    for words, text in (
        (["show", "--nonsense", "a"], "unknown option --nonsense; see hexadctl --help"),
        (["show", "-json", "a"], "unknown option -json; did you mean --json?"),
        (["show", "-j", "a"], "unknown option -j; see"),
        (["submit", "--label"], "--label requires a value; see hexadctl --help"),
        (["submit", "--wiat", "a"], "did you mean --wait?"),
        (["submit", "--f", "a"], "unknown option --f"),
        (["submit", "--wait=1", "a"], "--wait takes no value"),
        (["list", "--wait"], "hexadctl list: this command has no option --wait"),
        (["--hlep"], "did you mean --help?"),
    ):
        done = run(*words)
        assert done.returncode == 2 and text in done.stderr, (words, done.stderr)
    for word in ("01aaaaaaaaaaaaaaaaaaaaaaaa", "../../etc", ""):
        assert run("show", word).returncode == 4
    text = run("--help", "all")
    assert text.returncode == 0 and "Exit status" in text.stdout
    assert run("help", "all").stdout == text.stdout
    assert run("help").stdout == run("--help").stdout
    assert run("--version").stdout.startswith("hexadctl ")


def test_help_of_a_command_is_about_this_command(run):
    text = run("--help", "all").stdout
    commands = re.findall(r"^  ([a-z][a-z-]*) ", text, re.M)
    assert len(commands) >= 30
    for command in set(commands) - {"help"}:
        done = run("help", command)
        assert done.returncode == 0 and run(command, "--help").stdout == done.stdout
        parts = re.findall(r"^  ([a-z][a-z-]*) ", done.stdout, re.M)
        assert parts and all(command == part for part in parts), done.stdout
        assert all(line in text.splitlines() for line in done.stdout.splitlines()[2:-2])
    assert run("help", "token", "add").stdout.count("token") < run("help", "token").stdout.count("token")
    unknown = run("help", "sumbit")
    assert unknown.returncode == 2 and "did you mean submit?" in unknown.stderr


def test_options_of_submit_change_the_spec(run, tmp_path, service):
    first = run("submit", write(tmp_path, sphere(name="first"))).stdout.strip()
    path = write(tmp_path, sphere(name="old", queue={"labels": ["a"]}))
    radii = "/queue/by_frame={\"/surface/analytic/radius\": [1, 2, 3]}"
    done = run("submit", path, "--set", radii, "--name", "shot 010", "--frames", "1-3", "--depends-on", "first", "--depends-on", first[:20],
               "--label", "b", "--set", "/sampling/count=150", "--set", "/output/mesh=true", "--set", "/queue/max_running=1")
    assert done.returncode == 0, done.stderr
    spec = service.job(done.stdout.strip())["spec"]
    assert spec["name"] == "shot 010" and spec["sampling"]["count"] == 150 and spec["output"]["mesh"] is True
    assert {key: spec["queue"][key] for key in ("frames", "labels", "depends_on", "max_running")} == {
        "frames": "1-3", "labels": ["a", "b"], "depends_on": [first, first], "max_running": 1}
    for words, told, code in ((("--set", "count=5"), "must be /MEMBER=VALUE", 2), (("--set", "/sampling/cuont=5"), "/sampling/cuont", 2),
                              (("--depends-on", "no such job"), "has no job no such job", 4)):
        done = run("submit", path, *words)
        assert done.returncode == code and told in done.stderr and not done.stdout, done.stderr


def test_a_job_without_a_name_has_the_name_of_its_input_in_lists(new_service, example, build):
    service = new_service("--input_roots", example.parent).start()
    surface = {"vdb": {"path": str(example)}}
    jobs = {service.submit(sphere(surface=surface)): example.name, service.submit(sphere(surface=surface, name="own")): "own",
            service.submit(sphere(surface={"union": [{"analytic": {"shape": "sphere", "radius": 1}}, surface]})): example.name,
            service.submit(sphere()): "-"}
    done = subprocess.run([build / "hexadctl", "list"], capture_output=True, text=True, timeout=PATIENCE_S, env=service.environment())
    assert {line.split()[0]: line.split()[-1] for line in done.stdout.splitlines()[1:]} == jobs
    for job, name in jobs.items():
        document = service.job(job)
        assert document["input"] == (None if name in ("own", "-") else name) and document["name"] == ("own" if name == "own" else None)


@pytest.mark.sanitized
@pytest.mark.parametrize("server, said", [("http://127.0.0.1:1", "Connection refused"),
                                          ("unix:/nowhere/hexad.sock", "No such file or directory")])
def test_no_server(build, server, said):
    done = subprocess.run([build / "hexadctl", "--server", server, "list"], capture_output=True, text=True,
                          timeout=PATIENCE_S)
    assert done.returncode == 3 and f"{server}: cannot connect ({said})" in done.stderr and "--server" in done.stderr


def test_a_wait_outlives_a_restart(new_service, build):
    service = new_service("--workers", 1)
    where = service.base / "s.sock"  # keeps its name over the restart
    service.options[service.options.index("--listen") + 1] = f"unix:{where}"
    service.start()
    process = subprocess.Popen([build / "hexadctl", "--server", f"unix:{where}", "submit", "-", "--wait"],
                               stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        process.stdin.write(json.dumps(sphere(count=2000)))
        process.stdin.close()
        process.stdin = None
        said = b""
        while b"\n" not in said:
            said += read_some(process.stderr.fileno())
        assert said.startswith(b"job ")  # accepted: from here it waits
        service.end(signal.SIGKILL)
        service.start()
        out, _ = process.communicate(timeout=PATIENCE_S)
        assert process.returncode in (0, 10, 11) and "succeeded" in out
    finally:
        process.kill()
        process.wait()


# ---- the names of jobs

@pytest.fixture(scope="module")
def own_service(build, tmp_path_factory):
    """A daemon whose callers are users: the test's own, as `service`, and those of tokens."""
    made = Service(build, tmp_path_factory.mktemp("own"))
    tokens = made.base / "tokens"
    made.tokens = {user: subprocess.run([build / "hexadctl", "token", "add", user, "--file", tokens], check=True, text=True,
                                        capture_output=True).stdout.strip() for user in ("alice", "bob")}
    yield made.start("--token_file", tokens)
    made.clean_up()


@pytest.fixture
def as_user(own_service, build, tmp_path):
    def call(user, *words):
        return subprocess.run([build / "hexadctl", *map(str, words)], capture_output=True, text=True, timeout=PATIENCE_S,
                              env={**own_service.environment(), "HEXAD_TOKEN": own_service.tokens[user]}, cwd=tmp_path)
    return call


def test_prefixes_and_latest_name_jobs_of_the_caller(as_user, tmp_path):
    held = write(tmp_path, sphere(name="one"))
    first = as_user("alice", "submit", held).stdout.strip()
    other = as_user("bob", "submit", held).stdout.strip()
    assert as_user("alice", "show", "latest").stdout.startswith(first)
    assert as_user("bob", "show", "latest").stdout.startswith(other)
    assert as_user("alice", "show", first[:20]).stdout.startswith(first)
    refused = as_user("alice", "show", other[:20])  # a job of bob's
    assert refused.returncode == 4 and f"the user alice has no job {other[:20]}" in refused.stderr
    assert '"hexadctl list --name NAME" prints the IDs of the jobs of all users' in refused.stderr
    assert as_user("alice", "show", other).returncode == 0  # its whole id names it
    refused = as_user("alice", "show", first[:7])
    assert refused.returncode == 4 and "first 8 characters" in refused.stderr


def test_a_prefix_of_several_jobs_lists_them(as_user, own_service):
    """The 8 characters are the time in units of 1024 ms: of three jobs in a second two share them."""
    headers = {"Content-Type": "application/json", "Authorization": f"Bearer {own_service.tokens['alice']}"}
    spec = json.dumps(sphere(name="two"))
    ids = [own_service.request("POST", "/v1/jobs", spec, headers).json["id"] for _ in range(3)]
    prefix = ids[1][:8]
    matches = [job for job in ids if job.startswith(prefix)]
    assert len(matches) >= 2
    done = as_user("alice", "show", prefix)
    assert done.returncode == 2 and not done.stdout
    assert all((job in done.stderr) == (job in matches) for job in ids) and "two" in done.stderr, done.stderr


def test_names_name_jobs_of_the_caller(as_user, tmp_path):
    named = {user: as_user(user, "submit", write(tmp_path, sphere(name="shot 020"))).stdout.strip() for user in ("alice", "bob")}
    for user, job in named.items():
        assert as_user(user, "wait", "shot 020").stdout.startswith(job)
        assert as_user(user, "show", "shot 020").stdout.startswith(job)
    assert as_user("alice", "show", "shot").returncode == 4  # the whole name
    other = as_user("alice", "submit", write(tmp_path, sphere(name=named["alice"][:20]))).stdout.strip()
    assert as_user("alice", "show", named["alice"][:20]).stdout.startswith(named["alice"])  # IDs come before names
    assert as_user("alice", "show", other).stdout.startswith(other)
    second = as_user("alice", "submit", write(tmp_path, sphere(name="shot 020"))).stdout.strip()
    refused = as_user("alice", "show", "shot 020")
    assert refused.returncode == 2 and "shot 020 is the name of 2 jobs: give an ID" in refused.stderr
    assert named["alice"] in refused.stderr and second in refused.stderr and named["bob"] not in refused.stderr


def test_cancel_and_delete_take_short_names_with_yes_only(as_user, tmp_path):
    job = as_user("alice", "submit", write(tmp_path, sphere(name="only one"))).stdout.strip()
    for command in ("cancel", "delete"):
        for name in ("latest", job[:20], "only one"):
            done = as_user("alice", command, name)
            assert done.returncode == 2 and job in done.stderr and "--yes" in done.stderr, done.stderr
    assert as_user("alice", "wait", "latest").returncode in (0, 10, 11)
    assert as_user("alice", "delete", "latest", "--yes").returncode == 0
    assert as_user("alice", "show", job).returncode == 4
    assert as_user("alice", "show", "latest", "--yes").returncode == 2  # it does not belong to this command


def test_several_jobs_are_deleted_or_cancelled_in_one_call(as_user, tmp_path):
    spec = write(tmp_path, sphere())
    jobs = [as_user("alice", "submit", spec, "--wait").stdout.split()[0] for _ in range(2)]
    missing = "01aaaaaaaaaaaaaaaaaaaaaaaa"
    done = as_user("alice", "cancel", *jobs)
    assert done.returncode == 4 and all(job in done.stderr for job in jobs)  # both have ended
    done = as_user("alice", "retry", *jobs)
    assert done.returncode == 4 and all(job in done.stderr for job in jobs)  # and succeeded
    done = as_user("alice", "delete", jobs[0], missing, jobs[1])
    assert done.returncode == 4 and missing in done.stderr
    assert done.stdout.splitlines() == [f"{job} deleted" for job in (jobs[0], jobs[1])]
    assert all(as_user("alice", "show", job).returncode == 4 for job in jobs)
    assert as_user("alice", "show", *jobs).returncode == 2


def test_wait_takes_several_jobs_and_ends_with_the_code_of_the_worst(run, tmp_path):
    good, unresolved = (run("submit", write(tmp_path, spec)).stdout.strip() for spec in (
        sphere(), sphere(outcome={"require": {"hex_fraction": 1}})))
    first, second = (run("wait", job) for job in (good, unresolved))
    assert (first.returncode, second.returncode) == (0, 11)
    for jobs in ((good, unresolved), (unresolved, good)):
        done = run("wait", *jobs)
        assert done.returncode == 11 and [line.split()[0] for line in done.stdout.splitlines()] == list(jobs)
    assert run("wait", unresolved, "01aaaaaaaaaaaaaaaaaaaaaaaa", good).returncode == 4


def test_wait_says_why_a_job_is_queued(new_service, build, tmp_path):
    service = new_service("--listen", f"unix:{tmp_path / 'socket'}").start()  # where the service's own user is an administrator
    assert service.request("POST", "/v1/admin/hold").status == 200
    job = service.submit(sphere(100))
    with subprocess.Popen([build / "hexadctl", "wait", job], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                          env=service.environment()) as process:
        deadline = threading.Timer(PATIENCE_S, process.kill)
        deadline.start()
        lines = iter(process.stderr.readline, "")
        told = next((line for line in lines if line.startswith("held: ")), None)  # before the release
        deadline.cancel()
        assert service.request("POST", "/v1/admin/release").status == 200
        rest = process.communicate(timeout=PATIENCE_S)
    assert told == 'held: jobs are accepted, and none starts until "hexadctl release"\n'
    assert process.returncode == 0 and "held: " not in rest[1]


def test_progress_of_several_jobs_names_the_job(clean_gated, build):
    first, second = clean_gated.submit(sphere(name="shot 010")), clean_gated.submit(sphere())
    clean_gated.wait_worker(first)
    with subprocess.Popen([build / "hexadctl", "wait", first, second], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL,
                          env=clean_gated.environment(), text=True) as waiting:
        assert waiting.stderr.readline() == f"{first} (shot 010): running: relax\n"
        clean_gated.open_gate(first)
        assert waiting.stderr.readline() == f"{first}: 7 points\n"
        assert waiting.stderr.readline().startswith(f"{second}: ")
        clean_gated.open_gate(second)
        waiting.communicate(timeout=PATIENCE_S)
    assert waiting.returncode == 0


def test_a_cancelled_job_is_called_so_once(clean_gated, build):
    job = clean_gated.submit(sphere())
    clean_gated.wait_state(job, "running")
    done = subprocess.run([build / "hexadctl", "cancel", job], capture_output=True, text=True, timeout=PATIENCE_S, env=clean_gated.environment())
    assert done.returncode == 0, done.stderr
    done = subprocess.run([build / "hexadctl", "wait", job], capture_output=True, text=True, timeout=PATIENCE_S, env=clean_gated.environment())
    assert done.returncode == 6 and done.stdout.startswith(f"{job} cancelled: "), done.stdout
    for words in (("fetch", job), ("retry", job)):  # what the first one names is the second one
        done = subprocess.run([build / "hexadctl", *words], capture_output=True, text=True, timeout=PATIENCE_S, env=clean_gated.environment())
        assert words[0] == "retry" or (done.returncode == 4 and f"hexadctl retry {job}" in done.stderr), done.stderr
    assert done.returncode == 0, done.stderr


def test_a_list_has_the_jobs_with_a_text_in_their_name(run, tmp_path):
    named = {name: run("submit", write(tmp_path, sphere(name=name))).stdout.strip() for name in ("Shot 010", "other")}
    done = run("list", "--text", "shot")
    assert done.returncode == 0 and named["Shot 010"] in done.stdout and named["other"] not in done.stdout


def test_a_job_shows_what_it_depends_on_and_what_depends_on_it(as_user, own_service, tmp_path):
    first = as_user("alice", "submit", write(tmp_path, long_sphere())).stdout.strip()
    second = as_user("alice", "submit", write(tmp_path, sphere(queue={"depends_on": [first]}))).stdout.strip()
    third = as_user("alice", "submit", write(tmp_path, sphere(queue={"after": [first]}))).stdout.strip()
    foreign = as_user("bob", "submit", write(tmp_path, sphere(queue={"after": [first]}))).stdout.strip()
    shown = as_user("alice", "show", first).stdout
    assert f"  needed by {third} blocked, {second} blocked\n" in shown and foreign not in shown
    shown = as_user("alice", "show", second).stdout
    assert f"  depends on{first}\n" in shown.replace("depends on ", "depends on") and "needed by" not in shown
    assert foreign in as_user("bob", "show", first).stdout  # bob sees his own
    headers = {"Authorization": f"Bearer {own_service.tokens['bob']}"}
    asked = own_service.request("GET", f"/v1/jobs?depends_on={first}&owner=alice", headers=headers)
    assert asked.status == 403
    found = own_service.request("GET", f"/v1/jobs?depends_on={first}&sort=name&state=blocked", headers=headers).json["jobs"]
    assert [job["id"] for job in found] == [foreign]
    assert as_user("alice", "cancel", first, third).returncode == 0


def test_a_service_without_tls_is_named(own_service, build):
    server = f"https://{own_service.address}"
    done = subprocess.run([build / "hexadctl", "--server", server, "list"], capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 3 and f"this port does not use TLS: write http://{own_service.address}" in done.stderr


@pytest.mark.parametrize("started, finished, waited, took", [
    ("00.080", "00.350", "80ms", "270ms"), ("01.000", "01.999", "1.0s", "999ms"), ("09.990", "11.940", "9.9s", "1.9s"),
    ("10.000", "59.999", "10s", "49s")])
def test_times_below_a_second_are_shown(build, started, finished, waited, took):
    """Of a service that says when a job ran. Below 10 s, a time has a digit behind the point."""
    attempt = {"number": 1, "started": f"2026-01-31T18:00:{started}Z", "finished": f"2026-01-31T18:00:{finished}Z",
               "waited_ms": round(float(started) * 1000)}
    job = {"id": "06faddpyxsd3g6zk16mtd9v23g", "state": "succeeded", "created": "2026-01-31T18:00:00.000Z", "attempt": 1,
           "started": attempt["started"], "finished": attempt["finished"], "attempts": [attempt]}
    with canned(json.dumps(job)) as address:
        done = subprocess.run([build / "hexadctl", "--server", address, "show", job["id"]], capture_output=True, text=True,
                              timeout=PATIENCE_S)
    assert f"(waited {waited})" in done.stdout and f"(took {took})" in done.stdout, done
    row = done.stdout.splitlines()[-1].split()
    assert row[3:5] == [took, waited], row


def test_what_names_no_job_is_answered_with_the_forms_of_a_name(as_user):
    for command in ("show", "cancel"):
        for word in ("lat", "LATEST", "latestt", "01m8gncw8sdja3jftxre567t467", "a/b?c"):
            done = as_user("alice", command, word)
            assert done.returncode == 4 and "26 characters" in done.stderr and "8 characters or more" in done.stderr, done.stderr
    assert all("did you mean latest?" in as_user("alice", "show", word).stderr for word in ("LATEST", "latestt", "lates"))
    assert "did you mean" not in as_user("alice", "show", "trefoil").stderr


def test_spec_help_of_a_member(build):
    def spec_help(*words):
        return subprocess.run([build / "hexad-worker", "spec-help", *words], capture_output=True, text=True, timeout=PATIENCE_S)
    assert "(null)" not in spec_help("all").stdout
    assert re.search(r"\n\d+ of \d+ members\. hexad-worker spec-help all prints every one, ", spec_help().stdout)
    done = spec_help("sampling/count")
    assert done.returncode == 0 and done.stdout.startswith("/sampling/count (integer") and done.stdout.count("\n/") == 0
    for word, told in (("nonsense", ": run hexad-worker spec-help all for all members"), ("conut", "; did you mean count?")):
        done = spec_help(word)
        assert done.returncode == 2 and not done.stdout
        assert done.stderr == f"hexad-worker: unknown member {word}{told}\n"


@pytest.mark.parametrize("command", ["upload", "sample"])
def test_a_fifo_is_not_a_file_that_can_be_sent(run, tmp_path, command):
    """No process writes into it, so that an open of it would wait."""
    os.mkfifo(tmp_path / "pipe.obj")
    done = run(command, "pipe.obj")
    assert done.returncode == 2 and "pipe.obj is not a regular file: give the path of a file" in done.stderr, done.stderr
