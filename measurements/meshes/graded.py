#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Samples meshes with graded spacing by two builds, and writes how well the points keep to the request
(measurements/meshes/graded.md).

    measurements/meshes/graded.py --worker build/hexad-worker --reference OTHER/hexad-worker --output measurements/meshes/graded.md
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
            "solver": {"seed": seed, "threads": 1, **members.get("solver", {})}, "output": {"preview": False}}
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


def row(name, grading, which, found, outcome):
    return (f"| {name} | {grading} | {which} | {found[0]:.4f} | {found[1]:.4f} | {found[2]:.3f} | {found[3]:.3f} | "
            f"{outcome} | {found[4]:.1f} |")


def write(output, lines, missed, options):
    head = ["# Graded spacing on meshes", "",
            f"Written by `measurements/meshes/graded.py`: {options.count} points, {options.seeds} seed(s), one thread, by this build "
            "and by a reference build.", "",
            f"- curvature: `sampling.curvature` with a ratio of {RATIO}",
            f"- map: `sampling.grid`, a spacing that is {RATIO} times as wide at one end of the mesh as at the other",
            "- amplitudes: `sampling.alpha` with the method `paper`", "",
            "Exponent and CV compare the achieved spacing with the requested one ([report.md](../report.md#quality)) and are "
            "computed from points.ply. Amplitudes request no spacing, so the achieved spacing is compared with a power law "
            "of the amplitude. hex_fraction and coverage are the report's.", "",
            f"Bounds: the exponent is within {EXPONENT} of 1, or of the reference's with amplitudes; the CV is at most {CV} "
            f"above the reference's. Missed: {missed}.", "",
            "| mesh | grading | build | exponent | CV | hex_fraction | coverage | outcome | CPU s |",
            "|---|---|---|---|---|---|---|---|---|"]
    pathlib.Path(options.output).write_text("\n".join(head + lines) + "\n")


def main():
    parser = inputs.parser_of(__doc__.splitlines()[0])
    parser.add_argument("--reference", required=True)
    parser.add_argument("--count", type=int, default=10000)
    parser.add_argument("--seeds", type=int, default=1)
    options = inputs.arguments(parser)
    lines, missed = [], 0
    with tempfile.TemporaryDirectory() as scratch:
        work = pathlib.Path(scratch)
        made = patches.write(welded_torus(300, 150), work / "torus.off")
        for path in (made, *(pathlib.Path(options.data) / "meshes" / name for name in MESHES)):
            for grading, members in gradings(meshes.read(path), work).items():
                if options.only and not any(word in f"{path.name} {grading}" for word in options.only):
                    continue
                ours, theirs = (figures(os.path.abspath(worker), path, grading, members, options, work)
                                for worker in (options.worker, options.reference))
                wanted = theirs[0][0] if grading == "amplitudes" else 1
                missed += bool(abs(ours[0][0] - wanted) > EXPONENT or ours[0][1] > theirs[0][1] + CV)
                lines += [row(path.name, grading, which, *found)
                          for which, found in (("this", ours), ("reference", theirs))]
                write(options.output, lines, missed, options)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
