# SPDX-License-Identifier: Apache-2.0
"""The engine slurm, with a real Slurm of two nodes on this machine. What goes wrong on clusters is in test_farm.py, for
`make farmtest`."""
import collections
import os
import shutil
import signal

import pytest

from service import sphere, wait_until
from slurm_farm import all_ended, array, attempts, attempts_of_frames, make_footage, needs_slurm, on_nodes, points, wait_running

pytestmark = [pytest.mark.extended, needs_slurm]


def test_jobs_run_on_the_nodes_with_the_results_of_the_local_engine(slurm, new_farm, new_service):
    farm = new_farm()
    local = new_service("--memory_mb", "300").start()
    for count in (200, 300):
        there, here = farm.submit(sphere(count)), local.submit(sphere(count))
        farm.wait_state(there, "succeeded")
        local.wait_state(here, "succeeded")
        assert points(farm, there) == points(local, here)
        (attempt,) = attempts(farm, there)
        assert attempt["exit_status"] == 0 and min(attempt[k] for k in ("peak_memory_bytes", "waited_ms", "processor_ms")) > 0
    assert len({line.split()[0] for line in slurm.jobs()}) == 2
    wait_until(lambda: not any((farm.base / "work/farm").iterdir()), "an empty farm")
    assert not (farm.state / "results").exists()
    assert (farm.base / "work/instance").exists()


def test_slurm_is_told_what_a_job_needs(slurm, new_farm, front):
    where = front("sbatch", 'echo "$@" >"$where/words"; exec "$real" "$@"')
    farm = new_farm("--slurm_accounts", "somebody=other,*=film", "--slurm_options", "--comment=hexad",
                    "--slurm_allow", "--partition=farm,--constraint")
    for option in ("--partition=other", "--qos=high", "--constraint=a\n--uid=0"):
        refused = farm.post("/v1/jobs", sphere(queue={"slurm": ["--partition=farm", option]}))
        assert refused.status == 422 and refused.json["errors"][0]["pointer"] == "/queue/slurm/1"
    job = farm.submit(sphere(queue={"priority": 10, "slurm": ["--partition=farm"]}, limits={"timeout_s": 100, "memory_mb": 400}, solver={"threads": 2}))
    farm.wait_state(job, "succeeded")
    words = (where / "words").read_text().split()
    assert {"--account=film", "--comment=hexad", "--cpus-per-task=2", "--mem=400", "--nice=990", "--no-requeue",
            "--partition=farm"} < set(words)
    assert any(word.startswith("--time=") for word in words)


def test_slurm_and_its_nodes_get_a_short_environment(slurm, new_farm, front, tmp_path, monkeypatch):
    """sbatch exports its own to the nodes."""
    worker = tmp_path / "shows"
    worker.write_text(f"#!/bin/sh\ncat > /dev/null\n/usr/bin/env > {tmp_path}/of_worker\n"
                      f"tr '\\0' '\\n' < /proc/$PPID/environ > {tmp_path}/of_node\nexit 3\n")
    worker.chmod(0o755)
    front("sbatch", f'/usr/bin/env > {tmp_path}/of_sbatch; exec "$real" "$@"')
    for name in ("HEXAD_TOKEN", "CREDENTIALS_DIRECTORY", "ANY"):
        monkeypatch.setenv(name, "a secret")
    farm = new_farm("--worker", worker)
    farm.wait_state(farm.submit(sphere()), "failed")
    of_sbatch, of_node, of_worker = ((tmp_path / name).read_text() for name in ("of_sbatch", "of_node", "of_worker"))
    assert "SLURM_CONF=" in of_sbatch and "PATH=" in of_worker
    assert "a secret" not in of_sbatch + of_node + of_worker and "SLURM_" not in of_worker


@pytest.mark.parametrize("fault", ['"$real" "$@" >/dev/null; echo "sbatch: error: Batch job submission failed: Socket '
                                   'timed out on send/recv operation" >&2; exit 1',
                                   '"$real" "$@"; sleep 100'])
def test_a_submission_that_was_accepted_without_an_answer_is_found_again(slurm, new_farm, front, fault):
    front("sbatch", f'echo x >>"$where/calls"; {fault}')
    farm = new_farm("--slurm_timeout_s", "1")
    job = farm.submit(sphere())
    farm.wait_state(job, "succeeded")
    assert len(attempts(farm, job)) == 1 and len(slurm.jobs()) == 1
    assert (front("sbatch", 'exec "$real" "$@"') / "calls").read_text() == "x\n"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_attempts_run_on_without_the_daemon(slurm, new_farm, gate, number):
    farm = new_farm("--worker", gate)
    ends, goes_on = farm.submit(sphere()), farm.submit(sphere(201))
    for job in (ends, goes_on):
        wait_running(slurm, farm, job)
    hosts = wait_until(lambda: all(found := [w["host"] for w in farm.get("/v1/workers").json["workers"]]) and found, "their hosts")
    assert sorted(hosts) == sorted(slurm.jobs("%N"))
    slurm.call("scontrol", "update", "partition=farm", "state=DOWN")
    waits = farm.submit(sphere(202))
    wait_until(lambda: "PENDING" in slurm.jobs("%T"), "a job that waits in Slurm")
    assert farm.end(number) == (-number if number == signal.SIGKILL else 0)
    slurm.call("scontrol", "update", "partition=farm", "state=UP")
    farm.open_gate(ends)
    wait_until(lambda: not on_nodes(slurm, ends), "the worker's end")
    stale = farm.base / "work/farm/01aaaaaaaaaaaaaaaaaaaaaaaa.1"  # as a crash after a settlement leaves it
    shutil.copytree(farm.base / f"work/farm/{goes_on}.1", stale)
    farm.start()
    farm.wait_state(ends, "succeeded")
    wait_until(lambda: not stale.exists(), "its removal")
    for job in (goes_on, waits):
        farm.open_gate(job)
        farm.wait_state(job, "succeeded")
    for job in (ends, goes_on, waits):
        assert len(attempts(farm, job)) == 1
    assert len(slurm.jobs()) == 3


def test_a_paused_job_leaves_the_queue_of_slurm(slurm, new_farm):
    slurm.call("scontrol", "update", "partition=farm", "state=DOWN")
    farm = new_farm()
    job = farm.submit(sphere())
    assert wait_until(lambda: farm.job(job)["progress"], "a reason")["phase"] == "queue"
    farm.post(f"/v1/jobs/{job}/pause")
    farm.wait_state(job, "paused")
    wait_until(lambda: all_ended(slurm), "an empty queue of Slurm")
    slurm.call("scontrol", "update", "partition=farm", "state=UP")
    farm.post(f"/v1/jobs/{job}/resume")
    farm.wait_state(job, "succeeded")
    assert [a["reason"][:8] for a in attempts(farm, job)] == ["paused: ", "exit sta"]


def test_a_priority_that_is_changed_reaches_slurm(slurm, new_farm):
    slurm.call("scontrol", "update", "partition=farm", "state=DOWN")
    farm = new_farm()
    job = farm.submit(sphere())
    wait_until(lambda: "1000 PENDING" in slurm.jobs("%y %T"), "the job in Slurm's queue")
    done = farm.request("PATCH", f"/v1/jobs/{job}", '{"priority": 50}', {"Content-Type": "application/json"})
    assert done.status == 200
    wait_until(lambda: [j for j in slurm.jobs("%y %T") if "PENDING" in j] == ["950 PENDING"], "its new priority there")
    slurm.call("scontrol", "update", "partition=farm", "state=UP")
    farm.wait_state(job, "succeeded")
    assert [a["reason"][:8] for a in attempts(farm, job)] == ["priority", "exit sta"]


def test_frames_are_one_job_and_a_retry_runs_those_that_failed(slurm, new_farm, tmp_path):
    """`make farmtest` has 1000 of them."""
    footage = make_footage(tmp_path, (1, 2, 4, 5, 6))
    farm = new_farm("--input_roots", footage)
    job = farm.submit(array(footage, "1-6"))
    assert "1 of 6 frames failed; frame 3:" in farm.wait_state(job, "failed")["error"]["message"]
    os.link(footage / "one.nrrd", footage / "a.0003.nrrd")
    farm.post(f"/v1/jobs/{job}/retry")
    farm.wait_state(job, "succeeded")
    assert attempts_of_frames(farm, job) == {1: 1, 2: 1, 3: 2, 4: 1, 5: 1, 6: 1}


def test_a_slurm_job_goes_on_with_small_attempts_that_others_have_not_begun(slurm, new_farm, gate, front):
    """There is one processor for a batch of several Slurm jobs."""
    where = front("sbatch", 'touch "$where/here"; while ! [ -e "$where/back" ]; do sleep 0.02; done; exec "$real" "$@"')
    farm = new_farm("--worker", gate, "--slurm_batch_s", "3600", "--slurm_timeout_s", "300", "--user_running", "0")
    slurm.submit("--nodelist=n1", "--exclusive", script="exec sleep 1000")
    opener = farm.submit(sphere())
    wait_until((where / "here").exists, "sbatch")
    ids = [farm.submit(sphere(300 + i)) for i in range(40)]
    for job in ids:
        farm.wait_state(job, "running")
    for job in ids[:-1]:
        farm.open_gate(job)
    (where / "back").touch()
    for job in ids[:-1]:
        farm.wait_state(job, "succeeded")
    states = collections.Counter(slurm.jobs("%T"))
    assert states["RUNNING"] == 3 and states["COMPLETED"] == 0, states
    for job in (opener, ids[-1]):
        farm.open_gate(job)
        farm.wait_state(job, "succeeded")
    wait_until(lambda: "PENDING" not in slurm.jobs("%T"), "an empty queue of Slurm")
    assert all(len(attempts(farm, job)) == 1 for job in ids)


def test_a_job_that_slurm_refuses_says_why_and_is_not_tried_again(slurm, new_farm, front):
    """One alone; those that come meanwhile together, and then one by one."""
    where = front("sbatch", 'while ! [ -e "$where/back" ]; do sleep 0.02; done; exec "$real" "$@"')
    farm = new_farm("--slurm_options", "--partition=nowhere", "--slurm_timeout_s", "300")
    ids = [farm.submit(sphere(200 + i)) for i in range(3)]
    for job in ids:
        farm.wait_state(job, "running")
    (where / "back").touch()
    for job in ids:
        error = farm.wait_state(job, "failed")["error"]
        assert error["code"] == "not_supported" and "invalid partition" in error["message"].lower()
        assert len(attempts(farm, job)) == 1 and not slurm.jobs()


def test_the_frames_of_a_chunk_share_a_task(slurm, new_farm, tmp_path):
    """Frames 4 and 9 have no file: their attempts fail, the other frames of their chunks have results."""
    footage = make_footage(tmp_path, (1, 2, 3, 5, 6, 7, 8, 10))
    farm = new_farm("--input_roots", footage)
    job = farm.submit(array(footage, "1-10", chunk=4))
    assert "2 of 10 frames failed" in farm.wait_state(job, "failed")["error"]["message"]
    assert len(slurm.jobs()) == 3  # frames 1-4, 5-8 and 9-10
    for frame in (4, 9):
        os.link(footage / "one.nrrd", footage / f"a.{frame:04d}.nrrd")
    farm.post(f"/v1/jobs/{job}/retry")
    farm.wait_state(job, "succeeded")
    assert attempts_of_frames(farm, job) == {**{frame: 1 for frame in range(1, 11)}, 4: 2, 9: 2}
    assert len(slurm.jobs()) == 5


def test_the_frames_of_a_chunk_run_on_without_the_daemon(slurm, new_farm, gate, tmp_path):
    footage = make_footage(tmp_path, (1, 2, 3))
    farm = new_farm("--worker", gate, "--input_roots", footage)
    job = farm.submit(array(footage, "1-3", chunk=3))
    wait_running(slurm, farm, job)
    farm.end(signal.SIGKILL)
    farm.open_gate(job)
    wait_until(lambda: all_ended(slurm), "the end of the task")
    farm.start()
    farm.wait_state(job, "succeeded")
    assert attempts_of_frames(farm, job) == {1: 1, 2: 1, 3: 1}
    assert len(slurm.jobs()) == 1
