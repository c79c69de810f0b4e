# SPDX-License-Identifier: Apache-2.0
"""Inputs that several readers, or several writers of one format, can have: colours, names, materials, packages. field_variations.py has those
of which the surface alone is known."""
import random


import numpy
import pytest

import field_variations
import textured
from readers import read_columns

GRID = 9  # vertices along each side of a square


def square():
    at = numpy.stack(numpy.meshgrid(numpy.arange(GRID), numpy.arange(GRID)), -1).reshape(-1, 2).tolist()
    corners = [(GRID * j + i, GRID * j + i + 1, GRID * j + i + GRID + 1, GRID * j + i + GRID) for j in range(GRID - 1) for i in range(GRID - 1)]
    return at, corners


@pytest.fixture
def sample(solve):
    """The report and the columns of the points, or the error and None."""
    def run(path, **more):
        told, data = solve({"version": 1, "surface": {"mesh": {"path": str(path)}}, "sampling": {"count": 200},
                            "solver": {"threads": 1, "max_sweeps": 2}, "output": {"preview": False}, **more})
        return told, data and read_columns(data)
    return run


def write_ply(path, kind, color):
    at, corners = square()
    path.write_text(f"ply\nformat ascii 1.0\nelement vertex {len(at)}\nproperty float x\nproperty float y\nproperty float z\n" +
                    "".join(f"property {kind} {c}\n" for c in ("red", "green", "blue")) + f"element face {len(corners)}\n"
                    "property list uchar int vertex_indices\nend_header\n" + "".join("%d %d 0 %s\n" % (*p, color) for p in at) +
                    "".join("4 %d %d %d %d\n" % c for c in corners))
    return path


@pytest.mark.sanitized
@pytest.mark.parametrize("kind, color, right", (("uchar", "51 102 255", (.2, .4, 1)), ("ushort", "13107 26214 65535", (.2, .4, 1)), ("int", "51 102 255", (.2, .4, 1)),
                                                ("short", "51 102 255", (.2, .4, 1)), ("uint", "1 0 1", (1 / 255, 0, 1 / 255)), ("float", "0.2 0.4 1", (.2, .4, 1)),
                                                ("double", "51 102 255", (.2, .4, 1))))
def test_colours_of_ply_have_the_range_of_their_type(sample, tmp_path, kind, color, right):
    _, points = sample(write_ply(tmp_path / "m.ply", kind, color), attributes=[{"name": "color"}])
    for name, value in zip("rgb", right):
        assert points["color_" + name] == pytest.approx(value, abs=1e-6)


@pytest.mark.parametrize("kind, color", (("int", "51 102 256"), ("short", "-1 102 255"), ("float", "-0.1 0.5 1")))
def test_colours_of_ply_without_a_known_range_are_refused_by_their_type(sample, tmp_path, kind, color):
    told, _ = sample(write_ply(tmp_path / "m.ply", kind, color), attributes=[{"name": "color"}])
    assert told["code"] == "input_unsupported" and f'type "{kind}"' in told["message"]


def write_obj(path, libraries, names):
    at, corners = square()
    half = len(corners) // 2
    path.write_text(f"mtllib {libraries}\n" + "".join("v %d %d 0\n" % tuple(p) for p in at) +
                    "".join((f"usemtl {names[k == half]}\n" if k in (0, half) else "") + "f %d %d %d %d\n" % tuple(i + 1 for i in c) for k, c in enumerate(corners)))
    return path


@pytest.mark.parametrize("beside", ({"a.mtl": "one", "b.mtl": "two"}, {"a.mtl b.mtl": "one two"}))
def test_a_line_of_obj_names_one_library_or_several(sample, tmp_path, beside):
    colors = {"one": "1 0 0", "two": "0 0 1"}
    for name, materials in beside.items():
        (tmp_path / name).write_text("".join(f"newmtl {m}\nKd {colors[m]}\n" for m in materials.split()))
    _, points = sample(write_obj(tmp_path / "m.obj", "a.mtl b.mtl", ("one", "two")), attributes=[{"name": "base_color"}])
    assert points["base_color_r"].mean() == pytest.approx(.5, abs=.05) and points["base_color_b"].mean() == pytest.approx(.5, abs=.05)


def test_a_library_that_is_missing_is_named(sample, tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl one\nKd 1 0 0\n")
    told, _ = sample(write_obj(tmp_path / "m.obj", "a.mtl c.mtl", ("one", "two")), attributes=[{"name": "base_color"}])
    assert told["code"] == "input_missing" and "c.mtl" in told["message"]


def test_a_vertex_that_is_a_corner_twice_has_both_coordinates(sample, tmp_path):
    sides = 32
    angles = 2 * numpy.pi * numpy.arange(sides) / sides
    text = "mtllib g.mtl\n" + "".join("v %.9f %.9f 0\n" % (r * numpy.cos(a), r * numpy.sin(a)) for r in (3, 1) for a in angles)
    text += "".join("vt %.9f 0.5\n" % (k / sides) for k in range(sides + 1)) + "usemtl g\nf "
    outer = [(k % sides + 1, k + 1) for k in range(sides + 1)]
    inner = [(sides + k % sides + 1, k + 1) for k in range(sides, -1, -1)]
    (tmp_path / "m.obj").write_text(text + " ".join("%d/%d" % c for c in outer + inner) + "\n")
    (tmp_path / "g.mtl").write_text("newmtl g\nmap_Kd g.png\n")
    (tmp_path / "g.png").write_bytes(textured.png(numpy.arange(256, dtype="u1")[None, :, None], 0))
    _, points = sample(tmp_path / "m.obj", attributes=[{"name": "base_color"}])
    share = numpy.arctan2(points["y"], points["x"]) % (2 * numpy.pi) / (2 * numpy.pi)
    within = (share > .02) & (share < .98)
    assert numpy.abs(points["base_color_r"] - share)[within].max() < .08  # the triangles are long


@pytest.mark.sanitized
def test_kinds_of_inputs_are_read_or_refused(build):
    seed = random.randrange(2 ** 31)
    print("seed", seed)
    rng = random.Random(seed)
    groups = {}
    for name, kind, way, write in field_variations.kinds():
        groups.setdefault((name, kind), []).append((way, write))
    for (name, kind), found in rng.sample(sorted(groups.items()), 12):
        way, write = rng.choice(found)
        base, _, columns = field_variations.run(build / "hexad-worker", field_variations.base_of(name))
        exact = field_variations.positions_of(columns) if name.startswith("painted") else None
        verdict, why = field_variations.judge(build / "hexad-worker", write, base["surface"]["warnings"], base["surface"]["area"], exact, kind)
        assert verdict not in field_variations.FAULTS, (name, kind, way, why)


@pytest.mark.parametrize("name, kind, way, says", (
    ("gltf", field_variations.OLDER, "1.0", "glTF 1.0"), ("gltf", field_variations.SKIPPED, "hidden nodes", "not visible"),
    ("obj", field_variations.SKIPPED, "unknown words", "face"), ("obj", field_variations.INDEX_0, "counted from 0", "from 1"),
    ("3mf", field_variations.SKIPPED, "objects that are not built", "not in the build"), ("3mf", field_variations.TRANSFORM, "16 numbers", "more than twelve"),
    ("3mf", field_variations.TRANSFORM, "rubbish behind", "more than twelve")))
def test_refusals_say_what_was_found(build, name, kind, way, says):
    (write,) = (w for *of, w in field_variations.kinds() if of == [name, kind, way])
    report, message, _ = field_variations.run(build / "hexad-worker", write)
    assert report is None and says in message


def test_separate_buffers_of_draco_are_named(sample, tmp_path):
    (tmp_path / "m.gltf").write_text('{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], "meshes": [{"primitives": '
                                     '[{"attributes": {"POSITION": 0}, "extensions": {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}}]}], '
                                     '"accessors": [{"componentType": 5126, "type": "VEC3", "count": 3}], "bufferViews": [{"buffer": 0, "byteLength": 8}], '
                                     '"buffers": [{"byteLength": 8, "uri": "m.bin"}]}')
    told, _ = sample(tmp_path / "m.gltf")
    assert told["code"] == "input_missing" and '"m.bin" is a separate file' in told["message"]


def test_rims_of_far_parts_keep_their_shape(sample, tmp_path):
    text, first = "", 1
    angles = 2 * numpy.pi * numpy.arange(32) / 32
    for centre in (0, 5.8e6):
        text += "".join("v %.9f %.9f %d\n" % (centre + .3 * numpy.cos(a), .3 * numpy.sin(a), z) for z in (0, 3) for a in angles)
        text += "".join("f %d %d %d %d\n" % (first + k, first + (k + 1) % 32, first + 32 + (k + 1) % 32, first + 32 + k) for k in range(32))
        first += 64
    (tmp_path / "m.obj").write_text(text)
    report, _ = sample(tmp_path / "m.obj")
    assert report["surface"]["area"] == pytest.approx(2 * 3 * 32 * .6 * numpy.sin(numpy.pi / 32), rel=1e-6)
    assert not [w for w in report["surface"]["warnings"] if "joined" in w]
