#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Samples a sphere of triangles at four distances from the origin, reads every output by readers that share no code with hexad, and
measures the largest error of a position over the spacing (measurements/outputs/README.md).

    measurements/outputs/precision.py --worker build/hexad-worker --output measurements/outputs/precision.csv

The spacing is 1. Positions are compared with those of the same job written as text of doubles. glTF: translations, rotations and floats
of its nodes are composed in doubles; USD: xformOp:translate is added to the points in doubles; OpenVDB: the translation is read from the
bytes of the grid's transform and set to 0, the local values are those that vdb_tool writes, and both are added in doubles. Ends with 1
when an error is above 1e-3.
"""
import argparse
import functools
import json
import math
import pathlib
import re
import shutil
import struct
import subprocess
import sys
import tempfile

import numpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import results  # noqa: E402

OFFSETS = (0, 1e3, 1e6, 1e9)
HEADER = ["output", "error_at_0", "error_at_1e3", "error_at_1e6", "error_at_1e9"]
DIRECTION = numpy.array([1, -0.75, 0.5])
RADIUS = 4
BOUND = 1e-3
OUTPUTS = {"points_npz": True, "points_glb": True, "points_usda": True, "points_vdb": True, "mesh": True, "mesh_usda": True}


# ---- input

@functools.lru_cache
def icosphere(levels=2, radius=RADIUS):
    golden = (1 + 5 ** 0.5) / 2
    vertices = [(s * a, t * b, 0) for a, b in [(1, golden)] for s in (-1, 1) for t in (-1, 1)]
    vertices = [tuple(v[(k - r) % 3] for k in range(3)) for r in range(3) for v in vertices]
    vertices = [tuple(numpy.array(v) / numpy.linalg.norm(v)) for v in vertices]
    edge = min(numpy.linalg.norm(numpy.subtract(vertices[0], v)) for v in vertices[1:])
    near = [[numpy.linalg.norm(numpy.subtract(a, b)) < 1.1 * edge for b in vertices] for a in vertices]
    faces = [(a, b, c) for a in range(12) for b in range(a) for c in range(b) if near[a][b] and near[b][c] and near[a][c]]
    faces = [f if numpy.linalg.det([vertices[k] for k in f]) > 0 else f[::-1] for f in faces]
    for _ in range(levels):
        middle, split = {}, []

        def between(a, b):
            key = (min(a, b), max(a, b))
            if key not in middle:
                m = numpy.add(vertices[a], vertices[b])
                middle[key] = len(vertices)
                vertices.append(tuple(m / numpy.linalg.norm(m)))
            return middle[key]
        for a, b, c in faces:
            d, e, f = between(a, b), between(b, c), between(c, a)
            split += [(a, d, f), (d, b, e), (f, e, c), (d, e, f)]
        faces = split
    return radius * numpy.array(vertices), numpy.array(faces)


def write_ply(path, vertices, faces):
    head = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n" +
            "".join(f"property double {axis}\n" for axis in "xyz") +
            f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n").encode()
    path.write_bytes(head + numpy.asarray(vertices, "<f8").tobytes() + b"".join(struct.pack("<B3i", 3, *f) for f in faces))


# ---- readers

def read_ply(path):
    head, _, body = path.read_bytes().partition(b"end_header\n")
    words = [line.split() for line in head.decode().splitlines()]
    count = int([w for w in words if w[:2] == ["element", "vertex"]][0][2])
    upto = [w[:2] for w in words].index(["element", "face"]) if ["element", "face"] in [w[:2] for w in words] else len(words)
    properties = [w for w in words[:upto] if w[0] == "property"]
    names = [w[2] for w in properties]
    if words[1][1] == "ascii":
        rows = numpy.array([[float(v) for v in line.split()] for line in body.decode().splitlines()[:count]])
        return rows[:, [names.index(axis) for axis in "xyz"]]
    kinds = {"float": "<f4", "double": "<f8", "int": "<i4", "uint": "<u4", "uchar": "u1"}
    table = numpy.frombuffer(body, [(w[2], kinds[w[1]]) for w in properties], count)
    return numpy.stack([table[axis].astype(float) for axis in "xyz"], 1)


def read_npz(path):
    with numpy.load(path) as arrays:
        return arrays["position"]


def turn(q, v):
    """Vectors turned by a quaternion x y z w."""
    axis, w = numpy.array(q[:3]), q[3]
    return v + 2 * numpy.cross(axis, numpy.cross(axis, v) + w * v)


def read_glb(path):
    """Positions of the scene's points in its space, in doubles."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20:20 + length]), data[28 + length:]

    def place(index):
        node, found = document["nodes"][index], []
        if "mesh" in node:
            (primitive,) = document["meshes"][node["mesh"]]["primitives"]
            accessor = document["accessors"][primitive["attributes"]["POSITION"]]
            view = document["bufferViews"][accessor["bufferView"]]
            local = numpy.frombuffer(binary, "<f4", 3 * accessor["count"], view["byteOffset"]).reshape(-1, 3)
            assert accessor["min"] == local.min(0).tolist() and accessor["max"] == local.max(0).tolist()
            found.append(local.astype(float))
        found += [place(child) for child in node.get("children", [])]
        (points,) = found
        return turn(node.get("rotation", [0, 0, 0, 1]), points) + node.get("translation", [0, 0, 0])
    (top,) = document["scenes"][document["scene"]]["nodes"]
    return place(top)


def read_usda(path):
    text = path.read_text()
    (numbers,) = re.findall(r"^    point3f\[\] points = \[(.*)\]$", text, re.M)
    local = numpy.array([float(v) for v in re.findall(r"[^(), ]+", numbers)]).astype("f4").astype(float).reshape(-1, 3)
    translation = re.findall(r"^    double3 xformOp:translate = \((.*)\)$", text, re.M)
    if not translation:
        assert "xformOp" not in text
        return local
    assert '    uniform token[] xformOpOrder = ["xformOp:translate"]\n' in text
    return local + [float(v) for v in translation[0].split(",")]


def read_vdb(path):
    """In the order of vdb_tool."""
    data = bytearray(path.read_bytes())
    name = b"UniformScaleTranslateMap"
    at = data.index(name) + len(name)
    translation = numpy.array(struct.unpack_from("<3d", data, at))
    struct.pack_into("<3d", data, at, 0, 0, 0)
    with tempfile.TemporaryDirectory() as where:
        local = pathlib.Path(where)
        (local / "local.vdb").write_bytes(data)
        subprocess.run(["vdb_tool", "-read", local / "local.vdb", "-vdb2points", "-write", local / "local.ply"], check=True,
                       capture_output=True, timeout=60)
        return read_ply(local / "local.ply") + translation


READERS = {"points.ply": read_ply, "points.npz": read_npz, "points.glb": read_glb, "points.usda": read_usda, "points.vdb": read_vdb,
           "mesh.ply": read_ply, "mesh.usda": read_usda}


# ---- measuring

def run(worker, where, offset):
    """Samples the sphere twice: with all outputs, and as text of doubles. Returns the directory, the report and the positions."""
    vertices, faces = icosphere()
    write_ply(where / "sphere.ply", vertices + offset * DIRECTION, faces)
    for name, output in (("out", OUTPUTS), ("doubles", {"ply": {"precision": "double", "format": "ascii"}})):
        spec = {"version": 1, "surface": {"mesh": {"path": str(where / "sphere.ply"), "resolution": 40}}, "sampling": {"spacing": 1},
                "output": {"preview": False, **output}}
        (where / "spec.json").write_text(json.dumps(spec))
        done = subprocess.run([worker, "run", where / "spec.json", "--output", where / name], capture_output=True, text=True, timeout=300)
        assert done.returncode in (0, 10, 11), done.stderr
    return where / "out", json.loads((where / "out/report.json").read_text()), read_ply(where / "doubles/points.ply")


def error(name, where, report, positions):
    """The largest distance of a position of the file from the point that it is of, over the spacing."""
    read = READERS[name](where / name)
    if name == "points.glb" and report["up"] == "z":
        read = numpy.stack([read[:, 0], -read[:, 2], read[:, 1]], 1)
    assert read.shape == positions.shape
    if name == "points.vdb":  # another order
        apart = numpy.linalg.norm(read[:, None] - positions[None], axis=2)
        assert len(set(apart.argmin(1))) == len(positions)
        return apart.min(1).max() / report["spacing"]
    return numpy.linalg.norm(read - positions, axis=1).max() / report["spacing"]


def distance(positions, offset):
    """The largest distance of a point from the triangles, which are a convex body: from the plane that it is farthest out of."""
    vertices, faces = icosphere()
    corner = vertices[faces]
    normal = numpy.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= numpy.linalg.norm(normal, axis=1)[:, None]
    local = positions - offset * DIRECTION
    heights = numpy.einsum("pfk,fk->pf", local[:, None] - corner[None, :, 0], normal)
    return numpy.abs(heights.max(1)).max()


def main():
    options = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    options.add_argument("--worker", required=True, type=pathlib.Path)
    options.add_argument("--output", required=True, type=pathlib.Path)
    options = options.parse_args()
    names = [name for name in READERS if name != "points.vdb" or shutil.which("vdb_tool")]
    rows, worst = {name: [] for name in [*names, "distance"]}, 0
    for offset in OFFSETS:
        with tempfile.TemporaryDirectory() as directory:
            where, report, positions = run(options.worker.resolve(), pathlib.Path(directory), offset)
            for name in names:
                rows[name].append(error(name, where, report, positions))
            rows["distance"].append(distance(positions, offset) / report["spacing"])
            worst = max(worst, *(rows[name][-1] for name in rows))
    assert math.isfinite(worst)
    titles = {"distance": "distance of the doubles from the triangles"}
    lines = [[titles.get(name, name), *(f"{value:.1e}" for value in row)] for name, row in rows.items()]
    results.write(options.output, HEADER, lines)
    for line in lines:
        print(", ".join(f"{name} {value}" for name, value in zip(HEADER, line)))
    print(f"largest error {worst:.1e}, bound {BOUND:g}")
    return int(worst > BOUND)


if __name__ == "__main__":
    sys.exit(main())
