# SPDX-License-Identifier: Apache-2.0
"""A look into files: the worker alone, and the service with its rules of access."""
import gzip
import json
import os
import pathlib
import pty
import re
import subprocess

import numpy
import pytest

from readers import read_png
from service import PATIENCE_S
from volumes import Part, write_exr, write_nifti, write_nrrd

CUBE = """v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1
f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\n"""


@pytest.fixture
def inspect(build, tmp_path):
    def call(path, *words, code=0):
        done = subprocess.run([build / "hexad-worker", "inspect", path, "--json", *map(str, words)], cwd=tmp_path,
                              capture_output=True, text=True, timeout=PATIENCE_S)
        assert done.returncode == code, done.stderr
        return json.loads(done.stdout if code == 0 else done.stderr.splitlines()[-1])
    return call


def run_suggestion(worker, tmp_path, suggestion):
    """The report of the spec as it is."""
    done = worker(suggestion["spec"])
    assert done.returncode == 0, done.stderr
    return json.loads((tmp_path / "out" / "report.json").read_text())


def ball(side=24):
    """Values that fall from 100 in the middle of a ball to 0 outside, in whole numbers; half way at a radius of 8."""
    x = numpy.arange(side) - (side - 1) / 2
    radius = numpy.sqrt(sum(g * g for g in numpy.meshgrid(x, x, x)))
    return numpy.clip(numpy.rint(100 * (8.5 - radius) + 0), 0, 100).astype(numpy.int16)


def test_an_inspection_is_shown_on_a_terminal(build, tmp_path):
    """The line is removed before the answer. Without a terminal there is none."""
    (tmp_path / "cube.obj").write_text(CUBE)
    words = [build / "hexad-worker", "inspect", "cube.obj"]
    master, slave = pty.openpty()
    done = subprocess.run(words, cwd=tmp_path, stdout=subprocess.PIPE, stderr=slave, timeout=PATIENCE_S)
    os.close(slave)
    shown = os.read(master, 4096)
    os.close(master)
    assert done.returncode == 0 and shown == b"inspecting cube.obj: all of it is read\r\x1b[K", shown
    assert subprocess.run(words, cwd=tmp_path, capture_output=True, timeout=PATIENCE_S).stderr == b""


def test_a_level_set(inspect, example, worker, tmp_path):
    found = inspect(example)
    (grid,), (suggestion,) = found["grids"], found["suggestions"]
    assert found["format"] == "OpenVDB" and found["bytes"] == example.stat().st_size
    assert grid["class"] == "level set" and grid["type"] == "float" and grid["scalar"]
    assert grid["range"][0] < 0 < grid["range"][1] and len(grid["histogram"]) == 32
    assert abs(sum(grid["histogram"]) - 1) < 1e-9 and grid["active_voxels"] > 100000
    assert suggestion["measured"] and abs(suggestion["slope"] - 1) < 0.05  # distances in world units
    report = run_suggestion(worker, tmp_path, suggestion)
    assert report["count"] == suggestion["spec"]["sampling"]["count"] == suggestion["count"]
    assert report["surface"]["area"] == suggestion["area"] and report["advice"] == []


@pytest.fixture(scope="module")
def small_level_set(tmp_path_factory):
    openvdb = pytest.importorskip("pyopenvdb", reason="there is no pyopenvdb to write level sets with")
    path = tmp_path_factory.mktemp("small") / "sphere.vdb"
    openvdb.write(str(path), grids=[openvdb.createLevelSetSphere(radius=1, voxelSize=0.1)])
    return path


def test_a_file_of_a_newer_library(inspect, small_level_set, tmp_path, worker):
    """What the library has to say of it does not stand in the answer."""
    bytes_of_it = bytearray(small_level_set.read_bytes())
    bytes_of_it[8] += 1  # the version, behind the magic number
    (tmp_path / "newer.vdb").write_bytes(bytes_of_it)
    found = inspect("newer.vdb")
    assert found["suggestions"][0]["measured"]
    done = worker(found["suggestions"][0]["spec"])
    assert done.returncode == 0 and "\x1b" not in done.stdout + done.stderr
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert any("newer" in text for text in report["surface"]["warnings"])


def test_a_mesh_and_one_that_is_open(inspect, tmp_path, worker):
    (tmp_path / "cube.obj").write_text(CUBE + "f 4 1 5 8\n")
    found = inspect("cube.obj")
    assert found["mesh"]["closed"] and found["mesh"]["components"] == 1 and found["mesh"]["triangles"] == 12
    assert found["mesh"]["area"] == 24 and found["mesh"]["bounding_box"] == {"min": [-1, -1, -1], "max": [1, 1, 1]}
    first = found["suggestions"][0]
    assert first["measured"] and abs(first["area"] / 24 - 1) < 1e-3
    assert run_suggestion(worker, tmp_path, first)["outcome"] == "converged"
    (tmp_path / "open.obj").write_text(CUBE)
    found = inspect("open.obj")
    assert not found["mesh"]["closed"] and found["mesh"]["open_edges"] == 4
    assert found["mesh"]["open_at"]["bounding_box"] == {"min": [-1, -1, -1], "max": [-1, 1, 1]}
    first = found["suggestions"][0]
    assert first["measured"] and abs(first["area"] / 20 - 1) < 1e-6
    assert run_suggestion(worker, tmp_path, first)["surface"]["mesh"]["patches"] == 5


@pytest.mark.sanitized
def test_walls_thinner_than_the_smallest_measured_distance_are_named(inspect, tmp_path):
    for thickness, named in ((1, False), (1e-5, True)):
        plate = re.sub(r"(?m)^(v \S+ \S+) 1$", rf"\1 {thickness - 1}", CUBE)
        (tmp_path / "plate.obj").write_text(plate + "f 4 1 5 8\n")
        (found,) = inspect("plate.obj")["suggestions"]
        assert any("more points" in w for w in found["warnings"]) == named, found["warnings"]


def test_a_dense_volume_of_whole_numbers(inspect, tmp_path, worker):
    write_nrrd(tmp_path / "ball.nrrd", ball())
    found = inspect("ball.nrrd")
    volume, first = found["volume"], found["suggestions"][0]
    assert volume["type"] == "int16" and volume["size"] == [24, 24, 24] and volume["range"] == [0, 100]
    assert volume["integral"] and volume["voxel_size"] == [1, 1, 1]
    isovalues = [s["spec"]["surface"]["volume"]["isovalue"] for s in found["suggestions"]]
    assert all(v % 1 == 0.5 for v in isovalues) and len(set(isovalues)) == len(isovalues)  # off the plateaus
    assert abs(first["area"] / (4 * numpy.pi * 64) - 1) < 0.1
    assert run_suggestion(worker, tmp_path, first)["count"] == first["count"]


@pytest.mark.sanitized
def test_a_packed_volume_of_nearly_one_value(inspect, tmp_path, worker):
    values = numpy.zeros((40, 40, 40), numpy.float32)
    values[18:22, 18:22, 18:22] = 1  # a thousandth of all
    write_nifti(tmp_path / "dot.nii", values)
    (tmp_path / "dot.nii.gz").write_bytes(gzip.compress((tmp_path / "dot.nii").read_bytes()))
    found = inspect("dot.nii.gz")
    assert found["format"] == "NIfTI" and found["volume"]["type"] == "float"
    first = found["suggestions"][0]
    assert first["spec"]["surface"]["volume"]["isovalue"] == 0.5
    assert run_suggestion(worker, tmp_path, first)["count"] == first["count"]


def test_what_is_looked_at_is_limited_by_its_size(inspect, tmp_path):
    """Surfaces of very many cells are not scanned, on however fast a machine."""
    noise = numpy.random.default_rng(1).random((90, 90, 90), numpy.float32)
    write_nrrd(tmp_path / "noise.nrrd", noise)
    found = inspect("noise.nrrd")["suggestions"]
    assert len(found) > 1 and not any(s["measured"] for s in found) and all("spec" in s for s in found)
    assert found[0]["cells"] > 400000 and found[0]["area"] > 0


@pytest.mark.sanitized
def test_images_and_their_stack(inspect, tmp_path, worker):
    for k, values in enumerate(ball().astype(numpy.float32)):
        write_exr(tmp_path / f"slice.{k:03}.exr", Part({"density": values, "heat": 0 * values}))
    found = inspect("slice.007.exr")
    assert [c["channel"] for c in found["channels"]] == ["density", "heat"] and found["images"] == 24
    assert found["channels"][0]["type"] == "float" and found["channels"][0]["data_window"] == [0, 0, 23, 23]
    first = found["suggestions"][0]
    assert first["spec"]["surface"]["exr"]["slices"] == "0-23"
    assert {s["spec"]["surface"]["exr"]["channel"] for s in found["suggestions"]} == {"density"}  # heat is 0 everywhere
    assert run_suggestion(worker, tmp_path, first)["count"] == first["count"]
    write_exr(tmp_path / "alone.exr", Part({"Y": numpy.zeros((4, 4), numpy.float32)}))
    found = inspect("alone.exr")
    assert found["images"] == 1 and found["suggestions"] == []


def test_damage_is_named(inspect, tmp_path, example):
    (tmp_path / "cut.vdb").write_bytes(example.read_bytes()[:5000])
    found = inspect("cut.vdb", code=3)
    assert found["code"] == "input_damaged" and "cut.vdb" in found["message"]
    (tmp_path / "text.obj").write_text("nothing\n")
    assert inspect("text.obj", code=3)["code"] == "input_damaged"
    assert inspect("none.obj", code=3)["code"] == "input_missing"


@pytest.mark.sanitized
def test_a_page_for_people_and_a_picture(build, tmp_path, small_level_set):
    done = subprocess.run([build / "hexad-worker", "inspect", small_level_set, "--preview", "seen.png"], cwd=tmp_path,
                          capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    assert "level set" in done.stdout and "surfaces to try:\n1. area" in done.stdout and "histogram  |" in done.stdout
    assert read_png((tmp_path / "seen.png").read_bytes())[:2] == (512, 512)
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith("seen")] == ["seen.png"]


def ask(service, path, **more):
    return service.request("POST", "/v1/inputs:inspect", json.dumps({"path": path}).encode(),
                           {"Content-Type": "application/json"}, **more)


def test_the_service_looks_into_what_jobs_may_read(new_service, build, tmp_path):
    root = tmp_path / "inputs"
    root.mkdir()
    (root / "cube.obj").write_text(CUBE + "f 4 1 5 8\n")
    (root / "open.obj").write_bytes(b"\x00damaged")
    (tmp_path / "outside.obj").write_text(CUBE)
    service = new_service("--input_roots", root).start()
    reply = ask(service, "cube.obj")
    assert reply.status == 200, reply.body
    found = json.loads(reply.body)
    assert found["mesh"]["closed"] and "surfaces to try" in found["text"]
    spec = found["suggestions"][0]["spec"]
    assert service.post("/v1/jobs", spec).status == 201
    for path, status, code in (("../outside.obj", 403, "path_forbidden"), (str(tmp_path / "outside.obj"), 403,
                               "path_forbidden"), ("none.obj", 422, "input_missing"),
                               ("open.obj", 422, "input_damaged"), ("sha256:" + "0" * 64, 422, "input_missing")):
        reply = ask(service, path)
        assert json.loads(reply.body)["code"] == code, (path, reply.status, reply.body)
    done = subprocess.run([build / "hexadctl", "inspect", "cube.obj"], capture_output=True, text=True,
                          timeout=PATIENCE_S, env=service.environment())
    assert done.returncode == 0 and done.stdout == found["text"], done.stderr
    assert not list((service.state / "estimates").iterdir())


def test_some_of_the_collection(build, shared_data):
    """measurements/inputs/inspections.py goes through all of it."""
    table = pathlib.Path(__file__).resolve().parents[2] / "measurements/inputs/inspections.py"
    for word in ("meshes/bob.obj", "vdb/nebula", "volumes/fmob", "exr/comp_rle", "malformed/git_lfs"):
        done = subprocess.run(["/usr/bin/python3", "-B", table, "--worker", build / "hexad-worker", "--data", shared_data,
                               "--only", word], capture_output=True, text=True, timeout=PATIENCE_S)
        assert done.returncode == 0 and done.stdout.count("\n") == 2, done.stdout + done.stderr
