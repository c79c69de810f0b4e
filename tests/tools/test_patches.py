# SPDX-License-Identifier: Apache-2.0
"""measurements/meshes/patches.py: its measures on shapes whose edges are known, and a row of the results from the worker;
mesh_results.py: its summary."""
import pathlib
import subprocess
import sys

import numpy
import pytest

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[2] / "measurements" / folder) for folder in ("common", "meshes")]
import mesh_results  # noqa: E402
import meshes  # noqa: E402
import patches  # noqa: E402
import results  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service

SQUARE = numpy.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])


def test_edges_are_told_apart():
    cube = patches.prism(SQUARE, lambda x, y: -1, lambda x, y: 1)
    for mesh in (cube, patches.flipped(cube)):
        assert [len(e) for e in patches.edges_of(mesh)] == [0, 0, 12]
    fan = patches.joined(*(patches.sheet([0, 0, 0], [0, 0, 1], [numpy.cos(a), numpy.sin(a), 0]) for a in (0, 2, 4)))
    opened, crowded, sharp = patches.edges_of(fan)
    assert (len(opened), len(crowded), len(sharp)) == (3 * 24, 8, 0)
    crossed = patches.prism(patches.star(), lambda x, y: -1, lambda x, y: 1)
    assert len(patches.edges_of(crossed)[2]) == 3 * 16


def test_distances_are_of_the_nearest_triangle():
    """Of needles the places that are tried say little."""
    needles = patches.prism(patches.circle(720), lambda x, y: -1.5, lambda x, y: 0.5 - y / 2)
    place = meshes.places(needles, 500)[0]
    assert patches.largest(needles, place) < 1e-12
    assert abs(patches.largest(needles, place + [0, 0, 1e-3]) - 1e-3) < 1e-6
    edge = patches.edges_of(needles)[2]
    lines = patches.Lines(needles, edge, 0.01)
    assert lines.distance(lines.place).max() < 1e-12 and abs(lines.distance(numpy.array([[0, 0, -1.5]]))[0] - 1) < 1e-4


def test_a_row_of_the_table(source, build, tmp_path):
    done = subprocess.run([sys.executable, "-B", source / "measurements/meshes/patches.py", "--worker", build / "hexad-worker", "--data", tmp_path,
                           "--output", tmp_path / "patches.csv", "--seeds", "1", "--count", "2000", "--only", "cube by mesh"],
                          capture_output=True, text=True)
    assert done.returncode in (0, 1) and (tmp_path / "patches.csv").exists(), done.stderr
    (row,) = results.read(tmp_path / "patches.csv")
    assert row["surface"] == "cube by mesh" and row["outcome"] == "1 converged"
    assert float(row["off_mesh_per_diagonal"]) < 1e-9 and row["wrong_edges"] == "0"
    assert 0.5 < float(row["coverage_spacings"]) < 1 and float(row["sharp_edges_spacings"]) < 0.8 and float(row["hausdorff_spacings"]) < 0.01
    assert row["open_edges_spacings"] == row["grading_cv"] == ""
    assert (done.returncode == 1) == (row["missed"] != "") and set(row["missed"].split()) <= {name for _, name, _ in patches.COLUMNS}


def test_the_summary_of_counts_agrees_with_the_results(source):
    """Those of the repository; the ratios were measured with other builds (README.md beside them)."""
    folder = source / "measurements/meshes"
    jobs = [list(row.values()) for row in results.read(folder / "counts.csv")]
    assert len({job[0] for job in jobs}) == len(jobs) and all(len(job) == len(mesh_results.HEADER) for job in jobs)
    stored = [list(row.values()) for row in results.read(folder / "by_count.csv")]
    found = [list(map(str, row)) for row in mesh_results.summary(jobs, mesh_results.COUNTS)]
    ratios = mesh_results.SUMMARY.index("cpu_ratio_median")
    assert [row[:ratios] for row in stored] == [row[:ratios] for row in found]


def test_ratios_are_of_jobs_of_both_workers():
    report = {"outcome": "converged", "outcome_reasons": [], "quality": {name: 0.5 for name in mesh_results.MEASURES}}
    mesh, failed = pathlib.Path("a.off"), (None, "no surface")
    jobs = [mesh_results.row(mesh, 10, own, other, "") for own, other in (
        ((report, 1.0, 30), (report, 2.0, 20)), ((report, 3.0, 20), (report, 2.0, 20)), ((report, 9.0, 20), failed), (failed, None))]
    (row,) = mesh_results.summary(jobs, [10])
    named = dict(zip(mesh_results.SUMMARY, row))
    assert (named["jobs"], named["converged"], named["cpu_ratio_median"], named["cpu_ratio_largest"]) == (4, 3, "1.00", "1.50")
    assert named["memory_ratio_largest"] == "1.50" and jobs[3][3:5] == ["error", "no surface"]
