"""What a web page that is open in a browser can do to a port that asks for no token: nothing, unless it is named."""
import json

import pytest

from service import OPEN_TCP, long_sphere, sphere
from test_access import new_token
from test_connections import settings_fault
from test_rest import exchange, expect_problem

GUI = "https://gui.example"


def port_of(service):
    return service.address.rpartition(":")[2]


def ask(service, method, path, body=None, **headers):
    return service.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})


def test_a_foreign_host_is_refused(service):
    """The name of an attacker's host was made to lead here (DNS rebinding)."""
    job = service.submit(long_sphere())
    port = port_of(service)
    for host in ("evil.example", f"evil.example:{port}", "localhost", "127.0.0.1", f"127.0.0.1:{int(port) ^ 1}",
                 f"localhost:{port}.evil.example", f"127.0.0.2:{port}", ""):
        for method, path in (("GET", "/v1/jobs"), ("GET", f"/v1/jobs/{job}"), ("POST", f"/v1/jobs/{job}/cancel"),
                             ("GET", "/healthz"), ("GET", "/nothing"), ("OPTIONS", "/v1/jobs")):
            expect_problem(ask(service, method, path, Host=host), 421, "misdirected_request")
    two = exchange(service, f"GET /v1/jobs HTTP/1.1\r\nHost: {service.address}\r\nHost: evil.example\r\n\r\n".encode())
    assert two.startswith(b"HTTP/1.1 400 ") and b'"request_invalid"' in two
    assert service.job(job)["state"] in ("queued", "running")


def test_its_own_hosts_are_answered(service):
    port = port_of(service)
    for host in (f"127.0.0.1:{port}", f"localhost:{port}", f"LOCALHOST:{port}", f"[::1]:{port}"):
        assert ask(service, "GET", "/v1/jobs", Host=host).status == 200
        assert ask(service, "GET", "/v1/jobs", Origin=f"http://{host}").status == 200
    # every browser names the host; what does not is none
    assert exchange(service, b"GET /v1/jobs HTTP/1.0\r\n\r\n").split()[1] == b"200"


def test_the_host_that_the_setting_names(new_service):
    service = new_service("--listen", "localhost:0").start()
    assert ask(service, "GET", "/v1/jobs", Host=f"localhost:{port_of(service)}").status == 200


def test_pages_of_others_are_refused(service):
    """A page sends a form to this port (CSRF); a browser says so, and answers to pages it lets nobody read."""
    job = service.submit(long_sphere())
    port = port_of(service)
    for origin in ("http://evil.example", "null", f"https://localhost:{port}", "http://localhost", "",
                   f"http://evil.example:{port}", f"http://localhost:{port}/", f"http://localhost:{port}@evil.example"):
        for method, path in (("GET", "/v1/jobs"), ("POST", f"/v1/jobs/{job}/cancel"),
                             ("POST", f"/v1/jobs/{job}/pause"), ("GET", "/version")):
            reply = ask(service, method, path, Origin=origin)
            expect_problem(reply, 403, "origin_forbidden")
            assert not [name for name in reply.headers if name.startswith("Access-Control")]
        reply = ask(service, "OPTIONS", "/v1/jobs", Origin=origin, Access_Control_Request_Method="POST")
        expect_problem(reply, 403, "origin_forbidden")
    two = exchange(service, f"GET /v1/jobs HTTP/1.1\r\nHost: {service.address}\r\nOrigin: http://{service.address}\r\n"
                            "Origin: http://evil.example\r\n\r\n".encode())
    assert two.startswith(b"HTTP/1.1 403 ")
    assert service.job(job)["state"] in ("queued", "running")


def test_pages_that_name_no_origin_are_refused(service):
    """A picture or a script of another site: asked for without Origin, but new browsers say whose it is."""
    for site, status in (("cross-site", 403), ("same-site", 403), ("same-origin", 200), ("none", 200)):
        assert ask(service, "GET", "/v1/jobs", Sec_Fetch_Site=site).status == status


def test_a_named_origin_is_let_in(new_service):
    service = new_service("--page_origins", f"{GUI},http://localhost:3000").start()
    for origin in (GUI, "http://localhost:3000"):
        reply = ask(service, "POST", "/v1/jobs", json.dumps(sphere()), Origin=origin, Sec_Fetch_Site="cross-site",
                    Content_Type="application/json")
        assert reply.status == 201 and reply.headers["Access-Control-Allow-Origin"] == origin
        assert "Location" in reply.headers["Access-Control-Expose-Headers"] and reply.headers["Vary"] == "Origin"
        # it may read why something went wrong, too
        reply = ask(service, "GET", "/v1/jobs/nothing", Origin=origin)
        assert reply.status == 404 and reply.headers["Access-Control-Allow-Origin"] == origin
    expect_problem(ask(service, "GET", "/v1/jobs", Origin=f"{GUI}:8443"), 403, "origin_forbidden")
    expect_problem(ask(service, "GET", "/v1/jobs", Origin="http://gui.example"), 403, "origin_forbidden")
    # the same page may reach the service through its own host
    assert ask(service, "GET", "/v1/jobs", Host="gui.example").status == 200
    plain = service.get("/v1/jobs")
    assert plain.status == 200 and plain.headers["Vary"] == "Origin"
    assert plain.headers["Access-Control-Allow-Origin"] is None


def test_the_question_before_a_request(new_service):
    service = new_service("--page_origins", GUI).start()
    reply = ask(service, "OPTIONS", "/v1/jobs", Origin=GUI, Access_Control_Request_Method="POST",
                Access_Control_Request_Headers="content-type,idempotency-key")
    assert reply.status == 204 and reply.body == b""
    assert reply.headers["Access-Control-Allow-Origin"] == GUI and reply.headers["Vary"] == "Origin"
    assert {"GET", "POST", "PATCH", "DELETE"} <= set(reply.headers["Access-Control-Allow-Methods"].split(", "))
    assert {"Content-Type", "Idempotency-Key"} <= set(reply.headers["Access-Control-Allow-Headers"].split(", "))
    # without the question it is a method like another
    assert ask(service, "OPTIONS", "/v1/jobs", Origin=GUI).status == 405


@pytest.fixture
def with_tokens(new_service):
    service = new_service("--page_origins", GUI)
    service.options = [o for o in service.options if o not in ("--tcp_without_tokens", OPEN_TCP)]
    service.state.mkdir(mode=0o700)
    service.token = f"Bearer {new_token(service, 'alice')}"
    return service.start()


def test_where_tokens_are_needed_nothing_changes(with_tokens):
    """A page has none; and proxies ask by other names."""
    assert ask(with_tokens, "GET", "/v1/jobs", Host="hexad.example", Authorization=with_tokens.token).status == 200
    reply = ask(with_tokens, "GET", "/v1/jobs", Origin="http://evil.example", Authorization=with_tokens.token)
    assert reply.status == 200 and reply.headers["Access-Control-Allow-Origin"] is None
    assert ask(with_tokens, "GET", "/healthz", Host="evil.example").status == 200
    expect_problem(ask(with_tokens, "GET", "/v1/jobs", Origin=GUI), 401, "unauthorized")
    # a named origin's page that was given one may use it
    asked = ask(with_tokens, "OPTIONS", "/v1/jobs", Origin=GUI, Access_Control_Request_Method="GET",
                Access_Control_Request_Headers="authorization")
    assert asked.status == 204 and "Authorization" in asked.headers["Access-Control-Allow-Headers"]


def test_on_a_port_open_to_all_a_token_is_enough(new_service):
    service = new_service()
    service.state.mkdir(mode=0o700)
    token = f"Bearer {new_token(service, 'alice')}"
    service.start()
    assert ask(service, "GET", "/v1/jobs", Host="hexad.example", Authorization=token).status == 200
    refused = ask(service, "GET", "/healthz", Host="evil.example", Authorization="Bearer hexad_" + "0" * 64)
    expect_problem(refused, 421, "misdirected_request")


def test_an_origin_that_is_none(service):
    for origin in ("gui.example", "null", "*", f"{GUI}/"):
        assert "page_origins" in settings_fault(service, "--page_origins", origin)
