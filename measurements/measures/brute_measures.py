#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares the measures of reports with those of a program that compares places with all points near them
(measurements/measures/README.md).

    measurements/measures/brute_measures.py --worker build/hexad-worker --data FOLDER --output measurements/measures/brute_measures.csv
                                            [--only NAME,...]

FOLDER has the volumes that JOBS names. The definitions are those of doc/report.md. Shares no code with the project: surfaces are
triangles of marching tetrahedra on grids of an eighth of the spacing or less, of formulas, of splines of scipy through a volume's
samples, or of the true interfaces of a segmentation. Coverage, which is taken at the triangles' corners, is up to .03 low.
"""
import argparse
import json
import pathlib
import resource
import subprocess
import sys
import tempfile

import numpy
from scipy import ndimage
from scipy.sparse import coo_matrix, csgraph
from scipy.spatial import cKDTree

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tests" / "service"))
from label_shapes import TURNED, Balls, places  # noqa: E402
from readers import read_columns  # noqa: E402
from volumes import read_nifti, read_nrrd, write_nrrd  # noqa: E402

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import results  # noqa: E402

# Bounds of the measures' definitions: the cosine of opposite walls; close, coincident and missing, in spacings.
OPPOSITE, CLOSE, COINCIDENT, MISSING = -0.4, 0.25, 1e-3, 1.2
# Parts of an edge of a triangle that two cells share, and how often two cells must meet to be neighbours.
PARTS, LEAST_MEETINGS = 8, 3
# Points that are compared with a place at first; where none of them belongs to the place's side, all are.
NEAREST = 24
# What may differ, and hex_fraction below FEW points.
ALLOWED = {"coverage": 0.05, "missing_share": 0.003, "close_share": 0.002, "hex_fraction": 0.04, "min_spacing_ratio": 0.01,
           "coincident": 0, "parts_without_points": 0}
FEW, ALLOWED_OF_FEW = 300, 0.1
# Of volumes the coverage may also differ by this part of a voxel: specks have the size of one.
ALLOWED_VOXEL = 0.25


# ---- surfaces: triangles with a patch each

class Surface:
    """Triangles (corners [n, 3, 3]) whose normals point from the first to the second label of their patch. `gradient` gives the normals of
    a smooth surface; without it they are those of the triangles."""
    def __init__(self, corners, patch=None, labels=None, box=None, gradient=None):
        self.corners, self.labels, self.box, self.gradient = corners, labels, box, gradient
        self.patch = numpy.zeros(len(corners), int) if patch is None else patch
        cross = numpy.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        twice = numpy.linalg.norm(cross, axis=1)
        self.keep(twice > 1e-9 * twice.max(), cross, twice)
        self.middle = self.corners.mean(1)
        self.piece = pieces(self.corners)
        if gradient:
            self.normal = gradient(self.middle)

    def keep(self, chosen, cross, twice):
        self.corners, self.patch = self.corners[chosen], self.patch[chosen]
        self.normal, self.area = cross[chosen] / twice[chosen, None], twice[chosen] / 2


def gradient_of(function, step, matrix=numpy.eye(3), origin=numpy.zeros(3)):
    """Unit gradients at places matrix i + origin, by differences of a function of i."""
    inverse = numpy.linalg.inv(matrix)

    def gradient(x):
        at = (x - origin) @ inverse.T
        slope = numpy.stack([function(at + step * axis) - function(at - step * axis) for axis in numpy.eye(3)], 1) @ inverse
        return slope / numpy.linalg.norm(slope, axis=1)[:, None]
    return gradient


def pieces(corners):
    """Triangles that share a corner, to a millionth of their size, are of one piece."""
    unit = 1e-6 * abs(corners).max()
    key = numpy.unique(numpy.rint(corners.reshape(-1, 3) / unit).astype(numpy.int64), axis=0, return_inverse=True)[1].reshape(-1, 3)
    joined = coo_matrix((numpy.ones(2 * len(key)), (numpy.r_[key[:, 0], key[:, 0]], numpy.r_[key[:, 1], key[:, 2]])),
                        (key.max() + 1,) * 2)
    return csgraph.connected_components(joined, directed=False)[1][key[:, 0]]


# The six tetrahedra around the diagonal of a cube, by the numbers of its corners x + 2 y + 4 z.
TETRAHEDRA = numpy.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]])


def cut(x, f, inside, outside):
    """Zeros on the edges of tetrahedra between corners of these numbers."""
    rows = numpy.arange(len(f))
    a, b = f[rows, inside], f[rows, outside]
    return x[rows, inside] + (a / (a - b))[:, None] * (x[rows, outside] - x[rows, inside])


def triangles_of(x, f):
    """The zero set in tetrahedra with corners x [n, 4, 3] and values f [n, 4]; normals point to where f is positive."""
    out = []
    order = numpy.argsort(f >= 0, axis=1, kind="stable")  # the negative corners first
    count = (f < 0).sum(1)
    for negative in (1, 2, 3):
        of = count == negative
        o, y, g = order[of], x[of], f[of]
        if negative == 2:
            p, q, r, s = (cut(y, g, o[:, i], o[:, k]) for i, k in ((0, 2), (0, 3), (1, 3), (1, 2)))
            found = [numpy.stack([p, q, r], 1), numpy.stack([p, r, s], 1)]
        else:
            alone = 0 if negative == 1 else 3
            others = [k for k in range(4) if k != alone]
            found = [numpy.stack([cut(y, g, o[:, alone], o[:, k]) for k in others], 1)]
        rows = numpy.arange(len(g))
        outwards = y[rows, o[:, 3]] - y[rows, o[:, 0]]
        for t in found:
            back = (numpy.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]) * outwards).sum(1) < 0
            t[back] = t[back][:, ::-1]
            out.append(t)
    return numpy.concatenate(out)


def march(function, low, high, cell):
    """Triangles of the zero set of a function of places [n, 3] in a box."""
    size = numpy.ceil((numpy.asarray(high) - low) / cell).astype(int)
    axes = [numpy.linspace(low[k], high[k], size[k] + 1) for k in range(3)]
    value = numpy.empty(size + 1)
    for i, x in enumerate(axes[0]):  # a slice at a time
        at = numpy.stack(numpy.meshgrid([x], axes[1], axes[2], indexing="ij"), -1)
        value[i] = function(at.reshape(-1, 3)).reshape(at.shape[1:3])
    value[value == 0] = 1e-300
    sign = value < 0
    some = numpy.zeros(size, bool)
    every = numpy.ones(size, bool)
    shifts = [(k & 1, k >> 1 & 1, k >> 2) for k in range(8)]
    for s in shifts:
        part = sign[s[0]:size[0] + s[0], s[1]:size[1] + s[1], s[2]:size[2] + s[2]]
        some |= part
        every &= part
    at = numpy.argwhere(some & ~every)
    corner = at[:, None] + numpy.array(shifts)
    x = numpy.stack([axes[k][corner[..., k]] for k in range(3)], -1)
    f = value[corner[..., 0], corner[..., 1], corner[..., 2]]
    return numpy.concatenate([triangles_of(x[:, t], f[:, t]) for t in TETRAHEDRA])


# ---- points

class Points:
    """Delivered points. Each has up to four sides: a normal and the patch that it belongs to."""
    def __init__(self, path, surface, cell):
        table = read_columns(path.read_bytes())
        self.x = numpy.stack([table[a] for a in "xyz"], 1).astype(float)
        self.h = numpy.asarray(table["spacing"], float)
        tree = cKDTree(surface.middle)
        _, near = tree.query(self.x, k=min(64, len(surface.middle)))
        self.piece = surface.piece[near[:, 0]]
        self.normal = surface.gradient(self.x)[:, None] if surface.gradient else surface.normal[near[:, :1]]
        self.patch = surface.patch[near[:, :1]]
        self.has = numpy.ones((len(self.x), 1), bool)
        if surface.labels is not None:  # on a line each interface there
            on_line = table["feature"] > 0
            for p in range(len(surface.labels)):
                d, at = cKDTree(surface.middle[surface.patch == p]).query(self.x)
                at = numpy.flatnonzero(surface.patch == p)[at]
                self.has = numpy.c_[self.has, on_line & (d < 4 * cell)]
                self.normal = numpy.concatenate([self.normal, surface.normal[at][:, None]], 1)
                self.patch = numpy.c_[self.patch, numpy.full(len(at), p)]
            self.fork = on_line
        else:
            self.fork = numpy.zeros(len(self.x), bool)

    def __len__(self):
        return len(self.x)


def signs(labels, p, q):
    """How cosines of normals of patches are to be read: 0 where the patches share no label."""
    if labels is None:
        return numpy.ones(numpy.broadcast(p, q).shape)
    a, b = labels[p], labels[q]
    same = (a[..., 0] == b[..., 0]) | (a[..., 1] == b[..., 1])
    turned = (a[..., 0] == b[..., 1]) | (a[..., 1] == b[..., 0])
    return numpy.where(same, 1, numpy.where(turned, -1, 0))


def are_facing(surface, points, normal, patch, i):
    """Whether places with these normals [...] and the points i are not of opposite walls."""
    sign = signs(surface.labels, points.patch[i], numpy.asarray(patch)[..., None])
    c = (points.normal[i] * normal[..., None, :]).sum(-1) * sign
    return (((c > OPPOSITE) | (sign == 0)) & points.has[i]).any(-1)


# ---- measures

def owners(surface, points, faces, places_, same_piece):
    """For each place of a face the points near it in order of distance: numbers, distances; infinite where a point is of an opposite wall
    or, if asked, of another piece."""
    distance, near = cKDTree(points.x).query(places_, k=min(NEAREST, len(points)))
    ok = are_facing(surface, points, surface.normal[faces][:, None], surface.patch[faces][:, None], near)
    if same_piece:
        ok &= points.piece[near] == surface.piece[faces][:, None]
    distance = numpy.where(ok, distance, numpy.inf)
    return near, distance


def nearest_of_all(surface, points, faces, same_piece):
    """The same for few places, by all points: the nearest, and its distance over its spacing."""
    best, over = numpy.zeros(len(faces), int), numpy.full(len(faces), numpy.inf)
    every = numpy.arange(len(points))
    for k, f in enumerate(faces):
        ok = are_facing(surface, points, surface.normal[f][None], surface.patch[f][None], every[None])[0]
        if same_piece:
            ok &= points.piece == surface.piece[f]
        d = numpy.where(ok, numpy.linalg.norm(points.x - surface.middle[f], axis=1), numpy.inf)
        best[k] = d.argmin()
        over[k] = d.min() / points.h[best[k]]
    return best, over


def measure_places(surface, points):
    """coverage, missing_share"""
    tree = cKDTree(points.x)
    farthest = 0
    for corner in range(3):
        d, i = tree.query(surface.corners[:, corner])
        farthest = max(farthest, (d / points.h[i]).max())
    missing = 0
    for begin in range(0, len(surface.area), 200000):
        faces = numpy.arange(begin, min(begin + 200000, len(surface.area)))
        near, distance = owners(surface, points, faces, surface.middle[faces], False)
        least = (distance / points.h[near]).min(1)
        far = least > MISSING
        unknown = far & ~(distance < numpy.inf).any(1)
        if unknown.any():
            least[unknown] = nearest_of_all(surface, points, faces[unknown], False)[1]
        missing += surface.area[faces][least > MISSING].sum()
    return farthest, missing / surface.area.sum()


def neighbours(surface, points):
    """Pairs of cells that meet inside of triangles, by dividing each triangle that may lie in several cells."""
    steps = [(i, k) for i in range(PARTS + 1) for k in range(PARTS + 1 - i)]
    number = {s: n for n, s in enumerate(steps)}
    weights = numpy.array([(PARTS - i - k, i, k) for i, k in steps]) / PARTS
    links = numpy.array([(number[s], number[t]) for s in steps for t in ((s[0] + 1, s[1]), (s[0], s[1] + 1), (s[0] + 1, s[1] - 1))
                         if t in number])
    pairs = []
    for begin in range(0, len(surface.area), 20000):
        faces = numpy.arange(begin, min(begin + 20000, len(surface.area)))
        near, distance = owners(surface, points, faces, surface.middle[faces], True)
        order = numpy.argsort(distance, axis=1)[:, :8]
        near, distance = numpy.take_along_axis(near, order, 1), numpy.take_along_axis(distance, order, 1)
        radius = numpy.linalg.norm(surface.corners[faces] - surface.middle[faces][:, None], axis=2).max(1)
        several = (distance[:, 1] < distance[:, 0] + 2 * radius) if distance.shape[1] > 1 else numpy.zeros(len(faces), bool)
        at = numpy.einsum("wc,fcx->fwx", weights, surface.corners[faces[several]])
        away = ((at[:, :, None] - points.x[near[several]][:, None]) ** 2).sum(-1)
        away[numpy.broadcast_to(~numpy.isfinite(distance[several])[:, None], away.shape)] = numpy.inf
        own = numpy.take_along_axis(near[several], away.argmin(2), 1)
        a, b = own[:, links[:, 0]].ravel(), own[:, links[:, 1]].ravel()
        differ = a != b
        pairs.append(numpy.sort(numpy.stack([a[differ], b[differ]], 1), 1))
    found, count = numpy.unique(numpy.concatenate(pairs), axis=0, return_counts=True)
    return found[count >= LEAST_MEETINGS]


def ideal_range(surface, points):
    """The least and the most ideal degree of each point: 6, or of its angle where faces of a box cut the surface; 6 and more on a line."""
    angle = numpy.full(len(points), 2 * numpy.pi)
    border = numpy.zeros(len(points), bool)
    if surface.box is not None:
        for i in range(len(points)):
            n = points.normal[i, 0]
            inwards = []
            for axis in range(3):
                for end, way in ((0, 1), (1, -1)):
                    if abs(points.x[i, axis] - surface.box[end][axis]) < 1e-6 * points.h[i]:
                        d = way * numpy.eye(3)[axis]
                        d = d - (d @ n) * n
                        inwards.append(d / numpy.linalg.norm(d))
            if inwards:
                border[i] = True
                cosine = min(p @ q for p in inwards for q in inwards)
                angle[i] = numpy.pi - numpy.arccos(numpy.clip(cosine, -1, 1))
    ideal = angle / (numpy.pi / 3) + border
    least, most = numpy.floor(ideal + 0.2), numpy.ceil(ideal - 0.2)
    most[points.fork] = numpy.inf
    return least, most


def measure_pairs(surface, points):
    """min_spacing_ratio, close_share, coincident: all pairs within 1.5 spacings."""
    pair = cKDTree(points.x).query_pairs(1.5 * points.h.max(), output_type="ndarray")
    i, j = pair.T
    ok = points.piece[i] == points.piece[j]
    facing = numpy.zeros(len(i), bool)
    for k in range(points.normal.shape[1]):
        facing |= points.has[i, k] & are_facing(surface, points, points.normal[i, k], points.patch[i, k], j)
    ok &= facing
    d = numpy.linalg.norm(points.x[i] - points.x[j], axis=1) / (0.5 * (points.h[i] + points.h[j]))
    nearest = numpy.full(len(points), numpy.inf)
    numpy.minimum.at(nearest, i[ok], d[ok])
    numpy.minimum.at(nearest, j[ok], d[ok])
    return nearest.min(), (nearest < CLOSE).mean(), int((nearest < COINCIDENT).sum())


def measure(surface, points):
    coverage, missing = measure_places(surface, points)
    spacing, close, coincident = measure_pairs(surface, points)
    pair = neighbours(surface, points)
    degree = numpy.bincount(pair.ravel(), minlength=len(points))
    least, most = ideal_range(surface, points)
    empty = [p for p in numpy.unique(surface.piece) if not (points.piece == p).any()
             and surface.area[surface.piece == p].sum() > 3 ** 0.5 / 2 * numpy.median(points.h) ** 2]
    return {"coverage": coverage, "missing_share": missing, "close_share": close, "min_spacing_ratio": spacing,
            "coincident": coincident, "hex_fraction": ((degree >= least) & (degree <= most)).mean(),
            "parts_without_points": len(empty)}


# ---- jobs

def sphere(x):
    return numpy.linalg.norm(x, axis=1) - 1


def torus(x):
    return numpy.hypot(numpy.hypot(x[:, 0], x[:, 1]) - 1, x[:, 2]) - 0.3


def box(half, rounding):
    def f(x):
        q = abs(x) - (numpy.array(half) - rounding)
        return numpy.linalg.norm(numpy.maximum(q, 0), axis=1) + numpy.minimum(q.max(1), 0) - rounding
    return f


def gyroid(x):
    s, c = numpy.sin(2 * numpy.pi * x), numpy.cos(2 * numpy.pi * x)
    return s[:, 0] * c[:, 1] + s[:, 1] * c[:, 2] + s[:, 2] * c[:, 0]


def quartic(x):
    return (x ** 4).sum(1) - 10 * 0.13 ** 2 * (x ** 2).sum(1)


def formula(count, function, extent, solver=(), **shape):
    """A job on a formula around the origin, in a box of this extent to either side."""
    def make(folder, data, report_only=False):
        spec = {"surface": {"analytic": {"center": [0, 0, 0], **shape}}, "sampling": {"count": count}, "solver": dict(solver)}

        def surface(cell):
            low, high = -numpy.array(extent), numpy.array(extent)
            open_ = shape["shape"] == "gyroid"
            corners = march(function, low - (0 if open_ else cell), high + (0 if open_ else 1.37 * cell), cell)
            return Surface(corners, box=(low, high) if open_ else None, gradient=gradient_of(function, 1e-5))
        return spec, surface
    return make


def between_samples(corners, inside):
    """Triangles of pieces that no grid cell with samples on both sides has a part of: jobs sample what they cross."""
    shape = numpy.array(inside.shape) - 2
    cell = numpy.clip(numpy.floor(corners.mean(1)).astype(int), 0, shape)
    at = [inside[tuple((cell + s).T)] for s in numpy.ndindex(2, 2, 2)]
    crossed = numpy.any(at, axis=0) & ~numpy.all(at, axis=0)
    piece = pieces(corners)
    return ~numpy.isin(piece, piece[crossed])


def volume(count, name, isovalue):
    def make(folder, data):
        spec = {"surface": {"volume": {"path": name, "isovalue": isovalue}}, "sampling": {"count": count}}

        def surface(cell):
            path = data / name
            values, matrix = read_nifti(path) if ".nii" in name else read_nrrd(path)
            beyond = min(12, min(values.shape) - 1)  # data go on beyond their end by odd reflection
            spline = ndimage.spline_filter(numpy.pad(values - isovalue, beyond, mode="reflect", reflect_type="odd"), order=3)
            size = numpy.array(values.shape)
            voxel = numpy.linalg.norm(matrix[:3, :3], axis=0).min()

            def f(x):
                return ndimage.map_coordinates(spline, x.T + beyond, order=3, prefilter=False)
            corners = march(f, numpy.zeros(3), size - 1.0, min(cell / voxel, 0.4))  # no coarser than the data
            corners = corners[~between_samples(corners, values < isovalue)]
            made = corners @ matrix[:3, :3].T + matrix[:3, 3]
            if numpy.linalg.det(matrix[:3, :3]) < 0:
                made = made[:, ::-1]
            ends = numpy.stack([numpy.zeros(3), size - 1.0]) @ matrix[:3, :3].T + matrix[:3, 3]
            return Surface(made, box=(ends.min(0), ends.max(0)),
                           gradient=gradient_of(f, 1e-3, matrix[:3, :3], matrix[:3, 3]))
        return spec, surface
    return make


def nested(size):
    """A ball of label 2 in a ball of label 1: two pieces."""
    off = numpy.linalg.norm(places(size), axis=-1)
    return numpy.where(off < 0.25 * size, 2, numpy.where(off < 0.4 * size, 1, 0)).astype("u1")


def ball_of(centre, radius):
    return lambda x: radius - numpy.linalg.norm(x - centre, axis=1)  # from the outside, label 0, to the inside


def nested_surface(size, cell):
    middle = numpy.full(3, (size - 1) / 2)
    low, high = middle - 0.42 * size, middle + 0.42 * size
    outer, inner = (march(ball_of(middle, r * size), low, high, cell) for r in (0.4, 0.25))
    return Surface(numpy.concatenate([outer, inner]), numpy.repeat([0, 1], [len(outer), len(inner)]), numpy.array([[0, 1], [1, 2]]))


def balls_surface(shape, cell):
    """Three balls; discs part them."""
    middle = (shape.size - 1) / 2
    centres = shape.centres + middle
    low, high = numpy.zeros(3), numpy.full(3, shape.size - 1.0)
    parts, labels = [], []
    for k in range(3):
        t = march(ball_of(centres[k], shape.radius), low, high, cell)
        parts.append(t[owner_of(centres, t.mean(1)) == k])
        labels.append((0, k + 1))
    for a, b in ((0, 1), (0, 2), (1, 2)):
        p, q = centres[a], centres[b]
        t = march(lambda x: (x - (p + q) / 2) @ (q - p), low, high, cell)
        m = t.mean(1)
        third = 3 - a - b
        parts.append(t[(numpy.linalg.norm(m - p, axis=1) < shape.radius) &
                       (numpy.linalg.norm(m - centres[third], axis=1) > numpy.linalg.norm(m - p, axis=1))])
        labels.append((a + 1, b + 1))
    made = Surface(numpy.concatenate(parts), numpy.repeat(numpy.arange(6), [len(p) for p in parts]), numpy.array(labels))
    made.piece[:] = 0  # the interfaces meet in lines
    return made


def owner_of(centres, x):
    return numpy.linalg.norm(x[:, None] - centres, axis=2).argmin(1)


def segmentation(count, values, surface_of):
    def make(folder, data):
        write_nrrd(folder / "labels.nrrd", values())
        return {"surface": {"labels": {"path": str(folder / "labels.nrrd")}}, "sampling": {"count": count}}, surface_of
    return make


SIZE = 64
JOBS = {
    "sphere": formula(200, sphere, (1, 1, 1), shape="sphere", radius=1),
    "torus": formula(2000, torus, (1.3, 1.3, 0.3), shape="torus", axis=[0, 0, 1], major_radius=1, minor_radius=0.3),
    "thin box": formula(1000, box((1, 1, 0.05), 0.04), (1, 1, 0.05), shape="box", half_size=[1, 1, 0.05], rounding=0.04),
    "gyroid": formula(3000, gyroid, (1, 1, 1), shape="gyroid", period=1, size=[2, 2, 2]),
    "quartic": formula(10000, quartic, (0.5, 0.5, 0.5), shape="quartic", r=0.13),
    "torus after one sweep": formula(500, torus, (1.3, 1.3, 0.3), {"max_sweeps": 1}, shape="torus", axis=[0, 0, 1], major_radius=1,
                                minor_radius=0.3),
    "fmob-c4h.nrrd at 0.5": volume(1000, "fmob-c4h.nrrd", 0.5),
    "tooth.nhdr at 600": volume(3000, "tooth.nhdr", 600),
    "anatomical.nii at 9000": volume(500, "anatomical.nii", 9000),
    "quarter.nhdr at 800": volume(5000, "headsq/quarter.nhdr", 800),
    "three balls": segmentation(1500, lambda: Balls(SIZE, TURNED).labels, lambda cell: balls_surface(Balls(SIZE, TURNED), cell)),
    "three balls and few points": segmentation(200, lambda: Balls(SIZE, TURNED).labels,
                                            lambda cell: balls_surface(Balls(SIZE, TURNED), cell)),
    "nested balls": segmentation(2000, lambda: nested(SIZE), lambda cell: nested_surface(SIZE, cell)),
}


def run(worker, data, name, folder):
    spec, surface = JOBS[name](folder, data)
    spec = {"version": 1, **spec, "output": {"preview": False, "ply": {"precision": "double", "properties": ["all"]}}}
    spec["solver"] = {"threads": 1, **spec.get("solver", {})}
    (folder / "spec.json").write_text(json.dumps(spec))
    root = folder if "labels" in spec["surface"] else data or folder
    if "labels" in spec["surface"]:
        spec["surface"]["labels"]["path"] = "labels.nrrd"
        (folder / "spec.json").write_text(json.dumps(spec))
    done = subprocess.run([worker, "run", folder / "spec.json", "--output", folder / "out", "--input-root", root],
                          capture_output=True, text=True)
    if done.returncode not in (0, 10, 11):
        raise SystemExit(f"{name}: {done.stderr}")
    report = json.loads((folder / "out" / "report.json").read_text())
    count = report["points"]["count"] if "points" in report else spec["sampling"]["count"]
    h = numpy.sqrt(2 * report["surface"]["area"] / (3 ** 0.5 * count))
    cell = h / (8 if count <= 3000 else 5)
    on = surface(cell)
    points = Points(folder / "out" / "points.ply", on, cell)
    return report, measure(on, points), points, on.area.sum() / report["surface"]["area"]


def voxel_of(report):
    return numpy.min(report["surface"]["voxel_size"])


def told_of(report, name):
    value = report["quality"][name]
    return value["count"] if isinstance(value, dict) else value


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worker", required=True)
    parser.add_argument("--data", type=pathlib.Path)
    parser.add_argument("--output", type=pathlib.Path)
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    names = [n for n in JOBS if not given.only or n in given.only.split(",")]
    header = ["surface", "points", "outcome", "area_ratio", *(f"{name}_{of}" for name in ALLOWED for of in ("report", "program"))]
    lines = []
    apart = []
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            report, brute, points, area = run(given.worker, given.data, name, pathlib.Path(folder))
        cells, count = [], len(points)
        for measure_, allowed in ALLOWED.items():
            if measure_ == "coverage" and "volume" in report["surface"]:
                allowed = max(allowed, ALLOWED_VOXEL * voxel_of(report) / points.h.mean())
            allowed = ALLOWED_OF_FEW if measure_ == "hex_fraction" and count < FEW else allowed
            told, found = told_of(report, measure_), brute[measure_]
            far = not abs(told - found) <= allowed
            apart += [f"{name}: {measure_}"] if far else []
            cells += [f"{told:.4g}", f"{found:.4g}"]
        lines.append([name, count, report["outcome"], f"{area:.4f}", *cells])
        print(", ".join(f"{key} {value}" for key, value in zip(header, lines[-1])), flush=True)
    if given.output:
        results.write(given.output, header, lines)
    print("apart:", ", ".join(apart) or "none", f"({resource.getrusage(resource.RUSAGE_SELF).ru_utime:.0f} s)")
    return 1 if apart else 0


if __name__ == "__main__":
    sys.exit(main())
