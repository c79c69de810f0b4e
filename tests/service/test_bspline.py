# SPDX-License-Identifier: Apache-2.0
"""surface.bspline through the worker and the daemon: the examples, coefficients from files, refusals."""
import hashlib
import json
import pathlib
import subprocess
import sys

import numpy
import pytest

from readers import Points
from service import PATIENCE_S, last_words, sphere

SOURCE = pathlib.Path(__file__).resolve().parent.parent.parent
EXAMPLES = ["bspline-box.json", "bspline-torus.json"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """What the tool writes now."""
    directory = tmp_path_factory.mktemp("made")
    subprocess.run([sys.executable, SOURCE / "tools" / "bspline_examples.py", directory], check=True,
                   timeout=PATIENCE_S)
    return directory


def torus_spec(made, count, **members):
    """The example's surface with other coefficients or the like, its points spread evenly."""
    bspline = json.loads((made / "bspline-torus.json").read_text())["surface"]["bspline"]
    if "path" in members:
        del bspline["coefficients"]
    bspline.update(members)
    return sphere(count, surface={"bspline": bspline}, output={"preview": False})


def coefficients(made):
    return numpy.array(json.loads((made / "bspline-torus.json").read_text())["surface"]["bspline"]["coefficients"])


def distance_from_torus(p):
    """The formula of the tool's header, as a true distance."""
    p = p - 0.5
    return numpy.hypot(numpy.hypot(p[:, 0], p[:, 1]) - 0.3, p[:, 2]) - 0.12


def distance_from_box(p):
    q = numpy.abs(p - 0.5) - (0.34 - 0.12)
    return numpy.linalg.norm(numpy.maximum(q, 0), axis=1) + numpy.minimum(q.max(axis=1), 0) - 0.12


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_examples_are_what_the_tool_writes(made, name):
    here, now = (json.loads((where / name).read_text()) for where in (SOURCE / "examples", made))
    theirs, ours = (numpy.array(d["surface"]["bspline"].pop("coefficients")) for d in (here, now))
    assert here == now
    assert numpy.abs(theirs - ours).max() <= 2e-6  # the last digit may differ with the machine's mathematics


@pytest.mark.sanitized
@pytest.mark.parametrize("name, distance, worst", [
    ("torus", distance_from_torus, 2e-4),
    ("box", distance_from_box, 5e-3),
])
def test_an_example_runs(worker, tmp_path, name, distance, worst):
    """Figure 6. `worst` is what 13 spans along the cube leave of the formula."""
    spec = json.loads((SOURCE / "examples" / f"bspline-{name}.json").read_text())
    spec["output"] = {"preview": False}
    assert worker(spec).returncode in (0, 11)
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    points = Points((tmp_path / "out" / "points.ply").read_bytes())
    assert points.count == report["count"] == 1250 and report["quality"]["lost"] == 0
    assert report["inputs"] == []
    assert numpy.abs(distance(points.position.astype(float))).max() < worst
    out = points.normal.astype(float) * 1e-3
    assert (distance(points.position + out) > distance(points.position - out)).all()


def test_coefficients_from_a_file(worker, tmp_path, made):
    """64 bits are the numbers of the spec; 32 are those rounded."""
    assert worker(torus_spec(made, 300), output="inline").returncode == 0
    for width, name in ((8, "c.f64"), (4, "c.f32")):
        data = coefficients(made).astype(f"<f{width}").tobytes()
        (tmp_path / name).write_bytes(data)
        assert worker(torus_spec(made, 300, path=name), output=name + ".out").returncode == 0
        report = json.loads((tmp_path / (name + ".out") / "report.json").read_text())
        of_file = (tmp_path / name).stat()
        assert report["inputs"] == [{"path": name, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest(),
                                     "inode": str(of_file.st_ino), "mtime_ns": str(of_file.st_mtime_ns),
                                     "ctime_ns": str(of_file.st_ctime_ns)}]
    inline, double, single = ((tmp_path / where / "points.ply").read_bytes() for where in
                              ("inline", "c.f64.out", "c.f32.out"))
    assert double == inline
    far = numpy.abs(distance_from_torus(Points(single).position.astype(float))).max()
    assert far < 2e-4


def test_an_open_spline_has_rims(worker, tmp_path):
    """The half space x < 0.4: its plane ends at four faces of the domain."""
    n = 8
    places = [(i - 1) / (n - 3) - 0.4 for i in range(n)]
    spec = sphere(400, surface={"bspline": {"dims": [n, n, n], "coefficients": places * n * n}},
                  output={"preview": False})
    assert worker(spec).returncode == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    points = Points((tmp_path / "out" / "points.ply").read_bytes())
    assert report["surface"]["area"] == pytest.approx(1, abs=1e-9)
    at_end = numpy.minimum(points.position[:, 1:], 1 - points.position[:, 1:]).min(axis=1) < 1e-6
    assert 40 < at_end.sum() < 120  # the perimeter is 4, the spacing 0.054
    assert numpy.abs(points.position[:, 0] - 0.4).max() < 1e-6
    assert points.position.min() >= 0 and points.position.max() <= 1
    assert (points.normal[:, 0] > 0.999).all()


@pytest.mark.sanitized
def test_bad_files_are_told(worker, tmp_path, made):
    whole = coefficients(made).astype("<f8")
    odd = whole.copy()
    odd[17 + 16 * (3 + 16 * 5) - 16] = numpy.nan  # (1, 3, 5)
    (tmp_path / "nan.raw").write_bytes(odd.tobytes())
    (tmp_path / "short.raw").write_bytes(whole.tobytes()[:-1])
    (tmp_path / "empty.raw").write_bytes(b"")
    (tmp_path / "flat.raw").write_bytes(numpy.ones(4096, "<f4").tobytes())
    cases = [("nan.raw", 3, "input_damaged", "(1, 3, 5)"),
             ("short.raw", 3, "input_damaged", "16384 bytes as 32-bit floats or 32768 as 64-bit"),
             ("empty.raw", 3, "input_damaged", "has 0 bytes"),
             ("missing.raw", 3, "input_missing", "missing.raw"),
             ("flat.raw", 4, "no_surface", "range from 1 to 1")]
    for name, code, error, words in cases:
        done = worker(torus_spec(made, 100, path=name))
        assert done.returncode == code, done
        said = last_words(done)
        assert said["code"] == error and words in said["message"] and name in said["message"], said
    huge = torus_spec(made, 100, path="huge.raw", dims=[256, 256, 256])
    with open(tmp_path / "huge.raw", "wb") as sparse:
        sparse.truncate(4 * 256**3)
    done = worker(huge, "--memory-mb", 64)
    assert done.returncode == 5 and last_words(done)["code"] == "limit_memory"


def test_the_daemon_looks_at_the_path(new_service, tmp_path, made):
    root = tmp_path / "root"
    root.mkdir()
    (root / "c.raw").write_bytes(coefficients(made).astype("<f4").tobytes())
    (tmp_path / "outside.raw").write_bytes(b"")
    service = new_service("--input_roots", root).start()
    cases = [("missing.raw", 422, "input_missing"), (str(tmp_path / "outside.raw"), 403, "path_forbidden")]
    for path, status, code in cases:
        reply = service.post("/v1/jobs", torus_spec(made, 100, path=path))
        assert reply.status == status and reply.json["code"] == code
        assert [e["pointer"] for e in reply.json["errors"]] == ["/surface/bspline/path"]
    service.wait_state(service.submit(torus_spec(made, 100, path="c.raw")), "succeeded")
    service.wait_state(service.submit(torus_spec(made, 100)), "succeeded")
