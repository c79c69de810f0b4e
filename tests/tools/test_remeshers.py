# SPDX-License-Identifier: Apache-2.0
"""measurements/meshes/remeshers.py: its rows for hexad on a mesh of known shape. ACVD is not packaged, and is not run."""
import pathlib
import subprocess
import sys

import pytest

HERE = pathlib.Path(__file__).resolve().parents[2] / "measurements"
sys.path.insert(0, str(HERE / "common"))
import results  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service


def cube(path, cuts=8):
    """The surface of a cube, each side cut into squares of two triangles."""
    index, faces = {}, []
    for axis in range(3):
        for end in (0, cuts):
            for u in range(cuts):
                for v in range(cuts):
                    square = []
                    for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1)):
                        corner = [u + du, v + dv]
                        corner.insert(axis, end)
                        square.append(index.setdefault(tuple(corner), len(index)))
                    # axes that follow each other cyclically turn to the outside at the far end
                    square = square if (end > 0) == (axis != 1) else square[::-1]
                    faces += [(square[0], square[1], square[2]), (square[0], square[2], square[3])]
    path.write_text(f"OFF\n{len(index)} {len(faces)} 0\n" + "".join("%d %d %d\n" % at for at in index) +
                    "".join("3 %d %d %d\n" % face for face in faces))


def test_rows_of_hexad_on_a_cube(build, tmp_path):
    cube(tmp_path / "cube.off")
    output = tmp_path / "remeshers.csv"
    done = subprocess.run([sys.executable, HERE / "meshes/remeshers.py", "--worker", build / "hexad-worker", "--data", tmp_path,
                           "--meshes", "cube.off", "--counts", "600", "--runs", "1", "--output", output, "--commit", "here"],
                          env={"PATH": "/usr/bin:/bin"}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "HEXAD_ACVD" in done.stderr
    rows = results.read(output)
    assert [row["job"] for row in rows] == ["cube 600 hexad", "cube 600 hexad with mesh.ply"]
    for row in rows:
        assert (row["points"], row["commit"]) == ("600", "here")
        # the triangles are a cube: points on them are at most rounding away, and no place is far from all points
        assert float(row["residual_spacings"]) < 1e-3 and float(row["coverage"]) < 1
        assert float(row["hex_fraction"]) > 0.7 and float(row["cpu_s_least"]) > 0
    # the triangles are made after the points, which they do not change
    measured = ("hex_fraction", "edge_cv", "area_cv", "min_spacing_ratio")
    assert [rows[0][name] for name in measured] == [rows[1][name] for name in measured]


def test_a_folder_is_required(build, tmp_path):
    done = subprocess.run([sys.executable, HERE / "meshes/remeshers.py", "--worker", build / "hexad-worker", "--output", tmp_path / "out.csv"],
                          env={"PATH": "/usr/bin:/bin"}, capture_output=True, text=True)
    assert done.returncode == 1 and "HEXAD_SHARED" in done.stderr and not (tmp_path / "out.csv").exists()
