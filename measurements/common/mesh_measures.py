# SPDX-License-Identifier: Apache-2.0
"""Measures of points on a triangle mesh, as doc/report.md defines them, by brute force: the mesh is cut into small triangles, each of
which belongs to the Voronoi cell of its nearest point. Shares no code with the sampler.

Limits. Edges of the small triangles are at most FINENESS spacings, so coverage may be too low by about that much, and a cell's side
shorter than that may be missed or added. Pieces without an orientation (Moebius strips) get an arbitrary one. Of a closed mesh of several
pieces only the parts count that bound the union of its solids: places with one side inside and one outside, by winding numbers.
"""
import dataclasses

import numpy
from scipy.sparse import coo_matrix, csgraph
from scipy.spatial import cKDTree

import meshes

# Longest edge of the small triangles, in spacings; longer ones where there would be more than MOST_PLACES.
FINENESS, MOST_PLACES = 0.12, 1500000
# Bounds of the definitions.
OPPOSITE, MISSING, CLOSE, COINCIDENT = -0.4, 1.2, 0.25, 1e-3
# A point lies on the triangles that are within this distance, in spacings. Degrees within HALF of an integer are that integer.
ON_SURFACE, HALF = 1e-3, 0.2
# Nearest points of a place, and nearest small triangles of a point, that are looked at.
NEAREST, NEAREST_PLACES = (8, 64), 40
# Both sides of a triangle are looked at this far from it, of the mesh's extent.
SIDE = 1e-5
# Lines run along the last axis of a mesh that is turned, so that they meet no edges; triangles are sorted into squares across it, at most
# this many along an axis. Places that are tested at a time.
MOST_SQUARES, AT_ONCE = 256, 20000


@dataclasses.dataclass
class MeshMeasures:
    coverage: float
    missing_share: float
    hex_fraction: float
    edge_cv: float
    area_cv: float
    min_spacing_ratio: float
    close_share: float
    coincident: int
    parts_without_points: int
    empty_area_share: float
    unmeasured_share: float
    max_residual: float
    degree: numpy.ndarray
    ideal_degree: numpy.ndarray  # before rounding

    def failed(self):
        """The criteria of the outcome that these measures fail."""
        bounds = (("coverage", self.coverage, MISSING), ("missing_share", self.missing_share, 0.01),
                  ("close_share", self.close_share, 0.01), ("coincident", self.coincident, 0),
                  ("parts_without_points", self.empty_area_share, 0.01), ("unmeasured_share", self.unmeasured_share, 0.1))
        return [name for name, value, bound in bounds if value > bound]


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


# ---- triangles

def edges_of(triangles):
    """Of each triangle the numbers of its edges (n, 3), edge k between the corners k and k + 1; and of each edge its two vertices."""
    ends = numpy.sort(numpy.stack([triangles, numpy.roll(triangles, -1, axis=1)], axis=2), axis=2)
    key = ends[..., 0].astype(numpy.int64) * (triangles.max() + 1) + ends[..., 1]
    found, number = numpy.unique(key, return_inverse=True)
    return number.reshape(-1, 3), numpy.stack(numpy.divmod(found, triangles.max() + 1), axis=1)


def pairs_across(number):
    """Pairs of triangles that share an edge, and the edge."""
    edge = number.ravel()
    order = numpy.argsort(edge, kind="stable")
    triangle, edge = order // 3, edge[order]
    pairs, many = [], numpy.bincount(edge).max()
    for step in range(1, many):
        same = edge[step:] == edge[:-step]
        pairs.append(numpy.stack([triangle[:-step][same], triangle[step:][same], edge[step:][same]], axis=1))
    return numpy.concatenate(pairs) if pairs else numpy.zeros((0, 3), int)


def pieces_of(triangles):
    number, _ = edges_of(triangles)
    i, j, _ = pairs_across(number).T
    n = len(triangles)
    return csgraph.connected_components(coo_matrix((numpy.ones(len(i)), (i, j)), (n, n)), directed=False)[1]


def oriented(mesh, piece):
    """Normals of the triangles, turned to agree with each other within each piece."""
    triangles = mesh.triangles
    number, _ = edges_of(triangles)
    pair = pairs_across(number)
    pair = pair[numpy.bincount(number.ravel())[pair[:, 2]] == 2]
    forward = triangles < numpy.roll(triangles, -1, axis=1)  # the direction in which a triangle runs along its edge
    runs = {}
    for side in (0, 1):
        k = (number[pair[:, side]] == pair[:, 2:3]).argmax(axis=1)
        runs[side] = forward[pair[:, side], k]
    against = runs[0] == runs[1]
    n = len(triangles)
    graph = coo_matrix((1.0 + against, (pair[:, 0], pair[:, 1])), (n, n)).tocsr()
    graph = graph.maximum(graph.T)
    turned = numpy.zeros(n, bool)
    for first in numpy.unique(piece, return_index=True)[1]:
        order, before = csgraph.breadth_first_order(graph, first, directed=False)
        weight = numpy.asarray(graph[before[order[1:]], order[1:]]).ravel() if len(order) > 1 else []
        for k, w in zip(order[1:], weight):
            turned[k] = turned[before[k]] ^ (w == 2)
    return numpy.where(turned[:, None], -mesh.normals, mesh.normals)


def cut(mesh, tree, spacing, fineness):
    """Vertices, small triangles, and the triangle of the mesh on which each lies. Edges are halved until none is longer than
    `fineness` spacings of the nearest point; both triangles of an edge are cut."""
    vertices, triangles, parent = mesh.vertices, mesh.triangles.astype(numpy.int64), numpy.arange(len(mesh.triangles))
    while True:
        number, ends = edges_of(triangles)
        way = vertices[ends[:, 1]] - vertices[ends[:, 0]]
        length = numpy.linalg.norm(way, axis=1)
        marked = length > fineness * spacing.min()
        some = numpy.flatnonzero(marked)
        marked[some] = length[some] > fineness * spacing[tree.query(vertices[ends[some]].mean(axis=1))[1]]
        if not marked.any():
            return vertices, triangles, parent
        longest = number[numpy.arange(len(number)), length[number].argmax(axis=1)]
        while True:
            more = longest[marked[number].any(axis=1)]
            if marked[more].all():
                break
            marked[more] = True
        middle = numpy.full(len(ends), -1)
        middle[marked] = len(vertices) + numpy.arange(marked.sum())
        vertices = numpy.concatenate([vertices, vertices[ends[marked]].mean(axis=1)])
        # the longest edge between the corners 0 and 1, and the other edges in order
        k = length[number].argmax(axis=1)
        turn = (k[:, None] + numpy.arange(3)) % 3
        corner, edge = numpy.take_along_axis(triangles, turn, 1), numpy.take_along_axis(number, turn, 1)
        whole = ~marked[edge[:, 0]]
        a, b, c = corner[~whole].T
        m, right, left = middle[edge[~whole]].T
        from_ = parent[~whole]
        done, owner = [triangles[whole]], [parent[whole]]
        for p, q, r, half in ((m, b, c, right), (c, a, m, left)):  # triangle p q r; `half`: the middle of q r, or of p q
            first = half < 0
            done.append(numpy.stack([p, q, r], axis=1)[first])
            owner.append(from_[first])
            p, q, r, h = p[~first], q[~first], r[~first], half[~first]
            two = ((p, q, h), (p, h, r)) if half is right else ((p, h, r), (h, q, r))
            for three in two:
                done.append(numpy.stack(three, axis=1))
                owner.append(from_[~first])
        triangles, parent = numpy.concatenate(done), numpy.concatenate(owner)


# ---- points on the mesh

def _corner_angles(corner):
    u, v = numpy.roll(corner, -1, axis=1) - corner, numpy.roll(corner, 1, axis=1) - corner
    return numpy.arctan2(numpy.linalg.norm(numpy.cross(u, v), axis=2), (u * v).sum(axis=2))


def touching(mesh, position, spacing, near):
    """Pairs of points and triangles of the mesh on which they lie, from candidates (n, k), and the angle of each there: pi of an
    edge, 2 pi within."""
    n, k = near.shape
    pair = numpy.unique(numpy.stack([numpy.repeat(numpy.arange(n), k), near.ravel()], axis=1), axis=0)
    corner = mesh.vertices[mesh.triangles[pair[:, 1]]]
    place, h = position[pair[:, 0]], spacing[pair[:, 0]]
    away = meshes.distance_to_triangles(place, corner)
    nearest = numpy.full(n, numpy.inf)
    numpy.minimum.at(nearest, pair[:, 0], away)
    on = away <= nearest[pair[:, 0]] + ON_SURFACE * h
    pair, corner, place, h = pair[on], corner[on], place[on], h[on]
    angle = numpy.full(len(pair), 2 * numpy.pi)
    for a in range(3):
        p, way = corner[:, a], corner[:, (a + 1) % 3] - corner[:, a]
        t = numpy.clip(((place - p) * way).sum(axis=1) / (way * way).sum(axis=1), 0, 1)
        beside = numpy.linalg.norm(place - p - t[:, None] * way, axis=1) <= ON_SURFACE * h + nearest[pair[:, 0]]
        angle[beside] = numpy.minimum(angle[beside], numpy.pi)
    at = numpy.linalg.norm(corner - place[:, None], axis=2) <= (ON_SURFACE * h + nearest[pair[:, 0]])[:, None]
    corners = _corner_angles(corner)
    some = at.any(axis=1)
    angle[some] = corners[some, at[some].argmax(axis=1)]
    return pair, angle


def normals_of(pair, normal, count):
    """Up to eight different normals of each point (n, 8, 3), repeated where there are fewer."""
    found = numpy.zeros((count, 8, 3))
    order = numpy.argsort(pair[:, 0], kind="stable")
    for some in numpy.split(order, numpy.flatnonzero(numpy.diff(pair[order, 0])) + 1):
        own = normal[pair[some, 1]]
        keep = numpy.unique(numpy.round(own, 3), axis=0, return_index=True)[1][:8]
        found[pair[some[0], 0]] = own[keep[numpy.arange(8) % len(keep)]]
    return found


def is_opposite(normals, normal):
    """Whether points with the normals (n, 8, 3) are of an opposite wall of places with the normals (n, 3)."""
    return numpy.einsum("nkc,nc->nk", normals, normal).max(axis=1) <= OPPOSITE


def owners(tree, spacing, normals, own_piece, place, normal, piece):
    """Of each place its nearest point of its piece that is not of an opposite wall (-1: none is near), and the distance over the spacing
    of the nearest point of any piece that is not of an opposite wall."""
    n = len(place)
    owner, away = numpy.full(n, -1), numpy.full(n, numpy.inf)
    todo = numpy.arange(n)
    for many in NEAREST:
        many = min(many, len(spacing))
        distance, near = tree.query(place[todo], many)
        distance, near = distance.reshape(len(todo), -1), near.reshape(len(todo), -1)
        for k in range(many):
            i = near[:, k]
            open_ = numpy.flatnonzero((owner[todo] < 0) | ~numpy.isfinite(away[todo]))
            if not len(open_):
                break
            fits = ~is_opposite(normals[i[open_]], normal[todo[open_]])
            these, by = todo[open_[fits]], i[open_[fits]]
            away[these] = numpy.minimum(away[these], distance[open_[fits], k] / spacing[by])
            own = (piece[these] == own_piece[by]) & (owner[these] < 0)
            owner[these[own]] = by[own]
        todo = todo[(owner[todo] < 0) | ~numpy.isfinite(away[todo])]
        if not len(todo) or many == len(spacing):
            break
    return owner, away


def _variation(values):
    return float(values.std() / values.mean()) if len(values) > 1 else float("nan")


def _close_pairs(tree, spacing, normals, piece):
    """Pairs of one piece that are not of opposite walls, within 1.5 of the largest spacing, and their distances over the mean spacing."""
    reach = 1.5 * spacing.max() if spacing.max() < 2 * spacing.min() else spacing.max() / 2
    i, j = tree.query_pairs(reach, output_type="ndarray").T
    facing = numpy.einsum("nkc,nlc->nkl", normals[i], normals[j]).max(axis=(1, 2)) if len(i) else numpy.zeros(0)
    keep = (piece[i] == piece[j]) & (facing > OPPOSITE)
    i, j = i[keep], j[keep]
    return i, j, numpy.linalg.norm(tree.data[i] - tree.data[j], axis=1) / (0.5 * (spacing[i] + spacing[j]))


def exposed(mesh, piece, place, normal):
    """Whether places bound the union of the solids of a closed mesh of several pieces; all places of others."""
    number, _ = edges_of(mesh.triangles)
    if piece.max() == 0 or (numpy.bincount(number.ravel()) % 2).any():
        return numpy.ones(len(place), bool)
    step, winding = SIDE * float(numpy.ptp(mesh.vertices, axis=0).max()), Winding(mesh)
    inside = [winding.at(place + sign * step * normal) != 0 for sign in (-1, 1)]  # shells may be inside out
    return inside[0] != inside[1]


def measure(mesh, position, spacing, fineness=FINENESS):
    """Of points whose requested spacings are `spacing`; `fineness`: the longest edge of the small triangles, in spacings."""
    n, tree = len(position), cKDTree(position)
    fineness = max(fineness, 2.5 * numpy.sqrt(mesh.area / MOST_PLACES) / spacing.mean())
    vertices, small, parent = cut(mesh, tree, spacing, fineness)
    while len(small) > MOST_PLACES:  # slivers give more than their area does
        fineness *= 1.5
        vertices, small, parent = cut(mesh, tree, spacing, fineness)
    corner = vertices[small]
    place = corner.mean(axis=1)
    area = 0.5 * numpy.linalg.norm(numpy.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    piece_of_triangle = pieces_of(mesh.triangles)
    normal_of_triangle = oriented(mesh, piece_of_triangle)
    seen = exposed(mesh, piece_of_triangle, place, mesh.normals[parent])

    near = parent[cKDTree(place).query(position, min(NEAREST_PLACES, len(place)))[1].reshape(n, -1)]
    pair, angle = touching(mesh, position, spacing, near)
    normals = normals_of(pair, normal_of_triangle, n)
    angles = numpy.bincount(pair[:, 0], numpy.minimum(angle, 2 * numpy.pi), n)
    whole = numpy.zeros(n, bool)  # within a triangle
    whole[pair[angle == 2 * numpy.pi, 0]] = True
    angles[whole] = 2 * numpy.pi
    own_piece = numpy.zeros(n, int)
    own_piece[pair[:, 0]] = piece_of_triangle[pair[:, 1]]

    owner, away = owners(tree, spacing, normals, own_piece, place, normal_of_triangle[parent], piece_of_triangle[parent])
    distance, nearest = tree.query(place[seen])

    number, ends = edges_of(small)
    across = pairs_across(number)
    border = numpy.bincount(number.ravel())[number] == 1
    on_border = numpy.zeros(n, bool)
    at_border = owner[border.any(axis=1)]
    on_border[at_border[at_border >= 0]] = True  # the cell has a side on the border
    many = numpy.zeros(n, bool)  # on an edge of three and more faces
    owned = owner[across[:, :2]]
    met = (owned[:, 0] != owned[:, 1]) & (owned >= 0).all(axis=1)
    neighbours = numpy.unique(numpy.sort(owned[met], axis=1), axis=0)
    degree = numpy.bincount(neighbours.ravel(), minlength=n)

    ideal = 3 * angles / numpy.pi
    faces = numpy.bincount(pair[angle == numpy.pi, 0], minlength=n)
    many = (faces >= 3) & ~whole
    # the point itself lies on the border if its angle is not closed
    lies_on_border = on_border & (_edge_borders(mesh, position, spacing, pair) > 0)
    ideal = ideal + lies_on_border
    middle = numpy.abs(ideal - numpy.round(ideal)) > HALF
    good = numpy.where(middle, (degree == numpy.floor(ideal)) | (degree == numpy.ceil(ideal)), degree == numpy.round(ideal))
    good = numpy.where(many, degree >= 6, good)

    i, j = neighbours.T
    length = numpy.linalg.norm(position[i] - position[j], axis=1) / (0.5 * (spacing[i] + spacing[j]))
    cell = numpy.bincount(owner[owner >= 0], area[owner >= 0], n) / spacing ** 2 / (angles / (2 * numpy.pi))
    a, b, ratio = _close_pairs(tree, spacing, normals, own_piece)
    close = numpy.unique(numpy.concatenate([a[ratio < CLOSE], b[ratio < CLOSE]]))
    coincident = numpy.unique(numpy.concatenate([a[ratio < COINCIDENT], b[ratio < COINCIDENT]]))
    h = spacing[tree.query(place)[1]]
    room = numpy.bincount(piece_of_triangle[parent], seen * area / (numpy.sqrt(0.75) * h ** 2))
    empty = (numpy.bincount(own_piece, minlength=len(room)) == 0) & (room > 1)
    return MeshMeasures(
        coverage=float((distance / spacing[nearest]).max()),
        missing_share=float(area[seen & (away > MISSING)].sum() / area[seen].sum()),
        hex_fraction=float(good.mean()), edge_cv=_variation(length), area_cv=_variation(cell),
        min_spacing_ratio=float(ratio.min()) if len(ratio) else float("nan"),
        close_share=len(close) / n, coincident=len(coincident), parts_without_points=int(empty.sum()),
        empty_area_share=float(area[seen & empty[piece_of_triangle[parent]]].sum() / area[seen].sum()),
        unmeasured_share=float((degree < 3 - on_border).mean()), max_residual=mesh.farthest(position, spacing),
        degree=degree, ideal_degree=ideal)


def _edge_borders(mesh, position, spacing, pair):
    """Of each point the number of border edges on which it lies."""
    number, _ = edges_of(mesh.triangles)
    border = numpy.bincount(number.ravel())[number] == 1
    found = numpy.zeros(len(position))
    for k in range(3):
        some = pair[border[pair[:, 1], k]]
        p = mesh.vertices[mesh.triangles[some[:, 1], k]]
        way = mesh.vertices[mesh.triangles[some[:, 1], (k + 1) % 3]] - p
        t = numpy.clip(((position[some[:, 0]] - p) * way).sum(axis=1) / (way * way).sum(axis=1), 0, 1)
        beside = numpy.linalg.norm(position[some[:, 0]] - p - t[:, None] * way, axis=1) <= ON_SURFACE * spacing[some[:, 0]]
        found += numpy.bincount(some[beside, 0], minlength=len(position))
    return found
