# SPDX-License-Identifier: Apache-2.0
"""What goes wrong on clusters, and must not go wrong here, with a real Slurm of several nodes on this machine. Minutes of
waiting for Slurm: `make farmtest` runs it; test_slurm.py is the short form."""
import contextlib
import os
import pathlib
import shutil
import signal
import subprocess
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "crash"))
import calls  # noqa: E402
import cluster  # noqa: E402
import farm as crash_farm  # noqa: E402
from service import long_sphere, sphere, wait_until
from slurm_farm import all_ended, array, attempts, attempts_of_frames, make_footage, needs_slurm, on_nodes, points, wait_running

pytestmark = [pytest.mark.extended, pytest.mark.campaign, needs_slurm]
MOVES = {"rename", "renameat", "renameat2"}


def test_small_jobs_share_slurm_jobs(slurm, new_farm, front):
    """Those that come while the first ones are submitted."""
    where = front("sbatch", 'while ! [ -e "$where/back" ]; do sleep 0.02; done; exec "$real" "$@"')
    farm = new_farm("--slurm_batch_attempts", "8", "--user_running", "0", "--slurm_timeout_s", "300")
    ids = [farm.submit(sphere(50 + i, output={"preview": False})) for i in range(60)]
    for job in ids:
        farm.wait_state(job, "running")
    (where / "back").touch()
    for job in ids:
        farm.wait_state(job, "succeeded")
        assert len(attempts(farm, job)) == 1
    tasks = slurm.jobs("%F_%K %j")
    assert len(tasks) < 40, tasks  # 31 at most, however many the first ones are


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


# ---- many frames

def test_a_coherent_sequence_is_the_one_of_the_local_engine(slurm, new_farm, new_service):
    spec = sphere(500, output={"preview": False}, queue={"frames": "1-20", "coherent": True, "by_frame": {
        "/surface/analytic/radius": {"from": 1, "to": 1.5}}})
    farm, local = new_farm(), new_service("--memory_mb", "300").start()
    there, here = farm.submit(spec), local.submit(spec)
    farm.wait_state(there, "succeeded")
    local.wait_state(here, "succeeded")
    assert attempts_of_frames(farm, there) == {frame: 1 for frame in range(1, 21)}
    for frame in range(1, 21):
        one, other = (service.get(f"/v1/jobs/{job}/results/points.ply?frame={frame}")
                      for service, job in ((farm, there), (local, here)))
        assert one.status == 200 and one.body == other.body


def test_an_array_of_1000_frames_is_one_job_and_a_retry_runs_the_one_that_failed(slurm, new_farm, tmp_path):
    frames = range(1, 1001)
    footage = make_footage(tmp_path, [frame for frame in frames if frame != 500])
    farm = new_farm("--input_roots", footage, "--user_running", "0")
    job = farm.submit(array(footage, "1-1000"))
    ended = farm.wait_state(job, "failed", seconds=3600)
    assert "1 of 1000 frames failed; frame 500:" in ended["error"]["message"]
    os.link(footage / "one.nrrd", footage / "a.0500.nrrd")
    farm.post(f"/v1/jobs/{job}/retry")
    farm.wait_state(job, "succeeded")
    assert attempts_of_frames(farm, job) == {frame: 1 + (frame == 500) for frame in frames}


# ---- 1: an answer is lost

def test_a_submission_that_was_not_accepted_is_made_again(slurm, new_farm, front):
    where = front("sbatch", 'echo x >>"$where/calls"; [ $(wc -l <"$where/calls") -gt 1 ] && exec "$real" "$@"; '
                            'echo "sbatch: error: Socket timed out on send/recv operation" >&2; exit 1')
    farm = new_farm()
    job = farm.submit(sphere())
    farm.wait_state(job, "succeeded")
    assert len(slurm.jobs()) == 1 and (where / "calls").read_text() == "x\nx\n"
    assert [a["reason"][:20] for a in attempts(farm, job)] == ["Slurm no longer list", "exit status 0"]


def test_a_slurm_that_is_full_is_asked_again(slurm, new_farm, front):
    """sbatch repeats by itself, and is cut short."""
    where = front("sbatch", 'echo x >>"$where/calls"; [ $(wc -l <"$where/calls") -gt 1 ] && exec "$real" "$@"; '
                            'echo "sbatch: error: Slurm temporarily unable to accept job, sleeping and retrying" >&2; exec sleep 100')
    farm = new_farm("--slurm_timeout_s", "1")
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
    assert slurm.submit("--job-name=other", script="exec sleep 1000") == number
    wait_until(lambda: len(attempts(farm, job)) == 2, "a second attempt")
    wait_running(slurm, farm, job)
    farm.open_gate(job)
    farm.wait_state(job, "succeeded")
    assert attempts(farm, job)[0]["reason"].startswith("Slurm no longer lists the job")
    # it may have ended when the node told the new controller of the old one's job; hexad has not cancelled it
    (state,) = wait_until(lambda: [row for row in slurm.jobs() if row.startswith("other ")], "a list of Slurm's jobs")
    assert state != "other CANCELLED"


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

def preempt(slurm, number):
    """Another job needs all nodes for a moment, and is of more worth."""
    slurm.submit("--partition=urgent", "--nodes=2", "--exclusive")


def fail_node(slurm, number):
    slurm.call("scontrol", "update", f"nodename={slurm.call('squeue', '-h', '-j', number, '-o', '%N').strip()}", "state=DOWN",
               "reason=test")


STATES = [("PREEMPTED", preempt, "given back", "Slurm preempted the job (PREEMPTED)"),
          ("NODE_FAIL", fail_node, "interrupted", "the node failed (NODE_FAIL)"),
          ("CANCELLED", lambda slurm, number: slurm.call("scancel", number), "spent", "cancelled outside hexad"),
          ("REQUEUED", lambda slurm, number: slurm.call("scontrol", "requeue", number), "given back", "Slurm requeued the job")]


@pytest.mark.parametrize("state, stop, counts, reason", STATES, ids=[s[0] for s in STATES])
def test_a_job_that_slurm_stops_runs_again(slurm, new_farm, gate, state, stop, counts, reason):
    farm = new_farm("--worker", gate, *(("--slurm_options", "--requeue") if state == "REQUEUED" else ()))
    job = farm.submit(sphere())
    wait_running(slurm, farm, job)
    stop(slurm, slurm.jobs("%F")[0])
    wait_until(lambda: len(attempts(farm, job)) == 2, "a second attempt")
    farm.open_gate(job)
    farm.wait_state(job, "succeeded")
    assert reason in attempts(farm, job)[0]["reason"]
    (task,) = farm.get(f"/v1/jobs/{job}/tasks").json["tasks"]
    assert (task["spent"], task["interrupted"]) == {"given back": (1, 0), "interrupted": (1, 1), "spent": (2, 0)}[counts]


def test_a_time_limit_of_slurm_ends_the_job(slurm, new_farm, gate):
    """Slurm counts in minutes, and looks every half minute."""
    farm = new_farm("--worker", gate, "--slurm_options", "--time=1")
    job = farm.submit(sphere())
    assert farm.wait_state(job, "timed_out")["error"]["code"] == "limit_time"
    assert "(TIMEOUT)" in attempts(farm, job)[0]["reason"]


def test_a_job_that_slurm_kills_for_its_memory_is_not_tried_for_ever(slurm, new_farm, tmp_path):
    """Without control groups Slurm calls that FAILED."""
    greedy = tmp_path / "greedy-worker"
    greedy.write_text("#!/bin/sh\nhead -c 900M /dev/zero | tail\n")
    greedy.chmod(0o755)
    farm = new_farm("--worker", greedy, "--max_interruptions", "1", "--max_attempts", "2")
    job = farm.submit(sphere())
    farm.wait_state(job, "failed")
    assert "FAILED" in attempts(farm, job)[0]["reason"]


def test_a_memory_limit_that_the_kernel_keeps_for_slurm_is_told(new_cluster, new_farm, tmp_path):
    if cluster.lacks_groups():
        pytest.skip(cluster.lacks_groups())
    greedy = tmp_path / "greedy-worker"
    greedy.write_text("#!/bin/sh\nexec tail /dev/zero\n")
    greedy.chmod(0o755)
    new_cluster(nodes=1, groups=True)
    farm = new_farm("--worker", greedy, "--max_attempts", "1")
    job = farm.submit(sphere())
    assert farm.wait_state(job, "failed")["error"]["code"] == "limit_memory"


def test_the_deadline_of_a_job_that_waits_has_passed(slurm, new_farm):
    """It can be no sooner than the time limit, a minute."""
    for node in slurm.nodes:
        slurm.submit(f"--nodelist={node}", "--exclusive", script="exec sleep 1000")
    farm = new_farm("--slurm_options", "--time=1,--deadline=now+62seconds")
    job = farm.submit(sphere())
    assert farm.wait_state(job, "timed_out")["error"]["code"] == "limit_time"
    assert "(DEADLINE)" in attempts(farm, job)[0]["reason"]


def test_a_held_job_says_so_and_waits(slurm, new_farm):
    slurm.call("scontrol", "update", "partition=farm", "state=DOWN")
    farm = new_farm()
    job = farm.submit(sphere())
    (number,) = wait_until(lambda: slurm.jobs("%F"), "the job in Slurm")
    slurm.call("scontrol", "hold", number)
    slurm.call("scontrol", "update", "partition=farm", "state=UP")
    wait_until(lambda: (farm.job(job)["progress"] or {}).get("reason") == "JobHeldAdmin", "the reason")
    slurm.call("scontrol", "release", number)
    farm.wait_state(job, "succeeded")
    assert len(attempts(farm, job)) == 1


@pytest.fixture
def accounts(new_cluster):
    if cluster.lacks_accounts():
        pytest.skip(cluster.lacks_accounts())
    return new_cluster(nodes=1, accounts={"film": ["GrpJobs=1"], "poor": ["MaxSubmitJobs=0"]})


def test_limits_of_accounts_are_told(accounts, new_farm, gate):
    """With slurmdbd: an account that may submit nothing, one that may run one job at a time, and one that is not there."""
    farm = new_farm("--worker", gate, "--slurm_accounts", "*=film", "--slurm_allow", "--account")
    for account in ("poor", "strange"):
        job = farm.submit(sphere(queue={"slurm": [f"--account={account}"]}))
        error = farm.wait_state(job, "failed")["error"]
        assert error["code"] == "not_supported" and "account" in error["message"].lower(), error
        assert len(attempts(farm, job)) == 1
    first = farm.submit(sphere())
    wait_running(accounts, farm, first)
    second = farm.submit(sphere())
    wait_until(lambda: (farm.job(second)["progress"] or {}).get("reason") == "AssocGrpJobsLimit", "the reason")
    for job in (first, second):
        farm.open_gate(job)
        farm.wait_state(job, "succeeded")
        assert len(attempts(farm, job)) == 1
    rows = wait_until(lambda: [row for row in accounts.call("sacct", "-nPX", "-o", "account,state").splitlines() if "COMPLETED" in row],
                      "the jobs' accounts")
    assert all(row.startswith("film|") for row in rows)


WORDS = [("OUT_OF_MEMORY", "failed", "limit_memory", "out of memory"), ("BOOT_FAIL", "succeeded", None, "(BOOT_FAIL)"),
         ("DEADLINE", "timed_out", "limit_time", "(DEADLINE)")]


@pytest.mark.parametrize("word, end, code, reason", WORDS, ids=[w[0] for w in WORDS])
def test_states_that_take_another_machine(slurm, new_farm, front, gate, word, end, code, reason):
    """The job is really stopped by Slurm; only the word for it is put in its place."""
    front("squeue", f'"$real" "$@" | sed "s/CANCELLED/{word}/"')
    farm = new_farm("--worker", gate)
    job = farm.submit(sphere())
    wait_running(slurm, farm, job)
    slurm.call("scancel", slurm.jobs("%F")[0])
    if end == "succeeded":
        wait_until(lambda: len(attempts(farm, job)) == 2, "a second attempt")
        farm.open_gate(job)
    now = farm.wait_state(job, end)
    assert (now["error"] or {}).get("code") == code
    assert reason in attempts(farm, job)[0]["reason"]


def test_a_state_that_nobody_knows_decides_nothing(slurm, new_farm, front, gate):
    front("squeue", '"$real" "$@" | sed "s/RUNNING/DREAMING/"')
    farm = new_farm("--worker", gate)
    job = farm.submit(sphere())
    wait_running(slurm, farm, job)
    farm.open_gate(job)
    farm.wait_state(job, "succeeded")
    assert len(attempts(farm, job)) == 1


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


SETTLING = {"before the output is taken": ("rename", "work/attempts/"), "before the result is delivered": ("rename", "work/results/"),
            "before the queue knows of it": ("write", "queue.db-wal")}


@pytest.mark.parametrize("when", SETTLING)
def test_a_daemon_killed_while_it_settles_keeps_the_result(slurm, build, tmp_path, when):
    if calls.why_not():
        pytest.skip(calls.why_not())
    delivered, killed = [], []
    kind, path = SETTLING[when]

    def judge(call):
        """Kills the daemon at the call: it is not done."""
        to = next((p for p in call.paths[::-1] if p), "")
        due = call.name in (calls.WRITES if kind == "write" else MOVES) and to.startswith(path)
        if due and not killed and (kind == "rename" or delivered):
            killed.append(call.name)
            os.kill(daemon.process.pid, signal.SIGKILL)
        delivered.extend([to] if call.name in MOVES and to.startswith("work/results/") else [])

    daemon = crash_farm.Daemon(build, tmp_path, "--engine", "slurm", "--work_dir", tmp_path / "state/work", "--memory_mb", "300",
                               "--slurm_interval_s", "0.2")
    daemon.state.mkdir()
    daemon.spawn(judge)
    try:
        with daemon.supervisor:
            assert daemon.await_served()
            job = daemon.submit(sphere())
            wait_until(daemon.dead, "the kill")
        daemon.start()
        daemon.wait_state(job, "succeeded")
        assert killed and len(attempts(daemon, job)) == 1 and b"element vertex 200" in points(daemon, job)
    finally:
        daemon.clean_up()


@pytest.fixture
def frozen_disk(tmp_path):
    """A disk that can be frozen: whoever writes then waits."""
    path, image = tmp_path / "disk", tmp_path / "image"
    path.mkdir()
    image.touch()
    os.truncate(image, 64 << 20)
    subprocess.run(["mkfs.ext4", "-q", image], check=True)
    done = subprocess.run(["mount", "-o", "loop", image, path], text=True, stderr=subprocess.PIPE)
    if done.returncode:
        pytest.skip(f"no disk can be mounted: {done.stderr.strip()}")
    yield path
    subprocess.run(["fsfreeze", "--unfreeze", path], stderr=subprocess.DEVNULL)
    subprocess.run(["umount", "-l", path], check=True)


def wait_workers(slurm, ids):
    for job in ids:
        wait_until(lambda: on_nodes(slurm, job, "hexad-worker"), "a worker on a node")


def test_a_full_storage_costs_time_and_no_job(new_disk, slurm, new_farm):
    """While nodes work, so that they can write neither results nor endings."""
    disk = new_disk(32)
    farm = new_farm("--free_space_mb", "0", work=disk.path / "work")
    ids = [farm.submit(sphere(8000 + i)) for i in range(3)]
    wait_workers(slurm, ids)
    with contextlib.suppress(OSError):  # it is full: the nodes write, too
        disk.fill(0)
    late = farm.submit(sphere())
    wait_until(lambda: not any(on_nodes(slurm, job, "hexad-worker") for job in ids), "the workers' end")
    disk.empty()
    for job in (*ids, late):
        farm.wait_state(job, "succeeded")
        assert sum(a["exit_status"] == 0 for a in attempts(farm, job)) == 1


def test_a_storage_that_hangs_holds_up_no_request(frozen_disk, slurm, new_farm):
    """As a file server that is away."""
    farm = new_farm("--free_space_mb", "0", work=frozen_disk / "work")
    ids = [farm.submit(sphere(8000 + i)) for i in range(3)]
    wait_workers(slurm, ids)
    subprocess.run(["fsfreeze", "--freeze", frozen_disk], check=True)
    ids += [farm.submit(sphere(300 + i)) for i in range(3)]
    assert [farm.job(job)["state"] in ("queued", "running") for job in ids] == [True] * 6
    farm.post(f"/v1/jobs/{ids[-1]}/cancel")
    subprocess.run(["fsfreeze", "--unfreeze", frozen_disk], check=True)
    for job in ids[:-1]:
        farm.wait_state(job, "succeeded")
        assert len(attempts(farm, job)) == 1
    farm.wait_state(ids[-1], "cancelled")


def test_a_node_whose_storage_is_read_only_is_avoided(new_cluster, new_farm):
    """It fails at once, so that Slurm would give it every further attempt."""
    slurm, farm = new_cluster(cpus=1), new_farm("--max_attempts", "2")
    work = farm.base / "work"
    slurm.end("n0", signal.SIGTERM)
    slurm.begin("n0", "unshare", "--mount", "sh", "-c", f"mount --bind {work} {work} && mount -o remount,bind,ro {work} && "
                "exec slurmd -D -N n0")
    wait_until(lambda: (slurm.base / "slurmd.n0.log").read_text().count("slurmd started on") == 2, "the node")
    ids = [farm.submit(sphere(200 + i)) for i in range(6)]
    for job in ids:
        farm.wait_state(job, "succeeded")
    assert any(a["reason"].startswith("the node could not run") for job in ids for a in attempts(farm, job))
    assert all(len(attempts(farm, job)) <= 2 for job in ids)


@pytest.mark.parametrize("skew", ["+60s", "-60s"])
def test_the_clock_of_a_node_is_off_by_a_minute(slurm, new_farm, build, tmp_path, skew):
    if not shutil.which("faketime"):
        pytest.skip("no faketime")
    node = tmp_path / "node"
    node.write_text(f"#!/bin/sh\nexec faketime -f '{skew}' {build}/hexad-node \"$@\"\n")
    node.chmod(0o755)
    farm = new_farm("--slurm_node", node)
    done, late = farm.submit(sphere()), farm.submit(long_sphere(limits={"timeout_s": 1}))
    farm.wait_state(done, "succeeded")
    assert farm.wait_state(late, "timed_out")["error"]["code"] == "limit_time"
    (attempt,) = attempts(farm, done)
    assert attempt["started"] <= attempt["finished"] and len(attempts(farm, late)) == 1


def test_a_node_that_cannot_write_fails_its_attempts_only(new_cluster, new_farm):
    slurm, farm = new_cluster(nodes=1), new_farm("--max_attempts", "2")
    hidden = farm.base / "work/farm"
    slurm.call("scontrol", "update", "partition=farm", "state=DOWN")
    job = farm.submit(sphere())
    wait_until(lambda: "PENDING" in slurm.jobs("%T"), "a job that waits in Slurm")
    hidden.rename(farm.base / "work/away")
    slurm.call("scontrol", "update", "partition=farm", "state=UP")
    wait_until(lambda: "FAILED" in slurm.jobs("%T"), "its failure")
    (farm.base / "work/away").rename(hidden)
    farm.wait_state(job, "succeeded")
    assert attempts(farm, job)[0]["exit_status"] is None
