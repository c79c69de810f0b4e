# SPDX-License-Identifier: Apache-2.0
"""A wall clock that is set while the daemon runs, and while it does not."""
import hashlib
import json

from receivers import hooked
from service import sphere, wait_until
from sessions import ask, cookie_of, sign_in

HOUR, DAY = 3600, 86400


def test_a_clock_that_is_set_back_delays_no_webhook(new_service, receiver, secret, clock):
    service = new_service("--webhook_hosts", receiver.host, "--webhook_secret_file", secret, "--webhook_retry_s", 0.3)
    service.clock = clock
    service.start()
    receiver.answers.put(500)
    job = service.submit(hooked(receiver))
    receiver.calls.get()
    wait_until(lambda: f"webhook not delivered job={job}" in service.log.read_text(), "the failure")
    clock.step(-5 * HOUR)
    service.submit(sphere())  # something happens
    assert receiver.calls.get(timeout=60)
    wait_until(lambda: f"webhook delivered job={job}" in service.log.read_text(), "the delivery")


def test_a_clock_that_is_set_forward_ends_nothing(with_tokens, clock):
    service = with_tokens
    service.end()
    service.clock = clock
    service.start()
    data = b"solid x\nendsolid x\n"
    sent = f"/v1/inputs/{hashlib.sha256(data).hexdigest()}"
    bearer = {"Authorization": service.token, "Content-Type": "application/json"}
    done = ask(service, "PUT", sent, data, Authorization=service.token)
    assert done.status == 201, done.body
    cookie = cookie_of(sign_in(service, service.token))

    def end(retention_s):
        reply = ask(service, "POST", "/v1/jobs", json.dumps(sphere(queue={"retention_s": retention_s})), **bearer)
        assert reply.status == 201, reply.body
        wait_until(lambda: ask(service, "GET", f"/v1/jobs/{reply.json['id']}", **bearer).json["finished"], "the end")
        return reply.json["id"]

    kept = end(HOUR)
    for again in (False, True):
        if again:
            service.end()
        clock.step(400 * DAY)
        if again:
            service.start()
        mark = end(20)
        clock.step(30)  # as if time had passed: the mark's is over
        end(HOUR)  # something happens
        wait_until(lambda: ask(service, "GET", f"/v1/jobs/{mark}", **bearer).status == 404, "the end of the mark")
        assert ask(service, "GET", f"/v1/jobs/{kept}", **bearer).status == 200
        assert ask(service, "HEAD", sent, **bearer).status == 200
        assert ask(service, "GET", "/v1/session", Cookie=cookie).json["user"]
