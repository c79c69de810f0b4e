#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Samples open and sharp-edged surfaces, holds the points against the triangles, and writes a row
for each surface (measurements/meshes/patches.csv).

    measurements/meshes/patches.py --worker build/hexad-worker --output measurements/meshes/patches.csv [--data DIRECTORY] [--only WORD ...]
                     [--seeds 5] [--count 10000] [--pictures DIRECTORY]

DIRECTORY, or HEXAD_SHARED, has the folder meshes. cases() says what is sampled; each figure is the median over the seeds, and
the bounds are AT_MOST and AT_LEAST. Ends with 1 when one is missed. Shares no code with the sampler; hex_fraction and the variations
are the report's.
"""
import dataclasses
import json
import os
import pathlib
import resource
import shutil
import subprocess
import sys
import tempfile

import numpy
from scipy.spatial import cKDTree

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1] / folder) for folder in ("common", "inputs")]
import features  # noqa: E402
import inputs  # noqa: E402
import measure  # noqa: E402
import meshes  # noqa: E402
import results  # noqa: E402

# Edges bent by more are sharp, radians.
SHARP = 0.7
# Places on a mesh, and of an edge of mesh.ply what is near, in spacings.
PLACES, NEAR = 40000, 0.6
# What a case may come to: at most, or at least.
AT_MOST = {"off": 1e-6, "place": 1.0, "open": 0.8, "cv": 0.02, "row": 0.8, "wrong": 0, "hausdorff": 0.15, "graded": 0.02}
AT_LEAST = {"hex": 0.95}


@dataclasses.dataclass
class Case:
    name: str
    surface: dict          # of the spec
    mesh: meshes.Mesh      # that the points are held against
    bounds: tuple          # names of AT_MOST and AT_LEAST that hold here
    spec: dict = dataclasses.field(default_factory=dict)  # members beside
    is_mesh: bool = True   # the points are to be on these triangles, which are no stand-in of a formula
    at_least: float = AT_LEAST["hex"]


# ---- shapes

SQUARE = numpy.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])


def write(mesh, path):
    path.write_text("\n".join([f"OFF\n{len(mesh.vertices)} {len(mesh.triangles)} 0"] +
                              ["%r %r %r" % tuple(v) for v in mesh.vertices.tolist()] +
                              ["3 %d %d %d" % tuple(t) for t in mesh.triangles]) + "\n")
    return path


def grid(place, across, along, wrap=()):
    """Triangles over the unit square, cut into so many parts, whose places are place(u, v)."""
    u, v = (g.ravel() for g in numpy.meshgrid(numpy.arange(across + 1) / across, numpy.arange(along + 1) / along, indexing="ij"))
    index = numpy.arange(len(u)).reshape(across + 1, along + 1)
    a, b, c, d = (x.ravel() for x in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    return numpy.round(place(u, v), 12), numpy.concatenate([numpy.stack([a, b, c], 1), numpy.stack([a, c, d], 1)])


def joined(*parts):
    count = numpy.cumsum([0] + [len(v) for v, _ in parts])
    return meshes.Mesh(numpy.concatenate([v for v, _ in parts]), numpy.concatenate([t + n for (_, t), n in zip(parts, count)]))


def prism(outline, bottom, top):
    """A star-shaped outline (n, 2) about the origin, between two heights: functions of the place."""
    n = len(outline)
    low, high = (numpy.c_[outline, [level(*p) for p in outline]] for level in (bottom, top))
    vertices = numpy.concatenate([low, high, [[0, 0, bottom(0, 0)], [0, 0, top(0, 0)]]])
    k, m = numpy.arange(n), (numpy.arange(n) + 1) % n
    triangles = [numpy.stack(t, 1) for t in ((k, m, m + n), (k, m + n, k + n), (m, k, 0 * k + 2 * n), (k + n, m + n, 0 * k + 2 * n + 1))]
    return meshes.Mesh(vertices, numpy.concatenate(triangles))


def star():
    """The outline of a square and of one that is turned by an eighth."""
    angle = numpy.pi / 8 * numpy.arange(16)
    inner = 1 / numpy.cos(numpy.pi / 8)
    return numpy.where(numpy.arange(16) % 2, inner, 2 ** 0.5)[:, None] * numpy.stack([numpy.cos(angle + numpy.pi / 4),
                                                                                  numpy.sin(angle + numpy.pi / 4)], 1)


def circle(count):
    angle = 2 * numpy.pi * numpy.arange(count) / count
    return numpy.stack([numpy.cos(angle), numpy.sin(angle)], 1)


def moebius(u, v):
    angle, half = 2 * numpy.pi * u, 0.6 * (v - 0.5)
    # the last column is the first upside down
    return numpy.stack([(1 + half * numpy.cos(angle / 2)) * numpy.cos(angle), (1 + half * numpy.cos(angle / 2)) * numpy.sin(angle),
                        half * numpy.sin(angle / 2)], 1)


def klein(u, v):
    a, b = 2 * numpy.pi * u, 2 * numpy.pi * v
    out = 2 + numpy.cos(a / 2) * numpy.sin(b) - numpy.sin(a / 2) * numpy.sin(2 * b)
    return numpy.stack([out * numpy.cos(a), out * numpy.sin(a), numpy.sin(a / 2) * numpy.sin(b) + numpy.cos(a / 2) * numpy.sin(2 * b)], 1)


def sheet(*sides):
    origin, first, second = (numpy.array(s, float) for s in sides)
    return grid(lambda u, v: origin + u[:, None] * first + v[:, None] * second, 8, 8)


def flipped(mesh):
    """Half of its triangles the other way round."""
    turn = numpy.random.default_rng(3).random(len(mesh.triangles)) < 0.5
    return meshes.Mesh(mesh.vertices, numpy.where(turn[:, None], mesh.triangles[:, ::-1], mesh.triangles))


def write_map(mesh, path, ratio=5):
    """Spacings `ratio` times as wide at one end of the longest side as at the other."""
    import pyopenvdb
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    voxel, axis = float((high - low).max() / 64), int((high - low).argmax())
    size = numpy.ceil((high - low) / voxel).astype(int) + 9
    at = (numpy.arange(size[axis]) - 4) * voxel / (high - low)[axis]
    values = numpy.broadcast_to((1 + (ratio - 1) * numpy.clip(at, 0, 1)).reshape([-1 if k == axis else 1 for k in range(3)]), size)
    made = pyopenvdb.FloatGrid(1.0)
    made.copyFromArray(numpy.ascontiguousarray(values, numpy.float32), ijk=(-4, -4, -4))
    made.transform = pyopenvdb.createLinearTransform(voxelSize=voxel)
    made.transform.translate(low.tolist())
    made.name = "spacing"
    pyopenvdb.write(str(path), grids=[made])
    return {"path": str(path), "name": "spacing"}


def of_file(path, **members):
    return {"mesh": {"path": str(path), **members}}


ON = ("off", "place", "open", "wrong")
SHARP_ON = (*ON, "cv", "row", "hausdorff", "hex")
OPEN = ("stanford-bunny.obj", "suzanne.obj", "teapot.obj", "alligator_flat.obj", "plane_holes.obj", "truck.obj", "cycloidal.ply",
        "soup.stl", "busted.STL", "multibody.stl")


def as_it_is(path):
    hexes = ("hex",) if path.name == "stanford-bunny.obj" else ()
    return Case(path.name, of_file(path), meshes.read(path), (*ON, *hexes), at_least=0.94)


def of_formula(name, surface, mesh):
    return Case(f"{name} by formula", surface, mesh, SHARP_ON, {"features": True}, is_mesh=False)


def of_shape(name, mesh, work, bounds, **members):
    return Case(name, of_file(write(mesh, work / "shape.off"), **members), mesh, bounds)


def amplitudes(path, count):
    return Case(f"{path.name} by amplitudes", of_file(path), meshes.read(path), ("off", "converged"),
                {"sampling": {"count": count, "alpha": {"d": 2}}, "solver": {"method": "paper"}})


def graded(name, path, mesh, count, work):
    return Case(f"{name} graded", of_file(path), mesh, ("off", "place", "graded"),
                {"sampling": {"count": count, "grid": write_map(mesh, work / "map.vdb")}})


def cases(data, work, count):
    """(name, what makes the case) of each; what is made lies in `work`, where the next one's takes its place."""
    folder, eighth = data / "meshes", 0.5 ** 0.5
    for name in OPEN:
        yield name, lambda: as_it_is(folder / name)
    yield "fandisk.off", lambda: Case("fandisk.off", of_file(folder / "fandisk.off", features={}), meshes.read(folder / "fandisk.off"),
                                      SHARP_ON)
    box = {"analytic": {"shape": "box", "center": [0, 0, 0], "half_size": [1, 1, 1]}}
    turned = {"transform": {"surface": box, "matrix": [eighth, -eighth, 0, 0, eighth, eighth, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}}
    cut = {"difference": [{"analytic": {"shape": "cylinder", "radius": 1, "height": 3, "center": [0, 0, 0]}},
                          {"analytic": {"shape": "halfspace", "center": [0, 0, 0.5], "axis": [0, -1, -2]}}]}
    for name, surface, mesh in (("cube", box, prism(SQUARE, lambda x, y: -1, lambda x, y: 1)),
                                ("crossed cubes", {"union": [box, turned]}, prism(star(), lambda x, y: -1, lambda x, y: 1)),
                                ("cut cylinder", cut, prism(circle(720), lambda x, y: -1.5, lambda x, y: 0.5 - y / 2))):
        yield f"{name} by formula", lambda: of_formula(name, surface, mesh)
        yield f"{name} by mesh", lambda: of_shape(f"{name} by mesh", mesh, work, SHARP_ON, features={})
    spacing = measure.ideal_spacing(2, count)
    blade = prism(SQUARE, lambda x, y: -1, lambda x, y: 1)
    blade = meshes.Mesh(blade.vertices * [0.5, 0.05, 0.00005], blade.triangles)
    for name, mesh in (("Moebius strip", joined(grid(moebius, 160, 16))), ("Klein bottle", joined(grid(klein, 160, 80))),
                       ("three half-planes at an edge", joined(*(sheet([0, 0, 0], [0, 0, 1], [numpy.cos(a), numpy.sin(a), 0])
                                                            for a in (0, 2, 4)))),
                       ("two squares .3 spacings apart", joined(*(sheet([0, 0, z], [1, 0, 0], [0, 1, 0])
                                                                 for z in (0, 0.3 * spacing))))):
        yield name, lambda: of_shape(name, mesh, work, ON)
    bottle = joined(grid(klein, 160, 80))
    yield "Klein bottle with features", lambda: of_shape("Klein bottle with features", bottle, work, ON, features={})
    yield "blade", lambda: of_shape("blade", blade, work, ON, features={})
    yield "half flipped", lambda: of_shape("half flipped", flipped(meshes.read(folder / "spot.obj")), work, ON)
    for name in ("fandisk.off", "wingnut.obj", "cup.obj"):
        yield f"{name} by amplitudes", lambda: amplitudes(folder / name, count)
    for name in ("busted.STL", "soup.stl"):
        yield f"{name} graded", lambda: graded(name, folder / name, meshes.read(folder / name), count, work)
    mesh = lambda: flipped(meshes.read(folder / "spot.obj"))  # noqa: E731
    yield "half flipped graded", lambda: graded("half flipped", write(mesh(), work / "shape.off"), mesh(), count, work)


# ---- measures

def edges_of(mesh):
    """(open, crowded, sharp): pairs of vertices of edges of one triangle, of three and more, and of two that are bent."""
    edge = numpy.sort(mesh.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = numpy.repeat(numpy.arange(len(mesh.triangles)), 3)
    turn = numpy.where(mesh.triangles[:, [0, 1, 2]].ravel() < mesh.triangles[:, [1, 2, 0]].ravel(), 1, -1)
    one, first, where, uses = numpy.unique(edge, axis=0, return_index=True, return_inverse=True, return_counts=True)
    order = numpy.argsort(where, kind="stable")
    begin = numpy.cumsum(uses) - uses
    two = numpy.flatnonzero(uses == 2)
    a, b = order[begin[two]], order[begin[two] + 1]
    cosine = (mesh.normals[owner[a]] * mesh.normals[owner[b]]).sum(axis=1) * -turn[a] * turn[b]
    return one[uses == 1], one[uses > 2], one[two[cosine < numpy.cos(SHARP)]]


class Lines:
    """Distances from segments, and places on them."""

    def __init__(self, mesh, edge, step):
        self.from_, self.to = mesh.vertices[edge[:, 0]], mesh.vertices[edge[:, 1]]
        parts = 1 + numpy.ceil(numpy.linalg.norm(self.to - self.from_, axis=1) / step).astype(int)
        self.owner = numpy.repeat(numpy.arange(len(edge)), parts)
        k = numpy.arange(len(self.owner)) - numpy.repeat(numpy.cumsum(parts) - parts, parts)
        share = (k / numpy.maximum(parts[self.owner] - 1, 1))[:, None]
        self.place = self.from_[self.owner] + share * (self.to - self.from_)[self.owner]

    def distance(self, points):
        if len(self.place) == 0:
            return numpy.full(len(points), numpy.inf)
        near = self.owner[cKDTree(self.place).query(points, min(8, len(self.place)))[1].reshape(len(points), -1)]
        best = numpy.full(len(points), numpy.inf)
        for k in near.T:
            side, r = self.to[k] - self.from_[k], points - self.from_[k]
            t = numpy.clip((r * side).sum(axis=1) / numpy.maximum((side * side).sum(axis=1), 1e-300), 0, 1)
            best = numpy.minimum(best, numpy.linalg.norm(r - t[:, None] * side, axis=1))
        return best


def largest(mesh, points):
    return mesh.farthest(points, numpy.ones(len(points)))


def farthest(place, points, which):
    """The largest distance of the places from the nearest of some points, in the spacings requested there."""
    if len(place) == 0 or not which.any():
        return None if len(place) == 0 else numpy.inf
    away, nearest = cKDTree(points.position[which]).query(place)
    return float((away / points.spacing[which][nearest]).max())


def examine(case, report, points, made, diagonal):
    """Every figure by its name; None: there is nothing to measure."""
    mesh, q = case.mesh, report["quality"]
    feature = points.columns.get("feature", numpy.zeros(points.count)).astype(int)
    step = float(points.spacing.min()) / 4
    opened, crowded, sharp = edges_of(mesh)
    rims = Lines(mesh, opened, step)
    off = largest(mesh, points.position) / diagonal if case.is_mesh else q["max_residual"] * report["spacing"] / diagonal
    place = meshes.places(mesh, PLACES)[0]
    found = {"off": off, "place": farthest(place, points, feature >= 0), "open": farthest(rims.place, points, feature >= 0),
             "hex": q["hex_fraction"], "cv": report["curves"]["edge_cv"] if "curves" in report else None,
             "row": farthest(Lines(mesh, sharp, step).place, points, feature > 0) if "row" in case.bounds else None,
             "graded": q["grading"]["cv"] if "graded" in case.bounds else None}
    loose, many, _ = edges_of(made)
    middle = [made.vertices[e].mean(axis=1) for e in (loose, many)]
    near = NEAR * points.spacing.max()
    found["wrong"] = int((rims.distance(middle[0]) > near).sum() + (Lines(mesh, crowded, step).distance(middle[1]) > near).sum())
    there = meshes.places(made, PLACES)[0]
    found["hausdorff"] = max(largest(made, place), largest(mesh, there)) / report["spacing"]
    return found


def run(case, worker, count, seed, work):
    spec = {"version": 1, "surface": case.surface, "sampling": {"count": count}, **case.spec}
    spec["solver"] = {"threads": 1, "seed": seed, **case.spec.get("solver", {})}
    spec["output"] = {"mesh": True, "ply": {"precision": "double", "properties": ["all"]}}
    (work / "spec.json").write_text(json.dumps(spec))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([worker, "run", work / "spec.json", "--output", work / "out"], text=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 10, 11):
        return done.stderr.strip()[-300:], None
    report = json.loads((work / "out" / "report.json").read_text())
    made = meshes.Mesh(*features.read_result(work / "out" / "mesh.ply"))
    diagonal = float(numpy.linalg.norm(numpy.ptp(case.mesh.vertices, axis=0)))
    found = examine(case, report, measure.read_ply(work / "out" / "points.ply"), made, diagonal)
    found["cpu"] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    found["unresolved"] = 100 * report["quality"]["thin_count"] / report["count"]
    reasons = [reason["criterion"] for reason in report["outcome_reasons"]]
    return (report["outcome"].replace("_", " ") + (f" ({', '.join(reasons)})" if reasons else "")), found


# ---- the table

COLUMNS = (("unresolved", "thin_percent", ".2f"), ("off", "off_mesh_per_diagonal", ".0e"), ("place", "coverage_spacings", ".2f"),
           ("open", "open_edges_spacings", ".2f"), ("row", "sharp_edges_spacings", ".2f"), ("hex", "hex_fraction", ".3f"),
           ("cv", "curve_edge_cv", ".4f"), ("graded", "grading_cv", ".3f"), ("wrong", "wrong_edges", "g"),
           ("hausdorff", "hausdorff_spacings", ".2f"), ("cpu", "cpu_s", ".1f"))
HEADER = ("surface", "outcome", *(name for _, name, _ in COLUMNS), "missed")


def row(case, found):
    """A row of HEADER: medians of the runs, and the names of the columns that miss a bound."""
    outcomes = [outcome for outcome, _ in found]
    counts = "; ".join(f"{outcomes.count(o)} {o}" for o in dict.fromkeys(outcomes))
    good = [figures for _, figures in found if figures]
    bad = len(good) < len(found) or ("converged" in case.bounds and any(o != "converged" for o in outcomes))
    cells, missed = [case.name, counts], ["outcome"] if bad else []
    for name, column, form in COLUMNS:
        values = [figures[name] for figures in good if figures[name] is not None]
        if not values:
            cells.append("")
            continue
        value = float(numpy.median(values))
        if name in case.bounds and (value > AT_MOST[name] if name in AT_MOST else value < case.at_least):
            missed.append(column)
        cells.append(format(value, form))
    return [*cells, " ".join(missed)]


def table(options):
    """Rows of HEADER, each printed as soon as it is known."""
    rows = []
    with tempfile.TemporaryDirectory() as where:
        work = pathlib.Path(where)
        for name, make in cases(pathlib.Path(options.data), work, options.count):
            if options.only and not any(word in name for word in options.only):
                continue
            case = make()
            found = [run(case, os.path.abspath(options.worker), options.count, seed, work) for seed in range(1, options.seeds + 1)]
            if options.pictures and found[-1][1]:
                pathlib.Path(options.pictures).mkdir(parents=True, exist_ok=True)
                shutil.copy(work / "out" / "preview.png", pathlib.Path(options.pictures) / f"{case.name}.png")
            rows.append(row(case, found))
            results.write(options.output, HEADER, rows)
            print(*rows[-1], sep=", ", flush=True)
    return rows


def main():
    parser = inputs.parser_of(__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--count", type=int, default=10000)
    parser.add_argument("--pictures", help="a directory for the previews")
    options = inputs.arguments(parser)
    rows = table(options)
    missed = [f"{name}: {columns}" for name, *_, columns in rows if columns]
    print(f"{len(rows)} surfaces, {len(missed)} of them miss bounds", *missed, sep="\n")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
