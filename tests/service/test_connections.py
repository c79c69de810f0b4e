"""Many connections at once: all are answered, whatever their number."""
import resource
import selectors
import signal
import socket

import pytest

from service import wait_until

MOST = 1100
# The stalls that were found came at exactly 128, 256 and 512 connections, where a batch of events was full.
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
    service = new_service("--listen", f"unix:{path}", "--client_connection_limit", 2 * MOST, "--connection_limit", 2 * MOST,
                          "--connection_timeout_s", 600, "--log_level", "warning").start()
    made = Clients(path, MOST)
    made.service = service
    made.ask(MOST)
    assert made.hear(MOST) == 0  # all are taken in
    yield made
    made.close()


def test_requests_that_come_at_once_are_all_answered(clients):
    """The daemon stands still while they are sent, so that it finds them all in one look, as a busy one does by chance."""
    daemon = clients.service.process
    for count in COUNTS:
        daemon.send_signal(signal.SIGSTOP)
        wait_until(lambda: b"\nState:\tT" in open(f"/proc/{daemon.pid}/status", "rb").read(), "the daemon's stop")
        clients.ask(count)
        daemon.send_signal(signal.SIGCONT)
        left = clients.hear(count)
        assert left == 0, f"{left} of {count} connections have no answer"


def test_requests_that_follow_each_other_are_all_answered(clients):
    """Each round begins when the last answer of the round before has come."""
    for count in (127, 128, 129, 255, 256, 257, 512, 1024):
        for _ in range(10):
            clients.ask(count)
            left = clients.hear(count)
            assert left == 0, f"{left} of {count} connections have no answer"
