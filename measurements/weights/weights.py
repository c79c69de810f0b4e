#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures the error of integrals with the attribute `weight`, beside equal weights and a published program.

    measurements/weights/weights.py --worker build/hexad-worker [--only WORD] [--published FILE.py] [--output weights.csv]

Integrals are compared with those of the surface itself, which are closed forms, or quadrature along rays with an error below that of
the weights (`reference_error`). Coordinates u are relative to the centre of the surface, in the unit of its size. --published: the
function Smooth_Closed_Surface_Quadrature_RBF of Reeger, Fornberg and Watts, for Python 3; it gets the same nodes, triangles and normals.
"""
import argparse
import importlib.util
import json
import pathlib
import resource
import subprocess
import sys
import tempfile
import time

import numpy
from scipy import ndimage
from scipy.spatial import cKDTree

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "common"), str(HERE.parent / "measures"), str(HERE.parents[1] / "tools")]
import bspline_examples  # noqa: E402
import measure  # noqa: E402
import meshes  # noqa: E402
import referee  # noqa: E402
import results  # noqa: E402
import surfaces  # noqa: E402

HEADER = ["row", "points", "kind", "reason", "area", "exp", "z2", "x4y2", "x2", "normal", "sum", "least_weight", "degree_difference",
          "equal_weights", "published", "apart_from_published", "reference_error", "volume_error", "cpu_s", "published_cpu_s"]
INTEGRANDS = {"area": lambda u: numpy.ones(len(u)), "exp": lambda u: numpy.exp(u[:, 0]), "z2": lambda u: u[:, 2] ** 2,
              "x4y2": lambda u: u[:, 0] ** 4 * u[:, 1] ** 2, "x2": lambda u: u[:, 0] ** 2}
# Largest relative errors of area, exp and z2 of high-order rows by their number of points, and of a kind.
BOUNDS = {2000: 3e-5, 5000: 1e-6, 10000: 1e-7}
OF_SMOOTH, OF_CELLS, OF_SUMS, EQUAL_LEAST, CPU_S = 1e-6, 1e-3, 1e-12, 0.1, 12


class Rays:
    """The integrals over a surface that each ray meets once, near `start`: from a centre over the sphere, or from a ring over a torus."""

    def __init__(self, surface, center, length, start, ring=0.0):
        self.surface, self.center, self.length, self.start, self.ring = surface, numpy.array(center, float), length, start, ring

    def _rays(self, n):
        """Origins, directions and the weight of each ray, without the factors of _factor."""
        if not self.ring:
            u, weight = surfaces._directions(n)
            return numpy.zeros_like(u), u, weight * numpy.pi / n
        a, b = (x.ravel() for x in numpy.meshgrid(numpy.arange(3 * n) * 2 * numpy.pi / (3 * n), numpy.arange(n) * 2 * numpy.pi / n))
        out = numpy.stack([numpy.cos(a), numpy.sin(a), 0 * a], axis=1)
        u = numpy.cos(b)[:, None] * out + numpy.sin(b)[:, None] * numpy.array([0, 0, 1])
        return self.ring * out, u, numpy.full(len(a), 4 * numpy.pi ** 2 / (3 * n * n))

    def integrals(self, n):
        origin, u, weight = self._rays(n)
        t = self.start(u) if callable(self.start) else numpy.full(len(u), float(self.start))
        for _ in range(8):
            x = self.center + origin + t[:, None] * u
            slope = (self.surface.gradient(x) * u).sum(axis=1)
            t = t - self.surface.value(x) / slope
        x = self.center + origin + t[:, None] * u
        g = self.surface.gradient(x)
        around = t * numpy.hypot(*(x - self.center)[:, :2].T) if self.ring else t * t
        area = weight * around * numpy.linalg.norm(g, axis=1) / numpy.abs((g * u).sum(axis=1))
        at = (x - self.center) / self.length
        return {name: float((area * f(at)).sum()) for name, f in INTEGRANDS.items()}

    def references(self, n):
        """The integrals, and the largest relative difference from those of fewer rays."""
        fine, coarse = self.integrals(n), self.integrals(n * 3 // 4)
        return fine, max(abs(coarse[name] / value - 1) for name, value in fine.items())


class MeshIntegrals:
    """The integrals over a mesh: polynomials of degree 2 exactly, others by the centroids of 4^LEVELS parts."""
    LEVELS = 3

    def __init__(self, mesh, length):
        self.mesh, self.length = mesh, length

    def references(self, _):
        t = self.mesh.vertices[self.mesh.triangles]
        for _ in range(self.LEVELS):
            m = 0.5 * (t + t[:, [1, 2, 0]])
            t = numpy.concatenate([m] + [numpy.stack([t[:, k], m[:, k], m[:, k - 1]], axis=1) for k in range(3)])
        area = 0.5 * numpy.linalg.norm(numpy.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)
        # the midpoints of the sides are exact to degree 2
        middle = [0.5 * (t[:, k] + t[:, k - 1]) / self.length for k in range(3)]
        return {name: float(sum((area * f(m)).sum() for m in middle) / 3) for name, f in INTEGRANDS.items()}, 0.0


def analytic(shape, **members):
    return {"analytic": {"shape": shape, **members}}


def spline_torus():
    """The example's coefficients."""
    n = bspline_examples.COEFFICIENTS
    return {"dims": [n, n, n], "coefficients": bspline_examples.coefficients(bspline_examples.torus)}


def write_volume(value, low, voxel, size, path):
    """Samples of a function, negative inside, as NRRD: larger values are inside there. Returns the spline through them."""
    at = numpy.stack(numpy.meshgrid(*[l + voxel * numpy.arange(n) for l, n in zip(low, size)], indexing="ij"), axis=-1)
    samples = value(at.reshape(-1, 3)).reshape(size)
    directions = " ".join("(" + ",".join(repr(voxel if a == b else 0.0) for b in range(3)) + ")" for a in range(3))
    header = ("NRRD0005\ntype: double\ndimension: 3\nsizes: {}\nencoding: raw\nendian: little\nspace: left-posterior-superior\n"
              "space directions: {}\nspace origin: ({})\n\n")
    text = header.format(" ".join(map(str, size)), directions, ",".join(repr(float(v)) for v in low))
    path.write_bytes(text.encode() + (-samples).astype("<f8").tobytes(order="F"))
    return referee.Spline(ndimage.spline_filter(samples, order=3, mode="mirror"), low, (voxel,) * 3)


def volume_of(shape, half, voxels, path):
    """A volume of a surface about the origin, `voxels` along its longest side; `half`: of its box."""
    voxel = 2 * max(half) / voxels
    size = [2 * int(numpy.ceil(h / voxel) + 8) + 1 for h in half]
    return write_volume(shape.value, [-voxel * (n // 2) for n in size], voxel, size, path)


def torus_mesh(around, rows, path):
    """Quads of a torus (1, 0.4), as OBJ."""
    u, v = (a.ravel() for a in numpy.meshgrid(numpy.arange(around) * 2 * numpy.pi / around, numpy.arange(rows) * 2 * numpy.pi / rows,
                                              indexing="ij"))
    r = 1 + 0.4 * numpy.cos(v)
    index = numpy.arange(around * rows).reshape(around, rows) + 1
    quads = numpy.stack([index, numpy.roll(index, -1, 0), numpy.roll(numpy.roll(index, -1, 0), -1, 1), numpy.roll(index, -1, 1)], axis=-1)
    lines = [f"v {a:.17g} {b:.17g} {c:.17g}" for a, b, c in zip(r * numpy.cos(u), r * numpy.sin(u), 0.4 * numpy.sin(v))]
    path.write_text("\n".join(lines + ["f {} {} {} {}".format(*q) for q in quads.reshape(-1, 4)]) + "\n")


def ellipsoid_mesh(radii, rows, path):
    """An ellipsoid of rows of triangles between its poles, as OBJ."""
    around = 2 * rows
    lines = [f"v 0 0 {radii[2]}", f"v 0 0 {-radii[2]}"]
    for k in range(1, rows):
        a = numpy.pi * k / rows
        lines += [f"v {radii[0] * numpy.sin(a) * numpy.cos(b):.17g} {radii[1] * numpy.sin(a) * numpy.sin(b):.17g} "
                  f"{radii[2] * numpy.cos(a):.17g}" for b in numpy.arange(around) * 2 * numpy.pi / around]
    at = [[3 + k * around + i % around for i in range(around + 1)] for k in range(rows - 1)]
    lines += [f"f 1 {at[0][i]} {at[0][i + 1]}" for i in range(around)] + [f"f 2 {at[-1][i + 1]} {at[-1][i]}" for i in range(around)]
    for one, other in zip(at, at[1:]):
        lines += [f"f {one[i]} {other[i]} {other[i + 1]} {one[i + 1]}" for i in range(around)]
    path.write_text("\n".join(lines) + "\n")


def jobs(where):
    """(name, spec of the surface, sampling, further members, integrals, rays, integrals of the true surface of a volume)."""
    torus, quartic = surfaces.Torus(1, 0.4, (0, 0, 0)), surfaces.Quartic(0.13, (0, 0, 0))
    radii = (1, 0.6, 0.325)
    ellipsoid = surfaces.Ellipsoid(radii, (0, 0, 0))
    tori = analytic("torus", center=[0, 0, 0], major_radius=1, minor_radius=0.4)
    of_torus = Rays(torus, (0, 0, 0), 1, 0.4, ring=1)

    def around_ellipsoid(u):
        return 1 / numpy.linalg.norm(u / numpy.array(radii), axis=1)

    # the curvature of the torus varies little: a high exponent makes its spacing vary
    graded, graded_torus = ({"count": 10000, "curvature": {"ratio": 5, "exponent": exponent}} for exponent in (1, 12))
    for points in BOUNDS:
        yield f"torus, {points}", tori, {"count": points}, {}, of_torus, 96, None
    yield "torus, ratio 3, 10000", tori, {"count": 10000, "curvature": {"ratio": 3}}, {}, of_torus, 96, None
    yield ("ellipsoid, 10000", analytic("ellipsoid", center=[0, 0, 0], radii=radii), {"count": 10000}, {},
           Rays(ellipsoid, (0, 0, 0), 1, around_ellipsoid), 96, None)
    yield ("ellipsoid, ratio 3, 10000", analytic("ellipsoid", center=[0, 0, 0], radii=radii),
           {"count": 10000, "curvature": {"ratio": 3}}, {}, Rays(ellipsoid, (0, 0, 0), 1, around_ellipsoid), 96, None)
    yield ("quartic, 10000", analytic("quartic", center=[0, 0, 0], r=0.13), {"count": 10000}, {},
           Rays(quartic, (0, 0, 0), 0.5, lambda u: numpy.sqrt(quartic.c / (u ** 4).sum(axis=1))), 128, None)
    spline = spline_torus()
    yield ("B-spline of a torus, 10000", {"bspline": spline}, {"count": 10000}, {},
           Rays(referee.bspline(spline), (0.5, 0.5, 0.5), 0.5, 0.12, ring=0.3), 200, None)
    for voxels in (128, 256):
        file = where / f"torus{voxels}.nrrd"
        of_spline = Rays(volume_of(torus, (1.4, 1.4, 0.4), voxels, file), (0, 0, 0), 1, 0.4, ring=1)
        volume = {"volume": {"path": str(file), "isovalue": 0}}
        yield f"volume of a torus, {voxels} voxels, 10000", volume, {"count": 10000}, {}, of_spline, 200, of_torus
        if voxels == 128:
            yield (f"volume of a torus, {voxels} voxels, in a region, ratio 5, 10000", volume, graded_torus,
                   {"region": {"min": [-2, -2, -2], "max": [2, 2, 2]}}, of_spline, 200, None)
    file = where / "ellipsoid.nrrd"
    of_spline = Rays(volume_of(ellipsoid, radii, 128, file), (0, 0, 0), 1, around_ellipsoid)
    yield ("volume of an ellipsoid, 128 voxels, in a region, ratio 5, 10000", {"volume": {"path": str(file), "isovalue": 0}},
           graded, {"region": {"min": [-2, -2, -2], "max": [2, 2, 2]}}, of_spline, 128, None)
    for name, write in (("torus", lambda path: torus_mesh(200, 80, path)), ("ellipsoid", lambda path: ellipsoid_mesh(radii, 100, path))):
        file = where / f"{name}.obj"
        write(file)
        yield (f"mesh of {name}, ratio 5, 10000", {"mesh": {"path": str(file)}}, graded_torus if name == "torus" else graded, {},
               MeshIntegrals(meshes.read(file), 1), 0, None)


def run(worker, spec, where):
    """Runs a job; returns its CPU seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([worker, "run", "-", "--output", where, "--threads", "1"], input=json.dumps(spec), text=True, capture_output=True)
    if done.returncode not in (0, 10, 11):
        raise RuntimeError(f"the worker ended with {done.returncode}: {done.stderr.strip()}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def published_weights(path, points, triangles):
    """Weights by the published program, with the normals of the points, and its CPU seconds."""
    description = importlib.util.spec_from_file_location("published", path)
    module = importlib.util.module_from_spec(description)
    description.loader.exec_module(module)
    tree, begin = cKDTree(points["position"]), time.process_time()
    with numpy.errstate(all="ignore"):
        weight = module.Smooth_Closed_Surface_Quadrature_RBF(points["position"], triangles, lambda x: numpy.zeros(len(x)),
                                                             lambda x: points["normal"][tree.query(x)[1]])
    return weight[:, 0], time.process_time() - begin


def measured(options, job, where):
    name, surface, sampling, further, truth, rays, exact = job
    spec = {"version": 1, "surface": surface, "sampling": sampling, "solver": {"threads": 1}, **further,
            "attributes": [{"from": "geometry", "name": "weight"}], "output": {"points_npz": True, "preview": False}}
    high = "ratio 5" not in name
    if options.published and high:
        spec["output"]["mesh"] = True
    plain = {k: v for k, v in spec.items() if k != "attributes"}
    cpu = run(options.worker, spec, where / "with") - run(options.worker, plain, where / "without")
    report = json.loads((where / "with" / "report.json").read_text())
    told, points = report["weights"], dict(numpy.load(where / "with" / "points.npz"))
    expected, reference_error = truth.references(rays)
    center, length = getattr(truth, "center", 0), truth.length
    u, w, n = (points["position"] - center) / length, points["weight"], points["normal"]

    def errors(weight):
        return {key: float(weight @ f(u)) / expected[key] - 1 for key, f in INTEGRANDS.items()}

    mine, equal = errors(w), errors(numpy.full(len(w), expected["area"] / len(w)))
    row = {"row": name, "points": len(w), "kind": told["kind"], "reason": told["reason"], **mine,
           "normal": float(numpy.linalg.norm((w[:, None] * n).sum(axis=0)) / w.sum()),
           "sum": w.sum() / (report["surface"]["area"] - told["area_without_points"]) - 1 if told["kind"] == "cells" else None,
           "least_weight": w.min() * len(w) / w.sum(), "degree_difference": told["degree_difference"],
           "equal_weights": max(abs(equal[key]) for key in ("exp", "z2", "x2")), "reference_error": reference_error, "cpu_s": cpu}
    if exact:
        true = exact.references(96)[0]
        row["volume_error"] = max(abs(expected[key] / true[key] - 1) for key in ("area", "exp", "z2"))
    if options.published and high:
        mesh = meshes.read(where / "with" / "mesh.ply")  # its vertices are sorted
        triangles = cKDTree(points["position"]).query(mesh.vertices)[1][mesh.triangles]
        theirs, row["published_cpu_s"] = published_weights(options.published, points, triangles)
        found = errors(theirs)
        row["published"] = max(abs(found[key]) for key in ("area", "exp", "z2"))
        row["apart_from_published"] = float(numpy.abs(theirs - w).max() / w.mean())
    return row


def faults(row):
    """What a row misses."""
    high = row["kind"] == "high_order"
    largest = max(abs(row[key]) for key in ("area", "exp", "z2"))
    if high:
        bound = BOUNDS[row["points"]] if row["row"].startswith("torus, ") and "ratio" not in row["row"] else OF_SMOOTH
        checks = {"errors": largest <= bound, "positive": "torus" not in row["row"] or row["least_weight"] > 0,
                  "cpu_s": row["cpu_s"] <= CPU_S * row["points"] / 10000}
    else:
        checks = {"sum": abs(row["sum"]) <= OF_SUMS, "x2": abs(row["x2"]) <= OF_CELLS, "normal": row["normal"] <= OF_CELLS,
                  "equal_weights": row["equal_weights"] > EQUAL_LEAST}
    return [name for name, holds in checks.items() if not holds]


def cell(value):
    return None if value is None else f"{value:.2g}" if isinstance(value, float) else value


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True, type=lambda name: pathlib.Path(name).resolve())
    parser.add_argument("--only", default="")
    parser.add_argument("--published", type=pathlib.Path)
    parser.add_argument("--output", type=pathlib.Path)
    options = parser.parse_args()
    rows, wrong = [], 0
    with tempfile.TemporaryDirectory() as where:
        where = pathlib.Path(where)
        for k, job in enumerate(jobs(where)):
            if options.only not in job[0]:
                continue
            row = measured(options, job, where / str(k))
            missed = faults(row)
            wrong += bool(missed)
            rows.append([cell(row.get(key)) for key in HEADER])
            print(", ".join(f"{key} {value}" for key, value in zip(HEADER, rows[-1]) if value is not None), *missed, flush=True)
    if options.output:
        results.write(options.output, HEADER, rows)
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
