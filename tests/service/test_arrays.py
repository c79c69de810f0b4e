"""Jobs with a task per frame, dependencies, and what users may ask of jobs that wait, end to end."""
import json
import shutil
import subprocess

import pytest

from service import PATIENCE_S, sphere


@pytest.fixture(scope="module")
def footage(build, tmp_path_factory):
    """A directory with the frames 8, 9 and 11 of a level set."""
    where = tmp_path_factory.mktemp("footage")
    subprocess.run([build / "hexad-worker", "make-example", where / "a.0008.vdb"], check=True, timeout=PATIENCE_S)
    for frame in (9, 11):
        shutil.copy(where / "a.0008.vdb", where / f"a.{frame:04d}.vdb")
    return where


def sequence(footage, frames, **queue):
    return {"version": 1, "surface": {"vdb": {"path": str(footage / "a.####.vdb")}}, "sampling": {"count": 100},
            "output": {"preview": False}, "queue": {"frames": frames, **queue}}


def test_a_sequence_is_one_job(new_service, footage):
    service = new_service("--input_roots", footage).start()
    job = service.submit(sequence(footage, "8-9,11"))
    done = service.wait_state(job, "succeeded")
    assert done["outcome"] in ("converged", "not_converged")
    assert len(done["attempts"]) == 3
    names = sorted(p.name for p in (service.state / "results").iterdir())
    assert names == sorted(f"{job}.{frame}" for frame in (8, 9, 11))
    for name in names:
        assert (service.state / "results" / name / "report.json").is_file()
    assert service.get(f"/v1/jobs/{job}/results").status == 404


def test_a_frame_that_is_missing_fails_alone(new_service, footage):
    service = new_service("--input_roots", footage).start()
    job = service.submit(sequence(footage, "8-11"))
    done = service.wait_state(job, "failed")
    assert done["error"]["code"] == "input_missing"
    assert "1 of 4 frames failed; frame 10:" in done["error"]["message"] and "a.0010.vdb" in done["error"]["message"]
    assert len(list((service.state / "results").iterdir())) == 3


def test_a_sequence_begins_with_a_file_that_is_there(new_service, footage):
    service = new_service("--input_roots", footage).start()
    refused = service.post("/v1/jobs", sequence(footage, "7-9"))
    assert refused.status == 422 and refused.json["code"] == "input_missing", refused.body
    assert "a.0007.vdb" in refused.json["detail"]


def test_a_job_that_depends_on_another(service):
    first = service.submit(sphere())
    second = service.submit(sphere(queue={"depends_on": [first]}))
    done = service.wait_state(second, "succeeded")
    assert done["started"] >= service.job(first)["finished"]
    refused = service.post("/v1/jobs", sphere(queue={"depends_on": [first, "nobody"]}))
    assert refused.status == 422 and refused.json["errors"][0]["pointer"] == "/queue/depends_on/1"


def test_the_worker_alone_runs_one_frame(build, footage, tmp_path):
    words = [build / "hexad-worker", "run", "-", "--output", tmp_path / "out"]
    spec = json.dumps(sequence(footage, "8-11"))
    done = subprocess.run([*words, "--frame", "9"], input=spec, text=True, capture_output=True, timeout=PATIENCE_S)
    assert done.returncode in (0, 10), done.stderr
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["inputs"][0]["path"] == str(footage / "a.0009.vdb")
    for more in ([], ["--frame", "12"]):
        done = subprocess.run([*words, *more], input=spec, text=True, capture_output=True, timeout=PATIENCE_S)
        assert done.returncode == 2 and "8-11" in done.stderr
