# SPDX-License-Identifier: Apache-2.0
"""Surfaces as the job spec names them, evaluated here by their definitions: value, gradient, area.

Nothing of this is hexad's: the formulas are those of the spec's documentation, volumes are read by OpenVDB's own
Python module and interpolated by scipy's cubic spline, areas are closed forms or integrals.
"""
import numpy
from scipy import ndimage

# Around the active voxels: what is beyond is background, and the spline forgets its ends with 0.27 a voxel.
MARGIN = 12
# The last step of Newton's towards the foot on an ellipsoid, of the way from the nearest pole: the next would be the
# square of it.
FOOT_STEP = 1e-8
# Of the least radius: far below what a float of a level set tells.
OFF_PLANES = 1e-9
# Of a voxel or of the domain: the error of central differences is then below 1e-7 of the gradient.
STEP = 1e-4


class Surface:
    """value(x) and gradient(x) of (n, 3) points; `area`; `domain` (low, high) when it is cut, else None;
    `length`: the size that steps of differences are a fraction of."""
    domain = None
    euler = None
    length = 1.0

    def gradient(self, x):
        step = STEP * self.length
        return numpy.stack([(self.value(x + step * e) - self.value(x - step * e)) / (2 * step)
                            for e in numpy.eye(3)], axis=1)

    def distance(self, x):
        """To first order, unsigned."""
        return numpy.abs(self.value(x)) / numpy.linalg.norm(self.gradient(x), axis=1)

    def normal(self, x):
        g = self.gradient(x)
        return g / numpy.linalg.norm(g, axis=1)[:, None]

    def curvatures(self, x):
        """Principal curvatures, the larger first: eigenvalues of the change of the normal."""
        from measure import tangents
        u, v = tangents(self.normal(x))
        step = 1e-3 * self.length
        turn = [(self.normal(x + step * t) - self.normal(x - step * t)) / (2 * step) for t in (u, v)]
        a, d = (turn[0] * u).sum(1), (turn[1] * v).sum(1)
        b = 0.5 * ((turn[0] * v).sum(1) + (turn[1] * u).sum(1))
        mean, spread = 0.5 * (a + d), numpy.hypot(0.5 * (a - d), b)
        return mean + spread, mean - spread


class Sphere(Surface):
    euler = 2

    def __init__(self, radius, center=(0.5, 0.5, 0.5)):
        self.radius, self.center, self.length = radius, numpy.array(center), radius
        self.area = 4 * numpy.pi * radius ** 2

    def value(self, x):
        return numpy.linalg.norm(x - self.center, axis=1) - self.radius


class Torus(Surface):
    euler = 0

    def __init__(self, major_radius, minor_radius, center=(0.5, 0.5, 0.5), axis=(0, 0, 1)):
        self.major, self.minor, self.center = major_radius, minor_radius, numpy.array(center)
        self.axis = numpy.array(axis) / numpy.linalg.norm(axis)
        self.length = minor_radius
        self.area = 4 * numpy.pi ** 2 * major_radius * minor_radius

    def value(self, x):
        d = x - self.center
        up = d @ self.axis
        out = numpy.linalg.norm(d - up[:, None] * self.axis, axis=1)
        return numpy.hypot(out - self.major, up) - self.minor

    def curvatures(self, x):
        d = x - self.center
        out = numpy.linalg.norm(d - (d @ self.axis)[:, None] * self.axis, axis=1)
        along = (out - self.major) / self.minor / out
        return numpy.maximum(1 / self.minor, along), numpy.minimum(1 / self.minor, along)


class Box(Surface):
    """Grown by `rounding` from a core."""
    euler = 2

    def __init__(self, half_size, rounding=0.0, center=(0.5, 0.5, 0.5)):
        self.core = numpy.array(half_size) - rounding
        self.rounding, self.center, self.length = rounding, numpy.array(center), min(half_size)
        a, b, c = 2 * self.core
        self.area = (2 * (a * b + b * c + c * a) + 2 * numpy.pi * rounding * (a + b + c) +
                     4 * numpy.pi * rounding ** 2)

    def value(self, x):
        q = numpy.abs(x - self.center) - self.core
        outside = numpy.linalg.norm(numpy.maximum(q, 0), axis=1)
        return outside + numpy.minimum(q.max(axis=1), 0) - self.rounding


class Frustum(Surface):
    """A cone that is cut off, a cylinder or a segment, about an axis, grown by `rounding`: the distance to its outline in
    the half-plane through the axis."""
    euler = 2

    def __init__(self, half, bottom_radius, top_radius, rounding, center, axis):
        self.outline = numpy.array([(0, -half), (bottom_radius, -half), (top_radius, half), (0, half)])
        self.rounding, self.center = rounding, numpy.array(center)
        self.axis = numpy.array(axis) / numpy.linalg.norm(axis)
        self.length = max(bottom_radius, top_radius, rounding)
        side = numpy.hypot(2 * half, bottom_radius - top_radius)
        # Steiner's formula: area, mean curvature over it, and the sphere that the corners make up
        area = numpy.pi * (bottom_radius ** 2 + top_radius ** 2 + side * (bottom_radius + top_radius))
        turn = numpy.arctan2(2 * half, top_radius - bottom_radius)
        mean = numpy.pi * (2 * half + bottom_radius * (numpy.pi - turn) + top_radius * turn)
        self.area = float(area + 2 * mean * rounding + 4 * numpy.pi * rounding ** 2)

    def value(self, x):
        d = x - self.center
        z = d @ self.axis
        p = numpy.stack([numpy.linalg.norm(d - z[:, None] * self.axis, axis=1), z], axis=1)
        nearest, inside = numpy.full(len(x), numpy.inf), numpy.ones(len(x), bool)
        for a, b in zip(self.outline[:-1], self.outline[1:]):
            along = b - a
            if not along.any():
                continue
            t = numpy.clip((p - a) @ along / (along @ along), 0, 1)
            nearest = numpy.minimum(nearest, numpy.linalg.norm(p - a - t[:, None] * along, axis=1))
            inside &= (p - a) @ [along[1], -along[0]] < 0
        return numpy.where(inside, -nearest, nearest) - self.rounding


def cylinder(radius, height, rounding=0.0, center=(0.5, 0.5, 0.5), axis=(0, 0, 1)):
    return Frustum(height / 2 - rounding, radius - rounding, radius - rounding, rounding, center, axis)


def cone(radius, height, top_radius=0.0, center=(0.5, 0.5, 0.5), axis=(0, 0, 1)):
    return Frustum(height / 2, radius, top_radius, 0.0, center, axis)


def capsule(radius, height, center=(0.5, 0.5, 0.5), axis=(0, 0, 1)):
    return Frustum(height / 2, 0.0, 0.0, radius, center, axis)


def _directions(n):
    """Unit vectors and weights that add up to 4 n over the sphere: by Gauss in the height and equal steps
    around."""
    height, weight = numpy.polynomial.legendre.leggauss(n)
    around = 2 * numpy.pi * (numpy.arange(2 * n) + 0.5) / (2 * n)
    z, phi = (a.ravel() for a in numpy.meshgrid(height, around, indexing="ij"))
    flat = numpy.sqrt(1 - z * z)
    u = numpy.stack([flat * numpy.cos(phi), flat * numpy.sin(phi), z], axis=1)
    return u, numpy.repeat(weight, 2 * n)


class Ellipsoid(Surface):
    """Distances are true ones: the foot of x is r^2 x / (t + r^2), at the largest root t of |r x / (t + r^2)| = 1."""
    euler = 2

    def __init__(self, radii, center=(0.5, 0.5, 0.5)):
        self.radii, self.center, self.length = numpy.array(radii, float), numpy.array(center), min(radii)
        self.area = self._integral(400)

    def foot(self, x):
        """The nearest place on the surface.

        By Newton from below: the function of t is convex and falls, so that no step passes the root; s is t from the
        nearest pole on. Off the planes of symmetry, where an inner point has two feet and the function none of its
        terms."""
        d, above = x - self.center, self.radii ** 2 - self.length ** 2
        d = numpy.where(d < 0, -1, 1) * numpy.maximum(numpy.abs(d), OFF_PLANES * self.length)
        s = (self.radii * numpy.abs(d) - above).max(axis=1)
        step = s
        while (step > FOOT_STEP * s).any():
            ratio = self.radii * d / (s[:, None] + above)
            step = ((ratio ** 2).sum(axis=1) - 1) / (2 * (ratio ** 2 / (s[:, None] + above)).sum(axis=1))
            s = s + step
        return self.center + self.radii ** 2 * d / (s[:, None] + above)

    def value(self, x):
        d = x - self.center
        side = numpy.sign(((d / self.radii) ** 2).sum(axis=1) - 1)
        return side * numpy.linalg.norm(x - self.foot(x), axis=1)

    def normal(self, x):
        g = (self.foot(x) - self.center) / self.radii ** 2
        return g / numpy.linalg.norm(g, axis=1)[:, None]

    gradient = normal

    def _integral(self, n):
        """dA = r0 r1 r2 |u / r| dOmega over the unit sphere."""
        u, weight = _directions(n)
        stretch = self.radii.prod() * numpy.linalg.norm(u / self.radii, axis=1)
        return float((stretch * weight).sum() * numpy.pi / n)


class Quartic(Surface):
    """Equation (15): along a direction u the surface is at t = sqrt(10 r^2 / sum u^4)."""
    euler = 2

    def __init__(self, r=0.13, center=(0.5, 0.5, 0.5)):
        self.c, self.center, self.length = 10 * r * r, numpy.array(center), r
        self.area = self._integral(400)

    def value(self, x):
        s = (x - self.center) ** 2
        return (s * s).sum(axis=1) - self.c * s.sum(axis=1)

    def gradient(self, x):
        d = x - self.center
        return 4 * d ** 3 - 2 * self.c * d

    def _integral(self, n):
        """dA = t^2 dOmega / (n . u), by Gauss in the height and equal steps around."""
        u, weight = _directions(n)
        t = numpy.sqrt(self.c / (u ** 4).sum(axis=1))
        facing = (self.normal(self.center + t[:, None] * u) * u).sum(axis=1)
        return float((t * t / facing * weight).sum() * numpy.pi / n)


class Gyroid(Surface):
    def __init__(self, period, size=(1, 1, 1), center=(0.5, 0.5, 0.5)):
        self.k, self.center, self.length = 2 * numpy.pi / period, numpy.array(center), period
        half = 0.5 * numpy.array(size)
        self.domain = self.center - half, self.center + half
        cells = numpy.round(24 * numpy.array(size) / period).astype(int)
        self.area = area_by_rays(self, self.domain[0], 2 * half / cells, cells)

    def value(self, x):
        s, c = numpy.sin(self.k * (x - self.center)), numpy.cos(self.k * (x - self.center))
        return (s * numpy.roll(c, -1, axis=1)).sum(axis=1)

    def gradient(self, x):
        s, c = numpy.sin(self.k * (x - self.center)), numpy.cos(self.k * (x - self.center))
        return self.k * (c * numpy.roll(c, -1, axis=1) - s * numpy.roll(s, 1, axis=1))


class Volume(Surface):
    """A grid of an OpenVDB file at its isovalue, through scipy's interpolating cubic spline."""

    def __init__(self, path, grid=None, isovalue=0.0):
        import pyopenvdb
        (name,) = {g.name for g in pyopenvdb.readAllGridMetadata(str(path)) if grid in (None, g.name)}
        grid = pyopenvdb.read(str(path), name)
        low, high = (numpy.array(corner) for corner in grid.evalActiveVoxelBoundingBox())
        self.low = low - MARGIN
        dense = numpy.zeros(high - low + 1 + 2 * MARGIN)
        grid.copyToArray(dense, ijk=tuple(int(v) for v in self.low))
        sign = 1 if grid.gridClass == "level set" else -1
        self.samples = sign * (dense - isovalue)
        self.coefficients = ndimage.spline_filter(self.samples, order=3, mode="mirror")
        self.origin = numpy.array(grid.transform.indexToWorld((0, 0, 0)))
        matrix = numpy.array([grid.transform.indexToWorld(tuple(e)) for e in numpy.eye(3)]) - self.origin
        self.voxel = numpy.diag(matrix)
        if numpy.abs(matrix - numpy.diag(self.voxel)).max() > 1e-12 * self.voxel.max():
            raise ValueError(f"{path}: only voxels along the axes are measured here")
        self.length = self.voxel.min()
        self._area = None

    def value(self, x):
        index = (x - self.origin) / self.voxel - self.low
        return ndimage.map_coordinates(self.coefficients, index.T, order=3, mode="mirror", prefilter=False)

    @property
    def area(self):
        if self._area is None:
            shape = numpy.array(self.samples.shape) - 1
            near = ndimage.minimum_filter(self.samples, 5) * ndimage.maximum_filter(self.samples, 5) <= 0
            cells = numpy.argwhere(near[:-1, :-1, :-1])
            # off the nodes, where a surface along the voxels would stand between two pieces of a ray
            low = self.origin + (self.low + OFF_NODES) * self.voxel
            self._area = area_by_rays(self, low, self.voxel, shape, cells)
        return self._area


def _roots(surface, low, high, axis):
    """Points of the surface on segments along an axis whose ends are on its two sides (Illinois' rule)."""
    a, b = low[:, axis].copy(), high[:, axis].copy()
    fa, fb = surface.value(low), surface.value(high)
    x = low.copy()
    last = numpy.zeros(len(a))
    for _ in range(12):
        with numpy.errstate(invalid="ignore", divide="ignore"):
            t = numpy.clip(numpy.nan_to_num((a * fb - b * fa) / (fb - fa), nan=0), numpy.minimum(a, b),
                           numpy.maximum(a, b))
        x[:, axis] = t
        f = surface.value(x)
        left = (f < 0) == (fa < 0)
        fb = numpy.where(left & (last == 1), 0.5 * fb, fb)
        fa = numpy.where(~left & (last == -1), 0.5 * fa, fa)
        a, fa = numpy.where(left, t, a), numpy.where(left, f, fa)
        b, fb = numpy.where(left, b, t), numpy.where(left, fb, f)
        last = numpy.where(left, 1, -1)
    return x


# Rays per side of a cell, and pieces that a ray is cut into within it: two roots in one piece are missed, but they
# are where the ray grazes the surface and weigh next to nothing.
RAYS, PIECES, OFF_NODES = 4, 3, 0.29
# Where the mean of the normals in a cell is shorter than this the surface bends within it, and gets more rays.
BENT, RAYS_BENT = 0.98, 24


def _cast(surface, origin, cell, cells, rays):
    """What `rays` squared rays along each axis of each cell see: the area each stands for, normal, which cell."""
    found = [(numpy.zeros(0), numpy.zeros((0, 3)), numpy.zeros(0, int))]
    for axis in range(3):
        ray = cell[(axis + 1) % 3] * cell[(axis + 2) % 3] / rays ** 2
        for sub in numpy.ndindex(rays, rays):
            start = cells.astype(float)
            start[:, (axis + 1) % 3] += (sub[0] + 0.5) / rays
            start[:, (axis + 2) % 3] += (sub[1] + 0.5) / rays
            step = numpy.eye(3)[axis] / PIECES
            ends = [origin + (start + k * step) * cell for k in range(PIECES + 1)]
            sides = [surface.value(x) < 0 for x in ends]
            for k in range(PIECES):
                hit = numpy.flatnonzero(sides[k] != sides[k + 1])
                n = surface.normal(_roots(surface, ends[k][hit], ends[k + 1][hit], axis))
                found.append((ray * numpy.abs(n[:, axis]) ** 5 / (n ** 6).sum(axis=1), n, hit))
    return [numpy.concatenate(column) for column in zip(*found)]


def area_by_rays(surface, origin, cell, count, cells=None):
    """Area inside the box of `count` cells of size `cell` at `origin`, given the cells that matter (or all).

    Rays along axis a see an element of area dA as |n_a| dA. With weights w_a = n_a^6 / sum n^6, which sum to one,
    A = sum over axes and rays of w_a / |n_a|: every term vanishes with the fifth power of n_a where the ray
    grazes, so that equally spaced rays are as good as the surface is smooth."""
    if cells is None:
        cells = numpy.stack(numpy.meshgrid(*map(numpy.arange, count), indexing="ij"), axis=-1).reshape(-1, 3)
    area, n, which = _cast(surface, origin, cell, cells, RAYS)
    mean = numpy.stack([numpy.bincount(which, area * n[:, k], len(cells)) for k in range(3)], axis=1)
    bent = numpy.linalg.norm(mean, axis=1) < BENT * numpy.bincount(which, area, len(cells))
    again = _cast(surface, origin, cell, cells[bent], RAYS_BENT)[0]
    return float(area[~bent[which]].sum() + again.sum())


SHAPES = {"sphere": Sphere, "torus": Torus, "box": Box, "ellipsoid": Ellipsoid, "quartic": Quartic, "gyroid": Gyroid,
          "cylinder": cylinder, "cone": cone, "capsule": capsule}


def surface_of(spec_surface):
    """The surface that a job spec's member `surface` describes; None when it is none of those known here."""
    (kind, members), = spec_surface.items()
    if kind == "analytic" and members["shape"] in SHAPES:
        return SHAPES[members["shape"]](**{k: v for k, v in members.items() if k != "shape"})
    if kind == "vdb":
        return Volume(members["path"], members.get("grid"), members.get("isovalue", 0.0))
    return None
