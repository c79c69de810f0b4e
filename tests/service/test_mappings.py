# SPDX-License-Identifier: Apache-2.0
"""Paths of other machines: what a job asks for, and what is opened here."""
import hashlib
import struct
import subprocess

import pytest

from service import PATIENCE_S, aged, sphere

AXIS = [k / 7 for k in range(8)]


def write_ball(path):
    """Coefficients of a ball, as bspline reads them."""
    values = [(x - .5) ** 2 + (y - .5) ** 2 + (z - .5) ** 2 - .09 for z in AXIS for y in AXIS for x in AXIS]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(struct.pack(f"<{len(values)}f", *values))


def ball(path, **parts):
    return sphere(surface={"bspline": {"dims": [8, 8, 8], "path": path}}, **parts)


@pytest.fixture
def show(tmp_path):
    """A show as this machine has it."""
    where = tmp_path / "show"
    write_ball(where / "a.f32")
    return where


@pytest.fixture
def mapped(new_service, show):
    # no file is looked into: none of them is what it is called
    return new_service("--input_roots", show, "--output_roots", show, "--estimates", 0, "--path_mappings",
                       f"/Volumes/show={show}, Z:\\show={show},/Volumes/show/none={show}/nothing").start()


def expect_path(document, pointer, asked, opened):
    assert {"pointer": pointer, "asked": asked, "opened": str(opened)} in document["paths"]


def test_a_job_reads_and_writes_where_files_are_here(mapped, show):
    asked, output = "/Volumes/show/a.f32", "Z:\\show\\out\\a"
    reply = mapped.post("/v1/jobs", ball(asked, output={"directory": output, "preview": False}))
    assert reply.status == 201, reply.body
    done = mapped.wait_state(reply.json["id"], "succeeded")
    for document in (reply.json, done):
        assert document["spec"]["surface"]["bspline"]["path"] == asked
        assert document["spec"]["output"]["directory"] == output
        assert len(document["paths"]) == 2
        expect_path(document, "/surface/bspline/path", asked, show / "a.f32")
        expect_path(document, "/output/directory", output, show / "out" / "a")
    assert (show / "out" / "a" / "points.ply").is_file()
    report = mapped.get(f"/v1/jobs/{reply.json['id']}/results/report.json").json
    assert [i["path"] for i in report["inputs"]] == [str(show / "a.f32")]
    # another start, without the table: the job is what it was
    mapped.end()
    mapped.options = [o for o in mapped.options if "Volumes" not in o and o != "--path_mappings"]
    mapped.start()
    assert mapped.job(done["id"])["paths"] == done["paths"]
    refused = mapped.post("/v1/jobs", ball(asked))
    assert refused.status == 403 and "asked for" not in refused.json["detail"]


@pytest.mark.sanitized
def test_every_path_of_a_spec(mapped, show):
    for frame in (1, 2):
        write_ball(show / f"b.{frame:04d}.f32")
    for slice_number in (1, 2, 3):
        (show / f"c{slice_number}.exr").write_bytes(b"looked at by the worker")
    data = (show / "a.f32").read_bytes()
    sent = mapped.request("PUT", f"/v1/inputs/{hashlib.sha256(data).hexdigest()}", data,
                          {"Content-Type": "application/octet-stream"})
    assert sent.status in (200, 201), sent.body
    parts = [{"bspline": {"dims": [8, 8, 8], "path": "z:/Show/b.####.f32"}},
             {"offset": {"surface": {"bspline": {"dims": [8, 8, 8], "path": "/Volumes/show/a.f32"}}, "distance": 0.1}},
             {"exr": {"path": "/Volumes/show/c#.exr", "slices": "1-3", "isovalue": 0, "voxel_size": [1, 1, 1]}},
             {"bspline": {"dims": [8, 8, 8], "path": sent.json["path"]}},
             {"bspline": {"dims": [8, 8, 8], "path": f"{show}/a.f32"}}]
    reply = mapped.post("/v1/jobs:validate", sphere(surface={"union": parts}, queue={"frames": "1-2"}))
    assert reply.status == 200, reply.body
    got = reply.json
    assert len(got["paths"]) == 3
    expect_path(got, "/surface/union/0/bspline/path", "z:/Show/b.####.f32", show / "b.####.f32")
    expect_path(got, "/surface/union/1/offset/surface/bspline/path", "/Volumes/show/a.f32", show / "a.f32")
    expect_path(got, "/surface/union/2/exr/path", "/Volumes/show/c#.exr", show / "c#.exr")
    assert got["spec"]["surface"]["union"][0]["bspline"]["path"] == "z:/Show/b.####.f32"
    assert got["spec"]["surface"]["union"][2]["exr"]["path"] == "/Volumes/show/c#.exr"


@pytest.mark.sanitized
def test_both_names_are_told(mapped, show):
    for asked, opened, status in (("/Volumes/show/no.f32", show / "no.f32", 422),
                                  ("/Volumes/show/none/a.f32", show / "nothing" / "a.f32", 422),
                                  ("/Volumes/show/../x.f32", show / ".." / "x.f32", 403)):
        refused = mapped.post("/v1/jobs", ball(asked))
        detail = refused.json["errors"][0]["detail"]
        assert refused.status == status and refused.json["errors"][0]["pointer"] == "/surface/bspline/path"
        assert f"mapped from {asked}" in detail and str(opened) in detail
    refused = mapped.post("/v1/jobs", sphere(output={"directory": "Z:\\show\\..\\up"}))
    assert refused.status == 403 and "Z:\\show\\..\\up" in refused.json["detail"]
    refused = mapped.post("/v1/jobs", ball("/Volumes/shows/a.f32"))
    assert refused.status == 403 and "asked for" not in refused.json["detail"]


def test_one_file_by_two_names_is_one_input(mapped, show):
    aged(show / "a.f32")
    first = mapped.submit(ball("/Volumes/show/a.f32"))
    mapped.wait_state(first, "succeeded")
    for name in ("Z:\\show\\a.f32", f"{show}/a.f32"):
        again = mapped.wait_state(mapped.submit(ball(name)), "succeeded")
        assert again["cached_from"] == first and again["spec"]["surface"]["bspline"]["path"] == name


def test_a_bad_table_is_refused_at_the_start(build, tmp_path):
    done = subprocess.run([build / "hexad", "--state_dir", tmp_path / "state", "--path_mappings", "/a=b"],
                          capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 2 and "/a=b" in done.stderr
