# SPDX-License-Identifier: Apache-2.0
"""Jobs with a task per frame, dependencies, and what users may ask of jobs that wait, end to end."""
import json
import math
import os
import shutil
import subprocess

import pytest

from service import PATIENCE_S, Service, aged, gated_worker, long_sphere, sphere, wait_until


TETRAHEDRON = "OFF\n4 4 0\n1 1 1\n1 -1 -1\n-1 1 -1\n-1 -1 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


@pytest.fixture(scope="module")
def footage(build, tmp_path_factory):
    """A directory with the frames 8, 9 and 11 of a level set."""
    where = tmp_path_factory.mktemp("footage")
    subprocess.run([build / "hexad-worker", "make-example", where / "a.0008.vdb"], check=True, timeout=PATIENCE_S)
    for frame in (9, 11):
        shutil.copy(where / "a.0008.vdb", where / f"a.{frame:04d}.vdb")
    (where / "repeated").mkdir()
    (where / "repeated" / "a.off").write_text(TETRAHEDRON)  # made early: the cache trusts no file that has just changed
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


def sequence(footage, frames, **queue):
    return {"version": 1, "surface": {"vdb": {"path": str(footage / "a.####.vdb")}}, "sampling": {"count": 100},
            "output": {"preview": False}, "queue": {"frames": frames, **queue}}


def test_a_sequence_is_one_job(service, footage):
    job = service.submit(sequence(footage, "8-9,11"))
    done = service.wait_state(job, "succeeded")
    assert done["outcome"] in ("converged", "unresolved", "not_converged")
    assert len(done["attempts"]) == 3
    names = sorted(p.name for p in (service.state / "results").iterdir())
    assert names == sorted(f"{job}.{frame}" for frame in (8, 9, 11))
    for name in names:
        assert (service.state / "results" / name / "report.json").is_file()
    assert service.get(f"/v1/jobs/{job}/results").status == 400  # of which frame?
    assert service.get(f"/v1/jobs/{job}/results?frame=10").status == 404
    for result in service.get(f"/v1/jobs/{job}/results?frame=9").json["results"]:
        assert service.get(result["href"]).status == 200
    tasks = service.get(f"/v1/jobs/{job}/tasks?limit=2").json
    assert [t["frame"] for t in tasks["tasks"]] == [8, 9]
    rest = service.get(f"/v1/jobs/{job}/tasks?limit=2&after={tasks['next']}").json
    assert [t["frame"] for t in rest["tasks"]] == [11] and rest["next"] is None


def test_a_frame_number_is_written_as_in_houdini(service, build, footage, tmp_path):
    spec = {**sequence(footage, "8-9"), "surface": {"vdb": {"path": str(footage / "a.$F4.vdb")}}}
    done = service.wait_state(service.submit(spec), "succeeded")
    read = [service.get(f"/v1/jobs/{done['id']}/results/report.json?frame={n}").json["inputs"][0]["path"] for n in (8, 9)]
    assert read == [str(footage / "a.0008.vdb"), str(footage / "a.0009.vdb")]
    sent = subprocess.run([build / "hexadctl", "upload", footage / "a.$F4.vdb"], env=service.environment(), text=True,
                          capture_output=True, timeout=PATIENCE_S)
    assert sent.returncode == 0 and len(sent.stdout.splitlines()) == 3, sent.stderr
    # what the command says about one job for all of them is true
    names = json.dumps(sent.stdout.split())
    advised = json.loads("{" + sent.stderr.split("queue.files: ")[1].replace('["sha256:....vdb", ...]', names) + "}")
    done = service.wait_state(service.submit({"version": 1, "sampling": {"count": 50}, "output": {"preview": False}, **advised}), "succeeded")
    assert done["tasks"]["all"] == 3


def test_all_frames_are_those_of_the_files_at_the_submission(new_service, footage, tmp_path):
    film, more = tmp_path / "film", tmp_path / "more"
    for name in ("a.0008.off", "a.0009.off", "a.0011.off", "a.0013.off", "a.7.off", "b.0001.off", "a.0008.off.bak"):
        film.mkdir(exist_ok=True)
        (film / name).write_text(TETRAHEDRON)
    (film / "a.0012.off").symlink_to(film / "a.0008.off")
    (film / "a.0014.off").symlink_to("/etc/hostname")  # which jobs may not read
    more.mkdir()
    (more / "a.0002.off").write_text(TETRAHEDRON)
    service = new_service("--input_roots", f"{film},{more}", base=tmp_path).start()

    def spec(path, **queue):
        return {"version": 1, "surface": {"mesh": {"path": str(path)}}, "sampling": {"count": 50},
                "output": {"preview": False}, "queue": {"frames": "all", **queue}}

    job = service.submit(spec(film / "a.####.off"))
    (film / "a.0020.off").write_text(TETRAHEDRON)
    done = service.wait_state(job, "succeeded")
    assert done["spec"]["queue"]["frames"] == "8-9,11-13" and done["tasks"]["all"] == 5
    assert service.post("/v1/jobs:validate", spec("a.%04d.off")).json["spec"]["queue"]["frames"] == "2,8-9,11-13,20"
    wrong = service.post("/v1/jobs", spec(film / "a.$F4.off", by_frame={"/solver/seed": [1, 2]}))
    assert wrong.status == 422 and "2 values for 6 frames" in wrong.json["detail"], wrong.body
    for path, code in ((film / "c.####.off", "input_missing"), (film / "none/a.####.off", "input_missing"),
                       ("/etc/a.####.off", "path_forbidden")):
        refused = service.post("/v1/jobs", spec(path))
        assert refused.json["code"] == code and refused.json["errors"][0]["pointer"] == "/queue/frames", refused.body
    shots = film / "shots"
    for number in (3, 4, 5):
        (shots / f"{number:03d}").mkdir(parents=True)
        if number != 4:
            (shots / f"{number:03d}" / "a.off").write_text(TETRAHEDRON)
    assert service.post("/v1/jobs:validate", spec(shots / "###/a.off")).json["spec"]["queue"]["frames"] == "3,5"


def test_more_frames_than_a_job_may_have_are_refused(new_service, tmp_path):
    film = tmp_path / "film"
    film.mkdir()
    for number in range(100001):
        (film / f"a.{number}.off").touch()
    service = new_service("--input_roots", film, base=tmp_path).start()
    spec = {"version": 1, "surface": {"mesh": {"path": "a.#.off"}}, "sampling": {"count": 50}, "queue": {"frames": "all"}}
    refused = service.post("/v1/jobs", spec)
    assert refused.status == 422 and refused.json["code"] == "spec_invalid", refused.body
    assert "more than 100000 files match a.#.off" in refused.json["detail"]


def test_the_worker_alone_finds_no_frames(build, footage, tmp_path):
    words = [build / "hexad-worker", "run", "-", "--output", tmp_path / "out", "--frame", "8"]
    done = subprocess.run(words, input=json.dumps(sequence(footage, "all")), text=True, capture_output=True, timeout=PATIENCE_S)
    assert done.returncode == 2 and "only the service finds" in done.stderr


def test_at_most_max_running_frames_run(new_service, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path), "--workers", 4, "--threads", 4, base=tmp_path).start()
    job = service.submit(sphere(queue={"frames": "1-4", "max_running": 2, "by_frame": {"/solver/seed": [1, 2, 3, 4]}}))
    later = service.submit(sphere())
    service.wait_state(later, "running")  # so the frames that wait were passed over
    assert service.job(job)["tasks"]["running"] == 2
    changed = service.request("PATCH", f"/v1/jobs/{job}", json.dumps({"max_running": 3}), {"Content-Type": "application/json"})
    assert changed.status == 200, changed.body
    wait_until(lambda: service.job(job)["tasks"]["running"] == 3, "a third frame")
    for frame in (1, 2, 3, 4):
        service.open_gate(f"{job}.{frame}")
    assert service.wait_state(job, "succeeded")["tasks"]["succeeded"] == 4


def failing_worker(where):
    """A gated worker that fails if there is a text in the gate."""
    path = gated_worker(where)
    path.write_text(path.read_text().replace("\nprintf x >", "\n[ -s \"$base/open.${job%.*}\" ] && exit 3\nprintf x >"))
    return path


def test_frames_start_after_the_same_frames_of_another_job(new_service, tmp_path):
    service = new_service("--worker", failing_worker(tmp_path), "--workers", 8, "--threads", 8, base=tmp_path).start()
    by_frame = {"frames": "1-3", "by_frame": {"/solver/seed": [1, 2, 3]}}
    first = service.submit(sphere(queue=by_frame))
    second = service.submit(sphere(queue={**by_frame, "after_frames": [first]}))
    third = service.submit(sphere(queue={"depends_on": [second]}))

    def states(job):
        return [(t["state"], t["waits"]) for t in service.get(f"/v1/jobs/{job}/tasks").json["tasks"]]

    wait_until(lambda: service.job(first)["tasks"]["running"] == 3, "all frames of the first job")
    assert service.job(second)["state"] == "blocked" and states(second) == [("queued", 1)] * 3
    assert [j["id"] for j in service.get(f"/v1/jobs?depends_on={first}").json["jobs"]] == [second]
    service.open_gate(f"{first}.2")
    wait_until(lambda: states(second)[1][0] == "running", "the second frame of the second job")
    assert states(second)[0] == ("queued", 1) and service.job(first)["state"] == "running"
    service.end(9)  # what is running is queued again, and what waits goes on to wait
    service.start()
    wait_until(lambda: states(second) == [("queued", 1), ("running", 0), ("queued", 1)], "the frames after a crash")
    (tmp_path / f"open.{first}.1").write_text("fail")
    for frame in (1, 2, 3):
        service.open_gate(f"{second}.{frame}")
    service.open_gate(f"{first}.3")
    ended = service.wait_state(second, "failed")
    assert [s for s, _ in states(second)] == ["failed", "succeeded", "succeeded"]
    assert ended["error"]["code"] == "dependency_failed"
    assert f"1 of 3 frames failed; frame 1: this frame starts after the same frame of the job {first}" in ended["error"]["message"]
    assert service.job(third)["error"]["code"] == "dependency_failed"
    assert service.post(f"/v1/jobs/{second}/retry").status == 409

    (tmp_path / f"open.{first}.1").write_text("")
    retried = service.post(f"/v1/jobs/{first}/retry?dependents=1")
    assert retried.status == 200 and retried.json["dependents"] == {"retried": 2, "others": []}, retried.body
    service.wait_state(second, "succeeded")
    service.open_gate(f"{third}")
    service.wait_state(third, "running", "succeeded")


def test_dependencies_on_frames_that_are_not_possible_are_refused(service, footage):
    array, single = service.submit(sequence(footage, "8-9")), service.submit(sphere())
    for queue, pointer, words in (({"after_frames": ["nobody"]}, "/queue/after_frames/0", "nobody does not exist"),
                                  ({"after_frames": [single]}, "/queue/after_frames/0", "has no frames"),
                                  ({"after_frames": [array]}, "/queue/after_frames/0", "has no frame 11"),
                                  ({"after": [array], "after_frames": [array]}, "/queue/after_frames/0", "listed twice")):
        refused = service.post("/v1/jobs", sequence(footage, "8,11", **queue))
        fault = refused.json["errors"][0]
        assert refused.status == 422 and fault["pointer"] == pointer and words in fault["detail"], refused.body
    assert service.post("/v1/jobs", sphere(queue={"after_frames": [array]})).json["errors"][0]["pointer"] == "/queue/after_frames"


def test_a_frame_that_is_missing_fails_alone(service, footage):
    job = service.submit(sequence(footage, "9-10"))
    done = service.wait_state(job, "failed")
    assert done["error"]["code"] == "input_missing"
    assert "1 of 2 frames failed; frame 10:" in done["error"]["message"] and "a.0010.vdb" in done["error"]["message"]
    assert len(list((service.state / "results").iterdir())) == 1


def test_a_sequence_begins_with_a_file_that_is_there(service, footage):
    refused = service.post("/v1/jobs", sequence(footage, "7-9"))
    assert refused.status == 422 and refused.json["code"] == "input_missing", refused.body
    assert "a.0007.vdb below the input roots" in refused.json["detail"]


def test_a_job_that_depends_on_another(service):
    first = service.submit(sphere())
    second = service.submit(sphere(queue={"depends_on": [first]}))
    done = service.wait_state(second, "succeeded")
    assert done["started"] >= service.job(first)["finished"]
    refused = service.post("/v1/jobs", sphere(queue={"depends_on": [first, "nobody"]}))
    assert refused.status == 422 and refused.json["errors"][0]["pointer"] == "/queue/depends_on/1"


def test_a_job_that_waits_for_any_end(service):
    first = service.submit(long_sphere(limits={"timeout_s": 0.2, "max_attempts": 1}))
    second = service.submit(sphere(queue={"after": [first]}))
    strict = service.submit(sphere(queue={"depends_on": [first]}))
    done = service.wait_state(second, "succeeded")
    assert done["started"] >= service.job(first)["finished"]
    assert service.job(strict)["error"]["code"] == "dependency_failed"
    refused = service.post("/v1/jobs", sphere(queue={"after": [first, "nobody"]}))
    assert refused.status == 422 and refused.json["errors"][0]["pointer"] == "/queue/after/1"


def test_attempts_come_in_pages(service):
    job = service.submit(sphere(output={"preview": False}, queue={"frames": "8-9,11", "by_frame": {
        "/surface/analytic/radius": [1, 2, 3]}}))
    service.wait_state(job, "succeeded")
    seen, after = [], ""
    while after is not None:
        page = service.get(f"/v1/jobs/{job}/attempts?limit=2{after}").json
        seen.append([a["frame"] for a in page["attempts"]])
        after = page["next"] and f"&after={page['next']}"
    assert seen == [[8, 9], [11]]
    assert service.get(f"/v1/jobs/{job}/attempts").json["next"] is None


def test_the_worker_alone_runs_one_frame(build, footage, tmp_path):
    words = [build / "hexad-worker", "run", "-", "--output", tmp_path / "out"]
    spec = json.dumps(sequence(footage, "8-11"))
    done = subprocess.run([*words, "--frame", "9"], input=spec, text=True, capture_output=True, timeout=PATIENCE_S)
    assert done.returncode in (0, 10, 11), done.stderr
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["inputs"][0]["path"] == str(footage / "a.0009.vdb")
    for more in ([], ["--frame", "12"]):
        done = subprocess.run([*words, *more], input=spec, text=True, capture_output=True, timeout=PATIENCE_S)
        assert done.returncode == 2 and "8-11" in done.stderr


@pytest.mark.sanitized
def test_copies_of_results(new_service, tmp_path):
    show = tmp_path / "show"
    show.mkdir()
    service = new_service("--output_roots", show, "--output_mode", "0640").start()
    job = service.submit(sphere(output={"directory": f"{show}/shot/a"}))
    service.wait_state(job, "succeeded")
    copied = show / "shot" / "a"
    for result in service.get(f"/v1/jobs/{job}/results").json["results"]:
        assert (copied / result["name"]).read_bytes() == service.get(result["href"]).body
        assert (copied / result["name"]).stat().st_mode & 0o777 == 0o640
    spec = sphere(queue={"frames": "8-9", "by_frame": {"/surface/analytic/radius": [1, 2]}}, output={"preview": False})
    spec["output"]["directory"] = f"{show}/frames/%03d"
    service.wait_state(service.submit(spec), "succeeded")
    assert sorted(p.name for p in (show / "frames").iterdir()) == ["008", "009"]
    spec["output"]["directory"] = f"{show}/frames"
    assert service.post("/v1/jobs", spec).json["errors"][0]["pointer"] == "/queue/frames"
    refused = service.post("/v1/jobs", sphere(output={"directory": "/etc/hexad"}))
    assert refused.status == 403 and refused.json["errors"][0]["pointer"] == "/output/directory"


def test_the_stage_of_a_sequence_is_above_its_frames(new_service, build, tmp_path):
    show = tmp_path / "show"
    show.mkdir()
    service = new_service("--output_roots", show).start()
    spec = sphere(queue={"frames": "8-9", "by_frame": {"/surface/analytic/radius": [1, 2]}},
                  output={"preview": False, "points_usda": True, "directory": f"{show}/shot/####"})
    done = service.wait_state(service.submit(spec), "succeeded")
    assert done["delivery"]["state"] == "delivered"
    assert sorted(p.name for p in (show / "shot").iterdir()) == ["0008", "0009", "points_stage.usda"]
    assert "assetPaths = [@./0008/points.usda@, @./0009/points.usda@]" in (show / "shot/points_stage.usda").read_text()
    names = [r["name"] for r in service.get(f"/v1/jobs/{done['id']}/results?frame=8").json["results"]]
    assert "points_stage.usda" in names and "points_sequence.usda" in names
    (show / "shot/points_stage.usda").unlink()
    assert service.post(f"/v1/jobs/{done['id']}/deliver").status == 202
    wait_until((show / "shot/points_stage.usda").is_file, "the second copy")

    del spec["output"]["directory"]
    job = service.submit(spec)
    service.wait_state(job, "succeeded")
    fetched = subprocess.run([build / "hexadctl", "fetch", job, "--output", tmp_path / "here"], env=service.environment(),
                             capture_output=True, text=True, timeout=PATIENCE_S)
    assert fetched.returncode == 0, fetched.stderr
    assert sorted(p.name for p in (tmp_path / "here").iterdir()) == ["8", "9", "points_stage.usda"]
    assert not (tmp_path / "here/8/points_stage.usda").exists()
    spec["output"]["directory"] = f"{show}#/x"  # the place of the stage is not below the output root
    (tmp_path / "show7").mkdir()
    other = new_service("--output_roots", tmp_path / "show7").start()
    spec["queue"] = {"frames": "7", "by_frame": {"/solver/seed": [1]}}
    other.wait_state(other.submit(spec), "succeeded")
    assert [p.name for p in (tmp_path / "show7").iterdir()] == ["x"] and not (tmp_path / "points_stage.usda").exists()


def test_a_directory_that_cannot_be_made_is_refused(new_service, tmp_path):
    show = tmp_path / "show"
    show.mkdir()
    (show / "taken").write_text("a file where a directory should be")
    service = new_service("--output_roots", show).start()
    refused = service.post("/v1/jobs", sphere(output={"directory": f"{show}/taken/a"}))
    assert refused.status == 403 and refused.json["code"] == "path_forbidden" and f"{show}/taken/a" in refused.json["detail"]
    (show / "taken").unlink()
    service.wait_state(service.submit(sphere(output={"directory": f"{show}/taken/a"})), "succeeded")
    assert (show / "taken" / "a" / "report.json").is_file()


def test_a_repeat_is_given_the_result(new_service, footage, tmp_path):
    film = footage / "repeated"
    file = film / "a.off"
    aged(file)
    service = new_service("--input_roots", film, "--output_roots", tmp_path).start()
    spec = {"version": 1, "surface": {"mesh": {"path": str(file), "resolution": 24}}, "sampling": {"count": 100}}

    def run(**parts):
        job = service.submit({**spec, **parts})
        return service.wait_state(job, "succeeded")

    first = run()
    again = run(name="again", queue={"priority": 5}, output={"directory": f"{tmp_path}/copy"})
    assert first["cached_from"] is None and again["cached_from"] == first["id"]
    assert again["outcome"] == first["outcome"] and again["attempts"][0]["reason"] == "the result of an equal job"
    log = service.get(f"/v1/jobs/{again['id']}/log")
    assert log.status == 404 and f"the result of the equal job {first['id']}. Read the log of that job." in log.json["detail"]
    assert (tmp_path / "copy" / "report.json").is_file()
    points = [service.get(f"/v1/jobs/{job['id']}/results/points.ply").body for job in (first, again)]
    assert points[0] == points[1]
    assert run(sampling={"count": 101})["cached_from"] is None
    service.end()
    service.start()
    assert run()["cached_from"] == first["id"]  # it is no matter of memory
    os.utime(file)
    assert run()["cached_from"] is None  # the file is the same, but who knows
    aged(file)
    later = run()
    assert later["cached_from"] is None and run()["cached_from"] == later["id"]


def test_a_formula_differs_by_frame(service, build, tmp_path):
    spec = sphere(queue={"frames": "1-3", "by_frame": {"/surface/analytic/radius": {"from": 1, "to": 2}, "/solver/seed": [4, 5, 6]}})
    job = service.submit(spec)
    service.wait_state(job, "succeeded")
    for frame, radius, seed in ((1, 1, 4), (2, 1.5, 5), (3, 2, 6)):
        report = service.get(f"/v1/jobs/{job}/results/report.json?frame={frame}").json
        assert report["surface"]["area"] == pytest.approx(4 * math.pi * radius ** 2, rel=1e-2)
        assert report["spec"]["solver"]["seed"] == seed and report["spec"]["surface"]["analytic"]["radius"] == radius
        assert report["spec"]["queue"]["frames"] == str(frame)
    words = [build / "hexad-worker", "run", "-", "--output", tmp_path / "out", "--frame", "2"]
    done = subprocess.run(words, input=json.dumps(spec), text=True, capture_output=True, timeout=PATIENCE_S)
    assert done.returncode in (0, 10), done.stderr
    points = service.get(f"/v1/jobs/{job}/results/points.ply?frame=2").body
    assert (tmp_path / "out" / "points.ply").read_bytes() == points


def test_what_differs_by_frame_is_checked_for_every_frame(service):
    place = "/queue/by_frame/~1surface~1analytic~1radius"
    for values, pointer, words in (([1, 1, -1], place + "/2", "frame 3: must be"), ([1, 1], place, "2 values for 3 frames"),
                                   ({"from": 1, "to": -1}, place, "frame 2: must be")):
        refused = service.post("/v1/jobs", sphere(queue={"frames": "1-3", "by_frame": {"/surface/analytic/radius": values}}))
        fault = refused.json["errors"][0]
        assert refused.status == 422 and fault["pointer"] == pointer and words in fault["detail"], refused.body
    assert service.get("/v1/jobs").json["jobs"] == []


def test_a_repeat_waits_for_no_worker(new_service):
    """It is given the result of its equal while the only slot is taken; what is new waits."""
    service = new_service("--workers", 1).start()
    first = service.submit(sphere())
    service.wait_state(first, "succeeded")
    busy = service.submit(long_sphere())
    service.wait_worker(busy)
    new = service.submit(sphere(count=201))
    for _ in range(3):
        again = service.wait_state(service.submit(sphere()), "succeeded")
        assert again["cached_from"] == first and len(again["attempts"]) == 1
    assert service.job(new)["state"] == "queued" and service.job(busy)["state"] == "running"
    assert service.get("/v1/workers").json["load"]["attempts_limit"] == 1
    service.end(9)
    # what was not settled is, and the last slot is as free as before
    service.start()
    service.post(f"/v1/jobs/{busy}/cancel")
    service.wait_state(new, "succeeded")


@pytest.mark.sanitized
def test_a_repeat_that_lost_its_result_runs(new_service):
    service = new_service("--workers", 1).start()
    first = service.submit(sphere())
    service.wait_state(first, "succeeded")
    busy = service.submit(long_sphere())
    service.wait_worker(busy)
    for file in (service.state / "results" / first).iterdir():
        file.unlink()
    again = service.submit(sphere())
    wait_until(lambda: "cannot use a cached result" in service.log.read_text(), "the attempt without a result")
    assert service.wait_state(again, "queued")["progress"] is None
    service.post(f"/v1/jobs/{busy}/cancel")
    done = service.wait_state(again, "succeeded")
    assert done["cached_from"] is None
