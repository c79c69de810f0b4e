# SPDX-License-Identifier: Apache-2.0
"""Positions of outputs far from the origin, read by readers that are not ours (measurements/outputs/precision.py), and meshes that lie there."""
import json
import pathlib
import re
import shutil
import sys

import numpy
import pytest

import damaged_meshes
from readers import read_columns
from service import sphere

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "measurements" / "outputs"))
import precision  # noqa: E402


@pytest.fixture(scope="module")
def measured(build, tmp_path_factory):
    """{offset: directory, report and positions} of one sphere."""
    return {offset: precision.run(build / "hexad-worker", tmp_path_factory.mktemp("far"), offset) for offset in precision.OFFSETS}


@pytest.mark.parametrize("name", precision.READERS)
def test_every_output_holds_its_points_at_any_distance(measured, name):
    """To 1e-3 spacings, translation and local value added in doubles; near the origin PLY, glTF and USD hold floats and no translation."""
    if name == "points.vdb" and not shutil.which("vdb_tool"):
        pytest.skip("there is no vdb_tool (Debian: libopenvdb-tools)")
    for offset, (where, report, positions) in measured.items():
        assert precision.error(name, where, report, positions) < (1e-3 if offset else 1e-6)
        assert precision.distance(positions, offset) < 1e-6 * report["spacing"]
    near, _, _ = measured[0]
    assert b"xformOp" not in (near / name).read_bytes() and b"translation" not in (near / name).read_bytes()
    if name.endswith(".ply"):
        assert b"property float x" in (near / name).read_bytes()


@pytest.mark.parametrize("name, offset, scale", [("sheet", (3.6e6, 0, 12), 1), ("box", (-2e5, 7e5, 1e4), 0.01), ("torus", (1e7, 1e7, -1e7), 1),
                                                 ("angle", (0, -1e9, 0), 100), ("sphere", (5e3, 0, 0), 1e-3)])
def test_every_output_holds_the_points_of_other_meshes(worker, tmp_path, name, offset, scale):
    vertices, faces = damaged_meshes.SURFACES[name]()
    triangles = numpy.array([t for f in faces for t in (damaged_meshes.ears(f, vertices) if len(f) > 3 else [f])])
    vertices = scale * vertices + offset
    precision.write_ply(tmp_path / "mesh.ply", vertices, triangles)
    coarse = {"resolution": 32} if name in ("torus", "sphere") else {}  # of the level set
    done = worker({"version": 1, "surface": {"mesh": {"path": str(tmp_path / "mesh.ply"), **coarse}}, "sampling": {"count": 60},
                   "solver": {"max_sweeps": 3}, "output": {"preview": False, **precision.OUTPUTS}})
    assert done.returncode in (0, 10, 11), done.stderr
    report = json.loads((tmp_path / "out/report.json").read_text())
    positions = precision.read_npz(tmp_path / "out/points.npz")
    assert damaged_meshes.distances(positions - offset, (vertices - offset)[triangles]).max() < 1e-3 * report["spacing"]
    for output in precision.READERS:
        if output != "points.vdb" or shutil.which("vdb_tool"):
            assert precision.error(output, tmp_path / "out", report, positions) < 1e-3, output


def test_floats_that_move_points_along_the_surface_are_doubles(worker, tmp_path):
    """A sheet in a plane z = 0: floats keep its points on the plane, and move them along it."""
    def run(x):
        (tmp_path / "sheet.obj").write_text(f"v {x} 0 0\nv {x + 1} 0 0\nv {x + 1} 1 0\nv {x} 1 0\nf 1 2 3 4\n")
        done = worker({"version": 1, "surface": {"mesh": {"path": str(tmp_path / "sheet.obj")}}, "sampling": {"spacing": 0.125},
                       "output": {"preview": False, "mesh": True}})
        assert done.returncode in (0, 10, 11), done.stderr
        report = json.loads((tmp_path / "out/report.json").read_text())
        told = [w for w in report["surface"]["warnings"] if "written in double" in w]
        data = [(tmp_path / "out" / name).read_bytes() for name in ("points.ply", "mesh.ply")]
        assert all((b"property double x" in d) == bool(told) for d in data)
        return bool(told), read_columns(data[0])["x"] - x
    (near, at), (far, there) = run(0), run(65536)
    assert (near, far) == (False, True)
    assert numpy.abs(numpy.sort(at) - numpy.sort(there)).max() < 1e-4 * 0.125


def test_a_sequence_far_from_the_origin_has_a_translation_for_each_frame(worker, tmp_path):
    spec = {"version": 1, "surface": {"transform": {"surface": sphere(1)["surface"], "matrix": [1, 0, 0, 1e7, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}},
            "sampling": {"count": 100}, "solver": {"max_sweeps": 20},
            "output": {"preview": False, "points_usda": True, "ply": {"precision": "double"}},
            "queue": {"frames": "3-4", "by_frame": {"/surface/transform/matrix/3": [1e7, -1e7]}}}
    for frame in (3, 4):
        done = worker(spec, "--frame", frame, output=str(frame))
        assert done.returncode in (0, 10, 11), done.stderr
        text = (tmp_path / f"{frame}/points.usda").read_text()
        (of, numbers), = re.findall(r"double3 xformOp:translate.timeSamples = \{\n +(\d): \((.*)\)", text)
        (values,) = re.findall(r"point3f\[\] points.timeSamples = \{\n +\d: \[(.*)\]", text)
        local = numpy.array(re.findall(r"[^(), ]+", values)).astype("f4").astype(float).reshape(-1, 3)
        columns = read_columns((tmp_path / f"{frame}/points.ply").read_bytes())
        positions = numpy.stack([columns[a] for a in "xyz"], 1)
        assert int(of) == frame and numpy.abs(local + [float(v) for v in numbers.split(",")] - positions).max() < 1e-6
    for text in (text, (tmp_path / "3/points_sequence.usda").read_text()):
        assert "    double3 xformOp:translate" in text and '    uniform token[] xformOpOrder = ["xformOp:translate"]\n' in text


ALL_FAR = [pytest.param(kind, at, marks=[] if (kind, at[0]) in (("closed", 1e9), ("open", 1e8), ("sharp", 1e8), ("cut", 1e8)) else pytest.mark.extended)
           for kind in ("closed", "open", "sharp", "fine", "cut") for at in ((1e8, -1e8, 1e8), (1e9, 0, 0))]


@pytest.mark.parametrize("kind, offset", ALL_FAR)
def test_a_mesh_far_from_the_origin_is_solved_as_near_to_it(worker, tmp_path, kind, offset):
    """A radius of 0.05 at 1e8, where doubles are 1.5e-8 apart; as level set and on its triangles."""
    vertices, faces = precision.icosphere(2 if kind == "sharp" else 3, 0.0625)
    if kind == "sharp":
        vertices = numpy.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]) * 0.0625
        faces = numpy.array([(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2),
                             (1, 3, 7), (1, 7, 5)])
    if kind == "open":
        faces = faces[vertices[faces][:, :, 2].max(1) > 0]
    vertices = numpy.round(vertices * 2 ** 20) / 2 ** 20  # in steps that doubles have there, too
    found = []
    for at in ((0, 0, 0), offset):
        precision.write_ply(tmp_path / "mesh.ply", vertices + at, faces)
        coarse = {"resolution": 40} if kind in ("closed", "cut") else {}  # of the level set
        region = {"region": {"min": [at[0], at[1] - 1, at[2] - 1], "max": [at[0] + 1, at[1] + 1, at[2] + 1]}} if kind == "cut" else {}
        done = worker({"version": 1, "surface": {"mesh": {"path": str(tmp_path / "mesh.ply"), **coarse}},
                       "sampling": {"count": 3000 if kind == "fine" else 500}, "output": {"preview": False, "ply": {"precision": "double"}}, **region})
        assert done.returncode == 0, done.stderr
        report = json.loads((tmp_path / "out/report.json").read_text())
        columns = read_columns((tmp_path / "out/points.ply").read_bytes())
        positions = numpy.stack([columns[a] for a in "xyz"], 1) - at
        box = report["surface"]["bounding_box"]
        low = vertices[faces].min((0, 1)) * ([0, 1, 1] if kind == "cut" else 1)
        assert numpy.allclose(box["min"], numpy.array(at) + low, rtol=0, atol=2e-3)
        found.append((report["outcome"], report["quality"], positions))
    (outcome, near, a), (same, far, b) = found
    assert kind != "cut" or b[:, 0].min() >= 0
    assert outcome == same == "converged" and abs(near["hex_fraction"] - far["hex_fraction"]) < 0.03
    assert far["coverage"] < near["coverage"] + 0.05 and far["max_residual"] < 1e-4 and far["min_spacing_ratio"] > near["min_spacing_ratio"] - 0.05
    assert numpy.abs(a.min(0) - b.min(0)).max() < 2e-3 and len(a) == len(b)


def test_a_region_that_misses_a_mesh_far_away_says_where_it_is(worker, tmp_path):
    vertices, faces = precision.icosphere(1, 0.0625)
    precision.write_ply(tmp_path / "mesh.ply", vertices + 1e8, faces)
    done = worker({"version": 1, "surface": {"mesh": {"path": str(tmp_path / "mesh.ply"), "resolution": 16}}, "sampling": {"count": 50},
                   "region": {"min": [1e8 - 0.01] * 3, "max": [1e8 + 0.01] * 3}})
    error = json.loads(done.stderr.splitlines()[-1])
    assert error["code"] == "no_surface" and ("relative to (100000000, 100000000, 100000000)" in error["message"]), error


def test_points_that_floats_about_an_origin_do_not_hold_are_warned_of(worker, tmp_path):
    """Two sheets, 1e5 apart."""
    corners = [(x + a, b, 0) for x in (0, 1e5) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    (tmp_path / "two.obj").write_text("".join("v %r %r %r\n" % c for c in corners) + "f 1 2 3 4\nf 5 6 7 8\n")
    spec = {"version": 1, "surface": {"mesh": {"path": str(tmp_path / "two.obj")}}, "sampling": {"spacing": 0.25},
            "solver": {"max_sweeps": 5}, "output": {"preview": False, "points_npz": True}}
    told = []
    for more in ({}, {"points_glb": True}, {"points_usda": True}):
        done = worker(spec | {"output": spec["output"] | more})
        assert done.returncode in (0, 10, 11), done.stderr
        warnings = json.loads((tmp_path / "out/report.json").read_text())["surface"]["warnings"]
        told.append([w for w in warnings if "points.glb and points.usda" in w])
    assert [len(t) for t in told] == [0, 1, 1] and "Use points.ply" in told[1][0]


def test_the_case_far_from_the_origin_is_held_by_every_output(worker, shared_data, tmp_path):
    done = worker({"version": 1, "surface": {"mesh": {"path": str(shared_data / "cases/far_origin.ply")}}, "sampling": {"count": 3000},
                   "solver": {"max_sweeps": 20}, "output": {"preview": False, **precision.OUTPUTS}})
    assert done.returncode in (0, 10, 11), done.stderr
    report = json.loads((tmp_path / "out/report.json").read_text())
    positions = precision.read_npz(tmp_path / "out/points.npz")
    for name in precision.READERS:
        if name != "points.vdb" or shutil.which("vdb_tool"):
            assert precision.error(name, tmp_path / "out", report, positions) < 1e-3
