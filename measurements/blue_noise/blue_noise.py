#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures of the pattern blue_noise: distances on several surfaces, and spectra on a square (measurements/blue_noise/README.md).

    measurements/blue_noise/blue_noise.py --worker build/hexad-worker --output measurements/blue_noise/blue_noise.csv [--data DIRECTORY]

DIRECTORY, or HEXAD_SHARED, has the folder meshes. Spectra are mean periodograms of SEEDS point sets on the unit square, beside those of
Yuksel's sample elimination (2015) from five times as many random points. FILE_spectra.csv beside the output has them. Ends with 1 when
a bound is missed.
"""
import argparse
import json
import os
import pathlib
import resource
import subprocess
import sys
import tempfile

import numpy

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1] / folder) for folder in ("common", "packing")]
import coarse  # noqa: E402
import measure  # noqa: E402
import results  # noqa: E402

LEAST, RELATIVE, LATER, ANISOTROPY = 0.74, 1.05, 1.2, -8
TOLERANCE = 1e-3
SEEDS, SQUARE_COUNT = 10, 2000
SPHERE = {"analytic": {"shape": "sphere", "radius": 0.4}}
TORUS = {"analytic": {"shape": "torus", "major_radius": 0.3, "minor_radius": 0.2}}
GRADED = {"curvature": {"ratio": 2.5, "exponent": 1}}
COUNTS = (1000, 10000, 100000)
DISTANCES = ["row", "surface", "points", "pattern", "least_distance", "coverage_ratio", "hex_fraction", "sweeps", "outcome", "cpu_s"]
SPECTRA = ["sampler", "first_peak", "largest_later_maximum", "low_power", "anisotropy_db"]


def write_square(path):
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n")
    return {"mesh": {"path": str(path)}}


def run(worker, surface, where, seed=1, **sampling):
    """Report, directory and processor seconds of a job with one thread."""
    spec = {"version": 1, "surface": surface, "sampling": sampling, "solver": {"seed": seed, "threads": 1},
            "output": {"preview": False, "ply": {"properties": ["all"]}}}
    path, out = pathlib.Path(where) / "spec.json", pathlib.Path(where) / "out"
    path.write_text(json.dumps(spec))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([worker, "run", path, "--output", out], capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 10, 11):
        sys.exit(done.stderr)
    took = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return json.loads((out / "report.json").read_text()), out, took


def spectrum(sets):
    """Radial mean, variance and number of frequencies of rings of width 1 of the mean periodogram of point sets in the unit square.
    Frequencies of a coordinate axis, which the sides of the square disturb, are left out."""
    most = int(3.2 * len(sets[0]) ** 0.5)
    f = numpy.arange(-most, most + 1)
    power = 0
    for p in sets:
        x, y = (numpy.exp(-2j * numpy.pi * numpy.outer(p[:, axis], f)) for axis in (0, 1))
        power = power + abs(x.T @ y) ** 2 / len(p) / len(sets)
    fx, fy = numpy.meshgrid(f, f, indexing="ij")
    ring = numpy.rint(numpy.hypot(fx, fy)).astype(int)
    inside = (ring <= most) & (fx != 0) & (fy != 0)
    count = numpy.bincount(ring[inside])
    mean = numpy.bincount(ring[inside], power[inside]) / numpy.maximum(count, 1)
    square = numpy.bincount(ring[inside], power[inside] ** 2) / numpy.maximum(count, 1)
    return mean, (square - mean ** 2) * count / numpy.maximum(count - 1, 1), count


def rate(sets):
    """The height of the first peak, the largest maximum after it, the mean power below half of the principal frequency, and the anisotropy in dB:
    the mean over rings of variance over squared mean."""
    mean, variance, count = spectrum(sets)
    first = int(numpy.argmax(mean[:int(1.6 * len(sets[0]) ** 0.5)]))
    trough = first + int(numpy.argmin(mean[first:2 * first]))
    low = numpy.average(mean[1:first // 2 + 1], weights=count[1:first // 2 + 1])
    anisotropy = 10 * numpy.log10((variance[5:] / mean[5:] ** 2).mean())
    return mean[first], mean[trough:].max(), low, anisotropy


def distance_row(name, count, pattern, report, took):
    q = report["quality"]
    relative = q["coverage"] / q["min_spacing_ratio"]
    good = q["min_spacing_ratio"] >= (1 - TOLERANCE) * LEAST and relative <= (1 + TOLERANCE) * RELATIVE
    row = [f"{name} {count} {pattern}", name, count, pattern, f"{q['min_spacing_ratio']:.3f}", f"{relative:.3f}", f"{q['hex_fraction']:.3f}",
           report["sweeps_total"], report["outcome"], f"{took:.2f}"]
    return row, good or pattern == "hexagonal"


def distance_rows(worker, data, where):
    surfaces = [("sphere", SPHERE, {}), ("torus, graded", TORUS, GRADED)]
    surfaces += [(f"{name}.{kind}", {"mesh": {"path": str(data / "meshes" / f"{name}.{kind}")}}, {})
                 for name, kind in (("fertility", "off"), ("armadillo", "obj"), ("fandisk", "off")) if data]
    for name, surface, grading in surfaces:
        for count in COUNTS:
            for pattern in ("blue_noise", "hexagonal"):
                report, _, took = run(worker, surface, where, count=count, pattern=pattern, **grading)
                yield distance_row(name, count, pattern, report, took)


def square_rows(worker, where):
    surface = write_square(pathlib.Path(where) / "square.obj")
    h = measure.ideal_spacing(1, SQUARE_COUNT)
    ours, others, bad = [], [], 0
    for seed in range(1, SEEDS + 1):
        report, out, _ = run(worker, surface, where, seed, count=SQUARE_COUNT, pattern="blue_noise")
        bad += not distance_row("", 0, "blue_noise", report, 0)[1]
        ours.append(measure.read_ply(out / "points.ply").position[:, :2])
        drawn = numpy.random.default_rng(seed).random((5 * SQUARE_COUNT, 2))
        others.append(drawn[coarse.eliminate(drawn, SQUARE_COUNT, h)])
    rows = []
    for name, sets in (("blue_noise", ours), ("sample elimination", others)):
        first, later, low, anisotropy = rate(sets)
        rows.append((later, low, anisotropy, [name, f"{first:.2f}", f"{later:.3f}", f"{low:.3f}", f"{anisotropy:.1f}"]))
    mine, reference = rows
    bad += mine[0] > LATER or mine[1] > reference[1] or mine[2] > ANISOTROPY
    return [row[3] for row in rows], bad


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True)
    parser.add_argument("--output", required=True, type=pathlib.Path)
    parser.add_argument("--data", default=os.environ.get("HEXAD_SHARED"))
    options = parser.parse_args()
    worker, data = os.path.abspath(options.worker), options.data and pathlib.Path(options.data)
    with tempfile.TemporaryDirectory() as where:
        spectra, bad = square_rows(worker, where)
        distances = []
        for row, good in distance_rows(worker, data, where):
            print(", ".join(f"{key} {value}" for key, value in zip(DISTANCES[1:], row[1:])), flush=True)
            distances.append(row)
            bad += not good
    for row in spectra:
        print(", ".join(f"{key} {value}" for key, value in zip(SPECTRA, row)))
    print(f"missed bounds: {bad}")
    results.write(options.output, DISTANCES, distances)
    results.write(options.output.with_name(f"{options.output.stem}_spectra.csv"), SPECTRA, spectra)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
