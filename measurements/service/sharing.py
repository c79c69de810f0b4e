#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How long jobs wait when users share one worker: one job behind many, and five users of different weights.

    measurements/service/sharing.py --built BUILD [--output measurements/service/sharing.csv] [--many 10000] [--each 100] [--job-ms 20]

Prints the results and writes them. Ends with 1 when a claim is missed. The worker is a script that takes --job-ms and delivers a
result, so that waiting times show the order of the jobs only.
"""
import argparse
import calendar
import collections
import hashlib
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1] / "tests" / "service"), str(HERE.parent / "common")]

import results  # noqa: E402
from service import Service, sphere, wait_until  # noqa: E402

WORKER = """#!/bin/sh
cat > /dev/null
sleep %s
printf x > "$4/points.ply"
printf '{"outcome":"converged","count":7,"outputs":[{"name":"points.ply","bytes":1,"sha256":"%s"}]}' > "$4/report.json"
"""
WEIGHTS = {"alice": 4, "bob": 2, "carol": 1, "dave": 1, "erin": 0.5}
MOST_OFF = 0.02  # of a share; a turn is a whole job
PAGE = 500
COLUMNS = ["user", "weight", "share_by_weight", "share", "median_wait_s", "longest_wait_s", "median_wait_by_age_s",
           "longest_wait_by_age_s", "others_begun", "outcome"]

Started = collections.namedtuple("Started", "name at_ms waited_ms")


def at_ms(text):
    whole, _, ms = text.rstrip("Z").partition(".")
    return calendar.timegm(time.strptime(whole, "%Y-%m-%dT%H:%M:%S")) * 1000 + int(ms)


class Farm:
    """A daemon, and a token for each user."""

    def __init__(self, options, where):
        base = pathlib.Path(tempfile.mkdtemp(dir=where))
        worker = base / "worker"
        worker.write_text(WORKER % (options.job_ms / 1000, hashlib.sha256(b"x").hexdigest()))
        worker.chmod(0o700)
        self.service = Service(options.built, base, "--listen", f"unix:{base}/socket", "--worker", worker, "--workers", 1,
                               "--cache", 0, "--log_level", "warning", "--user_weights",
                               ",".join(f"{user}:{weight}" for user, weight in WEIGHTS.items()))
        self.service.state.mkdir(mode=0o700)
        self.tokens = {user: self.token(user) for user in (*WEIGHTS, "many", "one")}
        self.service.start()

    def token(self, user):
        return subprocess.run([self.service.build / "hexadctl", "token", "add", user, "--file", self.service.state / "tokens"],
                              check=True, capture_output=True, text=True).stdout.strip()

    def submit(self, user, name, count=1):
        """Jobs over one connection; the id of the last one."""
        connection = self.service.connection()
        headers = {"Authorization": f"Bearer {self.tokens[user]}", "Content-Type": "application/json"}
        for _ in range(count):
            connection.request("POST", "/v1/jobs", json.dumps(sphere(name=name)), headers)
            reply = connection.getresponse()
            answer = json.loads(reply.read())
            assert reply.status == 201, answer
        connection.close()
        return answer["id"]

    def hold(self, on):
        assert self.service.post("/v1/admin/hold" if on else "/v1/admin/release").status == 200

    def started(self, since_ms):
        """The jobs that have started, in the order of their starts; they waited since they were submitted or that time."""
        found, cursor = [], ""
        while cursor is not None:
            page = self.service.get(f"/v1/jobs?limit={PAGE}{cursor and '&cursor='}{cursor}").json
            for job in page["jobs"]:
                if job["started"]:
                    began, came = at_ms(job["started"]), max(since_ms, at_ms(job["created"]))
                    found.append(Started(job["name"], began, began - came))
            cursor = page["next"]
        return sorted(found, key=lambda s: s.at_ms)


def one_behind_many(farm, many):
    """How long the one waited, and how many jobs of the other user began meanwhile."""
    farm.hold(True)
    farm.submit("many", "many", many)
    farm.hold(False)
    wait_until(lambda: farm.service.get("/v1/jobs?state=running").json["jobs"], "a job that runs")
    job = farm.service.job(farm.submit("one", "one"))
    job = wait_until(lambda: (now := farm.service.job(job["id"]))["started"] and now, "its start")
    came, began = at_ms(job["created"]), at_ms(job["started"])
    between = [s for s in farm.started(0) if s.name == "many" and came < s.at_ms < began]
    return began - came, len(between)


def share(farm, each, owner_of):
    """Each user's jobs, submitted one user after the other while the queue was held."""
    farm.hold(True)
    for user in WEIGHTS:
        farm.submit(owner_of(user), user, each)
    released_ms = int(time.time() * 1000)
    farm.hold(False)
    count = each * len(WEIGHTS)
    wait_until(lambda: len(farm.service.get("/v1/jobs?state=succeeded&limit=1").json["jobs"]) and
               not farm.service.get("/v1/jobs?state=queued&limit=1").json["jobs"], "all jobs", 3600)
    started = farm.started(released_ms)
    assert len(started) == count
    return started


def seconds(ms):
    return f"{ms / 1000:.2f}"


def row(user, started, each):
    """Share of the starts while all waited, median and longest waiting time."""
    left, busy = {u: each for u in WEIGHTS}, []
    for s in started:
        busy.append(s.name)
        left[s.name] -= 1
        if not left[s.name]:
            break
    waits = [s.waited_ms for s in started if s.name == user]
    return busy.count(user) / len(busy), statistics.median(waits), max(waits)


def measure(options, where):
    rows = []
    farm = Farm(options, where)
    try:
        waited, between = one_behind_many(farm, options.many)
    finally:
        farm.service.clean_up()
    rows.append([f"one job behind {options.many}", 1, "", "", f"{waited / 1000:.3f}", f"{waited / 1000:.3f}", "", "", between,
                 "met" if between <= 1 else "missed"])
    kinds = {"turns": lambda user: user, "age": lambda user: "many"}
    found = {}
    for kind, owner_of in kinds.items():
        farm = Farm(options, where)
        try:
            found[kind] = share(farm, options.each, owner_of)
        finally:
            farm.service.clean_up()
    for user, weight in WEIGHTS.items():
        wanted = weight / sum(WEIGHTS.values())
        got, median, longest = row(user, found["turns"], options.each)
        _, age_median, age_longest = row(user, found["age"], options.each)
        met = abs(got - wanted) <= max(MOST_OFF, 1 / options.each)
        rows.append([user, weight, f"{wanted:.3f}", f"{got:.3f}", *map(seconds, (median, longest, age_median, age_longest)), "",
                     "met" if met else "missed"])
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--built", type=pathlib.Path, required=True)
    parser.add_argument("--output", type=pathlib.Path, default=HERE / "sharing.csv")
    parser.add_argument("--many", type=int, default=10000)
    parser.add_argument("--each", type=int, default=100)
    parser.add_argument("--job-ms", type=int, default=20)
    options = parser.parse_args()
    options.built = options.built.resolve()
    with tempfile.TemporaryDirectory() as where:
        rows = measure(options, where)
    for row in (COLUMNS, *rows):
        print(*row, sep=", ")
    results.write(options.output, COLUMNS, rows)
    return 1 if any(row[-1] == "missed" for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
