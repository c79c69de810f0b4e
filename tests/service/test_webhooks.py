# SPDX-License-Identifier: Apache-2.0
"""Webhooks: who is told that a job has ended, how often, and that it is this service that says so."""
import base64
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import threading

import pytest

from receivers import SECRET, Receiver, hooked
from service import PATIENCE_S, gated_worker, sphere, wait_until

OLD_SECRET = "correct horse battery staple"  # any other text is the key itself


@pytest.fixture
def caller(new_service, receiver, secret):
    return new_service("--webhook_hosts", receiver.host, "--webhook_secret_file", secret,
                       "--webhook_retry_s", "0.01", "--webhook_retry_most_s", "0.05").start()


def told(job, state="succeeded", outcome="converged", name=None, labels=(), traceparent=None, delivery=None):
    return {"job": job, "state": state, "outcome": outcome, "name": name, "labels": list(labels),
            "traceparent": traceparent, "host": socket.gethostname(), "delivery": delivery}


def wait_delivered(service, job, number):
    wait_until(lambda: f"webhook delivered job={job} event={number}" in service.log.read_text(), "the delivery")


def test_the_end_of_a_job_is_told(caller, receiver):
    job = caller.submit(hooked(receiver))
    number, body = receiver.next()
    done = caller.wait_state(job, "succeeded")
    assert body == {"type": "job.ended", "timestamp": done["finished"], "data": told(job, outcome=done["outcome"])}
    assert done["spec"]["queue"]["webhook"] == receiver.url
    quiet = caller.submit(sphere())
    caller.wait_state(quiet, "succeeded")
    other = caller.submit(hooked(receiver))
    assert receiver.next()[1]["data"]["job"] == other
    assert "show=7" not in caller.log.read_text()  # addresses may hold secrets


def test_what_became_of_the_copy_of_a_result_is_told(new_service, receiver, secret, tmp_path):
    service = new_service("--webhook_hosts", receiver.host, "--webhook_secret_file", secret, "--worker",
                          gated_worker(tmp_path), "--output_roots", tmp_path, base=tmp_path).start()
    for name, state, code in (("good", "delivered", None), ("bad", "failed", "path_forbidden")):
        job = service.submit(hooked(receiver, output={"directory": f"{tmp_path}/{name}"}))
        service.wait_worker(job)
        if code:
            (tmp_path / name).write_text("no directory")
        service.open_gate(job)
        data = receiver.next()[1]["data"]
        assert data == told(job, delivery=service.job(job)["delivery"])
        assert (data["delivery"]["state"], data["delivery"]["code"]) == (state, code)


def test_the_check_in_the_guide(caller, receiver, source):
    page = {}
    blocks = re.findall(r"^```python\n(.*?)^```$", (source / "doc/guide.md").read_text(), re.M | re.S)
    exec(next(block for block in blocks if "is_genuine" in block), page)
    caller.submit(hooked(receiver))
    _, headers, body = receiver.calls.get(timeout=PATIENCE_S)
    assert page["is_genuine"](SECRET + "\n", headers, body)
    old = {**headers, "webhook-timestamp": str(int(headers["webhook-timestamp"]) - 3600)}
    for forged in ((headers, body + b" "), (old, body), ({**headers, "webhook-id": "x"}, body)):
        assert not page["is_genuine"](SECRET + "\n", *forged)


@pytest.mark.sanitized
def test_what_a_job_was_called_is_told(caller, receiver):
    trace = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"
    spec = sphere(name="ball of \u2603", queue={"webhook": receiver.url, "labels": ["show", "shot 7"]})
    reply = caller.request("POST", "/v1/jobs", json.dumps(spec),
                           {"Content-Type": "application/json", "traceparent": trace})
    data = receiver.next()[1]["data"]
    assert data == told(reply.json["id"], outcome=data["outcome"], name="ball of \u2603", labels=["show", "shot 7"],
                        traceparent=trace)


def test_the_document_describes_the_call(caller, receiver):
    jsonschema = pytest.importorskip("jsonschema", reason="no python3-jsonschema")
    document = caller.get("/v1/openapi.json").json
    schema = document["webhooks"]["jobEnded"]["post"]["requestBody"]["content"]["application/json"]["schema"]
    caller.submit(hooked(receiver))
    jsonschema.Draft202012Validator({**schema, "components": document["components"]}).validate(receiver.next()[1])


def test_no_two_queues_give_the_same_id(new_service, receiver, secret):
    options = ("--webhook_hosts", receiver.host, "--webhook_secret_file", secret)
    first, second = new_service(*options).start(), new_service(*options).start()
    ids = set()
    for service in (first, second):
        service.submit(hooked(receiver))
        ids.add(receiver.next()[0])
    first.end()
    shutil.rmtree(first.state)  # a new queue of the same service
    first.start().submit(hooked(receiver))
    ids.add(receiver.next()[0])
    assert len(ids) == 3


def test_a_secret_of_any_text_is_the_key(new_service, receiver, secret):
    """A secret without the prefix of Standard Webhooks. A library gets it as base64."""
    secret.write_text(OLD_SECRET + "\n")
    receiver.secret = "whsec_" + base64.b64encode(OLD_SECRET.encode()).decode()
    service = new_service("--webhook_hosts", receiver.host, "--webhook_secret_file", secret).start()
    job = service.submit(hooked(receiver))
    assert receiver.next()[1]["data"]["job"] == job


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
        assert f"the receiver answered with status {word}" in log


@pytest.mark.sanitized
def test_an_answer_counts_when_its_head_has_come(caller, receiver):
    receiver.answers.put((200, {"Content-Length": "100"}))
    job = caller.submit(hooked(receiver))
    number, _ = receiver.next()
    wait_delivered(caller, job, number)
    assert "webhook not delivered" not in caller.log.read_text() and receiver.calls.empty()


@pytest.mark.parametrize("status, after, bound, wait", [(503, "100", 1000, 100), (429, "100000", 2000, 2000), (500, "100", 1000, 1),
                                                        (503, "100", 0, 1), (429, "nonsense", 1000, 1)])
def test_a_receiver_says_when_to_try_again(new_service, receiver, secret, status, after, bound, wait):
    service = new_service("--webhook_hosts", receiver.host, "--webhook_secret_file", secret, "--webhook_retry_s", 1,
                          "--webhook_retry_after_s", bound).start()
    receiver.answers.put((status, {"Retry-After": after}))
    service.submit(hooked(receiver))
    receiver.next()
    log = wait_until(lambda: re.search(r"webhook not delivered .* next_s=(\S+):", service.log.read_text()), "the failure")
    assert float(log[1]) == wait


def test_a_receiver_that_is_gone_is_called_once(caller, receiver):
    receiver.answers.put(410)
    job = caller.submit(hooked(receiver))
    receiver.next()
    wait_until(lambda: f"webhook given up job={job}" in caller.log.read_text(), "the end of tries")
    other = caller.submit(hooked(receiver))  # a notification of its own
    assert receiver.next()[1]["data"]["job"] == other and receiver.calls.empty()


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


@pytest.mark.sanitized
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
    assert body["data"] == told(job, "cancelled", None)
    assert service.post(f"/v1/jobs/{job}/retry").status in (200, 202)
    service.open_gate(job)
    again, body = receiver.next()
    assert again != number and body["data"] == told(job)


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
    assert f"this service does not call {receiver.host}" in service.log.read_text() and receiver.calls.empty()


@pytest.mark.sanitized
def test_settings_that_miss_a_secret(build, receiver, tmp_path):
    words = [build / "hexad", "--state_dir", tmp_path / "state", "--webhook_hosts", receiver.host]
    missing = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE_S)
    assert missing.returncode == 2 and "webhook_hosts requires webhook_secret_file: set it" in missing.stderr
    nothing = subprocess.run([*words, "--webhook_secret_file", tmp_path / "none"], capture_output=True, text=True,
                             timeout=PATIENCE_S)
    assert nothing.returncode == 2 and "No such file" in nothing.stderr
    file = tmp_path / "secret"
    for text, mode, told_what in (("too short", 0o600, "at least 16"), (SECRET, 0o644, "chmod 640" if os.geteuid() == 0 else "chmod 600"),
                                  ("whsec_" + "A" * 30 + "*A", 0o600, "is not base64"),
                                  (SECRET[:-1], 0o600, "is not base64"),
                                  ("whsec_" + base64.b64encode(bytes(23)).decode(), 0o600, "24 to 64 bytes"),
                                  ("whsec_" + base64.b64encode(bytes(65)).decode(), 0o600, "24 to 64 bytes")):
        file.write_text(text)
        file.chmod(mode)
        done = subprocess.run([*words, "--webhook_secret_file", file], capture_output=True, text=True,
                              timeout=PATIENCE_S)
        assert done.returncode == 2 and told_what in done.stderr, done.stderr
