# SPDX-License-Identifier: Apache-2.0
"""FBX, COLLADA and glTF with Draco, which assimp reads: positions, units, axes, several parts, transforms and attributes. What
assimp does not apply is refused or warned about by name. Its other formats are refused."""
import json

import numpy
import pytest

import library_meshes as write
from mesh_files import FACES, box
from readers import read_columns


@pytest.fixture
def r():
    seed = numpy.random.SeedSequence().entropy % 2 ** 32
    print("seed", seed)
    return numpy.random.default_rng(seed)


@pytest.fixture
def look(worker, tmp_path):
    """(surface of the report, columns of the points), or the error. Each corner of the mesh has a point."""
    def call(path, count=1500, attributes=()):
        done = worker({"version": 1, "surface": {"mesh": {"path": str(path)}}, "sampling": {"count": count}, "solver": {"max_sweeps": 1},
                       "attributes": [{"name": name} if name != "normal" else {"name": name, "as": "given"} for name in attributes], "output": {"preview": False, "ply": {"precision": "double"}}})
        if done.returncode not in (0, 10, 11):
            return json.loads(done.stderr.splitlines()[-1])
        surface = json.loads((tmp_path / "out/report.json").read_text())["surface"]
        surface["notes"] = [w for w in surface["warnings"] if "walls thinner" not in w]
        return surface, read_columns((tmp_path / "out/points.ply").read_bytes())
    return call


def positions(points):
    return numpy.stack([points[axis] for axis in "xyz"], 1)


def boxes(r, count, **members):
    """Boxes that do not touch, each with a node of its own."""
    return [write.Part(box(r) + (20 * k, 0, 0), FACES, r.integers(-9, 9, 3), (r.standard_normal(3), r.uniform(-1.4, 1.4)), 2.0 ** r.integers(-1, 3, 3),
                       **members) for k in range(count)]


def assert_corners(found, parts):
    """Each corner of each part has a point, and there is nothing else."""
    assert isinstance(found, tuple), found
    at, scale = positions(found[1]), max(numpy.abs(p.vertices).max() for p in parts)
    for part in parts:
        away = numpy.linalg.norm(part.vertices[:, None] - at[None], axis=2).min(axis=1)
        assert away.max() < 2e-5 * scale, (away, at)
    every = numpy.concatenate([p.vertices for p in parts])
    assert numpy.allclose(at.min(0), every.min(0), atol=2e-5 * scale) and numpy.allclose(at.max(0), every.max(0), atol=2e-5 * scale)
    assert found[0]["mesh"]["triangles"] == sum(len(p.faces) for p in parts) and found[0]["mesh"]["open_edges"] == 0


@pytest.mark.sanitized
@pytest.mark.parametrize("ending", write.WRITERS)
def test_parts_with_transforms_are_placed(look, tmp_path, r, ending):
    parts = boxes(r, 3)
    write.WRITERS[ending](tmp_path / f"boxes.{ending}", parts)
    found = look(tmp_path / f"boxes.{ending}")
    assert_corners(found, parts)
    assert found[0]["notes"] == []


@pytest.mark.parametrize("ending", write.WRITERS)
def test_attributes_of_vertices_are_read(look, tmp_path, r, ending):
    """A sheet whose values are linear in x and y."""
    flat = numpy.array([(0, 0, 0), (4, 0, 0), (0, 4, 0), (4, 4, 0)], float)
    uv = flat[:, :2] / 4
    color = numpy.c_[uv[:, 0], uv[:, 1], 0.5 * numpy.ones((4, 1)), numpy.ones((4, 1))]
    turned = write.rotation((1, 2, 3), 0.7)
    members = {"uv": uv, "normal": numpy.tile(turned[:, 2], (4, 1)), "color": color}
    part = write.Part(flat @ turned.T, [(0, 1, 2), (2, 1, 3)], (1, 2, 3), ((0, 1, 0), 0.4), (1, 2, 1), **members)
    write.WRITERS[ending](tmp_path / f"sheet.{ending}", [part])
    found = look(tmp_path / f"sheet.{ending}", 40, members)
    assert isinstance(found, tuple), found
    points = found[1]
    at = positions(points) @ turned / 4
    t = 1 - at[:, 1] if ending == "glb" else at[:, 1]  # glTF counts from the top of the picture
    assert numpy.allclose(points["uv_s"], at[:, 0], atol=1e-5) and numpy.allclose(points["uv_t"], t, atol=1e-5)
    normal = numpy.stack([points[f"given_{axis}"] for axis in "xyz"], 1)
    assert numpy.allclose(normal, turned[:, 2], atol=1e-5)
    # glTF has linear colours, which become sRGB
    red = at[:, 0].clip(0, 1)
    expected = red if ending != "glb" else numpy.where(red <= 0.0031308, 12.92 * red, 1.055 * red ** (1 / 2.4) - 0.055)
    corner = numpy.abs(at[:, :2] - at[:, :2].round()).max(axis=1) < 1e-6  # the library's colours are exact at corners
    assert corner.sum() >= 4
    assert numpy.allclose(points["color_r"][corner], expected[corner], atol=0.6 / 255)
    assert numpy.allclose(points["color_a"], 1, atol=0.6 / 255)


# ---- FBX

def test_pivots_and_rotations_of_an_fbx_are_honoured(look, tmp_path):
    """Roff Rp Rpre R Rp^-1 Soff Sp S Sp^-1 behind the translation, and the geometric transform before all of it."""
    def move(v):
        m = numpy.eye(4)
        m[:3, 3] = v
        return m

    def linear(m):
        out = numpy.eye(4)
        out[:3, :3] = m
        return out

    def turn(degrees, order="XYZ"):
        m = numpy.eye(3)
        for axis in order:
            k = "XYZ".index(axis)
            m = write.rotation(numpy.eye(3)[k], numpy.radians(degrees[k])) @ m
        return linear(m)
    corners, names = box(numpy.random.default_rng(4)), ("XYZ", "XZY", "YZX", "YXZ", "ZXY", "ZYX")
    for number, order in enumerate(names):
        properties = [write.fbx_property(name, kind, *values) for name, kind, *values in (
            ("RotationActive", "bool", 1), ("RotationOrder", "enum", number), ("PreRotation", "Vector3D", -90, 0, 15), ("RotationOffset", "Vector3D", 5, 6, 7),
            ("RotationPivot", "Vector3D", 1, 2, 3), ("ScalingPivot", "Vector3D", 3, 1, 2), ("GeometricTranslation", "Vector3D", 1, 1, 9),
            ("Lcl Rotation", "Lcl Rotation", 10, 20, 30), ("Lcl Scaling", "Lcl Scaling", 1, 2, 4), ("Lcl Translation", "Lcl Translation", 7, 8, 9))]
        text = write.fbx_text([write.Part(corners, FACES)], properties=[properties])
        for name in ("Translation", "Rotation", "Scaling"):  # those of the part come first
            text = text.replace(next(k for k in text.splitlines(True) if f"Lcl {name}" in k), "", 1)
        (tmp_path / "box.fbx").write_text(text)
        m = (move((7, 8, 9)) @ move((5, 6, 7)) @ move((1, 2, 3)) @ turn((-90, 0, 15)) @ turn((10, 20, 30), order) @ move((-1, -2, -3)) @
             move((3, 1, 2)) @ linear(numpy.diag([1., 2, 4])) @ move((-3, -1, -2)) @ move((1, 1, 9)))
        assert_corners(look(tmp_path / "box.fbx"), [write.Part(corners @ m[:3, :3].T + m[:3, 3], FACES)])


FBX_NOTES = {"unit": ([write.fbx_property("UnitScaleFactor", "double", 100.0)], [], "unit of the file is 100 cm"),
             "axis": ([write.fbx_property("UpAxis", "int", 2), write.fbx_property("UpAxisSign", "int", 1)], [], "the up axis of the file is z"),
             "hidden": ([], [write.fbx_property("Show", "bool", 0)], "1 nodes are hidden"),
             "spheric": ([], [write.fbx_property("RotationOrder", "enum", 6)], "Unsupported RotationMode")}


@pytest.mark.parametrize("name", FBX_NOTES)
def test_what_an_fbx_has_that_is_not_applied_is_warned_of(look, tmp_path, r, name):
    settings, properties, words = FBX_NOTES[name]
    part = write.Part(box(r), FACES, turn=((0, 0, 1), 0.5 if name == "spheric" else 0))
    (tmp_path / "box.fbx").write_text(write.fbx_text([part], settings, [properties]))
    found = look(tmp_path / "box.fbx")
    assert_corners(found, [write.Part(part.local(), FACES)])  # without the rotation
    assert len(found[0]["notes"]) == 1 and words in found[0]["notes"][0], found[0]["notes"]


def test_nodes_of_an_fbx_below_others_are_placed(look, tmp_path, r):
    """The scale of the parent applies, unless InheritType says otherwise, which is warned of."""
    inner, outer = box(r), box(r) + (40, 0, 0)
    parts = [write.Part(outer, FACES, (1, 2, 3), scale=(2, 2, 2)), write.Part(inner, FACES, (5, 0, 0))]
    placed = [write.Part(outer, FACES), write.Part(inner * 2 + (1, 2, 3), FACES)]
    (tmp_path / "boxes.fbx").write_text(write.fbx_text(parts, parents={1: 0}))
    found = look(tmp_path / "boxes.fbx")
    assert_corners(found, placed)
    assert found[0]["notes"] == []
    (tmp_path / "boxes.fbx").write_text(write.fbx_text(parts, properties=[[], [write.fbx_property("InheritType", "enum", 2)]], parents={1: 0}))
    assert any("InheritType" in note for note in look(tmp_path / "boxes.fbx")[0]["notes"])


# ---- COLLADA

@pytest.mark.parametrize("up", ["X_UP", "Y_UP", "Z_UP"])
@pytest.mark.parametrize("meter", [1, 0.01, 0.0254])
def test_a_collada_is_read_in_metres_and_y_up(look, tmp_path, r, up, meter):
    parts = boxes(r, 2)
    (tmp_path / "boxes.dae").write_text(write.collada_text(parts, up, meter))
    assert_corners(look(tmp_path / "boxes.dae"), parts)


def test_transforms_of_a_collada_are_honoured(look, tmp_path, r):
    """A matrix, and a camera's lookat, which moves the node to the eye and looks along -z."""
    corners = box(r)
    (tmp_path / "box.dae").write_text(write.collada_text([write.Part(corners, FACES)], nodes=["<matrix>0 -2 0 1 2 0 0 2 0 0 4 3 0 0 0 1</matrix>"]))
    assert_corners(look(tmp_path / "box.dae"), [write.Part(corners @ numpy.array([[0, -2, 0], [2, 0, 0], [0, 0, 4]]).T + (1, 2, 3), FACES)])
    (tmp_path / "box.dae").write_text(write.collada_text([write.Part(corners, FACES)], nodes=["<lookat>7 8 10 7 8 0 0 1 0</lookat>"]))
    assert_corners(look(tmp_path / "box.dae"), [write.Part(corners + (7, 8, 10), FACES)])


@pytest.mark.sanitized
def test_a_skew_of_a_collada_is_refused_by_name(look, tmp_path, r):
    (tmp_path / "box.dae").write_text(write.collada_text([write.Part(box(r), FACES)], nodes=["<skew>45 0 1 0 1 0 0</skew>"]))
    error = look(tmp_path / "box.dae")
    assert error["code"] == "input_unsupported" and "<skew>" in error["message"], error


@pytest.mark.parametrize("node, words", [('<node><instance_node url="other.dae#x"/></node>', "Unresolved reference format of node"),
                                         ('<node><instance_geometry url="#nowhere"/></node>', 'Unable to find geometry for ID "nowhere"')])
def test_a_reference_of_a_collada_that_is_not_in_the_file_is_warned_of(look, tmp_path, r, node, words):
    part = write.Part(box(r), FACES)
    (tmp_path / "box.dae").write_text(write.collada_text([part], scene=node))
    found = look(tmp_path / "box.dae")
    assert_corners(found, [part])
    assert any(words in note for note in found[0]["notes"]), found[0]["notes"]


@pytest.mark.parametrize("old, new, words", [('count="12"', 'count="11"', "declares 11 triangles"), ('count="12"', 'count="0"', "declares 0 triangles"), ('count="24"', 'count="23"', "declares 23 numbers and has 24"),
                                             ('count="8"', 'count="8x"', 'is "8x"'), ("<scale>", "<scale>7 ", "has 4 numbers and not 3"),
                                             ('<p>', '<p>0,5 ', '"0,5"'), ('count="12"', 'count="12" count="12"', "not valid XML")])
def test_a_collada_that_its_data_contradict_is_refused_with_the_line(look, tmp_path, r, old, new, words):
    text = write.collada_text([write.Part(box(r), FACES)])
    assert old in text
    (tmp_path / "box.dae").write_text(text.replace(old, new))
    error = look(tmp_path / "box.dae")
    assert error["code"] == "input_damaged" and words in error["message"] and "line 2" in error["message"], error


def test_a_property_that_an_fbx_has_twice_is_refused_with_the_line(look, tmp_path, r):
    twice = write.fbx_property("Lcl Scaling", "Lcl Scaling", 2, 2, 2)
    text = write.fbx_text([write.Part(box(r), FACES)], properties=[[twice]])
    (tmp_path / "box.fbx").write_text(text)
    error = look(tmp_path / "box.fbx")
    line = text[:text.index(twice)].count("\n") + 1
    assert error["code"] == "input_damaged" and f"line {line}" in error["message"] and 'the property "Lcl Scaling" for the second time' in error["message"], error


@pytest.mark.parametrize("old, new", [("Vertices: *24", "Vertices: *25"), ("Vertices: *24", "Vertices: *21"), ("PolygonVertexIndex: *36", "PolygonVertexIndex: *33")])
def test_an_array_of_an_fbx_that_is_not_what_it_declares_is_refused_with_the_line(look, tmp_path, r, old, new):
    text = write.fbx_text([write.Part(box(r), FACES)])
    assert old in text
    (tmp_path / "box.fbx").write_text(text.replace(old, new))
    error = look(tmp_path / "box.fbx")
    assert error["code"] == "input_damaged" and f"declares {new.split('*')[1]} numbers and has {old.split('*')[1]}" in error["message"], error


# ---- other formats of assimp

# what assimp recognises by bytes or by the ending of the name
OTHERS = {"a.x": b"xof 0303txt 0032\nMesh {\n3;\n0;0;0;,\n1;0;0;,\n0;1;0;;\n1;\n3;0,1,2;;\n}\n",
          "a.mesh": b"MeshVersionFormatted 1\nDimension 3\n", "a.ms3d": b"MS3D000000\4\0\0\0\0\0\0\0\0\0",
          "a.blend": b"BLENDER-v304", "a.lwo": b"FORM\0\0\0\4LWO2", "a.ac": b"AC3Db\nOBJECT world\nkids 0\n",
          "a.nff": b"p 3\n0 0 0\n1 0 0\n0 1 0\n", "a.md2": b"IDP2\x08\0\0\0", "a.raw": b"0 0 0 1 0 0 0 1 0\n",
          "a.ifc": b"ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('IFC2X3'));\nENDSEC;\n", "a.ASE": b"*3DSMAX_ASCIIEXPORT 200\n",
          "a.ogex": b"Metric (key = \"distance\") {float {1}}", "a.irrmesh": b"<?xml version=\"1.0\"?>\n<mesh/>",
          "a.q3o": b"quick3Do00000000", "a.xgl": b"<WORLD><MESH/></WORLD>", "a.ndo": b"nendo 1.1",
          "a.b3d": b"BB3D\0\0\0\0", "a.cob": b"Caligari V00.01ALH", "a.iqm": b"INTERQUAKEMODEL\0",
          "a.pmx": b"PMX ", "a.smd": b"version 1\nnodes\nend\n", "a.off.x": b"xof 0302txt 0064\n",
          "x.obj.bin": b"xof 0303txt 0032\nMesh {\n3;\n0;0;0;,\n1;0;0;,\n0;1;0;;\n1;\n3;0,1,2;;\n}\n"}


@pytest.mark.sanitized
@pytest.mark.parametrize("name", OTHERS)
def test_the_other_formats_of_the_library_are_refused_with_a_converter(worker, tmp_path, name):
    data = OTHERS[name]
    (tmp_path / name).write_bytes(data)
    done = worker({"version": 1, "surface": {"mesh": {"path": str(tmp_path / name)}}, "sampling": {"count": 100}})
    error = json.loads(done.stderr.splitlines()[-1])
    assert error["code"] == "input_unsupported", error
    assert "its format is not known" in error["message"] and "assimp export" in error["message"] or "NRRD header" in error["message"], error
