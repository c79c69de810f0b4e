# SPDX-License-Identifier: Apache-2.0
"""Thin and sharp solids as triangles, and the walls of points on them, computed with numpy from the positions alone; files of points."""
import numpy
from scipy.spatial import ConvexHull, cKDTree

OPPOSITE = -0.4  # largest cosine between normals of opposite walls (doc/report.md)


class Solid:
    """Vertices, and triangles that are counter-clockwise seen from outside."""

    def __init__(self, vertices, triangles):
        self.vertices, self.triangles = numpy.array(vertices, float), numpy.array(triangles)
        across = self.sides()
        self.area = numpy.linalg.norm(across, axis=1) / 2
        self.normals = across / (2 * self.area[:, None])

    def sides(self):
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        return numpy.cross(b - a, c - a)

    def rotated(self, random):
        turn, _ = numpy.linalg.qr(random.normal(size=(3, 3)))
        turn *= numpy.sign(numpy.linalg.det(turn))
        return Solid(self.vertices @ turn.T + random.uniform(-1, 1, 3), self.triangles)

    def spacing(self, count):
        return (2 * self.area.sum() / (3 ** 0.5 * count)) ** 0.5

    def write(self, path):
        path.write_text("".join("v %.17g %.17g %.17g\n" % tuple(v) for v in self.vertices) +
                        "".join("f %d %d %d\n" % tuple(t + 1) for t in self.triangles))
        return path

    def scatter(self, random, count):
        """(points, triangle of each), uniform in area."""
        of = random.choice(len(self.triangles), count, p=self.area / self.area.sum())
        weights = random.dirichlet((1, 1, 1), count)
        return (weights[:, :, None] * self.vertices[self.triangles[of]]).sum(axis=1), of

    def darts(self, random, distance, draws):
        """Points of which no two on walls that are not opposite are nearer than `distance`; and the triangle of each."""
        points, of = self.scatter(random, draws)
        kept = []
        for k in range(draws):
            near = [j for j in kept if numpy.linalg.norm(points[j] - points[k]) < distance]
            if all(self.normals[of[j]] @ self.normals[of[k]] <= OPPOSITE for j in near):
                kept.append(k)
        return points[kept], of[kept]

    def touching(self, points, tolerance=1e-7):
        """For each point the normals of the triangles that it lies on, edges included."""
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        size = numpy.ptp(self.vertices, axis=0).max() * tolerance
        frame = numpy.linalg.inv(numpy.stack([b - a, c - a, self.normals], axis=2))
        out = []
        for p in points:
            u, v, up = numpy.einsum("nij,nj->in", frame, p - a)
            heights = [numpy.linalg.norm(frame[:, k], axis=1) for k in (0, 1)]
            third = numpy.linalg.norm(frame[:, 0] + frame[:, 1], axis=1)
            on = (abs(up) < size) & (u > -size * heights[0]) & (v > -size * heights[1]) & (u + v < 1 + size * third)
            out.append(self.normals[on])
        return out

    def least_distance(self, points, spacing, kept):
        """Least distance over the mean spacing of two points that are not on opposite walls and not both kept."""
        walls, least = self.touching(points), numpy.inf
        for i, j in cKDTree(points).query_pairs(1.5 * spacing.max()):
            if (kept[i] and kept[j]) or (walls[i] @ walls[j].T).max() <= OPPOSITE:
                continue
            least = min(least, 2 * numpy.linalg.norm(points[i] - points[j]) / (spacing[i] + spacing[j]))
        return least


def write_points(path, points, kind="double"):
    """As PLY, of doubles or floats."""
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property {kind} {axis}\n" for axis in "xyz") + "end_header\n"
    path.write_bytes(head.encode() + points.astype({"double": "<f8", "float": "<f4"}[kind]).tobytes())
    return path


def hull(points):
    """The convex hull of points."""
    points = numpy.array(points, float)
    made, middle = ConvexHull(points), points.mean(axis=0)
    triangles = [t if numpy.cross(points[t[1]] - points[t[0]], points[t[2]] - points[t[0]]) @ (points[t[0]] - middle) > 0 else t[::-1]
                 for t in made.simplices]
    return Solid(points, triangles)


def plate(width, thickness):
    return hull([(x, y, z) for x in (0, 1) for y in (0, width) for z in (0, thickness)])


def ball(radius, splits):
    """An icosahedron, subdivided."""
    g = (1 + 5 ** 0.5) / 2
    made = hull([p for a in (-1, 1) for b in (-g, g) for p in ((0, a, b), (a, b, 0), (b, 0, a))])
    for _ in range(splits):
        middles = [(made.vertices[t[k]] + made.vertices[t[(k + 1) % 3]]) / 2 for t in made.triangles for k in range(3)]
        all_of = numpy.unique(numpy.round(numpy.concatenate([made.vertices, middles]), 9), axis=0)
        made = hull(all_of / numpy.linalg.norm(all_of, axis=1)[:, None])
    return Solid(made.vertices * radius, made.triangles)


def shell(thickness, splits=3):
    outer = ball(1, splits)
    inner = outer.vertices * (1 - thickness)
    return Solid(numpy.concatenate([outer.vertices, inner]),
                 numpy.concatenate([outer.triangles, outer.triangles[:, ::-1] + len(inner)]))


def prism(degrees, length=1.3):
    """An edge of this interior angle, two of half the angle that remains to 180 degrees, and six right ones."""
    a = numpy.radians(degrees)
    outline = [(0, 0), (1, 0), (numpy.cos(a), numpy.sin(a))]
    return hull([(x, y, z) for x, y in outline for z in (0, length)])


def drum(sides, height=0.4):
    """A cylinder with a groove: sharp rims, and smooth or flat sides."""
    turn = numpy.arange(sides) * 2 * numpy.pi / sides
    levels = [(1, 0), (1, height / 3), (0.8, height / 2), (1, height)]
    vertices = [(r * numpy.cos(t), r * numpy.sin(t), z) for r, z in levels for t in turn] + [(0, 0, 0), (0, 0, height)]
    triangles = []
    for k in range(sides):
        m = (k + 1) % sides
        for n in range(len(levels) - 1):
            low, high = n * sides, (n + 1) * sides
            triangles += [(low + k, low + m, high + m), (low + k, high + m, high + k)]
        top = (len(levels) - 1) * sides
        triangles += [(m, k, len(vertices) - 2), (top + k, top + m, len(vertices) - 1)]
    return Solid(vertices, triangles)


def twice(solid):
    """Each triangle in both orientations, as two-sided faces are written."""
    return Solid(solid.vertices, numpy.concatenate([solid.triangles, solid.triangles[:, ::-1]]))
