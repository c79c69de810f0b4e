# SPDX-License-Identifier: Apache-2.0
"""The files of a result have what was written, read from the disk by readers that share no code with the writers: every format,
with attributes of all kinds, also for a million points. Points of OpenVDB files: tests/unit/test_vdb_points; pictures:
tests/unit/test_preview and test_outputs.py. What becomes of files that differ: tests/unit/test_file.
"""
import hashlib
import json
import pathlib
import subprocess
import tempfile

import numpy
import pytest

from carried_points import linear_light
from readers import read_mesh
from scenes import read_glb, read_usda

MILLION = pytest.param(1000000, marks=pytest.mark.extended)
OWN = {"position": ("x", "y", "z"), "normal": ("nx", "ny", "nz")}


@pytest.fixture
def written(finished, carried):
    """Runs a job with all formats: its directory, the columns of points.ply, and the arrays of points.npz."""
    def call(count, **output):
        carried["sampling"] = {"count": count}
        carried["solver"] = {"max_sweeps": 2}
        carried["output"].update(orient={}, **output)
        where, columns, report = finished(carried)
        for told in report["outputs"]:
            data = (where / told["name"]).read_bytes()
            assert (told["bytes"], told["sha256"]) == (len(data), hashlib.sha256(data).hexdigest()), told["name"]
        with numpy.load(where / "points.npz") as arrays:
            return where, columns, {name: arrays[name] for name in arrays}
    return call


def columns_of(name, columns):
    """The names of the columns of a PLY file that an array of NumPy has."""
    if name in columns:
        return (name,)
    return OWN.get(name) or tuple(c for c in columns if c.rpartition("_")[0] == name and len(c.rpartition("_")[2]) == 1)


@pytest.mark.parametrize("count", [2000, MILLION])
def test_formats_have_the_same_points(written, count):
    where, columns, arrays = written(count)
    assert {"position", "normal", "orient", "heat", "wind", "Cd", "label", "energy"} <= set(arrays)
    count = len(columns["x"])
    compared = set()
    for name, array in arrays.items():
        assert len(array) == count and numpy.isfinite(array).all()
        of_ply = columns_of(name, columns)
        for k, column in enumerate(of_ply):
            assert (columns[column] == (array if array.ndim == 1 else array[:, k])).all(), column
        compared.update(of_ply)
    assert compared == set(columns) - {"red", "green", "blue"}
    for k, name in enumerate(("red", "green", "blue")):
        assert (columns[name] == numpy.rint(255 * numpy.clip(arrays["rgb"][:, k], 0, 1))).all()
    gltf, _ = read_glb((where / "points.glb").read_bytes())
    usd, _ = read_usda((where / "points.usda").read_text())
    of_usd = {declared.split()[1].removeprefix("primvars:"): values for declared, values in usd.items()}
    fixed = {"position": ("POSITION", "points"), "normal": ("NORMAL", "normals"), "id": ("_ID", "ids")}
    for name, array in arrays.items():
        if name in ("rgb", "Cd"):
            continue
        in_gltf, in_usd = fixed.get(name, ("_" + name.upper(), "widths" if name == "radius" else name))
        scale = 2 if name == "radius" else 1
        assert (gltf[in_gltf] == array.astype("f4")).all(), name
        order = [3, 0, 1, 2] if name == "orient" else slice(None)  # quaternions of USD begin with the real part
        one = array[:, order] if array.ndim > 1 else array
        assert (of_usd[in_usd].astype("f4") == (scale * one).astype("f4")).all(), name
    light = linear_light(numpy.clip(arrays["rgb"], 0, 1))
    assert numpy.abs(gltf["COLOR_0"] - light).max() < 1e-6 and numpy.abs(of_usd["displayColor"] - light).max() < 1e-6


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("count", [2000, MILLION])
def test_text_has_the_same_numbers(written, count, precision):
    where, columns, arrays = written(count, ply={"precision": precision, "format": "ascii"})
    for name, array in arrays.items():
        for k, column in enumerate(columns_of(name, columns)):
            one = array if array.ndim == 1 else array[:, k]
            assert (columns[column] == one).all() if precision == "double" else (
                columns[column].astype("f4") == one.astype("f4")).all(), column


def test_a_mesh_has_the_points(written):
    where, columns, arrays = written(2000, mesh=True, mesh_usda=True)
    _, vertices, faces = read_mesh((where / "mesh.ply").read_bytes())
    usd, _ = read_usda((where / "mesh.usda").read_text())
    assert (vertices[:, :3] == arrays["position"]).all() and len(faces) > 2000
    assert (usd["int[] faceVertexIndices"].reshape(-1, 3) == faces).all()
    assert (usd["point3f[] points"].astype("f4") == arrays["position"].astype("f4")).all()


def test_results_in_memory_are_written_too(build, tmp_path):
    """A file system in memory keeps its pages: the bytes in memory are compared."""
    if not pathlib.Path("/dev/shm").is_dir():
        pytest.skip("no file system in memory")
    spec = {"version": 1, "surface": {"analytic": {"shape": "sphere", "radius": 1}}, "sampling": {"count": 100},
            "output": {"points_npz": True}}
    with tempfile.TemporaryDirectory(dir="/dev/shm") as where:
        done = subprocess.run([build / "hexad-worker", "run", "-", "--output", where + "/out"], input=json.dumps(spec), text=True,
                              capture_output=True)
        assert done.returncode in (0, 10, 11), done.stderr
        report = json.loads(pathlib.Path(where, "out/report.json").read_text())
        for told in report["outputs"]:
            data = pathlib.Path(where, "out", told["name"]).read_bytes()
            assert told["sha256"] == hashlib.sha256(data).hexdigest()
