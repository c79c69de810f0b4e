# SPDX-License-Identifier: Apache-2.0
"""Snapshots of the points of running jobs."""
import ctypes
import json
import os
import pathlib
import subprocess
import sys

import numpy
import pytest
import scipy.spatial

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent))
import setclock  # noqa: E402
from accounts import new_token, with_token  # noqa: E402
from service import PATIENCE_S, gated_worker, long_sphere, sphere, wait_until  # noqa: E402


def read_snapshot(data):
    """Comments, and a row of numbers for each point."""
    head, _, body = data.partition(b"end_header\n")
    lines = [line.split() for line in head.decode().splitlines()]
    assert lines[:2] == [["ply"], ["format", "binary_little_endian", "1.0"]]
    count = next(int(line[2]) for line in lines if line[0] == "element")
    record = numpy.dtype([(line[2], {"double": "<f8", "float": "<f4"}[line[1]]) for line in lines if line[0] == "property"])
    points = numpy.frombuffer(body, record)
    assert len(points) == count
    return {line[1]: line[2] for line in lines if line[0] == "comment"}, points


def test_only_the_owner_and_administrators_get_the_snapshot_of_a_running_attempt(closed_service, tmp_path):
    closed_service.end()
    closed_service.start("--worker", gated_worker(tmp_path))
    own, other = new_token(closed_service, "carol"), new_token(closed_service, "dave")
    job = with_token(closed_service, own, "POST", "/v1/jobs", sphere()).json["id"]
    path = f"/v1/jobs/{job}/snapshot"
    attempt = closed_service.state / "attempts" / f"{job}.1"
    wait_until(attempt.exists, "the attempt")
    missing = with_token(closed_service, own, "GET", path)
    assert (missing.status, missing.json["code"]) == (404, "not_found")
    (attempt / "snapshot.ply").write_bytes(b"ply\n")
    for token in (own, closed_service.token):
        found = with_token(closed_service, token, "GET", path)
        assert (found.status, found.body, found.headers["Cache-Control"]) == (200, b"ply\n", "no-store")
    assert with_token(closed_service, other, "GET", path).status == 403
    assert with_token(closed_service, own, "GET", f"{path}?frame=1").status == 404  # it is no array
    closed_service.open_gate(job)
    wait_until(lambda: with_token(closed_service, own, "GET", f"/v1/jobs/{job}").json["state"] == "succeeded", "the end")
    assert with_token(closed_service, own, "GET", path).status == 404
    names = [result["name"] for result in with_token(closed_service, own, "GET", f"/v1/jobs/{job}/results").json["results"]]
    assert names and "snapshot.ply" not in names


@pytest.mark.extended
def test_a_long_job_has_snapshots_until_it_ends(service):
    job = service.submit(long_sphere())
    first = wait_until(lambda: (reply := service.get(f"/v1/jobs/{job}/snapshot")).status == 200 and reply, "a snapshot")
    comments, points = read_snapshot(first.body)
    assert comments == {"up": "z", "particles": "20000"} and len(points) == 20000
    place = numpy.stack([points[axis] for axis in "xyz"], 1)
    normal = numpy.stack([points[f"n{axis}"] for axis in "xyz"], 1)
    assert numpy.abs(numpy.linalg.norm(place, axis=1) - 1).max() < 1e-3
    assert numpy.sum(place * normal, 1).min() > 0.99
    # cells of 20 000 points that share the sphere
    assert numpy.allclose(numpy.median(points["spacing"]) ** 2 * numpy.sqrt(3) / 2 * 20000, 4 * numpy.pi, rtol=0.05)
    wait_until(lambda: service.get(f"/v1/jobs/{job}/snapshot").body != first.body, "the next snapshot")
    service.post(f"/v1/jobs/{job}/cancel")
    service.wait_state(job, "cancelled")
    assert service.get(f"/v1/jobs/{job}/snapshot").status == 404
    assert not list(service.state.rglob("snapshot.ply*"))


@pytest.mark.extended
def test_of_many_points_a_part_is_written(service):
    job = service.submit({**long_sphere(), "sampling": {"count": 150000}})

    def full():
        reply = service.get(f"/v1/jobs/{job}/snapshot")
        found = reply.status == 200 and read_snapshot(reply.body)
        return found if found and found[0]["particles"] == "150000" else None
    _, points = wait_until(full, "all particles")
    service.post(f"/v1/jobs/{job}/cancel")
    assert 20000 <= len(points) <= 60000
    place = numpy.stack([points[axis] for axis in "xyz"], 1)
    tree, radius = scipy.spatial.cKDTree(place), points["spacing"][0] / numpy.sqrt(3)
    assert (points["spacing"] == points["spacing"][0]).all()
    assert tree.query(place, 2)[0][:, 1].min() > 0.98 * radius  # particles move while they are relaxed
    everywhere = numpy.random.default_rng(83).normal(size=(20000, 3))
    gaps = tree.query(everywhere / numpy.linalg.norm(everywhere, axis=1)[:, None])[0]
    assert (gaps > radius).mean() < 0.05 and gaps.max() < 1.7 * radius  # the discs cover the sphere


IN_MOVED_TO = 0x80
ROOF = "OFF\n6 6 0\n0 0 0\n2 0 0\n2 1 1\n0 1 1\n2 2 0\n0 2 0\n3 0 1 2\n3 0 2 3\n3 3 2 4\n3 3 4 5\n3 0 5 4\n3 0 4 1\n"


def test_snapshots_change_no_byte_of_points_on_patches_with_graded_spacing(build, tmp_path):
    """The monotonic clock advances by 1 s with each reading, so a snapshot is due again and again."""
    if setclock.why_not():
        pytest.skip(setclock.why_not())
    (tmp_path / "roof.off").write_text(ROOF)
    spec = tmp_path / "spec.json"
    spec.write_text(json.dumps({
        "version": 1, "surface": {"mesh": {"path": str(tmp_path / "roof.off"), "features": {"angle": 0.7}}},
        "sampling": {"count": 100, "curve_spacing": 0.1}, "output": {"preview": False}}))
    command = [build / "hexad-worker", "run", spec, "--output"]
    assert subprocess.run([*command, tmp_path / "without"], timeout=PATIENCE_S).returncode == 0
    (tmp_path / "with").mkdir()
    libc = ctypes.CDLL(None, use_errno=True)
    watch = libc.inotify_init()
    assert libc.inotify_add_watch(watch, os.fsencode(tmp_path / "with"), IN_MOVED_TO) >= 0
    with open(tmp_path / "progress", "wb") as progress:
        subprocess.run([*command, tmp_path / "with", "--progress-fd", str(progress.fileno())], pass_fds=[progress.fileno()],
                       env=setclock.Clock(tmp_path, per_reading=1).environment, timeout=PATIENCE_S)
    os.set_blocking(watch, False)
    assert b"snapshot.ply\0" in os.read(watch, 1 << 20)  # the events, with the names of the files
    os.close(watch)
    assert (tmp_path / "with" / "points.ply").read_bytes() == (tmp_path / "without" / "points.ply").read_bytes()


def test_a_run_removes_the_snapshots_of_an_earlier_run_that_was_killed(build, tmp_path):
    spec, out = tmp_path / "spec.json", tmp_path / "out"
    spec.write_text(json.dumps(sphere(output={"preview": False})))
    out.mkdir()
    for name in ("snapshot.ply", "snapshot.ply.part"):
        (out / name).write_bytes(b"ply\n")
    assert subprocess.run([build / "hexad-worker", "run", spec, "--output", out], timeout=PATIENCE_S).returncode == 0
    assert not list(out.glob("snapshot*"))


@pytest.mark.extended
def test_snapshots_change_no_byte_of_the_points(build, tmp_path):
    """A worker whose progress is read writes them; one by hand does not."""
    spec = tmp_path / "spec.json"
    spec.write_text('{"version": 1, "surface": {"analytic": {"shape": "torus", "center": [0, 0, 0], "major_radius": 1, "minor_radius": 0.4}},'
                    ' "sampling": {"count": 20000}, "output": {"preview": false},'
                    ' "solver": {"max_sweeps": 4000, "step_tolerance": 1e-12, "energy_tolerance": 1e-12}}')
    command = [build / "hexad-worker", "run", spec, "--output"]
    subprocess.run([*command, tmp_path / "without"], timeout=PATIENCE_S)
    end, write_end = os.pipe()
    process = subprocess.Popen([*command, tmp_path / "with", "--progress-fd", str(write_end)], pass_fds=[write_end])
    os.close(write_end)
    seen = False
    with os.fdopen(end) as lines:
        for _ in lines:
            seen = seen or (tmp_path / "with" / "snapshot.ply").exists()
    process.wait(PATIENCE_S)
    assert seen, "the job was too short for a snapshot"
    assert (tmp_path / "with" / "points.ply").read_bytes() == (tmp_path / "without" / "points.ply").read_bytes()
    assert sorted(f.name for f in (tmp_path / "with").iterdir()) == sorted(f.name for f in (tmp_path / "without").iterdir())
