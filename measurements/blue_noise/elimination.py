#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Blue noise and the progressive order beside sample elimination (Yuksel 2015), on the six surfaces of measurements/blue_noise/order.py.

    measurements/blue_noise/elimination.py --worker build/hexad-worker --elimination PROGRAM [--open3d] --data DIRECTORY
                                           --output measurements/blue_noise/elimination.csv

PROGRAM is measurements/speed/peers/sample_elimination.cc, compiled with cyCodeBase. DIRECTORY has the folder meshes. --open3d also runs
sample_points_poisson_disk of Open3D. Candidates are five random points for each point, on the triangles of the mesh that a job with
output.mesh writes. CPU times of hexad are those of whole jobs on one thread; those of the others are of the elimination alone.
FILE_order.csv beside the output has the progressive order.
"""
import argparse
import json
import pathlib
import resource
import subprocess
import sys
import tempfile
import time

import numpy
from scipy.spatial import cKDTree

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import measure  # noqa: E402
import order  # noqa: E402
import results  # noqa: E402

CANDIDATES, PLACES, PLACES_OF_PREFIXES = 5, 20, 4
COUNTS = (1000, 10000, 100000)
HEADER = ["row", "surface", "points", "least_distance_hexad", "coverage_ratio_hexad", "least_distance_elimination",
          "coverage_ratio_elimination", "cpu_s_hexad", "cpu_s_cycodebase", "cpu_s_open3d", "cpu_ratio"]
ORDER = ["row", "surface", "points", *(f"{name}_{of}" for of in ("hexad", "elimination") for name in (
    "coverage_largest", "coverage_mean", "least_distance_smallest", "least_distance_mean")), "cpu_s_hexad", "cpu_s_cycodebase"]


def job(worker, data, surface, count, where, sampling, output):
    """Directory of the result, and CPU seconds."""
    surface = json.loads(json.dumps(surface))
    if "mesh" in surface:
        surface["mesh"]["path"] = str(data / "meshes" / surface["mesh"]["path"])
    spec = {"version": 1, "surface": surface, "sampling": {"count": count, **sampling}, "limits": {"memory_mb": 16000},
            "solver": {"threads": 1}, "output": {"preview": False, "ply": {"properties": ["all"]}, **output}}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([worker, "run", "-", "--output", where], input=json.dumps(spec), capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert done.returncode in (0, 10, 11), done.stderr
    return pathlib.Path(where), after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


class Mesh:
    """The triangles of a PLY file that hexad wrote."""

    def __init__(self, path):
        head, _, body = path.read_bytes().partition(b"end_header\n")
        words = [line.split() for line in head.decode().splitlines()]
        counts = [int(w[2]) for w in words if w[0] == "element"]
        kind = numpy.dtype([(w[2], order.TYPES[w[1]]) for w in words if w[0] == "property" and w[1] != "list"])
        vertex = numpy.frombuffer(body, kind, counts[0])
        faces = numpy.frombuffer(body, [("n", "u1"), ("v", "<i4", 3)], counts[1], offset=counts[0] * kind.itemsize)
        self.vertices = numpy.stack([vertex[a] for a in "xyz"], 1).astype(float)
        self.corners = self.vertices[faces["v"]]
        cross = numpy.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0])
        size = numpy.linalg.norm(cross, axis=1)
        self.areas, self.normals = size / 2, cross / size[:, None].clip(1e-300)
        self.triangles = faces["v"]

    def draw(self, count, generator):
        """Random points, and their normals."""
        t = generator.choice(len(self.areas), count, p=self.areas / self.areas.sum())
        u, v = generator.random((2, count, 1))
        flip = u + v > 1
        u, v = numpy.where(flip, 1 - u, u), numpy.where(flip, 1 - v, v)
        a, b, c = self.corners[t].transpose(1, 0, 2)
        return a + u * (b - a) + v * (c - a), self.normals[t]


class Set:
    """Points as order.measure takes them."""
    facing = order.Points.facing

    def __init__(self, x, normal, piece, h):
        self.x, self.normal, self.piece, self.h, self.count = x, normal, piece, numpy.full(len(x), h), len(x)


def distances(points, places):
    """Least distance over h, of points that are not on opposite walls, and coverage over the least distance."""
    counts = [points.count]
    coverage, least = order.measure(points, numpy.arange(points.count), counts, (places, numpy.full(len(places), points.h[0])))
    return least[0], coverage[0] / least[0]


def prefixes(points, places):
    counts = numpy.unique(numpy.geomspace(order.FIRST, points.count // 2, order.PREFIXES).round().astype(int))
    coverage, least = order.measure(points, numpy.arange(points.count), counts, (places, numpy.full(len(places), points.h[0])))
    return f"{coverage.max():.2f}", f"{coverage.mean():.2f}", f"{numpy.nanmin(least):.2f}", f"{numpy.nanmean(least):.2f}"


def eliminate(program, candidates, count, area, kind, where):
    """Kept points in their order, and CPU seconds."""
    candidates.tofile(f"{where}/candidates")
    told = subprocess.run([program, f"{where}/candidates", str(count), str(area), kind, f"{where}/kept"], capture_output=True, text=True,
                          check=True).stdout
    return numpy.fromfile(f"{where}/kept").reshape(-1, 3), float(told)


def open3d_seconds(mesh, count):
    import open3d
    whole = open3d.geometry.TriangleMesh(open3d.utility.Vector3dVector(mesh.vertices), open3d.utility.Vector3iVector(mesh.triangles))
    begin = time.process_time()
    whole.sample_points_poisson_disk(count, init_factor=CANDIDATES)
    return time.process_time() - begin


def rows(options, name, count):
    surface, sampling = order.SURFACES[name]
    sampling = {} if "curvature" in sampling else sampling
    with tempfile.TemporaryDirectory() as where:
        meshed, _ = job(options.worker, options.data, surface, max(count, 20000), f"{where}/mesh", {}, {"mesh": True})
        mesh, generator = Mesh(meshed / "mesh.ply"), numpy.random.default_rng(1)
        candidates, normals = mesh.draw(CANDIDATES * count, generator)
        places, _ = mesh.draw(PLACES * count, generator)
        h, tree = measure.ideal_spacing(mesh.areas.sum(), count), cKDTree(candidates)
        several, dense = name in order.SEVERAL, order.Points(meshed / "points.ply", name in order.SEVERAL)
        near = cKDTree(dense.x)

        def kept(kind):
            x, seconds = eliminate(options.elimination, candidates, count, mesh.areas.sum(), kind, where)
            return Set(x, normals[tree.query(x)[1]], dense.piece[near.query(x)[1]], h), seconds

        noise, noise_s = job(options.worker, options.data, surface, count, f"{where}/noise", {"pattern": "blue_noise"}, {})
        ordered, ordered_s = job(options.worker, options.data, surface, count, f"{where}/ordered", {}, {"order": "progressive"})
        ours, others = order.Points(noise / "points.ply", several), kept("none")
        ours.h[:] = h
        figures = [*(f"{v:.3f}" for v in (*distances(ours, places), *distances(others[0], places))), f"{noise_s:.2f}", f"{others[1]:.2f}"]
        figures.append(f"{open3d_seconds(mesh, count):.2f}" if options.open3d else None)
        few = PLACES_OF_PREFIXES * count
        first = [f"{name} {count}", name, count, *figures, f"{noise_s / others[1]:.1f}"]
        ours, others = order.Points(ordered / "points.ply", several), kept("progressive")
        ours.h[:] = h
        second = [f"{name} {count}", name, count, *prefixes(ours, places[:few]), *prefixes(others[0], places[:few]), f"{ordered_s:.2f}",
                  f"{others[1]:.2f}"]
    return first, second


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worker", required=True)
    parser.add_argument("--elimination", required=True)
    parser.add_argument("--open3d", action="store_true")
    parser.add_argument("--data", type=pathlib.Path, required=True)
    parser.add_argument("--output", type=pathlib.Path, required=True)
    parser.add_argument("--counts", default=",".join(map(str, COUNTS)))
    options = parser.parse_args()
    found = []
    for name in order.SURFACES:
        for count in map(int, options.counts.split(",")):
            found.append(rows(options, name, count))
            for header, row in zip((HEADER, ORDER), found[-1]):
                print(", ".join(f"{key} {value}" for key, value in zip(header[1:], row[1:])), flush=True)
    first, second = zip(*found)
    results.write(options.output, HEADER, first)
    results.write(options.output.with_name(f"{options.output.stem}_order.csv"), ORDER, second)
    return 0


if __name__ == "__main__":
    sys.exit(main())
