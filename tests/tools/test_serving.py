# SPDX-License-Identifier: Apache-2.0
"""The benchmark of the service: a short run of it, and that its clients see what is wrong."""
import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "service"), str(ROOT / "measurements" / "common")]

import results  # noqa: E402
from service import Service  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service

SHORT = ("--rounds", "1", "--span", "0.1", "--waiting", "70", "--looks", "20", "--streams", "40", "--jobs", "2")


@pytest.fixture
def service(build, tmp_path):
    made = Service(build, tmp_path, "--listen", f"unix:{tmp_path}/socket")
    yield made.start()
    made.clean_up()


def test_a_short_run_has_all_its_parts(source, build, tmp_path):
    output = tmp_path / "service.csv"
    done = subprocess.run([sys.executable, "-B", source / "measurements/service/serving.py", "--built", build, "--output", output,
                           *SHORT], capture_output=True, text=True)
    assert done.returncode in (0, 1), done.stderr  # 1: a ratio of so short a run is none
    rows = {row["quantity"]: row for row in results.read(output)}
    claims = [name for name, row in rows.items() if row["bound"]]
    assert {rows[name]["outcome"] for name in claims} <= {"met", "missed", "not judged"}
    assert [name.split(" ")[0] for name in claims] == ["List", "Status", "Status", "1", "Largest", "Submissions", "1", "A", "Busy", "A", "Busy"]
    assert rows["Open event streams with every event until the job's end"]["measured"] == rows["Open event streams"]["measured"] == "40"
    connections = results.read(tmp_path / "connections.csv")
    assert connections[-1]["busy_connections"] == "1024" and all(float(value) >= 0 for row in connections for value in row.values())
    text = output.read_text()
    assert "nan" not in text and "inf" not in text and str(tmp_path) not in text


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

