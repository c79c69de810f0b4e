# SPDX-License-Identifier: Apache-2.0
"""measurements/paper/reproduce in its short form: the page, its links and its pictures."""
import json
import re
import subprocess
import sys

import pytest

pytestmark = pytest.mark.extended  # measuring programs, not the service


@pytest.fixture(scope="module")
def page(source, build, tmp_path_factory):
    where = tmp_path_factory.mktemp("doc")
    subprocess.run([sys.executable, source / "measurements/paper/reproduce", "--quick", "--worker", build / "hexad-worker",
                    "--output", where], check=True)
    return where / "reproduction.md"


def test_table_1(page):
    (row,) = [line for line in page.read_text().splitlines() if line.startswith("| 300 | 1/6 |")]
    paper, ours = (float(cell.split()[0]) for cell in row.split("|")[3:5])
    assert paper == 8.5 and abs(ours / paper - 1) <= 0.1


def test_figure_4(page):
    (row,) = [line for line in page.read_text().splitlines() if line.startswith("| d3 ")]
    cells = [cell.strip() for cell in row.split("|")]
    assert cells[2:4] == ["1000", "converged"]
    assert abs(float(cells[7]) / 0.125 - 1) < 0.1


def test_every_picture_is_there_and_small(page):
    links = re.findall(r"\]\((reproduction/[^)]*)\)", page.read_text())
    assert len(links) == 3
    for link in links:
        assert 0 < (page.parent / link).stat().st_size <= 150_000


def test_every_job_is_a_job(source, build, tmp_path):
    """The worker knows every member of the specs that the page is made of, or says that it is not built."""
    specs = sorted((source / "measurements/paper/reproduce.d").glob("*.json"))
    assert len(specs) == 7
    for path in specs:
        spec = json.loads(path.read_text())
        spec["solver"]["max_sweeps"] = 1
        done = subprocess.run([build / "hexad-worker", "run", "-", "--output", tmp_path / path.stem], text=True,
                              input=json.dumps(spec), capture_output=True)
        told = json.loads(done.stderr.splitlines()[-1]) if done.returncode not in (0, 10, 11) else {"code": None}
        assert told["code"] in (None, "not_supported", "input_missing"), (path.name, told)
