# SPDX-License-Identifier: Apache-2.0
"""For the drivers: the arguments that each is given, a dense volume of distances, and the way back to its surface.

Arguments of every driver: PREFIX COUNT SPACING SEED OUTPUT; PREFIX.ply are triangles, PREFIX.nhdr and .raw the volume,
SPACING is that of an ideal hexagonal packing. OUTPUT is written as doubles, x y z of every point."""
import sys

import numpy
from scipy import ndimage


def arguments():
    prefix, count, spacing, seed, output = sys.argv[1:]
    return prefix, int(count), float(spacing), int(seed), output


def read_triangles(prefix):
    """Vertices and triangles."""
    with open(f"{prefix}.ply", "rb") as file:
        head, _, body = file.read().partition(b"end_header\n")
    words = [line.split() for line in head.decode("ascii").splitlines()]
    vertices, faces = (int(w[2]) for w in words if w[0] == "element")
    record = numpy.dtype([("count", "u1"), ("corner", "<i4", 3)])
    return (numpy.frombuffer(body, "<f8", 3 * vertices).reshape(-1, 3).copy(),
            numpy.frombuffer(body, record, faces, 24 * vertices)["corner"].copy())


def random_points(prefix, count, seed):
    """Uniform on the triangles."""
    vertices, triangles = read_triangles(prefix)
    corner = vertices[triangles]
    rng = numpy.random.default_rng(seed)
    area = numpy.linalg.norm(numpy.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    chosen = corner[rng.choice(len(area), count, p=area / area.sum())]
    u, v = rng.random((2, count, 1))
    flip = u + v > 1
    u, v = numpy.where(flip, 1 - u, u), numpy.where(flip, 1 - v, v)
    return chosen[:, 0] + u * (chosen[:, 1] - chosen[:, 0]) + v * (chosen[:, 2] - chosen[:, 0])


class Volume:
    def __init__(self, prefix):
        with open(f"{prefix}.nhdr", encoding="ascii") as file:
            head = dict(line.strip().split(": ", 1) for line in file if ": " in line)
        size = [int(n) for n in head["sizes"].split()]
        self.voxel = float(head["space directions"].split(")")[0].lstrip("(").split(",")[0])
        self.origin = numpy.array([float(v) for v in head["space origin"].strip("()").split(",")])
        self.values = numpy.fromfile(f"{prefix}.raw", "<f4").reshape(size, order="F")
        self.slopes = numpy.gradient(self.values, self.voxel)

    def project(self, places):
        """One Newton step onto the zero set."""
        index = ((places - self.origin) / self.voxel).T
        value, *slope = (ndimage.map_coordinates(v, index, order=1, mode="nearest")
                         for v in (self.values, *self.slopes))
        slope = numpy.array(slope)
        return places - (value / (slope * slope).sum(axis=0) * slope).T
