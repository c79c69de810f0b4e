# SPDX-License-Identifier: Apache-2.0
"""The state directory of an earlier version (tests/upgrade/make_state.py says how it was made): nothing in it is lost, what waited
and what ran when the earlier daemon died goes on."""
import hashlib
import json
import pathlib
import shutil
import sqlite3
import subprocess
import sys

import pytest

from service import PATIENCE_S, sphere

UPGRADE = pathlib.Path(__file__).parent.parent / "upgrade"
sys.path.insert(0, str(UPGRADE))
import make_state  # noqa: E402

ENDED = ("succeeded", "failed", "cancelled")


@pytest.fixture(params=["0.1.0"])
def upgraded(request, new_service, tmp_path):
    """A service on a copy of that version's state, started, and the jobs as that version told them: by name."""
    earlier = UPGRADE / request.param
    inputs = tmp_path / "inputs"
    inputs.mkdir()
    make_state.write_frames(inputs)
    service = new_service("--input_roots", inputs, "--listen", f"unix:{tmp_path}/socket")  # as an administrator
    for part in ("attempts", "inputs", "results"):
        # as new: inputs that nobody has used for days are deleted
        shutil.copytree(earlier / part, service.state / part, copy_function=shutil.copyfile)
    with sqlite3.connect(service.state / "queue.db") as database:
        database.executescript((earlier / "queue.sql").read_text())
    database.close()
    service.start()
    return service, {job["name"]: job for job in json.loads((earlier / "jobs.json").read_text())}


def served(service, job, query=""):
    """name -> content of the files of a result, each held against its listing."""
    listing = service.get(f"/v1/jobs/{job}/results{query}")
    assert listing.status == 200, listing.body
    found = {item["name"]: service.get(item["href"]).body for item in listing.json["results"]}
    assert {n: hashlib.sha256(b).hexdigest() for n, b in found.items()} == {i["name"]: i["sha256"] for i in listing.json["results"]}
    return found


def test_nothing_is_lost_and_all_goes_on(upgraded):
    service, earlier = upgraded
    told = {job["name"]: job for job in service.get("/v1/jobs?limit=100").json["jobs"]}
    assert {n: (j["id"], j["labels"], j["priority"]) for n, j in told.items()} == \
        {n: (j["id"], j["labels"], j["priority"]) for n, j in earlier.items()}
    ended = [n for n, j in earlier.items() if j["state"] in ENDED]
    assert {n: (told[n]["state"], told[n]["outcome"]) for n in ended} == \
        {n: (earlier[n]["state"], earlier[n]["outcome"]) for n in ended} and len(ended) == 4
    assert {"points.ply", "report.json"} <= set(served(service, told["sent"]["id"]))
    assert served(service, told["frames"]["id"], "?frame=1") != served(service, told["frames"]["id"], "?frame=2")

    # what ran starts again, and that costs none of its attempts; what it had written is no result
    for name in ("runs", "waits", "after", "waits with a sent file", "waiting frames"):
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
