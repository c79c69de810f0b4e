# SPDX-License-Identifier: Apache-2.0
"""hexad behind nginx and stunnel, set up as doc/systemd.md says, over TLS with a certificate made for the test."""
import hashlib
import json
import os
import socket
import ssl
import subprocess
import threading

import pytest

from accounts import new_token
from proxies import Front
from service import OPEN_TCP, PATIENCE_S, Stream, gated_worker, sphere, wait_until

pytestmark = pytest.mark.extended  # needs nginx and stunnel


@pytest.fixture
def fronts(source, certificate, tmp_path):
    """Makes fronts, which are gone after the test."""
    made = []

    def make(kind, behind):
        made.append(Front(kind, source, certificate, tmp_path / f"front.{len(made)}", behind))
        return made[-1]

    yield make
    for front in made:
        front.end()


@pytest.fixture
def guarded(new_service):
    """Makes services with a token of alice, on a loopback port."""
    def make(*options):
        service = new_service(*options)
        service.options = [o for o in service.options if o not in ("--tcp_without_tokens", OPEN_TCP)]
        service.state.mkdir(mode=0o700)
        service.token = new_token(service, "alice")
        return service.start()

    return make


KINDS = {"nginx": ("--trusted_proxies", "127.0.0.1"), "stunnel": ()}


@pytest.fixture(params=KINDS)
def both(request, guarded, fronts, tmp_path):
    """A service whose jobs end when their gate opens, and a front."""
    service = guarded("--worker", gated_worker(tmp_path), *KINDS[request.param])
    front = fronts(request.param, service.address)
    return service, front


def test_events_arrive_when_they_happen(both):
    service, front = both
    told = iter(Stream(front, "/v1/events", token=service.token))
    assert next(told)[1] == "position"
    job = front.submit(service.token, sphere())
    for _, kind, document in told:  # the job goes on until its gate opens, so nothing pushes these out
        if kind == "started" and document["job"] == job:
            break
    for _, kind, _ in Stream(front, f"/v1/jobs/{job}/events", token=service.token):
        if kind == "progress":
            break
    service.open_gate(job)
    assert next(kind for _, kind, d in told if kind == "ended" and d["job"] == job)


def test_the_client_in_python(both, source, certificate, tmp_path, monkeypatch):
    """Events, waits, results and files through TLS; a certificate that nobody vouches for is refused at once."""
    monkeypatch.syspath_prepend(str(source / "clients/python"))
    import hexad
    service, front = both
    server = f"https://{front.address}"
    client = hexad.Client(server, service.token, context=ssl.create_default_context(cafile=str(certificate / "certificate.pem")))
    job = client.submit(sphere(100))
    service.open_gate(job.id)
    assert list(job.events())[-1].is_end and job.wait().state == "succeeded"
    fetched = job.fetch(tmp_path / "out")
    assert [p.name for p in fetched] == [r.name for r in job.results()] and fetched[-1].name == "report.json"
    assert client.upload(b"v 0 0 0\n" * 200_000, ".obj") == client.upload(b"v 0 0 0\n" * 200_000, ".obj")
    with pytest.raises(hexad.Unreachable, match="certificate"):
        hexad.Client(server, service.token).job(job.id)
    with pytest.raises(hexad.Problem) as refused:
        hexad.Client(server, "wrong", context=client.transport.context).job(job.id)
    assert refused.value.status == 401


def test_an_answer_waits(both):
    service, front = both
    job = front.submit(service.token, sphere())
    got = []
    waiting = threading.Thread(target=lambda: got.append(
        front.ask(service.token, "GET", f"/v1/jobs/{job}", Prefer="wait=60")))
    waiting.start()
    wait_until(lambda: b"hexad_http_connections 2" in front.ask(service.token, "GET", "/metrics").body, "the one who waits")
    assert not got
    service.open_gate(job)
    waiting.join(PATIENCE_S)
    assert got[0].status == 200 and json.loads(got[0].body)["state"] == "succeeded"


def test_long_bodies_go_through(both):
    service, front = both
    data = os.urandom(3 << 20)
    name = hashlib.sha256(data).hexdigest()
    assert front.ask(service.token, "PUT", f"/v1/inputs/{name}", data).status == 201
    other = data[:-1]
    name = hashlib.sha256(other).hexdigest()
    pieces = (other[i:i + 65536] for i in range(0, len(other), 65536))  # chunks, without a length
    assert front.ask(service.token, "PUT", f"/v1/inputs/{name}", pieces).status == 201


def test_parts_of_results(both):
    service, front = both
    job = front.submit(service.token, sphere())
    service.open_gate(job)
    waited = front.ask(service.token, "GET", f"/v1/jobs/{job}", Prefer="wait=60")
    assert json.loads(waited.body)["state"] == "succeeded"
    where = f"/v1/jobs/{job}/results/report.json"
    whole = front.ask(service.token, "GET", where)
    part = front.ask(service.token, "GET", where, Range="bytes=3-9", If_Range=whole.headers["ETag"])
    assert part.status == 206 and part.body == whole.body[3:10]
    assert part.headers["Content-Range"] == f"bytes 3-9/{len(whole.body)}"
    assert front.ask(service.token, "GET", where, If_None_Match=whole.headers["ETag"]).status == 304
    assert front.ask(service.token, "GET", where, Range=f"bytes={2**64 - 1}-").status == 416


def test_hexadctl_speaks_tls(both, tmp_path):
    service, front = both
    known = {**os.environ, "HEXAD_SERVER": f"https://{front.address}", "HEXAD_TOKEN": service.token,
             "SSL_CERT_FILE": str(front.certificate / "certificate.pem")}

    def call(*words, environment=known):
        return subprocess.run([service.build / "hexadctl", *map(str, words)], env=environment, cwd=tmp_path,
                              capture_output=True, text=True, timeout=PATIENCE_S)

    (tmp_path / "long").write_bytes(os.urandom(2 << 20))
    sent = call("upload", "long")
    assert sent.returncode == 0 and sent.stdout.startswith("sha256:"), sent.stderr
    (tmp_path / "spec.json").write_text(json.dumps(sphere()))
    submitted = call("submit", "spec.json", "--json")
    assert submitted.returncode == 0, submitted.stderr
    job = json.loads(submitted.stdout)["id"]
    service.open_gate(job)
    assert call("wait", job).returncode == 0
    assert call("fetch", job, "--output", tmp_path / "got").returncode == 0
    assert (tmp_path / "got" / "report.json").exists()
    # a server whose certificate nobody vouches for is told nothing
    strange = call("list", environment={k: v for k, v in known.items() if k != "SSL_CERT_FILE"})
    assert strange.returncode == 3 and "certificate" in strange.stderr


def test_nginx_tells_who_the_client_is(guarded, fronts):
    service = guarded(*KINDS["nginx"])
    front = fronts("nginx", service.address)
    claims = {"Forwarded": "for=192.0.2.1", "X_Forwarded_For": "192.0.2.2", "X_Real_IP": "192.0.2.3"}
    assert front.ask(service.token, "GET", "/v1/jobs", source="127.0.0.7", **claims).status == 200
    log = service.log.read_text()
    assert "user=alice client=127.0.0.7" in log and "192.0.2." not in log


def test_stunnel_tells_nothing(guarded, fronts):
    """What a client claims passes, and is not believed."""
    service = guarded(*KINDS["stunnel"])
    front = fronts("stunnel", service.address)
    assert front.ask(service.token, "GET", "/v1/jobs", Forwarded="for=192.0.2.1").status == 200
    log = service.log.read_text()
    assert "user=alice client=127.0.0.1" in log and "192.0.2." not in log


def test_nginx_replaces_what_clients_claim(fronts):
    """As it arrives behind nginx."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        front = fronts("nginx", f"127.0.0.1:{listening.getsockname()[1]}")
        got = []

        def serve():
            one, _ = listening.accept()
            while b"\r\n\r\n" not in b"".join(got):
                got.append(one.recv(65536))
            one.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n")
            one.close()

        server = threading.Thread(target=serve)
        server.start()
        front.ask("x", "GET", "/v1/jobs", Forwarded="for=192.0.2.1", X_Forwarded_For="192.0.2.2")
        server.join(PATIENCE_S)
    lines = b"".join(got).decode().lower().split("\r\n")
    assert [line for line in lines if "forwarded" in line] == ["forwarded: for=127.0.0.1"]
    assert lines[0] == "get /v1/jobs http/1.1" and f"host: {front.address}" in lines and "authorization: bearer x" in lines
