# SPDX-License-Identifier: Apache-2.0
"""A service whose clients take all descriptors: it answers again as soon as they have gone."""
import os
import re
import resource
import socket
import subprocess

import pytest

from service import PATIENCE_S, wait_until

SPARE = 8  # descriptors
RECOVERED_S = 20  # far above the second that the service needs, and far below the time limits of connections


def open_files(service):
    return len(os.listdir(f"/proc/{service.process.pid}/fd"))


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


def exhaust(service, address, files, sent):
    """Open connections, more than the service can accept, which have sent these bytes."""
    held = []
    for _ in range(60):
        held.append(socket.socket())
        held[-1].setblocking(False)
        held[-1].connect_ex(address)
        if sent:
            held[-1].send(sent)
    wait_until(lambda: open_files(service) == files, "all descriptors to be taken")
    return held


# Each listening socket follows the same rule. The limit of files changes after the start, which had sufficient ones.
@pytest.mark.sanitized
@pytest.mark.parametrize("sockets, sent", [(1, b""), (2, b""), (1, b"GET /hea")])
def test_a_service_answers_again_after_its_descriptors_were_exhausted(new_service, sockets, sent):
    service = new_service("--connection_timeout_s", 600, *["--listen", "127.0.0.1:0"] * sockets).start()
    wait_until(lambda: "database checked" in service.log.read_text(), "the end of the start")
    files = open_files(service) + SPARE
    resource.prlimit(service.process.pid, resource.RLIMIT_NOFILE, (files, files))
    for _ in range(5):
        for address in addresses(service):
            for one in exhaust(service, address, files, sent):
                one.close()
            wait_until(lambda: is_answered(address), "an answer after the shortage", RECOVERED_S)
    log = service.log.read_text()
    assert log.count(f"has reached its limit of {files} open files (RLIMIT_NOFILE)") == 1


# The limit that the warning names is sufficient; a smaller one would be reached by requests that the service has accepted.
OPEN_FOR_A_MOMENT = 8  # files of other threads, which count if they are open while the service counts


def test_the_limit_of_connections_is_lowered_to_what_the_limit_of_files_leaves(new_service):
    def warning(files):
        service = new_service()
        service.under = ["prlimit", f"--nofile={files}:{files}"]
        service.start()
        found = re.search("connection_limit is lowered from 2048 to ([0-9]+): the service may open ([0-9]+) files .* and ([0-9]+) are needed",
                          service.log.read_text())
        assert is_answered(addresses(service)[0])
        return found and [int(number) for number in found.groups()]

    lowered, limit, needed = warning(1000)
    assert limit == 1000 and 100 < lowered < 400 < 5000 < needed
    assert warning(44)[0] == 1
    assert warning(needed - OPEN_FOR_A_MOMENT)[0] < 2048
    assert warning(needed + OPEN_FOR_A_MOMENT) is None


def test_a_socket_whose_service_does_not_accept_is_not_waited_for(build, tmp_path):
    path = tmp_path / "socket"
    with socket.socket(socket.AF_UNIX) as listening, socket.socket(socket.AF_UNIX) as waiting:
        listening.bind(str(path))
        listening.listen(0)
        waiting.connect(str(path))  # the queue of the socket is full
        done = subprocess.run([build / "hexad", "--state_dir", tmp_path / "state", "--listen", f"unix:{path}"],
                              stderr=subprocess.PIPE, text=True, timeout=PATIENCE_S)
    assert done.returncode == 2 and "another process uses this socket" in done.stderr
