"""The manual pages say all that the programs say of themselves, and are well formed; so is the completion."""
import os
import re
import shutil
import subprocess
import sys

import pytest

PAGES = {"hexad.8": "hexad", "hexad-worker.1": "hexad-worker", "hexadctl.1": "hexadctl", "hexad.conf.5": "hexad"}
OPTION = r"--[a-z][a-z_-]*"


def help_of(build, program):
    return subprocess.run([build / program, "--help"], capture_output=True, text=True, check=True).stdout


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
    state = re.search(r"^localstatedir = (.*)$", (build / "Makefile").read_text(), re.M)[1]
    prefix = re.search(r"^prefix = (.*)$", (build / "Makefile").read_text(), re.M)[1]
    subprocess.run([sys.executable, source / "tools/man.py", build, tmp_path, state.replace("${prefix}", prefix)],
                   check=True)
    for page in PAGES:
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


@pytest.mark.parametrize("page", ["hexad-worker.1", "hexadctl.1"])
def test_no_option_is_missing(build, source, needs_mandoc, page):
    text = rendered(source / "doc/man" / page)
    options = set(re.findall(OPTION, help_of(build, PAGES[page])))
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
def test_all_options_are_completed(build, complete, program):
    assert complete(program, "--") == sorted(set(re.findall(OPTION, help_of(build, program))))


def test_all_commands_are_completed(source, complete):
    client = (source / "src/programs/hexadctl.c").read_text()
    names = re.findall(r'\{"([a-z -]+)", command_', client)
    assert {"submit", "fetch"} <= set(names)
    assert set(complete("hexadctl", "")) == {name.split()[0] for name in names}
    for group, _, name in (n.partition(" ") for n in names):
        assert not name or name in complete("hexadctl", group, "")
    assert complete("hexadctl", "su") == ["submit"]
    assert {"run", "make-example", "spec-help"} <= set(complete("hexad-worker", ""))
    assert complete("hexadctl", "show", "") == []  # an id: nothing but names of files
