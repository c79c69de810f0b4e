# SPDX-License-Identifier: Apache-2.0
"""The attribute `weight`: integrals over surfaces whose integrals are known, the report's `weights`, formats, refusals."""
import json
import re
import subprocess

import numpy
import pytest

from readers import read_columns
from service import PATIENCE_S, last_words

WEIGHT = [{"from": "geometry", "name": "weight"}]
TORUS = {"analytic": {"shape": "torus", "center": [0, 0, 0], "major_radius": 1, "minor_radius": 0.4}}
AREA = 4 * numpy.pi ** 2 * 0.4


def run(build, where, surface, count=600, threads=2, **members):
    """The report and the arrays of points.npz."""
    output = {"points_npz": True, "preview": False, **members.pop("output", {})}
    sampling = {"count": count, **members.pop("sampling", {})}
    spec = {"version": 1, "surface": surface, "sampling": sampling, "attributes": WEIGHT, "output": output, **members}
    done = subprocess.run([build / "hexad-worker", "run", "-", "--output", where, "--threads", str(threads)], input=json.dumps(spec),
                          text=True, capture_output=True, timeout=PATIENCE_S)
    assert done.returncode in (0, 10, 11), done.stderr
    return json.loads((where / "report.json").read_text()), dict(numpy.load(where / "points.npz"))


def cube(path, half=1.0):
    corners = [(x, y, z) for x in (-half, half) for y in (-half, half) for z in (-half, half)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    path.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) +
                    "".join("f {} {} {} {}\n".format(*(k + 1 for k in quad)) for quad in quads))


@pytest.mark.sanitized
def test_a_smooth_closed_formula_has_weights_of_high_order(build, source, tmp_path):
    report, points = run(build, tmp_path / "a", TORUS, 2000)
    told, x, w, n = report["weights"], points["position"], points["weight"], points["normal"]
    assert told["kind"] == "high_order" and told["reason"] is None and told["area_without_points"] == 0
    assert abs(w.sum() / AREA - 1) < 3e-5 and told["sum"] == pytest.approx(w.sum(), rel=1e-12)
    assert w.min() > 0 and told["least"] == w.min() and told["patches"] == [told["sum"]]
    assert abs((w * (x * n).sum(axis=1)).sum() / (6 * numpy.pi ** 2 * 0.16) - 1) < 3e-5
    explained = (source / "doc/report.md").read_text().split("### weights\n")[1].split("\n### ")[0]
    assert all(f"`{member}`" in explained for member in told)
    assert told["normal_integral"] < 1e-4 and 0 < abs(told["degree_difference"]) < 1e-3


def test_weights_whose_sum_is_worse_than_that_of_cells_are_replaced(build, tmp_path):
    """With 1000 points the sum of the weights of high order differs from the area by 1e-3."""
    report, points = run(build, tmp_path / "a", TORUS, 1000)
    told = report["weights"]
    assert (told["kind"], told["reason"], told["degree_difference"]) == ("cells", "area", None)
    assert any("their sum would differ from the area" in text for text in report["surface"]["warnings"])
    assert points["weight"].sum() == pytest.approx(AREA, rel=1e-5) and points["weight"].min() > 0


def test_unstable_weights_are_replaced(build, tmp_path):
    """Rows of points three times as dense on one side of a torus as on the other: weights of high order would reach -.27, 55 times
    the mean, and their magnitudes add up to more than 1.5 times their sum."""
    around, rows = 90, 36
    t = numpy.array([[(i + 0.5 * (j % 2)) / around, j / rows] for j in range(rows) for i in range(around)]) * 2 * numpy.pi
    u, v = t[:, 0] + 0.5 * numpy.sin(t[:, 0]), t[:, 1]
    r = 1 + 0.4 * numpy.cos(v)
    numpy.savez(tmp_path / "given.npz", position=numpy.stack([r * numpy.cos(u), r * numpy.sin(u), 0.4 * numpy.sin(v)], axis=1))
    report, points = run(build, tmp_path / "a", TORUS, around * rows + 20,
                         sampling={"points": {"path": str(tmp_path / "given.npz"), "mode": "keep"}})
    told = report["weights"]
    assert (told["kind"], told["reason"], told["degree_difference"]) == ("cells", "unstable", None)
    assert any("magnitudes of weights would exceed their sum by half" in text for text in report["surface"]["warnings"])
    assert points["weight"].sum() == pytest.approx(AREA, rel=1e-5) and points["weight"].min() > 0


def test_bytes_do_not_depend_on_threads_or_the_instruction_set(build, tmp_path):
    found = [run(build, tmp_path / str(k), TORUS, 300, threads, solver={"isa": isa})[1]["weight"].tobytes()
             for k, (threads, isa) in enumerate(((1, "portable"), (3, "auto")))]
    assert found[0] == found[1]


def test_transforms_move_and_scale_weights(build, tmp_path):
    matrix = [2, 0, 0, 5, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1]
    report, points = run(build, tmp_path / "a", {"transform": {"matrix": matrix, "surface": TORUS}}, 2000)
    assert report["weights"]["kind"] == "high_order"
    assert abs(points["weight"].sum() / (4 * AREA) - 1) < 3e-5


@pytest.mark.parametrize("reason, surface, members", [
    ("region", TORUS, {"region": {"min": [-2, -2, -2], "max": [2, 2, 2]}}),
    ("combination", {"union": [TORUS, {"analytic": {"shape": "sphere", "center": [1, 0, 0], "radius": 0.5}}]}, {}),
    ("crease", {"analytic": {"shape": "box", "center": [0, 0, 0], "half_size": [1, 1, 1]}}, {}),
    ("border", {"analytic": {"shape": "gyroid", "center": [0.5, 0.5, 0.5], "size": [1, 1, 1], "period": 1}}, {}),
])
def test_other_surfaces_have_the_areas_of_cells(build, tmp_path, reason, surface, members):
    report, points = run(build, tmp_path / "a", surface, **members)
    told = report["weights"]
    assert (told["kind"], told["reason"], told["degree_difference"]) == ("cells", reason, None)
    assert not [text for text in report["surface"]["warnings"] if "weights" in text]  # no number of points changes it
    assert points["weight"].sum() + told["area_without_points"] == pytest.approx(report["surface"]["area"], rel=1e-12)
    assert points["weight"].sum() == pytest.approx(report["surface"]["area"], rel=1e-5)


def test_few_points_have_the_areas_of_cells(build, tmp_path):
    report, points = run(build, tmp_path / "a", TORUS, 60)
    assert report["weights"]["kind"] == "cells" and report["weights"]["reason"] in ("few_nodes", "triangulation")
    (told,) = [text for text in report["surface"]["warnings"] if "weights" in text]
    assert told.startswith("the weights are areas of cells and not of high order: ") and "Increase the number of points" in told
    more, _ = run(build, tmp_path / "b", TORUS, 2000)  # the remedy
    assert more["weights"]["kind"] == "high_order" and not [text for text in more["surface"]["warnings"] if "weights" in text]
    assert points["weight"].sum() == pytest.approx(report["surface"]["area"], rel=1e-12)


def test_patches_of_a_cube_have_sums_and_its_integrals_are_right(build, tmp_path):
    cube(tmp_path / "cube.obj")
    report, points = run(build, tmp_path / "a", {"mesh": {"path": str(tmp_path / "cube.obj")}}, 2000, sampling={"curvature": {"ratio": 2}})
    told, x, w = report["weights"], points["position"], points["weight"]
    assert told["reason"] == "mesh" and len(told["patches"]) == 6
    assert sum(told["patches"]) == pytest.approx(24, rel=1e-12) and w.sum() == pytest.approx(24, rel=1e-12)
    assert numpy.allclose(told["patches"], [w[points["patch"] == k].sum() for k in range(6)])
    # of x^2: two faces at x = +-1, and four along x
    assert (w * x[:, 0] ** 2).sum() == pytest.approx(8 + 16 / 3, rel=4e-3)
    assert abs((w * x[:, 0]).sum()) < 0.02


def test_pieces_without_points_are_told(build, tmp_path):
    spheres = {"union": [{"analytic": {"shape": "sphere", "center": [0, 0, 0], "radius": 1}},
                         {"analytic": {"shape": "sphere", "center": [5, 0, 0], "radius": 0.02}}]}
    report, points = run(build, tmp_path / "a", spheres, 200)
    told, area = report["weights"], report["surface"]["area"]
    assert told["sum"] + told["area_without_points"] == pytest.approx(area, rel=1e-12)
    alone = (points["position"][:, 0] < 3).all()
    assert told["area_without_points"] == (pytest.approx(4 * numpy.pi * 0.02 ** 2, rel=1e-2) if alone else 0)


def test_every_format_has_the_weight(build, tmp_path):
    outputs = {"points_usda": True, "points_glb": True, "points_vtp": True, "points_vdb": True, "mesh": True}
    report, points = run(build, tmp_path / "a", TORUS, 300, output=outputs)
    assert (read_columns((tmp_path / "a" / "points.ply").read_bytes())["weight"] == points["weight"]).all()
    assert b"property double weight\n" in (tmp_path / "a" / "mesh.ply").read_bytes()
    usda = (tmp_path / "a" / "points.usda").read_text()
    assert "double[] primvars:weight" in usda
    grid = (tmp_path / "a" / "points.vdb").read_bytes()
    assert b"weight" in grid and grid.count(b"double") == 1  # the type of one attribute
    assert b"_WEIGHT" in (tmp_path / "a" / "points.glb").read_bytes()
    described = [a for a in report["attributes"] if a["name"] == "weight"]
    assert described[0]["minimum"] == points["weight"].min() and described[0]["type"] == "float"


def test_weights_follow_the_order_of_the_points(build, tmp_path):
    plain, ordered = (run(build, tmp_path / str(k), TORUS, 300, output=output)[1]
                      for k, output in enumerate(({}, {"order": "progressive"})))
    one, other = ({tuple(x): w for x, w in zip(p["position"], p["weight"])} for p in (plain, ordered))
    assert one == other


@pytest.mark.parametrize("sampling, told", [
    ({"count": 100, "points": {"path": "given.npz", "mode": "avoid", "distance": 0.1}}, "mode \"avoid\""),
    ({"attach": "points.ply"}, "sampling.attach"),
])
def test_weights_of_points_that_do_not_represent_the_surface_are_refused(build, tmp_path, sampling, told):
    spec = {"version": 1, "surface": {"mesh": {"path": "a.obj"}}, "sampling": sampling, "attributes": WEIGHT}
    done = subprocess.run([build / "hexad-worker", "run", "-", "--output", tmp_path / "a"], input=json.dumps(spec), text=True,
                          capture_output=True, timeout=PATIENCE_S)
    assert done.returncode == 2 and told in str(last_words(done)) and '"weight"' in str(last_words(done))


def test_a_result_with_weights_is_attached_without_making_them_again(build, tmp_path):
    cube(tmp_path / "cube.obj")
    cube(tmp_path / "larger.obj", 2.0)
    spec = {"version": 1, "surface": {"mesh": {"path": str(tmp_path / "cube.obj")}}, "sampling": {"count": 100},
            "attributes": WEIGHT + [{"from": "geometry", "name": "source"}], "output": {"preview": False, "points_npz": True}}
    for words in (["run", "-", "--output", tmp_path / "a"],
                  ["attach", tmp_path / "a", tmp_path / "larger.obj", "--output", tmp_path / "b"]):
        done = subprocess.run([build / "hexad-worker", *words], input=json.dumps(spec), text=True, capture_output=True, timeout=PATIENCE_S)
        assert done.returncode in (0, 10, 11), done.stderr
    first, second = (numpy.load(tmp_path / name / "points.npz") for name in "ab")
    assert (first["weight"] == second["weight"]).all() and abs(second["position"]).max() > 1.9
    assert "weights" not in json.loads((tmp_path / "b" / "report.json").read_text())


def test_a_job_with_weights_is_estimated(build, tmp_path):
    spec = {"version": 1, "surface": TORUS, "sampling": {"count": 1000}, "attributes": WEIGHT, "output": {"preview": False}}
    done = subprocess.run([build / "hexad-worker", "estimate", "-", "--output", tmp_path / "a"], input=json.dumps(spec), text=True,
                          capture_output=True, timeout=PATIENCE_S, check=True)
    found = json.loads(done.stdout)
    assert 0 < found["weights_seconds"] < found["seconds"]
    report, _ = run(build, tmp_path / "b", TORUS, count=1000)
    assert report["timing_s"]["weights"] > 0


def test_the_guide_integrates_and_solves(build, source, tmp_path):
    """The blocks of Python of doc/guide.md print small errors."""
    section = (source / "doc/guide.md").read_text().split("## Integrate over a surface\n")[1].split("\n## ")[0]
    spec = re.search(r"^cat > nodes.json <<'END'\n(.*?)^END$", section, re.M | re.S)[1]
    subprocess.run([build / "hexad-worker", "run", "-", "--output", tmp_path / "nodes"], input=spec, text=True, check=True,
                   timeout=PATIENCE_S, capture_output=True)
    names = {}
    for block in re.findall(r"^```python\n(.*?)^```$", section, re.M | re.S):
        exec(block.replace("nodes/points.npz", str(tmp_path / "nodes" / "points.npz")), names)
    assert abs(names["area"] / AREA - 1) < 3e-5 and abs(names["volume"] / (2 * numpy.pi ** 2 * 0.16) - 1) < 3e-5
    x = names["inside"]
    assert abs(names["u"] - x[:, 0] ** 2 + x[:, 1] ** 2).max() < 1e-4
