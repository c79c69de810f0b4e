#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Regularity and cost of jobs on smooth surfaces, on meshes with detail or creases, and of graded ones, at 1 000 to 100 000 points.

    measurements/speed/limits.py --worker build/hexad-worker --output measurements/speed/limits.csv [--data FOLDER] [--count N ...]
                           [--runs N] [--only WORD ...]

FOLDER has the folder meshes; without it, or HEXAD_SHARED, meshes are left out. Each job has one thread and no preview. hex_fraction and
edge_cv are those of the report, with the default seed. Of jobs graded 10:1 by curvature, requested_ratio is the largest requested
spacing over the least, and achieved_ratio the largest spacing_local of points.ply over the least. cpu_s is of the whole process, the
least of the runs.
"""
import argparse
import json
import os
import pathlib
import resource
import shutil
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))

import results  # noqa: E402
from measure import read_ply  # noqa: E402

RESULTS = (0, 10, 11)  # exit codes with points
COUNTS = (10 ** 3, 10 ** 4, 10 ** 5)
FIRST_JOB = 3000  # points of README's first job
SMOOTH = {"sphere": {"shape": "sphere", "radius": 1}, "torus": {"shape": "torus", "major_radius": 1, "minor_radius": 0.4},
          "rounded box": {"shape": "box", "half_size": [1, 0.75, 0.5], "rounding": 0.25}, "quartic": {"shape": "quartic", "r": 0.13}}
MESHES = {"detail": ("bunny_pmp.off", "armadillo.obj", "dragon_100k.obj"), "creases": ("fandisk.off", "42400-IDGH.stl")}
HEADER = ["row", "kind", "points", "outcome", "hex_fraction", "edge_cv", "requested_ratio", "achieved_ratio", "cpu_s", "cpu_us_per_point"]
GRADED = {"shape": "ellipsoid", "radii": [1, 0.6, 0.325]}, {"curvature": {"ratio": 10, "exponent": 1}}


def jobs(worker, folder, data, counts):
    """(row, kind, surface, sampling)."""
    for name, shape in SMOOTH.items():
        yield from ((f"{name} {count}", "smooth", {"analytic": shape}, {"count": count}) for count in counts)
    shape, curvature = GRADED
    yield from ((f"graded ellipsoid {count}", "graded", {"analytic": shape}, {"count": count, **curvature}) for count in counts)
    trefoil = folder / "trefoil.vdb"
    subprocess.run([worker, "make-example", trefoil], check=True, stdout=subprocess.DEVNULL)
    yield f"trefoil {FIRST_JOB}", "smooth", {"vdb": {"path": str(trefoil)}}, {"count": FIRST_JOB}
    for kind, names in MESHES.items() if data else ():
        for name in names:
            surface = {"mesh": {"path": str(data / "meshes" / name)}}
            yield from ((f"{pathlib.Path(name).stem} {count}", kind, surface, {"count": count}) for count in counts)


def run(worker, surface, sampling, folder):
    """The report of a job, its achieved spacings, and its CPU seconds."""
    spec, out = folder / "spec.json", folder / "out"
    spec.write_text(json.dumps({"version": 1, "surface": surface, "sampling": sampling, "solver": {"threads": 1},
                                "output": {"preview": False, "ply": {"properties": ["all"]}}}))
    shutil.rmtree(out, ignore_errors=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([worker, "run", spec, "--output", out], capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in RESULTS:
        raise SystemExit(done.stderr)
    report = json.loads((out / "report.json").read_text())
    local = read_ply(out / "points.ply").columns["spacing_local"]
    return report, local, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measure(options, folder):
    for row, kind, surface, sampling in jobs(options.worker, folder, options.data, options.count):
        if options.only and not any(word in row for word in options.only):
            continue
        found = [run(options.worker, surface, sampling, folder) for _ in range(options.runs)]
        report, local, cpu = found[0][0], found[0][1], min(f[2] for f in found)
        grading = report.get("grading")
        requested = round(grading["largest_spacing"] / grading["least_spacing"], 2) if grading else None
        achieved = round(local.max() / local.min(), 2) if grading else None
        line = [row, kind, sampling["count"], report["outcome"].replace("_", " "), round(report["quality"]["hex_fraction"], 4),
                round(report["quality"]["edge_cv"], 4), requested, achieved, round(cpu, 3), round(1e6 * cpu / sampling["count"], 2)]
        print(*line, flush=True)
        yield line


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True, type=lambda p: pathlib.Path(p).resolve())
    parser.add_argument("--output", required=True, type=pathlib.Path)
    parser.add_argument("--data", type=pathlib.Path, default=os.environ.get("HEXAD_SHARED") and pathlib.Path(os.environ["HEXAD_SHARED"]))
    parser.add_argument("--count", nargs="+", type=int, default=COUNTS)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=[])
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        results.write(options.output, HEADER, list(measure(options, pathlib.Path(folder))))


if __name__ == "__main__":
    main()
