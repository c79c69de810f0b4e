#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Solves every mesh of a collection with two workers and compares the points by one set of definitions (doc/measured/builds.md).

    tools/compare_builds.py --worker build/hexad-worker --reference WORKER --work FOLDER --output PAGE [--data DIRECTORY]
                            [--only WORD ...] [--count 5000] [--seeds 1 2 3] [--seconds N]

DIRECTORY, or HEXAD_SHARED, has the folders meshes and cases. Reports of different builds define their measures differently, so all
measures are computed from the triangles of the file and the points (tools/mesh_measures.py). The outcome is computed from these
measures by the bounds of doc/report.md; `not_converged` is also the outcome if the build's report has it. Every file is solved with
the first seed; a file that is worse in any measure is solved with all seeds, and is worse if the means differ by the bound and the standard
error of their difference.

FOLDER keeps the measures of each result, so that a comparison can be made in pieces: with --seconds no result is begun after that
time, and the exit is 3 until all are there. Defaults of the spec, one thread.
"""
import dataclasses
import json
import os
import pathlib
import sys
import tempfile
import time

import numpy

import inputs
import measure
import mesh_measures
import meshes

FOLDERS = ("meshes", "cases")
ORDER = ("converged", "unresolved", "not converged", "error")  # from the best
# A measure is worse if it differs by more than this; `True`: a larger value is better.
BOUNDS = (("hex_fraction", 0.005, True), ("min_spacing_ratio", 0.02, True), ("coverage", 0.02, False), ("max_residual", 1e-4, False))
# Longest edge of the small triangles that the measures are made with, in spacings. On spot.obj half of it
# changes hex_fraction by 0.0002 and coverage by 0.005, and takes three times as long.
FINENESS = 0.25
NO_AREA = 1e-9  # twice the area over the square of the longest side
SHOWN = (("hex_fraction", ".3f"), ("min_spacing_ratio", ".2f"), ("close_share", ".2%"), ("coverage", ".2f"), ("missing_share", ".2%"),
         ("max_residual", ".1e"))


def with_area(mesh):
    """The mesh without the triangles whose area is that of rounding."""
    corner = mesh.vertices[mesh.triangles]
    longest = numpy.linalg.norm(corner - numpy.roll(corner, 1, axis=1), axis=2).max(axis=1)
    return meshes.Mesh(mesh.vertices, mesh.triangles[2 * mesh.areas > NO_AREA * longest ** 2])


class Build:
    def __init__(self, worker, work):
        self.worker, self.mark = os.path.abspath(worker), inputs.mark_of(worker).split()[1].rstrip(".")
        self.kept = work / self.mark
        self.kept.mkdir(parents=True, exist_ok=True)

    def has(self, path, seed):
        return (self.kept / f"{path.name}.{seed}.json").exists()

    def result(self, path, seed, count):
        """What is known of a result: the outcome, the reasons of the report, the measures, CPU seconds; of an error its message."""
        kept = self.kept / f"{path.name}.{seed}.json"
        if not kept.exists():
            kept.write_text(json.dumps(self.solved(path, seed, count)))
        return json.loads(kept.read_text())

    def solved(self, path, seed, count):
        with tempfile.TemporaryDirectory() as folder:
            case = inputs.Case(path, "mesh", pathlib.Path(folder), self.worker)
            error, report = case.run({}, count, seed)
            if error:
                return {"outcome": "error", "why": f"{error['code']}: {error['message']}".replace(str(path.parent) + "/", "")}
            points = measure.read_ply(pathlib.Path(folder) / "out" / "points.ply")
            found = mesh_measures.measure(with_area(meshes.read(path)), points.position, points.spacing, FINENESS)
            why, outcome = found.failed(), "unresolved" if found.failed() else "converged"
            if found.max_residual > inputs.RESIDUAL:
                why, outcome = [*why, "max_residual"], "not converged"
            if report["outcome"] == "not_converged":
                why, outcome = [*why, "by its report"], "not converged"
            values = {k: v for k, v in dataclasses.asdict(found).items() if not isinstance(v, numpy.ndarray)}
            return {"outcome": outcome, "why": ", ".join(why), "cpu_s": case.processor_s, **values}


def worse(reference, own):
    """The names of what is worse; results are lists of one and more seeds, whose means are compared. The bound is increased by the standard
    error of the difference. Of a reference whose points are off the surface only the outcome is compared."""
    found = []
    if max(ORDER.index(r["outcome"]) for r in own) > max(ORDER.index(r["outcome"]) for r in reference):
        found.append("outcome")
    if any(r["outcome"] == "error" for r in [*own, *reference]) or max(r["max_residual"] for r in reference) > inputs.RESIDUAL:
        return found
    for name, bound, larger in BOUNDS:
        before, after = ([r[name] for r in results] for results in (reference, own))
        error = numpy.sqrt((numpy.var(before, ddof=1) + numpy.var(after, ddof=1)) / len(own)) if len(own) > 1 else 0
        difference = numpy.mean(after) - numpy.mean(before)
        if (-difference if larger else difference) > bound + error:
            found.append(name)
    return found


def text_of(result, name, form):
    return format(result[name], form) if name in result else ""


def row(name, seed, reference, own, words):
    outcomes = [r["outcome"] + (f" ({r['why']})" if r["why"] else "") for r in (reference, own)]
    cells = [name, str(seed), " / ".join(outcomes)]
    for key, form in (*SHOWN, ("cpu_s", ".1f")):
        cells.append(f"{text_of(reference, key, form)} / {text_of(own, key, form)}")
    return "| " + " | ".join(inputs.cell(c) for c in [*cells, ", ".join(words)]) + " |"


HEAD = ("file", "seed", "outcome", *(name for name, _ in SHOWN), "CPU s", "worse")


def table(rows):
    return ["| " + " | ".join(HEAD) + " |", "|---" * len(HEAD) + "|", *rows]


def page(options, found, missing):
    """`found`: {name: [(seed, reference's result, own result)]}; `missing`: names of files without results."""
    first = [row(name, *results[0], worse([results[0][1]], [results[0][2]])) for name, results in found.items()]
    again = {name: results for name, results in found.items() if len(results) > 1}
    verdicts = {name: worse(*([r[k] for r in results] for k in (1, 2))) for name, results in again.items()}
    bad = [name for name, words in verdicts.items() if words]
    lines = ["# Two builds by the same measures", "",
             f"`tools/compare_builds.py`: {options.name} before the stroke, the present build after it. {len(found)} meshes, "
             f"{options.count} points, defaults, one thread. For both builds, the measures are computed from the triangles of the file and the "
             "points (`tools/mesh_measures.py`), and the outcome from these measures. `not converged` is also the outcome "
             "if the build's own report has it.", "",
             "A row is worse if its outcome is worse, if hex_fraction is more than 0.005 lower, min_spacing_ratio more than 0.02 lower, coverage "
             "more than 0.02 higher, or the largest distance from the triangles more than 1e-4 higher. If the points of the reference are off "
             "the surface, because it read the file differently, only the outcome is compared. "
             f"{len(again)} files are worse with the first seed. For these, the means of {len(options.seeds)} seeds are compared, and the "
             f"bounds are increased by the standard error. {len(bad)} files are worse then: "
             + (", ".join(f"{name} ({', '.join(verdicts[name])})" for name in bad) or "none") + "."]
    if missing:
        lines += ["", f"Not compared yet: {', '.join(missing)}."]
    lines += ["", "## First seed", "", *table(first)]
    if again:
        lines += ["", "## All seeds of the files that are worse with the first seed", ""]
        lines += table([row(name, *result, verdicts[name]) for name, results in again.items() for result in results])
    return "\n".join(lines) + "\n"


def main():
    parser = inputs.parser_of(__doc__.splitlines()[0])
    parser.add_argument("--reference", required=True)
    parser.add_argument("--name", default="the reference", help="what the page calls the reference")
    parser.add_argument("--work", required=True, type=pathlib.Path)
    parser.add_argument("--count", type=int, default=5000)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--seconds", type=float, default=float("inf"))
    options = inputs.arguments(parser)
    end = time.monotonic() + options.seconds
    reference, own = Build(options.reference, options.work), Build(options.worker, options.work)
    paths = [p for folder in FOLDERS for p in inputs.files(pathlib.Path(options.data), folder) if p.suffix.lower() in inputs.READ_HERE]
    found = {}

    def both(path, seed):
        if time.monotonic() > end and not (reference.has(path, seed) and own.has(path, seed)):
            return None
        return seed, reference.result(path, seed, options.count), own.result(path, seed, options.count)

    missing = []
    for path in [p for p in paths if not options.only or any(word in str(p) for word in options.only)]:
        result = both(path, options.seeds[0])
        if result is None:
            missing.append(path.name)
            continue
        found[path.name] = [result]
        print(row(path.name, *result, worse([result[1]], [result[2]])), file=sys.stderr, flush=True)
    for path in paths:
        results = found.get(path.name)
        if not results or not worse([results[0][1]], [results[0][2]]):
            continue
        more = [both(path, seed) for seed in options.seeds[1:]]
        if None in more:
            missing.append(f"{path.name} (all seeds)")
            continue
        results += more
    pathlib.Path(options.output).write_text(page(options, found, missing))
    return 3 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
