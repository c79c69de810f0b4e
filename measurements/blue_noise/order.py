#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Samples six surfaces with output.order "progressive", measures prefixes of the points beside farthest-point orders of
the same points (measurements/blue_noise/README.md).

    HEXAD_SHARED=... measurements/blue_noise/order.py --worker build/hexad-worker --output measurements/blue_noise/order.csv

Of N points with spacing h, the first n have coverage and least distance in units of h_n = h sqrt(N / n), at 24 values
of n from 32 to N / 2. Coverage: the largest distance of a place of the surface from its nearest point of the prefix, over
the spacing requested at the place; places are the N points and the centres of the triangles between neighbours. Least
distance: of two points of the prefix that belong to one piece and not to opposite walls (normals with a cosine up to
-0.4), over the mean of their spacings.

Two farthest-point orders begin with the same point: one by distances in space alone, and one by the distances that count
for the least distance. Both are computed here with a heap and a k-d tree of SciPy, without code of hexad. CPU times are
of whole jobs without previews.

Ends with 1 if a coverage is above 1.15, a least distance below 0.45, or either more than 5 % worse than the worse of
both orders, as means over the prefixes; or if a job takes more than 1.4 times the CPU time of the job without an order.
"""
import argparse
import heapq
import json
import os
import pathlib
import resource
import subprocess
import sys
import tempfile

import numpy
from scipy.spatial import cKDTree

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import results  # noqa: E402

COVERAGE, LEAST, WORSE, COST = 1.15, 0.45, 1.05, 1.4
HEADER = ["row", "surface", "points", "coverage_largest", "coverage_mean", "coverage_mean_in_space", "coverage_mean_within_walls",
          "least_distance_smallest", "least_distance_mean", "least_distance_mean_in_space", "least_distance_mean_within_walls",
          "cpu_s_without_order", "cpu_s_with_order"]
OPPOSITE = -0.4
FIRST, PREFIXES = 32, 24
SURFACES = {
    "sphere": ({"analytic": {"shape": "sphere", "center": [0, 0, 0], "radius": 1}}, {}),
    "ellipsoid, ratio 3": ({"analytic": {"shape": "ellipsoid", "center": [0, 0, 0], "radii": [1, 0.3, 0.3]}},
                           {"curvature": {"ratio": 3}}),
    "thin plate": ({"analytic": {"shape": "box", "center": [0, 0, 0], "half_size": [1, 1, 0.02]}}, {}),
    "bunny": ({"mesh": {"path": "stanford-bunny.obj"}}, {}),
    "fandisk": ({"mesh": {"path": "fandisk.off"}}, {}),
    "footbones": ({"mesh": {"path": "footbones.ply", "interior": "keep"}}, {}),
}
SEVERAL = {"footbones"}
TYPES = {"float": "<f4", "double": "<f8", "int": "<i4", "uint": "<u4", "uchar": "u1"}


class Points:
    def __init__(self, path, by_patch):
        head, _, body = path.read_bytes().partition(b"end_header\n")
        words = [line.split() for line in head.decode().splitlines()]
        table = numpy.frombuffer(body, [(w[2], TYPES[w[1]]) for w in words if w[0] == "property"])
        self.x = numpy.stack([table[a] for a in "xyz"], 1).astype(float)
        self.normal = numpy.stack([table["n" + a] for a in "xyz"], 1).astype(float)
        self.h = table["spacing"].astype(float)
        self.count = len(self.x)
        # patches of a mesh without sharp edges are its pieces; all others here are one piece
        self.piece = table["patch"] if by_patch else numpy.zeros(self.count, int)

    def facing(self, i, j):
        return (self.normal[i] * self.normal[j]).sum(-1) > OPPOSITE

    def places(self):
        """The points, and centres of triangles between neighbours; the spacing at each."""
        _, near = cKDTree(self.x).query(self.x, 7)
        i = numpy.repeat(numpy.arange(self.count), 15)
        first, second = numpy.triu_indices(6, 1)
        j, k = near[:, 1:][:, first].ravel(), near[:, 1:][:, second].ravel()
        h = (self.h[i] + self.h[j] + self.h[k]) / 3
        close = numpy.linalg.norm(self.x[j] - self.x[k], axis=1) < 1.5 * h
        good = (i < j) & (i < k) & self.facing(i, j) & self.facing(i, k) & close
        centre = (self.x[i] + self.x[j] + self.x[k])[good] / 3
        return numpy.concatenate([self.x, centre]), numpy.concatenate([self.h, h[good]])


def farthest_order(points, count, within_walls):
    """Indices of the first points; by distances in space, or of points of one wall alone as far as these exist."""
    x, h, tree, largest = points.x, points.h, cKDTree(points.x), points.h.max()
    far = numpy.full(points.count, 1e30)
    taken, order, heap = numpy.zeros(points.count, bool), [], [(-1e30, i) for i in range(points.count)]
    while len(order) < count:
        reach, i = heapq.heappop(heap)
        if taken[i] or -reach != far[i]:
            continue
        taken[i] = True
        order.append(i)
        radius = -reach * 0.5 * (h[i] + largest)
        near = (numpy.arange(points.count) if radius > 1e9 else
                numpy.array(tree.query_ball_point(x[i], radius * (1 + 1e-9))))
        near = near[~taken[near]]
        distance = numpy.linalg.norm(x[near] - x[i], axis=1) / (0.5 * (h[near] + h[i]))
        if within_walls:
            same = points.facing(near, i) & (points.piece[near] == points.piece[i])
            distance[~same] = 1e30 if radius < 1e9 else 1e3 + distance[~same]
        less = distance < far[near]
        far[near[less]] = distance[less]
        for k, d in zip(near[less].tolist(), distance[less].tolist()):
            heapq.heappush(heap, (-d, k))
    return numpy.array(order)


def measure(points, order, counts, places):
    """(coverage, least distance) of each prefix, over h_n; NaN where no two points are near that count."""
    rows = []
    where, size = places
    for n in counts:
        chosen, scale = order[:n], (points.count / n) ** 0.5
        x, tree = points.x[chosen], cKDTree(points.x[chosen])
        distance, _ = tree.query(where)
        i, j = tree.query_pairs(1.1 * scale * points.h.max(), output_type="ndarray").T
        i, j = chosen[i], chosen[j]
        same = points.facing(i, j) & (points.piece[i] == points.piece[j])
        least = numpy.linalg.norm(points.x[i] - points.x[j], axis=1)[same] / (0.5 * (points.h[i] + points.h[j]))[same]
        rows.append(((distance / size).max() / scale, (least.min() if len(least) else numpy.nan) / scale))
    return numpy.array(rows).T


def run(worker, shared, surface, sampling, count, order, where):
    spec = {"version": 1, "surface": surface, "sampling": {"count": count, **sampling}, "limits": {"memory_mb": 16000},
            "solver": {"threads": 1}, "output": {"preview": False, "ply": {"properties": ["all"]}, **({"order": order} if order else {})}}
    pathlib.Path(where).mkdir(exist_ok=True)
    path = pathlib.Path(where) / "spec.json"
    path.write_text(json.dumps(spec))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    roots = ["--input-root", str(shared)] if shared else []
    done = subprocess.run([worker, "run", path, "--output", where, *roots], capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert done.returncode in (0, 10, 11), done.stderr
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def examine(worker, shared, name, count, where):
    surface, sampling = SURFACES[name]
    plain_s = run(worker, shared, surface, sampling, count, None, f"{where}/plain")
    order_s = run(worker, shared, surface, sampling, count, "progressive", f"{where}/ordered")
    points = Points(pathlib.Path(where) / "ordered/points.ply", name in SEVERAL)
    counts = numpy.unique(numpy.geomspace(FIRST, points.count // 2, PREFIXES).round().astype(int))
    places = points.places()
    own = measure(points, numpy.arange(points.count), counts, places)
    space = measure(points, farthest_order(points, counts[-1], False), counts, places)
    walls = measure(points, farthest_order(points, counts[-1], True), counts, places)
    return plain_s, order_s, own, space, walls


def result(name, count, plain_s, order_s, own, space, walls):
    coverage, least = ([f"{v:.2f}" for v in (*extreme, *(numpy.nanmean(m[k]) for m in (own, space, walls)))]
                       for k, extreme in enumerate(([own[0].max()], [numpy.nanmin(own[1])])))
    return [f"{name} {count}", name, count, *coverage, *least, f"{plain_s:.1f}", f"{order_s:.1f}"]


def show(row):
    print(", ".join(f"{key} {value}" for key, value in zip(HEADER[1:], row[1:]) if value is not None), flush=True)


def is_worse(own, space, walls):
    means = [[numpy.nanmean(m[k]) for m in (own, space, walls)] for k in range(2)]
    return means[0][0] > WORSE * max(means[0][1:]) or WORSE * means[1][0] < min(means[1][1:])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worker", required=True)
    parser.add_argument("--output", type=pathlib.Path)
    parser.add_argument("--counts", default="1000,10000,100000")
    parser.add_argument("--surfaces", default="|".join(SURFACES))
    parser.add_argument("--cost", type=int, default=1000000, help="points of a sphere whose jobs are timed; 0: none")
    given = parser.parse_args()
    shared = os.environ.get("HEXAD_SHARED")
    shared = pathlib.Path(shared) / "meshes" if shared else None
    lines, faults = [], []
    for name in given.surfaces.split("|"):
        if "mesh" in SURFACES[name][0] and not shared:
            faults.append(f"{name}: set HEXAD_SHARED")
            continue
        for count in map(int, given.counts.split(",")):
            with tempfile.TemporaryDirectory() as where:
                plain_s, order_s, own, space, walls = examine(given.worker, shared, name, count, where)
            lines.append(result(name, count, plain_s, order_s, own, space, walls))
            show(lines[-1])
            if own[0].max() > COVERAGE or numpy.nanmin(own[1]) < LEAST:
                faults.append(f"{name}, {count}: coverage {own[0].max():.3f}, "
                              f"least distance {numpy.nanmin(own[1]):.3f}")
            if is_worse(own, space, walls):
                faults.append(f"{name}, {count}: worse than the farthest-point orders")
    if given.cost:
        with tempfile.TemporaryDirectory() as where:
            cost = [run(given.worker, None, *SURFACES["sphere"], given.cost, order, f"{where}/{order}")
                    for order in (None, "progressive")]
        lines.append([f"sphere {given.cost}", "sphere", given.cost, *[None] * 8, f"{cost[0]:.1f}", f"{cost[1]:.1f}"])
        show(lines[-1])
        if cost[1] > COST * cost[0]:
            faults.append(f"{given.cost} points: {cost[1] / cost[0]:.2f} times the CPU time")
    if given.output:
        results.write(given.output, HEADER, lines)
    print(*faults, sep="\n", file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
