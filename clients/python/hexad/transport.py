# SPDX-License-Identifier: Apache-2.0
"""Requests to the service, over a Unix socket or TCP: repeated when their answer is lost, refused by exceptions."""
from __future__ import annotations

import http.client
import json
import os
import pathlib
import socket
import ssl
import time
import urllib.parse
from typing import Any, Callable, Mapping, TypeVar

from .errors import Problem, Unreachable
from .problems import BY_CODE

__all__ = ["FIRST_PAUSE_S", "LOST", "Transport", "body_of", "with_query"]

DEFAULT_SERVER = "unix:/run/hexad/hexad.sock"
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.05, 5.0
# A request that these refuse may be repeated later; nothing in it is wrong.
LATER = ("too_many_requests", "too_many_submissions", "unavailable")
# The connection, and with it the answer, is lost; or there is none (a socket is missing while the service starts).
LOST = (ConnectionError, FileNotFoundError, socket.timeout, socket.gaierror, http.client.HTTPException)
T = TypeVar("T")


class UnixConnection(http.client.HTTPConnection):
    def __init__(self, path: str, timeout: float) -> None:
        super().__init__("hexad", timeout=timeout)
        self.path = path

    def connect(self) -> None:
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(self.timeout)
        self.sock.connect(self.path)


def body_of(response: http.client.HTTPResponse) -> Any:
    """The JSON document of an answer; None: it has none."""
    data = response.read()
    return json.loads(data) if data else None


def raise_problem(response: http.client.HTTPResponse) -> None:
    data = response.read()
    try:
        document = json.loads(data)
    except ValueError:
        document = None
    if not isinstance(document, dict):  # of a proxy
        document = {"detail": data[:200].decode("utf-8", "replace")}
    kind: type[Problem] = BY_CODE.get(document.get("code", ""), Problem)
    raise kind(response.status, document)


class Transport:
    """One service. Threads may share it: each request has a connection of its own.

    timeout: seconds without a byte after which a connection is given up
    patience: seconds for which a request is repeated
    """

    def __init__(self, server: str | None = None, token: str | None = None, timeout: float = 60.0,
                 patience: float = 60.0, context: ssl.SSLContext | None = None) -> None:
        self.server = server or os.environ.get("HEXAD_SERVER") or DEFAULT_SERVER
        self.token = (token or os.environ.get("HEXAD_TOKEN") or "").strip()
        self.timeout, self.patience, self.context = timeout, patience, context
        self.url = urllib.parse.urlsplit(self.server)
        if self.url.scheme not in ("unix", "http", "https") or not (self.url.hostname or self.url.scheme == "unix"):
            raise ValueError(f"{self.server}: a server is unix:PATH, http://HOST:PORT or https://HOST:PORT")

    def connect(self) -> http.client.HTTPConnection:
        if self.url.scheme == "unix":
            return UnixConnection(self.url.path, self.timeout)
        host = self.url.hostname or ""
        if self.url.scheme == "https":
            context = self.context or ssl.create_default_context()
            return http.client.HTTPSConnection(host, self.url.port, timeout=self.timeout, context=context)
        return http.client.HTTPConnection(host, self.url.port, timeout=self.timeout)

    def open_once(self, method: str, path: str, body: bytes | pathlib.Path | None,
                  headers: Mapping[str, str] | None) -> tuple[http.client.HTTPConnection, http.client.HTTPResponse]:
        sent = dict(headers or {})
        if self.token:
            sent["Authorization"] = f"Bearer {self.token}"
        target = path if self.url.scheme == "unix" else self.url.path.rstrip("/") + path
        connection = self.connect()
        try:
            try:
                if isinstance(body, pathlib.Path):
                    with open(body, "rb") as file:
                        sent["Content-Length"] = str(body.stat().st_size)
                        connection.request(method, target, file, sent)
                else:
                    connection.request(method, target, body, sent)
            except (BrokenPipeError, ConnectionResetError):
                if not body:
                    raise
                # the service refuses before it has read all of a body: the answer says why
            response = connection.getresponse()
            if response.status >= 300 and response.status != 304:
                raise_problem(response)
            return connection, response
        except BaseException:
            connection.close()
            raise

    def explain_tls(self, doubt: ssl.SSLError) -> str:
        """Why there is no TLS connection; the token is not sent."""
        if isinstance(doubt, ssl.SSLCertVerificationError):
            return str(doubt)
        plain = http.client.HTTPConnection(self.url.hostname or "", self.url.port, timeout=self.timeout)
        try:
            plain.request("GET", "/healthz")
            found = plain.getresponse().status == 200
        except (OSError, http.client.HTTPException):
            found = False
        finally:
            plain.close()
        return (f"this port does not use TLS: write http://{self.url.netloc}, or use the address of the TLS proxy"
                if found else str(doubt))

    def patiently(self, once: Callable[[], T], what: str, repeat: bool = True) -> T:
        """What `once` returns; it is repeated while there is no answer, unless that would do something twice."""
        end, pause = time.monotonic() + self.patience, FIRST_PAUSE_S
        while True:
            fault: Exception
            try:
                return once()
            except Problem as problem:
                if problem.code not in LATER:
                    raise
                fault = problem
            except ssl.SSLError as doubt:  # a repetition fails in the same way
                raise Unreachable(f"{self.server}: {self.explain_tls(doubt)}") from None
            except PermissionError:
                raise Unreachable(f"{self.server}: this user may not connect: as root type hexad --allow USER, "
                                  "with --config FILE for a service with another settings file") from None
            except LOST as lost:
                fault = Unreachable(f"{self.server}: {what}: {lost or type(lost).__name__}")
            if not repeat or time.monotonic() + pause > end:
                raise fault
            time.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE_S)

    def open(self, path: str, headers: Mapping[str, str]) -> tuple[http.client.HTTPConnection, http.client.HTTPResponse]:
        """An answer that is read as it comes; the caller closes the connection."""
        return self.patiently(lambda: self.open_once("GET", path, None, headers), path)

    def ask(self, method: str, path: str, body: bytes | pathlib.Path | None = None,
            headers: Mapping[str, str] | None = None, *, read: Callable[[http.client.HTTPResponse], T],
            repeat: bool = True) -> T:
        """What `read` makes of the answer."""
        def once() -> T:
            connection, response = self.open_once(method, path, body, headers)
            try:
                return read(response)
            finally:
                connection.close()
        return self.patiently(once, f"{method} {path}", repeat)

    def get(self, path: str, query: Mapping[str, Any] | None = None, headers: Mapping[str, str] | None = None) -> Any:
        return self.ask("GET", with_query(path, query), headers=headers, read=body_of)

    def send(self, method: str, path: str, document: Any = None, headers: Mapping[str, str] | None = None,
             repeat: bool = True) -> Any:
        body = None if document is None else json.dumps(document).encode()
        more = {"Content-Type": "application/json"} if body else {}
        return self.ask(method, path, body, {**more, **(headers or {})}, read=body_of, repeat=repeat)


def with_query(path: str, query: Mapping[str, Any] | None) -> str:
    given = {name: value for name, value in (query or {}).items() if value is not None}
    return f"{path}?{urllib.parse.urlencode(given)}" if given else path
