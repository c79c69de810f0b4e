# SPDX-License-Identifier: Apache-2.0
"""The place of each point on the mesh of its surface, and its evaluation on other frames of the mesh, held against an evaluation with
numpy from the numbers in the files."""
import json
import re
import shlex
import subprocess

import numpy
import pytest
from scipy.spatial import KDTree

import bars
from readers import read_columns
from scenes import read_glb, read_usda
from service import PATIENCE_S, Service

SOURCE = [{"from": "geometry", "name": "source"}]


def places_of(columns, name="source"):
    """{mesh, face, corner, bary} of all points."""
    return {"mesh": columns[f"{name}_mesh"], "face": columns[f"{name}_face"],
            **{key: numpy.stack([columns[f"{name}_{key}_{axis}"] for axis in "xyz"], axis=1) for key in ("corner", "bary")}}


def chosen(places, which):
    return {key: values[which] for key, values in places.items()}


def positions(columns):
    return numpy.stack([columns[axis] for axis in "xyz"], axis=1)


def normals(columns):
    return numpy.stack([columns["n" + axis] for axis in "xyz"], axis=1)


@pytest.fixture
def sample(worker, tmp_path):
    """Samples a surface with places; the columns of points.ply and the report."""
    def call(surface, count=700, output=None, where="out", **more):
        done = worker({"version": 1, "surface": surface, "sampling": {"count": count}, "attributes": SOURCE,
                       "solver": {"threads": 1}, "output": {"preview": False, **(output or {})}, **more}, output=where)
        assert done.returncode in (0, 10, 11), done.stderr
        return (read_columns((tmp_path / where / "points.ply").read_bytes()),
                json.loads((tmp_path / where / "report.json").read_text()))
    return call


@pytest.mark.sanitized
@pytest.mark.parametrize("ending", sorted(bars.WRITERS))
def test_places_give_the_positions_and_the_side_of_the_normals(sample, tmp_path, ending):
    """The file alone gives the position of each point, to a millionth of the spacing. The ends of the bar are polygons of ten corners."""
    vertices, faces = bars.bar()
    bars.write(tmp_path / f"bar.{ending}", vertices, faces)
    columns, report = sample({"mesh": {"path": f"bar.{ending}"}}, output={"ply": {"precision": "double"}})
    places = places_of(columns)
    assert (places["mesh"] == 0).all() and len(set(places["face"])) > 100
    assert {0, len(faces) - 1} <= set(places["face"]) and places["corner"].max() > 3
    at, across = bars.evaluate(places, vertices, faces)
    assert numpy.linalg.norm(at - positions(columns), axis=1).max() < 1e-6 * report["spacing"]
    assert numpy.abs(places["bary"].sum(axis=1) - 1).max() < 1e-14 and places["bary"].min() >= -1e-14
    assert ((across * normals(columns)).sum(axis=1) > 0.6).all()  # on edges they are means
    assert (places["corner"].min(axis=1) == places["corner"][:, 0]).all()


def test_weights_are_doubles_in_a_file_of_floats(sample, tmp_path):
    vertices, faces = bars.bar()
    bars.write(tmp_path / "bar.ply", vertices, faces)
    columns, report = sample({"mesh": {"path": "bar.ply"}})
    header = (tmp_path / "out" / "points.ply").read_bytes().partition(b"end_header")[0].decode()
    assert "property float x\n" in header and "property double source_bary_x\n" in header
    assert "property int source_corner_x\n" in header and "property int source_face\n" in header
    text, _ = sample({"mesh": {"path": "bar.ply"}}, output={"ply": {"format": "ascii"}}, where="text")
    for name in columns:
        assert (columns[name] == text[name].astype("f4") if "bary" not in name else columns[name] == text[name]).all(), name


def test_places_are_in_all_formats(sample, tmp_path):
    vertices, faces = bars.bar()
    bars.write(tmp_path / "bar.ply", vertices, faces)
    columns, _ = sample({"mesh": {"path": "bar.ply"}},
                        output={"points_npz": True, "points_glb": True, "points_usda": True, "points_vdb": True})
    places = places_of(columns)
    arrays = numpy.load(tmp_path / "out" / "points.npz")
    usd, _ = read_usda((tmp_path / "out" / "points.usda").read_text())
    gltf, _ = read_glb((tmp_path / "out" / "points.glb").read_bytes())
    types = {"mesh": "int[]", "face": "int[]", "corner": "int3[]", "bary": "double3[]"}
    for key, values in places.items():
        name = f"source_{key}"
        assert arrays[name].dtype == ("f8" if key == "bary" else "i8") and (arrays[name] == values).all()
        assert (usd[f"{types[key]} primvars:{name}"] == values).all()
        assert (gltf[f"_{name.upper()}"] == values.astype("f4")).all()
    assert b"source_bary" in (tmp_path / "out" / "points.vdb").read_bytes()


@pytest.mark.sanitized
def test_points_of_other_parts_have_no_place(sample, tmp_path):
    """A union of two meshes, one of them moved, and a ball, from which a region cuts a piece."""
    vertices, faces = bars.bar()
    bars.write(tmp_path / "bar.obj", vertices, faces)
    bars.write(tmp_path / "bent.ply", bars.bent(vertices, 1.5), faces)
    matrix = numpy.diag([0.5, 0.5, 0.5, 1])
    matrix[:3, 3] = 0, 4, 0
    parts = [{"mesh": {"path": "bar.obj"}}, {"analytic": {"shape": "sphere", "radius": 1, "center": [0, -4, 0]}},
             {"transform": {"matrix": matrix.ravel().tolist(), "surface": {"mesh": {"path": "bent.ply"}}}}]
    columns, report = sample({"union": parts}, count=2500,
                             attributes=[*SOURCE, {"from": "geometry", "name": "part"}],
                             region={"min": [-2.5, -9, -9], "max": [9, 9, 9]})
    places, part, x = places_of(columns), columns["part"], positions(columns)
    spacing = report["spacing"]
    on_cap = x[:, 0] < -2.5 + 0.2 * spacing
    assert on_cap.any() and set(places["mesh"]) == {-1, 0, 1}
    assert (places["mesh"][~on_cap] == numpy.choose(part.astype(int), [0, -1, 1])[~on_cap]).all()
    none = chosen(places, places["mesh"] < 0)
    assert (none["face"] == -1).all() and (none["corner"] == -1).all() and (none["bary"] == -1).all()
    moved = bars.bent(vertices, 1.5) * 0.5 + matrix[:3, 3]
    for mesh, corners in ((0, vertices), (1, moved)):
        which = places["mesh"] == mesh
        at, _ = bars.evaluate(chosen(places, which), corners, faces)
        assert numpy.linalg.norm(at - x[which], axis=1).max() < 0.05 * spacing
    (told,) = [a for a in report["attributes"] if a["name"] == "source_mesh"]
    assert told["outside"] == (places["mesh"] < 0).sum() and told["distance"] < 0.05
    assert [mesh["path"] for mesh in told["meshes"]] == ["bar.obj", "bent.ply"]
    assert all((mesh["vertices"], mesh["faces"]) == (len(vertices), len(faces)) for mesh in told["meshes"])
    assert any("lie on no mesh" in warning for warning in report["surface"]["warnings"])


def test_faces_without_area_have_numbers(sample, tmp_path):
    """A face of two corners, and one whose vertices are the same: the numbers of all others are those of the file."""
    vertices, faces = bars.bar()
    faces = [faces[0], [3, 4], [5, 5, 5], *faces[1:]]
    bars.write(tmp_path / "bar.obj", vertices, faces)
    columns, report = sample({"mesh": {"path": "bar.obj"}}, output={"ply": {"precision": "double"}})
    at, _ = bars.evaluate(places_of(columns), vertices, faces)
    assert numpy.linalg.norm(at - positions(columns), axis=1).max() < 1e-6 * report["spacing"]


def test_a_surface_without_a_mesh_has_no_places(worker):
    done = worker({"version": 1, "surface": {"analytic": {"shape": "sphere", "radius": 1}}, "sampling": {"count": 100},
                   "attributes": SOURCE})
    told = json.loads(done.stderr.splitlines()[-1])
    assert (done.returncode, told["code"]) == (3, "attribute_missing") and told["message"].startswith("/attributes/0:")


def test_a_reserved_name_of_a_place_is_refused(worker, tmp_path):
    bars.write(tmp_path / "bar.obj", *bars.bar())
    done = worker({"version": 1, "surface": {"mesh": {"path": "bar.obj"}}, "sampling": {"count": 100},
                   "attributes": [*SOURCE, {"from": "geometry", "name": "source", "as": "root"},
                                  {"from": "geometry", "name": "direction1", "as": "root_face"}]})
    told = json.loads(done.stderr.splitlines()[-1])
    assert told["code"] == "spec_invalid" and "root_face" in told["message"] and "/attributes/2" in told["message"]


# ---- another frame

@pytest.fixture
def attach(build, tmp_path):
    """Places the points of a result on a mesh; the columns and the report, or the error and None."""
    def call(*meshes, result="out", where="moved", code=0, options=()):
        done = subprocess.run([build / "hexad-worker", "attach", result, *meshes, "--output", where, *options], cwd=tmp_path,
                              text=True, capture_output=True, timeout=PATIENCE_S)
        assert done.returncode == code, done.stderr
        if code:
            return json.loads(done.stderr.splitlines()[-1]), None
        return (read_columns((tmp_path / where / "points.ply").read_bytes()),
                json.loads((tmp_path / where / "report.json").read_text()))
    return call


def nearest(points):
    """Distance of each point from its nearest one."""
    distance, _ = KDTree(points).query(points, k=2)
    return distance[:, 1]


@pytest.mark.sanitized
@pytest.mark.parametrize("ending", ["obj", "ply"])
def test_attached_points_lie_where_numpy_evaluates_them(sample, attach, tmp_path, ending):
    """A bar that is bent further from frame to frame. Spacings change by no more than the deformation stretches the triangles."""
    rest, faces = bars.bar()
    bars.write(tmp_path / f"bar.{ending}", rest, faces)
    before, report = sample({"mesh": {"path": f"bar.{ending}"}}, count=1500, output={"ply": {"precision": "double"}})
    places = places_of(before)
    for angle in (0, 0.8, 2.4):
        vertices = bars.bent(rest, angle)
        bars.write(tmp_path / f"bent.{ending}", vertices, faces)
        after, told = attach(f"bent.{ending}")
        at, _ = bars.evaluate(places, vertices, faces)
        assert numpy.linalg.norm(positions(after) - at, axis=1).max() < 1e-9 * report["spacing"]
        assert numpy.linalg.norm(normals(after) - bars.smooth_normals(places, vertices, faces), axis=1).max() < 1e-5
        assert all((after[name] == before[name]).all() for name in before if name not in "x y z nx ny nz".split())
        low, high = bars.stretches(places, rest, vertices, faces)
        ratio = nearest(positions(after)) / nearest(positions(before))
        assert 0.97 * low.min() < ratio.min() and ratio.max() < 1.03 * high.max()
        assert (told["outcome"], told["count"], told["attached"]["without_place"]) == ("converged", len(before["x"]), 0)
        assert {item["path"] for item in told["inputs"]} == {f"bent.{ending}", "out/points.ply"}
    assert ratio.max() > 1.05  # the last frame stretches


def test_normals_of_the_first_frame_are_kept_on_a_smooth_mesh(sample, attach, tmp_path):
    """On a sphere, whose faces some programs orient inwards. The sampler makes normals another way."""
    u, v = numpy.meshgrid(numpy.linspace(0, numpy.pi, 33), numpy.arange(64) * 2 * numpy.pi / 64, indexing="ij")
    vertices = numpy.stack([numpy.sin(u) * numpy.cos(v), numpy.sin(u) * numpy.sin(v), numpy.cos(u)], -1).reshape(-1, 3)
    faces = [[k * 64 + a, k * 64 + (a + 1) % 64, (k + 1) * 64 + (a + 1) % 64, (k + 1) * 64 + a] for k in range(32) for a in range(64)]
    bars.write(tmp_path / "ball.obj", vertices, faces)
    before, _ = sample({"mesh": {"path": "ball.obj"}}, output={"ply": {"precision": "double"}})
    assert ((normals(before) * positions(before)).sum(axis=1) > 0.99).all()
    after, _ = attach("ball.obj")
    assert (positions(after) != 0).any() and numpy.linalg.norm(positions(after) - positions(before), axis=1).max() < 1e-9
    assert ((normals(after) * normals(before)).sum(axis=1) > 0.999).all()


def test_a_mesh_of_another_topology_is_refused_with_the_difference(sample, attach, tmp_path):
    vertices, faces = bars.bar()
    bars.write(tmp_path / "bar.obj", vertices, faces)
    sample({"mesh": {"path": "bar.obj"}})
    quad = faces[5]
    others = {"vertices": (numpy.r_[vertices, [[9, 9, 9]]], faces, f"has {len(vertices) + 1} vertices"),
              "faces": (vertices, [*faces[:5], quad[:3], [quad[0], *quad[2:]], *faces[6:]], f"has {len(faces) + 1} faces"),
              "corners": (vertices, [*faces[:5], quad[:3], *faces[6:]], "corners of faces"),
              "order": (vertices, [*faces[1:], faces[0]], "other vertices")}
    for name, (moved, cut, words) in others.items():
        bars.write(tmp_path / f"{name}.obj", moved, cut)
        told, _ = attach(f"{name}.obj", code=3)
        assert told["code"] == "input_unsupported" and words in told["message"] and f"{name}.obj" in told["message"], told
        assert not (tmp_path / "moved" / "report.json").exists()


def test_attributes_of_the_mesh_are_read_again(sample, attach, tmp_path):
    """A frame with other values, and one without: then those of the result are kept, and a warning says so."""
    rest, faces = bars.bar()
    bars.write_ply(tmp_path / "bar.ply", rest, faces, heat=rest[:, 0])
    before, _ = sample({"mesh": {"path": "bar.ply"}}, attributes=[*SOURCE, {"name": "heat"}],
                       output={"ply": {"precision": "double"}})
    vertices = bars.bent(rest, 1.2)
    bars.write_ply(tmp_path / "hot.ply", vertices, faces, heat=5 + 2 * rest[:, 0])
    after, told = attach("hot.ply")
    assert numpy.abs(after["heat"] - (5 + 2 * before["heat"])).max() < 0.05 and not told["surface"]["warnings"]
    assert list(after) == list(before)
    bars.write_ply(tmp_path / "plain.ply", vertices, faces)
    after, told = attach("plain.ply")
    assert (after["heat"] == before["heat"]).all()
    assert any('"heat" keeps the values' in warning for warning in told["surface"]["warnings"])


def test_all_meshes_of_a_surface_are_replaced(sample, attach, tmp_path):
    """Two meshes, one of them moved by a transform, and a ball, whose points stay."""
    rest, faces = bars.bar()
    bars.write(tmp_path / "one.obj", rest, faces)
    bars.write(tmp_path / "two.ply", bars.bent(rest, 1), faces)
    matrix = numpy.diag([0.5, 0.5, 0.5, 1])
    matrix[:3, 3] = 0, 4, 0
    before, _ = sample({"union": [{"mesh": {"path": "one.obj"}}, {"analytic": {"shape": "sphere", "radius": 1, "center": [0, -4, 0]}},
                                  {"transform": {"matrix": matrix.ravel().tolist(), "surface": {"mesh": {"path": "two.ply"}}}}]},
                       count=1500, output={"points_npz": True, "points_vdb": True, "orient": True})
    places = places_of(before)
    frames = [bars.bent(rest, 2), bars.bent(rest, -1)]
    bars.write(tmp_path / "first.obj", frames[0], faces)
    bars.write(tmp_path / "second.ply", frames[1], faces)
    after, told = attach("first.obj", "second.ply")
    arrays = numpy.load(tmp_path / "moved" / "points.npz")
    for mesh, vertices in ((0, frames[0]), (1, frames[1] * 0.5 + matrix[:3, 3])):
        which = places["mesh"] == mesh
        at, _ = bars.evaluate(chosen(places, which), vertices, faces)
        assert numpy.linalg.norm(arrays["position"][which] - at, axis=1).max() < 1e-9
    still = places["mesh"] < 0
    assert still.any() and (positions(after)[still] == positions(before)[still]).all()
    assert told["attached"]["without_place"] == still.sum()
    assert not numpy.allclose(after["orient_x"][~still], before["orient_x"][~still])
    told, _ = attach("first.obj", code=2)
    assert "has 2 meshes (given 1)" in told["message"]


def test_an_attached_result_can_be_attached_again(sample, attach, tmp_path):
    rest, faces = bars.bar()
    bars.write(tmp_path / "bar.obj", rest, faces)
    sample({"mesh": {"path": "bar.obj"}})
    bars.write(tmp_path / "bent.obj", bars.bent(rest, 2), faces)
    first, _ = attach("bent.obj")
    attach("bar.obj", where="back")
    again, _ = attach("bent.obj", result="back", where="again")
    assert all((first[name] == again[name]).all() for name in first)


def test_points_without_places_are_refused(worker, sample, attach, tmp_path):
    rest, faces = bars.bar()
    bars.write(tmp_path / "bar.obj", rest, faces)
    sample({"mesh": {"path": "bar.obj"}}, attributes=[])
    told, _ = attach("bar.obj", code=3)
    assert told["code"] == "attribute_missing"
    assert """sample it again with --set '/attributes=[{"from":"geometry","name":"source"}]'""" in told["message"]
    done = worker({"version": 1, "surface": {"mesh": {"path": "bar.obj"}}, "sampling": {"attach": "out/points.ply"},
                   "output": {"preview": False}}, output="moved")
    told = json.loads(done.stderr.splitlines()[-1])
    assert (done.returncode, told["code"]) == (3, "attribute_missing") and "no attribute source" in told["message"]
    sample({"mesh": {"path": "bar.obj"}}, output={"ply": {"properties": ["minimal", "attributes"]}})
    told, _ = attach("bar.obj", code=3)
    assert told["code"] == "attribute_missing" and "spacing_local" in told["message"]


@pytest.mark.parametrize("sampling", [{}, {"curvature": {"ratio": 3}}])
def test_an_attached_result_has_the_properties_of_its_points(sample, attach, tmp_path, sampling):
    """Those of the default, with a spacing if it is graded, of a list, and all; the mean spacing is that of the report."""
    bars.write(tmp_path / "bar.obj", *bars.bar())
    for where, properties in (("out", None), ("list", ["kappa", "default"]), ("every", ["all"])):
        ply = {"precision": "double", **({"properties": properties} if properties else {})}
        before, report = sample({"mesh": {"path": "bar.obj"}}, output={"ply": ply}, sampling={"count": 700, **sampling}, where=where)
        after, told = attach("bar.obj", result=where)
        assert list(after) == list(before)
        assert ("spacing" in before) == bool(sampling or properties == ["all"]) and ("kappa" in before) == bool(properties)
        assert told["spacing"] == pytest.approx(report["spacing"], rel=0.05 if sampling else 0.005)


@pytest.mark.parametrize("color, shown", [("curvature", False), ("alpha", False), ("degree", False), ("spacing", True)])
def test_a_preview_of_what_attached_points_lack_is_shaded(sample, attach, tmp_path, color, shown):
    bars.write(tmp_path / "bar.obj", *bars.bar())
    sample({"mesh": {"path": "bar.obj"}}, output={"preview": {"size": 64, "color": color}, "points_glb": True})
    _, told = attach("bar.obj")
    assert any("the preview is shaded" in warning for warning in told["surface"]["warnings"]) != shown
    assert (tmp_path / "moved" / "preview.png").exists()


@pytest.mark.sanitized
def test_places_that_the_mesh_does_not_have_are_refused(sample, attach, tmp_path):
    """A file of points that was changed: faces, corners, weights and meshes that do not exist, and names that no format has."""
    rest, faces = bars.bar()
    bars.write(tmp_path / "bar.obj", rest, faces)
    sample({"mesh": {"path": "bar.obj"}}, count=50, output={"ply": {"format": "ascii", "properties": ["all"]}})
    path = tmp_path / "out" / "points.ply"
    head, mark, body = path.read_text().partition("end_header\n")
    names = [line.split()[-1] for line in head.splitlines() if line.startswith("property")]
    for name, value in (("source_face", 9999), ("source_corner_y", 77), ("source_bary_x", 5.5), ("source_mesh", 3), ("spacing", 0),
                        ("nx", 50), ("x", 1e35)):
        rows = [line.split() for line in body.splitlines()]
        rows[7][names.index(name)] = str(value)
        path.write_text(head + mark + "".join(" ".join(row) + "\n" for row in rows))
        told, _ = attach("bar.obj", code=3)
        assert told["code"] == "input_damaged" and "point 7" in told["message"], (name, told)
    path.write_text(head.replace("property int patch", "property int ../patch") + mark + body)
    told, _ = attach("bar.obj", code=3)
    assert told["code"] == "input_unsupported" and "../patch" in told["message"]


def test_attaching_excludes_what_concerns_the_computation_of_points(worker):
    done = worker({"version": 1, "surface": {"analytic": {"shape": "sphere", "radius": 1}}, "output": {"mesh": True},
                   "sampling": {"attach": "out/points.ply", "curvature": {"ratio": 2}}})
    told = json.loads(done.stderr.splitlines()[-1])
    assert done.returncode == 2 and {fault["pointer"] for fault in told["errors"]} == {
        "/sampling/attach", "/sampling/curvature", "/output/mesh"}


# ---- the service

@pytest.fixture(scope="module")
def animated(build, tmp_path_factory):
    """A daemon, and the finished job `job` of a bar, whose frames 1 to 4 are bent more and more."""
    where = tmp_path_factory.mktemp("frames")
    rest, faces = bars.bar()
    for frame in range(1, 5):
        bars.write(where / f"bar.{frame:04d}.obj", bars.bent(rest, 0.5 * (frame - 1)), faces)
    made = Service(build, tmp_path_factory.mktemp("service"), "--input_roots", where).start()
    try:
        made.where = where
        made.job_id = made.submit({"version": 1, "name": "bar", "surface": {"mesh": {"path": str(where / "bar.0001.obj")}}, "attributes": SOURCE,
                                   "sampling": {"count": 500}, "output": {"preview": False, "ply": {"precision": "double"}}})
        made.wait_state(made.job_id, "succeeded")
        yield made
    finally:
        made.clean_up()


@pytest.fixture
def hexadctl(animated, build, tmp_path):
    def call(*words):
        return subprocess.run([build / "hexadctl", *map(str, words)], capture_output=True, text=True, timeout=PATIENCE_S,
                              env=animated.environment(), cwd=tmp_path)
    return call


@pytest.mark.sanitized
def test_hexadctl_attaches_the_points_of_a_job_to_all_frames(animated, hexadctl, tmp_path):
    """One array of as many tasks as frames; also of a frame of that array, again."""
    done = hexadctl("attach", animated.job_id, animated.where / "bar.####.obj", "--frames", "2-4", "--wait", "--label", "bent")
    assert done.returncode == 0, done.stderr
    job = json.loads(hexadctl("list", "--label", "bent", "--json").stdout)["jobs"][0]["id"]
    assert hexadctl("fetch", "bar", "--output", "named").returncode == 0  # the names differ, so that each names one job
    assert animated.job(job)["name"] == "bar attached"
    assert hexadctl("fetch", job, "--output", "bent").returncode == 0
    assert hexadctl("fetch", animated.job_id, "--output", "rest").returncode == 0
    before = read_columns((tmp_path / "rest" / "points.ply").read_bytes())
    rest, faces = bars.bar()
    for frame in range(2, 5):
        after = read_columns((tmp_path / "bent" / str(frame) / "points.ply").read_bytes())
        at, _ = bars.evaluate(places_of(before), bars.bent(rest, 0.5 * (frame - 1)), faces)
        assert numpy.linalg.norm(positions(after) - at, axis=1).max() < 1e-9
    done = hexadctl("attach", job, animated.where / "bar.0001.obj", "--frame", 4, "--wait", "--label", "back", "--name", "straight")
    assert done.returncode == 0, done.stderr
    back = json.loads(hexadctl("list", "--name", "straight", "--json").stdout)["jobs"][0]["id"]
    assert hexadctl("fetch", back, "--output", "back").returncode == 0
    after = read_columns((tmp_path / "back" / "points.ply").read_bytes())
    assert numpy.linalg.norm(positions(after) - positions(before), axis=1).max() < 1e-9


def test_hexadctl_says_why_points_cannot_be_attached(animated, hexadctl, tmp_path):
    mesh = animated.where / "bar.0002.obj"
    done = hexadctl("attach", animated.job_id)
    assert done.returncode == 2 and "ID and PATH are required" in done.stderr
    done = hexadctl("attach", animated.job_id, mesh, mesh)
    assert done.returncode == 2 and "has 1 meshes (given 2)" in done.stderr
    done = hexadctl("attach", animated.job_id, mesh, "--frame", 1)
    assert done.returncode == 2 and "has no frames" in done.stderr
    done = hexadctl("attach", animated.job_id, animated.where / "none.obj", "--wait")
    assert done.returncode != 0 and "none.obj" in done.stderr + done.stdout
    without = animated.submit({"version": 1, "surface": {"mesh": {"path": str(mesh)}}, "sampling": {"count": 100},
                               "output": {"preview": False}})
    animated.wait_state(without, "succeeded")
    done = hexadctl("attach", without, mesh, "--label", "without")
    assert done.returncode == 2 and "its points have no attribute source: sample it again with --set" in done.stderr
    assignment = shlex.split(re.search(r"--set ('[^']*')", done.stderr)[1])[0]
    done = hexadctl("sample", mesh, "--count", 100, "--set", assignment, "--output", tmp_path / "with")
    assert done.returncode == 0 and "source_face" in read_columns((tmp_path / "with/points.ply").read_bytes()), done.stderr
    assert json.loads(hexadctl("list", "--label", "without", "--json").stdout)["jobs"] == []


def test_a_mesh_of_another_topology_fails_its_job(animated, hexadctl):
    rest, faces = bars.bar()
    bars.write(animated.where / "other.obj", rest, faces[1:])
    done = hexadctl("attach", animated.job_id, animated.where / "other.obj", "--wait")
    assert done.returncode == 1 and f"{len(faces) - 1} faces" in done.stdout + done.stderr
