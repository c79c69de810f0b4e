# SPDX-License-Identifier: Apache-2.0
"""On thin and sharp meshes the exact position of a point decides its wall: normals, given points, places and measures, held against the
triangles of the file. Every solid is rotated at random.

HEXAD_WALL_CASES (8 unless it is set) is the number of solids of each test, HEXAD_TEST_SEED their seed, which is printed."""
import json
import os

import numpy
import pytest

import bars
import solids
from readers import EVERY, read_columns
from scenes import stack

CASES = int(os.environ.get("HEXAD_WALL_CASES", "8"))
BETWEEN = 0.55  # of a hexagonal packing and one more point, which is 0.577 spacings from three others
LEAST = 0.15  # of points drawn at random, and edges: both leave gaps smaller than the spacing
SEED = int(os.environ.get("HEXAD_TEST_SEED", "20051"))


@pytest.fixture
def run(worker, tmp_path):
    """Runs a job on a solid: its report, and the columns of points.ply."""
    def call(solid, sampling, where="out", **more):
        solid.write(tmp_path / "solid.obj")
        done = worker({"version": 1, "surface": {"mesh": {"path": "solid.obj"}}, "sampling": sampling, "solver": {"threads": 1},
                       "output": {"preview": False, "ply": {"precision": "double", **EVERY}}, **more}, output=where)
        assert done.returncode in (0, 10, 11), done.stderr
        return (json.loads((tmp_path / where / "report.json").read_text()),
                read_columns((tmp_path / where / "points.ply").read_bytes()))
    return call


def cases():
    print("seed", SEED)
    for k in range(CASES):
        yield k, numpy.random.default_rng((SEED, k))


def thin(k, random, count):
    """Plates and shells between .05 and 1 spacings thick."""
    thickness = 10 ** random.uniform(numpy.log10(0.05), 0)
    if k % 4 == 3:
        made = solids.shell(thickness * solids.ball(1, 3).spacing(count / 2))
    else:
        width = random.uniform(0.4, 1)
        made = solids.plate(width, thickness * solids.plate(width, 1e-3).spacing(count))
    return made.rotated(random)


def test_given_points_keep_their_wall_and_measures_see_it(run, tmp_path):
    """Points drawn on the triangles; the report has the least distance that the triangles give."""
    for k, random in cases():
        count = int(random.integers(200, 500))
        solid = thin(k, random, count)
        given, of = solid.darts(random, 0.75 * solid.spacing(count), count // 2)
        solids.write_points(tmp_path / "given.ply", given)
        report, columns = run(solid, {"count": count, "points": {"path": "given.ply", "mode": "keep"}})
        at, normals = stack(columns, *"xyz"), stack(columns, "nx", "ny", "nz")
        assert (at[:len(given)] == given).all()
        along = (normals[:len(given)] * solid.normals[of]).sum(axis=1)
        assert along.min() > 0.9, (k, count, int((along < 0.9).sum()))
        least = solid.least_distance(at, columns["spacing"], columns["kept"] == 1)
        assert abs(report["quality"]["min_spacing_ratio"] - least) < 1e-6 and least > LEAST, (k, count, least)


def test_points_of_a_result_keep_their_wall(run, tmp_path):
    """hexad's own points, edges included, of which some are made anew."""
    for k, random in cases():
        count = int(random.integers(200, 500))
        solid = thin(k, random, count)
        first, before = run(solid, {"count": count}, "before")
        chosen = numpy.sort(random.permutation(count)[:count * 95 // 100])
        given, was = stack(before, *"xyz")[chosen], stack(before, "nx", "ny", "nz")[chosen]
        solids.write_points(tmp_path / "given.ply", given)
        report, columns = run(solid, {"count": count, "points": {"path": "given.ply", "mode": "keep"}})
        at, normals = stack(columns, *"xyz"), stack(columns, "nx", "ny", "nz")
        for own, there, walls in zip(normals, at, solid.touching(at)):
            assert is_outward(own, walls), (k, there)
        inside = before["feature"][chosen] == 0
        assert ((normals[:len(given)] * was).sum(axis=1)[inside] > 0.9).all(), k
        least = solid.least_distance(at, columns["spacing"], columns["kept"] == 1)
        assert abs(report["quality"]["min_spacing_ratio"] - least) < 1e-6, (k, count, least)
        assert least > min(BETWEEN, 0.9 * first["quality"]["min_spacing_ratio"]), (k, count, least)
        assert report["quality"]["hex_fraction"] > first["quality"]["hex_fraction"] - 0.05, (k, count)


def test_points_on_a_thin_formula_with_edges_keep_their_wall(worker, tmp_path):
    """A box, of which one side is a third of the spacing: the sign of a coordinate tells the walls."""
    def run(sampling, where):
        done = worker({"version": 1, "surface": {"analytic": {"shape": "box", "center": [0, 0, 0], "half_size": [0.5, 0.4, 0.015]}},
                       "features": True, "sampling": sampling, "solver": {"threads": 1},
                       "output": {"preview": False, "ply": {"precision": "double"}}}, output=where)
        assert done.returncode in (0, 10, 11), done.stderr
        return read_columns((tmp_path / where / "points.ply").read_bytes())
    before = run({"count": 200}, "before")
    given = stack(before, *"xyz")[before["feature"] == 0][::2]
    assert 20 < (given[:, 2] > 0).sum() < len(given) - 20
    solids.write_points(tmp_path / "given.ply", given)
    after = run({"count": 200, "points": {"path": "given.ply", "mode": "keep"}}, "after")
    assert (after["nz"][:len(given)] * numpy.sign(given[:, 2]) > 0.999).all()


def is_outward(normal, walls):
    """Whether it is the normal of one of the walls, or of several between which the surface turns by at most 60 degrees."""
    facing = walls @ normal
    return len(walls) > 0 and facing.max() > 0.81 and facing.min() > -0.98


def sharp(k, random):
    kinds = (lambda: solids.prism(random.uniform(30, 150)), lambda: solids.plate(1, 1),
             lambda: solids.prism(90), lambda: solids.drum(int(random.integers(5, 40))))
    return kinds[k % 4]().rotated(random)


@pytest.mark.sanitized
def test_normals_faces_and_corners_agree_at_edges(run):
    """In the result, and when it is attached to the mesh that it lies on."""
    for k, random in cases():
        solid = sharp(k, random)
        results = [run(solid, {"count": int(random.integers(150, 400))}, "first",
                       attributes=[{"from": "geometry", "name": "source"}]),
                   run(solid, {"attach": "first/points.ply"}, "second")]
        for _, columns in results:
            at, normals = stack(columns, *"xyz"), stack(columns, "nx", "ny", "nz")
            for own, there, walls in zip(normals, at, solid.touching(at)):
                assert is_outward(own, walls), (k, there)
            places = {key: columns[f"source_{key}"] for key in ("mesh", "face")}
            places.update({key: stack(columns, *(f"source_{key}_{axis}" for axis in "xyz")) for key in ("corner", "bary")})
            there, across = bars.evaluate(places, solid.vertices, solid.triangles.tolist())
            assert numpy.linalg.norm(there - at, axis=1).max() < 1e-6
            assert ((across * normals).sum(axis=1) > 0.5).all(), k
            assert ((across * solid.normals[places["face"].astype(int)]).sum(axis=1) > 0.999).all(), k


def test_two_sided_faces_are_one_sheet(run, tmp_path):
    """Of coincident faces the first one has the points; new points keep their distance from given ones."""
    random = numpy.random.default_rng(SEED)
    one = solids.ball(1, 3)
    one = solids.Solid(one.vertices, one.triangles[one.normals[:, 2] > 0]).rotated(random)
    given, of = one.darts(random, 0.75 * one.spacing(400), 200)
    solids.write_points(tmp_path / "given.ply", given)
    report, columns = run(solids.twice(one), {"count": 400, "points": {"path": "given.ply", "mode": "keep"}},
                          attributes=[{"from": "geometry", "name": "source"}])
    assert columns["source_face"].max() < len(one.triangles)
    along = (stack(columns, "nx", "ny", "nz")[:len(given)] * one.normals[of]).sum(axis=1)
    assert abs(along).min() > 0.9 and (along > 0).all() or (along < 0).all()
    least = one.least_distance(stack(columns, *"xyz"), columns["spacing"], columns["kept"] == 1)
    assert abs(report["quality"]["min_spacing_ratio"] - least) < 1e-6 and least > LEAST
