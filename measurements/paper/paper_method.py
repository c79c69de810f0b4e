#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the paper's method with amplitudes by curvature on many surfaces, and writes the outcome of each.

    measurements/paper/paper_method.py --worker build/hexad-worker --output measurements/paper/paper_method.csv [--reference WORKER]
                          [--seeds 5] [--reference-seeds 5] [--jobs N] [--only WORD ...]

The surfaces are those of paper_method.json; files are below HEXAD_SHARED. Each is sampled with the least count of LADDER that
resolves it for all seeds. With --reference the same jobs also run through another worker, and the results have its outcomes and
CPU times. Ends with 1 if less converged than BOUNDS require.
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
sys.path.insert(0, str(HERE.parent / "common"))

import results  # noqa: E402

HEADER = ["surface", "group", "points", "thin_wall_percent", "converged_seeds", "seeds", "hex_fraction", "cpu_s", "reasons"]
REFERENCE_HEADER = ["reference_converged_seeds", "reference_seeds", "reference_cpu_s"]
LADDER = (1000, 2000, 4000, 8000, 16000, 32000, 64000, 100000)
# Count for a surface that no count of LADDER resolves; not itself in LADDER.
OTHERWISE = 8001
# Maximum share of the points on thin walls at a count that resolves a surface.
RESOLVED = 0.02
OUTCOMES = {0: "converged", 11: "unresolved", 10: "not_converged"}
# Of each group: surfaces whose seeds must all converge, or single runs.
BOUNDS = {"meshes": ("surfaces", 22), "others": ("runs", 58)}


def spec_of(surface, count, seed, init):
    return {"version": 1, "surface": surface, "sampling": {"count": count, "alpha": {"d": 2}},
            "solver": {"method": "paper", "init": init, "seed": seed, "threads": 1}, "output": {"preview": False}}


def run(worker, spec):
    """(report or None, CPU seconds, outcome or message of the error) of one job."""
    with tempfile.TemporaryDirectory() as where:
        child = subprocess.Popen([worker, "run", "-", "--output", where], stdin=subprocess.PIPE,
                                 stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        child.stdin.write(json.dumps(spec))
        child.stdin.close()
        said = child.stderr.read()
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        seconds = usage.ru_utime + usage.ru_stime
        if child.returncode not in OUTCOMES:
            return None, seconds, (said.strip().splitlines() or [f"exit {child.returncode}"])[-1][:120]
        report = json.loads((pathlib.Path(where) / "report.json").read_text())
        return report, seconds, OUTCOMES[child.returncode]


def share_of(report):
    quality = report["quality"]  # a reference build may call the member unresolved_count
    return quality.get("thin_count", quality.get("unresolved_count")) / report["count"]


def is_resolved(report):
    """Few points lie on thin walls, and no place is uncovered: a slot narrower than the spacing may be without points."""
    return share_of(report) <= RESOLVED and all(reason["criterion"] != "coverage" for reason in report["outcome_reasons"])


def runs_at(worker, surface, count, seeds, init):
    """Runs of the paper's method. The first run that the count does not resolve is the last one, unless the count is OTHERWISE."""
    runs = []
    for seed in range(seeds):
        runs.append(run(worker, spec_of(surface, count, seed + 1, init)))
        if count in LADDER and runs[-1][0] and not is_resolved(runs[-1][0]):
            break
    return runs


def measure(surface, options):
    """(count, largest share of points on thin walls, runs, runs of the reference), at the least count of LADDER that resolves the surface for
    all seeds, or else at OTHERWISE."""
    for count in (*LADDER, OTHERWISE):
        runs = runs_at(options.worker, surface, count, options.seeds, options.init)
        reports = [report for report, _, _ in runs if report]
        share = max(map(share_of, reports), default=0)
        if all(map(is_resolved, reports)):
            break
    there = [run(options.reference, spec_of(surface, count, seed + 1, options.init)) for seed in range(options.reference_seeds)] if options.reference else []
    return count, share, runs, there


def located(surface, data):
    """The surface with its paths below the data."""
    if isinstance(surface, list):
        return [located(item, data) for item in surface]
    if not isinstance(surface, dict):
        return surface
    return {key: str(data / value) if key == "path" else located(value, data) for key, value in surface.items()}


def rested(outcome, resolvable):
    """Whether an outcome counts as converged: `unresolved` does where no count resolves the surface."""
    return outcome == "converged" or (outcome == "unresolved" and not resolvable)


def row_of(case, count, share, here, there):
    """(seeds that converged, row of the results)."""
    resolvable = count != OTHERWISE
    converged = sum(rested(outcome, resolvable) for _, _, outcome in here)
    reports = [report for report, _, _ in here if report]
    reasons = sorted({f"{outcome}: " + ", ".join(f"{r['criterion']} {r['value']:.3g} (bound {r['bound']:.3g})"
                                                for r in report["outcome_reasons"])
                      for report, _, outcome in here if report and not rested(outcome, resolvable)} |
                     {outcome for report, _, outcome in here if not report})
    hexagons = [r["quality"]["hex_fraction"] for r in reports if r["quality"]["hex_fraction"] is not None]
    row = [case["name"], case["group"], count, f"{100 * share:.2g}", converged, len(here),
           f"{statistics.median(hexagons):.3f}" if hexagons else None, f"{statistics.median(s for _, s, _ in here):.2f}",
           "; ".join(reasons)]
    if there:
        row += [sum(o == "converged" for _, _, o in there), len(there), f"{statistics.median(s for _, s, _ in there):.2f}"]
    return converged, row


def rows_of(cases, options, pool):
    """(rows of the results, missed bounds). Prints each row and a summary."""
    jobs = [pool.submit(measure, case["surface"], options) for case in cases]
    rows, faults, spent = [], [], [0.0, 0.0]
    for group, (unit, least) in BOUNDS.items():
        if not any(case["group"] == group for case in cases):
            continue
        whole, runs, ended = 0, 0, 0
        for case, job in zip(cases, jobs):
            if case["group"] != group:
                continue
            count, share, here, there = job.result()
            converged, row = row_of(case, count, share, here, there)
            whole, runs, ended = whole + (converged == options.seeds), runs + converged, ended + 1
            for k, ran in enumerate([here[:len(there)], there]):
                spent[k] += sum(seconds for _, seconds, _ in ran)
            rows.append(row)
            print(*row, flush=True)
        print(f"{group}: all seeds converged on {whole} of {ended} surfaces; {runs} of {ended * options.seeds} runs converged", flush=True)
        if not options.only and (whole if unit == "surfaces" else runs) < least:
            faults.append(f"{group}: fewer {unit} converged than {least}")
    if options.reference:
        print(f"CPU time of the runs that both builds made: {spent[0]:.0f} s; of the reference {spent[1]:.0f} s")
    return rows, faults


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True, type=os.path.abspath)
    parser.add_argument("--reference", type=os.path.abspath, help="another worker, for its outcomes and CPU times")
    parser.add_argument("--output", required=True, type=pathlib.Path)
    parser.add_argument("--init", default="surface", choices=["surface", "sized"],
                        help="solver.init: surface is the paper's; sized, from coarse to fine, is the default of hexad")
    parser.add_argument("--seeds", default=5, type=int)
    parser.add_argument("--reference-seeds", default=5, type=int, help="seeds of the other worker")
    parser.add_argument("--jobs", default=1, type=int, help="jobs at the same time")
    parser.add_argument("--only", nargs="*", default=[])
    options = parser.parse_args()
    data = pathlib.Path(os.environ.get("HEXAD_SHARED", HERE.parents[2] / "shared" / "data"))
    cases = [{**case, "group": group, "surface": located(case["surface"], data)}
             for group, listed in json.loads((HERE / "paper_method.json").read_text()).items() for case in listed
             if not options.only or any(word in case["name"] for word in options.only)]
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        rows, faults = rows_of(cases, options, pool)
    results.write(options.output, HEADER + (REFERENCE_HEADER if options.reference else []), rows)
    for fault in faults:
        print(fault, file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
