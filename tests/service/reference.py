# SPDX-License-Identifier: Apache-2.0
"""A second opinion on volumes: OpenVDB's own Python module reads the grid, scipy's cubic spline goes
through its samples, differences give the gradient, the co-area formula the area. Nothing here is hexad's."""
import numpy
from scipy import ndimage

# Around the active voxels: what is beyond is background, and the spline forgets its ends with 0.27 a voxel.
MARGIN = 12
# Of a voxel, in index space: the error of central differences is then below 1e-7 of the gradient.
STEP = 1e-4


class Reference:
    """The grid `name` ("name[k]" among equals; None: the only one) of a file."""

    def __init__(self, path, name=None):
        import pyopenvdb
        grids = pyopenvdb.readAllGridMetadata(str(path))
        plain, _, which = (name or "").rpartition("[")
        if plain:
            equals = [g for g in pyopenvdb.readAll(str(path))[0] if g.name == plain]
            grid = equals[int(which.rstrip("]"))]
        else:
            (wanted,) = {g.name for g in grids if name is None or g.name == name}
            grid = pyopenvdb.read(str(path), wanted)
        self.grid_class = grid.gridClass
        low, high = (numpy.array(corner) for corner in grid.evalActiveVoxelBoundingBox())
        self.low = low - MARGIN
        dense = numpy.zeros(high - low + 1 + 2 * MARGIN)
        grid.copyToArray(dense, ijk=tuple(int(v) for v in self.low))
        self.coefficients = ndimage.spline_filter(dense, order=3, mode="mirror")
        self.origin = numpy.array(grid.transform.indexToWorld((0, 0, 0)))
        unit = numpy.eye(3)
        self.matrix = numpy.array([grid.transform.indexToWorld(tuple(u)) for u in unit]).T - self.origin[:, None]
        self.voxel = min(numpy.linalg.norm(self.matrix, axis=0))

    def _at(self, index):
        return ndimage.map_coordinates(self.coefficients, index.T - self.low[:, None], order=3, mode="mirror",
                                       prefilter=False)

    def sample(self, world):
        """Values, and gradients by world coordinates."""
        index = numpy.linalg.solve(self.matrix, (world - self.origin).T).T
        along = [(self._at(index + STEP * u) - self._at(index - STEP * u)) / (2 * STEP) for u in numpy.eye(3)]
        return self._at(index), numpy.linalg.solve(self.matrix.T, numpy.array(along)).T

    def distances_vox(self, world, isovalue):
        """To first order: how far from the isosurface, in edges of the smallest voxel."""
        value, gradient = self.sample(world)
        return numpy.abs(value - isovalue) / numpy.linalg.norm(gradient, axis=1) / self.voxel

    def outward(self, world):
        """Unit normals: along the gradient for level sets, against it for fog."""
        gradient = self.sample(world)[1]
        sign = 1 if self.grid_class == "level set" else -1
        return sign * gradient / numpy.linalg.norm(gradient, axis=1)[:, None]

    def area(self, isovalue, band, strata, rng):
        """Area of the isosurface: the integral of |gradient| over where F is within `band` of the isovalue,
        divided by the band's width, from one random place in each of strata^3 parts of a cell."""
        around = numpy.ones((5, 5, 5), bool)  # a spline lies within the hull of its coefficients
        low = ndimage.minimum_filter(self.coefficients, footprint=around)
        high = ndimage.maximum_filter(self.coefficients, footprint=around)
        cells = numpy.argwhere((low <= isovalue + band) & (high >= isovalue - band)) + self.low
        total = 0.0
        for part in numpy.ndindex(strata, strata, strata):
            index = cells + (numpy.array(part) + rng.random(cells.shape)) / strata
            index = index[numpy.abs(self._at(index) - isovalue) < band]
            total += numpy.linalg.norm(self.sample(index @ self.matrix.T + self.origin)[1], axis=1).sum()
        return total * abs(numpy.linalg.det(self.matrix)) / strata ** 3 / (2 * band)
