#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Samples meshes with graded spacing by two builds, and writes how well the points keep to the request
(measurements/meshes/graded.csv).

    measurements/meshes/graded.py --worker build/hexad-worker --reference OTHER/hexad-worker --output measurements/meshes/graded.csv
                    [--data DIRECTORY] [--only WORD ...] [--count 10000] [--seeds 1]

DIRECTORY, or HEXAD_SHARED, has the folder meshes. Exponent and CV are computed here, for both builds in the same way,
from the request and the Voronoi cells of points.ply. Medians over the seeds. Ends with 1 when a bound is missed.
"""
import json
import os
import pathlib
import resource
import subprocess
import sys
import tempfile

import numpy

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1] / folder) for folder in ("common", "inputs")]
import inputs  # noqa: E402
import measure  # noqa: E402
import meshes  # noqa: E402
import patches  # noqa: E402
import results  # noqa: E402

MESHES = ("spot.obj", "fertility.off", "bunny_pmp.off", "armadillo.obj")
RATIO = 10
# Of the exponent from 1 (amplitudes: from the reference's), and of the CV above the reference's.
EXPONENT, CV = 0.01, 0.003


def torus(u, v):
    """A torus whose curvature varies by 9 to 1."""
    u, v = 2 * numpy.pi * u, 2 * numpy.pi * v
    across = 1 + 0.91 * numpy.cos(v)
    return numpy.stack([across * numpy.cos(u), across * numpy.sin(u), 0.91 * numpy.sin(v)], 1)


def welded_torus(across, along):
    """The torus as a closed mesh."""
    places, triangles = patches.grid(torus, across, along)
    _, first, number = numpy.unique(numpy.round(places, 9), axis=0, return_index=True, return_inverse=True)
    return meshes.Mesh(places[first], number.ravel()[triangles])


def gradings(mesh, work):
    """The members of the spec for each way of grading."""
    return {"curvature": {"sampling": {"curvature": {"ratio": RATIO}}},
            "map": {"sampling": {"grid": patches.write_map(mesh, work / "map.vdb", RATIO)}},
            "amplitudes": {"sampling": {"alpha": {}}, "solver": {"method": "paper"}}}


def run(worker, path, members, count, seed, work):
    """Points, report and processor seconds of a job."""
    spec = {"version": 1, "surface": {"mesh": {"path": str(path)}},
            "sampling": {"count": count, **members["sampling"]},
            "solver": {"seed": seed, "threads": 1, **members.get("solver", {})}, "output": {"preview": False, "ply": {"properties": ["all"]}}}
    spec_path, out = work / "spec.json", work / "out"
    spec_path.write_text(json.dumps(spec))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([worker, "run", str(spec_path), "--output", str(out)], capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 10, 11):
        sys.exit(f"{worker}, {path}: {done.stderr}")
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return measure.read_ply(out / "points.ply"), json.loads((out / "report.json").read_text()), spent


def keeping(points, by_amplitudes):
    """Exponent and CV of the achieved spacing against the requested one, or against the amplitudes by a power law."""
    cell = measure.voronoi_areas(points, measure.triangulate(points))
    local = numpy.sqrt(2 * numpy.maximum(cell, 0) / numpy.sqrt(3))
    wanted = points.alpha if by_amplitudes else points.spacing
    sized = local > 0
    local, wanted = local[sized], wanted[sized]
    exponent, offset = numpy.polyfit(numpy.log(wanted), numpy.log(local), 1)
    law = numpy.exp(offset) * wanted ** exponent if by_amplitudes else wanted
    return float(exponent), float((local / law).std() / (local / law).mean())


def figures(worker, path, grading, members, options, work):
    """Medians over the seeds: exponent, CV, hex_fraction, coverage, CPU seconds; and the outcomes."""
    found, outcomes = [], set()
    for seed in range(1, options.seeds + 1):
        points, report, spent = run(worker, path, members, options.count, seed, work)
        quality = report["quality"]
        found.append([*keeping(points, grading == "amplitudes"), quality["hex_fraction"], quality["coverage"],
                      spent])
        outcomes.add(report["outcome"].replace("_", " "))
    return numpy.median(numpy.array(found, float), axis=0), ", ".join(sorted(outcomes))


HEADER = ("job", "mesh", "grading", "build", "exponent", "spacing_cv", "hex_fraction", "coverage", "outcome", "cpu_s", "missed")


def row(name, grading, build, found, outcome, missed):
    return [f"{name} {grading} {build}", name, grading, build, f"{found[0]:.4f}", f"{found[1]:.4f}", f"{found[2]:.3f}", f"{found[3]:.3f}",
            outcome, f"{found[4]:.1f}", " ".join(missed)]


def missed_bounds(ours, theirs, grading):
    """Names of the columns of this build that miss a bound."""
    wanted = theirs[0] if grading == "amplitudes" else 1
    return (["exponent"] if abs(ours[0] - wanted) > EXPONENT else []) + (["spacing_cv"] if ours[1] > theirs[1] + CV else [])


def main():
    parser = inputs.parser_of(__doc__.splitlines()[0])
    parser.add_argument("--reference", required=True)
    parser.add_argument("--count", type=int, default=10000)
    parser.add_argument("--seeds", type=int, default=1)
    options = inputs.arguments(parser)
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        work = pathlib.Path(scratch)
        made = patches.write(welded_torus(300, 150), work / "torus.off")
        for path in (made, *(pathlib.Path(options.data) / "meshes" / name for name in MESHES)):
            for grading, members in gradings(meshes.read(path), work).items():
                if options.only and not any(word in f"{path.name} {grading}" for word in options.only):
                    continue
                ours, theirs = (figures(os.path.abspath(worker), path, grading, members, options, work)
                                for worker in (options.worker, options.reference))
                rows += [row(path.name, grading, "this", *ours, missed_bounds(ours[0], theirs[0], grading)),
                         row(path.name, grading, "reference", *theirs, [])]
                results.write(options.output, HEADER, rows)
                print(*rows[-2], sep=", ", flush=True)
    missed = [row[0] for row in rows if row[-1]]
    print(f"{len(rows) // 2} jobs, {len(missed)} of them miss bounds", *missed, sep="\n")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
