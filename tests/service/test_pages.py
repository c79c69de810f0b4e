# SPDX-License-Identifier: Apache-2.0
"""What web pages that are open in a browser can do over TCP: nothing, unless they are named, or are hexad's own.

Its own page signs in with a token and has a session from then on.
"""
import json
import re
import shutil
import signal
import subprocess

import pytest

from accounts import new_token
from commands import settings_fault
from service import exchange, expect_problem, long_sphere, sphere, wait_until
from sessions import GUI, ask, cookie_of, sign_in


def port_of(service):
    return service.address.rpartition(":")[2]


@pytest.fixture
def service(clean_service):
    """One daemon for the tests of this file, without jobs of other tests."""
    return clean_service


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


@pytest.mark.sanitized
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


def test_whoever_shows_a_token_asks_by_any_name(with_tokens):
    """A page of others has none; and proxies ask by other names."""
    assert ask(with_tokens, "GET", "/v1/jobs", Host="hexad.example", Authorization=with_tokens.token).status == 200
    reply = ask(with_tokens, "GET", "/v1/jobs", Origin="http://evil.example", Authorization=with_tokens.token)
    assert reply.status == 200 and reply.headers["Access-Control-Allow-Origin"] is None
    expect_problem(ask(with_tokens, "GET", "/healthz", Host="evil.example"), 421, "misdirected_request")
    # of a program it says what is wrong: its token
    wrong = ask(with_tokens, "GET", "/v1/jobs", Host="hexad.example", Authorization="Bearer hexad_" + "0" * 64)
    expect_problem(wrong, 401, "unauthorized")
    expect_problem(ask(with_tokens, "GET", "/v1/jobs", Origin=GUI), 401, "unauthorized")
    # a named origin's page that was given one may use it
    asked = ask(with_tokens, "OPTIONS", "/v1/jobs", Origin=GUI, Host="hexad.example", Access_Control_Request_Method="GET",
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


# ---- hexad's own page, and sessions

@pytest.mark.sanitized
def test_the_page_is_open_and_holds_nothing(with_tokens):
    if not (with_tokens.build / "page/uplot.js").exists():
        pytest.skip("the page was not built: run npm ci in page, and make")
    page = with_tokens.get("/")
    assert page.status == 200 and page.headers["Content-Type"] == "text/html; charset=utf-8"
    policy = page.headers["Content-Security-Policy"]
    assert "default-src 'self'" in policy and "frame-ancestors 'none'" in policy and "unsafe" not in policy
    for link in re.findall(r'(?:src|href)="(page/[^"]*)"', page.body.decode()):
        part = with_tokens.get(f"/{link}")
        assert part.status == 200 and part.headers["X-Content-Type-Options"] == "nosniff"
        again = ask(with_tokens, "GET", f"/{link}", If_None_Match=part.headers["ETag"])
        assert again.status == 304 and not again.body
    for path in ("/page/nothing.js", "/page/..%2findex.html", "/page/made-up.js"):
        assert with_tokens.get(path).status in (401, 404)
    # a link on another page leads here; a picture or a frame of it does not
    assert ask(with_tokens, "GET", "/", Sec_Fetch_Site="cross-site", Sec_Fetch_Dest="document").status == 200
    expect_problem(ask(with_tokens, "GET", "/", Sec_Fetch_Site="cross-site", Sec_Fetch_Dest="iframe"), 403,
                   "origin_forbidden")
    expect_problem(ask(with_tokens, "GET", "/v1/jobs", Sec_Fetch_Site="cross-site", Sec_Fetch_Dest="document"), 403,
                   "origin_forbidden")
    expect_problem(ask(with_tokens, "GET", "/", Host="evil.example"), 421, "misdirected_request")


@pytest.mark.sanitized
def test_a_session_has_the_rights_of_its_token(with_tokens):
    own = f"http://{with_tokens.address}"
    reply = sign_in(with_tokens, new_token(with_tokens, "bob", "--scopes", "read"), Origin=own)
    assert reply.status == 200 and reply.json["user"] == "bob" and reply.json["scopes"] == ["read"]
    attributes = reply.headers["Set-Cookie"].split("; ")[1:]
    assert attributes == ["Max-Age=43200", "HttpOnly", "SameSite=Strict"]
    cookie = cookie_of(reply)
    assert ask(with_tokens, "GET", "/v1/session", Cookie=cookie).json == reply.json
    assert ask(with_tokens, "GET", "/v1/jobs", Cookie=f"other=1; {cookie}").status == 200
    refused = ask(with_tokens, "POST", "/v1/jobs", json.dumps(sphere()), Cookie=cookie, Content_Type="application/json")
    expect_problem(refused, 403, "forbidden")
    # a session is no token: it makes no page of others welcome
    for headers, status in (({"Host": "evil.example"}, 421), ({"Origin": "http://evil.example"}, 403),
                            ({"Sec_Fetch_Site": "cross-site"}, 403)):
        assert ask(with_tokens, "GET", "/v1/jobs", Cookie=cookie, **headers).status == status
    over = ask(with_tokens, "DELETE", "/v1/session", Cookie=cookie)
    assert over.status == 204 and "Max-Age=0" in over.headers["Set-Cookie"]
    assert "; Secure" in sign_in(with_tokens, with_tokens.token, Origin=GUI).headers["Set-Cookie"]


def test_a_session_outlives_the_service_but_not_its_token(with_tokens):
    secret = new_token(with_tokens, "bob")
    cookie = cookie_of(sign_in(with_tokens, secret))
    with_tokens.end(signal.SIGKILL)
    with_tokens.start()
    assert ask(with_tokens, "GET", "/v1/session", Cookie=cookie).json["user"] == "bob"
    identity = cookie.partition("=")[2].partition(".")[0]
    subprocess.run([with_tokens.build / "hexadctl", "token", "revoke", identity, "--file",
                    with_tokens.state / "tokens"], check=True)
    assert ask(with_tokens, "GET", "/v1/session", Cookie=cookie).json == {"user": None, "scopes": [], "ends": None}
    expect_problem(ask(with_tokens, "GET", "/v1/jobs", Cookie=cookie), 401, "unauthorized")
    expect_problem(sign_in(with_tokens, secret), 401, "unauthorized")
    expect_problem(sign_in(with_tokens, "x" * 5000), 401, "unauthorized")
    for body, code in (("{", "json_invalid"), ("", "json_invalid"), ("[]", "request_invalid"), ('{"token":1}', "request_invalid")):
        reply = ask(with_tokens, "POST", "/v1/session", body, Content_Type="application/json")
        expect_problem(reply, 400, code)


@pytest.mark.sanitized
def test_a_session_that_was_changed_is_none(with_tokens):
    name, _, value = cookie_of(sign_in(with_tokens, with_tokens.token)).partition("=")
    identity, ends, mac = value.split(".")
    for forged in (f"{identity}.{int(ends) + 1}.{mac}", f"{identity}.{ends}.{'0' * 64}", f"{identity}.{ends}.",
                   f"{identity}.{ends}", identity, "", "." * 60, f"{identity}.{'9' * 40}.{mac}", f"{value}0",
                   f"{identity}. {ends}.{mac}", value.upper()):
        assert ask(with_tokens, "GET", "/v1/jobs", Cookie=f"{name}={forged}").status == 401, forged
    assert ask(with_tokens, "GET", "/v1/jobs", Cookie=f"{name}={value}").status == 200
    assert oct((with_tokens.state / "session.key").stat().st_mode & 0o777) == "0o600"


def test_a_session_ends(with_tokens):
    with_tokens.end()
    with_tokens.start("--session_s", "1")
    reply = sign_in(with_tokens, with_tokens.token)
    assert "Max-Age=1;" in reply.headers["Set-Cookie"]
    wait_until(lambda: ask(with_tokens, "GET", "/v1/jobs", Cookie=cookie_of(reply)).status == 401, "the end")


def installed_at(build):
    """The directories of programs and of the page, without the slash at the beginning."""
    prefix = re.search(r"^prefix = (.*)$", (build / "Makefile").read_text(), re.MULTILINE).group(1)
    return prefix.strip("/") + "/bin", prefix.strip("/") + "/share/hexad/page"


@pytest.fixture
def staged(new_service, build, source, tmp_path):
    """A service whose program lies below another root, as `make install DESTDIR=` leaves it."""
    programs, page = installed_at(build)
    (tmp_path / "root" / programs).mkdir(parents=True)
    shutil.copy(build / "hexad", tmp_path / "root" / programs)
    shutil.copytree(source / "page", tmp_path / "root" / page, ignore=shutil.ignore_patterns("node_modules"))
    service = new_service("--worker", build / "hexad-worker")
    service.build = tmp_path / "root" / programs
    service.page = tmp_path / "root" / page
    return service


def test_the_page_of_a_staged_tree_is_found(staged):
    staged.start()
    assert staged.get("/").status == 200


def test_a_page_that_is_missing_is_looked_for_at_both_places(staged):
    shutil.rmtree(staged.page)
    staged.start()
    told = staged.log.read_text()
    assert f"the web page is not served: neither {staged.build}/page nor {staged.page}" in told, told
    assert "install" in told.partition("the web page is not served")[2].partition("\n")[0]


def test_a_service_without_its_page(with_tokens):
    cookie = cookie_of(sign_in(with_tokens, with_tokens.token))
    with_tokens.end()
    with_tokens.start("--page", "0")
    expect_problem(with_tokens.get("/"), 404, "not_found")
    expect_problem(sign_in(with_tokens, with_tokens.token), 404, "not_found")
    assert ask(with_tokens, "GET", "/v1/jobs", Cookie=cookie).status == 401
