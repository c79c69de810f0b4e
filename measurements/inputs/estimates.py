#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares the memory and the CPU time that the worker estimates for a job with what the job takes
(estimated_memory.csv, estimated_time.csv and, for each count, estimated_order.csv in measurements/inputs).

    measurements/inputs/estimates.py --worker build/hexad-worker --output FOLDER [--data DIRECTORY]
                       [--only WORD ...] [--counts 1000 30000] [--time-counts 10000]

DIRECTORY, or HEXAD_SHARED, has the folders meshes, vdb and volumes. Both runs are of the same spec, each a process
of its own. CPU time is compared for every mesh, with one thread and seed 1. Ends with 1 when an estimate of memory is
below the job's peak by more than a tenth or above it by more than a half, or when fewer than nine in ten estimates of
time are within a factor of 2.
"""
import argparse
import itertools
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

# Of all surfaces, and of one of each kind besides.
COUNTS, LARGE = (1000, 30000), 1000000
OF_LARGE = {"torus", "vdb/ls_sphere_half.vdb", "meshes/spot.obj"}
LEAST, MOST = 0.9, 1.5
TIME_COUNTS, TIME_FACTOR, TIME_SHARE = (10000,), 2, 0.9
MESHES = (".obj", ".ply", ".off", ".stl")
# The worker's exit codes of results.
RESULTS = (0, 10, 11)
TORUS = {"shape": "torus", "center": [0, 0, 0], "axis": [0, 0, 1], "major_radius": 1, "minor_radius": 0.3}


def surfaces(data):
    """Names and members of surfaces: of each way into the sampler a small and a large one."""
    def of(kind, path, **more):
        return path, {kind: {"path": str(data / path), **more}}
    return dict([("torus", {"analytic": TORUS}),
                 of("vdb", "vdb/ls_sphere_half.vdb"), of("vdb", "vdb/ls_cube_half.vdb"),
                 of("vdb", "vdb/vpt_dragon_fog.vdb", isovalue=0.5),
                 of("vdb", "vdb/wdas_cloud_sixteenth.vdb", isovalue=0.1),
                 of("mesh", "meshes/spot.obj"), of("mesh", "meshes/cup.obj"), of("mesh", "meshes/dragon_100k.obj"),
                 of("mesh", "meshes/fandisk.off"), of("mesh", "meshes/plane_holes.obj"),
                 of("volume", "volumes/HeadMRVolume.mhd", isovalue=30), of("volume", "volumes/tooth.nhdr", isovalue=900)])


def call(worker, command, spec, where):
    """The JSON file of the worker's command or None, the last line of its error or None, and its CPU seconds."""
    (where / "spec.json").write_text(json.dumps(spec))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([worker, command, where / "spec.json", "--output", where / command], text=True,
                          capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if done.returncode not in RESULTS:
        return None, done.stderr.splitlines()[-1], seconds
    file = {"run": "report.json", "estimate": "estimate.json"}[command]
    return json.loads((where / command / file).read_text()), None, seconds


MEMORY = ("job", "surface", "points", "estimate_mib", "peak_mib", "ratio", "missed", "error")
TIME = ("job", "mesh", "points", "estimate_s", "job_cpu_s", "ratio", "estimate_cpu_s", "error")
ORDER = ("points", "estimates", "within_a_factor_of_2", "pairs_a_factor_apart", "pairs_ordered",
         "ratio_least", "ratio_median", "ratio_largest")


def row(worker, name, surface, count, where):
    """A row of MEMORY."""
    spec = {"version": 1, "surface": surface, "sampling": {"count": count}, "output": {"preview": False}}
    estimate, failed, _ = call(worker, "estimate", spec, where)
    found, failed, _ = call(worker, "run", spec, where) if estimate else (None, failed, None)
    if failed:
        return [f"{name} {count}", name, count, "", "", "", "error", failed]
    ratio = estimate["memory_bytes"] / found["peak_memory_bytes"]
    missed = "below" if ratio < LEAST else "above" if ratio > MOST else ""
    return [f"{name} {count}", name, count, f"{estimate['memory_bytes'] / 2 ** 20:.0f}", f"{found['peak_memory_bytes'] / 2 ** 20:.0f}",
            f"{ratio:.2f}", missed, ""]


def times(worker, meshes, counts):
    """Rows of TIME; for each count the pairs (estimate, CPU seconds)."""
    rows, pairs = [], {count: [] for count in counts}
    for mesh, count in itertools.product(meshes, counts):
        spec = {"version": 1, "surface": {"mesh": {"path": str(mesh)}}, "sampling": {"count": count},
                "solver": {"seed": 1, "threads": 1}, "output": {"preview": False}}
        with tempfile.TemporaryDirectory() as where:
            estimate, failed, cost = call(worker, "estimate", spec, pathlib.Path(where))
            _, failed, used = call(worker, "run", spec, pathlib.Path(where)) if estimate else (None, failed, 0)
        cells = ["", "", "", "", failed]
        if not failed:
            pairs[count].append((estimate["seconds"], used))
            cells = [f"{estimate['seconds']:.2f}", f"{used:.2f}", f"{estimate['seconds'] / used:.2f}", f"{cost:.2f}", ""]
        rows.append([f"{mesh.name} {count}", mesh.name, count, *cells])
        print(*rows[-1], sep=", ", flush=True)
    return rows, pairs


def order(count, pairs):
    """A row of ORDER, and whether enough of the estimates are near."""
    near = sum(1 / TIME_FACTOR <= estimate / used <= TIME_FACTOR for estimate, used in pairs)
    apart = [(a, b) for a, b in itertools.combinations(pairs, 2) if not 1 / TIME_FACTOR < a[1] / b[1] < TIME_FACTOR]
    ordered = sum((a[0] < b[0]) == (a[1] < b[1]) for a, b in apart)
    ratios = [estimate / used for estimate, used in pairs]
    cells = [count, len(pairs), near, len(apart), ordered, *(f"{f(ratios):.2f}" for f in (min, statistics.median, max))]
    return cells, near >= TIME_SHARE * len(pairs)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worker", required=True)
    parser.add_argument("--data", type=pathlib.Path, default=os.environ.get("HEXAD_SHARED"))
    parser.add_argument("--only", nargs="*", default=[""])
    parser.add_argument("--counts", nargs="*", type=int, default=COUNTS)
    parser.add_argument("--time-counts", nargs="*", type=int, default=TIME_COUNTS)
    parser.add_argument("--output", type=pathlib.Path, required=True)
    words = parser.parse_args()
    if not words.data:
        parser.error("give --data or set HEXAD_SHARED")
    rows = []
    for name, surface in surfaces(pathlib.Path(words.data)).items():
        if not any(word in name for word in words.only):
            continue
        for count in (*words.counts, *([LARGE] if name in OF_LARGE else [])):
            with tempfile.TemporaryDirectory() as where:
                rows.append(row(words.worker, name, surface, count, pathlib.Path(where)))
            print(*rows[-1], sep=", ", flush=True)
    meshes = sorted(p for p in (pathlib.Path(words.data) / "meshes").iterdir()
                    if p.suffix.lower() in MESHES and any(word in f"meshes/{p.name}" for word in words.only))
    timed, pairs = times(words.worker, meshes, words.time_counts)
    found = [order(count, pairs[count]) for count in words.time_counts if pairs[count]]
    words.output.mkdir(parents=True, exist_ok=True)
    for name, header, table in (("memory", MEMORY, rows), ("time", TIME, timed), ("order", ORDER, [cells for cells, _ in found])):
        results.write(words.output / f"estimated_{name}.csv", header, table)
    missed = [cells for cells in rows if cells[6]]
    print(f"memory: {len(missed)} of {len(rows)} estimates miss the bounds", *missed, *(cells for cells, _ in found), sep="\n")
    return 1 if missed or not all(near for _, near in found) else 0


if __name__ == "__main__":
    sys.exit(main())
