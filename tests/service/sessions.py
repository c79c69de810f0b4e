# SPDX-License-Identifier: Apache-2.0
"""Sessions of browsers: signing in with a token, cookies, and requests from a page of another origin."""
import json

import pytest

from accounts import new_token
from service import OPEN_TCP

GUI = "https://gui.example"


def ask(service, method, path, body=None, **headers):
    return service.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})


@pytest.fixture
def with_tokens(new_service):
    service = new_service("--page_origins", GUI)
    service.options = [o for o in service.options if o not in ("--tcp_without_tokens", OPEN_TCP)]
    service.state.mkdir(mode=0o700)
    service.token = f"Bearer {new_token(service, 'alice')}"
    return service.start()


def sign_in(service, token, **headers):
    return ask(service, "POST", "/v1/session", json.dumps({"token": token.removeprefix("Bearer ")}),
               Content_Type="application/json", **headers)


def cookie_of(reply):
    return reply.headers["Set-Cookie"].partition(";")[0]
