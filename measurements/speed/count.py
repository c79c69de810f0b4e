#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Counts instructions of the worker on fixed inputs under callgrind and holds them against measurements/speed/counts.json.

    measurements/speed/count.py --worker build/hexad-worker --build "COMPILER AND FLAGS" [--case NAME ...] [--update]

One thread, no preview, and the instruction set that valgrind can run: avx2, or portable on a machine without it; each
has a baseline of its own. A table goes to standard output: of each case the whole run and the phases, with all that
they call. Ends with 1 when a count exceeds its baseline by more than 5 %, or has none. --update makes the counts
the baseline instead. Counts belong to a compiler and its flags: that the baseline comes from others is said.
"""
import argparse
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
# Libraries differ between machines, and the start of threads and files varies a little from run to run.
SLACK = 0.05
# An input, made by the worker itself: a level set of 64 voxels.
EXAMPLE = "example.vdb"
CASES = {
    "quartic-1000": {
        "surface": {"analytic": {"shape": "quartic", "center": [0.5, 0.5, 0.5], "r": 0.13}},
        "sampling": {"count": 1000}},
    "sphere-10000": {
        "surface": {"analytic": {"shape": "sphere", "radius": 0.4}}, "sampling": {"count": 10000}},
    "tricubic-20000": {
        "surface": {"vdb": {"path": EXAMPLE}}, "sampling": {"count": 20000}},
    "graded-torus-10000": {
        "surface": {"analytic": {"shape": "torus", "center": [0, 0, 0], "major_radius": 1.0, "minor_radius": 0.91}},
        "sampling": {"count": 10000, "curvature": {"ratio": 10, "exponent": 2}}},
}
WHOLE = "whole run"
# Functions with all that they call. Those with an indent are part of the ones above, and of each other.
PHASES = ("volume_open", "surface_scan", "sizing_field_new", "levels_plan", "sampler_new", "sampler_step",
          "  refine_particles", "  relax_build", "  relax_sweep", "sampler_finalize", "quality_measure", "ply_write")


def instruction_set():
    """What valgrind can run: it knows AVX2, no more."""
    cpu = pathlib.Path("/proc/cpuinfo").read_text()
    return "avx2" if re.search(r"^flags\s*:.*\bavx2\b", cpu, re.MULTILINE) else "portable"


def run(command, where):
    done = subprocess.run(command, cwd=where, capture_output=True, text=True)
    if done.returncode not in (0, 10, 11):  # succeeded, whatever the outcome
        sys.exit(f"{' '.join(map(str, command))}: exit code {done.returncode}\n{done.stderr}")
    return done.stdout


def counts_of(profile, where):
    """By function, inclusive; the whole under its own name. What was inlined into a function from a header stands on
    a line of its own, within what the first counts."""
    text = run(["callgrind_annotate", "--inclusive=yes", "--threshold=100", "--auto=no", "--show=Ir", profile], where)
    counts = {WHOLE: int(re.search(r"([\d,]+) \(100\.0%\)\s+PROGRAM TOTALS", text).group(1).replace(",", ""))}
    wanted = {name.strip() for name in PHASES}
    for line in text.splitlines():
        found = re.match(r"\s*([\d,]+) .*?:(\w+)(?:\.\w+)*(?:'\d+)? ", line)
        if found and found.group(2) in wanted:
            counts[found.group(2)] = max(counts.get(found.group(2), 0), int(found.group(1).replace(",", "")))
    return counts


def count_case(name, worker, isa, where):
    spec = {"version": 1, **CASES[name], "solver": {"isa": isa, "threads": 1, "seed": 1},
            "output": {"preview": False}}
    (where / "spec.json").write_text(json.dumps(spec))
    run(["valgrind", "--tool=callgrind", "--callgrind-out-file=profile", worker, "run", "spec.json",
         "--output", "result"], where)
    return counts_of("profile", where)


def show_case(name, counts, before):
    """One line for each count; returns those that are too many."""
    print(f"\n{name:26}{'million':>12}{'baseline':>12}{'change':>10}")
    beyond = []
    for label in (WHOLE, *PHASES):
        key = label.strip()
        if key not in counts:
            continue
        ir, base = counts[key], before.get(key)
        line = f"{label:26}{ir / 1e6:12.2f}"
        if base is not None:
            line += f"{base / 1e6:12.2f}{100 * (ir / base - 1):+9.1f} %"
        if base is None or ir > base * (1 + SLACK):
            beyond.append(f"{name}: {key}")
        print(line)
    return beyond


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True, type=lambda p: str(pathlib.Path(p).resolve()))
    parser.add_argument("--build", required=True, help="compiler and flags, noted with the counts")
    parser.add_argument("--baseline", default=HERE / "counts.json", type=pathlib.Path)
    parser.add_argument("--case", action="append", choices=CASES, help="only this one; may be given several times")
    parser.add_argument("--update", action="store_true", help="the counts become the baseline")
    return parser.parse_args()


def main():
    options = arguments()
    missing = [tool for tool in ("valgrind", "callgrind_annotate") if not shutil.which(tool)]
    if missing:
        sys.exit(f"measurements/speed/count.py: {', '.join(missing)} not found (Debian: valgrind)")
    isa = instruction_set()
    baselines = json.loads(options.baseline.read_text()) if options.baseline.exists() else {}
    baseline = baselines.get(isa, {"build": options.build, "counts": {}})
    print(f"instructions, {isa}, {options.build}")
    if baseline["build"] != options.build:
        print(f"the baseline is of another build: {baseline['build']}")
    beyond = []
    with tempfile.TemporaryDirectory() as scratch:
        where = pathlib.Path(scratch)
        run([options.worker, "make-example", EXAMPLE], where)
        for name in options.case or CASES:
            counts = count_case(name, options.worker, isa, where)
            beyond += show_case(name, counts, baseline["counts"].get(name, {}))
            if options.update:
                baseline["counts"][name] = counts
    if options.update:
        baselines[isa] = {**baseline, "build": options.build}
        options.baseline.write_text(json.dumps(baselines, indent=1, sort_keys=True) + "\n")
        return 0
    if beyond:
        print(f"\nmore than {100 * SLACK:.0f} % above the baseline, or without one (BENCH_FLAGS=--update):",
              *beyond, sep="\n  ")
    return 1 if beyond else 0


if __name__ == "__main__":
    sys.exit(main())
