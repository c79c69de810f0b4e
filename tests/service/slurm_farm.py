# SPDX-License-Identifier: Apache-2.0
"""A farm on a real Slurm, for tests: the fixtures, and what is asked of it."""
import collections
import os
import shutil

import numpy
import pytest

import cluster
from service import wait_until
from volumes import write_nrrd

needs_slurm = pytest.mark.skipif(cluster.missing() is not None, reason=str(cluster.missing()))


def speak_to(monkeypatch, made):
    """The daemon that a test starts afterwards speaks to this cluster."""
    for name in ("SLURM_CONF", "PATH"):
        monkeypatch.setenv(name, made.environment[name])
    return made


@pytest.fixture(scope="module")
def running_cluster():
    made = cluster.Cluster()
    try:
        yield made.start()
    finally:
        made.clean_up()


@pytest.fixture
def slurm(request, running_cluster, monkeypatch):
    """Two nodes of two cores. One for all tests of a file: each begins with nodes that are idle and sees its own jobs."""
    assert request.node.get_closest_marker("extended"), "the packages of the first tier do not include Slurm: mark the test extended"
    yield speak_to(monkeypatch, running_cluster)
    running_cluster.forget()


@pytest.fixture
def new_cluster(monkeypatch):
    """Starts clusters of other kinds."""
    made = []

    def make(**facts):
        made.append(cluster.Cluster(**facts))
        return speak_to(monkeypatch, made[-1]).start()

    yield make
    for c in made:
        c.clean_up()


@pytest.fixture
def new_farm(new_service, tmp_path):
    def make(*options, work=tmp_path / "service.0/work"):
        return new_service("--engine", "slurm", "--work_dir", work, "--slurm_interval_s", "0.2",
                           "--memory_mb", "300", "--grace_s", "2", "--retry_s", "0.1", "--slurm_lost_s", "1",
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


def all_ended(slurm):
    return not [state for state in slurm.jobs("%T") if state in ("PENDING", "RUNNING", "COMPLETING")]


def make_footage(where, frames):
    """The same small volume as many frames."""
    x, y, z = numpy.mgrid[-6:7, -6:7, -6:7].astype("f4")
    write_nrrd(where / "one.nrrd", 4 - numpy.sqrt(x * x + y * y + z * z), numpy.eye(4))
    for frame in frames:
        os.link(where / "one.nrrd", where / f"a.{frame:04d}.nrrd")
    return where


def array(footage, frames, **queue):
    return {"version": 1, "surface": {"volume": {"path": f"{footage}/a.####.nrrd", "isovalue": 0}}, "sampling": {"count": 100},
            "output": {"preview": False}, "queue": {"frames": frames, **queue}}


def attempts_of_frames(farm, job):
    """Of each frame, how many."""
    found, after = {}, ""
    while after is not None:
        page = farm.get(f"/v1/jobs/{job}/tasks?limit=100{after and '&after='}{after}").json
        found.update((task["frame"], task["attempt"]) for task in page["tasks"])
        after = page["next"]
    return found
