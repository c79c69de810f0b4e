#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares measures of reports with an exact program on bad and good point sets (measurements/measures/README.md).

    measurements/measures/adversarial.py --worker build/hexad-worker [--output measurements/measures/adversarial.csv] [--only WORD] [--seed 1]

Shares no code with the project. Each triangle is clipped by the bisectors of the points that can be nearest to one of its places. Normals of
points on smooth places are those of points.ply, which also decide in hexad; on creases those of the triangles there.
"""
import argparse
import json
import math
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from scipy.sparse import coo_matrix, csgraph
from scipy.spatial import cKDTree

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1] / "common"),
                str(pathlib.Path(__file__).resolve().parents[2] / "tests" / "service")]
import results  # noqa: E402
from readers import read_columns  # noqa: E402

# Absolute, and of energy_excess relative to the mean energy: of random points single pairs have most of it.
BOUNDS = {"hex_fraction": 0.002, "edge_cv": 0.002, "coverage": 0.002, "defect_share": 0.005, "edge_skipped_share": 0.002, "area_cv": 0.005,
          "energy_excess": 0.002}
OPPOSITE, LEAST_SIDE, FOLD, ON = -0.4, 1e-6, 0.5, 1e-6
# Cosine of normals up to which a pair of opposite walls has no energy; the energy of an ideal packing.
NO_ENERGY, IDEAL_ENERGY = -0.6, 0.710825908
# Faces whose normals have a smaller cosine meet in a crease.
CREASE = 0.7


# ---- surfaces

def patch(f, m, n, wrap_u=False, wrap_v=False, twist=False):
    """Triangles of a map of m x n cells of the unit square; `twist`: u = 1 is glued to u = 0 with v reversed."""
    us, vs = m + (not (wrap_u or twist)), n + (not wrap_v)
    vertex = np.array([f(i / m, k / n) for i in range(us) for k in range(vs)], float)

    def at(i, k):
        if twist and i == m:
            i, k = 0, n - k
        return (i % us) * vs + k % vs
    faces = []
    for i in range(m):
        for k in range(n):
            a, b, c, d = at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)
            faces += [(a, b, c), (a, c, d)]
    return vertex, np.array(faces)


def united(*parts):
    vertex, faces, before = [], [], 0
    for v, f in parts:
        vertex.append(v)
        faces.append(np.asarray(f) + before)
        before += len(v)
    return np.concatenate(vertex), np.concatenate(faces)


def ball(radius, centre=(0, 0, 0), level=4, stretch=(1, 1, 1), bumps=None):
    """An octahedron divided `level` times."""
    v = [np.array(p, float) for p in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))]
    f = [(a, b, c) if np.linalg.det([v[a], v[b], v[c]]) > 0 else (a, c, b) for a in (0, 1) for b in (2, 3) for c in (4, 5)]
    for _ in range(level):
        middle, out = {}, []

        def between(a, b):
            key = (min(a, b), max(a, b))
            if key not in middle:
                p = v[a] + v[b]
                v.append(p / np.linalg.norm(p))
                middle[key] = len(v) - 1
            return middle[key]
        for a, b, c in f:
            d, e, g = between(a, b), between(b, c), between(c, a)
            out += [(a, d, g), (d, b, e), (g, e, c), (d, e, g)]
        f = out
    v = np.array(v)
    r = radius * (np.array([bumps(p) for p in v]) if bumps else np.ones(len(v)))
    return v * r[:, None] * stretch + centre, np.array(f)


def box(a, b, c):
    v = np.array([(x, y, z) for x in (0, a) for y in (0, b) for z in (0, c)], float)
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return v, np.array([t for p, q, r, s in quads for t in ((p, q, r), (p, r, s))])


def plane(size=10.0, cells=20, height=lambda x, y: 0.0):
    return patch(lambda u, v: (size * u, size * v, height(size * u, size * v)), cells, cells)


def torus(major, minor, m=64, n=32):
    def f(u, v):
        a, b = 2 * math.pi * u, 2 * math.pi * v
        return ((major + minor * math.cos(b)) * math.cos(a), (major + minor * math.cos(b)) * math.sin(a), minor * math.sin(b))
    return patch(f, m, n, True, True)


def moebius(radius=3.0, width=2.0, m=96, n=12):
    def f(u, v):
        a, t = 2 * math.pi * u, width * (v - 0.5)
        r = radius + t * math.cos(a / 2)
        return (r * math.cos(a), r * math.sin(a), t * math.sin(a / 2))
    return patch(f, m, n, twist=True)


def spikes(count, height, seed=3):
    rng = np.random.default_rng(seed)
    axis = rng.standard_normal((count, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    return lambda p: 1 + height * sum(math.exp(-60 * (1 - p @ a)) for a in axis)


SURFACES = {
    "plane": lambda: plane(), "ball": lambda: ball(2), "torus": lambda: torus(2, 0.7), "cube": lambda: box(3, 3, 3),
    "plate": lambda: box(4, 4, 0.15), "moebius strip": lambda: moebius(),
    "spiked ball": lambda: ball(1.5, level=5, bumps=spikes(12, 1.0)),
    "ripples": lambda: plane(8, 80, lambda x, y: 0.3 * math.sin(3 * x)),
    "deep ripples": lambda: plane(6, 96, lambda x, y: 1.2 * math.sin(4 * x)),
    "needle": lambda: ball(3, stretch=(1, 0.08, 0.08), level=5),
    "slivers": lambda: patch(lambda u, v: (10 * u, 10 * v, 0), 200, 2),
    "close sheets": lambda: united(plane(6, 12), plane(6, 12, lambda x, y: 0.1)),
    "tiny pieces": lambda: united(ball(2), *(ball(0.05, (3 + k, 0, 0), 2) for k in range(3))),
    "two balls": lambda: united(ball(1.5), ball(1.0, (4, 0, 0))),
}


# ---- points that are given

def area_places(vertex, faces, count, rng):
    a, b, c = (vertex[faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    t = rng.choice(len(faces), count, p=area / area.sum())
    u, w = rng.random((2, count))
    over = u + w > 1
    u[over], w[over] = 1 - u[over], 1 - w[over]
    return a[t] + u[:, None] * (b - a)[t] + w[:, None] * (c - a)[t]


def square(n, shift=0.0, size=10.0):
    x = (np.arange(n) + 0.5) * size / n
    p = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    p[:, 0] += shift * (p[:, 1] > size / 2)
    return np.c_[np.clip(p, 0, size), np.zeros(len(p))]


def clustered(n, size=10.0):
    p = square(n)
    return np.c_[size * (p[:, :2] / size) ** 2, np.zeros(len(p))]


def given_sets(rng):
    yield "plane", "square lattice", square(16)
    yield "plane", "shifted lattice", square(15, 0.3)
    yield "plane", "clustered lattice", clustered(15)
    yield "plane", "stretched lattice", np.repeat(square(16), 1, 0)[::2]
    yield "slivers", "square lattice", square(15)
    for name in ("plane", "ball", "torus", "moebius strip", "ripples", "spiked ball", "needle", "two balls", "tiny pieces", "close sheets", "slivers"):
        vertex, faces = SURFACES[name]()
        for count in (60, 250):
            yield name, f"{count} random", area_places(vertex, faces, count, rng)
    vertex, faces = SURFACES["torus"]()
    yield "torus", "half of it random", (lambda p: p[p[:, 0] > 0])(area_places(vertex, faces, 400, rng))
    vertex, faces = SURFACES["ball"]()
    p = area_places(vertex, faces, 150, rng)
    yield "ball", "duplicates", np.r_[p, p[:10]]
    yield "ball", "nearly duplicates", np.r_[p, p[:10] + 1e-5]


def sets(seed):
    """Name, surface, count, given points."""
    rng = np.random.default_rng(seed)
    for name, kind, points in given_sets(rng):
        yield f"{name}: {kind}", name, len(points), points
    for name in SURFACES:
        for count in (100, 400):
            yield f"{name}: solved, {count}", name, count, None


# ---- the exact program

def clip(polygon, behind, normal, offset, other):
    """The part with normal . x <= offset; behind[k]: the point beyond the edge from corner k."""
    height = polygon @ normal - offset
    if (height <= 0).all():
        return polygon, behind
    out, beyond = [], []
    for k in range(len(polygon)):
        n = (k + 1) % len(polygon)
        if height[k] <= 0:
            out.append(polygon[k])
            beyond.append(behind[k])
        if (height[k] <= 0) != (height[n] <= 0):
            out.append(polygon[k] + height[k] / (height[k] - height[n]) * (polygon[n] - polygon[k]))
            beyond.append(other if height[k] <= 0 else behind[k])
    return np.array(out).reshape(-1, 3), beyond


def cells_of(x, corners, candidates):
    """(point, polygon, points behind its edges) of the cells in a triangle."""
    middle = corners.mean(0)
    radius = np.linalg.norm(corners - middle, axis=1).max()
    distance = np.linalg.norm(x[candidates] - middle, axis=1)
    candidates = candidates[distance <= distance.min() + 2 * radius * (1 + 1e-9)]
    square = ((x[candidates, None] - corners) ** 2).sum(-1)
    # a candidate that another one beats at each corner is nowhere the nearest
    nearest = np.unique(np.r_[square.argmin(0), square.sum(1).argmin()])
    beaten = (square[:, None] > square[nearest][None] * (1 + 1e-9)).all(-1).any(1)
    candidates = candidates[~beaten]
    for i in candidates:
        polygon, behind = corners, [-1, -1, -1]
        for j in candidates:
            if i == j or len(polygon) == 0:
                continue
            to = x[j] - x[i]
            if not to.any():
                polygon = polygon if i < j else polygon[:0]
                continue
            polygon, behind = clip(polygon, behind, to, to @ (x[i] + x[j]) / 2, j)
        if len(polygon) > 2:
            yield i, polygon, behind


def triangle_distance(q, a, b, c):
    """The distance of places q from triangles; all broadcast."""
    ab, ac, aq = b - a, c - a, q - a
    n = np.cross(ab, ac)
    nn = (n * n).sum(-1)
    w1, w2 = (np.cross(aq, ac) * n).sum(-1) / nn, (np.cross(ab, aq) * n).sum(-1) / nn
    best = np.where((w1 >= 0) & (w2 >= 0) & (w1 + w2 <= 1), abs((aq * n).sum(-1)) / np.sqrt(nn), np.inf)
    for o, e in ((a, ab), (b, c - b), (c, a - c)):
        t = np.clip(((q - o) * e).sum(-1) / (e * e).sum(-1), 0, 1)
        best = np.minimum(best, np.linalg.norm(q - o - t[..., None] * e, axis=-1))
    return best


class Mesh:
    def __init__(self, vertex, faces):
        self.vertex, self.faces = vertex, faces
        self.a, self.b, self.c = (vertex[faces[:, k]] for k in range(3))
        cross = np.cross(self.b - self.a, self.c - self.a)
        self.normal = cross / np.linalg.norm(cross, axis=1)[:, None]
        side = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), 1)
        edge, self.side_edge, count = np.unique(side, axis=0, return_inverse=True, return_counts=True)
        self.border = edge[count == 1]
        owner = np.tile(np.arange(len(faces)), 3)
        link = coo_matrix((np.ones(len(owner)), (owner, self.side_edge.ravel())), (len(faces), len(edge)))
        self.pieces, self.piece = csgraph.connected_components(link @ link.T, directed=False)
        self.euler = np.zeros(self.pieces)
        for p in range(self.pieces):
            own = faces[self.piece == p]
            edges = np.unique(np.sort(np.concatenate([own[:, [0, 1]], own[:, [1, 2]], own[:, [2, 0]]]), 1), axis=0)
            self.euler[p] = len(np.unique(own)) - len(edges) + len(own)

    def distances(self, q):
        return triangle_distance(q, self.a, self.b, self.c)


def angle_at(mesh, x, on, h):
    """The angle of the surface at a point on a curve, and whether it is on a border."""
    vertex = np.linalg.norm(mesh.vertex - x, axis=1)
    a, b = mesh.vertex[mesh.border[:, 0]], mesh.vertex[mesh.border[:, 1]]
    border = False
    if len(a):
        t = np.clip(((x - a) * (b - a)).sum(1) / ((b - a) ** 2).sum(1), 0, 1)
        border = np.linalg.norm(x - a - t[:, None] * (b - a), axis=1).min() < ON * h
    if vertex.min() >= ON * h:
        return (math.pi if border else 2 * math.pi), border
    at, total = vertex.argmin(), 0
    for f in mesh.faces[on]:
        if at in f:
            k = list(f).index(at)
            p, q = mesh.vertex[f[(k + 1) % 3]] - mesh.vertex[at], mesh.vertex[f[(k + 2) % 3]] - mesh.vertex[at]
            total += math.acos(np.clip(p @ q / np.linalg.norm(p) / np.linalg.norm(q), -1, 1))
    return total, border


def potential(u):
    """The cotangent potential of distances over the support."""
    with np.errstate(divide="ignore"):
        return np.where(u < 1, 1 / np.tan(np.pi * u / 2) + np.pi * u / 2 - np.pi / 2, 0)


def energies(x, h, normal, piece, one_sided):
    """The energy of each point over that of a point in an ideal packing, all pairs summed."""
    total = np.zeros(len(x))
    for i in range(len(x)):
        cosine = np.einsum("ac,jbc->jab", normal[i], normal)
        facing = (abs(cosine) if one_sided else cosine).max((1, 2)) > NO_ENERGY
        mean = (h[i] + h) / 2
        pair = (mean / h[i]) ** 2 * potential(np.linalg.norm(x - x[i], axis=1) / (math.sqrt(3) * mean))
        total[i] = pair[facing & (piece == piece[i]) & (np.arange(len(x)) != i)].sum()
    return total / IDEAL_ENERGY


def measure(mesh, table, one_sided):
    x = np.stack([table[a] for a in "xyz"], 1).astype(float)
    h = np.asarray(table["spacing"], float)
    count = len(x)
    on_curve = np.asarray(table["feature"]) > 0 if "feature" in table else np.zeros(count, bool)
    normals, piece, angle, border = [], np.zeros(count, int), np.full(count, 2 * math.pi), np.zeros(count, bool)
    for i in range(count):
        d = mesh.distances(x[i])
        piece[i] = mesh.piece[d.argmin()]
        on = np.flatnonzero(d <= d.min() + ON * h[i])
        own = np.array([[table[n][i] for n in ("nx", "ny", "nz")]], float)
        has_divergent_normals = on_curve[i] and (mesh.normal[on] @ mesh.normal[on].T).min() < CREASE
        normals.append(mesh.normal[on] if has_divergent_normals else own)
        if on_curve[i]:
            angle[i], border[i] = angle_at(mesh, x[i], on, h[i])
    most = max(len(n) for n in normals)
    normal = np.stack([np.r_[n, np.repeat(n[:1], most - len(n), 0)] for n in normals])
    farthest, sides, area = 0, {}, np.zeros(count)
    for t in range(len(mesh.faces)):
        corners = np.stack([mesh.a[t], mesh.b[t], mesh.c[t]])
        for i, polygon, _ in cells_of(x, corners, np.arange(count)):
            farthest = max(farthest, np.linalg.norm(polygon - x[i], axis=1).max() / h[i])
        cosine = normal @ mesh.normal[t]
        facing = (abs(cosine) if one_sided else cosine).max(1) > OPPOSITE
        candidates = np.flatnonzero(facing & (piece == mesh.piece[t]))
        if len(candidates) == 0:
            continue
        for i, polygon, behind in cells_of(x, corners, candidates):
            fan = np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0])
            area[i] += np.linalg.norm(fan, axis=1).sum() / 2
            for k, j in enumerate(behind):
                if j >= 0:
                    key = (min(i, j), max(i, j))
                    length = np.linalg.norm(polygon[(k + 1) % len(polygon)] - polygon[k])
                    sides[key] = sides.get(key, 0) + (length if i < j else 0)
    pairs = np.array([key for key, length in sides.items() if length > LEAST_SIDE * (h[key[0]] + h[key[1]]) / 2])
    degree = np.bincount(pairs.ravel(), minlength=count)
    mean = (h[pairs[:, 0]] + h[pairs[:, 1]]) / 2
    distance = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1) / mean
    skipped = np.array([d > 2 * FOLD and mesh.distances((x[p] + x[q]) / 2).min() > FOLD * m
                        for (p, q), d, m in zip(pairs, distance, mean)])
    ideal = angle / (math.pi / 3) + border
    regular = (degree >= np.floor(ideal + 0.2)) & (degree <= np.ceil(ideal - 0.2))
    bad = np.bincount(piece[~regular], minlength=mesh.pieces)
    has = np.bincount(piece, minlength=mesh.pieces) > 0
    kept = distance[~skipped]
    own = area / (h ** 2 * angle / (2 * math.pi))
    return {"hex_fraction": regular.mean(), "edge_cv": kept.std() / kept.mean(), "coverage": farthest, "edge_skipped_share": skipped.mean(),
            "area_cv": own.std() / own.mean(), "energy_excess": (energies(x, h, normal, piece, one_sided) / (ideal / 6)).mean() - 1,
            "defect_share": np.maximum(bad - 6 * abs(mesh.euler), 0)[has].sum() / count}


# ---- jobs

def write_obj(path, vertex, faces):
    path.write_text("".join("v %.17g %.17g %.17g\n" % tuple(p) for p in vertex) + "".join("f %d %d %d\n" % tuple(f + 1) for f in faces))


def write_points(path, points):
    path.write_text("\n".join(["ply", "format ascii 1.0", f"element vertex {len(points)}", *(f"property double {a}" for a in "xyz"), "end_header",
                               *("%.17g %.17g %.17g" % tuple(p) for p in points), ""]))


def run(worker, folder, surface, count, given):
    vertex, faces = SURFACES[surface]()
    write_obj(folder / "m.obj", vertex, faces)
    sampling = {"count": count if given is None else count + count // 2 + 8}  # the rest is free
    if given is not None:
        write_points(folder / "given.ply", given)
        sampling["points"] = {"path": str(folder / "given.ply"), "mode": "keep"}
    spec = {"version": 1, "surface": {"mesh": {"path": str(folder / "m.obj")}}, "sampling": sampling, "solver": {"threads": 1},
            "output": {"preview": False, "ply": {"precision": "double", "properties": ["all"]}}}
    (folder / "spec.json").write_text(json.dumps(spec))
    done = subprocess.run([worker, "run", folder / "spec.json", "--output", folder / "out"], capture_output=True, text=True)
    if done.returncode not in (0, 10, 11):
        return None, done.stderr.strip()
    report = json.loads((folder / "out" / "report.json").read_text())
    table = read_columns((folder / "out" / "points.ply").read_bytes())
    return report, measure(Mesh(vertex, faces), table, report["surface"]["mesh"]["one_sided_patches"] > 0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worker", required=True)
    parser.add_argument("--output", type=pathlib.Path)
    parser.add_argument("--only", default="")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rows = []
    for name, surface, count, given in sets(options.seed):
        if options.only not in name:
            continue
        with tempfile.TemporaryDirectory() as folder:
            report, found = run(options.worker, pathlib.Path(folder), surface, count, given)
        if report is None:
            print(f"{name}: {found}", flush=True)
            continue
        told = {k: report["quality"][k] for k in BOUNDS}
        apart = [k for k, bound in BOUNDS.items()
                 if told[k] is None or not abs(told[k] - found[k]) <= bound * (1 + found[k] if k == "energy_excess" else 1)]
        rows.append([name, count, *(f"{v:.4f}" if v is not None else "" for k in BOUNDS for v in (told[k], found[k])), " ".join(apart)])
        print(*rows[-1], flush=True)
    if options.output:
        results.write(options.output, ["row", "points", *(f"{k}_{of}" for k in BOUNDS for of in ("report", "program")), "differences"], rows)
    print(f"{len(rows)} sets, {sum(bool(row[-1]) for row in rows)} with differences beyond the bounds (seed {options.seed})")


if __name__ == "__main__":
    main()
