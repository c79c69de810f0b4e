# SPDX-License-Identifier: Apache-2.0
"""The measurement of each row of the table of routes: short runs of it."""
import re
import subprocess
import sys

import pytest

pytestmark = pytest.mark.extended  # measuring programs, not the service


def run(source, build, *options):
    done = subprocess.run([sys.executable, "-B", source / "measurements/isolation/isolation.py", "--built", build, *map(str, options)],
                          capture_output=True, text=True)
    assert done.returncode in (0, 1), done.stdout + done.stderr  # 1: a goal was missed, since other work runs beside
    return done.stdout


def test_each_row_is_loaded_by_each_caller(source, build):
    text = run(source, build, "--routes", 0.2, "--only", "getOpenapi,followJobs")
    rows = re.findall(r"^\| ([^|]+) \| (\w+) \| (\d+): \d+", text, re.MULTILINE)
    assert [r[:2] for r in rows] == [(title, caller) for title in (
        "followJobs", "followJobs (backlog)", "followJobs (new events)", "getOpenapi") for caller in ("anonymous", "reader", "submitter")]
    assert [status for _, _, status in rows] == ["401", "200", "200"] * 3 + ["200"] * 3


def test_each_row_has_a_time_in_the_serving_thread(source, build):
    text = run(source, build, "--serving-thread")
    page = (source / "measurements/isolation/isolation.md").read_text()
    table = r"^(\| (?!row)\w+ \| [^|]+ \| )\d+ \| \d+ \| [\d.]+ \| [\d.]+ \|$"
    assert re.findall(table, text, re.MULTILINE) == re.findall(table, page, re.MULTILINE)
    assert len(re.findall(r"^\| (?:putInput|getResult|followJobs): [^|]+ \| [\d.]+ \|$", text, re.MULTILINE)) == 4
