#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Samples meshes with hexad and with ACVD, and measures the points and the CPU time of both (measurements/meshes/README.md).

    HEXAD_ACVD=PATH measurements/meshes/remeshers.py --worker build/hexad-worker --output measurements/meshes/remeshers.csv
                    [--data FOLDER] [--meshes cow.obj ...] [--counts 2000 20000] [--runs 3] [--commit NAME]

HEXAD_ACVD names the executable ACVD (github.com/valette/ACVD, commit 27555498). FOLDER has the meshes; default: HEXAD_SHARED/meshes. Each
tool reads the same triangles from a PLY file and uses one thread. The runs of the tools alternate, so that other work on the machine
affects each of them. mesh_measures.py measures the positions of the last run, relative to the spacing of a hexagonal packing with this
number of points.
"""
import argparse
import json
import os
import pathlib
import shutil
import statistics
import sys
import tempfile

import numpy

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1] / folder) for folder in ("common", "speed")]
import measure  # noqa: E402
import mesh_measures  # noqa: E402
import meshes  # noqa: E402
import prepared_inputs  # noqa: E402
import results  # noqa: E402
import samplers  # noqa: E402

MESHES = ("cow.obj", "bunny_pmp.off", "fandisk.off")
COUNTS = (2000, 20000)
LIMIT_S = 3600
HEADER = ("job", "tool", "mesh", "requested", "points", "cpu_s_least", "cpu_s_median", "cpu_ratio", "peak_mb", "hex_fraction", "edge_cv",
          "area_cv", "min_spacing_ratio", "coverage", "residual_spacings", "runs", "commit")


def hexad(worker, mesh, count, work, output):
    """Positions, and what the run took."""
    spec = {"version": 1, "surface": {"mesh": {"path": str(mesh)}}, "sampling": {"count": count}, "solver": {"threads": 1},
            "output": {"preview": False, **output}}
    (work / "spec.json").write_text(json.dumps(spec), encoding="utf-8")
    job = work / "job"
    shutil.rmtree(job, ignore_errors=True)
    took = samplers.timed([worker, "run", work / "spec.json", "--output", job], LIMIT_S)
    if took["code"] not in (0, 10, 11):
        raise samplers.Failed(f"hexad failed with {took['code']}: {took['said']}")
    return samplers.read_ply_positions(job / "points.ply"), took


def acvd(program, mesh, count, work, ratio):
    """ACVD with its defaults, except `ratio`: the vertices for each point to which it subdivides the triangles."""
    output = work / "acvd"
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir()
    took = samplers.timed([program, mesh, count, 0, "-s", ratio, "-o", f"{output}/", "-of", "points.ply"], LIMIT_S)
    if took["code"] != 0 or not (output / "points.ply").exists():
        raise samplers.Failed(f"ACVD failed with {took['code']}: {took['said']}")
    return samplers.read_ply_positions(output / "points.ply"), took


def tools_of(worker, program):
    """Name -> function of the file, the count and a folder for work."""
    tools = {"hexad": lambda *job: hexad(worker, *job, {}), "hexad with mesh.ply": lambda *job: hexad(worker, *job, {"mesh": True})}
    if program:
        tools["ACVD"] = lambda *job: acvd(program, *job, 10)
        tools["ACVD fine"] = lambda *job: acvd(program, *job, 100)
    return tools


def rows_of(name, mesh, count, tools, runs, work, commit):
    """A row of HEADER for each tool."""
    path = work / "input.ply"
    prepared_inputs.write_ply(path, mesh.vertices, mesh.triangles)
    took, positions = {tool: [] for tool in tools}, {}
    for _ in range(runs):
        for tool, run in tools.items():
            positions[tool], used = run(path, count, work)
            took[tool].append(used)
    rows, own = [], statistics.median(used["cpu_s"] for used in took["hexad"])
    for tool, position in positions.items():
        seconds = [used["cpu_s"] for used in took[tool]]
        found = mesh_measures.measure(mesh, position, numpy.full(len(position), measure.ideal_spacing(mesh.area, count)))
        rows.append([f"{name} {count} {tool}", tool, name, count, len(position), f"{min(seconds):.2f}", f"{statistics.median(seconds):.2f}",
                     f"{statistics.median(seconds) / own:.2f}", f"{max(used['peak_mb'] for used in took[tool]):.0f}",
                     f"{found.hex_fraction:.3f}", f"{found.edge_cv:.3f}", f"{found.area_cv:.3f}", f"{found.min_spacing_ratio:.3f}",
                     f"{found.coverage:.2f}", f"{found.max_residual:.0e}", runs, commit])
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True, type=lambda name: pathlib.Path(name).resolve())
    parser.add_argument("--output", required=True, type=pathlib.Path)
    parser.add_argument("--data", type=pathlib.Path)
    parser.add_argument("--meshes", nargs="+", default=MESHES)
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--commit", default="")
    options = parser.parse_args()
    data = options.data or (pathlib.Path(os.environ["HEXAD_SHARED"]) / "meshes" if "HEXAD_SHARED" in os.environ else None)
    if not data:
        raise SystemExit("The folder of the meshes is not given: set HEXAD_SHARED, or use --data.")
    program = os.environ.get("HEXAD_ACVD")
    if not program:
        print("HEXAD_ACVD does not name the executable ACVD: only hexad is measured.", file=sys.stderr)
    rows = []
    with tempfile.TemporaryDirectory() as work:
        for file in options.meshes:
            mesh = meshes.read(data / file)
            for count in options.counts:
                rows += rows_of(pathlib.Path(file).stem, mesh, count, tools_of(options.worker, program), options.runs, pathlib.Path(work),
                                options.commit)
                results.write(options.output, HEADER, rows)
                for row in rows[-len(tools_of(options.worker, program)):]:
                    print(*row, sep=", ", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
