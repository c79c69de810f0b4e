# SPDX-License-Identifier: Apache-2.0
"""Data sets: jobs with one frame for each file (queue.files)."""
import hashlib
import json
import os
import pathlib
import signal
import sqlite3
import subprocess
import sys
import warnings

import numpy
import pytest

from accounts import new_token, with_token
from service import OPEN_TCP, PATIENCE_S, expect_problem, gated_worker, wait_until
from slurm_farm import needs_slurm

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent.parent / "clients" / "python"))
import hexad  # noqa: E402

TETRAHEDRON = "OFF\n4 4 0\n{0} {0} {0}\n{0} -{0} -{0}\n-{0} {0} -{0}\n-{0} -{0} {0}\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


def write(path, size=1):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(TETRAHEDRON.format(size))
    return path


@pytest.fixture
def root(tmp_path):
    """A directory of meshes of the sizes 1, 2 and 3, with entries that are no files of a data set."""
    for size, name in enumerate(("b.off", "a.off", "Z é.off"), 1):
        write(tmp_path / "root" / "meshes" / name, size)
    write(tmp_path / "root" / "meshes" / ".hidden.off")
    write(tmp_path / "root" / "meshes" / "deeper.off" / "c.off")
    write(tmp_path / "root" / "meshes" / "a.off.bak")
    return tmp_path / "root"


def data_set(files, path="{file}", **queue):
    return {"version": 1, "surface": {"mesh": {"path": str(path)}}, "sampling": {"count": 40},
            "output": {"preview": False}, "queue": {"files": files, **queue}}


def client_of(service):
    return hexad.Client(f"http://{service.address}")


def files_of(service, job):
    return [(t["frame"], t["file"]) for t in service.get(f"/v1/jobs/{job}/tasks?limit=500").json["tasks"]]


def report(service, job, frame):
    return service.get(f"/v1/jobs/{job}/results/report.json?frame={frame}").json


SORTED = ["meshes/Z é.off", "meshes/a.off", "meshes/b.off"]


def test_a_pattern_is_the_files_at_the_submission(new_service, root):
    (root / "meshes" / "linked.off").symlink_to(root / "meshes" / "a.off")
    (root / "meshes" / "leads_out.off").symlink_to("/etc/hostname")
    service = new_service("--input_roots", root).start()
    job = service.submit(data_set("meshes/*.off"))
    write(root / "meshes" / "later.off")
    done = service.wait_state(job, "succeeded")
    names = [*SORTED, "meshes/linked.off"]
    assert files_of(service, job) == list(enumerate(names)) and done["tasks"]["all"] == 4
    assert done["spec"]["queue"]["files"] == "meshes/*.off" and done["spec"]["surface"]["mesh"]["path"] == "{file}"
    assert done["array"] and done["input"] == "*.off"
    for frame, size in enumerate((3, 2, 1, 2)):
        made = report(service, job, frame)
        assert made["spec"]["queue"]["files"] == [names[frame]]  # and no other name
        assert [i["path"] for i in made["inputs"]] == [names[frame]]
        # the edges of a tetrahedron with corners at +-s are 2 sqrt(2) s long, and its area is sqrt(3) times their square
        assert made["surface"]["area"] == pytest.approx(3 ** 0.5 * 8 * size ** 2, rel=1e-6)


@pytest.mark.parametrize("files, path, names", [
    ("*.off", "meshes/{file}", ["Z é.off", "a.off", "b.off"]),
    ("*", "meshes/{file}.off", ["Z é", "a", "b"]),
    ("a*f", "meshes/{file}", ["a.off"]),
    ("*a.*f", "meshes/{file}", ["a.off"]),
    ("meshes/d*", "{file}/c.off", ["meshes/deeper.off"])])
def test_a_name_is_what_the_place_stands_for(new_service, root, files, path, names):
    service = new_service("--input_roots", root).start()
    for where in (path, path if path.startswith("{") else root / path):
        job = service.submit(data_set(files, where))
        service.wait_state(job, "succeeded")
        assert files_of(service, job) == list(enumerate(names))


def test_a_pattern_with_a_name_that_is_not_utf_8_is_refused(new_service, root):
    """Such a name cannot be in a spec. Other patterns, and lists of names in the directory, are not affected."""
    service = new_service("--input_roots", root).start()
    (root / "meshes" / os.fsdecode(b"caf\xe9.off")).write_text("")
    refused = service.post("/v1/jobs", data_set("meshes/*.off"))
    expect_problem(refused, 422, "input_unsupported", "/queue/files")
    assert refused.json["detail"] == "the name of the file meshes/caf\\x{e9}.off is not UTF-8: rename the file"
    assert service.post("/v1/jobs", data_set("meshes/a*.off")).status == 201
    listed = [f["name"] for f in service.get(f"/v1/files?path={root}/meshes").json["files"]]
    assert "a.off" in listed and not [name for name in listed if name.startswith("caf")]


def test_a_pattern_outside_the_roots_is_shown_as_it_was_written(new_service, root, tmp_path):
    service = new_service("--input_roots", root).start()
    for files, path in ((f"{tmp_path}/*.off", "{file}"), ("*.off", f"{tmp_path}/{{file}}"), ("/*.off", "{file}"), (f"{root}/none/*.off", "{file}")):
        refused = service.post("/v1/jobs", data_set(files, path)).json
        assert str(tmp_path if "*" not in files[:2] else "/") in refused["detail"] and "//" not in refused["detail"], refused["detail"]
    frames = {**data_set("x", f"{tmp_path}/a.####.off"), "queue": {"frames": "all"}}
    refused = service.post("/v1/jobs", frames).json
    assert f"{tmp_path}/ is outside the input roots" in refused["detail"]


def test_a_list_has_its_own_order_and_a_missing_file_fails_alone(new_service, root):
    service = new_service("--input_roots", root).start()
    job = service.submit(data_set(["meshes/b.off", "meshes/none.off", "meshes/a.off"]))
    done = service.wait_state(job, "failed")
    assert files_of(service, job) == [(0, "meshes/b.off"), (1, "meshes/none.off"), (2, "meshes/a.off")]
    states = [t["state"] for t in service.get(f"/v1/jobs/{job}/tasks").json["tasks"]]
    assert states == ["succeeded", "failed", "succeeded"]
    assert done["error"]["message"].startswith("1 of 3 frames failed; frame 1 (meshes/none.off): "), done["error"]
    assert "files" not in done["spec"]["queue"]
    write(root / "meshes" / "none.off")
    assert service.post(f"/v1/jobs/{job}/retry").status == 200
    service.wait_state(job, "succeeded")
    assert report(service, job, 1)["spec"]["queue"]["files"] == ["meshes/none.off"]


def test_faults_name_their_place(new_service, root):
    (root / "few").mkdir()
    service = new_service("--input_roots", root, "--max_files", 3).start()

    def refused(spec, code, pointer="/queue/files"):
        reply = service.post("/v1/jobs", spec)
        assert reply.json["code"] == code and reply.json["errors"][0]["pointer"] == pointer, reply.body
        return reply.json["detail"]

    for other in ({"frames": "1-2"}, {"frames": "1-2", "by_frame": {"/solver/seed": [1, 2]}}, {"coherent": True},
                  {"after_frames": ["01ARZ3NDEKTSV4RRFFQ69G5FAV"]}):
        assert "excludes queue." in refused(data_set(["meshes/a.off"], **other), "spec_invalid")
    assert "all frames are equal" in refused(data_set(["meshes/a.off"], "meshes/a.off"), "spec_invalid")
    assert "only one input path" in refused({**data_set(["meshes/a.off"]), "attributes": [{"from": "{file}", "name": "c"}]},
                                            "spec_invalid")
    alone = data_set(["meshes/a.off"])
    del alone["queue"]["files"]
    assert "is required, because /surface/mesh/path has {file}" in refused(alone, "spec_invalid")
    directory = {**data_set(["meshes/a.off"]), "output": {"directory": "/srv/out"}}
    assert "overwrite each other" in refused(directory, "spec_invalid")
    for wrong in ("meshes/a.off", "mesh*/a.off", "", [], [""], [1], 7, ["x" * 4097]):
        place = "/queue/files/0" if isinstance(wrong, list) and wrong else "/queue/files"
        refused(data_set(wrong), "spec_invalid", place)
    assert "setting max_files" in refused(data_set(["meshes/a.off"] * 4), "spec_invalid")
    write(root / "meshes" / "d.off")
    assert "more than 3 files match meshes/*.off" in refused(data_set("meshes/*.off"), "spec_invalid")
    assert "no file below the input roots matches few/*.off" in refused(data_set("few/*.off"), "input_missing")
    refused(data_set("/etc/*.off"), "path_forbidden")
    refused(data_set("../*.off"), "input_missing")
    refused(data_set(["/etc/hostname"]), "path_forbidden", "/surface/mesh/path")
    assert service.post("/v1/jobs:validate", data_set("meshes/a*")).json["spec"]["queue"]["files"] == "meshes/a*"


def test_the_worker_alone_takes_a_list(build, root):
    def run(files, frame=None):
        words = [build / "hexad-worker", "run", "-", "--output", root / "out", *(["--frame", str(frame)] if frame is not None else [])]
        return subprocess.run(words, input=json.dumps(data_set(files)), text=True, capture_output=True, timeout=PATIENCE_S, cwd=root)

    done = run(["meshes/a.off", "meshes/b.off"], 1)
    assert done.returncode in (0, 10, 11), done.stderr
    assert json.loads((root / "out" / "report.json").read_text())["inputs"][0]["path"] == "meshes/b.off"
    for files, frame, why in ((["meshes/a.off", "meshes/b.off"], 2, "data set of 2 files"),
                              (["meshes/a.off"], None, "data set of 1 files"), ("meshes/*", 0, "only the service finds")):
        assert run(files, frame).returncode == 2 and why in run(files, frame).stderr


@pytest.mark.sanitized
def test_nothing_is_lost_after_kill_9(new_service, root, tmp_path):
    worker = gated_worker(tmp_path)
    worker.write_text(worker.read_text().replace("spec=$(cat)", 'cat >"$4/spec"'))
    service = new_service("--input_roots", root, "--worker", worker, base=tmp_path).start()
    spec, key = data_set("meshes/*.off", max_running=1), {"Idempotency-Key": "k", "Content-Type": "application/json"}
    job = service.request("POST", "/v1/jobs", json.dumps(spec), key).json["id"]
    service.wait_worker(job)
    service.end(signal.SIGKILL)
    (root / "meshes" / "a.off").unlink()
    write(root / "meshes" / "0.off")
    service.start()
    assert files_of(service, job) == list(enumerate(SORTED))
    again = service.request("POST", "/v1/jobs", json.dumps(spec), key)
    assert again.status == 201 and again.json["id"] == job
    for frame in range(3):
        service.open_gate(f"{job}.{frame}")
    service.wait_state(job, "succeeded")
    for frame, name in enumerate(SORTED):
        given = json.loads((service.state / "results" / f"{job}.{frame}" / "spec").read_text())
        assert given["queue"]["files"] == [name]


def test_names_come_back_from_reports_if_the_database_is_lost(new_service, root):
    service = new_service("--input_roots", root).start()
    job = service.submit(data_set("meshes/*.off"))
    service.wait_state(job, "succeeded")
    service.end()
    for path in service.state.glob("queue.db*"):
        path.unlink()
    service.start("--adopt")
    service.end()  # only an administrator may read an adopted job
    with sqlite3.connect(service.state / "queue.db") as database:
        assert database.execute("SELECT frame, file FROM task ORDER BY number").fetchall() == list(enumerate(SORTED))
        (spec,), = database.execute("SELECT spec FROM spec").fetchall()
        assert "files" not in json.loads(spec)["queue"]


def test_uploads_belong_to_their_sender(new_service, root, tmp_path):
    service = new_service("--input_roots", root)
    service.options = [o for o in service.options if o not in ("--tcp_without_tokens", OPEN_TCP)]
    service.state.mkdir(mode=0o700)
    tokens = {user: new_token(service, user) for user in ("alice", "bob")}
    service.start()
    names = []
    for size in (4, 5):
        data = TETRAHEDRON.format(size).encode()
        names.append(f"sha256:{hashlib.sha256(data).hexdigest()}.off")
        sent = service.request("PUT", f"/v1/inputs/{names[-1][7:71]}", data,
                               {"Authorization": f"Bearer {tokens['alice']}", "Content-Type": "application/octet-stream"})
        assert sent.status == 201, sent.body

    def post(user, spec):
        return with_token(service, tokens[user], "POST", "/v1/jobs", spec)

    refused = post("bob", data_set(names))
    assert refused.json["code"] == "input_missing" and refused.json["errors"][0]["pointer"] == "/queue/files/0", refused.body
    beside = post("alice", data_set(names, "meshes/{file}"))
    assert beside.json["code"] == "spec_invalid" and "no path" in beside.json["detail"], beside.body
    job = post("alice", data_set([*names, "meshes/a.off"])).json["id"]

    def ask(path):
        return with_token(service, tokens["alice"], "GET", path).json

    wait_until(lambda: ask(f"/v1/jobs/{job}")["state"] == "succeeded", "its end")
    assert [t["file"] for t in ask(f"/v1/jobs/{job}/tasks")["tasks"]] == [*names, "meshes/a.off"]
    areas = [ask(f"/v1/jobs/{job}/results/report.json?frame={frame}")["surface"]["area"] for frame in range(3)]
    assert areas == pytest.approx([3 ** 0.5 * 8 * size ** 2 for size in (4, 5, 2)], rel=1e-6)


def test_a_worker_may_read_its_own_upload_only(new_service, tmp_path):
    """The command line of a worker names the files that it may read."""
    worker = gated_worker(tmp_path)
    worker.write_text(worker.read_text().replace("spec=$(cat)", 'cat >"$4/spec"; printf "%s\\n" "$@" >"$4/words"'))
    service = new_service("--worker", worker, base=tmp_path).start()
    names = []
    for size in range(1, 4):
        data = TETRAHEDRON.format(size).encode()
        names.append(f"sha256:{hashlib.sha256(data).hexdigest()}")
        assert service.request("PUT", f"/v1/inputs/{names[-1][7:]}", data,
                               {"Content-Type": "application/octet-stream"}).status == 201
    job = service.submit(data_set([f"{name}.off" for name in names]))
    for frame in range(3):
        service.open_gate(f"{job}.{frame}")
    service.wait_state(job, "succeeded")
    for frame, name in enumerate(names):
        words = (service.state / "results" / f"{job}.{frame}" / "words").read_text().splitlines()
        assert [pathlib.Path(w).name for w in words if "sha256:" in w] == [name]


@pytest.mark.extended
@needs_slurm
def test_nodes_of_a_farm_get_their_own_names(slurm, new_farm, root):
    service = new_farm("--input_roots", root)
    job = service.submit(data_set("meshes/*.off"))
    service.wait_state(job, "succeeded")
    assert [report(service, job, frame)["spec"]["queue"]["files"] for frame in range(3)] == [[name] for name in SORTED]


@pytest.mark.extended
def test_100000_names_do_not_hold_other_requests(new_service, tmp_path):
    """The directory is listed by a thread of the pool; the stored spec and each attempt stay short."""
    root = tmp_path / "root"
    root.mkdir()
    for number in range(100000):
        os.close(os.open(root / f"{number:06d}.off", os.O_CREAT | os.O_WRONLY))
    write(root / "000000.off")
    service = new_service("--input_roots", root, "--worker", gated_worker(tmp_path), base=tmp_path).start()
    job = service.submit(data_set("*.off"))
    assert service.job(job)["tasks"]["all"] == 100000 and len(json.dumps(service.job(job)["spec"])) < 10000
    last = service.get(f"/v1/jobs/{job}/tasks?after=99998").json["tasks"]
    assert [(t["frame"], t["file"]) for t in last] == [(99999, "099999.off")]
    service.end(signal.SIGKILL)
    service.start()
    assert service.get(f"/v1/jobs/{job}/tasks?after=99998").json["tasks"][0]["file"] == "099999.off"
    write(root / "100000.off")
    expect_problem(service.post("/v1/jobs", data_set("*.off")), 422, "spec_invalid", "/queue/files")


def test_hexadctl_submits_a_pattern_and_a_stack_has_the_points(new_service, build, root, tmp_path):
    service = new_service("--input_roots", root).start()
    (tmp_path / "spec.json").write_text(json.dumps({**data_set("other/*"), "queue": {}}))

    def hexadctl(*words):
        return subprocess.run([build / "hexadctl", *map(str, words)], env=service.environment(), text=True,
                              capture_output=True, timeout=PATIENCE_S)

    job = hexadctl("submit", tmp_path / "spec.json", "--files", "meshes/*.off", "--wait").stdout.split()[0]
    assert files_of(service, job) == list(enumerate(SORTED))
    stack = client_of(service).job(job).stack()
    assert stack.positions.shape == stack.normals.shape == (3, 40, 3)
    assert stack.names == SORTED and stack.missing == [] and stack.frames == [0, 1, 2]
    # points of a tetrahedron with corners at +-s: one face of four is the plane x + y + z = -s or one of its mirror images
    for row, size in zip(stack.positions, (3, 2, 1)):
        planes = numpy.array([(1, 1, -1), (1, -1, 1), (-1, 1, 1), (-1, -1, -1)])
        assert numpy.abs((row @ planes.T).max(axis=1) - size).max() < 1e-5 * size
    assert all(stack[name].shape == (3, 40) for name in stack)
    partly = service.submit(data_set(["meshes/a.off", "meshes/none.off", "meshes/b.off"]))
    service.wait_state(partly, "failed")
    assert "1 (meshes/none.off)" in hexadctl("show", partly).stdout
    made = hexadctl("fetch", partly, "--output", tmp_path / "partly")
    assert made.returncode == 4 and "frame 1 (meshes/none.off) has no results" in made.stderr, made.stderr
    stack = client_of(service).job(partly).stack()
    assert stack.positions.shape == (2, 40, 3) and stack.frames == [0, 2]
    assert stack.names == ["meshes/a.off", "meshes/b.off"] and stack.missing == ["meshes/none.off"]


@pytest.mark.parametrize("radii, differ", [((0.3, 0.6), True), ((0.3, 0.3), False)])
def test_a_stack_warns_if_rows_are_not_the_same_points(new_service, radii, differ):
    service = new_service().start()
    spec = {"version": 1, "surface": {"analytic": {"shape": "torus", "major_radius": 1, "minor_radius": 0.3}}, "sampling": {"count": 300},
            "output": {"preview": False, "order": "id"},
            "queue": {"frames": "1-2", "coherent": True, "by_frame": {"/surface/analytic/minor_radius": list(radii)}}}
    job = service.submit(spec)
    service.wait_state(job, "succeeded")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        stack = client_of(service).job(job).stack()
    assert (stack["id"][0] != stack["id"][1]).any() == differ
    assert [w.category for w in caught] == [hexad.RowWarning] * differ


def test_unequal_numbers_of_points_name_their_files(new_service, root):
    service = new_service("--input_roots", root).start()
    spec = {**data_set(["meshes/b.off", "meshes/a.off"]), "sampling": {"spacing": 0.5}}
    job = service.submit(spec)
    service.wait_state(job, "succeeded")
    words = str(pytest.raises(ValueError, client_of(service).job(job).stack).value)
    assert "meshes/a.off has " in words and ", and meshes/b.off has " in words and "equal numbers" in words


def test_local_jobs_take_lists(build, root):
    with hexad.Local(worker=build / "hexad-worker") as local:
        spec = data_set([str(root / "meshes" / "a.off"), str(root / "meshes" / "none.off"), str(root / "meshes" / "b.off")])
        job = local.submit(spec).wait(check=False)
        stack = job.stack()
        assert stack.positions.shape == (2, 40, 3) and [pathlib.Path(n).name for n in stack.names] == ["a.off", "b.off"]
        assert [pathlib.Path(n).name for n in stack.missing] == ["none.off"]
        with pytest.raises(ValueError, match="only a service"):
            local.submit(data_set("meshes/*.off"))
