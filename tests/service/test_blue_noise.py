# SPDX-License-Identifier: Apache-2.0
"""sampling.pattern "blue_noise": distances of the points, their spectrum, and what the pattern excludes."""
import json
import pathlib
import sys

import numpy
import pytest
from scipy.spatial import cKDTree

from readers import read_columns
from service import sphere

sys.path += [str(pathlib.Path(__file__).resolve().parents[2] / "measurements" / folder) for folder in ("common", "blue_noise")]
import blue_noise  # noqa: E402
import measure  # noqa: E402

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n"
CUBE = "".join(f"v {k & 1} {k >> 1 & 1} {k >> 2}\n" for k in range(8)) + \
    "".join(f"f {a} {b} {c}\nf {a} {c} {d}\n" for a, b, c, d in ((1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4),
                                                              (1, 5, 7, 3), (2, 4, 8, 6)))
TORUS = {"analytic": {"shape": "torus", "center": [0, 0, 0], "major_radius": 0.3, "minor_radius": 0.2}}
# a prism with edges of 27, 63 and 90 degrees
WEDGE = "v 0 0 0\nv 1 0 0\nv 1 0.5 0\nv 0 0.5 0\nv 0 0 0.5\nv 0 0.5 0.5\nf 1 4 3\nf 1 3 2\nf 5 2 3\nf 5 3 6\n" \
    "f 1 5 6\nf 1 6 4\nf 1 2 5\nf 4 6 3\n"
LEAST, RELATIVE, TOLERANCE = 0.74, 1.05, 1e-3


def spec(surface, count, solver=None, **sampling):
    return {"version": 1, "surface": surface, "sampling": {"count": count, "pattern": "blue_noise", **sampling},
            "solver": solver or {}, "output": {"preview": False, "ply": {"precision": "double"}}}


@pytest.fixture
def square(tmp_path):
    (tmp_path / "square.obj").write_text(SQUARE)
    return {"mesh": {"path": "square.obj"}}


@pytest.fixture
def run(solve):
    """Report and positions of a job that converges, and whose report has met the bounds of the pattern."""
    def call(document):
        report, points = solve(document)
        assert report["outcome"] == "converged", report
        columns = read_columns(points)
        position = numpy.stack([columns[name] for name in "xyz"], 1)
        assert len(position) == document["sampling"]["count"]
        quality = report["quality"]
        assert quality["min_spacing_ratio"] >= (1 - TOLERANCE) * LEAST
        assert quality["coverage"] <= (1 + TOLERANCE) * RELATIVE * quality["min_spacing_ratio"]
        return report, position
    return call


def distances(position, h, places):
    """The least distance and coverage of places, in spacings."""
    tree = cKDTree(position)
    return tree.query(position, 2)[0][:, 1].min() / h, tree.query(places)[0].max() / h


def check_distances(position, h, places):
    least, coverage = distances(position, h, places)
    assert least >= (1 - TOLERANCE) * LEAST
    assert coverage <= (1 + TOLERANCE) * RELATIVE * least


@pytest.mark.sanitized
def test_a_square_is_covered_up_to_its_corners(run, square):
    _, position = run(spec(square, 500))
    side = numpy.linspace(0, 1, 201)
    places = numpy.stack(numpy.meshgrid(side, side, [0]), -1).reshape(-1, 3)
    check_distances(position, measure.ideal_spacing(1, 500), places)
    assert not position[:, 2].any() and position.min() >= 0 and position.max() <= 1


def test_points_keep_their_distances_on_a_sphere(run):
    surface = {"analytic": {"shape": "sphere", "center": [0, 0, 0], "radius": 1}}
    report, position = run(spec(surface, 1000))
    places = numpy.random.default_rng(1).normal(size=(100000, 3))
    places /= numpy.linalg.norm(places, axis=1)[:, None]
    check_distances(position, measure.ideal_spacing(4 * numpy.pi, 1000), places)
    assert abs(numpy.linalg.norm(position, axis=1) - 1).max() < 1e-9
    assert report["quality"]["hex_fraction"] < 0.6


def test_distances_follow_the_grading(run):
    report, _ = run(spec(TORUS, 1000, curvature={"ratio": 2.5, "exponent": 1}))
    assert report["grading"]["largest_spacing"] > 1.3 * report["grading"]["least_spacing"]


def test_points_of_a_cube_form_no_rows_along_its_edges(run, tmp_path):
    (tmp_path / "cube.obj").write_text(CUBE)
    _, position = run(spec({"mesh": {"path": "cube.obj"}}, 1500))
    h = measure.ideal_spacing(6, len(position))
    from_edge = numpy.sort(numpy.minimum(position, 1 - position), 1)[:, 1] / h
    expected = 24 * 0.1 * h / 6 * len(position)  # points within 0.1 spacings of an edge, at an even density
    assert (from_edge < 1e-6).sum() < 0.1 * expected and (from_edge < 0.1).sum() < 2 * expected


@pytest.mark.parametrize("mesh, count", [(CUBE, 1500), (WEDGE, 4000)], ids=["cube", "wedge"])
def test_surfaces_are_covered_across_their_edges(run, tmp_path, mesh, count):
    (tmp_path / "sharp.obj").write_text(mesh)
    report, position = run(spec({"mesh": {"path": "sharp.obj"}}, count))
    vertex = numpy.array([line.split()[1:] for line in mesh.splitlines() if line[0] == "v"], float)
    triangle = numpy.array([line.split()[1:] for line in mesh.splitlines() if line[0] == "f"], int) - 1
    share = numpy.linspace(0, 1, 1001)[:, None]
    edges = [(1 - share) * vertex[t[k - 1]] + share * vertex[t[k]] for t in triangle for k in range(3)]
    _, coverage = distances(position, report["spacing"], numpy.concatenate(edges))
    assert coverage <= (1 + TOLERANCE) * RELATIVE * report["quality"]["min_spacing_ratio"]


def test_a_surface_that_a_region_cuts_is_covered(run):
    document = spec({"analytic": {"shape": "sphere", "center": [0, 0, 0], "radius": 1}}, 500)
    _, position = run({**document, "region": {"min": [-2, -2, 0], "max": [2, 2, 2]}})
    angle = numpy.linspace(0, 2 * numpy.pi, 2000)
    rim = numpy.stack([numpy.cos(angle), numpy.sin(angle), 0 * angle], 1)
    check_distances(position, measure.ideal_spacing(2 * numpy.pi, 500), rim)
    assert position[:, 2].min() >= 0


def test_points_depend_on_the_seed_and_not_on_threads(solve, square):
    points = [solve(spec(square, 3000, {"seed": seed, "threads": threads}))[1]
              for seed, threads in ((1, 1), (1, 3), (2, 1))]
    assert points[0] == points[1] != points[2]


def test_hexagonal_is_the_default(solve):
    plain = sphere(300, output={"preview": False})
    named = {**plain, "sampling": {**plain["sampling"], "pattern": "hexagonal"}}
    assert solve(plain)[1] == solve(named)[1]


def test_ratings_are_those_of_the_pattern(run, square):
    report, _ = run(spec(square, 300))
    assert {name: rated["rating"] for name, rated in report["ratings"].items()} == \
        {"min_spacing_ratio": "good", "relative_coverage": "good"}


def test_features_below_the_spacing_are_not_converged(solve, tmp_path):
    # a prism of a tenth of a spacing: one point would have to cover two spacings of its length
    (tmp_path / "thin.obj").write_text("".join(
        f"v {10 * (k & 1)} {0.01 * (k >> 1 & 1)} {0.01 * (k >> 2)}\n" for k in range(8)) + CUBE[CUBE.index("f"):])
    report, _ = solve(spec({"mesh": {"path": "thin.obj"}}, 60))
    assert report["outcome"] == "not_converged"
    assert "relative_coverage" in {reason["criterion"] for reason in report["outcome_reasons"]}


REFUSED = [("/sampling/alpha", {"sampling": {"alpha": {}}}),
           ("/sampling/resolve", {"sampling": {"count": None, "resolve": True, "feature": {}}}),
           ("/sampling/points", {"sampling": {"points": {"path": "a.ply", "mode": "keep"}}}),
           ("/sampling/curve_spacing", {"sampling": {"curve_spacing": 0.5}}),
           ("/features", {"features": True}),
           ("/queue/coherent", {"surface": {"vdb": {"path": "a.####.vdb"}}, "queue": {"coherent": True, "frames": "1-2"}}),
           ("/solver/energy", {"solver": {"energy": "gaussian"}}),
           ("/sampling/pattern", {"surface": {"labels": {"path": "a.nrrd"}}})]


@pytest.mark.parametrize("pointer, parts", REFUSED, ids=[pointer for pointer, _ in REFUSED])
def test_what_the_pattern_excludes_is_refused(worker, pointer, parts):
    document = spec({"analytic": {"shape": "sphere", "radius": 0.4}}, 100)
    for group, members in parts.items():
        document[group] = members if group in ("surface", "features") else \
            {k: v for k, v in {**document.get(group, {}), **members}.items() if v is not None}
    done = worker(document)
    error = json.loads(done.stderr.splitlines()[-1])
    assert error["code"] == "spec_invalid"
    assert f"{pointer}: " in done.stderr and "blue_noise" in done.stderr


def points_on_square(solve, square, pattern):
    document = spec(square, 1000)
    document["sampling"]["pattern"] = pattern
    columns = read_columns(solve(document)[1])
    return numpy.stack([columns["x"], columns["y"]], 1)


def test_the_spectrum_has_one_peak_and_little_low_power(solve, square):
    first, later, low, _ = blue_noise.rate([points_on_square(solve, square, "blue_noise")])
    assert first > 1.4 and later < 1.5 and low < 0.12  # one set: rings have a noise of 5 %
    _, later, _, _ = blue_noise.rate([points_on_square(solve, square, "hexagonal")])
    assert later > 2


@pytest.mark.extended
def test_spectra_of_ten_seeds_are_within_the_bounds(build, tmp_path):
    rows, bad = blue_noise.square_rows(build / "hexad-worker", tmp_path)
    assert bad == 0, rows
