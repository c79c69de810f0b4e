#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Submissions, reads and tiny jobs a second of two builds, in one run.

    measurements/service/rates.py --built BUILD --before BUILD [--rounds 5] [--span 2] [--jobs 100] [--worker PROGRAM] [--least 0.95]
                                  [--output rates.csv]

The builds take turns in each round, the second one first in every other round. Printed are the medians of the rounds, and the median
of the rounds' ratios. Ends with 1 when a ratio is below --least. --worker: of both for the tiny jobs, instead of each build's own;
then only the daemons differ.
"""
import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1] / "tests" / "service"), str(HERE.parent / "common")]

import results  # noqa: E402
from service import Service, cpu_seconds, sphere, wait_until  # noqa: E402

CLIENTS = 16
READERS = 128  # with this number the server bounds the rate, not the client
READ = 1000  # jobs
QUIET_S, QUIET_MS = 0.3, 3  # a daemon that has nothing to do uses less in this time


class Build:
    """Two daemons of a build: in one nothing runs, the other runs tiny jobs."""

    def __init__(self, options, built, where, worker):
        self.options, self.made, self.number = options, [], 0
        self.waiting = self.start(built, where / "waiting", "--worker", worker, "--workers", 1, "--threads", 1)
        self.busy = self.start(built, where / "busy", "--workers", len(os.sched_getaffinity(0)),
                               *(("--worker", options.worker) if options.worker else ()))
        self.waiting.wait_state(self.waiting.submit(sphere()), "running")
        self.paths = where / "paths"
        self.paths.write_text("".join(f"/v1/jobs/{self.waiting.submit(self.tiny())}\n" for _ in range(READ)))
        self.body, self.place = where / "body", where / "place"
        self.body.write_text(json.dumps(self.tiny()))
        self.place.write_text("/v1/jobs\n")

    def start(self, built, base, *more):
        base.mkdir(parents=True)
        one = Service(built, base, "--listen", f"unix:{base}/socket", "--log_level", "warning", "--cache", 0,
                      "--user_queued", 0, "--user_submissions", 0, *more)
        one.socket = base / "socket"
        self.made.append(one)
        return one.start()

    def tiny(self):
        self.number += 1
        return sphere(60, solver={"seed": self.number}, output={"preview": False})

    def used(self):
        """ms of processor time of the daemon in which nothing runs."""
        tasks = pathlib.Path(f"/proc/{self.waiting.process.pid}/task")
        return sum(int((task / "schedstat").read_text().split()[0]) for task in tasks.iterdir()) / 1e6

    def load(self, what, paths, clients, *more):
        """A second, and ms of the daemon's processor time each."""
        used = self.used()
        done = subprocess.run([self.options.built / "measurements/service/load", what, self.waiting.socket, paths, str(clients),
                               f"{self.options.span}s", *more], check=True, stdout=subprocess.PIPE, text=True)
        told = json.loads(done.stdout)
        assert not told["failed"], told
        return told["rate"], (self.used() - used) / told["count"]

    def submissions(self):
        return self.load("post", self.place, CLIENTS, self.body)

    def reads(self):
        """Of jobs that do not change meanwhile: each is asked for once before, when the submissions before are written back."""
        before = 0
        while self.used() - before > QUIET_MS:
            before = self.used()
            time.sleep(QUIET_S)
        subprocess.run([self.options.built / "measurements/service/load", "get", self.waiting.socket, self.paths, "1", str(READ)], check=True,
                       stdout=subprocess.DEVNULL)
        return self.load("get", self.paths, READERS)

    def tiny_jobs(self):
        service, count = self.busy, self.options.jobs
        used, began = sum(cpu_seconds(service.process.pid)), time.monotonic()
        for _ in range(count):
            service.submit(self.tiny())
        wait_until(lambda: not service.get("/v1/jobs?state=queued,running&limit=1").json["jobs"], "the jobs to end")
        took = time.monotonic() - began
        assert not service.get("/v1/jobs?state=failed&limit=1").json["jobs"]
        return count / took, 1000 * (sum(cpu_seconds(service.process.pid)) - used) / count

    def end(self):
        for one in self.made:
            one.clean_up()


def measure(builds, rounds):
    """measure -> for each build the (rate, cost) of all rounds."""
    told = {name: ([], []) for name in ("submissions", "reads", "tiny_jobs")}
    for number in range(rounds):
        for name, results in told.items():
            for which in (0, 1) if number % 2 == 0 else (1, 0):
                results[which].append(getattr(builds[which], name)())
    return told


COLUMNS = ["rate", "before_per_s", "now_per_s", "ratio", "least_ratio", "greatest_ratio", "before_cpu_ms", "now_cpu_ms"]


def table(told):
    rows, ratios = [], {}
    for name, (before, now) in told.items():
        each = [n[0] / b[0] for b, n in zip(before, now)]
        ratios[name] = statistics.median(each)
        rates, costs = ([statistics.median(x[k] for x in one) for one in (before, now)] for k in (0, 1))
        rows.append([name.replace("_", " "), f"{rates[0]:.0f}", f"{rates[1]:.0f}", f"{ratios[name]:.3f}", f"{min(each):.2f}", f"{max(each):.2f}",
                     f"{costs[0]:.4f}", f"{costs[1]:.4f}"])
    return rows, ratios


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--built", type=lambda path: pathlib.Path(path).resolve(), required=True)
    parser.add_argument("--before", type=lambda path: pathlib.Path(path).resolve(), required=True)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--span", type=float, default=2)
    parser.add_argument("--jobs", type=int, default=100)
    parser.add_argument("--worker", type=lambda path: pathlib.Path(path).resolve())
    parser.add_argument("--least", type=float, default=0.95)
    parser.add_argument("--output", type=pathlib.Path)
    options = parser.parse_args()
    builds = []
    with tempfile.TemporaryDirectory() as where:
        where = pathlib.Path(where)
        worker = where / "worker"
        worker.write_text("#!/bin/sh\nexec sleep 1000000\n")
        worker.chmod(0o700)
        try:
            for name, built in (("before", options.before), ("now", options.built)):
                builds.append(Build(options, built, where / name, worker))
            told = measure(builds, options.rounds)
        finally:
            for one in builds:
                one.end()
    rows, ratios = table(told)
    print(f"{os.cpu_count()} processors, load average {os.getloadavg()[0]:.1f}, {options.rounds} rounds")
    for row in (COLUMNS, *rows):
        print(*row, sep=", ")
    if options.output:
        results.write(options.output, COLUMNS, rows)
    return 1 if min(ratios.values()) < options.least else 0


if __name__ == "__main__":
    sys.exit(main())
