# SPDX-License-Identifier: Apache-2.0
"""The curvature of points on meshes, held against the surfaces that the meshes approximate; kappa_defined in all formats and in pictures."""
import json

import numpy
import pytest

import bars
from readers import EVERY, read_columns
from scenes import read_glb, read_usda

MAJOR, MINOR = 1, 0.4
SOLID = {"mesh": {"path": "torus.ply"}}


def torus(around, along, shift=(0, 0, 0), major=MAJOR, minor=MINOR):
    """Quads whose corners lie on a torus."""
    u, v = numpy.meshgrid(2 * numpy.pi * numpy.arange(around) / around, 2 * numpy.pi * numpy.arange(along) / along, indexing="ij")
    from_axis = major + minor * numpy.cos(v)
    vertices = numpy.stack([from_axis * numpy.cos(u), from_axis * numpy.sin(u), minor * numpy.sin(v)], axis=-1).reshape(-1, 3)
    i, j = (k.ravel() for k in numpy.meshgrid(numpy.arange(around), numpy.arange(along), indexing="ij"))
    faces = [(i + a) % around * along + (j + b) % along for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    return vertices + numpy.array(shift), numpy.stack(faces, axis=1).tolist()


def true_curvatures(x, major=MAJOR, minor=MINOR):
    cosine = numpy.cos(numpy.arctan2(x[:, 2], numpy.hypot(x[:, 0], x[:, 1]) - major))
    return numpy.stack([numpy.full(len(x), 1 / minor), cosine / (major + minor * cosine)], axis=1)


def positions(columns):
    return numpy.stack([columns[axis] for axis in "xyz"], axis=1).astype(float)


def errors(columns, true):
    """Of the defined points: the error of both curvatures over the larger one."""
    found = numpy.stack([columns["kappa1"], columns["kappa2"]], axis=1)
    off = numpy.abs(found - true).max(axis=1) / numpy.abs(true).max(axis=1)
    return off[columns["kappa_defined"] == 1]


@pytest.fixture
def sample(worker, tmp_path):
    """Samples a surface; the columns of points.ply and the report."""
    def call(surface, count=1500, output=None, sampling=None, where="out", **more):
        done = worker({"version": 1, "surface": surface, "sampling": {"count": count, **(sampling or {})}, "solver": {"threads": 1},
                       "output": {"preview": False, "ply": EVERY, **(output or {})}, **more}, output=where)
        assert done.returncode in (0, 10, 11), done.stderr
        return (read_columns((tmp_path / where / "points.ply").read_bytes()),
                json.loads((tmp_path / where / "report.json").read_text()))
    return call


@pytest.mark.parametrize("count", [500, 6000])
def test_coarse_quads_have_the_curvature_of_the_torus_at_any_count(sample, tmp_path, count):
    bars.write(tmp_path / "torus.ply", *torus(40, 20))
    columns, _ = sample(SOLID, count)
    off = errors(columns, true_curvatures(positions(columns)))
    assert (columns["kappa_defined"] == 1).all() and numpy.median(off) < 0.05 and off.max() < 0.1


@pytest.mark.parametrize("surface", [SOLID, {"mesh": {"path": "torus.ply", "resolution": 64}},
                                     {"union": [SOLID, {"analytic": {"shape": "sphere", "center": [0, 0, 0], "radius": 0.5}}]}],
                         ids=["mesh", "level set", "union"])
@pytest.mark.parametrize("properties, more", [("minimal", {}), (["nx", "spacing"], {}), (["kappa1"], {}), (["kappa_defined"], {}), ("blender", {}),
                                              (["energy", "d_x"], {"attributes": [{"from": "geometry", "name": "direction1", "as": "d"}]})],
                         ids=str)
def test_columns_do_not_depend_on_which_others_are_chosen(sample, tmp_path, surface, properties, more):
    """The curvature is computed if a column needs it."""
    bars.write(tmp_path / "torus.ply", *torus(40, 20))
    every, whole = sample(surface, 500, {"ply": {"precision": "double", **EVERY}}, **more)
    chosen, report = sample(surface, 500, {"ply": {"precision": "double", "properties": properties}}, where="chosen", **more)
    assert {"x", "y", "z"} <= set(chosen) and report["quality"] == whole["quality"]
    for name in set(chosen) & set(every):
        assert (chosen[name] == every[name]).all(), name


@pytest.mark.parametrize("output, more, computed", [
    ({}, {}, False), ({"preview": {"size": 64}}, {}, False), ({"preview": {"size": 64}, "preview_exr": True, "points_vdb": True}, {}, False),
    ({"mesh": True}, {}, False), ({"ply": {"properties": ["spacing", "energy", "default"]}}, {}, False),
    ({}, {"sampling": {"curvature": {"ratio": 3}}}, False), ({"ply": EVERY}, {}, True), ({"ply": {"properties": "quality"}}, {}, True),
    ({"ply": {"properties": "blender"}}, {}, True), ({"preview": {"size": 64, "color": "curvature"}}, {}, True),
    ({"preview": {"size": 64, "attribute": "kappa_defined"}}, {}, True), ({"preview": {"size": 64, "channels": "all"}, "preview_exr": True}, {}, True),
    ({"points_npz": True}, {}, True), ({"orient": {"twist": "kappa_defined"}}, {}, True),
    ({}, {"attributes": [{"from": "geometry", "name": "direction1"}]}, True)], ids=str)
def test_curvature_is_computed_only_if_something_shows_it(sample, tmp_path, output, more, computed):
    """If it is, the report describes where it is defined."""
    bars.write(tmp_path / "torus.ply", *torus(40, 20))
    columns, report = sample(SOLID, 300, {"ply": {}, **output}, **more)
    assert ("kappa_defined" in [a["name"] for a in report.get("attributes", [])]) == computed
    named = output.get("ply", {}).get("properties") in (["all"], "blender")
    assert ("kappa_defined" in columns) == named, "the default does not depend on other outputs"
    if not output.get("ply"):
        assert list(columns)[:6] == "x y z nx ny nz".split() and ("spacing" in columns) == ("sampling" in more)


def test_values_of_few_and_of_many_points_agree(sample, tmp_path):
    bars.write(tmp_path / "torus.ply", *torus(40, 20))
    few, _ = sample(SOLID, 500)
    many, _ = sample(SOLID, 12000, where="many")
    apart = numpy.linalg.norm(positions(few)[:, None] - positions(many)[None], axis=2).argmin(axis=1)
    assert numpy.median(numpy.abs(few["kappa"] / many["kappa"][apart] - 1)) < 0.02


@pytest.mark.parametrize("surface, more", [
    ({"mesh": {"path": "torus.ply", "resolution": 96}}, {}), ({"mesh": {"path": "torus.ply", "resolution": 96, "on_mesh": False}}, {}),
    (SOLID, {"region": {"min": [-2, -2, -2], "max": [0.3, 0.2, 0.1]}}),
    (SOLID, {"region": {"inside": {"analytic": {"shape": "box", "center": [0, 0, 0], "half_size": [0.9, 2, 0.25]}}}})],
    ids=["level set", "beside the mesh", "box", "region"])
def test_level_sets_and_regions_have_the_curvature_of_the_mesh(sample, tmp_path, surface, more):
    bars.write(tmp_path / "torus.ply", *torus(100, 40))
    columns, _ = sample(surface, **more)
    off = errors(columns, true_curvatures(positions(columns)))
    assert (columns["kappa_defined"] == 1).all() and numpy.median(off) < 0.01 and off.max() < 0.03


def test_an_offset_has_the_curvature_of_the_parallel_surface(sample, tmp_path):
    bars.write(tmp_path / "torus.ply", *torus(100, 40))
    columns, _ = sample({"offset": {"surface": SOLID, "distance": 0.1}})
    off = errors(columns, true_curvatures(positions(columns), minor=MINOR + 0.1))
    assert (columns["kappa_defined"] == 1).all() and numpy.median(off) < 0.015 and off.max() < 0.04


def test_an_offset_of_a_box_is_round_at_its_edges(sample, tmp_path):
    corners = numpy.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    bars.write(tmp_path / "box.ply", corners, faces)
    columns, _ = sample({"offset": {"surface": {"mesh": {"path": "box.ply"}}, "distance": 0.25}}, 3000)
    x = positions(columns)
    beyond = ((x < -0.01) | (x > 1.01)).sum(axis=1)  # 1: over a face, 2: along an edge, 3: at a corner
    clear = (numpy.minimum(numpy.abs(x), numpy.abs(x - 1)) > 0.02).all(axis=1)
    assert (columns["kappa_defined"] == 1).all() and set(beyond[clear]) == {1, 2, 3}
    for kind, true in ((1, (0, 0)), (2, (4, 0)), (3, (4, 4))):
        which = clear & (beyond == kind)
        assert numpy.allclose(columns["kappa1"][which], true[0], atol=1e-4) and numpy.allclose(columns["kappa2"][which], true[1], atol=1e-4)


@pytest.mark.extended
def test_points_of_a_union_have_the_curvature_of_their_part(sample, tmp_path):
    shift = numpy.array([0.7, 0.1, 0.05])
    bars.write(tmp_path / "torus.ply", *torus(100, 40))
    bars.write(tmp_path / "second.ply", *torus(100, 40, shift))
    columns, _ = sample({"union": [SOLID, {"mesh": {"path": "second.ply"}}]}, 3000, attributes=[{"from": "geometry", "name": "part"}])
    x = positions(columns)
    true = numpy.where(columns["part"][:, None] == 0, true_curvatures(x), true_curvatures(x - shift))
    off = errors(columns, true)
    assert numpy.median(off) < 0.01 and off.max() < 0.03
    undefined = columns["kappa_defined"] == 0
    assert 0.005 < undefined.mean() < 0.2 and (columns["kappa"][undefined] == 0).all()
    other = numpy.where(columns["part"] == 0, *(numpy.abs(numpy.hypot(numpy.hypot(y[:, 0], y[:, 1]) - MAJOR, y[:, 2]) - MINOR)
                                                for y in (x - shift, x)))
    assert other[undefined].max() < other[~undefined].min() + 0.02  # those near the other part


def test_directions_are_those_of_the_mesh(sample, tmp_path):
    """direction1 of a torus runs around its tube."""
    bars.write(tmp_path / "torus.ply", *torus(60, 24))
    columns, _ = sample(SOLID, attributes=[{"from": "geometry", "name": name} for name in ("direction1", "direction2")])
    x = positions(columns)
    around = numpy.stack([-x[:, 1], x[:, 0], 0 * x[:, 0]], axis=1) / numpy.hypot(x[:, 0], x[:, 1])[:, None]
    first, second = (numpy.stack([columns[f"direction{k}_{axis}"] for axis in "xyz"], axis=1) for k in (1, 2))
    assert numpy.abs((first * around).sum(axis=1)).max() < 0.05 and numpy.abs((second * around).sum(axis=1)).min() > 0.99


@pytest.mark.parametrize("by", [{}, {"resolution": 40}])
def test_directions_are_tangents_of_coarse_meshes(sample, tmp_path, by):
    """The normals of the points are those of the facets; the curvature belongs to the smooth surface."""
    bars.write(tmp_path / "torus.ply", *torus(16, 9))
    columns, _ = sample({"mesh": {"path": "torus.ply", **by}}, 600, attributes=[{"from": "geometry", "name": f"direction{k}"} for k in (1, 2)])
    normal = numpy.stack([columns[f"n{axis}"] for axis in "xyz"], axis=1)
    first, second = (numpy.stack([columns[f"direction{k}_{axis}"] for axis in "xyz"], axis=1) for k in (1, 2))
    defined = columns["kappa_defined"] == 1
    assert defined.mean() > 0.9
    for a, b in ((first, normal), (second, normal), (first, second)):
        assert numpy.abs((a * b).sum(axis=1))[defined].max() < 1e-6
    assert numpy.abs(numpy.linalg.norm(first, axis=1) - 1)[defined].max() < 1e-6


def test_spacing_by_curvature_at_points_takes_the_curvature_of_the_mesh(sample, tmp_path):
    """The larger curvature of a torus is the same everywhere outside, whatever its quads are like."""
    bars.write(tmp_path / "torus.ply", *torus(40, 20))
    columns, _ = sample(SOLID, sampling={"curvature": {"chord_error": 0.001, "scale": {"spacings": 0}}})
    assert columns["spacing"].max() / columns["spacing"].min() < 1.1


def pyramid(tmp_path):
    """A blunt, open mesh of five vertices, which determine no curvature."""
    corners = numpy.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 0.1]])
    bars.write(tmp_path / "pyramid.ply", corners, [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    return {"mesh": {"path": "pyramid.ply"}}


def test_kappa_defined_is_the_last_attribute_in_all_formats(sample, tmp_path):
    columns, report = sample(pyramid(tmp_path), 200, attributes=[{"from": "geometry", "name": "direction1"}],
                             output={f"points_{kind}": True for kind in ("npz", "glb", "usda", "vdb", "vtp")})
    assert list(columns)[-1] == "kappa_defined" and (columns["kappa_defined"] == 0).all()
    assert all((columns[name] == 0).all() for name in ("kappa", "kappa1", "kappa2", "direction1_x"))
    (told,) = [a for a in report["attributes"] if a["name"] == "kappa_defined"]
    assert told == report["attributes"][-1] and (told["type"], told["minimum"], told["maximum"]) == ("int", 0, 0)
    usd, _ = read_usda((tmp_path / "out" / "points.usda").read_text())
    gltf, _ = read_glb((tmp_path / "out" / "points.glb").read_bytes())
    assert (numpy.load(tmp_path / "out" / "points.npz")["kappa_defined"] == 0).all()
    assert (usd["int[] primvars:kappa_defined"] == 0).all() and (gltf["_KAPPA_DEFINED"] == 0).all()
    assert all(b"kappa_defined" in (tmp_path / "out" / f"points.{kind}").read_bytes() for kind in ("vdb", "vtp"))


def test_formulas_have_no_kappa_defined(sample):
    columns, report = sample({"analytic": {"shape": "sphere", "radius": 1}}, 200)
    assert "kappa_defined" not in columns and "attributes" not in report


def test_an_attribute_of_that_name_is_kept(sample, tmp_path):
    columns, report = sample(pyramid(tmp_path), 200, attributes=[{"from": "geometry", "name": "direction1", "as": "kappa_defined"}])
    assert "kappa_defined_x" in columns and "kappa_defined" not in columns
    assert any("kappa_defined" in warning for warning in report["surface"]["warnings"])


def test_undefined_points_are_grey(sample, tmp_path):
    shown = {"ply": {"properties": ["x", "y", "z", "red", "green", "blue", "kappa_defined"]}}
    columns, _ = sample(pyramid(tmp_path), 200, output=shown)
    colors = numpy.stack([columns[name] for name in ("red", "green", "blue")], axis=1)
    assert (colors == 140).all()
    bars.write(tmp_path / "torus.ply", *torus(40, 20))
    columns, _ = sample(SOLID, 200, output=shown)
    colors = numpy.stack([columns[name] for name in ("red", "green", "blue")], axis=1).astype(int)
    assert (colors.max(axis=1) - colors.min(axis=1) > 20).all()


def test_attached_results_keep_kappa_defined_or_go_on_without_it(sample, worker, tmp_path):
    bars.write(tmp_path / "torus.ply", *torus(40, 20))
    source = [{"from": "geometry", "name": "source"}]
    columns, _ = sample(SOLID, 300, attributes=source)
    attached = {"version": 1, "surface": SOLID, "sampling": {"attach": "out/points.ply"}, "output": {"preview": False}}
    assert worker(attached, output="again").returncode == 0
    again = read_columns((tmp_path / "again" / "points.ply").read_bytes())
    assert list(again)[-1] == "kappa_defined" and (again["kappa_defined"] == columns["kappa_defined"]).all()
    without = [name for name in columns if name != "kappa_defined"]
    sample(SOLID, 300, attributes=source, output={"ply": {"properties": without}})
    assert worker(attached, output="without").returncode == 0
    assert "kappa_defined" not in read_columns((tmp_path / "without" / "points.ply").read_bytes())
