#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Solves every mesh of a folder at several counts, with one worker or with two, and writes what the reports say, the CPU time and
the memory (measurements/meshes/meshes.md).

    measurements/meshes/mesh_results.py --worker build/hexad-worker [--reference WORKER] --data FOLDER --output measurements/meshes/meshes.md
                          [--counts 10 200 ...] [--seed 1]

One thread; defaults else. FOLDER has the meshes. Of the reference only CPU time and memory are told: reports of older versions measure
other things.
"""
import argparse
import json
import os
import pathlib
import statistics
import subprocess
import tempfile

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


def number(x, digits):
    return "" if x is None else f"{x:.{digits}g}"


def row(mesh, count, own, other):
    if own[0] is None:
        return f"| {mesh.name} | {count} | {own[1]} ||||||||||"
    report, seconds, memory = own
    quality = report["quality"]
    criteria = ", ".join(r["criterion"] for r in report["outcome_reasons"])
    cells = [mesh.name, str(count), report["outcome"] + (f" ({criteria})" if criteria else ""),
             *(number(quality[name], 3) for name in ("coverage", "missing_share", "close_share")), str(quality["coincident"]),
             *(number(quality[name], 3) for name in ("min_spacing_ratio", "hex_fraction")), f"{seconds:.2f}", f"{memory:.0f}"]
    if other and other[0] is not None:
        cells[-2] += f" / {other[1]:.2f}"
        cells[-1] += f" / {other[2]:.0f}"
    return "| " + " | ".join(cells) + " |"


def summary(results, counts):
    """Ratios of CPU time and of memory for each count."""
    lines = ["| points | CPU, median | largest | memory, median | largest |", "|---|---|---|---|---|"]
    for count in counts:
        pairs = [(own, other) for at, own, other in results if at == count and other and own[0] and other[0]]
        if pairs:
            cpu, memory = ([own[k] / other[k] for own, other in pairs] for k in (1, 2))
            lines.append(f"| {count} | {statistics.median(cpu):.2f} | {max(cpu):.2f} | {statistics.median(memory):.2f} | {max(memory):.2f} |")
    return lines


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True)
    parser.add_argument("--reference")
    parser.add_argument("--data", required=True, type=pathlib.Path)
    parser.add_argument("--output", required=True, type=pathlib.Path)
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    meshes = sorted(p for p in args.data.iterdir() if p.suffix.lower() in SUFFIXES)
    rows, results = [], []
    for mesh in meshes:
        for count in args.counts:
            own = solve(args.worker, mesh, count, args.seed)
            other = solve(args.reference, mesh, count, args.seed) if args.reference else None
            results.append((count, own, other))
            rows.append(row(mesh, count, own, other))
            print(rows[-1], flush=True)
    text = ["# Meshes at several counts", "",
            f"    measurements/meshes/mesh_results.py --worker WORKER --reference REFERENCE --data FOLDER --seed {args.seed}", "",
            "Measures of the reports on real meshes with defaults and one thread. In CPU seconds and MB, the figure after the slash is that "
            "of the reference, commit d10413d0.", ""]
    if args.reference:
        text += ["Ratios to the reference:", "", *summary(results, args.counts), ""]
    text += ["| mesh | points | outcome | coverage | missing_share | close_share | coincident | min_spacing_ratio | hex_fraction | CPU s | MB |",
             "|" + "---|" * 11, *rows]
    args.output.write_text("\n".join(text) + "\n")


if __name__ == "__main__":
    main()
