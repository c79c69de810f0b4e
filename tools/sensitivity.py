#!/usr/bin/env python3
"""Measures what each number of the schedules does: the effect of doubling and of halving it (doc/measured/sensitivity.md).

    tools/sensitivity.py --worker build/tools/tuned-worker --output doc/measured/sensitivity.md [--only NAME ...]

The worker is the usual one, linked with tools/tuned_schedule.c, which scales numbers by the environment HEXAD_SCHEDULE. All surfaces
are generated. A row has, for each case, the change of hex_fraction (hex) and of edge_cv in percent, and the ratio of sweeps times
points, which is the CPU time without its noise. Cases that a number does not change are left out.
"""
import argparse
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

import numpy

SEEDS = (1, 2, 3)
RESULTS = (0, 10, 11)
# Below these a change is no larger than that of another seed.
HEX_NOISE, CV_NOISE, WORK_NOISE = 0.004, 3, 0.02


def rough_sphere(path, subdivisions=4):
    """A sphere of 5 120 triangles whose vertices are off by 1 % of the radius at random, as of a scan."""
    golden = (1 + 5 ** 0.5) / 2
    points = [numpy.array(p, float) for p in
              [(-1, golden, 0), (1, golden, 0), (-1, -golden, 0), (1, -golden, 0), (0, -1, golden), (0, 1, golden),
               (0, -1, -golden), (0, 1, -golden), (golden, 0, -1), (golden, 0, 1), (-golden, 0, -1), (-golden, 0, 1)]]
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6), (7, 1, 8),
             (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    for _ in range(subdivisions):
        middle, finer = {}, []
        for face in faces:
            m = []
            for a, b in zip(face, face[1:] + face[:1]):
                key = min(a, b), max(a, b)
                if key not in middle:
                    middle[key] = len(points)
                    points.append(points[a] + points[b])
                m.append(middle[key])
            a, b, c = face
            finer += [(a, m[0], m[2]), (b, m[1], m[0]), (c, m[2], m[1]), tuple(m)]
            for k in m:
                points[k] /= numpy.linalg.norm(points[k])
        faces = finer
    noise = numpy.random.default_rng(1)
    points = [p / numpy.linalg.norm(p) * (1 + 0.01 * noise.standard_normal()) for p in points]
    path.write_text(f"OFF\n{len(points)} {len(faces)} 0\n" + "".join("%.9g %.9g %.9g\n" % tuple(p) for p in points) +
                    "".join("3 %d %d %d\n" % f for f in faces))


def box(path):
    corners = [(x, y, z) for x in (0, 2) for y in (0, 1) for z in (0, 1.5)]
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
    path.write_text("OFF\n8 12 0\n" + "".join("%g %g %g\n" % c for c in corners) + "".join("3 %d %d %d\n" % f for f in faces))


def cases(work):
    """Name, surface, members of sampling and of solver."""
    rough_sphere(work / "rough.off")
    box(work / "box.off")
    torus = {"analytic": {"shape": "torus", "major_radius": 0.3, "minor_radius": 0.12}}
    ball = {"shape": "sphere", "radius": 0.3}
    return {
        "torus": (torus, {"count": 20000}, {}),
        "gyroid": ({"analytic": {"shape": "gyroid", "period": 0.5}}, {"count": 4000}, {}),
        "graded torus": (torus, {"count": 6000, "curvature": {"ratio": 10}}, {}),
        "rough mesh": ({"mesh": {"path": str(work / "rough.off")}}, {"count": 6000}, {}),
        "CAD model": ({"mesh": {"path": str(work / "box.off")}}, {"count": 4000}, {}),
        "two spheres": ({"union": [{"analytic": {**ball, "center": [0.4, 0.5, 0.5]}}, {"analytic": {**ball, "center": [0.65, 0.5, 0.5]}}]},
                        {"count": 3000}, {}),
        "paper": ({"analytic": {"shape": "quartic"}}, {"count": 600}, {"method": "paper", "init": "random"}),
    }


def run(worker, case, tuning, work):
    """Means over the seeds of hex_fraction and edge_cv, and updates of particles in all; None: an error."""
    surface, sampling, solver = case
    found = []
    for seed in SEEDS:
        spec = {"version": 1, "surface": surface, "sampling": sampling, "output": {"preview": False},
                "solver": {"threads": 1, "seed": seed, **solver}, "limits": {"timeout_s": 120}}
        (work / "spec.json").write_text(json.dumps(spec))
        done = subprocess.run([worker, "run", work / "spec.json", "--output", work / "out"], capture_output=True,
                              env={**os.environ, "HEXAD_SCHEDULE": tuning})
        if done.returncode not in RESULTS:
            return None
        report = json.loads((work / "out" / "report.json").read_text())
        work_done = sum(r["sweeps"] * r["count"] for r in report["rounds"])
        found.append((report["quality"]["hex_fraction"], report["quality"]["edge_cv"], work_done))
    return numpy.mean(found, axis=0)


def effect(before, after):
    """A change in words; empty: within the noise."""
    if after is None:
        return "error"
    hexagons, cv, work = after[0] - before[0], 100 * (after[1] / before[1] - 1), after[2] / before[2]
    parts = [f"hex {hexagons:+.3f}"] * (abs(hexagons) > HEX_NOISE) + [f"cv {cv:+.0f} %"] * (abs(cv) > CV_NOISE)
    parts += [f"work {work:.2f}"] * (abs(work - 1) > WORK_NOISE)
    return ", ".join(parts)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", type=pathlib.Path, required=True)
    parser.add_argument("--output", type=pathlib.Path, required=True)
    parser.add_argument("--only", nargs="*", default=[], help="numbers whose names begin so")
    options = parser.parse_args()
    source = (pathlib.Path(__file__).parent / "tuned_schedule.c").read_text()
    names = [n for n in re.findall(r'(?:REAL|WHOLE)\([^"]*"([\w.]+)"\)', source) if not options.only or n.startswith(tuple(options.only))]
    with tempfile.TemporaryDirectory() as directory:
        work = pathlib.Path(directory)
        all_cases = cases(work)
        base = {name: run(options.worker, case, "", work) for name, case in all_cases.items()}
        lines = ["# What the numbers of the schedules do", "",
                 "Made by `make sensitivity` (`tools/sensitivity.py` says how): each number of `src/solver/schedule.c` is doubled and halved in all "
                 "schedules. Changes of `hex_fraction` below 0.004, of `edge_cv` below 3 % and of the work (updates of particles) below 2 % are left out: "
                 f"another seed makes such. Means of {len(SEEDS)} seeds.", "",
                 "| without a change | hex_fraction | edge_cv |", "|---|---:|---:|"]
        lines += [f"| {name} | {b[0]:.3f} | {b[1]:.3f} |" for name, b in base.items()]
        lines += ["", "| number | doubled | halved |", "|---|---|---|"]
        for name in names:
            cells = []
            for factor in (2, 0.5):
                told = [(case, effect(base[case], run(options.worker, members, f"{name}={factor}", work)))
                        for case, members in all_cases.items()]
                cells.append("; ".join(f"{case}: {what}" for case, what in told if what) or "no change")
            lines.append(f"| `{name}` | {cells[0]} | {cells[1]} |")
            print(lines[-1], flush=True)
    options.output.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    sys.exit(main())
