# SPDX-License-Identifier: Apache-2.0
"""doc/report.md names every member of a report, every property of points.ply and every file of a result."""
import json
import re
import subprocess

import pytest

SPHERE = {"analytic": {"shape": "sphere", "center": [0, 0, 0], "radius": 1}}
NO_PREVIEW = {"preview": False}
OCTAHEDRON = "".join(f"v {x} {y} {z}\n" for x, y, z in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))) + \
    "".join(f"f {a} {b} {c}\n" for a, b, c in ((1, 3, 5), (3, 2, 5), (2, 4, 5), (4, 1, 5), (3, 1, 6), (2, 3, 6), (4, 2, 6),
                                             (1, 4, 6)))


def spec(surface, output=NO_PREVIEW, sampling=None, **parts):
    return {"version": 1, "surface": surface, "sampling": {"count": 100, **(sampling or {})}, "output": output, **parts}


def make_sequence(build, where, output=NO_PREVIEW):
    """A coherent sequence of which frame 1 is there."""
    subprocess.run([build / "hexad-worker", "make-example", where / "a.0001.vdb"], check=True, timeout=60)
    return spec({"vdb": {"path": "a.####.vdb"}}, output, queue={"frames": "1-2", "coherent": True})


@pytest.fixture
def page(source):
    return (source / "doc/report.md").read_text()


def members(value, path=()):
    """Paths of all members below a value; those of a list's elements count as the list's own. The spec is another page's."""
    if isinstance(value, list):
        for element in value:
            yield from members(element, path)
    elif isinstance(value, dict):
        for key, inner in value.items():
            if path + (key,) == ("spec",):
                continue
            yield path + (key,)
            yield from members(inner, path + (key,))


def unnamed(page, report):
    """Members whose name stands nowhere in the page: in backticks, alone or behind a point, or in a heading. Advice sets
    members of the spec."""
    return sorted({".".join(path) for path in members(report)
                   if not re.search(rf"`([a-z_]+\.)*{path[-1]}`|^#+ .*\b{path[-1]}\b", page, re.M)
                   and path[0] not in ("requested", "reached") and path[:2] != ("advice", "set")})


@pytest.mark.parametrize("names", [["graded", "mesh", "sequence"], pytest.param(["both"], marks=pytest.mark.extended)],
                         ids=["basic", "union"])
def test_every_member_is_explained(page, worker, tmp_path, build, names):
    (tmp_path / "ball.obj").write_text(OCTAHEDRON)
    graded = spec(SPHERE, {**NO_PREVIEW, "mesh": True}, {"curvature": {"chord_error": 0.01}}, solver={"method": "sized"})
    mesh = spec({"mesh": {"path": "ball.obj", "resolution": 16}})
    both = spec({"union": [mesh["surface"], {"analytic": {"shape": "sphere", "center": [1, 0, 0], "radius": 0.5}}]})
    sequence = make_sequence(build, tmp_path)
    words = {"graded": (), "mesh": (), "both": (), "sequence": ("--frame", 1)}
    documents = {"graded": graded, "mesh": mesh, "both": both, "sequence": sequence}
    for name in names:
        document = documents[name]
        run = worker(document, *words[name], output=name)
        assert run.returncode in (0, 10, 11), run.stderr
        report = json.loads((tmp_path / name / "report.json").read_text())
        assert len(list(members(report))) > 60
        assert not unnamed(page, report), name


def test_a_member_that_is_not_explained_is_found(page):
    assert unnamed(page, {"surface": {"area": 1, "colour_of_the_sky": 2}}) == ["surface.colour_of_the_sky"]


def test_every_property_and_file_is_explained(page, worker, tmp_path, build):
    everything = {"preview": {"turntable": 1, "size": 64}, "mesh": True, "mesh_usda": True, "points_vdb": True, "points_npz": True, "points_glb": True,
                  "points_usda": True, "convergence": True, "ply": {"properties": ["all"]}}
    run = worker(make_sequence(build, tmp_path, everything), "--frame", 1)
    assert run.returncode in (0, 10, 11), run.stderr
    header = (tmp_path / "out/points.ply").read_bytes().split(b"end_header")[0].decode()
    properties = re.findall(r"^property \w+ (\w+)$", header, re.M)
    assert len(properties) == 17
    named = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`]*)`", page))))
    assert set(properties) <= named, set(properties) - named
    files = {path.name for path in (tmp_path / "out").iterdir()}
    assert files and all(f"`{name}`" in page for name in files), files
