# SPDX-License-Identifier: Apache-2.0
"""Triangle meshes for the measuring programs: OBJ, OFF, STL and PLY by their definitions, and what is asked of
them: parts, areas, creases, the nearest place. Shares no code with the sampler."""
import re
import struct

import numpy
from scipy.sparse import coo_matrix, csgraph
from scipy.spatial import cKDTree

# Triangles whose centres are the nearest, that the nearest place is looked for on.
CANDIDATES = 16
# Places that are asked whether another part hides them, and how many at a time.
PLACES, PLACES_AT_ONCE = 100000, 2000


class Mesh:
    def __init__(self, vertices, triangles):
        """Vertices at the same place become one, whatever the file says, and triangles that stand there twice."""
        self.vertices, same = numpy.unique(numpy.asarray(vertices, float), axis=0, return_inverse=True)
        triangles = same.reshape(-1)[numpy.asarray(triangles, int)]
        a, b, c = triangles.T
        triangles = triangles[(a != b) & (b != c) & (c != a)]
        once = numpy.unique(numpy.sort(triangles, axis=1), axis=0, return_index=True)[1]
        self.triangles = triangles[numpy.sort(once)]
        corner = self.vertices[self.triangles]
        across = numpy.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        twice = numpy.linalg.norm(across, axis=1)
        self.areas = 0.5 * twice
        self.normals = across / numpy.maximum(twice, 1e-300)[:, None]

    @property
    def area(self):
        return float(self.areas.sum())

    def parts(self):
        """The part of every triangle, from 0."""
        i, j = self.triangles[:, [0, 1]].ravel(), self.triangles[:, [1, 2]].ravel()
        n = len(self.vertices)
        part = csgraph.connected_components(coo_matrix((numpy.ones(len(i)), (i, j)), (n, n)), directed=False)[1]
        return numpy.unique(part[self.triangles[:, 0]], return_inverse=True)[1]

    def seen(self):
        """Of every triangle the area that lies inside no other part, and what is one component of the surface that is
        seen: of every triangle, from 0; parts that run into each other are one."""
        part = self.parts()
        corner = self.vertices[self.triangles]
        place, owner, weight = self._places()
        hidden = numpy.zeros(len(place), bool)
        meet = [numpy.zeros((0, 2), int)]
        for other in range(part.max() + 1):
            low, high = corner[part == other].min(axis=(0, 1)), corner[part == other].max(axis=(0, 1))
            asked = numpy.flatnonzero((part[owner] != other) & ((place > low) & (place < high)).all(axis=1))
            for some in numpy.array_split(asked, 1 + len(asked) // PLACES_AT_ONCE):
                inside = some[numpy.abs(solid_angles(place[some], corner[part == other])) > 2 * numpy.pi]
                hidden[inside] = True
                meet.append(numpy.stack([part[owner[inside]], numpy.full(len(inside), other)], axis=1))
        i, j = numpy.concatenate(meet).T
        n = part.max() + 1
        component = csgraph.connected_components(coo_matrix((numpy.ones(len(i)), (i, j)), (n, n)), directed=False)[1]
        return numpy.bincount(owner[~hidden], weight[~hidden], len(self.areas)), component[part]

    def _places(self):
        """Places spread evenly over the triangles, whose each is on, and the area that each stands for."""
        corner = self.vertices[self.triangles]
        steps = numpy.maximum(1, numpy.ceil(numpy.sqrt(PLACES * self.areas / self.area))).astype(int)
        places, owners = [], []
        for m in numpy.unique(steps):
            i, j = (g.ravel() for g in numpy.meshgrid(numpy.arange(m), numpy.arange(m)))
            up, down = i + j < m, i + j < m - 1  # the small triangles that stand upright, and those between
            u = numpy.concatenate([i[up] + 1 / 3, i[down] + 2 / 3]) / m
            v = numpy.concatenate([j[up] + 1 / 3, j[down] + 2 / 3]) / m
            some = numpy.flatnonzero(steps == m)
            c = corner[some][:, None]
            places.append((c[:, :, 0] + u[:, None] * (c[:, :, 1] - c[:, :, 0]) +
                           v[:, None] * (c[:, :, 2] - c[:, :, 0])).reshape(-1, 3))
            owners.append(numpy.repeat(some, len(u)))
        owner = numpy.concatenate(owners)
        return numpy.concatenate(places), owner, (self.areas / steps ** 2)[owner]

    def creases(self, cosine, step):
        """Points at most `step` apart on the edges where the normals' cosine is below `cosine`."""
        edge = numpy.sort(self.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        owner = numpy.repeat(numpy.arange(len(self.triangles)), 3)
        order = numpy.lexsort((edge[:, 1], edge[:, 0]))
        edge, owner = edge[order], owner[order]
        pair = numpy.flatnonzero((edge[1:] == edge[:-1]).all(axis=1))
        sharp = pair[(self.normals[owner[pair]] * self.normals[owner[pair + 1]]).sum(axis=1) < cosine]
        points = []
        for a, b in self.vertices[edge[sharp]]:
            count = 1 + int(numpy.ceil(numpy.linalg.norm(b - a) / step))
            points.append(a + (b - a) * numpy.linspace(0, 1, count + 1)[:, None])
        return numpy.concatenate(points) if points else numpy.zeros((0, 3))

    def nearest(self, points):
        """Of every point: the distance to the mesh, and the triangle that is nearest."""
        fine, owner = self._dense()
        tree = cKDTree(fine)
        best = numpy.full(len(points), numpy.inf)
        which = numpy.zeros(len(points), int)
        near = owner[tree.query(points, CANDIDATES)[1]]
        for k in range(near.shape[1]):
            d = distance_to_triangles(points, self.vertices[self.triangles[near[:, k]]])
            better = d < best
            best[better], which[better] = d[better], near[better, k]
        return best, which

    def farthest(self, points, scale):
        """The largest distance of a point from the mesh, over its scale. `nearest` may miss a sliver: the farthest are held
        against all triangles."""
        away, most = self.nearest(points)[0] / scale, 0.0
        corner = self.vertices[self.triangles]
        low, high = corner.min(axis=1), corner.max(axis=1)
        for i in numpy.argsort(-away):
            if away[i] <= most:
                break
            beside = numpy.linalg.norm(numpy.maximum(numpy.maximum(low - points[i], points[i] - high), 0), axis=1)
            near = corner[beside <= away[i] * scale[i]]
            most = max(most, distance_to_triangles(numpy.repeat(points[i:i + 1], len(near), axis=0), near).min() / scale[i])
        return float(most)

    def _dense(self):
        """Places on the triangles, so many on each that the nearest place is on the nearest triangle's or on
        one beside it."""
        step = 0.5 * numpy.sqrt(self.area / max(len(self.triangles), 20000))
        corner = self.vertices[self.triangles]
        longest = numpy.linalg.norm(corner - numpy.roll(corner, 1, axis=1), axis=2).max(axis=1)
        parts = numpy.ceil(longest / (4 * step)).astype(int)
        places, owners = [], []
        for m in numpy.unique(parts):
            u, v = (g.ravel() for g in numpy.meshgrid((numpy.arange(m) + 1 / 3) / m, (numpy.arange(m) + 1 / 3) / m))
            u, v = u[u + v < 1], v[u + v < 1]
            some = numpy.flatnonzero(parts == m)
            c = corner[some][:, None]
            places.append((c[:, :, 0] + u[:, None] * (c[:, :, 1] - c[:, :, 0]) +
                           v[:, None] * (c[:, :, 2] - c[:, :, 0])).reshape(-1, 3))
            owners.append(numpy.repeat(some, len(u)))
        return numpy.concatenate(places), numpy.concatenate(owners)


def places(mesh, count):
    """Evenly spread over a mesh, with the normals of their triangles."""
    random = numpy.random.default_rng(1)
    which = numpy.searchsorted(numpy.cumsum(mesh.areas), (numpy.arange(count) + 0.5) / count * mesh.area)
    u, v = random.random((2, count))
    u, v = numpy.where(u + v > 1, 1 - u, u), numpy.where(u + v > 1, 1 - v, v)
    a, b, c = (mesh.vertices[mesh.triangles[which, k]] for k in range(3))
    return a + u[:, None] * (b - a) + v[:, None] * (c - a), mesh.normals[which]


def solid_angles(points, corners):
    """Under which every point sees the triangles (n, 3, 3), summed with their signs: 4 pi inside a closed mesh (Van
    Oosterom and Strackee 1983)."""
    a, b, c = (corners[None, :, k] - points[:, None] for k in range(3))
    p, q, r = (numpy.linalg.norm(v, axis=2) for v in (a, b, c))
    volume = (a * numpy.cross(b, c)).sum(axis=2)
    other = p * q * r + (a * b).sum(axis=2) * r + (b * c).sum(axis=2) * p + (c * a).sum(axis=2) * q
    return 2 * numpy.arctan2(volume, other).sum(axis=1)


def distance_to_triangles(points, corners):
    """Of each point to its own triangle, corners (n, 3, 3)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = numpy.cross(b - a, c - a)
    squared = numpy.maximum((normal * normal).sum(axis=1), 1e-300)
    inside = numpy.ones(len(points), bool)
    best = numpy.full(len(points), numpy.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        edge, r = q - p, points - p
        inside &= (numpy.cross(edge, r) * normal).sum(axis=1) >= 0
        t = numpy.clip((r * edge).sum(axis=1) / numpy.maximum((edge * edge).sum(axis=1), 1e-300), 0, 1)
        best = numpy.minimum(best, numpy.linalg.norm(r - t[:, None] * edge, axis=1))
    plane = numpy.abs(((points - a) * normal).sum(axis=1)) / numpy.sqrt(squared)
    return numpy.where(inside, plane, best)


def read(path):
    kind = str(path).rsplit(".", 1)[-1].lower()
    with open(path, "rb") as file:
        data = file.read()
    return {"obj": _read_obj, "off": _read_off, "stl": _read_stl, "ply": _read_ply}[kind](data)


def _fans(polygons):
    return [(p[0], p[k], p[k + 1]) for p in polygons for k in range(1, len(p) - 1)]


def _ears(vertices, polygon):
    """Triangles of a polygon of any shape, nearly in a plane, by clipping of ears; a fan of what has none."""
    at = {k: numpy.array(vertices[k], float) for k in polygon}
    normal = sum(numpy.cross(at[a] - at[polygon[0]], at[b] - at[polygon[0]]) for a, b in zip(polygon, polygon[1:]))

    def turn(a, b, c):
        return numpy.cross(at[b] - at[a], at[c] - at[a]) @ normal
    found, polygon = [], list(polygon)
    while len(polygon) > 3:
        for k in range(len(polygon)):
            a, b, c = polygon[k - 1], polygon[k], polygon[(k + 1) % len(polygon)]
            others = [p for p in polygon if p not in (a, b, c)]
            if turn(a, b, c) > 0 and not any(min(turn(a, b, p), turn(b, c, p), turn(c, a, p)) >= 0 for p in others):
                break
        else:
            return found + _fans([polygon])
        found.append((a, b, c))
        polygon.pop(k)
    return [*found, tuple(polygon)]


def _from_cut(vertices, polygon):
    """A quad from a corner of the diagonal that cuts it: the one at a reflex corner, else the shorter one; of equal ones that of the
    corner which comes first in space."""
    if len(polygon) != 4:
        return polygon
    at = numpy.array([vertices[k] for k in polygon])
    before, across, after = ((way := numpy.roll(at, -k, axis=0) - at) / numpy.maximum(numpy.linalg.norm(way, axis=1), 1e-300)[:, None]
                             for k in (3, 2, 1))
    angles = [numpy.arccos(numpy.clip((side * across).sum(axis=1), -1, 1)) for side in (before, after)]
    hollow = numpy.flatnonzero(angles[0] + angles[1] > numpy.pi)
    lengths = [((at[k + 2] - at[k]) ** 2).sum() for k in (0, 1)]
    if len(hollow):
        first = hollow[0]
    elif abs(lengths[1] - lengths[0]) <= 1e-6 * max(lengths):
        first = min(range(4), key=lambda k: tuple(at[k]))
    else:
        first = int(lengths[1] < lengths[0])
    return polygon[first:] + polygon[:first]


def _read_obj(data):
    vertices, polygons = [], []
    for line in data.decode("latin-1").splitlines():
        words = line.split("#")[0].split()
        if words[:1] == ["v"]:
            vertices.append([float(w) for w in words[1:4]])
        elif words[:1] == ["f"]:
            at = [int(w.split("/")[0]) for w in words[1:]]
            polygons.append([k - 1 if k > 0 else len(vertices) + k for k in at])
    return Mesh(vertices, [t for p in polygons for t in (_ears(vertices, p) if len(p) > 4 else _fans([_from_cut(vertices, p)]))])


def _read_off(data):
    words = iter(data.decode("ascii").split())
    assert next(words) == "OFF"
    counts = [int(next(words)) for _ in range(3)]
    vertices = [[float(next(words)) for _ in range(3)] for _ in range(counts[0])]
    return Mesh(vertices, _fans([[int(next(words)) for _ in range(int(next(words)))] for _ in range(counts[1])]))


def _read_stl(data):
    if len(data) < 84 or len(data) != 84 + 50 * struct.unpack("<I", data[80:84])[0]:
        corners = [line.split()[1:4] for line in data.decode("latin-1").splitlines() if line.split()[:1] == ["vertex"]]
        return Mesh(numpy.array(corners, float), numpy.arange(len(corners)).reshape(-1, 3))
    record = numpy.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("more", "<u2")])
    corners = numpy.frombuffer(data, record, -1, 84)["corner"].astype(float).reshape(-1, 3)
    return Mesh(corners, numpy.arange(len(corners)).reshape(-1, 3))


def _read_ply(data):
    head, _, body = re.split(rb"(end_header[ \r]*\n)", data, maxsplit=1)
    words = [line.split() for line in head.decode("ascii").splitlines()]
    count = {w[1]: int(w[2]) for w in words if w[:1] == ["element"]}
    if b"format ascii" not in head:
        return _read_binary_ply(words, count, body)
    lines = [line.split() for line in body.decode("ascii").splitlines() if line.strip()]
    vertices = [[float(w) for w in line[:3]] for line in lines[:count["vertex"]]]
    faces = lines[count["vertex"]:count["vertex"] + count["face"]]
    return Mesh(vertices, _fans([[int(w) for w in line[1:1 + int(line[0])]] for line in faces]))


def _read_binary_ply(words, count, body):
    assert ["format", "binary_little_endian", "1.0"] in words, "of binary PLY only little-endian is read here"
    kinds = {"float": "<f4", "float32": "<f4", "double": "<f8", "uchar": "u1", "uint8": "u1", "int": "<i4"}
    members = {"vertex": [], "face": []}
    for w in words:
        element = w[1] if w[0] == "element" else element if w[0] == "property" else ""
        if w[0] == "property":
            members[element] += [("n", "u1"), ("corner", "<i4", 3)] if w[1] == "list" else [(w[2], kinds[w[1]])]
    points = numpy.frombuffer(body, members["vertex"], count["vertex"])
    faces = numpy.frombuffer(body, members["face"], count["face"], points.nbytes)
    assert (faces["n"] == 3).all(), "of binary PLY only triangles are read here"
    return Mesh(numpy.stack([points[axis] for axis in "xyz"], axis=1), faces["corner"])
