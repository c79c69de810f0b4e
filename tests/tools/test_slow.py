# SPDX-License-Identifier: Apache-2.0
"""measurements/inputs/slow.py on small forms of its meshes."""
import math
import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "measurements" / "common"), str(ROOT / "measurements" / "inputs")]
import results  # noqa: E402
import slow  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service


def area(vertices, faces):
    """By the vector area of each face."""
    total = 0
    for face in faces:
        cross = [0, 0, 0]
        for k in range(1, len(face) - 1):
            u, v = ([b - a for a, b in zip(vertices[face[0]], vertices[face[k + i]])] for i in (0, 1))
            cross = [c + x for c, x in zip(cross, (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]))]
        total += math.sqrt(sum(c * c for c in cross)) / 2
    return total


AREAS = {  # of 200, 200 x 2, 10 teeth, 20 sides, 10 pages and 8 shells
    "star": (slow.polygon(slow.star_corners(200, 1, 0.5)), 100 * 0.5 * math.sin(2 * math.pi / 200)),
    "comb": (slow.comb(10), 2 * 0.2 + 10 * 0.2 * 0.475 * 1.8),
    "needles": (slow.needle_cylinder(20, (1, 1, 1)), 20 * 2 * math.sin(math.pi / 20) * 0.5 * 2),
    "book": (slow.book(10, False), 10),
    "book of triangles": (slow.book(10, True), 5),
    "shells": (slow.shells(8), 8 * math.sqrt(3) * (0.6 * math.sqrt(2)) ** 2)}


@pytest.mark.parametrize("name", AREAS)
def test_a_mesh_has_its_area(name):
    mesh, expected = AREAS[name]
    assert area(*mesh) == pytest.approx(expected, rel=1e-12)


def test_every_mesh_has_its_row(source, build, tmp_path):
    done = subprocess.run([sys.executable, "-B", source / "measurements/inputs/slow.py", "--worker", build / "hexad-worker",
                           "--output", tmp_path / "slow.csv", "--size", "0.01", "--count", "200"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = {row["mesh"]: row for row in results.read(tmp_path / "slow.csv")}
    assert list(rows) == [name for name, _, _ in slow.meshes(0.01)]
    for row in rows.values():
        assert row["outcome"] in ("converged", "not_converged", "unresolved"), row
        assert row["cpu_s"] and row["estimate_s"], row
