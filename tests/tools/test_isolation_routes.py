# SPDX-License-Identifier: Apache-2.0
"""The measurement of each row of the table of routes: short runs of it."""
import pathlib
import subprocess
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "measurements" / "common"))
import results  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service


def run(source, build, output, *options):
    done = subprocess.run([sys.executable, "-B", source / "measurements/isolation/isolation.py", "--built", build, "--output", output,
                           *map(str, options)], capture_output=True, text=True)
    assert done.returncode in (0, 1), done.stdout + done.stderr  # 1: a goal was missed, since other work runs beside
    return results.read(output)


def test_each_row_is_loaded_by_each_caller(source, build, tmp_path):
    rows = run(source, build, tmp_path / "routes.csv", "--routes", 0.2, "--only", "getOpenapi,followJobs")
    assert [row["row"] for row in rows] == [f"{title} {caller}" for title in (
        "followJobs", "followJobs (500)", "followJobs (backlog)", "followJobs (new events)", "getOpenapi") for caller in ("anonymous", "reader", "submitter")]
    assert [row["answers_per_s"].partition(":")[0] for row in rows] == ["401", "200", "200"] * 4 + ["200"] * 3


def test_each_row_has_a_time_in_the_serving_thread(source, build, tmp_path):
    calls = lambda rows: [(row["row"], row["calls"]) for row in rows]
    rows = run(source, build, tmp_path / "serving_thread.csv", "--serving-thread")
    assert calls(rows) == calls(results.read(source / "measurements/isolation/serving_thread.csv"))
    assert len([row for row in rows if ": " in row["row"] and float(row["whole_request_ms"]) > 0]) == 6
