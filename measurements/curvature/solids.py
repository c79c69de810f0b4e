#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The curvatures of points on solids of flat faces: cylinders of 8 and 16 faces, a cube, and a bracket with a fillet.

    measurements/curvature/solids.py --worker build/hexad-worker [--output measurements/curvature/solids.csv]

For each part of a solid the 1st, 50th and 99th percentile of both principal curvatures, times the radius. Ends with 1 if a median is not
the documented one (doc/method.md, curvature of meshes).
"""
import argparse
import pathlib
import sys
import tempfile

import numpy

import curvature
import results  # curvature adds the directory

HEIGHT, FILLET, LEG, THICK, STEPS = 2, 0.5, 2, 0.4, 8
# largest difference of a median from the documented value
MOST = 0.05
HEADER = ["row", "points", "undefined_percent", "kappa1_percentile_1", "kappa1_median", "kappa1_percentile_99",
          "kappa2_percentile_1", "kappa2_median", "kappa2_percentile_99", "documented_kappa1", "documented_kappa2"]


def prism(outline):
    """An outline (counterclockwise, in the plane of x and y) from z = 0 to HEIGHT."""
    count = len(outline)
    vertices = numpy.concatenate([numpy.c_[outline, numpy.full(count, z)] for z in (0, HEIGHT)])
    sides = [[k, (k + 1) % count, (k + 1) % count + count, k + count] for k in range(count)]
    return vertices, [*sides, list(range(count - 1, -1, -1)), list(range(count, 2 * count))]


def circle(count):
    angle = 2 * numpy.pi * numpy.arange(count) / count
    return numpy.stack([numpy.cos(angle), numpy.sin(angle)], axis=1)


def bracket():
    """An L whose inner edge has a fillet."""
    angle = numpy.pi / 2 * numpy.arange(STEPS + 1) / STEPS
    arc = THICK + FILLET - FILLET * numpy.stack([numpy.sin(angle), numpy.cos(angle)], axis=1)
    return numpy.concatenate([[[0, 0], [LEG, 0], [LEG, THICK]], arc, [[THICK, LEG], [0, LEG]]])


def is_cap(points):
    return numpy.abs(points.normal[:, 2]) > 0.9


def is_fillet(points):
    x, y = points.position[:, 0], points.position[:, 1]
    return ~is_cap(points) & (x > THICK - 1e-3) & (y > THICK - 1e-3) & (x < THICK + FILLET) & (y < THICK + FILLET)


def is_beside(points):
    """On a face that ends at the fillet."""
    x, y = points.position[:, 0], points.position[:, 1]
    return ~is_cap(points) & ~is_fillet(points) & ((numpy.abs(y - THICK) < 1e-3) | (numpy.abs(x - THICK) < 1e-3))


def solids():
    """Names, meshes, radii, and parts: names, the points of each, and the documented curvatures; None: not documented."""
    def is_side(points):
        return ~is_cap(points)

    def is_other(points):
        return ~is_fillet(points) & ~is_beside(points)

    square = numpy.array([[0, 0], [HEIGHT, 0], [HEIGHT, HEIGHT], [0, HEIGHT]])
    return [("cylinder of 8 faces", prism(circle(8)), 1, [("side", is_side, (0, 0)), ("ends", is_cap, (0, 0))]),
            ("cylinder of 16 faces", prism(circle(16)), 1, [("side", is_side, (0.88, 0)), ("ends", is_cap, (0, 0))]),
            ("cube", prism(square), 1, [("faces", lambda points: points.position[:, 0] > -1, (0, 0))]),
            ("bracket", prism(bracket()), FILLET, [("fillet", is_fillet, (0, -1)), ("faces beside the fillet", is_beside, None),
                                                   ("other faces", is_other, (0, 0))])]


def row_of(name, points, chosen, radius, documented):
    defined = chosen & (points.columns["kappa_defined"] == 1)
    figures = numpy.concatenate([numpy.percentile(radius * points.columns[key][defined], (1, 50, 99)) for key in ("kappa1", "kappa2")])
    is_missed = documented is not None and numpy.abs(figures[[1, 4]] - documented).max() > MOST
    shown = [f"{value:.3g}" for value in (100 * (1 - defined.sum() / chosen.sum()), *numpy.where(numpy.abs(figures) < 1e-9, 0, figures))]
    return [name, int(chosen.sum()), *shown, *(documented or (None, None))], is_missed


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", type=lambda path: pathlib.Path(path).resolve(), required=True)
    parser.add_argument("--output", type=pathlib.Path)
    options = parser.parse_args()
    rows, missed = [], 0
    with tempfile.TemporaryDirectory() as directory:
        for name, mesh, radius, parts in solids():
            curvature.write_obj(pathlib.Path(directory) / "mesh.obj", *mesh)
            points = curvature.run(options.worker, pathlib.Path(directory), {"mesh": {"path": "mesh.obj"}}, {})
            for part, chosen, documented in parts:
                row, is_missed = row_of(f"{name}: {part}", points, chosen(points), radius, documented)
                missed += is_missed
                rows.append(row)
                print(row[0], *(f"{key} {value}" for key, value in zip(HEADER[1:], row[1:])), "MISSED" if is_missed else "", sep=", ", flush=True)
    return results.end(options.output, HEADER, rows, missed)


if __name__ == "__main__":
    sys.exit(main())
