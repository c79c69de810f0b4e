#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Solves every mesh of a folder at several counts, with one worker or with two, and writes what the reports say, the CPU time and
the memory (measurements/meshes/counts.csv).

    measurements/meshes/mesh_results.py --worker build/hexad-worker [--reference WORKER] --data FOLDER --output counts.csv
                          [--summary by_count.csv] [--commit NAME] [--counts 10 200 ...] [--seed 1]

One thread; defaults else. FOLDER has the meshes. Of the reference only CPU time and memory are written: reports of older versions
measure other quantities. The summary has a row for each count; --commit is the text of the last column.
"""
import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import results  # noqa: E402

SUFFIXES = (".obj", ".ply", ".off", ".stl")
COUNTS = [10, 50, 200, 1000, 2000, 10000, 50000]


def solve(worker, mesh, count, seed):
    """The report, CPU seconds and MB of a job; or the last line of its error."""
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder)
        spec = {"version": 1, "surface": {"mesh": {"path": str(mesh)}}, "sampling": {"count": count},
                "solver": {"seed": seed, "threads": 1}, "output": {"preview": False}}
        (out / "spec.json").write_text(json.dumps(spec))
        with open(out / "log", "w") as log:
            process = subprocess.Popen([worker, "run", out / "spec.json", "--output", out / "out"], stdout=log, stderr=log)
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        report = out / "out" / "report.json"
        if not report.exists():
            return None, (out / "log").read_text().strip().splitlines()[-1]
        result = json.loads(report.read_text())
        # not ru_maxrss: a process inherits that of the one that started it
        return result, used.ru_utime + used.ru_stime, result["peak_memory_bytes"] / 2 ** 20


HEADER = ("job", "mesh", "points", "outcome", "criteria", "coverage", "missing_share", "close_share", "coincident", "min_spacing_ratio",
          "hex_fraction", "cpu_s", "memory_mib", "reference_cpu_s", "reference_memory_mib", "commit")
MEASURES = HEADER[5:11]


def row(mesh, count, own, other, commit):
    """A row of HEADER; the criteria of a job without a result are its error."""
    cells = {"job": f"{mesh.name} {count}", "mesh": mesh.name, "points": count, "outcome": "error", "criteria": own[1], "commit": commit}
    if own[0] is not None:
        report, seconds, memory = own
        cells |= {"outcome": report["outcome"], "criteria": " ".join(r["criterion"] for r in report["outcome_reasons"]),
                  **{name: "" if report["quality"][name] is None else f"{report['quality'][name]:.3g}" for name in MEASURES},
                  "cpu_s": f"{seconds:.2f}", "memory_mib": f"{memory:.0f}"}
    if other and other[0] is not None:
        cells |= {"reference_cpu_s": f"{other[1]:.2f}", "reference_memory_mib": f"{other[2]:.0f}"}
    return [cells.get(name, "") for name in HEADER]


SUMMARY = ("points", "jobs", "converged", "unresolved", "not_converged", "coverage_largest", "coverage_above_1", "close_share_above_0.01",
           "coincident_jobs", "hex_fraction_least", "hex_fraction_median", "cpu_ratio_median",
           "cpu_ratio_largest", "memory_ratio_median", "memory_ratio_largest")


def summary(table, counts):
    """Rows of SUMMARY, one for each count: numbers of jobs, and ratios to the reference."""
    rows = []
    for count in counts:
        jobs = [dict(zip(HEADER, cells)) for cells in table if int(cells[2]) == count]
        outcomes = [job["outcome"] for job in jobs]
        values = {name: [float(job[name]) for job in jobs if job[name] != ""]
                  for name in ("coverage", "close_share", "coincident", "hex_fraction")}
        pairs = [job for job in jobs if job["cpu_s"] != "" and job["reference_cpu_s"] != ""]
        ratios = [[float(job[name]) / float(job[f"reference_{name}"]) for job in pairs] for name in ("cpu_s", "memory_mib")]
        rows.append([count, len(jobs), *(outcomes.count(name) for name in SUMMARY[2:5]), max(values["coverage"], default=""),
                     sum(x > 1 for x in values["coverage"]), sum(x > 0.01 for x in values["close_share"]),
                     sum(x > 0 for x in values["coincident"]), min(values["hex_fraction"], default=""),
                     f"{statistics.median(values['hex_fraction'] or [0]):.3g}",
                     *(f"{f(r):.2f}" if r else "" for r in ratios for f in (statistics.median, max))])
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True)
    parser.add_argument("--reference")
    parser.add_argument("--data", required=True, type=pathlib.Path)
    parser.add_argument("--output", required=True, type=pathlib.Path)
    parser.add_argument("--summary", type=pathlib.Path)
    parser.add_argument("--commit", default="")
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    table = []
    for mesh in sorted(p for p in args.data.iterdir() if p.suffix.lower() in SUFFIXES):
        for count in args.counts:
            own = solve(args.worker, mesh, count, args.seed)
            other = solve(args.reference, mesh, count, args.seed) if args.reference else None
            table.append(row(mesh, count, own, other, args.commit))
            results.write(args.output, HEADER, table)
            print(*table[-1], sep=", ", flush=True)
    for cells in (SUMMARY, *summary(table, args.counts)):
        print(*cells, sep=", ")
    if args.summary:
        results.write(args.summary, SUMMARY, summary(table, args.counts))


if __name__ == "__main__":
    main()
