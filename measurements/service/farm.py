#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures the engine slurm on a Slurm of four nodes on this machine, beside the local engine.

    farm.py BUILD [--output measurements/service/farm.csv] [--small N] [--large N] [--queued N]     (--queued 0: only the jobs)

Prints the results and writes them: each quantity with local workers and with Slurm.

--small: jobs of 1000 points, through Slurm and locally; --large: of a million, besides. --queued: tasks of an array that
wait in Slurm while its partition is down; then all are cancelled. How late progress and cancellation are is measured with
a worker that writes the time.
"""
import argparse
import os
import pathlib
import shutil
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1] / "tests/service"), str(HERE.parent / "common")]
import results  # noqa: E402
from cluster import Cluster  # noqa: E402
from service import Service, Stream, cpu_seconds, sphere, wait_until  # noqa: E402

TICK = os.sysconf("SC_CLK_TCK")
# CPU time of the daemon is without the commands that it calls and without workers; other processes are the daemons, Slurm, and other load
JOB_QUANTITIES = ("jobs", "wall_s", "daemon_cpu_ms_a_job", "slurm_daemons_cpu_ms_a_job", "workers_share_of_cores",
                  "other_processes_share_of_cores", "idle_share_of_cores")
SLURM_QUANTITIES = ("progress_to_event_at_most_s", "cancellation_to_end_of_worker_at_most_s", "attempts_in_queue",
                    "submission_to_all_in_queue_s", "daemon_memory_then_mib", "one_squeue_s", "waiting_daemon_share_of_a_core", "get_jobs_s",
                    "cancel_until_job_cancelled_s", "cancel_until_queue_empty_s", "cores", "load_average_at_the_end")


def resident_mb(pid):
    for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return 0


def machine_s():
    """Processor time of all processes of the machine."""
    fields = list(map(int, pathlib.Path("/proc/stat").read_text().splitlines()[0].split()[1:9]))
    return (sum(fields) - fields[3] - fields[4]) / TICK


def await_idle(service):
    """Asks little, so that this takes no time of what is measured."""
    while any(service.get(f"/v1/jobs?limit=1&state={state}").json["jobs"] for state in ("queued", "running")):
        time.sleep(0.25)


def worker_s(service, job):
    """Processor time of its workers, as the nodes tell."""
    assert service.job(job)["state"] == "succeeded"
    return sum(a.get("processor_ms", 0) for a in service.get(f"/v1/jobs/{job}/attempts").json["attempts"]) / 1000


def run_jobs(service, given, slurm=None):
    """Wall time; processor time of the daemon itself, of Slurm's daemons, of the workers, and of the whole machine."""
    assert service.post("/v1/admin/hold").status == 200
    jobs = [service.submit(sphere(count, solver={"seed": n, "threads": 1}, output={"preview": False}, limits={"memory_mb": memory}))
            for count, memory, many in ((1000000, 2000, given.large), (1000, 300, given.small)) for n in range(many)]
    daemons = [p.pid for p in slurm.running.values()] if slurm else []
    own, theirs, begin = cpu_seconds(service.process.pid)[0], sum(cpu_seconds(pid)[0] for pid in daemons), time.monotonic()
    all_s = machine_s()
    service.post("/v1/admin/release")
    await_idle(service)
    wall, all_s = time.monotonic() - begin, machine_s() - all_s
    own, theirs = cpu_seconds(service.process.pid)[0] - own, sum(cpu_seconds(pid)[0] for pid in daemons) - theirs
    return wall, own, theirs, sum(worker_s(service, job) for job in jobs), all_s


# Says every third of a second what time it is, ten seconds long; then waits to be cancelled.
CLOCK = """#!/bin/sh
cat >/dev/null
for i in $(seq 30); do echo "{\\"phase\\":\\"relax\\",\\"fraction\\":0.5,\\"now\\":$(date +%s.%N)}" >&3; sleep 0.33; done
exec sleep 1000
"""


def run_clock(service, slurm):
    """How late progress is in a stream of events, and the end of a worker after a cancellation: the latest."""
    job, late = service.submit(sphere()), []
    stream = Stream(service, f"/v1/jobs/{job}/events")
    for _, kind, document in stream:
        now = document.get("progress", document).get("now")
        late += [time.time() - now] if now else []
        if len(late) >= 10:
            break
    stream.close()
    asked = time.monotonic()
    service.post(f"/v1/jobs/{job}/cancel")
    wait_until(lambda: not [1 for words in slurm.steps().values() if any(f"/farm/{job}." in w for w in words)], "its end")
    return max(late), time.monotonic() - asked


def run_queued(service, slurm, count):
    slurm.call("scontrol", "update", "partition=farm", "state=DOWN")
    begin = time.monotonic()
    job = service.submit(sphere(100000, output={"preview": False}, queue={
        "frames": f"1-{count}", "by_frame": {"/surface/analytic/radius": {"from": 1, "to": 2}}}))
    wait_until(lambda: slurm.jobs("%T").count("PENDING") == count, "all to be in Slurm's queue", 3600)
    queued_s = time.monotonic() - begin
    memory, own, begin = resident_mb(service.process.pid), sum(cpu_seconds(service.process.pid)), time.monotonic()
    asked = time.monotonic()
    slurm.jobs()
    asked = time.monotonic() - asked
    time.sleep(30)
    share = (sum(cpu_seconds(service.process.pid)) - own) / (time.monotonic() - begin)
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
    words.add_argument("--output", type=pathlib.Path, default=HERE / "farm.csv")
    words.add_argument("--small", type=int, default=2000)
    words.add_argument("--large", type=int, default=20)
    words.add_argument("--queued", type=int, default=10000, help="0: only the jobs, and no file")
    given = words.parse_args()
    base = pathlib.Path(tempfile.mkdtemp(prefix="farm."))
    slurm = Cluster(nodes=4, cpus=1, memory_mb=4000, most_jobs=100000)
    common = ("--memory_mb", "300", "--cache", "0", "--log_level", "info", "--user_running", "0", "--user_queued", "0")
    local = Service(given.build.resolve(), base / "local", "--listen", f"unix:{base}/local.sock", *common)
    farm = Service(given.build.resolve(), base / "farm", "--engine", "slurm", "--work_dir", base / "farm/work",
                   "--slurm_job_limit", str(max(given.queued, 2000)), "--listen", f"unix:{base}/farm.sock", *common)
    clock = base / "clock"
    clock.write_text(CLOCK)
    clock.chmod(0o755)
    watched = Service(given.build.resolve(), base / "watched", "--engine", "slurm", "--work_dir", base / "watched/work",
                      "--worker", str(clock), *common)
    found = []
    try:
        slurm.start()
        os.environ.update(SLURM_CONF=slurm.environment["SLURM_CONF"], PATH=slurm.environment["PATH"])
        for service, of in ((local, None), (farm, slurm)):
            service.base.mkdir()
            service.start()
            wall, own, theirs, workers, whole = run_jobs(service, given, of)
            count, there_was = given.small + given.large, wall * os.cpu_count()
            found.append([count, f"{wall:.1f}", f"{1000 * own / count:.2f}", f"{1000 * theirs / count:.2f}", f"{workers / there_was:.2f}",
                          f"{(whole - workers) / there_was:.2f}", f"{1 - whole / there_was:.2f}"])
            print("slurm" if of else "local", *found[-1], sep=", ", flush=True)
        local.end()
        if not given.queued:
            return
        watched.base.mkdir()
        late = run_clock(watched.start(), slurm)
        watched.end()
        print(f"progress {late[0]:.2f} s late, cancelled after {late[1]:.2f} s", flush=True)
        queued = run_queued(farm, slurm, given.queued)
    finally:
        local.clean_up()
        farm.clean_up()
        watched.clean_up()
        slurm.clean_up()
        shutil.rmtree(base, ignore_errors=True)
    own = [f"{late[0]:.2f}", f"{late[1]:.2f}", given.queued, f"{queued[0]:.1f}", f"{queued[1]:.0f}", f"{queued[2]:.2f}", f"{queued[3]:.3f}",
           f"{queued[4]:.3f}", f"{queued[5]:.1f}", f"{queued[6]:.1f}", os.cpu_count(), f"{os.getloadavg()[2]:.1f}"]
    rows = [list(row) for row in zip(JOB_QUANTITIES, *found)] + [[name, "", value] for name, value in zip(SLURM_QUANTITIES, own)]
    for row in rows:
        print(*row, sep=", ")
    results.write(given.output, ["quantity", "local", "slurm"], rows)


if __name__ == "__main__":
    main()
