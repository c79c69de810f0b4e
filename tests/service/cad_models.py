# SPDX-License-Identifier: Apache-2.0
"""Models as a CAD program writes them: sharp edges, planes and arcs, exact to rounding."""
import numpy


class Solid:
    """Vertices and faces of a file. Faces are polygons, counter-clockwise seen from outside."""

    def __init__(self):
        self.vertices, self.faces, self.number = [], [], {}

    def vertex(self, *place):
        key = tuple(round(float(x), 12) for x in place)
        if key not in self.number:
            self.number[key] = len(self.vertices)
            self.vertices.append(key)
        return self.number[key]

    def face(self, places):
        self.faces.append([self.vertex(*p) for p in places])

    def prism(self, outline, low, high):
        """Of a simple polygon, counter-clockwise."""
        self.face([(x, y, low) for x, y in outline[::-1]])
        self.face([(x, y, high) for x, y in outline])
        for (x, y), (u, v) in zip(outline, numpy.roll(outline, -1, axis=0)):
            self.face([(x, y, low), (u, v, low), (u, v, high), (x, y, high)])

    def write(self, path):
        path.write_text("\n".join(["v %.15g %.15g %.15g" % v for v in self.vertices] +
                                  ["f " + " ".join(str(k + 1) for k in f) for f in self.faces]) + "\n")


def gear():
    """40 teeth."""
    solid, outline = Solid(), []
    for tooth in range(40):
        for part, radius in ((0, 0.9), (0.25, 0.9), (0.4, 1), (0.65, 1)):
            angle = 2 * numpy.pi * (tooth + part + 0.2) / 40
            outline.append((radius * numpy.cos(angle), radius * numpy.sin(angle)))
    solid.prism(numpy.array(outline), 0, 0.3)
    return solid


def bracket():
    """Two plates at a right angle, with a fillet inside and one outside."""
    arc = numpy.linspace(0, numpy.pi / 2, 13)
    inner = [(0.5 - 0.3 * numpy.sin(a), 0.5 - 0.3 * numpy.cos(a)) for a in arc]
    outer = [(0.4 - 0.4 * numpy.cos(a), 0.4 - 0.4 * numpy.sin(a)) for a in arc]
    solid = Solid()
    solid.prism(numpy.array(outer + [(1.5, 0), (1.5, 0.2)] + inner + [(0.2, 1.5), (0, 1.5)]), 0, 0.8)
    return solid


def tube(solid, start, end, radius, sides=24):
    """A closed cylinder."""
    start, end = numpy.array(start, float), numpy.array(end, float)
    along = (end - start) / numpy.linalg.norm(end - start)
    across = numpy.cross(along, (1, 0, 0) if abs(along[0]) < 0.9 else (0, 1, 0))
    across /= numpy.linalg.norm(across)
    other = numpy.cross(along, across)
    ring = [radius * (numpy.cos(a) * across + numpy.sin(a) * other) for a in 2 * numpy.pi * numpy.arange(sides) / sides]
    solid.face([start + r for r in ring[::-1]])
    solid.face([end + r for r in ring])
    for a, b in zip(ring, ring[1:] + ring[:1]):
        solid.face([start + a, start + b, end + b, end + a])


def chair():
    """Tubes that go into each other."""
    solid = Solid()
    for x in (0, 1):
        for y in (0, 1):
            tube(solid, (x, y, 0), (x, y, 2.2 if y else 1.03), 0.06)
        tube(solid, (x, 0, 1), (x, 1, 1), 0.05)
    for y, z in ((0, 1), (1, 1), (1, 1.5), (1, 2.1)):
        tube(solid, (0, y, z), (1, y, z), 0.05)
    return solid


def plate_with_holes(across=20, along=10):
    """A hole in the middle of each unit square."""
    solid, corners = Solid(), ((1, 1), (0, 1), (0, 0), (1, 0))
    ring = [(0.5 + 0.25 * numpy.cos(a), 0.5 + 0.25 * numpy.sin(a)) for a in 2 * numpy.pi * numpy.arange(16) / 16]
    for i in range(across):
        for j in range(along):
            at = [(i + x, j + y) for x, y in ring]
            for z, turn in ((0, -1), (0.5, 1)):
                for q, (x, y) in enumerate(corners):  # between a side of the square and a quarter of the circle
                    u, v = corners[(q + 1) % 4]
                    quarter = [at[(4 * q + k) % 16] for k in range(6, 1, -1)]
                    solid.face([(a, b, z) for a, b in ([(i + x, j + y), (i + u, j + v)] + quarter)[::turn]])
            for (x, y), (u, v) in zip(at, at[1:] + at[:1]):
                solid.face([(u, v, 0), (x, y, 0), (x, y, 0.5), (u, v, 0.5)])
    outline = [(k, 0) for k in range(across)] + [(across, k) for k in range(along)] + \
              [(across - k, along) for k in range(across)] + [(0, along - k) for k in range(along)]
    for (x, y), (u, v) in zip(outline, outline[1:] + outline[:1]):
        solid.face([(x, y, 0), (u, v, 0), (u, v, 0.5), (x, y, 0.5)])
    return solid


LETTERS = ("#..#.####.#...#..##..###.",
           "#..#.#.....#.#..#..#.#..#",
           "####.###....#...####.#..#",
           "#..#.#.....#.#..#..#.#..#",
           "#..#.####.#...#.#..#.###.")


def engraved_text():
    """Letters cut into a plate, with flat bottoms."""
    rows = ["." * 27, *("." + line + "." for line in LETTERS), "." * 27]
    depth = [[-0.5 if c == "#" else 0 for c in row] for row in rows[::-1]]
    height, width, bottom = len(depth), len(depth[0]), -2
    solid = Solid()
    for j in range(height):
        for i in range(width):
            z = depth[j][i]
            solid.face([(i, j, z), (i + 1, j, z), (i + 1, j + 1, z), (i, j + 1, z)])
            solid.face([(i, j, bottom), (i, j + 1, bottom), (i + 1, j + 1, bottom), (i + 1, j, bottom)])
            for di, dj, a, b in ((1, 0, (1, 0), (1, 1)), (0, 1, (1, 1), (0, 1)), (-1, 0, (0, 1), (0, 0)), (0, -1, (0, 0), (1, 0))):
                inside = 0 <= i + di < width and 0 <= j + dj < height
                low = depth[j + dj][i + di] if inside else bottom
                if low < z:
                    (x, y), (u, v) = (i + a[0], j + a[1]), (i + b[0], j + b[1])
                    solid.face([(x, y, low), (u, v, low), (u, v, z), (x, y, z)])
    return solid


def notched_sheet(width=0.07, notches=5):
    """A sheet without thickness: from one side narrow notches with round ends go in. No vertex of an end bends by a third of a
    right angle."""
    outline = []
    for k in range(notches):
        middle, depth = 1 + 2 * k, 2 + 0.23 * k
        outline += [(middle - width / 2, 0)]
        outline += [(middle - width / 2 * numpy.cos(a), depth + width / 2 * numpy.sin(a)) for a in numpy.linspace(0, numpy.pi, 8)]
        outline += [(middle + width / 2, 0)]
    solid = Solid()
    solid.face([(x, y, 0) for x, y in [(0, 0), *outline, (2 * notches, 0), (2 * notches, 5), (0, 5)]])
    return solid


def hooked_sheet(size=0.06, cuts=5):
    """A sheet without thickness: from one side cuts with nearly no width go in. At its end each turns right, and back to the left
    of where it turned."""
    outline = []
    for k in range(cuts):
        x, y, w = 1 + 2 * k, 2 + 0.23 * k, 0.05 * size
        outline += [(x - w, 0), (x - w, y), (x + 0.8 * size - 2 * w, y + 0.4 * size), (x - 0.4 * size, y + size),
                    (x + 0.8 * size + 2 * w, y + 0.4 * size), (x + w, y), (x + w, 0)]
    solid = Solid()
    solid.face([(x, y, 0) for x, y in [(0, 0), *outline, (2 * cuts, 0), (2 * cuts, 5), (0, 5)]])
    return solid


def crossed_sheet(length=6):
    """A sheet without thickness of three planes in a row; the first and the third pass through each other, at a right angle."""
    profile = [(0, 0), (2, 2), (2, 0), (0, 2)]
    solid = Solid()
    for (x, y), (u, v) in zip(profile, profile[1:]):
        solid.face([(x, y, 0), (u, v, 0), (u, v, length), (x, y, length)])
    return solid


SHEETS = {"notched_sheet": notched_sheet, "hooked_sheet": hooked_sheet}
MODELS = {"gear": gear, "bracket": bracket, "chair": chair, "plate_with_holes": plate_with_holes, "engraved_text": engraved_text}
