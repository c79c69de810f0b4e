"""The engine slurm, with a real Slurm of several nodes on this machine: jobs through it, and what goes wrong on clusters."""
import collections
import os
import pathlib
import shutil
import signal
import subprocess
import sys

import pytest

import cluster
from service import long_sphere, sphere, wait_until

pytestmark = pytest.mark.skipif(cluster.missing() is not None, reason=str(cluster.missing()))


@pytest.fixture
def new_cluster(monkeypatch):
    """Starts clusters; the daemon that a test starts afterwards speaks to the last one."""
    made = []

    def make(**facts):
        c = cluster.Cluster(**facts)
        made.append(c)
        for name in ("SLURM_CONF", "PATH"):
            monkeypatch.setenv(name, c.environment[name])
        return c.start()

    yield make
    for c in made:
        c.clean_up()


@pytest.fixture
def new_farm(new_service, tmp_path):
    def make(*options):
        return new_service("--engine", "slurm", "--work_dir", tmp_path / "service.0/work", "--slurm_interval_s", "0.2",
                           "--memory_mb", "300", "--grace_s", "2", "--retry_s", "0.1", "--slurm_lost_s", "1", "--drain_s", "0",
                           *options).start()
    return make


# Waits for Service.open_gate, of its job or of its attempt, and writes the attempt's number as its points.
GATED_WORKER = """#!/bin/sh
cat >/dev/null
name=${4%/out}
name=${name##*/}
echo '{"phase":"relax","fraction":0.5}' >&3
while ! [ -e "BASE/open.$name" ] && ! [ -e "BASE/open.${name%%.*}" ]; do sleep 0.02; done
printf %s "${name##*.}" >"$4/points.ply"
hash=$(sha256sum <"$4/points.ply" | cut -c1-64)
printf '{"outcome":"converged","count":7,"outputs":[{"name":"points.ply","bytes":1,"sha256":"%s"}]}' $hash >"$4/report.json"
"""


@pytest.fixture
def gate(tmp_path):
    """A worker that waits, in the directory of the service that comes first."""
    base = tmp_path / "service.0"
    base.mkdir()
    worker = base / "gated-worker"
    worker.write_text(GATED_WORKER.replace("BASE", str(base)))
    worker.chmod(0o755)
    return worker


@pytest.fixture
def front(tmp_path, monkeypatch):
    """Puts a script in front of a command of Slurm; in it, `real` is the command itself. Install it before the daemon
    starts."""
    where = tmp_path / "front"

    def install(name, script):
        where.mkdir(exist_ok=True)
        real = shutil.which(name, path=cluster.PATH)
        (where / name).write_text(f"#!/bin/sh\nreal={real}\nwhere={where}\n{script}\n")
        (where / name).chmod(0o755)
        if not os.environ["PATH"].startswith(str(where)):
            monkeypatch.setenv("PATH", f"{where}:{os.environ['PATH']}")
        return where
    return install


def attempts(farm, job):
    """Oldest first; what an attempt does not have is None."""
    found = farm.get(f"/v1/jobs/{job}/attempts").json["attempts"]
    return [collections.defaultdict(lambda: None, a) for a in found]


def on_nodes(slurm, job, program="gated-worker"):
    """Processes of the job's workers on the nodes, wherever they hang."""
    return [pid for pid, words in slurm.steps().items() if any(program in w for w in words)
            and any(f"/farm/{job}." in w for w in words)]


def wait_running(slurm, farm, job):
    wait_until(lambda: farm.job(job)["progress"], "progress")
    return wait_until(lambda: on_nodes(slurm, job), "a worker on a node")


def points(farm, job):
    return farm.get(f"/v1/jobs/{job}/results/points.ply").body


def test_jobs_run_on_the_nodes_with_the_results_of_the_local_engine(new_cluster, new_farm, new_service):
    slurm, farm = new_cluster(), new_farm()
    local = new_service("--memory_mb", "300").start()
    for count in (200, 300):
        there, here = farm.submit(sphere(count)), local.submit(sphere(count))
        farm.wait_state(there, "succeeded")
        local.wait_state(here, "succeeded")
        assert points(farm, there) == points(local, here)
        (attempt,) = attempts(farm, there)
        assert attempt["exit_status"] == 0 and attempt["peak_memory_bytes"] > 0
    assert len({line.split()[0] for line in slurm.jobs()}) == 2
    wait_until(lambda: not any((farm.base / "work/farm").iterdir()), "an empty farm")
    assert not (farm.state / "results").exists()
    assert (farm.base / "work/instance").exists()


def test_small_jobs_share_slurm_jobs(new_cluster, new_farm):
    slurm, farm = new_cluster(), new_farm("--slurm_together", "8")
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
    wait_until(lambda: not [s for s in slurm.jobs("%T") if s in ("PENDING", "RUNNING")], "an empty queue of Slurm")
    late = farm.submit(long_sphere(limits={"timeout_s": 1}))
    assert farm.wait_state(late, "timed_out")["error"]["code"] == "limit_time"


def test_slurm_is_told_what_a_job_needs(new_cluster, new_farm, front):
    new_cluster()
    where = front("sbatch", 'echo "$@" >"$where/words"; exec "$real" "$@"')
    farm = new_farm("--slurm_accounts", "somebody=other,*=film", "--slurm_options", "--comment=hexad")
    job = farm.submit(sphere(queue={"priority": 10}, limits={"timeout_s": 100, "memory_mb": 400}, solver={"threads": 2}))
    farm.wait_state(job, "succeeded")
    words = (where / "words").read_text().split()
    assert {"--account=film", "--comment=hexad", "--cpus-per-task=2", "--mem=400", "--nice=990", "--no-requeue"} < set(words)
    assert any(word.startswith("--time=") for word in words)


def test_a_drain_gives_attempts_back(new_cluster, new_farm, gate):
    slurm, farm = new_cluster(), new_farm("--worker", gate)
    job = farm.submit(sphere())
    wait_running(slurm, farm, job)
    assert farm.end() == 0
    wait_until(lambda: not on_nodes(slurm, job), "the worker's end")
    farm.start()
    farm.open_gate(job)
    farm.wait_state(job, "succeeded")
    first, second = attempts(farm, job)
    assert first["reason"].startswith("drained"), first


# ---- 1: an answer is lost

@pytest.mark.parametrize("fault", ['"$real" "$@" >/dev/null; echo "sbatch: error: Batch job submission failed: Socket '
                                   'timed out on send/recv operation" >&2; exit 1',
                                   '"$real" "$@"; sleep 100'])
def test_a_submission_that_was_accepted_without_an_answer_is_found_again(new_cluster, new_farm, front, fault):
    slurm = new_cluster()
    front("sbatch", f'echo x >>"$where/calls"; {fault}')
    farm = new_farm("--slurm_command_s", "1")
    job = farm.submit(sphere())
    farm.wait_state(job, "succeeded")
    assert len(attempts(farm, job)) == 1 and len(slurm.jobs()) == 1
    assert (front("sbatch", 'exec "$real" "$@"') / "calls").read_text() == "x\n"


def test_a_submission_that_was_not_accepted_is_made_again(new_cluster, new_farm, front):
    slurm = new_cluster()
    where = front("sbatch", 'echo x >>"$where/calls"; [ $(wc -l <"$where/calls") -gt 1 ] && exec "$real" "$@"; '
                            'echo "sbatch: error: Socket timed out on send/recv operation" >&2; exit 1')
    farm = new_farm()
    job = farm.submit(sphere())
    farm.wait_state(job, "succeeded")
    assert len(slurm.jobs()) == 1 and (where / "calls").read_text() == "x\nx\n"
    assert [a["reason"][:24] for a in attempts(farm, job)] == ["Slurm does not know the ", "exit status 0"]


def test_a_slurm_that_is_full_is_asked_again(new_cluster, new_farm, front):
    """sbatch repeats by itself, and is cut short."""
    slurm = new_cluster()
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


# ---- 6: the daemon is killed

def test_attempts_run_on_without_the_daemon(new_cluster, new_farm, gate):
    slurm, farm = new_cluster(nodes=1), new_farm("--worker", gate)
    ends, goes_on = farm.submit(sphere()), farm.submit(sphere(201))
    for job in (ends, goes_on):
        wait_running(slurm, farm, job)
    waits = farm.submit(sphere(202))
    wait_until(lambda: "PENDING" in slurm.jobs("%T"), "a job that waits in Slurm")
    farm.end(signal.SIGKILL)
    farm.open_gate(ends)
    wait_until(lambda: not on_nodes(slurm, ends), "the worker's end")
    farm.start()
    farm.wait_state(ends, "succeeded")
    for job in (goes_on, waits):
        farm.open_gate(job)
        farm.wait_state(job, "succeeded")
    for job in (ends, goes_on, waits):
        assert len(attempts(farm, job)) == 1
    assert len(slurm.jobs()) == 3


@pytest.mark.parametrize("script", ['touch "$where/here"; sleep 2; exec "$real" "$@"',
                                    '"$real" "$@"; touch "$where/here"; sleep 2',
                                    'touch "$where/here"; sleep 100'], ids=["before", "after", "never"])
def test_a_daemon_killed_while_it_submits_runs_each_job_once(new_cluster, new_farm, front, script):
    slurm = new_cluster()
    where = front("sbatch", f'[ -e "$where/here" ] && exec "$real" "$@"; {script}')
    farm = new_farm()
    job = farm.submit(sphere())
    wait_until((where / "here").exists, "sbatch")
    farm.end(signal.SIGKILL)
    farm.start()
    farm.wait_state(job, "succeeded")
    assert sum(a["exit_status"] == 0 for a in attempts(farm, job)) == 1
    wait_until(lambda: not [s for s in slurm.jobs("%T") if s in ("PENDING", "RUNNING")], "an empty queue of Slurm")


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


# ---- 7: not allowed

def test_a_job_that_slurm_refuses_says_why_and_is_not_tried_again(new_cluster, new_farm):
    slurm, farm = new_cluster(), new_farm("--slurm_options", "--partition=nowhere")
    farm.post("/v1/admin/hold")
    ids = [farm.submit(sphere(200 + i)) for i in range(3)]
    farm.post("/v1/admin/release")
    for job in ids:
        error = farm.wait_state(job, "failed")["error"]
        assert error["code"] == "not_supported" and "invalid partition" in error["message"].lower()
        assert len(attempts(farm, job)) == 1 and not slurm.jobs()


# ---- all of it

def test_a_short_campaign_of_kills(build):
    """`make farmtest` is the whole."""
    campaign = pathlib.Path(__file__).parents[1] / "crash/farmtest.py"
    done = subprocess.run([sys.executable, "-B", campaign, build, "--jobs", "40", "--kills", "8", "--seed", "1"], text=True,
                          capture_output=True)
    assert done.returncode == 0, done.stdout + done.stderr
