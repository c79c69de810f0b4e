# SPDX-License-Identifier: Apache-2.0
"""The measuring programs, on point sets and surfaces whose measures are known beforehand."""
import json
import math
import pathlib
import subprocess
import sys

import numpy
import pytest

PACKING = pathlib.Path(__file__).resolve().parents[2] / "measurements" / "packing"
sys.path[:0] = [str(PACKING), str(PACKING.parent / "common")]

import measure  # noqa: E402
import meshes  # noqa: E402
import quality  # noqa: E402
import results  # noqa: E402
import surfaces  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service


def point_set(position, normal, spacing=None, alpha=None):
    n = len(position)
    spacing = numpy.ones(n) if spacing is None else spacing
    return measure.PointSet(position, normal, spacing, numpy.ones(n) if alpha is None else alpha, {})


def lattice(rows, columns, jitter=0.0, seed=1):
    """A hexagonal packing of spacing 1 in the plane z = 0, cut by a box; and the box."""
    i, j = numpy.meshgrid(numpy.arange(columns), numpy.arange(rows))
    position = numpy.stack([i + 0.5 * (j % 2), j * math.sqrt(3) / 2, 0.0 * i], axis=-1).reshape(-1, 3).astype(float)
    position[:, :2] += jitter * numpy.random.default_rng(seed).standard_normal((len(position), 2))
    normal = numpy.tile([0.0, 0.0, 1.0], (len(position), 1))
    box = numpy.array([0, 0, -100.0]), numpy.array([columns - 0.5, (rows - 1) * math.sqrt(3) / 2, 100.0])
    return point_set(position, normal), box


def area_of(points):
    """That makes h = 1."""
    return points.count * math.sqrt(3) / 2


def test_a_perfect_packing():
    points, box = lattice(40, 40)
    found = measure.measure(points, area_of(points), window=box)
    assert found["hex_fraction"] == 1
    assert found["edge_cv"] < 1e-9 and found["area_cv"] < 1e-9 and abs(found["energy_excess"]) < 1e-9
    assert abs(found["min_spacing_ratio"] - 1) < 1e-12 and abs(found["h"] - 1) < 1e-12
    inner = found["inner"]
    assert points.count / 2 < inner.sum() < points.count
    assert numpy.abs(found["local"][inner] - 1).max() < 1e-9
    assert found["component"].max() == 0


def test_points_on_borders_are_measured():
    """A lattice that a rectangle cuts: two sides have rows, with four neighbours each and energies over 4 of them; the others are zigzags
    of which every second point is on the border."""
    points, box = lattice(40, 40)
    found = measure.measure(points, area_of(points), border=box)
    x, y = points.position[:, 0], points.position[:, 1]
    below = (y == 0) & (x > 0.75) & (x < 38)
    assert (found["degree"][below] == 4).all() and numpy.abs(found["local"][below] - 1).max() < 1e-6
    beside = (x < 0.75) | (x > 38.75)
    others = ~beside & ~((y < 0.1) | (y > 33.7))
    assert (found["degree"][others] == 6).all() and 0.9 < found["hex_fraction"] < 1 and found["inner"].all()
    assert found["edge_cv"] < 1e-9 and abs(found["min_spacing_ratio"] - 1) < 1e-9 and found["unmeasured_share"] == 0


def test_the_ideal_energy_is_that_of_the_design():
    assert abs(measure.E_IDEAL - 0.710825908) < 1e-9


def test_a_jittered_packing():
    """Each end of an edge moves by the jitter along it: the variation of lengths is sqrt(2) times it. The cells'
    areas follow to first order too: their variation is proportional to the jitter."""
    found = []
    for jitter in (0.01, 0.02):
        points, box = lattice(100, 100, jitter)
        found.append(measure.measure(points, area_of(points), window=box))
    assert abs(found[0]["edge_cv"] / (math.sqrt(2) * 0.01) - 1) < 0.03
    assert abs(found[1]["area_cv"] / found[0]["area_cv"] / 2 - 1) < 0.02
    assert found[0]["hex_fraction"] == 1 and found[0]["min_spacing_ratio"] < 0.97
    assert found[1]["energy_excess"] > found[0]["energy_excess"] > 0


def test_disorder_is_not_what_grading_costs():
    """A lattice under the exponential map has none, but for how it is shaken."""
    for jitter in (0, 0.1):
        points, _ = lattice(60, 60, jitter)
        turn = 1 / 9
        z = numpy.exp(turn * (points.position[:, 0] + 1j * points.position[:, 1]))
        graded = point_set(numpy.stack([z.real, z.imag, 0 * z.real], axis=1) / turn, points.normal, abs(z))
        middle = (numpy.abs(points.position[:, 0] - 30) < 22) & (numpy.abs(points.position[:, 1] - 26) < 19)
        reach = abs(graded.position).max()
        triangles = measure.triangulate(graded, (numpy.full(3, -reach), numpy.full(3, reach)))
        edges = measure.edges_of(triangles)
        cell, energy = measure.voronoi_areas(graded, triangles), measure._energies(graded, 1, True)[middle].mean()
        told = measure._disorder(graded, energy, middle, cell, measure.turns(graded, triangles), edges, True)
        assert energy / measure.E_IDEAL - 1 > 0.6 * turn ** 2
        assert told > 0.08 if jitter else abs(told) < 1e-3


def test_defects_that_curvature_demands_are_no_disorder():
    """The corners of an icosahedron: five neighbours each, in perfect order."""
    golden = (1 + math.sqrt(5)) / 2
    corner = numpy.array([c for a in (-1, 1) for b in (-golden, golden) for c in ((0, a, b), (a, b, 0), (b, 0, a))])
    corner /= numpy.linalg.norm(corner[0])
    area = 4 * math.pi
    found = measure.measure(point_set(corner, corner, numpy.full(12, measure.ideal_spacing(area, 12))), area)
    assert found["hex_fraction"] == 0 and abs(found["disorder"]) < 0.01


def test_the_energy_of_a_pair_by_hand():
    """A square lattice: the area is 1, sigma 1.86, so that the sum has four sides and four diagonals."""
    i, j = numpy.meshgrid(numpy.arange(20.0), numpy.arange(20.0))
    position = numpy.stack([i, j, 0 * i], axis=-1).reshape(-1, 3)
    normal = numpy.tile([0.0, 0.0, 1.0], (400, 1))
    found = measure.measure(point_set(position, normal), 400, window=((0, 0, -9), (19, 19, 9)))
    sigma = math.sqrt(3) * math.sqrt(2 / math.sqrt(3))

    def phi(r):
        w = r / sigma * math.pi / 2
        return 1 / math.tan(w) + w - math.pi / 2

    wanted = 4 * (phi(1) + phi(math.sqrt(2))) / measure.E_IDEAL - 1
    assert abs(found["energy_excess"] - wanted) < 1e-12
    assert abs(found["area_cv"]) < 1e-6


def test_a_vacancy_and_a_twin():
    points, box = lattice(40, 40)
    hole = numpy.flatnonzero((numpy.abs(points.position[:, 0] - 20) < 0.6) &
                             (numpy.abs(points.position[:, 1] - 17.3) < 0.5))[0]
    keep = numpy.arange(points.count) != hole
    missing = point_set(points.position[keep], points.normal[keep])
    found = measure.measure(missing, area_of(missing), window=box)
    assert (found["degree"][found["inner"]] != 6).sum() >= 3
    moved = points.position.copy()
    moved[hole] = moved[hole + 1] + [0.1, 0, 0]
    found = measure.measure(point_set(moved, points.normal), area_of(points), window=box)
    assert abs(found["min_spacing_ratio"] - 0.1) < 1e-9 and found["close_share"] == 2 / points.count and found["coincident"] == 0


def flat_torus(rows, columns):
    """A hexagonal packing rolled up to a thin ring: even along it and around it to the first order."""
    big = columns / (2 * math.pi)
    small = rows * math.sqrt(3) / 2 / (2 * math.pi)
    i, j = numpy.meshgrid(numpy.arange(columns), numpy.arange(rows))
    u = (2 * math.pi * (i + 0.5 * (j % 2)) / columns).ravel()
    v = (2 * math.pi * j / rows).ravel()
    normal = numpy.stack([numpy.cos(u) * numpy.cos(v), numpy.sin(u) * numpy.cos(v), numpy.sin(v)], axis=1)
    middle = big * numpy.stack([numpy.cos(u), numpy.sin(u), 0 * u], axis=1)
    return point_set(middle + small * normal, normal), 4 * math.pi ** 2 * big * small


def test_topology():
    points, area = flat_torus(40, 240)
    found = measure.measure(points, area)
    assert found["euler"] == 0 and found["unmeshed"] == 0
    assert abs(found["cell"].sum() / area - 1) < 5e-3
    two = point_set(numpy.concatenate([sphere_points(1500), sphere_points(700) + [3, 0, 0]]),
                    numpy.concatenate([sphere_points(1500), sphere_points(700)]), numpy.full(2200, 0.1))
    found = measure.measure(two, 8 * math.pi)
    assert found["euler"] == 4
    assert sorted(numpy.bincount(found["component"])) == [700, 1500]


def sphere_points(n):
    """A spiral of even density on the unit sphere."""
    k = numpy.arange(n) + 0.5
    z, turn = 1 - 2 * k / n, math.pi * (1 + math.sqrt(5)) * k
    flat = numpy.sqrt(1 - z * z)
    return numpy.stack([flat * numpy.cos(turn), flat * numpy.sin(turn), z], axis=1)


def test_edges_of_numbers_whose_squares_are_large():
    edges = measure.edges_of(numpy.array([[46345, 47000, 46350]], numpy.int32))
    assert edges.tolist() == [[46345, 46350], [46345, 47000], [46350, 47000]]


def test_opposite_walls_are_not_near_each_other():
    """A plate thicker than the spacing, and points of its two walls that are nearer than others of their own wall."""
    points, box = lattice(40, 40)
    below = points.position - [0.3, 0.2, 1.25]
    plate = point_set(numpy.concatenate([points.position, below]), numpy.concatenate([points.normal, -points.normal]))
    found = measure.measure(plate, area_of(plate), window=box)
    assert found["hex_fraction"] == 1 and abs(found["energy_excess"]) < 1e-9 and found["area_cv"] < 1e-6
    plate.position[points.count:, 2] = -0.1
    found = measure.measure(plate, area_of(plate), window=box)
    assert found["close_share"] == 0 and abs(found["min_spacing_ratio"] - 1) < 1e-9


def test_grading():
    """Spacings that grow along x: the local ones are what the points have, to the power that was made."""
    x, rows, step = 1.0, [], 0.03
    while x < 20:  # columns of a lattice whose spacing is step * x
        h = step * x
        rows.append((x, h))
        x += h * math.sqrt(3) / 2
    position, spacing = [], []
    for k, (x, h) in enumerate(rows):
        y = numpy.arange(-1, 1, h) + 0.5 * h * (k % 2)
        position.append(numpy.stack([numpy.full(len(y), x), y, 0 * y], axis=1))
        spacing.append(numpy.full(len(y), h))
    position, spacing = numpy.concatenate(position), numpy.concatenate(spacing)
    normal = numpy.tile([0.0, 0.0, 1.0], (len(position), 1))
    box = (0.9, -1, -99), (20, 1, 99)
    right = measure.measure(point_set(position, normal, spacing), 38, window=box)
    # its columns slip along each other: the cells differ by a few per cent
    assert right["grading_cv"] < 0.06 and abs(right["grading_exponent"] - 1) < 0.03
    root = measure.measure(point_set(position, normal, numpy.sqrt(step * spacing)), 38, window=box)
    assert abs(root["grading_exponent"] - 2) < 0.05 and root["grading_cv"] > 0.1


def test_a_request_that_is_not_followed():
    """An even packing where half of it was to be wider: the variation of 1 and 0.8, and no slope at all."""
    points, box = lattice(40, 40)
    points.spacing[points.position[:, 0] > 19.7] = 1.25
    found = measure.measure(points, area_of(points), window=box)
    ratio = 1 / points.spacing[found["inner"]]
    assert abs(found["grading_cv"] - ratio.std() / ratio.mean()) < 1e-9
    assert abs(found["grading_exponent"]) < 1e-9


# ---- surfaces

def test_areas():
    assert abs(surfaces.Quartic().area - 4.5639274) < 1e-6
    assert abs(surfaces.Box([1, 1, 1], 1.0).area - 4 * math.pi) < 1e-12
    assert abs(surfaces.Box([1, 2, 3]).area - 88) < 1e-12
    gyroid = surfaces.Gyroid(1.0)
    small = surfaces.Gyroid(0.5, size=(0.5, 0.5, 0.5))
    assert abs(gyroid.area / small.area - 4) < 1e-5  # the same shape
    assert abs(gyroid.area - 3.0916) < 1e-3           # of the minimal surface 3.0915
    torus = surfaces.Torus(0.3, 0.12)
    rays = surfaces.area_by_rays(torus, numpy.zeros(3), numpy.ones(3) / 24, [24] * 3)
    assert abs(rays / torus.area - 1) < 1e-5


@pytest.mark.parametrize("surface", [surfaces.Quartic(), surfaces.Gyroid(1.0)])
def test_gradients(surface):
    x = numpy.random.default_rng(3).random((50, 3))
    differences = surfaces.Surface.gradient(surface, x)
    assert numpy.abs(surface.gradient(x) - differences).max() < 1e-6 * numpy.abs(differences).max()


def test_curvatures():
    torus = surfaces.Torus(0.3, 0.12)
    x = torus.center + [[0.42, 0, 0], [0.18, 0, 0], [0, 0.3, 0.12]]
    for by in (torus.curvatures(x), surfaces.Surface.curvatures(torus, x)):
        assert numpy.abs(by[0] - [1 / 0.12] * 3).max() < 1e-4
        assert numpy.abs(by[1] - [1 / 0.42, -1 / 0.18, 0]).max() < 1e-4


def test_meshes():
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    cube = meshes.Mesh(corners * 2, [(a, b, c) for q in quads for a, b, c in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))])
    assert len(cube.vertices) == 8 and abs(cube.area - 6) < 1e-12 and set(cube.parts()) == {0}
    edges = cube.creases(0.7, 0.1)
    assert len(numpy.unique(numpy.round(edges, 6), axis=0)) > 100
    assert ((numpy.abs(edges - numpy.round(edges)) < 1e-12).sum(axis=1) >= 2).all()
    far, which = cube.nearest(numpy.array([[0.4, 0.3, 1.5], [2, 2, 2], [0.5, 0.6, 0.9]]))
    assert numpy.abs(far - [0.5, math.sqrt(3), 0.1]).max() < 1e-12
    assert abs(cube.normals[which[0]][2]) == 1


# ---- the page

def test_what_other_parts_hide():
    """Of two unit cubes that share a half the box that they make is seen, of area 8; of a third beside them all."""
    corners = numpy.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    cube = numpy.array([(a, b, c) for q in quads for a, b, c in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))])
    moved = [corners, corners + [0.5, 1e-3, 1e-3], corners + [5, 0, 0]]
    three = meshes.Mesh(numpy.concatenate(moved), numpy.concatenate([cube, cube + 8, cube + 16]))
    seen, component = three.seen()
    assert len(set(component)) == 2 and len(set(three.parts())) == 3
    first, second = (seen[component == k].sum() for k in (component[0], component[-1]))
    assert abs(first - 8) < 0.05 and abs(second - 6) < 1e-9
    assert (seen <= three.areas + 1e-12).all()


def test_graded_field():
    """Along a line a peak of small spacing spreads as steeply as it may."""
    wanted = numpy.array([1, 1, 0.1, 1, 1.0])
    edges = numpy.array([[0, 1], [1, 2], [2, 3], [3, 4]])
    field = quality.graded_field(wanted, 0.5, edges, numpy.ones(4))
    assert numpy.abs(field - [1, 0.6, 0.1, 0.6, 1]).max() < 1e-12


def test_verdicts():
    bounds = {"some": {"hex_fraction": [">=", 0.9], "lost": ["<=", 0], "exponent": ["within", 0.99, 1.01]}}
    row = {"hex_fraction": 0.95, "lost": 0, "exponent": 1.0, "told_count": 5, "count": 5,
           "close_share": 0, "coincident": 0, "verdict": ("converged", ()), "difference": {"edge_cv": 0.001, "area_cv": -0.009}}
    case = {"bounds": "some"}
    assert quality.judge(case, [row, row], bounds) == []
    assert not quality.differences([row])[1]
    assert quality.differences([{**row, "difference": {"edge_cv": -0.021}}])[1]
    assert len(quality.judge(case, [row, row, {**row, "lost": 1}], bounds)) == 1
    assert len(quality.judge(case, [{**row, "exponent": 1.02}], bounds)) == 1
    assert len(quality.judge(case, [{**row, "exponent": float("nan")}], bounds)) == 1
    assert len(quality.judge(case, [{**row, "told_count": 6}], bounds)) == 1
    assert len(quality.judge(case, [{**row, "verdict": ("not_converged", ("step_left",))}], bounds)) == 1
    assert len(quality.judge(case, [{**row, "close_share": 0.02}], bounds)) == 1
    told = {"close_share": 0.02, "verdict": ("unresolved", ("close_share",))}
    assert quality.judge(case, [{**row, **told}], bounds) == []


CASES = {
    "bounds": {"some": {"hex_fraction": [">=", 0.9], "max_residual": ["<=", 1e-3], "missing": ["<=", 0]},
               "strict": {"hex_fraction": [">=", 1.0]}},
    "cases": [
        {"name": "ball", "bounds": "some", "sampling": {"count": 1000}, "seeds": [1, 2],
         "surface": {"analytic": {"shape": "sphere", "radius": 0.4}}},
        {"name": "perfect ball", "bounds": "strict", "sampling": {"count": 1000}, "seeds": [1],
         "surface": {"analytic": {"shape": "sphere", "radius": 0.4}}},
        {"name": "not there", "bounds": "some", "sampling": {"count": 1000}, "seeds": [1],
         "surface": {"mesh": {"path": "meshes/no such mesh.obj", "resolution": 64}}}]}


def run_quality(build, tmp_path, *names):
    cases = tmp_path / "cases.json"
    cases.write_text(json.dumps(CASES))
    more = [word for name in names for word in ("--case", name)]
    done = subprocess.run([sys.executable, PACKING / "quality.py", "--worker", build / "hexad-worker", "--cases", cases,
                           "--output", tmp_path / "quality.csv", "--threads", "1", *more], capture_output=True, text=True)
    return done, results.read(tmp_path / "quality.csv")


def test_a_case_from_start_to_end(build, tmp_path):
    done, rows = run_quality(build, tmp_path, "ball", "not there")
    assert done.returncode == 0, done.stderr
    ball, missing = rows
    assert ball["outcome"] == "converged" and float(ball["hex_fraction"]) > 0.9 and ball["faults"] == ""
    assert missing["case"] == "not there" and "skipped: there is no meshes/no such mesh.obj" in missing["faults"]


def test_a_missed_bound_is_told(build, tmp_path):
    done, (row,) = run_quality(build, tmp_path, "perfect ball")
    assert done.returncode == 1
    assert "perfect ball: hex_fraction" in done.stderr and "bound >= 1.0" in row["faults"]


def test_the_table_of_cases(source):
    """Every case names bounds that exist and, where it is like another, one that stands before it."""
    table = json.loads((source / "measurements/packing/quality.json").read_text())
    before = set()
    for case in table["cases"]:
        assert case["bounds"] in table["bounds"] and case.get("like", case["name"]) in before | {case["name"]}
        assert case["name"] not in before
        before.add(case["name"])
