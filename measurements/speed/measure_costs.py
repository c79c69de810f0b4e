#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes what measuring a result costs, as a table.

    measurements/speed/measure_costs.py --worker build/hexad-worker --data FOLDER --output measurements/speed/measure_costs.csv
                           [--count N ...] [--runs N] [--only WORD ...]

FOLDER has the folders meshes and volumes. Each job has one thread. The share is the CPU time of the report's phase `measure` over that of the
whole job with its readers, each the least of the runs. The worker is given a clock that counts the CPU time of its process, so
that other processes of the machine matter little.
"""
import argparse
import json
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))

import results  # noqa: E402

# The main thread's monotonic clock counts the CPU time of the process, read again each millisecond: other threads wait by that clock.
CLOCK = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>
int clock_gettime(clockid_t id, struct timespec *t)
{
    static int (*real)(clockid_t, struct timespec *);
    static __thread struct timespec last, cpu;
    struct timespec now;
    if (!real) real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    if (id != CLOCK_MONOTONIC || syscall(SYS_gettid) != getpid()) return real(id, t);
    real(id, &now);
    const long ns = (now.tv_sec - last.tv_sec) * 1000000000L + now.tv_nsec - last.tv_nsec;
    if (ns > 1000000) {
        last = now;
        real(CLOCK_PROCESS_CPUTIME_ID, &cpu);
    }
    *t = cpu;
    return 0;
}
"""
RESULTS = (0, 10, 11)
MESHES = {".obj", ".off", ".ply", ".stl"}
# File, isovalue, and what else the surface needs.
VOLUMES = (("tooth.nhdr", 600, {}), ("fmob-c4h.nrrd", 0.5, {}), ("HeadMRVolume.mhd", 60, {}), ("avg152T1_RL_nifti.nii.gz", 128, {}),
           ("anatomical.nii", 9000, {}), ("example4d.nii.gz", 300, {"index": 0}), ("example_nifti2.nii.gz", 300, {"index": 0}),
           ("headsq/quarter.nhdr", 800, {}), ("frogtissue.mhd", 14.5, {}))
FORMULAS = {"torus": {"shape": "torus", "axis": [0, 0, 1], "major_radius": 1, "minor_radius": 0.3},
            "gyroid": {"shape": "gyroid", "period": 1, "size": [2, 2, 2]}, "quartic": {"shape": "quartic", "r": 0.13},
            "sphere": {"shape": "sphere", "radius": 1}, "thin box": {"shape": "box", "half_size": [1, 1, 0.05], "rounding": 0.04}}


def surfaces(data):
    yield from ((p.name, {"mesh": {"path": str(p)}}) for p in sorted((data / "meshes").iterdir()) if p.suffix.lower() in MESHES)
    for name, isovalue, more in VOLUMES:
        yield f"{name} at {isovalue:g}", {"volume": {"path": str(data / "volumes" / name), "isovalue": isovalue, **more}}
    yield "labels of frogtissue.mhd", {"labels": {"path": str(data / "volumes" / "frogtissue.mhd")}}
    yield from ((name, {"analytic": formula}) for name, formula in FORMULAS.items())


def run(worker, surface, count, clock):
    """CPU seconds of the job and of its measuring, and its report."""
    with tempfile.TemporaryDirectory() as folder:
        spec, out = pathlib.Path(folder) / "spec.json", pathlib.Path(folder) / "out"
        spec.write_text(json.dumps({"version": 1, "surface": surface, "sampling": {"count": count}, "solver": {"threads": 1},
                                    "output": {"preview": False}}))
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run([worker, "run", spec, "--output", out], capture_output=True, text=True,
                              env={**os.environ, "LD_PRELOAD": str(clock)})
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode not in RESULTS:
            raise SystemExit(done.stderr)
        report = json.loads((out / "report.json").read_text())
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, report["timing_s"]["measure"], report


def measure(worker, jobs, runs):
    """(name, count, CPU, measuring, outcome) of each job."""
    with tempfile.TemporaryDirectory() as folder:
        source, clock = pathlib.Path(folder) / "clock.c", pathlib.Path(folder) / "clock.so"
        source.write_text(CLOCK)
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", clock, source, "-ldl"], check=True)
        for name, surface, count in jobs:
            found = [run(worker, surface, count, clock) for _ in range(runs)]
            row = name, count, min(f[0] for f in found), min(f[1] for f in found), found[0][2]["outcome"]
            print(*row, flush=True)
            yield row


def table(rows):
    """The header, a row for each job, and for each number of points the median and the largest share."""
    lines = [[f"{name} {count}", name, count, outcome.replace("_", " "), round(cpu, 3), round(spent, 3), round(spent / cpu, 4)]
             for name, count, cpu, spent, outcome in rows]
    for count in sorted({row[1] for row in rows}):
        shares = [row[3] / row[2] for row in rows if row[1] == count]
        lines += [[f"{word} of {count}", None, count, None, None, None, round(function(shares), 4)]
                  for word, function in (("median", statistics.median), ("largest", max))]
    return ["row", "surface", "points", "outcome", "job_cpu_s", "measure_cpu_s", "share"], lines


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True)
    parser.add_argument("--data", required=True, type=pathlib.Path)
    parser.add_argument("--output", required=True, type=pathlib.Path)
    parser.add_argument("--count", nargs="+", type=int, default=[10000])
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--only", nargs="*", default=[])
    o = parser.parse_args()
    jobs = [(name, surface, count) for count in o.count for name, surface in surfaces(o.data)
            if not o.only or any(word in name for word in o.only)]
    header, rows = table(list(measure(os.path.abspath(o.worker), jobs, o.runs)))
    results.write(o.output, header, rows)
    print(*(f"share: {row[0]} points {row[-1]:.1%}" for row in rows if row[1] is None), sep="\n")


if __name__ == "__main__":
    main()
