"""How well points cover the mesh that they were sampled from, and how far off it they lie. Shares no code with the
sampler.

Only that part of the mesh counts that bounds the union of its solids: a place on a triangle whose one side lies inside
and whose other side lies outside, by winding numbers.
"""
import dataclasses

import numpy
from scipy.spatial import cKDTree

import meshes

# Spread over the mesh for one point of the sample, within bounds.
PLACES_A_POINT, FEWEST, MOST = 8, 40000, 400000
# Farther from all points than this, in spacings, a place is not covered; an ideal packing leaves 0.58 at most.
NOT_COVERED = 1.2
# Both sides of a triangle are looked at so far from it, of the mesh's extent.
SIDE = 1e-5
# Lines run along the last axis of a mesh that is turned, so that they meet no edges; triangles are sorted into squares
# across it, at most so many along an axis. Places that are asked at a time.
MOST_SQUARES, AT_ONCE = 256, 20000


@dataclasses.dataclass
class Covering:
    gap: float       # the largest distance of a place from the nearest point, in spacings
    missing: float   # share of the area that is not covered
    distance: float  # the largest distance of a point from the mesh, in spacings


class Winding:
    """Winding numbers of a closed mesh, by the triangles that a line crosses above a place."""

    def __init__(self, mesh):
        turn = numpy.linalg.qr(numpy.random.default_rng(1).normal(size=(3, 3)))[0]
        self.turn = turn * numpy.sign(numpy.linalg.det(turn))
        self.corner = (mesh.vertices @ self.turn.T)[mesh.triangles]
        across = self.corner[:, :, :2]
        self.low = across.min(axis=(0, 1))
        self.squares = int(min(max(numpy.sqrt(len(self.corner)), 8), MOST_SQUARES))
        self.size = (across.max(axis=(0, 1)) - self.low) / self.squares
        first, last = self._square(across.min(axis=1)), self._square(across.max(axis=1))
        wide = last - first + 1
        which = numpy.repeat(numpy.arange(len(wide)), wide.prod(axis=1))
        k = numpy.arange(len(which)) - numpy.repeat(numpy.cumsum(wide.prod(axis=1)) - wide.prod(axis=1), wide.prod(axis=1))
        square = (first[which, 0] + k % wide[which, 0]) * self.squares + first[which, 1] + k // wide[which, 0]
        self.triangle = which[numpy.argsort(square, kind="stable")]
        self.start = numpy.concatenate([[0], numpy.cumsum(numpy.bincount(square, minlength=self.squares ** 2))])

    def _square(self, across):
        return numpy.clip(((across - self.low) / self.size).astype(int), 0, self.squares - 1)

    def at(self, place):
        return numpy.concatenate([self._some(part) for part in numpy.array_split(place, 1 + len(place) // AT_ONCE)])

    def _some(self, place):
        p = place @ self.turn.T
        square = self._square(p[:, :2]) @ [self.squares, 1]
        count = self.start[square + 1] - self.start[square]
        asked = numpy.repeat(numpy.arange(len(p)), count)
        k = numpy.arange(len(asked)) - numpy.repeat(numpy.cumsum(count) - count, count)
        corner = self.corner[self.triangle[self.start[square][asked] + k]] - p[asked, None]
        x, y = corner[:, :, 0], corner[:, :, 1]
        side = x * numpy.roll(y, -1, axis=1) - y * numpy.roll(x, -1, axis=1)
        whole = side.sum(axis=1)
        met = (side > 0).all(axis=1) | (side < 0).all(axis=1)
        height = (numpy.roll(side, -1, axis=1) * corner[:, :, 2]).sum(axis=1) / numpy.where(met, whole, 1)
        return numpy.bincount(asked, met * (height > 0) * numpy.sign(whole), len(p))


def measure(mesh, position, spacing):
    """Of points whose requested spacings are `spacing`."""
    place, normal = meshes.places(mesh, int(min(max(PLACES_A_POINT * len(position), FEWEST), MOST)))
    step, winding = SIDE * float(numpy.ptp(mesh.vertices, axis=0).max()), Winding(mesh)
    # shells may be inside out
    inside = [winding.at(place + sign * step * normal) != 0 for sign in (-1, 1)]
    away, nearest = cKDTree(position).query(place[inside[0] != inside[1]])
    away = away / spacing[nearest]
    return Covering(float(away.max()), float((away > NOT_COVERED).sum() / len(place)),
                    mesh.farthest(position, spacing))
