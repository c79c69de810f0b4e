"""Quality measures of a point set on a surface, from its points alone; the second opinion on report.json.

Shares no code with the sampler. Neighbours are those of the Voronoi diagram restricted to the surface: each
point's cell is cut out of its own tangent plane, its neighbours rolled into that plane with their distances
kept. A pair is joined where the two planes' Voronoi edges have a positive length between them; of the two
diagonals of four points nearly on a circle the longer one's opponent loses, so that both are never joined.
"""
import dataclasses

import numpy
from scipy.sparse import coo_matrix, csgraph
from scipy.spatial import cKDTree

E_IDEAL = 6 * (1 / numpy.tan(numpy.pi / 2 / numpy.sqrt(3)) + numpy.pi / 2 / numpy.sqrt(3) - numpy.pi / 2)
# Normals that part by more than this belong to another sheet; a right angle, as on a cube, does not.
OTHER_SIDE = -0.25
# Enough for the cells and the potential's support in a packing that is about even; more are fetched for the
# points that need them, up to the last of these.
NEIGHBOURS = (20, 40, 80, 160)
# Where nothing bounds a cell (a rim), it ends here, in requested spacings.
CELL_END = 2.0
# Voronoi edges shorter than this, in requested spacings, are held against the other diagonal's.
DOUBT = 0.1
# Pairs whose Voronoi edge is shorter than minus this, seen from one end, are no neighbours from either.
FAR = 0.5
# Points that are worked on together: arrays of CHUNK x NEIGHBOURS^2 doubles.
CHUNK = 2048


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
    """Any PLY whose vertices are all floats or all doubles, as text or little-endian."""
    with open(path, "rb") as file:
        head, mark, body = file.read().partition(b"end_header\n")
    words = [line.split() for line in head.decode("ascii").splitlines()]
    if not mark or words[0] != ["ply"]:
        raise ValueError(f"{path} is not a PLY file")
    count = next(int(w[2]) for w in words if w[:2] == ["element", "vertex"])
    names = [w[2] for w in words if w[0] == "property"]
    kinds = {w[1] for w in words if w[0] == "property"}
    if ["format", "ascii", "1.0"] in words:
        table = numpy.array(body.split(), float)
    else:
        table = numpy.frombuffer(body, {"float": "<f4", "double": "<f8"}[kinds.pop()]).astype(float)
    table = table.reshape(count, len(names))
    columns = {name: table[:, k] for k, name in enumerate(names)}
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


def _rolled(points, near, at):
    """Neighbours near[] of points at[] in their tangent planes: the direction of the projection, the distance
    in space; infinitely far those on another sheet."""
    u, v = tangents(points.normal[at])
    r = points.position[near] - points.position[at][:, None]
    flat = numpy.stack([numpy.einsum("nkc,nc->nk", r, u), numpy.einsum("nkc,nc->nk", r, v)], axis=2)
    distance = numpy.linalg.norm(r, axis=2)
    length = numpy.linalg.norm(flat, axis=2)
    same = numpy.einsum("nkc,nc->nk", points.normal[near], points.normal[at]) > OTHER_SIDE
    flat *= (distance / numpy.maximum(length, 1e-300))[:, :, None]
    return flat, distance, same


def _cells(points, near, at):
    """Of points at[] with neighbours near[]: signed lengths of the Voronoi edges, who ends them, areas, the
    distances, which of them are on the same sheet, and how far the cell reaches."""
    flat, distance, same = _rolled(points, near, at)
    end = CELL_END * points.spacing[at][:, None]
    dot = numpy.einsum("njc,nlc->njl", flat, flat)
    side = flat[:, :, None, 0] * flat[:, None, :, 1] - flat[:, :, None, 1] * flat[:, None, :, 0]
    side /= numpy.maximum(distance, 1e-300)[:, :, None]
    rest = 0.5 * (distance[:, None, :] ** 2 - dot)
    with numpy.errstate(divide="ignore", invalid="ignore"):
        cut = rest / side
    usable = same[:, None, :] & ~numpy.eye(near.shape[1], dtype=bool)[None]
    above = numpy.where(usable & (side > 0), cut, numpy.inf)
    below = numpy.where(usable & (side < 0), cut, -numpy.inf)
    between = (usable & (side == 0) & (rest < 0)).any(axis=2)  # somebody stands in the way
    high_by, low_by = above.argmin(axis=2), below.argmax(axis=2)
    high = numpy.minimum(numpy.take_along_axis(above, high_by[:, :, None], 2)[:, :, 0], end)
    low = numpy.maximum(numpy.take_along_axis(below, low_by[:, :, None], 2)[:, :, 0], -end)
    signed = numpy.where(same & ~between, high - low, -numpy.inf)
    open_end = (high == end) | (low == -end)
    length = numpy.maximum(signed, 0)
    area = 0.25 * (distance * length).sum(axis=1)
    corner = numpy.where(length > 0, numpy.hypot(0.5 * distance, numpy.maximum(high, -low)), 0).max(axis=1)
    rows = numpy.arange(len(at))[:, None]
    cutters = numpy.where(open_end, -1, near[rows, high_by]), numpy.where(open_end, -1, near[rows, low_by])
    return signed, cutters, area, distance, same, corner


@dataclasses.dataclass
class Pairs:
    """Each i < j once: distance, and the mean signed length of their Voronoi edge (-inf: far apart)."""
    i: numpy.ndarray
    j: numpy.ndarray
    distance: numpy.ndarray
    edge: numpy.ndarray
    joined: numpy.ndarray


def _gather(points, support):
    """Every close pair as seen from both ends, and the areas; `support`: how far pairs must be known."""
    tree = cKDTree(points.position)
    area = numpy.zeros(points.count)
    seen = []
    todo = numpy.arange(points.count)
    for most in NEIGHBOURS:
        most = min(most, points.count - 1)
        again = []
        for at in numpy.array_split(todo, max(1, len(todo) * (most // NEIGHBOURS[0]) ** 2 // CHUNK)):
            near = tree.query(points.position[at], most + 1)[1]
            near = _without_self(near, at)
            signed, cutters, cell, distance, same, corner = _cells(points, near, at)
            known = distance[:, -1] >= numpy.maximum(2 * corner, support[at])
            last = most in (NEIGHBOURS[-1], points.count - 1)
            done = known | last
            again.append(at[~done])
            area[at[done]] = cell[done]
            keep = same & done[:, None] & ((signed > -FAR * points.spacing[at][:, None]) |
                                           (distance <= support[at].max()))
            rows = numpy.broadcast_to(at[:, None], near.shape)
            seen.append([a[keep] for a in (rows, near, distance, signed, *cutters)])
        todo = numpy.concatenate(again)
        if not len(todo):
            break
    return area, [numpy.concatenate(column) for column in zip(*seen)]


def _without_self(near, at):
    """The lists without the point itself, which twins may have pushed off the first place."""
    own = near == at[:, None]
    own[~own.any(axis=1), -1] = True
    return near[~own].reshape(len(at), -1)


def find_pairs(points, support):
    """Pairs with their Voronoi edges, and every point's Voronoi area."""
    area, (i, j, distance, signed, high_by, low_by) = _gather(points, support)
    n = points.count
    key = numpy.minimum(i, j) * n + numpy.maximum(i, j)
    order = numpy.lexsort((i > j, key))
    key, i, j, distance, signed = key[order], i[order], j[order], distance[order], signed[order]
    high_by, low_by = high_by[order], low_by[order]
    first = numpy.flatnonzero(numpy.r_[True, key[1:] != key[:-1]])
    twice = numpy.r_[first[1:], len(key)] - first == 2
    other = numpy.where(twice, numpy.minimum(first + 1, len(key) - 1), first)
    edge = numpy.where(twice, 0.5 * (signed[first] + signed[other]), -numpy.inf)
    pairs = Pairs(numpy.minimum(i, j)[first], numpy.maximum(i, j)[first], distance[first], edge, edge > 0)
    _settle_doubts(points, pairs, key[first], high_by[first], low_by[first])
    return pairs, area


def _settle_doubts(points, pairs, key, c, d):
    """Four points nearly on a circle, seen in four planes: ab is joined when its edge is the longer."""
    n = points.count
    doubt = numpy.flatnonzero((numpy.abs(pairs.edge) < DOUBT * points.spacing[pairs.i]) & (c >= 0) & (d >= 0))
    c, d = c[doubt], d[doubt]
    opponent = numpy.minimum(c, d) * n + numpy.maximum(c, d)
    place = numpy.minimum(numpy.searchsorted(key, opponent), len(key) - 1)
    rival = numpy.where(key[place] == opponent, pairs.edge[place], -numpy.inf)
    own = pairs.edge[doubt]
    pairs.joined[doubt] = (own > rival) | ((own == rival) & (key[doubt] < opponent))


def _variation(values):
    return float(values.std() / values.mean()) if len(values) else float("nan")


def measure(points, area, domain=None):
    """The quality measures by their names in report.json, from the points and the surface's true area.

    domain: (low, high) corners of the box whose faces cut the surface; points within 2 h of it are left out.
    Beside them `degree`, `cell` (Voronoi areas), `local` (spacing), `component` (number of each point's
    part), `pairs`, `h` and `rim`, for further questions."""
    n, h = points.count, ideal_spacing(area, points.count)
    graded = points.spacing.max() > 1.05 * points.spacing.min() and points.alpha.std() == 0
    support = numpy.sqrt(3) * (points.spacing if graded else numpy.full(n, h))
    pairs, cell = find_pairs(points, support)
    i, j = pairs.i, pairs.j
    rim = numpy.zeros(n, bool)
    if domain is not None:
        low, high = numpy.asarray(domain[0]) + 2 * h, numpy.asarray(domain[1]) - 2 * h
        rim = ((points.position < low) | (points.position > high)).any(axis=1)
    inner = ~rim
    relative = pairs.distance / (0.5 * (points.spacing[i] + points.spacing[j]))
    degree = numpy.bincount(i[pairs.joined], minlength=n) + numpy.bincount(j[pairs.joined], minlength=n)
    own = pairs.joined & inner[i] & inner[j]
    phi = 0.5 * (points.alpha[i] + points.alpha[j]) * cotangent(pairs.distance / (0.5 * (support[i] + support[j])))
    energy = numpy.bincount(i, phi, n) + numpy.bincount(j, phi, n)
    local = numpy.sqrt(2 * cell / numpy.sqrt(3))
    sized = inner & (local > 0)
    graph = coo_matrix((numpy.ones(pairs.joined.sum()), (i[pairs.joined], j[pairs.joined])), (n, n))
    reach = inner[i] | inner[j]
    slope = numpy.polyfit(numpy.log(points.spacing[sized]), numpy.log(local[sized]), 1)[0] if \
        points.spacing.max() > 1.05 * points.spacing.min() else 1.0
    return {
        "count": n, "h": h, "rim_count": int(rim.sum()),
        "hex_fraction": float((degree[inner] == 6).mean()),
        "edge_cv": _variation(relative[own]),
        "area_cv": _variation((cell / points.spacing ** 2)[inner]),
        "energy_excess": float(energy[inner].sum() / points.alpha[inner].sum() / E_IDEAL - 1),
        "min_spacing_ratio": float(relative[reach].min()),
        "euler": float((6 - degree).sum() / 6),
        "grading_cv": _variation((local / points.spacing)[inner]),
        "grading_exponent": float(slope),
        "degree": degree, "cell": cell, "local": local, "pairs": pairs, "rim": rim,
        "component": csgraph.connected_components(graph, directed=False)[1],
    }
