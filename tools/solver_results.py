#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Solves the same jobs with two workers and compares order, coverage, outcome and CPU time (doc/measured/solver.md).

    tools/solver_results.py --worker build/hexad-worker --reference WORKER --data DIRECTORY --output PAGE [--only WORD ...]

DIRECTORY has the folders meshes, vdb and volumes. Each job runs once with each worker, one after the other, with one thread and seed 1.
If a measure is outside of its bound then, seeds 2 and 3 run as well, and the means of all three are compared.
Measures of meshes are computed from the file's triangles and the points (tools/mesh_measures.py), for both builds alike; those of
formulas, level sets, volumes and labels are the reports'. Exit status 1: a bound is missed.
"""
import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

import levelsets
import measure
import mesh_measures
import meshes
import sequence
from compare_builds import FINENESS, ORDER, with_area

RESULTS = {0: "converged", 11: "unresolved", 10: "not converged"}
# hex_fraction may be lower by this on shapes without noise and on others; the other measures may be larger by WORSE; CPU ratios.
HEX_CLEAN, HEX_OTHER, WORSE, CPU_MEDIAN, CPU_LARGEST = 0.005, 0.01, 0.10, 1.1, 1.3
LOWER_IS_BETTER = ("edge_cv", "energy_excess", "coverage")
SHOWN = (("hex_fraction", ".3f"), ("edge_cv", ".4f"), ("energy_excess", ".4f"), ("coverage", ".3f"))
GRADED = {"ratio": 10}


def jobs(data, work):
    """Name, whether the shape is without noise, surface, sampling, solver."""
    torus, ball = work / "torus.vdb", work / "sphere.vdb"
    levelsets.write_torus(1.0, 0.4, 0.02, torus)
    levelsets.write_torus(1e-9, 0.7, 0.02, ball)
    for count in (1000, 100000, 1000000):
        yield f"torus, level set, {count}", True, {"vdb": {"path": str(torus)}}, {"count": count}, {}
        yield f"sphere, level set, {count}", True, {"vdb": {"path": str(ball)}}, {"count": count}, {}
    quartic = {"analytic": {"shape": "quartic"}}
    for name, alpha in (("alpha 0", None), ("d = 1", 1), ("d = 3", 3)):
        sampling = {"count": 1000, **({"alpha": {"d": alpha}} if alpha else {})}
        yield f"quartic, paper, {name}", True, quartic, sampling, {"method": "paper"}
    yield "torus graded 10:1", True, {"analytic": {"shape": "torus", "major_radius": 0.3, "minor_radius": 0.12}}, \
        {"count": 10000, "curvature": GRADED}, {}
    for name in ("bunny_pmp.off", "armadillo.obj", "dragon_100k.obj", "fertility.off", "fandisk.off"):
        for count in (10000, 50000):
            for graded in (False, True):
                sampling = {"count": count, **({"curvature": GRADED} if graded else {})}
                yield f"{name}, {count}{', graded' * graded}", False, {"mesh": {"path": str(data / "meshes" / name)}}, sampling, {}
    for name, isovalue in (("wdas_cloud_sixteenth.vdb", 0.2), ("smoke1_half.vdb", 0.3)):
        for count in (100000, 1000000):
            cloud = {"path": str(data / "vdb" / name), "grid": "density", "isovalue": isovalue}
            yield f"{name}, {count}", False, {"vdb": cloud}, {"count": count}, {}
    yield "labels of frogtissue.mhd", False, {"labels": {"path": str(data / "volumes" / "frogtissue.mhd")}}, {"count": 50000}, {}


def run(worker, spec, out, more=()):
    """Report or None, CPU seconds, outcome."""
    child = subprocess.Popen([worker, "run", "-", "--output", out, *more], stdin=subprocess.PIPE, stderr=subprocess.PIPE,
                             stdout=subprocess.DEVNULL)
    child.stdin.write(json.dumps(spec).encode())
    child.stdin.close()
    told = child.stderr.read().decode()
    _, status, usage = os.wait4(child.pid, 0)
    code = child.returncode = os.waitstatus_to_exitcode(status)
    seconds = usage.ru_utime + usage.ru_stime
    if code not in RESULTS:
        return None, seconds, "error: " + (told.strip().splitlines() or [str(code)])[-1][:80]
    return json.loads((out / "report.json").read_text()), seconds, RESULTS[code]


def measures_of(report, surface, out):
    quality = report["quality"]
    found = {name: quality.get(name) for name, _ in SHOWN}
    if "mesh" in surface:
        points = measure.read_ply(out / "points.ply")
        own = mesh_measures.measure(with_area(meshes.read(pathlib.Path(surface["mesh"]["path"]))), points.position, points.spacing, FINENESS)
        found = {name: getattr(own, name, None) for name, _ in SHOWN}
    return found


def result(worker, seed, surface, sampling, solver):
    spec = {"version": 1, "surface": surface, "sampling": sampling, "solver": {"threads": 1, "seed": seed, **solver},
            "output": {"preview": False}}
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "out"
        report, seconds, outcome = run(worker, spec, out)
        return {"outcome": outcome, "cpu_s": seconds, **(measures_of(report, surface, out) if report else {})}


def sequence_result(worker, seed, work):
    """Three frames of a torus that moves, coherent: the worst measures, all CPU seconds."""
    case = {**sequence.CASES["torus"], "frames": range(1, 4)}
    surface = sequence.surface_of("moving", case, None, work)
    spec = {"version": 1, "surface": surface, "sampling": case["sampling"], "solver": {"threads": 1, "seed": seed},
            "output": {"preview": False}, "queue": {"frames": "1-3", "coherent": True}}
    with tempfile.TemporaryDirectory() as folder:
        previous, found = None, []
        for frame in (1, 2, 3):
            out = pathlib.Path(folder) / str(frame)
            report, seconds, outcome = run(worker, spec, out, ["--frame", str(frame), *(["--previous", previous] if previous else [])])
            if not report:
                return {"outcome": outcome, "cpu_s": seconds}
            found.append({"outcome": outcome, "cpu_s": seconds, **measures_of(report, surface, out)})
            previous = out
    worst = {name: (min if name == "hex_fraction" else max)(f[name] for f in found) for name, _ in SHOWN}
    return {**worst, "outcome": worst_outcome(found), "cpu_s": sum(f["cpu_s"] for f in found)}


def worst_outcome(found):
    return max((f["outcome"] for f in found), key=lambda outcome: ORDER.index(outcome) if outcome in ORDER else len(ORDER))


def mean(found):
    """The means of the measures of several seeds, and the worst outcome."""
    means = {}
    for name in [*(name for name, _ in SHOWN), "cpu_s"]:
        values = [f[name] for f in found if f.get(name) is not None]
        means[name] = statistics.mean(values) if values else None
    return {**means, "outcome": worst_outcome(found)}


def missed(clean, before, after):
    """The names of what is worse than the bounds."""
    found = []
    if after["outcome"] not in ORDER or (before["outcome"] in ORDER and ORDER.index(after["outcome"]) > ORDER.index(before["outcome"])):
        found.append("outcome")
    if after["cpu_s"] > CPU_LARGEST * before["cpu_s"]:
        found.append("CPU")
    if before.get("hex_fraction") is None or after.get("hex_fraction") is None:
        return found
    if after["hex_fraction"] < before["hex_fraction"] - (HEX_CLEAN if clean else HEX_OTHER):
        found.append("hex_fraction")
    return found + [n for n in LOWER_IS_BETTER if before.get(n) and after.get(n) is not None and after[n] > (1 + WORSE) * before[n]]


def row(name, before, after, words):
    cells = [name, f"{before['outcome']} / {after['outcome']}"]
    for key, form in SHOWN:
        cells.append(" / ".join(format(r[key], form) if r.get(key) is not None else "–" for r in (before, after)))
    cells += [f"{before['cpu_s']:.2f} / {after['cpu_s']:.2f}", f"{after['cpu_s'] / before['cpu_s']:.2f}", ", ".join(words)]
    return "| " + " | ".join(cells) + " |"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True)
    parser.add_argument("--reference", required=True)
    parser.add_argument("--data", type=pathlib.Path, required=True)
    parser.add_argument("--output", type=pathlib.Path)
    parser.add_argument("--only", nargs="*", default=[], help="jobs whose names contain a word")
    parser.add_argument("--name", default="the reference", help="what the page calls the reference")
    options = parser.parse_args()
    options.worker, options.reference = os.path.abspath(options.worker), os.path.abspath(options.reference)
    head = ["job", "outcome", *(name for name, _ in SHOWN), "CPU s", "ratio", "worse than the bound"]
    rows, ratios, bad = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"], [], 0
    print("\n".join(rows), flush=True)
    with tempfile.TemporaryDirectory() as folder:
        work = pathlib.Path(folder)
        all_jobs = [(name, clean, lambda worker, seed, s=surface, p=sampling, v=solver: result(worker, seed, s, p, v))
                    for name, clean, surface, sampling, solver in jobs(options.data, work)]
        all_jobs.append(("sequence of three frames", True, lambda worker, seed: sequence_result(worker, seed, work)))
        for name, clean, solve in all_jobs:
            if options.only and not any(word in name for word in options.only):
                continue
            before, after = solve(options.reference, 1), solve(options.worker, 1)
            words = missed(clean, before, after)
            if words:
                before, after = (mean([first, solve(worker, 2), solve(worker, 3)])
                                 for first, worker in ((before, options.reference), (after, options.worker)))
                words, name = missed(clean, before, after), name + ", three seeds"
            bad += bool(words)
            ratios.append(after["cpu_s"] / before["cpu_s"])
            rows.append(row(name, before, after, words))
            print(rows[-1], flush=True)
    told = (f"CPU: median {statistics.median(ratios):.2f} (bound {CPU_MEDIAN}), largest {max(ratios):.2f} (bound {CPU_LARGEST}). "
            f"Rows with something worse than its bound: {bad} of {len(ratios)}.")
    print(told)
    if options.output:
        options.output.write_text("\n".join(
            ["# The solver beside an earlier build", "",
             f"Written by `tools/solver_results.py`: {options.name} before the slash, the present build after it. One thread, seed 1; where a measure "
             "is outside of its bound with this seed, the means of seeds 1 to 3. Measures of meshes are "
             "computed from the triangles of the file and the points for both builds alike; the others are those of the reports.", "",
             f"Bounds: hex_fraction not lower by more than {HEX_CLEAN} on formulas and level sets and {HEX_OTHER} elsewhere, edge_cv, energy_excess "
             f"and coverage not larger by more than {WORSE:.0%}, the outcome not worse, CPU at most {CPU_LARGEST} times.", "", told, "", *rows]) + "\n")
    return bad > 0 or statistics.median(ratios) > CPU_MEDIAN


if __name__ == "__main__":
    sys.exit(main())
