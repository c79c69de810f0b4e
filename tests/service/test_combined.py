# SPDX-License-Identifier: Apache-2.0
"""Surfaces of surfaces, as a user hands them to the worker: unions, intersections, differences, offsets and transforms of
formulas, dense volumes and meshes, held against what geometry says."""
import json

import numpy
import pytest
from scipy.spatial import cKDTree

from mesh_reader import Mesh
from readers import EVERY, Points
from volumes import write_nrrd

COUNT = 800


@pytest.fixture
def sample(solve):
    """Runs a surface; the report and the points, or the error and None. Few sweeps: areas and places need no rest."""
    def run(surface, **parts):
        spec = {"version": 1, "surface": surface, "sampling": {"count": COUNT},
                "solver": {"threads": 1, "max_sweeps": 40},
                "output": {"preview": False, "ply": {"precision": "double", **EVERY}}, **parts}
        told, data = solve(spec)
        return told, data and Points(data)
    return run


def sphere(radius, center=(0, 0, 0)):
    return {"analytic": {"shape": "sphere", "radius": radius, "center": list(center)}}


def box(half_size, center=(0, 0, 0), rounding=0.0):
    return {"analytic": {"shape": "box", "half_size": list(half_size), "center": list(center), "rounding": rounding}}


def transform(surface, matrix):
    return {"transform": {"surface": surface, "matrix": [float(v) for v in numpy.array(matrix).flat]}}


def to_sphere(points, radius, center):
    return numpy.linalg.norm(points.position - numpy.array(center), axis=1) - radius


@pytest.fixture(scope="module")
def dense_ball(tmp_path_factory):
    """A ball of radius 1 about (0.1, 0, 0) in voxels of 0.1, with a margin of 5 voxels around it."""
    path = tmp_path_factory.mktemp("ball") / "ball.nrrd"
    n, h = 30, 0.1
    matrix = numpy.diag([h, h, h, 1.0])
    matrix[:3, 3] = -h * (n - 1) / 2 + numpy.array([0.1, 0, 0])
    index = numpy.stack(numpy.meshgrid(*[numpy.arange(n)] * 3, indexing="ij"), -1)
    world = index @ matrix[:3, :3].T + matrix[:3, 3]
    write_nrrd(path, (1 - numpy.linalg.norm(world - [0.1, 0, 0], axis=-1)).astype("f4"), matrix)
    return {"volume": {"path": str(path), "isovalue": 0}}


@pytest.fixture(scope="module")
def cube_mesh(tmp_path_factory):
    """The cube from -1 to 1, a mesh."""
    path = tmp_path_factory.mktemp("cube") / "cube.off"
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    text = "OFF\n8 6 0\n" + "".join("%d %d %d\n" % c for c in corners) + "".join("4 %d %d %d %d\n" % f for f in faces)
    path.write_text(text)
    return {"mesh": {"path": str(path), "resolution": 40, "band_vox": 8}}


def coarse(cube_mesh):
    """The same cube in voxels of 0.1."""
    return {"mesh": {**cube_mesh["mesh"], "resolution": 20}}

R1, R2, APART = 1.0, 0.7, 0.9


@pytest.mark.parametrize("kind", ["union", "intersection", "difference"])
def test_two_spheres(sample, diagnose, kind):
    """Each point lies on one sphere, on the side of the other that belongs to the solid; areas are those of caps."""
    report, points = sample({kind: [sphere(R1), sphere(R2, (APART, 0, 0))]})
    one, two = to_sphere(points, R1, (0, 0, 0)), to_sphere(points, R2, (APART, 0, 0))
    on_one = numpy.abs(one) < 1e-6
    assert (on_one | (numpy.abs(two) < 1e-6)).all()
    sign = {"union": (1, 1), "intersection": (-1, -1), "difference": (1, -1)}[kind]  # of the other's F on one, on two
    assert (sign[0] * two[on_one] > -1e-6).all() and (sign[1] * one[~on_one] > -1e-6).all()
    outward = numpy.where(on_one[:, None], points.position / R1, (points.position - [APART, 0, 0]) / R2)
    if kind == "difference":
        outward[~on_one] *= -1
    edge = (numpy.abs(one) < 1e-3) & (numpy.abs(two) < 1e-3)  # there either normal will do
    assert ((outward * points.normal).sum(axis=1)[~edge] > 1 - 1e-6).all()
    at = (APART**2 + R1**2 - R2**2) / (2 * APART)  # the plane of the circle in which they meet
    inside_one, inside_two = 2 * numpy.pi * R1 * (R1 - at), 2 * numpy.pi * R2 * (R2 - (APART - at))
    all_one, all_two = 4 * numpy.pi * R1**2, 4 * numpy.pi * R2**2
    area = {"union": all_one - inside_one + all_two - inside_two, "intersection": inside_one + inside_two,
            "difference": all_one - inside_one + inside_two}[kind]
    q = report["quality"]
    diagnose(f"{kind}: area off by {report['surface']['area'] / area - 1:.1e}, hex_fraction {q['hex_fraction']:.3f}, "
             f"euler {q['euler']:.3g}")
    assert report["surface"]["area"] == pytest.approx(area, rel=2e-4)
    assert q["lost"] == 0 and q["max_residual"] < 1e-3


def solid(shape, **members):
    return {"analytic": {"shape": shape, "center": [0, 0, 0], **members}}

ROOT5, PI = 5 ** 0.5, numpy.pi
CYLINDER = solid("cylinder", radius=1, height=2, axis=[1, 1, 0.5])


@pytest.mark.parametrize("surface, area", [
    (CYLINDER, 6 * PI),
    (solid("cylinder", radius=1, height=2, rounding=0.25), 2 * PI * 0.75**2 + 3 * PI + 0.375 * PI**2 + 4 * PI * 0.25**2),
    (solid("cone", radius=1, height=2), PI * (1 + ROOT5)),
    (solid("cone", radius=1, top_radius=0.5, height=2, axis=[0, 1, 1]), PI * (1.25 + 1.5 * numpy.hypot(2, 0.5))),
    (solid("capsule", radius=0.5, height=2, axis=[1, 2, 3]), 3 * PI),
    ({"offset": {"surface": CYLINDER, "distance": -0.25}}, 2 * PI * 0.75**2 + 2 * PI * 0.75 * 1.5),
    pytest.param({"intersection": [sphere(1), solid("halfspace")]}, 3 * PI, marks=pytest.mark.extended),
    pytest.param({"intersection": [solid("halfspace", center=[0, 0, 5]), sphere(1)]}, 4 * PI,
                 marks=pytest.mark.extended),
    ({"difference": [sphere(1), transform(solid("halfspace"), [[0, 0, 1, 0.5], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])]},
     PI + PI * 0.75)],
    ids=["cylinder", "rounded", "cone", "cut cone", "capsule", "shrunk", "half", "whole", "cap"])
def test_areas_of_formulas(sample, surface, area):
    report, points = sample(surface)
    assert report["surface"]["area"] == pytest.approx(area, rel=1e-3)
    assert report["quality"]["lost"] == 0


def test_a_half_space_in_a_region(sample):
    # the plane y + 2 z = 0 in a cube of side 2
    cube = {"min": [-1, -1, -1], "max": [1, 1, 1]}
    report, points = sample(solid("halfspace", axis=[0, 1, 2]), region=cube)
    assert report["surface"]["area"] == pytest.approx(2 * ROOT5, rel=1e-9)
    assert numpy.abs(points.position @ [0, 1, 2]).max() < 1e-8
    assert (numpy.abs(points.position).max(axis=1) > 1 - 1e-9).sum() > 10
    e, _ = sample(solid("halfspace", center=[0, 0, 9]), region=cube)
    assert e["code"] == "no_surface" and "move or widen the region" in e["message"]
    report, _ = sample({"union": [solid("halfspace"), sphere(0.5)]}, region=cube)
    assert report["surface"]["area"] == pytest.approx(4 + PI * 0.25, rel=5e-4)


@pytest.mark.parametrize("z, sign", [
    (6, 1), (33, 1), pytest.param(6, -1, marks=pytest.mark.extended), pytest.param(33, -1, marks=pytest.mark.extended)])
def test_a_plane_has_two_sides_beyond_its_coefficient_blocks(sample, tmp_path, sign, z):
    """A sphere far from the plane is another surface on the one side, and within the solid on the other."""
    values = numpy.broadcast_to(sign * (numpy.arange(40.0) - 19.5), (40, 40, 40))
    write_nrrd(tmp_path / "plane.nrrd", values.astype("f4"))
    report, _ = sample({"union": [{"volume": {"path": str(tmp_path / "plane.nrrd"), "isovalue": 0}}, sphere(4, (20, 20, z))]})
    within = (z > 19.5) == (sign > 0)
    assert report["surface"]["area"] == pytest.approx(39**2 + (0 if within else 4 * PI * 16), rel=2e-3)


@pytest.fixture
def to_the_end(tmp_path):
    """Solids that data of 40^3 voxels do not hold whole: all above z = 19.5; all but a ball of radius 6 in the middle."""
    n, middle = 40, 19.5
    index = numpy.stack(numpy.meshgrid(*[numpy.arange(n)] * 3, indexing="ij"), -1)
    solids = {"half": index[..., 2] - middle, "hollow": numpy.linalg.norm(index - middle, axis=-1) - 6}
    for name, values in solids.items():
        write_nrrd(tmp_path / f"{name}.nrrd", values.astype("f4"))
        solids[name] = {"volume": {"path": str(tmp_path / f"{name}.nrrd"), "isovalue": 0}}
    return solids


def ball_at(radius, z):
    return sphere(radius, (19.5, 19.5, z))


@pytest.mark.parametrize("kind, solid, other, area, open_", [
    pytest.param("intersection", "half", ball_at(5, 28), 4 * PI * 25, False, marks=pytest.mark.extended),
    ("intersection", "half", ball_at(8, 21.5), 2 * PI * 8 * 10 + PI * 60, False),
    pytest.param("intersection", "half", ball_at(5, 37), 2 * PI * 5 * 7, True, marks=pytest.mark.extended),
    ("difference", "half", ball_at(5, 28), 39**2 + 4 * PI * 25, True),
    pytest.param("intersection", "hollow", ball_at(12, 19.5), 4 * PI * (144 + 36), False, marks=pytest.mark.extended),
    ("difference", "hollow", sphere(4, (33, 33, 33)), 4 * PI * (16 + 36), False)],
    ids=["within", "across", "over the end", "hole", "shell", "two holes"])
def test_solids_go_on_where_they_have_no_surface(sample, to_the_end, kind, solid, other, area, open_):
    """Up to the end of the data, beyond the box that holds the surface."""
    report, points = sample({kind: [to_the_end[solid], other]})
    assert report["surface"]["area"] == pytest.approx(area, rel=2e-3)
    assert report["quality"]["lost"] == 0 and (points.position.max() > 39 - 1e-6) == open_
    assert points.position.max() <= 39 + 1e-6


TURN = [[0.8, -0.6, 0, 0], [0.6, 0.8, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


@pytest.mark.sanitized
def test_data_that_end_in_a_solid_are_refused(sample, to_the_end):
    turned = transform(to_the_end["hollow"], TURN)
    for surface, part in (({"difference": [box((15, 15, 15), (19.5, 19.5, 40)), to_the_end["half"]]}, 1),
                          ({"intersection": [turned, sphere(12, (20, 27, 19.5))]}, 0)):
        e, _ = sample(surface)
        assert e["code"] == "not_supported" and f"part {part}" in e["message"], e


@pytest.mark.extended
def test_a_solid_within_the_ends_of_turned_data_is_whole(sample, to_the_end):
    turned = transform(to_the_end["hollow"], TURN)
    report, _ = sample({"intersection": [turned, sphere(10, (3.9, 27.3, 19.5))]})
    assert report["surface"]["area"] == pytest.approx(4 * PI * (100 + 36), rel=2e-3)


def on_curve(points, *distances):
    """Steps of the row of points that lie on all of these surfaces, along a curve about the z axis."""
    on = numpy.max([numpy.abs(d) for d in distances], axis=0) < 1e-6
    row = points.position[on]
    row = row[numpy.argsort(numpy.arctan2(row[:, 1], row[:, 0]))]
    return numpy.linalg.norm(numpy.roll(row, -1, axis=0) - row, axis=1)


def test_sharp_edges_have_rows_of_points(sample, tmp_path, diagnose):
    """A cylinder that a plane cuts: a circle and an ellipse; its mesh is closed and cuts no corner."""
    cut = {"difference": [solid("cylinder", radius=1, height=3), solid("halfspace", center=[0, 0, 0.5], axis=[0, -1, -2])]}
    report, points = sample(cut, features=True, sampling={"count": 3000}, solver={"threads": 2},
                            output={"preview": False, "mesh": True, "ply": {"precision": "double"}})
    area, q = PI * (1 + ROOT5 / 2) + 2 * PI * 2, report["quality"]
    assert report["outcome"] == "converged" and report["surface"]["area"] == pytest.approx(area, rel=1e-4)
    h = (2 * area / (3 ** 0.5 * 3000)) ** 0.5
    x, y, z = points.position.T
    side, top, bottom = numpy.hypot(x, y) - 1, (y + 2 * z - 1) / ROOT5, z + 1.5
    for row in (on_curve(points, side, top), on_curve(points, side, bottom)):
        diagnose(f"{len(row)} points, steps of {row.mean() / h:.3f} spacings, cv {row.std() / row.mean():.1e}")
        assert 0.9 < row.min() / h and row.max() / h < 1.1 and row.std() / row.mean() < 0.02
    assert q["hex_fraction"] > 0.93 and q["lost"] == 0
    loops = report["curves"]["list"]
    assert len(loops) == 2 and all(c["closed"] and c["edge_cv"] < 0.02 and 0.9 < c["gap"] < 1.1 for c in loops)
    assert min(c["length"] for c in loops) == pytest.approx(2 * PI, rel=2e-3)
    assert sorted(c["points"] for c in loops) == sorted(len(row) for row in
                                                        (on_curve(points, side, top), on_curve(points, side, bottom)))
    mesh = Mesh(tmp_path / "out" / "mesh.ply")
    edges = numpy.sort(numpy.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), axis=1)
    assert (numpy.unique(edges, axis=0, return_counts=True)[1] == 2).all() and len(mesh.faces) == 2 * 3000 - 4
    x, y, z = ((mesh.a + mesh.b + mesh.c) / 3).T
    off = numpy.maximum(numpy.hypot(x, y) - 1, numpy.maximum((y + 2 * z - 1) / ROOT5, -z - 1.5))
    assert numpy.abs(off).max() < 0.15 * h


@pytest.mark.extended
def test_points_on_the_edge_between_spheres_have_whole_cells(sample):
    """A point of the edge that only the triangles on one side contain had half of its cell's share of a turn: 1.41 spacings."""
    bitten = {"difference": [sphere(1), sphere(0.8, (0.7, 0.2, 0.1))]}
    _, points = sample(bitten, features=True, sampling={"count": 400})
    on_edge = points.feature == 1
    assert on_edge.sum() > 15
    assert (points.spacing_local / points.spacing)[on_edge].max() < 1.2


def test_points_of_a_mesh_that_a_sphere_cuts_lie_on_them(sample, cube_mesh):
    report, _ = sample({"difference": [coarse(cube_mesh), sphere(0.5, (1, 0.9, 0.2))]}, sampling={"count": 500})
    assert report["quality"]["largest_move"] > 0 and report["quality"]["max_residual"] < 1e-5


@pytest.mark.extended
def test_points_of_combined_meshes_lie_on_them(sample, cube_mesh):
    """Beside an edge in which two meet, too: a point may be nearer to the level set of the one that it is not on."""
    moved = {"transform": {"surface": cube_mesh, "matrix": [1, 0, 0, 0.71, 0, 1, 0, 0.33, 0, 0, 1, 0.52, 0, 0, 0, 1]}}
    report, _ = sample({"difference": [cube_mesh, moved]}, sampling={"count": 1000})
    assert report["quality"]["largest_move"] > 0 and report["quality"]["max_residual"] < 1e-5


@pytest.mark.sanitized
def test_curvature_does_not_look_across_an_edge(sample):
    """The faces of a cube are flat up to its edges, at any scale."""
    report, points = sample({"analytic": {"shape": "box", "center": [0, 0, 0], "half_size": [1, 1, 1]}}, features=True,
                            sampling={"count": 1500, "alpha": {"d": 1}})
    assert report["alpha"]["scale"] > report["spacing"]
    assert numpy.abs(points.kappa_scale).max() < 1e-9 and numpy.ptp(points.alpha) < 1e-9


def test_points_on_curves_may_be_denser(sample):
    """Those on a cube's edges have half the spacing of those amid its faces; the count is exact, and the others follow."""
    cube = {"surface": {"analytic": {"shape": "box", "center": [0, 0, 0], "half_size": [1, 1, 1]}}, "features": True}
    report, points = sample(**cube, sampling={"count": 2000, "curve_spacing": 0.5}, solver={"threads": 1})
    assert report["outcome"] == "converged" and report["count"] == len(points.position) == 2000
    on = points.feature == 1
    assert points.spacing[on].max() == pytest.approx(0.5 * points.spacing.max(), rel=0.02)
    assert report["curves"]["points"] == on.sum() > 12 * 2 / (0.55 * points.spacing.max())
    assert report["curves"]["edge_cv"] < 0.02 and report["quality"]["grading"]["cv"] < 0.05  # rows, too, where the spacing varies most
    amid = numpy.sort(1 - numpy.abs(points.position), axis=1)[:, 1]  # how far from the nearest edge
    assert points.spacing == pytest.approx(numpy.minimum(points.spacing[on].min() + 0.2 * amid, points.spacing.max()), rel=0.02)
    e, _ = sample(**cube, sampling={"count": 3000, "curve_spacing": 0.5, "alpha": {"d": 1}})
    assert e["code"] == "spec_invalid" and "curve_spacing" in e["message"]


def test_a_region_ends_in_rows(sample):
    """The upper part of a sphere, and of an open surface that is turned, which only patches can be."""
    above = {"min": [-2, -2, 0.1], "max": [2, 2, 2]}
    report, points = sample(sphere(1), features=True, region=above)
    assert report["surface"]["area"] == pytest.approx(2 * PI * 0.9, rel=1e-3)
    assert points.position[:, 2].min() > 0.1 - 1e-9
    row = on_curve(points, points.position[:, 2] - 0.1, numpy.linalg.norm(points.position, axis=1) - 1)
    assert row.std() / row.mean() < 0.02
    c, s = numpy.cos(0.5), numpy.sin(0.5)
    turn = numpy.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    gyroid = {"analytic": {"shape": "gyroid", "period": 1, "center": [0, 0, 0]}}
    plain, _ = sample(gyroid)
    report, points = sample(transform(gyroid, turn), features=True)
    assert report["surface"]["area"] == pytest.approx(plain["surface"]["area"], rel=2e-3)
    back = numpy.abs(points.position @ turn[:3, :3])
    assert back.max() < 0.5 + 1e-9 and (back.max(axis=1) > 0.5 - 1e-9).sum() > 50
    e, _ = sample({"union": [gyroid, sphere(0.2)]}, features=True)
    assert e["code"] == "not_supported"


C, S = numpy.cos(0.5), numpy.sin(0.5)
TURNED_BOX = transform(box((0.5, 0.5, 3)), [[C, -S, 0, 0], [S, C, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
CAP = 2 * PI * 1.2 * (1.2 - 1)


@pytest.mark.parametrize("surface, area", [
    ({"difference": [sphere(1), sphere(1, (0.5, 0, 0))]}, 4 * PI),
    pytest.param({"difference": [box((1, 1, 1)), TURNED_BOX]}, 24 - 2 + 8, marks=pytest.mark.extended),
    pytest.param({"difference": [box((1, 1, 1)), box((1, 1, 1), (1.1, 0.9, 1.2))]}, 24, marks=pytest.mark.extended),
    pytest.param({"intersection": [box((1, 1, 1)), sphere(1.2)]}, 4 * PI * 1.2**2 - 6 * CAP + 6 * PI * (1.2**2 - 1),
                 marks=pytest.mark.extended)],
    ids=["crescent", "hole", "corner", "die"])
def test_areas_at_sharp_edges(sample, diagnose, surface, area):
    """The part of a surface between an edge and the cells that the edge crosses is not lost: an edge of 29 degrees,
    edges oblique to the cells, and edges along them. The areas are closed forms."""
    report, _ = sample(surface)
    diagnose(f"area off by {report['surface']['area'] / area - 1:.1e}")
    assert report["surface"]["area"] == pytest.approx(area, rel=5e-4)
    assert report["quality"]["lost"] == 0


def test_solids_that_hide_each_other(sample, dense_ball):
    """Deep inside of a volume, and far outside, where its spline is not defined, its side still counts."""
    small, far = sphere(0.2, (0.1, 0, 0)), sphere(0.5, (9, 0, 0))
    ball = 4 * numpy.pi
    report, points = sample({"union": [dense_ball, small]})
    assert numpy.abs(to_sphere(points, 1, (0.1, 0, 0))).max() < 1e-3
    assert report["surface"]["area"] == pytest.approx(ball, rel=1e-3)
    assert report["surface"]["parts"][0]["volume"]["size"] == [30, 30, 30]
    report, points = sample({"difference": [dense_ball, small]})
    assert report["surface"]["area"] == pytest.approx(ball * (1 + 0.2**2), rel=1e-3)
    hollow = to_sphere(points, 0.2, (0.1, 0, 0)) < 0.1
    inwards = ((points.position - [0.1, 0, 0]) * points.normal).sum(axis=1) < 0
    assert hollow.sum() > 10 and (inwards == hollow).all()
    report, _ = sample({"union": [far, dense_ball]})
    assert report["surface"]["area"] == pytest.approx(ball * (1 + 0.5**2), rel=1e-3)
    for nothing in ({"intersection": [dense_ball, far]}, {"intersection": [small, sphere(0.05, (0.1, 0.3, 0))]}):
        e, points = sample(nothing)
        assert points is None and e["code"] == "no_surface", (nothing, e)


@pytest.mark.extended
def test_a_solid_deep_inside_a_volume(sample, dense_ball):
    """The intersection is the solid; the difference is empty."""
    small = sphere(0.2, (0.1, 0, 0))
    report, _ = sample({"intersection": [small, dense_ball]})
    assert report["surface"]["area"] == pytest.approx(4 * PI * 0.2**2, rel=1e-3)
    e, points = sample({"difference": [small, dense_ball]})
    assert points is None and e["code"] == "no_surface", e


@pytest.mark.parametrize("more", [{}, pytest.param({"features": True}, marks=pytest.mark.extended)],
                         ids=["smooth", "features"])
def test_a_part_that_is_empty_changes_nothing(sample, more):
    """Parts that do not meet, or of which nothing is left: in a union, or taken from a solid, they count as nothing, which a
    warning says. A solid of which nothing is left is no_surface, and says which part that is."""
    one, other = sphere(1), sphere(0.5, (3, 0, 0))
    none = {"intersection": [other, sphere(0.3)]}
    away = transform({"difference": [sphere(0.3), one]}, numpy.diag([2, -1, 1, 1.0]))
    shrunk = {"offset": {"surface": sphere(0.3), "distance": -0.5}}
    alone, points = sample(one, **more)
    for surface, left_out in (({"union": [none, one]}, ["/union/0"]), ({"difference": [one, shrunk, away]},
                              ["/difference/1/offset/surface", "/difference/2/transform/surface"]),
                              ({"union": [one, {"union": [shrunk, none]}]}, ["/union/1"])):
        report, same = sample(surface, **more)
        assert report["surface"]["area"] == pytest.approx(alone["surface"]["area"], rel=2e-3), surface
        assert numpy.abs(to_sphere(same, 1, (0, 0, 0))).max() < 1e-9
        told = [w for w in report["surface"]["warnings"] if "this part is skipped" in w]
        assert [w.split(":")[0] for w in told] == ["/surface" + place for place in left_out], report["surface"]["warnings"]
    for nothing, where in ((none, "/surface"), ({"difference": [{"union": [none, shrunk]}, one]}, "/surface/difference/0")):
        e, points = sample(nothing, **more)
        assert points is None and e["code"] == "no_surface" and e["message"].startswith(where + ": "), e


@pytest.mark.extended
def test_an_empty_part_of_a_mesh_changes_nothing(sample, cube_mesh):
    report, points = sample({"union": [cube_mesh, {"intersection": [cube_mesh, sphere(0.5, (3, 0, 0))]}]})
    assert points.count == COUNT and len(report["surface"]["parts"]) == 1
    assert report["surface"]["area"] == pytest.approx(24, rel=1e-2)


@pytest.mark.extended
def test_shells_thinner_than_cells(sample):
    """A shell that the parts' own cells do not show is whole, also where it is a combination within another."""
    report, points = sample({"difference": [sphere(1), sphere(0.9, (0, 0, 0.09))]})
    assert report["surface"]["area"] == pytest.approx(4 * numpy.pi * 1.81, rel=1e-3) and not report["surface"]["warnings"][1:]
    cut = {"difference": [{"difference": [sphere(1), sphere(0.97)]}, box((1, 1, 1), (1, 1, 1))]}
    report, points = sample(cut)  # an eighth is cut out
    assert report["surface"]["area"] == pytest.approx(numpy.pi * (3.5 * (1 + 0.97**2) + 0.75 * (1 - 0.97**2)), rel=2e-3)


@pytest.mark.sanitized
def test_walls_thinner_than_cells(sample):
    """A lens that the parts' own cells do not show is whole. A wall that no cells show is reported as lost."""
    tube = {"radius": 0.2, "height": 2, "axis": [0, 0, 1]}
    report, points = sample({"difference": [solid("capsule", **tube), solid("capsule", **{**tube, "radius": 0.19999})]})
    assert report["outcome"] != "converged" and "lost_area" in [r["criterion"] for r in report["outcome_reasons"]]
    assert any("thinner than its smallest cells" in w for w in report["surface"]["warnings"])
    lens = {"intersection": [sphere(1, (3, 0, 0)), sphere(1, (3, 0, 1.99))]}
    report, points = sample({"union": [sphere(0.5), lens]})
    assert report["surface"]["area"] == pytest.approx(numpy.pi * (1 + 0.02), rel=1e-3)


def test_what_is_missing_counts_by_its_area(sample):
    """Of a ball and a shell that no cells show, the shell is about two thirds of the area, whatever its own unit is."""
    shares = []
    for unit in (1, 100):
        thin = {"difference": [solid("capsule", radius=unit * r, height=2 * unit, axis=[0, 0, 1])
                               for r in (0.2, 0.19999)]}
        matrix = [1 / unit, 0, 0, 0, 0, 1 / unit, 0, 0, 0, 0, 1 / unit, 0, 0, 0, 0, 1]
        report, _ = sample({"union": [sphere(0.45, (3, 0, 0)), {"transform": {"matrix": matrix, "surface": thin}}]})
        shares += [r["value"] for r in report["outcome_reasons"] if r["criterion"] == "lost_area"]
    assert len(shares) == 2 and 0.4 < shares[0] < 0.9 and shares[1] == pytest.approx(shares[0], rel=0.1), shares


@pytest.mark.sanitized
def test_a_mesh_and_a_volume_in_one_union(sample, dense_ball, cube_mesh):
    moved = transform(coarse(cube_mesh), [[1, 0, 0, 4], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    report, points = sample({"union": [moved, dense_ball]})
    on_cube = points.position[:, 0] > 2
    assert numpy.abs(numpy.abs(points.position[on_cube] - [4, 0, 0]).max(axis=1) - 1).max() < 0.04
    assert numpy.abs(to_sphere(points, 1, (0.1, 0, 0))[~on_cube]).max() < 1e-3
    assert report["surface"]["area"] == pytest.approx(24 + 4 * PI, rel=1e-2)
    assert [part.get("volume", {}).get("format") for part in report["surface"]["parts"]] == [None, "NRRD"]
    assert [i["path"].split("/")[-1] for i in report["inputs"]] == ["cube.off", "ball.nrrd"]


@pytest.mark.extended
def test_kinds_may_be_mixed_and_nested(sample, dense_ball, cube_mesh):
    """A cube from which two balls are taken: every point is on one of the three."""
    corner = (-1, -1, 0.2)
    report, points = sample({"difference": [cube_mesh, {"union": [dense_ball, sphere(0.5, corner)]}]})
    cube = numpy.abs(points.position).max(axis=1) - 1
    ball = to_sphere(points, 1, (0.1, 0, 0))
    hole = to_sphere(points, 0.5, corner)
    near = 0.02  # a voxel of the mesh is 0.05, and its edges are round within it
    assert (numpy.minimum(numpy.abs(cube), numpy.minimum(numpy.abs(ball), numpy.abs(hole))) < near).all()
    assert (cube < near).all() and (ball > -near).all() and (hole > -near).all()
    assert [part.get("volume", {}).get("format") for part in report["surface"]["parts"]] == [None, "NRRD"]
    assert [i["path"].split("/")[-1] for i in report["inputs"]] == ["cube.off", "ball.nrrd"]
    assert report["quality"]["lost"] == 0


def test_a_transform_moves_turns_mirrors_and_shears(sample):
    matrix = numpy.array([[-2, 0.3, 0, 1], [0, 1, 0.2, -2], [0.1, 0, 0.5, 3], [0, 0, 0, 1]])
    _, points = sample(transform(sphere(1), matrix))
    back = numpy.linalg.solve(matrix[:3, :3], (points.position - matrix[:3, 3]).T).T
    assert numpy.abs(numpy.linalg.norm(back, axis=1) - 1).max() < 1e-6
    outward = numpy.linalg.solve(matrix[:3, :3].T, back.T).T
    outward /= numpy.linalg.norm(outward, axis=1)[:, None]
    assert ((outward * points.normal).sum(axis=1) > 1 - 1e-6).all()
    # an ellipsoid's curvatures are those of the formula
    _, one = sample(transform(sphere(1), numpy.diag([1, 2, 0.7, 1])))
    x = one.position / numpy.array([1, 2, 0.7])**2
    gauss = 1 / (1 * 2 * 0.7 * (x**2).sum(axis=1))**2
    assert numpy.abs(one.kappa1 * one.kappa2 / gauss - 1).max() < 1e-5


def test_a_transform_of_a_volume(sample, dense_ball):
    turn = numpy.array([[0, -2.0, 0, 5], [2.0, 0, 0, 0], [0, 0, 2.0, 0], [0, 0, 0, 1]])
    report, points = sample(transform(dense_ball, turn))
    assert numpy.abs(to_sphere(points, 2, (5, 0.2, 0))).max() < 1e-3
    assert report["surface"]["area"] == pytest.approx(16 * numpy.pi, rel=1e-3)


SMALL_GYROID = {"analytic": {"shape": "gyroid", "period": 1, "size": [1, 1, 1], "center": [0, 0, 0]}}


def test_open_surfaces(sample):
    """A gyroid's box cuts it: it stays open when it is turned by a quarter, cannot be turned obliquely, and cannot end
    inside of a union."""
    gyroid = {"analytic": {"shape": "gyroid", "period": 1, "size": [2, 2.5, 3], "center": [0, 0, 0]}}
    quarter = numpy.array([[0, -1, 0, 1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    plain, _ = sample(gyroid)
    report, points = sample(transform(gyroid, quarter))
    assert report["surface"]["area"] == pytest.approx(plain["surface"]["area"], rel=1e-5)
    assert numpy.abs(points.position - [1, 0, 0]).max(axis=0) == pytest.approx([1.25, 1, 1.5], abs=1e-9)
    c, s = numpy.cos(0.5), numpy.sin(0.5)
    e, _ = sample(transform(gyroid, [[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]))
    assert e["code"] == "not_supported" and "axes to axes" in e["message"]
    e, _ = sample({"union": [SMALL_GYROID, sphere(0.5, (4, 0, 0))]})
    assert e["code"] == "not_supported" and "part 0" in e["message"]


@pytest.mark.extended
def test_a_sphere_within_its_box_closes_a_gyroid(sample):
    report, points = sample({"intersection": [SMALL_GYROID, sphere(0.45)]})
    assert report["quality"]["lost"] == 0
    assert (numpy.linalg.norm(points.position, axis=1) < 0.45 + 1e-6).all()


def test_offsets_are_distances(sample, cube_mesh):
    digests = {}
    for name, surface in (("sphere", sphere(1.25)), ("offset", {"offset": {"surface": sphere(1), "distance": 0.25}}),
                          ("twice", {"offset": {"surface": {"offset": {"surface": sphere(1.5), "distance": -0.5}},
                                                "distance": 0.25}})):
        report, _ = sample(surface)
        digests[name] = report["outputs"][0]["sha256"]
    assert len(set(digests.values())) == 1, digests
    report, points = sample({"offset": {"surface": box((1, 1, 1)), "distance": 0.25}})
    gap = numpy.linalg.norm(numpy.maximum(numpy.abs(points.position) - 1, 0), axis=1)
    assert numpy.abs(gap - 0.25).max() < 1e-6
    for distance in (0.15, 0.75):  # the second is wider than the band of the spec
        _, points = sample({"offset": {"surface": cube_mesh, "distance": distance}})
        gap = numpy.linalg.norm(numpy.maximum(numpy.abs(points.position) - 1, 0), axis=1)
        assert numpy.abs(gap - distance).max() < 0.01
    _, points = sample({"offset": {"surface": cube_mesh, "distance": -0.15}})
    assert numpy.abs(numpy.abs(points.position).max(axis=1) - 0.85).max() < 0.02
    double = numpy.diag([2, 2, 2, 1.0])
    _, points = sample({"offset": {"surface": transform(sphere(1), double), "distance": 0.5}})
    assert numpy.abs(to_sphere(points, 2.5, (0, 0, 0))).max() < 1e-6
    _, points = sample({"offset": {"surface": {"difference": [sphere(2), sphere(1)]}, "distance": 0.1}})
    radius = numpy.linalg.norm(points.position, axis=1)
    assert (numpy.minimum(numpy.abs(radius - 2.1), numpy.abs(radius - 0.9)) < 1e-6).all() and radius.min() < 1 < radius.max()


@pytest.mark.sanitized
def test_what_has_no_offset_says_so(sample, dense_ball, cube_mesh):
    quartic = {"analytic": {"shape": "quartic"}}
    stretched = transform(sphere(1), numpy.diag([2, 1, 1, 1.0]))
    for surface, distance, code, word in (
            (quartic, 0.1, "not_supported", "the formula of this shape does not give"),
            (dense_ball, 0.1, "not_supported", "a dense volume does not have"),
            (stretched, 0.1, "not_supported", "does not preserve"),
            (sphere(1), -1, "no_surface", "removes the whole shape"),
            (cube_mesh, 2, "spec_invalid", "set voxel_size to at least 0.069")):
        e, points = sample({"offset": {"surface": surface, "distance": distance}})
        assert points is None and e["code"] == code and word in e["message"], e


def test_a_region_of_a_combination(sample):
    report, points = sample({"union": [sphere(R1), sphere(R2, (APART, 0, 0))]},
                            region={"min": [-2, -2, 0], "max": [2, 2, 2]})
    assert points.position[:, 2].min() >= 0 and (points.position[:, 2] < 1e-9).sum() > 10
    at = (APART**2 + R1**2 - R2**2) / (2 * APART)  # as in test_two_spheres
    whole = 2 * PI * (R1 * (R1 + at) + R2 * (R2 + APART - at))
    assert report["surface"]["area"] == pytest.approx(whole / 2, rel=1e-3)


@pytest.mark.sanitized
def test_points_on_new_places_find_their_rest(sample):
    """Between two spheres that touch all but for a hair particles leave the surface and are put elsewhere: the others make room."""
    pair = {"union": [sphere(0.2, (0.25, 0.5, 0.5)), sphere(0.2, (0.6495, 0.5, 0.5))]}
    report, _ = sample(pair, sampling={"count": 1200}, solver={"threads": 1, "seed": 4})
    assert report["quality"]["removed_offsurface"] > 0
    assert report["diagnostics"]["step_left"] <= report["spec"]["solver"]["step_tolerance"]
    assert report["outcome"] == "converged"  # both spheres are covered, and points at the contact are on opposite walls


@pytest.mark.sanitized
def test_faults_point_to_the_part(sample):
    e, _ = sample({"union": [sphere(1), {"difference": [sphere(1), sphere(-1)]}, {"offset": {"surface": {}}}]})
    pointers = {f["pointer"] for f in e["errors"]}
    assert pointers == {"/surface/union/1/difference/1/analytic/radius", "/surface/union/2/offset/surface",
                        "/surface/union/2/offset/distance"}, e
    for matrix, word in (([1] * 15, "must be 16 numbers"), ([0] * 15 + [1], "is singular"),
                         ([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 1, 1], "the last row must be")):
        e, _ = sample({"transform": {"surface": sphere(1), "matrix": matrix}})
        assert e["errors"][0]["pointer"] == "/surface/transform/matrix" and word in e["errors"][0]["detail"]
    e, _ = sample({"union": [sphere(1)]})
    assert "must be an array of 2 to 64 surfaces" in e["message"]
    deep = sphere(1)
    for _ in range(20):
        deep = {"offset": {"surface": deep, "distance": 0.1}}
    e, _ = sample(deep)
    assert e["code"] == "spec_invalid" and "nested levels" in e["message"]


def test_inputs_of_parts_stay_within_the_roots(worker, tmp_path, dense_ball):
    (tmp_path / "inside").mkdir()
    done = worker({"version": 1, "surface": {"union": [sphere(1), dense_ball]}, "sampling": {"count": 100}},
                  "--input-root", tmp_path / "inside")
    assert json.loads(done.stderr.splitlines()[-1])["code"] == "path_forbidden"


VOXEL, ROOM = 0.08, 2.2  # of solids that are handed over as data, and how far these reach from the middle


class Solid:
    """A solid: spec, f (negative inside), places spread over its surface by area, and by how much points may miss that."""
    def __init__(self, spec, f, places, miss=1e-6):
        self.spec, self.f, self.places, self.miss = spec, f, places, miss

    @classmethod
    def ball(cls, rng):
        c, r = rng.uniform(-1, 1, 3), rng.uniform(0.4, 1.2)
        way = rng.normal(size=(3000, 3))
        return cls(sphere(r, c), lambda x: numpy.linalg.norm(x - c, axis=-1) - r,
                   c + r * way / numpy.linalg.norm(way, axis=1)[:, None])

    @classmethod
    def box(cls, rng):
        c, h = rng.uniform(-1, 1, 3), rng.uniform(0.4, 1.2, 3)
        side = rng.choice(3, 3000, p=1 / h / (1 / h).sum())
        place = rng.uniform(-1, 1, (3000, 3))
        place[numpy.arange(3000), side] = rng.choice([-1, 1], 3000)
        return cls(box(h, c), lambda x: (numpy.abs(x - c) - h).max(axis=-1), c + h * place)

    @classmethod
    def data(cls, rng, path):
        """A ball as a volume, or all but a ball, up to the end of the data."""
        whole, sign = cls.ball(rng), rng.choice([1, -1], p=[0.5, 0.5])
        n = round(2 * ROOM / VOXEL) + 1
        matrix = numpy.diag([VOXEL, VOXEL, VOXEL, 1.0])
        matrix[:3, 3] = -ROOM
        at = numpy.stack(numpy.meshgrid(*[VOXEL * numpy.arange(n) - ROOM] * 3, indexing="ij"), -1)
        write_nrrd(path, (-sign * whole.f(at)).astype("f4"), matrix)
        return cls({"volume": {"path": str(path), "isovalue": 0}}, lambda x: sign * whole.f(x), whole.places, 0.01 * VOXEL)

    def turned(self, rng):
        turn, by = numpy.linalg.qr(rng.normal(size=(3, 3)))[0], rng.uniform(-0.5, 0.5, 3)
        matrix = numpy.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn, by
        return Solid(transform(self.spec, matrix), lambda x: self.f((x - by) @ turn), self.places @ turn.T + by, self.miss)


def random_solid(rng, path):
    kind = rng.integers(5)
    whole = Solid.data(rng, path) if kind < 2 else Solid.box(rng) if kind < 4 else Solid.ball(rng)
    return whole.turned(rng) if kind in (1, 3) else whole


RANDOM = 20261123
SOME = [RANDOM + k for k in (1, 2, 3)]


@pytest.mark.parametrize("seeds, least", [
    (SOME, 2), pytest.param([RANDOM + k for k in (0, 5, 6, 7, 9)], 3, marks=pytest.mark.extended)],
    ids=["some", "others"])
def test_random_combinations_are_where_geometry_says(sample, diagnose, tmp_path, seeds, least):
    """Points lie on the surface that the solids' own formulas give, and near all of its places, except where the
    surface folds back nearby. `least` of the seeds give a surface."""
    sampled = 0
    for seed in seeds:
        rng = numpy.random.default_rng(seed)
        parts = [random_solid(rng, tmp_path / f"{seed}.{k}.nrrd") for k in range(rng.integers(2, 4))]
        kind = ("union", "intersection", "difference")[rng.integers(3)]
        signs = [1] + [-1 if kind == "difference" else 1] * (len(parts) - 1)

        def f(x):
            values = [sign * part.f(x) for sign, part in zip(signs, parts)]
            return numpy.min(values, axis=0) if kind == "union" else numpy.max(values, axis=0)

        wanted = []
        for part in parts:
            step = 1e-5 * numpy.eye(3)
            out = numpy.stack([part.f(part.places + d) - part.f(part.places - d) for d in step], axis=-1)
            out /= numpy.linalg.norm(out, axis=1)[:, None]
            thick = numpy.abs(f(part.places)) < 1e-9
            for t in (0.05, 0.1, 0.2, 0.3):
                thick &= f(part.places - t * out) * f(part.places + t * out) < 0
            wanted.append(part.places[thick & (numpy.abs(part.places) < ROOM - 0.3).all(axis=1)])
        wanted = numpy.concatenate(wanted)
        report, points = sample({kind: [part.spec for part in parts]})
        if points is None:
            assert report["code"] == ("no_surface" if len(wanted) == 0 else "not_supported"), (seed, kind, report)
            continue
        sampled += 1
        miss = numpy.abs(f(points.position)).max()
        gap = cKDTree(points.position).query(wanted)[0].max() / report["spacing"] if len(wanted) else 0
        diagnose(f"seed {seed}, {kind} of {len(parts)}: {miss:.1e} off, farthest place {gap:.2f} spacings away")
        assert miss < max(part.miss for part in parts) and gap < 1.2
    assert sampled >= least
