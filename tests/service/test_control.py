# SPDX-License-Identifier: Apache-2.0
"""What clients do with jobs that are there: keys and conditions, waiting, changing, following."""
import json
import re
import resource
import socket
import subprocess
import threading

import pytest

from accounts import new_token, with_token
from commands import control
from service import PATIENCE_S, Stream, expect_problem, gated_worker, sphere, wait_until


@pytest.fixture
def gated(clean_gated):
    """One worker, which ends a job when its gate is opened; the daemon is the same for all tests of this file."""
    return clean_gated


@pytest.fixture
def service(clean_service):
    """One daemon for the tests of this file, without jobs of other tests."""
    return clean_service


def submit_with_key(service, key, spec):
    return service.request("POST", "/v1/jobs", json.dumps(spec),
                           {"Content-Type": "application/json", "Idempotency-Key": key})


def test_a_key_makes_one_job(service):
    first = submit_with_key(service, "k-1", sphere(name="a"))
    assert first.status == 201
    again = submit_with_key(service, "k-1", sphere(name="a"))
    assert again.status == 201 and again.json["id"] == first.json["id"]
    assert again.headers["Location"] == first.headers["Location"]
    expect_problem(submit_with_key(service, "k-1", sphere(name="b")), 422, "idempotency_mismatch")
    assert submit_with_key(service, "k-2", sphere(name="a")).json["id"] != first.json["id"]
    assert len(service.get("/v1/jobs").json["jobs"]) == 2
    expect_problem(submit_with_key(service, "x" * 256, sphere()), 400, "request_invalid")
    # it outlives the service
    service.end()
    service.start()
    assert submit_with_key(service, "k-1", sphere(name="a")).json["id"] == first.json["id"]


def test_keys_that_come_at_once(service):
    """Of many that send the same at the same time, one makes the job."""
    ids = []

    def send():
        ids.append(submit_with_key(service, "same", sphere()).json["id"])

    threads = [threading.Thread(target=send) for _ in range(16)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert len(ids) == 16 and len(set(ids)) == 1


def test_lists_are_filtered_and_linked(gated):
    for i in range(3):
        gated.submit(sphere(name=f"n{i}", queue={"labels": ["a", f"l{i}"]}))
    assert [j["name"] for j in gated.get("/v1/jobs?label=l1").json["jobs"]] == ["n1"]
    assert len(gated.get("/v1/jobs?owner=anyone").json["jobs"]) == 3
    assert gated.get("/v1/jobs?owner=nobody").json["jobs"] == []
    page = gated.get("/v1/jobs?label=a&limit=2")
    target, _, rel = page.headers["Link"].partition(";")
    assert rel.strip() == 'rel="next"'
    rest = gated.get(target.strip("<>"))
    assert [j["name"] for j in rest.json["jobs"]] == ["n0"] and "Link" not in rest.headers


def test_what_a_client_knows_is_not_told_again(gated):
    job = gated.submit(sphere())
    gated.wait_worker(job)
    queued = gated.submit(sphere())
    first = gated.get(f"/v1/jobs/{queued}")
    tag = first.headers["ETag"]
    again = gated.request("GET", f"/v1/jobs/{queued}", headers={"If-None-Match": tag})
    assert again.status == 304 and again.body == b"" and again.headers["ETag"] == tag
    assert gated.post(f"/v1/jobs/{queued}/pause").status == 200
    changed = gated.request("GET", f"/v1/jobs/{queued}", headers={"If-None-Match": tag})
    assert changed.status == 200 and changed.json["state"] == "paused" and changed.headers["ETag"] != tag


def test_an_answer_waits_for_the_end(gated):
    job = gated.submit(sphere())
    gated.wait_worker(job)
    got = []

    def ask():
        got.append(gated.request("GET", f"/v1/jobs/{job}", headers={"Prefer": "wait=60"}))

    waiting = threading.Thread(target=ask)
    waiting.start()
    wait_until(lambda: int(re.search(rb"hexad_http_connections (\d+)", gated.get("/metrics").body)[1]) > 1,
               "the request that waits")
    assert not got  # nothing has ended it
    gated.open_gate(job)
    waiting.join(PATIENCE_S)
    assert got[0].status == 200 and got[0].json["state"] == "succeeded"


@pytest.mark.sanitized
def test_the_answer_to_a_submission_and_to_a_retry_waits_for_the_end(gated):
    def ask(path, document, wait):
        got = []
        headers = {"Prefer": f"wait={wait}", "Content-Type": "application/json"}
        body = json.dumps(document) if document else None
        thread = threading.Thread(target=lambda: got.append(gated.request("POST", path, body, headers)))
        thread.start()
        return thread, got

    def only_job(state):
        return wait_until(lambda: gated.get(f"/v1/jobs?state={state}").json["jobs"], "the job")[0]["id"]

    waiting, got = ask("/v1/jobs", sphere(), 60)
    job = only_job("running")
    gated.open_gate(job)
    waiting.join(PATIENCE_S)
    assert got[0].status == 201 and got[0].json["state"] == "succeeded" and got[0].headers["Location"] == f"/v1/jobs/{job}"
    assert got[0].headers["Preference-Applied"] == "wait=60" and got[0].headers["ETag"] == gated.get(f"/v1/jobs/{job}").headers["ETag"]
    # no longer than it was asked to
    waiting, got = ask("/v1/jobs", sphere(), 0.2)
    waiting.join(PATIENCE_S)
    job = got[0].json["id"]
    assert got[0].status == 201 and got[0].json["state"] in ("queued", "running")
    gated.wait_worker(job)
    gated.post(f"/v1/jobs/{job}/cancel")
    gated.wait_state(job, "cancelled")
    waiting, got = ask(f"/v1/jobs/{job}/retry?dependents=1", None, 60)
    gated.wait_worker(job)
    assert not got
    gated.open_gate(job)
    waiting.join(PATIENCE_S)
    assert got[0].status == 200 and got[0].json["state"] == "succeeded" and got[0].json["dependents"] == {"retried": 0, "others": []}
    assert "Preference-Applied" not in gated.post("/v1/jobs", sphere()).headers
    expect_problem(gated.request("POST", "/v1/jobs", "{}", {"Prefer": "wait=60", "Content-Type": "application/json"}), 422, "spec_invalid")


def test_a_wait_is_bounded_by_the_service(new_service, tmp_path):
    gated = new_service("--worker", gated_worker(tmp_path), "--wait_limit_s", 0.1).start()
    headers = {"Prefer": "wait=3000", "Content-Type": "application/json"}
    reply = gated.request("POST", "/v1/jobs", json.dumps(sphere()), headers)
    assert reply.status == 201 and reply.headers["Preference-Applied"] == "wait=0.1"
    shown = gated.request("GET", reply.headers["Location"], None, headers)
    assert shown.json["state"] in ("queued", "running") and shown.headers["Preference-Applied"] == "wait=0.1"


def test_more_answers_wait_than_there_are_threads(gated):
    count, got = 40, []
    threads = [threading.Thread(target=lambda: got.append(gated.request(
        "POST", "/v1/jobs", json.dumps(sphere()), {"Prefer": "wait=60", "Content-Type": "application/json"}))) for _ in range(count)]
    for thread in threads:
        thread.start()
    wait_until(lambda: len(gated.get("/v1/jobs?limit=500").json["jobs"]) == count, "all jobs")
    assert not got
    assert gated.post("/v1/jobs", sphere()).status == 201  # others get their answers
    gated.remove_jobs()
    for thread in threads:
        thread.join(PATIENCE_S)
    assert [r.status for r in got] == [201] * count


def ask_with(service, method, path, *headers):
    """The status and the headers of an answer. `headers` are pairs, and a name may be repeated."""
    connection = service.connection()
    connection.putrequest(method, path)
    for name, value in headers:
        connection.putheader(name, value)
    connection.endheaders()
    reply = connection.getresponse()
    reply.read()
    connection.close()
    return reply.status, reply.headers


@pytest.mark.parametrize("values, waits", [
    (["wait=0.01"], True), (["Wait=0.01"], True), (["WAIT = 0.01"], True), (['wait="0.01"'], True), (["x-wait=1, wait=0.01"], True),
    (["respond-async,wait=0.01"], True), (["respond-async", "wait=0.01"], True), (["wait=0.01", "wait=60"], True),
    (["wait=0.01; strict, handling=lenient"], True), (['a="x, wait=9", WAIT=0.01'], True), (['a="\\", wait=9",, wait=0.01'], True),
    (["await=9"], False), (["wait"], False), (["wait=soon"], False), (["wait=9x"], False), (["wait=-1"], False),
    (["respond-async; wait=9"], False), (['a="x, wait=9'], False), ([""], False)])
def test_preferences_are_read_as_rfc_7240_says(gated, values, waits):
    job = gated.submit(sphere())
    status, headers = ask_with(gated, "GET", f"/v1/jobs/{job}", *(("Prefer", value) for value in values))
    assert status == 200 and headers["Preference-Applied"] == ("wait=0.01" if waits else None)


def test_lists_in_repeated_headers_are_one_list(gated):
    job = gated.submit(sphere())
    gated.wait_worker(job)
    tag = gated.get(f"/v1/jobs/{job}").headers["ETag"]
    assert ask_with(gated, "GET", f"/v1/jobs/{job}", ("If-None-Match", '"x"'), ("if-none-match", tag))[0] == 304
    traces = [("traceparent", f"00-{'4b' * 16}-{'0f' * 8}-0{n}") for n in (0, 1)]
    made = gated.connection()
    made.putrequest("POST", "/v1/jobs")
    body = json.dumps(sphere()).encode()
    for name, value in (*traces, ("Content-Type", "application/json"), ("Content-Length", len(body))):
        made.putheader(name, value)
    made.endheaders(body)
    assert json.loads(made.getresponse().read())["traceparent"] is None  # the standard: no more than one


def test_an_answer_waits_for_a_change(gated):
    gated.wait_worker(gated.submit(sphere()))
    job = gated.submit(sphere())
    tag = gated.get(f"/v1/jobs/{job}").headers["ETag"]
    got = []
    headers = {"Prefer": "wait=60", "If-None-Match": tag}
    waiting = threading.Thread(target=lambda: got.append(gated.request("GET", f"/v1/jobs/{job}", headers=headers)))
    waiting.start()
    assert gated.request("PATCH", f"/v1/jobs/{job}", json.dumps({"priority": 9}),
                         {"Content-Type": "application/json"}).status == 200
    waiting.join(PATIENCE_S)
    assert got[0].status == 200 and got[0].json["priority"] == 9
    # and no longer than it was asked to
    headers = {"Prefer": "wait=0.2", "If-None-Match": got[0].headers["ETag"]}
    assert gated.request("GET", f"/v1/jobs/{job}", headers=headers).status == 304


@pytest.mark.sanitized
def test_who_knows_an_older_document_does_not_wait(gated):
    """Also when only the progress is newer."""
    job = gated.submit(sphere())
    gated.wait_worker(job)
    tag = gated.get(f"/v1/jobs/{job}").headers["ETag"]
    revision, dot, _ = tag.strip('"').partition(".")
    assert dot
    for stale in (f'"{revision}"', f'"{revision}.00000000"', f'"{int(revision) - 1}"'):
        headers = {"Prefer": "wait=60", "If-None-Match": stale}  # longer than this connection is patient, were it to wait
        connection = gated.connection()
        connection.timeout = 30
        connection.request("GET", f"/v1/jobs/{job}", headers=headers)
        reply = connection.getresponse()
        assert reply.status == 200 and reply.headers["ETag"] == tag
        connection.close()
    headers = {"Prefer": "wait=0.2", "If-None-Match": f'"x", {tag}'}
    assert gated.request("GET", f"/v1/jobs/{job}", headers=headers).status == 304


def test_a_wait_ends_with_the_service(new_service, tmp_path):
    gated = new_service("--worker", gated_worker(tmp_path), "--workers", 1, "--drain_s", 0.2).start()
    job = gated.submit(sphere())
    gated.wait_worker(job)
    got = []
    waiting = threading.Thread(target=lambda: got.append(
        gated.request("GET", f"/v1/jobs/{job}", headers={"Prefer": "wait=60"})))
    waiting.start()
    wait_until(lambda: b"hexad_http_connections 2" in gated.get("/metrics").body, "the one who waits")
    assert gated.end() == 0
    waiting.join(PATIENCE_S)
    assert got and got[0].status == 200


@pytest.mark.sanitized
def test_a_change_of_what_one_knows(gated):
    gated.wait_worker(gated.submit(sphere()))
    job = gated.submit(sphere(queue={"labels": ["x"]}))
    path, kind = f"/v1/jobs/{job}", {"Content-Type": "application/json"}
    tag = gated.get(path).headers["ETag"]
    done = gated.request("PATCH", path, json.dumps({"priority": 5, "labels": ["y", "z"], "retention_s": 60}),
                         {**kind, "If-Match": tag})
    assert done.status == 200
    assert (done.json["priority"], done.json["labels"], done.json["retention_s"]) == (5, ["y", "z"], 60)
    expect_problem(gated.request("PATCH", path, "{}", {**kind, "If-Match": tag}), 412, "precondition_failed")
    assert gated.request("PATCH", path, '{"priority":1}', {**kind, "If-Match": done.headers["ETag"]}).status == 200
    assert gated.request("PATCH", path, '{"priority":2}', {**kind, "If-Match": "*"}).status == 200
    for body, pointer in (('{"priority":1e9}', "/priority"), ('{"labels":[1]}', "/labels/0"), ('{"name":"x"}', "/name"),
                          ('{"retention_s":-1}', "/retention_s"), ("[]", "")):
        expect_problem(gated.request("PATCH", path, body, kind), 422, "spec_invalid", pointer)
    expect_problem(gated.request("PATCH", path, "{", kind), 400, "json_invalid")
    assert gated.job(job)["priority"] == 2


@pytest.mark.parametrize("changes", [30, pytest.param(100, marks=pytest.mark.extended)])
def test_no_answer_is_older_than_a_change(gated, changes):
    """While others keep asking, so that there is an answer that was kept at every moment."""
    gated.wait_worker(gated.submit(sphere()))
    job = gated.submit(sphere())
    path, over, faults = f"/v1/jobs/{job}", threading.Event(), []

    def look():
        connection, last = gated.connection(), 0
        while not over.is_set():
            connection.request("GET", path)
            now = json.loads(connection.getresponse().read())["priority"]
            if now < last:
                faults.append((last, now))
            last = now
        connection.close()

    threads = [threading.Thread(target=look) for _ in range(2)]
    for t in threads:
        t.start()
    try:
        for priority in range(1, changes + 1):
            assert gated.request("PATCH", path, json.dumps({"priority": priority}),
                                 {"Content-Type": "application/json"}).status == 200
            assert [gated.job(job)["priority"] for _ in range(2)] == [priority] * 2
    finally:
        over.set()
        for t in threads:
            t.join()
    assert not faults


def test_pause_resume_retry_delete(gated):
    job = gated.submit(sphere())
    other = gated.submit(sphere())
    gated.wait_worker(job)
    assert gated.post(f"/v1/jobs/{other}/pause").json["state"] == "paused"
    assert gated.post(f"/v1/jobs/{other}/pause").status == 200
    expect_problem(gated.post(f"/v1/jobs/{other}/retry"), 409, "conflict")
    expect_problem(gated.request("DELETE", f"/v1/jobs/{other}"), 409, "conflict")
    assert gated.post(f"/v1/jobs/{other}/resume").json["state"] == "queued"
    assert gated.post(f"/v1/jobs/{other}/cancel").json["state"] == "cancelled"
    expect_problem(gated.post(f"/v1/jobs/{other}/pause"), 409, "conflict")
    assert gated.post(f"/v1/jobs/{other}/retry").json["state"] == "queued"
    gated.open_gate(job)
    gated.wait_state(job, "succeeded")
    expect_problem(gated.post(f"/v1/jobs/{job}/retry"), 409, "conflict")
    assert gated.get(f"/v1/jobs/{job}/results").status == 200
    assert gated.request("DELETE", f"/v1/jobs/{job}").status == 204
    expect_problem(gated.get(f"/v1/jobs/{job}"), 404, "not_found")
    assert not list((gated.state / "results").glob(f"{job}*"))
    assert not list((gated.state / "attempts").glob(f"{job}*"))


@pytest.mark.sanitized
def test_attempts_and_log(service):
    job = service.submit(sphere())
    service.wait_state(job, "succeeded")
    attempts = service.get(f"/v1/jobs/{job}/attempts").json["attempts"]
    assert [a["number"] for a in attempts] == [1] and attempts[0]["exit_status"] in (0, 10, 11)
    tasks = service.get(f"/v1/jobs/{job}/tasks").json
    assert tasks["next"] is None and [t["state"] for t in tasks["tasks"]] == ["succeeded"]
    log = service.get(f"/v1/jobs/{job}/log")
    assert log.status == 200 and log.headers["Content-Type"] == "text/plain"
    expect_problem(service.get(f"/v1/jobs/{job}/log?attempt=2"), 404, "not_found")


def test_workers(gated):
    job = gated.submit(sphere(name="busy"))
    gated.wait_worker(job)
    # the daemon may have not yet noticed that the worker has started
    seen = wait_until(lambda: (found := gated.get("/v1/workers").json)["workers"][0]["host"] and found, "the host")
    assert [(w["job"], w["name"], w["host"]) for w in seen["workers"]] == [(job, "busy", socket.gethostname())]
    assert seen["load"]["attempts"] == 1 == seen["load"]["attempts_limit"]


def test_a_drain_and_its_end(new_service, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path), "--workers", 1)
    at = service.options.index("--listen")
    del service.options[at:at + 2]  # a Unix socket, where the service's own user is an admin
    service.start()
    first, second = service.submit(sphere()), service.submit(sphere())
    service.wait_worker(first)
    assert service.post("/v1/admin/drain").json == {"status": "draining", "running": 1}
    for refused in service.post("/v1/jobs", sphere()), service.get("/readyz"):
        expect_problem(refused, 503, "unavailable")
        assert "an administrator drained" in refused.json["detail"] and "run hexadctl undrain" in refused.json["detail"]
    assert service.get("/healthz").json == {"status": "draining"}
    service.open_gate(first)
    service.open_gate(second)
    service.wait_state(first, "succeeded")
    assert service.post("/v1/admin/resume").json["status"] == "ok"
    service.wait_state(second, "succeeded")
    assert service.get("/readyz").status == 200
    done = [e for e in service.get("/v1/events?after=0&limit=500").json["events"] if e["type"] == "started" and e["job"] == second]
    assert len(done) == 1  # none before the resume was taken back


def test_a_worker_finds_the_trace(new_service, tmp_path):
    program = tmp_path / "traced"
    program.write_text("#!/bin/sh\ncat > /dev/null\necho \"in $TRACEPARENT\" >&2\nexit 3\n")
    program.chmod(0o700)
    service = new_service("--worker", program, "--max_attempts", 1).start()
    trace = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01"
    for headers, wanted in (({"traceparent": trace}, trace), ({}, "")):
        job = service.request("POST", "/v1/jobs", json.dumps(sphere()), {"Content-Type": "application/json", **headers}).json["id"]
        service.wait_state(job, "failed")
        assert service.get(f"/v1/jobs/{job}/log").body.decode().endswith(f"in {wanted}\n")


def test_a_trace_is_kept(service):
    trace = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01"
    headers = {"Content-Type": "application/json", "traceparent": trace}
    job = service.request("POST", "/v1/jobs", json.dumps(sphere()), headers).json
    assert job["traceparent"] == trace == service.job(job["id"])["traceparent"]
    assert f"trace={trace}" in service.log.read_text()
    # it begins the worker's log, and the worker finds it in its environment
    attempts = service.wait_state(job["id"], "succeeded")["attempts"]
    assert service.get(f"/v1/jobs/{job['id']}/log").body.decode().startswith(f"TRACEPARENT={trace}\n")
    assert len(attempts) == 1
    headers["traceparent"] = trace.upper()
    assert service.request("POST", "/v1/jobs", json.dumps(sphere()), headers).json["traceparent"] is None


@pytest.mark.sanitized
def test_a_stream_tells_all_and_ends(gated):
    job = gated.submit(sphere())
    stream = Stream(gated, f"/v1/jobs/{job}/events")
    assert stream.reply.status == 200 and stream.reply.headers["Content-Type"] == "text/event-stream"
    told = []
    for event in stream:
        told.append(event)
        if event[1] == "progress":
            assert "." in event[0] and event[2]["progress"]["phase"] == "relax" and event[2]["job"] == job
            gated.open_gate(job)
    states = [e[2]["state"] for e in told if e[1] == "state"]
    assert states[0] == "queued" and states[-1] == "succeeded" and "running" in states
    assert "progress" in [e[1] for e in told]
    numbers = [e[0] for e in told if e[1] != "progress"]
    assert numbers == sorted(set(numbers))
    # broken off in the middle it goes on behind that
    rest = [e[0] for e in Stream(gated, f"/v1/jobs/{job}/events", last=numbers[0]) if e[1] != "progress"]
    assert rest == numbers[1:]
    # and when all was told, there is nothing to come again for
    assert Stream(gated, f"/v1/jobs/{job}/events", last=numbers[-1]).reply.status == 204
    # the same by pages
    pages, after = [], 0
    while after is not None:
        page = gated.get(f"/v1/jobs/{job}/events?limit=2&after={after}").json
        pages += [e["seq"] for e in page["events"]]
        after = page["next"]
    assert pages == numbers


def test_a_stream_over_a_restart(gated):
    job = gated.submit(sphere())
    stream = iter(Stream(gated, f"/v1/jobs/{job}/events"))
    first = next(stream)
    gated.end(9)
    with pytest.raises(Exception):
        while True:
            next(stream)
    gated.start()
    gated.open_gate(job)
    rest = list(Stream(gated, f"/v1/jobs/{job}/events", last=first[0]))
    assert rest[-1][2]["state"] == "succeeded" and all(e[1] == "progress" or e[0] > first[0] for e in rest)


def test_all_jobs_of_a_user(new_service):
    """An admin hears all, a user what is the user's own; and whose a job is decides who may have to do with it."""
    service = new_service("--workers", 1)
    at = service.options.index("--tcp_without_tokens")
    del service.options[at:at + 2]
    service.state.mkdir(mode=0o700)
    alice, bob, root = new_token(service, "alice"), new_token(service, "bob"), new_token(service, "r", "--scopes", "admin")
    service.start()
    job = with_token(service, alice, "POST", "/v1/jobs", sphere()).json
    assert job["owner"] == "alice" and job["spec"]
    path = f"/v1/jobs/{job['id']}"
    seen = with_token(service, bob, "GET", path)
    assert seen.status == 200 and seen.json["spec"] is None and seen.json["owner"] == "alice"
    for method, rest in (("GET", "/results"), ("GET", "/results/points.ply"), ("GET", "/log"), ("GET", "/events"),
                         ("GET", "/tasks"), ("GET", "/attempts"), ("POST", "/cancel"), ("POST", "/pause"),
                         ("POST", "/retry"), ("DELETE", ""), ("PATCH", "")):
        expect_problem(with_token(service, bob, method, path + rest, {} if method == "PATCH" else None), 403, "forbidden")
    wait_until(lambda: with_token(service, alice, "GET", path).json["state"] == "succeeded", "the job")
    assert with_token(service, alice, "GET", path + "/results").status == 200
    assert with_token(service, root, "GET", path + "/results").status == 200
    assert with_token(service, bob, "GET", "/v1/events?after=0").json["events"] == []
    assert {e["job"] for e in with_token(service, root, "GET", "/v1/events?after=0").json["events"]} == {job["id"]}
    assert {e["job"] for e in with_token(service, alice, "GET", "/v1/events?after=0").json["events"]} == {job["id"]}
    assert with_token(service, root, "DELETE", path).status == 204


@pytest.mark.parametrize("count", [100, pytest.param(1000, marks=pytest.mark.extended)])
def test_a_thousand_streams(new_service, tmp_path, count):
    """While jobs run, each of many streams sends the events of its job up to its end."""
    most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if most[1] < 1200:
        pytest.skip("this process may not open so many files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(most[0], 1200), most[1]))
    service = new_service("--worker", gated_worker(tmp_path), "--workers", 2, "--user_connection_limit", 1100,
                          "--connection_limit", 1200)
    at = service.options.index("--listen")
    service.options[at + 1] = f"unix:{tmp_path}/s"
    service.start()
    jobs = [service.submit(sphere()) for _ in range(5)]
    streams = [Stream(service, f"/v1/jobs/{jobs[i % 5]}/events") for i in range(count)]
    assert all(s.reply.status == 200 for s in streams)
    assert service.get("/healthz").status == 200  # and others are served
    for job in jobs:
        service.open_gate(job)
    for job in jobs:
        service.wait_state(job, "succeeded")
    for i, stream in enumerate(streams):
        told = list(stream)
        assert told[-1][1] == "state" and told[-1][2]["state"] == "succeeded" and told[-1][2]["job"] == jobs[i % 5]
        stream.close()


def test_the_client_watches_all_jobs(new_service):
    service = new_service()
    at = service.options.index("--listen")
    del service.options[at:at + 2]
    service.start()
    watching = subprocess.Popen([service.build / "hexadctl", "watch"], env=service.environment(), stdout=subprocess.PIPE, text=True)
    try:
        assert list(json.loads(watching.stdout.readline())) == ["seq"]  # the position from which on it listens
        jobs = [service.submit(sphere()), service.submit(sphere(count=301))]
        ended = set()
        while ended != set(jobs):
            event = json.loads(watching.stdout.readline())
            if event["type"] == "state" and event["state"] == "succeeded":
                ended.add(event["job"])
        assert watching.poll() is None
    finally:
        watching.kill()
        watching.wait()
        watching.stdout.close()


@pytest.mark.sanitized
def test_the_client_does_all_that(new_service, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path), "--workers", 1)
    at = service.options.index("--listen")
    del service.options[at:at + 2]
    service.start()
    first, second = service.submit(sphere(name="one of two")), service.submit(sphere())
    service.wait_worker(first)
    running = wait_until(lambda: (found := service.get("/v1/workers").json["workers"][0])["host"] and found, "the host")
    code, out, _ = control(service, "workers")
    head, titles, row = out.splitlines()
    assert code == 0 and "1 of 1 attempts" in head and titles.split() == ["JOB", "ATTEMPT", "USER", "NAME", "HOST", "THREADS", "MEMORY"]
    assert re.split("  +", row) == [first, "1", running["owner"], "one of two", running["host"], str(running["threads"]),
                                    f"{running['memory_mb']} MiB"]
    assert control(service, "pause", second)[1].split()[:2] == [second, "paused"]
    assert control(service, "resume", second)[1].split()[:2] == [second, "queued"]
    assert control(service, "priority", second)[0] == 2
    assert control(service, "priority", second, "--priority", "9")[0] == 0
    assert service.job(second)["priority"] == 9
    assert control(service, "delete", second)[0] == 4
    assert control(service, "cancel", second)[0] == 0
    assert control(service, "retry", second)[1].split()[:2] == [second, "queued"]
    assert control(service, "cancel", second)[0] == 0
    assert control(service, "delete", second)[0] == 0
    assert control(service, "show", second)[0] == 4
    code, out, _ = control(service, "drain")
    assert code == 0 and out.startswith("1 attempt runs\n") and "accepts no jobs until it is restarted: run hexadctl undrain\n" in out and service.get("/readyz").status == 503
    code, out, _ = control(service, "undrain")
    assert code == 0 and out.startswith("the drain is ended: the service accepts jobs\n1 attempt runs\n") and service.get("/readyz").status == 200
    assert control(service, "undrain")[1] == "the service was not drained: it accepts jobs\n1 attempt runs\n"
    service.open_gate(first)
    code, out, _ = control(service, "watch", first)
    events = [json.loads(line) for line in out.splitlines()]
    assert code == 0 and events[0]["state"] == "queued" and events[-1]["state"] == "succeeded"
    assert control(service, "log", first)[0] == 0
    assert control(service, "log", "01aaaaaaaaaaaaaaaaaaaaaaaa")[0] == 4
