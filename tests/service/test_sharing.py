# SPDX-License-Identifier: Apache-2.0
"""How users share the service: turns, weights, priorities, limits, and a hold of the whole queue."""
import json
import subprocess

import pytest

from accounts import new_token
from commands import control, run_hexad
from service import expect_problem, sphere, wait_until


@pytest.mark.parametrize("many", [60, pytest.param(300, marks=pytest.mark.extended)])
def test_one_job_is_next_behind_many(farm, many):
    shared = farm()
    for _ in range(many):
        shared.submit("ann")
    assert shared.running()[0] == "ann"
    bobs = shared.submit("bob")
    assert shared.next() == ("bob", bobs)
    assert shared.next()[0] == "ann"


def test_weights_give_more_turns(farm):
    shared = farm("--user_weights", "ann:2,*:1")
    for _ in range(8):
        for user in ("ann", "bob", "eve"):
            shared.submit(user)
    order = [shared.running()[0], *(shared.next()[0] for _ in range(7))]
    assert {user: order.count(user) for user in order} == {"ann": 4, "bob": 2, "eve": 2}


def test_a_wrong_weight_is_told(build, tmp_path):
    done = run_hexad(build, "--state_dir", tmp_path / "state", "--user_weights", "ann:0")
    assert done.returncode != 0 and "user_weights: ann:0: the number must be from 0.01 to 100" in done.stderr


def test_priorities_have_a_limit(farm):
    shared = farm("--user_priorities", "ann:50,*:0")
    job = shared.submit("ann", queue={"priority": 50})
    for user, priority in (("ann", 51), ("bob", 1)):
        refused = shared.ask(user, "POST", "/v1/jobs", sphere(queue={"priority": priority}))
        expect_problem(refused, 403, "priority_forbidden")
        assert refused.json["errors"][0]["pointer"] == "/queue/priority"
        assert "user_priorities" in refused.json["detail"]
    expect_problem(shared.ask("bob", "POST", "/v1/jobs:validate", sphere(queue={"priority": 1})), 403,
                   "priority_forbidden")
    refused = shared.ask("ann", "PATCH", f"/v1/jobs/{job}", {"priority": 51})
    expect_problem(refused, 403, "priority_forbidden")
    assert shared.ask("ann", "PATCH", f"/v1/jobs/{job}", {"priority": -3}).status == 200
    shared.submit("bob", queue={"priority": -1000})
    assert shared.ask("admin", "PATCH", f"/v1/jobs/{job}", {"priority": 1000}).status == 200
    shared.submit("admin", queue={"priority": 1000})


def test_a_token_may_lower_the_limit_of_priorities(farm):
    """The lower of the user's limit and the token's holds; a token's holds for administrators, too."""
    shared = farm("--user_priorities", "ann:50,*:0")
    for name, user, most in (("ann_20", "ann", "20"), ("bob_20", "bob", "20"), ("admin_-5", "root", "-5")):
        scopes = "admin" if user == "root" else "read,submit,cancel"
        shared.tokens[name] = new_token(shared.service, user, "--scopes", scopes, "--max-priority", most)
    job = shared.submit("ann_20", queue={"priority": 20})
    for name, priority, words in (("ann_20", 21, "token"), ("bob_20", 1, "user_priorities"), ("admin_-5", 0, "token")):
        for path in ("/v1/jobs", "/v1/jobs:validate"):
            refused = shared.ask(name, "POST", path, sphere(queue={"priority": priority}))
            expect_problem(refused, 403, "priority_forbidden")
            assert refused.json["errors"][0]["pointer"] == "/queue/priority"
            assert words in refused.json["detail"]
    refused = shared.ask("ann_20", "PATCH", f"/v1/jobs/{job}", {"priority": 21})
    expect_problem(refused, 403, "priority_forbidden")
    assert shared.ask("ann", "PATCH", f"/v1/jobs/{job}", {"priority": 21}).status == 200
    shared.submit("admin_-5", queue={"priority": -5})


@pytest.mark.sanitized
def test_tokens_are_listed_with_their_limits(farm):
    shared = farm()
    new_token(shared.service, "cid", "--max-priority", "-3")

    def tell(*words):
        return control(shared.service, "token", *words, "--file", shared.service.state / "tokens")

    listed = {t["user"]: t.get("max_priority") for t in json.loads(tell("list", "--json")[1])}
    assert listed == {"ann": None, "bob": None, "eve": None, "admin": None, "cid": -3}
    last = {line.split()[1]: line.split()[-1] for line in tell("list")[1].splitlines()}
    assert (last["USER"], last["ann"], last["cid"]) == ("MAX_PRIORITY", "-", "-3")
    for wrong in ("high", "", "1001", "2x"):
        code, _, told = tell("add", "dan", "--max-priority", wrong)
        assert code == 2 and "--max-priority" in told and "-1000 to 1000" in told


@pytest.mark.sanitized
def test_submissions_have_a_limit(farm):
    shared = farm("--user_submissions", 3)
    key = {"Idempotency-Key": "k"}
    first = shared.ask("ann", "POST", "/v1/jobs", sphere(), **key)
    assert first.status == 201
    for _ in range(2):  # the same request again is no other submission
        assert shared.ask("ann", "POST", "/v1/jobs", sphere(), **key).json["id"] == first.json["id"]
        shared.submit("ann")
    assert shared.ask("ann", "POST", "/v1/jobs", sphere(), **key).json["id"] == first.json["id"]
    refused = shared.ask("ann", "POST", "/v1/jobs", sphere())
    expect_problem(refused, 429, "too_many_submissions")
    assert 0 < int(refused.headers["Retry-After"]) <= 1200
    shared.submit("bob")


def test_a_hold_starts_no_job(farm):
    shared = farm()
    first = shared.submit("ann")
    assert shared.running() == ("ann", first)
    assert shared.ask("ann", "POST", "/v1/admin/hold").status == 403
    assert shared.ask("admin", "POST", "/v1/admin/hold").json == {"held": True, "running": 1}
    second = shared.submit("bob")
    shared.service.open_gate(first)
    wait_until(lambda: shared.ask("ann", "GET", f"/v1/jobs/{first}").json["state"] == "succeeded", "its end")
    shared.service.end()
    shared.service.start()
    ready = shared.service.get("/readyz")
    assert ready.status == 200 and ready.json["checks"]["queue"] == "held"
    assert b"\nhexad_held 1\n" in shared.ask("ann", "GET", "/metrics").body
    third = shared.submit("ann", queue={"priority": 9})  # the executor looks whether it can start it
    assert shared.ask("admin", "GET", "/v1/workers").json["workers"] == []
    assert shared.ask("bob", "GET", f"/v1/jobs/{second}").json["state"] == "queued"
    assert shared.ask("admin", "POST", "/v1/admin/release").json["held"] is False
    assert shared.running() == ("ann", third)
    assert shared.service.get("/readyz").json["checks"]["queue"] == "ok"


@pytest.mark.sanitized
def test_the_client_holds_and_releases(new_service):
    service = new_service()
    at = service.options.index("--listen")
    del service.options[at:at + 2]
    service.start()
    code, out, _ = control(service, "hold")
    assert code == 0 and out.startswith("0 attempts run\nheld: ") and "hexadctl release" in out
    assert service.get("/readyz").json["checks"]["queue"] == "held"
    job = service.submit(sphere())
    for words in (("workers",), ("list",), ("show", job)):  # so that its owner learns why it waits
        assert out.splitlines()[1] in "".join(control(service, *words)[1:]), words
    assert json.loads(control(service, "--json", "hold")[1]) == {"held": True, "running": 0}
    code, out, _ = control(service, "release")  # the job may have begun before the answer
    assert code == 0 and out in ("the hold is ended\n0 attempts run\n", "the hold is ended\n1 attempt runs\n") and "held" not in control(service, "workers")[1]
    service.wait_state(job, "succeeded")
    assert control(service, "release")[1].startswith("the queue was not held\n")
    assert control(service, "list")[2] == control(service, "show", job)[2] == ""


def test_a_job_that_waits_for_its_users_own_attempts_says_so(farm):
    shared = farm("--user_running", 1, workers=3)
    submitted = {user: [shared.submit(user), shared.submit(user)] for user in ("ann", "bob")}

    def say(user, *words):
        environment = {**shared.service.environment(), "HEXAD_TOKEN": shared.tokens[user]}
        done = subprocess.run([shared.service.build / "hexadctl", *words], env=environment, capture_output=True, text=True, check=True)
        return [line for line in (done.stdout + done.stderr).splitlines() if "user_running" in line]

    wait_until(lambda: len(shared.ask("admin", "GET", "/v1/workers").json["workers"]) == 2, "an attempt of each user")
    lines = {user: f"{user}: 1 of 1 running attempts (setting user_running): other jobs of this user wait" for user in submitted}
    assert sorted(say("ann", "workers")) == sorted(say("ann", "list")) == sorted(lines.values())
    for user, jobs in submitted.items():
        assert [say(user, "show", job) for job in jobs] == [[], [lines[user]]]
