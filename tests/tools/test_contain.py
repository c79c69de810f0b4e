# SPDX-License-Identifier: Apache-2.0
"""tests/contain ends what a test leaves behind; tools/one_make.sh lets one make at a time work in a directory."""
import os
import pathlib
import signal
import subprocess
import sys
import uuid

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "service"))

from service import PATIENCE_S, wait_until  # noqa: E402

DETACHED = "setsid sleep 1000 & setsid sh -c 'trap \"\" TERM INT; sleep 1000 & sleep 1000'"


def marked(mark):
    """Processes with this mark in their environment, without zombies."""
    found = []
    for entry in pathlib.Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and mark.encode() in (entry / "environ").read_bytes():
                found.append(int(entry.name))
        except OSError:
            pass
    return found


@pytest.fixture
def contain(build):
    """Starts a command below tests/contain; returns the process and a function that lists all of its processes."""
    mark = f"HEXAD_TEST_MARK={uuid.uuid4()}"

    def start(*words):
        name, _, value = mark.partition("=")
        process = subprocess.Popen([build / "tests/contain", *words], text=True, stdout=subprocess.PIPE,
                                   env={**os.environ, name: value})
        return process, lambda: marked(mark)
    yield start
    for pid in marked(mark):
        os.kill(pid, signal.SIGKILL)


@pytest.mark.parametrize("end, status", [("exit 3", 3), ("kill -TERM $$", 128 + signal.SIGTERM), ("exec true", 0)])
def test_processes_left_behind_are_ended_and_the_status_is_that_of_the_command(contain, end, status):
    process, alive = contain("sh", "-c", f"({DETACHED}) & echo 'ok 1'; {end}")
    told = process.communicate(timeout=PATIENCE_S)[0].splitlines()
    assert process.returncode == status and not alive()
    assert told[0] == "ok 1" and told[1].startswith("# time: ") and told[1].endswith(" s CPU")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_all_processes_after_the_test_has_cleaned_up(contain, tmp_path, number):
    process, alive = contain("sh", "-c", f"trap 'touch {tmp_path}/cleaned; exit' INT; {DETACHED} & touch {tmp_path}/ready; wait")
    wait_until(lambda: (tmp_path / "ready").exists() and len(alive()) >= 5, "the processes")
    process.send_signal(number)
    process.wait(PATIENCE_S)
    assert not alive() and (tmp_path / "cleaned").exists()


def test_a_killed_suite_leaves_nothing_behind(contain, build):
    process, alive = contain("--suite", "sh", "-c", f"setsid {build}/tests/contain sh -c \"{DETACHED}\" & wait")
    wait_until(lambda: len(alive()) >= 7, "the processes")
    process.kill()
    process.wait(PATIENCE_S)
    wait_until(lambda: not alive(), "the end of all processes")


def test_a_second_make_in_a_directory_refuses(source, tmp_path):
    (tmp_path / "Makefile").write_text(
        f"another := $(shell exec {source}/tools/one_make.sh)\none := $(if $(another),$(error $(another)))\n"
        "all:\n\t@touch held; while ! [ -e go ]; do sleep .01; done; $(MAKE) --no-print-directory below\nbelow:\n\t@echo below\n")
    words = ["make", "--no-print-directory", "-C", tmp_path]
    environ = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")}
    with subprocess.Popen(words, text=True, stdout=subprocess.PIPE, env=environ) as first:
        wait_until((tmp_path / "held").exists, "the first make")
        second = subprocess.run([*words, "below"], text=True, capture_output=True, env=environ, timeout=PATIENCE_S)
        (tmp_path / "go").touch()
        assert first.communicate(timeout=PATIENCE_S)[0] == "below\n" and first.returncode == 0
    assert second.returncode == 2 and f"another make (process {first.pid}) works in {tmp_path}" in second.stderr
    third = subprocess.run([*words, "below"], text=True, capture_output=True, env=environ, timeout=PATIENCE_S)
    assert third.stdout == "below\n"
