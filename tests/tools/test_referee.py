# SPDX-License-Identifier: Apache-2.0
"""The referee on one surface: it agrees with the worker, and says so when a report is wrong."""
import pathlib
import subprocess
import sys

import numpy
import pytest

MEASURES = pathlib.Path(__file__).resolve().parents[2] / "measurements" / "measures"
sys.path[:0] = [str(MEASURES), str(MEASURES.parent / "common")]

import measure  # noqa: E402
import referee  # noqa: E402
import results  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service


def test_reported_and_recomputed_values_agree(build, tmp_path):
    done = subprocess.run([sys.executable, MEASURES / "referee.py", "--worker", build / "hexad-worker", "--seeds", "1",
                           "--only", "quartic", "--output", tmp_path / "referee.csv"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "agree within 20%" in done.stdout
    rows = results.read(tmp_path / "referee.csv")
    assert [row["row"] for row in rows] == [f"quartic (15): {name}" for name, _, _ in referee.WAYS]
    assert {float(row["step_left_ratio_largest"]) for row in rows} == {1}


@pytest.fixture(scope="module")
def job(build, tmp_path_factory):
    case = next(c for c in referee.formulas() if c.name == "sphere")
    return referee.surface_of(case.surface), *referee.run(build / "hexad-worker", case, referee.WAYS[2], 1,
                                                          tmp_path_factory.mktemp("job"))


@pytest.mark.parametrize("member", ("step", "energy", "alpha", "kappa1", "normal"))
def test_what_is_wrong_is_found(job, member):
    surface, report, points = job
    assert referee.disagreements(referee.compare(surface, report, points)) == []
    if member == "step":
        report = {**report, "diagnostics": {**report["diagnostics"], "step_left": 1.3 * report["diagnostics"]["step_left"]}}
    elif member == "normal":
        points = measure.PointSet(points.position, numpy.roll(points.normal, 1, axis=0), points.spacing, points.alpha,
                                  points.columns)
    else:
        column = 1.3 * points.columns[member]
        points = measure.PointSet(points.position, points.normal, points.spacing,
                                  column if member == "alpha" else points.alpha, {**points.columns, member: column})
    assert any(member in words for words in referee.disagreements(referee.compare(surface, report, points)))


def test_the_summary_is_that_of_the_results(tmp_path):
    subprocess.run([sys.executable, MEASURES / "differences.py", "--output", tmp_path / "differences.csv"], check=True, capture_output=True)
    assert (tmp_path / "differences.csv").read_text() == (MEASURES / "differences.csv").read_text()


def test_derivatives_of_a_spline():
    """A spline through x y z: its gradient and Hessian are those of the product."""
    side = numpy.arange(8.0) - 1
    product = referee.Spline(side[:, None, None] * side[None, :, None] * side[None, None, :], (-1, -1, -1), (1, 1, 1))
    x = numpy.random.default_rng(1).uniform(0, 5, (20, 3))
    assert numpy.allclose(product.value(x), x.prod(axis=1))
    assert numpy.allclose(product.gradient(x), numpy.roll(x, 1, 1) * numpy.roll(x, 2, 1))
    assert numpy.allclose(product.hessian(x)[:, 0, 1], x[:, 2]) and numpy.allclose(product.hessian(x)[:, 0, 0], 0)
