# SPDX-License-Identifier: Apache-2.0
"""Measures of the same points with certain cells and with all cells from triangles (measurements/measures/two_ways.py)."""
import math
import pathlib
import sys

import numpy
import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "measurements" / "measures"))

import two_ways  # noqa: E402
from volumes import write_nrrd  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service


@pytest.mark.parametrize("name, certain", [("torus 2000", 0.98), ("torus graded 2000", 0.97), ("torus blue noise 2000", 0),
                                           ("open gyroid 2000", 0), ("torus with 100 kept points 2000", 0.9),
                                           ("labels of three balls 2000", 0.7)])
def test_both_ways_give_the_same_measures(build, tmp_path, name, certain):
    jobs = {job: (surface, sampling) for job, surface, sampling in two_ways.jobs(None, [2000], tmp_path)}
    found, why = two_ways.measured(build / "hexad-two-ways", *jobs[name], tmp_path)
    assert found, why
    assert found["certain_share"] >= certain
    wrong = [member for member in two_ways.faults(found, 2000, False) if member != "disorder"]
    assert not wrong and abs(found["certain"]["disorder"] - found["exact"]["disorder"]) < 0.002


@pytest.mark.parametrize("sampling", [{"count": 3000}, *({"count": count, "pattern": "blue_noise"} for count in (1500, 2000, 2500))])
def test_the_degrees_of_points_on_a_torus_add_up_to_its_euler_characteristic(build, tmp_path, sampling):
    found, why = two_ways.measured(build / "hexad-two-ways", two_ways.TORUS, sampling, tmp_path)
    assert found, why
    assert found["certain"]["euler"] == pytest.approx(0, abs=1e-9)
    assert found["exact"]["euler"] == pytest.approx(0, abs=1e-9)


def distance_from_circle(voxels, circle, radius):
    """In voxels, from a torus; with a circle of radius 0 from a sphere."""
    axis = numpy.arange(voxels) - (voxels - 1) / 2
    x, y, z = numpy.meshgrid(axis, axis, axis, indexing="ij")
    return (numpy.hypot(numpy.hypot(x, y) - circle, z) - radius).astype("f4")


@pytest.mark.parametrize("voxels, circle, radius, count, euler", [(9, 0, 2.7, 20000, 2), (14, 3.6, 1.8, 5000, 0), (14, 3.6, 1.8, 20000, 0)])
def test_grid_cells_larger_than_the_spacing_have_the_areas_of_the_surface(build, tmp_path, voxels, circle, radius, count, euler):
    path = tmp_path / "volume.nrrd"
    write_nrrd(path, distance_from_circle(voxels, circle, radius))
    found, why = two_ways.measured(build / "hexad-two-ways", {"volume": {"path": str(path), "isovalue": 0}}, {"count": count}, tmp_path)
    assert found, why
    assert found["certain_share"] > 0.99
    assert not two_ways.faults(found, count, False)
    assert found["exact"]["euler"] == pytest.approx(euler, abs=1e-9)


def write_rough_torus(path, steps, noise, seed):
    """A mesh of twice as many steps around the axis as around the tube, with noise in its vertices."""
    chance = numpy.random.default_rng(seed)
    around, across = 2 * steps, steps
    turns = [(2 * math.pi * i / around, 2 * math.pi * j / across) for i in range(around) for j in range(across)]
    vertices = numpy.array([((1 + 0.4 * math.cos(v)) * math.cos(u), (1 + 0.4 * math.cos(v)) * math.sin(u), 0.4 * math.sin(v))
                            for u, v in turns])
    vertices += chance.normal(0, noise, vertices.shape)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    for i in range(around):
        for j in range(across):
            a, b, c, d = (p % around * across + q % across + 1 for p, q in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)))
            lines += [f"f {a} {b} {c}", f"f {a} {c} {d}"]
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("noise, count", [(0.005, 10000), (0.01, 30000)])
def test_the_degrees_of_points_on_a_rough_mesh_add_up_to_its_euler_characteristic(build, tmp_path, noise, count):
    write_rough_torus(tmp_path / "mesh.obj", 30, noise, seed=1)
    found, why = two_ways.measured(build / "hexad-two-ways", {"mesh": {"path": str(tmp_path / "mesh.obj")}}, {"count": count}, tmp_path)
    assert found, why
    assert found["certain_share"] > 0.9
    assert found["certain"]["euler"] == pytest.approx(0, abs=1e-9)
    assert found["exact"]["euler"] == pytest.approx(0, abs=1e-9)


def test_a_difference_beyond_its_bound_is_named():
    same = {name: 0.5 for name in two_ways.BOUNDS} | {"outcome": "converged"}
    other = same | {"coverage": 0.53, "outcome": "unresolved"}
    assert two_ways.faults({"certain": same, "exact": same}, 2000, False) == []
    assert two_ways.faults({"certain": same, "exact": other}, 2000, False) == ["outcome", "coverage"]


def test_sides_on_a_strongly_bent_surface_are_lengths_of_arcs(build, tmp_path):
    found, why = two_ways.measured(build / "hexad-two-ways", {"analytic": {"shape": "sphere", "radius": 1}}, {"count": 200}, tmp_path)
    assert found, why
    assert found["certain_share"] > 0.7
    assert found["certain"]["disorder"] == pytest.approx(found["exact"]["disorder"], abs=0.0005)
