# SPDX-License-Identifier: Apache-2.0
"""A seeded campaign of kills over the engine slurm: the daemon, the controller, node daemons and workers, in any
mixture, while jobs run. Every job that was acknowledged must end exactly once, with the bytes that the local engine
gives.

    farmtest.py BUILD [--jobs N] [--kills N] [--seed N]
"""
import argparse
import collections
import os
import pathlib
import random
import shutil
import signal
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "service"))
from cluster import Cluster, missing  # noqa: E402
from service import Service, wait_until  # noqa: E402

FINAL = ("succeeded", "failed", "cancelled", "timed_out")
SPECS = 20  # different ones; the cache is off, so that each job runs


def spec(number):
    return {"version": 1, "name": f"job {number}", "sampling": {"count": 100 + number % SPECS},
            "solver": {"seed": 1 + number % SPECS}, "output": {"preview": False},
            "surface": {"analytic": {"shape": "sphere", "center": [0, 0, 0], "radius": 1}}}


def kill_daemon(farm, slurm, chance):
    farm.end(chance.choice((signal.SIGKILL, signal.SIGTERM)))

    def start():
        """A child that was about to become sbatch may hold the lock for a moment."""
        try:
            return farm.start()
        except AssertionError as why:
            if "another hexad" not in str(why):
                raise
            return None
    wait_until(start, "a start")


def kill_controller(farm, slurm, chance):
    slurm.end("slurmctld", chance.choice((signal.SIGKILL, signal.SIGTERM)))
    if chance.random() < 0.2:  # it has lost all it was told
        shutil.rmtree(slurm.base / "state")
        (slurm.base / "state").mkdir()
    slurm.start_controller()


def kill_node(farm, slurm, chance):
    node = chance.choice(slurm.nodes)
    slurm.end(node)
    slurm.start_node(node)


def kill_worker(farm, slurm, chance):
    found = [pid for pid, words in slurm.steps().items()
             if any(w.endswith(("/hexad-worker", "/hexad-node")) for w in words[:1]) or words[0].startswith("slurmstepd")]
    if found:
        try:
            os.kill(chance.choice(found), signal.SIGKILL)
        except ProcessLookupError:
            pass


KILLS = {"daemon": kill_daemon, "controller": kill_controller, "node": kill_node, "worker": kill_worker}


def files_of(service, job):
    """The bytes of all outputs but the report, which holds times."""
    listed = service.get(f"/v1/jobs/{job}/results").json["results"]
    return {f["name"]: service.get(f"/v1/jobs/{job}/results/{f['name']}").body for f in listed
            if f["name"] != "report.json"}


def check(farm, jobs, expected):
    """How many jobs are not as they have to be, and how many attempts there were."""
    bad = made = 0
    for number, job in enumerate(jobs):
        now = farm.job(job)
        attempts = farm.get(f"/v1/jobs/{job}/attempts").json["attempts"]
        ended = [a for a in attempts if a.get("exit_status") == 0]
        made += len(attempts)
        found = now["state"] == "succeeded" and files_of(farm, job) == expected[number % SPECS]
        if found and len(ended) <= 1:
            continue
        bad += 1
        print(f"job {job}: {now['state']} {now['error']}, {len(ended)} attempts with results", flush=True)
    return bad, made


def run(build, base, jobs, kills, seed):
    chance, kinds, begin = random.Random(seed), collections.Counter(), time.monotonic()
    os.environ.pop("SLURM_CONF", None)
    local = Service(build, base / "local", "--cache", "0")
    local.base.mkdir()
    local.start()
    reference = [local.submit(spec(n)) for n in range(SPECS)]
    for job in reference:
        local.wait_state(job, "succeeded")
    expected = [files_of(local, job) for job in reference]
    local.end()
    slurm = Cluster(nodes=4, cpus=2, memory_mb=4000, node_timeout=5)
    farm = Service(build, base / "farm", "--engine", "slurm", "--work_dir", base / "farm/work", "--memory_mb", "300",
                   "--cache", "0", "--max_attempts", "100", "--max_interruptions", "0", "--retry_s", "0.1",
                   "--retry_most_s", "1", "--slurm_lost_s", "2", "--slurm_interval_s", "0.5")
    farm.base.mkdir()
    try:
        slurm.start()
        os.environ.update(SLURM_CONF=slurm.environment["SLURM_CONF"], PATH=slurm.environment["PATH"])
        farm.start()
        ids = []

        def kill():
            kind = chance.choice(list(KILLS))
            KILLS[kind](farm, slurm, chance)
            kinds[kind] += 1
        for number in range(jobs):
            ids.append(farm.submit(spec(number)))
            while kinds.total() * jobs < kills * (number + 1):
                kill()
        wait_until(lambda: all(farm.job(j)["state"] in FINAL for j in ids), "the end of all jobs", 60 + jobs)
        bad, made = check(farm, ids, expected)
        print(f"{jobs} jobs, {kinds.total()} kills {dict(kinds)}, seed {seed}: {made} attempts, "
              f"{time.monotonic() - begin:.0f} s, {bad} violations", flush=True)
        return bad
    finally:
        farm.clean_up()
        local.clean_up()
        slurm.clean_up()


def main():
    words = argparse.ArgumentParser()
    words.add_argument("build", type=pathlib.Path)
    words.add_argument("--jobs", type=int, default=2000)
    words.add_argument("--kills", type=int, default=300)
    words.add_argument("--seed", type=int, default=int(time.time()))
    given = words.parse_args()
    if missing():
        print(f"skipped: {missing()}")
        return 77
    base = pathlib.Path(tempfile.mkdtemp(prefix="farmtest."))
    print(f"seed {given.seed}, in {base}", flush=True)
    bad = run(given.build.resolve(), base, given.jobs, given.kills, given.seed)
    if not bad:
        shutil.rmtree(base)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
