#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the paper's method with amplitudes by curvature on many surfaces, and writes what became of each as a page.

    measurements/paper/paper_method.py --worker build/hexad-worker --output measurements/paper/paper_method.md [--reference WORKER]
                          [--seeds 5] [--reference-seeds 5] [--jobs N] [--only WORD ...]

The surfaces are those of paper_method.json; files are below HEXAD_SHARED. Each is sampled at the least count of LADDER that
resolves it for all seeds, once from points distributed by area ("surface") and once from coarse to fine ("sized", the default). With --reference the same jobs run through another worker as well, and
the page compares processor times. Ends with 1 when less came to rest than BOUNDS ask for.
"""
import argparse
import concurrent.futures
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
LADDER = (1000, 2000, 4000, 8000, 16000, 32000, 64000, 100000)
# How many points a surface gets that none of them resolves; none of them itself.
OTHERWISE = 8001
# The share of the points that may be unresolved at a count that resolves a surface.
RESOLVED = 0.02
RESULTS = {0: "converged", 11: "unresolved", 10: "not_converged"}
# Of each group: surfaces whose seeds must all converge, or single runs.
BOUNDS = {"meshes": ("surfaces", 22), "others": ("runs", 58)}


def spec_of(surface, count, seed, init="surface"):
    return {"version": 1, "surface": surface, "sampling": {"count": count, "alpha": {"d": 2}},
            "solver": {"method": "paper", "init": init, "seed": seed, "threads": 1}, "output": {"preview": False}}


def run(worker, spec):
    """(report or None, processor seconds, outcome or the error's words) of one job."""
    with tempfile.TemporaryDirectory() as where:
        child = subprocess.Popen([worker, "run", "-", "--output", where], stdin=subprocess.PIPE,
                                 stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        child.stdin.write(json.dumps(spec))
        child.stdin.close()
        said = child.stderr.read()
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        seconds = usage.ru_utime + usage.ru_stime
        if child.returncode not in RESULTS:
            return None, seconds, (said.strip().splitlines() or [f"exit {child.returncode}"])[-1][:120]
        report = json.loads((pathlib.Path(where) / "report.json").read_text())
        return report, seconds, RESULTS[child.returncode]


def share_of(report):
    return report["quality"]["unresolved_count"] / report["count"]


def is_resolved(report):
    """Few points are unresolved, and no place is bare: a slot narrower than the spacing may be without points."""
    return share_of(report) <= RESOLVED and all(reason["criterion"] != "coverage" for reason in report["outcome_reasons"])


def runs_at(worker, surface, count, seeds):
    """Runs of the paper's method; none after one that the count does not resolve, unless it is OTHERWISE."""
    runs = []
    for seed in range(seeds):
        runs.append(run(worker, spec_of(surface, count, seed + 1)))
        if count in LADDER and runs[-1][0] and not is_resolved(runs[-1][0]):
            break
    return runs


def measure(surface, options):
    """(count, largest share unresolved, runs, runs of the reference, runs from coarse to fine), at the least count of LADDER that
    resolves the surface for all seeds, or else at OTHERWISE."""
    for count in (*LADDER, OTHERWISE):
        runs = runs_at(options.worker, surface, count, options.seeds)
        reports = [report for report, _, _ in runs if report]
        share = max(map(share_of, reports), default=0)
        if all(map(is_resolved, reports)):
            break
    there = [run(options.reference, spec_of(surface, count, seed + 1)) for seed in range(options.reference_seeds)] if options.reference else []
    sized = [run(options.worker, spec_of(surface, count, seed + 1, "sized")) for seed in range(options.seeds)]
    return count, share, runs, there, sized


def located(surface, data):
    """The surface with its paths below the data."""
    if isinstance(surface, list):
        return [located(item, data) for item in surface]
    if not isinstance(surface, dict):
        return surface
    return {key: str(data / value) if key == "path" else located(value, data) for key, value in surface.items()}


def rested(outcome, resolvable):
    """At rest: in order, or without order where no count resolves the surface."""
    return outcome == "converged" or (outcome == "unresolved" and not resolvable)


def row_of(case, init, count, share, here, there):
    resolvable = count != OTHERWISE
    at_rest = sum(rested(outcome, resolvable) for _, _, outcome in here)
    reports = [report for report, _, _ in here if report]
    seconds = statistics.median(s for _, s, _ in here)
    reasons = sorted({f"{outcome}: " + ", ".join(f"{r['criterion']} {r['value']:.3g} (bound {r['bound']:.3g})"
                                                for r in report["outcome_reasons"])
                      for report, _, outcome in here if report and not rested(outcome, resolvable)} |
                     {outcome for report, _, outcome in here if not report})
    hexagons = [r["quality"]["hex_fraction"] for r in reports if r["quality"]["hex_fraction"] is not None]
    cells = [case["name"], init, str(count), f"{100 * share:.2g}", f"{at_rest} of {len(here)}",
             f"{statistics.median(hexagons):.3f}" if hexagons else "-", f"{seconds:.2f}"]
    if there:
        before = statistics.median(s for _, s, _ in there)
        seconds = statistics.median(s for _, s, _ in here[:len(there)])
        cells += [f"{sum(o == 'converged' for _, _, o in there)} of {len(there)}", f"{before:.2f}", f"{seconds / before:.2f}"]
    return at_rest, "| " + " | ".join([*cells, "; ".join(reasons)]) + " |"


def page(cases, options, pool):
    jobs = [pool.submit(measure, case["surface"], options) for case in cases]
    lines, faults, spent = [], [], [0.0, 0.0]
    for group, (unit, least) in BOUNDS.items():
        if not any(case["group"] == group for case in cases):
            continue
        head = ["surface", "init", "points", "on thin walls %", "converged", "hex_fraction", "CPU s"]
        head += ["reference converged", "reference CPU s", "ratio"] if options.reference else []
        lines += ["", f"## {group}", "", "| " + " | ".join([*head, "reasons"]) + " |", "|---" * (len(head) + 1) + "|"]
        whole, runs, ended, by_levels = 0, 0, 0, 0
        for case, job in zip(cases, jobs):
            if case["group"] != group:
                continue
            count, share, here, there, sized = job.result()
            at_rest, line = row_of(case, "surface", count, share, here, there)
            whole, runs, ended = whole + (at_rest == options.seeds), runs + at_rest, ended + 1
            share = max((share_of(report) for report, _, _ in sized if report), default=0)
            sized_at_rest, sized_line = row_of(case, "sized", count, share, sized, there)
            by_levels += sized_at_rest
            for k, results in enumerate([here[:len(there)], there]):
                spent[k] += sum(seconds for _, seconds, _ in results)
            lines += [line, sized_line]
            print(line, sized_line, sep="\n", file=sys.stderr, flush=True)
        lines += ["", f"All seeds converged: {whole} of {ended} surfaces; {runs} of {ended * options.seeds} runs. From coarse to fine: "
                  f"{by_levels} runs."]
        if not options.only and (whole if unit == "surfaces" else runs) < least:
            faults.append(f"{group}: fewer {unit} converged than {least}")
    if options.reference:
        lines += ["", f"CPU time of the runs that both builds made: {spent[0]:.0f} s; of the reference {spent[1]:.0f} s."]
    return lines, faults


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True, type=os.path.abspath)
    parser.add_argument("--reference", type=os.path.abspath, help="another worker, for its processor time")
    parser.add_argument("--output", required=True, type=pathlib.Path)
    parser.add_argument("--seeds", default=5, type=int)
    parser.add_argument("--reference-seeds", default=5, type=int, help="how many of them the other worker runs")
    parser.add_argument("--jobs", default=1, type=int, help="how many run at a time")
    parser.add_argument("--only", nargs="*", default=[])
    options = parser.parse_args()
    data = pathlib.Path(os.environ.get("HEXAD_SHARED", HERE.parents[2] / "shared" / "data"))
    cases = [{**case, "group": group, "surface": located(case["surface"], data)}
             for group, listed in json.loads((HERE / "paper_method.json").read_text()).items() for case in listed
             if not options.only or any(word in case["name"] for word in options.only)]
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        lines, faults = page(cases, options, pool)
    head = ["# The paper's method on many surfaces", "",
            "`make paper-method` ([paper_method.py](paper_method.py)) runs the method `paper` with `alpha`, d = 2, on one "
            f"thread with {options.seeds} seeds. Each surface has the least count", f"of {', '.join(map(str, LADDER))} at which at most 2 % "
            "of the points lie on walls thinner than 1.2 spacings with every seed. A surface without such a count",
            f"has {OTHERWISE} points, and the outcome `unresolved` counts as converged. Times are medians of CPU seconds. Rows with the "
            "`init` `sized`, the default with `alpha`, have the same counts and seeds."]
    options.output.write_text("\n".join(head + lines) + "\n")
    for fault in faults:
        print(fault, file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
