#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Samples a mesh with one field of spacings, 10:1, as values of its vertices and as a volume, and writes how well the points keep
to the field (measurements/meshes/painted.csv).

    measurements/meshes/painted.py --worker build/hexad-worker --output measurements/meshes/painted.csv
                    [--data DIRECTORY] [--only WORD ...] [--count 10000] [--seeds 3]

DIRECTORY, or HEXAD_SHARED, has the folder meshes. Exponent and CV are computed here, from the request and the Voronoi cells
of points.ply. Medians over the seeds. A job misses a bound if it is farther than these from that of the volume.
"""
import os
import pathlib
import sys
import tempfile

import numpy

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1] / folder) for folder in ("common", "inputs")]
import graded  # noqa: E402
import inputs  # noqa: E402
import meshes  # noqa: E402
import results  # noqa: E402

MESH = "armadillo.obj"
RATIO = 10
VOXELS = 96  # along the longest side of the volume
WAVES = 2  # along the longest side


def ramp(x):
    """Linear along y; x is relative to the box of the mesh, from 0 to 1 along its longest side."""
    return 1 + (RATIO - 1) * numpy.clip(x[..., 1], 0, 1)


def waves(x):
    """Exponential of waves along all axes."""
    return RATIO ** (0.5 + 0.5 * numpy.sin(2 * numpy.pi * WAVES * x).prod(axis=-1))


FIELDS = {"ramp": ramp, "waves": waves}


def write_volume(path, field, low, side):
    import pyopenvdb
    at = (numpy.arange(VOXELS + 9) - 4) / VOXELS
    values = field(numpy.stack(numpy.meshgrid(at, at, at, indexing="ij"), -1))
    grid = pyopenvdb.FloatGrid(1.0)
    grid.copyFromArray(values.astype(numpy.float32), ijk=(-4, -4, -4))
    grid.transform = pyopenvdb.createLinearTransform(voxelSize=side / VOXELS)
    grid.transform.translate(low.tolist())
    grid.name = "spacing"
    pyopenvdb.write(str(path), grids=[grid])


def write_ply(path, mesh, values, of_color):
    """The values as the property quality, or as the red of colours: of 255 steps, from 1/RATIO to 1."""
    columns = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), *([(c, "u1") for c in ("red", "green", "blue")] if of_color else [("quality", "<f4")])]
    table = numpy.zeros(len(mesh.vertices), columns)
    for k, axis in enumerate("xyz"):
        table[axis] = mesh.vertices[:, k]
    table["red" if of_color else "quality"] = numpy.rint(255 * values / RATIO) if of_color else values
    faces = numpy.zeros(len(mesh.triangles), [("n", "u1"), ("corner", "<i4", 3)])
    faces["n"], faces["corner"] = 3, mesh.triangles
    words = {"<f4": "float", "u1": "uchar"}
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}", *(f"property {words[t]} {n}" for n, t in columns),
            f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    path.write_bytes("\n".join(head).encode() + table.tobytes() + faces.tobytes())


def write_vtk(path, mesh, values):
    """A legacy file, as text."""
    lines = ["# vtk DataFile Version 3.0", "painted", "ASCII", "DATASET POLYDATA", f"POINTS {len(mesh.vertices)} double",
             *("%.9g %.9g %.9g" % tuple(v) for v in mesh.vertices), f"POLYGONS {len(mesh.triangles)} {4 * len(mesh.triangles)}",
             *("3 %d %d %d" % tuple(t) for t in mesh.triangles), f"POINT_DATA {len(values)}", "SCALARS size float", "LOOKUP_TABLE default",
             *("%.9g" % v for v in values)]
    path.write_text("\n".join(lines) + "\n")


def maps(mesh, field, box, work):
    """The member sampling.grid for each way of writing the field; the volume first."""
    low, side = box
    values = field((mesh.vertices - low) / side)
    write_volume(work / "map.vdb", field, low, side)
    write_ply(work / "quality.ply", mesh, values, False)
    write_ply(work / "color.ply", mesh, values, True)
    write_vtk(work / "size.vtk", mesh, values)
    return {"volume": {"path": str(work / "map.vdb"), "name": "spacing"}, "PLY quality": {"path": str(work / "quality.ply"), "name": "quality"},
            "PLY red": {"path": str(work / "color.ply"), "name": "color", "component": 0}, "VTK": {"path": str(work / "size.vtk"), "name": "size"}}


def figures(grid, field, box, options, work):
    """Medians over the seeds: exponent, CV, CV of the request over the field, hex_fraction, coverage, CPU seconds; and the outcomes."""
    found, outcomes = [], set()
    low, side = box
    for seed in range(1, options.seeds + 1):
        path = pathlib.Path(options.data) / "meshes" / MESH
        points, report, spent = graded.run(os.path.abspath(options.worker), path, {"sampling": {"grid": grid}}, options.count, seed, work)
        request = points.spacing / field((points.position - low) / side)
        found.append([*graded.keeping(points, False), request.std() / request.mean(), report["quality"]["hex_fraction"],
                      report["quality"]["coverage"], spent])
        outcomes.add(report["outcome"].replace("_", " "))
    return numpy.median(numpy.array(found, float), axis=0), ", ".join(sorted(outcomes))


HEADER = ("job", "mesh", "field", "map", "exponent", "spacing_cv", "request_cv", "hex_fraction", "coverage", "outcome", "cpu_s", "missed")


def main():
    parser = inputs.parser_of(__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10000)
    parser.add_argument("--seeds", type=int, default=3)
    options = inputs.arguments(parser)
    mesh, rows = meshes.read(pathlib.Path(options.data) / "meshes" / MESH), []
    low = mesh.vertices.min(axis=0)
    box = low, float((mesh.vertices.max(axis=0) - low).max())
    with tempfile.TemporaryDirectory() as scratch:
        work = pathlib.Path(scratch)
        for name, field in FIELDS.items():
            of_volume = None
            for way, grid in maps(mesh, field, box, work).items():
                if options.only and not any(word in f"{name} {way}" for word in (*options.only, "volume")):
                    continue
                found, outcome = figures(grid, field, box, options, work)
                of_volume = found if of_volume is None else of_volume
                missed = graded.missed_bounds(found, of_volume, "amplitudes")
                rows.append([f"{MESH} {name} {way}", MESH, name, way, *(f"{v:.4f}" for v in found[:3]), *(f"{v:.3f}" for v in found[3:5]), outcome,
                             f"{found[5]:.1f}", " ".join(missed)])
                results.write(options.output, HEADER, rows)
                print(*rows[-1], sep=", ", flush=True)
    return 1 if any(row[-1] for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
