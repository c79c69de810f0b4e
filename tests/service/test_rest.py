# SPDX-License-Identifier: Apache-2.0
"""The REST interface, as a client sees it."""
import hashlib
import json
import os
import signal
import socket
import struct
import subprocess
import time

import pytest

from service import PATIENCE_S, exchange, expect_problem, gated_worker, long_sphere, sphere, wait_until


@pytest.fixture
def service(clean_service):
    """One daemon for the tests of this file, without jobs of other tests."""
    return clean_service


def test_submit_wait_fetch(service):
    reply = service.post("/v1/jobs", sphere(name="ball", queue={"priority": 3, "labels": ["a", "b"]}))
    assert reply.status == 201
    job = reply.json
    assert reply.headers["Location"] == f"/v1/jobs/{job['id']}" == job["links"]["self"]
    assert job["name"] == "ball" and job["priority"] == 3 and job["labels"] == ["a", "b"]
    assert job["spec"]["sampling"]["count"] == 200
    done = service.wait_state(job["id"], "succeeded")
    assert done["outcome"] in ("converged", "unresolved", "not_converged")
    assert done["error"] is None and done["attempt"] == 1
    assert done["created"] <= done["started"] <= done["finished"]
    assert done["attempts"][0]["exit_status"] in (0, 10, 11)
    results = service.get(done["links"]["results"]).json["results"]
    names = [r["name"] for r in results]
    assert "points.ply" in names and "report.json" in names
    for r in results:
        got = service.get(r["href"])
        assert got.status == 200
        assert got.headers["Content-Type"] == r["content_type"]
        assert len(got.body) == r["bytes"] == int(got.headers["Content-Length"])
        assert hashlib.sha256(got.body).hexdigest() == r["sha256"]
        head = service.request("HEAD", r["href"])
        assert head.status == 200 and head.body == b""
        assert head.headers["Content-Length"] == got.headers["Content-Length"]
        if r["name"] == "points.ply":
            assert got.body.startswith(b"ply\n") and b"element vertex 200\n" in got.body
        if r["name"] == "report.json":
            assert json.loads(got.body)["count"] == 200


def test_list_pages(new_service):
    service = new_service().start()
    made = [service.submit(sphere(name=f"n{i}")) for i in range(5)]
    seen, cursor = [], ""
    while True:
        page = service.get(f"/v1/jobs?limit=2{cursor}").json
        assert len(page["jobs"]) <= 2
        seen += [j["id"] for j in page["jobs"]]
        if page["next"] is None:
            break
        cursor = f"&cursor={page['next']}"
    assert seen == made[::-1]
    for job in made:
        service.wait_state(job, "succeeded")
    assert len(service.get("/v1/jobs?state=succeeded").json["jobs"]) == 5
    assert service.get("/v1/jobs?state=failed").json == {"jobs": [], "next": None}


@pytest.mark.sanitized
def test_sorted_pages(new_service, tmp_path):
    """The pages are the whole list, cut."""
    service = new_service("--worker", gated_worker(tmp_path), "--workers", 1).start()
    service.wait_state(service.submit(sphere(name="c")), "running")
    for name, priority in (("b:1,ü", 3), ("a", 3), ("B%", -1)):
        service.submit(sphere(name=name, queue={"priority": priority}))

    def names(path):
        reply = service.get(path)
        return [j["name"] for j in reply.json["jobs"]], reply.headers["Link"] and reply.headers["Link"].partition(">")[0][1:]

    for sort in ("-created", "created", "name", "-name", "-priority", "state"):
        for states in ("", "&state=queued,running"):
            whole, seen, path = names(f"/v1/jobs?sort={sort}{states}")[0], [], f"/v1/jobs?limit=1&sort={sort}{states}"
            while path:
                one, path = names(path)
                seen += one
            assert seen == whole and len(whole) == 4, (sort, states)
    assert names("/v1/jobs?sort=name")[0] == ["a", "B%", "b:1,ü", "c"]
    assert names("/v1/jobs?sort=-priority")[0] == ["a", "b:1,ü", "c", "B%"]
    assert names("/v1/jobs?text=b%25")[0] == ["B%"]


@pytest.mark.sanitized
@pytest.mark.parametrize("query", ["state=nonsense", "limit=0", "limit=x", "limit=501", "cursor=-1", "other=1", "state",
                                   "sort=size", "sort=name,state", "sort=name&cursor=1", "cursor=1:x", "sort=name&cursor=1:-name:x",
                                   "sort=owner&cursor=1:name:x", "sort=created&cursor=1", "cursor=1:created:", "sort=created&cursor=1:created:x", "text=",
                                   "limit=1&limit=2", "state=queued&state=queued", "state=queued%00x"])
def test_bad_queries_are_refused(service, query):
    expect_problem(service.get(f"/v1/jobs?{query}"), 400, "request_invalid")


def test_no_parameter_is_dropped(service):
    many = "&".join(f"a{i}=1" for i in range(9))
    expect_problem(service.get("/healthz?a=1"), 400, "request_invalid")
    assert service.get("/healthz?a=1").json["detail"].endswith("a is not a parameter of this path: it has none; remove it")
    told = service.get("/v1/jobs?since=1h").json["detail"]
    assert "use state, owner, " in told and "created_after, " in told and told.endswith(", limit, cursor"), told
    expect_problem(service.get(f"/healthz?{many}"), 400, "request_invalid")


@pytest.mark.sanitized
def test_health_and_version(service):
    assert service.get("/healthz").json == {"status": "ok"}
    version = service.get("/version").json
    assert version["name"] == "hexad" and version["api"] == "v1" and version["version"]
    head = service.request("HEAD", "/healthz")
    assert head.status == 200 and head.body == b"" and int(head.headers["Content-Length"]) > 0


@pytest.mark.sanitized
def test_unknown_places(service):
    expect_problem(service.get("/nothing"), 404, "not_found")
    expect_problem(service.get("/v1/nothing"), 404, "not_found")
    expect_problem(service.get("/v1/jobs/"), 404, "not_found")
    expect_problem(service.get("/v1/jobs/01aaaaaaaaaaaaaaaaaaaaaaaa"), 404, "not_found")
    expect_problem(service.get("/v1/jobs/..%2f..%2fetc"), 404, "not_found")
    expect_problem(service.get("/v1/jobs/" + "x" * 5000), 404, "not_found")
    expect_problem(service.post("/v1/jobs/01aaaaaaaaaaaaaaaaaaaaaaaa/cancel"), 404, "not_found")


def test_wrong_methods_say_what_is_allowed(service):
    reply = service.request("DELETE", "/v1/jobs")
    expect_problem(reply, 405, "method_not_allowed")
    assert sorted(reply.headers["Allow"].split(", ")) == ["GET", "HEAD", "POST"]
    reply = service.request("PUT", "/healthz", b"x")
    expect_problem(reply, 405, "method_not_allowed")
    assert reply.headers["Allow"] == "GET, HEAD"


def test_media_type(service):
    body = json.dumps(sphere())
    expect_problem(service.request("POST", "/v1/jobs", body), 415, "media_type_unsupported")
    expect_problem(service.request("POST", "/v1/jobs", body, {"Content-Type": "text/plain"}), 415,
                   "media_type_unsupported")
    good = service.request("POST", "/v1/jobs", body, {"Content-Type": "application/json; charset=utf-8"})
    assert good.status == 201


@pytest.mark.sanitized
@pytest.mark.parametrize("raw", ["", "{", "nonsense", '{"version":1}x', '{"a":1,"a":2}', b'"\xff"', "[" * 100000])
def test_what_is_not_json_is_400(service, raw):
    answer = service.post("/v1/jobs", raw=raw)
    expect_problem(answer, 400, "json_invalid")
    assert answer.json["detail"].startswith("a spec must be a valid JSON document: line ")


def test_nonsense_specs_are_422_with_pointers(service):
    expect_problem(service.post("/v1/jobs", raw="[]"), 422, "spec_invalid")
    expect_problem(service.post("/v1/jobs", {"version": 1, "nonsense": 1}), 422, "spec_invalid", "/nonsense")
    expect_problem(service.post("/v1/jobs", sphere(count=-1)), 422, "spec_invalid", "/sampling/count")
    spec = sphere()
    spec["surface"]["analytic"]["radius"] = "wide"
    expect_problem(service.post("/v1/jobs", spec), 422, "spec_invalid", "/surface/analytic/radius")
    expect_problem(service.post("/v1/jobs", sphere(region={"min": [0, 0, 0], "max": [1, 1, 0]})), 422, "spec_invalid",
                   "/region/max/2")


def vdb(path):
    return sphere(50, surface={"vdb": {"path": str(path)}}, output={"preview": False})


def test_paths_stay_inside_the_roots(new_service, tmp_path):
    root, outside = tmp_path / "root", tmp_path / "outside"
    root.mkdir()
    outside.mkdir()
    (root / "here.vdb").write_bytes(b"no volume")
    (outside / "secret.vdb").write_bytes(b"secret")
    (root / "link.vdb").symlink_to(outside / "secret.vdb")
    (root / "up").symlink_to("..")
    os.mkfifo(root / "fifo.vdb")
    service = new_service("--input_roots", root).start()
    pointer = "/surface/vdb/path"
    for path in (outside / "secret.vdb", root / "../outside/secret.vdb", "../outside/secret.vdb", root / "link.vdb",
                 "link.vdb", "up/outside/secret.vdb", "/etc/passwd", "/proc/self/environ"):
        expect_problem(service.post("/v1/jobs", vdb(path)), 403, "path_forbidden", pointer)
    for path in (".", "./", f"{root}/", f"{root}/."):
        named = service.post("/v1/jobs", vdb(path))
        expect_problem(named, 422, "input_unsupported", pointer)
        assert f"{path} is an input root: name a file below it" in named.json["detail"]
    refused = service.post("/v1/jobs", vdb("missing.vdb"))
    expect_problem(refused, 422, "input_missing", pointer)
    assert "; upload the file with hexadctl upload, or correct the path" in refused.json["detail"]
    absolute = service.post("/v1/jobs", vdb(root / "missing.vdb")).json
    assert absolute["code"] == "input_missing" and "; put the file there, or correct the path" in absolute["detail"]
    expect_problem(service.post("/v1/jobs", vdb("fifo.vdb")), 422, "input_unsupported", pointer)
    # a file that only claims to be a volume is the worker's to refuse, and harms nobody else
    bad = service.submit(vdb("here.vdb"))
    good = service.submit(sphere())
    failed = service.wait_state(bad, "failed")
    assert failed["error"]["code"] in ("input_damaged", "input_unsupported")
    assert "here.vdb" in failed["error"]["message"] and len(failed["attempts"]) == 1
    service.wait_state(good, "succeeded")
    expect_problem(service.get(f"/v1/jobs/{bad}/results"), 404, "not_found")


def test_links_from_root_to_root_are_followed(new_service, build, tmp_path):
    """As `latest` on farms, by the service and by a worker in the sandbox."""
    shows, shared = tmp_path / "shows", tmp_path / "shared"
    (shows / "v2").mkdir(parents=True)
    shared.mkdir()
    subprocess.run([build / "hexad-worker", "make-example", shared / "example.vdb"], check=True, timeout=PATIENCE_S)
    (shows / "latest").symlink_to(shows / "v2")
    (shows / "v2" / "cloud.vdb").symlink_to(shared / "example.vdb")
    service = new_service("--input_roots", f"{shows},{shared}").start()
    for path in ("latest/cloud.vdb", shows / "latest/cloud.vdb"):
        service.wait_state(service.submit(vdb(path)), "succeeded")


def test_without_roots_no_file_is_read(service, tmp_path):
    (tmp_path / "a.vdb").write_bytes(b"x")
    expect_problem(service.post("/v1/jobs", vdb(tmp_path / "a.vdb")), 403, "path_forbidden", "/surface/vdb/path")


@pytest.mark.sanitized
def test_results_of_an_unfinished_job(service):
    job = service.submit(long_sphere())
    expect_problem(service.get(f"/v1/jobs/{job}/results"), 409, "conflict")
    expect_problem(service.get(f"/v1/jobs/{job}/results/points.ply"), 409, "conflict")


def test_only_listed_results_are_served(service):
    job = service.submit(sphere())
    service.wait_state(job, "succeeded")
    for name in ("worker.log", "nothing", "..", "..%2f..%2fqueue.db", ".", "points.ply%00"):
        reply = service.get(f"/v1/jobs/{job}/results/{name}")
        assert reply.status == 404, name
        assert b"SQLite" not in reply.body
    expect_problem(service.get(f"/v1/jobs/{job}/results/worker.log"), 404, "not_found")


def test_a_head_that_the_library_refuses_ends_nothing(service):
    exchange(service, b"GET /foo HTTP/1.1\r\nba\0z: bar\r\n\r\n")
    assert service.get("/healthz").status == 200


def test_body_limit_by_length(new_service):
    service = new_service("--body_limit_bytes", 1000).start()
    # the answer comes before a single byte of the body
    got = exchange(service, b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
                            b"Content-Length: 1001\r\n\r\n")
    assert got.startswith(b"HTTP/1.1 413 ") and b"body_too_large" in got and b"Connection: close" in got
    expect_problem(service.post("/v1/jobs", raw=" " * 1001), 413, "body_too_large")
    fitting = json.dumps(sphere())
    assert service.post("/v1/jobs", raw=fitting + " " * (1000 - len(fitting))).status == 201


@pytest.mark.sanitized
def test_body_limit_chunked(new_service):
    service = new_service("--body_limit_bytes", 1000).start()
    head = (b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
            b"Transfer-Encoding: chunked\r\nConnection: close\r\n\r\n")
    body = json.dumps(sphere()).encode()

    def chunked(size):
        """A spec that is whole and valid, with blanks up to a size; and a request behind it."""
        padded = body + b" " * (size - len(body))
        pieces = [padded[i:i + 400] for i in range(0, size, 400)] + [b""]
        return head + b"".join(b"%x\r\n%s\r\n" % (len(p), p) for p in pieces)

    assert exchange(service, chunked(1000)).startswith(b"HTTP/1.1 201 ")
    for size in (1001, 2400, 100000):
        got = exchange(service, chunked(size).replace(b"Connection: close\r\n", b"") +
                       b"GET /version HTTP/1.1\r\nHost: x\r\n\r\n")
        assert got.startswith(b"HTTP/1.1 413 ") and b"body_too_large" in got and b"Connection: close" in got, got
        assert got.count(b"HTTP/1.1 ") == 1
    assert len(service.get("/v1/jobs").json["jobs"]) == 1


def test_an_endless_body_is_cut_off(new_service):
    service = new_service("--body_limit_bytes", 1000, "--connection_timeout_s", 0.5).start()
    got = exchange(service, b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
                            b"Transfer-Encoding: chunked\r\n\r\n" + b"190\r\n" + b" " * 400 + b"\r\n")
    assert got == b""
    assert service.get("/v1/jobs").json["jobs"] == []


def test_a_dripping_client_is_cut_off(new_service):
    service = new_service("--connection_timeout_s", 1).start()
    host, _, port = service.address.rpartition(":")
    with socket.create_connection((host, int(port)), timeout=PATIENCE_S) as s:
        started = time.monotonic()
        s.sendall(b"GET /healthz HTTP/1.1\r\n")

        def cut():
            """Sends a byte, so that the connection is never idle; true once it is closed."""
            s.settimeout(0.1)
            try:
                s.sendall(b"a")
                return s.recv(100) == b""
            except TimeoutError:
                return False
            except OSError:
                return True

        wait_until(cut, "the connection to be cut", 30)
        assert time.monotonic() - started >= 0.9
    assert service.get("/healthz").status == 200


def quiet_s(s):
    """Seconds since data were last sent and last received on a TCP socket, as the kernel counts them."""
    info = struct.unpack_from("8B24I", s.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 104))
    return info[8 + 9] / 1000, info[8 + 11] / 1000  # tcpi_last_data_sent, tcpi_last_data_recv, ms


def test_an_idle_time_is_not_the_next_requests(new_service):
    """Idle for most of the timeout, then a request that takes most of it: both have the whole of it."""
    timeout_s = 3
    service = new_service("--connection_timeout_s", timeout_s).start()
    host, _, port = service.address.rpartition(":")
    with socket.create_connection((host, int(port)), timeout=PATIENCE_S) as s:
        named = f"Host: {service.address}\r\n\r\n".encode()
        for part in (b"GET /healthz HTTP/1.1\r\n", named):
            s.sendall(part)
        assert s.recv(65536).startswith(b"HTTP/1.1 200 ")
        wait_until(lambda: quiet_s(s)[1] >= timeout_s * 0.6, "the connection to be idle")
        s.sendall(b"GET /healthz HTTP/1.1\r\n")
        wait_until(lambda: quiet_s(s)[0] >= timeout_s * 0.6, "the request to be slow")
        s.sendall(named)
        assert s.recv(65536).startswith(b"HTTP/1.1 200 ")


def test_keep_alive_and_pipelining(service):
    connection = service.connection()
    for _ in range(20):
        connection.request("GET", "/healthz")
        assert connection.getresponse().read()
    connection.close()
    got = exchange(service, b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n" * 2 +
                   b"GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
    assert got.count(b"HTTP/1.1 200 ") == 3


@pytest.mark.sanitized
def test_a_unix_socket(new_service, tmp_path):
    where = tmp_path / "s.sock"
    service = new_service("--listen", f"unix:{where}")
    service.start()
    assert service.address == f"unix:{where}"
    assert where.stat().st_mode & 0o077 == 0  # nobody else's
    out = subprocess.run([service.build / "hexadctl", "--server", service.address, "list", "--json"],
                         capture_output=True, timeout=PATIENCE_S)
    assert json.loads(out.stdout) == {"jobs": [], "next": None}
    service.end(signal.SIGKILL)
    assert where.exists()  # a stale socket is in nobody's way
    service.start()
    assert service.end() == 0
    assert not where.exists()
