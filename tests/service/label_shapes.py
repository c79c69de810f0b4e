# SPDX-License-Identifier: Apache-2.0
"""Segmentations of known shapes: what each voxel belongs to by the place of its centre, and where the interfaces truly are."""
import numpy

# 30 degrees about (1, 1, 1).
_axis = numpy.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]]) / numpy.sqrt(3)
TURNED = numpy.eye(3) + numpy.sin(numpy.pi / 6) * _axis + (1 - numpy.cos(numpy.pi / 6)) * _axis @ _axis
PLAIN = numpy.eye(3)


def places(size):
    """The centres of the voxels of a cube, from its middle."""
    return numpy.stack(numpy.meshgrid(*3 * [numpy.arange(size) - (size - 1) / 2], indexing="ij"), -1)


class Sectors:
    """Three sectors of 120 degrees that meet in a line, the labels 1 to 3."""
    def __init__(self, size, turn=PLAIN):
        self.size, self.turn = size, turn
        x = places(size) @ turn
        angle = numpy.arctan2(x[..., 1], x[..., 0]) + numpy.pi
        self.labels = (1 + numpy.minimum(angle // (2 * numpy.pi / 3), 2)).astype("u1")

    def off_interface(self, x, pair):
        """Distances from the interface of two labels, in voxels, along its normal from the first to the second."""
        angle = {(1, 2): -numpy.pi / 3, (2, 3): numpy.pi / 3, (1, 3): numpy.pi}[pair]
        normal = numpy.array([-numpy.sin(angle), numpy.cos(angle), 0]) * (-1 if pair == (1, 3) else 1)
        return (x - (self.size - 1) / 2) @ self.turn @ normal

    def off_lines(self, x):
        return numpy.linalg.norm(((x - (self.size - 1) / 2) @ self.turn)[:, :2], axis=1)


class Balls:
    """Three balls, the labels 1 to 3, in a box of label 0: where two would overlap a disc parts them, and the three meet in
    a line."""
    def __init__(self, size, turn=PLAIN):
        self.size = size
        self.radius, self.apart = 0.22 * size, 0.32 * size
        angles = numpy.radians([90, 210, 330])
        self.centres = self.apart / 3 ** 0.5 * numpy.stack(
            [numpy.cos(angles), numpy.sin(angles), 0 * angles], axis=1) @ turn.T
        self.axis = turn[:, 2]
        off = numpy.stack([numpy.linalg.norm(places(size) - c, axis=-1) for c in self.centres])
        self.labels = numpy.where(off.min(0) <= self.radius, off.argmin(0) + 1, 0).astype("u1")

    def _from_middle(self, x):
        return x - (self.size - 1) / 2

    def off_interface(self, x, pair):
        x, (a, b) = self._from_middle(x), pair
        if a == 0:
            return self.radius - numpy.linalg.norm(x - self.centres[b - 1], axis=1)
        p, q = self.centres[a - 1], self.centres[b - 1]
        return (x - (p + q) / 2) @ (q - p) / self.apart

    def off_lines(self, x):
        x = self._from_middle(x)
        best = numpy.linalg.norm(numpy.cross(x, self.axis), axis=1)
        for k in range(3):
            p, q = self.centres[k], self.centres[(k + 1) % 3]
            up = (x - (p + q) / 2) @ (q - p) / self.apart
            across = numpy.linalg.norm(x - (p + q) / 2 - up[:, None] * (q - p) / self.apart, axis=1)
            best = numpy.minimum(best, numpy.hypot(up, across - (self.radius ** 2 - self.apart ** 2 / 4) ** 0.5))
        return best

    def areas(self):
        """Of each pair of labels."""
        r, d = self.radius, self.apart
        disc, inner = (r * r - d * d / 4) ** 0.5, d / 2 / 3 ** 0.5
        parting = numpy.pi * disc ** 2 - (disc ** 2 * numpy.arccos(inner / disc) - inner * (disc ** 2 - inner ** 2) ** 0.5)
        # of a ball what neither plane cuts off, slice by slice along the axis
        z = (numpy.arange(20000) + 0.5) / 10000 - 1
        share = d / 2 / r / numpy.sqrt(1 - z * z)
        half = numpy.where(share < 1, numpy.arccos(numpy.minimum(share, 1)), 0)
        arcs = 2 * numpy.pi - numpy.where(half > numpy.pi / 6, 2 * half + numpy.pi / 3, 4 * half)
        outer = r * r * arcs.sum() * (z[1] - z[0])
        return {(0, 1): outer, (0, 2): outer, (0, 3): outer, (1, 2): parting, (1, 3): parting, (2, 3): parting}
