# SPDX-License-Identifier: Apache-2.0
"""Meshes in formats that few files of the collection have: the same box with sides of 1, 2 and 3, beside OBJ. Each stands where its
file says, and pictures have the axis up that files of its kind have."""
import base64
import json
import struct
import zipfile

import numpy
import pytest

CORNERS = numpy.array([(x, y, z) for z in (0, 3) for y in (0, 2) for x in (0, 1)], "f4")
FACES = numpy.array([(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4),
                     (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5)])


def write_obj(path):
    path.write_text("".join("v %g %g %g\n" % tuple(v) for v in CORNERS) + "".join("f %d %d %d\n" % tuple(f + 1) for f in FACES))


def write_off(path):
    path.write_text(f"OFF\n{len(CORNERS)} {len(FACES)} 0\n" + "".join("%g %g %g\n" % tuple(v) for v in CORNERS) +
                    "".join("3 %d %d %d\n" % tuple(f) for f in FACES))


def write_stl(path):
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *CORNERS[f].ravel(), 0) for f in FACES)
    path.write_bytes(bytes(80) + struct.pack("<I", len(FACES)) + rows)


def gltf(uri=None):
    """The document, and its binary part."""
    data = CORNERS.tobytes() + FACES.astype("<u2").tobytes()
    buffer = {"byteLength": len(data), **({"uri": uri(data)} if uri else {})}
    return {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "buffers": [buffer],
            "nodes": [{"mesh": 0}], "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 96}, {"buffer": 0, "byteOffset": 96, "byteLength": 72}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3", "min": [0, 0, 0], "max": [1, 2, 3]},
                          {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"}]}, data


def write_gltf(path):
    document, _ = gltf(lambda data: "data:application/octet-stream;base64," + base64.b64encode(data).decode())
    path.write_text(json.dumps(document))


def write_glb(path):
    document, data = gltf()
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data)) + struct.pack("<I4s", len(text), b"JSON") + text +
                     struct.pack("<I4s", len(data), b"BIN\0") + data)


def write_fbx(path):
    numbers = ",".join(f"{v:g}" for v in CORNERS.ravel())
    corners = ",".join(f"{a},{b},{-c - 1}" for a, b, c in FACES)
    path.write_text(f"""; FBX 7.3.0 project file
FBXHeaderExtension:  {{
    FBXHeaderVersion: 1003
    FBXVersion: 7300
}}
GlobalSettings:  {{
    Version: 1000
    Properties70:  {{
        P: "UpAxis", "int", "Integer", "",1
        P: "UnitScaleFactor", "double", "Number", "",1
    }}
}}
Objects:  {{
    Geometry: 1001, "Geometry::box", "Mesh" {{
        Vertices: *24 {{
            a: {numbers}
        }}
        PolygonVertexIndex: *36 {{
            a: {corners}
        }}
        GeometryVersion: 124
    }}
    Model: 2001, "Model::box", "Mesh" {{
        Version: 232
    }}
}}
Connections:  {{
    C: "OO",2001,0
    C: "OO",1001,2001
}}
""")


def write_dae(path, up="Y_UP"):
    numbers = " ".join(f"{v:g}" for v in CORNERS.ravel())
    path.write_text(f"""<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified><up_axis>{up}</up_axis></asset>
<library_geometries><geometry id="box"><mesh>
<source id="p"><float_array id="pa" count="24">{numbers}</float_array>
<technique_common><accessor source="#pa" count="8" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/><p>{" ".join(map(str, FACES.ravel()))}</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#box"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
""")


def write_3mf(path):
    vertices = "".join('<vertex x="%g" y="%g" z="%g"/>' % tuple(v) for v in CORNERS)
    triangles = "".join('<triangle v1="%d" v2="%d" v3="%d"/>' % tuple(f) for f in FACES)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("[Content_Types].xml", """<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>""")
        archive.writestr("_rels/.rels", """<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Target="/3D/3dmodel.model" Id="rel0"
Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>""")
        archive.writestr("3D/3dmodel.model", f"""<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>
<object id="1" type="model"><mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh></object>
</resources><build><item objectid="1"/></build></model>""")


@pytest.mark.parametrize("name, up", [("obj", "y"), ("off", "y"), ("stl", "z"), ("gltf", "y"), ("glb", "y"), ("fbx", "y"), ("dae", "y"),
                                      ("3mf", "z")])
def test_a_box(worker, tmp_path, name, up):
    path = tmp_path / f"box.{name}"
    globals()[f"write_{name}"](path)
    done = worker({"version": 1, "surface": {"mesh": {"path": str(path), "resolution": 60}}, "sampling": {"count": 150},
                   "output": {"preview": False}})
    assert done.returncode in (0, 10, 11), done.stderr
    report = json.loads((tmp_path / "out/report.json").read_text())
    box = report["surface"]["bounding_box"]
    assert numpy.allclose(box["min"], 0, atol=0.05) and numpy.allclose(box["max"], (1, 2, 3), atol=0.05), box
    assert report["surface"]["area"] == pytest.approx(22, rel=0.02) and report["up"] == up
    assert not [w for w in report["surface"]["warnings"] if "from byte" in w]


def write_ply(path, layout="ascii"):
    head = (f"ply\nformat {layout} 1.0\nelement vertex {len(CORNERS)}\n" + "".join(f"property float {axis}\n" for axis in "xyz") +
            f"element face {len(FACES)}\nproperty list uchar int vertex_indices\nend_header\n").encode()
    if layout == "ascii":
        rows = "".join("%g %g %g\n" % tuple(v) for v in CORNERS) + "".join("3 %d %d %d\n" % tuple(f) for f in FACES)
        path.write_bytes(head + rows.encode())
    else:
        path.write_bytes(head + CORNERS.tobytes() + b"".join(struct.pack("<B3i", 3, *f) for f in FACES))


def write_text_stl(path):
    facets = "".join("facet normal 0 0 0\nouter loop\n" + "".join("vertex %g %g %g\n" % tuple(CORNERS[k]) for k in f) +
                     "endloop\nendfacet\n" for f in FACES)
    path.write_text(f"solid box\n{facets}endsolid box\n" + "solid none\nendsolid none\n")


@pytest.mark.sanitized
@pytest.mark.parametrize("name, write", [("stl", write_stl), ("stl", write_text_stl), ("off", write_off), ("ply", write_ply),
                                         ("ply", lambda path: write_ply(path, "binary_little_endian"))])
def test_what_follows_a_mesh_in_its_file_is_told(worker, tmp_path, name, write):
    """Another mesh behind it is not read, which the report says; blanks and zeros behind it are nothing."""
    path, other = tmp_path / f"box.{name}", tmp_path / "other.stl"
    write(path)
    write_stl(other)
    one = path.read_bytes()
    for more in (b"\n\0\0\n", other.read_bytes()[:10] + b"x" + other.read_bytes()):
        path.write_bytes(one + more)
        done = worker({"version": 1, "surface": {"mesh": {"path": str(path)}}, "sampling": {"count": 150}, "output": {"preview": False}})
        assert done.returncode in (0, 10, 11), done.stderr
        surface = json.loads((tmp_path / "out/report.json").read_text())["surface"]
        told = [w for w in surface["warnings"] if f"from byte {len(one)} on" in w]
        assert surface["area"] == pytest.approx(22, rel=0.02) and len(told) == (len(more) > 10), surface


def write_obj(path):
    path.write_text("# a box\n\no box\n" + "".join("v %g %g %g\n" % tuple(c) for c in CORNERS) +
                    "".join("f %d %d %d\n" % tuple(k + 1 for k in f) for f in FACES))


@pytest.mark.parametrize("name, write", [("stl", write_stl), ("stl", write_text_stl), ("off", write_off), ("ply", write_ply),
                                         ("obj", write_obj)])
def test_a_file_without_an_ending_is_read(worker, tmp_path, name, write):
    """As an upload that was sent without one."""
    path = tmp_path / "box"
    write(path)
    done = worker({"version": 1, "surface": {"mesh": {"path": str(path)}}, "sampling": {"count": 150}, "output": {"preview": False}})
    assert done.returncode in (0, 10, 11), done.stderr
    surface = json.loads((tmp_path / "out/report.json").read_text())["surface"]
    assert surface["area"] == pytest.approx(22, rel=0.02)
    assert not any("ending" in warning for warning in surface["warnings"]), surface["warnings"]


def test_a_mesh_stands_on_its_base(worker, tmp_path):
    """A pyramid stands along the axis of its base, whatever files of its kind mostly do, unless the spec says otherwise."""
    base = numpy.array([(0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0), (.5, .5, 2)])
    faces = numpy.array([(0, 1, 2), (0, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)])

    def up(name, corners, **preview):
        path = tmp_path / name
        if path.suffix == ".obj":
            path.write_text("".join("v %g %g %g\n" % tuple(v) for v in corners) + "".join("f %d %d %d\n" % tuple(f + 1) for f in faces))
        else:
            rows = b"".join(struct.pack("<12fH", 0, 0, 0, *corners[f].astype("f4").ravel(), 0) for f in faces)
            path.write_bytes(bytes(80) + struct.pack("<I", len(faces)) + rows)
        done = worker({"version": 1, "surface": {"mesh": {"path": str(path)}}, "sampling": {"count": 400},
                       "output": {"points_usda": True, "preview": {"size": 96, **preview}}})
        assert done.returncode in (0, 10, 11), done.stderr
        axis = json.loads((tmp_path / "out/report.json").read_text())["up"]
        assert f'upAxis = "{axis.upper()}"' in (tmp_path / "out/points.usda").read_text()
        return axis
    lying = base[:, [1, 2, 0]]  # along y
    assert [up("p.obj", base), up("p.obj", lying), up("p.stl", base), up("p.stl", lying)] == ["z", "y", "z", "y"]
    assert up("p.obj", base, up="y") == "y"


@pytest.mark.parametrize("byte", [b"\n", b"\r"])
def test_data_of_a_ply_may_begin_as_a_line_ends(worker, tmp_path, byte):
    """One of 128 binary files begins with such a byte."""
    write_ply(tmp_path / "box.ply", "binary_little_endian")
    head, end, data = (tmp_path / "box.ply").read_bytes().partition(b"end_header\n")
    (tmp_path / "box.ply").write_bytes(head + end + byte + data[1:])  # the first x is all but 0
    done = worker({"version": 1, "surface": {"mesh": {"path": str(tmp_path / "box.ply")}}, "sampling": {"count": 150},
                   "output": {"preview": False}})
    assert done.returncode in (0, 10, 11), done.stderr
    assert json.loads((tmp_path / "out/report.json").read_text())["surface"]["area"] == pytest.approx(22, rel=0.02)


def test_words_about_files_are_the_users(worker, tmp_path):
    """Errors name the file as the user does, and tell which memory is meant."""
    def fails(name, limit=None, **members):
        done = worker({"version": 1, "surface": {"mesh": {"path": str(tmp_path / name), **members}}, "sampling": {"count": 150},
                       "output": {"preview": False}, **({"limits": {"memory_mb": limit}} if limit else {})})
        error = json.loads(done.stderr.splitlines()[-1])
        assert str(tmp_path / name) in error["message"], error
        return error["code"], error["message"]
    (tmp_path / "mine.dae").write_bytes(b"no triangles are in this file" * 9)
    code, words = fails("mine.dae")
    assert code == "input_damaged" and "mesh.dae" not in words and "line 1 is not valid XML" in words
    (tmp_path / "mine.stl").write_bytes(b"no triangles are in this file" * 9)
    code, words = fails("mine.stl")
    assert code == "input_damaged" and 'does not begin with "solid"' in words and "has 261 of" in words
    write_ply(tmp_path / "mine.ply", "binary_little_endian")
    whole = (tmp_path / "mine.ply").read_bytes()
    (tmp_path / "mine.ply").write_bytes(whole.replace(b"list uchar int vertex_indices", b"list uchar int vertex_places_"))
    code, words = fails("mine.ply")
    assert code == "input_damaged" and 'no list "vertex_indices"' in words
    write_obj(tmp_path / "box.obj")
    code, words = fails("box.obj", limit=64, voxel_size=0.003)
    assert code == "limit_memory" and "MiB are left of the limit" in words and "raise limits.memory_mb" in words


def test_a_property_without_a_name_is_refused_with_its_line(worker, tmp_path):
    (tmp_path / "mine.ply").write_bytes(b"ply\nformat binary_little_endian 1.0\ncomment made by hand\nelement vertex 8\n"
                                        b"property float x\nproperty float y\nproperty \0\0\0\t\7\0\0\0\3\0\0\0\3\3\0\0\0\7\0\0\0"
                                        b"\4\0\0\0\3\3\0\0\0\4\0\0\0\0\0\0\0")
    done = worker({"version": 1, "surface": {"mesh": {"path": "mine.ply"}}, "sampling": {"count": 150}})
    error = json.loads(done.stderr.splitlines()[-1])
    assert done.returncode == 3 and error["code"] == "input_damaged", error
    assert "mine.ply: line 7 of the header of the PLY file" in error["message"], error


def test_usd_is_not_read(worker, tmp_path):
    (tmp_path / "box.usda").write_text('#usda 1.0\ndef Mesh "box" {\n}\n')
    done = worker({"version": 1, "surface": {"mesh": {"path": str(tmp_path / "box.usda")}}, "sampling": {"count": 150}})
    assert done.returncode == 3 and json.loads(done.stderr.splitlines()[-1])["code"] == "input_unsupported", done.stderr


def test_what_is_up_in_pictures(worker, tmp_path):
    """Of a camera without an up it is the axis of the file's kind, unless the spec says one; a file of COLLADA that stands along z is
    turned, and stands along y."""
    def run(path, **preview):
        camera = {"position": [9, 8, 7], "target": [0.5, 1, 1.5]}
        done = worker({"version": 1, "surface": {"mesh": {"path": str(path), "resolution": 40}}, "sampling": {"count": 150},
                       "output": {"preview": {"size": 96, "camera": {**camera, **preview.pop("camera", {})}, **preview}}})
        assert done.returncode in (0, 10, 11), done.stderr
        report = json.loads((tmp_path / "out/report.json").read_text())
        return report["up"], report["spec"]["output"]["preview"]["camera"]["up"], report["surface"]["bounding_box"]["max"]
    write_glb(tmp_path / "box.glb")
    write_stl(tmp_path / "box.STL")
    write_dae(tmp_path / "box.dae", "Z_UP")
    assert run(tmp_path / "box.glb")[:2] == ("y", [0, 1, 0])
    assert run(tmp_path / "box.STL")[:2] == ("z", [0, 0, 1])
    assert run(tmp_path / "box.STL", up="y")[:2] == ("y", [0, 1, 0])
    assert run(tmp_path / "box.glb", camera={"up": [0, 0, 1]})[:2] == ("y", [0, 0, 1])
    up, _, highest = run(tmp_path / "box.dae")
    assert up == "y" and numpy.allclose(highest, (1, 3, 0), atol=0.05)
