# SPDX-License-Identifier: Apache-2.0
"""Workers in the sandbox: the same bytes as without for every kind of job, and no file but those that are theirs."""
import hashlib
import os
import json
import pathlib
import re
import subprocess

import numpy
import pytest

import volumes
from ply_files import write_ply
from service import PATIENCE_S, expect_problem, last_words, long_sphere, processes, sphere, wait_until

TETRAHEDRON = """OFF
4 4 0
1 1 1
1 -1 -1
-1 1 -1
-1 -1 1
3 0 2 1
3 0 1 3
3 0 3 2
3 1 2 3
"""


def spec_of(surface, count=300):
    return {"version": 1, "surface": surface, "sampling": {"count": count},
            "output": {"preview": {"size": [64, 64]}, "preview_exr": True}}


@pytest.fixture(scope="module")
def inputs(build, source, tmp_path_factory):
    """A directory with a file of each kind."""
    where = tmp_path_factory.mktemp("inputs")
    subprocess.run([build / "hexad-worker", "make-example", where / "example.vdb"], check=True, timeout=PATIENCE_S)
    (where / "mesh.off").write_text(TETRAHEDRON)
    box = json.loads((source / "examples" / "bspline-box.json").read_text())["surface"]["bspline"]
    (where / "box.json").write_text(json.dumps(box))
    x, y, z = numpy.meshgrid(*[numpy.arange(16) - 7.5] * 3, indexing="ij")
    ball = (numpy.sqrt(x * x + y * y + z * z) - 5).astype("f4")
    volumes.write_nrrd(where / "ball.nrrd", ball, numpy.eye(4))
    volumes.write_nifti(where / "ball.nii", ball, numpy.eye(4))
    for k in range(16):
        volumes.write_exr(where / f"ball.{k:04}.exr", volumes.Part({"Y": ball[:, :, k]}))
    return where


def surface(inputs, kind):
    return {
        "analytic": lambda: sphere()["surface"],
        "vdb": lambda: {"vdb": {"path": str(inputs / "example.vdb")}},
        "mesh": lambda: {"mesh": {"path": str(inputs / "mesh.off"), "resolution": 32}},
        "nrrd": lambda: {"volume": {"path": str(inputs / "ball.nrrd"), "isovalue": 0}},
        "nifti": lambda: {"volume": {"path": str(inputs / "ball.nii"), "isovalue": 0}},
        "exr": lambda: {"exr": {"path": str(inputs / "ball.####.exr"), "slices": "0-15", "isovalue": 0}},
        "bspline": lambda: {"bspline": json.loads((inputs / "box.json").read_text())},
    }[kind]()


@pytest.mark.parametrize("kind", ["analytic", "vdb", "mesh", "nrrd", "nifti", "exr", "bspline"])
def test_the_same_bytes(worker, tmp_path, inputs, kind):
    for mode in ("off", "available"):
        done = worker(spec_of(surface(inputs, kind)), "--input-root", inputs, "--sandbox", mode, output=mode)
        assert done.returncode in (0, 10, 11), done.stderr
        assert ("sandbox: no new privileges, filtered system calls (seccomp)" in done.stderr) == (mode == "available")
    for name in ("points.ply", "preview.png", "preview.exr"):
        assert (tmp_path / "off" / name).read_bytes() == (tmp_path / "available" / name).read_bytes()


def test_many_threads(worker, tmp_path):
    """Threads are made inside; more points than one thread is used for."""
    spec = sphere(count=30000, solver={"threads": 3}, output={"preview": False})
    done = worker(spec, "--sandbox", "available")
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "out" / "report.json").read_text())["count"] == 30000


def test_no_input_root_means_no_file(worker, inputs):
    done = worker(spec_of(surface(inputs, "vdb")), "--sandbox", "available")
    assert done.returncode == 3
    assert last_words(done)["code"] == "path_forbidden"


# ---- the second file of a job: a map of spacings on the vertices of a mesh

def write_map(path, ratio=4):
    """Spacings on a tetrahedron around the sphere, `ratio` to 1 along x."""
    corners = numpy.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    faces = numpy.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    write_ply(path, corners, faces, {"quality": ("float", numpy.where(corners[:, 0] > 0, ratio, 1))}, "ascii")
    return hashlib.sha256(path.read_bytes()).hexdigest()


def mapped(path):
    return sphere(200, sampling={"count": 200, "grid": {"path": str(path), "name": "quality"}}, output={"preview": False})


@pytest.fixture
def roots(tmp_path):
    """An input root with a map, and a folder beside it with another one, to which links in the root lead."""
    root, outside = tmp_path / "root", tmp_path / "outside"
    root.mkdir()
    outside.mkdir()
    write_map(root / "map.ply")
    write_map(outside / "map.ply")
    (root / "link.ply").symlink_to(outside / "map.ply")
    (root / "folder").symlink_to(outside)
    return root, outside


def test_a_map_is_read_in_the_sandbox(worker, roots, tmp_path):
    for mode in ("off", "available"):
        done = worker(mapped(roots[0] / "map.ply"), "--input-root", roots[0], "--sandbox", mode, output=mode)
        assert done.returncode in (0, 10, 11), done.stderr
    assert (tmp_path / "off" / "points.ply").read_bytes() == (tmp_path / "available" / "points.ply").read_bytes()


@pytest.mark.parametrize("mode", ["available", "off"])
def test_a_map_outside_of_the_roots_is_refused_by_the_worker(worker, roots, mode):
    root, outside = roots
    for path in (outside / "map.ply", root / ".." / "outside" / "map.ply", root / "link.ply", root / "folder" / "map.ply"):
        done = worker(mapped(path), "--input-root", root, "--sandbox", mode)
        assert done.returncode == 3 and last_words(done)["code"] == "path_forbidden", (path, done.stderr)


def test_a_map_outside_of_the_roots_is_refused_by_the_service(new_service, roots):
    root, outside = roots
    service = new_service("--input_roots", root).start()
    for path in (outside / "map.ply", "../outside/map.ply", "link.ply", "folder/map.ply"):
        expect_problem(service.post("/v1/jobs", mapped(path)), 403, "path_forbidden", "/sampling/grid/path")


def test_a_map_that_is_replaced_while_its_job_waits(new_service, build, roots, tmp_path):
    """The job reads what is there when it starts, and nothing outside of the roots."""
    root, outside = roots
    gate, program = tmp_path / "gate", tmp_path / "waiting-worker"
    program.write_text(f'#!/bin/sh\nwhile ! [ -e {gate} ]; do sleep 0.01; done\nexec {build.resolve() / "hexad-worker"} "$@"\n')
    program.chmod(0o700)
    names = ("other.ply", "link.ply", "folder.ply", "pipe.ply", "none.ply")
    (root / "link.ply").unlink()
    for name in names:
        write_map(root / name)
    service = new_service("--input_roots", root, "--worker", program).start()
    jobs = {name: service.submit(mapped(name)) for name in names}
    for name in names:
        (root / name).unlink()
    digest = write_map(root / "other.ply", 2)
    (root / "link.ply").symlink_to(outside / "map.ply")
    (root / "folder.ply").mkdir()
    os.mkfifo(root / "pipe.ply")
    gate.touch()
    service.wait_state(jobs["other.ply"], "succeeded")
    report = service.get(f"/v1/jobs/{jobs['other.ply']}/results/report.json").json
    assert [(i["path"], i["sha256"]) for i in report["inputs"]] == [("other.ply", digest)]
    codes = {name: service.wait_state(jobs[name], "failed")["error"]["code"] for name in names[1:]}
    assert codes == {"link.ply": "path_forbidden", "folder.ply": "input_unsupported", "pipe.ply": "input_unsupported", "none.ply": "input_missing"}


@pytest.mark.sanitized
def test_modes_that_are_none(worker):
    done = worker(sphere(), "--sandbox", "tight")
    assert done.returncode == 2
    assert "required, available or off" in last_words(done)["message"]


@pytest.mark.parametrize("kind", ["mesh", *(pytest.param(kind, marks=pytest.mark.extended) for kind in ("vdb", "exr"))])
def test_workers_of_the_daemon_are_inside(new_service, inputs, kind):
    service = new_service("--input_roots", inputs).start()
    assert "worker sandbox: no new privileges, filtered system calls (seccomp)" in service.log.read_text()
    job = service.submit(spec_of(surface(inputs, kind)))
    service.wait_state(job, "succeeded")
    log = (service.state / "attempts" / f"{job}.1" / "worker.log")
    log = log if log.exists() else service.state / "results" / job / "worker.log"
    assert "sandbox: no new privileges, filtered system calls (seccomp)" in log.read_text()


def test_a_file_longer_than_allowed_ends_the_job(new_service):
    service = new_service("--file_mb", "1").start()
    job = service.submit(sphere(count=30000, solver={"max_sweeps": 1}, output={"preview": False, "ply": {"properties": ["all"]}}))
    done = service.wait_state(job, "failed")
    assert done["error"]["code"] == "limit_file" and "File too large" in done["error"]["message"]
    assert done["attempt"] == 1  # again it would be as long


FACTS = """#!/bin/sh
cat >/dev/null
echo "core $(ulimit -c) descriptors $(ulimit -Hn) blocks $(ulimit -Hf) $(grep NoNewPrivs /proc/self/status)" \
    "oom_score_adj $(cat /proc/self/oom_score_adj) nice $(nice)" >&2
exit 3
"""


SECRETS = {"HEXAD_TOKEN": "hexad_secret", "NOTIFY_SOCKET": "/none", "CREDENTIALS_DIRECTORY": "/none", "LD_BIND_NOW": "1", "ANY": "secret"}


def documented_variables(source):
    """The names in the table of doc/worker.md."""
    table = (source / "doc" / "worker.md").read_text().partition("### Environment")[2].partition("\n## ")[0]
    return {name for row in table.splitlines() if row.startswith("| `") for name in re.findall(r"`(\w+)`", row.split("|")[1])}


def test_the_environment_of_a_worker_is_a_documented_list(new_service, tmp_path, source, monkeypatch):
    program, passed = tmp_path / "shows", {"MALLOC_ARENA_MAX": "3", "TMPDIR": str(tmp_path), "TZ": "Asia/Tokyo", "UBSAN_OPTIONS": "halt_on_error=1"}
    program.write_text("#!/bin/sh\ncat > /dev/null\n/usr/bin/env >&2\nexit 3\n")
    program.chmod(0o700)
    for name, value in {**SECRETS, **passed, "TRACEPARENT": "of-the-daemon"}.items():
        monkeypatch.setenv(name, value)
    service = new_service("--worker", program).start()
    job = service.submit(sphere())
    service.wait_state(job, "failed")
    lines = (service.state / "attempts" / f"{job}.1" / "worker.log").read_text().splitlines()
    seen = dict(line.split("=", 1) for line in lines)
    assert passed.items() <= seen.items() and seen["PATH"] == os.environ["PATH"] and "TRACEPARENT" not in seen
    assert set(seen) - {"PWD", "_", "SHLVL", "OLDPWD"} <= documented_variables(source)  # a shell adds these


def oom_score(pid):
    return int(pathlib.Path(f"/proc/{pid}/oom_score_adj").read_text())


def test_what_any_worker_starts_with(new_service, tmp_path, inputs):
    """Also one that does not restrict itself."""
    program = tmp_path / "facts"
    program.write_text(FACTS)
    program.chmod(0o700)
    service = new_service("--worker", program, "--file_mb", "2", "--input_roots", inputs).start()
    job = service.submit(sphere())
    service.wait_state(job, "failed")
    log = (service.state / "attempts" / f"{job}.1" / "worker.log").read_text()
    words = log.split()
    assert 128 < int(words.pop(3)) < 135  # one for each input root
    assert words == ["core", "0", "descriptors", "blocks", "4096", "NoNewPrivs:", "1",
                     "oom_score_adj", str(min(oom_score("self") + 500, 1000)),
                     "nice", str(min(os.nice(0) + 5, 19))]


def test_the_kernel_ends_a_worker_before_the_daemon(new_service):
    """The daemon's own oom_score_adj stays what it was; that of a running worker is higher."""
    service = new_service().start()
    own = oom_score("self")
    job = service.submit(long_sphere())
    workers = wait_until(lambda: [pid for pid, (parent, _, command) in processes().items()
                                  if parent == service.process.pid and command == "hexad-worker"], "the worker")
    assert [oom_score(pid) for pid in workers] == [min(own + 500, 1000)]
    assert oom_score(service.process.pid) == own
    service.post(f"/v1/jobs/{job}/cancel")
    service.wait_state(job, "cancelled")
