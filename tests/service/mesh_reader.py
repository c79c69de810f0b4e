# SPDX-License-Identifier: Apache-2.0
"""Triangle meshes by an independent reader of OBJ, OFF, STL and PLY, and the distances of points from them. It shares no
code with hexad, and takes files in good order only."""
import numpy
import scipy.sparse
from scipy.spatial import cKDTree


def _fan(corners, first=0):
    turned = corners[first:] + corners[:first]
    return [[turned[0], turned[k], turned[k + 1]] for k in range(1, len(turned) - 1)]


def _cut(vertices, corners):
    """A quadrangle along the shorter of its diagonals that lie inside; of equal ones that of the corner which comes first in space."""
    if len(corners) != 4:
        return _fan(corners)
    at = numpy.array([vertices[k] for k in corners], float)
    normal = numpy.cross(at[2] - at[0], at[3] - at[1])

    def is_inside(first):
        a, b, c, d = numpy.roll(at, -first, axis=0)
        return min(numpy.cross(b - a, c - a) @ normal, numpy.cross(c - a, d - a) @ normal) > 0
    lengths = [((at[k + 2] - at[k]) ** 2).sum() for k in (0, 1)]
    if is_inside(0) != is_inside(1):
        return _fan(corners, int(is_inside(1)))
    if abs(lengths[1] - lengths[0]) <= 1e-6 * max(lengths):
        return _fan(corners, min(range(4), key=lambda k: tuple(at[k])) % 2)
    return _fan(corners, int(lengths[1] < lengths[0]))


def _read_obj(data):
    vertices, faces = [], []
    for line in data.decode("latin-1").splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(x) for x in words[1:4]])
        elif words[:1] == ["f"]:
            faces.append([int(w.split("/")[0]) - 1 for w in words[1:]])
    return vertices, [triangle for face in faces for triangle in _cut(vertices, face)]


def _read_off(data):
    words = [w for line in data.decode("latin-1").splitlines() for w in line.split("#")[0].split()]
    count, polygons, at = int(words[1]), int(words[2]), 4
    vertices = numpy.array(words[at:at + 3 * count], float).reshape(-1, 3)
    at, faces = at + 3 * count, []
    for _ in range(polygons):
        n = int(words[at])
        faces += _cut(vertices, [int(w) for w in words[at + 1:at + 1 + n]])
        at += 1 + n
    return vertices, faces


def _read_stl(data):
    if data.startswith(b"solid") and b"facet" in data[:400]:
        words = data.split()
        vertices = [[float(x) for x in words[k + 1:k + 4]] for k, w in enumerate(words) if w == b"vertex"]
        return vertices, numpy.arange(len(vertices)).reshape(-1, 3)
    count = int.from_bytes(data[80:84], "little")
    table = numpy.frombuffer(data, [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")], count, 84)
    return table["v"].reshape(-1, 3), numpy.arange(3 * count).reshape(-1, 3)


def _read_ply(data):
    head, _, rest = data.partition(b"end_header")
    body = rest[rest.index(b"\n") + 1:]
    lines = [line.split() for line in head.decode().splitlines()]
    order = ">" if ["format", "binary_big_endian", "1.0"] in lines else "<"
    size = {w[1]: int(w[2]) for w in lines if w[0] == "element"}
    if ["format", "ascii", "1.0"] in lines:
        rows = [[float(x) for x in row.split()] for row in body.decode().splitlines()]
        faces = rows[size["vertex"]:size["vertex"] + size["face"]]
        vertices = [row[:3] for row in rows[:size["vertex"]]]
        return vertices, [f for row in faces for f in _cut(vertices, [int(x) for x in row[1:]])]
    kinds = {"float": "f4", "float32": "f4", "double": "f8", "uchar": "u1", "uint8": "u1", "int": "i4"}
    properties = {}
    for words in lines:
        if words[0] == "element":
            element = properties[words[1]] = []
        elif words[0] == "property":
            of_list = words[1] == "list"  # of triangles, every one of them
            element += [("n", "u1"), ("i", order + "i4", 3)] if of_list else [(words[2], order + kinds[words[1]])]
    vertices = numpy.frombuffer(body, properties["vertex"], size["vertex"])
    faces = numpy.frombuffer(body, properties["face"], size["face"], vertices.nbytes)
    assert (faces["n"] == 3).all()
    return numpy.stack([vertices["x"], vertices["y"], vertices["z"]], axis=1), faces["i"]


class Mesh:
    """Vertices that are equal are one; triangles without area are left out, and those that stand twice count once."""

    def __init__(self, path):
        read = {".obj": _read_obj, ".off": _read_off, ".stl": _read_stl, ".ply": _read_ply}[path.suffix.lower()]
        vertices, faces = read(path.read_bytes())
        vertices, faces = numpy.array(vertices, float), numpy.array(faces, int)
        self.vertices, one = numpy.unique(vertices.astype(numpy.float32).astype(float), axis=0, return_inverse=True)
        faces = one.ravel()[faces]
        faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
        self.faces = faces[numpy.unique(numpy.sort(faces, axis=1), axis=0, return_index=True)[1]]
        self.a, self.b, self.c = (self.vertices[self.faces[:, k]] for k in range(3))
        across = numpy.cross(self.b - self.a, self.c - self.a)
        length = numpy.linalg.norm(across, axis=1)
        self.areas = 0.5 * length
        self.normals = across / numpy.maximum(length, 1e-300)[:, None]
        self.volume = (self.a * numpy.cross(self.b, self.c)).sum() / 6
        self.longest = (self.vertices.max(axis=0) - self.vertices.min(axis=0)).max()
        edges = numpy.concatenate([self.faces[:, :2], self.faces[:, 1:]])
        graph = scipy.sparse.coo_matrix((numpy.ones(len(edges)), edges.T), shape=(len(self.vertices),) * 2)
        count, labels = scipy.sparse.csgraph.connected_components(graph, directed=False)
        self.component_count, self.components = count, labels[self.faces[:, 0]]

    def _clouds(self, count, random):
        """Random points of the surface, by area, and their triangles."""
        chosen = random.choice(len(self.faces), count, p=self.areas / self.areas.sum())
        u, v = random.random(count), random.random(count)
        fold = u + v > 1
        u[fold], v[fold] = 1 - u[fold], 1 - v[fold]
        a = self.a[chosen]
        return a + u[:, None] * (self.b[chosen] - a) + v[:, None] * (self.c[chosen] - a), chosen

    def nearest(self, points, count=300000, candidates=12):
        """Distance of each point from the mesh, and the triangle that is nearest. The triangles tried are those of the
        random points next to it, so that the distance may be too large where it matters, never too small."""
        cloud, chosen = self._clouds(count, numpy.random.default_rng(1))
        _, near = cKDTree(cloud).query(points, k=candidates)
        best, which = numpy.full(len(points), numpy.inf), numpy.zeros(len(points), int)
        for k in range(candidates):
            t = chosen[near[:, k]]
            d = _distances(points, self.a[t], self.b[t], self.c[t])
            closer = d < best
            best[closer], which[closer] = d[closer], t[closer]
        return best, which

    def distance(self, points):
        """Exact distance of each point from the mesh: those that seem off it are held against all triangles whose bounding
        sphere is as near as the nearest triangle found."""
        far, _ = self.nearest(points)
        middle = (self.a + self.b + self.c) / 3
        reach = numpy.sqrt(numpy.max([((corner - middle) ** 2).sum(axis=1) for corner in (self.a, self.b, self.c)], axis=0))
        for k in numpy.flatnonzero(far > 1e-7 * self.longest):
            away = middle - points[k]
            near = numpy.einsum("ij,ij->i", away, away) <= (reach + far[k]) ** 2 * (1 + 1e-9)
            a, b, c = self.a[near], self.b[near], self.c[near]
            far[k] = _distances(numpy.broadcast_to(points[k], a.shape), a, b, c).min()
        return far


def _distances(p, a, b, c):
    """Exact distances from triangles: the foot in the plane where it is within, else the nearest edge."""
    def dot(x, y):
        return (x * y).sum(axis=1)

    def edge(a, b):
        way = b - a
        s = numpy.clip(dot(p - a, way) / numpy.maximum(dot(way, way), 1e-300), 0, 1)
        return numpy.linalg.norm(p - a - s[:, None] * way, axis=1)

    normal = numpy.cross(b - a, c - a)
    square = numpy.maximum(dot(normal, normal), 1e-300)
    weights = [dot(numpy.cross(y - x, p - x), normal) for x, y in ((a, b), (b, c), (c, a))]
    within = numpy.all([w >= 0 for w in weights], axis=0)
    height = numpy.abs(dot(p - a, normal)) / numpy.sqrt(square)
    edges = numpy.minimum(numpy.minimum(edge(a, b), edge(b, c)), edge(c, a))
    return numpy.where(within, height, edges)
