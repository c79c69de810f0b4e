# SPDX-License-Identifier: Apache-2.0
"""Requests that a proxy in front may read otherwise: each is refused, once, and what follows on the connection is no request."""
import json
import random
import socket

import pytest

from service import PATIENCE_S, exchange, expect_problem, sphere

FOLLOWS = b"GET /version HTTP/1.1\r\nHost: x\r\n\r\n"
NOT_PLAIN = {
    "blank before the colon": b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-Name : 1\r\n\r\n",
    "tab before the colon": b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-Name\t: 1\r\n\r\n",
    "blank before the first name": b"GET /healthz HTTP/1.1\r\n X-Name: 1\r\nHost: x\r\n\r\n",
    "no name": b"GET /healthz HTTP/1.1\r\nHost: x\r\n: 1\r\n\r\n",
    "bad byte in a name": b"GET /healthz HTTP/1.1\r\nHost: x\r\nX(Name): 1\r\n\r\n",
    "two hosts": b"GET /healthz HTTP/1.1\r\nHost: x\r\nHost: x\r\n\r\n",
    "no host": b"GET /healthz HTTP/1.1\r\nX-Name: 1\r\n\r\n",
    "NUL in a value": b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-Name: 1\x002\r\n\r\n",
    "NUL at the end of a value": b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-Name: 1\x00\r\n\r\n",
    "NUL in the last value": b"GET /healthz HTTP/1.1\r\nX-Name: 1\x002\r\nHost: x\r\n\r\n",
    "control byte in a value": b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-Name: 1\x012\r\n\r\n",
    "CR in a value": b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-Name: 1\r2\r\n\r\n",
    "CR before CR LF": b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-Name: 1\r\r\n\r\n",
    "folded": b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-Name: 1\r\n 2\r\n\r\n",
    "folded with a tab": b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-Name: 1\r\n\t2\r\nX-Other: 3\r\n\r\n",
    "folded and empty": b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-Name: 1\r\n \r\n\r\n",
    "folded length": b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: 1\r\n 2\r\n\r\n",
    "LF after the request line": b"GET /healthz HTTP/1.1\nHost: x\r\n\r\n",
    "LF after a header": b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-Name: 1\nX-Other: 2\r\n\r\n",
    "LF after the last header": b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-Name: 1\n\r\n",
    "LF at the end": b"GET /healthz HTTP/1.1\r\nHost: x\r\n\n",
    "LF everywhere": b"GET /healthz HTTP/1.1\nHost: x\n\n",
    "two blanks before the path": b"GET  /healthz HTTP/1.1\r\nHost: x\r\n\r\n",
    "two blanks before the version": b"GET /healthz  HTTP/1.1\r\nHost: x\r\n\r\n",
    "blank in the path": b"GET /healthz x HTTP/1.1\r\nHost: x\r\n\r\n",
    "NUL in the path": b"GET /healthz\x00x HTTP/1.1\r\nHost: x\r\n\r\n",
    "NUL in the method": b"GET\x00 /healthz HTTP/1.1\r\nHost: x\r\n\r\n",
    "tab in the path": b"GET /healthz\tx HTTP/1.1\r\nHost: x\r\n\r\n",
    "coding with HTTP/1.0": b"POST /v1/jobs HTTP/1.0\r\nHost: x\r\nConnection: keep-alive\r\n"
                            b"Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
    "length and coding": b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
    "two lengths": b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\nContent-Length: 6\r\n\r\n0\r\n\r\n",
    "the same length twice": b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\nContent-Length: 5\r\n\r\n0\r\n\r\n",
    "two codings": b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n"
                   b"Transfer-Encoding: identity\r\n\r\n0\r\n\r\n",
    "unknown coding": b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: gzip\r\n\r\n0\r\n\r\n",
    "negative length": b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: -1\r\n\r\n",
    "signed length": b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: +1\r\n\r\n1",
    "length in words": b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: five\r\n\r\n12345",
    "list of lengths": b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: 5, 5\r\n\r\n12345",
    "length of 80 bits": b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: 1208925819614629174706176\r\n\r\n",
}


def answer_of(got):
    """The status, the headers and the document of the one answer in these bytes."""
    assert got.count(b"HTTP/1.1 ") == 1, got
    head, _, body = got.partition(b"\r\n\r\n")
    line, *headers = head.decode().split("\r\n")
    headers = {name.lower(): value for name, value in (h.split(": ", 1) for h in headers)}
    assert len(body) == int(headers["content-length"])
    return int(line.split()[1]), headers, json.loads(body)


@pytest.fixture
def service(clean_service):
    """One daemon for the tests of this file, without jobs of other tests."""
    return clean_service


@pytest.mark.sanitized
@pytest.mark.parametrize("name", NOT_PLAIN)
def test_what_can_be_read_otherwise_is_refused(service, name):
    status, headers, problem = answer_of(exchange(service, NOT_PLAIN[name] + FOLLOWS))
    assert status == 400 or name == "length of 80 bits" and status == 413
    assert headers["content-type"] == "application/problem+json" and headers["connection"] == "close"
    assert problem["status"] == status and problem["detail"]
    assert problem["code"] == ("request_invalid" if status == 400 else "body_too_large")


def connect(service):
    host, _, port = service.address.rpartition(":")
    return socket.create_connection((host, int(port)), timeout=PATIENCE_S)


def test_a_bad_length_is_answered_while_other_heads_are_under_way(service):
    """Connections with a part of a head are not taken for the one with the fault."""
    named = f"Host: {service.address}\r\n".encode()
    others = [connect(service) for _ in range(3)]
    for other in others:
        other.sendall(b"GET /healthz HTTP/1.1\r\n" + named)
    for _ in range(3):
        status, _, _ = answer_of(exchange(service, NOT_PLAIN["length in words"] + FOLLOWS))
        assert status == 400
    for other in others:
        other.sendall(b"Connection: close\r\n\r\n")
        assert other.recv(65536).startswith(b"HTTP/1.1 200 ")
        other.close()


def test_cookies_without_room_are_refused_once(service):
    """The library copies cookies. Where there is no room for the copy it answers twice by itself."""
    statuses = []
    for length in range(1000, 32000, 1000):
        request = b"GET /healthz HTTP/1.1\r\nHost: %s\r\nCookie: a=%s\r\nConnection: close\r\n\r\n" % (
            service.address.encode(), b"b" * length)
        got = exchange(service, request)
        assert got.count(b"HTTP/1.1 ") == 1, got
        statuses.append(int(got.split()[1]))
        if statuses[-1] == 400:
            assert b"header_limit_bytes" in got
    assert statuses[0] == 200 and 400 in statuses and sorted(statuses) == statuses


@pytest.mark.parametrize("rounds", [20, pytest.param(60, marks=pytest.mark.extended)])
def test_good_heads_of_all_sizes_pass(service, rounds):
    """However they are cut into pieces and follow each other; up to nearly header_limit_bytes."""
    seed = random.randrange(2**32)
    print("seed", seed)
    chance = random.Random(seed)
    with connect(service) as s:
        answers = s.makefile("rb")
        for _ in range(rounds):
            lines = [f"Host: {service.address}", "cookie: a=1; b=\"2\"", "x-empty:", "x-tab:\t1 \t", "x-utf: \u00e4"]
            for i in range(chance.choice((0, 3, 50))):
                lines.append(f"x-{i}:{' ' * chance.randrange(3)}{'v' * chance.choice((0, 1, 20, 150))}")
            chance.shuffle(lines)
            count = chance.choice((1, 2, 5))
            head = "\r\n".join([f"GET /healthz{chance.choice(('', '?'))} HTTP/1.1", *lines, "", ""]).encode()
            sent = head * count
            while sent:
                some = chance.choice((len(sent), 1000, 100))
                s.sendall(sent[:some])
                sent = sent[some:]
            for _ in range(count):
                assert answers.readline() == b"HTTP/1.1 200 OK\r\n"
                length = 0
                while (line := answers.readline()) != b"\r\n":
                    if line.lower().startswith(b"content-length:"):
                        length = int(line.split(b":")[1])
                assert answers.read(length)


def test_no_request_follows_a_chunked_body(service):
    """Readers of chunks disagree on what is malformed, so the connection ends with such a request."""
    body = json.dumps(sphere()).encode()
    got = exchange(service, b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
                            b"Transfer-Encoding: chunked\r\n\r\n%x\r\n%s\r\n0\r\n\r\n" % (len(body), body) + FOLLOWS)
    status, headers, _ = answer_of(got)
    assert status == 201 and headers["connection"] == "close"


@pytest.mark.parametrize("count", [9, 500, 1000, 8000])
def test_a_query_of_many_parameters_is_answered(service, count):
    """With more than the library has memory for, it fell silent until the time limit of the connection."""
    query = "&".join(f"{i:x}" for i in range(count))[:30000]
    expect_problem(service.get(f"/v1/jobs?{query}"), 400, "request_invalid")


@pytest.mark.sanitized
def test_a_coded_body_is_refused(service):
    body = json.dumps(sphere())
    headers = {"Content-Type": "application/json", "Content-Encoding": "gzip"}
    reply = service.request("POST", "/v1/jobs", body, headers)
    expect_problem(reply, 415, "media_type_unsupported")
    assert reply.headers["Accept-Encoding"] == "identity"
    expect_problem(service.request("PUT", f"/v1/inputs/sha256:{'0' * 64}", b"x", {"Content-Encoding": "gzip"}), 415,
                   "media_type_unsupported")
    assert service.request("POST", "/v1/jobs", body, {**headers, "Content-Encoding": "Identity"}).status == 201


def test_a_merge_patch_is_understood(service):
    job = service.submit(sphere())
    patched = service.request("PATCH", f"/v1/jobs/{job}", '{"labels":["new"]}', {"Content-Type": "application/merge-patch+json"})
    assert patched.status == 200 and patched.json["labels"] == ["new"]
    expect_problem(service.request("POST", "/v1/jobs", json.dumps(sphere()), {"Content-Type": "application/merge-patch+json"}),
                   415, "media_type_unsupported")


def test_a_range_far_beyond_the_end_is_no_range(service):
    job = service.submit(sphere())
    service.wait_state(job, "succeeded")
    path = f"/v1/jobs/{job}/results/points.ply"
    for far in (2**63 - 1, 2**64 - 1, 10**30):
        reply = service.request("GET", path, headers={"Range": f"bytes={far}-"})
        expect_problem(reply, 416, "range_not_satisfiable")
    whole = service.get(path).body
    part = service.request("GET", path, headers={"Range": f"bytes=5-{2**64 - 1}"})
    assert part.status == 206 and part.body == whole[5:]
