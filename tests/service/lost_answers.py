# SPDX-License-Identifier: Apache-2.0
"""A Unix socket between a client and the service that loses answers."""
import socket
import threading

from service import Service


def on_a_socket(build, where, *options):
    """A daemon on the Unix socket of its state directory, so that its address stays when it is started again."""
    service = Service(build, where, *options)
    for word in ("--listen", "--tcp_without_tokens"):
        at = service.options.index(word)
        del service.options[at:at + 2]
    return service


def read_message(connection):
    """A request or an answer, as long as its head says."""
    data = connection.recv(65536)
    while b"\r\n\r\n" not in data:
        data += connection.recv(65536)
    head, _, body = data.partition(b"\r\n\r\n")
    length = int(head.lower().partition(b"content-length: ")[2].partition(b"\r\n")[0] or 0)
    while len(body) < length:
        body += connection.recv(65536)
    return head + b"\r\n\r\n" + body


class LosesAnswers:
    """A proxy to a Unix socket: it loses the first answer, once the daemon has given it."""

    def __init__(self, where, target):
        self.target, self.asked = target, 0
        self.listener = socket.socket(socket.AF_UNIX)
        self.listener.bind(str(where))
        self.listener.listen()
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while self.asked < 2:
            connection, _ = self.listener.accept()
            with connection, socket.socket(socket.AF_UNIX) as behind:
                behind.connect(self.target)
                behind.sendall(read_message(connection))
                answer = read_message(behind)
                self.asked += 1
                if self.asked > 1:
                    connection.sendall(answer)
