# SPDX-License-Identifier: Apache-2.0
"""The client in Python (clients/python): against a real daemon, without one, and as its types say."""
import ast
import doctest
import hashlib
import importlib
import os
import pathlib
import re
import shutil
import signal
import struct
import subprocess
import sys
import threading

import pytest

from lost_answers import LosesAnswers, on_a_socket
from readers import read_png
from service import PATIENCE_S, gated_worker, long_sphere, sphere, wait_until

PACKAGE = pathlib.Path(__file__).parents[2] / "clients/python"
sys.path.insert(0, str(PACKAGE))

import hexad  # noqa: E402
from hexad import points as points_module, problems  # noqa: E402


@pytest.fixture
def socket_service(build, tmp_path):
    made = []

    def make(*options):
        made.append(on_a_socket(build, tmp_path, *options))
        return made[-1].start()

    yield make
    for service in made:
        service.clean_up()


@pytest.fixture(scope="module")
def client(build, tmp_path_factory):
    service = on_a_socket(build, tmp_path_factory.mktemp("client")).start()
    made = hexad.Client(service.address)
    made.service = service
    yield made
    service.clean_up()


@pytest.fixture
def local(build, tmp_path):
    with hexad.Local(build / "hexad-worker", tmp_path / "local") as made:
        yield made


SPEC = sphere(300, output={"preview": False, "mesh": True})


@pytest.mark.parametrize("arrays", [True, False], ids=["numpy", "plain"])
def test_submit_wait_and_fetch(client, tmp_path, monkeypatch, arrays):
    if not arrays:
        monkeypatch.setattr(points_module, "numpy", None)
    job = client.submit({**SPEC, "queue": {"labels": [f"arrays={arrays}"]}}, wait=True)
    assert (job.state, job.outcome, job.error) == ("succeeded", "converged", None)
    assert [j.id for j in client.jobs(label=f"arrays={arrays}", state="succeeded")] == [job.id]
    assert client.job(job.id).spec["surface"] == SPEC["surface"]
    paths = job.fetch(tmp_path / "out")
    assert [p.name for p in paths] == ["points.ply", "mesh.ply", "report.json"]
    for path, result in zip(paths, job.results()):
        assert hashlib.sha256(path.read_bytes()).hexdigest() == result.sha256 and path.stat().st_size == result.bytes
    written = [p.stat().st_ino for p in paths]
    assert job.fetch(tmp_path / "out") == paths and [p.stat().st_ino for p in paths] == written  # not brought again
    assert {p.name for p in (tmp_path / "out").iterdir()} == {p.name for p in paths}
    points, mesh = job.points(), job.points(name="mesh.ply")
    assert points.count == 300 == job.report()["count"] and mesh.count == 300 and len(mesh.triangles) == 596
    for position, normal in zip(points.positions, points.normals):
        assert max(abs(a - b) for a, b in zip(position, normal)) < 1e-5  # of a unit ball
    assert isinstance(points["x"], points_module.numpy.ndarray if arrays else points_module.array.array)


def test_ascii_and_other_types_are_read(client, tmp_path, monkeypatch):
    job = client.submit({**SPEC, "output": {"preview": False, "mesh": True, "ply": {"format": "ascii", "precision": "double"}}},
                        wait=True)
    other = tmp_path / "other.ply"
    other.write_bytes(b"ply\nformat binary_little_endian 1.0\ncomment of another order\nelement vertex 2\nproperty uchar red\n"
                      b"property double x\nproperty uint id\nend_header\n" + struct.pack("<BdIBdI", 255, 0.5, 7, 1, -2, 8))
    for numpy in (points_module.numpy, None):
        monkeypatch.setattr(points_module, "numpy", numpy)
        assert len(job.points(name="mesh.ply").triangles) == 596 and job.points().count == 300
        read = hexad.read_ply(other)
        assert {name: list(read[name]) for name in read} == {"red": [255, 1], "x": [0.5, -2], "id": [7, 8]}
        cut = tmp_path / "cut.ply"
        cut.write_bytes(other.read_bytes()[:-1])
        with pytest.raises(hexad.Damaged):
            hexad.read_ply(cut)


def test_events_across_a_crash_of_the_daemon(socket_service, tmp_path):
    service = socket_service("--worker", gated_worker(tmp_path))
    client = hexad.Client(service.address)
    job = client.submit(sphere())
    told, others = [], []
    followers = [threading.Thread(target=lambda: told.extend(job.events()), daemon=True),
                 threading.Thread(target=lambda: others.extend(e for e in all_events(client)), daemon=True)]
    seen = threading.Event()

    def all_events(client):
        for event in client.events(after="0"):
            if event.state == "running":
                seen.set()
            yield event
            if event.is_end:
                return

    for thread in followers:
        thread.start()
    assert seen.wait(PATIENCE_S)
    service.end(signal.SIGKILL)
    service.start()
    assert job.refresh().state in ("queued", "running")  # asked until the daemon was there
    service.open_gate(job.id)
    for thread in followers:
        thread.join(PATIENCE_S)
        assert not thread.is_alive()
    page = service.get("/v1/events?after=0").json["events"]
    assert [e["state"] for e in page if e["type"] == "state"] == ["queued", "running", "queued", "running", "succeeded"]
    assert [e.data for e in told if e.type != "progress"] == page
    assert [e.data for e in others] == page
    assert list(job.events(after=told[-1].id)) == []  # nothing more will come
    assert job.wait().state == "succeeded"


def test_a_submission_whose_answer_is_lost_makes_one_job(client, tmp_path):
    proxy = LosesAnswers(tmp_path / "proxy", client.service.address.removeprefix("unix:"))
    through = hexad.Client(f"unix:{tmp_path}/proxy")
    job = through.submit(sphere(name="lost answer"))
    assert proxy.asked == 2
    assert [j.id for j in client.jobs(name="lost answer")] == [job.id]
    proxy.listener.close()
    again = [client.submit(sphere(name="by key"), key="key of mine").id for _ in range(2)]
    assert again[0] == again[1]
    with pytest.raises(problems.IdempotencyMismatch):
        client.submit(sphere(201), key="key of mine")


CUBE_OBJ = "".join(f"v {x} {y} {z}\n" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)) + """f 1 2 4 3
f 5 7 8 6
f 1 5 6 2
f 3 4 8 7
f 1 3 7 5
f 2 6 8 4
"""


def test_a_fifo_cannot_be_sent(client, tmp_path):
    """No process writes into it, so that an open of it would wait."""
    os.mkfifo(tmp_path / "pipe.obj")
    with pytest.raises(OSError, match="is not a regular file: give the path of a file"):
        client.upload(tmp_path / "pipe.obj")
    with pytest.raises(FileNotFoundError):
        client.upload(tmp_path / "none.obj")


@pytest.mark.sanitized
def test_files_are_sent(client, tmp_path, monkeypatch):
    asked = []
    open_once = client.transport.open_once
    monkeypatch.setattr(client.transport, "open_once", lambda *words: asked.append(words[0]) or open_once(*words))
    (tmp_path / "cube.obj").write_text(CUBE_OBJ)
    path = client.upload(tmp_path / "cube.obj")
    assert client.upload(CUBE_OBJ.encode(), ".obj") == path
    assert asked == ["GET", "PUT", "GET"]  # once
    sent = f"/v1/inputs/{path.removeprefix('sha256:').removesuffix('.obj')}"
    assert client.transport.get(sent)["name"] == "cube.obj"
    (tmp_path / "cube.obj").rename(tmp_path / "würfel.obj")
    assert client.upload(tmp_path / "würfel.obj") == path and client.transport.get(sent)["name"] == "würfel.obj"
    assert client.inspect(path)["mesh"]
    (tmp_path / "scan.v2.nii.gz").write_bytes(b"")
    assert client.upload(tmp_path / "scan.v2.nii.gz").endswith(hashlib.sha256(b"").hexdigest() + ".nii.gz")
    spec = {"surface": {"mesh": {"path": path, "resolution": 32}}, "sampling": {"count": 200}, "output": {"preview": False}}
    assert client.estimate(spec)["count"] == 200
    job = client.submit(spec, wait=True)
    assert job.points().count == 200
    upload = next(upload for upload in client.uploads() if upload["name"] == "würfel.obj")
    assert path.startswith(upload["path"]) and upload["bytes"] == len(CUBE_OBJ) and upload["jobs"] == [job.id]
    client.delete_upload(path)
    assert upload["sha256"] not in [other["sha256"] for other in client.uploads()]
    with pytest.raises(problems.NotFound):
        client.delete_upload(path)


@pytest.mark.sanitized
def test_errors_have_classes(client, tmp_path):
    with pytest.raises(problems.SpecInvalid) as refused:
        client.submit(sphere(2))
    assert (refused.value.code, refused.value.status) == ("spec_invalid", 422)
    assert [e["pointer"] for e in refused.value.errors] == ["/sampling/count"]
    with pytest.raises(problems.NotFound):
        client.job("0" * 26)
    with pytest.raises(hexad.Unreachable):
        hexad.Client(f"unix:{tmp_path}/nobody", patience=0.1).version()
    for server in ("nonsense", "ftp://host", "http://"):
        with pytest.raises(ValueError):
            hexad.Client(server)
    apart = {"intersection": [{"analytic": {"shape": "sphere", "center": [at, 0, 0], "radius": 1}} for at in (0, 9)]}
    with pytest.raises(hexad.JobFailed) as failed:
        client.submit(sphere(surface=apart), wait=True)
    assert failed.value.code == "no_surface" and client.job(failed.value.job).state == "failed"
    job = client.submit(sphere(), wait=True)
    with pytest.raises(problems.Conflict):
        job.cancel()


def test_a_damaged_file_does_not_arrive(client, tmp_path):
    job = client.submit(sphere(210, output={"preview": False}), wait=True)
    stored = client.service.state / "results" / job.id / "points.ply"
    data = bytearray(stored.read_bytes())
    data[-1] ^= 1
    stored.chmod(0o600)
    stored.write_bytes(data)
    with pytest.raises(hexad.Damaged):
        job.fetch(tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


def test_a_wait_has_an_end(socket_service, tmp_path):
    service = socket_service("--worker", gated_worker(tmp_path))
    job = hexad.Client(service.address).submit(sphere())
    with pytest.raises(hexad.WaitTimeout):
        job.wait(0.1)
    assert job.cancel().wait(check=False).state == "cancelled" == job.cancel().state
    with pytest.raises(hexad.JobFailed):
        job.check()
    job.delete()
    with pytest.raises(problems.NotFound):
        job.refresh()


def test_a_result_is_delivered_again(socket_service, tmp_path):
    service = socket_service("--output_roots", tmp_path)
    job = hexad.Client(service.address).submit(sphere(60, output={"preview": False, "directory": f"{tmp_path}/show"}))
    assert job.wait().document["delivery"]["state"] == "delivered"
    (tmp_path / "show" / "points.ply").unlink()
    job.deliver()
    wait_until(lambda: job.refresh().document["delivery"]["state"] == "delivered", "the copy")
    assert (tmp_path / "show" / "points.ply").is_file()


def test_tokens_over_tcp(build, new_service):
    service = new_service()
    at = service.options.index("--tcp_without_tokens")
    del service.options[at:at + 2]
    service.state.mkdir()
    token = subprocess.run([build / "hexadctl", "token", "add", "alice", "--file", service.state / "tokens"], check=True,
                           capture_output=True, text=True).stdout.split()[0]
    service.start()
    client = hexad.Client(f"http://{service.address}", token)
    assert client.submit(sphere()).document["owner"] == "alice"
    with pytest.raises(problems.Forbidden):
        client.transport.send("POST", "/v1/admin/drain")
    with pytest.raises(problems.Unauthorized):
        hexad.Client(f"http://{service.address}", "wrong").submit(sphere())


# which no other test computes: the daemon would give their results
ALONE = {**SPEC, "solver": {"seed": 9}}
FRAMES = sphere(200, output={"preview": False},
                queue={"frames": "1-2", "by_frame": {"/surface/analytic/radius": {"from": 1, "to": 2}}})


def test_without_a_daemon_all_is_the_same(client, local, tmp_path):
    coherent = {**FRAMES, "queue": {**FRAMES["queue"], "coherent": True}}
    for spec in (ALONE, FRAMES, coherent):
        ours, theirs = local.submit(spec, wait=True), client.submit(spec, wait=True)
        assert (ours.state, ours.outcome, list(ours.frames())) == (theirs.state, theirs.outcome, list(theirs.frames()))
        frame = ours.frames()[-1]
        assert ours.read("points.ply", frame) == theirs.read("points.ply", frame)
        names = [sorted(p.relative_to(tmp_path / w) for p in j.fetch(tmp_path / w)) for j, w in ((ours, "a"), (theirs, "b"))]
        assert names[0] == names[1]
        states = [[e.state for e in j.events() if e.type == "state" and "frame" not in e.data] for j in (ours, theirs)]
        assert states[0] == states[1] == ["queued", "running", "succeeded"]
    assert [j.id for j in local.jobs()][0] == ours.id
    assert local.estimate(SPEC)["count"] == 300
    with pytest.raises(problems.SpecInvalid) as refused:
        local.submit(sphere(2))
    assert refused.value.errors[0]["pointer"] == "/sampling/count"
    assert local.submit(SPEC, key="k") is local.submit(SPEC, key="k")
    path = local.upload(CUBE_OBJ.encode(), ".obj")
    assert local.inspect(path)["mesh"]


def test_outcomes_are_accepted_as_the_spec_says(client, local):
    thin = {"surface": {"analytic": {"shape": "torus", "center": [0, 0, 0], "major_radius": 1, "minor_radius": 0.1}},
            "sampling": {"count": 100}, "outcome": {"require": {"hex_fraction": 0.99}}, "output": {"preview": False}}
    for service in (client, local):
        for accept in (["converged"], ["unresolved"]):
            job = service.submit({**thin, "queue": {"accept": accept}}, wait=True)
            assert job.outcome == "unresolved" and job.accepted is (job.outcome in accept)


def test_frames_without_a_daemon_fail_as_with_one(client, local):
    """One frame has no surface: the others have results, and the job says why it failed."""
    spec = {**FRAMES, "surface": {"offset": {"surface": FRAMES["surface"], "distance": 0}},
            "queue": {"frames": "1-3", "by_frame": {"/surface/offset/distance": [0.1, -2, 0.2]}}}
    for job in (local.submit(spec).wait(check=False), client.submit(spec).wait(check=False)):
        assert (job.state, job.error["code"], list(job.frames())) == ("failed", "no_surface", [1, 3])


def test_a_local_job_is_cancelled(local):
    job = local.submit(long_sphere())
    with pytest.raises(hexad.WaitTimeout):
        job.wait(0.1)
    assert job.cancel().state == "cancelled" == job.cancel().state
    with pytest.raises(hexad.HexadError):
        job.results()
    ended = local.submit(SPEC, wait=True)
    with pytest.raises(problems.Conflict):
        ended.cancel()


def python_files():
    return sorted(PACKAGE.rglob("*.py"))


def test_the_syntax_is_of_python_3_9():
    assert len(python_files()) >= 9
    for path in python_files():
        ast.parse(path.read_text(), feature_version=(3, 9))


@pytest.mark.extended
def test_it_runs_by_python_3_9(client, build, tmp_path):
    """Where there is one; the syntax and the types are held to that version everywhere."""
    old = shutil.which("python3.9")
    if not old or subprocess.run([old, "-c", ""], capture_output=True).returncode:
        pytest.skip("no python3.9")
    (tmp_path / "try.py").write_text(f"""
import hexad, sys
assert sys.version_info[:2] == (3, 9)
spec = {{"surface": {{"analytic": {{"shape": "sphere", "radius": 1}}}}, "sampling": {{"count": 60}}, "output": {{"preview": False}}}}
with hexad.Local({str(build / "hexad-worker")!r}) as local:
    for where in (hexad.Client({client.service.address!r}), local):
        job = where.submit(spec, wait=True)
        assert list(job.events())[-1].is_end and job.points().count == 60 == job.report()["count"]
        assert len(job.fetch("out." + type(where).__name__)) == 2
        try:
            where.submit({{"surface": {{}}}})
        except hexad.Problem as problem:
            assert problem.code == "spec_invalid" and problem.errors
        else:
            sys.exit("a bad spec was taken")
""")
    done = subprocess.run([old, "try.py"], cwd=tmp_path, env={"PYTHONPATH": str(PACKAGE), "PATH": "/usr/bin:/bin"},
                          capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr


MISTAKES = """
import hexad
from hexad import spec

good: spec.Spec = {"surface": {"union": [{"analytic": {"shape": "sphere", "radius": 1}}, {"vdb": {"path": "a.vdb"}}]},
                   "sampling": {"count": 100}, "queue": {"by_frame": {"/solver/seed": {"from": 1, "to": 2}}}}
hexad.Client().submit(good)
bad1: spec.Spec = {"surface": {"union": [{"analytic": {"shape": "sphere", "radius": "1"}}]}, "sampling": {}}  # wrong
bad2: spec.Spec = {"surface": {"vdb": {"path": "a.vdb"}}, "sampling": {"cuont": 100}}  # wrong
bad3 = spec.Sampling(count=1.5)  # wrong
bad4 = spec.Solver(method="newton")  # wrong
bad5 = spec.SurfaceMesh(resolution=64)  # wrong
ball = hexad.sample("a.obj", count=10, curvature={"ratio": 4}, holes="fill", features={"angle": 0.5}, region={"min": [0, 0, 0]})
hexad.sample_many(["a.obj"], 10, pattern="blue_noise", seed=3, points={"path": [[0, 0, 0]], "mode": "keep"})
bad7 = hexad.sample("a.obj", cuont=10)  # wrong
bad8 = hexad.sample("a.obj", count=10, pattern="blue noise")  # wrong
bad9 = hexad.sample_many(["a.obj"], 10, isovalue="0.5")  # wrong
bad10: int = ball.outcome  # wrong
bad11 = hexad.sample_many(["a.obj"], 10, mesh=True)  # wrong
bad6: str = hexad.Client().submit(good).points().count  # wrong
"""


@pytest.mark.extended
def test_the_types_are_strict_and_find_mistakes(source, tmp_path):
    pytest.importorskip("mypy", reason="no python3-mypy")
    mypy = [sys.executable, "-m", "mypy", "--config-file", PACKAGE / "pyproject.toml", "--cache-dir", tmp_path / "cache"]
    (tmp_path / "mistakes.py").write_text(MISTAKES)
    done = subprocess.run([*mypy, "hexad", "generate.py", tmp_path / "mistakes.py"], cwd=PACKAGE, capture_output=True,
                          text=True, timeout=PATIENCE_S)
    found = {int(line.split(":")[1]) for line in done.stdout.splitlines() if "mistakes.py" in line and "error" in line}
    assert found == {i for i, line in enumerate(MISTAKES.splitlines(), 1) if line.endswith("# wrong")}, done.stdout
    assert done.stdout.count("error:") == len(found) and "in 1 file (checked" in done.stdout, done.stdout


def test_what_is_generated_is_current(build, tmp_path):
    subprocess.run([sys.executable, PACKAGE / "generate.py", build, tmp_path], check=True, timeout=PATIENCE_S)
    for name in ("spec.py", "problems.py"):
        assert (tmp_path / name).read_text() == (PACKAGE / "hexad" / name).read_text(), "run make python-client"


CUBE = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
CUBE_FACES = [tuple(int(corner) - 1 for corner in line.split()[1:]) for line in CUBE_OBJ.splitlines() if line[0] == "f"]


@pytest.fixture
def submitter(request, monkeypatch):
    """The part of a submitter (share/) that needs no other program."""
    folder, name = request.param
    monkeypatch.syspath_prepend(str(PACKAGE.parents[1] / "share" / folder))
    yield importlib.import_module(name)
    del sys.modules[name]


SUBMITTERS = pytest.mark.parametrize("submitter, label", [
    (("blender/hexad_sampler", "submission"), "blender"), (("houdini", "hexad_sampler"), "houdini")], indirect=["submitter"])


@SUBMITTERS
def test_a_submitter_samples_a_mesh_of_its_program(client, submitter, label):
    job = submitter.submit(client, "a cube", CUBE, CUBE_FACES, 150).wait()
    points = job.points()
    assert (job.name, job.document["labels"], points.count) == ("a cube", [label], 150)
    assert {"blender": "radius", "houdini": "pscale"}[label] in points
    for place, normal in zip(points.positions, points.normals):  # on the cube, and outwards
        assert abs(max(map(abs, place)) - 1) < 1e-6 and sum(p * n for p, n in zip(place, normal)) > 0


@pytest.mark.parametrize("submitter", [("houdini", "hexad_sampler")], indirect=True)
def test_a_submitter_cancels_its_job_when_it_is_interrupted(socket_service, tmp_path, submitter):
    class Interrupted(Exception):
        pass

    def interrupt(fraction):
        raise Interrupted

    client = hexad.Client(socket_service().address)
    job = client.submit(long_sphere())
    with pytest.raises(Interrupted):
        submitter.follow(job, interrupt)
    assert job.wait(check=False).state == "cancelled"


def test_the_submitters_have_the_syntax_of_their_programs():
    """Blender 3.4 has Python 3.10, Houdini 19.5 has 3.9."""
    share = PACKAGE.parents[1] / "share"
    found = sorted([*share.rglob("hexad_sampler.py"), *(share / "blender/hexad_sampler").glob("*.py")])
    assert len(found) == 3
    for path in found:
        ast.parse(path.read_text(), feature_version=(3, 9))


def section_of(text, heading):
    """A section of a page, with the sections below it; without a heading the whole page."""
    return re.search(rf"^## {heading}\n.*?(?=^## |\Z)", text, re.M | re.S)[0] if heading else text


@pytest.mark.parametrize("page, heading", [("doc/clients.md", "Python"), ("doc/library.md", None), ("clients/python/README.md", None),
                                           pytest.param("doc/clients.md", "Examples of the function", marks=pytest.mark.extended)])
def test_the_examples_of_the_pages(client, build, source, tmp_path, monkeypatch, page, heading):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HEXAD_SERVER", client.service.address)
    monkeypatch.setenv("HEXAD_WORKER", str(build / "hexad-worker"))
    monkeypatch.setenv("HEXAD_LIBRARY", str(build / "libhexad.so.1"))
    monkeypatch.setenv("MPLBACKEND", "Agg")
    has_pictures = heading == "Examples of the function"
    if has_pictures:
        pytest.importorskip("matplotlib", reason="no python3-matplotlib")
        pytest.importorskip("vtkmodules", reason="no python3-vtk9")
    (tmp_path / "cube.obj").write_text(CUBE_OBJ)
    (tmp_path / "examples.md").write_text(section_of((source / page).read_text(), heading))
    failed, tried = doctest.testfile(str(tmp_path / "examples.md"), module_relative=False, optionflags=doctest.ELLIPSIS)
    assert failed == 0 and tried >= 3
    if has_pictures:
        for name in ("points.png", "mesh.png"):
            values = b"".join(map(bytes, read_png((tmp_path / name).read_bytes())[2]))
            assert 0.02 < 1 - values.count(255) / len(values) < 0.5, name  # on white
        assert "NumberOfPoints=\"2000\"" in (tmp_path / "points.vtp").read_bytes()[:1000].decode("latin-1")


def test_a_fault_that_the_service_finds_is_a_warning(client, monkeypatch):
    spec = {"surface": {"analytic": {"shape": "sphere", "radius": 1}}, "sampling": {"count": 100}}
    fault = hexad.Problem(422, {"code": "grid_missing", "detail": "there is no grid x"})
    monkeypatch.setattr(client, "fault_of", lambda asked: fault if asked is spec else None)
    with pytest.warns(hexad.FaultWarning, match="when it runs: grid_missing: there is no grid x"):
        client.submit(spec)
    monkeypatch.undo()
    assert client.fault_of(spec) is None


def test_https_at_a_port_without_tls_is_explained(service):
    with pytest.raises(hexad.HexadError, match=f"this port does not use TLS: write http://{service.address}"):
        hexad.Client(f"https://{service.address}", patience=0).job("x")


def test_a_socket_that_may_not_be_opened_is_explained(monkeypatch, tmp_path):
    """Root may open every socket, so the refusal is simulated."""
    def refuse(self):
        raise PermissionError(13, "Permission denied")
    monkeypatch.setattr("hexad.transport.UnixConnection.connect", refuse)
    with pytest.raises(hexad.HexadError, match="may not connect: as root type hexad --allow"):
        hexad.Client(f"unix:{tmp_path}/socket", patience=0).job("x")
