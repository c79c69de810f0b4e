#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Resolves meshes with thin parts and close opposite walls, compares each mesh.ply with its input, and writes a row
for each mesh (measurements/meshes/features.csv).

    measurements/meshes/features.py --worker build/hexad-worker --output measurements/meshes/features.csv
                     [--data DIRECTORY] [--only WORD ...]

DIRECTORY, or HEXAD_SHARED, has the folder meshes. All are resolved by one setting: `resolve` with what `feature` is by default.
The file is written after each mesh. Ends with 1 when a bound is missed:
the outcome converged; a closed manifold with the genus and the number of parts of the input; the least angle above 25
degrees in 99.9 % of the triangles; nowhere farther from the input than a third of the local feature size, or of
the least spacing where that is larger. The local feature size is the distance to the medial axis of the input, by shrinking
balls (Ma, Bae and Choi 2012) of which only those count that touch sheets that face each other. Shares no code with the
sampler.
"""
import json
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy
from scipy.sparse import coo_matrix, csgraph
from scipy.spatial import cKDTree

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1] / folder) for folder in ("common", "inputs")]
import inputs  # noqa: E402
import meshes  # noqa: E402
import results  # noqa: E402

CASES = ("dragon_100k.obj", "scorpion_low.obj", "footbones.ply", "42400-IDGH.stl", "fertility.off", "high_genus13k.off",
         "gargoyle.off", "wingnut.obj", "rocker-arm.obj", "skull_low.obj")
LEAST_ANGLE, SHARE = 25, 0.999
FARTHEST = 1 / 3
# Places on a mesh that feature sizes are measured at, and those on each mesh that distances are: what is far from the other mesh
# may be small, so that of few places luck would decide which of it is met.
PLACES, DISTANT_PLACES = 60000, 400000
# Sheets face each other when the cosine of their normals is below this.
FACING = -0.4
BALL_STEPS, BALL_TOLERANCE = 30, 1e-2
# Places that balls are first made smaller by.
FIRST_PLACES = 300


def read_result(path):
    """mesh.ply of the worker: vertices in the order of points.ply, triangles of them."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    words = [line.split() for line in head.decode("ascii").splitlines()]
    kinds = {"float": "<f4", "double": "<f8", "int": "<i4"}
    vertex = [(w[2], kinds[w[1]]) for w in words if w[0] == "property" and w[1] in kinds]
    count = {w[1]: int(w[2]) for w in words if w[0] == "element"}
    at = numpy.dtype(vertex).itemsize * count["vertex"]
    points = numpy.frombuffer(body, vertex, count["vertex"])
    faces = numpy.frombuffer(body, [("n", "u1"), ("corner", "<i4", 3)], count["face"], at)
    assert (faces["n"] == 3).all() and at + 13 * len(faces) == len(body)
    return numpy.stack([points[axis] for axis in "xyz"], axis=1).astype(float), faces["corner"].astype(int)


class Topology:
    def __init__(self, triangles):
        """Of triangles that share their corners."""
        used, triangles = numpy.unique(triangles, return_inverse=True)
        triangles = triangles.reshape(-1, 3)
        n, f = len(used), len(triangles)
        start, end = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
        once = numpy.bincount(numpy.unique(start * n + end, return_inverse=True)[1])
        low, high = numpy.minimum(start, end), numpy.maximum(start, end)
        edge, which, uses = numpy.unique(low * n + high, return_inverse=True, return_counts=True)
        self.closed = bool((uses == 2).all() and (once == 1).all())
        # the triangles at a vertex are one fan: joined across the edges that they share there, they are one piece
        corner = numpy.arange(3 * f).reshape(-1, 3)
        order = numpy.argsort(which, kind="stable")
        pair = order.reshape(-1, 2) if self.closed else numpy.zeros((0, 2), int)
        first, second = pair[:, 0], pair[:, 1]
        following = corner[:, [1, 2, 0]].ravel()
        join = numpy.concatenate([numpy.stack([first, following[second]], 1), numpy.stack([following[first], second], 1)])
        fans = csgraph.connected_components(coo_matrix((numpy.ones(len(join)), join.T), (3 * f, 3 * f)), directed=False)[0]
        self.manifold = self.closed and fans == n
        graph = coo_matrix((numpy.ones(len(start)), (start, end)), (n, n))
        self.parts = csgraph.connected_components(graph, directed=False)[0]
        self.genus = self.parts - (n - len(edge) + f) / 2


def least_angles(vertices, triangles):
    corner = vertices[triangles]
    side = numpy.linalg.norm(corner - numpy.roll(corner, 1, axis=1), axis=2)
    a, b, c = numpy.sort(side, axis=1).T
    return numpy.degrees(numpy.arccos(numpy.clip((b * b + c * c - a * a) / (2 * b * c), -1, 1)))


def medial_axis(point, normal):
    """Centres of balls that touch two sheets that face each other, on both sides of the surface."""
    tree, centres = cKDTree(point), []
    widest = float(numpy.ptp(point, axis=0).max())
    which = numpy.arange(0, len(point), max(1, len(point) // FIRST_PLACES))
    few = point[which]
    for side in (-1, 1):
        n = side * normal
        radius, touched = numpy.full(len(point), widest), numpy.zeros(len(point), int)
        for some in numpy.array_split(numpy.arange(len(point)), 50):  # far balls take the tree long
            d = few - point[some, None]
            across = (d * n[some, None]).sum(axis=2)
            size = numpy.where(across > 0, (d * d).sum(axis=2) / (2 * numpy.maximum(across, 1e-300)), widest)
            radius[some] = numpy.minimum(widest, size.min(axis=1) * (1 + 1e-3))
            touched[some] = which[size.argmin(axis=1)]
        asked = numpy.arange(len(point))
        for _ in range(BALL_STEPS):
            distance, other = tree.query(point[asked] + radius[asked, None] * n[asked])
            smaller = (distance < radius[asked] * (1 - BALL_TOLERANCE)) & (other != asked)
            asked, other = asked[smaller], other[smaller]
            if len(asked) == 0:
                break
            d = point[other] - point[asked]
            across = (d * n[asked]).sum(axis=1)
            radius[asked] = numpy.minimum(radius[asked], (d * d).sum(axis=1) / (2 * numpy.maximum(across, 1e-300)))
            touched[asked] = other
        facing = (normal * normal[touched]).sum(axis=1) < FACING
        centres.append((point + radius[:, None] * n)[facing & (radius < widest)])
    return numpy.concatenate(centres)


def farthest(given, made, floor):
    """The largest distance between two meshes, either way, over the local feature size."""
    point, normal = meshes.places(given, PLACES)
    axis = cKDTree(medial_axis(point, normal))
    ways = (meshes.places(given, DISTANT_PLACES)[0], made), (meshes.places(made, DISTANT_PLACES)[0], given)
    return max(other.farthest(x, numpy.maximum(axis.query(x)[0], floor)) for x, other in ways)


def resolve(worker, path, work, sampling=None):
    """The input, the report, mesh.ply, and the least spacing."""
    given = meshes.read(path)
    spec = {"version": 1, "surface": {"mesh": {"path": str(path)}},
            "sampling": {"resolve": True, "feature": {}, **(sampling or {})},
            "output": {"mesh": True, "preview": False}}
    (work / "spec.json").write_text(json.dumps(spec))
    done = subprocess.run([worker, "run", work / "spec.json", "--output", work / "out"], text=True, capture_output=True)
    if done.returncode not in (0, 10, 11):
        raise SystemExit(f"{path.name}: {done.stderr[-300:]}")
    report = json.loads((work / "out" / "report.json").read_text())
    return given, report, read_result(work / "out" / "mesh.ply"), report["grading"]["feature_size"]["floor"]


def measure(given, report, result, spacing):
    """What is measured, each with its text and whether it is within its bound."""
    vertices, triangles = result
    before, after = Topology(given.triangles), Topology(triangles)
    angles = least_angles(vertices, triangles)
    share = float((angles > LEAST_ANGLE).mean())
    distance = farthest(given, meshes.Mesh(vertices, triangles), spacing)
    thin = report["quality"]["thin_count"]  # points within 1.2 spacings of an opposite wall
    whole = after.manifold and after.genus == before.genus and after.parts == before.parts
    shape = f"{after.parts} of genus {after.genus:g}" if after.manifold else "not closed" if not after.closed else "pinched"
    return ((f"{report['count']}", True), (report["outcome"].replace("_", " "), report["outcome"] == "converged"),
            (f"{thin}", True), (f"{before.parts} of genus {before.genus:g}", True), (shape, whole),
            (f"{angles.min():.1f}", True), (f"{100 * share:.2f}", share >= SHARE), (f"{distance:.3f}", distance <= FARTHEST))


HEADER = ("mesh", "least_spacing_thousandths", "points", "outcome", "thin_points", "input_topology", "mesh_topology",
          "least_angle_deg", f"percent_above_{LEAST_ANGLE}_deg", "distance_over_feature_size", "wall_s", "missed")


def row(name, found, cells):
    """A row of HEADER: the sides of the least spacing are relative to the longest side of the bounding box."""
    longest = float(numpy.ptp(found[0].vertices, axis=0).max())
    missed = [column for column, (_, good) in zip(HEADER[2:], cells) if not good]
    return [name, f"{1000 * found[3] / longest:.2f}", *(text for text, _ in cells), f"{found[1]['timing_s']['total']:.0f}", " ".join(missed)]


def main():
    options = inputs.arguments(inputs.parser_of(__doc__.splitlines()[0]))
    worker, rows = os.path.abspath(options.worker), []
    for name in CASES:
        if options.only and not any(word in name for word in options.only):
            continue
        with tempfile.TemporaryDirectory() as where:
            found = resolve(worker, pathlib.Path(options.data) / "meshes" / name, pathlib.Path(where))
        rows.append(row(name, found, measure(*found)))
        results.write(options.output, HEADER, rows)  # a run that is interrupted leaves the rows so far
        print(*rows[-1], sep=", ", flush=True)
    missed = [f"{name}: {columns}" for name, *_, columns in rows if columns]
    print(f"{len(rows)} meshes, {len(missed)} of them miss bounds", *missed, sep="\n")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
