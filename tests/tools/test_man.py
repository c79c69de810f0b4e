# SPDX-License-Identifier: Apache-2.0
"""The manual pages say all that the programs say of themselves, and are well formed; so is the completion."""
import http.server
import json
import os
import re
import shutil
import subprocess
import sys
import threading

import pytest

PAGES = {"hexad.8": "hexad", "hexad-worker.1": "hexad-worker", "hexadctl.1": "hexadctl", "hexad.conf.5": "hexad"}
OPTION = r"--[a-z][a-z_-]*"


def help_of(build, program, *words):
    return subprocess.run([build / program, "--help", *words], capture_output=True, text=True, check=True).stdout


def rendered(path):
    """The page as it is read, without line breaks and hyphenation."""
    text = subprocess.run(["mandoc", "-T", "utf8", "-O", "width=500", path], capture_output=True, text=True,
                          check=True).stdout
    return re.sub(r".\x08", "", text)


@pytest.fixture
def needs_mandoc():
    if not shutil.which("mandoc"):
        pytest.skip("mandoc is not installed")


def test_pages_are_what_the_tool_writes(build, source, tmp_path):
    prefix, state, settings = (re.search(rf"^{name} = (.*)$", (build / "Makefile").read_text(), re.M)[1]
                               for name in ("prefix", "localstatedir", "sysconfdir"))
    places = [path.replace("${prefix}", prefix) for path in (state, settings)]
    subprocess.run([sys.executable, source / "tools/man.py", build, tmp_path, *places], check=True)
    for page in PAGES:
        assert not any(f"{path}/" in (source / "doc/man" / page).read_text() for path in places)  # packages have others
        assert (tmp_path / page).read_text() == (source / "doc/man" / page).read_text(), "make man writes it anew"


@pytest.mark.parametrize("page", PAGES)
def test_pages_are_well_formed(source, needs_mandoc, page):
    path = source / "doc/man" / page
    lint = subprocess.run(["mandoc", "-T", "lint", "-W", "warning", path], capture_output=True, text=True)
    assert lint.returncode == 0, lint.stdout
    if shutil.which("man"):
        shown = subprocess.run(["man", "--warnings", "-l", "-Tutf8", "-Z", path], capture_output=True, text=True,
                               env={**os.environ, "LC_ALL": "C.UTF-8"})
        assert shown.returncode == 0 and not shown.stderr, shown.stderr


def test_terms_are_apart_from_their_texts(source, needs_mandoc):
    """Also terms of two lines in the help, and those as long as the column."""
    lines = [line.strip() for line in rendered(source / "doc/man/hexadctl.1").splitlines()]
    attach, = (line for line in lines if line.startswith("attach ID"))
    assert attach.endswith(" [--priority N] [--label LABEL]... [--key KEY]")
    assert "--state STATES" in lines and any(line.startswith("blocked, queued, ") for line in lines)


def test_options_have_no_text_in_their_terms(source):
    for page in PAGES:
        for term in re.findall(r"^\.TP\n\.B (\\-\\-.*)$", (source / "doc/man" / page).read_text(), re.M):
            assert len(re.findall(r" [a-z]+", term)) <= 1, (page, term)


def test_a_text_one_space_after_its_option_is_refused(source, tmp_path):
    for gap, good in ("  ", True), (" ", False), ("\n          ", True):
        for program in ("hexad", "hexad-worker", "hexadctl"):
            (tmp_path / program).write_text("#!/bin/sh\ncat <<'END'\nusage: x\n\nA text.\n\n  --file  reads a file\n"
                                            f"  --line  prints a line\n  --port{gap}opens several ports\n\n"
                                            "Settings, as options and as keys of the file\n\n  --key\n      a setting\nEND\n")
            (tmp_path / program).chmod(0o755)
        done = subprocess.run([sys.executable, source / "tools/man.py", tmp_path, tmp_path / "pages", "/var", "/etc"], text=True,
                              capture_output=True)
        assert (done.returncode == 0) == good, (gap, done.stderr)
        assert good or "two spaces" in done.stderr


@pytest.mark.parametrize("program", ["hexad", "hexadctl", "hexad-worker", "hexad-node"])
def test_help_is_short_and_all_of_it_begins_with_what_is_basic(build, program):
    """Commands and options are the lines with two spaces in front."""
    short, every = (help_of(build, program, *words).splitlines() for words in ((), ("all",)))
    assert len(short) <= 40 and all(len(line) <= 100 for line in short)
    if program == "hexad-node":  # Slurm starts it
        return
    basic, terms = ([line.split()[0] for line in lines if re.match("  [a-zA-Z-]", line)] for lines in (short, every))
    assert "--help all" in "".join(short)
    for kind in "^[a-z]", "^--":  # commands, options
        wanted = [term for term in basic if re.match(kind, term) and term != "help"]
        found = [term for term in terms if re.match(kind, term) and term != "help"]
        assert set(wanted) < set(found) or not wanted
        if kind == "^[a-z]":
            assert found[:len(wanted)] == wanted


@pytest.mark.parametrize("page", ["hexad-worker.1", "hexadctl.1"])
def test_no_option_is_missing(build, source, needs_mandoc, page):
    text = rendered(source / "doc/man" / page)
    options = set(re.findall(OPTION, help_of(build, PAGES[page], "all")))
    assert len(options) >= 5
    assert options <= set(re.findall(OPTION, text))


def test_no_setting_is_missing(build, source, needs_mandoc):
    sample = subprocess.run([build / "hexad", "--print-config"], capture_output=True, text=True, check=True).stdout
    settings = re.findall(r"^#([a-z_]+) =", sample, re.M)
    text = rendered(source / "doc/man/hexad.conf.5")
    assert len(settings) >= 15
    for setting in settings:
        assert re.search(rf"^ +{setting}( |$)", text, re.M), setting
    assert {"--config", "--print-config"} <= set(re.findall(OPTION, rendered(source / "doc/man/hexad.8")))


# ---- completion

BASH = r'''. "$0/completion.bash"; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _hexad
printf "%s\n" "${COMPREPLY[@]}"'''
# what zsh has for use within its editor alone: to keep what begins like the word, and to go by the names of files
ZSH = """compadd() { shift; print -l -- ${(M)@:#$words[CURRENT]*} }; _files() { }
words=("$@") CURRENT=$#; complete_it() { source $1 }; complete_it $0/completion.zsh"""


@pytest.fixture(params=["bash", pytest.param("zsh", marks=pytest.mark.extended)])
def complete(request, build, source):
    """What the shell offers for the last of the words."""
    shell = request.param
    if not shutil.which(shell):
        pytest.skip(f"{shell} is not here")

    def call(*words):
        start = {"bash": ["bash", "-c", BASH], "zsh": ["zsh", "-f", "-c", ZSH]}[shell]
        done = subprocess.run([*start, source / "etc", build / words[0], *words[1:]],
                              capture_output=True, text=True, check=True)
        assert not done.stderr
        return sorted(done.stdout.split())
    return call


@pytest.mark.parametrize("program", ["hexad", "hexadctl", "hexad-worker"])
def test_basic_options_are_completed_and_all_after_a_letter(build, complete, program):
    basic, every = (set(re.findall(OPTION, help_of(build, program, *words))) for words in ((), ("all",)))
    assert complete(program, "--") == sorted(basic) and basic < every
    for letter in {option[2] for option in every}:
        assert complete(program, f"--{letter}") == sorted(option for option in every if option[2] == letter)


def test_all_commands_are_completed(source, complete):
    client = (source / "src/programs/hexadctl.c").read_text()
    ranks = {name: rank for rank, name in re.findall(r'\{OPTION_(\w+), "([a-z -]+)", command_', client)}
    names = list(ranks)
    assert {"submit", "fetch", "retry"} <= set(names)
    assert set(complete("hexadctl", "")) == {name for name in names if ranks[name] == "BASIC"} | {"help"}
    for letter in {name[0] for name in names}:
        assert {name.split()[0] for name in names if name[0] == letter} <= set(complete("hexadctl", letter))
    for group, _, name in (n.partition(" ") for n in names):
        assert not name or name in complete("hexadctl", group, "")
    assert complete("hexadctl", "su") == ["submit"]
    assert {"run", "make-example", "spec-help"} <= set(complete("hexad-worker", ""))
    assert complete("hexad-worker", "sch") == ["schema"]
    assert complete("hexadctl", "show", "") == []  # without a server no id: nothing but names of files


class Queue(http.server.BaseHTTPRequestHandler):
    """A server with a list of two jobs."""
    ids = ("06faddpyxsd3g6zk16mtd9v23g", "06fb0000000000000000000000")

    def do_GET(self):
        body = json.dumps({"jobs": [{"id": job, "state": "queued"} for job in self.ids], "next": None}).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        pass


@pytest.fixture(scope="module")
def queue():
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Queue)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    thread.join()
    server.server_close()


def test_ids_are_completed(complete, queue, monkeypatch):
    monkeypatch.setenv("HEXAD_SERVER", queue)
    monkeypatch.setenv("HEXAD_COMPLETION_S", "60")  # the machine may be busy
    assert complete("hexadctl", "show", "") == [*Queue.ids, "latest"]
    assert complete("hexadctl", "watch", "06fb") == [Queue.ids[1]]
    assert complete("hexadctl", "delete", Queue.ids[0], "06fb") == [Queue.ids[1]]
    assert complete("hexadctl", "submit", "") == []


def test_states_are_completed(source, complete):
    names = re.findall(r'\[QUEUE_\w+\] = "([a-z_]+)"', re.search(r"state_names.*?;", (source / "src/service/queue/queue.c").read_text(), re.S)[0])
    assert len(names) == 9
    assert complete("hexadctl", "list", "--state", "") == sorted(names)
    assert complete("hexadctl", "list", "--state", "ca") == ["cancelled", "cancelling"]
    assert complete("hexadctl", "list", "--state", "queued,ru") == ["queued,running"]
