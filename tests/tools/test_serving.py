# SPDX-License-Identifier: Apache-2.0
"""The benchmark of the service: a short run of it, and that its clients see what is wrong."""
import pathlib
import re
import subprocess
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "service"))

from service import Service  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service

SHORT = ("--rounds", "1", "--span", "0.1", "--waiting", "70", "--looks", "20", "--streams", "40", "--jobs", "2")


@pytest.fixture
def service(build, tmp_path):
    made = Service(build, tmp_path, "--listen", f"unix:{tmp_path}/socket")
    yield made.start()
    made.clean_up()


def test_a_short_run_has_all_its_parts(source, build, tmp_path):
    page = tmp_path / "page.md"
    done = subprocess.run([sys.executable, "-B", source / "measurements/service/serving.py", "--built", build, "--page", page,
                           *SHORT], capture_output=True, text=True)
    assert done.returncode in (0, 1), done.stderr  # 1: a ratio of so short a run is none
    text = page.read_text()
    rows = re.findall(r"^\| (.+?) \| (?:at|1|0)\b.*\| (?:met|\*\*missed\*\*|not in this run) \|$", text, re.MULTILINE)
    assert [r.split(" ")[0] for r in rows] == ["list", "status", "Status", "1", "-", "Submissions", "1", "A", "-", "A", "-"]
    assert "- 40 open event streams of 2 jobs that ran: 40 had every event until the job's end" in text
    assert re.search(r"^\| 1024 \| \d+ \| [\d.]+ \| [\d.]+ \| [\d.]+ \|$", text, re.MULTILINE)
    assert not re.search(r"\b(nan|inf)\b", text) and str(tmp_path) not in text


def test_the_client_counts_answers_that_are_failures(service, build, tmp_path):
    paths, body = tmp_path / "paths", tmp_path / "body"
    paths.write_text("/v1/nothing\n/v1/jobs\n")
    load = build / "measurements" / "service" / "load"
    told = subprocess.run([load, "get", tmp_path / "socket", paths, "2", "10"], check=True, capture_output=True,
                          text=True)
    assert '"count": 10, "failed": 5,' in told.stdout
    paths.write_text("/v1/jobs\n")
    body.write_text('{"version": 1}')
    told = subprocess.run([load, "post", tmp_path / "socket", paths, "2", "6", body], check=True, capture_output=True,
                          text=True)
    assert '"count": 6, "failed": 6,' in told.stdout

