#!/usr/bin/env python3
"""Runs coherent sequences frame by frame and writes how well their points stay put (doc/sequences.md).

    tools/sequence.py --worker build/hexad-worker --output doc/sequences.md [--case NAME ...] [--short] [--keep DIR]

Cases: a torus that moves, turns about a tilted axis and grows, as level sets; and, where HEXAD_SHARED has them, frames
2 and 3 of blender_smoke. What the report says of drift is not used: of the torus the motion of every point of its
surface is known by a formula, of smoke nobody knows it, and what counts is the way beside that along the normal.
hex_fraction comes from measure.py. Ends with 1 when a measure misses its bound.
"""
import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy
from scipy.spatial import cKDTree

import levelsets
import measure

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


def write_torus(torus, voxel, path):
    reach = torus.major + torus.minor + (levelsets.BAND + 2) * voxel
    low = numpy.floor((torus.centre - reach) / voxel).astype(int)
    high = numpy.ceil((torus.centre + reach) / voxel).astype(int)
    axes = [numpy.arange(a, b + 1) * voxel for a, b in zip(low, high)]
    levelsets.write_array(torus.distance(numpy.stack(numpy.meshgrid(*axes, indexing="ij"), axis=-1)), low, voxel, path)


TORUS = {"radii": [1.0, 0.4], "velocity": [0.05, 0.03, 0.02], "turn": [0.02, 0.06, 0.04], "growth": [1.01, 1.01]}
CASES = {
    "torus": {"torus": TORUS, "frames": range(1, 21), "sampling": {"count": 4000}, "voxel": 0.04},
    "torus-thicker": {"torus": {**TORUS, "growth": [1.0, 1.01]}, "frames": range(1, 21), "sampling": {"count": 4000},
                      "voxel": 0.04},
    "torus-spacing": {"torus": TORUS, "frames": range(1, 21), "sampling": {"spacing": 0.067}, "voxel": 0.04},
    "smoke": {"files": "vdb/blender_smoke_{:06d}.vdb", "frames": range(2, 4), "sampling": {"count": 5000},
              "vdb": {"grid": "density", "isovalue": 0.1}},
}


# ---- running

def surface_of(name, case, shared, where):
    """The files of a case, and its surface with the frames' places."""
    if "torus" not in case:
        path = str(shared / case["files"]).replace("{:06d}", "######")
        return {"vdb": {"path": path, **case["vdb"]}}
    for frame in case["frames"]:
        write_torus(Torus(frame, case["torus"]), case["voxel"], where / f"{name}.{frame:04d}.vdb")
    return {"vdb": {"path": str(where / f"{name}.####.vdb")}}


def run_frame(worker, spec, frame, where, previous):
    words = [worker, "run", "-", "--output", where, "--frame", str(frame)]
    if previous:
        words += ["--previous", previous]
    done = subprocess.run(words, input=json.dumps(spec), text=True, capture_output=True)
    if done.returncode not in (0, 10):
        raise RuntimeError(f"frame {frame}: {done.stderr.strip().splitlines()[-1]}")
    with open(where / "report.json", encoding="utf-8") as file:
        return measure.read_ply(where / "points.ply"), json.load(file)


def ways(case, frame, before, after):
    """How far the points that are in both frames went beside the surface's own motion, world units."""
    _, i, j = numpy.intersect1d(before.columns["id"], after.columns["id"], return_indices=True)
    start, end = before.position[i], after.position[j]
    if "torus" in case:
        expected = Torus(frame - 1, case["torus"]).carry(start, Torus(frame, case["torus"]))
        return numpy.linalg.norm(end - expected, axis=1)
    way, normal = end - start, after.normal[j]
    return numpy.linalg.norm(way - (way * normal).sum(1)[:, None] * normal, axis=1)


def measure_frame(case, frame, points, report, before):
    area = Torus(frame, case["torus"]).area() if "torus" in case else report["surface"]["area"]
    quality = measure.measure(points, area)
    row = {"frame": frame, "count": points.count, "hex": quality["hex_fraction"], "area_cv": quality["area_cv"],
           "sweeps": len(report["sweeps"]), "outcome": report["outcome"], "born": report["sequence"]["born"],
           "died": report["sequence"]["died"], "seconds": report["timing_s"]["total"], "median": 0.0, "p95": 0.0,
           "told": report["sequence"].get("drift", {}).get("median", 0)}
    if before:
        way = ways(case, frame, before, points) / quality["h"]
        row |= {"median": float(numpy.median(way)), "p95": float(numpy.quantile(way, 0.95))}
    return row


def run_case(worker, name, case, shared, where, frames):
    surface = surface_of(name, {**case, "frames": frames}, shared, where)
    spec = {"version": 1, "surface": surface, "sampling": case["sampling"], "output": {"preview": False},
            "queue": {"frames": f"{frames[0]}-{frames[-1]}", "coherent": True}}
    rows, before, previous = [], None, None
    for frame in frames:
        place = where / f"{name}.{frame}"
        points, report = run_frame(worker, spec, frame, place, previous)
        rows.append(measure_frame(case, frame, points, report, before))
        before, previous = points, place
        r = rows[-1]
        print(f"{name} {frame}: hex {r['hex']:.3f} area_cv {r['area_cv']:.3f} median {r['median']:.4f} ({r['told']:.4f}) p95 {r['p95']:.3f}"
              f" born {r['born']} died {r['died']} sweeps {r['sweeps']} {r['outcome']} {r['seconds']:.2f} s", flush=True)
    return rows


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--worker", required=True, type=pathlib.Path)
    parser.add_argument("--output", type=pathlib.Path)
    parser.add_argument("--case", nargs="*", default=list(CASES))
    parser.add_argument("--short", action="store_true", help="three frames of each")
    parser.add_argument("--keep", type=pathlib.Path, help="a directory for all files; else a temporary one")
    given = parser.parse_args()
    shared = pathlib.Path(os.environ["HEXAD_SHARED"]) if os.environ.get("HEXAD_SHARED") else None
    with tempfile.TemporaryDirectory() as scratch:
        where = given.keep or pathlib.Path(scratch)
        where.mkdir(exist_ok=True)
        for name in given.case:
            case = CASES[name]
            if "files" in case and not shared:
                print(f"{name}: skipped, HEXAD_SHARED is not set")
                continue
            frames = list(case["frames"])[:3 if given.short else None]
            run_case(given.worker, name, case, shared, where, frames)


if __name__ == "__main__":
    sys.exit(main())
