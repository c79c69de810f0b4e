# SPDX-License-Identifier: Apache-2.0
"""Files in and out: parts of results, results that a client has already, inputs that clients send."""
import base64
import hashlib
import os
import socket
import time
import urllib.parse

import pytest

from accounts import new_token, with_token
from service import OPEN_TCP, PATIENCE_S, exchange, expect_problem, gated_worker, long_sphere, sphere, wait_until

TETRAHEDRON = b"""v 1 1 1
v -1 -1 1
v -1 1 -1
v 1 -1 -1
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""


@pytest.fixture
def service(clean_service):
    """One daemon for the tests of this file, without jobs of other tests."""
    return clean_service


@pytest.fixture
def finished(service):
    job = service.submit(sphere())
    service.wait_state(job, "succeeded")
    service.href = f"/v1/jobs/{job}/results/points.ply"
    service.whole = service.get(service.href).body
    return service


@pytest.mark.sanitized
def test_parts_of_a_result(finished):
    whole, size = finished.whole, len(finished.whole)
    for text, first, last in (("bytes=0-0", 0, 0), ("bytes=10-99", 10, 99), ("bytes=-7", size - 7, size - 1),
                              (f"bytes={size - 1}-", size - 1, size - 1), (f"bytes=5-{size * 2}", 5, size - 1)):
        got = finished.request("GET", finished.href, headers={"Range": text})
        assert got.status == 206 and got.body == whole[first:last + 1]
        assert got.headers["Content-Range"] == f"bytes {first}-{last}/{size}"
    # put together it is the whole
    parts = b"".join(finished.request("GET", finished.href, headers={"Range": f"bytes={i}-{i + 999}"}).body
                     for i in range(0, size, 1000))
    assert parts == whole
    for text in ("bytes=0-1,3-4", "nonsense", "bytes=9-1"):
        assert finished.request("GET", finished.href, headers={"Range": text}).status == 200
    over = finished.request("GET", finished.href, headers={"Range": f"bytes={size}-"})
    expect_problem(over, 416, "range_not_satisfiable")
    assert over.headers["Content-Range"] == f"bytes */{size}"
    head = finished.request("HEAD", finished.href, headers={"Range": "bytes=0-0"})
    assert head.status == 200 and int(head.headers["Content-Length"]) == size


def test_what_a_client_has_is_not_sent_again(finished):
    digest = hashlib.sha256(finished.whole)
    got = finished.get(finished.href)
    tag = got.headers["ETag"]
    assert tag == f'"{digest.hexdigest()}"'
    assert got.headers["Repr-Digest"] == f"sha-256=:{base64.b64encode(digest.digest()).decode()}:"
    for known in (tag, f'"x", {tag}', f"W/{tag}", "*"):
        again = finished.request("GET", finished.href, headers={"If-None-Match": known})
        assert again.status == 304 and again.body == b"" and again.headers["ETag"] == tag
    assert finished.request("GET", finished.href, headers={"If-None-Match": '"x"'}).status == 200
    # a part only of the same thing
    same = {"Range": "bytes=0-3", "If-Range": tag}
    assert finished.request("GET", finished.href, headers=same).body == finished.whole[:4]
    other = {"Range": "bytes=0-3", "If-Range": '"x"'}
    assert finished.request("GET", finished.href, headers=other).body == finished.whole


def test_a_listing_is_made_once(finished):
    """And says the same when it is read again, also by a service that was started anew."""
    where = finished.href.rpartition("/")[0]
    listed = finished.get(where).json
    assert [r["name"] for r in listed["results"]][-1] == "report.json"
    job = where.split("/")[3]
    kept = finished.state / "results" / job / ".listing.json"
    assert kept.exists()
    expect_problem(finished.get(f"{where}/.listing.json"), 404, "not_found")
    finished.end()
    # what a killed daemon left goes, and what a writer of this one may need stays
    left, young = (kept.with_name(f".listing.json.{n}") for n in ("0123456789abcdef", "1123456789abcdef"))
    left.touch()
    young.touch()
    os.utime(young, (time.time() + 1000,) * 2)
    finished.start()
    assert finished.get(where).json == listed
    wait_until(lambda: not left.exists(), "the removal of a temporary file")
    assert young.exists() and kept.exists()
    young.unlink()
    kept.unlink()
    assert finished.get(where).json == listed


def put(service, data, name=None, **headers):
    name = name or hashlib.sha256(data).hexdigest()
    return service.request("PUT", f"/v1/inputs/{name}", data, headers)


def query_of(name):
    return "?" + urllib.parse.urlencode({"name": name})


def kept_by(service):
    """The names of the files that were sent."""
    return [f.name for f in (service.state / "inputs").iterdir()]


def mesh(path):
    return sphere(surface={"mesh": {"path": path, "resolution": 24}})


def test_an_input_is_sent_and_used(new_service):
    service = new_service().start()
    name = hashlib.sha256(TETRAHEDRON).hexdigest()
    expect_problem(service.get(f"/v1/inputs/{name}"), 404, "not_found")
    expect_problem(service.post("/v1/jobs", mesh(f"sha256:{name}")), 422, "input_missing", "/surface/mesh/path")
    first = put(service, TETRAHEDRON)
    assert first.status == 201 and first.headers["Location"] == f"/v1/inputs/{name}"
    assert first.json == {"sha256": name, "bytes": len(TETRAHEDRON), "path": f"sha256:{name}", "name": None, "sent": first.json["sent"]}
    again = put(service, TETRAHEDRON)
    assert again.status == 200 and again.json == first.json
    assert service.get(f"/v1/inputs/{name}").json == first.json
    assert kept_by(service) == [f"sha256:{name}"]
    job = service.submit(mesh(f"sha256:{name}.obj"))
    service.wait_state(job, "succeeded")
    report = service.get(f"/v1/jobs/{job}/results/report.json").json
    assert report["inputs"][0]["sha256"] == name


@pytest.mark.parametrize("kind", ["nhdr", "mhd"])
def test_an_uploaded_header_cannot_name_other_files(new_service, kind):
    """They have no place beside it, also if they were uploaded."""
    service = new_service().start()
    headers = {"nhdr": "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 8 8 8\nencoding: raw\ndata file: v.raw\n",
               "mhd": "ObjectType = Image\nNDims = 3\nDimSize = 8 8 8\nElementType = MET_UCHAR\nElementDataFile = v.raw\n"}
    put(service, bytes(512))
    path = put(service, headers[kind].encode()).json["path"]
    volume = {"surface": {"volume": {"path": f"{path}.{kind}", "isovalue": 1}}}
    for members in (volume, {"surface": {"labels": {"path": f"{path}.{kind}"}}},
                    {"attributes": [{"from": f"{path}.{kind}", "as": "heat"}]}):
        job = service.submit({**sphere(100), **members})
        error = service.wait_state(job, "failed")["error"]
        assert error["code"] == "input_unsupported" and error["message"].endswith(
            "it names other files, which an uploaded header cannot: upload one file (.mha with ElementDataFile = LOCAL, "
            ".nrrd with the data in it), or put header and data below an input root"), error


def test_a_result_of_what_was_sent_is_given_again(service):
    """That others use the file meanwhile makes no difference."""
    name = put(service, TETRAHEDRON).json["path"]
    first = service.submit(mesh(f"{name}.obj"))
    service.wait_state(first, "succeeded")
    put(service, TETRAHEDRON)
    again = service.wait_state(service.submit(mesh(f"{name}.obj")), "succeeded")
    assert again["cached_from"] == first


# what it was called with goes to its log
ASKED = """#!/bin/sh
cat > /dev/null
echo "$@" >&2
exit 3
"""


def test_a_worker_is_given_what_its_spec_names(new_service, tmp_path):
    program = tmp_path / "asked"
    program.write_text(ASKED)
    program.chmod(0o700)
    others = tmp_path / "others"
    others.mkdir()
    service = new_service("--worker", program, "--input_roots", others).start()
    name, other = (put(service, data).json["path"] for data in (TETRAHEDRON, b"another's"))
    both = {"union": [mesh(f"{name}.obj")["surface"], mesh(f"{name}.stl")["surface"]]}
    for spec, wanted in ((mesh(f"{name}.obj"), [name]), (sphere(surface=both), [name]), (sphere(), [])):
        job = service.submit(spec | {"name": other})
        service.wait_state(job, "failed")
        words = (service.state / "attempts" / f"{job}.1" / "worker.log").read_text().split()
        roots = [b for a, b in zip(words, words[1:]) if a == "--input-root"]
        assert roots == [str(service.state / "inputs" / w) for w in wanted] + [str(others)]


def test_an_input_that_is_sent_twice_is_not_asked_for(service):
    put(service, TETRAHEDRON)
    name = hashlib.sha256(TETRAHEDRON).hexdigest()
    # the client waits to be told to send; what it hears is that there is no need
    got = exchange(service, f"PUT /v1/inputs/{name} HTTP/1.1\r\nHost: x\r\nExpect: 100-continue\r\n"
                            f"Content-Length: {len(TETRAHEDRON)}\r\n\r\n".encode())
    assert got.startswith(b"HTTP/1.1 200 ") and b"100 Continue" not in got


@pytest.mark.sanitized
def test_inputs_that_are_refused(new_service):
    service = new_service("--upload_limit_bytes", 1000, "--upload_total_bytes", 1500, "--user_upload_bytes", 1500).start()
    expect_problem(put(service, b"x", name="0" * 64), 422, "digest_mismatch")
    for bad in ("0" * 63, "A" * 64, "..", "x" * 64):
        expect_problem(put(service, b"x", name=bad), 400, "request_invalid")
    refused = put(service, b"x" * 1001)
    expect_problem(refused, 413, "body_too_large")
    assert "1001 bytes" in refused.json["detail"] and "1000 (setting upload_limit_bytes)" in refused.json["detail"]
    chunks = (b"x" * 100 for _ in range(11))  # its length is not announced
    name = hashlib.sha256(b"x" * 1100).hexdigest()
    connection = service.connection()
    connection.request("PUT", f"/v1/inputs/{name}", chunks, encode_chunked=True,
                       headers={"Transfer-Encoding": "chunked"})
    refused = connection.getresponse()
    assert refused.status == 413 and b"more bytes than the limit of 1000 (setting upload_limit_bytes)" in refused.read()
    connection.close()
    assert put(service, b"a" * 1000).status == 201
    refused = put(service, b"b" * 1000)
    expect_problem(refused, 507, "storage_full")
    assert "all uploads have 1000 of 1500 bytes (setting upload_total_bytes)" in refused.json["detail"]
    assert put(service, b"c" * 500).status == 201
    assert len(kept_by(service)) == 2
    # a deleted file releases its space
    name = hashlib.sha256(b"a" * 1000).hexdigest()
    expect_problem(service.request("DELETE", f"/v1/inputs/{name}?all=1"), 403, "forbidden")  # an open port has no administrators
    assert service.request("DELETE", f"/v1/inputs/{name}").status == 204
    assert put(service, b"b" * 1000).status == 201


def test_a_broken_upload_leaves_nothing(new_service):
    service = new_service("--upload_total_bytes", 1000, "--user_upload_bytes", 1000).start()
    kept = service.state / "inputs"
    host, _, port = service.address.rpartition(":")
    data = os.urandom(1000)
    name = hashlib.sha256(data).hexdigest()
    with socket.create_connection((host, int(port)), timeout=PATIENCE_S) as s:
        s.sendall(f"PUT /v1/inputs/{name} HTTP/1.1\r\nHost: {service.address}\r\nContent-Length: 1000\r\n\r\n".encode() + data[:600])
        wait_until(lambda: kept_by(service), "the upload")
        expect_problem(put(service, data), 507, "storage_full")  # its room is taken
    wait_until(lambda: not kept_by(service), "the end of it")
    assert put(service, data).status == 201
    # and what a crash leaves is swept away
    service.end(9)
    (kept / f"sha256:{name}.0123456789abcdef").write_bytes(b"a part")
    service.start()
    assert kept_by(service) == [f"sha256:{name}"]
    expect_problem(put(service, b"y"), 507, "storage_full")


@pytest.mark.extended
def test_an_input_that_nobody_uses_goes(new_service, tmp_path, clock):
    service = new_service("--inputs_keep_s", 60, "--worker", gated_worker(tmp_path), "--workers", 1)
    service.clock = clock
    service.start()
    name = put(service, TETRAHEDRON).json["path"]
    job = service.submit(mesh(f"{name}.obj"))
    service.wait_worker(job)
    put(service, b"another")
    clock.step(50)  # the daemon takes it for time that has passed, and looks every 15 s
    wait_until(lambda: kept_by(service) == [name], "the other to go")
    service.open_gate(job)
    service.wait_state(job, "succeeded")
    clock.step(50)
    wait_until(lambda: not list((service.state / "inputs").iterdir()), "the input and its senders to go")
    refused = service.post("/v1/jobs", mesh(f"{name}.obj"))
    expect_problem(refused, 422, "input_missing", "/surface/mesh/path")
    assert refused.json["detail"].endswith("has expired: send it with hexadctl upload")


def test_a_job_whose_input_is_gone_says_so(new_service):
    service = new_service("--workers", 1).start()
    name = put(service, TETRAHEDRON).json["path"]
    first = service.submit(long_sphere())
    service.wait_worker(first)
    job = service.submit(mesh(f"{name}.obj"))
    (service.state / "inputs" / name).unlink()
    assert service.post(f"/v1/jobs/{first}/cancel").status == 202
    failed = service.wait_state(job, "failed")
    assert failed["error"]["code"] == "input_missing" and name in failed["error"]["message"]
    assert "root" not in failed["error"]["message"] and str(service.state) not in failed["error"]["message"]


@pytest.mark.sanitized
def test_an_admin_deletes_an_input(new_service):
    service = new_service()
    at = service.options.index("--listen")
    del service.options[at:at + 2]  # a Unix socket, where the service's own user is an admin
    service.start()
    name = put(service, TETRAHEDRON).json["sha256"]
    assert service.request("DELETE", f"/v1/inputs/{name}").status == 204
    expect_problem(service.request("DELETE", f"/v1/inputs/{name}"), 404, "not_found")
    assert list((service.state / "inputs").iterdir()) == []


@pytest.fixture
def shared_by(new_service):
    """Makes services with tokens of alice, bob and an administrator."""
    def make(*options):
        service = new_service(*options)
        service.options = [o for o in service.options if o not in ("--tcp_without_tokens", OPEN_TCP)]
        service.state.mkdir(mode=0o700)
        service.tokens = {user: new_token(service, user) for user in ("alice", "bob")}
        service.tokens["root"] = new_token(service, "root", "--scopes", "admin")
        service.start()

        def ask(user, method, path, document=None, raw=None, **headers):
            if raw is None:
                return with_token(service, service.tokens[user], method, path, document, **headers)
            return service.request(method, path, raw, {"Authorization": f"Bearer {service.tokens[user]}", **headers})

        service.ask = ask
        return service

    return make


def test_a_hash_alone_opens_nothing(shared_by):
    """Who knows the hash of a file that another has sent can neither name it nor find out that it is there."""
    service = shared_by()
    name = hashlib.sha256(TETRAHEDRON).hexdigest()
    where, spec = f"/v1/inputs/{name}", mesh(f"sha256:{name}.obj")
    assert service.ask("alice", "PUT", where, raw=TETRAHEDRON).status == 201
    assert service.ask("alice", "POST", "/v1/jobs", spec).status == 201

    def expect_nothing():
        expect_problem(service.ask("bob", "GET", where), 404, "not_found")
        for path in ("/v1/jobs", "/v1/jobs:validate"):
            expect_problem(service.ask("bob", "POST", path, spec), 422, "input_missing", "/surface/mesh/path")

    expect_nothing()
    expect_problem(service.ask("bob", "POST", "/v1/jobs", mesh(str(service.state / "inputs" / f"sha256:{name}"))), 403,
                   "path_forbidden", "/surface/mesh/path")
    # other bytes under its name do not make it bob's
    expect_problem(service.ask("bob", "PUT", where, raw=b"x" * len(TETRAHEDRON)), 422, "digest_mismatch")
    got = exchange(service, f"PUT {where} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {service.tokens['bob']}\r\n"
                            f"Expect: 100-continue\r\nContent-Length: {len(TETRAHEDRON)}\r\nConnection: close\r\n\r\n".encode()
                   + b"x" * len(TETRAHEDRON))
    assert got.startswith(b"HTTP/1.1 100 ") and b'"digest_mismatch"' in got
    expect_nothing()
    # administrators may name all
    assert service.ask("root", "POST", "/v1/jobs", spec).status == 201
    assert service.ask("root", "GET", where).status == 200


def test_the_same_bytes_make_it_ones_own(shared_by):
    service = shared_by("--upload_total_bytes", 3 * len(TETRAHEDRON), "--user_upload_bytes", 3 * len(TETRAHEDRON))
    name = hashlib.sha256(TETRAHEDRON).hexdigest()
    where, spec = f"/v1/inputs/{name}", mesh(f"sha256:{name}.obj")
    file = service.state / "inputs" / f"sha256:{name}"
    assert service.ask("alice", "PUT", where, raw=TETRAHEDRON).status == 201
    first = file.stat().st_ino
    for _ in range(5):  # kept once, however often it is sent: nothing of the room for uploads is lost
        assert service.ask("bob", "PUT", where, raw=TETRAHEDRON).status in (200, 201)
    assert kept_by(service) == [file.name] and file.stat().st_ino == first  # which a worker may be about to open
    assert service.ask("bob", "POST", "/v1/jobs", spec).status == 201
    service.end(9)
    service.start()
    assert service.ask("bob", "GET", where).status == 200  # noted for good
    expect_problem(service.ask("root", "DELETE", where), 404, "not_found")  # not uploaded by root
    assert service.ask("root", "DELETE", where + "?all=1").status == 204
    assert not list((service.state / "inputs").iterdir())
    assert service.ask("alice", "PUT", where, raw=TETRAHEDRON).status == 201
    expect_problem(service.ask("bob", "GET", where), 404, "not_found")


def test_the_name_of_an_upload_is_shown_to_its_sender_only(shared_by, tmp_path):
    service = shared_by()
    name = hashlib.sha256(TETRAHEDRON).hexdigest()
    where, spec = f"/v1/inputs/{name}", mesh(f"sha256:{name}.obj") | {"name": None}
    del spec["name"]
    secret, other = "naïve & secret (2).obj", "bob's.obj"
    sent = service.ask("alice", "PUT", where + query_of(secret), raw=TETRAHEDRON)
    assert sent.status == 201 and sent.json["name"] == secret
    assert service.ask("alice", "GET", where).json["name"] == secret
    assert service.ask("root", "GET", where).json["name"] is None
    assert service.ask("bob", "PUT", where, raw=TETRAHEDRON).json["name"] is None
    jobs = {user: service.ask(user, "POST", "/v1/jobs", spec).json for user in ("alice", "bob", "root")}

    def inputs_seen_by(user):
        """The input of each user's job, in the list and in the document."""
        listed = {job["owner"]: job["input"] for job in service.ask(user, "GET", "/v1/jobs").json["jobs"]}
        single = {owner: service.ask(user, "GET", f"/v1/jobs/{job['id']}").json["input"] for owner, job in jobs.items()}
        assert listed == single
        return listed

    assert {user: job["input"] for user, job in jobs.items()} == {"alice": secret, "bob": None, "root": None}
    for user, job in jobs.items():
        ended = service.ask(user, "GET", f"/v1/jobs/{job['id']}", Prefer=f"wait={PATIENCE_S}")
        assert ended.json["state"] == "succeeded" and ended.json["input"] == job["input"]
    assert inputs_seen_by("alice") == {"alice": secret, "bob": None, "root": None}
    assert inputs_seen_by("bob") == inputs_seen_by("root") == {"alice": None, "bob": None, "root": None}
    # a later name replaces the earlier one, also in documents of jobs that have ended; no bytes are needed
    assert service.ask("bob", "PUT", where + query_of(other), raw=b"").json["name"] == other
    assert inputs_seen_by("bob") == {"alice": None, "bob": other, "root": None}
    assert service.ask("alice", "PUT", where + query_of("third.obj"), raw=b"").status == 200
    assert inputs_seen_by("alice") == {"alice": "third.obj", "bob": None, "root": None}
    service.end(9)
    service.start()
    assert service.ask("alice", "GET", where).json["name"] == "third.obj"
    # neither results nor logs contain a name, only the database
    for path in (p for p in service.state.rglob("*") if p.is_file() and not p.name.startswith("queue.db") and p.name != "reserve"):
        content = path.read_bytes()
        assert not any(text.encode() in content for text in (secret, other, "third.obj")), path
    # it goes with the file
    assert service.ask("root", "DELETE", where + "?all=1").status == 204
    assert not list((service.state / "inputs").iterdir())
    assert inputs_seen_by("alice") == {"alice": None, "bob": None, "root": None}


def test_messages_name_an_upload_to_its_sender_only(shared_by):
    service = shared_by()
    broken = b"ply\nformat ascii 1.0\nelement vertex 3\n"
    name = hashlib.sha256(broken).hexdigest()
    assert service.ask("alice", "PUT", f"/v1/inputs/{name}" + query_of("my scan.v2.ply"), raw=broken).status == 201
    job = service.ask("alice", "POST", "/v1/jobs", mesh(f"sha256:{name}.ply")).json["id"]
    ended = service.ask("alice", "GET", f"/v1/jobs/{job}", Prefer=f"wait={PATIENCE_S}")
    assert ended.json["state"] == "failed"

    def messages_seen_by(user):
        answers = service.ask(user, "GET", f"/v1/jobs/{job}").json, service.ask(user, "GET", "/v1/jobs").json["jobs"][0]
        tasks = service.ask(user, "GET", f"/v1/jobs/{job}/tasks").json["tasks"]
        return {answer["error"]["message"] for answer in (*answers, *tasks)}

    (stored,) = messages_seen_by("root")
    assert f"sha256:{name}.ply" in stored
    named = stored.replace(f"sha256:{name}.ply", f"my scan.v2.ply (sha256:{name[:8]}...)")
    assert messages_seen_by("alice") == {named}
    for path, document in (("/v1/jobs:validate", mesh(f"sha256:{name}.ply")), ("/v1/inputs:inspect", {"path": f"sha256:{name}.ply"})):
        refused = service.ask("alice", "POST", path, document)
        assert refused.status == 422 and refused.json["detail"].startswith(f"my scan.v2.ply (sha256:{name[:8]}...): "), refused.json
    assert service.ask("alice", "PUT", f"/v1/inputs/{name}" + query_of("b.ply"), raw=b"").status == 200
    fresh = service.ask("alice", "GET", f"/v1/jobs/{job}", **{"If-None-Match": ended.headers["ETag"]})
    assert fresh.status == 200 and fresh.json["error"]["message"] == named.replace("my scan.v2.ply", "b.ply")


@pytest.mark.sanitized
def test_the_name_of_a_shared_upload_belongs_to_each_user(shared_by):
    service = shared_by("--share_inputs", 1)
    where = f"/v1/inputs/{hashlib.sha256(TETRAHEDRON).hexdigest()}"
    assert service.ask("alice", "PUT", where + query_of("a.obj"), raw=TETRAHEDRON).json["name"] == "a.obj"
    assert service.ask("bob", "GET", where).json["name"] is None
    assert service.ask("bob", "PUT", where + query_of("b" * 255), raw=b"").json["name"] == "b" * 255
    assert service.ask("alice", "GET", where).json["name"] == "a.obj"
    for wrong in ("", "c" * 256):
        expect_problem(service.ask("bob", "PUT", where + query_of(wrong), raw=b""), 400, "request_invalid")
    refused = service.ask("bob", "PUT", f"/v1/inputs/{'0' * 64}" + query_of("d.obj"), raw=b"")
    expect_problem(refused, 422, "digest_mismatch")
    assert service.ask("bob", "GET", where).json["name"] == "b" * 255
    # a client that waits for 100 gets the answer at once if the name is known
    token = service.tokens["alice"]
    got = exchange(service, f"PUT {where}?name=a.obj HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {token}\r\n"
                            f"Expect: 100-continue\r\nContent-Length: {len(TETRAHEDRON)}\r\n\r\n".encode())
    assert got.startswith(b"HTTP/1.1 200 ") and b"100 Continue" not in got


def uploads_of(service, user, limit=500):
    """All entries of the user's list, read in pages."""
    entries, cursor = [], ""
    while cursor is not None:
        page = service.ask(user, "GET", f"/v1/inputs?limit={limit}{cursor}").json
        assert len(page["inputs"]) <= limit
        entries += page["inputs"]
        cursor = page["next"] and f"&cursor={page['next']}"
    return entries


def test_users_list_their_uploads(shared_by):
    service = shared_by()
    contents = [b"file %d" % i for i in range(5)]
    names = [hashlib.sha256(content).hexdigest() for content in contents]
    for user in ("alice", "bob"):
        assert uploads_of(service, user) == []
    for i, (name, content) in enumerate(zip(names, contents)):
        sent = service.ask("alice", "PUT", f"/v1/inputs/{name}" + query_of(f"{i}.obj"), raw=content)
        shown = service.ask("alice", "GET", f"/v1/inputs/{name}").json
        assert sent.json == shown and shown["sent"] is not None
    assert service.ask("bob", "PUT", f"/v1/inputs/{names[0]}", raw=contents[0]).status == 201
    entries = uploads_of(service, "alice")
    assert sorted(entry["name"] for entry in entries) == [f"{i}.obj" for i in range(5)]
    assert sorted(entries, key=lambda entry: entry["sent"], reverse=True) == entries
    assert all(entry["bytes"] == 6 and entry["path"] == "sha256:" + entry["sha256"] and entry["jobs"] == []
               and entry["job_count"] == entry["unfinished_count"] == 0 and entry["used"] for entry in entries)
    for limit in (1, 2, 5):
        assert uploads_of(service, "alice", limit) == entries
    # an entry that is deleted between two pages skips no other one
    page = service.ask("alice", "GET", "/v1/inputs?limit=2").json
    assert service.ask("alice", "DELETE", f"/v1/inputs/{page['inputs'][1]['sha256']}").status == 204
    rest = service.ask("alice", "GET", f"/v1/inputs?cursor={page['next']}").json
    assert rest == {"inputs": entries[2:], "next": None}
    for wrong in ("x", "1-", "1-zz", "-" + names[0]):
        expect_problem(service.ask("alice", "GET", f"/v1/inputs?cursor={wrong}"), 400, "request_invalid")
    # other users see neither entries nor names
    assert [(entry["sha256"], entry["name"]) for entry in uploads_of(service, "bob")] == [(names[0], None)]
    assert uploads_of(service, "root") == []
    service.end(9)
    service.start()
    assert uploads_of(service, "alice") == entries[:1] + entries[2:]


def test_a_list_of_uploads_has_the_own_jobs_that_read_them(shared_by, tmp_path):
    service = shared_by("--worker", gated_worker(tmp_path), "--workers", 1)
    where = f"/v1/inputs/{hashlib.sha256(TETRAHEDRON).hexdigest()}"
    spec = mesh(service.ask("alice", "PUT", where, raw=TETRAHEDRON).json["path"] + ".obj")
    assert service.ask("bob", "PUT", where, raw=TETRAHEDRON).status == 201
    jobs = {user: [service.ask(user, "POST", "/v1/jobs", spec).json["id"] for _ in range(count)]
            for user, count in (("alice", 2), ("bob", 1))}
    for user, ids in jobs.items():
        entry, = uploads_of(service, user)
        assert (entry["jobs"], entry["job_count"], entry["unfinished_count"]) == (ids[::-1], len(ids), len(ids))
    assert service.ask("alice", "POST", f"/v1/jobs/{jobs['alice'][1]}/cancel").status == 200
    entry, = uploads_of(service, "alice")
    assert (entry["jobs"], entry["job_count"], entry["unfinished_count"]) == (jobs["alice"][::-1], 2, 1)


def test_a_deleted_upload_stays_for_other_users_and_for_unfinished_jobs(shared_by):
    size = len(TETRAHEDRON)
    service = shared_by("--user_upload_bytes", size)
    name = hashlib.sha256(TETRAHEDRON).hexdigest()
    where, file = f"/v1/inputs/{name}", service.state / "inputs" / f"sha256:{name}"
    spec = mesh(f"sha256:{name}.obj")
    for user in ("alice", "bob"):
        assert service.ask(user, "PUT", where + query_of(f"{user}.obj"), raw=TETRAHEDRON).status == 201
    # one user deletes it: it has neither file nor name any more, and space for another file
    expect_problem(service.ask("alice", "DELETE", where + "?all=1"), 403, "forbidden")
    assert service.ask("alice", "DELETE", where).status == 204
    expect_problem(service.ask("alice", "DELETE", where), 404, "not_found")
    expect_problem(service.ask("alice", "GET", where), 404, "not_found")
    expect_problem(service.ask("alice", "POST", "/v1/jobs", spec), 422, "input_missing", "/surface/mesh/path")
    assert uploads_of(service, "alice") == [] and file.exists()
    other = b"x" * size
    assert service.ask("alice", "PUT", f"/v1/inputs/{hashlib.sha256(other).hexdigest()}", raw=other).status == 201
    # the other user has a job, which runs although its owner deletes the file before
    assert service.ask("bob", "GET", where).json["name"] == "bob.obj"
    assert service.ask("root", "POST", "/v1/admin/hold").status == 200
    job = service.ask("bob", "POST", "/v1/jobs", spec).json["id"]
    assert service.ask("bob", "DELETE", where).status == 204
    assert file.exists() and uploads_of(service, "bob") == []
    expect_problem(service.ask("bob", "POST", "/v1/jobs", spec), 422, "input_missing", "/surface/mesh/path")
    assert service.ask("root", "POST", "/v1/admin/release").status == 200
    assert service.ask("bob", "GET", f"/v1/jobs/{job}", Prefer=f"wait={PATIENCE_S}").json["state"] == "succeeded"
    # then no user and no job needs it: the next collection, here that of a start, removes it
    service.end()
    service.start()
    wait_until(lambda: not file.exists(), "the collection")


def test_the_last_user_that_deletes_an_upload_removes_it(shared_by):
    service = shared_by()
    where = f"/v1/inputs/{hashlib.sha256(TETRAHEDRON).hexdigest()}"
    for user in ("alice", "bob"):
        assert service.ask(user, "PUT", where + query_of("a.obj"), raw=TETRAHEDRON).status == 201
    assert service.ask("bob", "DELETE", where).status == 204
    assert kept_by(service)
    assert service.ask("alice", "DELETE", where).status == 204
    assert not list((service.state / "inputs").iterdir())


@pytest.mark.sanitized
def test_a_user_that_sends_a_shared_file_holds_it(shared_by):
    """Whether the service needs the bytes or not."""
    service = shared_by("--share_inputs", 1, "--user_upload_bytes", len(TETRAHEDRON))
    where = f"/v1/inputs/{hashlib.sha256(TETRAHEDRON).hexdigest()}"
    assert service.ask("alice", "PUT", where, raw=TETRAHEDRON).status == 201
    assert service.ask("bob", "GET", where).json["sent"] is None and uploads_of(service, "bob") == []
    assert service.ask("bob", "PUT", where, raw=b"").status == 200
    assert service.ask("bob", "GET", where).json["sent"] is not None and len(uploads_of(service, "bob")) == 1
    assert service.ask("alice", "DELETE", where).status == 204
    assert service.ask("bob", "DELETE", where).status == 204
    assert not list((service.state / "inputs").iterdir())
    # the limit of a user applies to this file as well
    other = f"/v1/inputs/{hashlib.sha256(b'x').hexdigest()}"
    assert service.ask("bob", "PUT", other, raw=b"x").status == 201
    assert service.ask("alice", "PUT", where, raw=TETRAHEDRON).status == 201
    expect_problem(service.ask("bob", "PUT", where, raw=b""), 507, "storage_full")
    assert [entry["bytes"] for entry in uploads_of(service, "bob")] == [1]


def test_what_is_sent_can_be_shared(shared_by):
    service = shared_by("--share_inputs", 1)
    name = hashlib.sha256(TETRAHEDRON).hexdigest()
    assert service.ask("alice", "PUT", f"/v1/inputs/{name}", raw=TETRAHEDRON).status == 201
    assert service.ask("bob", "POST", "/v1/jobs", mesh(f"sha256:{name}.obj")).status == 201
