# SPDX-License-Identifier: Apache-2.0
"""Clients that take all descriptors of a service: it answers again within two seconds after they have gone."""
import collections
import contextlib
import http.client
import json
import os
import random
import resource
import selectors
import socket
import time

from farm import Service, Violation, spec, wait_until

LIMITS = (40, 1024)  # of open files
LEAST_FOR_JOBS = 120  # from this limit on a job can be submitted, too
CONNECTIONS = (1, 2000)
RECOVERED_S = 2
HELD_S = 0.5  # the longest time that the connections are held
RUNNING = 0.5  # the chance that the limit is set while the service runs, which then has not adapted connection_limit
SENT = (b"", b"GET /hea", b"GET /healthz HTTP/1.1\r\nHost: %s\r\n\r\n")


class Clients:
    """Connections to the service that are opened as fast as possible, and kept. They send nothing, a part of a request or one."""

    def __init__(self, address, count, rng):
        self.open, self.files = [], selectors.DefaultSelector()
        host, _, port = address.rpartition(":")
        for _ in range(count):
            one = socket.socket()
            self.open.append(one)
            one.setblocking(False)
            one.connect_ex((host, int(port)))
            text = rng.choice(SENT).replace(b"%s", address.encode())
            if text:
                self.files.register(one, selectors.EVENT_WRITE, text)

    def send(self):
        """Sends what the connections that have been established are to send."""
        for key, _ in self.files.select(0):
            self.files.unregister(key.fileobj)
            with contextlib.suppress(OSError):
                key.fileobj.send(key.data)

    def close(self):
        self.files.close()
        for one in self.open:
            one.close()


def open_files(service):
    return len(os.listdir(f"/proc/{service.process.pid}/fd"))


def start(build, where, limit, running):
    service = Service(build, where, "--log_level", "info", "--connection_timeout_s", 600, "--client_connection_limit", CONNECTIONS[1])
    if not running:
        service.under = ["prlimit", f"--nofile={limit}:{limit}"]
    service.start()
    wait_until(lambda: "database checked" in service.log.read_text(), "the end of the start")
    if running:
        resource.prlimit(service.process.pid, resource.RLIMIT_NOFILE, (limit, limit))
    return service


def ask(service, method, path, document, wanted, until):
    """Asks until the wanted status comes; the time of the answer. Each try has the time that is left."""
    while time.monotonic() < until:
        connection = service.connection()
        connection.timeout = max(until - time.monotonic(), 0.001)
        try:
            connection.request(method, path, document, {"Content-Type": "application/json"})
            reply = connection.getresponse()
            body = reply.read()
            if reply.status == wanted:
                return time.monotonic(), body
        except (OSError, http.client.HTTPException):
            time.sleep(0.001)  # a refused connection is tried again without using a whole CPU
        finally:
            connection.close()
    return None


def hold(service, limit, count, rng):
    """Holds connections for a time; whether the service had all the descriptors that it may have."""
    clients, exhausted = Clients(service.address, count, rng), False
    until = time.monotonic() + rng.uniform(0.05, HELD_S)
    while time.monotonic() < until:
        clients.send()
        exhausted |= open_files(service) >= limit
    clients.close()
    return exhausted


def try_one(build, where, number, rng):
    """The figures of one try."""
    limit, count, running = rng.randint(*LIMITS), rng.randint(*CONNECTIONS), rng.random() < RUNNING
    if number % 4 == 0:
        limit = rng.randint(LIMITS[0], 80)
    what = f"limit {limit} {'set while it runs' if running else 'from the start'}, {count} connections"
    service = start(build, where, limit, running)
    try:
        exhausted = hold(service, limit, count, rng)
        began = time.monotonic()
        until = began + RECOVERED_S
        health = ask(service, "GET", "/healthz", None, 200, until)
        if not health:
            raise Violation(f"{what}: no answer {RECOVERED_S} s after the connections have ended: {service.log.read_text()[-2000:]}")
        seconds = {"healthz": health[0] - began}
        if limit >= LEAST_FOR_JOBS:
            job = ask(service, "POST", "/v1/jobs", json.dumps(spec(f"shortage {number}")), 201, until)
            if not job:
                raise Violation(f"{what}: no job accepted {RECOVERED_S} s after the connections have ended: {service.log.read_text()[-2000:]}")
            seconds["POST"] = job[0] - began
        check_log(service, what, limit, running, exhausted)
        return {"limit": limit, "connections": count, "running": running, "exhausted": exhausted, "seconds": seconds}
    finally:
        service.clean_up()


def check_log(service, what, limit, running, exhausted):
    log = service.log.read_text()
    if not running and f"the service may open {limit} files (RLIMIT_NOFILE)" not in log:
        raise Violation(f"{what}: the log does not say that connection_limit was lowered: {log[-2000:]}")
    if exhausted and f"reached its limit of {limit} open files (RLIMIT_NOFILE)" not in log:
        raise Violation(f"{what}: the log does not say what was lacking: {log[-2000:]}")


def run(build, where, tries, seed, say):
    """Each try with a service of its own."""
    rng = random.Random(f"{seed} shortage")
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    made = []
    try:
        for number in range(tries):
            place = where / str(number)
            place.mkdir(parents=True, exist_ok=True)
            made.append(try_one(build, place, number, rng))
            say(f"shortage {number + 1} of {tries}: {made[-1]}")
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    counts = collections.Counter()
    for one in made:
        counts["limit set while it ran"] += one["running"]
        counts["limit reached"] += one["exhausted"]
    slowest = {kind: max((one["seconds"][kind] for one in made if kind in one["seconds"]), default=None) for kind in ("healthz", "POST")}
    return {"tries": tries, "least limit": min(one["limit"] for one in made), "jobs accepted": sum("POST" in one["seconds"] for one in made),
            **counts, "slowest": slowest}
