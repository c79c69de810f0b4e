# SPDX-License-Identifier: Apache-2.0
"""output.order: the rows of every output, compared with each other and with the points of a job without an order."""
import json

import numpy
import pytest
from scipy.spatial import ConvexHull, cKDTree

from readers import EVERY, read_columns, read_mesh
from scenes import read_glb, read_usda, stack
from service import sphere

ALL = {"points_npz": True, "points_glb": True, "points_usda": True, "points_vdb": True, "mesh": True, "mesh_usda": True}


@pytest.fixture
def run(worker, tmp_path):
    """Runs a job that must succeed; its directory and the columns of points.ply."""
    def call(spec, where="out", *words):
        done = worker(spec, *words, output=where)
        assert done.returncode in (0, 10, 11), done.stderr
        return tmp_path / where, read_columns((tmp_path / where / "points.ply").read_bytes())
    return call


def job(count=400, order=None, **output):
    asked = {"preview": False, "ply": {"precision": "double", **EVERY}, **output}
    return sphere(count, output=asked | ({"order": order} if order else {}))


def sorted_rows(columns):
    table = numpy.stack([columns[name] for name in sorted(columns)], 1)
    return table[numpy.lexsort(table.T)]


@pytest.mark.sanitized
@pytest.mark.parametrize("order", ["progressive", "spatial"])
def test_all_outputs_have_the_rows_in_one_order(run, order):
    where, columns = run(job(order=order, **ALL))
    at = stack(columns, *"xyz")
    _, plain = run(job(), "plain")
    assert (sorted_rows(columns) == sorted_rows(plain)).all()  # the same points with the same values
    assert (at != stack(plain, *"xyz")).any()
    with numpy.load(where / "points.npz") as arrays:
        assert (arrays["position"] == at).all() and (arrays["kappa1"] == columns["kappa1"]).all()
        assert (arrays["normal"] == stack(columns, "nx", "ny", "nz")).all()
        assert (arrays["id"] == numpy.arange(400)).all()
    of_gltf, _ = read_glb((where / "points.glb").read_bytes())
    assert (of_gltf["POSITION"] == at.astype("f4")).all()
    assert (of_gltf["_ENERGY"] == columns["energy"].astype("f4")).all()
    of_usd, _ = read_usda((where / "points.usda").read_text())
    assert (of_usd["point3f[] points"].astype("f4") == at.astype("f4")).all()
    assert (of_usd["float[] widths"].astype("f4") == columns["spacing_local"].astype("f4")).all()
    names, vertices, faces = read_mesh((where / "mesh.ply").read_bytes())
    assert names[:3] == list("xyz") and (vertices[:, :3] == at).all()
    assert {tuple(sorted(f)) for f in faces} == {tuple(sorted(f)) for f in ConvexHull(at).simplices}
    of_mesh, _ = read_usda((where / "mesh.usda").read_text())
    assert (of_mesh["int[] faceVertexIndices"].reshape(-1, 3) == faces).all()
    assert (of_mesh["point3f[] points"].astype("f4") == at.astype("f4")).all()
    # the worker has read points.vdb again, and compared the point of each id with that row
    assert json.loads((where / "report.json").read_text())["outputs"][1]["name"] == "points.vdb"


def test_each_prefix_is_spread(run):
    """Every point is the farthest from those before it, and the bounds of doc/formats.md hold."""
    _, columns = run(job(600, "progressive"))
    at, h = stack(columns, *"xyz"), columns["spacing"][0]
    far = numpy.full(len(at), numpy.inf)
    for n in range(1, len(at)):
        far = numpy.minimum(far, numpy.linalg.norm(at - at[n - 1], axis=1))
        assert far[n] >= far.max() * (0.98 - 1e-9)
        if 32 <= n <= len(at) / 2:
            apart, _ = cKDTree(at[:n]).query(at[:n], 2)
            assert far.max() <= 1.15 * h * (len(at) / n) ** 0.5 and apart[:, 1].min() >= 0.45 * h * (len(at) / n) ** 0.5


def test_points_on_walls_of_a_thin_plate_and_on_patches_are_ordered(run):
    """Each prefix has points on both walls; the values of patches go with the points."""
    half = numpy.array([1, 1, 0.1])
    plate = job(300, "progressive", points_npz=True)
    plate["surface"] = {"analytic": {"shape": "box", "center": [0, 0, 0], "half_size": half.tolist()}}
    plate["features"] = True
    where, columns = run(plate)
    for n in (32, 60, 100, 150):
        up = (columns["nz"][:n] > 0.9).sum() / (numpy.abs(columns["nz"][:n]) > 0.9).sum()
        assert 0.3 < up < 0.7, n
    on_corner = numpy.abs(stack(columns, *"xyz")) > half * (1 - 1e-9)
    assert (columns["feature"] >= on_corner.sum(1) - 1).all() and (columns["feature"] == 2).sum() == 8
    with numpy.load(where / "points.npz") as arrays:
        assert (arrays["patch"] == columns["patch"]).all()


def test_threads_do_not_change_the_order(run):
    digests = set()
    for threads in (1, 3):
        spec = job(3000, "progressive")
        spec["solver"] = {"threads": threads}
        where, _ = run(spec, str(threads))
        digests.add((where / "points.ply").read_bytes())
    assert len(digests) == 1


def test_spatial_order_keeps_neighbours_near_in_the_file(run):
    _, columns = run(job(1000, "spatial"))
    steps = numpy.linalg.norm(numpy.diff(stack(columns, *"xyz"), axis=0), axis=1)
    assert numpy.median(steps) < 1.6 * columns["spacing"][0]


def test_frames_of_a_coherent_sequence_are_ordered_by_id(run):
    """As well as progressively, where points.vdb tells the rows, since its ids are those of the sequence."""
    spec = job(300, "id", points_vdb=True)
    spec["queue"] = {"frames": "1-2", "by_frame": {"/surface/analytic/radius": [1.0, 1.3]}, "coherent": True}
    _, first = run(spec, "1", "--frame", 1)
    _, second = run(spec, "2", "--frame", 2, "--previous", "1")
    for columns in (first, second):
        assert (numpy.diff(columns["id"]) > 0).all()
    moved = stack(first, *"xyz") * 1.3 - stack(second, *"xyz")
    same = first["id"] == second["id"]
    assert same.mean() > 0.9 and numpy.linalg.norm(moved[same], axis=1).max() < 0.2
    spec["output"]["order"] = "progressive"
    where, third = run(spec, "3", "--frame", 2, "--previous", "1")
    assert b"row" in (where / "points.vdb").read_bytes() and set(third["id"]) == set(second["id"])
    assert (third["velocity_x"][numpy.argsort(third["id"])] == second["velocity_x"]).all()


def test_bad_orders_are_refused(worker):
    for order, words in (("random", 'must be one of "progressive", "spatial", "id" (given "random")'),
                         ("id", "requires queue.coherent")):
        done = worker(job(100, order))
        told = json.loads(done.stderr.splitlines()[-1])
        assert done.returncode == 2 and told["code"] == "spec_invalid"
        assert told["message"].startswith("/output/order: ") and words in told["message"]
