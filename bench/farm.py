#!/usr/bin/env python3
"""Measures the engine slurm on a Slurm of four nodes on this machine, beside the local engine, and writes a page.

    farm.py BUILD PAGE [--small N] [--queued N]

--small: jobs of 1000 points, through Slurm and locally. --queued: tasks of an array that wait in Slurm while its
partition is down; then all are cancelled.
"""
import argparse
import os
import pathlib
import shutil
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "tests/service"))
from cluster import Cluster  # noqa: E402
from service import Service, sphere, wait_until  # noqa: E402

TICK = os.sysconf("SC_CLK_TCK")


def processor_s(pid, children=False):
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15] if children else fields[11:13])) / TICK


def resident_mb(pid):
    for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return 0


def run_small(service, count, slurm=None):
    """Wall time, processor time of the daemon itself, of Slurm's daemons."""
    service.post("/v1/admin/hold")
    jobs = [service.submit(sphere(1000, solver={"seed": n, "threads": 1}, output={"preview": False})) for n in range(count)]
    daemons = [p.pid for p in slurm.running.values()] if slurm else []
    own, theirs, begin = processor_s(service.process.pid), sum(map(processor_s, daemons)), time.monotonic()
    service.post("/v1/admin/release")
    service.wait_state(jobs[-1], "succeeded", seconds=3600)
    for job in jobs:
        service.wait_state(job, "succeeded", seconds=3600)
    return (time.monotonic() - begin, processor_s(service.process.pid) - own,
            sum(map(processor_s, daemons)) - theirs)


def run_queued(service, slurm, count):
    slurm.call("scontrol", "update", "partition=farm", "state=DOWN")
    begin = time.monotonic()
    job = service.submit(sphere(100000, output={"preview": False}, queue={
        "frames": f"1-{count}", "by_frame": {"/surface/analytic/radius": {"from": 1, "to": 2}}}))
    wait_until(lambda: slurm.jobs("%T").count("PENDING") == count, "all to be in Slurm's queue", 3600)
    queued_s = time.monotonic() - begin
    memory, own, begin = resident_mb(service.process.pid), processor_s(service.process.pid, True), time.monotonic()
    asked = time.monotonic()
    slurm.jobs()
    asked = time.monotonic() - asked
    time.sleep(30)
    share = (processor_s(service.process.pid, True) - own) / (time.monotonic() - begin)
    begin = time.monotonic()
    service.get("/v1/jobs")
    listed = time.monotonic() - begin
    begin = time.monotonic()
    service.post(f"/v1/jobs/{job}/cancel")
    service.wait_state(job, "cancelled", seconds=3600)
    cancelled = time.monotonic() - begin
    wait_until(lambda: not [s for s in slurm.jobs("%T") if s == "PENDING"], "an empty queue of Slurm", 3600)
    return queued_s, memory, asked, share, listed, cancelled, time.monotonic() - begin


def main():
    words = argparse.ArgumentParser()
    words.add_argument("build", type=pathlib.Path)
    words.add_argument("page", type=pathlib.Path)
    words.add_argument("--small", type=int, default=2000)
    words.add_argument("--queued", type=int, default=10000)
    given = words.parse_args()
    base = pathlib.Path(tempfile.mkdtemp(prefix="farm."))
    slurm = Cluster(nodes=4, cpus=1, memory_mb=4000, most_jobs=100000)
    common = ("--memory_mb", "300", "--cache", "0", "--log_level", "info", "--user_running", "0", "--user_queued", "0")
    local = Service(given.build.resolve(), base / "local", *common)
    farm = Service(given.build.resolve(), base / "farm", "--engine", "slurm", "--work_dir", base / "farm/work",
                   "--slurm_most_jobs", str(given.queued), *common)
    rows = []
    try:
        slurm.start()
        os.environ.update(SLURM_CONF=slurm.environment["SLURM_CONF"], PATH=slurm.environment["PATH"])
        for name, service, of in (("local, 2 workers", local, None), ("slurm, 4 nodes of 1 core", farm, slurm)):
            service.base.mkdir()
            service.start()
            wall, own, theirs = run_small(service, given.small, of)
            rows.append(f"| {name} | {given.small} | {wall:.1f} | {1000 * wall / given.small:.1f} | "
                        f"{1000 * own / given.small:.2f} | {1000 * theirs / given.small:.2f} |")
            print(rows[-1], flush=True)
        local.end()
        queued = run_queued(farm, slurm, given.queued)
    finally:
        local.clean_up()
        farm.clean_up()
        slurm.clean_up()
        shutil.rmtree(base, ignore_errors=True)
    given.page.write_text(PAGE.format(small=given.small, queued=given.queued, rows="\n".join(rows), cores=os.cpu_count(),
                                      load=os.getloadavg()[2], q=queued))


PAGE = """# The farm

`python3 bench/farm.py BUILD doc/measured/farm.md --small {small} --queued {queued}`: a Slurm of four nodes and the daemon on one
machine of {cores} cores, which others used, too (load average {load:.1f}). The figures say what the engine costs, not how a cluster
scales.

## Small jobs: 1000 points each

| engine | jobs | wall s | wall ms a job | processor ms of the daemon a job | of Slurm's daemons a job |
|---|---|---|---|---|---|
{rows}

The daemon's time is its own, without the commands that it calls and without workers.

## {queued} attempts in Slurm's queue

| what | |
|---|---|
| from the submission until all are in Slurm's queue | {q[0]:.1f} s |
| memory of the daemon then | {q[1]:.0f} MiB |
| one `squeue` for all | {q[2]:.2f} s |
| processor time of the daemon and its commands while they wait, in shares of a core | {q[3]:.3f} |
| `GET /v1/jobs` meanwhile | {q[4]:.3f} s |
| cancel all: until the job is cancelled | {q[5]:.1f} s |
| until Slurm's queue is empty | {q[6]:.1f} s |
"""


if __name__ == "__main__":
    main()
