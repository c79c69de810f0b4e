"""region through the worker and the daemon: every kind of surface, rims, what is refused."""
import json
import math
import subprocess

import numpy
import pytest

from readers import Points
from service import PATIENCE_S, last_words, sphere

WIDE = {"min": [-1000, -1000, -1000], "max": [1000, 1000, 1000]}
PLANE = [(i - 1) / 5 - 0.4 for i in range(8)]
SURFACES = {
    "formula": {"analytic": {"shape": "torus", "center": [0, 0, 0], "major_radius": 1, "minor_radius": 0.4}},
    "open formula": {"analytic": {"shape": "gyroid", "period": 0.8}},
    "spline": {"bspline": {"dims": [8, 8, 8], "coefficients": PLANE * 64}},
    "level set": {"vdb": {"path": "example.vdb"}},
}


@pytest.fixture
def surfaces(build, tmp_path):
    subprocess.run([build / "hexad-worker", "make-example", tmp_path / "example.vdb"], check=True, timeout=PATIENCE_S)
    return SURFACES


def run(worker, tmp_path, surface, count, **more):
    spec = sphere(count, surface=surface, output={"preview": False, "ply": {"precision": "double"}}, **more)
    done = worker(spec)
    assert done.returncode in (0, 10, 11), done.stderr
    return json.loads((tmp_path / "out" / "report.json").read_text()), (tmp_path / "out" / "points.ply").read_bytes()


@pytest.mark.parametrize("kind", SURFACES)
def test_a_region_cuts_every_kind_of_surface(worker, tmp_path, surfaces, kind):
    """In two, along y: no point is outside, points lie in the cut, and the areas add up."""
    whole, _ = run(worker, tmp_path, surfaces[kind], 50, solver={"max_sweeps": 1})
    box = whole["surface"]["bounding_box"]
    cut = 0.6 * box["min"][1] + 0.4 * box["max"][1]
    area = 0
    for low, high in ((-1000, cut), (cut, 1000)):
        region = {"min": [-1000, low, -1000], "max": [1000, high, 1000]}
        report, ply = run(worker, tmp_path, surfaces[kind], 400, region=region)
        y = Points(ply).position[:, 1]
        assert y.min() >= low and y.max() <= high
        assert report["count"] == 400 and report["quality"]["lost"] == 0 and report["quality"]["rim_count"] > 0
        assert (numpy.abs(y - cut) < 1e-9).sum() >= 10
        assert report["spec"]["region"] == region
        area += report["surface"]["area"]
    assert area == pytest.approx(whole["surface"]["area"], rel=1e-3)


@pytest.mark.parametrize("kind", SURFACES)
@pytest.mark.parametrize("init", ["surface", "random"])
def test_a_region_around_the_surface_changes_nothing(worker, tmp_path, surfaces, kind, init):
    solver = {"init": init, "max_sweeps": 20}
    _, alone = run(worker, tmp_path, surfaces[kind], 200, solver=solver)
    report, within = run(worker, tmp_path, surfaces[kind], 200, solver=solver, region=WIDE)
    assert alone == within
    assert report["spec"]["region"] == WIDE


def test_random_starts_stay_in_the_region(worker, tmp_path, surfaces):
    region = {"min": [-2, -2, 0.1], "max": [0.3, 2, 2]}
    for kind in ("formula", "level set"):
        report, ply = run(worker, tmp_path, surfaces[kind], 300, region=region, solver={"init": "random"})
        p = Points(ply).position
        assert report["quality"]["lost"] == 0
        assert (p >= region["min"]).all() and (p <= region["max"]).all()


def test_an_empty_region_is_no_surface(worker, tmp_path, surfaces):
    regions = [({"min": [5, 6, 7], "max": [8, 9, 10]}, "(5, 6, 7) to (8, 9, 10)"),  # beside the data
               ({"min": [-0.01, -0.01, -0.01], "max": [0.01, 0.01, 0.01]}, "(-0.01, -0.01, -0.01)")]
    for kind in ("formula", "level set"):
        for region, words in regions:
            done = worker(sphere(100, surface=surfaces[kind], region=region))
            assert done.returncode == 4, done
            said = last_words(done)
            assert said["code"] == "no_surface" and words in said["message"], said
            assert ("example.vdb" in said["message"]) == (kind == "level set")


def test_a_region_through_the_daemon(service):
    job = service.submit(sphere(200, region={"min": [-2, -2, 0], "max": [2, 2, 2]}))
    service.wait_state(job, "succeeded")
    report = service.get(f"/v1/jobs/{job}/results/report.json").json
    assert report["surface"]["area"] == pytest.approx(2 * math.pi, rel=1e-4)
    refused = service.submit(sphere(200, region={"min": [2, 2, 2], "max": [3, 3, 3]}))
    failed = service.wait_state(refused, "failed")
    assert failed["error"]["code"] == "no_surface" and "(2, 2, 2) to (3, 3, 3)" in failed["error"]["message"]
