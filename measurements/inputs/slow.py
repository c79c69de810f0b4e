#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures the CPU time of jobs on meshes that take long for their size, and the worker's estimate of it (slow.csv).

    measurements/inputs/slow.py --worker build/hexad-worker --output slow.csv [--only WORD ...] [--size 1] [--count 2000]
                       [--most 120] [--growth]

The meshes are generated: fans, combs, slivers, many faces on one edge or vertex, many parts. `--size` multiplies the number of
their faces. `--growth` instead measures each mesh with its faces and with twice their number (growth.csv): the work follows the
number of faces if the ratio of the times is about 2. Each run has one thread and seed 1, and is stopped after `--most` seconds of CPU time. Ends with 1 if a run was
stopped, or failed with another error than limit_memory.
"""
import argparse
import json
import math
import pathlib
import random
import resource
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import results  # noqa: E402

HEADER = ("mesh", "what", "faces", "cpu_s", "estimate_s", "ratio", "outcome")
GROWTH = ("mesh", "what", "faces", "cpu_s", "twice_faces", "twice_cpu_s", "growth", "outcome")
# The worker's exit codes of results.
RESULTS = (0, 10, 11)


def circle(count, radius=1.0, z=0.0, phase=0.0):
    angles = [2 * math.pi * (k + phase) / count for k in range(count)]
    return [(radius * math.cos(a), radius * math.sin(a), z) for a in angles]


def strip(first, second, is_closed, is_cut=False):
    """Quadrilaterals, or pairs of triangles, between two polylines of equal length."""
    n = len(first)
    quads = [(k, (k + 1) % n, n + (k + 1) % n, n + k) for k in range(n if is_closed else n - 1)]
    return [*first, *second], [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))] if is_cut else quads


def polygon(corners):
    return corners, [tuple(range(len(corners)))]


def fan(apex, rim):
    n = len(rim)
    return [apex, *rim], [(0, 1 + k, 1 + (k + 1) % n) for k in range(n)]


def star_corners(count, outer, inner):
    return [(x * r, y * r, 0) for (x, y, _), r in zip(circle(count), (outer, inner) * (count // 2))]


def comb(teeth):
    pitch = 2 / teeth
    return polygon([(0, 0, 0), (2, 0, 0), *((2 - pitch * (k + x), y, 0) for k in range(teeth)
                                            for x, y in ((0, 0.2), (0.05, 2), (0.5, 2), (0.5, 0.2))), (0, 0.2, 0)])


def notched(count):
    """A disc with narrow notches."""
    notch = [(0.92, 1), (1, 0.1), (1.08, 1)]
    return polygon([(r * math.cos(2 * math.pi * (k + a) / count), r * math.sin(2 * math.pi * (k + a) / count), 0)
                    for k in range(count) for a, r in notch])


def pleats(count):
    lines = [[(k / count, y, 0.5 / count * (k % 2)) for k in range(count + 1)] for y in (0, 2)]
    return strip(*lines, is_closed=False, is_cut=True)


def turned(vertices, axis):
    """Rotates the axis z to `axis`."""
    length, across = math.hypot(*axis), math.hypot(*axis[:2])
    w, u = [a / length for a in axis], (-axis[1] / across, axis[0] / across, 0)
    v = (w[1] * u[2] - w[2] * u[1], w[2] * u[0] - w[0] * u[2], w[0] * u[1] - w[1] * u[0])
    return [tuple(x * a + y * b + z * c for a, b, c in zip(u, v, w)) for x, y, z in vertices]


# The direction along which coplanar.c compares planes first.
OBLIQUE = (0.5377, 0.3183, 0.7809)


def needle_cylinder(sides, axis=None, height=2.0):
    vertices, faces = strip(circle(sides, 0.5, -height / 2), circle(sides, 0.5, height / 2), is_closed=True, is_cut=True)
    return (turned(vertices, axis) if axis else vertices), faces


def book(pages, is_triangle):
    """Faces on one edge."""
    edge = [(0, 0, 0), (0, 0, 1)]
    if is_triangle:
        return [*edge, *circle(pages, 1, 0.5)], [(0, 1, 2 + k) for k in range(pages)]
    return [*edge, *circle(pages, 1, 0), *circle(pages, 1, 1)], [(0, 1, 2 + pages + k, 2 + k) for k in range(pages)]


def spiral(steps, is_flat):
    """100 steps a turn."""
    lines, turns = [], max(steps // 100, 1)
    for side in (0, 1):
        radii = [0.05 + k / steps + (0.5 / turns * side if is_flat else 0) for k in range(steps + 1)]
        lines.append([(r * math.cos(2 * math.pi * turns * k / steps), r * math.sin(2 * math.pi * turns * k / steps), 0 if is_flat else side)
                      for k, r in enumerate(radii)])
    return strip(*lines, is_closed=False)


def joined(parts):
    vertices, faces = [], []
    for more, of in parts:
        faces += [tuple(len(vertices) + k for k in face) for face in of]
        vertices += more
    return vertices, faces


def sheet(cells, lift):
    """A sheet whose inner vertices are alternately at 0 and at `lift`; its rim is at `lift`."""
    n = cells + 1
    heights = [[lift if i in (0, cells) or j in (0, cells) or (i + j) % 2 else 0 for j in range(n)] for i in range(n)]
    return ([(i / cells, j / cells, heights[i][j]) for i in range(n) for j in range(n)],
            [(i * n + j, i * n + n + j, i * n + n + j + 1, i * n + j + 1) for i in range(cells) for j in range(cells)])


def tetrahedron(x, y, z):
    corners = ((1, 1, 1), (-1, -1, 1), (-1, 1, -1), (1, -1, -1))
    return [(x + 0.3 * a, y + 0.3 * b, z + 0.3 * c) for a, b, c in corners], [(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)]


def shells(count):
    side = math.ceil(count ** (1 / 3) - 1e-9)
    return joined(tetrahedron(k % side, k // side % side, k // side ** 2) for k in range(count))


def nested(count):
    """Tetrahedra around one centre."""
    return joined(([tuple((1 + k / count) * c for c in p) for p in tetrahedron(0, 0, 0)[0]], tetrahedron(0, 0, 0)[1]) for k in range(count))


def leaves(count, radius):
    """Triangles with one common vertex, each turned about its own axis, or separate ones at a radius."""
    parts = []
    for k in range(count):
        z = 1 - (2 * k + 1) / count
        x, y = (math.sqrt(1 - z * z) * f(k * math.pi * (3 - math.sqrt(5))) for f in (math.cos, math.sin))
        parts.append((turned([(0, 0, radius), (0.5 / math.sqrt(count), 0, 1), (0, 0.5 / math.sqrt(count), 1)], (x, y, z)), [(0, 1, 2)]))
    return joined(parts)


def tiles(count, is_apart):
    """Triangles in one oblique plane, which are apart, or overlap along a line."""
    side = math.ceil(math.sqrt(count))
    places = [(k % side, k // side) if is_apart else (0.3 * k, 0) for k in range(count)]
    vertices, faces = joined(([(x, y, 0), (x + 0.8, y, 0), (x, y + 0.8, 0)], [(0, 1, 2)]) for x, y in places)
    return turned(vertices, (1, 2, 3)), faces


def ruled(count):
    """A triangle as one polygon whose base has collinear vertices."""
    return polygon([(k / count, 0, 0) for k in range(count + 1)] + [(0.5, 1, 0)])


def splinters(count):
    """Slivers on one long edge, in different directions around it."""
    return [(0, 0, 0), (1, 0, 0)] + [(0.5, *p[:2]) for p in circle(count, 1e-3)], [(0, 1, 2 + k) for k in range(count)]


def in_box(count, side, seed=1):
    """Skewed quadrilaterals at random places of a unit box, with sides of about `side`; most of them cross others."""
    rng = random.Random(seed)
    parts = []
    for _ in range(count):
        place, along, across = ([rng.uniform(-0.5, 0.5) for _ in range(3)] for _ in range(3))
        corners = [[p + side * (a * u + b * v + rng.uniform(-0.2, 0.2)) for p, u, v in zip(place, along, across)]
                   for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        parts.append((corners, [(0, 1, 2, 3)]))
    return joined(parts)


def crumpled(cells, lift, seed=1):
    """A sheet whose vertices are moved at random by up to `lift` cells: its quadrilaterals are skewed, and cross their neighbours."""
    rng = random.Random(seed)
    n = cells + 1
    return ([(i / cells + rng.uniform(-lift, lift) / cells, j / cells + rng.uniform(-lift, lift) / cells, rng.uniform(-lift, lift) / cells)
             for i in range(n) for j in range(n)],
            [(i * n + j, i * n + n + j, i * n + n + j + 1, i * n + j + 1) for i in range(cells) for j in range(cells)])


def tangled(vertices, faces, seed=1):
    """Quadrilaterals between random vertices in a box."""
    rng = random.Random(seed)
    return ([tuple(rng.uniform(0, 1) for _ in range(3)) for _ in range(vertices)], [tuple(rng.sample(range(vertices), 4)) for _ in range(faces)])


def meshes(size):
    """Names, descriptions and functions that return vertices and faces."""
    def n(faces, least=8):
        return 2 * max(round(faces * size / 2), least // 2)
    return (
        ("star", "a star polygon of 20 000 corners", lambda: polygon(star_corners(n(20000), 1, 0.5))),
        ("star ring", "10 000 quadrilaterals between two star polygons", lambda: strip(star_corners(n(10000), 1, 0.7), star_corners(n(10000), 0.5, 0.3), True)),
        ("notches", "a polygon with 1 000 narrow notches", lambda: notched(n(1000))),
        ("comb", "a polygon with 1 000 teeth", lambda: comb(n(1000))),
        ("slits", "300 rectangles side by side", lambda: joined(([(k, 0, 0), (k + 0.5, 0, 0), (k + 0.5, 300, 0), (k, 300, 0)], [(0, 1, 2, 3)])
                                                                for k in range(n(300)))),
        ("slivers", "a cylinder of 1 440 slivers of aspect 20 000", lambda: needle_cylinder(n(720), height=87)),
        ("needles", "a cylinder of 100 000 sides", lambda: needle_cylinder(n(100000))),
        ("diagonal needles", "a cylinder of 20 000 sides along the diagonal", lambda: needle_cylinder(n(20000), (1, 1, 1))),
        ("oblique needles", "a cylinder of 20 000 sides along the direction of coplanar.c", lambda: needle_cylinder(n(20000), OBLIQUE)),
        ("pleats", "5 000 folds in a row", lambda: pleats(n(5000))),
        ("book", "2 000 rectangles on one edge", lambda: book(n(2000), False)),
        ("book of triangles", "2 000 triangles on one edge", lambda: book(n(2000), True)),
        ("spiral", "a strip of 10 000 quadrilaterals in 100 turns", lambda: spiral(n(10000), False)),
        ("flat spiral", "a flat strip of 3 000 quadrilaterals in 30 turns", lambda: spiral(n(3000), True)),
        ("touching sheets", "20 sheets of 1 600 faces that touch", lambda: joined(sheet(n(40, 2), 1e-4 * (1 + k)) for k in range(20))),
        ("shells", "10 000 tetrahedra", lambda: shells(n(10000))),
        ("cone", "a vertex of 50 000 triangles", lambda: fan((0, 0, 1), circle(n(50000)))),
        ("folded cone", "a vertex of 5 000 folds",
         lambda: fan((0, 0, 1), [(x, y, 0.3 * (k % 2)) for k, (x, y, _) in enumerate(circle(n(5000)))])),
        ("vertex", "2 000 separate triangles at one vertex", lambda: leaves(n(2000), 0)),
        ("leaves", "5 000 separate triangles around a centre", lambda: leaves(n(5000), 0.9)),
        ("tiles", "2 000 separate triangles in one plane", lambda: tiles(n(2000), True)),
        ("overlaps", "1 000 triangles in one plane, each on its neighbours", lambda: tiles(n(1000), False)),
        ("nested", "100 tetrahedra around one centre", lambda: nested(n(100))),
        ("collinear", "a triangle with 5 000 vertices on one side", lambda: ruled(n(5000))),
        ("splinters", "200 slivers on one long edge", lambda: splinters(n(200))),
        ("crossing small", "48 000 skewed quadrilaterals in a box, sides of a tenth", lambda: in_box(n(48000), 0.1)),
        ("crossing", "12 000 skewed quadrilaterals in a box, sides of a third", lambda: in_box(n(12000), 0.3)),
        ("crossing large", "4 800 skewed quadrilaterals in a box, as long as the box", lambda: in_box(n(4800), 1)),
        ("crumpled", "a sheet of 48 000 skewed quadrilaterals that cross their neighbours", lambda: crumpled(round(math.sqrt(n(48000))), 1)),
        ("crumpled more", "the same with vertices moved by up to 5 cells", lambda: crumpled(round(math.sqrt(n(48000))), 5)),
        ("tangled", "1 200 quadrilaterals between 300 random vertices", lambda: tangled(max(n(1200) // 4, 8), n(1200))),
    )


def write_obj(path, vertices, faces):
    lines = [*("v %.17g %.17g %.17g" % tuple(v) for v in vertices), *("f " + " ".join(str(k + 1) for k in face) for face in faces)]
    path.write_text("\n".join(lines) + "\n")


def call(worker, command, spec, where, most):
    """The JSON file of the worker's command or None, the error's code or None, and the CPU seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([worker, command, "-", "--output", where / command], input=json.dumps(spec), text=True, capture_output=True,
                          preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (most, most)))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if done.returncode < 0 or seconds >= most:
        return None, "stopped", seconds
    if done.returncode not in RESULTS:
        return None, json.loads(done.stderr.splitlines()[-1])["code"], seconds
    return json.loads((where / command / {"run": "report.json", "estimate": "estimate.json"}[command]).read_text()), None, seconds


def run(worker, mesh, count, most, where):
    """The spec, the report or None, the error's code or None, and the CPU seconds."""
    write_obj(where / "mesh.obj", *mesh)
    spec = {"version": 1, "surface": {"mesh": {"path": str(where / "mesh.obj")}}, "sampling": {"count": count},
            "solver": {"seed": 1, "threads": 1}, "output": {"preview": False}}
    return (spec, *call(worker, "run", spec, where, most))


def growth_row(worker, name, what, mesh, twice, count, most, where):
    (_, found, failed, used), (_, _, _, twice_used) = (run(worker, each, count, most, where / k) for k, each in (("one", mesh), ("two", twice)))
    return [name, what, len(mesh[1]), f"{used:.2f}", len(twice[1]), f"{twice_used:.2f}", f"{twice_used / used:.2f}", found["outcome"] if found else failed]


def row(worker, name, what, mesh, count, most, where):
    faces = mesh[1]
    spec, found, failed, used = run(worker, mesh, count, most, where)
    estimate = call(worker, "estimate", spec, where, most)[0]
    seconds = estimate["seconds"] if estimate else None
    return [name, what, len(faces), f"{used:.2f}", "" if seconds is None else f"{seconds:.2f}",
            "" if seconds is None or not found else f"{seconds / used:.2f}", found["outcome"] if found else failed]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worker", required=True)
    parser.add_argument("--output", type=pathlib.Path, required=True)
    parser.add_argument("--only", nargs="*", default=[""])
    parser.add_argument("--size", type=float, default=1)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--most", type=int, default=120)
    parser.add_argument("--growth", action="store_true")
    words = parser.parse_args()
    rows = []
    for (name, what, make), (_, _, make_twice) in zip(meshes(words.size), meshes(2 * words.size)):
        if not any(word in name for word in words.only):
            continue
        with tempfile.TemporaryDirectory() as where:
            folder = pathlib.Path(where)
            if words.growth:
                for k in ("one", "two"):
                    (folder / k).mkdir()
                rows.append(growth_row(words.worker, name, what, make(), make_twice(), words.count, words.most, folder))
            else:
                rows.append(row(words.worker, name, what, make(), words.count, words.most, folder))
        print(*rows[-1], sep=", ", flush=True)
        results.write(words.output, GROWTH if words.growth else HEADER, rows)
    return 1 if any(cells[-1] not in ("converged", "not_converged", "unresolved", "limit_memory") for cells in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
