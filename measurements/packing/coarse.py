#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares samplings of surfaces whose walls are thinner than the spacing with sample elimination on the same surface
(measurements/packing/README.md).

    measurements/packing/coarse.py --worker build/hexad-worker --output measurements/packing/coarse.csv [--data DIRECTORY] [--only WORD ...]

DIRECTORY, or HEXAD_SHARED, has the folder vdb. Sample elimination is Yuksel's (2015), weighted, with the paper's constants, in
space: it takes FACTOR times the points, spread at random over the surface. These are of a job with DENSE points, of which each
has about the same share of the area. Both answers are measured from the points alone. Ends with 1 when this sampler's least
distance within a sheet, spread of edges, or farthest place but for a thousandth of them is more than a tenth worse, or when more
pairs of facing sheets are near each other than chance brings together.
"""
import heapq
import os
import pathlib
import sys
import tempfile

import numpy
from scipy.spatial import cKDTree

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1] / folder) for folder in ("common", "inputs")]
import inputs  # noqa: E402
import measure  # noqa: E402
import results  # noqa: E402

# file and isovalue
CASES = (("wdas_cloud_sixteenth.vdb", 0.3232), ("smoke1_half.vdb", 2.85742), ("blender_smoke_000002.vdb", 0.436),
         ("blender_smoke_000003.vdb", 0.5), ("nebula_5grids.vdb", 0.5), ("monkey_mantaflow.vdb", 0.5))
COUNT, FACTOR, DENSE = 5000, 5, 100000
# Of weighted elimination: the exponent of distances, and how small ones are bounded (sections 3 and 4 of the paper).
ALPHA, BETA, GAMMA = 8, 0.65, 1.5
SLACK = 1.1
# Over the spacing: pairs of facing sheets that are counted.
NEAR = 0.6
HEADER = ["row", "file", "sampler", "least_distance", "least_distance_within_wall", "nearest_cv", "edge_cv", "area_cv", "coverage_of_999_of_1000",
          "coverage", "facing_pairs", "facing_pairs_by_chance", "outcome", "cpu_s"]


def run(worker, surface, count, where):
    """Points, report and processor seconds of a job."""
    case = inputs.Case(pathlib.Path(surface["path"]), "vdb", pathlib.Path(where), worker)
    chosen = {k: v for k, v in surface.items() if k != "path"}
    error, report = case.run(chosen, count)
    if error:
        sys.exit(f"{surface['path']}: {error['message']}")
    return measure.read_ply(pathlib.Path(where) / "out" / "points.ply"), report, case.processor_s


def eliminate(position, count, h):
    """Which of the points stay."""
    many, least = len(position), h * (1 - (count / len(position)) ** GAMMA) * BETA
    i, j = cKDTree(position).query_pairs(h, output_type="ndarray").T
    weight = (1 - numpy.maximum(numpy.linalg.norm(position[i] - position[j], axis=1), least) / h) ** ALPHA
    order = numpy.argsort(numpy.concatenate([i, j]), kind="stable")
    near, weight = numpy.concatenate([j, i])[order], numpy.tile(weight, 2)[order]
    start = numpy.concatenate([[0], numpy.cumsum(numpy.bincount(numpy.concatenate([i, j]), minlength=many))])
    total = numpy.array([weight[a:b].sum() for a, b in zip(start, start[1:])])
    stays, heap = numpy.ones(many, bool), [(-w, k) for k, w in enumerate(total)]
    heapq.heapify(heap)
    while many > count:
        negative, k = heapq.heappop(heap)
        if not stays[k] or -negative != total[k]:
            continue
        stays[k], many, own = False, many - 1, slice(start[k], start[k + 1])
        total[near[own]] -= weight[own]
        for m in near[own][stays[near[own]]]:
            heapq.heappush(heap, (-total[m], m))
    return stays


def figures(position, normal, area, places):
    """Least distance of all and of points that are not of opposite walls, spread of distances to the nearest, edge_cv, area_cv, coverage
    without a thousandth of the places and of all: lengths in spacings."""
    count, tree = len(position), cKDTree(position)
    h = measure.ideal_spacing(area, count)
    nearest = tree.query(position, 2)[0][:, 1] / h
    i, j = tree.query_pairs(1.5 * h, output_type="ndarray").T
    beside = (normal[i] * normal[j]).sum(1) > measure.OPPOSITE
    within = numpy.linalg.norm(position[i] - position[j], axis=1)[beside].min() / h
    points = measure.PointSet(position, normal, numpy.full(count, h), numpy.ones(count), {})
    cells = measure.measure(points, area)
    away = tree.query(places)[0] / h
    return [nearest.min(), within, nearest.std() / nearest.mean(), cells["edge_cv"], cells["area_cv"],
            numpy.quantile(away, 0.999), away.max()]


def facing(position, normal, h, dense):
    """How many pairs of sheets that are turned from each other (beyond 90 degrees) are nearer than NEAR, and how many would be by
    chance: of each point with places of the dense sample, in the proportion of the counts."""
    i, j = cKDTree(position).query_pairs(NEAR * h, output_type="ndarray").T
    found = int(((normal[i] * normal[j]).sum(1) < 0).sum())
    near = cKDTree(dense.position).query_ball_point(position, NEAR * h)
    turned = sum(int((dense.normal[there] @ normal[k] < 0).sum()) for k, there in enumerate(near))
    return found, turned * len(position) / len(dense.position) / 2


def rows(worker, data, name, isovalue):
    """Rows of the CSV, and whether the bounds are met."""
    surface = {"path": str(data / "vdb" / name), "isovalue": isovalue}
    if name.startswith(("nebula", "monkey")):
        surface["grid"] = "density"
    with tempfile.TemporaryDirectory() as where:
        ours, report, spent = run(worker, surface, COUNT, where)
        dense, _, _ = run(worker, surface, DENSE, where)
    area = report["surface"]["area"]
    drawn = numpy.random.default_rng(1).permutation(len(dense.position))[:FACTOR * COUNT]
    kept = drawn[eliminate(dense.position[drawn], COUNT, measure.ideal_spacing(area, COUNT))]
    lines, both, crossing = [], [], []
    for which, position, normal in (("hexad", ours.position, ours.normal),
                                    ("elimination", dense.position[kept], dense.normal[kept])):
        both.append(figures(position, normal, area, dense.position))
        found, chance = facing(position, normal, measure.ideal_spacing(area, COUNT), dense)
        crossing.append(found <= chance)
        lines.append([f"{name} {which}", name, which, *(f"{f:.3f}" for f in both[-1]), found, f"{chance:.0f}",
                      *([report["outcome"], f"{spent:.1f}"] if which == "hexad" else [None, None])])
    mine, theirs = both
    good = mine[1] * SLACK >= theirs[1] and mine[3] <= theirs[3] * SLACK and mine[5] <= theirs[5] * SLACK
    return lines, good and crossing[0]


def main():
    options = inputs.arguments(inputs.parser_of(__doc__.splitlines()[0]))
    lines, bad = [], 0
    for name, isovalue in CASES:
        if options.only and not any(word in name for word in options.only):
            continue
        found, good = rows(os.path.abspath(options.worker), pathlib.Path(options.data), name, isovalue)
        lines += found
        bad += not good
        print(*(", ".join(f"{name} {value}" for name, value in zip(HEADER[1:], row[1:])) for row in found), sep="\n", flush=True)
    results.write(options.output, HEADER, lines)
    print(f"missed bounds: {bad}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
