# SPDX-License-Identifier: Apache-2.0
"""The JSON parsing suite and hostile requests of the shared data, against a running daemon: what must be
refused is, what must be accepted is, and the daemon lives on."""
import json
import socket

import pytest

from service import PATIENCE_S, sphere

pytestmark = pytest.mark.extended  # all need the shared data

# Valid JSON by the grammar, but refused by src/base/json on purpose: of two members with one name readers
# disagree which counts, and a NUL would end the text for whoever reads it in C.
STRICTER = {"y_object_duplicated_key.json", "y_object_duplicated_key_and_value.json",
            "y_object_escaped_null_in_key.json", "y_string_null_escape.json"}


@pytest.fixture
def suite(shared_data):
    where = shared_data / "json" / "JSONTestSuite"
    if not where.is_dir():
        pytest.skip(f"there is no {where}")
    return sorted(where.glob("*.json"))


def test_json_suite(service, suite):
    wrong, seen = [], {"y": 0, "n": 0, "i": 0}
    for file in suite:
        kind = file.name[0]
        reply = service.post("/v1/jobs", raw=file.read_bytes())
        seen[kind] += 1
        # no file of the suite is a job spec, so what is JSON is refused as a spec
        fitting = {"y": (400,) if file.name in STRICTER else (422,), "n": (400,), "i": (400, 422)}[kind]
        if reply.status not in fitting or reply.headers["Content-Type"] != "application/problem+json":
            wrong.append((file.name, reply.status))
    assert not wrong
    assert seen["y"] > 90 and seen["n"] > 180
    assert service.get("/healthz").json == {"status": "ok"}


def test_naughty_strings(service, shared_data):
    where = shared_data / "json" / "naughty_strings"
    files = sorted(where.glob("*.json"))
    if not files:
        pytest.skip(f"there is no list in {where}")
    for text in json.loads(files[0].read_text()):
        spec = sphere(name=text[:200])
        spec["surface"] = {"vdb": {"path": text or "x"}}  # without roots only files that were sent are open to jobs
        reply = service.post("/v1/jobs", spec)
        assert reply.status in (403, 422), text
        assert reply.json["code"] in ("path_forbidden", "input_missing", "input_unsupported", "spec_invalid"), text
        reply = service.post("/v1/jobs", sphere(name=text[:200], limits={"timeout_s": 1e6}))
        if reply.status == 201:
            assert reply.json["name"] == text[:200]
            service.post(f"/v1/jobs/{reply.json['id']}/cancel")


def test_hostile_requests(new_service, shared_data):
    service = new_service("--connection_timeout_s", 1).start()  # some never end their request
    files = sorted((shared_data / "json" / "http").glob("*.http"))
    if not files:
        pytest.skip("there are no raw requests")
    host, _, port = service.address.rpartition(":")
    for file in files:
        data = file.read_bytes().replace(b"\n", b"").replace(b"\\r\\n", b"\r\n").replace(b"\\0", b"\0")
        with socket.create_connection((host, int(port)), timeout=PATIENCE_S) as s:
            try:
                s.sendall(data)
                s.shutdown(socket.SHUT_WR)
                got = b""
                while piece := s.recv(65536):
                    got += piece
            except ConnectionError:
                continue
        # 505 is what another version of HTTP is to be told
        assert b"HTTP/1.1 5" not in got.replace(b"HTTP/1.1 505", b""), file.name
        assert b" 201 " not in got, file.name
    assert service.get("/healthz").json == {"status": "ok"}
    assert service.get("/v1/jobs").json["jobs"] == []
