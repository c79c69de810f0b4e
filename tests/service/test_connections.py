# SPDX-License-Identifier: Apache-2.0
"""Many connections at once: all are answered, whatever their number; and nobody's shut others out."""
import contextlib
import http.client
import resource
import selectors
import signal
import socket
import threading

import pytest

from accounts import new_token
from commands import settings_fault
from service import OPEN_TCP, PATIENCE_S, UnixConnection, wait_until

MOST = 1100
# The stalls that were found came at exactly 128, 256 and 512 connections, where a batch of events was full.
FEW_COUNTS = [1, 2, 127, 128, 129, 255, 256, 257, 512, MOST]
COUNTS = [1, 2] + [n + d for n in range(64, MOST, 64) for d in (-1, 0, 1)] + [MOST]
STALLED_S = 10  # without a byte for any of them; an answer takes a millisecond
REQUEST = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"


@pytest.fixture(autouse=True)
def descriptors():
    """Room for the sockets of this process, and of the daemon that inherits the limit."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < 2 * MOST:
        pytest.skip(f"needs {2 * MOST} open files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 2 * MOST), hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


class Clients:
    """Connections to a Unix socket that are kept, and asked all at once."""

    def __init__(self, path, count):
        self.path, self.open = path, []
        while len(self.open) < count:
            one = socket.socket(socket.AF_UNIX)
            one.connect(str(path))
            one.setblocking(False)
            self.open.append(one)

    def ask(self, count):
        for one in self.open[:count]:
            one.sendall(REQUEST)

    def hear(self, count):
        """How many of the first connections got no whole answer before all fell silent."""
        got = {}
        with selectors.DefaultSelector() as waiting:
            for one in self.open[:count]:
                waiting.register(one, selectors.EVENT_READ)
            while waiting.get_map():
                ready = waiting.select(STALLED_S)
                if not ready:
                    break
                for key, _ in ready:
                    one = key.fileobj
                    got[one] = got.get(one, b"") + one.recv(65536)
                    head, end, body = got[one].partition(b"\r\n\r\n")
                    assert head.startswith(b"HTTP/1.1 200 "), got[one]
                    if end and len(body) == int(head.lower().partition(b"content-length:")[2].split()[0]):
                        waiting.unregister(one)
            return len(waiting.get_map())

    def close(self):
        for one in self.open:
            one.close()


@pytest.fixture
def clients(new_service, tmp_path):
    # what is idle for the length of a stall is not to be ended, which would wake the server up
    path = tmp_path / "socket"
    service = new_service("--listen", f"unix:{path}", "--user_connection_limit", MOST, "--connection_limit", 2 * MOST,
                          "--connection_timeout_s", 600, "--log_level", "warning").start()
    made = Clients(path, MOST)
    made.service = service
    made.ask(MOST)
    assert made.hear(MOST) == 0  # all are taken in
    yield made
    made.close()


@pytest.mark.parametrize("counts", [FEW_COUNTS, pytest.param(COUNTS, marks=pytest.mark.extended)], ids=["few", "all"])
def test_requests_that_come_at_once_are_all_answered(clients, counts):
    """The daemon stands still while they are sent, so that it finds them all in one look, as a busy one does by chance."""
    daemon = clients.service.process
    for count in counts:
        daemon.send_signal(signal.SIGSTOP)
        wait_until(lambda: b"\nState:\tT" in open(f"/proc/{daemon.pid}/status", "rb").read(), "the daemon's stop")
        clients.ask(count)
        daemon.send_signal(signal.SIGCONT)
        left = clients.hear(count)
        assert left == 0, f"{left} of {count} connections have no answer"


@pytest.mark.parametrize("rounds", [2, pytest.param(10, marks=pytest.mark.extended)])
def test_requests_that_follow_each_other_are_all_answered(clients, rounds):
    """Each round begins when the last answer of the round before has come."""
    for count in (127, 128, 129, 255, 256, 257, 512, 1024):
        for _ in range(rounds):
            clients.ask(count)
            left = clients.hear(count)
            assert left == 0, f"{left} of {count} connections have no answer"


@pytest.fixture
def guarded(new_service):
    """Makes services on loopback ports that want tokens, with those of two users and an admin."""
    def make(*options):
        service = new_service(*options)
        service.options = [o for o in service.options if o not in ("--tcp_without_tokens", OPEN_TCP)]
        service.state.mkdir(mode=0o700)
        service.tokens = {user: new_token(service, user) for user in ("alice", "bob")}
        service.tokens["root"] = new_token(service, "root", "--scopes", "admin")
        return service.start()

    return make


class Held:
    """Connections over TCP that stay open."""

    def __init__(self, service):
        self.service, self.open = service, []

    def connect(self, source="127.0.0.1"):
        host, _, port = self.service.address.rpartition(":")
        one = http.client.HTTPConnection(host, int(port), timeout=PATIENCE_S, source_address=(source, 0))
        one.connect()
        self.open.append(one)
        return one

    def ask(self, user=None, source="127.0.0.1", path="/v1/jobs?limit=1", **headers):
        """The answer to one request on a new connection."""
        one = self.connect(source)
        if user:
            headers["Authorization"] = f"Bearer {self.service.tokens[user]}"
        one.request("GET", path, headers=headers)
        reply = one.getresponse()
        if headers.get("Accept") != "text/event-stream":
            reply.body = reply.read()
        return reply

    def close(self):
        for one in self.open:
            one.close()


@pytest.fixture
def hold():
    """Makes Held, which are closed at the end."""
    with contextlib.ExitStack() as stack:
        yield lambda service: stack.enter_context(contextlib.closing(Held(service)))


def expect_crowd(reply, status, code):
    assert reply.status == status, reply.body
    assert f'"{code}"'.encode() in reply.body
    assert int(reply.headers["Retry-After"]) >= 1 and reply.headers["Content-Type"] == "application/problem+json"


def test_a_half_closed_connection_gets_its_answers_and_is_closed(new_service):
    service = new_service("--connection_timeout_s", 3600).start()
    host, _, port = service.address.rpartition(":")
    request = f"GET /v1/jobs HTTP/1.1\r\nHost: {service.address}\r\n\r\n".encode()
    for count in (1, 2) * 20:
        with socket.create_connection((host, int(port)), timeout=60) as client:
            client.sendall(count * request)
            client.shutdown(socket.SHUT_WR)
            got = b"".join(iter(lambda: client.recv(65536), b""))
        assert got.count(b"HTTP/1.1 200 OK") == count


def test_idle_connections_shut_nobody_out(guarded, hold):
    """They say nothing, or begin a request that never ends, or were told that they need a token."""
    service = guarded()
    held = hold(service)
    for i in range(600):
        one = held.connect()
        if i % 3 == 0:
            one.sock.sendall(b"GET /healthz HTTP/1.1\r\nX: ")
        elif i % 3 == 1:
            one.request("GET", "/v1/jobs")
            one.getresponse().read()
    reply = held.ask("alice")
    assert reply.status == 200, reply.body


def test_the_connection_that_is_idle_longest_goes_first(guarded, hold):
    service = guarded("--client_connection_limit", 4)
    held = hold(service)
    assert held.ask("alice").status == 200  # a user's, which stays
    user = held.open[0]
    first, second, *others = [held.connect() for _ in range(4)]
    first.request("GET", "/healthz")
    assert first.getresponse().read()  # it is not the longest any more
    fifth = held.connect()
    assert second.sock.recv(1) == b""
    shown = {"Authorization": f"Bearer {service.tokens['alice']}"}
    for one in (user, first, *others, fifth):
        one.request("GET", "/healthz", headers=shown if one is user else {})
        assert one.getresponse().read()


def test_a_user_has_so_many_connections_from_all_addresses(guarded, hold):
    service = guarded()
    held = hold(service)
    replies = [held.ask("alice", f"127.0.0.{2 + i % 14}") for i in range(520)]
    assert [r.status for r in replies] == [200] * 512 + [429] * 8
    expect_crowd(replies[-1], 429, "too_many_requests")
    assert held.ask("bob", "127.0.0.2").status == 200
    # one less of them is room for one
    held.open[0].close()
    wait_until(lambda: held.ask("alice").status == 200, "a place")


def test_an_admin_always_gets_in(guarded, hold):
    service = guarded("--connection_limit", 64, "--user_connection_limit", 40, "--admin_connections", 8)
    held = hold(service)
    for i in range(40):
        assert held.ask("alice", f"127.0.0.{2 + i}").status == 200
    statuses = [held.ask("bob", f"127.0.0.{2 + i}").status for i in range(40)]
    assert statuses == [200] * 16 + [503] * 24
    for i in range(100):  # strangers from everywhere
        held.connect(f"127.0.1.{i + 1}").sock.sendall(b"GET /healthz HTTP/1.1\r\nX: ")
    for _ in range(8):
        assert held.ask("root").status == 200
    expect_crowd(held.ask("root"), 503, "unavailable")
    expect_crowd(held.ask("bob"), 503, "unavailable")


def test_strangers_make_room_for_users(guarded, hold):
    service = guarded("--connection_limit", 32, "--admin_connections", 4)
    held = hold(service)
    for i in range(100):
        held.connect(f"127.0.0.{2 + i}").sock.sendall(b"GET /healthz HTTP/1.1\r\nX: ")
    for _ in range(28):
        assert held.ask("alice").status == 200
    expect_crowd(held.ask("bob"), 503, "unavailable")


def test_a_trusted_proxy_tells_clients_apart(guarded, hold):
    """Two connections of a client without a token are ended for a third, unless it is another client's."""
    service = guarded("--client_connection_limit", 2, "--trusted_proxies", "127.0.0.9,127.0.1.0/24")

    def survives(source, *clients):
        """Whether a connection for the first of these clients is still there after those for the others."""
        held = hold(service)
        for client in clients:
            assert held.ask(None, source, "/healthz", **({"Forwarded": client} if client else {})).status == 200
        first = held.open[0]
        try:
            first.request("GET", "/healthz")
            return first.getresponse().status == 200
        except (http.client.RemoteDisconnected, ConnectionError):
            return False

    a, b = "for=192.0.2.1", "for=192.0.2.2"
    assert not survives("127.0.0.2", a, b, b)  # nobody trusts this one: all are the same client's
    assert survives("127.0.0.9", a, b, b)
    assert not survives("127.0.0.9", a, a, a)
    assert not survives("127.0.0.9", a, f"{b}, {a}", f"{b};by=x, {a}")  # what the client itself says is nothing
    assert survives("127.0.1.77", f"{a}, for=127.0.0.9", f"{b}, for=127.0.0.9", f"{b}, for=127.0.0.9")
    log = service.log.read_text()
    assert "user=- client=192.0.2.2" in log and "client=127.0.0.2" in log


def test_what_a_proxy_says_lets_nobody_in(guarded, hold):
    service = guarded("--trusted_proxies", "127.0.0.1")
    assert hold(service).ask(None, Forwarded="for=127.0.0.1").status == 401
    bad = settings_fault(service, "--trusted_proxies", "10.0.0.0/33")
    assert "trusted_proxies" in bad and "10.0.0.0/33" in bad


@pytest.mark.parametrize("stops", [3, pytest.param(8, marks=pytest.mark.extended)])
def test_a_stop_while_clients_ask_ends_well(new_service, tmp_path, stops):
    """Requests that a thread of the pool answers suspend their connections: none may be suspended when the server stops."""
    def ask(service, over):
        while not over.is_set() and service.process.poll() is None:
            try:
                connection = UnixConnection(str(tmp_path / "socket"))
                while not over.is_set():
                    connection.request("POST", f"/v1/jobs/{'0' * 26}/cancel", b"", {"Content-Type": "application/json"})
                    connection.getresponse().read()
            except (OSError, http.client.HTTPException):
                continue

    for _ in range(stops):
        service = new_service("--listen", f"unix:{tmp_path / 'socket'}").start()
        over = threading.Event()
        clients = [threading.Thread(target=ask, args=(service, over)) for _ in range(16)]
        try:
            for client in clients:
                client.start()
            assert service.end() == 0
        finally:
            over.set()
            for client in clients:
                client.join()
