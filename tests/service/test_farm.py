"""What goes wrong on clusters, and must not go wrong here, with a real Slurm of several nodes on this machine. Minutes of
waiting for Slurm: `make farmtest` runs it; test_slurm.py is the short form."""
import os
import shutil
import signal
import subprocess

import pytest

from service import long_sphere, sphere, wait_until
from slurm_farm import attempts, front, gate, all_ended, needs_slurm, new_cluster, new_farm, on_nodes, points, \
    running_cluster, slurm, wait_running

pytestmark = needs_slurm


def test_small_jobs_share_slurm_jobs(slurm, new_farm):
    farm = new_farm("--slurm_together", "8")
    farm.post("/v1/admin/hold")
    ids = [farm.submit(sphere(50 + i, output={"preview": False})) for i in range(60)]
    farm.post("/v1/admin/release")
    for job in ids:
        farm.wait_state(job, "succeeded")
        assert len(attempts(farm, job)) == 1
    tasks = slurm.jobs("%F_%K %j")
    assert len(tasks) < 40, tasks


def test_progress_cancel_and_time_limit(new_cluster, new_farm):
    slurm, farm = new_cluster(nodes=1, cpus=1), new_farm()
    runs = farm.submit(long_sphere())
    wait_until(lambda: (farm.job(runs)["progress"] or {}).get("phase") == "relax", "progress")
    waits = farm.submit(long_sphere())
    wait_until(lambda: any("PENDING" in line for line in slurm.jobs()), "a job that waits in Slurm")
    assert wait_until(lambda: farm.job(waits)["progress"], "a reason")["phase"] == "queue"
    for job in (waits, runs):
        farm.post(f"/v1/jobs/{job}/cancel")
        assert farm.wait_state(job, "cancelled")["error"]["code"] == "cancelled"
    wait_until(lambda: not on_nodes(slurm, runs, "hexad-worker"), "the worker's end")
    wait_until(lambda: all_ended(slurm), "an empty queue of Slurm")
    late = farm.submit(long_sphere(limits={"timeout_s": 1}))
    assert farm.wait_state(late, "timed_out")["error"]["code"] == "limit_time"


# ---- 1: an answer is lost

def test_a_submission_that_was_not_accepted_is_made_again(slurm, new_farm, front):
    where = front("sbatch", 'echo x >>"$where/calls"; [ $(wc -l <"$where/calls") -gt 1 ] && exec "$real" "$@"; '
                            'echo "sbatch: error: Socket timed out on send/recv operation" >&2; exit 1')
    farm = new_farm()
    job = farm.submit(sphere())
    farm.wait_state(job, "succeeded")
    assert len(slurm.jobs()) == 1 and (where / "calls").read_text() == "x\nx\n"
    assert [a["reason"][:24] for a in attempts(farm, job)] == ["Slurm does not know the ", "exit status 0"]


def test_a_slurm_that_is_full_is_asked_again(slurm, new_farm, front):
    """sbatch repeats by itself, and is cut short."""
    where = front("sbatch", 'echo x >>"$where/calls"; [ $(wc -l <"$where/calls") -gt 1 ] && exec "$real" "$@"; '
                            'echo "sbatch: error: Slurm temporarily unable to accept job, sleeping and retrying" >&2; exec sleep 100')
    farm = new_farm("--slurm_command_s", "1")
    job = farm.submit(sphere())
    farm.wait_state(job, "succeeded")
    assert len(attempts(farm, job)) == 1 and len(slurm.jobs()) == 1 and (where / "calls").read_text() == "x\nx\n"


# ---- 2: the controller is away

def test_nothing_is_decided_while_the_controller_is_away(new_cluster, new_farm, gate):
    slurm, farm = new_cluster(), new_farm("--worker", gate)
    ends, goes_on = farm.submit(sphere()), farm.submit(sphere(201))
    for job in (ends, goes_on):
        wait_running(slurm, farm, job)
    slurm.end("slurmctld", signal.SIGTERM)
    wait_until(lambda: "squeue does not answer" in farm.log.read_text(), "a complaint")
    waits = farm.submit(sphere(202))
    farm.open_gate(ends)
    farm.wait_state(ends, "succeeded")  # its node has said so
    assert farm.job(goes_on)["state"] == farm.job(waits)["state"] == "running"
    slurm.start_controller()
    for job in (goes_on, waits):
        farm.open_gate(job)
        farm.wait_state(job, "succeeded")
    for job in (ends, goes_on, waits):
        assert len(attempts(farm, job)) == 1


# ---- 3: the controller forgets

def test_jobs_that_the_controller_forgot_run_again_and_their_numbers_are_not_trusted(new_cluster, new_farm, gate):
    slurm, farm = new_cluster(), new_farm("--worker", gate)
    job = farm.submit(sphere())
    wait_running(slurm, farm, job)
    (number,) = slurm.jobs("%F")
    slurm.end("slurmctld")
    shutil.rmtree(slurm.base / "state")
    (slurm.base / "state").mkdir()
    slurm.start_controller()
    other = subprocess.run(["sbatch", "--parsable", "--job-name=other", "--mem=10", "--output=/dev/null", "--chdir=/"],
                           input="#!/bin/sh\nexec sleep 1000\n", text=True, capture_output=True, env=slurm.environment)
    assert other.stdout.strip() == number, other
    wait_until(lambda: len(attempts(farm, job)) == 2, "a second attempt")
    wait_running(slurm, farm, job)
    farm.open_gate(job)
    farm.wait_state(job, "succeeded")
    assert attempts(farm, job)[0]["reason"].startswith("Slurm does not know the job")
    assert {"other RUNNING", "other PENDING"} & set(slurm.jobs())


# ---- 4: a node dies and its process goes on

@pytest.mark.parametrize("wakes", ["before", "during"])
def test_what_an_orphan_writes_reaches_no_result(new_cluster, new_farm, gate, wakes):
    slurm, farm = new_cluster(node_timeout=2), new_farm("--worker", gate)
    job = farm.submit(sphere())
    wait_running(slurm, farm, job)
    (node,) = slurm.jobs("%N")
    orphans = [pid for pid, words in slurm.steps().items() if any(f"{job}.1" in w for w in words)]
    for pid in orphans:
        os.kill(pid, signal.SIGSTOP)
    slurm.end(node)
    wait_until(lambda: len(attempts(farm, job)) == 2, "a second attempt")
    wait_until(lambda: any(f"{job}.2" in w for words in slurm.steps().values() for w in words), "its worker")
    farm.open_gate(f"{job}.1")
    if wakes == "during":
        farm.open_gate(f"{job}.2")
    for pid in orphans:
        os.kill(pid, signal.SIGCONT)
    wait_until(lambda: not any(f"{job}.1" in w for words in slurm.steps().values() for w in words), "the orphan's end")
    farm.open_gate(f"{job}.2")
    farm.wait_state(job, "succeeded")
    assert points(farm, job) == b"2"
    assert "NODE_FAIL" in attempts(farm, job)[0]["reason"]


# ---- 5: what Slurm says of a job

STATES = [("PREEMPTED", "succeeded", None, "(PREEMPTED)"),
          ("NODE_FAIL", "succeeded", None, "(NODE_FAIL)"),
          ("CANCELLED", "succeeded", None, "cancelled by somebody else"),
          ("TIMEOUT", "timed_out", "limit_time", "(TIMEOUT)"),
          ("OUT_OF_MEMORY", "failed", "limit_memory", "out of memory")]


@pytest.mark.parametrize("state, end, code, reason", STATES, ids=[s[0] for s in STATES])
def test_each_state_of_slurm_has_its_code(new_cluster, new_farm, front, gate, state, end, code, reason):
    """The job is really stopped by Slurm; only the word for it is put in its place."""
    slurm = new_cluster(nodes=1)
    front("squeue", f'"$real" "$@" | sed "s/CANCELLED/{state}/"')
    farm = new_farm("--worker", gate, "--max_attempts", "2")
    job = farm.submit(sphere())
    wait_running(slurm, farm, job)
    slurm.call("scancel", slurm.jobs("%F")[0])
    if end == "succeeded":
        wait_until(lambda: len(attempts(farm, job)) == 2, "a second attempt")
        farm.open_gate(job)
    now = farm.wait_state(job, end)
    assert (now["error"] or {}).get("code") == code
    assert reason in attempts(farm, job)[0]["reason"]


# ---- 6: the daemon is killed; storage and clocks fail

@pytest.mark.parametrize("script", ['touch "$where/here"; sleep 2; exec "$real" "$@"',
                                    '"$real" "$@"; touch "$where/here"; sleep 2',
                                    'touch "$where/here"; sleep 100'], ids=["before", "after", "never"])
def test_a_daemon_killed_while_it_submits_runs_each_job_once(slurm, new_farm, front, script):
    where = front("sbatch", f'[ -e "$where/here" ] && exec "$real" "$@"; {script}')
    farm = new_farm()
    job = farm.submit(sphere())
    wait_until((where / "here").exists, "sbatch")
    farm.end(signal.SIGKILL)
    farm.start()
    farm.wait_state(job, "succeeded")
    assert sum(a["exit_status"] == 0 for a in attempts(farm, job)) == 1
    wait_until(lambda: all_ended(slurm), "an empty queue of Slurm")


def test_a_node_that_cannot_write_fails_its_attempts_only(new_cluster, new_farm):
    slurm, farm = new_cluster(nodes=1), new_farm("--max_attempts", "2")
    hidden = farm.base / "work/farm"
    farm.post("/v1/admin/hold")
    job = farm.submit(sphere())
    slurm.call("scontrol", "update", "partition=farm", "state=DOWN")
    farm.post("/v1/admin/release")
    wait_until(lambda: "PENDING" in slurm.jobs("%T"), "a job that waits in Slurm")
    hidden.rename(farm.base / "work/away")
    slurm.call("scontrol", "update", "partition=farm", "state=UP")
    wait_until(lambda: "FAILED" in slurm.jobs("%T"), "its failure")
    (farm.base / "work/away").rename(hidden)
    farm.wait_state(job, "succeeded")
    assert attempts(farm, job)[0]["exit_status"] is None
