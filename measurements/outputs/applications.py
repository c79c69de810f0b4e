# SPDX-License-Identifier: Apache-2.0
"""Opens a job's files with the programs that people open them with, and asserts what each shows (make applications).

Blender, Open3D, CloudCompare, ParaView, MeshLab and OpenImageIO, as Debian 12 has them, without a screen; those that are
not installed are named. Prints a line for each and fails if one shows something else.
"""
import argparse
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

import numpy

COUNT = 2000
SPEC = {"version": 1, "surface": {"analytic": {"shape": "quartic"}},
        "sampling": {"count": COUNT, "curvature": {"ratio": 2}},
        "output": {"preview": {"channels": "all"}, "preview_exr": True, "ply": {"properties": "blender"}, "points_glb": True, "points_npz": True,
                   "points_usda": True, "mesh": True}}
GLB = """
import bpy, json, numpy
numpy.bool = bool  # Debian's Blender asks Debian's NumPy for a name that it has no more
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath="points.glb")
thing = next(o for o in bpy.data.objects if o.type == "MESH")
print("shows:", json.dumps([len(thing.data.vertices), [c.name for c in thing.data.color_attributes],
                            list(max((thing.matrix_world @ v.co)[k] for v in thing.data.vertices) for k in range(3))]))
"""
PARAVIEW = """
from paraview.simple import *
reader = PLYReader(FileNames=["points.ply"])
reader.UpdatePipeline()
data = reader.PointData
print("shows:", reader.GetDataInformation().GetNumberOfPoints(), {data.GetArray(k).Name: data.GetArray(k).GetRange(0) for k in range(data.NumberOfArrays)})
"""
OPEN3D = """
import open3d, numpy
cloud = open3d.io.read_point_cloud("points.ply")
numpy.savez("open3d.npz", at=cloud.points, normal=cloud.normals, color=cloud.colors)
"""


def run(*command, **more):
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, **more)
    assert done.returncode == 0, f"{command[0]} ended with {done.returncode}: {done.stdout[-500:]}{done.stderr[-500:]}"
    return done.stdout + done.stderr


def shown(text):
    return re.search(r"^shows: (.*)$", text, re.M).group(1)


def blender_ply(given, source):
    text = run("blender", "--background", "--python", source / "share/blender/import_points.py", "--", "points.ply",
               "blender.png")
    assert f"hexad: {COUNT} points with" in text and " radius red" in text and "Cd " in text
    picture = run("oiiotool", "--stats", "blender.png") if shutil.which("oiiotool") else ""
    return "points, radius and colour by share/blender/import_points.py; blender.png " + " ".join(
        re.findall(r"Stats StdDev:\s*(.*)", picture)[:1])


def blender_glb(given, source):
    count, colors, most = json.loads(shown(run("blender", "--background", "--python-expr", GLB)))
    assert count == COUNT and colors, (count, colors)
    # Blender's z is up, as the set's is: the node's turn and the importer's cancel
    assert numpy.allclose(most, given["at"].max(0), atol=1e-5), most
    return f"{count} vertices, colours {' '.join(colors)}, upright"


def open3d(given, source):
    run("/usr/bin/python3", "-c", OPEN3D)
    with numpy.load("open3d.npz") as cloud:
        assert (cloud["at"].astype("f4") == given["at"]).all() and (cloud["normal"].astype("f4") == given["normal"]).all()
        assert numpy.abs(cloud["color"] * 255 - given["color"]).max() < 1e-6
    return "points, normals and colours, each as written"


def cloudcompare(given, source):
    run("CloudCompare", "-SILENT", "-AUTO_SAVE", "OFF", "-O", "points.ply", "-C_EXPORT_FMT", "ASC", "-PREC", "9", "-SAVE_CLOUDS",
        "FILE", "cloudcompare.asc")
    table = numpy.loadtxt("cloudcompare.asc")
    assert numpy.abs(table[:, :3] - given["at"]).max() < 1e-6 and (table[:, 3:6] == given["color"]).all()
    assert numpy.abs(table[:, -3:] - given["normal"]).max() < 5e-3  # it keeps directions of two bytes
    return "points, colours and normals"


def paraview(given, source):
    pathlib.Path("look.py").write_text(PARAVIEW)
    count, arrays = shown(run("pvpython", "--force-offscreen-rendering", "look.py")).split(" ", 1)
    assert int(count) == COUNT and "'RGB'" in arrays and "'Normals'" in arrays
    return "points, normals and colours"


def meshlab(given, source):
    run("xvfb-run", "-a", "meshlabserver", "-i", "points.ply", "-o", "meshlab.ply", "-m", "vc", "vn")
    head = pathlib.Path("meshlab.ply").read_bytes().partition(b"end_header")[0].decode("latin1")
    assert f"element vertex {COUNT}" in head and "uchar red" in head and " nx" in head
    return "points, normals and colours"


def openimageio(given, source):
    text = run("iinfo", "-v", "preview.exr")
    assert "P.X (float)" in text and "N.Z (float)" in text and "worldToCamera" in text
    return "preview.exr with all its channels and the camera"


CHECKS = [("Blender, points.ply", "blender", blender_ply), ("Blender, points.glb", "blender", blender_glb),
          ("Open3D", "/usr/lib/python3/dist-packages/open3d", open3d), ("CloudCompare", "CloudCompare", cloudcompare),
          ("ParaView", "pvpython", paraview), ("MeshLab", "meshlabserver", meshlab), ("OpenImageIO", "iinfo", openimageio)]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worker", type=pathlib.Path, required=True)
    parser.add_argument("--keep", type=pathlib.Path, help="a directory for the files; default: none stay")
    given = parser.parse_args()
    source, worker = pathlib.Path(__file__).resolve().parents[2], given.worker.resolve()
    os.environ["QT_QPA_PLATFORM"] = "offscreen"
    with tempfile.TemporaryDirectory() as scratch:
        where = (given.keep or pathlib.Path(scratch)).resolve()
        where.mkdir(parents=True, exist_ok=True)
        os.chdir(where)
        pathlib.Path("spec.json").write_text(json.dumps(SPEC))
        run(worker, "run", "spec.json", "--output", ".")
        with numpy.load("points.npz") as arrays:
            known = {"at": arrays["position"].astype("f4"), "normal": arrays["normal"].astype("f4"),
                     "color": numpy.round(arrays["rgb"] * 255)}
        failed = 0
        for name, needs, check in CHECKS:
            if not shutil.which(needs) and not os.path.isdir(needs):
                print(f"{name}: not installed")
                continue
            try:
                print(f"{name}: {check(known, source)}", flush=True)
            except (AssertionError, AttributeError) as fault:
                failed += 1
                print(f"{name}: FAILED: {fault}", flush=True)
    return failed > 0


sys.exit(main())
