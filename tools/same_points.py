#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the same specs with two workers and compares the bytes of all outputs that hold points.

    tools/same_points.py --worker build/hexad-worker --reference WORKER --data DIRECTORY

DIRECTORY has the folders meshes, cases, vdb, volumes and exr. Prints a row for each spec: the outcome of each worker and the files that
differ. Exit status 1: a file or an outcome differs. For changes that must not change results: comments, names, messages, moved code.
Reports and previews are not compared. Files have all properties, unless the spec chooses them.
"""
import argparse
import hashlib
import json
import os
import pathlib
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "measurements" / "common"))
import levelsets  # noqa: E402

POINTS = ("points.ply", "points.npz", "points.glb", "points.usda", "points.vdb", "mesh.ply", "mesh.usda")


def jobs(data, work):
    """Name and spec, without version and seed."""
    ball = {"analytic": {"shape": "sphere", "radius": 0.3}}
    torus = {"analytic": {"shape": "torus", "major_radius": 0.3, "minor_radius": 0.12}}
    box = {"analytic": {"shape": "box", "half_size": [0.4, 0.3, 0.2], "rounding": 0.02}}
    levelsets.write_torus(1.0, 0.4, 0.02, work / "torus.vdb")
    torus_grid = {"vdb": {"path": str(work / "torus.vdb")}}

    def mesh(name, folder="meshes", **more):
        return {"mesh": {"path": str(data / folder / name), **more}}

    def vdb(name, folder="vdb", **more):
        return {"vdb": {"path": str(data / folder / name), **more}}

    def volume(name, isovalue, folder="volumes", **more):
        return {"volume": {"path": str(data / folder / name), "isovalue": isovalue, **more}}

    def with_count(surface, count=2000, **more):
        return {"surface": surface, "sampling": {"count": count}, **more}

    def with_sampling(surface, **sampling):
        return {"surface": surface, "sampling": {"count": 2000, **sampling}}

    # formulas
    yield "sphere", with_count(ball)
    yield "torus, all outputs", with_count(torus, output={name: True for name in ("points_npz", "points_glb", "points_usda", "points_vdb", "mesh",
                                                                                    "mesh_usda", "orient")})
    yield "rounded box, ASCII, double", with_count(box, output={"ply": {"format": "ascii", "precision": "double"}})
    yield "gyroid", with_count({"analytic": {"shape": "gyroid", "period": 0.5}})
    yield "cylinder", with_count({"analytic": {"shape": "cylinder", "radius": 0.2, "height": 0.6}})
    yield "cone", with_count({"analytic": {"shape": "cone", "radius": 0.3, "height": 0.6, "top_radius": 0.1}})
    yield "ellipsoid, curvature", with_sampling({"analytic": {"shape": "ellipsoid", "radii": [0.4, 0.2, 0.1]}}, curvature={"ratio": 5})
    yield "torus, alpha", with_sampling(torus, alpha={"d": 2})
    yield "torus, spacing", {"surface": torus, "sampling": {"spacing": 0.03}}
    yield "quartic, paper", {"surface": {"analytic": {"shape": "quartic"}}, "sampling": {"count": 600}, "solver": {"method": "paper"}}
    yield "quartic, Witkin-Heckbert", {"surface": {"analytic": {"shape": "quartic"}}, "sampling": {"count": 400},
                                       "solver": {"method": "witkin-heckbert"}}
    yield "torus, Gaussian energy", {"surface": torus, "sampling": {"count": 800}, "solver": {"energy": "gaussian"}}
    # combinations
    yield "union", with_count({"union": [ball, box]})
    yield "difference", with_count({"difference": [box, ball]})
    yield "intersection of a grid and a formula", with_count({"intersection": [torus_grid, {"analytic": {
        "shape": "halfspace", "center": [0, 0, 0], "axis": [1, 0, 0]}}]})
    yield "offset", with_count({"offset": {"surface": torus, "distance": 0.03}})
    # meshes
    for name in ("spot.obj", "fandisk.off", "cycloidal.ply", "42400-IDGH.stl", "stanford-bunny.obj", "truck.obj", "lucy_100k.ply"):
        yield name, with_count(mesh(name))
    yield "suzanne.obj, graded, progressive", {"surface": mesh("suzanne.obj"), "sampling": {"count": 2000, "curvature": {"ratio": 4}},
                                               "output": {"order": "progressive"}}
    yield "spot.obj, level set", with_count(mesh("spot.obj", resolution=128))
    for name in ("inch.3mf", "quantized.glb", "zero_area.ply", "comb.obj"):
        yield name, with_count(mesh(name, "cases"))
    # volumes
    yield "level set", with_count(torus_grid, 10000)
    yield "ls_cube_half.vdb", with_count(vdb("ls_cube_half.vdb"))
    yield "smoke1_half.vdb", with_count(vdb("smoke1_half.vdb", grid="density", isovalue=0.3), 3000)
    yield "vpt_dragon_rotated_xform.vdb", with_count(vdb("vpt_dragon_rotated_xform.vdb", isovalue=0.3))
    yield "noflood.vdb", with_count(vdb("noflood.vdb", "cases"))
    yield "tooth.nhdr", with_count(volume("tooth.nhdr", 600))
    yield "example4d.nii.gz", with_count(volume("example4d.nii.gz", 400, index=0))
    yield "HeadMRVolume.mhd, smoothing", with_count(volume("HeadMRVolume.mhd", 60, reconstruction="smoothing"), 3000)
    yield "offset0.nii", with_count(volume("offset0.nii", 0.5, "cases"), 500)
    yield "fmob-c4h.nrrd", with_count(volume("fmob-c4h.nrrd", 0.5))
    yield "frogtissue.mhd, labels", with_count({"labels": {"path": str(data / "volumes" / "frogtissue.mhd")}}, 5000)
    yield "EXR slices", with_count({"exr": {"path": str(data / "exr" / "displaywindow" / "t##.exr"), "slices": "1-8", "channel": "R", "isovalue": 0.3}}, 500)


def is_default_all(worker):
    """Builds without the word "all" write all properties."""
    return " all: " not in subprocess.run([worker, "spec-help", "output/ply/properties"], capture_output=True, text=True).stdout.replace("\n", " ")


def run(worker, spec, out):
    if not is_default_all(worker):
        output = spec["output"]
        spec = {**spec, "output": {**output, "ply": {"properties": ["all"], **output.get("ply", {})}}}
    done = subprocess.run([worker, "run", "-", "--output", out], input=json.dumps(spec), capture_output=True, text=True)
    found = {name: hashlib.sha256((out / name).read_bytes()).hexdigest() for name in POINTS if (out / name).exists()}
    if not found:
        return (done.stderr.strip().splitlines() or ["?"])[-1][:70], found
    return json.loads((out / "report.json").read_text())["outcome"], found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True)
    parser.add_argument("--reference", required=True)
    parser.add_argument("--data", type=pathlib.Path, required=True)
    options = parser.parse_args()
    print("| spec | reference | worker | files | different |\n|---|---|---|---|---|")
    total = different = 0
    with tempfile.TemporaryDirectory() as folder:
        work = pathlib.Path(folder)
        for name, spec in jobs(options.data, work):
            spec = {"version": 1, **spec, "solver": {"seed": 1, "threads": 1, **spec.get("solver", {})}}
            spec["output"] = {"preview": False, **spec.get("output", {})}
            results = [run(os.path.abspath(w), spec, work / f"{total}.{k}") for k, w in enumerate((options.reference, options.worker))]
            (before, old), (after, new) = results
            unlike = [n for n in POINTS if old.get(n) != new.get(n)]
            different += bool(unlike) or before != after
            total += 1
            print(f"| {name} | {before} | {after} | {len(old)} | {', '.join(unlike)} |", flush=True)
    print(f"\n{total} specs, {different} with a difference")
    return different > 0


if __name__ == "__main__":
    sys.exit(main())
