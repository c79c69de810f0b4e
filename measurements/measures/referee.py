#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The referee: recomputes from points.ply, report.json and the paper's equations what the worker reports.

    measurements/measures/referee.py [--worker build/hexad-worker] [--output measurements/measures/referee.csv] [--seeds 5] [--directory DIR]

Shares no code with the sampler. Surfaces are formulas and cubic splines written down here and in surfaces.py; sums over
pairs are made with numpy from equations (3), (6), (7), (10), (12), (13) and (14) and from what doc/method.md adds to them
(facing weights, and the turning of the normal that goes with them). A row of the CSV has the worst of the seeds for one surface and method.
"""
import argparse
import dataclasses
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy
from scipy.spatial import cKDTree

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import levelsets  # noqa: E402
import measure  # noqa: E402
import results as csv_results  # noqa: E402
import surfaces  # noqa: E402

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "examples"

# Facing weights: whole up to the second cosine, nothing from the first on (doc/method.md).
FACING_NONE, FACING_WHOLE = -0.8, -0.5
# Steps are compared away from edges, where all normals within the support have a larger cosine with a particle's own, and
# at least RIM spacings from a face that cuts the surface.
SMOOTH, RIM = 0.8, 2
# A curvature jumps where it differs by JUMPS of the largest from that at JUMP spacings beside.
JUMP, JUMPS = 0.01, 0.1
# Agreement: of every number that both have, by this share.
AGREE = 0.2


# ---- surfaces: value, gradient and Hessian

class Spline(surfaces.Surface):
    """A tensor-product cubic B-spline; coefficient (i, j, k) is centred at `low` + (i, j, k) * `step`."""

    def __init__(self, coefficients, low, step):
        self.c, self.low, self.step = coefficients, numpy.asarray(low, float), numpy.asarray(step, float)

    def _sum(self, x, order):
        """The derivatives of `order`, a number for each axis."""
        at = (x - self.low) / self.step
        first = numpy.clip(numpy.floor(at).astype(int), 1, numpy.array(self.c.shape) - 3)
        weight = [_basis(at[:, a] - first[:, a], order[a]) / self.step[a] ** order[a] for a in range(3)]
        total = numpy.zeros(len(x))
        for i, j, k in numpy.ndindex(4, 4, 4):
            c = self.c[first[:, 0] + i - 1, first[:, 1] + j - 1, first[:, 2] + k - 1]
            total += c * weight[0][i] * weight[1][j] * weight[2][k]
        return total

    def value(self, x):
        return self._sum(x, (0, 0, 0))

    def gradient(self, x):
        return numpy.stack([self._sum(x, e) for e in numpy.eye(3, dtype=int)], axis=1)

    def hessian(self, x):
        e = numpy.eye(3, dtype=int)
        return numpy.stack([[self._sum(x, e[a] + e[b]) for b in range(3)] for a in range(3)]).transpose(2, 0, 1)


def _basis(t, order):
    """The four cubic pieces at t in [0, 1], or their derivatives of order 1 or 2."""
    one = numpy.ones_like(t)
    return {0: [(1 - t) ** 3 / 6, (3 * t ** 3 - 6 * t ** 2 + 4) / 6, (1 + 3 * t + 3 * t ** 2 - 3 * t ** 3) / 6, t ** 3 / 6],
            1: [-(1 - t) ** 2 / 2, (3 * t ** 2 - 4 * t) / 2, (1 + 2 * t - 3 * t ** 2) / 2, t ** 2 / 2],
            2: [1 - t, 3 * t - 2 * one, 1 - 3 * t, t]}[order]


class Least(surfaces.Surface):
    """The union (or, with the sign -1, the intersection) of solids whose values are distances."""

    def __init__(self, parts, sign=1):
        self.parts, self.sign = parts, sign

    def _pick(self, x, of):
        values = self.sign * numpy.stack([p.value(x) for p in self.parts])
        return numpy.take_along_axis(of, values.argmin(axis=0).reshape((1, -1) + (1,) * (of.ndim - 2)), axis=0)[0]

    def value(self, x):
        return self._pick(x, numpy.stack([p.value(x) for p in self.parts]))

    def gradient(self, x):
        return self._pick(x, numpy.stack([p.gradient(x) for p in self.parts]))

    def hessian(self, x):
        return self._pick(x, numpy.stack([hessian(p, x) for p in self.parts]))


def hessian(surface, x):
    """The surface's own, or by central differences of its gradient."""
    if hasattr(surface, "hessian"):
        return surface.hessian(x)
    step = 1e-3 * surface.length
    columns = [(surface.gradient(x + step * e) - surface.gradient(x - step * e)) / (2 * step) for e in numpy.eye(3)]
    h = numpy.stack(columns, axis=2)
    return 0.5 * (h + h.transpose(0, 2, 1))


def volume(path):
    """A level set as a spline through its samples."""
    v = surfaces.Volume(path)
    return Spline(v.coefficients, v.origin + v.low * v.voxel, v.voxel)


def bspline(members):
    """As the job spec gives it: x varies fastest, coefficient i belongs to min + (i - 1) w."""
    dims = members["dims"]
    low = numpy.array(members.get("domain", {}).get("min", [0, 0, 0]), float)
    high = numpy.array(members.get("domain", {}).get("max", [1, 1, 1]), float)
    step = (high - low) / (numpy.array(dims) - 3)
    c = numpy.array(members["coefficients"]).reshape(dims[::-1]).transpose(2, 1, 0)
    return Spline(c, low - step, step)


def surface_of(members):
    (kind, value), = members.items()
    if kind == "vdb":
        return volume(value["path"])
    if kind == "bspline":
        return bspline(value)
    if kind in ("union", "intersection"):
        return Least([surface_of(m) for m in value], 1 if kind == "union" else -1)
    return surfaces.surface_of(members)


# ---- the shape: normals and curvatures

@dataclasses.dataclass
class Shape:
    normal: numpy.ndarray
    u: numpy.ndarray      # with v a frame of the tangent plane
    v: numpy.ndarray
    turn_u: numpy.ndarray  # the change of the normal along u
    turn_v: numpy.ndarray
    kappa1: numpy.ndarray
    kappa2: numpy.ndarray


def shape_at(surface, x):
    g, h = surface.gradient(x), hessian(surface, x)
    length = numpy.linalg.norm(g, axis=1)[:, None]
    n = g / length
    u, v = measure.tangents(n)
    turn = [numpy.einsum("nab,nb->na", h, t) / length for t in (u, v)]
    turn = [t - (t * n).sum(axis=1)[:, None] * n for t in turn]
    a, b, d = (turn[0] * u).sum(1), (turn[0] * v).sum(1), (turn[1] * v).sum(1)
    mean, spread = 0.5 * (a + d), numpy.hypot(0.5 * (a - d), b)
    return Shape(n, u, v, turn[0], turn[1], mean + spread, mean - spread)


def curvature_at(surface, x):
    shape = shape_at(surface, x)
    return numpy.hypot(shape.kappa1, shape.kappa2)


# ---- the particles

def potential(u):
    """(6) and its first two derivatives by u = r / sigma."""
    w = numpy.pi / 2 * u
    cot = 1 / numpy.tan(w)
    return cot + w - numpy.pi / 2, -numpy.pi / 2 * cot ** 2, numpy.pi ** 2 / 2 * cot * (1 + cot ** 2)


class Particles:
    """Of a result: where they are, what they are given, and the pairs within the support."""

    def __init__(self, surface, x, alpha, size, sigma, h):
        """`size`: requested spacing over h; `sigma`: the support of a pair of size 1."""
        self.count, self.h, self.size, self.shape = len(x), h, size, shape_at(surface, x)
        i, j = cKDTree(x).query_pairs(sigma * size.max(), output_type="ndarray").T
        i, j = numpy.concatenate([i, j]), numpy.concatenate([j, i])
        offset, pair_size = x[i] - x[j], 0.5 * (1 + size[j] / size[i])
        support = pair_size * sigma * size[i]
        u = numpy.linalg.norm(offset, axis=1) / support
        self.i, self.j, self.offset, self.u, self.support, pair_size = (
            a[u < 1] for a in (i, j, offset, u, support, pair_size))
        self.amplitude = 0.5 * (alpha[self.i] + alpha[self.j]) * pair_size ** 2
        self.cosine = (self.shape.normal[self.i] * self.shape.normal[self.j]).sum(axis=1)
        least = numpy.ones(self.count)
        numpy.minimum.at(least, self.i, self.cosine)
        self.away_from_rims = numpy.ones(self.count, bool)
        if surface.domain is not None:
            low, high = surface.domain
            self.away_from_rims = (numpy.minimum(x - low, high - x) > RIM * (h * size)[:, None]).all(axis=1)
        self.smooth = (least > SMOOTH) & self.away_from_rims
        bend = numpy.hypot(self.shape.kappa1, self.shape.kappa2)
        beside = numpy.stack([curvature_at(surface, x + JUMP * h * t) for s in (self.shape.u, self.shape.v) for t in (s, -s)])
        self.jumps = (numpy.abs(beside - bend) > JUMPS * bend.max()).any(axis=0)

    def _sum(self, values):
        return numpy.bincount(self.i, values, self.count)

    def energies(self):
        """E_i, the full sum of (13), over the particle's squared size."""
        return self._sum(self.amplitude * facing(self.cosine)[0] * potential(self.u)[0])

    def steps_left(self):
        """Newton's step (12) over the requested spacing: (5) in the tangent frame, with what the turning of the normal adds,
        and the first term of (10)."""
        weight, slope = facing(self.cosine)
        e, e1, e2 = potential(self.u)
        s, i = self.shape, self.i
        along = [(self.offset * t[i]).sum(axis=1) / (self.u * self.support) for t in (s.u, s.v)]
        turning = [(t[i] * s.normal[self.j]).sum(axis=1) for t in (s.turn_u, s.turn_v)]
        fu, fv = (self._sum(self.amplitude * (weight * e1 / self.support * a + slope * t * e))
                  for a, t in zip(along, turning))
        bend = self.amplitude * weight * e2 / self.support ** 2
        huu, huv, hvv = (self._sum(bend * along[a] * along[b]) for a, b in ((0, 0), (0, 1), (1, 1)))
        determinant = numpy.maximum(huu * hvv - huv ** 2, 1e-300)
        step = numpy.hypot(huv * fv - hvv * fu, huv * fu - huu * fv) / determinant
        return step / (self.h * self.size)


def facing(cosine):
    """The weight of a pair, and its slope by the cosine."""
    t = numpy.clip((cosine - FACING_NONE) / (FACING_WHOLE - FACING_NONE), 0, 1)
    return t * t * (3 - 2 * t), 6 * t * (1 - t) / (FACING_WHOLE - FACING_NONE)


# ---- the table

@dataclasses.dataclass
class Case:
    name: str
    surface: dict
    count: int


def analytic(shape, **members):
    return {"analytic": {"shape": shape, **members}}


def formulas():
    """Cases that need nothing but the worker."""
    two = [analytic("sphere", radius=0.3, center=[x, 0.5, 0.5]) for x in (0.35, 0.7)]
    return [
        Case("sphere", analytic("sphere", radius=0.4), 1000),
        Case("ellipsoid", analytic("ellipsoid", radii=[0.4, 0.25, 0.15]), 1000),
        Case("torus", analytic("torus", major_radius=0.3, minor_radius=0.12), 1500),
        Case("quartic (15)", analytic("quartic"), 1000),
        Case("rounded box", analytic("box", half_size=[0.4, 0.3, 0.2], rounding=0.1), 1500),
        Case("gyroid, cut by a box", analytic("gyroid", period=0.5), 6000),
        Case("two spheres, united", {"union": two}, 1500),
        Case("two spheres, intersected", {"intersection": two}, 1000),
        *(Case(f"B-spline, {name}", json.loads((EXAMPLES / f"bspline-{name}.json").read_text())["surface"], 1250)
          for name in ("torus", "box")),
    ]


def level_sets(where):
    """Level sets that are made here: of a formula, and of a mesh whose facets are as large as the spacing."""
    levelsets.write_torus(0.3, 0.12, 0.02, where / "torus.vdb")
    (where / "facets.obj").write_text(faceted_torus(0.3, 0.12, 48, 20))
    levelsets.write_mesh(where / "facets.obj", 64, where / "facets.vdb")
    return [Case("level set of a torus", {"vdb": {"path": str(where / "torus.vdb")}}, 1500),
            Case("level set of a faceted torus", {"vdb": {"path": str(where / "facets.vdb")}}, 1500)]


def faceted_torus(major, minor, around, along):
    lines = []
    for i, j in numpy.ndindex(around, along):
        a, b = 2 * numpy.pi * i / around, 2 * numpy.pi * j / along
        r = major + minor * numpy.cos(b)
        lines.append(f"v {r * numpy.cos(a):.9g} {r * numpy.sin(a):.9g} {minor * numpy.sin(b):.9g}")
    for i, j in numpy.ndindex(around, along):
        p, q = (i * along + 1, (i + 1) % around * along + 1)
        lines.append(f"f {p + j} {q + j} {q + (j + 1) % along} {p + (j + 1) % along}")
    return "\n".join(lines) + "\n"


def of_directory(directory, where):
    """Its level sets, and its meshes as level sets of 128 voxels."""
    cases = []
    for path in sorted(directory.iterdir()):
        if path.suffix.lower() in (".obj", ".off", ".stl", ".ply"):
            levelsets.write_mesh(path, 128, where / (path.name + ".vdb"))
            cases.append(Case(path.name, {"vdb": {"path": str(where / (path.name + ".vdb"))}}, 10000))
        elif path.suffix == ".vdb":
            cases.append(Case(path.name, {"vdb": {"path": str(path)}}, 10000))
    return cases


# name, sampling, solver
WAYS = (
    ("paper", {}, {"method": "paper", "init": "random"}),
    ("paper, alpha", {"alpha": {"d": 2}}, {"method": "paper", "init": "random"}),
    ("paper, alpha at points", {"alpha": {"d": 2, "scale": {"spacings": 0}}}, {"method": "paper", "init": "random"}),
    ("sized", {}, {}),
    ("sized, graded 4 : 1", {"curvature": {"ratio": 4}}, {}),
)


def run(worker, case, way, seed, where):
    _, sampling, solver = way
    spec = {"version": 1, "surface": case.surface, "sampling": {"count": case.count, **sampling},
            "solver": {"threads": 1, "seed": seed, **solver},
            "output": {"ply": {"precision": "double", "properties": ["all"]}, "preview": False}}
    done = subprocess.run([worker, "run", "-", "--output", where], input=json.dumps(spec), text=True, capture_output=True)
    if done.returncode not in (0, 10, 11):
        raise RuntimeError(f"{case.name}: the worker ended with {done.returncode}: {done.stderr.strip()}")
    return json.loads((where / "report.json").read_text()), measure.read_ply(where / "points.ply")


def difference(ours, theirs):
    """The largest, over the largest of theirs."""
    return float(numpy.abs(ours - theirs).max() / numpy.abs(theirs).max())


def compare(surface, report, points):
    """Reported and computed figures: by name (reported, computed) of numbers, or the largest difference of columns."""
    x, columns, h = points.position, points.columns, report["spacing"]
    size = points.spacing / h if "grading" in report else numpy.ones(points.count)
    own = Particles(surface, x, points.alpha, size, report["diagnostics"]["sigma"], h)
    step = own.steps_left()[own.smooth]
    energies = own.energies()
    # at a sharp edge, and where a curvature jumps, a point is on one side by rounding alone
    calm = own.smooth & ~own.jumps
    columns_of = {"normal": (own.shape.normal, points.normal), "energy": (energies, columns["energy"])}
    for k in (1, 2):
        columns_of[f"kappa{k}"] = (getattr(own.shape, f"kappa{k}"), columns[f"kappa{k}"])
    given = report.get("alpha")
    if given:
        kappa = columns.get("kappa_scale", numpy.hypot(own.shape.kappa1, own.shape.kappa2))
        members = report["spec"]["sampling"]["alpha"]
        columns_of["alpha"] = (amplitude(kappa * given["length"], members), points.alpha)
    inner = own.away_from_rims
    return {
        "columns": {name: difference(ours[calm], theirs[calm]) for name, (ours, theirs) in columns_of.items()},
        "numbers": {"step": (report["diagnostics"]["step_left"], float(numpy.sqrt((step ** 2).mean()))),
                    "energy": (report["diagnostics"]["energy"]["mean"], float(energies[inner].sum() / points.alpha[inner].sum()))},
        "rms_step": report["sweeps"][-1]["rms_step"],
        "outcome": report["outcome"],
    }


def amplitude(kappa, members):
    """(14), with curvature bounded."""
    return members["gamma"] + 1 / (numpy.minimum(kappa, members["kappa_max"]) ** members["d"] + members["nu"])


def disagreements(found):
    """What differs by more than AGREE, in words."""
    far = [f"{name} differs by {value:.2g}" for name, value in found["columns"].items() if not value <= AGREE]
    return far + [f"{name}: reported {told:.3g}, computed {own:.3g}" for name, (told, own) in found["numbers"].items()
                  if not abs(told - own) <= AGREE * own]


HEADER = ["row", "surface", "method", "runs", "converged", "normal_difference", "kappa_difference", "alpha_difference", "energy_difference",
          "mean_energy_difference", "step_left", "step_left_ratio_least", "step_left_ratio_largest", "rms_step"]


def row(case, way, results):
    """A row of the CSV, of all seeds."""
    worst = {name: max(r["columns"].get(name, 0) for r in results) for name in ("normal", "energy", "alpha")}
    bend = max(max(r["columns"][k] for k in ("kappa1", "kappa2")) for r in results)
    told, own = zip(*(r["numbers"]["step"] for r in results))
    ratio = [a / b for a, b in zip(told, own)]
    mean = max(abs(a / b - 1) for a, b in (r["numbers"]["energy"] for r in results))
    outcomes = [r["outcome"] for r in results]
    return [f"{case.name}: {way[0]}", case.name, way[0], len(outcomes), outcomes.count("converged"),
            *(f"{v:.0e}" for v in (worst["normal"], bend, worst["alpha"], worst["energy"], mean)), f"{max(told):.1e}", f"{min(ratio):.2f}",
            f"{max(ratio):.2f}", f"{max(r['rms_step'] for r in results):.1e}"]


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", default=EXAMPLES.parent / "build" / "hexad-worker", type=pathlib.Path)
    parser.add_argument("--output", type=pathlib.Path, help="the CSV file to write")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--directory", type=pathlib.Path, help="meshes and level sets to look at, instead of the twelve surfaces")
    parser.add_argument("--only", help="surfaces whose name begins so")
    options = parser.parse_args()
    options.worker = options.worker.resolve()
    return options


def main():
    options, lines, far = arguments(), [], []
    with tempfile.TemporaryDirectory() as scratch:
        scratch = pathlib.Path(scratch)
        if options.directory:
            cases = of_directory(options.directory, scratch)
        else:
            cases = formulas()
            if not options.only or options.only.startswith("level set"):
                cases += level_sets(scratch)
        for case in cases:
            if options.only and not case.name.startswith(options.only):
                continue
            surface = surface_of(case.surface)
            for way in WAYS:
                results = []
                for seed in range(1, options.seeds + 1):
                    found = compare(surface, *run(options.worker, case, way, seed, scratch / "job"))
                    results.append(found)
                    far += [f"{case.name}, {way[0]}, seed {seed}: {words}" for words in disagreements(found)]
                lines.append(row(case, way, results))
                print(", ".join(f"{name} {value}" for name, value in zip(HEADER[1:], lines[-1][1:])), flush=True)
    if options.output:
        csv_results.write(options.output, HEADER, lines)
    print(*far, sep="\n", end="\n" if far else "")
    print(f"{options.seeds * len(lines)} runs: " + (f"{len(far)} figures differ by more than {AGREE:.0%}" if far else
                                                    f"all reported and recomputed values agree within {AGREE:.0%}"))
    return 1 if far else 0


if __name__ == "__main__":
    sys.exit(main())
