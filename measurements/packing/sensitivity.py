#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures what each number of the schedules does: the effect of doubling and of halving it (measurements/packing/README.md).

    measurements/packing/sensitivity.py --build build [--output measurements/packing/sensitivity.csv] [--only NAME ...] [--jobs 2]
                         [--no-cpu]

For each number of src/sampling/solver/schedule.c, the program makes a worker from a copy of the sources and their build (a folder of the
sources, configured as ../configure) in which only this number is different in all schedules, and runs the same jobs with it and
with the worker of the build. All surfaces are generated. The CSV has a row for each number, change (doubled or halved) and case whose
result changes: hex_fraction, edge_cv, coverage, the work, which is the number of updates of particles and has no noise, and the CPU
time if the work does not explain it. Changes that another seed makes as well are left out; a change without an effect has one
row with the case "all cases". FILE_cases.csv beside it has the measures of the cases without a change.
"""
import argparse
import concurrent.futures
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

import numpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import results as csv_results  # noqa: E402

SOURCE = pathlib.Path(__file__).resolve().parents[2]
SCHEDULE = "src/sampling/solver/schedule.c"
SEEDS = (1, 2, 3)
RESULTS = (0, 10, 11)
HEADER = ["row", "number", "change", "case", "hex_fraction_change", "edge_cv_change_percent", "coverage_change_percent", "work_ratio", "cpu_ratio"]
# Below these a change is no larger than that of another seed.
HEX_NOISE, CV_NOISE, COVERAGE_NOISE, WORK_NOISE, CPU_NOISE = 0.004, 0.03, 0.03, 0.02, 0.1


def rough_sphere(path, subdivisions=4):
    """A sphere of 5 120 triangles whose vertices are off by 1 % of the radius at random, as of a scan."""
    golden = (1 + 5 ** 0.5) / 2
    points = [numpy.array(p, float) for p in
              [(-1, golden, 0), (1, golden, 0), (-1, -golden, 0), (1, -golden, 0), (0, -1, golden), (0, 1, golden),
               (0, -1, -golden), (0, 1, -golden), (golden, 0, -1), (golden, 0, 1), (-golden, 0, -1), (-golden, 0, 1)]]
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6), (7, 1, 8),
             (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    for _ in range(subdivisions):
        middle, finer = {}, []
        for face in faces:
            m = []
            for a, b in zip(face, face[1:] + face[:1]):
                key = min(a, b), max(a, b)
                if key not in middle:
                    middle[key] = len(points)
                    points.append(points[a] + points[b])
                m.append(middle[key])
            a, b, c = face
            finer += [(a, m[0], m[2]), (b, m[1], m[0]), (c, m[2], m[1]), tuple(m)]
            for k in m:
                points[k] /= numpy.linalg.norm(points[k])
        faces = finer
    noise = numpy.random.default_rng(1)
    points = [p / numpy.linalg.norm(p) * (1 + 0.01 * noise.standard_normal()) for p in points]
    path.write_text(f"OFF\n{len(points)} {len(faces)} 0\n" + "".join("%.9g %.9g %.9g\n" % tuple(p) for p in points) +
                    "".join("3 %d %d %d\n" % f for f in faces))


def box(path):
    corners = [(x, y, z) for x in (0, 2) for y in (0, 1) for z in (0, 1.5)]
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
    path.write_text("OFF\n8 12 0\n" + "".join("%g %g %g\n" % c for c in corners) + "".join("3 %d %d %d\n" % f for f in faces))


def clouds(path):
    """A level set of smooth noise with features down to two voxels, which few points do not resolve."""
    axis = numpy.arange(64)
    noise = numpy.random.default_rng(1).standard_normal((64, 64, 64))
    waves = numpy.meshgrid(numpy.fft.fftfreq(64), numpy.fft.fftfreq(64), numpy.fft.rfftfreq(64), indexing="ij")
    frequency = numpy.sqrt(sum(w * w for w in waves))
    field = numpy.fft.irfftn(numpy.fft.rfftn(noise) * numpy.exp(-(frequency * 20) ** 2 / 2), s=noise.shape)
    field /= field.std()
    fade = numpy.minimum(axis, 63 - axis) / 6.0
    edge = numpy.minimum(numpy.minimum(fade[:, None, None], fade[None, :, None]), fade[None, None, :])
    data = numpy.where(edge < 1, field - 3 * (1 - edge), field).astype("<f4")
    header = "NRRD0004\ntype: float\ndimension: 3\nsizes: 64 64 64\nencoding: raw\nendian: little\nspacings: 1 1 1\n\n"
    path.write_bytes(header.encode() + data.tobytes(order="F"))


def cases(work):
    """Name -> surface, members of sampling and of solver."""
    rough_sphere(work / "rough.off")
    box(work / "box.off")
    clouds(work / "clouds.nrrd")
    torus = {"analytic": {"shape": "torus", "major_radius": 0.3, "minor_radius": 0.12}}
    ball = {"shape": "sphere", "radius": 0.3}
    fog = {"volume": {"path": str(work / "clouds.nrrd"), "isovalue": 0.5}}
    return {
        "torus": (torus, {"count": 10000}, {}),
        "gyroid": ({"analytic": {"shape": "gyroid", "period": 0.5}}, {"count": 4000}, {}),
        "graded torus": (torus, {"count": 6000, "curvature": {"ratio": 10}}, {}),
        "rough mesh": ({"mesh": {"path": str(work / "rough.off")}}, {"count": 6000}, {}),
        "CAD model": ({"mesh": {"path": str(work / "box.off")}}, {"count": 4000}, {}),
        "two spheres": ({"union": [{"analytic": {**ball, "center": [0.4, 0.5, 0.5]}}, {"analytic": {**ball, "center": [0.65, 0.5, 0.5]}}]},
                        {"count": 3000}, {}),
        "cloud, 3 000": (fog, {"count": 3000}, {}),
        "cloud, 20 000": (fog, {"count": 20000}, {}),
        "paper": ({"analytic": {"shape": "quartic"}}, {"count": 600}, {"method": "paper"}),
        "amplitudes": ({"analytic": {"shape": "quartic"}}, {"count": 6000, "alpha": {"d": 2}}, {}),
    }


def result(worker, case, seed):
    """hex_fraction, edge_cv, coverage, updates of particles in all, CPU seconds; None: an error."""
    surface, sampling, solver = case
    spec = {"version": 1, "surface": surface, "sampling": sampling, "output": {"preview": False},
            "solver": {"threads": 1, "seed": seed, **solver}, "limits": {"timeout_s": 120}}
    with tempfile.TemporaryDirectory() as out:
        child = subprocess.Popen([worker, "run", "-", "--output", out], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL,
                                 stderr=subprocess.DEVNULL)
        child.stdin.write(json.dumps(spec).encode())
        child.stdin.close()
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode not in RESULTS:
            return None
        report = json.loads((pathlib.Path(out) / "report.json").read_text())
    quality = report["quality"]
    updates = sum(r["sweeps"] * r["count"] for r in report["rounds"])
    return quality["hex_fraction"], quality["edge_cv"], quality["coverage"], updates, usage.ru_utime


def results(pool, worker, all_cases):
    """Name -> results of the seeds."""
    waiting = {name: [pool.submit(result, worker, case, seed) for seed in SEEDS] for name, case in all_cases.items()}
    return {name: [job.result() for job in jobs] for name, jobs in waiting.items()}


def effect(before, after, with_cpu):
    """The last five cells of a row, between lists of results of the same seeds; None: within the noise."""
    if any(a is None for a in after):
        return ["no result"] * 5
    before, after = numpy.array(before), numpy.array(after)
    (hexagons, cv, coverage, work, cpu), (hexagons_now, cv_now, coverage_now, work_now, cpu_now) = before.mean(0), after.mean(0)
    noise = before.std(0, ddof=1)
    cells = [None] * 5
    if abs(hexagons_now - hexagons) > max(HEX_NOISE, noise[0]):
        cells[0] = f"{hexagons_now - hexagons:.3f}"
    if abs(cv_now / cv - 1) > max(CV_NOISE, noise[1] / cv):
        cells[1] = f"{100 * (cv_now / cv - 1):.0f}"
    if abs(coverage_now / coverage - 1) > max(COVERAGE_NOISE, noise[2] / coverage):
        cells[2] = f"{100 * (coverage_now / coverage - 1):.0f}"
    if abs(work_now / work - 1) > max(WORK_NOISE, noise[3] / work):
        cells[3] = f"{work_now / work:.2f}"
    elif with_cpu and abs(cpu_now / cpu - 1) > max(CPU_NOISE, noise[4] / cpu):
        cells[4] = f"{cpu_now / cpu:.2f}"
    return cells


def rows_of(number, change, effects):
    """Rows of the CSV, of the effects on each case by name."""
    changed = {case: cells for case, cells in effects.items() if any(cells)} or {"all cases": [None] * 5}
    return [[f"{number} {change} {case}", number, change, case, *cells] for case, cells in changed.items()]


def numbers(text):
    """Names of the numbers of the schedules; `name.0` and `name.1` are members of an array."""
    found = {}
    for name, value in re.findall(r"\.(\w+) = (\{[^}]*\}|[-\d.e]+)", text):
        values = re.findall(r"[-\d.e]+", value)
        found.update(dict.fromkeys([name] if len(values) == 1 else [f"{name}.{k}" for k in range(len(values))]))
    return list(found)


def scaled(text, number, factor):
    """The source with this number times the factor in all schedules. Whole numbers stay whole."""
    name, _, index = number.partition(".")

    def change(number):
        value = float(number) * factor
        whole = "." not in number and "e" not in number
        return str(round(value)) if whole and value >= 1 else repr(value)

    def member(match):
        values = re.findall(r"[-\d.e]+", match[2])
        if index:
            values[int(index)] = change(values[int(index)])
            return match[1] + "{" + ", ".join(values) + "}"
        return match[1] + change(values[0])

    return re.sub(rf"(\.{name} = )(\{{[^}}]*\}}|[-\d.e]+)", member, text)


class Builds:
    """A copy of the sources and their build, which makes workers with one number changed."""

    def __init__(self, work, build):
        self.tree = work / "source" / build.relative_to(SOURCE)
        shutil.copytree(SOURCE, work / "source", symlinks=True, ignore=shutil.ignore_patterns(".git", "node_modules"))
        self.path = work / "source" / SCHEDULE
        self.text = self.path.read_text()
        self.worker("unchanged", self.text)

    def worker(self, name, text):
        """The path of a worker with this schedule.c."""
        self.path.write_text(text)
        subprocess.run(["make", "-s", "hexad-worker"], cwd=self.tree, check=True, capture_output=True)
        path = self.tree / f"worker-{name}"
        shutil.copy2(self.tree / "hexad-worker", path)
        return path


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", type=pathlib.Path, required=True)
    parser.add_argument("--output", type=pathlib.Path)
    parser.add_argument("--only", nargs="*", default=[], help="numbers whose names begin so")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--no-cpu", action="store_true", help="no CPU times, on a machine with other work")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory, concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        work = pathlib.Path(directory)
        all_cases = cases(work)
        builds = Builds(work, options.build.resolve())
        base = results(pool, builds.tree / "worker-unchanged", all_cases)
        failed = [name for name, found in base.items() if None in found]
        if failed:
            raise SystemExit(f"no result without a change: {', '.join(failed)}")
        lines = []
        for number in numbers(builds.text):
            if options.only and not number.startswith(tuple(options.only)):
                continue
            for change, factor in (("doubled", 2), ("halved", 0.5)):
                worker = builds.worker("changed", scaled(builds.text, number, factor))
                found = results(pool, worker, all_cases)
                lines += rows_of(number, change, {case: effect(base[case], found[case], not options.no_cpu) for case in all_cases})
                print(*(row[0] for row in lines if row[1:3] == [number, change]), sep="\n", flush=True)
    if options.output:
        means = [[name, all_cases[name][1]["count"], *(f"{v:.3f}" for v in numpy.mean(found, axis=0)[:3])] for name, found in base.items()]
        csv_results.write(options.output, HEADER, lines)
        csv_results.write(options.output.with_name(f"{options.output.stem}_cases.csv"), ["case", "points", "hex_fraction", "edge_cv", "coverage"],
                          means)


if __name__ == "__main__":
    sys.exit(main())
