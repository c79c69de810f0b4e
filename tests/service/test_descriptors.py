"""A service whose clients take all descriptors: it answers again as soon as they have gone."""
import os
import socket

import pytest

from service import wait_until

FILES = 44  # a few more than the service has without connections
RECOVERED_S = 20  # far above the second that the service needs, and far below the time limits of connections


@pytest.fixture
def limited(new_service):
    """Makes services that may open this number of files. Their connections do not end by themselves."""
    def make(*options):
        service = new_service("--connection_timeout_s", 600, *options)
        service.under = ["prlimit", f"--nofile={FILES}:{FILES}"]
        return service.start()

    return make


def addresses(service):
    lines = service.port_file.read_text().splitlines()
    return [(host, int(port)) for host, _, port in (line.rpartition(":") for line in lines)]


def is_answered(address):
    """Whether a new connection gets an answer in a second."""
    with socket.socket() as one:
        one.settimeout(1)
        try:
            one.connect(address)
            one.sendall(b"GET /healthz HTTP/1.1\r\nHost: %s:%d\r\n\r\n" % (address[0].encode(), address[1]))
            return one.recv(4096).startswith(b"HTTP/1.1 200 ")
        except OSError:
            return False


def exhaust(service, address, count):
    """Open connections, more than the service can accept."""
    held = []
    for _ in range(count):
        held.append(socket.socket())
        held[-1].setblocking(False)
        held[-1].connect_ex(address)
    wait_until(lambda: len(os.listdir(f"/proc/{service.process.pid}/fd")) == FILES, "all descriptors to be taken")
    return held


# Each listening socket follows the same rule.
@pytest.mark.sanitized
@pytest.mark.parametrize("sockets", [1, 2])
def test_a_service_answers_again_after_its_descriptors_were_exhausted(limited, sockets):
    service = limited(*["--listen", "127.0.0.1:0"] * sockets)
    for _ in range(5):
        for address in addresses(service):
            for one in exhaust(service, address, 60):
                one.close()
            wait_until(lambda: is_answered(address), "an answer after the shortage", RECOVERED_S)
    log = service.log.read_text()
    assert log.count(f"has reached its limit of {FILES} open files (RLIMIT_NOFILE)") == 1
