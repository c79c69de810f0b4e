#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes examples/bspline-torus.json and examples/bspline-box.json: the two B-splines of the paper's Figure 6.

A cubic B-spline that goes through the values of a formula at its knots: along an axis with n coefficients the
domain [0, 1] is n - 3 knot intervals, coefficient i belongs to the knot (i - 1) / (n - 3), and at a knot the
spline is (c[i - 1] + 4 c[i] + c[i + 1]) / 6. The formula is known outside of the domain as well: knots are
added on either side until the ends of the system no longer show.

    tools/bspline_examples.py [DIRECTORY]      (default: examples/ beside this tool's directory)
"""
import json
import math
import pathlib
import sys

COEFFICIENTS = 16  # along each axis
PADDING = 12  # knots more on either side: 0.268^12 = 1e-7 of what is wrong at the end arrives inside
DIGITS = 6  # significant ones: 1e-6 of the shape

# centred in the unit cube
MAJOR_RADIUS, MINOR_RADIUS = 0.3, 0.12
HALF_SIZE, ROUNDING = 0.34, 0.12


def torus(x, y, z):
    """The quartic of a torus about the z axis, scaled to be the distance near it."""
    inner = x * x + y * y + z * z + MAJOR_RADIUS**2 - MINOR_RADIUS**2
    return (inner**2 - 4 * MAJOR_RADIUS**2 * (x * x + y * y)) / (8 * MAJOR_RADIUS**2 * MINOR_RADIUS)


def box(x, y, z):
    """The distance from a rounded cube, negative inside."""
    q = [abs(v) - (HALF_SIZE - ROUNDING) for v in (x, y, z)]
    return math.hypot(*(max(v, 0) for v in q)) + min(max(q), 0) - ROUNDING


def prefilter(values):
    """Values at knots to coefficients, along one line; at its ends the coefficient is the value."""
    count = len(values)
    upper, right = [0.0] * count, list(values)
    for i in range(1, count - 1):
        pivot = 4 - upper[i - 1]
        upper[i] = 1 / pivot
        right[i] = (6 * values[i] - right[i - 1]) / pivot
    for i in range(count - 2, 0, -1):
        right[i] -= upper[i] * right[i + 1]
    return right


def coefficients(formula):
    """Of the spline through the formula at the knots, x fastest."""
    side = COEFFICIENTS + 2 * PADDING
    knot = [(i - PADDING - 1) / (COEFFICIENTS - 3) - 0.5 for i in range(side)]
    kept = slice(PADDING, PADDING + COEFFICIENTS)
    # values[k][j][i], solved and cut along x, then y, then z
    lines = [[prefilter([formula(x, y, z) for x in knot])[kept] for y in knot] for z in knot]
    planes = [list(zip(*(prefilter(column)[kept] for column in zip(*plane)))) for plane in lines]
    whole = [[prefilter([planes[k][j][i] for k in range(side)])[kept]
              for i in range(COEFFICIENTS)] for j in range(COEFFICIENTS)]
    return [float(f"{whole[j][i][k]:.{DIGITS}g}") for k in range(COEFFICIENTS)
            for j in range(COEFFICIENTS) for i in range(COEFFICIENTS)]


def job(name, formula):
    """A spec as the paper's: some 1250 particles, drawn to curvature."""
    return {
        "version": 1,
        "name": name,
        "surface": {"bspline": {"dims": [COEFFICIENTS] * 3, "coefficients": coefficients(formula)}},
        "sampling": {"count": 1250, "alpha": {"d": 2}},
        "solver": {"init": "random", "seed": 1},
    }


def main():
    default = pathlib.Path(__file__).resolve().parent.parent / "examples"
    directory = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else default
    for name, formula in (("torus", torus), ("box", box)):
        spec = job(f"the {name} of the paper's Figure 6, a B-spline", formula)
        (directory / f"bspline-{name}.json").write_text(json.dumps(spec) + "\n", encoding="ascii")


if __name__ == "__main__":
    main()
