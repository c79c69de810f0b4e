# SPDX-License-Identifier: Apache-2.0
"""The measurement of shares: a short run of it."""
import re
import subprocess
import sys

import pytest

pytestmark = pytest.mark.extended  # measuring programs, not the service


def test_a_short_run_has_all_its_parts(source, build, tmp_path):
    page = tmp_path / "page.md"
    done = subprocess.run([sys.executable, "-B", source / "measurements/service/sharing.py", "--built", build, "--page", page, "--many",
                           "40", "--each", "16", "--job-ms", "1"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    text = page.read_text()
    rows = re.findall(r"^\| (\w+) \| [\d.]+ \| [\d.]+ \| [\d.]+ \|(?: [\d.]+ \|){4}$", text, re.MULTILINE)
    assert rows == ["alice", "bob", "carol", "dave", "erin"] and "missed" not in text and str(tmp_path) not in text
