# SPDX-License-Identifier: Apache-2.0
"""A service whose workers several users share."""
import pytest

from accounts import new_token, with_token
from service import OPEN_TCP, gated_worker, sphere, wait_until


class Farm:
    """A daemon with a worker whose jobs end when they are told to, and a token for each user."""

    def __init__(self, new_service, tmp_path, *options, workers=1):
        self.service = new_service("--worker", gated_worker(tmp_path), "--workers", workers, "--cache", 0, *options)
        self.service.options = [o for o in self.service.options if o not in ("--tcp_without_tokens", OPEN_TCP)]
        self.service.state.mkdir(mode=0o700)
        self.tokens = {user: new_token(self.service, user) for user in ("ann", "bob", "eve")}
        self.tokens["admin"] = new_token(self.service, "admin", "--scopes", "read,submit,cancel,admin")
        self.service.start()

    def ask(self, user, method, path, document=None, **headers):
        return with_token(self.service, self.tokens[user], method, path, document, **headers)

    def submit(self, user, **parts):
        reply = self.ask(user, "POST", "/v1/jobs", sphere(**parts))
        assert reply.status == 201, reply.body
        return reply.json["id"]

    def running(self):
        """Owner and id of the only attempt that runs."""
        workers = wait_until(lambda: self.ask("admin", "GET", "/v1/workers").json["workers"], "an attempt")
        assert len(workers) == 1
        return workers[0]["owner"], workers[0]["job"]

    def next(self):
        """Ends the running job; returns owner and id of the one that starts then."""
        before = self.running()
        self.service.open_gate(before[1])
        wait_until(lambda: self.ask("admin", "GET", f"/v1/jobs/{before[1]}").json["state"] == "succeeded", "its end")
        return self.running()


@pytest.fixture
def farm(new_service, tmp_path):
    return lambda *options, **more: Farm(new_service, tmp_path, *options, **more)
