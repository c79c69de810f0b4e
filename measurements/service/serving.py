#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The daemon against the machine it runs on, as ratios in one run, and what small jobs cost it.

    measurements/service/serving.py --built BUILD [--output measurements/service/service.csv] [--place DIRECTORY] [--rounds 5]
                     [--span SECONDS] [--waiting 100000] [--looks 500] [--streams 1000] [--jobs 100]

Prints the results and writes them: --output has the claims and the figures, connections.csv beside it the numbers of busy
connections. --place: a directory of the disk to be measured. What is compared alternates, --rounds times
for --span seconds each, and medians count, so that a noisy neighbour hits both. Claims of a run with fewer jobs
or streams than are claimed are not judged. Ends with 1 when a claim is missed.
"""
import argparse
import calendar
import collections
import datetime
import json
import os
import pathlib
import random
import re
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1] / "tests" / "service"), str(HERE.parent / "common")]

import results  # noqa: E402
from service import Service, cpu_seconds, long_sphere, sphere, wait_until  # noqa: E402

CLIENTS = 16
PAGE = 50  # jobs of a listing; the queue that counts as empty has a few more
STREAMS_OF_JOB = 20
# of those the library's own loop stalled at 128, 256 and 512
CONNECTIONS = (1, 16, 64, 127, 128, 129, 255, 256, 257, 511, 512, 513, 1023, 1024)
SHARED_FLUSHES = 7  # submissions to a flush, where flushing is slow
BUSY = 0.8  # of the processors, where it is fast
CLAIMED = {"waiting": 100000, "streams": 1000, "jobs": 100}
TICKS = os.sysconf("SC_CLK_TCK")

Claim = collections.namedtuple("Claim", "text wanted found met")
SMALL = {"no preview": {"output": {"preview": False}}, "default outputs": {"output": {}}}
OUTCOMES = {True: "met", False: "missed", None: "not judged"}


def cpu_model():
    found = re.search(r"^model name\s*: (.*)$", pathlib.Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return found.group(1) if found else "unknown"


def small_job(kind):
    return sphere(1000, **SMALL[kind])


def idle_seconds():
    """Of all processors, waiting for disks included."""
    fields = pathlib.Path("/proc/stat").read_text().split("\n", 1)[0].split()
    return sum(map(int, fields[4:6])) / TICKS


def at_ms(text):
    whole, _, ms = text.rstrip("Z").partition(".")
    return calendar.timegm(time.strptime(whole, "%Y-%m-%dT%H:%M:%S")) * 1000 + int(ms)


class Bench:
    def __init__(self, options, where):
        self.options, self.where = options, where
        self.claims, self.figures, self.connections = [], [], []
        self.made = []

    def figure(self, name, value, form="{}"):
        self.figures.append((name, form.format(value)))
        print(f"{name}: {form.format(value)}", flush=True)

    def claim(self, text, wanted, value, bound, at_least, form="{:.2f}", judged=True):
        met = None if not judged else value >= bound if at_least else value <= bound
        self.claims.append(Claim(text, wanted, form.format(value), met))
        print(f"{text}: {form.format(value)} ({wanted}){' MISSED' if met is False else ''}", flush=True)

    def service(self, *more):
        base = pathlib.Path(tempfile.mkdtemp(dir=self.where))
        one = Service(self.options.built, base, "--listen", f"unix:{base}/socket", "--log_level", "warning",
                      "--cache", 0, "--connection_limit", 4096, "--user_connection_limit", 2048,
                      "--user_queued", 0, "--user_submissions", 0, *more)
        one.socket = base / "socket"
        self.made.append(one)
        return one.start()

    def waiting_service(self):
        """Nothing of its queue runs: the one worker there is sleeps."""
        worker = self.where / "sleeping-worker"
        worker.write_text("#!/bin/sh\nexec sleep 1000000\n")
        worker.chmod(0o700)
        one = self.service("--worker", worker, "--workers", 1, "--threads", 1)
        one.wait_state(one.submit(sphere()), "running")
        return one

    def stop(self, one):
        one.clean_up()
        self.made.remove(one)

    def file(self, name, text):
        path = self.where / name
        path.write_text(text)
        return path

    def load(self, *words):
        done = subprocess.run([self.options.built / "measurements/service/load", *map(str, words)], check=True,
                              stdout=subprocess.PIPE, text=True)
        told = json.loads(done.stdout)
        if isinstance(told, dict) and told["failed"]:
            sys.exit(f"measurements/service/serving.py: {told['failed']} of {told['count']} requests failed: {words}")
        return told

    def post(self, one, connections, limit):
        body = self.file("body", json.dumps(small_job("no preview")))
        return self.load("post", one.socket, self.file("jobs", "/v1/jobs\n"), connections, limit, body)

    def rounds(self, *measures, times=1):
        """Of each measure the results of all rounds; `times` as many rounds."""
        return zip(*[[m() for m in measures] for _ in range(times * self.options.rounds)])


def submissions(b, one):
    """Jobs acknowledged a second, the daemon's processor time for each in ms, and the share of the processors that it
    and its clients took of what others left."""
    daemon, clients, idle = sum(cpu_seconds(one.process.pid)), sum(os.times()[2:4]), idle_seconds()
    told = b.post(one, CLIENTS, f"{b.options.span}s")
    daemon, clients, idle = (sum(cpu_seconds(one.process.pid)) - daemon, sum(os.times()[2:4]) - clients,
                             idle_seconds() - idle)
    return told["rate"], 1000 * daemon / told["count"], (daemon + clients) / max(daemon + clients + idle, 1 / TICKS)


def bench_submissions(b, one):
    """What bounds them is the disk's flushes, which they share, or where those are fast the processors."""
    rows, posts = b.rounds(lambda: b.load("rows", b.where, b.options.span), lambda: submissions(b, one))
    flush_ms = 1000 / statistics.median(rows)
    rate, own_ms, busy = (statistics.median(x) for x in zip(*posts))
    b.figure(f"Submissions of {CLIENTS} clients, acknowledged jobs a second", rate, "{:.0f}")
    b.figure("Durable transaction of one row with SQLite, ms", flush_ms, "{:.2f}")
    b.figure("Durable transactions of one row with SQLite, a second", 1000 / flush_ms, "{:.0f}")
    b.figure("Submission, CPU time of the daemon, ms", own_ms, "{:.3f}")
    b.figure("Submissions, busy share of the processors", busy, "{:.2f}")
    shared = statistics.median(p[0] / r for p, r in zip(posts, rows))
    b.claim(f"Submissions of {CLIENTS} clients over what disk or processors allow", "at least 1",
            max(shared / SHARED_FLUSHES, busy / BUSY), 1, True)


def bench_connections(b, one):
    """Each number of connections asks for a while, all of them at once."""
    paths = b.file("healthz", "/healthz\n")
    told, stalled = {}, []
    for count in CONNECTIONS:
        try:
            runs = [b.load("get", one.socket, paths, count, f"{b.options.span / 2}s") for _ in range(b.options.rounds)]
        except subprocess.CalledProcessError:  # no answer in time, or the connection was ended
            stalled.append(count)
            continue
        told[count] = [statistics.median(r[name] for r in runs) for name in ("rate", "p50_ms", "p99_ms", "max_ms")]
    b.claim(f"1 to {CONNECTIONS[-1]} busy connections: number of connections without an answer", "0",
            len(stalled), 0, False, "{:.0f}")
    if stalled:
        b.figure("Numbers of connections of which some had no answer", " ".join(map(str, stalled)))
    b.connections = [[count, f"{rate:.0f}", f"{p50:.2f}", f"{p99:.2f}", f"{longest:.1f}"]
                     for count, (rate, p50, p99, longest) in told.items()]
    for row in b.connections:
        print(*row, sep=", ", flush=True)
    if told:
        b.claim(f"Largest 99th percentile with 1 to {CONNECTIONS[-1]} connections, ms", "at most 250",
                max(p99 for _, _, p99, _ in told.values()), 250, False, "{:.1f}")


def paths_of_jobs(b, one, count):
    """A file with the paths of jobs that the listing has."""
    ids, cursor = [], ""
    while len(ids) < count:
        page = one.get(f"/v1/jobs?limit=500{cursor}").json
        ids += [j["id"] for j in page["jobs"]]
        cursor = f"&cursor={page['next']}"
        if not page["next"]:
            break
    random.Random(1).shuffle(ids)
    return b.file(f"paths.{one.base.name}", "".join(f"/v1/jobs/{i}\n" for i in ids[:count]))


def rate_and_cost(b, pid, socket, paths):
    """Answers a second, and microseconds of the server's processor time for each."""
    before = sum(cpu_seconds(pid))
    told = b.load("get", socket, paths, CLIENTS, f"{b.options.span}s")
    return told["rate"], (sum(cpu_seconds(pid)) - before) / told["count"] * 1e6


def bench_reads(b, one):
    paths = paths_of_jobs(b, one, 1000)
    size = b.load("get", one.socket, paths, 1, 1)["bytes"]
    socket = b.where / "bare"
    bare = subprocess.Popen([b.options.built / "measurements/service/bare", socket, str(size)], stdin=subprocess.PIPE,
                            stdout=subprocess.PIPE)
    bare.stdout.readline()
    try:
        theirs, ours = b.rounds(lambda: rate_and_cost(b, bare.pid, socket, paths),
                                lambda: rate_and_cost(b, one.process.pid, one.socket, paths))
    finally:
        bare.stdin.close()
        bare.wait()
    rates = [statistics.median(r for r, _ in x) for x in (ours, theirs)]
    costs = [statistics.median(c for _, c in x) for x in (ours, theirs)]
    b.figure("Status of 1 000 jobs in turn, bytes", size)
    for k, answers in enumerate(("Status reads", "Replies of a bare libmicrohttpd")):
        b.figure(f"{answers} over {CLIENTS} connections, a second", rates[k], "{:.0f}")
        b.figure(f"{answers}, CPU time of the server, us", costs[k], "{:.1f}")
    b.claim("Status reads over replies of a bare libmicrohttpd", "at least 0.40",
            statistics.median(o[0] / t[0] for o, t in zip(ours, theirs)), 0.4, True)


def bench_looks(b, small, full):
    o = b.options
    b.post(small, 1, PAGE + 10)
    b.post(full, 64, o.waiting)
    judged = o.waiting >= CLAIMED["waiting"]
    listing = b.file("listing", f"/v1/jobs?state=queued&limit={PAGE}\n")
    for what, empty_paths, full_paths in (
            ("List", listing, listing),
            ("Status", paths_of_jobs(b, small, PAGE), paths_of_jobs(b, full, min(o.waiting, 20000)))):
        # short rounds, and many: one pause of the machine is all that a percentile of such rounds tells of
        few, many = b.rounds(lambda: b.load("get", small.socket, empty_paths, 1, o.looks)["p99_ms"],
                             lambda: b.load("get", full.socket, full_paths, 1, o.looks)["p99_ms"], times=4)
        b.figure(f"{what} with {o.waiting} waiting jobs, 99th percentile, ms", statistics.median(many), "{:.3f}")
        b.figure(f"{what} with {PAGE + 10} waiting jobs, 99th percentile, ms", statistics.median(few), "{:.3f}")
        b.claim(f"{what} with 100 000 waiting jobs over {PAGE + 10}, 99th percentile", "at most 3",
                statistics.median(m / f for m, f in zip(many, few)), 3, False, judged=judged)


def bench_claims(b):
    """A claim is the executor's, not a client's: the queue's own benchmark has it, with as many jobs."""
    if b.options.waiting < CLAIMED["waiting"]:
        return
    done = subprocess.run([b.options.built / "measurements/service/queue", b.where], stdout=subprocess.PIPE, text=True)
    ratio = float(re.search(r"^claim +([\d.]+)", done.stdout, re.MULTILINE).group(1))
    b.claim("Claim with 100 000 waiting jobs over an empty queue, 99th percentile (make bench-queue)", "at most 3", ratio, 3, False)


def bench_streams(b):
    """Streams of jobs that wait are opened; then the one goes that all wait for."""
    one, count = b.service(), b.options.streams
    first = one.submit(long_sphere(queue={"priority": 100}))
    one.wait_state(first, "running")
    jobs = [one.submit(small_job("no preview") | {"queue": {"depends_on": [one.submit(small_job("no preview"))]}})
            for _ in range(max(1, count // STREAMS_OF_JOB))]
    paths = b.file("streams", "".join(f"/v1/jobs/{j}/events\n" for j in jobs))
    client = subprocess.Popen([b.options.built / "measurements/service/load", "streams", one.socket, paths,
                               str(count // len(jobs))], stdout=subprocess.PIPE, text=True)
    assert client.stdout.readline() == "open\n"
    assert one.post(f"/v1/jobs/{first}/cancel").status in (200, 202)
    got = [json.loads(line) for line in client.stdout]
    whole, latest = 0, 0.0
    events = {f"/v1/jobs/{j}/events": one.get(f"/v1/jobs/{j}/events?limit=500").json["events"] for j in jobs}
    for stream in got:
        told = events[stream["path"]]
        whole += stream["ids"] == [e["seq"] for e in told] and told[-1]["state"] == "succeeded"
        latest = max([latest, *(ms - at_ms(e["at"]) for ms, e in zip(stream["received_ms"], told)
                                if e["type"] != "state" or e["state"] not in ("blocked", "queued"))])
    b.stop(one)
    b.figure("Open event streams", count)
    b.figure("Jobs with open event streams", len(jobs))
    b.figure("Open event streams with every event until the job's end", whole)
    b.figure("Largest delay of an event, ms", latest, "{:.0f}")
    b.claim("1 000 open event streams: share with every event until the job's end", "1",
            whole / count, 1, True, "{:.4g}", count >= CLAIMED["streams"])


def run_alone(b, kind, count, at_once):
    """Processor time of a job by the worker alone, as many at once as the service has."""
    spec = b.file("spec.json", json.dumps(small_job(kind)))
    used = os.times()
    running = []
    for i in range(count):
        running.append(subprocess.Popen([b.options.built / "hexad-worker", "run", spec, "--threads", "1", "--output",
                                         b.where / f"alone.{i}"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        while len(running) == at_once or (i + 1 == count and running):
            assert running.pop(0).wait() in (0, 10, 11)
    now = os.times()
    return (now.children_user + now.children_system - used.children_user - used.children_system) / count


def run_served(b, one, kind, count):
    """Of a batch: processor time of the daemon and of its workers for each job, and the share of the processors that
    they took of what others left, while there were jobs that waited."""
    daemon, workers = cpu_seconds(one.process.pid)
    ids = [one.submit(small_job(kind)) for _ in range(count)]
    idle, used = idle_seconds(), sum(cpu_seconds(one.process.pid))
    wait_until(lambda: not one.get("/v1/jobs?state=queued&limit=1").json["jobs"], "the jobs to be begun")
    idle, used = idle_seconds() - idle, sum(cpu_seconds(one.process.pid)) - used
    for job in ids:
        one.wait_state(job, "succeeded")
        for result in one.get(f"/v1/jobs/{job}/results").json["results"]:
            assert one.get(result["href"]).status == 200
    after = cpu_seconds(one.process.pid)
    return (after[0] - daemon) / count, (after[1] - workers) / count, used / max(used + idle, 1 / TICKS)


def bench_small_jobs(b):
    cores = len(os.sched_getaffinity(0))
    count = b.options.jobs
    judged = count >= CLAIMED["jobs"]
    one = b.service("--workers", cores)
    for kind in SMALL:
        # once: processor time of so many jobs does not depend much on the neighbours
        alone = run_alone(b, kind, count, cores)
        daemon, worker, busy = run_served(b, one, kind, count)
        own = 1000 * (daemon + worker - alone)
        for program, used in (("of the daemon each", daemon), ("of the worker each", worker), ("of the worker alone", alone)):
            b.figure(f"{count} jobs of 1 000 points, {kind}: CPU time {program}, ms", 1000 * used, "{:.1f}")
        b.claim(f"A job of 1 000 points, {kind}: CPU time of the service, ms", "at most 100", own, 100, False,
                "{:.1f}", judged)
        b.claim(f"Busy share of the processors while jobs wait, without other processes, {kind}", "at least 0.90", busy, 0.9, True,
                "{:.3f}", judged)
    b.stop(one)


def measure(b):
    load = os.getloadavg()[0]
    small, full = b.waiting_service(), b.waiting_service()
    bench_looks(b, small, full)
    bench_reads(b, full)
    bench_connections(b, small)
    bench_submissions(b, small)
    b.stop(small)
    b.stop(full)
    bench_claims(b)
    bench_streams(b)
    bench_small_jobs(b)
    for name, value in (("Processor", cpu_model()), ("Processor cores", len(os.sched_getaffinity(0))),
                        ("Date", datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%MZ")),
                        ("Load average at the start", f"{load:.1f}"), ("Rounds", b.options.rounds)):
        b.figure(name, value)
    results.write(b.options.output, ["quantity", "bound", "measured", "outcome"],
                  [[c.text, c.wanted, c.found, OUTCOMES[c.met]] for c in b.claims] + [[name, "", value, ""] for name, value in b.figures])
    results.write(b.options.output.with_name("connections.csv"),
                  ["busy_connections", "answers_per_s", "median_ms", "p99_ms", "longest_ms"], b.connections)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--built", type=pathlib.Path, required=True)
    parser.add_argument("--output", type=pathlib.Path, default=HERE / "service.csv")
    parser.add_argument("--place", type=pathlib.Path, default=None)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--span", type=float, default=2.0)
    parser.add_argument("--looks", type=int, default=500)
    for name, value in CLAIMED.items():
        parser.add_argument(f"--{name}", type=int, default=value)
    options = parser.parse_args()
    options.built = options.built.resolve()
    with tempfile.TemporaryDirectory(dir=options.place) as where:
        b = Bench(options, pathlib.Path(where))
        try:
            measure(b)
        finally:
            for one in b.made:
                one.clean_up()
    return 1 if any(c.met is False for c in b.claims) else 0


if __name__ == "__main__":
    sys.exit(main())
