# SPDX-License-Identifier: Apache-2.0
"""State directories of earlier builds (tests/upgrade/make_state.py makes them): nothing in them is lost, waiting jobs run, and no result is
reused. Older ones are refused."""
import hashlib
import pathlib
import shutil
import sqlite3
import subprocess
import sys

import pytest

from service import PATIENCE_S, sphere

UPGRADE = pathlib.Path(__file__).parent.parent / "upgrade"
sys.path.insert(0, str(UPGRADE))
sys.path.insert(0, str(UPGRADE.parents[1] / "clients/python"))
import hexad  # noqa: E402
import make_state  # noqa: E402

ENDED = ("succeeded", "failed", "cancelled")
WAITING = ("runs", "waits", "after", "waits with a sent file", "waits, equal to sent", "waits with defaults", "waiting frames")


@pytest.fixture(params=["d10413d0", "ef072324", "7218b1f7"])
def upgraded(request, new_service, tmp_path):
    """A service on a copy of the state of that commit, started, and the jobs of jobs.json by name."""
    earlier = UPGRADE / request.param
    inputs = tmp_path / "inputs"
    inputs.mkdir()
    make_state.write_frames(inputs)
    service = new_service("--input_roots", inputs, "--listen", f"unix:{tmp_path}/socket")  # as an administrator
    make_state.put_back(earlier, service.state)
    make_state.make_database(earlier, service.state / "queue.db")
    service.start()
    return service, make_state.read_jobs(earlier)


def served(service, job, query=""):
    """name -> content of the files of a result, each held against its listing."""
    listing = service.get(f"/v1/jobs/{job}/results{query}")
    assert listing.status == 200, listing.body
    found = {item["name"]: service.get(item["href"]).body for item in listing.json["results"]}
    assert {n: hashlib.sha256(b).hexdigest() for n, b in found.items()} == {i["name"]: i["sha256"] for i in listing.json["results"]}
    return found


def jobs_by_name(service):
    return {job["name"]: job for job in service.get("/v1/jobs?limit=100").json["jobs"]}


def test_nothing_is_lost_and_all_goes_on(upgraded):
    service, earlier = upgraded
    told = jobs_by_name(service)
    assert {n: (j["id"], j["labels"], j["priority"]) for n, j in told.items()} == \
        {n: (j["id"], j["labels"], j["priority"]) for n, j in earlier.items()}
    ended = [n for n, j in earlier.items() if j["state"] in ENDED]
    assert {n: (told[n]["state"], told[n]["outcome"]) for n in ended} == \
        {n: (earlier[n]["state"], earlier[n]["outcome"]) for n in ended} and len(ended) == 5
    assert {"points.ply", "report.json"} <= set(served(service, told["sent"]["id"]))
    assert served(service, told["frames"]["id"], "?frame=1") != served(service, told["frames"]["id"], "?frame=2")

    # what ran starts again, and that costs none of its attempts; what it had written is no result
    for name in WAITING:
        service.wait_state(told[name]["id"], "succeeded")
    attempts = service.get(f"/v1/jobs/{told['runs']['id']}/attempts").json["attempts"]
    assert len(attempts) == 2 and "exit_status" not in attempts[0] and attempts[1]["exit_status"] == 0, attempts
    assert set(served(service, told["runs"]["id"])) == {"points.ply", "report.json"}
    served(service, told["waiting frames"]["id"], "?frame=2")
    assert service.job(told["paused"]["id"])["state"] == "paused"
    assert service.post(f"/v1/jobs/{told['paused']['id']}/resume").status == 200
    service.wait_state(told["paused"]["id"], "succeeded")

    # a job that failed may be tried again, and a new one runs
    assert service.post(f"/v1/jobs/{told['broken']['id']}/retry").status == 200
    service.wait_state(told["broken"]["id"], "failed")
    service.wait_state(service.submit(sphere()), "succeeded")


def test_uploads_of_earlier_builds_are_held_by_their_user(upgraded):
    """Files beside the uploads recorded who holds them, until version 22."""
    service, earlier = upgraded
    stored = {path.name for path in (service.state / "inputs").iterdir()}
    files = service.get("/v1/inputs").json["inputs"]
    assert len(files) == 2 and {file["path"] for file in files} == stored
    usage, = (user for user in service.get("/v1/usage").json["users"] if user["upload_bytes"])
    assert usage["upload_bytes"] == sum(file["bytes"] for file in files)
    for name in WAITING:
        service.wait_state(earlier[name]["id"], "succeeded")
    for file in files:
        assert service.request("DELETE", f"/v1/inputs/{file['sha256']}").status == 204
    assert not list((service.state / "inputs").iterdir()) and service.get("/v1/inputs").json["inputs"] == []
    service.end()
    service.start()
    assert service.get("/v1/inputs").json["inputs"] == []


def test_a_waiting_job_has_the_defaults_of_its_build(upgraded, request):
    """A stored spec has every default of the build that stored it, also defaults that have changed since."""
    service, earlier = upgraded
    job = earlier["waits with defaults"]["id"]
    service.wait_state(job, "succeeded")
    for spec in (service.job(job)["spec"], service.get(f"/v1/jobs/{job}/results/report.json").json["spec"]):
        found = spec["surface"]["mesh"]["interior"], spec["output"]["preview"]["compression"]
        assert found == {"d10413d0": ("keep", "none"), "ef072324": ("auto", "zip"),
                         "7218b1f7": ("auto", "zip")}[request.node.callspec.params["upgraded"]]
    assert {"kappa1", "energy", "spacing"} <= set(hexad.Client(service.environment()["HEXAD_SERVER"]).job(job).points())


@pytest.mark.parametrize("upgraded", ["7218b1f7"], indirect=True)
def test_a_waiting_job_with_a_removed_member_fails_with_what_replaces_it(upgraded):
    service, earlier = upgraded
    job = service.wait_state(earlier["waits with a removed member"]["id"], "failed")
    assert job["error"]["code"] == "spec_invalid" and "/sampling/time_s: was removed: give count" in job["error"]["message"], job["error"]


def test_no_result_of_an_earlier_build_is_reused(upgraded, request):
    """From 7218b1f7 on the keys of results have the commit of the build: its waiting jobs find its results, and new jobs do not."""
    service, earlier = upgraded
    has_commit = request.node.callspec.params["upgraded"] == "7218b1f7"
    sent = earlier["sent"]
    assert earlier["cached"]["cached_from"] == sent["id"] == service.job(earlier["cached"]["id"])["cached_from"]
    assert served(service, earlier["cached"]["id"])["points.ply"] == served(service, sent["id"])["points.ply"]
    waited = service.wait_state(earlier["waits, equal to sent"]["id"], "succeeded")
    assert waited["cached_from"] == (sent["id"] if has_commit else None)

    # an equal new job is computed, and the result of this build is reused
    text = make_state.TETRAHEDRON.format(1)
    path = service.request("PUT", f"/v1/inputs/{hashlib.sha256(text.encode()).hexdigest()}", text).json["path"]
    first, second = (service.wait_state(service.submit(make_state.mesh(name, path)), "succeeded") for name in ("first", "second"))
    assert first["cached_from"] is None and second["cached_from"] == first["id"]
    assert service.end() == 0
    if has_commit:
        return
    with sqlite3.connect(service.state / "queue.db") as database:
        keys = database.execute("SELECT id FROM job JOIN spec ON spec.job = seq WHERE cache_key IS NOT NULL").fetchall()
        kept = database.execute("SELECT id FROM job JOIN cache ON cache.job = seq").fetchall()
    database.close()
    assert {id for (id,) in keys} == {first["id"], second["id"]} and kept == [(first["id"],)]


def test_reports_of_earlier_builds_are_readable(upgraded, build):
    """Members whose places have changed are found in both by the page; hexadctl and the Python client show such results."""
    service, earlier = upgraded
    job = earlier["sent"]["id"]
    report = service.get(f"/v1/jobs/{job}/results/report.json").json
    assert report.get("diagnostics", report)["threads"] == 1 and {"unresolved_count", "thin_count"} & set(report["quality"])
    notes = service.job(job)["notes"]
    assert notes["outcome_reasons"][0]["message"] and notes["warnings"] is not None and notes["advice"] is not None
    shown = subprocess.run([build / "hexadctl", "show", job], capture_output=True, text=True, timeout=PATIENCE_S,
                           env=service.environment())
    assert shown.returncode == 0 and notes["outcome_reasons"][0]["message"] in shown.stdout, shown.stderr
    remote = hexad.Client(service.environment()["HEXAD_SERVER"]).job(job)
    assert remote.outcome == "unresolved" and remote.points().count == 60 and remote.outcome_reasons()


def tree(folder):
    return {p.relative_to(folder): p.read_bytes() if p.is_file() else None for p in folder.rglob("*") if p.name != "lock"}


@pytest.mark.parametrize("has_log", [False, True], ids=["closed", "with a log"])
def test_an_older_state_is_refused_and_unchanged(new_service, tmp_path, has_log):
    earlier = UPGRADE / "681e8d2"
    service = new_service("--listen", f"unix:{tmp_path}/socket")
    make_state.put_back(earlier, service.state)
    database = sqlite3.connect(tmp_path / "queue.db")
    database.execute("PRAGMA journal_mode = WAL")
    database.executescript((earlier / "queue.sql").read_text())
    if not has_log:
        database.close()
    for file in tmp_path.glob("queue.db*"):
        if not file.name.endswith("-shm"):
            shutil.copyfile(file, service.state / file.name)
    database.close()
    before = tree(service.state)
    assert (service.state / "queue.db-wal").exists() == has_log
    done = subprocess.run([service.build / "hexad", "--state_dir", service.state, *map(str, service.options)], capture_output=True, text=True,
                          timeout=PATIENCE_S)
    (line,) = [line for line in done.stderr.splitlines() if " error " in line]
    assert done.returncode == 1 and "queue.db" in line and "has version 4, and this hexad converts versions 11 to " in line, done.stderr
    assert {name: content for name, content in tree(service.state).items() if name in before} == before


def test_the_state_is_sound_and_stays_so(upgraded, build):
    service, earlier = upgraded
    service.wait_state(earlier["after"]["id"], "succeeded")
    assert service.end() == 0
    checked = subprocess.run([build / "hexad", "--state_dir", service.state, "--check"], capture_output=True, text=True,
                             timeout=PATIENCE_S)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    assert not (service.state / "lost+found").exists()
    service.start()
    assert len(service.get("/v1/jobs?limit=100").json["jobs"]) == len(earlier)
