# SPDX-License-Identifier: Apache-2.0
import json
import pathlib
import subprocess
import sys

import pytest

from service import PATIENCE_S, Service, gated_worker

# fixtures of modules
from accounts import closed_service, users  # noqa: F401
from carried_points import carried, finished  # noqa: F401
from disks import new_disk  # noqa: F401
from proxies import certificate  # noqa: F401
from pyramid import mesh_reader  # noqa: F401
from receivers import receiver, secret  # noqa: F401
from sessions import with_tokens  # noqa: F401
from shared_service import farm  # noqa: F401
from slurm_farm import front, gate, new_cluster, new_farm, running_cluster, slurm  # noqa: F401

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent))
import setclock  # noqa: E402


@pytest.fixture
def new_service(build, tmp_path):
    """Makes services in directories of their own; all are gone after the test."""
    made = []

    def make(*options, base=None):
        where = base or tmp_path / f"service.{len(made)}"
        where.mkdir(exist_ok=True)
        made.append(Service(build, where, *options))
        return made[-1]

    yield make
    for service in made:
        service.clean_up()


@pytest.fixture
def service(new_service):
    return new_service().start()


@pytest.fixture(scope="module")
def module_service(build, tmp_path_factory):
    """One daemon for all tests of a file."""
    made = Service(build, tmp_path_factory.mktemp("service"))
    yield made.start()
    made.clean_up()


@pytest.fixture(scope="module")
def module_gated(build, tmp_path_factory):
    """One daemon for all tests of a file, with one worker, which ends a job when its gate is opened."""
    where = tmp_path_factory.mktemp("gated")
    made = Service(build, where, "--worker", gated_worker(where), "--workers", 1)
    yield made.start()
    made.clean_up()


def without_jobs(service):
    """Starts a daemon that has ended, and removes all jobs after the test."""
    if service.process.poll() is not None:
        service.start()
    yield service
    if service.process.poll() is None:
        service.remove_jobs()


@pytest.fixture
def clean_service(module_service):
    """The daemon of the file, without jobs of other tests. Its log has the lines of earlier tests."""
    yield from without_jobs(module_service)


@pytest.fixture
def clean_gated(module_gated):
    """The daemon of the file with one gated worker, without jobs of other tests."""
    yield from without_jobs(module_gated)


@pytest.fixture(scope="module")
def data_service(build, shared_data, tmp_path_factory):
    """One daemon for all tests of a file, open to the shared data."""
    made = Service(build, tmp_path_factory.mktemp("service"), "--input_roots", shared_data, "--threads", 8)
    yield made.start()
    made.clean_up()


@pytest.fixture(scope="module")
def example(build, tmp_path_factory):
    """A small level set."""
    path = tmp_path_factory.mktemp("example") / "example.vdb"
    subprocess.run([build / "hexad-worker", "make-example", path], check=True, timeout=PATIENCE_S)
    return path


@pytest.fixture
def worker(build, tmp_path):
    """Runs hexad-worker; a document instead of a path is written down first."""
    def call(spec, *words, output="out", command="run", **more):
        if not isinstance(spec, str):
            (tmp_path / "spec.json").write_text(json.dumps(spec))
            spec = "spec.json"
        to = [] if output is None else ["--output", output]
        return subprocess.run([build / "hexad-worker", command, spec, *to, *map(str, words)], cwd=tmp_path, text=True,
                              capture_output=True, timeout=PATIENCE_S, **more)
    return call


@pytest.fixture
def solve(worker, tmp_path):
    """Runs a spec; the report and the bytes of points.ply, or the error and None."""
    def call(spec):
        done = worker(spec)
        if done.returncode not in (0, 10, 11):
            return json.loads(done.stderr.splitlines()[-1]), None
        return json.loads((tmp_path / "out" / "report.json").read_text()), (tmp_path / "out" / "points.ply").read_bytes()
    return call


@pytest.fixture
def clock(tmp_path):
    """A wall clock that a test sets for the programs that it starts."""
    if setclock.why_not():
        pytest.skip(setclock.why_not())
    return setclock.Clock(tmp_path)
