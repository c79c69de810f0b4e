# SPDX-License-Identifier: Apache-2.0
"""The events of all jobs: where a follower begins, what filters leave, and what it is told of events that are missing."""
import sqlite3

import pytest

from accounts import new_token, with_token
from service import Stream, expect_problem, gated_worker, sphere, wait_until

HISTORY = 5000  # events
# a stream's head and its first event, however long the history is
FEW_BYTES = 500


@pytest.fixture
def gated(clean_gated):
    """One worker, which ends a job when its gate is opened; the daemon is the same for all tests of this file."""
    return clean_gated


@pytest.fixture
def service(clean_service):
    """One daemon for the tests of this file, without jobs of other tests."""
    return clean_service


def change_database(service, *statements):
    """Ends the service, changes its database, and starts it again."""
    service.end()
    with sqlite3.connect(service.state / "queue.db") as database:
        for statement in statements:
            database.execute(*statement)
    database.close()
    service.start()


def add_history(service, job, count):
    """That many more events of a job, as if it had been edited as often."""
    change_database(service, (
        "WITH RECURSIVE n (i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < ?2)"
        " INSERT INTO event (at_ms, job, type, state) SELECT 0, seq, 'edited', 'queued' FROM job, n WHERE id = ?1",
        (job, count)))


def newest(service):
    return service.get("/v1/events").json["position"]


def pages(service, query, get=None):
    """All pages of a listing: the numbers of their events, and the last page."""
    seen, after = [], 0
    while after is not None:
        page = (get or service.get)(f"/v1/events?after={after}&limit=500{query}").json
        seen += [e["seq"] for e in page["events"]]
        after = page["next"]
    return seen, page


def jobs_told(stream, last):
    """The jobs of the events of a stream up to the end of the job `last`."""
    told = []
    for _, kind, document in stream:
        if kind == "position":
            continue
        told.append(document["job"])
        if document["job"] == last and document.get("state") == "succeeded" and kind == "state":
            return told
    raise AssertionError("the stream has ended")


def test_a_follower_begins_now(new_service, tmp_path):
    gated = new_service("--worker", gated_worker(tmp_path), "--workers", 1).start()
    job = gated.submit(sphere())
    gated.open_gate(job)
    gated.wait_state(job, "succeeded")
    add_history(gated, job, HISTORY)
    page = gated.get("/v1/events").json
    assert page["events"] == [] and page["next"] is None and page["position"] > HISTORY
    stream = Stream(gated, "/v1/events")
    told = iter(stream)
    begin, kind, document = next(told)
    assert kind == "position" and begin == document["seq"] >= page["position"]
    other = gated.submit(sphere())
    for number, kind, document in told:
        assert number > begin
        if document["job"] == other:
            assert kind == "state" and document["state"] == "queued"
            break
    # who asks for all that is kept is told all
    seen, last = pages(gated, "")
    assert len(seen) >= HISTORY and seen == sorted(set(seen)) and last["position"] == seen[-1]
    assert gated.get("/v1/events?after=0&limit=2").json["next"] == seen[1]
    assert next(e for e in Stream(gated, "/v1/events?after=0") if e[1] != "position")[0] == seen[0]
    # one job's events begin at its beginning
    assert gated.get(f"/v1/jobs/{other}/events").json["events"][0]["state"] == "queued"


def test_what_a_new_follower_is_told_does_not_grow(service):
    """The bytes that come before the first event of a new job are as many after a long history as after a short one."""
    service.wait_state(service.submit(sphere()), "succeeded")

    def count_bytes():
        stream = Stream(service, "/v1/events")
        job, count = None, 0
        for line in stream.reply:
            count += len(line)
            if line == b"\n" and job is None:
                job = service.submit(sphere())
            elif job and job.encode() in line:
                stream.close()
                service.wait_state(job, "succeeded")
                return count, job
        raise AssertionError("the stream has ended")

    before, job = count_bytes()
    add_history(service, job, HISTORY)
    after, _ = count_bytes()
    assert before < FEW_BYTES and after < FEW_BYTES


def test_a_poller_goes_on_from_the_position(service):
    position = newest(service)
    job = service.submit(sphere())
    service.wait_state(job, "succeeded")
    seen = []
    while not (seen and seen[-1]["state"] == "succeeded" and seen[-1]["type"] == "state"):
        page = service.get(f"/v1/events?after={position}&limit=2").json
        seen += page["events"]
        assert page["position"] >= position and page["next"] in (None, page["position"])
        position = page["position"]
    assert [e["type"] for e in seen] == ["state", "state", "started", "ended", "state"]
    assert service.get(f"/v1/events?after={position}").json == {"events": [], "next": None, "position": position}


def test_a_stream_begins_at_once_also_behind_a_proxy(gated):
    job = gated.submit(sphere())
    gated.post(f"/v1/jobs/{job}/pause")
    for path in ("/v1/events", f"/v1/jobs/{job}/events?after={newest(gated)}"):
        stream = Stream(gated, path)
        assert stream.reply.status == 200 and stream.reply.headers["X-Accel-Buffering"] == "no"
        assert stream.reply.readline().strip()  # although nothing happens
        stream.close()


@pytest.mark.sanitized
def test_filters(closed_service):
    service, root = closed_service, closed_service.token
    alice, bob = new_token(service, "alice"), new_token(service, "bob")

    def submit(token, *labels):
        return with_token(service, token, "POST", "/v1/jobs", sphere(queue={"labels": list(labels)})).json["id"]

    def told(token, query):
        page = with_token(service, token, "GET", f"/v1/events?after=0&limit=500&{query}")
        assert page.status == 200, page.body
        return {e["job"] for e in page.json["events"]}

    streams = {query: Stream(service, f"/v1/events?{query}", token=root)
               for query in ("", "label=night", "owner=bob", "owner=alice&label=night", "label=none")}
    one, two, three = submit(alice, "night"), submit(alice), submit(bob, "night", "x")
    wait_until(lambda: with_token(service, root, "GET", f"/v1/jobs/{three}").json["state"] == "succeeded", "the jobs")
    # pages
    assert told(root, "") == {one, two, three}
    assert told(root, "label=night") == {one, three} and told(root, "owner=alice") == {one, two}
    assert told(root, "owner=alice&label=night") == {one} and told(root, "owner=bob&label=y") == set()
    assert told(root, f"job={two}") == {two} and told(root, f"job={two}&label=night") == set()
    # streams of what came since
    assert set(jobs_told(streams[""], three)) == {one, two, three}
    assert set(jobs_told(streams["label=night"], three)) == {one, three}
    assert set(jobs_told(streams["owner=bob"], three)) == {three}
    assert set(jobs_told(streams["owner=alice&label=night"], one)) == {one}
    # the label that a job has now counts
    assert with_token(service, bob, "PATCH", f"/v1/jobs/{three}", {"labels": ["none"]}).status == 200
    assert next(e for e in streams["label=none"] if e[1] != "position")[2]["job"] == three
    assert told(root, "label=night") == {one}
    # others than admins are told of their own jobs, and refused where nothing could ever come
    assert told(alice, "") == told(alice, "owner=alice") == {one, two} and told(alice, f"job={one}") == {one}
    for query, status, code in (("owner=bob", 403, "forbidden"), (f"job={three}", 403, "forbidden"),
                                ("job=01aaaaaaaaaaaaaaaaaaaaaaaa", 404, "not_found"), ("job=x", 400, "request_invalid")):
        expect_problem(with_token(service, alice, "GET", f"/v1/events?{query}"), status, code)
    assert with_token(service, root, "GET", "/v1/events?after=0&owner=nobody").json["events"] == []


def until_end(stream, job):
    """(type, document) of all that comes, up to the end of the job."""
    seen = []
    for _, kind, document in stream:
        seen.append((kind, document))
        if kind == "state" and document["job"] == job and document["state"] == "succeeded":
            return seen
    return None


def test_everyone_may_follow_the_jobs_that_he_may_list(closed_service, tmp_path):
    service = closed_service
    service.end()
    service.start("--worker", gated_worker(tmp_path))
    alice, bob = new_token(service, "alice"), new_token(service, "bob")
    streams = [Stream(service, f"/v1/events?all=1&progress=1{more}", token=alice) for more in ("", "&owner=bob")]
    job = with_token(service, bob, "POST", "/v1/jobs", sphere()).json["id"]
    streams.append(Stream(service, f"/v1/events?all=1&job={job}", token=alice))
    own = Stream(service, "/v1/events?progress=1", token=bob)
    wait_until(lambda: with_token(service, bob, "GET", f"/v1/jobs/{job}").json["progress"], "progress")
    service.open_gate(job)
    for stream in streams:
        seen = list(until_end(stream, job))
        assert {document["job"] for kind, document in seen if kind != "position"} == {job}
        assert not [kind for kind, _ in seen if kind == "progress"]  # of the jobs of others
    assert until_end(own, job)
    assert with_token(service, alice, "GET", f"/v1/events?after=0&all=1&job={job}").json["events"]
    expect_problem(with_token(service, alice, "GET", "/v1/events?all=1&job=01aaaaaaaaaaaaaaaaaaaaaaaa"), 404, "not_found")


def test_a_filter_that_leaves_out_much_is_told_how_far_it_has_got(new_service):
    """Each answer looks at a bounded number of events, and what was looked at is not looked at again."""
    service = new_service().start()
    job = service.submit(sphere(queue={"labels": ["common"]}))
    service.wait_state(job, "succeeded")
    add_history(service, job, 3 * HISTORY)
    last = newest(service)
    page = service.get("/v1/events?after=0&label=rare").json
    assert page["events"] == [] and 0 < page["next"] == page["position"] < last
    seen, page = pages(service, "&label=rare")
    assert seen == [] and page["position"] == last
    assert len(pages(service, "&label=common")[0]) >= 3 * HISTORY
    stream = Stream(service, "/v1/events?after=0&label=rare")
    position = -1
    for number, kind, document in stream:
        assert kind == "position" and number == document["seq"] > position
        position = number
        if position == last:
            break
    rare = service.submit(sphere(queue={"labels": ["rare"]}))
    assert set(jobs_told(Stream(service, "/v1/events?label=rare", last=position), rare)) == {rare}


def test_one_is_told_of_events_that_were_removed(new_service):
    service = new_service().start()
    first, second, third = (service.submit(sphere()) for _ in range(3))
    for job in (first, second, third):
        service.wait_state(job, "succeeded")
    every = {e["seq"]: e["job"] for e in service.get("/v1/events?after=0&limit=500").json["events"]}
    assert "removed_up_to" not in service.get("/v1/events?after=0").json
    gone = max(n for n, job in every.items() if job == second)
    assert service.request("DELETE", f"/v1/jobs/{second}").status == 204
    for restarted in (False, True):
        if restarted:
            service.end()
            service.start()
        page = service.get("/v1/events?after=0&limit=500").json
        assert [e["seq"] for e in page["events"]] == [n for n, job in every.items() if job != second]
        assert page["removed_up_to"] == gone
        assert service.get(f"/v1/events?after={gone - 1}").json["removed_up_to"] == gone
        assert "removed_up_to" not in service.get(f"/v1/events?after={gone}").json
        assert "removed_up_to" not in service.get("/v1/events").json
        assert "removed_up_to" not in service.get(f"/v1/jobs/{third}/events").json
        # who comes again goes on where it was, and is told so
        last = min(every)
        told = iter(Stream(service, "/v1/events", last=last))
        assert next(told) == (last, "position", {"seq": last, "removed_up_to": gone})
        assert next(told)[0] == min(n for n, job in every.items() if job != second and n > last)
        assert next(iter(Stream(service, "/v1/events", last=gone))) == (gone, "position", {"seq": gone})
    # those of the newest job, too: its numbers are not given again
    assert service.request("DELETE", f"/v1/jobs/{third}").status == 204
    page = service.get("/v1/events?after=0&limit=500").json
    assert page["removed_up_to"] == max(n for n, job in every.items() if job in (second, third))
    assert newest(service) >= max(every)


def test_a_position_that_was_not_reached_yet(gated):
    """As after a restored backup: the numbers begin behind it again, and the follower is told so."""
    job = gated.submit(sphere())
    gated.wait_worker(job)
    last = newest(gated)
    page = gated.get(f"/v1/events?after={last + 1000}").json
    assert page == {"events": [], "next": None, "position": last, "reset": True}
    told = iter(Stream(gated, "/v1/events", last=last + 1000))
    assert next(told) == (last, "position", {"seq": last, "reset": True})
    of_job = iter(Stream(gated, f"/v1/jobs/{job}/events", last=last + 1000))
    assert next(e for e in of_job if e[1] != "progress") == (last, "position", {"seq": last, "reset": True})
    gated.open_gate(job)
    assert set(jobs_told(told, job)) == {job}
    assert list(of_job)[-1][2]["state"] == "succeeded"


def test_a_stream_ends_whose_events_fill_a_batch(service):
    """The end of a job is noticed although as many events were read as are read at once (64)."""
    job = service.submit(sphere())
    service.wait_state(job, "succeeded")
    end = service.get(f"/v1/jobs/{job}/events").json["events"][-1]["seq"]
    change_database(
        service, ("DELETE FROM event WHERE seq = ?1", (end,)),
        ("WITH RECURSIVE n (i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 59)"
         " INSERT INTO event (at_ms, job, type, state) SELECT 0, seq, 'edited', 'queued' FROM job, n WHERE id = ?1", (job,)),
        ("INSERT INTO event (at_ms, job, type, state, outcome)"
         " SELECT 0, seq, 'state', 'succeeded', 'converged' FROM job WHERE id = ?1", (job,)))
    stream = Stream(service, f"/v1/jobs/{job}/events")
    told = [event for _, event in zip(range(64), stream)]
    assert told[-1][2]["state"] == "succeeded"
    assert stream.reply.readline() == b""  # the end, not a comment that says that nothing is new


@pytest.mark.sanitized
def test_progress_is_told_once(gated):
    """Who comes back with the id of the last event, or of the last progress, is told what is new only."""
    job = gated.submit(sphere())
    gated.wait_worker(job)
    where = f"/v1/jobs/{job}/events"
    told = []
    for number, kind, _ in Stream(gated, where):
        told.append((number, kind))
        if kind == "progress":
            break
    seq, _, row = told[-1][0].partition(".")
    assert int(seq) == told[-2][0] and int(row) > 0
    streams = [Stream(gated, where, last=last) for last in (told[-1][0], seq)]
    again = Stream(gated, f"{where}?after={seq}")  # who asks for a page of the past has not been told
    gated.open_gate(job)
    for stream in streams:
        later = [(number, kind) for number, kind, _ in stream]
        assert later and later[-1][1] == "state" and "progress" not in [kind for _, kind in later]
        assert all(number > int(seq) for number, _ in later)
    assert "progress" in [kind for _, kind, _ in again]
    for bad in ("x", "1.", ".1", "1.2.3", "1.x", "-1"):
        expect_problem(gated.request("GET", where, headers={"Accept": "text/event-stream", "Last-Event-ID": bad}), 400,
                       "request_invalid")


def test_progress_of_all_jobs_is_told_to_who_wants_it(gated):
    """The lines of a running job reach a stream of all jobs that asked for them, and only that."""
    plain, wanting = Stream(gated, "/v1/events"), Stream(gated, "/v1/events?progress=1")
    job = gated.submit(sphere())
    line = next(document for _, kind, document in wanting if kind == "progress")
    assert line["job"] == job and line["progress"]["phase"] == "relax"
    gated.open_gate(job)
    kinds = set()
    for _, kind, document in plain:
        kinds.add(kind)
        if document.get("state") == "succeeded":
            break
    assert "progress" not in kinds
