# SPDX-License-Identifier: Apache-2.0
"""What a job would take: told by the worker, and by the service to who has a spec checked."""
import json
import re
import threading

import numpy
import pytest

from service import expect_problem, gated_worker, last_words, long_sphere, sphere, wait_until
from volumes import write_nrrd


@pytest.fixture
def estimate(build, worker, tmp_path):
    """Runs hexad-worker estimate; the object that it prints and writes."""
    def call(spec, *words):
        done = worker(spec, *words, command="estimate", output="estimate")
        assert done.returncode == 0, done.stderr
        found = json.loads(done.stdout)
        assert json.loads((tmp_path / "estimate" / "estimate.json").read_text()) == found
        assert len(list((tmp_path / "estimate").iterdir())) == 1
        return found
    return call


TORUS = {"analytic": {"shape": "torus", "center": [0, 0, 0], "axis": [0, 0, 1], "major_radius": 1,
                      "minor_radius": 0.3}}


@pytest.mark.parametrize("sampling", [{"count": 3000}, {"spacing": 0.05}, {"density": 100}])
def test_it_is_what_the_job_comes_to(estimate, worker, tmp_path, sampling):
    spec = sphere(surface=TORUS, sampling=sampling, output={"preview": False})
    found = estimate(spec, "--threads", 1)
    assert worker(spec, "--threads", 1).returncode in (0, 10, 11)
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert found["count"] == report["count"] and found["threads"] == report["diagnostics"]["threads"]
    assert found["area"] == report["surface"]["area"]
    assert found["bounding_box"] == report["surface"]["bounding_box"]
    assert found["seconds"] > 0 and found["seconds_missing"] is None


OCTAHEDRON = ("OFF\n6 8 0\n1 0 0\n-1 0 0\n0 1 0\n0 -1 0\n0 0 1\n0 0 -1\n"
              "3 0 2 4\n3 2 1 4\n3 1 3 4\n3 3 0 4\n3 2 0 5\n3 1 2 5\n3 3 1 5\n3 0 3 5\n")


def write_volume(path):
    x = numpy.arange(160, dtype="f4") - 79.5
    write_nrrd(path, 60 - numpy.sqrt(x[:, None, None] ** 2 + x[:, None] ** 2 + x ** 2))
    return {"volume": {"path": str(path), "isovalue": 0}}


@pytest.mark.parametrize("name", ["few points", "many points", "pictures", "points grid", "volume",
                                  pytest.param("level set", marks=pytest.mark.extended), "mesh"])
def test_its_memory_is_that_of_the_job(estimate, worker, request, tmp_path, name):
    """At the peak: of loading, or of sampling. A worker's peak differs by a MiB from run to run."""
    (tmp_path / "octahedron.off").write_text(OCTAHEDRON)
    surface = {"volume": lambda: write_volume(tmp_path / "ball.nrrd"),
               "level set": lambda: {"vdb": {"path": str(request.getfixturevalue("example"))}},
               "mesh": lambda: {"mesh": {"path": str(tmp_path / "octahedron.off"), "voxel_size": 0.02}}}.get(name, lambda: TORUS)()
    output = {"pictures": {"preview": {"size": 1024}}, "points grid": {"preview": False, "points_vdb": True}}
    spec = sphere(surface=surface, sampling={"count": 60000 if name == "many points" else 1000},
                  output=output.get(name, {"preview": False}), solver={"threads": 1, "max_sweeps": 20})
    told = estimate(spec)["memory_bytes"]
    assert worker(spec).returncode in (0, 10, 11)
    peak = json.loads((tmp_path / "out" / "report.json").read_text())["peak_memory_bytes"]
    assert 0.85 * peak - 2 ** 21 < told < 1.6 * peak + 2 ** 21, (told, peak)


@pytest.mark.extended  # some seconds
@pytest.mark.parametrize("kind", ["formula", "volume", "mesh"])
def test_the_memory_that_a_message_requests_is_needed_and_suffices(worker, tmp_path, kind):
    """The peak is at most the requested limit, and the limit at most 1.5 times the peak."""
    (tmp_path / "octahedron.off").write_text(OCTAHEDRON)
    surface = {"formula": lambda: TORUS, "volume": lambda: write_volume(tmp_path / "ball.nrrd"),
               "mesh": lambda: {"mesh": {"path": str(tmp_path / "octahedron.off")}}}[kind]()
    spec = sphere(surface=surface, sampling={"count": 500000}, output={"preview": False},
                  solver={"threads": 1, "max_sweeps": 10}, limits={"memory_mb": 64})
    while True:
        done = worker(spec)
        if done.returncode in (0, 10, 11):
            break
        told = last_words(done)
        assert told["code"] == "limit_memory", told
        found = re.search(r"set it to at least (\d+)", told["message"])
        spec["limits"]["memory_mb"] = int(found[1]) if found else spec["limits"]["memory_mb"] + 16
    limit = spec["limits"]["memory_mb"] * 2 ** 20
    peak = json.loads((tmp_path / "out" / "report.json").read_text())["peak_memory_bytes"]
    assert peak <= limit <= 1.5 * peak, (peak, limit)


@pytest.mark.sanitized
def test_what_cannot_be_told(estimate):
    """The count is found on the way."""
    control = {"min_count": 100, "max_sigma": 0.3}
    found = estimate(sphere(sampling={"control": control}, solver={"method": "paper"}))
    assert found["seconds"] is None and "sampling.control" in found["seconds_missing"]


@pytest.mark.extended  # the estimate runs parts of the job for four seconds
def test_a_job_that_does_not_converge_has_no_estimated_time(estimate):
    found = estimate(long_sphere(), "--threads", 1)
    assert found["seconds"] is None and "did not end" in found["seconds_missing"]


def write_balls(where):
    """Frames 3 and 4 of a sequence; its surface."""
    x = numpy.arange(8) - 3.5
    ball = numpy.sqrt(sum(g * g for g in numpy.meshgrid(x, x, x))) - 2
    for frame in (3, 4):
        ball.astype("f4").tofile(where / f"ball.000{frame}.f32")
    return {"bspline": {"dims": [8, 8, 8], "path": str(where / "ball.####.f32")}}


PLATE = "".join(f"v {x} {y} {z}\n" for z in (0, 1e-5) for y in (0, 1) for x in (0, 1)) + "".join(
    f"f {face}\n" for face in ("1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"))


@pytest.mark.extended
def test_a_warning_of_thin_walls_does_not_ask_for_more_points_than_the_maximum(estimate, tmp_path):
    (tmp_path / "plate.obj").write_text(PLATE)
    found = estimate(sphere(surface={"mesh": {"path": "plate.obj"}}, sampling={"count": 5000000}))
    advice, walls = found["advice"]
    assert walls["code"] == "thin_walls" and found["warnings"] == []
    assert "the maximum of 100000000 points" in walls["message"] and "ask for" not in walls["message"], walls
    assert advice["set"] == {} and "the maximum of 100000000 points" in advice["message"], advice


def test_advice_names_no_memory_that_no_job_may_have(new_service, tmp_path):
    """The advice for a thin plate takes 280 000 points; that of a service with little memory sets nothing."""
    (tmp_path / "plate.obj").write_text(PLATE.replace("1e-05", "0.002"))
    spec = sphere(surface={"mesh": {"path": str(tmp_path / "plate.obj")}}, sampling={"count": 1000})
    needed = None
    for most in (4000, 120):
        service = new_service("--input_roots", tmp_path, "--host_memory_mb", most, "--memory_mb", 100).start()
        advice, _ = service.post("/v1/jobs:validate", spec).json["estimate"]["advice"]
        if most == 4000:
            needed = advice["set"]["/limits/memory_mb"]
            assert 120 < needed <= 4000, advice
        else:
            assert advice["set"] == {} and f"about {needed} MiB, more than the 120 MiB that a job may have" in advice["message"], advice
        told = service.post("/v1/jobs:validate", sphere(sampling={"spacing": 0.0008})).json["detail"]
        assert ("a job may have at most 120, so ask for fewer points" in told) == (most == 120), told


def test_points_can_be_carried_only_once(estimate, worker, tmp_path):
    spec = sphere(surface=write_balls(tmp_path), queue={"frames": "3-4", "coherent": True})
    assert worker(spec, "--frame", 3, output="3").returncode in (0, 10, 11)
    assert estimate(spec, "--frame", 3)["seconds"] > 0
    found = estimate(spec, "--frame", 4, "--previous", "3")
    assert found["count"] == 200 and found["seconds"] is None and "previous frame" in found["seconds_missing"]


def test_faults_are_those_of_the_job(worker, tmp_path):
    (tmp_path / "bad.vdb").write_bytes(b"no volume")
    for spec, code in ((sphere(surface={"vdb": {"path": "bad.vdb"}}), "input_damaged"),
                       (sphere(count=10**7, limits={"memory_mb": 64}), "limit_memory"),
                       (sphere(sampling={"spacing": 100}), "spec_invalid"),
                       (sphere(region={"min": [5, 5, 5], "max": [6, 6, 6]}), "no_surface")):
        done = worker(spec, command="estimate")
        alone = worker(spec, output="run")
        assert last_words(done) == last_words(alone) and last_words(done)["code"] == code
        assert done.returncode == alone.returncode


def test_a_check_tells_it(new_service, tmp_path):
    (tmp_path / "bad.vdb").write_bytes(b"no volume")
    service = new_service("--input_roots", tmp_path).start()
    reply = service.post("/v1/jobs:validate", sphere(surface=TORUS))
    assert reply.status == 200 and reply.json["estimate_missing"] is None
    assert reply.json["estimate"]["count"] == 200 and abs(reply.json["estimate"]["area"] - 11.8435) < 1e-3
    for surface, code in (({"vdb": {"path": str(tmp_path / "bad.vdb")}}, "input_damaged"),
                          ({"vdb": {"path": str(tmp_path / "none.vdb")}}, "input_missing")):
        expect_problem(service.post("/v1/jobs:validate", sphere(surface=surface)), 422, code)
    expect_problem(service.post("/v1/jobs:validate", sphere(limits={"memory_mb": 1 << 24})), 422, "limit_memory")
    # of a sequence it is the first frame's
    sequence = sphere(surface=write_balls(tmp_path), queue={"frames": "3-4"})
    reply = service.post("/v1/jobs:validate", sequence)
    assert reply.status == 200 and reply.json["estimate"]["count"] == 200, reply.body
    assert service.get("/v1/jobs").json["jobs"] == [] and not list((service.state / "estimates").iterdir())


def test_it_takes_a_time_and_no_more(new_service, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path, deaf=True), "--estimate_timeout_s", "0.2", "--input_roots", tmp_path).start()
    reply = service.post("/v1/jobs:validate", sphere())
    assert reply.status == 200 and reply.json["estimate"] is None
    missing = reply.json["estimate_missing"]
    assert missing.startswith("the estimate took longer than 0.2 s: run `hexad-worker estimate") and "estimate_timeout_s" in missing
    (tmp_path / "a.ply").write_text("ply\n")
    inspection = service.post("/v1/inputs:inspect", {"path": f"{tmp_path}/a.ply"})
    assert "the inspection took longer than 0.2 s: run `hexad-worker inspect FILE`" in inspection.json["detail"], inspection.body
    reply = service.post("/v1/jobs:validate?within_ms=1", sphere())
    assert reply.json["estimate_missing"] == "the estimate took longer than 0.001 s: raise within_ms of the request"
    wait_until(lambda: not service.children(), "its worker to go")
    assert not list((service.state / "estimates").iterdir())
    assert service.end() == 0


def test_a_service_that_makes_none(new_service):
    service = new_service("--estimates", 0).start()
    reply = service.post("/v1/jobs:validate", sphere())
    assert reply.status == 200 and reply.json["estimate"] is None and "estimates" in reply.json["estimate_missing"]


def test_a_service_full_of_them_takes_jobs(new_service, tmp_path):
    program, most = tmp_path / "sleeper", 33
    program.write_text("#!/bin/sh\nexec sleep 1000\n")
    program.chmod(0o700)
    service = new_service("--worker", program, "--estimates", most, "--estimate_timeout_s", 1000, "--drain_s", 0,
                          "--grace_s", 0).start()
    replies = []
    askers = [threading.Thread(target=lambda: replies.append(service.post("/v1/jobs:validate", sphere())))
              for _ in range(most)]
    for asker in askers:
        asker.start()
    wait_until(lambda: len(service.children()) == most, "all workers")
    service.submit(sphere())
    assert not replies
    assert service.end() == 0
    for asker in askers:
        asker.join()
    assert [r.status for r in replies] == [200] * most


def test_a_worker_that_does_not_start_leaves_nothing(new_service, tmp_path):
    program = tmp_path / "gone"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o700)
    service = new_service("--worker", program).start()
    program.unlink()
    reply = service.post("/v1/jobs:validate", sphere())
    assert reply.status == 200 and reply.json["estimate"] is None
    assert "cannot start the worker" in reply.json["estimate_missing"]
    assert not list((service.state / "estimates").iterdir())


ASKED = """#!/bin/sh
spec=$(cat)
printf '{"words": "%s"}' "$*" > "$4/estimate.json"
"""


@pytest.mark.sanitized
def test_its_worker_is_held_like_others(new_service, tmp_path):
    program = tmp_path / "asked"
    program.write_text(ASKED)
    program.chmod(0o700)
    service = new_service("--worker", program, "--input_roots", tmp_path).start()
    words = service.post("/v1/jobs:validate", sphere(solver={"threads": 1})).json["estimate"]["words"].split()
    assert words[:3] == ["estimate", "-", "--output"] and "/estimates/" in words[3]
    told = dict(zip(words[4::2], words[5::2]))
    assert told["--sandbox"] == "available" and told["--input-root"] == str(tmp_path)
    assert told["--threads"] == "1" and int(told["--memory-mb"]) > 0
