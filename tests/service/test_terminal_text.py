# SPDX-License-Identifier: Apache-2.0
"""What terminals and logs show of texts from others: tests/terminal_text.tsv, which tests/unit/test_terminal_text.c reads, too."""
import json
import pathlib
import re
import subprocess
import urllib.parse

import pytest

from accounts import new_token, with_token
from service import OPEN_TCP, PATIENCE_S, sphere

LIST = pathlib.Path(__file__).parent.parent / "terminal_text.tsv"
# what no terminal and no log gets: controls, direction controls, and bytes that are not UTF-8, as surrogateescape reads them
FORBIDDEN = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
                       "\ud800-\udfff\U000e0000-\U000e0fff]")
OVERRIDE = "a\u202eb\x9b31m\u200b\U000e0041"
SHOWN = r"a\u{202e}b\u{9b}31m\u{200b}\u{e0041}"


def rows():
    """Pairs of a text, as JSON can contain it, and what is shown."""
    found = []
    for line in LIST.read_text().splitlines():
        if line.startswith("#"):
            continue
        digits, shown, _ = line.split("\t")
        try:
            text = bytes.fromhex(digits).decode()
        except UnicodeDecodeError:
            continue
        if text.strip() and "\0" not in text:
            found.append((text, shown))
    assert len(found) > 40
    return found


def shown_text(data):
    text = data.decode(errors="surrogateescape")
    assert not FORBIDDEN.search(text), FORBIDDEN.findall(text)
    return text


class Users:
    """A daemon with tokens of two users and of an administrator. eve submits jobs."""

    def __init__(self, service, where):
        self.service, self.where = service, where
        service.options = [o for o in service.options if o not in ("--tcp_without_tokens", OPEN_TCP)]
        service.state.mkdir(mode=0o700)
        self.tokens = {user: new_token(service, user) for user in ("ann", "eve")}
        self.tokens["root"] = new_token(service, "root", "--scopes", "read,submit,cancel,admin")
        service.start()

    def submit(self, **parts):
        reply = with_token(self.service, self.tokens["eve"], "POST", "/v1/jobs", sphere(**parts))
        assert reply.status == 201, reply.body
        return reply.json["id"]

    def client(self, *words, code=0, user="ann"):
        """The bytes that hexadctl prints."""
        done = subprocess.run([self.service.build / "hexadctl", *words], capture_output=True, timeout=PATIENCE_S, cwd=self.where,
                              env={**self.service.environment(), "HEXAD_TOKEN": self.tokens[user]})
        assert code in (None, done.returncode), done.stdout + done.stderr
        return done.stdout + done.stderr


@pytest.fixture
def users(new_service, tmp_path):
    return Users(new_service("--input_roots", tmp_path), tmp_path)


@pytest.mark.sanitized
def test_names_of_other_users_are_escaped_in_lists(users):
    assert with_token(users.service, users.tokens["root"], "POST", "/v1/admin/hold").status == 200
    jobs = {users.submit(name=text): (text, shown) for text, shown in rows()}
    lines = {line.split()[0]: line for line in shown_text(users.client("list", "--limit", "500")).splitlines() if line}
    for job, (_, shown) in jobs.items():
        assert lines[job].endswith(f"  {shown}"), lines[job]
    for job, (_, shown) in list(jobs.items())[:5]:
        assert f"  name      {shown}\n" in shown_text(users.client("show", job))


@pytest.mark.sanitized
def test_messages_are_escaped_in_the_client_and_in_the_log(users):
    path = str(users.where / f"{OVERRIDE}.obj")
    pathlib.Path(path).write_text("v 0 0 nothing\n")
    job = users.submit(surface={"mesh": {"path": path}}, name=OVERRIDE, queue={"labels": [OVERRIDE]})
    for code, *words in ((1, "wait", job), (0, "show", job), (0, "log", job), (0, "show", OVERRIDE), (4, "show", f"no {OVERRIDE}"), (2, "list", "--since", OVERRIDE),
                         (2, OVERRIDE), (2, "list", OVERRIDE), (2, "validate", f"{OVERRIDE}.json"), (2, "submit", f"{OVERRIDE}.json"),
                         (2, b"\x9b" + OVERRIDE.encode()), (2, f"--{OVERRIDE}"), (2, "inspect", path)):
        text = shown_text(users.client(*words, code=code, user="eve"))
        assert SHOWN in text or words[0] == "log", (words, text)
    for words in (("show", job), ("list",)):
        assert SHOWN in shown_text(users.client(*words)), words
    for line in shown_text(users.client("watch", job, user="eve")).splitlines():
        assert json.loads(line)
    assert with_token(users.service, users.tokens["eve"], "GET", f"/v1/{urllib.parse.quote(OVERRIDE)}").status == 404
    log = shown_text(users.service.log.read_bytes())
    assert SHOWN in log, log


def test_json_and_the_route_of_logs_are_unchanged(users):
    job = users.submit(name=OVERRIDE)
    users.client("wait", job, "--accept", user="eve", code=None)
    assert OVERRIDE in users.client("show", job, "--json").decode()
    assert json.loads(users.client("list", "--json"))["jobs"][0]["name"] == OVERRIDE
    log = next((users.service.state / "results" / job).glob("*.log"), None) or users.service.state / "attempts" / f"{job}.1" / "worker.log"
    written = f"one\ttwo\n\x1b[31m{OVERRIDE}\0\n".encode() + b"\x9b\n"
    log.write_bytes(written)
    assert with_token(users.service, users.tokens["eve"], "GET", f"/v1/jobs/{job}/log").body == written
    assert shown_text(users.client("log", job, user="eve")) == f"one\ttwo\n\\u{{1b}}[31m{SHOWN}\\u{{0}}\n\\x{{9b}}\n"


@pytest.mark.sanitized
@pytest.mark.parametrize("command", ["run", "inspect", "estimate"])
def test_the_worker_escapes_what_it_prints(build, tmp_path, command):
    name = OVERRIDE.encode() + b"\x9b.obj"
    words = [b"missing" + name] if command == "inspect" else [name, "--output", "out"]
    done = subprocess.run([build / "hexad-worker", command, *words], capture_output=True, timeout=PATIENCE_S, cwd=tmp_path)
    shown_text(done.stdout + done.stderr)
    last = json.loads(done.stderr.splitlines()[-1])
    assert OVERRIDE in last["message"], last


def test_inspect_escapes_names_in_files(build, tmp_path):
    (tmp_path / f"{OVERRIDE}.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    done = subprocess.run([build / "hexad-worker", "inspect", f"{OVERRIDE}.obj"], capture_output=True, timeout=PATIENCE_S, cwd=tmp_path)
    page = shown_text(done.stdout)
    assert page.startswith(f"{SHOWN}.obj: ") and not done.returncode
    spec = re.search(r"  spec       (.*)\n", page).group(1)
    assert OVERRIDE in json.loads(spec)["surface"]["mesh"]["path"]
