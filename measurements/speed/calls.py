#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes what a call of hexad.sample costs beyond the phases of its job, as a table.

    measurements/speed/calls.py --library build/libhexad.so.1 --data FOLDER --output measurements/speed/calls.csv
                                [--runs N] [--meshes N]

FOLDER has the folder meshes. One call: 2 048 points on a torus of 10 000 triangles, least of the runs; with all properties, and with
properties="minimal", without the curvature. Many: hexad.sample_many with 2 048 points on meshes of the folder that are cut by a plane,
turned and scaled, one at a time. One thread for each job. Phases are load, start, relax and measure of the report; the phase curvature
is beside them. Their clock counts the CPU time of the process, so that other processes of the machine matter little.
"""
import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "common"), str(HERE.parents[1] / "clients/python")]

import meshes  # noqa: E402
import results  # noqa: E402

# The monotonic clock of the thread of a job counts the CPU time of the process. Threads that this thread starts have the usual clock: they wait.
CLOCK = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
static __thread int is_of_job;
struct start { void *(*function)(void *); void *context; };
static void *begin(void *context)
{
    const struct start s = *(struct start *)context;
    free(context);
    is_of_job = 1;
    return s.function(s.context);
}
int pthread_create(pthread_t *thread, const pthread_attr_t *attributes, void *(*function)(void *), void *context)
{
    int (*real)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *) = dlsym(RTLD_NEXT, "pthread_create");
    Dl_info caller;
    if (is_of_job || !dladdr(__builtin_return_address(0), &caller) || !strstr(caller.dli_fname, "libhexad"))
        return real(thread, attributes, function, context);
    struct start *s = malloc(sizeof *s);
    *s = (struct start){function, context};
    return real(thread, attributes, begin, s);
}
int clock_gettime(clockid_t id, struct timespec *t)
{
    static int (*real)(clockid_t, struct timespec *);
    if (!real) real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    return real(id == CLOCK_MONOTONIC && is_of_job ? CLOCK_PROCESS_CPUTIME_ID : id, t);
}
"""
COUNT = 2048
PHASES = ("load", "start", "relax", "measure")
LARGEST = 15000  # triangles of a mesh of the data


def torus(around=100, across=50):
    """10 000 triangles."""
    u, v = numpy.meshgrid(*[numpy.linspace(0, 2 * numpy.pi, n, endpoint=False) for n in (around, across)], indexing="ij")
    radius = 2 + 0.7 * numpy.cos(v)
    vertices = numpy.stack([radius * numpy.cos(u), radius * numpy.sin(u), 0.7 * numpy.sin(v)], axis=-1).reshape(-1, 3)
    index = numpy.arange(around * across).reshape(around, across)
    quads = numpy.stack([index, numpy.roll(index, -1, 0), numpy.roll(index, (-1, -1), (0, 1)), numpy.roll(index, -1, 1)], axis=-1)
    quads = quads.reshape(-1, 4)
    return vertices, numpy.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def varied(data, count, seed=1):
    """Meshes of the data, each cut by a plane that leaves at least half of its triangles, turned and scaled."""
    random = numpy.random.default_rng(seed)
    found = [meshes.read(path) for path in sorted((data / "meshes").iterdir()) if path.suffix.lower() in (".obj", ".off", ".ply", ".stl")]
    found = [mesh for mesh in found if 500 < len(mesh.triangles) <= LARGEST]
    for k in range(count):
        mesh = found[k % len(found)]
        turn = numpy.linalg.qr(random.standard_normal((3, 3)))[0]
        turn *= numpy.linalg.det(turn)
        along = mesh.vertices[mesh.triangles].mean(1) @ turn[0]
        kept = mesh.triangles[along <= numpy.quantile(along, random.uniform(0.5, 1))]
        yield mesh.vertices @ turn.T * random.uniform(0.8, 1.25, 3), kept


def spent(report):
    return sum(report["timing_s"][phase] for phase in PHASES), report["timing_s"]["curvature"], report["timing_s"]["write"]


def call_once(surface, properties):
    """CPU seconds of the process, of the phases, and of the phases `curvature` and `write`."""
    import hexad
    begin = time.process_time()
    points = hexad.sample(*surface, count=COUNT, threads=1, properties=properties)
    return (time.process_time() - begin, *spent(points.report))


def call_many(surfaces):
    """The same sums of all meshes, and the number of those that failed."""
    import hexad
    import hexad.sample
    module, reports = sys.modules["hexad.sample"], []
    made = module.Sampled.__init__
    module.Sampled.__init__ = lambda self, arrays, report: (reports.append(report), made(self, arrays, report))[1]
    begin = time.process_time()
    samples = hexad.sample_many(surfaces, COUNT, processors=1)
    cpu = time.process_time() - begin
    return cpu, *map(float, numpy.sum([spent(report) for report in reports], axis=0)), sum(error is not None for error in samples.errors)


def inside(o):
    """In a process with the clock: prints the rows."""
    rows = []
    for name, properties in (("one call", "all"), ("one call without curvature", "minimal")):
        one = min((call_once(torus(), properties) for _ in range(o.runs)), key=lambda times: times[0] - times[1] - times[2])
        rows.append([name, 1, 0, *one])
    if o.meshes:
        *times, failed = call_many(list(varied(o.data, o.meshes)))
        rows.append(["many", o.meshes, failed, *times])
    print(json.dumps(rows))


def table(rows):
    header = ["row", "meshes", "failed", "cpu_s", "phases_s", "curvature_s", "write_s", "beyond_phases_ms", "beyond_phases_and_curvature_ms",
              "cpu_ratio", "cpu_ratio_with_curvature"]
    lines = [[name, count, failed, *(round(time, 4) for time in (cpu, phases, curvature, write)), round(1e3 * (cpu - phases) / count, 2),
              round(1e3 * (cpu - phases - curvature) / count, 2), round(cpu / phases, 3), round(cpu / (phases + curvature), 3)]
             for name, count, failed, cpu, phases, curvature, write in rows]
    return header, lines


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--library", required=True, type=pathlib.Path)
    parser.add_argument("--data", type=pathlib.Path)
    parser.add_argument("--output", type=pathlib.Path)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--meshes", type=int, default=200)
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    o = parser.parse_args()
    if o.inside:
        return inside(o)
    with tempfile.TemporaryDirectory() as folder:
        source, clock = pathlib.Path(folder) / "clock.c", pathlib.Path(folder) / "clock.so"
        source.write_text(CLOCK)
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", clock, source, "-ldl"], check=True)
        environment = {**os.environ, "LD_PRELOAD": str(clock), "HEXAD_LIBRARY": str(o.library.resolve())}
        done = subprocess.run([sys.executable, "-B", *sys.argv, "--inside"], env=environment, stdout=subprocess.PIPE, check=True)
    header, rows = table(json.loads(done.stdout))
    results.write(o.output, header, rows)
    for row in rows:
        print(*(f"{name} {value}" for name, value in zip(header, row)), sep=", ")


if __name__ == "__main__":
    main()
