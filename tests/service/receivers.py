# SPDX-License-Identifier: Apache-2.0
"""A receiver of webhooks, with the secret that signs them."""
import base64
import hmac
import http.server
import json
import queue
import re
import threading
import time

import pytest

from service import PATIENCE_S, sphere

KEY = bytes(range(32))
SECRET = "whsec_" + base64.b64encode(KEY).decode()


def verify(secret, headers, body):
    """The verification of the Standard Webhooks specification, version 1.0.0: of a symmetric signature, for a receiver."""
    key = base64.b64decode(secret.removeprefix("whsec_"), validate=True)
    assert 24 <= len(key) <= 64
    number, second = headers["webhook-id"], headers["webhook-timestamp"]
    assert number and "." not in number and re.fullmatch("[0-9]+", second)
    assert abs(time.time() - int(second)) < 5 * 60
    right = hmac.digest(key, f"{number}.{second}.".encode() + body, "sha256")
    signatures = [s.partition(",") for s in headers["webhook-signature"].split(" ")]
    assert any(version == "v1" and hmac.compare_digest(base64.b64decode(text, validate=True), right)
               for version, _, text in signatures)


class Receiver:
    """An HTTP server on loopback that answers with the next of `answers`, a status or (status, headers), and 204 when there
    is none."""

    def __init__(self):
        self.secret = SECRET
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
                answer, headers = answer if isinstance(answer, tuple) else (answer, {})
                self.send_response(answer)
                if answer // 100 == 3:
                    self.send_header("Location", "/elsewhere")
                for name, value in {"Content-Length": "0", **headers}.items():
                    self.send_header(name, value)
                self.end_headers()
                if "Content-Length" in headers:  # the body that was promised does not come
                    self.close_connection = True

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
        verify(self.secret, headers, body)
        assert headers.get("traceparent") == json.loads(body)["data"]["traceparent"]
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


def hooked(receiver, **parts):
    return sphere(queue={"webhook": receiver.url}, **parts)
