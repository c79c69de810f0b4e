#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs coherent sequences frame by frame and measures the motion of their points relative to the surface (measurements/sequences/README.md).

    measurements/sequences/sequence.py --worker build/hexad-worker --output measurements/sequences/sequences.csv
                                      [--case NAME ...] [--short] [--keep DIR]

Cases: a torus that moves, turns about a tilted axis and grows, as level sets; and, where HEXAD_SHARED has them, what
lies between frames 2 and 3 of blender_smoke, which themselves have little to do with each other, and these alone. What
the report says of drift is not used. hex_fraction comes from measure.py. The CSV has a row for each sequence; FILE_frames.csv beside it
has one for each frame, and FILE_alone.csv those of the files. Ends with 1 when a measure misses its bound.
"""
import argparse
import json
import os
import pathlib
import resource
import subprocess
import sys
import tempfile

import numpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import levelsets  # noqa: E402
import measure  # noqa: E402
import results as csv_results  # noqa: E402

DRIFT_MOST, HEX_LEAST = 0.1, 0.93  # median over h per frame; share of points with six neighbours


# ---- the torus

def rotation(vector):
    """The matrix that turns about the vector by its length."""
    angle = numpy.linalg.norm(vector)
    if angle == 0:
        return numpy.eye(3)
    x, y, z = numpy.asarray(vector) / angle
    cross = numpy.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return numpy.eye(3) + numpy.sin(angle) * cross + (1 - numpy.cos(angle)) * cross @ cross


class Torus:
    """Where it is in a frame: its centre, its frame of axes (z is its own), and its radii."""

    def __init__(self, frame, shape):
        t = frame - 1
        self.centre = numpy.array(shape["velocity"]) * t
        self.axes = rotation(numpy.array(shape["turn"]) * t)
        self.major, self.minor = (r * g ** t for r, g in zip(shape["radii"], shape["growth"]))

    def distance(self, x):
        local = (x - self.centre) @ self.axes
        return numpy.hypot(numpy.hypot(local[..., 0], local[..., 1]) - self.major, local[..., 2]) - self.minor

    def area(self):
        return 4 * numpy.pi ** 2 * self.major * self.minor

    def carry(self, x, other):
        """Where points of this torus are on the other when the surface moves and nothing slides along it: angles
        around the tube and around the axis stay, the latter from where the shortest turn brings the axis."""
        old, new = self.axes[:, 2], other.axes[:, 2]
        axis = numpy.cross(old, new)
        sine = numpy.linalg.norm(axis)
        turn = rotation(axis / sine * numpy.arctan2(sine, old @ new)) if sine > 0 else numpy.eye(3)
        arm = (x - self.centre) @ turn.T
        height = arm @ new
        flat = arm - height[:, None] * new
        out = numpy.linalg.norm(flat, axis=1)
        tube = numpy.stack([out - self.major, height], axis=1) * (other.minor / self.minor)
        return other.centre + flat / out[:, None] * (other.major + tube[:, 0])[:, None] + tube[:, 1:] * new


    def reach(self):
        return numpy.full(3, self.major + self.minor)


class BendingTorus:
    """A torus whose circle in the middle rises and falls twice around the axis z, more in each frame."""

    def __init__(self, frame, shape):
        self.centre = numpy.zeros(3)
        self.major, self.minor = shape["radii"]
        self.height = shape["height"] * (frame - 1)

    def bend(self, x):
        return self.height * numpy.cos(2 * numpy.arctan2(x[..., 1], x[..., 0]))

    def distance(self, x):
        """The distance along z from the bent circle is that of a level; it is divided by the length of the gradient."""
        out = numpy.hypot(x[..., 0], x[..., 1])
        level = numpy.hypot(out - self.major, x[..., 2] - self.bend(x)) - self.minor
        slope = 2 * self.height * numpy.sin(2 * numpy.arctan2(x[..., 1], x[..., 0])) / numpy.maximum(out, 0.1 * self.major)
        tilt = (x[..., 2] - self.bend(x)) / numpy.maximum(level + self.minor, 1e-9)
        return level / numpy.sqrt(1 + (slope * tilt) ** 2)

    def area(self):
        around, tube = numpy.meshgrid(*[2 * numpy.pi * (numpy.arange(n) + 0.5) / n for n in (720, 360)], indexing="ij")
        out = self.major + self.minor * numpy.cos(tube)
        slope = -2 * self.height * numpy.sin(2 * around)
        along = numpy.stack([-out * numpy.sin(around), out * numpy.cos(around), slope], -1)
        across = self.minor * numpy.stack([-numpy.sin(tube) * numpy.cos(around), -numpy.sin(tube) * numpy.sin(around), numpy.cos(tube)], -1)
        return numpy.linalg.norm(numpy.cross(along, across), axis=-1).mean() * (2 * numpy.pi) ** 2

    def carry(self, x, other):
        return x + numpy.stack([0 * x[:, 0], 0 * x[:, 1], other.bend(x) - self.bend(x)], 1)

    def reach(self):
        return numpy.array([self.major + self.minor] * 2 + [abs(self.height) + self.minor])


class Tube:
    """A straight tube along x with half spheres as ends; it becomes longer and wider by factors."""

    def __init__(self, frame, shape):
        self.centre = numpy.zeros(3)
        self.half, self.radius = (r * g ** (frame - 1) for r, g in zip((shape["length"] / 2, shape["radius"]), shape["growth"]))

    def distance(self, x):
        beyond = numpy.maximum(abs(x[..., 0]) - self.half, 0)
        return numpy.sqrt(beyond ** 2 + x[..., 1] ** 2 + x[..., 2] ** 2) - self.radius

    def area(self):
        return 4 * numpy.pi * self.radius * (self.half + self.radius)

    def carry(self, x, other):
        along = numpy.clip(x[:, 0], -self.half, self.half)
        centre = numpy.stack([along, 0 * along, 0 * along], 1)
        return centre * (other.half / self.half) + (x - centre) * (other.radius / self.radius)

    def reach(self):
        return numpy.array([self.half + self.radius, self.radius, self.radius])


SHAPES = {"torus": Torus, "bending": BendingTorus, "tube": Tube}


def shape_of(case, frame):
    """The shape of a case that has a formula; otherwise None."""
    return next((made(frame, case[name]) for name, made in SHAPES.items() if name in case), None)


def write_shape(shape, voxel, path):
    reach = shape.reach() + (levelsets.BAND + 2) * voxel
    low = numpy.floor((shape.centre - reach) / voxel).astype(int)
    high = numpy.ceil((shape.centre + reach) / voxel).astype(int)
    axes = [numpy.arange(a, b + 1) * voxel for a, b in zip(low, high)]
    levelsets.write_array(shape.distance(numpy.stack(numpy.meshgrid(*axes, indexing="ij"), axis=-1)), low, voxel, path)


TORUS = {"radii": [1.0, 0.4], "velocity": [0.05, 0.03, 0.02], "turn": [0.02, 0.06, 0.04], "growth": [1.01, 1.01]}
SMOKE = "vdb/blender_smoke_{:06d}.vdb"


def at_density(isovalue):
    return {"grid": "density", "isovalue": isovalue, "reconstruction": "smoothing"}


CASES = {
    "torus": {"what": "4000 points on a torus that moves, turns about a tilted axis and grows by 1 % a frame",
              "torus": TORUS, "frames": range(1, 21), "sampling": {"count": 4000}, "voxel": 0.04},
    "torus, thicker": {"what": "the same torus, except that only the tube grows, which stretches the outer half of the surface",
                       "torus": {**TORUS, "growth": [1.0, 1.01]}, "frames": range(1, 21),
                       "sampling": {"count": 4000}, "voxel": 0.04},
    "torus, spacing": {"what": "the torus of the first case at a spacing of 0.067: 2 % more points in each frame",
                       "torus": TORUS, "frames": range(1, 21), "sampling": {"spacing": 0.067}, "voxel": 0.04},
    "torus, wide spacing": {"what": "the same at a spacing of 0.084, a fifth of the tube's radius",
                            "torus": TORUS, "frames": range(1, 21), "sampling": {"spacing": 0.084}, "voxel": 0.04},
    "torus, shrinking": {"what": "the torus of the first case at a spacing of 0.067, 1 % smaller in each frame",
                         "torus": {**TORUS, "growth": [0.99, 0.99]}, "frames": range(1, 21),
                         "sampling": {"spacing": 0.067}, "voxel": 0.04},
    "torus, bending": {"what": "4000 points on a torus whose circle in the middle becomes a saddle in 60 frames",
                       "bending": {"radii": [1.0, 0.4], "height": 0.01}, "frames": range(1, 61),
                       "sampling": {"count": 4000}, "voxel": 0.04},
    "tube, growing": {"what": "4000 points on a tube that becomes longer by 0.5 % a frame",
                      "tube": {"length": 4.0, "radius": 0.5, "growth": [1.005, 1.0]}, "frames": range(1, 61),
                      "sampling": {"count": 4000}, "voxel": 0.04},
    "tube, wider": {"what": "the same tube, except that it becomes wider by 0.5 % a frame, not longer",
                    "tube": {"length": 4.0, "radius": 0.5, "growth": [1.0, 1.005]}, "frames": range(1, 61),
                    "sampling": {"count": 4000}, "voxel": 0.04},
    "smoke": {"what": "40 000 points on blender_smoke at density 0.8, from frame 2 towards 3 by 1/400 a frame",
              "blend": SMOKE, "steps": 400, "frames": range(1, 6), "sampling": {"count": 40000},
              "vdb": at_density(0.8)},
    "smoke, cut": {"what": "the same with the unchanged frames 2 and 3: less than half of the points find a surface"
                           " with a similar normal, so frame 3 is sampled anew",
                   "blend": SMOKE, "steps": 1, "frames": range(1, 3), "sampling": {"count": 40000},
                   "vdb": at_density(0.8)},
    "smoke, coarse": {"what": "15 000 points at density 0.3, by 1/40 a frame: the spacing of 1.2 voxels is larger"
                              " than the folds, and a frame alone has no higher hex",
                      "blend": SMOKE, "steps": 40, "frames": range(1, 6), "sampling": {"count": 15000},
                      "vdb": at_density(0.3), "hex_least": 0.85},
}
# Frames of the smoke alone, which is what a sequence can at most be held to: density, counts.
ALONE = {0.3: (5000, 15000, 40000, 160000), 0.8: (5000, 15000, 40000)}


# ---- smoke

VOXEL = 0.1325  # of the files
# The voxels that hold all of frames 2 and 3.
LOW, SIZE = (-2, -2, -2), (56, 54, 104)


def write_blend(case, shared, frame, path):
    """Between frames 2 (at 1) and 3, of whose densities it has the weighted mean."""
    import pyopenvdb
    grids = [pyopenvdb.read(str(shared / case["blend"].format(k)), case["vdb"]["grid"]) for k in (2, 3)]
    share, mixed = (frame - 1) / case["steps"], 0
    for grid, weight in zip(grids, (1 - share, share)):
        density = numpy.zeros(SIZE, numpy.float32)
        grid.copyToArray(density, ijk=LOW)
        mixed = mixed + numpy.float32(weight) * density
    made = pyopenvdb.FloatGrid()
    made.copyFromArray(mixed, ijk=LOW)
    made.transform, made.name, made.gridClass = grids[0].transform, "density", pyopenvdb.GridClass.FOG_VOLUME
    pyopenvdb.write(str(path), grids=[made])


# ---- running

def surface_of(name, case, shared, where):
    """The files of a case, and its surface with the frames' places."""
    for frame in case["frames"]:
        path = where / f"{name}.{frame:04d}.vdb"
        if shape_of(case, frame):
            write_shape(shape_of(case, frame), case["voxel"], path)
        else:
            write_blend(case, shared, frame, path)
    return {"vdb": {"path": str(where / f"{name}.####.vdb"), **case.get("vdb", {})}}


def processor_s():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def run_frame(worker, spec, frame, where, previous):
    words = [worker, "run", "-", "--output", where]
    if "queue" in spec:
        words += ["--frame", str(frame)]
    if previous:
        words += ["--previous", previous]
    before = processor_s()
    done = subprocess.run(words, input=json.dumps(spec), text=True, capture_output=True)
    spent = processor_s() - before
    if done.returncode not in (0, 10, 11):
        raise RuntimeError(f"frame {frame}: {done.stderr.strip().splitlines()[-1]}")
    with open(where / "report.json", encoding="utf-8") as file:
        return measure.read_ply(where / "points.ply"), {**json.load(file), "processor_s": spent}


def ways(case, frame, before, after):
    """How far the points that are in both frames went beside the surface's own motion, world units."""
    _, i, j = numpy.intersect1d(before.columns["id"], after.columns["id"], return_indices=True)
    start, end = before.position[i], after.position[j]
    if shape_of(case, frame):
        expected = shape_of(case, frame - 1).carry(start, shape_of(case, frame))
        return numpy.linalg.norm(end - expected, axis=1)
    way, normal = end - start, after.normal[j]
    return numpy.linalg.norm(way - (way * normal).sum(1)[:, None] * normal, axis=1)


def hex_alone(worker, spec, frame, where):
    """hex_fraction of a frame that is sampled as if there were no others."""
    points, report = run_frame(worker, {**spec, "queue": {"frames": spec["queue"]["frames"]}}, frame, where, None)
    return measure.measure(points, report["surface"]["area"])["hex_fraction"]


def measure_frame(case, frame, points, report, before):
    shape = shape_of(case, frame)
    area = shape.area() if shape else report["surface"]["area"]
    quality, told = measure.measure(points, area), report["sequence"]
    way = ways(case, frame, before, points) / quality["h"] if before else numpy.zeros(0)
    kept = len(way) > 0
    return {"frame": frame, "count": points.count, "hex": quality["hex_fraction"], "area_cv": quality["area_cv"],
            "born": told["born"], "died": told["died"], "sweeps": report["sweeps_total"],
            "processor_s": report["processor_s"], "kept": told["carried"] / points.count if before else None,
            "median": float(numpy.median(way)) if kept else None,
            "p95": float(numpy.quantile(way, 0.95)) if kept else None}


def run_case(worker, name, case, shared, where, frames):
    surface = surface_of(name, {**case, "frames": frames}, shared, where)
    spec = {"version": 1, "surface": surface, "sampling": case["sampling"], "output": {"preview": False, "ply": {"properties": ["all"]}},
            "queue": {"frames": f"{frames[0]}-{frames[-1]}", "coherent": True}}
    rows, before, previous = [], None, None
    for frame in frames:
        place = where / f"{name}.{frame}"
        points, report = run_frame(worker, spec, frame, place, previous)
        rows.append(measure_frame(case, frame, points, report, before))
        if "blend" in case:
            rows[-1]["alone"] = hex_alone(worker, spec, frame, where / f"{name}.{frame}.alone")
        before, previous = points, place
        print(name, rows[-1], flush=True)
    return rows


def run_alone(worker, shared, where):
    """Rows of (file's number, density, points, spacing in voxels, share of points on walls thinner than 1.2 spacings, hex_fraction)."""
    rows = []
    for number in (2, 3):
        for density, counts in ALONE.items():
            for count in counts:
                surface = {"vdb": {"path": str(shared / SMOKE.format(number)), **at_density(density)}}
                spec = {"version": 1, "surface": surface, "sampling": {"count": count}, "output": {"preview": False, "ply": {"properties": ["all"]}}}
                points, report = run_frame(worker, spec, number, where / "alone", None)
                hexes = measure.measure(points, report["surface"]["area"])["hex_fraction"]
                rows.append((number, density, count, report["spacing"] / VOXEL,
                             report["quality"]["thin_count"] / count, hexes))
                print("alone", rows[-1], flush=True)
    return rows


# ---- the results

FRAMES = ["row", "sequence", "frame", "points", "motion_median", "motion_p95", "hex_fraction", "hex_fraction_alone", "area_cv", "born", "died",
          "sweeps"]
SEQUENCES = ["sequence", "frames", "points_first", "points_last", "motion_median_largest", "motion_p95_largest", "hex_fraction_least",
             "hex_fraction_bound", "hex_fraction_alone_least", "area_cv_largest", "born", "died", "kept_least", "sweeps_largest", "processor_s", "missed"]
ALONE_HEADER = ["row", "file", "density", "points", "spacing_voxels", "on_thin_walls_share", "hex_fraction"]


def is_good(case, row):
    return row["hex"] >= case.get("hex_least", HEX_LEAST) and (row["median"] is None or row["median"] < DRIFT_MOST)


def number(value, form):
    return None if value is None else form.format(value)


def frame_row(name, r):
    return [f"{name} {r['frame']}", name, r["frame"], r["count"], number(r["median"], "{:.4f}"), number(r["p95"], "{:.3f}"), f"{r['hex']:.3f}",
            number(r.get("alone"), "{:.3f}"), f"{r['area_cv']:.3f}", r["born"], r["died"], r["sweeps"]]


def sequence_row(name, rows):
    """Extremes over the frames; born, died and sweeps without the first frame. `rows` may be the reason why there are none."""
    case = CASES[name]
    if isinstance(rows, str):
        return [name, *[None] * (len(SEQUENCES) - 2), rows]

    def of(key, choose, form):
        values = [r[key] for r in rows if r.get(key) is not None]
        return form.format(choose(values)) if values else None
    later = rows[1:]
    return [name, len(rows), rows[0]["count"], rows[-1]["count"], of("median", max, "{:.4f}"), of("p95", max, "{:.3f}"), of("hex", min, "{:.3f}"),
            case.get("hex_least", HEX_LEAST), of("alone", min, "{:.3f}"), of("area_cv", max, "{:.3f}"), sum(r["born"] for r in later),
            sum(r["died"] for r in later), of("kept", min, "{:.4f}"), max((r["sweeps"] for r in later), default=None), f"{sum(r['processor_s'] for r in rows):.1f}", sum(not is_good(case, r) for r in rows)]


def write_results(path, found, alone=()):
    csv_results.write(path, SEQUENCES, [sequence_row(name, rows) for name, rows in found.items()])
    csv_results.write(path.with_name(f"{path.stem}_frames.csv"), FRAMES,
                      [frame_row(name, r) for name, rows in found.items() if not isinstance(rows, str) for r in rows])
    if alone:
        csv_results.write(path.with_name(f"{path.stem}_alone.csv"), ALONE_HEADER,
                          [[f"file {n} density {d} points {c}", n, d, c, f"{h:.2f}", f"{u:.2f}", f"{x:.3f}"] for n, d, c, h, u, x in alone])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worker", required=True, type=lambda name: pathlib.Path(name).resolve())
    parser.add_argument("--output", type=pathlib.Path)
    parser.add_argument("--case", nargs="*", default=list(CASES), choices=list(CASES))
    parser.add_argument("--short", action="store_true", help="three frames of each")
    parser.add_argument("--keep", type=pathlib.Path, help="a directory for all files; else a temporary one")
    given = parser.parse_args()
    shared = pathlib.Path(os.environ["HEXAD_SHARED"]) if os.environ.get("HEXAD_SHARED") else None
    results, alone = {}, []
    with tempfile.TemporaryDirectory() as scratch:
        where = given.keep or pathlib.Path(scratch)
        where.mkdir(exist_ok=True)
        for name in given.case:
            case = CASES[name]
            if "blend" in case and not (shared and (shared / case["blend"].format(2)).exists()):
                results[name] = "Skipped: the data are not there (HEXAD_SHARED)."
                continue
            frames = list(case["frames"])[:3 if given.short else None]
            results[name] = run_case(given.worker, name, case, shared, where, frames)
        if shared and (shared / SMOKE.format(2)).exists() and set(given.case) == set(CASES) and not given.short:
            alone = run_alone(given.worker, shared, where)
    for name, rows in results.items():
        print(*(f"{key} {value}" for key, value in zip(SEQUENCES, sequence_row(name, rows)) if value is not None), sep=", ")
    if given.output:
        write_results(given.output, results, alone)
    return any(not is_good(CASES[name], row) for name, rows in results.items() if not isinstance(rows, str)
               for row in rows)


if __name__ == "__main__":
    sys.exit(main())
