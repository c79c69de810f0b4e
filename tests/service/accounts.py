# SPDX-License-Identifier: Apache-2.0
"""Users of a service, their tokens, and requests with these."""
import hashlib
import json
import subprocess

import pytest

from service import OPEN_TCP, PATIENCE_S, sphere, wait_until

USERS = ("ann", "ben")


def new_token(service, *words):
    done = subprocess.run([service.build / "hexadctl", "token", "add", *words, "--file", service.state / "tokens"],
                          capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def with_token(service, token, method, path, document=None, **more):
    headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json", **more}
    return service.request(method, path, json.dumps(document) if document is not None else None, headers)


@pytest.fixture
def closed_service(new_service):
    """On a loopback port, with an admin's token."""
    service = new_service()
    service.options = [o for o in service.options if o not in ("--tcp_without_tokens", OPEN_TCP)]
    service.state.mkdir(mode=0o700)
    service.token = new_token(service, "root", "--scopes", "admin")
    return service.start()


class Users:
    """A service on a port, and requests of two users who may submit."""

    def __init__(self, service):
        self.service = service
        service.options = [o for o in service.options if o not in ("--tcp_without_tokens", OPEN_TCP)]
        service.state.mkdir(mode=0o700)
        self.tokens = {user: new_token(service, user, "--scopes", "read,submit,cancel") for user in USERS}
        self.tokens["root"] = new_token(service, "root", "--scopes", "admin")

    def ask(self, user, method, path, document=None):
        return with_token(self.service, self.tokens[user], method, path, document)

    def submit(self, user, spec):
        reply = self.ask(user, "POST", "/v1/jobs", spec)
        assert reply.status == 201, reply.body
        return reply.json["id"]

    def wait(self, user, job, *states):
        return wait_until(lambda: (lambda j: j if j["state"] in states else None)(self.ask(user, "GET", f"/v1/jobs/{job}").json),
                          f"{job} to be {states}")

    def run(self, user, spec, state="succeeded"):
        return self.wait(user, self.submit(user, spec), state)

    def results(self, user, job):
        """name -> content of the files of a result, each held against its listing and its ETag."""
        found = {}
        for item in self.ask(user, "GET", f"/v1/jobs/{job}/results").json["results"]:
            reply = self.ask(user, "GET", item["href"])
            found[item["name"]] = reply.body
            digest = hashlib.sha256(reply.body).hexdigest()
            assert (item["sha256"], item["bytes"], reply.headers["ETag"]) == (digest, len(reply.body), f'"{digest}"')
        return found


@pytest.fixture
def users(new_service):
    return lambda *options: Users(new_service(*options))


def some(name=None, labels=(), **output):
    """A small job with the given data of its owner."""
    spec = sphere(count=60, queue={"labels": list(labels)}, output={"preview": False, **output})
    return {**spec, "name": name} if name else spec
