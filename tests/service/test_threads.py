# SPDX-License-Identifier: Apache-2.0
"""Results do not depend on the number of threads, nor on the processor's instructions: every file and every measure is the same."""
import json
import math
import os
import subprocess

import pytest

from label_shapes import Balls
from service import PATIENCE_S
from volumes import write_nrrd

TORUS = {"analytic": {"shape": "torus", "center": [0, 0, 0], "major_radius": 1, "minor_radius": 0.4}}
BOX = "".join(f"v {x} {y} {z}\n" for x in (0, 3) for y in (0, 2) for z in (0, 0.1)) + \
    "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
# Not every machine has every set: those it lacks are refused. The last one also makes the C library use its functions for processors
# without FMA, whose last bits differ.
WITHOUT_FMA = "portable, no FMA"
SETTINGS = [(1, "auto"), (2, "auto"), (3, "auto"), (8, "auto"), (3, "portable"), (2, "avx2"), (2, "avx512"), (1, WITHOUT_FMA)]
REFUSED = 2


def write_surfaces(folder):
    write_nrrd(folder / "balls.nrrd", Balls(24).labels)
    (folder / "box.obj").write_text(BOX)
    (folder / "bumps.obj").write_text(bumpy_torus(40, 20))


def bumpy_torus(around, across):
    """A closed mesh of curved triangles."""
    lines = []
    for k in range(around * across):
        u, v = 2 * math.pi * (k // across) / around, 2 * math.pi * (k % across) / across
        radius = 0.35 + 0.06 * math.sin(5 * u) * math.cos(3 * v)
        out = 1 + radius * math.cos(v)
        lines.append(f"v {out * math.cos(u):.9f} {out * math.sin(u):.9f} {radius * math.sin(v):.9f}\n")
    for k in range(around * across):
        corners = [(k // across + i) % around * across + (k % across + j) % across + 1 for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
        lines += ["f {} {} {}\n".format(*corners[:3]), "f {} {} {}\n".format(corners[0], *corners[2:])]
    return "".join(lines)


def run(build, folder, job, threads, isa):
    """The bytes of the files, and the measures; None if the machine lacks the instruction set."""
    where = folder / f"{threads} {isa}"
    spec = {"version": 1, **job, "output": {"mesh": True, "points_npz": True, "preview": False},
            "solver": {"isa": isa.partition(",")[0]}}
    more = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2"} if isa == WITHOUT_FMA else {}
    done = subprocess.run([build / "hexad-worker", "run", "-", "--output", where, "--threads", str(threads), "--input-root", folder],
                          input=json.dumps(spec), text=True, capture_output=True, timeout=PATIENCE_S, env={**os.environ, **more})
    if done.returncode == REFUSED and isa.startswith("avx"):
        return None
    assert done.returncode in (0, 10, 11), done.stderr
    report = json.loads((where / "report.json").read_text())
    assert report["diagnostics"]["threads"] == threads
    return {path.name: path.read_bytes() for path in where.iterdir() if path.suffix in (".ply", ".npz")}, report["quality"]


@pytest.mark.parametrize("surface, sampling", [
    (TORUS, {"count": 3000}),
    (TORUS, {"count": 1000, "alpha": {}}),
    (TORUS, {"count": 1000, "curvature": {"ratio": 4}}),
    (TORUS, {"count": 1000, "pattern": "blue_noise"}),
    ({"analytic": {"shape": "gyroid", "period": 0.5}}, {"count": 2000}),
    ({"mesh": {"path": "box.obj"}}, {"count": 1000}),
    ({"mesh": {"path": "bumps.obj"}}, {"count": 1000, "curvature": {"ratio": 4}}),
    ({"labels": {"path": "balls.nrrd"}}, {"count": 1000}),
], ids=["even", "amplitudes", "graded", "blue noise", "open", "mesh", "curved mesh", "labels"])
def test_results_do_not_depend_on_threads_or_the_processor(build, tmp_path, surface, sampling):
    write_surfaces(tmp_path)
    found = [run(build, tmp_path, {"surface": surface, "sampling": sampling}, *setting) for setting in SETTINGS]
    assert set(found[0][0]) >= {"points.ply", "points.npz"}
    for setting, other in zip(SETTINGS, found):
        assert other is None or other == found[0], setting
