# SPDX-License-Identifier: Apache-2.0
"""The measurement of shares: a short run of it."""
import pathlib
import subprocess
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "measurements" / "common"))
import results  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service


def test_a_short_run_has_all_its_parts(source, build, tmp_path):
    output = tmp_path / "sharing.csv"
    done = subprocess.run([sys.executable, "-B", source / "measurements/service/sharing.py", "--built", build, "--output", output, "--many",
                           "40", "--each", "16", "--job-ms", "1"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    one, *users = results.read(output)
    assert one["user"] == "one job behind 40" and [row["user"] for row in users] == ["alice", "bob", "carol", "dave", "erin"]
    assert {row["outcome"] for row in (one, *users)} == {"met"} and float(users[-1]["longest_wait_s"]) > 0
