# SPDX-License-Identifier: Apache-2.0
"""Meshes that are damaged in ways that files have, with the surface that they still mean.

A case is a surface, one to three ways of damage and a file format, all by a seed. `truth` are the triangles that the points are
to lie on and to cover; distances from them are by brute force, and share no code with hexad.

As a program: `damaged_meshes.py BUILD [--cases N] [--seed N] [--minutes N] [--points N] [--without WAY,...] [--meshes FOLDER]` runs
cases until N are done or the time is over, prints each that fails, and ends with 1 if one of an unambiguous surface fails or more than
5 % of the others are refused. `make damaged-meshes` runs 2 000 cases. With FOLDER the surfaces are those of its meshes that are one closed
piece, have at most MOST_FACES triangles and pass while they are intact.
"""
import argparse
import json
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy
from scipy.spatial import cKDTree

import mesh_reader
from mesh_reader import _distances
from readers import Points

FLOAT_STEP, DOUBLE_STEP = 2.0 ** -23, 2.0 ** -52
OFF_SURFACE, COVERED = 1e-3, 1.2  # spacings
REFUSED_MOST = 0.05  # of the cases whose surface is ambiguous
MOST_FACES = 8000  # of a mesh of a folder: distances are by brute force


# ---- surfaces: vertices, and faces as tuples of corners, counter-clockwise from outside

def icosphere(splits=2):
    t = (1 + 5 ** 0.5) / 2
    v = [(-1, t, 0), (1, t, 0), (-1, -t, 0), (1, -t, 0), (0, -1, t), (0, 1, t), (0, -1, -t), (0, 1, -t), (t, 0, -1), (t, 0, 1),
         (-t, 0, -1), (-t, 0, 1)]
    f = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6), (7, 1, 8),
         (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    v = [numpy.array(x) / numpy.linalg.norm(x) for x in v]
    for _ in range(splits):
        middle, out = {}, []

        def at(a, b):
            key = min(a, b), max(a, b)
            if key not in middle:
                middle[key] = len(v)
                v.append((v[a] + v[b]) / numpy.linalg.norm(v[a] + v[b]))
            return middle[key]
        for a, b, c in f:
            ab, bc, ca = at(a, b), at(b, c), at(c, a)
            out += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        f = out
    return numpy.array(v), f


def prism(outline, height=1.0):
    """A solid over a simple polygon that turns to the left: polygons as its ends."""
    n = len(outline)
    v = numpy.array([(x, y, z) for z in (0.0, height) for x, y in outline])
    sides = [(k, (k + 1) % n, n + (k + 1) % n, n + k) for k in range(n)]
    return v, [tuple(range(n))[::-1], tuple(range(n, 2 * n)), *sides]


def box():
    return prism([(0, 0), (2, 0), (2, 1), (0, 1)])


def angle():
    return prism([(0, 0), (3, 0), (3, 1), (1, 1), (1, 2), (0, 2)])


def comb():
    return prism([(0, 0), (5, 0), (5, 2), (4, 2), (4, 1), (3, 1), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2)])


def torus(nu=24, nv=12):
    u, w = numpy.meshgrid(numpy.arange(nu) * 2 * numpy.pi / nu, numpy.arange(nv) * 2 * numpy.pi / nv, indexing="ij")
    r = 1 + 0.4 * numpy.cos(w)
    v = numpy.stack([r * numpy.cos(u), r * numpy.sin(u), 0.4 * numpy.sin(w)], axis=-1).reshape(-1, 3)
    f = []
    for i in range(nu):
        for j in range(nv):
            a, b, c, d = i * nv + j, (i + 1) % nu * nv + j, (i + 1) % nu * nv + (j + 1) % nv, i * nv + (j + 1) % nv
            f += [(a, b, c), (a, c, d)]
    return v, f


def sheet(n=8):
    """Open, and bent."""
    x, y = numpy.meshgrid(numpy.linspace(0, 2, n + 1), numpy.linspace(0, 2, n + 1), indexing="ij")
    v = numpy.stack([x, y, 0.2 * numpy.sin(2 * x) * numpy.cos(y)], axis=-1).reshape(-1, 3)
    f = []
    for i in range(n):
        for j in range(n):
            a, b, c, d = i * (n + 1) + j, (i + 1) * (n + 1) + j, (i + 1) * (n + 1) + j + 1, i * (n + 1) + j + 1
            f += [(a, b, c), (a, c, d)]
    return v, f


SURFACES = {"sphere": icosphere, "box": box, "angle": angle, "comb": comb, "torus": torus, "sheet": sheet}


def closed_mesh(path):
    """The vertices, within the unit sphere, and faces of a file with one closed piece; None of others."""
    mesh = mesh_reader.Mesh(path)
    faces = mesh.faces if mesh.volume > 0 else mesh.faces[:, ::-1]
    sides = [(a, b) for f in faces.tolist() for a, b in zip(f, f[1:] + f[:1])]
    if mesh.component_count > 1 or len(faces) > MOST_FACES or sorted(sides) != sorted((b, a) for a, b in sides) or \
            len(set(sides)) < len(sides):
        return None
    used, faces = numpy.unique(faces, return_inverse=True)
    vertices = mesh.vertices[used] - mesh.vertices[used].mean(axis=0)
    return vertices / numpy.linalg.norm(vertices, axis=1).max(), [tuple(f) for f in faces.reshape(-1, 3).tolist()]


def surfaces_of(folder, call, work, points):
    """As SURFACES, of the meshes of a folder that pass while they are intact."""
    out = {}
    for path in sorted(p for p in folder.iterdir() if p.suffix.lower() in (".obj", ".off", ".stl", ".ply")):
        found = closed_mesh(path)
        if found is None:
            continue
        m = Mesh(path.stem, numpy.random.default_rng(1), {path.stem: lambda found=found: found})
        if solve(m, "ply", call, work, points) is None:
            out[path.stem] = lambda found=found: found
    return out


def ears(corners, points):
    """Triangles of a planar polygon; slow and simple. A corner on the side of a triangle, but for rounding, counts as inside:
    otherwise corners on one line can remain, which are no triangle."""
    corners, out = list(corners), []
    total = sum(numpy.cross(points[a] - points[corners[0]], points[b] - points[corners[0]]) for a, b in zip(corners, corners[1:]))
    rounding = 1e-9 * (total @ total)
    while len(corners) > 3:
        for k in range(len(corners)):
            a, b, c = corners[k - 1], corners[k], corners[(k + 1) % len(corners)]
            if numpy.cross(points[b] - points[a], points[c] - points[a]) @ total <= rounding:
                continue
            if not any(all(numpy.cross(points[q] - points[p], points[x] - points[p]) @ total >= -rounding for p, q in ((a, b), (b, c), (c, a)))
                       for x in corners if x not in (a, b, c)):
                break
        else:
            raise ValueError("no ear")
        out.append((a, b, c))
        corners.pop(k)
    return [*out, tuple(corners)]


class Mesh:
    """What is damaged. Faces are polygons until `cut` is called; `truth` is what they were before."""

    def __init__(self, name, random, surfaces=None):
        vertices, faces = (surfaces or SURFACES)[name]()
        self.faces = list(faces)
        turn, _ = numpy.linalg.qr(random.standard_normal((3, 3)))
        turn *= numpy.sign(numpy.linalg.det(turn))
        scale = 10.0 ** random.integers(-3, 4)
        self.name, self.random, self.size = name, random, scale
        self.vertices = [*(scale * (vertices @ turn.T + random.uniform(-1, 1, 3)))]
        self.ambiguous, self.floats = False, False
        self.truth = self.triangles()

    def triangles(self):
        v = numpy.array(self.vertices)
        return v[[t for f in self.faces for t in (ears(f, v) if len(f) > 3 else [f])]]

    def cut(self):
        """All faces become triangles, once: the ways that make polygons come last."""
        v = numpy.array(self.vertices)
        self.faces = [t for f in self.faces for t in (ears(f, v) if len(f) > 3 else [f])]

    def add(self, place):
        self.vertices.append(numpy.asarray(place, float))
        return len(self.vertices) - 1

    def between(self, a, b, s):
        return self.add((1 - s) * self.vertices[a] + s * self.vertices[b])

    def step(self):
        """A rounding of the coordinates."""
        return (FLOAT_STEP if self.floats else DOUBLE_STEP) * numpy.abs(numpy.array(self.vertices)).max()

    def pick(self):
        """The number of a triangle whose sides are no rounding."""
        while True:
            k = int(self.random.integers(len(self.faces)))
            f = self.faces[k]
            if len(f) != 3:
                continue
            a, b, c = (self.vertices[n] for n in f)
            twice = numpy.linalg.norm(numpy.cross(b - a, c - a))
            if twice > 1e-4 * max(((b - a) ** 2).sum(), ((c - a) ** 2).sum(), ((c - b) ** 2).sum()):
                return k


# ---- ways of damage

WAYS = {}


def way(function):
    WAYS[function.__name__] = function
    return function


def on_triangles(function):
    """A way for one to six triangles."""
    def of_mesh(m):
        m.cut()
        for _ in range(int(m.random.integers(1, 7))):
            function(m, m.pick())
    of_mesh.__name__ = function.__name__
    return way(of_mesh)


def fan_at_side(m, k, places, zigzag):
    a, b, c = m.faces[k]
    new = [m.between(a, b, (n + 1) / (places + 1)) for n in range(places)]
    chain = [a, *new, b]
    m.faces[k] = (chain[0], chain[1], c)
    m.faces += [(p, q, c) for p, q in zip(chain[1:], chain[2:])]
    while len(chain) > 2:  # triangles without area between the chain and the side
        at = 1 if not zigzag or len(chain) % 2 else len(chain) - 2
        m.faces.append((chain[at - 1], chain[at + 1], chain[at]))
        chain.pop(at)


@on_triangles
def sliver_at_side(m, k):
    fan_at_side(m, k, 1, False)


@on_triangles
def slivers_about_a_corner(m, k):
    fan_at_side(m, k, int(m.random.integers(2, 9)), False)


@on_triangles
def slivers_in_zigzag(m, k):
    fan_at_side(m, k, int(m.random.integers(3, 10)), True)


@on_triangles
def sliver_in_face(m, k):
    a, b, c = m.faces[k]
    inner = m.add((m.vertices[a] + m.vertices[b] + m.vertices[c]) / 3)
    on = m.between(a, inner, m.random.uniform(0.2, 0.8))
    m.faces[k] = (a, b, inner)
    m.faces += [(b, c, inner), (c, a, on), (c, on, inner), (a, inner, on)]


@on_triangles
def needles_at_corner(m, k):
    a, b, c = m.faces[k]
    twin = m.add(m.vertices[a] + m.random.uniform(-1, 1, 3) * m.step())
    m.faces[k] = (twin, b, c)
    m.faces += [(a, b, twin), (a, twin, c)]


@on_triangles
def flap_at_side(m, k):
    a, b, _ = m.faces[k]
    m.faces.append((a, m.between(a, b, m.random.uniform(0.1, 0.9)), b))


@on_triangles
def flap_in_face(m, k):
    a, b, c = m.faces[k]
    inner = m.add((m.vertices[a] + m.vertices[b] + m.vertices[c]) / 3)
    m.faces.append((a, m.between(a, inner, 0.5), inner))


@on_triangles
def flap_of_two(m, k):
    """There and back, the same three corners."""
    a, b, _ = m.faces[k]
    middle = m.between(a, b, 0.5)
    m.faces += [(a, middle, b), (b, middle, a)]


@on_triangles
def corner_twice(m, k):
    a, b, _ = m.faces[k]
    m.faces.append((a, b, b))


@on_triangles
def corners_of_one_place(m, k):
    a, b, _ = m.faces[k]
    m.faces.append((a, b, m.add(m.vertices[b])))


@on_triangles
def split_at_the_middle(m, k):
    a, b, c = m.faces[k]
    inner = m.add((m.vertices[a] + m.vertices[b] + m.vertices[c]) / 3)
    m.faces[k] = (a, b, inner)
    m.faces += [(b, c, inner), (c, a, inner)]


def split_side(m, k, all_faces):
    a, b, _ = m.faces[k]
    middle = m.between(a, b, 0.5)
    for n in range(len(m.faces)) if all_faces else [k]:
        f = m.faces[n]
        if len(f) == 3 and a in f and b in f:
            m.faces[n] = tuple(middle if x == b else x for x in f)
            m.faces.append(tuple(middle if x == a else x for x in f))


@on_triangles
def split_side_of_both(m, k):
    split_side(m, k, True)


@on_triangles
def split_side_of_one(m, k):
    """The other triangle keeps its whole side."""
    split_side(m, k, False)


@on_triangles
def face_twice(m, k):
    a, b, c = m.faces[k]
    m.faces.append((b, c, a))


@on_triangles
def face_thrice(m, k):
    a, b, c = m.faces[k]
    m.faces += [(b, c, a), (c, a, b)]


@on_triangles
def face_and_its_back(m, k):
    """Whether there is a hole is ambiguous."""
    a, b, c = m.faces[k]
    m.faces.append((c, b, a))
    m.ambiguous = True


@way
def all_faces_twice(m):
    m.cut()
    m.faces += m.faces


@way
def faces_shuffled(m):
    m.faces = [m.faces[k] for k in m.random.permutation(len(m.faces))]


@way
def vertices_shuffled(m):
    order = m.random.permutation(len(m.vertices))
    to = numpy.argsort(order)
    m.vertices = [m.vertices[k] for k in order]
    m.faces = [tuple(int(to[x]) for x in f) for f in m.faces]


@way
def corners_rotated(m):
    m.faces = [f[k:] + f[:k] for f in m.faces for k in [int(m.random.integers(len(f)))]]


@way
def faces_turned(m):
    """Some of them: the others say which side is out."""
    for k in m.random.choice(len(m.faces), max(1, len(m.faces) // 10), replace=False):
        m.faces[k] = m.faces[k][::-1]


@way
def all_turned(m):
    m.faces = [f[::-1] for f in m.faces]


@way
def soup(m):
    """Each face has vertices of its own."""
    m.faces = [tuple(m.add(m.vertices[x]) for x in f) for f in m.faces]


@way
def soup_with_rounding(m):
    step = m.step()
    m.faces = [tuple(m.add(m.vertices[x] + m.random.integers(-1, 2, 3) * step) for x in f) for f in m.faces]


@way
def unused_vertices(m):
    for _ in range(5):
        m.add(m.size * m.random.uniform(-9, 9, 3))
    vertices_shuffled(m)


@way
def unused_vertices_without_numbers(m):
    for value in (numpy.nan, numpy.inf, -numpy.inf):
        m.add([0.0, value, 0.0])


@way
def polygons_merged(m):
    """Two triangles of a plane become a quadrangle, or join a polygon, as long as there are some."""
    m.cut()
    v, faces, order, at_side = numpy.array(m.vertices), m.faces, list(range(len(m.faces))), {}

    def sides(f):
        return zip(f, f[1:] + f[:1])
    for k, f in enumerate(faces):
        for side in sides(f):
            at_side.setdefault(side, []).append(k)
    for _ in range(4 * len(faces)):
        k = order[int(m.random.integers(len(order)))]
        f = faces[k]
        normal = sum(numpy.cross(v[a] - v[f[0]], v[b] - v[f[0]]) for a, b in zip(f, f[1:]))
        if numpy.linalg.norm(normal) < 1e-6 * m.size ** 2:
            continue
        at = int(m.random.integers(len(f)))
        a, b = f[at], f[(at + 1) % len(f)]
        other = [n for n in at_side.get((b, a), []) if n != k]
        if len(other) != 1 or len(set(f) & set(faces[other[0]])) != 2:
            continue
        g = faces[other[0]]
        if max(abs((v[x] - v[a]) @ normal) for x in g) > 1e-12 * numpy.linalg.norm(normal) * m.size:
            continue
        turned = g[g.index(a):] + g[:g.index(a)]  # a, ..., b
        for n in (k, other[0]):
            order.remove(n)
            for side in sides(faces[n]):
                at_side[side].remove(n)
        order.append(len(faces))
        faces.append(f[:at + 1] + turned[1:-1] + f[at + 1:])
        for side in sides(faces[-1]):
            at_side[side].append(order[-1])
    m.faces = [faces[k] for k in order]


@way
def polygons_with_straight_corners(m):
    """Middles of sides are corners of both faces."""
    middle = {}
    for k, f in enumerate(m.faces):
        out = []
        for a, b in zip(f, f[1:] + f[:1]):
            key = min(a, b), max(a, b)
            if key not in middle:
                middle[key] = m.between(*key, 0.5)
            out += [a, middle[key]]
        m.faces[k] = tuple(out)


@way
def polygon_corners_twice(m):
    m.faces = [f[:1] + f for f in m.faces]


@way
def points_and_lines(m):
    m.faces += [(0,), (0, 1)]


@way
def flat_polygons(m):
    a, b, *_ = m.faces[int(m.random.integers(len(m.faces)))]
    chain = [m.between(a, b, s) for s in (0.2, 0.4, 0.6, 0.8)]
    m.faces += [tuple(chain), (a, a, a, a)]


@way
def shell_beside(m):
    v, f = icosphere(1)
    base, low, high = len(m.vertices), *numpy.percentile(m.truth.reshape(-1, 3), [0, 100], axis=0)
    middle = high + 0.8 * m.size
    for x in v:
        m.add(middle + 0.5 * m.size * x)
    m.faces += [tuple(base + n for n in t) for t in f]
    m.truth = numpy.concatenate([m.truth, numpy.array(m.vertices)[[m.faces[k] for k in range(len(m.faces) - len(f), len(m.faces))]]])


@way
def shell_twice(m):
    """All of the surface once more, with vertices of its own."""
    m.faces += [tuple(m.add(m.vertices[x]) for x in f) for f in list(m.faces)]


@way
def face_removed(m):
    """The surface is open there; points lie on what is left."""
    m.cut()
    if len(m.faces) != len(m.truth):
        return  # not the only damage
    m.faces.pop(m.pick())
    m.truth = m.triangles()


@way
def in_floats(m):
    m.floats = True


@way
def far_away(m):
    shift = 100 * m.size
    m.vertices = [v + shift for v in m.vertices]
    m.truth = m.truth + shift


# In this order, as others compute with triangles and with all vertices.
LAST = ["polygons_merged", "polygons_with_straight_corners", "flat_polygons", "polygon_corners_twice", "points_and_lines",
        "unused_vertices_without_numbers"]


# ---- files

def write_ply(m, path):
    kind, number = ("float", "<f4") if m.floats else ("double", "<f8")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(m.vertices)}\n" + "".join(f"property {kind} {a}\n" for a in "xyz")
    head += f"element face {len(m.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_bytes(head.encode() + numpy.array(m.vertices, number).tobytes() +
                     b"".join(bytes([len(f)]) + numpy.array(f, "<i4").tobytes() for f in m.faces))


def write_text(m, path, begin, face):
    write = (lambda x: repr(float(numpy.float32(x)))) if m.floats else (lambda x: repr(float(x)))
    path.write_text(begin[0] + "".join(begin[1] + " ".join(map(write, v)) + "\n" for v in m.vertices) + "".join(map(face, m.faces)))


def write_obj(m, path):
    write_text(m, path, ("", "v "), lambda f: "f " + " ".join(str(x + 1) for x in f) + "\n")


def write_off(m, path):
    write_text(m, path, (f"OFF\n{len(m.vertices)} {len(m.faces)} 0\n", ""), lambda f: f"{len(f)} " + " ".join(map(str, f)) + "\n")


FORMATS = {"ply": write_ply, "obj": write_obj, "off": write_off}


def make(seed, without=(), surfaces=None):
    """(mesh, names of its surface, damage and format) of a case."""
    random = numpy.random.default_rng(seed)
    m = Mesh(str(random.choice(sorted(surfaces or SURFACES))), random, surfaces)
    ways = [str(w) for w in random.choice(sorted(set(WAYS) - set(without)), int(random.integers(1, 4)), replace=False)]
    m.floats = "in_floats" in ways
    ways.sort(key=lambda w: LAST.index(w) if w in LAST else -1)
    twice = {"all_faces_twice", "face_twice", "face_thrice", "shell_twice"} & set(ways)
    m.ambiguous |= bool("faces_turned" in ways and twice)  # of two faces one may be turned: they cancel
    for name in ways:
        WAYS[name](m)
    kind = str(random.choice(sorted(FORMATS))) if "unused_vertices_without_numbers" not in ways else "ply"
    return m, (m.name, *ways, kind)


# ---- what comes of them

def distances(points, triangles):
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    has_area = numpy.linalg.norm(numpy.cross(b - a, c - a), axis=1) > 1e-12 * ((b - a) ** 2).sum(axis=1)
    a, b, c = a[has_area], b[has_area], c[has_area]
    low, high = numpy.minimum(numpy.minimum(a, b), c), numpy.maximum(numpy.maximum(a, b), c)
    corner = cKDTree(numpy.concatenate([a, b, c])).query(points)[0]  # no nearest triangle is farther
    out = numpy.empty(len(points))
    for k, p in enumerate(points):
        reach = corner[k] * (1 + 1e-9)
        near = ((low <= p + reach) & (high >= p - reach)).all(axis=1)
        out[k] = _distances(numpy.broadcast_to(p, (near.sum(), 3)), a[near], b[near], c[near]).min()
    return out


def farthest_place(points, triangles, random, count=6000):
    """Of random places of the triangles, by area, from the points."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    area = numpy.linalg.norm(numpy.cross(b - a, c - a), axis=1)
    chosen = random.choice(len(area), count, p=area / area.sum())
    u, v = random.random((2, count, 1))
    fold = u + v > 1
    u, v = numpy.where(fold, 1 - u, u), numpy.where(fold, 1 - v, v)
    places = a[chosen] + u * (b[chosen] - a[chosen]) + v * (c[chosen] - a[chosen])
    return cKDTree(points).query(places)[0].max()


def judge(m, done, out):
    """None, or what is wrong; ("refused", words) for a mesh that gives no points."""
    if done.returncode not in (0, 10, 11):
        return "refused", done.stderr.strip()[-300:]
    report = json.loads((out / "report.json").read_text())
    points, h = Points((out / "points.ply").read_bytes()).position, report["spacing"]
    if m.floats:
        m.truth = m.truth.astype(numpy.float32).astype(float)
    off, far = distances(points, m.truth).max() / h, farthest_place(points, m.truth, numpy.random.default_rng(1)) / h
    wrong = [f"a point is {off:.3g} h off the surface"] if not off <= OFF_SURFACE else []
    wrong += [f"a place is {far:.3g} h from all points"] if not far <= COVERED else []
    if not report["quality"]["max_residual"] <= OFF_SURFACE and report["outcome"] != "not_converged":
        wrong += [f"max_residual {report['quality']['max_residual']:.3g} with outcome {report['outcome']}"]
    return ("wrong", f"{report['outcome']}: " + ", ".join(wrong)) if wrong else None


def solve(m, kind, call, folder, points):
    """judge's answer for a mesh, written as a file of a kind. `call` runs a spec's file into a folder."""
    path, out = folder / f"mesh.{kind}", folder / "out"
    FORMATS[kind](m, path)
    spec = {"version": 1, "surface": {"mesh": {"path": str(path)}}, "sampling": {"count": points}, "solver": {"threads": 1},
            "output": {"preview": False}}
    (folder / "spec.json").write_text(json.dumps(spec))
    return judge(m, call(folder / "spec.json", out), out)


def run(seed, call, folder, points, without=(), surfaces=None):
    """The names of the case, whether its surface is ambiguous, and judge's answer."""
    m, names = make(seed, without, surfaces)
    return names, m.ambiguous, solve(m, names[-1], call, folder, points)


def run_cases(build, cases, seed, points, say, minutes=240, without=(), meshes_folder=None):
    """Runs cases, and says which fail. Whether no unambiguous one does, and at most 5 % of the others are refused."""
    end, counts = time.monotonic() + 60 * minutes, {"cases": 0, "wrong": 0, "refused": 0, "ambiguous": 0, "ambiguous refused": 0}
    say(f"seed {seed}")

    def call(spec, out):
        return subprocess.run([build / "hexad-worker", "run", spec, "--output", out], capture_output=True, text=True)
    with tempfile.TemporaryDirectory() as folder:
        surfaces = surfaces_of(meshes_folder, call, pathlib.Path(folder), points) if meshes_folder else SURFACES
        say("surfaces: " + " ".join(sorted(surfaces)))
        for k in range(cases if surfaces else 0):
            if time.monotonic() > end:
                break
            names, ambiguous, found = run(seed + k, call, pathlib.Path(folder), points, without, surfaces)
            counts["cases"] += 1
            counts["ambiguous"] += ambiguous
            if found:
                counts[found[0] if found[0] == "wrong" or not ambiguous else "ambiguous refused"] += 1
                say(f"{seed + k} {' '.join(names)}: {found[0]}: {found[1]}")
            if counts["cases"] % 100 == 0:
                say(str(counts))
    say(str(counts))
    return not (counts["wrong"] or counts["refused"] or counts["ambiguous refused"] > REFUSED_MOST * max(counts["ambiguous"], 1))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", type=lambda text: pathlib.Path(text).resolve())
    parser.add_argument("--cases", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--minutes", type=float, default=240)
    parser.add_argument("--points", type=int, default=400)
    parser.add_argument("--without", default="", help="ways that are left out")
    parser.add_argument("--meshes", type=pathlib.Path, metavar="FOLDER", help="damage the meshes of a folder")
    o = parser.parse_args()
    without = [w for w in o.without.split(",") if w]
    return not run_cases(o.build, o.cases, o.seed, o.points, lambda text: print(text, flush=True), o.minutes, without, o.meshes)


if __name__ == "__main__":
    sys.exit(main())
