# SPDX-License-Identifier: Apache-2.0
"""From a file to points by one command: hexadctl sample, with a service, and hexad-worker sample, without one."""
import json
import re
import signal
import struct
import subprocess

import numpy
import pytest
from scipy.spatial import ConvexHull, cKDTree

from readers import read_columns
from service import PATIENCE_S, Service, wait_until
from volumes import Part, nrrd_header, write_exr, write_nifti, write_nrrd


def ellipsoid(path, *half_axes):
    """A closed mesh of an ellipsoid with 8 000 triangles."""
    k = numpy.arange(4002) + 0.5
    height, turn = 1 - 2 * k / len(k), numpy.pi * (1 + 5 ** 0.5) * k  # a spiral of equal areas
    ring = numpy.sqrt(1 - height ** 2)
    unit = numpy.c_[ring * numpy.cos(turn), ring * numpy.sin(turn), height]
    faces = ConvexHull(unit).simplices
    outward = numpy.einsum("ij,ij->i", numpy.cross(unit[faces[:, 1]] - unit[faces[:, 0]], unit[faces[:, 2]] - unit[faces[:, 0]]),
                           unit[faces[:, 0]]) > 0
    faces = numpy.where(outward[:, None], faces, faces[:, ::-1])
    corners = unit * half_axes
    path.write_text("".join("v {:.9g} {:.9g} {:.9g}\n".format(*v) for v in corners) +
                    "".join("f {} {} {}\n".format(*(f + 1)) for f in faces))
    return path


@pytest.fixture
def service(clean_service):
    return clean_service


@pytest.fixture
def sample(service, build, tmp_path):
    """hexadctl sample in the directory of the test."""
    def call(*words, of=None):
        return subprocess.run([build / "hexadctl", "sample", *map(str, words)], capture_output=True, text=True,
                              timeout=PATIENCE_S, env=(of or service).environment(), cwd=tmp_path)
    return call


@pytest.fixture
def sample_alone(build, tmp_path):
    """hexad-worker sample in the directory of the test."""
    def call(*words, code=0):
        done = subprocess.run([build / "hexad-worker", "sample", *map(str, words)], capture_output=True, text=True,
                              timeout=PATIENCE_S, cwd=tmp_path)
        assert done.returncode in (code if isinstance(code, tuple) else (code,)), done.stderr
        return done
    return call


def positions(directory):
    columns = read_columns((directory / "points.ply").read_bytes())
    return numpy.c_[columns["x"], columns["y"], columns["z"]]


def distances(points):
    """The distance of each point to its nearest neighbour."""
    return cKDTree(points).query(points, 2)[0][:, 1]


def spec_of(directory):
    return json.loads((directory / "spec.json").read_text())


def jobs(service):
    return service.get("/v1/jobs").json["jobs"]


def test_a_mesh_becomes_points_on_it(sample, service, tmp_path):
    ellipsoid(tmp_path / "ball.obj", 1, 1, 1)
    done = sample("ball.obj", "--count", 500)
    assert done.returncode == 0, done.stderr
    points = positions(tmp_path / "ball")
    assert len(points) == 500 and abs(numpy.linalg.norm(points, axis=1) - 1).max() < 0.01
    (job,) = jobs(service)
    assert done.stderr.startswith("ball.obj: sending ") and f"job {job['id']}\n" in done.stderr
    spec = spec_of(tmp_path / "ball")
    assert done.stdout.splitlines() == [f"spec: {json.dumps(spec, separators=(',', ':'))}", f"{job['id']} succeeded converged",
                                        "the points are in ball/points.ply"]
    assert job["name"] == spec["name"] == "ball" and spec["sampling"] == {"count": 500}
    there = {p.name for p in (tmp_path / "ball").iterdir()}
    assert there == {"spec.json"} | {r["name"] for r in service.get(f"/v1/jobs/{job['id']}/results").json["results"]}


def test_the_spec_is_the_first_suggestion(sample, service, tmp_path):
    ellipsoid(tmp_path / "egg.obj", 1, 1, 1.5)
    assert sample("egg.obj").returncode == 0
    spec = spec_of(tmp_path / "egg")
    first = service.post("/v1/inputs:inspect", {"path": spec["surface"]["mesh"]["path"]}).json["suggestions"][0]["spec"]
    assert spec == {**first, "name": "egg"}
    sha256 = spec["surface"]["mesh"]["path"].removeprefix("sha256:").removesuffix(".obj")
    assert service.get(f"/v1/inputs/{sha256}").json["name"] == "egg.obj"
    (tmp_path / "egg.obj").rename(tmp_path / "ei #2.obj")  # the service has these bytes: only the name is sent
    again = sample("ei #2.obj")
    assert again.returncode == 0 and "ei #2.obj: the service has this file\n" in again.stderr, again.stderr
    assert service.get(f"/v1/inputs/{sha256}").json["name"] == "ei #2.obj"
    assert json.loads((tmp_path / "egg/report.json").read_text())["count"] == first["sampling"]["count"]


@pytest.mark.sanitized
def test_a_directory_with_files_is_refused_before_anything_is_sent(sample, service, tmp_path):
    ellipsoid(tmp_path / "ball.obj", 1, 1, 1)
    (tmp_path / "ball").mkdir()
    for words in (("ball.obj",), ("ball.obj", "--output", ".")):
        done = sample(*words)
        assert done.returncode == 2 and "exists: name another directory for the result with --output" in done.stderr, done.stderr
    assert not jobs(service)
    assert sample("ball.obj", "--count", 200, "--output", "ball").returncode == 0  # it is given, and has no files
    again = sample("ball.obj", "--count", 200, "--output", "a/b")
    assert again.returncode == 0 and again.stderr.startswith("ball.obj: the service has this file\n")
    assert again.stdout.endswith("the points are in a/b/points.ply\n") and len(positions(tmp_path / "a/b")) == 200


def test_the_options_are_those_of_the_spec(sample, tmp_path):
    ellipsoid(tmp_path / "egg.obj", 1, 1, 2)
    assert sample("egg.obj", "--spacing", 0.1, "--output", "even").returncode == 0
    even = distances(positions(tmp_path / "even"))
    assert abs(numpy.median(even) / 0.1 - 1) < 0.1 and spec_of(tmp_path / "even")["sampling"] == {"spacing": 0.1}
    done = sample("egg.obj", "--count", 2000, "--grade", "curvature=3", "--output", "graded")
    assert done.returncode in (0, 11), done.stderr
    points = positions(tmp_path / "graded")
    near, tip = distances(points), abs(points[:, 2]) > 1.9
    assert numpy.median(near[abs(points[:, 2]) < 0.5]) > 1.5 * numpy.median(near[tip])  # the curvature is at least twice as large there
    assert sample("egg.obj", "--count", 2000, "--grade", "curvature", "--output", "four").returncode in (0, 11)
    assert spec_of(tmp_path / "four")["sampling"] == {"count": 2000, "curvature": {"ratio": 4}}
    assert sample("egg.obj", "--count", 2000, "--pattern", "blue_noise", "--output", "noise").returncode in (0, 10, 11)
    noise = distances(positions(tmp_path / "noise"))
    hexagonal = even
    assert numpy.std(noise) / numpy.mean(noise) > 2 * numpy.std(hexagonal) / numpy.mean(hexagonal)


def test_values_of_set_are_json_or_texts(sample, tmp_path):
    ellipsoid(tmp_path / "ball.obj", 1, 1, 1)
    done = sample("ball.obj", "--set", "/sampling/density=40", "--set", "/output/preview=false", "--set", "/name=a = b",
                  "--set", "/queue/labels=[\"x\"]")
    assert done.returncode == 0, done.stderr
    spec = spec_of(tmp_path / "ball")
    assert spec["sampling"] == {"density": 40}  # the suggested count gives way to another target
    assert spec["output"] == {"preview": False} and spec["name"] == "a = b" and spec["queue"] == {"labels": ["x"]}
    assert abs(len(positions(tmp_path / "ball")) / (40 * 4 * numpy.pi) - 1) < 0.02
    assert not (tmp_path / "ball/preview.png").exists()


@pytest.mark.sanitized
@pytest.mark.parametrize("words, told", [
    (("--count", "many"), "--count must be a number (given many)"),
    (("--count", "10", "--spacing", "1"), "--count and --spacing exclude each other"),
    (("--grade", "feature"), "--grade must be curvature or curvature=RATIO (given feature)"),
    (("--grade", "curvature=high"), "must be a number (given high)"),
    (("--set", "sampling=1"), "--set sampling=1: must be /MEMBER=VALUE, such as /sampling=1"),
    (("--set", "isovalue=100"), "such as /surface/vdb/isovalue=100 or /surface/volume/isovalue=100"),
    (("--set", "radius=1"), "--set radius=1: must be /MEMBER=VALUE"),
    (("--set", "/sampling"), "--set /sampling: must be /MEMBER=VALUE"),
    (("--set", "/version/major=1"), "a part of /version/major has no members"),
    (("--count", "2.5"), "/sampling/count: "), (("--pattern", "regular"), "/sampling/pattern: "),
    (("--set", "/sampling/cuont=5"), "/sampling/cuont: ")])
def test_wrong_options_are_named(sample, sample_alone, service, tmp_path, words, told):
    ellipsoid(tmp_path / "ball.obj", 1, 1, 1)
    done = sample("ball.obj", *words)
    assert done.returncode == 2 and told in done.stderr, done.stderr
    assert not jobs(service) and not (tmp_path / "ball").exists()
    error = json.loads(sample_alone("ball.obj", *words, code=2).stderr.splitlines()[-1])
    assert told in error["message"]
    if told.startswith("--"):  # a directory that is taken hides no wrong option
        for done in (sample("ball.obj", *words, "--output", "."), sample_alone("ball.obj", *words, "--output", ".", code=2)):
            assert told in done.stderr, done.stderr


def test_a_folder_is_not_called_a_result(sample, sample_alone, tmp_path):
    (tmp_path / "scans").mkdir()
    for path in ("scans", "./scans/", tmp_path / "scans"):
        told = json.loads(sample_alone(path, code=2).stderr.splitlines()[-1])["message"]
        assert told.startswith(f"{path} is a directory: give a file, or a pattern") and "exists" not in told
        assert " is a directory" in sample(path).stderr


def test_an_accepted_outcome_counts_as_converged(sample, sample_alone, tmp_path):
    """A solve that is stopped after two sweeps has not converged."""
    ellipsoid(tmp_path / "needle.obj", 10, 1, 0.05)
    words = ("needle.obj", "--count", 30, "--set", "/solver/max_sweeps=2")
    strict = "--set", '/queue/accept=["converged"]'
    code = sample_alone(*words, "--output", "plain", code=(10, 11)).returncode
    sample_alone(*words, "--output", "strict", "--accept", *strict, code=(code,))
    sample_alone(*words, "--output", "accepted", "--accept")
    for number, (more, expected) in enumerate(((("--accept",), 0), (("--accept", *strict), code), ((), code))):
        done = sample(*words, "--output", number, *more)
        assert done.returncode == expected, done.stderr


@pytest.mark.sanitized
def test_what_is_not_one_file_is_not_sent(sample, service, tmp_path):
    (tmp_path / "scan.zarr").mkdir()
    for k in range(3):
        write_exr(tmp_path / f"slice.{k}.exr", Part({"Y": numpy.ones((4, 4), numpy.float32)}))
    for word, told in (("scan.zarr", "scan.zarr is a directory"), ("slice.####.exr", "slice.####.exr is a pattern of several files"),
                       ("slice.1.exr", "slice.1.exr is one image of a stack")):
        done = sample(word)
        assert done.returncode == 2 and told in done.stderr, done.stderr
        assert "--on-service" in done.stderr and "hexad-worker sample" in done.stderr
    done = sample("x.####.obj", "--frames", "1-2")
    assert done.returncode == 2 and "or send the files with hexadctl upload 'x.####.obj'" in done.stderr, done.stderr
    values = numpy.ones((4, 4, 4), numpy.float32)
    (tmp_path / "split.nhdr").write_text("\n".join(nrrd_header(values, None, "raw", "little", ["data file: split.raw"])) + "\n\n")
    (tmp_path / "split.raw").write_bytes(values.tobytes())
    done = sample("split.nhdr")
    assert done.returncode == 2 and "split.nhdr: it names other files, which an uploaded header cannot" in done.stderr, done.stderr
    done = sample("missing.obj")
    assert done.returncode == 2 and "cannot read missing.obj: No such file or directory" in done.stderr
    assert not jobs(service)


def test_a_path_of_the_service(sample, new_service, tmp_path):
    root = tmp_path / "inputs"
    root.mkdir()
    ellipsoid(root / "ball.obj", 1, 1, 1)
    service = new_service("--input_roots", root).start()
    done = sample("--on-service", root / "ball.obj", "--count", 300, of=service)
    assert done.returncode == 0 and "sending" not in done.stderr, done.stderr
    assert spec_of(tmp_path / "ball")["surface"] == {"mesh": {"path": str(root / "ball.obj")}}
    assert len(positions(tmp_path / "ball")) == 300
    elsewhere = ellipsoid(tmp_path / "egg.obj", 1, 1, 2)
    done = sample("--on-service", elsewhere, of=service)
    assert done.returncode == 2 and "egg.obj" in done.stderr and not (tmp_path / "egg").exists()


@pytest.mark.parametrize("words", [("--frames", "1-3"), ("--set", "/queue/frames=1-3")])
def test_a_pattern_is_sampled_as_an_array(sample, sample_alone, new_service, tmp_path, words):
    root = tmp_path / "inputs"
    root.mkdir()
    for frame in (1, 2, 3):
        ellipsoid(root / f"ball.{frame:04}.obj", 1, 1, frame)
    service = new_service("--input_roots", root).start()
    pattern = root / "ball.####.obj"
    done = sample("--on-service", pattern, *words, "--set", "/sampling/spacing=0.3", "--name", "three balls", of=service)
    assert done.returncode == 0, done.stderr
    spec = spec_of(tmp_path / "ball")
    assert spec["surface"] == {"mesh": {"path": str(pattern)}} and spec["name"] == "three balls", spec
    for frame in (1, 2, 3):
        x, y, z = (positions(tmp_path / "ball" / str(frame)) / (1, 1, frame)).T
        assert abs(numpy.sqrt(x * x + y * y + z * z) - 1).max() < 0.01
    sample_alone(pattern, *words, "--frame", 2, "--output", "alone", "--name", "second")  # inspects the first frame
    assert abs(numpy.linalg.norm(positions(tmp_path / "alone") / (1, 1, 2), axis=1) - 1).max() < 0.01
    assert spec_of(tmp_path / "alone")["name"] == "second"
    every = sample("--on-service", pattern, "--frames", "all", "--output", "all", of=service)
    assert every.returncode == 2 and "write numbers in place of" in every.stderr, every.stderr


def test_a_pattern_of_label_images_is_sampled_as_an_array(sample, new_service, tmp_path):
    root = tmp_path / "inputs"
    root.mkdir()
    x = numpy.arange(24) - 11.5
    square = sum(g * g for g in numpy.meshgrid(x, x, x))
    radii = {1: (4, 8), 2: (5, 10)}  # of a ball of label 2 in a ball of label 1
    for frame, (inner, outer) in radii.items():
        write_nrrd(root / f"seg.{frame:04}.nrrd", ((square < outer ** 2).astype("u1") + (square < inner ** 2)).astype("u1"))
    service = new_service("--input_roots", root).start()
    done = sample("--on-service", root / "seg.####.nrrd", "--frames", "1-2", "--count", 300, of=service)
    assert done.returncode == 0, done.stderr
    assert spec_of(tmp_path / "seg")["surface"]["labels"]["path"] == str(root / "seg.####.nrrd")
    for frame, (inner, outer) in radii.items():
        distance = numpy.linalg.norm(positions(tmp_path / "seg" / str(frame)) - 11.5, axis=1)
        off = numpy.minimum(abs(distance - inner), abs(distance - outer))
        assert off.max() < 1 and (distance < (inner + outer) / 2).any() and (distance > (inner + outer) / 2).any(), (frame, off.max())


def test_the_exit_status_is_that_of_the_job(sample, sample_alone, tmp_path):
    ellipsoid(tmp_path / "ball.obj", 1, 1, 1)
    for call, words in ((sample, ()), (lambda *w: sample_alone(*w, code=11), ("--output", "alone"))):
        done = call("ball.obj", "--count", 300, "--set", "/outcome/require/hex_fraction=1", *words)
        assert done.returncode == 11, done.stderr
    assert len(positions(tmp_path / "ball")) == len(positions(tmp_path / "alone")) == 300  # there is a result
    done = sample("ball.obj", "--count", 50000, "--set", "/limits/timeout_s=0.01", "--output", "late")
    assert done.returncode == 1 and "limit_time" in done.stdout and not (tmp_path / "late").exists()
    assert "the points are" not in done.stdout


def test_the_worker_makes_the_same_points_alone(sample, sample_alone, example, tmp_path):
    (tmp_path / "tube.vdb").write_bytes(example.read_bytes())
    words = ("tube.vdb", "--count", 700, "--grade", "curvature=2", "--set", "/output/preview=false")
    assert sample(*words).returncode == 0
    done = sample_alone(*words, "--output", "alone")
    first, second, last = done.stdout.splitlines()
    assert re.match(r"700 points, spacing 0\.\d+, converged, ", second) and last == "the points are in alone/points.ply"
    spec = spec_of(tmp_path / "alone")
    assert first == f"spec: {json.dumps(spec, separators=(',', ':'))}" and "\r" not in done.stderr  # no bar: it is no terminal
    assert spec["surface"]["vdb"].pop("path") == "tube.vdb"
    with_service = spec_of(tmp_path / "tube")
    assert with_service["surface"]["vdb"].pop("path").endswith(".vdb") and spec == with_service
    assert sorted(p.name for p in (tmp_path / "alone").iterdir()) == sorted(p.name for p in (tmp_path / "tube").iterdir())
    assert (tmp_path / "alone/points.ply").read_bytes() == (tmp_path / "tube/points.ply").read_bytes()
    again = sample_alone(*words, code=2)  # ./tube exists
    assert "tube exists: name another directory" in json.loads(again.stderr.splitlines()[-1])["message"]


@pytest.mark.parametrize("text", ["This is simply a text.\n", "# Notes\n"])
def test_a_text_is_not_called_a_mesh(sample_alone, tmp_path, text):
    """The mesh library takes a text with ply in it for a PLY file."""
    (tmp_path / "notes.md").write_text(text)
    error = json.loads(sample_alone("notes.md", code=3).stderr.splitlines()[-1])
    assert error["code"] == "input_unsupported" and ".." not in error["message"], error
    assert "notes.md: its format is not known" in error["message"] and "PLY, OBJ, STL or OFF" in error["message"]


def test_one_of_several_volumes_is_named(sample_alone, tmp_path):
    x = numpy.arange(16) - 7.5
    radius = numpy.sqrt(sum(g * g for g in numpy.meshgrid(x, x, x)))
    write_nifti(tmp_path / "ball.nii", (7 - radius).astype("f4"))
    raw = bytearray((tmp_path / "ball.nii").read_bytes())
    struct.pack_into("<8h", raw, 40, 4, 16, 16, 16, 2, 1, 1, 1)
    (tmp_path / "ball.nii").write_bytes(raw + (3 - radius).astype("<f4").tobytes(order="F"))
    told = sample_alone("ball.nii", "--count", 200).stderr
    assert "\nvolume 0 of 2, from 0; set another with --set /surface/volume/index=K\nisovalue " in told
    done = sample_alone("ball.nii", "--count", 200, "--set", "/surface/volume/isovalue=0", "--set", "/surface/volume/index=1",
                        "--output", "b")
    assert "volume 0 of" not in done.stderr
    points = positions(tmp_path / "b")
    assert abs(numpy.linalg.norm(points - points.mean(axis=0), axis=1) - 3).max() < 0.2


def test_a_volume_is_sampled_at_the_suggested_isovalue(sample_alone, tmp_path):
    x = numpy.arange(24) - 11.5
    radius = numpy.sqrt(sum(g * g for g in numpy.meshgrid(x, x, x)))
    write_nrrd(tmp_path / "ball.nii.nrrd", numpy.tanh(8 - radius).astype(numpy.float32))
    told = sample_alone("ball.nii.nrrd", "--count", 400).stderr
    isovalue = spec_of(tmp_path / "ball.nii")["surface"]["volume"]["isovalue"]
    assert "inspecting ball.nii.nrrd\n" in told
    assert f"isovalue {isovalue:.6g}: suggested by inspect, of " in told and "--set /surface/volume/isovalue=V\n" in told
    told = sample_alone("ball.nii.nrrd", "--count", 400, "--set", "/surface/volume/isovalue=0.25", "--output", "other").stderr
    assert "suggested" not in told
    points = positions(tmp_path / "ball.nii")
    centre = points.mean(axis=0)
    assert abs(numpy.linalg.norm(points - centre, axis=1) - 8).max() < 0.5


def write_vdb(path, *names):
    """Grids of a ball of radius 8 voxels, whose values fall from 1 to 0 at its surface."""
    import pyopenvdb
    at = numpy.mgrid[-12:13, -12:13, -12:13]
    grids = []
    for name in names:
        grids.append(pyopenvdb.FloatGrid(0.0))
        grids[-1].name = name
        grids[-1].copyFromArray(numpy.clip(8.5 - numpy.sqrt((at ** 2).sum(0)), 0, 1), ijk=(-12, -12, -12))
    pyopenvdb.write(str(path), grids)


@pytest.mark.sanitized
def test_an_isovalue_makes_the_inspection_of_a_vdb_file_unnecessary(sample, sample_alone, service, tmp_path):
    write_vdb(tmp_path / "smoke.vdb", "density", "heat")
    words = ("smoke.vdb", "--count", 300, "--set", "/surface/vdb/isovalue=0.5")
    alone = json.loads(sample_alone(*words, "--output", "none", code=3).stderr.splitlines()[-1])
    refused = sample(*words)
    assert alone["code"] == "grid_ambiguous" and refused.returncode not in (0, 10, 11)
    for told in (alone["message"], refused.stderr):
        assert 'choose one of "density" (float), "heat" (float)' in told and "--set /surface/vdb/grid=NAME" in told, told
        assert "inspecting" not in told
    for done in (sample(*words, "--set", "/surface/vdb/grid=heat"), sample_alone(*words, "--set", "/surface/vdb/grid=heat", "--output", "alone")):
        assert done.returncode == 0 and "inspecting" not in done.stderr, done.stderr
    for directory in ("smoke", "alone"):
        assert abs(numpy.linalg.norm(positions(tmp_path / directory), axis=1) - 8).max() < 0.2


@pytest.mark.extended  # waits for a moment in which the service answers in 0.2 s
def test_a_fault_of_a_sent_file_is_refused_before_the_submission(sample, service, tmp_path):
    write_vdb(tmp_path / "smoke.vdb", "density", "heat")

    def is_refused():  # unless the answer takes longer than a submission waits
        before = jobs(service)
        done = sample("smoke.vdb", "--count", 300, "--set", "/surface/vdb/isovalue=0.5")
        assert done.returncode != 0 and "choose one of" in done.stdout + done.stderr, done.stderr
        return jobs(service) == before
    wait_until(is_refused, "a refusal")


def test_samples_wait_for_the_inspections_of_others(build, tmp_path, new_service):
    """The service makes one inspection at a time."""
    service = new_service("--estimates", 1).start()
    for k in range(4):
        ellipsoid(tmp_path / f"ball{k}.obj", 1, 1, 1 + k / 10)
    running = [subprocess.Popen([build / "hexadctl", "sample", f"ball{k}.obj", "--count", "100"], cwd=tmp_path, text=True,
                                env=service.environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE) for k in range(4)]
    for process in running:
        out, err = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0, err
    assert sorted(job["name"] for job in jobs(service)) == [f"ball{k}" for k in range(4)]


ENDLESS = ("--set", "/solver/max_sweeps=1000000", "--set", "/solver/step_tolerance=1e-12", "--set", "/solver/energy_tolerance=1e-12")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_sample_says_that_the_job_continues(build, service, tmp_path, number):
    ellipsoid(tmp_path / "ball.obj", 1, 1, 1)
    with subprocess.Popen([build / "hexadctl", "sample", "ball.obj", "--count", "20000", *ENDLESS], stderr=subprocess.PIPE, text=True,
                          stdout=subprocess.DEVNULL, env=service.environment(), cwd=tmp_path) as command:
        job = next(line for line in command.stderr if line.startswith("job ")).split()[1]
        service.wait_state(job, "running")
        command.send_signal(number)
        told = command.stderr.read()
    assert command.returncode == -number and f"the job {job} continues" in told, told
    assert f'"hexadctl wait {job}"' in told and f'"hexadctl cancel {job}"' in told
    assert service.job(job)["state"] == "running"
    subprocess.run([build / "hexadctl", "cancel", job], env=service.environment(), check=True, capture_output=True, timeout=PATIENCE_S)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_sample_keeps_ignoring_a_signal(build, service, tmp_path, number):
    """As with nohup, or in the background of a shell script."""
    ellipsoid(tmp_path / "ball.obj", 1, 1, 1)
    with subprocess.Popen([build / "hexadctl", "sample", "ball.obj", "--count", "20000", *ENDLESS], stderr=subprocess.PIPE, text=True,
                          stdout=subprocess.DEVNULL, env=service.environment(), cwd=tmp_path,
                          preexec_fn=lambda: signal.signal(number, signal.SIG_IGN)) as command:
        job = next(line for line in command.stderr if line.startswith("job ")).split()[1]
        service.wait_state(job, "running")
        command.send_signal(number)
        subprocess.run([build / "hexadctl", "cancel", job], env=service.environment(), check=True, capture_output=True, timeout=PATIENCE_S)
        told = command.stderr.read()
    assert command.returncode == 6 and "continues" not in told, (command.returncode, told)


def test_without_a_service_nothing_is_sent(build, tmp_path):
    ellipsoid(tmp_path / "ball.obj", 1, 1, 1)
    done = subprocess.run([build / "hexadctl", "--server", f"unix:{tmp_path}/none.sock", "sample", "ball.obj"], capture_output=True,
                          text=True, timeout=PATIENCE_S, cwd=tmp_path)
    assert done.returncode == 3 and "sending" not in done.stderr, done.stderr
    assert "cannot connect" in done.stderr and "`hexad-worker sample FILE` needs no service" in done.stderr


def test_the_document_of_the_job(build, service, tmp_path):
    ellipsoid(tmp_path / "ball.obj", 1, 1, 1)
    done = subprocess.run([build / "hexadctl", "--json", "sample", "ball.obj", "--count", "100"], capture_output=True, text=True,
                          timeout=PATIENCE_S, env=service.environment(), cwd=tmp_path)
    assert done.returncode == 0 and json.loads(done.stdout)["state"] == "succeeded", done.stderr
    assert len(positions(tmp_path / "ball")) == 100


@pytest.mark.parametrize("options", [("--estimates", 0), ("--estimate_timeout_s", 0.01)])
def test_a_mesh_needs_no_inspection_but_a_volume_does(new_service, sample, example, tmp_path, options):
    service = new_service("--input_roots", tmp_path, *options).start()
    ellipsoid(tmp_path / "ball.obj", 1, 1, 1)
    for words in (("ball.obj",), ("--on-service", tmp_path / "ball.obj", "--output", "again")):
        done = sample(*words, "--count", 300, of=service)
        assert done.returncode == 0, done.stderr
    assert len(positions(tmp_path / "ball")) == len(positions(tmp_path / "again")) == 300
    x = numpy.arange(24) - 11.5
    radius = numpy.sqrt(sum(g * g for g in numpy.meshgrid(x, x, x)))
    write_nrrd(tmp_path / "volume.nrrd", (12 - radius).astype(numpy.float32))
    isovalue = "--set", "/surface/volume/isovalue=4"
    assert sample("volume.nrrd", "--count", 300, *isovalue, of=service).returncode == 0  # nothing has to be suggested
    points = positions(tmp_path / "volume")
    assert abs(numpy.linalg.norm(points - points.mean(axis=0), axis=1) - 8).max() < 0.2
    for words in (("--count", 300), isovalue):
        done = sample("volume.nrrd", *words, "--output", "other", of=service)
        assert done.returncode == 1 and "hexad-worker sample FILE" in done.stderr, done.stderr
        assert "give --count and --set /surface/volume/isovalue=V\n" in done.stderr, done.stderr
    spec = re.search(r"if the values are labels, submit this spec: ({.*})", done.stderr)[1]
    done = subprocess.run([service.build / "hexadctl", "submit", "-", "--wait", "--set", "/sampling/count=300"], input=spec,
                          capture_output=True, text=True, timeout=PATIENCE_S, env=service.environment())
    assert "use surface.volume with an isovalue" in done.stdout, done.stdout  # the file was found; its values are no labels
    done = sample(example, of=service)
    assert done.returncode == 1, done.stderr
    assert ("does not inspect files: the setting estimates is 0" if options[1] == 0 else "inspection took longer than 0.01 s") in done.stderr
