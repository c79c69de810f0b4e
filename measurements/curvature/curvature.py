#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares the curvatures of points with those of the surfaces that formulas, volumes and meshes describe.

    measurements/curvature/curvature.py --worker build/hexad-worker [--reference WORKER] [--output measurements/curvature/curvature.csv]
        [--only WORD ...]

A torus and an ellipsoid are sampled as formulas and as volumes; with --reference, by another worker, too. A sphere, a torus and an
ellipsoid are sampled as meshes: quads, evenly or at random distributed vertices. A mesh is sampled on its triangles, through a level set,
at an offset, in a region and in a union with a copy that is moved. Errors are those of both principal curvatures over the larger one, at
points with kappa_defined 1. Ends with 1 if a bound is missed.
"""
import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy
from scipy.spatial import ConvexHull, Delaunay

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import levelsets  # noqa: E402
import measure  # noqa: E402
import results  # noqa: E402

COUNT, SIZES, OFFSET, SHIFT = 3000, (5000, 100000), 0.1, numpy.array([0.7, 0.1, 0.05])
MAJOR, MINOR, AXES, ROUND = 1, 0.4, numpy.array([1, 0.6, 0.325]), numpy.ones(3)
# per cent; of quads of 40 x 20, only the median
MOST_MEDIAN, MOST_99, MOST_COARSE = 2, 10, 9
# voxels along the longest side of a volume; largest quotient of an error and that of the reference: their points differ
VOXELS, MOST_QUOTIENT = (64, 256), 1.1
HEADER = ["row", "shape", "vertices", "triangles", "surface", "points", "undefined_percent", "median_percent", "percentile_99_percent",
          "largest_percent", "reference_median_percent", "reference_percentile_99_percent"]


# ---- shapes: their values at places near them, and the nearest places

def torus_curvatures(x, minor=MINOR):
    cosine = numpy.cos(numpy.arctan2(x[:, 2], numpy.hypot(x[:, 0], x[:, 1]) - MAJOR))
    return numpy.stack([numpy.full(len(x), 1 / minor), cosine / (MAJOR + minor * cosine)], axis=1)


def torus_distance(x):
    return numpy.hypot(numpy.hypot(x[:, 0], x[:, 1]) - MAJOR, x[:, 2]) - MINOR


def nearest_on(x, axes):
    """The nearest places of an ellipsoid: Newton's method for the multiplier t, from x_k = a_k^2 x_k / (a_k^2 + t)."""
    squares, t = axes ** 2, numpy.zeros(len(x))
    for _ in range(60):
        over = 1 / (squares + t[:, None])
        value = (squares * x ** 2 * over ** 2).sum(axis=1) - 1
        t += numpy.clip(value / (2 * (squares * x ** 2 * over ** 3).sum(axis=1)), -0.5 * (squares.min() + t), None)
    return squares * x / (squares + t[:, None])


def ellipsoid_curvatures(x, axes):
    y = nearest_on(x, axes)
    gradient = y / axes ** 2
    length = numpy.linalg.norm(gradient, axis=1)
    normal = gradient / length[:, None]
    plane = numpy.eye(3) - normal[:, :, None] * normal[:, None, :]
    return numpy.linalg.eigvalsh(plane @ numpy.diag(1 / axes ** 2) @ plane / length[:, None, None])[:, :0:-1]


def ellipsoid_distance(x, axes):
    return numpy.linalg.norm(x - nearest_on(x, axes), axis=1)


def at_offset(curvatures, distance):
    return curvatures / (1 + distance * curvatures)


# ---- meshes

def grid(around, along, place, is_closed):
    """Quads between rows, as lists of corners; `place` of angles in 0 .. 1."""
    rows = along if is_closed else along + 1
    a, b = numpy.meshgrid(numpy.arange(around) / around, numpy.arange(rows) / along, indexing="ij")
    i, j = (k.ravel() for k in numpy.meshgrid(numpy.arange(around), numpy.arange(along), indexing="ij"))
    faces = numpy.stack([(i + p) % around * rows + (j + q) % rows for p, q in ((0, 0), (1, 0), (1, 1), (0, 1))], axis=1)
    return place(a.ravel(), b.ravel()), faces.tolist()


def on_torus(a, b):
    u, v = 2 * numpy.pi * a, 2 * numpy.pi * b
    from_axis = MAJOR + MINOR * numpy.cos(v)
    return numpy.stack([from_axis * numpy.cos(u), from_axis * numpy.sin(u), MINOR * numpy.sin(v)], axis=1)


def balls_of_quads(side, axes):
    """Rings of quads with a triangle fan at each pole."""
    u, v = numpy.meshgrid(numpy.arange(2 * side) * numpy.pi / side, numpy.arange(1, side) * numpy.pi / side, indexing="ij")
    x = numpy.stack([numpy.sin(v) * numpy.cos(u), numpy.sin(v) * numpy.sin(u), numpy.cos(v)], axis=-1).reshape(-1, 3)
    rows, faces = side - 1, []
    for i in range(2 * side):
        k = (i + 1) % (2 * side)
        faces += [[len(x), i * rows, k * rows], [len(x) + 1, k * rows + rows - 1, i * rows + rows - 1]]
        faces += [[i * rows + j, i * rows + j + 1, k * rows + j + 1, k * rows + j] for j in range(rows - 1)]
    return numpy.concatenate([x, [[0, 0, 1], [0, 0, -1]]]) * axes, faces


def hull(x, axes):
    """The triangles of the convex hull of directions, outwards."""
    faces = ConvexHull(x).simplices
    normal = numpy.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]])
    inwards = (normal * x[faces].mean(axis=1)).sum(axis=1) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return x * axes, faces.tolist()


def even_directions(count):
    k = numpy.arange(count) + 0.5
    polar, turn = numpy.arccos(1 - 2 * k / count), numpy.pi * (1 + 5 ** 0.5) * k
    return numpy.stack([numpy.cos(turn) * numpy.sin(polar), numpy.sin(turn) * numpy.sin(polar), numpy.cos(polar)], axis=1)


def random_torus(count, rng):
    """The Delaunay triangles, in the plane of both angles, of random places."""
    a, b = rng.random((2, 4 * count))
    kept = rng.random(4 * count) < (MAJOR + MINOR * numpy.cos(2 * numpy.pi * b)) / (MAJOR + MINOR)
    uv = numpy.stack([a[kept], b[kept]], axis=1)[:count]
    copies = numpy.concatenate([uv + [i, j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    faces = Delaunay(copies * [MAJOR, MINOR]).simplices
    middle = copies[faces].mean(axis=1)
    faces = faces[((middle >= 0) & (middle < 1)).all(axis=1)]
    corners = copies[faces]
    turned = numpy.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) < 0
    faces[turned] = faces[turned][:, ::-1]
    return on_torus(*uv.T), (faces % count).tolist()


def mesh_of(shape, vertices, size, rng):
    side = round((size / 4) ** 0.5)
    if shape == "torus":
        if vertices == "quads":
            return grid(2 * side, side, on_torus, True)
        if vertices == "even":
            return grid(20 * side // 7, 5 * side // 7, on_torus, True)
        return random_torus(size // 2, rng)
    axes = AXES if shape == "ellipsoid" else ROUND
    if vertices == "quads":
        return balls_of_quads(side, axes)
    x = even_directions(size // 2) if vertices == "even" else rng.standard_normal((size // 2, 3))
    return hull(x / numpy.linalg.norm(x, axis=1)[:, None], axes)


def write_obj(path, vertices, faces):
    path.write_text("".join(f"v {x:.17g} {y:.17g} {z:.17g}\n" for x, y, z in vertices)
                    + "".join(f"f {' '.join(str(k + 1) for k in face)}\n" for face in faces))


# ---- jobs

def surfaces_of(shape):
    """Names, specs, and the true curvatures at places."""
    mesh, moved = {"mesh": {"path": "mesh.obj"}}, {"mesh": {"path": "moved.obj"}}
    if shape == "torus":
        true, distance, parallel = torus_curvatures, lambda x: numpy.abs(torus_distance(x)), lambda x: torus_curvatures(x, MINOR + OFFSET)
    else:
        axes = AXES if shape == "ellipsoid" else ROUND
        true, distance = lambda x: ellipsoid_curvatures(x, axes), lambda x: ellipsoid_distance(x, axes)
        parallel = lambda x: at_offset(true(x), OFFSET)  # noqa: E731
    union = lambda x: numpy.where((distance(x) < distance(x - SHIFT))[:, None], true(x), true(x - SHIFT))  # noqa: E731
    box = {"region": {"min": [-2, -2, -2], "max": [0.3, 0.25, 0.1]}}
    return [("triangles", mesh, {}, true), ("level set", {"mesh": {"path": "mesh.obj", "resolution": 128}}, {}, true),
            ("offset", {"offset": {"surface": mesh, "distance": OFFSET}}, {}, parallel), ("region", mesh, box, true),
            ("union", {"union": [mesh, moved]}, {}, union)]


def write_volume(shape, voxels, path):
    """Distances to a torus or an ellipsoid near it, about the origin."""
    half = AXES if shape == "ellipsoid" else numpy.array([MAJOR + MINOR, MAJOR + MINOR, MINOR])
    voxel = 2 * half.max() / voxels
    reach = numpy.ceil(half / voxel + levelsets.BAND + 1).astype(int)
    x = numpy.stack(numpy.meshgrid(*(numpy.arange(-k, k + 1) * voxel for k in reach), indexing="ij"), axis=-1)
    if shape == "torus":
        distance = torus_distance(x.reshape(-1, 3))
    else:
        # a place in a plane of symmetry has two nearest ones
        flat = numpy.where(x == 0, 1e-9, x).reshape(-1, 3)
        distance = numpy.copysign(ellipsoid_distance(flat, AXES), numpy.linalg.norm(flat / AXES, axis=1) - 1)
    levelsets.write_array(distance.reshape(x.shape[:3]), -reach, voxel, path)


def fields_of(shape):
    """Names, specs, voxels of the volume to write, and the true curvatures at places."""
    true = torus_curvatures if shape == "torus" else lambda x: ellipsoid_curvatures(x, AXES)
    sizes = {"major_radius": MAJOR, "minor_radius": MINOR} if shape == "torus" else {"radii": AXES.tolist()}
    return [("formula", {"analytic": {"shape": shape, "center": [0, 0, 0], **sizes}}, 0, true)] + [
        (f"volume of {voxels} voxels", {"vdb": {"path": "volume.vdb"}}, voxels, true) for voxels in VOXELS]


def run(worker, directory, surface, more, count=COUNT):
    spec = {"version": 1, "surface": surface, "sampling": {"count": count}, "output": {"preview": False, "ply": {"properties": ["all"]}}, **more}
    (directory / "spec.json").write_text(json.dumps(spec))
    subprocess.run([worker, "run", "spec.json", "--output", "out", "--threads", "1"], cwd=directory, check=False, capture_output=True)
    return measure.read_ply(directory / "out" / "points.ply")


def errors_of(points, true):
    """The undefined share, the median, the 99th percentile and the largest of the errors, per cent."""
    found = numpy.stack([points.columns["kappa1"], points.columns["kappa2"]], axis=1)
    exact, defined = true(points.position), points.columns.get("kappa_defined", numpy.ones(points.count)) == 1
    off = 100 * (numpy.abs(found - exact).max(axis=1) / numpy.abs(exact).max(axis=1))[defined]
    return 100 * (1 - defined.mean()), numpy.median(off), numpy.percentile(off, 99), off.max()


def field_row(options, directory, shape, name, surface, true):
    """A row of a formula or volume, and whether it misses a bound."""
    points = run(options.worker, directory, surface, {})
    own, reference = errors_of(points, true), [None] * 4
    if options.reference:
        reference = errors_of(run(options.reference, directory, surface, {}), true)
    row = [f"{shape}: {name}", shape, None, None, name, points.count, *own, *reference[1:3]]
    return row, options.reference and (own[1] > MOST_QUOTIENT * reference[1] or own[2] > MOST_QUOTIENT * reference[2])


def mesh_row(options, directory, shape, vertices, triangles, case):
    name, surface, more, true = case
    points = run(options.worker, directory, surface, more)
    own = errors_of(points, true)
    most = (MOST_COARSE, numpy.inf) if triangles == 1600 else (MOST_MEDIAN, MOST_99)
    row = [f"{shape}, {vertices}, {triangles}: {name}", shape, vertices, triangles, name, points.count, *own, None, None]
    return row, own[1] > most[0] or own[2] > most[1]


def rows_of(options, directory):
    """Yields rows, and whether each misses a bound."""
    def is_wanted(text):
        return all(word in text for word in options.only)

    for shape in ("torus", "ellipsoid"):
        for name, surface, voxels, true in fields_of(shape):
            if is_wanted(f"{shape} {name}"):
                if voxels:
                    write_volume(shape, voxels, directory / "volume.vdb")
                yield field_row(options, directory, shape, name, surface, true)
    rng = numpy.random.default_rng(1)
    cases = [(shape, vertices, size) for size in SIZES for shape in ("sphere", "torus", "ellipsoid") for vertices in ("quads", "even", "random")]
    for shape, vertices, size in [("torus", "40 x 20 quads", 1600), *cases]:
        mesh = grid(40, 20, on_torus, True) if size == 1600 else mesh_of(shape, vertices, size, rng)
        triangles = sum(len(face) - 2 for face in mesh[1])
        if is_wanted(f"{shape} {vertices} {triangles}"):
            write_obj(directory / "mesh.obj", *mesh)
            write_obj(directory / "moved.obj", mesh[0] + SHIFT, mesh[1])
            for case in surfaces_of(shape):
                yield mesh_row(options, directory, shape, vertices, triangles, case)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", type=lambda path: pathlib.Path(path).resolve(), required=True)
    parser.add_argument("--reference", type=lambda path: pathlib.Path(path).resolve(), help="another hexad-worker, for formulas and volumes")
    parser.add_argument("--output", type=pathlib.Path)
    parser.add_argument("--only", nargs="*", default=[], help="words that the row contains")
    options = parser.parse_args()
    rows, missed = [], 0
    with tempfile.TemporaryDirectory() as name:
        for row, is_missed in rows_of(options, pathlib.Path(name)):
            rows.append([f"{value:.3g}" if isinstance(value, float) else value for value in row])
            missed += bool(is_missed)
            print(row[0], *(f"{key} {value}" for key, value in zip(HEADER[6:], rows[-1][6:])), "MISSED" if is_missed else "", sep=", ", flush=True)
            if options.output:
                results.write(options.output, HEADER, rows)
    return results.end(options.output, HEADER, rows, missed)


if __name__ == "__main__":
    sys.exit(main())
