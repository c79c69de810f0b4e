# SPDX-License-Identifier: Apache-2.0
"""hexadctl and arrays, files and many jobs at once."""
import hashlib
import json
import re
import shutil
import subprocess

import pytest

from service import PARTLY_UNRESOLVED, PATIENCE_S, Service, gated_worker, sphere, wait_until

FRAMES = (8, 9, 11)


@pytest.fixture(scope="module")
def footage(build, tmp_path_factory):
    """A directory with the frames 8, 9 and 11 of a level set."""
    where = tmp_path_factory.mktemp("footage")
    subprocess.run([build / "hexad-worker", "make-example", where / "a.0008.vdb"], check=True, timeout=PATIENCE_S)
    for frame in FRAMES[1:]:
        shutil.copy(where / "a.0008.vdb", where / f"a.{frame:04d}.vdb")
    return where


@pytest.fixture(scope="module")
def module_service(build, footage, tmp_path_factory):
    made = Service(build, tmp_path_factory.mktemp("service"), "--input_roots", footage)
    yield made.start()
    made.clean_up()


@pytest.fixture
def service(clean_service):
    """One daemon for the tests of this file, without jobs of other tests."""
    return clean_service


@pytest.fixture(scope="module")
def finished(build, footage, tmp_path_factory):
    """Another daemon. The frames 8, 9 and 11 of the job `array` succeeded; frame 10 of the job `failed` failed."""
    made = Service(build, tmp_path_factory.mktemp("finished"), "--input_roots", footage).start()
    try:
        made.array = made.submit(sequence(footage, "8-9,11"))
        made.failed = made.submit(sequence(footage, "9-10"))
        made.wait_state(made.array, "succeeded")
        made.wait_state(made.failed, "failed")
        yield made
    finally:
        made.clean_up()


def runner(service, build, tmp_path):
    def call(*words, **more):
        return subprocess.run([build / "hexadctl", *map(str, words)], capture_output=True, text=True,
                              timeout=PATIENCE_S, env=service.environment(), cwd=tmp_path, **more)
    return call


@pytest.fixture
def run(service, build, tmp_path):
    return runner(service, build, tmp_path)


@pytest.fixture
def run_finished(finished, build, tmp_path):
    return runner(finished, build, tmp_path)


def sequence(footage, frames, **queue):
    return {"version": 1, "surface": {"vdb": {"path": str(footage / "a.####.vdb")}}, "sampling": {"count": 100},
            "output": {"preview": False, "points_usda": True}, "queue": {"frames": frames, **queue}}


def check_frame(service, job, frame, directory):
    listed = service.get(f"/v1/jobs/{job}/results?frame={frame}").json["results"]
    def place_of(name):  # the stage of all frames is above them
        return (directory.parent if name == "points_stage.usda" else directory) / name

    assert sorted(directory.iterdir()) == sorted(p for p in (place_of(r["name"]) for r in listed) if p.parent == directory)
    for r in listed:
        assert hashlib.sha256(place_of(r["name"]).read_bytes()).hexdigest() == r["sha256"]


def test_all_frames_are_fetched(run_finished, finished, tmp_path):
    run, service, job = run_finished, finished, finished.array
    done = run("fetch", job, "--output", "out")
    assert done.returncode == 0 and "3 of 3 frames" in done.stderr, done.stderr
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["11", "8", "9", "points_stage.usda"]
    for frame in FRAMES:
        check_frame(service, job, frame, tmp_path / "out" / str(frame))
        assert f"out/{frame}/report.json" in done.stdout
    # the stage of the sequence finds the frames' files where they are now
    for where, name in ((tmp_path / "out/8", "points_sequence.usda"), (tmp_path / "out", "points_stage.usda")):
        clips = re.findall("@([^@]*)@", re.search(r"assetPaths = \[(.*)\]", (where / name).read_text())[1])
        assert [(where / clip).resolve().parent.name for clip in clips] == ["8", "9", "11"]
        assert all((where / clip).is_file() for clip in clips)


@pytest.mark.sanitized
def test_a_fetch_goes_on_where_it_stopped(run_finished, finished, tmp_path):
    run, service, job = run_finished, finished, finished.array
    assert run("fetch", job, "--output", "out").returncode == 0
    kept = (tmp_path / "out/8/points.ply").stat()
    (tmp_path / "out/9/points.ply").write_bytes(b"cut off")
    shutil.rmtree(tmp_path / "out/11")
    assert run("fetch", job, "--output", "out").returncode == 0
    for frame in FRAMES:
        check_frame(service, job, frame, tmp_path / "out" / str(frame))
    now = (tmp_path / "out/8/points.ply").stat()
    assert (now.st_ino, now.st_mtime_ns) == (kept.st_ino, kept.st_mtime_ns)  # it was not downloaded again


def test_some_frames_are_fetched(run_finished, finished, tmp_path):
    run, service, job = run_finished, finished, finished.array
    done = run("fetch", job, "--frame", "9-11x2", "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert (told["fetched"], told["all"]) == (2, 2) and [f["frame"] for f in told["frames"]] == [9, 11]
    assert sorted(p.name for p in (tmp_path / job).iterdir()) == ["11", "9"]
    done = run("fetch", job, "--frame", "9-10")
    assert done.returncode == 4 and "1 of 2 frames" in done.stderr
    assert run("fetch", job, "--frame", "9-").returncode == 2
    single = service.submit(sphere())
    service.wait_state(single, "succeeded")
    assert run("fetch", single, "--frame", "1").returncode == 2


@pytest.mark.sanitized
def test_all_jobs_with_a_label_are_fetched(run, service, tmp_path):
    def submit(name, label="shot=010", radius=1.0, **queue):
        job = service.submit(sphere(count=100, name=name, queue={"labels": [label], **queue},
                                    surface={"analytic": {"shape": "sphere", "radius": radius}}))
        service.wait_state(job, "succeeded")
        return job

    ball, first, second, slash = submit("ball"), submit("twice"), submit("twice", radius=2.0), submit("a/b")
    frames = submit("frames", frames="1-2", by_frame={"/surface/analytic/radius": [1, 1.1]})
    submit("other", label="shot=020")
    done = run("fetch", "--label", "shot=010")
    assert done.returncode == 0 and "5 of 5 jobs are fetched to shot=010\n" in done.stderr, done.stderr
    # by name, or by id if the name is that of several jobs or is no name of a file
    where = tmp_path / "shot=010"
    assert {path.name for path in where.iterdir()} == {"ball", first, second, slash, "frames"}
    assert {path.name for path in (where / "frames").iterdir()} == {"1", "2"}
    for job, name in ((ball, "ball"), (first, first), (second, second), (slash, slash)):
        for listed in service.get(f"/v1/jobs/{job}/results").json["results"]:
            assert hashlib.sha256((where / name / listed["name"]).read_bytes()).hexdigest() == listed["sha256"]
    # with --json, one document
    done = run("fetch", "--label", "shot=010", "--json", "--output", "deep/er")
    told = json.loads(done.stdout)
    assert done.returncode == 0
    assert {entry["job"]: entry["directory"] for entry in told["jobs"]} == {
        ball: "deep/er/ball", first: f"deep/er/{first}", second: f"deep/er/{second}", slash: f"deep/er/{slash}", frames: "deep/er/frames"}
    for words in (("fetch",), ("fetch", ball, "--label", "x"), ("fetch", ball, "--owner", "x"), ("fetch", "--label", "x", "--frame", "1"),
                  ("fetch", "--label", "a/b")):
        assert run(*words).returncode == 2, words
    done = run("fetch", "--label", "none")
    assert done.returncode == 4 and "no jobs with the label none" in done.stderr
    assert not (tmp_path / "none").exists()


def test_a_job_with_a_label_that_has_no_results_is_named(new_service, build, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path), "--workers", 1).start()
    run = runner(service, build, tmp_path)
    first, second, cancelled = (service.submit(sphere(count=100, name=name, queue={"labels": ["x"]})) for name in ("first", "second", "third"))
    service.open_gate(first)
    service.wait_state(first, "succeeded")
    service.post(f"/v1/jobs/{cancelled}/cancel")
    done = run("fetch", "--label", "x")
    assert done.returncode == 4 and "1 of 3 jobs are fetched to x\n" in done.stderr, done.stderr
    assert re.search(f"{second} second has not ended: (running|queued). Fetch again later\n", done.stderr), done.stderr
    assert f"{cancelled} third has no results: cancelled" in done.stderr
    assert [path.name for path in (tmp_path / "x").iterdir()] == ["first"]
    service.open_gate(second)
    service.wait_state(second, "succeeded")


@pytest.mark.sanitized
def test_frames_that_are_not_there_yet_or_never(finished, build, tmp_path):
    service, job = finished, finished.failed
    words = [build / "hexadctl", "fetch", job]
    done = subprocess.run(words, env=service.environment(), cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 4 and "1 of 2 frames" in done.stderr
    assert "frame 10 has no results: failed: " in done.stderr and "a.0010.vdb" in done.stderr
    words[1] = "show"
    shown = subprocess.run(words, env=service.environment(), capture_output=True, text=True, timeout=PATIENCE_S).stdout
    failures = shown[shown.index("FRAME  STATE"):].splitlines()
    assert failures[1].split()[:2] == ["10", "failed"] and "a.0010.vdb" in failures[1]
    assert len(failures) == 3 and failures[2].startswith("frame 9: converged, ")  # of few points


@pytest.mark.sanitized
def test_the_log_of_a_frame(run_finished, finished):
    run, service, job = run_finished, finished, finished.failed
    done = run("log", job, "--frame", "10")
    assert done.returncode == 0 and "a.0010.vdb" in done.stdout
    last = service.get(f"/v1/jobs/{job}/tasks?after=0&limit=1").json["tasks"][0]["attempt"]
    assert run("log", job, "--frame", "10", "--attempt", last).stdout == done.stdout
    assert "a.0009.vdb" not in done.stdout
    done = run("log", job)
    assert done.returncode == 2 and "--frame" in done.stderr  # of which frame?
    lost = run("log", job, "--frame", "12")
    assert lost.returncode == 4 and f"the job {job} has no frame 12" in lost.stderr
    assert run("log", job, "--frame", "10", "--attempt", last + 1).returncode == 4


def test_a_wait_tells_how_many_frames_have_ended(new_service, build, footage, tmp_path):
    service = new_service("--input_roots", footage, "--worker", gated_worker(tmp_path), "--workers", 1).start()
    job = service.submit(sequence(footage, "8-9"))
    service.wait_worker(job)
    waiting = subprocess.Popen([build / "hexadctl", "wait", job], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                               env=service.environment(), text=True)
    assert "0 of 2 frames" in waiting.stderr.readline()
    service.open_gate(f"{job}.8")
    assert "1 of 2 frames" in waiting.stderr.readline()
    service.open_gate(f"{job}.9")
    out, _ = waiting.communicate(timeout=PATIENCE_S)
    assert waiting.returncode == 0 and out.startswith(f"{job} succeeded")


def test_a_pause_says_what_it_means(new_service, build, footage, tmp_path):
    service = new_service("--input_roots", footage, "--worker", gated_worker(tmp_path), "--workers", 1).start()

    def run(*words):
        return subprocess.run([build / "hexadctl", *words], env=service.environment(), capture_output=True, text=True,
                              timeout=PATIENCE_S).stdout
    array = service.submit(sequence(footage, "8-9,11"))
    service.wait_worker(array)
    told = run("pause", array)
    assert told.startswith(f"{array} running") and "1 running frame continues; 2 frames wait" in told
    single = service.submit(sphere())
    told = run("pause", single)
    assert told.startswith(f"{single} paused") and "no attempt starts" in told
    assert run("resume", single).startswith(f"{single} queued")


@pytest.mark.sanitized
def test_jobs_with_a_label_are_cancelled_together(new_service, build, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path), "--workers", 1).start()

    def run(*words):
        return subprocess.run([build / "hexadctl", *words], env=service.environment(), capture_output=True, text=True,
                              timeout=PATIENCE_S)
    jobs = [service.submit(sphere(queue={"labels": ["shot=010"]})) for _ in range(3)]
    jobs.append(service.submit(sphere(queue={"labels": ["shot=010"], "depends_on": jobs[:1]})))
    other = service.submit(sphere(queue={"labels": ["shot=020"]}))
    service.wait_worker(jobs[0])
    done = run("cancel", "--label", "shot=010")
    assert done.returncode == 0 and done.stdout == "4 jobs cancelled\n", done.stderr
    for job in jobs:
        service.wait_state(job, "cancelled")  # also the dependent one, which has not failed before
    assert service.job(other)["state"] in ("queued", "running")
    assert run("cancel", "--label", "shot=010", "--json").stdout == '{"cancelled":0}\n'
    for words in (["cancel"], ["cancel", other, "--label", "a"], ["cancel", "--label", "a", "--label", "b"]):
        assert run(*words).returncode == 2


def test_submit_takes_a_priority_and_labels(run, service, tmp_path):
    (tmp_path / "spec.json").write_text(json.dumps(sphere(queue={"labels": ["a"], "priority": 1})))
    job = run("submit", "spec.json", "--priority", "-7", "--label", "shot=010", "--label=user=me").stdout.strip()
    told = service.job(job)
    assert told["priority"] == -7 and told["labels"] == ["a", "shot=010", "user=me"]
    (tmp_path / "spec.json").write_text(json.dumps(sphere()))
    told = json.loads(run("submit", "spec.json", "--label", "x", "--json").stdout)
    assert told["labels"] == ["x"]
    done = run("submit", "spec.json", "--priority", "high")
    assert done.returncode == 2 and "--priority" in done.stderr
    done = run("submit", "spec.json", "--priority", "5000")
    assert done.returncode == 2 and "/queue/priority" in done.stderr


@pytest.mark.sanitized
def test_a_file_is_uploaded_and_used(run, service, footage, tmp_path):
    done = run("upload", footage / "a.0008.vdb")
    assert done.returncode == 0, done.stderr
    path = done.stdout.strip()
    assert path == f"sha256:{hashlib.sha256((footage / 'a.0008.vdb').read_bytes()).hexdigest()}.vdb"
    assert run("upload", footage / "a.0008.vdb").stdout == done.stdout
    assert json.loads(run("upload", footage / "a.0008.vdb", "--json").stdout)["name"] == "a.0008.vdb"
    spec = {"version": 1, "surface": {"vdb": {"path": path}}, "sampling": {"count": 100}}
    service.wait_state(service.submit(spec), "succeeded")
    (tmp_path / "large").write_bytes(b"x" * (3 << 20))
    assert json.loads(run("upload", "large", "--json").stdout)["bytes"] == 3 << 20
    for name in ("nowhere", "."):
        done = run("upload", name)
        assert done.returncode == 2 and name in done.stderr


@pytest.mark.sanitized
def test_several_files_and_the_files_of_a_pattern_are_uploaded(run, tmp_path):
    names = ("b.0002.obj", "b.0010.obj", "b.12345.obj")
    for name in (*names, "b.002.obj", "b.x.obj", "b.0002.obj.bak"):
        (tmp_path / name).write_text(name)
    paths = [f"sha256:{hashlib.sha256(name.encode()).hexdigest()}.obj" for name in names]
    done = run("upload", names[1], names[0])
    assert done.returncode == 0 and done.stdout.split() == [paths[1], paths[0]], done.stderr
    done = run("upload", "b.####.obj")
    assert done.returncode == 0 and done.stdout.split() == paths and '"files": ["sha256:....obj", ...]' in done.stderr
    done = run("upload", "c.####.obj")
    assert done.returncode == 2 and "c.####.obj: no file matches" in done.stderr
    done = run("upload", "nowhere", names[0])
    assert done.returncode == 2 and done.stdout.split() == [paths[0]]


@pytest.mark.sanitized
def test_uploads_are_listed_and_deleted(run, service, tmp_path):
    def rows():
        """The rows of the table by name, without the title and the ages."""
        return {row[0]: (row[1], row[4:-1], row[-1]) for row in (re.split(r"  +", line) for line in
                                                                run("uploads").stdout.splitlines()[1:])}

    for i, name in enumerate(("c.obj", "d.nii.gz", "two.obj")):
        (tmp_path / name).write_bytes(b"%d" % i * (3 << 19))
    paths = run("upload", "c.obj", "d.nii.gz", "two.obj").stdout.split()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "two.obj").write_text("another")
    paths += run("upload", "other/two.obj").stdout.split()
    listed = rows()
    assert listed["c.obj"] == ("1.5 MiB", ["0"], paths[0]) and listed["d.nii.gz"] == ("1.5 MiB", ["0"], paths[1])
    document = json.loads(run("uploads", "--json").stdout)
    assert {entry["name"] for entry in document["inputs"]} >= {"c.obj", "d.nii.gz", "two.obj"}
    # by path, with or without the extension, and by name
    done = run("delete-upload", paths[0], "d.nii.gz", paths[2].partition(":")[2].removesuffix(".obj"))
    assert done.returncode == 0 and done.stdout.splitlines()[:2] == [f"{paths[0]} deleted", "d.nii.gz deleted"], done.stderr
    listed = rows()
    assert "c.obj" not in listed and "d.nii.gz" not in listed and listed["two.obj"] == ("7 B", ["0"], paths[3])
    assert run("upload", "two.obj").stdout.split() == [paths[2]]
    done = run("delete-upload", "two.obj")
    assert done.returncode == 2 and "the name of 2 uploads: give a path" in done.stderr
    assert all(path in done.stderr for path in paths[2:]) and rows().keys() >= {"two.obj"}
    for gone in ("c.obj", paths[0]):
        done = run("delete-upload", gone)
        assert done.returncode == 4 and gone.removeprefix("sha256:")[:60] in done.stderr, done.stderr
    done = run("delete-upload", "c.obj", "--all")
    assert done.returncode == 4 and "give the path or sha256" in done.stderr, done.stderr


def test_an_empty_argument_deletes_no_upload_without_a_name(run, service):
    content = b"sent without a name"
    path = "/v1/inputs/" + hashlib.sha256(content).hexdigest()
    assert service.request("PUT", path, content, {"Content-Type": "application/octet-stream"}).status in (200, 201)
    done = run("delete-upload", "")
    assert done.returncode == 2 and "a name is empty" in done.stderr, done.stderr
    assert service.get(path).status == 200


def test_specs_are_checked_and_estimated(run, service, tmp_path):
    (tmp_path / "spec.json").write_text(json.dumps(sphere(count=1000)))
    done = run("validate", "spec.json")
    assert done.returncode == 0 and done.stdout == "spec.json: the spec is valid\n"
    assert json.loads(run("validate", "spec.json", "--json").stdout)["spec"]["sampling"]["count"] == 1000
    done = run("estimate", "-", input=json.dumps(sphere(count=1000)))
    assert done.returncode == 0 and "points   1000\n" in done.stdout and "memory " in done.stdout, done.stderr
    (tmp_path / "spec.json").write_text(json.dumps(sphere(count=-1)))
    for command in ("validate", "estimate", "submit"):
        done = run(command, "spec.json")
        assert done.returncode == 2 and done.stderr.startswith("hexadctl: spec.json: /sampling/count: ")
        assert done.stderr.count("/sampling/count") == 1  # it is told once
    (tmp_path / "spec.json").write_text(json.dumps(sphere(count=-1, nonsense=1)))
    done = run("submit", "spec.json")
    assert "/sampling/count: " in done.stderr and "/nonsense: " in done.stderr
    (tmp_path / "spec.json").write_text('{"version": 1,\n,}')
    done = run("submit", "spec.json")
    assert done.returncode == 2 and done.stderr.startswith("hexadctl: spec.json: a spec must be a valid JSON document: line 2 column ")


def test_an_option_that_does_not_belong_to_a_command(run):
    for words, told in {("list", "--wait"): "list: this command has no option --wait;", ("show", "x", "--priority", "1"): "show: this command has no option --priority;",
                        ("--label", "a", "wait", "x"): "wait: this command has no option --label;", ("token", "list", "--scopes", "a"): "token list: this command has no option --scopes;",
                        ("submit",): "submit: the argument SPEC is missing", ("show", "a", "b"): "show: unexpected argument b",
                        ("submt", "x"): ": unknown command submt; did you mean submit?", ("frobnicate",): ": unknown command frobnicate; see hexadctl --help",
                        ("token", "lst"): ": unknown command token lst; did you mean token list?", ("tokne", "list"): "; did you mean token?", ("status",): "hexadctl workers",
                        ("list", "--since", "yesterday"): "--since must be a date or time", ("list", "--until", "2x"): "(given 2x)", ("list", "--stat", "a"): ": unknown option --stat; did you mean --state?",
                        ("list", "--statr=a"): "; did you mean --state?", ("list", "-limit", "3"): "; did you mean --limit?", ("list", "--colour"): "see hexadctl --help",
                        ("list", "--state"): ": --state requires a value"}.items():
        done = run(*words)
        assert done.returncode == 2 and told in done.stderr, done.stderr


def test_states_are_listed_together_and_named_in_a_complaint(run, service, tmp_path):
    done = service.submit(sphere())
    service.wait_state(done, "succeeded")
    paused = service.submit(sphere(queue={"depends_on": [done]}))
    service.wait_state(paused, "succeeded")
    service.post("/v1/admin/drain")
    pages, cursor = [], ""
    while cursor is not None:
        page = service.get(f"/v1/jobs?state=queued,succeeded&limit=1{cursor}").json
        pages.append([j["id"] for j in page["jobs"]])
        cursor = page["next"] and f"&cursor={page['next']}"
    assert pages == [[paused], [done]]
    refused = run("list", "--state", "unresolved")
    assert refused.returncode == 2 and "or several of these, separated by commas; converged, not_converged and unresolved are " \
        "outcomes of succeeded jobs: list these (hexadctl list --state succeeded --json)" in refused.stderr
    refused = run("list", "--state", "succeeded,foo")
    assert refused.returncode == 2
    for state in ("queued", "blocked", "paused", "running", "cancelling", "succeeded", "failed", "cancelled", "timed_out"):
        assert state in refused.stderr


def test_a_list_tells_whose_how_old_and_how_far(new_service, build, footage, tmp_path):
    service = new_service("--input_roots", footage, "--worker", gated_worker(tmp_path), "--workers", 1).start()

    def told(*words):
        done = subprocess.run([build / "hexadctl", *words], env=service.environment(), capture_output=True, text=True,
                              timeout=PATIENCE_S)
        assert done.returncode == 0, done.stderr
        return done.stdout
    array = service.submit({**sequence(footage, "8-9"), "name": "smoke"})
    service.wait_worker(array)
    service.open_gate(f"{array}.8")
    wait_until(lambda: service.job(array)["tasks"]["succeeded"] == 1, "the first frame")
    single = service.submit(sphere(name="ball", queue={"labels": ["shot=010"], "after": [array]}))
    owner = service.job(array)["owner"]
    titles, *rows = [line.split() for line in told("list").splitlines()]
    assert titles == ["ID", "STATE", "OUTCOME", "OWNER", "AGE", "TIME", "PROGRESS", "PRIORITY", "NAME"]
    assert [row[0] for row in rows] == [single, array]
    assert rows[0][1:4] == ["blocked", "-", owner] and rows[0][5:] == ["-", "-", "0", "ball"]
    assert rows[1][6:] == ["1/2", "0", "smoke"] and rows[1][4].endswith("s")
    shown = told("show", array)
    assert shown.startswith(f"{array} running") and f"owner     {owner}" in shown and "name      smoke" in shown
    assert "1/2 frames have ended, 1 succeeded, 1 running" in shown and "created   20" in shown
    assert "FRAME  ATTEMPT" in shown
    assert f"after     {array}" in told("show", single) and "labels    shot=010" in told("show", single)
    assert [line.split()[:2] for line in told("attempts", array).splitlines()[1:]] == [["8", "1"], ["9", "1"]]
    assert [a["frame"] for a in json.loads(told("attempts", array, "--json"))["attempts"]] == [8, 9]
    service.open_gate(f"{array}.9")
    service.wait_worker(single)
    assert "progress  50% relax" in told("show", single) and told("list").splitlines()[1].split()[6] == "50%"


def test_cancelled_frames_are_counted_apart(new_service, build, footage, tmp_path):
    service = new_service("--input_roots", footage, "--worker", gated_worker(tmp_path), "--workers", 1).start()
    array = service.submit(sequence(footage, "8-10"))
    service.wait_worker(array)
    service.open_gate(f"{array}.8")
    wait_until(lambda: service.job(array)["tasks"]["succeeded"] == 1, "the first frame")

    def told(*words):
        return subprocess.run([build / "hexadctl", *words], env=service.environment(), capture_output=True, text=True,
                              timeout=PATIENCE_S).stdout
    told("cancel", array)
    service.wait_state(array, "cancelled")
    assert "  1/3, 2 cancelled  " in told("list"), told("list")
    assert "1/3 frames have ended, 1 succeeded, 2 cancelled" in told("show", array)


@pytest.mark.sanitized
def test_a_list_is_filtered_by_the_server(run, service):
    ids = [service.submit(sphere(name=name, queue={"labels": [label]})) for name, label in
           (("ball", "a"), ("cube", "a"), ("ball", "b"))]
    for job in ids:
        service.wait_state(job, "succeeded")
    owner = service.job(ids[0])["owner"]
    created = service.job(ids[1])["created"]

    def listed(*words):
        done = run("list", "--json", *words)
        assert done.returncode == 0, done.stderr
        return [j["id"] for j in json.loads(done.stdout)["jobs"]]
    assert listed("--name", "ball") == [ids[2], ids[0]]
    assert listed("--name", "ball", "--label", "a", "--owner", owner, "--state", "failed,succeeded") == [ids[0]]
    assert listed("--owner", "nobody") == []
    assert listed("--since", created) == [ids[2], ids[1]]
    assert listed("--until", created) == [ids[0]]
    for since in ("1h", "1h ago", "600s", created[:10]):
        assert listed("--since", since) == ids[::-1], since
    assert listed("--until", "1h") == [] and listed("--until", "1h ago") == []
    assert listed("--since", created, "--until", created) == []
    for words in (["--since", "yesterday"], ["--since", "1h hence"], ["--limit", "0"], ["--limit", "a"], ["--label", "a", "--label", "b"]):
        done = run("list", *words)
        assert done.returncode == 2 and not done.stdout
    done = run("list", "--limit", "2")
    assert len(done.stdout.splitlines()) == 3 and "more jobs" in done.stderr


def test_a_long_list_comes_in_pages(new_service, build, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path), "--workers", 1, "--user_queued", 2000,
                          "--log_level", "warning").start()
    connection, body = service.connection(), json.dumps(sphere())
    for _ in range(520):  # more than a page of the server
        connection.request("POST", "/v1/jobs", body, {"Content-Type": "application/json"})
        reply = connection.getresponse()
        assert reply.status == 201, reply.read()
        reply.read()
    connection.close()
    done = subprocess.run([build / "hexadctl", "list", "--limit", "515", "--json"], env=service.environment(),
                          capture_output=True, text=True, timeout=PATIENCE_S)
    jobs = json.loads(done.stdout)
    assert len({j["id"] for j in jobs["jobs"]}) == 515 and jobs["next"]


def test_show_and_wait_say_which_frames_are_unresolved(run, service):
    job = service.submit(PARTLY_UNRESOLVED)
    waited = run("wait", job)
    assert waited.returncode == 11 and "unresolved: frames 2, 4-5\n" in waited.stderr, waited.stderr
    shown = run("show", job).stdout
    assert "unresolved: frames 2, 4-5\n" in shown
    notes = {t["frame"]: t["notes"] for t in service.get(f"/v1/jobs/{job}/tasks").json["tasks"]}
    for text in (shown, waited.stderr):
        lines = {int(line.split()[1].rstrip(":")): line for line in text.splitlines() if line.startswith("frame ")}
        assert list(lines) == sorted(lines) and {2, 4, 5} <= set(lines)
        for frame, line in lines.items():
            assert line.startswith(f"frame {frame}: {'unresolved' if frame in (2, 4, 5) else 'converged'}")
            for name, rating in notes[frame]["ratings"].items():
                assert (f", {name} {rating['value'] or 0:.3g} {rating['rating']}" in line) == (rating["rating"] not in ("good", None)), line
            for told in (r["message"] for r in notes[frame]["outcome_reasons"]):
                assert f"; {told}" in line
    good = service.submit(sphere(100, output={"preview": False}, queue={"frames": "1-2", "by_frame": {"/surface/analytic/radius": [1, 2]}}))
    assert not re.search("unresolved|not converged", run("wait", good).stderr)


def test_ten_frames_with_notes_are_printed(run, service):
    """The same few points in each: the ratings of so few are not good."""
    job = service.submit(sphere(40, output={"preview": False},
                                queue={"frames": "1-13", "by_frame": {"/solver/seed": [1] * 13}}, solver={"seed": 1}))
    lines = [line for line in run("wait", job).stderr.splitlines() if "packing" not in line]
    assert [line.split(":")[0] for line in lines[-11:-1]] == [f"frame {k}" for k in range(1, 11)], lines
    assert ", hex_fraction" in lines[-2] and lines[-1] == "and 3 more frames with notes"


def test_a_warning_of_many_frames_is_printed_once_with_its_frames(run, service):
    """The walls of frames 2, 3 and 5 are thin, each by another measure."""
    thickness = [0.5, 0.02, 0.015, 0.5, 0.02]
    box = {"analytic": {"shape": "box", "center": [0, 0, 0], "half_size": [1, 1, 0.5]}}
    job = service.submit({"version": 1, "surface": box, "features": True, "sampling": {"count": 400}, "output": {"preview": False},
                          "queue": {"frames": "1-5", "by_frame": {"/surface/analytic/half_size": [[1, 1, z] for z in thickness]}}})
    waited = run("wait", job)
    warnings = {t["frame"]: t["notes"]["warnings"] for t in service.get(f"/v1/jobs/{job}/tasks").json["tasks"]}
    assert [frame for frame in warnings if warnings[frame]] == [2, 3, 5] and warnings[2] != warnings[3], warnings
    for text in (waited.stderr, run("show", job).stdout):
        lines = [line for line in text.splitlines() if line.startswith("warning: ")]
        assert lines == [f"warning: frames 2-3, 5: {text} (the numbers are those of the first frame)" for text in warnings[2]]


def test_wait_ends_with_zero_for_accepted_outcomes(run, service):
    job, strict = (service.submit({**PARTLY_UNRESOLVED, "queue": {**PARTLY_UNRESOLVED["queue"], "accept": accept}})
                   for accept in (["converged", "unresolved"], ["converged"]))
    dependent = service.submit(sphere(100, queue={"depends_on": [strict]}))
    assert run("wait", job).returncode == 11 and run("wait", "--accept", job).returncode == 0
    refused = run("wait", "--accept", strict)
    assert refused.returncode == 11 and f"{strict} succeeded unresolved (not accepted)" in refused.stdout
    assert run("wait", "--accept", job, strict).returncode == 11
    assert service.job(job)["accepted"] is True and service.job(strict)["accepted"] is False
    failed = service.wait_state(dependent, "failed")
    assert failed["error"]["code"] == "dependency_failed" and f"{strict}, which has the outcome unresolved" in failed["error"]["message"]
    assert failed["accepted"] is None
    changed = service.request("PATCH", f"/v1/jobs/{strict}", json.dumps({"accept": ["unresolved", "converged"]}),
                              {"Content-Type": "application/json"})
    assert changed.status == 200 and changed.json["accepted"] is True, changed.body
    assert run("retry", strict, "--dependents").returncode == 0
    assert service.wait_state(dependent, "succeeded")["accepted"] is True


def test_submit_accepts_outcomes_only_when_it_waits(run, tmp_path):
    (tmp_path / "spec.json").write_text(json.dumps({**PARTLY_UNRESOLVED, "queue": {
        **PARTLY_UNRESOLVED["queue"], "accept": ["converged", "unresolved"]}}))
    refused = run("submit", tmp_path / "spec.json", "--accept")
    assert refused.returncode == 2 and "--accept requires --wait" in refused.stderr
    assert run("submit", tmp_path / "spec.json", "--wait", "--accept").returncode == 0


def test_a_pattern_without_frames_is_reported(run, footage, build, tmp_path):
    spec = json.dumps({**sequence(footage, "8"), "queue": {}})
    (tmp_path / "spec.json").write_text(spec)
    worker = subprocess.run([build / "hexad-worker", "run", tmp_path / "spec.json", "--output", tmp_path / "out"],
                            capture_output=True, text=True, timeout=PATIENCE_S)
    for done in (run("submit", tmp_path / "spec.json"), worker):
        assert done.returncode in (2, 3) and "cannot read" in done.stderr and "a.####.vdb" in done.stderr, done.stderr
        assert "add queue.frames: ####, %04d or $F4 in a path stands for the frame number" in done.stderr, done.stderr


def faulty(footage, **parts):
    surface = parts.pop("surface", {"vdb": {"path": str(footage / "a.0008.vdb"), **parts.pop("vdb", {})}})
    return {"version": 1, "surface": surface, "sampling": {"count": 100}, **parts}


@pytest.mark.extended  # waits for a moment in which the service answers in 0.2 s
@pytest.mark.parametrize("part, told", [({"vdb": {"grid": "nonsense"}}, "nonsense"), ({"vdb": {"isovalue": 1000}}, "1000"),
                                        ({"attributes": [{"name": "nonsense"}]}, "nonsense"), ("text.obj", "text.obj")])
def test_a_fault_of_the_inputs_is_warned_of_when_a_job_is_submitted(run, service, footage, tmp_path, part, told):
    """The last input is a text in the place of a mesh."""
    if isinstance(part, str):
        (footage / part).write_text("hello world\n")
        part = {"surface": {"mesh": {"path": str(footage / part)}}}
    (tmp_path / "spec.json").write_text(json.dumps(faulty(footage, **part)))

    def warned():
        """Of a submission for which the service has looked into the file in time."""
        done = run("submit", tmp_path / "spec.json")
        assert done.returncode == 0, done.stderr
        return done if done.stderr else None

    done = wait_until(warned, "a warning")
    fault = service.wait_state(done.stdout.strip(), "failed")["error"]["message"]
    assert done.stderr == (f"warning: {tmp_path}/spec.json: {fault.rstrip('.')}. "
                           "The job is accepted, and fails if this is still so when it runs.\n") and told in fault


def test_a_submission_waits_for_no_long_look_at_its_inputs(build, tmp_path):
    """The worker of this service never ends."""
    service = Service(build, tmp_path, "--worker", gated_worker(tmp_path)).start()
    try:
        (tmp_path / "spec.json").write_text(json.dumps(sphere()))
        done = runner(service, build, tmp_path)("submit", tmp_path / "spec.json")
        assert done.returncode == 0 and not done.stderr
        answer = service.post("/v1/jobs:validate?within_ms=1", sphere()).json
        assert answer["estimate"] is None and "0.001 s: raise within_ms of the request" in answer["estimate_missing"]
    finally:
        service.clean_up()
