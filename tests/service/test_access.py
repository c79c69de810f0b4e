# SPDX-License-Identifier: Apache-2.0
"""Who may do what: Unix peers, tokens, scopes; and how many connections a client may have."""
import fcntl
import hashlib
import json
import os
import pathlib
import re
import shutil
import pwd
import socket
import subprocess
import sys
import tempfile

import pytest

from accounts import new_token, with_token
from commands import run_hexad
from service import OPEN_TCP, PATIENCE_S, Stream, expect_problem, long_sphere, sphere, wait_until

# asks a Unix socket as another user: USER GROUP SOCKET METHOD PATH; prints the status and the body
ASK_AS = """
import os, socket, sys
user, group, path, method, target = sys.argv[1:]
os.setgroups([int(group)] if group else [])
os.setgid(60000)
os.setuid(int(user))
s = socket.socket(socket.AF_UNIX)
s.connect(path)
s.sendall(f"{method} {target} HTTP/1.1\\r\\nHost: x\\r\\nConnection: close\\r\\n\\r\\n".encode())
got = b""
while piece := s.recv(65536):
    got += piece
print(got.split()[1].decode())
"""


@pytest.mark.extended
def test_a_change_of_tokens_does_not_wait_for_ever_for_another_one(build, tmp_path):
    held = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(held, fcntl.LOCK_EX)
    try:
        done = subprocess.run([build / "hexadctl", "token", "add", "ann", "--file", tmp_path / "tokens"],
                              capture_output=True, text=True, timeout=PATIENCE_S)
    finally:
        os.close(held)
    assert done.returncode == 1 and "another command changes the token files" in done.stderr


def test_a_token_for_a_user_that_the_machine_does_not_have_is_added_with_a_warning(build, tmp_path):
    def add(user):
        done = subprocess.run([build / "hexadctl", "token", "add", user, "--file", tmp_path / "tokens"],
                              capture_output=True, text=True, timeout=PATIENCE_S)
        assert done.returncode == 0 and done.stdout.startswith("hexad_"), done.stderr
        return done.stderr

    warning = add("no-such-user")
    assert "warning: this machine has no user no-such-user." in warning
    revoked, _, file = warning.partition("hexadctl token revoke ")[2].partition('"')[0].partition(" --file ")
    assert file == str(tmp_path / "tokens")
    assert (tmp_path / "tokens").read_text().splitlines()[1].split()[:2] == [revoked, "no-such-user"]
    assert "warning" not in add(pwd.getpwuid(os.geteuid()).pw_name)


def test_no_token_no_answer(closed_service):
    for path in ("/v1/jobs", "/v1/jobs/01aaaaaaaaaaaaaaaaaaaaaaaa", "/nothing", "/v1/jobs/x/results"):
        reply = closed_service.get(path)
        expect_problem(reply, 401, "unauthorized")
        assert reply.headers["WWW-Authenticate"].startswith("Bearer")
    reply = with_token(closed_service, "hexad_" + "0" * 64, "GET", "/v1/jobs")
    expect_problem(reply, 401, "unauthorized")
    assert "invalid_token" in reply.headers["WWW-Authenticate"]
    two = [("Authorization", f"Bearer {closed_service.token}")] * 2
    connection = closed_service.connection()
    connection.putrequest("GET", "/v1/jobs")
    for name, value in two:
        connection.putheader(name, value)
    connection.endheaders()
    assert connection.getresponse().status == 401
    connection.close()
    # how the service is, is no secret
    for path in ("/healthz", "/version"):
        assert closed_service.get(path).status == 200
    assert with_token(closed_service, closed_service.token, "GET", "/v1/jobs").status == 200


def test_hexadctl_says_that_a_token_is_missing_or_unknown(closed_service, build):
    for token, told in (("", "HEXAD_TOKEN is not set"), ("nonsense", "the token in HEXAD_TOKEN")):
        done = subprocess.run([build / "hexadctl", "list"], env={**closed_service.environment(), "HEXAD_TOKEN": token},
                              capture_output=True, text=True, timeout=PATIENCE_S)
        assert done.returncode == 2 and told in done.stderr and "hexadctl token add" in done.stderr


def test_a_line_end_behind_a_token_does_not_belong_to_it(closed_service, build):
    for token in (closed_service.token + "\n", f" {closed_service.token}\r\n"):
        environment = {**closed_service.environment(), "HEXAD_TOKEN": token}
        done = subprocess.run([build / "hexadctl", "list"], env=environment, capture_output=True, text=True, timeout=PATIENCE_S)
        assert done.returncode == 0, done.stderr
        done = subprocess.run([sys.executable, "-c", "import hexad; list(hexad.Client().jobs())"], capture_output=True, text=True,
                              env={**environment, "PYTHONPATH": str(pathlib.Path(__file__).parents[2] / "clients/python")}, timeout=PATIENCE_S)
        assert done.returncode == 0, done.stderr


def test_a_refused_user_is_sent_to_the_administrator(closed_service):
    """With the command for the administrator: only one can create a token."""
    service = closed_service
    unknown = with_token(service, "nonsense", "GET", "/v1/jobs").json["detail"]
    assert "ask the administrator to run `hexadctl token add USER`" in unknown, unknown
    carol = new_token(service, "carol", "--scopes", "read")
    refused = with_token(service, carol, "POST", "/v1/jobs", sphere()).json["detail"]
    assert "ask the administrator to run `hexadctl token add carol --scopes read,submit`" in refused, refused


def test_scopes(closed_service):
    service = closed_service
    reader = new_token(service, "carol", "--scopes", "read")
    sender = new_token(service, "dave", "--scopes", "submit")
    expect_problem(with_token(service, reader, "POST", "/v1/jobs", sphere()), 403, "forbidden")
    assert with_token(service, reader, "GET", "/v1/jobs").status == 200
    checked = with_token(service, reader, "POST", "/v1/jobs:validate", sphere())
    assert checked.status == 200 and checked.json["estimate"] is None and "submit" in checked.json["estimate_missing"]
    expect_problem(with_token(service, sender, "GET", "/v1/jobs"), 403, "forbidden")
    reply = with_token(service, sender, "POST", "/v1/jobs", long_sphere())
    assert reply.status == 201
    path = f"/v1/jobs/{reply.json['id']}/cancel"
    expect_problem(with_token(service, sender, "POST", path), 403, "forbidden")
    assert with_token(service, service.token, "POST", path).status in (200, 202)


STACK = {"path": "x", "slices": "1-3", "isovalue": 1}
SPHERE = {"analytic": {"shape": "sphere", "radius": 1}}
FRAMES = {"queue": {"frames": "1-2"}}


@pytest.mark.sanitized
@pytest.mark.parametrize("parts, pointer", [
    ({"attributes": ["temperature"], **FRAMES}, "/attributes/0"),
    ({"surface": {"exr": STACK}, **FRAMES}, "/surface/exr/path"),
    ({"surface": {"volume": STACK}, **FRAMES}, "/surface/volume/path"),
    ({"surface": {"labels": {"path": "x", "slices": "1-3"}}, **FRAMES}, "/surface/labels/path"),
    ({"surface": {"union": [SPHERE, {"exr": STACK}]}, **FRAMES}, "/surface/union/1/exr/path"),
    ({"region": {"inside": {"exr": STACK}}, **FRAMES}, "/region/inside/exr/path"),
    ({"surface": {"mesh": {}}, "output": {"preview": {"camera": {"position": [1, 1, 1]}}}}, "/surface/mesh/path")])
def test_a_fault_in_one_group_of_a_spec_is_refused_whatever_depends_on_the_group(closed_service, parts, pointer):
    service = closed_service
    reader = new_token(service, "carol", "--scopes", "read")
    refused = with_token(service, reader, "POST", "/v1/jobs:validate", sphere(**parts))
    expect_problem(refused, 422, "spec_invalid")
    assert pointer in [fault["pointer"] for fault in refused.json["errors"]]
    assert service.get("/healthz").status == 200


MARKED_WORKER = """#!/bin/sh
cat >/dev/null
base=${4%/*/*/*}
job=${4##*/}
echo '{"phase":"MARKER","fraction":0.5}' >&3
while ! [ -e "$base/open.${job%%.*}" ]; do sleep 0.01; done
echo '{"code":"input_damaged","message":"MARKER.vdb: damaged"}' >&2
exit 3
"""


@pytest.mark.sanitized
def test_readers_see_of_the_jobs_of_others_what_the_list_says(closed_service, tmp_path):
    service = closed_service
    worker = tmp_path / "worker"
    worker.write_text(MARKED_WORKER)
    worker.chmod(0o700)
    service.end()
    service.start("--worker", worker)
    alice, bob = new_token(service, "alice"), new_token(service, "bob", "--scopes", "read")
    spec = sphere(name="shown", queue={"labels": ["seen"], "priority": 3, "retention_s": 4711},
                  limits={"memory_mb": 100, "max_attempts": 7}, solver={"threads": 1}, outcome={"require": {"hex_fraction": 0.12345}})
    headers = {"traceparent": "00-" + "4" * 32 + "-" + "5" * 16 + "-01"}
    job = with_token(service, alice, "POST", "/v1/jobs", spec, **headers).json["id"]
    paths = ["/v1/jobs", f"/v1/jobs/{job}", "/v1/workers", "/v1/events?after=0&all=1&limit=500", "/metrics"]

    def texts(token):
        return [with_token(service, token, "GET", path).body.decode() for path in paths]

    wait_until(lambda: "MARKER" in texts(alice)[1], "progress")
    running = texts(bob)
    hosts = [with_token(service, token, "GET", "/v1/workers").json["workers"][0]["host"] for token in (alice, bob)]
    assert hosts == [socket.gethostname(), None]
    service.open_gate(job)
    wait_until(lambda: "MARKER.vdb" in texts(alice)[1], "the end")
    for text in running + texts(bob):
        assert not [word for word in ("MARKER", "4711", "4" * 32, "0.12345", "exit status") if word in text], text
    own, seen = (with_token(service, token, "GET", f"/v1/jobs/{job}").json for token in (alice, bob))
    shown = ("id", "owner", "name", "labels", "links", "state", "paused", "outcome", "revision", "priority", "created", "started",
             "finished", "array", "tasks", "attempt", "threads", "memory_mb")
    assert {k: seen[k] for k in shown} == {k: own[k] for k in shown} and seen["labels"] == ["seen"]
    assert seen.keys() == own.keys()
    hidden = {k: v for k, v in seen.items() if k not in shown}
    assert hidden.pop("error") == {"code": "input_damaged", "message": "The input cannot be read"}
    assert all(v in (None, [], 0) for v in hidden.values()), hidden
    assert own["attempts"] and own["retention_s"] == 4711 and own["error"]["message"].startswith("MARKER")
    for path in ("tasks", "attempts", "log", "events", "results", "thumbnail.png"):
        expect_problem(with_token(service, bob, "GET", f"/v1/jobs/{job}/{path}"), 403, "forbidden")


def test_what_an_owner_is_shown_others_are_not(closed_service):
    service = closed_service
    owner, other = new_token(service, "carol"), new_token(service, "dave")
    path = with_token(service, owner, "POST", "/v1/jobs", sphere()).json["links"]["self"]
    wait_until(lambda: with_token(service, owner, "GET", path).json["state"] == "succeeded", "the job")
    for _ in range(2):  # whose turn comes after whose makes no difference
        for token, sees in ((owner, True), (other, False), (service.token, True)):
            shown = with_token(service, token, "GET", path)
            assert (shown.json["spec"] is not None) == sees
            known = service.request("GET", path, headers={"Authorization": f"Bearer {token}",
                                                          "If-None-Match": shown.headers["ETag"]})
            assert known.status == 304


@pytest.mark.sanitized
def test_a_revoked_token_is_worth_nothing(closed_service):
    service = closed_service
    token = new_token(service, "erin")
    control = [service.build / "hexadctl", "token"]
    file = ["--file", service.state / "tokens"]
    listed = json.loads(subprocess.run([*control, "list", "--json", *file], capture_output=True, check=True).stdout)
    assert [t["user"] for t in listed] == ["root", "erin"]
    assert listed[1]["scopes"] == "read,submit,cancel"
    assert token not in (service.state / "tokens").read_text()
    assert with_token(service, token, "GET", "/v1/jobs").status == 200
    assert subprocess.run([*control, "revoke", listed[1]["id"], *file]).returncode == 0
    expect_problem(with_token(service, token, "GET", "/v1/jobs"), 401, "unauthorized")
    assert subprocess.run([*control, "revoke", listed[1]["id"], *file]).returncode == 4
    # the client shows one that it is given
    environment = {**service.environment(), "HEXAD_TOKEN": service.token}
    assert subprocess.run([service.build / "hexadctl", "list"], env=environment, capture_output=True).returncode == 0
    last = subprocess.run([*control, "revoke", listed[0]["id"], *file], capture_output=True, text=True)
    assert last.returncode == 0 and "contains no tokens now" in last.stderr
    environment["HEXAD_TOKEN"] = token
    done = subprocess.run([service.build / "hexadctl", "list"], env=environment, capture_output=True, text=True)
    assert done.returncode == 2 and "token" in done.stderr


def test_a_token_file_that_cannot_be_read_is_in_readyz_and_in_the_log(closed_service):
    service = closed_service
    tokens = service.state / "tokens"

    def state():
        done = subprocess.run([service.build / "hexadctl", "list"], env={**service.environment(), "HEXAD_TOKEN": service.token}, capture_output=True)
        reply = service.get("/readyz")
        return reply.status, reply.json["checks"]["tokens"], done.returncode

    assert state() == (200, "ok", 0)
    tokens.chmod(0o644)
    assert state() == (200, "unreadable", 2)
    assert re.search(rf"error no token is valid: {tokens}: other users can access the file: .*Run: chmod", service.log.read_text())
    tokens.chmod(0o600)
    assert state() == (200, "ok", 0)


@pytest.mark.parametrize("address, users, strict", [("127.0.0.1:0", "every user of this machine", 1), ("0.0.0.0:0", "other machines", 1),
                                                    ("unix:", None, 0), ("127.0.0.1:port", None, 2), ("unix:beside", None, 2)])
def test_a_check_of_settings_finds_ports_that_are_refused(build, tmp_path, address, users, strict):
    """As a start: with a token, the port is allowed."""
    where = ("--listen", address, "--state_dir", tmp_path)
    for words, status in ((), 2 if strict == 2 else 0), (("--strict",), strict):
        tried = run_hexad(build, *where, "--check-settings", *words)
        assert tried.returncode == status, tried
        if users:
            assert tried.stdout.startswith(f"hexad would not start: listen {address}: {users}") and f"{tmp_path}/tokens has no tokens" in tried.stdout
    assert run_hexad(build, *where, "--check-settings", "--tcp_without_tokens", "yes").returncode == 2
    if users:
        subprocess.run([build / "hexadctl", "token", "add", "alice", "--file", tmp_path / "tokens"], check=True, stdout=subprocess.DEVNULL)
        assert run_hexad(build, *where, "--check-settings", "--strict").returncode == 0


def test_ports_that_are_refused(build, tmp_path):
    state = tmp_path / "state"
    tried = run_hexad(build, "--listen", "127.0.0.1:0", "--state_dir", state)
    assert tried.returncode == 2 and "every user of this machine" in tried.stderr
    assert f"the token file {state}/tokens has no tokens" in tried.stderr and f"--file {state}/tokens" in tried.stderr
    tried = run_hexad(build, "--listen", "127.0.0.1:0", "--tcp_without_tokens", "yes", "--state_dir", state)
    assert tried.returncode == 2 and OPEN_TCP in tried.stderr
    tried = run_hexad(build, "--listen", "0.0.0.0:0", "--tcp_without_tokens", OPEN_TCP, "--state_dir", state)
    assert tried.returncode == 2 and "other machines" in tried.stderr and f"--file {state}/tokens" in tried.stderr
    (state / "tokens").write_text("nonsense")
    os.chmod(state / "tokens", 0o600)
    tried = run_hexad(build, "--listen", "127.0.0.1:0", "--state_dir", state)
    assert tried.returncode == 2 and "tokens:1" in tried.stderr


def test_administrators_see_the_tokens_without_their_values(service):
    alice, admin = new_token(service, "alice", "--max-priority", "5"), new_token(service, "carol", "--scopes", "admin")
    assert with_token(service, alice, "GET", "/v1/tokens").status == 403
    answer = with_token(service, admin, "GET", "/v1/tokens")
    assert answer.status == 200 and not [t for t in (alice, admin) if t in answer.body.decode()]
    shown = {t["user"]: t for t in answer.json["tokens"] if t["user"] in ("alice", "carol")}
    assert shown["alice"]["scopes"] == ["read", "submit", "cancel"] and shown["alice"]["max_priority"] == 5
    assert shown["carol"]["scopes"] == ["read", "submit", "cancel", "admin"] and shown["carol"]["max_priority"] is None
    assert alice.removeprefix("hexad_")[:12] != shown["alice"]["id"] and len(shown["alice"]["id"]) == 12


def test_an_open_port_is_nobodys_who_administers(service):
    """Without tokens all are one user, who owns what all submit."""
    job = service.submit(sphere())
    assert service.job(job)["state"] in ("queued", "running", "succeeded")


def test_a_port_for_other_machines_with_tokens(new_service):
    service = new_service("--listen", "0.0.0.0:0")
    service.options = [o for o in service.options if o not in ("--tcp_without_tokens", OPEN_TCP)]
    service.state.mkdir(mode=0o700)
    token = new_token(service, "alice")
    service.start()
    expect_problem(service.get("/v1/jobs"), 401, "unauthorized")
    assert with_token(service, token, "GET", "/v1/jobs").status == 200


@pytest.fixture
def public_directory():
    """A directory that every user can reach: pytest's own are shut again whenever another pytest starts."""
    with tempfile.TemporaryDirectory() as path:
        os.chmod(path, 0o755)
        yield pathlib.Path(path)


@pytest.mark.sanitized
def test_unix_peers(new_service, public_directory):
    if os.geteuid() != 0:
        pytest.skip("only root can be other users")
    where = public_directory / "s"
    service = new_service("--listen", f"unix:{where}", "--unix_users", "60001", "--unix_groups", "60100",
                          "--unix_admins", "60002").start()

    def ask(user, group="", method="GET", path="/v1/jobs"):
        done = subprocess.run([sys.executable, "-c", ASK_AS, str(user), str(group), where, method, path],
                              capture_output=True, text=True, timeout=PATIENCE_S)
        assert done.returncode == 0, done.stderr
        return int(done.stdout)

    assert ask(60001) == 200
    assert ask(60002) == 200
    assert ask(60003) == 401
    assert ask(60003, 60100) == 200
    assert ask(60003, path="/healthz") == 200
    assert service.get("/v1/jobs").status == 200


def test_a_refused_user_of_the_socket_is_named_with_the_command_that_permits_it(build, new_service, public_directory):
    if os.geteuid() != 0:
        pytest.skip("only root can be other users")
    settings = public_directory / "hexad.conf"
    settings.write_text("unix_users = 60001\n")
    shutil.copy(build / "hexadctl", public_directory / "hexadctl")
    new_service("--listen", f"unix:{public_directory}/s", "--config", settings).start()
    nobody = pwd.getpwnam("nobody").pw_uid
    for uid, name in ((nobody, "nobody"), (60003, "60003")):
        done = subprocess.run([public_directory / "hexadctl", "--server", f"unix:{public_directory}/s", "list"], capture_output=True, text=True,
                              user=uid, group=60000, extra_groups=[], cwd="/", timeout=PATIENCE_S)
        assert done.returncode == 2 and done.stderr == (
            f'hexadctl: the user "{name}" may not use this service: run `hexad --config {settings} --allow {name}` as root, '
            "or set HEXAD_TOKEN to a token\n")


def test_deleted_users_and_groups_do_not_keep_the_service_from_starting(new_service, tmp_path):
    """They are left out with a warning, at the start and at a reload; the others keep their access."""
    service = new_service("--unix_users", f"left-the-company,{os.geteuid()}", "--unix_groups", "disbanded").start()
    assert service.get("/v1/jobs").status == 200
    for line in ("setting unix_users: the user left-the-company does not exist", "setting unix_groups: the group disbanded does not exist"):
        assert line in service.log.read_text()


@pytest.mark.sanitized
def test_a_unix_socket_and_ports_are_served_together(new_service):
    """Users of the socket are known; callers of the ports are not, and a port of other machines demands tokens of all."""
    service = new_service("--listen", "unix:,127.0.0.1:0, 127.0.0.1:0")
    service.start()
    addresses = service.address.splitlines()
    assert addresses[0] == f"unix:{service.state}/hexad.sock" and len(set(addresses)) == 3
    for address, user in zip(addresses, (pwd.getpwuid(os.getuid()).pw_name, "anyone", "anyone")):
        service.address = address
        for _ in range(3):
            assert service.get("/v1/session").json["user"] == user
    command = [service.build / "hexadctl", "--server", addresses[0], "list"]
    assert subprocess.run(command, timeout=PATIENCE_S).returncode == 0
    assert service.end() == 0
    assert not (service.state / "hexad.sock").exists()
    done = subprocess.run([service.build / "hexad", "--state_dir", service.state, "--listen", "127.0.0.1:0,0.0.0.0:0",
                           "--tcp_without_tokens", OPEN_TCP], capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 2 and "listen 0.0.0.0:0: other machines can reach this address" in done.stderr


def test_a_socket_of_ones_own(new_service, tmp_path):
    """By default: in the state directory, and no other user's."""
    service = new_service()
    at = service.options.index("--listen")
    del service.options[at:at + 2]
    service.start()
    assert service.address == f"unix:{service.state}/hexad.sock"
    assert (service.state / "hexad.sock").stat().st_mode & 0o077 == 0
    job = service.submit(sphere())
    service.wait_state(job, "succeeded")


def open_connections(service, count):
    host, _, port = service.address.rpartition(":")
    return [socket.create_connection((host, int(port)), timeout=PATIENCE_S) for _ in range(count)]


def follow(connections):
    """They are in use: each follows the events."""
    for one in connections:
        host, port = one.getpeername()
        one.sendall(f"GET /v1/events HTTP/1.1\r\nHost: {host}:{port}\r\nAccept: text/event-stream\r\n\r\n".encode())
        assert one.recv(4096).startswith(b"HTTP/1.1 200 ")


@pytest.mark.sanitized
def test_connections_of_one_client(new_service):
    service = new_service("--client_connection_limit", 4).start()
    held = open_connections(service, 4)
    follow(held)
    reply = service.get("/healthz")
    expect_problem(reply, 429, "too_many_requests")
    assert int(reply.headers["Retry-After"]) >= 1
    for one in held:
        one.close()


def test_all_connections(new_service):
    service = new_service("--connection_limit", 4, "--admin_connections", 0).start()
    held = open_connections(service, 4)
    follow(held)
    reply = service.get("/healthz")
    expect_problem(reply, 503, "unavailable")
    assert int(reply.headers["Retry-After"]) >= 1
    for one in held:
        one.close()


@pytest.mark.sanitized
def test_a_slow_client_takes_no_place_from_others(new_service, public_directory):
    """All that one user may hold is held, by requests that never end; another is served as before."""
    if os.geteuid() != 0:
        pytest.skip("only root can be other users")
    where = public_directory / "s"
    service = new_service("--listen", f"unix:{where}", "--user_connection_limit", 8, "--connection_limit", 32,
                          "--unix_users", "60001").start()
    slow = []
    for _ in range(60):
        s = socket.socket(socket.AF_UNIX)
        s.settimeout(PATIENCE_S)
        s.connect(str(where))
        slow.append(s)
        try:
            s.sendall(b"GET /healthz HTTP/1.1\r\nX: ")
        except OSError:
            pass  # beyond the share it was closed at once
    done = subprocess.run([sys.executable, "-c", ASK_AS, "60001", "", where, "GET", "/v1/jobs"], capture_output=True,
                          text=True, timeout=PATIENCE_S)
    assert done.stdout.strip() == "200", done.stderr
    for s in slow:
        s.close()


def test_a_revoked_token_ends_its_streams(closed_service):
    """Nothing that happens later is told."""
    service = closed_service
    token, other = new_token(service, "alice"), new_token(service, "alice")
    stream = Stream(service, "/v1/events", token=token)
    events = iter(stream)
    assert next(events)[1] == "position"
    kept = [line for line in (service.state / "tokens").read_text().splitlines(True) if hashlib.sha256(token.encode()).hexdigest() not in line]
    (service.state / "tokens").write_text("".join(kept))
    assert with_token(service, other, "POST", "/v1/jobs", sphere()).status == 201
    assert list(events) == []
    assert with_token(service, token, "GET", "/v1/events").status == 401


@pytest.mark.sanitized
def test_the_files_of_the_input_roots_are_listed(new_service, tmp_path):
    """For those who may submit, and no other; page by page; nothing outside of the roots is told."""
    root, outside = tmp_path / "root", tmp_path / "outside"
    (root / "b").mkdir(parents=True)
    outside.mkdir()
    (outside / "secret").write_text("x")
    for name in ("c.ply", "a.vdb", ".hidden"):
        (root / name).write_text("1234")
    (root / "away").symlink_to(outside / "secret")
    (root / "latest").symlink_to("b")
    service = new_service("--input_roots", root).start()
    roots = service.get("/v1/files").json
    assert [f["name"] for f in roots["files"]] == [str(root)] and roots["files"][0]["directory"]
    page = service.get(f"/v1/files?path={root}").json
    assert [(f["name"], f["directory"], f["bytes"]) for f in page["files"]] == [
        ("a.vdb", False, 4), ("b", True, None), ("c.ply", False, 4), ("latest", True, None)]
    assert page["parent"] == "" and page["next"] is None
    assert service.get(f"/v1/files?path={root}/b").json["parent"] == str(root)
    names, after = [], ""
    while after is not None:
        page = service.get(f"/v1/files?path={root}&limit=1{after and '&cursor=' + after}").json
        names += [f["name"] for f in page["files"]]
        after = page["next"]
    assert names == ["a.vdb", "b", "c.ply", "latest"]
    for path in (outside, f"{root}/..", f"{root}/away", "/", f"{root}/b/../../outside", f"{root}side"):
        assert service.get(f"/v1/files?path={path}").status == 403, path
    expect_problem(service.get(f"/v1/files?path={root}/nothing"), 422, "input_missing")
    expect_problem(service.get(f"/v1/files?path={root}/c.ply"), 422, "input_missing")
    token = new_token(service, "eve", "--scopes", "read")
    expect_problem(with_token(service, token, "GET", "/v1/files"), 403, "forbidden")
