# SPDX-License-Identifier: Apache-2.0
"""Models of planes and arcs: a row of points along every edge, and no two points that nearly coincide."""
import collections
import json

import numpy
import pytest
from scipy.spatial import cKDTree

from cad_models import MODELS, SHEETS, crossed_sheet
from readers import Points


def sharp_edges(solid):
    """Ends of the edges at which two faces meet at more than 1 radian, or more than two faces meet."""
    places = numpy.array(solid.vertices)
    faces_at, normals = collections.defaultdict(list), []
    for n, face in enumerate(solid.faces):
        at = places[face]
        across = sum(numpy.cross(at[k] - at[0], at[k + 1] - at[0]) for k in range(1, len(at) - 1))
        normals.append(across / numpy.linalg.norm(across))
        for a, b in zip(face, face[1:] + face[:1]):
            faces_at[min(a, b), max(a, b)].append(n)
    ends = [edge for edge, at in faces_at.items() if len(at) > 2 or normals[at[0]] @ normals[at[1]] < numpy.cos(1)]
    return places[numpy.array(ends)]


def solve(worker, tmp_path, solid, count):
    solid.write(tmp_path / "model.obj")
    done = worker({"version": 1, "surface": {"mesh": {"path": str(tmp_path / "model.obj")}}, "sampling": {"count": count},
                   "output": {"preview": False}})
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads((tmp_path / "out" / "report.json").read_text()), Points((tmp_path / "out" / "points.ply").read_bytes())


@pytest.mark.parametrize("count", [600, pytest.param(3000, marks=pytest.mark.extended), pytest.param(10000, marks=pytest.mark.extended)])
@pytest.mark.parametrize("name", MODELS)
def test_no_points_nearly_coincide(worker, tmp_path, name, count):
    report, _ = solve(worker, tmp_path, MODELS[name](), count)
    quality = report["quality"]
    # a hole whose rim has two points leaves room between them for points of both faces
    most = 0.005 if name == "plate_with_holes" and count < 1000 else 0
    assert quality["coincident"] == 0 and quality["close_share"] <= most
    assert quality["missing_share"] < 0.01 and quality["coverage"] < 1.1


@pytest.mark.parametrize("name", SHEETS)
def test_no_points_of_a_rim_that_folds_back_nearly_coincide(worker, tmp_path, name):
    """At 500 points the two arms of a notch are 0.2 spacings apart, and the corners of a hook are 0.18."""
    report, _ = solve(worker, tmp_path, SHEETS[name](), 500)
    quality = report["quality"]
    assert quality["close_share"] == 0 and quality["min_spacing_ratio"] > 0.25
    assert quality["missing_share"] < 0.01 and quality["coverage"] < 1.1


def test_points_of_faces_that_pass_through_each_other_are_apart(worker, tmp_path):
    """No edge lies where two faces of one piece cross, and their points do not repel each other."""
    report, _ = solve(worker, tmp_path, crossed_sheet(), 2000)
    quality = report["quality"]
    assert quality["close_share"] == 0 and quality["min_spacing_ratio"] > 0.25 and quality["coverage"] < 1


@pytest.mark.parametrize("name", ["gear", "bracket", "plate_with_holes", "engraved_text"])
def test_every_edge_has_a_row(worker, tmp_path, name):
    """Along each edge, and nowhere else, there are points on curves, no farther apart than spacings."""
    solid = MODELS[name]()
    report, points = solve(worker, tmp_path, solid, 3000)
    edges, spacing = sharp_edges(solid), report["spacing"]
    steps = numpy.linspace(0, 1, 40)[:, None]
    places = numpy.concatenate([(1 - steps) * a + steps * b for a, b in edges])
    on_curve = points.feature > 0
    far, _ = cKDTree(points.position[on_curve]).query(places)
    assert far.max() < 0.8 * spacing
    dense = numpy.concatenate([(1 - s) * a + s * b for a, b in edges for s in [numpy.linspace(0, 1, 400)[:, None]]])
    off, _ = cKDTree(dense).query(points.position[on_curve])
    assert off.max() < 0.1 * spacing
