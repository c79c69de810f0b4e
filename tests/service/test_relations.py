# SPDX-License-Identifier: Apache-2.0
"""What a user learns of another user's job through a relation of jobs: a dependency, frames that wait for frames, a result that is reused."""
import json
import subprocess

import pytest

from accounts import some
from service import PARTLY_UNRESOLVED, PATIENCE_S, expect_problem, sphere, wait_until

ONLY_WHETHER = "which did not succeed as required: ask its owner"


@pytest.fixture
def both(users):
    made = users()
    made.service.start()
    return made


def array(frames="1-3", **queue):
    spec = some()
    spec["queue"] = {"frames": frames, **queue}
    if "by_frame" not in queue:
        spec["queue"]["by_frame"] = {"/solver/seed": [1, 2, 3]}
    return spec


def behind(*jobs, by="depends_on"):
    return {**some(), "queue": {by: list(jobs)}}


def run_as(both, user, *words):
    return subprocess.run([both.service.build / "hexadctl", *words], capture_output=True, text=True, timeout=PATIENCE_S,
                          env={**both.service.environment(), "HEXAD_TOKEN": both.tokens[user]})


def hold(both, on=True):
    assert both.ask("root", "POST", "/v1/admin/hold" if on else "/v1/admin/release").status == 200


def expect_only_whether(both, job, need, told=ONLY_WHETHER):
    """All that ben can read of the job says whether the other one succeeded as required, and nothing else."""
    text = f"this job depends on the job {need}, {told}"
    done = both.wait("ben", job, "failed")
    assert done["error"] == {"code": "dependency_failed", "message": text}
    tasks = both.ask("ben", "GET", f"/v1/jobs/{job}/tasks").json["tasks"]
    assert [t["error"]["message"] for t in tasks] == [text]
    assert text in run_as(both, "ben", "show", job).stdout
    read = [json.dumps(done), json.dumps(tasks), both.ask("ben", "GET", "/v1/jobs?owner=ben").body.decode(),
            both.ask("ben", "GET", f"/v1/jobs/{job}/attempts").body.decode(), both.ask("ben", "POST", f"/v1/jobs/{job}/retry").body.decode()]
    for words in (("show", job), ("wait", job), ("list", "--owner", "ben")):
        shown = run_as(both, "ben", *words)
        read.append(shown.stdout + shown.stderr)
    for hidden in ("excludes", "has the outcome", "which is "):
        assert [text for text in read if hidden in text] == []


@pytest.mark.sanitized
def test_a_dependency_on_another_users_job_shows_only_whether_it_succeeded(both):
    strict = both.submit("ann", {**PARTLY_UNRESOLVED, "queue": {**PARTLY_UNRESOLVED["queue"], "accept": ["converged"]}})
    waiting, of_ann = both.submit("ben", behind(strict)), both.submit("ann", behind(strict))
    assert both.wait("ann", strict, "succeeded")["accepted"] is False
    expect_only_whether(both, waiting, strict)
    later = both.ask("ben", "POST", "/v1/jobs", behind(strict))
    assert later.status == 201 and later.json["state"] == "failed" and later.json["error"] is None
    expect_only_whether(both, later.json["id"], strict)
    message = both.wait("ann", of_ann, "failed")["error"]["message"]
    assert message == f"this job depends on the job {strict}, which has the outcome unresolved, which its queue.accept excludes"
    empty = both.submit("ann", {**some(), "region": {"min": [5, 5, 5], "max": [6, 6, 6]}})
    both.wait("ann", empty, "failed")
    expect_only_whether(both, both.submit("ben", behind(empty)), empty)
    of_ann = both.submit("ann", behind(empty))
    assert both.wait("ann", of_ann, "failed")["error"]["message"].endswith(f"{empty}, which is failed: retry that job first")
    both.wait("ben", both.submit("ben", behind(strict, empty, by="after")), "succeeded")


def test_frames_wait_for_frames_of_own_jobs_only(both):
    """The refusal does not show whether the other job has the frames, or frames at all."""
    hold(both)
    frames, single, own = both.submit("ann", array()), both.submit("ann", some()), both.submit("ben", array())
    refusals = [expect_problem(both.ask("ben", "POST", "/v1/jobs", array(numbers, after_frames=[job], by_frame={"/solver/seed": seeds})),
                               403, "forbidden", "/queue/after_frames/0")["detail"].replace(job, "ID")
                for job in (frames, single) for numbers, seeds in (("1-3", [1, 2, 3]), ("3-4", [1, 2]), ("8", [1]))]
    assert len(set(refusals)) == 1 and "belongs to another user" in refusals[0] and "ann" not in refusals[0], refusals
    expect_problem(both.ask("ben", "POST", "/v1/jobs", array(after_frames=[own, frames])), 403, "forbidden", "/queue/after_frames/1")
    expect_problem(both.ask("ben", "POST", "/v1/jobs", array(after=[frames], after_frames=[frames])), 403, "forbidden", "/queue/after_frames/0")
    expect_problem(both.ask("ben", "POST", "/v1/jobs", array(after_frames=["nobody"])), 422, "spec_invalid", "/queue/after_frames/0")
    expect_problem(both.ask("ben", "POST", "/v1/jobs", array("1-4", after_frames=[own], by_frame={"/solver/seed": [1, 2, 3, 4]})),
                   422, "spec_invalid", "/queue/after_frames/0")
    assert {job["id"] for job in both.ask("root", "GET", "/v1/jobs").json["jobs"]} == {frames, single, own}
    for user, need in (("ben", own), ("ann", frames), ("root", frames)):
        assert both.ask(user, "GET", f"/v1/jobs/{both.submit(user, array(after_frames=[need]))}").json["state"] == "blocked"


def test_a_job_that_waits_for_frames_of_another_user_goes_on_after_a_restart(both):
    """An administrator's job; jobs of earlier versions are in test_queue."""
    hold(both)
    first = both.submit("ann", array())
    second = both.submit("root", array(after_frames=[first]))
    both.service.end()
    both.service.start()
    assert both.ask("root", "GET", f"/v1/jobs/{second}").json["state"] == "blocked"
    hold(both, False)
    assert both.wait("root", second, "succeeded")["tasks"]["succeeded"] == 3
    assert both.ask("ann", "GET", f"/v1/jobs/{first}").json["state"] == "succeeded"


@pytest.mark.sanitized
def test_a_reused_result_names_no_job_of_another_user(both):
    first = both.run("ann", some("ann's"))
    second, own = both.run("ben", some("ben's")), both.run("ann", some("ann's again"))
    assert len(second["attempts"]) == 1 and second["cached_from"] is None and own["cached_from"] == first["id"]
    third = both.run("ben", some("ben's again"))
    for job in (second["id"], third["id"]):
        for path in ("", "/attempts", "/tasks", "/results", "/results/report.json", "/events?after=0"):
            answer = both.ask("ben", "GET", f"/v1/jobs/{job}{path}")
            assert first["id"].encode() not in answer.body, path
        log = expect_problem(both.ask("ben", "GET", f"/v1/jobs/{job}/log"), 404, "not_found")["detail"]
        assert first["id"] not in log and "the result of an equal job" in log
        for words in (("show", job), ("log", job), ("wait", job), ("list",)):
            shown = run_as(both, "ben", *words)
            assert f"result of  {first['id']}" not in shown.stdout and (words == ("list",) or first["id"] not in shown.stdout + shown.stderr)
    listed = {job["id"]: job["cached_from"] for job in both.ask("ben", "GET", "/v1/jobs").json["jobs"]}
    assert listed == {first["id"]: None, second["id"]: None, own["id"]: None, third["id"]: None}
    for _ in range(2):  # once from the database, once from the cache of documents, in either order of readers
        for user, shown in (("root", first["id"]), ("ben", None), ("ann", None), ("root", first["id"])):
            assert both.ask(user, "GET", f"/v1/jobs/{second['id']}").json["cached_from"] == shown, user
    listed = {job["id"]: job["cached_from"] for job in both.ask("root", "GET", "/v1/jobs").json["jobs"]}
    assert listed[second["id"]] == listed[own["id"]] == first["id"]
    assert first["id"] in both.ask("root", "GET", f"/v1/jobs/{second['id']}/log").json["detail"]
    assert first["id"] in both.ask("ann", "GET", f"/v1/jobs/{own['id']}/log").json["detail"]
    assert both.ask("ann", "DELETE", f"/v1/jobs/{first['id']}").status == 204  # it stays the answer of whose job it was
    assert both.ask("ann", "GET", f"/v1/jobs/{own['id']}").json["cached_from"] == first["id"]
    assert both.ask("ben", "GET", f"/v1/jobs/{second['id']}").json["cached_from"] is None


def test_a_retry_with_dependents_names_only_jobs_of_the_caller(both):
    """Which jobs depend on one is a part of their specs."""
    hold(both)
    first, broken = both.submit("ann", some()), both.submit("ann", some())
    of_ben, of_ann, stuck = both.submit("ben", behind(first)), both.submit("ann", behind(first)), both.submit("ann", behind(first, broken))
    for job in (first, broken):
        assert both.ask("ann", "POST", f"/v1/jobs/{job}/cancel").status == 200
    for job in (of_ben, of_ann, stuck):
        both.wait("root", job, "failed")
    retried = both.ask("ann", "POST", f"/v1/jobs/{first}/retry?dependents=1")
    assert retried.status == 200 and retried.json["dependents"] == {"retried": 1, "others": [stuck]}, retried.body
    assert of_ben not in retried.body.decode()
    told = run_as(both, "ann", "retry", first, "--dependents")
    assert of_ben not in told.stdout + told.stderr
    assert both.ask("root", "POST", f"/v1/jobs/{first}/retry?dependents=1").json["dependents"] == {"retried": 1, "others": [stuck]}
    wait_until(lambda: both.ask("ben", "GET", f"/v1/jobs/{of_ben}").json["state"] == "blocked", "the retry by the administrator")


def test_the_list_of_dependents_has_own_jobs_only(both):
    hold(both)
    first = both.submit("ann", sphere())
    of_ben = both.submit("ben", behind(first))
    assert both.ask("ann", "GET", f"/v1/jobs?depends_on={first}").json["jobs"] == []
    assert [job["id"] for job in both.ask("ben", "GET", f"/v1/jobs?depends_on={first}").json["jobs"]] == [of_ben]
