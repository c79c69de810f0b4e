#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares ways to take a curvature over a distance, on a sphere and a torus in noisy samples, whose curvature is known.

    measurements/measures/curvature_methods.py [--output measurements/measures/curvature_methods.csv]

Computes the rms error of kappa over the rms of the true kappa (doc/departures.md). Lengths are in voxels. The methods are implemented
here with numpy. The method "fit" is that of src/sampling/sizing/scaled_curvature.c, on points instead of elements.
"""
import argparse
import pathlib
import sys

import numpy
from scipy import ndimage
from scipy.spatial import cKDTree

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import referee  # noqa: E402
import results  # noqa: E402
import surfaces  # noqa: E402

SIDE, POINTS, ACROSS = 96, 3000, 2
HEADER = ["row", "surface", "noise", "distance", "at_the_point_percent", "fit_percent", "filtered_field_percent", "diffused_shape_operator_percent"]
SHAPES = (("sphere, radius 30", surfaces.Sphere(30, (47.5, 47.5, 47.5))), ("torus, 30 and 12", surfaces.Torus(30, 12, (48, 48, 48))))


def noisy(shape, noise, rng):
    """A spline through the shape's distances at voxels, with noise that reaches ACROSS voxels."""
    at = numpy.stack(numpy.meshgrid(*[numpy.arange(SIDE)] * 3, indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
    rough = ndimage.gaussian_filter(rng.standard_normal((SIDE,) * 3), ACROSS / 2)
    return shape.value(at).reshape((SIDE,) * 3) + noise * rough / rough.std()


def spline(samples):
    return referee.Spline(ndimage.spline_filter(samples, order=3, mode="mirror"), (0, 0, 0), (1, 1, 1))


def points_on(surface, rng):
    x = rng.uniform(4, SIDE - 5, (60 * POINTS, 3))
    x = x[numpy.abs(surface.value(x)) < 2][:POINTS]
    for _ in range(8):
        g = surface.gradient(x)
        x = x - (surface.value(x) / (g ** 2).sum(axis=1))[:, None] * g
    return x


def pairs(x, scale):
    i, j = cKDTree(x).query_pairs(2 * scale, output_type="ndarray").T
    i, j = numpy.concatenate([i, j, numpy.arange(len(x))]), numpy.concatenate([j, i, numpy.arange(len(x))])
    return i, j, numpy.exp(-((x[i] - x[j]) ** 2).sum(axis=1) / scale ** 2)


def by_fit(x, shape, scale):
    """n_j - n_i = S (x_j - x_i) by least squares, the means taken off."""
    i, j, w = pairs(x, scale)
    count = len(x)

    def add(values):
        return numpy.bincount(i, w * values, count)

    d, turn, whole = x[j] - x[i], shape.normal[j] - shape.normal[i], add(numpy.ones(len(i)))
    a, b, p, q = ((v * t[i]).sum(axis=1) for v, t in ((d, shape.u), (d, shape.v), (turn, shape.u), (turn, shape.v)))
    mean = {k: add(v) / whole for k, v in (("a", a), ("b", b), ("p", p), ("q", q))}
    cross = {k + m: add(u * v) - whole * mean[k] * mean[m]
             for k, u in (("a", a), ("b", b), ("p", p), ("q", q)) for m, v in (("a", a), ("b", b))}
    zero = numpy.zeros(count)
    matrix = numpy.stack([[cross["aa"], cross["ab"], zero], [cross["ab"], cross["aa"] + cross["bb"], cross["ab"]],
                          [zero, cross["ab"], cross["bb"]]]).transpose(2, 0, 1)
    right = numpy.stack([cross["pa"], cross["pb"] + cross["qa"], cross["qb"]], axis=1)
    s = numpy.linalg.solve(matrix, right[:, :, None])[:, :, 0]
    return numpy.sqrt(s[:, 0] ** 2 + 2 * s[:, 1] ** 2 + s[:, 2] ** 2)


def by_diffusion(x, shape, scale):
    """Shape operators at points, as tensors in space, averaged with the same weights."""
    i, j, w = pairs(x, scale)
    tensor = shape.u[:, :, None] * shape.turn_u[:, None, :] + shape.v[:, :, None] * shape.turn_v[:, None, :]
    mean = numpy.stack([numpy.bincount(i, w * tensor[j, a, b], len(x)) for a in range(3) for b in range(3)], axis=1)
    mean /= numpy.bincount(i, w, len(x))[:, None]
    return numpy.sqrt((mean ** 2).sum(axis=1))


def kappa(shape):
    return numpy.hypot(shape.kappa1, shape.kappa2)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=pathlib.Path)
    options = parser.parse_args()
    rng, rows = numpy.random.default_rng(1), []
    for name, truth in SHAPES:
        for noise in (0.05, 0.2):
            samples = noisy(truth, noise, rng)
            surface = spline(samples)
            x = points_on(surface, rng)
            shape, true = referee.shape_at(surface, x), numpy.hypot(*truth.curvatures(x))
            for scale in (4, 8):
                # a Gaussian of this deviation weighs as exp(-(d / scale)^2) does
                filtered = spline(ndimage.gaussian_filter(samples, scale / numpy.sqrt(2)))
                found = (kappa(shape), by_fit(x, shape, scale), kappa(referee.shape_at(filtered, x)),
                         by_diffusion(x, shape, scale))
                error = [numpy.sqrt(((k - true) ** 2).mean() / (true ** 2).mean()) for k in found]
                rows.append([f"{name}, noise {noise:g}, distance {scale}", name, f"{noise:g}", scale, *(f"{100 * e:.1f}" for e in error)])
                print(rows[-1][0], *(f"{key} {value}" for key, value in zip(HEADER[4:], rows[-1][4:])), sep=", ", flush=True)
    if options.output:
        results.write(options.output, HEADER, rows)


if __name__ == "__main__":
    main()
