# SPDX-License-Identifier: Apache-2.0
"""region through the worker and the daemon: every kind of surface, rims, what is refused."""
import json
import math

import numpy
import pytest

from readers import Points
from service import last_words, sphere

WIDE = {"min": [-1000, -1000, -1000], "max": [1000, 1000, 1000]}
PLANE = [(i - 1) / 5 - 0.4 for i in range(8)]
SURFACES = {
    "formula": {"analytic": {"shape": "torus", "center": [0, 0, 0], "major_radius": 1, "minor_radius": 0.4}},
    "open formula": {"analytic": {"shape": "gyroid", "period": 0.8}},
    "spline": {"bspline": {"dims": [8, 8, 8], "coefficients": PLANE * 64}},
    "level set": {"vdb": {}},
}


@pytest.fixture
def surfaces(example):
    return {**SURFACES, "level set": {"vdb": {"path": str(example)}}}


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
        assert report["count"] == 400 and report["quality"]["lost"] == 0
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


def test_only_a_mesh_that_is_open_before_the_cut_is_told_to_be_open(worker, tmp_path):
    corners = "".join(f"v {x} {y} {z}\n" for z in (0, 1) for y in (0, 1) for x in (0, 1))
    sides = ["1 3 4 2", "5 6 8 7", "2 4 8 6", "3 7 8 4", "1 5 7 3", "1 2 6 5"]
    for count, told in ((6, []), (5, ["the mesh is open (4 edges with one triangle)"])):
        (tmp_path / "box.obj").write_text(corners + "".join(f"f {side}\n" for side in sides[:count]))
        report, _ = run(worker, tmp_path, {"mesh": {"path": str(tmp_path / "box.obj")}}, 300,
                        region={"min": [-1, -1, -1], "max": [0.5, 2, 2]})
        assert report["surface"]["area"] == pytest.approx(3 if count == 6 else 2.5, rel=1e-6)
        assert [text.split(":")[0] for text in report["surface"]["warnings"] if "open" in text] == told


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


def ball(radius, center=(0, 0, 0)):
    return {"analytic": {"shape": "sphere", "radius": radius, "center": list(center)}}


def below(z):
    return {"analytic": {"shape": "halfspace", "center": [0, 0, z], "axis": [0, 0, 1]}}


CUBE = "OFF\n8 6 0\n" + "".join("%d %d %d\n" % (x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)) + (
    "4 0 1 3 2\n4 4 6 7 5\n4 0 4 5 1\n4 2 3 7 6\n4 0 2 6 4\n4 1 5 7 3\n")
INSIDE = {  # surface, region, area, and where the cut is: the distance from it
    "a cap": (ball(1), below(-0.3), 2 * math.pi * 0.7, lambda p: p[:, 2] + 0.3),
    "a disc": (below(0.3), ball(1), math.pi * (1 - 0.3**2), lambda p: numpy.linalg.norm(p, axis=1) - 1),
    "two balls": (ball(1), {"union": [ball(0.5, (1, 0, 0)), ball(0.5, (-1, 0, 0))]}, math.pi / 2,
                  lambda p: numpy.linalg.norm(numpy.abs(p) - [1, 0, 0], axis=1) - 0.5),
    "in a mesh": (ball(0.5, (1, 0, 0)), {"mesh": {"path": "cube.off", "resolution": 50}}, math.pi / 2,
                  lambda p: p[:, 0] - 1),
}


@pytest.mark.sanitized
@pytest.mark.parametrize("what", INSIDE)
def test_the_inside_of_a_surface_is_a_region(worker, tmp_path, what):
    """Points lie on the cut exactly, in rows, and none outside; the area is that of closed forms."""
    surface, region, area, from_cut = INSIDE[what]
    (tmp_path / "cube.off").write_text(CUBE)
    report, ply = run(worker, tmp_path, surface, 1000, region={"inside": region})
    far = from_cut(Points(ply).position)
    assert report["count"] == 1000 and report["quality"]["lost"] == 0 and report["quality"]["coverage"] < 1
    assert report["surface"]["area"] == pytest.approx(area, rel=5e-3)
    fuzz = 1e-9 if "mesh" not in what else 2e-3  # of a level set
    assert far.max() <= fuzz and (numpy.abs(far) <= fuzz).sum() >= 40
    assert report["spec"]["region"]["inside"].keys() == region.keys()


@pytest.mark.sanitized
def test_regions_that_are_none(worker, tmp_path):
    (tmp_path / "open.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    for surface, region, words in (
            (ball(1), {}, "exactly one of inside, min"),
            (ball(1), {"inside": ball(1), "min": [0, 0, 0]}, "exactly one of inside, min"),
            (below(0), {"inside": below(1)}, "is unbounded"),
            (ball(1), {"inside": ball(0.5)}, "/region/inside: the solid, between (-0.51"),
            (ball(1), {"inside": ball(0.5)}, "contains no part of the surface, which is between (-1.0"),
            (ball(1), {"inside": {"mesh": {"path": "open.off"}}}, "or a region must be closed"),
            (ball(1), {"inside": {"mesh": {"path": "missing.off"}}}, "missing.off")):
        done = worker(sphere(100, surface=surface, region=region))
        assert done.returncode in (2, 3, 4) and words in done.stderr, done.stderr


def test_a_region_through_the_daemon(service):
    job = service.submit(sphere(200, region={"min": [-2, -2, 0], "max": [2, 2, 2]}))
    service.wait_state(job, "succeeded")
    report = service.get(f"/v1/jobs/{job}/results/report.json").json
    assert report["surface"]["area"] == pytest.approx(2 * math.pi, rel=1e-4)
    refused = service.submit(sphere(200, region={"min": [2, 2, 2], "max": [3, 3, 3]}))
    failed = service.wait_state(refused, "failed")
    assert failed["error"]["code"] == "no_surface" and "(2, 2, 2) to (3, 3, 3)" in failed["error"]["message"]
