# SPDX-License-Identifier: Apache-2.0
"""Measures of a point set on a closed surface, or on one that a box cuts, from its points alone; the second opinion on report.json.

They are those of doc/report.md, over all points. Shares no code with the sampler, nor its method. Neighbours are those of the Delaunay
triangulation restricted to the surface: of the tetrahedra between the points in space, those whose circumcentre lies inside are the
solid, and the triangles between these and the others are the surface. It is closed by construction and has one Euler characteristic.
Whether a circumcentre lies inside is decided by the normals of the points that it is nearest to, which are the tetrahedron's corners. So
walls closer than the spacing are not separated: points on a mesh are measured by mesh_measures.py.
"""
import dataclasses

import numpy
from scipy.sparse import coo_matrix, csgraph
from scipy.spatial import Delaunay, cKDTree

E_IDEAL = 6 * (1 / numpy.tan(numpy.pi / 2 / numpy.sqrt(3)) + numpy.pi / 2 / numpy.sqrt(3) - numpy.pi / 2)
# Near the ideal an energy goes as this power of distance, falling; and of perfect order whose spacing grows by g per distance, how
# much larger cells and energies are, over g squared.
SLOPE, GROWTH_CELL, GROWTH_ENERGY, GROWTH_MOST = 4.6856, 5 / 12, 0.668, 0.3
# Points whose normals have this product and less are on opposite walls.
OPPOSITE = -0.4
# Degrees within this of an integer are that integer; a point is on a border within this of it, in spacings.
INTEGER, ON_BORDER = 0.2, 1e-3
# Points without a neighbour nearer than these, in spacings, are not close, or not coincident.
CLOSE, COINCIDENT = 0.25, 1e-3
# Where none is requested the spacing is given as this power of the amplitude.
ALPHA_EXPONENT = 0.18
# Spacings that differ by less, relatively, were one before they were rounded.
SAME = 1e-6
# Points whose nearest so many do not reach beyond the support are asked for more, up to the last of these.
NEIGHBOURS = (16, 48, 144)
# Largest circumradius of a triangle of a surface that a box cuts, in spacings. An ideal one has 0.58, one beside a vacancy less than 1.
RADIUS = 1.2
# Points that lie on a plane or a sphere have no unique Delaunay triangulation, and the search for one takes for
# ever; moved by this, in spacings, they have.
JITTER = 1e-5
# Companions in the empty space, so many spacings off the surface, keep tetrahedra from reaching right across it. One
# point in COMPANIONS times the distance gets one, if it is nearer to nobody than CLEAR of that distance.
COMPANION_DISTANCES, COMPANIONS, CLEAR = (4, 8, 16, 32, 64, 128), 30, 0.8


@dataclasses.dataclass
class PointSet:
    position: numpy.ndarray
    normal: numpy.ndarray
    spacing: numpy.ndarray  # requested
    alpha: numpy.ndarray
    columns: dict           # every property of the file by its name

    @property
    def count(self):
        return len(self.position)


def read_ply(path):
    """Any PLY whose vertices have floats, doubles and unsigned integers, as text or little-endian."""
    with open(path, "rb") as file:
        head, mark, body = file.read().partition(b"end_header\n")
    words = [line.split() for line in head.decode("ascii").splitlines()]
    if not mark or words[0] != ["ply"]:
        raise ValueError(f"{path} is not a PLY file")
    count = next(int(w[2]) for w in words if w[:2] == ["element", "vertex"])
    names = [w[2] for w in words if w[0] == "property"]
    kinds = [{"float": "<f4", "double": "<f8", "uint": "<u4", "int": "<i4"}[w[1]] for w in words if w[0] == "property"]
    if ["format", "ascii", "1.0"] in words:
        table = numpy.array(body.split(), float).reshape(count, len(names))
    else:
        rows = numpy.frombuffer(body, list(zip(names, kinds)), count)
        table = numpy.stack([rows[name].astype(float) for name in names], axis=1)
    columns = {name: table[:, k] for k, name in enumerate(names)}
    if "spacing" not in columns:
        raise ValueError(f'{path} has no spacing: run the job with "all" in output.ply.properties')
    return PointSet(table[:, 0:3], table[:, 3:6], columns["spacing"], columns["alpha"], columns)


def ideal_spacing(area, count):
    return numpy.sqrt(2 * area / (numpy.sqrt(3) * count))


def cotangent(u):
    """Equation (6) of distances in units of the support."""
    w = numpy.clip(u, 1e-6, 1) * numpy.pi / 2
    return 1 / numpy.tan(w) + w - numpy.pi / 2


def tangents(normal):
    """Two unit vectors across each normal."""
    least = numpy.eye(3)[numpy.argmin(numpy.abs(normal), axis=1)]
    u = numpy.cross(normal, least)
    u /= numpy.linalg.norm(u, axis=1)[:, None]
    return u, numpy.cross(normal, u)


# ---- neighbours

def _companions(points, tree):
    """Places in the empty space, and on which side of the surface they are (-1: inside)."""
    rng = numpy.random.default_rng(1)
    places, sides = [numpy.zeros((0, 3))], [numpy.zeros(0)]
    for side in (-1, 1):
        for far in COMPANION_DISTANCES:
            who = rng.choice(points.count, max(1, points.count // (COMPANIONS * far)), replace=False)
            off = far * points.spacing[who]
            place = points.position[who] + (side * off)[:, None] * points.normal[who]
            alone = tree.query(place)[0] > CLEAR * off
            places.append(place[alone])
            sides.append(numpy.full(alone.sum(), side))
    return numpy.concatenate(places), numpy.concatenate(sides)


def circumcentres(corners):
    """Of tetrahedra (n, 4, 3); not finite where flat."""
    a = corners[:, 0]
    m = corners[:, 1:] - a[:, None]
    half = 0.5 * (m * m).sum(axis=2)
    with numpy.errstate(all="ignore"):
        across = sum(half[:, k, None] * numpy.cross(m[:, (k + 1) % 3], m[:, (k + 2) % 3]) for k in range(3))
        return a + across / numpy.einsum("nc,nc->n", m[:, 0], numpy.cross(m[:, 1], m[:, 2]))[:, None]


def triangulate(points, box=None):
    """Triangles (m, 3) of the Delaunay triangulation restricted to the surface. With a box only those whose circumcentres lie in it, since
    cells end at its faces, and are no farther than RADIUS from the corners: the others close the surface across the box."""
    rng = numpy.random.default_rng(2)
    n = points.count
    moved = points.position + (JITTER * points.spacing * rng.standard_normal(n))[:, None] * points.normal
    extra, sides = _companions(points, cKDTree(points.position))
    places = numpy.concatenate([moved, extra])
    mesh = Delaunay(places)
    corner = mesh.simplices
    centre = circumcentres(places[corner])
    normal = numpy.concatenate([points.normal, numpy.zeros_like(extra)])
    with numpy.errstate(invalid="ignore"):
        vote = numpy.sign(numpy.einsum("nkc,nkc->nk", centre[:, None] - places[corner], normal[corner]))
    vote = numpy.nan_to_num(vote).sum(axis=1)
    alone = (corner >= n).all(axis=1)
    vote[alone] = sides[corner[alone] - n].sum(axis=1)
    inside = vote < 0
    triangles = []
    for k in range(4):
        other = mesh.neighbors[:, k]
        face = inside & ((other < 0) | ~inside[other])
        triangles.append(numpy.delete(corner[face], k, axis=1))
    triangles = numpy.concatenate(triangles)
    triangles = triangles[(triangles < n).all(axis=1)]
    if box is not None:
        spacing = points.spacing[triangles].mean(axis=1)[:, None]
        corners = points.position[triangles]
        centre = triangle_circumcentres(corners)
        slack = ON_BORDER * spacing
        fits = ((centre >= box[0] - slack) & (centre <= box[1] + slack)).all(axis=1)
        triangles = triangles[fits & (circumradii(corners) < RADIUS * spacing[:, 0])]
    return triangles


def circumradii(corners):
    """Of triangles; very large where flat."""
    side = numpy.linalg.norm(corners - numpy.roll(corners, 1, axis=1), axis=2)
    across = numpy.linalg.norm(numpy.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return side.prod(axis=1) / (2 * numpy.maximum(across, 1e-300))


def triangle_circumcentres(corners):
    a = corners[:, 0]
    u, v = corners[:, 1] - a, corners[:, 2] - a
    across = numpy.cross(u, v)
    twice = 2 * numpy.maximum((across * across).sum(axis=1), 1e-300)[:, None]
    return a + ((u * u).sum(axis=1)[:, None] * numpy.cross(v, across) + (v * v).sum(axis=1)[:, None] * numpy.cross(across, u)) / twice


def edges_of(triangles):
    """Every edge once, (m, 2), i < j."""
    edge = numpy.sort(triangles.astype(numpy.int64)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    key = numpy.unique(edge[:, 0] * (edge.max(initial=0) + 1) + edge[:, 1])
    return numpy.stack(numpy.divmod(key, edge.max(initial=0) + 1), axis=1)


def voronoi_areas(points, triangles):
    """The dual cell of every point: each edge gives its two ends |e|^2 cot(opposite angle) / 8."""
    corner = points.position[triangles]
    area = numpy.zeros(points.count)
    for k in range(3):
        a, b, c = triangles[:, k], triangles[:, (k + 1) % 3], corner[:, (k + 2) % 3]
        u, v = corner[:, k] - c, corner[:, (k + 1) % 3] - c
        across = numpy.maximum(numpy.linalg.norm(numpy.cross(u, v), axis=1), 1e-300)
        share = ((u - v) ** 2).sum(axis=1) * (u * v).sum(axis=1) / across / 8
        area += numpy.bincount(a, share, points.count) + numpy.bincount(b, share, points.count)
    return area


def close_pairs(points, support):
    """Pairs i < j nearer than the larger of their supports, and their distances."""
    tree = cKDTree(points.position)
    n, todo, found = points.count, numpy.arange(points.count), []
    for most in NEIGHBOURS:
        most = min(most, n - 1)
        distance, near = tree.query(points.position[todo], most + 1)
        own = numpy.broadcast_to(todo[:, None], near.shape)
        keep = (distance < support[todo][:, None]) & (near != own)
        i, j, distance_kept = own[keep], near[keep], distance[keep]
        found.append((numpy.minimum(i, j) * n + numpy.maximum(i, j), distance_kept))
        todo = todo[distance[:, -1] < support[todo]]
        if not len(todo) or most == n - 1:
            break
    key, first = numpy.unique(numpy.concatenate([k for k, _ in found]), return_index=True)
    distance = numpy.concatenate([d for _, d in found])[first]
    i, j = numpy.divmod(key, n)
    return i, j, distance


def facing(points, i, j):
    return numpy.einsum("nc,nc->n", points.normal[i], points.normal[j])


def border_angles(points, box):
    """Of each point the surface's angle over a full turn, and whether it lies on a border: on a face of the box a half, where two faces
    meet the angle between them in the surface."""
    share, border = numpy.ones(points.count), numpy.zeros(points.count, bool)
    if box is None:
        return share, border
    slack = ON_BORDER * points.spacing[:, None]
    low, high = points.position <= box[0] + slack, points.position >= box[1] - slack
    on = low | high
    border = on.any(axis=1)
    share[border] = 0.5
    for i in numpy.flatnonzero(on.sum(axis=1) == 2):
        inward = [numpy.eye(3)[k] * (1 if low[i, k] else -1) for k in numpy.flatnonzero(on[i])]
        n = points.normal[i]
        u, v = (f - n * (f @ n) for f in inward)
        share[i] = (numpy.pi - numpy.arccos(u @ v / numpy.sqrt((u @ u) * (v @ v)))) / (2 * numpy.pi)
    return share, border


# ---- measures

def _variation(values):
    return float(values.std() / values.mean()) if len(values) > 1 and values.mean() > 0 else float("nan")


def is_uneven(spacing):
    return spacing.max() > 1.05 * spacing.min()


def is_asked_by_amplitudes(points):
    """Whether the spacing is what amplitudes make of it, and none is requested."""
    return is_uneven(points.alpha) and not is_uneven(points.spacing / points.alpha ** ALPHA_EXPONENT)


def _energies(points, h, graded):
    """Every point's full sum; the support is sqrt(3) h. Where graded it is that of each pair's mean spacing s, and
    a pair gives s^2 phi, to each end in units of its own spacing squared."""
    n = points.count
    support = numpy.sqrt(3) * (points.spacing if graded else numpy.full(n, h))
    i, j, distance = close_pairs(points, support)
    same = facing(points, i, j) > OPPOSITE
    i, j, distance = i[same], j[same], distance[same]
    between = 0.5 * (support[i] + support[j])
    phi = cotangent(distance / between)
    return (numpy.bincount(i, phi * (between / support[i]) ** 2, n) +
            numpy.bincount(j, phi * (between / support[j]) ** 2, n))


def turns(points, triangles):
    """The angles around each point over a full turn."""
    found = numpy.zeros(points.count)
    for k in range(3):
        at = triangles[:, k]
        a, b = (points.position[triangles[:, (k + n) % 3]] - points.position[at] for n in (1, 2))
        angle = numpy.arctan2(numpy.linalg.norm(numpy.cross(a, b), axis=1), (a * b).sum(axis=1))
        found += numpy.bincount(at, angle, points.count)
    return found / (2 * numpy.pi)


def _disorder(points, energy, measured, cell, turn, edges, uneven, neighbours=1):
    """The energy over that of perfect order with cells as large on the whole, as many neighbours as the turns around points
    demand (Gauss and Bonnet), and a spacing that grows as much: a lattice under the exponential map. Of growth in all directions an edge
    has half of the square. Cells and turns are over the surface's angle, `neighbours` is the mean ideal degree over 6."""
    i, j = edges.T
    length = numpy.linalg.norm(points.position[i] - points.position[j], axis=1)
    step = ((points.spacing[i] - points.spacing[j]) / length) ** 2
    ends, steps = numpy.concatenate([i, j]), numpy.concatenate([step, step])
    own = numpy.bincount(ends, steps, points.count) / numpy.maximum(numpy.bincount(ends, minlength=points.count), 1)
    growth = numpy.minimum(2 * own[measured], GROWTH_MOST ** 2).mean() if uneven and measured.any() else 0
    relative = (cell / points.spacing ** 2)[measured].mean() * 2 / numpy.sqrt(3) if measured.any() else 1
    sixth = turn[measured].mean() if measured.any() else 1
    ordered = E_IDEAL * neighbours * (1 + GROWTH_ENERGY * growth) * sixth * (sixth * (1 + GROWTH_CELL * growth) / relative) ** (SLOPE / 2)
    return float(energy / ordered - 1)


def measure(points, area, border=None, window=None):
    """The measures by their names in report.json, from the points and the surface's true area.

    border: (low, high) corners of the box whose faces cut the surface. window: those of a box that was cut out of a larger surface; points
    within two spacings of its faces, whose cells are not known, are left out.
    Beside the measures `degree`, `cell` (Voronoi areas), `local` (spacing), `component` (number of each point's part), `edges` and
    `inner` (not left out), for further questions."""
    n, h = points.count, ideal_spacing(area, points.count)
    triangles = triangulate(points, window if border is None else border)
    edges = edges_of(triangles)
    i, j = edges.T
    inner = numpy.ones(n, bool)
    if window is not None:
        within = 2 * points.spacing[:, None]
        low, high = numpy.asarray(window[0]) + within, numpy.asarray(window[1]) - within
        inner = ((points.position >= low) & (points.position <= high)).all(axis=1)
    share, on_border = border_angles(points, border)
    ideal = 6 * share + on_border
    length = numpy.linalg.norm(points.position[i] - points.position[j], axis=1)
    relative = length / (0.5 * (points.spacing[i] + points.spacing[j]))
    same = facing(points, i, j) > OPPOSITE
    degree = numpy.bincount(edges[same].ravel(), minlength=n)
    cell = voronoi_areas(points, triangles) / share
    local = numpy.sqrt(2 * numpy.maximum(cell, 0) / numpy.sqrt(3))
    uneven = is_uneven(points.spacing[inner])
    own = points
    if is_asked_by_amplitudes(points):  # order is measured against the achieved one
        own = dataclasses.replace(points, spacing=numpy.where(local > 0, local, points.spacing))
        relative = length / (0.5 * (own.spacing[i] + own.spacing[j]))
    energy = _energies(own, h, own is not points or points.spacing.max() > (1 + SAME) * points.spacing.min())

    both = numpy.abs(ideal - numpy.round(ideal)) > INTEGER
    regular = numpy.where(both, (degree == numpy.floor(ideal)) | (degree == numpy.ceil(ideal)), degree == numpy.round(ideal))
    first, second, gap = close_pairs(own, own.spacing)
    near = (facing(points, first, second) > OPPOSITE) & (inner[first] | inner[second])
    gap = gap[near] / (0.5 * (own.spacing[first[near]] + own.spacing[second[near]]))
    close, coincident = (numpy.unique(numpy.concatenate([k[near][gap < most] for k in (first, second)])) for most in (CLOSE, COINCIDENT))
    joined = same & (inner[i] | inner[j])
    sized = inner & (local > 0)
    slope = 1.0
    if uneven:
        slope = numpy.polyfit(numpy.log(points.spacing[sized]), numpy.log(local[sized]), 1)[0] if sized.sum() > 1 else float("nan")
    return {
        "count": n, "h": float(h),
        "hex_fraction": float(regular[inner].mean()) if inner.any() else float("nan"),
        "edge_cv": _variation(relative[joined]), "area_cv": _variation((cell / points.spacing ** 2)[inner]),
        "energy_excess": float((energy / (E_IDEAL * ideal / 6))[inner].mean() - 1),
        "disorder": _disorder(own, energy[inner].mean(), inner, cell, turns(points, triangles) / share, edges[same],
                              own is points and uneven, ideal[inner].mean() / 6),
        "min_spacing_ratio": float(min(relative[joined].min(initial=numpy.inf), gap.min(initial=numpy.inf))),
        "close_share": len(close) / n, "coincident": len(coincident),
        "unmeasured_share": float((degree < 3 - on_border)[inner].mean()) if inner.any() else float("nan"),
        "euler": int((numpy.bincount(edges.ravel(), minlength=n) > 0).sum() - len(edges) + len(triangles)),
        "unmeshed": int((degree == 0).sum()),
        "grading_cv": _variation((local / points.spacing)[inner]),
        "grading_exponent": float(slope),
        "degree": degree, "cell": cell, "local": local, "edges": edges, "edge_length": length, "inner": inner,
        "component": csgraph.connected_components(
            coo_matrix((numpy.ones(len(i)), (i, j)), (n, n)), directed=False)[1],
    }
