"""Webhooks: who is told that a job has ended, how often, and that it is this service that says so."""
import base64
import hashlib
import hmac
import http.server
import json
import queue
import signal
import subprocess
import threading
import time

import pytest

from service import PATIENCE_S, gated_worker, sphere, wait_until

SECRET = "correct horse battery staple"


class Receiver:
    """An HTTP server on loopback that answers with the next of `answers`, and 204 when there is none."""

    def __init__(self):
        self.calls, self.answers = queue.Queue(), queue.Queue()
        receiver = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self):
                body = self.rfile.read(int(self.headers["Content-Length"]))
                receiver.calls.put((self.path, dict(self.headers), body))
                try:
                    answer = receiver.answers.get_nowait()
                except queue.Empty:
                    answer = 204
                if callable(answer):
                    answer = answer()
                self.send_response(answer)
                if answer // 100 == 3:
                    self.send_header("Location", "/elsewhere")
                self.send_header("Content-Length", "0")
                self.end_headers()

            do_GET = do_POST

            def log_message(self, *words):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.host = f"127.0.0.1:{self.server.server_address[1]}"
        self.url = f"http://{self.host}/done?show=7"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def next(self):
        """The next call, after a look at whether it is genuine."""
        path, headers, body = self.calls.get(timeout=PATIENCE_S)
        assert path == "/done?show=7" and headers["Content-Type"] == "application/json"
        signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.{body.decode()}".encode()
        digest = hmac.new(SECRET.encode(), signed, hashlib.sha256).digest()
        assert headers["webhook-signature"] == "v1," + base64.b64encode(digest).decode()
        assert abs(time.time() - int(headers["webhook-timestamp"])) < PATIENCE_S
        return headers["webhook-id"], json.loads(body)


@pytest.fixture
def receiver():
    made = Receiver()
    yield made
    made.server.shutdown()
    made.server.server_close()


@pytest.fixture
def secret(tmp_path):
    path = tmp_path / "secret"
    path.write_text(SECRET + "\n")
    path.chmod(0o600)
    return path


@pytest.fixture
def caller(new_service, receiver, secret):
    return new_service("--webhook_hosts", receiver.host, "--webhook_secret_file", secret,
                       "--webhook_retry_s", "0.01", "--webhook_retry_most_s", "0.05").start()


def told(job, state="succeeded", outcome="converged"):
    return {"type": "job.ended", "data": {"job": job, "state": state, "outcome": outcome}}


def hooked(receiver, **parts):
    return sphere(queue={"webhook": receiver.url}, **parts)


def wait_delivered(service, job, number):
    wait_until(lambda: f"webhook delivered job={job} event={number}" in service.log.read_text(), "the delivery")


def test_the_end_of_a_job_is_told(caller, receiver):
    job = caller.submit(hooked(receiver))
    number, body = receiver.next()
    done = caller.wait_state(job, "succeeded")
    assert body == told(job, outcome=done["outcome"])
    assert done["spec"]["queue"]["webhook"] == receiver.url
    quiet = caller.submit(sphere())
    caller.wait_state(quiet, "succeeded")
    other = caller.submit(hooked(receiver))
    assert receiver.next()[1]["data"]["job"] == other
    assert "show=7" not in caller.log.read_text()  # addresses may hold secrets


def test_refusals_are_tried_again(caller, receiver):
    for answer in (500, 302, 404, 503):
        receiver.answers.put(answer)
    job = caller.submit(hooked(receiver))
    calls = [receiver.next() for _ in range(5)]
    assert all(c == calls[0] for c in calls) and calls[0][1]["data"]["job"] == job
    wait_delivered(caller, job, calls[0][0])
    assert receiver.calls.empty()  # nor was the redirect followed
    log = caller.log.read_text()
    for word in ("500", "302", "404", "503"):
        assert f"the answer was {word}" in log


def test_tries_are_bounded(new_service, receiver, secret):
    service = new_service("--webhook_hosts", receiver.host, "--webhook_secret_file", secret, "--webhook_tries", "3",
                          "--webhook_retry_s", "0.01").start()
    for _ in range(3):
        receiver.answers.put(500)
    first = service.submit(hooked(receiver))
    assert [receiver.next()[1]["data"]["job"] for _ in range(3)] == [first] * 3
    wait_until(lambda: "webhook given up" in service.log.read_text(), "the end of tries")
    second = service.submit(hooked(receiver))
    assert receiver.next()[1]["data"]["job"] == second


@pytest.mark.parametrize("number", (signal.SIGKILL, signal.SIGTERM))
def test_a_daemon_that_ends_between_tells_again(caller, receiver, number):
    """It ends while the receiver thinks; the next one tells it, under the same number."""
    release = threading.Event()

    def think():
        release.wait(PATIENCE_S)
        return 500

    receiver.answers.put(think)
    job = caller.submit(hooked(receiver))
    first = receiver.next()
    caller.end(number)
    release.set()
    caller.start()
    assert receiver.next() == first and first[1]["data"]["job"] == job
    wait_delivered(caller, job, first[0])
    caller.end()
    caller.start()
    another = caller.submit(hooked(receiver))
    again = receiver.next()
    assert again[1]["data"]["job"] == another and again[0] != first[0]


def test_each_end_of_a_job_is_told(new_service, receiver, secret, tmp_path):
    service = new_service("--webhook_hosts", receiver.host, "--webhook_secret_file", secret, "--worker",
                          gated_worker(tmp_path)).start()
    job = service.submit(hooked(receiver))
    service.wait_worker(job)
    assert service.post(f"/v1/jobs/{job}/cancel").status in (200, 202)
    number, body = receiver.next()
    assert body == told(job, "cancelled", None)
    assert service.post(f"/v1/jobs/{job}/retry").status in (200, 202)
    service.open_gate(job)
    assert receiver.next() == (str(int(number) + 1), told(job))


def test_hosts_that_are_not_listed_are_refused(new_service, caller, receiver):
    port = receiver.host.rpartition(":")[2]
    for url in (f"http://localhost:{port}/", "http://127.0.0.1/", "http://169.254.169.254/", "file:///etc/passwd",
                f"http://{receiver.host}@example.com/", f"http://me@{receiver.host}/", "nonsense"):
        for path in ("/v1/jobs", "/v1/jobs:validate"):
            refused = caller.post(path, sphere(queue={"webhook": url}))
            assert refused.status == 422, url
            assert refused.json["errors"][0]["pointer"] == "/queue/webhook"
    off = new_service().start()
    refused = off.post("/v1/jobs", hooked(receiver))
    assert refused.status == 422 and "webhook_hosts" in refused.json["detail"]
    assert receiver.calls.empty()


def test_a_host_that_does_not_answer_holds_up_no_other(new_service, receiver, secret):
    silent, release = Receiver(), threading.Event()
    silent.answers.put(lambda: release.wait(PATIENCE_S) and 204)
    service = new_service("--webhook_hosts", receiver.host, "--webhook_hosts", silent.host, "--webhook_secret_file",
                          secret, "--webhook_timeout_s", "3600").start()
    stuck = [service.submit(hooked(silent)) for _ in range(2)]
    assert silent.next()[1]["data"]["job"] in stuck
    for job in stuck:
        service.wait_state(job, "succeeded")
    job = service.submit(hooked(receiver))
    assert receiver.next()[1]["data"]["job"] == job
    assert silent.calls.empty()  # one call at a time to one host
    release.set()
    silent.next()
    silent.server.shutdown()
    silent.server.server_close()


def test_a_host_that_is_listed_no_more_is_not_called(new_service, receiver, secret):
    service = new_service("--webhook_secret_file", secret, "--webhook_retry_s", "0.01", "--webhook_tries", "2")
    service.start("--webhook_hosts", receiver.host)
    release = threading.Event()
    receiver.answers.put(lambda: release.wait(PATIENCE_S) and 500)
    service.submit(hooked(receiver))
    receiver.next()
    service.end(signal.SIGKILL)
    release.set()
    service.start("--webhook_hosts", "other.example")
    wait_until(lambda: "webhook given up" in service.log.read_text(), "the end of tries")
    assert f"the service does not call {receiver.host}" in service.log.read_text() and receiver.calls.empty()


def test_settings_that_miss_a_secret(build, receiver, tmp_path):
    words = [build / "hexad", "--state_dir", tmp_path / "state", "--webhook_hosts", receiver.host]
    short, open_file = tmp_path / "short", tmp_path / "open"
    short.write_text("too short")
    short.chmod(0o600)
    open_file.write_text(SECRET)
    open_file.chmod(0o644)
    for more, told_what in (([], "is not set"), (["--webhook_secret_file", tmp_path / "none"], "No such file"),
                            (["--webhook_secret_file", short], "at least 16"),
                            (["--webhook_secret_file", open_file], "chmod 600")):
        done = subprocess.run([*words, *more], capture_output=True, text=True, timeout=PATIENCE_S)
        assert done.returncode == 2 and told_what in done.stderr, done.stderr
