# SPDX-License-Identifier: Apache-2.0
"""measurements/paper/reproduce in its short form: its results and pictures; and what is kept of its long form."""
import csv
import json
import re
import subprocess
import sys

import pytest

pytestmark = pytest.mark.extended  # measuring programs, not the service


def rows(path):
    with open(path, newline="", encoding="utf-8") as file:
        read = csv.DictReader(file)
        return {row[read.fieldnames[0]]: row for row in read}


@pytest.fixture(scope="module")
def results(source, build, tmp_path_factory):
    where = tmp_path_factory.mktemp("paper")
    subprocess.run([sys.executable, source / "measurements/paper/reproduce", "--quick", "--worker", build / "hexad-worker",
                    "--output", where], check=True)
    return where


def test_table_1(results):
    (row,) = rows(results / "table1.csv").values()
    paper, ours = float(row["paper_neighbours"]), float(row["neighbours"])
    assert row["cell"] == "300 1/6" and paper == 8.5 and abs(ours / paper - 1) <= 0.1


def test_figure_2(results):
    found = rows(results / "figure2_properties.csv")
    assert abs(float(found["gaussian_peak_distance"]["value"]) - 1 / 3) < 0.01


def test_figure_4(results):
    (row,) = rows(results / "figures.csv").values()
    assert row["job"] == "quartic d3 1000" and row["outcome"] == "converged"
    assert abs(float(row["sigma"]) / 0.125 - 1) < 0.1
    assert 0 < (results / "pictures/figure4-d3-1000.png").stat().st_size <= 300_000


def test_rows_of_other_figures_stay(source, build, results):
    subprocess.run([sys.executable, source / "measurements/paper/reproduce", "--only", "figure2", "--worker",
                    build / "hexad-worker", "--output", results], check=True)
    with open(results / "figures.csv", "a", encoding="utf-8") as file:
        file.write("another,9\n")
    subprocess.run([sys.executable, source / "measurements/paper/reproduce", "--quick", "--only", "figure4", "--worker",
                    build / "hexad-worker", "--output", results], check=True)
    assert list(rows(results / "figures.csv")) == ["quartic d3 1000", "another"]


def test_every_picture_of_the_page_has_a_row(source):
    """Each picture of a figure has the row of its job, and the page shows it."""
    where = source / "measurements/paper"
    jobs = {f"figure{row['figure']}-{name.split()[-2]}-{row['points']}.png"
            for name, row in rows(where / "figures.csv").items()}
    shown = set(re.findall(r"\]\(pictures/([^)]*)\)", (where / "README.md").read_text()))
    there = {path.name for path in (where / "pictures").iterdir()}
    assert shown == there and there - {"figure2.svg"} <= jobs
    assert all(path.stat().st_size <= 1_300_000 for path in (where / "pictures").iterdir())
    assert (source / "doc/dragon.png").stat().st_size <= 1_500_000


def test_every_job_is_a_job(source, build, tmp_path):
    """The worker accepts every member of the specs of the figures, or reports that it is not built."""
    specs = sorted((source / "measurements/paper/reproduce.d").glob("*.json"))
    assert len(specs) == 8
    for path in specs:
        spec = json.loads(path.read_text())
        spec["solver"]["max_sweeps"] = 1
        done = subprocess.run([build / "hexad-worker", "run", "-", "--output", tmp_path / path.stem], text=True,
                              input=json.dumps(spec), capture_output=True)
        told = json.loads(done.stderr.splitlines()[-1]) if done.returncode not in (0, 10, 11) else {"code": None}
        assert told["code"] in (None, "not_supported", "input_missing"), (path.name, told)
