#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes a segmentation with many labels, and prints and writes the CPU time and the peak memory of jobs that sample it.

    measurements/labels/many_labels.py --worker build/hexad-worker [--labels 1500] [--size 256] [--seed 1] [--counts 100000,1000000]
        [--threads 2] [--memory-mb 16384] [--keep FILE.nrrd] [--output FILE.csv]

The labels are the Voronoi cells of random points in a cube of --size voxels. With the defaults about 3 million pairs of voxels
that share a side have different labels. --worker may name several workers, separated by commas. Each job uses the defaults
except for the count, the number of threads and the limit of memory. CPU time is user and system time of the process,
memory its largest resident set, both by wait4(2).
"""
import argparse
import json
import os
import pathlib
import sys
import tempfile

import numpy
from scipy.spatial import cKDTree

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "service"), str(ROOT / "measurements" / "common")]
import results  # noqa: E402
from volumes import write_nrrd  # noqa: E402


HEADER = ("job", "points", "labels", "voxel_faces", "triangles", "outcome", "lost", "cpu_s", "memory_mib")


def cells(labels, size, seed):
    """The number of the nearest of random points for each voxel, from 1."""
    tree = cKDTree(numpy.random.default_rng(seed).uniform(0, size - 1, (labels, 3)))
    plane = numpy.indices((size, size)).reshape(2, -1).T
    volume = numpy.empty((size, size, size), "u2")
    for x in range(size):
        nearest = tree.query(numpy.insert(plane.astype(float), 0, x, axis=1))[1]
        volume[x] = 1 + nearest.reshape(size, size)
    return volume


def run(worker, folder, volume, count, threads, memory_mb):
    """The report, CPU seconds and megabytes of one job."""
    spec = {"version": 1, "surface": {"labels": {"path": str(volume)}}, "sampling": {"count": count},
            "solver": {"threads": threads}, "limits": {"memory_mb": memory_mb}}
    (folder / "spec.json").write_text(json.dumps(spec))
    log = folder / "log"
    pid = os.posix_spawn(worker, [worker, "run", str(folder / "spec.json"), "--output", str(folder / "out")], os.environ,
                         file_actions=[(os.POSIX_SPAWN_OPEN, 2, str(log), os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)])
    _, status, usage = os.wait4(pid, 0)
    if os.waitstatus_to_exitcode(status) not in (0, 10, 11):
        raise SystemExit(log.read_text())
    report = json.loads((folder / "out" / "report.json").read_text())
    return report, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--worker", required=True)
    parser.add_argument("--counts", default="100000")
    parser.add_argument("--output", type=pathlib.Path)
    parser.add_argument("--keep", type=pathlib.Path, help="also write the volume to this file")
    for name, default in (("labels", 1500), ("size", 256), ("seed", 1), ("threads", 2), ("memory_mb", 16384)):
        parser.add_argument("--" + name.replace("_", "-"), type=int, default=default)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = pathlib.Path(place)
        file = options.keep or folder / "labels.nrrd"
        volume = cells(options.labels, options.size, options.seed)
        faces = sum(int(numpy.count_nonzero(numpy.diff(volume.astype("i4"), axis=axis))) for axis in range(3))
        write_nrrd(file, volume)
        labels = len(numpy.unique(volume))
        print(f"seed {options.seed}: {labels} labels in {options.size}^3 voxels, {faces} faces between voxels", flush=True)
        del volume
        rows = []
        for count in map(int, options.counts.split(",")):
            for worker in options.worker.split(","):
                report, cpu, memory = run(worker, folder, file, count, options.threads, options.memory_mb)
                rows.append([f"{worker} {count}", count, labels, faces, report["surface"]["labels"]["triangles"], report["outcome"],
                             report["quality"]["lost"], f"{cpu:.1f}", f"{memory:.0f}"])
                print(", ".join(f"{name} {value}" for name, value in zip(HEADER, rows[-1])), flush=True)
                if options.output:
                    results.write(options.output, HEADER, rows)


if __name__ == "__main__":
    main()
