# SPDX-License-Identifier: Apache-2.0
"""Instructions that long lists of a spec take, counted by tools/list_growth.py."""
import re
import shutil
import subprocess
import sys

import pytest


def growth(build, source, *words):
    return subprocess.run([sys.executable, "-B", source / "tools" / "list_growth.py", build, *words], capture_output=True, text=True)


@pytest.mark.extended
def test_twice_the_elements_take_at_most_two_and_a_half_times_the_instructions(build, source):
    if not shutil.which("valgrind"):
        pytest.skip("there is no valgrind")
    done = growth(build, source, "--elements", "4000")
    assert done.returncode == 0, done.stdout + done.stderr
    lists = set(re.findall(r"^\| (/\S+) ", done.stdout, re.M))
    assert {"/surface/labels/groups", "/surface/labels/interfaces", "/surface/union", "/attributes", "/queue/depends_on", "/queue/slurm",
            "/queue/by_frame", "/queue/frames"} <= lists


@pytest.mark.extended
def test_a_list_that_grows_faster_is_reported(build, source, tmp_path):
    """With a program in place of valgrind that counts the square of the document's length."""
    program = tmp_path / "valgrind"
    program.write_text("#!/bin/sh\nfor last; do :; done\nn=$(wc -c <$last)\necho \"Collected : $((n * n))\" >&2\n")
    program.chmod(0o700)
    done = subprocess.run([sys.executable, "-B", source / "tools" / "list_growth.py", build, "--only", "/surface/labels/labels"],
                          capture_output=True, text=True, env={"PATH": f"{tmp_path}:/usr/bin:/bin"})
    assert done.returncode == 1 and re.search(r"The largest growth is [34]\.\d\d", done.stdout), done.stdout + done.stderr
