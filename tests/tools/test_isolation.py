"""Short runs of the programs that measure how users are isolated from each other: bench/isolation.py and bench/separation.py."""
import re
import subprocess
import sys

import pytest

pytestmark = pytest.mark.extended  # measuring programs, not the service


def run(source, build, where, program, *more):
    done = subprocess.run([sys.executable, "-B", source / "bench" / program, "--built", build, "--place", where, *more],
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return done.stdout


def test_a_user_is_served_beside_ten_hostile_ones(source, build, tmp_path):
    told = run(source, build, tmp_path, "isolation.py", "--minutes", "0.2", "--jobs", "2000", "--untimed")
    numbers = dict(re.findall(r"^\| (GET /healthz|GET /v1/jobs/ID|POST /v1/jobs) \| (\d+) ", told, re.M))
    assert len(numbers) == 3 and all(int(n) for n in numbers.values()) and "All goals are met" in told


def test_another_users_answers_have_no_marker(source, build, tmp_path):
    told = run(source, build, tmp_path, "separation.py", "--operations", "200")
    assert ": 0 leaks" in told and re.search(r"[1-9]\d* pairs of equal specs", told)
