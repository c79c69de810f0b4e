#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares the curvatures of 2 000 points with those of 60 000 points on the same mesh: at the nearest points, and at the same places.

    measurements/curvature/counts.py --worker build/hexad-worker [--shared $HEXAD_SHARED] [--output measurements/curvature/counts.csv]

Differences are those of both principal curvatures over the larger one, at points with kappa_defined 1 and the same side. For the same
places, the 2 000 points are kept among 60 000; points on feature edges are left out, because they belong to one of two faces. Ends with 1
if a median at the nearest points of a smooth surface is above 2 %, or if values at the same places differ.
"""
import argparse
import os
import pathlib
import sys
import tempfile

import numpy
from scipy.spatial import cKDTree

import curvature
import results  # curvature adds the directory

# MOST_SAME: per cent, of float properties
FEW, MANY, MOST_MEDIAN, MOST_SAME = 2000, 60000, 2, 1e-4
SHARED = ("bunny_pmp.off", "armadillo.obj", "teapot.obj", "fandisk.off")
HEADER = ["row", "points", "median_percent", "percentile_90_percent", "distance_median", "same_place_largest_percent"]


def differences(one, two):
    """Per cent, of points in the same order."""
    one, two = (numpy.stack([points["kappa1"], points["kappa2"]], axis=1) for points in (one, two))
    size = numpy.maximum(numpy.abs(one), numpy.abs(two)).max(axis=1)
    return 100 * numpy.abs(one - two).max(axis=1) / numpy.where(size > 0, size, 1)


def compare(few, many, kept):
    """Points, median and 90th percentile of the differences, the median distance in spacings of the few, and the largest difference at
    the same places."""
    distance, nearest = cKDTree(many.position).query(few.position)
    there = {key: column[nearest] for key, column in many.columns.items()}
    same = (few.normal * many.normal[nearest]).sum(axis=1) > 0.5
    same &= (few.columns["kappa_defined"] == 1) & (there["kappa_defined"] == 1)
    off = differences(few.columns, there)[same]
    first = {key: column[:few.count] for key, column in kept.columns.items()}
    assert (kept.position[:few.count] == few.position).all()
    return (int(same.sum()), numpy.median(off), numpy.percentile(off, 90), numpy.median((distance / few.spacing)[same]),
            differences(few.columns, first)[few.columns["feature"] == 0].max())


def meshes(directory, shared):
    """Names, paths, and whether the surface is smooth."""
    rng = numpy.random.default_rng(1)
    for name, mesh in [("torus, 40 x 20 quads", curvature.grid(40, 20, curvature.on_torus, True)),
                       *((f"{shape}, random, 5000", curvature.mesh_of(shape, "random", 5000, rng)) for shape in ("torus", "ellipsoid"))]:
        curvature.write_obj(directory / "mesh.obj", *mesh)
        yield name, directory / "mesh.obj", True
    for name in SHARED if shared else ():
        yield name, pathlib.Path(shared).resolve() / "meshes" / name, False


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", type=lambda path: pathlib.Path(path).resolve(), required=True)
    parser.add_argument("--shared", default=os.environ.get("HEXAD_SHARED"))
    parser.add_argument("--output", type=pathlib.Path)
    options = parser.parse_args()
    rows, missed = [], 0
    with tempfile.TemporaryDirectory() as name:
        directory = pathlib.Path(name)
        for name, path, is_smooth in meshes(directory, options.shared):
            def run(count, **more):
                return curvature.run(options.worker, directory, {"mesh": {"path": str(path)}},  # noqa: B023
                                     {"sampling": {"count": count, **more}, "output": {"preview": False, "ply": {"precision": "double", "properties": ["all"]}}})

            many, few = run(MANY), run(FEW)
            (directory / "out" / "points.ply").rename(directory / "few.ply")
            figures = compare(few, many, run(MANY, points={"path": "few.ply", "mode": "keep"}))
            is_missed = (is_smooth and figures[1] > MOST_MEDIAN) or figures[4] > MOST_SAME
            missed += is_missed
            rows.append([name, figures[0], *(f"{value:.3g}" for value in figures[1:])])
            print(*rows[-1], "MISSED" if is_missed else "", sep=", ", flush=True)
    return results.end(options.output, HEADER, rows, missed)


if __name__ == "__main__":
    sys.exit(main())
