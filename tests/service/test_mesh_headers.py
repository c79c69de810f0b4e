# SPDX-License-Identifier: Apache-2.0
"""Header fields of mesh files that change positions or units, at values that are not their default: each file holds the same box, whose
corners have points. Files of formats that are not read are named with a converter."""
import re
import base64
import json
import struct
import zipfile

import numpy
import pytest

import mesh_files as write
from readers import read_columns

NAN, INF = float("nan"), float("inf")


@pytest.fixture
def r():
    seed = numpy.random.SeedSequence().entropy % 2 ** 32
    print("seed", seed)
    return numpy.random.default_rng(seed)


@pytest.fixture
def look(worker, tmp_path):
    """The mesh of a file, a box: its area and warnings, and the box around its points, of which eight are at the corners; or the error."""
    def call(path):
        done = worker({"version": 1, "surface": {"mesh": {"path": str(path)}}, "sampling": {"count": 30}, "solver": {"max_sweeps": 1},
                       "output": {"preview": False, "ply": {"precision": "double"}}})
        if done.returncode not in (0, 10, 11):
            return json.loads(done.stderr.splitlines()[-1])
        surface = json.loads((tmp_path / "out/report.json").read_text())["surface"]
        points = read_columns((tmp_path / "out/points.ply").read_bytes())
        at = numpy.stack([points[axis] for axis in "xyz"], 1)
        return {"area": surface["mesh"]["area"], "triangles": surface["mesh"]["triangles"], "closed": surface["mesh"]["open_edges"] == 0,
                "bounding_box": {"min": at.min(0), "max": at.max(0)}, "notes": [w for w in surface["warnings"] if "walls thinner" not in w]}
    return call


@pytest.fixture
def inspect(worker):
    def call(path):
        done = worker(str(path), "--json", output=None, command="inspect")
        answer = json.loads((done.stdout if done.returncode == 0 else done.stderr).splitlines()[-1])
        return answer["mesh"] if done.returncode == 0 else answer
    return call


def assert_box(found, corners, exact=1e-12):
    assert "bounding_box" in found, found
    scale = numpy.abs(corners).max()
    assert numpy.allclose(found["bounding_box"]["min"], corners.min(0), rtol=0, atol=exact * scale), (found, corners)
    assert numpy.allclose(found["bounding_box"]["max"], corners.max(0), rtol=0, atol=exact * scale), (found, corners)
    assert found["area"] == pytest.approx(write.area(corners), rel=max(20 * exact, 1e-9) * scale)
    assert found["closed"] and found["triangles"] == 12


# ---- glTF

@pytest.mark.parametrize("kind, normalised, stride", [("u1", False, 4), ("i1", False, 8), ("<u2", False, 8), ("<i2", False, 12),
                                                      ("u1", True, 4), ("i1", True, 4), ("<u2", True, 8), ("<i2", True, 8)])
def test_quantised_positions_of_gltf_are_read(look, tmp_path, r, kind, normalised, stride):
    corners = write.box(r)
    write.quantised(tmp_path / "box.glb", corners, kind, normalised, stride)
    found = look(tmp_path / "box.glb")
    assert_box(found, corners)
    assert found["notes"] == []


@pytest.mark.sanitized
@pytest.mark.parametrize("name", ["nested_nodes", "sparse", "sparse_of_nothing", "without_indices", "strips", "fans", "far_node"])
@pytest.mark.parametrize("ending", ["glb", "gltf"])
def test_nodes_and_accessors_of_gltf_are_honoured(look, tmp_path, r, name, ending):
    corners = write.box(r)
    getattr(write, name)(tmp_path / f"box.{ending}", corners)
    assert_box(look(tmp_path / f"box.{ending}"), corners, 1e-12 if name != "far_node" else 1e-8)


def test_a_translation_of_a_node_keeps_the_digits_of_the_file(look, tmp_path):
    """Floats hold 1e9 to 64."""
    g, corners = write.Gltf(), write.box(numpy.random.default_rng(1))
    mesh = g.mesh(g.accessor(corners, "<f4"), g.accessor(write.FACES.ravel(), "<u2"))
    g.document["nodes"] = [{"mesh": mesh, "translation": [1e9, -1e9, 12345678.25]}]
    g.write(tmp_path / "far.glb")
    assert_box(look(tmp_path / "far.glb"), corners + (1e9, -1e9, 12345678.25), 1e-15)


@pytest.mark.sanitized
@pytest.mark.parametrize("extension", ["EXT_meshopt_compression", "MSFT_lod", "EXT_mesh_gpu_instancing", "VENDOR_shape", "KHR_gaussian_splatting"])
def test_an_extension_that_a_gltf_requires_is_refused_by_its_name(look, tmp_path, r, extension):
    g = write.Gltf(extensionsUsed=[extension], extensionsRequired=["KHR_mesh_quantization", extension])
    g.document["nodes"] = [{"mesh": g.mesh(g.accessor(write.box(r), "<f4"), g.accessor(write.FACES.ravel(), "<u2"))}]
    g.write(tmp_path / "box.glb")
    error = look(tmp_path / "box.glb")
    assert error["code"] == "input_unsupported" and extension in error["message"], error


def test_what_a_gltf_has_beside_its_places_is_warned_of(look, tmp_path, r):
    """Skins, weights of morph targets, instances, and meshes outside of the scene are not applied."""
    corners = write.box(r)
    g = write.Gltf(extensionsUsed=["EXT_mesh_gpu_instancing"], skins=[{"joints": [0]}])
    mesh = g.mesh(g.accessor(corners, "<f4"), g.accessor(write.FACES.ravel(), "<u2"))
    g.mesh(g.accessor(9 * corners, "<f4"))
    g.document["nodes"] = [{"mesh": mesh, "skin": 0, "weights": [0, 0.5],
                            "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {}}}}]
    g.write(tmp_path / "box.glb")
    found = look(tmp_path / "box.glb")
    assert_box(found, corners)
    notes = " ".join(found["notes"])
    for word in ("1 of 2 meshes", "skin", "morph", "EXT_mesh_gpu_instancing"):
        assert word in notes, notes


def test_a_node_does_not_move_a_mesh_with_a_skin(look, worker, tmp_path, r):
    """Its joints do (glTF 2.0, 3.7.3.1)."""
    corners = write.box(r)
    g = write.Gltf(skins=[{"joints": [1]}])
    mesh = g.mesh(g.accessor(corners, "<f4"), g.accessor(write.FACES.ravel(), "<u2"))
    g.document["nodes"] = [{"mesh": mesh, "skin": 0, "translation": [100, 0, 0], "scale": [3, 3, 3]}, {"name": "joint"}]
    g.write(tmp_path / "box.glb")
    found = look(tmp_path / "box.glb")
    assert_box(found, corners.astype("f4").astype(float))
    assert "1 meshes have a skin" in " ".join(found["notes"])


def test_values_of_quantised_gltf_are_read(worker, tmp_path, r):
    """At places in doubles: each point has the colour that its place has."""
    corners = write.box(r)
    g = write.Gltf(extensionsRequired=["KHR_mesh_quantization"])
    low, size = corners.min(0), numpy.ptp(corners, axis=0)
    position = g.accessor(numpy.round((corners - low) / size * 65535), "<u2", 8)
    colour = g.accessor((corners - low) / size, "<f4")
    mesh = g.mesh(position, g.accessor(write.FACES.ravel(), "<u2"))
    g.document["meshes"][mesh]["primitives"][0]["attributes"]["COLOR_0"] = colour
    g.document["nodes"] = [{"mesh": mesh, "scale": (size / 65535).tolist(), "translation": low.tolist()}]
    g.write(tmp_path / "box.glb")
    done = worker({"version": 1, "surface": {"mesh": {"path": str(tmp_path / "box.glb")}}, "sampling": {"count": 200},
                   "attributes": [{"name": "color"}], "output": {"preview": False, "ply": {"precision": "double"}}})
    assert done.returncode in (0, 10, 11), done.stderr
    points = read_columns((tmp_path / "out/points.ply").read_bytes())
    at = (numpy.stack([points[axis] for axis in "xyz"], 1) - low) / size
    corner = numpy.abs(at - at.round()).max(axis=1) < 1e-6
    assert corner.sum() >= 8
    assert numpy.allclose(numpy.stack([points[f"color_{c}"] for c in "rgb"], 1)[corner], at[corner].round(), atol=1e-4)


def test_nodes_that_are_not_visible_are_skipped_with_those_below(look, worker, tmp_path, r):
    corners = write.box(r)
    g = write.Gltf(extensionsUsed=["KHR_node_visibility"], extensionsRequired=["KHR_node_visibility"], scenes=[{"nodes": [0, 1]}])
    mesh = g.mesh(g.accessor(corners, "<f4"), g.accessor(write.FACES.ravel(), "<u2"))
    hidden = {"extensions": {"KHR_node_visibility": {"visible": False}}}
    shown = {"extensions": {"KHR_node_visibility": {"visible": True}}}
    g.document["nodes"] = [{"mesh": mesh, **shown}, {"mesh": mesh, "translation": [100, 0, 0], "children": [2], **hidden},
                           {"mesh": mesh, "translation": [100, 0, 0], **shown}]
    g.write(tmp_path / "box.glb")
    found = look(tmp_path / "box.glb")
    assert_box(found, corners.astype("f4").astype(float))
    assert "1 nodes are not visible" in " ".join(found["notes"])
    done = worker({"version": 1, "surface": {"mesh": {"path": str(tmp_path / "box.glb")}}, "sampling": {"count": 30},
                   "attributes": [{"name": "group"}], "output": {"preview": False}})
    assert done.returncode in (0, 10, 11), done.stderr
    report = json.loads((tmp_path / "out/report.json").read_text())
    (group,) = [a for a in report["attributes"] if a["name"] == "group"]
    assert group["minimum"] == group["maximum"] == 0


@pytest.mark.parametrize("extension", ["CESIUM_RTC", "VENDOR_shape", "MSFT_lod"])
def test_an_extension_that_a_gltf_uses_and_that_is_not_known_is_named(look, tmp_path, r, extension):
    g = write.Gltf(extensionsUsed=["KHR_materials_unlit", extension])
    g.document["nodes"] = [{"mesh": g.mesh(g.accessor(write.box(r), "<f4"), g.accessor(write.FACES.ravel(), "<u2"))}]
    g.write(tmp_path / "box.glb")
    notes = look(tmp_path / "box.glb")["notes"]
    assert len(notes) == 1 and f"the glTF extension {extension} is not read" in notes[0], notes


@pytest.mark.parametrize("components", [3, 4])
def test_colours_of_a_gltf_are_linear(worker, tmp_path, r, components):
    """0.2158605 in linear light is 0.5 in sRGB (IEC 61966-2-1); three components are opaque."""
    g = write.Gltf()
    position, indices = g.accessor(write.box(r), "<f4"), g.accessor(write.FACES.ravel(), "<u2")
    colour = g.add({"bufferView": g.view(numpy.tile(numpy.array([0.21586050, 0, 1, 0.25][:components], "<f4"), (8, 1)).tobytes()),
                    "componentType": 5126, "count": 8, "type": f"VEC{components}"})
    mesh = g.mesh(position, indices)
    g.document["meshes"][mesh]["primitives"][0]["attributes"]["COLOR_0"] = colour
    g.document["nodes"] = [{"mesh": mesh}]
    g.write(tmp_path / "box.glb")
    done = worker({"version": 1, "surface": {"mesh": {"path": str(tmp_path / "box.glb")}}, "sampling": {"count": 30}, "solver": {"max_sweeps": 1},
                   "attributes": [{"name": "color"}], "output": {"preview": False}})
    assert done.returncode in (0, 10, 11), done.stderr
    points = read_columns((tmp_path / "out/points.ply").read_bytes())
    expected = (0.5, 0, 1, 0.25 if components == 4 else 1)
    for axis, value in zip("rgba", expected):
        assert numpy.allclose(points[f"color_{axis}"], value, atol=0.6 / 255), axis


def test_base64_data_may_be_percent_encoded(look, tmp_path, r):
    corners = write.box(r)
    g = write.Gltf()
    g.document["nodes"] = [{"mesh": g.mesh(g.accessor(corners, "<f4"), g.accessor(write.FACES.ravel(), "<u2"))}]
    g.write(tmp_path / "box.gltf")
    document = json.loads((tmp_path / "box.gltf").read_text())
    head, data = document["buffers"][0]["uri"].split(",")
    document["buffers"][0]["uri"] = head + "," + "".join(f"%{ord(c):02x}" if k % 3 == 0 or c in "+/=" else c for k, c in enumerate(data))
    (tmp_path / "box.gltf").write_text(json.dumps(document))
    assert_box(look(tmp_path / "box.gltf"), corners.astype("f4").astype(float))


@pytest.mark.parametrize("uri", ["box.bin", "data.bin", "a%20b.bin", "buffers/x.dat", "Box_0.buffer"])
def test_a_separate_file_of_a_gltf_is_reported_as_missing(look, tmp_path, r, uri):
    g = write.Gltf()
    g.document["nodes"] = [{"mesh": g.mesh(g.accessor(write.box(r), "<f4"), g.accessor(write.FACES.ravel(), "<u2"))}]
    g.write(tmp_path / "box.gltf", uri=uri)
    error = look(tmp_path / "box.gltf")
    assert error["code"] == "input_missing" and f'"{uri}" is a separate file' in error["message"] and ".glb" in error["message"], error


@pytest.mark.sanitized
@pytest.mark.parametrize("damage, words", [
    (lambda d: d["accessors"][0].update(count=9), "accessor 0"), (lambda d: d["accessors"][1].update(count=37), "accessor 1"),
    (lambda d: d["accessors"][0].update(type="VEC4"), "accessor 0"), (lambda d: d["bufferViews"][0].update(byteLength=10 ** 9), "accessor 0"),
    (lambda d: d["bufferViews"][0].update(byteOffset=-4), "accessor 0"), (lambda d: d["accessors"][0].update(componentType=7), "accessor 0"),
    (lambda d: d["accessors"][1].update(componentType=5122), "accessor 1"), (lambda d: d["accessors"][1].update(normalized=True), "accessor 1"),
    (lambda d: d["accessors"][1].update(componentType=5126, count=18), "accessor 1"),
    (lambda d: d["accessors"][0].update(sparse={"count": 1, "indices": {"bufferView": 1, "componentType": 5122}, "values": {"bufferView": 0}}), "accessor 0"),
    (lambda d: d["nodes"][0].update(children=[0]), "not a tree"), (lambda d: d["nodes"][0].update(mesh=5), "a mesh that is missing"),
    (lambda d: d["nodes"][0].update(matrix=[1, 2]), "transform"),
    (lambda d: d["nodes"][0].update(matrix=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1], scale=[2, 2, 2]), "a matrix beside"), (lambda d: d["asset"].update(minVersion="2.1"), "2.1")])
def test_a_damaged_gltf_is_refused_with_the_place(look, tmp_path, damage, words):
    g, corners = write.Gltf(), write.box(numpy.random.default_rng(2))
    g.document["nodes"] = [{"mesh": g.mesh(g.accessor(corners, "<f4"), g.accessor(write.FACES.ravel(), "<u2"))}]
    damage(g.document)
    g.write(tmp_path / "box.glb")
    error = look(tmp_path / "box.glb")
    assert error.get("code") in ("input_damaged", "input_unsupported") and words in error["message"], error


@pytest.mark.sanitized
def test_nodes_that_place_too_many_primitives_are_refused(look, tmp_path):
    g = write.Gltf()
    g.document["nodes"] = 2001 * [{"mesh": g.mesh(g.accessor(numpy.eye(3), "<f4"), mode=0)}]
    g.document["scenes"][0]["nodes"] = list(range(2001))
    g.document["meshes"][0]["primitives"] *= 500
    g.write(tmp_path / "box.glb")
    error = look(tmp_path / "box.glb")
    assert error.get("code") == "input_unsupported" and "its nodes place more than 1000000 primitives" in error["message"], error


def test_corners_of_strips_and_of_mirrored_nodes_keep_their_order(worker, tmp_path):
    """A sheet that looks up, as strip, as fan, and under a node that mirrors it."""
    flat = numpy.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)])
    for node, places, order, mode in (({}, flat, [0, 1, 2, 3], 5), ({}, flat, [0, 1, 3, 2], 6),
                                      ({"scale": [-1, 1, 1]}, flat * (-1, 1, 1), [2, 1, 0, 3, 1, 2], 4)):
        g = write.Gltf()
        g.document["nodes"] = [{"mesh": g.mesh(g.accessor(places, "<f4"), g.accessor(order, "<u2"), mode=mode), **node}]
        g.write(tmp_path / "sheet.glb")
        spec = {"version": 1, "surface": {"mesh": {"path": str(tmp_path / "sheet.glb")}}, "sampling": {"count": 40},
                "solver": {"max_sweeps": 5}, "output": {"preview": False, "ply": {"precision": "double"}}}
        done = worker(spec)
        assert done.returncode in (0, 10, 11), done.stderr
        assert (read_columns((tmp_path / "out/points.ply").read_bytes())["nz"] == 1).all()


@pytest.mark.parametrize("declared, words", [({"min": [-999, -999, -999]}, "min and max of accessor 0 contradict"),
                                             ({"max": [0, 0, 0]}, "min and max of accessor 0 contradict"), ({}, None)])
def test_bounds_of_a_gltf_that_its_positions_contradict_are_warned_of(look, tmp_path, r, declared, words):
    corners = write.box(r)
    bounds = {"min": [round(v, 6) for v in corners.min(0)], "max": [round(v, 6) for v in corners.max(0)], **declared}
    g = write.Gltf()
    g.document["nodes"] = [{"mesh": g.mesh(g.accessor(corners, "<f4", **bounds), g.accessor(write.FACES.ravel(), "<u2"))}]
    g.write(tmp_path / "box.glb")
    found = look(tmp_path / "box.glb")
    assert_box(found, corners)
    assert len(found["notes"]) == bool(words) and all(words in note for note in found["notes"]), found["notes"]


def test_draco_is_read_by_the_library(look, tmp_path):
    """The box of seed 1, compressed by draco_encoder of Debian."""
    data = base64.b64decode("RFJBQ08CAgEBAAAACAwACwAAA19LFQEBEAH/AAABAAkDAAACAQEBABADARABCCsBCAEgBABIDpEAAAAAmDoAoJwBAEEAMDn7UgMAMDn7UgMAAAD4UgMA"
                            "AAAA//8AAAAA2L4AADw+AAB/QABAbkAQ")
    corners, name = write.box(numpy.random.default_rng(1)), "KHR_draco_mesh_compression"
    g = write.Gltf(extensionsUsed=[name], extensionsRequired=[name])
    position = g.add({"componentType": 5126, "count": 8, "type": "VEC3", "min": corners.min(0).tolist(), "max": corners.max(0).tolist()})
    indices = g.add({"componentType": 5123, "count": 36, "type": "SCALAR"})
    compressed = {"bufferView": g.view(data), "attributes": {"POSITION": 0}}
    g.document["nodes"] = [{"mesh": g.mesh(position, indices, extensions={name: compressed})}]
    g.write(tmp_path / "box.glb")
    assert_box(look(tmp_path / "box.glb"), corners, 1e-4)


# ---- 3MF

@pytest.mark.parametrize("unit", write.UNITS)
def test_a_3mf_is_read_in_millimetres(look, tmp_path, r, unit):
    corners = write.box(r)
    write.in_unit(tmp_path / "box.3mf", corners, unit)
    found = look(tmp_path / "box.3mf")
    assert_box(found, corners)
    assert len(found["notes"]) == (unit != "millimeter") and all(unit in note and "millimetres" in note for note in found["notes"])


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_part_of_a_3mf_that_is_there_twice_is_refused(look, tmp_path, r):
    for scale in (1, 2):
        mesh = write.mesh_of_3mf(scale * write.box(r))
        write.write_3mf(tmp_path / f"box{scale}.3mf", f'<object id="1">{mesh}</object>', '<item objectid="1"/>')
    with zipfile.ZipFile(tmp_path / "box1.3mf", "a") as archive, zipfile.ZipFile(tmp_path / "box2.3mf") as other:
        (name,) = (n for n in archive.namelist() if n.endswith(".model"))
        archive.writestr(name, other.read(name))
    error = look(tmp_path / "box1.3mf")
    assert error["code"] == "input_damaged" and f"{name} is there twice" in error["message"], error


def test_objects_of_a_3mf_with_equal_ids_are_refused(look, tmp_path, r):
    mesh = write.mesh_of_3mf(write.box(r))
    write.write_3mf(tmp_path / "box.3mf", "".join(f'<object id="{k % 200}">{mesh}</object>' for k in range(7, 208)), '<item objectid="7"/>')
    error = look(tmp_path / "box.3mf")
    assert error["code"] == "input_damaged" and 'two of its objects have the id "7"' in error["message"], error


@pytest.mark.parametrize("name", ["with_transforms", "of_production"])
def test_transforms_and_parts_of_a_3mf_are_honoured(look, tmp_path, r, name):
    corners = write.box(r)
    getattr(write, name)(tmp_path / "box.3mf", corners)
    assert_box(look(tmp_path / "box.3mf"), corners)


def test_values_of_a_3mf_lie_where_its_mesh_is(worker, tmp_path):
    """Two boxes in inches, one beside the other: the numbers of their objects."""
    corners = write.box(numpy.random.default_rng(7))
    corners = (corners - corners.min(0)) / numpy.ptp(corners, axis=0)
    write.write_3mf(tmp_path / "two.3mf", f'<object id="1">{write.mesh_of_3mf(corners)}</object><object id="2">{write.mesh_of_3mf(corners + (3, 0, 0))}'
                    "</object>", '<item objectid="1"/><item objectid="2"/>', 'unit="inch"')
    done = worker({"version": 1, "surface": {"mesh": {"path": str(tmp_path / "two.3mf")}}, "sampling": {"count": 100}, "solver": {"max_sweeps": 1},
                   "attributes": [{"name": "group"}], "output": {"preview": False}})
    assert done.returncode in (0, 10, 11), done.stderr
    points = read_columns((tmp_path / "out/points.ply").read_bytes())
    assert len(set(points["group"][points["x"] < 30])) == len(set(points["group"][points["x"] > 70])) == 1
    assert len(set(points["group"])) == 2 and points["x"].max() == pytest.approx(4 * 25.4)


def test_digits_of_a_3mf_are_kept(look, tmp_path):
    corners = write.box(numpy.random.default_rng(3)) + 1e9
    write.in_unit(tmp_path / "box.3mf", corners, "millimeter")
    assert_box(look(tmp_path / "box.3mf"), corners, 1e-15)


@pytest.mark.sanitized
@pytest.mark.parametrize("attributes, words", [
    ('unit="cubit"', 'unit "cubit"'), ('requiredextensions="b" xmlns:b="http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"', "beamlattice"),
    ('requiredextensions="v" xmlns:v="http://schemas.3mf.io/volumetric"', "volumetric"),
    ('requiredextensions="p x" xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06" xmlns:x="urn:x"', "urn:x"),
    ('requiredextensions="q"', "xmlns:q")])
def test_what_a_3mf_requires_is_refused_by_its_name(look, tmp_path, attributes, words):
    corners = write.box(numpy.random.default_rng(4))
    write.write_3mf(tmp_path / "box.3mf", f'<object id="1">{write.mesh_of_3mf(corners)}</object>', '<item objectid="1"/>', attributes)
    error = look(tmp_path / "box.3mf")
    assert error.get("code") == "input_unsupported" and words in error["message"], error


@pytest.mark.sanitized
@pytest.mark.parametrize("item", ['<item objectid="2"/>', "<item/>", '<item objectid="1" transform="1 0 0"/>', '<item objectid="1"',
                                  '<item objectid="3"/>', '<item objectid="4"/>', '<item objectid="1" p:path="/none.model"/>'])
def test_a_damaged_3mf_is_refused(look, tmp_path, item):
    good = write.mesh_of_3mf(write.box(numpy.random.default_rng(5)))
    objects = (f'<object id="1">{good}</object><object id="3"><components><component objectid="3"/></components></object>'
               '<object id="4"><mesh><vertices><vertex x="1" y="2" z="3"/></vertices><triangles><triangle v1="0" v2="0" v3="1"/></triangles>'
               "</mesh></object>")
    write.write_3mf(tmp_path / "box.3mf", objects, item)
    error = look(tmp_path / "box.3mf")
    assert error.get("code") == "input_damaged" and "the 3MF file is damaged" in error["message"], error


EMPTY_MESH = "<mesh><vertices/><triangles/></mesh>"


def doubled(levels, mesh):
    """An object, and others of which each has two components, the object before."""
    pair = '<object id="%d"><components><component objectid="%d"/><component objectid="%d"/></components></object>'
    return f'<object id="0">{mesh}</object>' + "".join(pair % (k, k - 1, k - 1) for k in range(1, levels + 1))


@pytest.mark.sanitized
@pytest.mark.parametrize("levels, mesh", [(40, EMPTY_MESH), (40, "a box")], ids=["empty meshes", "boxes"])
def test_components_that_repeat_objects_too_often_are_refused(look, tmp_path, levels, mesh):
    if mesh == "a box":
        mesh = write.mesh_of_3mf(write.box(numpy.random.default_rng(4)))
    write.write_3mf(tmp_path / "box.3mf", doubled(levels, mesh), f'<item objectid="{levels}"/>')
    error = look(tmp_path / "box.3mf")
    assert error.get("code") == "input_unsupported" and "its components repeat objects too often" in error["message"], error


def test_components_that_repeat_an_object_are_read(look, tmp_path, r):
    """4 096 boxes at the same place."""
    corners = write.box(r)
    write.write_3mf(tmp_path / "box.3mf", doubled(12, write.mesh_of_3mf(corners)), '<item objectid="12"/>')
    found = look(tmp_path / "box.3mf")
    assert_box(found, corners)
    assert any(f"{12 * 4095} of {12 * 4096} triangles are duplicates" in note for note in found["notes"]), found


def test_character_references_of_a_3mf_are_replaced(look, tmp_path, r):
    corners = write.box(r)
    objects = f'<object id="a&amp;b">{write.mesh_of_3mf(corners)}</object>'
    write.write_3mf(tmp_path / "box.3mf", objects, '<item objectid="a&#38;b" transform="1&#32;0&#x20;0&#9;0 1 0 0 0 1 1 2 3"/>')
    assert_box(look(tmp_path / "box.3mf"), corners + (1, 2, 3))


def test_objects_outside_of_a_build_are_warned_of(look, tmp_path, r):
    corners = write.box(r)
    write.write_3mf(tmp_path / "box.3mf", f'<object id="1">{write.mesh_of_3mf(corners)}</object><object id="2">{write.mesh_of_3mf(9 * corners)}'
                    "<b:beamlattice/></object>", '<item objectid="1"/>')
    found = look(tmp_path / "box.3mf")
    assert_box(found, corners)
    assert "1 of 2 objects" in found["notes"][0] and "beam" in found["notes"][1]


# ---- units of FBX

@pytest.mark.parametrize("unit", [1, 2.54, 100])
def test_the_unit_of_an_fbx_is_warned_of(look, tmp_path, r, unit):
    corners = write.box(r)
    write.fbx(tmp_path / "box.fbx", corners, unit)
    found = look(tmp_path / "box.fbx")
    assert_box(found, corners, 1e-6)
    assert [f"{unit:g} cm" in note for note in found["notes"]] == [True] * (unit != 1)


# ---- OBJ

@pytest.mark.sanitized
@pytest.mark.parametrize("how", [
    {"face": "f {} # comment"}, {"face": "f {} #comment \\"}, {"vertex": "{} # a vertex"}, {"face": "f {}\t# 1 2 3", "end": "\r\n"},
    {"vertex": "{}#", "face": "f {}#"}, {"before": "# o \\", "face": "f {} "}, {"vertex": "{} 1.0"}, {"vertex": "{} 0.5 0.25 0.125"},
    {"vertex": "{} 0.5 0.25 0.125 1"}, {"vertex": "v \\\n{}"}], ids=str)
def test_an_obj_has_comments_and_longer_lines_anywhere(look, tmp_path, r, how):
    corners = write.box(r)
    if how.get("vertex", "").startswith("v \\"):
        how = {"vertex": "{}", "face": "f {}"}
        write.obj(tmp_path / "box.obj", corners, **how)
        text = (tmp_path / "box.obj").read_text()
        (tmp_path / "box.obj").write_text(text.replace("v ", "v \\\n").replace("f 1", "f \\\r\n 1"))
    elif how.get("vertex") == "{}#":
        write.obj(tmp_path / "box.obj", corners, vertex="{} #", face="f {}#")
    else:
        write.obj(tmp_path / "box.obj", corners, **how)
    found = look(tmp_path / "box.obj")
    assert_box(found, corners)
    assert found["notes"] == []


@pytest.mark.parametrize("before", ["mtllib C:\\models\\", "o box\\", "g a b\\", "usemtl grey \\  ", "# a comment \\"])
def test_a_name_of_an_obj_that_ends_in_a_backslash_continues_no_line(look, tmp_path, r, before):
    corners = write.box(r)
    write.obj(tmp_path / "box.obj", corners, before=before)
    found = look(tmp_path / "box.obj")
    assert_box(found, corners)
    assert found["notes"] == []


@pytest.mark.parametrize("mark", ["\\ \n", "\\\t \n", "\\ \r\n"], ids=repr)
def test_blanks_may_follow_the_mark_that_continues_a_line(look, tmp_path, r, mark):
    corners = write.box(r)
    write.obj(tmp_path / "box.obj", corners)
    text = (tmp_path / "box.obj").read_text().replace("v ", "v " + mark).replace("f ", "f " + mark)
    (tmp_path / "box.obj").write_bytes(text.encode())
    assert_box(look(tmp_path / "box.obj"), corners)


@pytest.mark.parametrize("vertex, note", [("{} 0,5", "8 vertices: a word after x y z is not a number; the rest of the line is skipped"), ("{} 0.5 0.5 -1.#IND", "8 vertices: a word after"),
                                          ("{}\nf # none", "8 faces have no corners"), ("{}\nf", "8 faces have no corners")])
def test_rows_of_an_obj_that_are_skipped_are_named(look, tmp_path, r, vertex, note):
    corners = write.box(r)
    write.obj(tmp_path / "box.obj", corners, vertex=vertex)
    found = look(tmp_path / "box.obj")
    assert_box(found, corners)
    assert len(found["notes"]) == 1 and found["notes"][0].startswith(note), found["notes"]


def test_what_an_obj_has_beside_polygons_is_warned_of(look, tmp_path, r):
    corners = write.box(r)
    write.obj(tmp_path / "box.obj", 2 * corners, vertex="{} 2", before="vp 0 1\nmystery 7", after="cstype bspline\ndeg 3\ncurv 0 1 1 2 3 4\n"
              "parm u 0 1\nend\nsurf 0 1 0 1 1 2 3 4\nl 1 2\np 1\nbevel on")
    found = look(tmp_path / "box.obj")
    assert_box(found, corners)
    notes = " ".join(found["notes"])
    assert "2 free-form" in notes and "8 vertices have a weight" in notes and "mystery" in notes and "2 points or lines" in notes, notes


def test_digits_of_text_are_kept_in_every_format(look, tmp_path):
    corners = write.box(numpy.random.default_rng(6)) + 123456789.015625
    for name in ("obj", "off", "ply"):
        getattr(write, name)(tmp_path / f"box.{name}", corners, **({"layout": "ascii"} if name == "ply" else {}))
        assert_box(look(tmp_path / f"box.{name}"), corners, 1e-15)


# ---- PLY

@pytest.mark.parametrize("layout", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("kind", ["float", "double"])
def test_vertices_of_no_face_need_not_be_finite(look, tmp_path, r, layout, kind):
    corners = write.box(r)
    write.ply(tmp_path / "box.ply", corners, layout, kind, [(NAN, NAN, NAN), (1, INF, 2), (-INF, 0, 0), (NAN, 1, 1), (1e33, 0, 0)],
              extra="comment c\nobj_info i\n")
    found = look(tmp_path / "box.ply")
    assert_box(found, corners)
    assert found["notes"] == ["5 unused vertices are not finite: they are skipped"]


@pytest.mark.parametrize("layout", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_a_face_whose_vertex_is_not_finite_is_named(look, tmp_path, r, layout):
    for place in ((NAN, 0, 0), (0, 0, -INF)):
        write.ply(tmp_path / "box.ply", write.box(r), layout, unused=[(NAN, 0, 0)], used={5: place})
        error = look(tmp_path / "box.ply")
        where = r"line \d+" if layout == "ascii" else r"byte \d+"
        assert error["code"] == "input_damaged" and re.search(f": {where} of the PLY file is a vertex ", error["message"]), error


@pytest.mark.parametrize("layout", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_strips_of_a_ply_keep_its_digits(look, tmp_path, r, layout):
    corners = write.box(r) + 123456789.015625
    write.strips_of_ply(tmp_path / "box.ply", corners, layout)
    assert_box(look(tmp_path / "box.ply"), corners, 1e-15)


@pytest.mark.parametrize("layout", ["binary_little_endian", "binary_big_endian"])
def test_a_ply_has_lists_and_elements_anywhere(look, tmp_path, r, layout):
    corners = write.box(r) + 123456789.015625
    write.odd_ply(tmp_path / "box.ply", corners, layout)
    found = look(tmp_path / "box.ply")
    assert_box(found, corners, 1e-15)
    assert found["notes"] == ["the file has a camera: vertices are not moved by it"]


# ---- STL

@pytest.mark.parametrize("how", [{"head": b"solid of a program that begins so"}, {"head": b"COLOR=\x10\x20\x30\x40,MATERIAL="},
                                 {"head": b"STLB ATF 1.0 UNITS=inch"}, {"text": True}, {"text": True, "solids": 3}], ids=str)
def test_an_stl_is_its_triangles_whatever_its_header_has(look, tmp_path, r, how):
    corners = write.box(r)
    write.stl(tmp_path / "box.stl", corners, **how)
    assert_box(look(tmp_path / "box.stl"), corners)


def stl_rows(corners, more=b""):
    return b"".join(struct.pack("<12fH", 0, 0, 0, *corners[f].ravel(), len(more)) + more for f in write.FACES)


@pytest.mark.parametrize("more", [b"abc", b"\0" * 7], ids=["text", "zeros"])
def test_attribute_bytes_of_an_stl_are_passed_over(look, tmp_path, r, more):
    corners = write.box(r).astype("f4").astype(float)
    (tmp_path / "box.stl").write_bytes(bytes(80) + struct.pack("<I", 12) + stl_rows(corners, more))
    found = look(tmp_path / "box.stl")
    assert_box(found, corners)
    assert found["notes"] == []


def test_an_stl_whose_number_of_triangles_is_0_is_read_by_its_length(look, tmp_path, r):
    corners = write.box(r).astype("f4").astype(float)
    (tmp_path / "box.stl").write_bytes(bytes(80) + struct.pack("<I", 0) + stl_rows(corners))
    found = look(tmp_path / "box.stl")
    assert_box(found, corners)
    assert "its number of triangles is 0" in found["notes"][0]


# ---- PLY headers

PLY_HEADERS = {"faces first": ("element vertex", None, "has its element \"face\" before its element \"vertex\""),
               "a count with text": ("element vertex 8", "element vertex 8x", "line 3 of the header"),
               "two numbers": ("element face 12", "element face 12 7", "line 7 of the header"),
               "an axis twice": ("property double z", "property double y", "line 6 of the header"),
               "a format twice": ("element vertex 8", "format ascii 1.0\nelement vertex 8", "line 3 of the header")}


@pytest.mark.parametrize("name", PLY_HEADERS)
def test_a_ply_header_that_contradicts_itself_is_refused_with_its_line(look, tmp_path, r, name):
    old, new, words = PLY_HEADERS[name]
    write.ply(tmp_path / "box.ply", write.box(r), layout="ascii")
    text = (tmp_path / "box.ply").read_text()
    if new:
        text = text.replace(old, new)
    else:
        head, rows = text.split("end_header\n")
        lines, data = head.splitlines(), rows.splitlines()
        text = "\n".join([*lines[:2], *lines[6:], *lines[2:6], "end_header", *data[8:], *data[:8]]) + "\n"
    (tmp_path / "box.ply").write_text(text)
    error = look(tmp_path / "box.ply")
    assert error["code"].startswith("input_") and words in error["message"], error


# ---- OFF

@pytest.mark.sanitized
@pytest.mark.parametrize("how", [{"binary": True}, {"binary": True, "prefix": "C", "colours": 3}, {"binary": True, "prefix": "N"},
                                 {"binary": True, "prefix": "STCN", "colours": 4}, {"binary": True, "prefix": "4", "w": 2},
                                 {"binary": True, "dimensions": 3}, {"prefix": "C", "colours": 3}, {"prefix": "N"}, {"prefix": "STCN"},
                                 {"prefix": "4", "w": 4}, {"dimensions": 3}, {"colours": 4}, {"prefix": "C4", "w": 2, "binary": True}], ids=str)
def test_an_off_is_read_with_whatever_its_vertices_have(look, tmp_path, r, how):
    corners = write.box(r)
    write.off(tmp_path / "box.off", corners, **how)
    assert_box(look(tmp_path / "box.off"), corners)


@pytest.mark.sanitized
@pytest.mark.parametrize("change, words", [(("8 12 0", "9 12 0"), "face 11 of the OFF file"), (("8 12 0", "8 13 0"), "face 12 of the OFF file"),
                                           (("8 12 0", "7 12 0"), "face 0 of the OFF file"), (("3 0 2 3", "3 0 2 8"), "face 0 of the OFF file"),
                                           (("3 0 2 3", "3 0 2 x"), "line 11"), (("OFF", "FOO"), "the header of the OFF file")])
def test_an_off_that_is_not_what_its_header_declares_is_refused_with_the_place(look, tmp_path, change, words):
    corners = write.box(numpy.random.default_rng(3))
    text = "OFF\n8 12 0\n" + "".join("%r %r %r\n" % tuple(v) for v in corners.tolist()) + "".join("3 %d %d %d\n" % tuple(f) for f in write.FACES)
    (tmp_path / "box.off").write_text(text.replace(*change, 1))
    error = look(tmp_path / "box.off")
    assert error.get("code") == "input_damaged" and words in error["message"], error


def test_an_off_of_other_dimensions_is_refused(look, tmp_path):
    (tmp_path / "a.off").write_text("nOFF 5\n1 1 0\n0 0 0 0 0\n3 0 0 0\n")
    error = look(tmp_path / "a.off")
    assert error["code"] == "input_unsupported" and "5 coordinates" in error["message"], error


# ---- OpenVDB

SHEAR = [[0.125, 0.03125, 0, 0], [0, 0.125, 0, 0], [0, 0, 0.25, 0], [1, 2, 3, 1]]  # of row vectors


@pytest.mark.parametrize("how, words", [
    ({}, []), ({"meta": {"unit": "cm"}}, ['has the unit "cm"']), ({"meta": {"Units": "inch"}}, ['has the unit "inch"']),
    ({"meta": {"is_local_space": True}}, ["is in local space"]), ({"half": True, "meta": {"is_local_space": False, "value": 3.0}}, []),
    ({"transform": SHEAR, "half": True}, []), ({"instance": True, "meta": {"unit": "m", "is_local_space": True}}, ['has the unit "m"', "is in local space"])], ids=str)
def test_metadata_and_transforms_of_a_grid_are_honoured_or_warned_of(worker, tmp_path, how, words):
    """A ball of a radius of eight voxels; an instance shares the tree of another grid, which has another transform."""
    openvdb = pytest.importorskip("pyopenvdb", reason="there is no pyopenvdb to write level sets with")
    grid = openvdb.createLevelSetSphere(radius=1, voxelSize=0.125)
    matrix = numpy.array(how.get("transform", numpy.diag([0.125, 0.125, 0.125, 1])), float)
    grid.name, grid.saveFloatAsHalf = "ball", how.get("half", False)
    grids = [grid]
    if how.get("instance"):
        grids.append(grid.copy())
        grids[1].name = "ball_again"
        matrix = 2 * matrix
    grids[-1].transform = openvdb.createLinearTransform(matrix.tolist()[:3] + [[*matrix[3, :3], 1]])
    for key, value in how.get("meta", {}).items():
        grids[-1][key] = value
    openvdb.write(str(tmp_path / "ball.vdb"), grids=grids)
    done = worker({"version": 1, "surface": {"vdb": {"path": str(tmp_path / "ball.vdb"), "grid": grids[-1].name}}, "sampling": {"count": 60},
                   "solver": {"max_sweeps": 2}, "output": {"preview": False}})
    assert done.returncode in (0, 10, 11), done.stderr
    surface = json.loads((tmp_path / "out/report.json").read_text())["surface"]
    reach, middle = 8 * numpy.linalg.norm(matrix[:3, :3], axis=0), matrix[3, :3]
    assert numpy.allclose(surface["bounding_box"]["min"], middle - reach, atol=0.04), surface
    assert numpy.allclose(surface["bounding_box"]["max"], middle + reach, atol=0.04), surface
    assert len(surface["warnings"]) == len(words) and all(w in told for w, told in zip(words, surface["warnings"])), surface


# ---- formats that are not read

UNREAD = {
    "part.step": (b"ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('AP214_IFC_LIKE'));\n", "STEP", "gmsh"),
    "part.stp": (b"ISO-10303-21;\r\nHEADER;\r\nFILE_SCHEMA (('CONFIG_CONTROL_DESIGN'));\r\nENDSEC;\r\nDATA;\r\n#1=IFC();\r\n", "STEP", "FreeCAD"),
    "part.igs": (b" " * 72 + b"S      1\n" + b"1H,,1H;" + b" " * 65 + b"G      1\n", "IGES", "gmsh"),
    "part.iges": (b"from a program".ljust(72) + b"S0000001\r\n", "IGES", "FreeCAD"),
    "a.abc": (b"Ogawa\xff\0\1" + bytes(40), "Alembic", "Blender"), "b.abc": (b"\x89HDF\r\n\x1a\n" + bytes(60), "Alembic", "Blender"),
    "a.bgeo": (b"\x7fNSJb" + bytes(50), "Houdini", "gconvert"), "b.bgeo": (b"BgeoV\0\0\0\x05" + bytes(50), "Houdini", "gconvert"),
    "a.geo": (b'["fileversion","18.0.416",', "Houdini", "gconvert"), "b.geo": (b"PGEOMETRY V5\n", "Houdini", "gconvert"),
    "c.bgeo.sc": (b"scf1" + bytes(50), "Houdini", "gconvert"),
    "a.vtk": (b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_GRID\n", "VTK", "ParaView"),
    "a.vtu": (b'<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="0.1">', "VTK", ".vtp"),
    "lh.pial": (b"\xff\xff\xfecreated by x\n\n" + bytes(40), "FreeSurfer", "mris_convert"),
    "a.vdb": (b" BDV\0\0\0\0" + bytes(40), "OpenVDB", "/surface/vdb/path"),
    "a.nrrd": (b"NRRD0004\ntype: float\n", "NRRD", "/surface/volume/path"),
    "a.x3d": (b"<Scene/>", "X3D", "assimp export"), "x3d": (b'<?xml version="1.0"?>\n<X3D version="3.3"><Scene/></X3D>\n', "X3D", "assimp export"),
    "a.3DS": (b"any", "3DS", "assimp export"), "3ds": (b"MM\x40\0\0\0\2\0\n\0\0\0\3\0\0\0" + bytes(48), "3DS", "assimp export"),
    "a.usda": (b"#usda 1.0\n", "USD", "Blender"), "a.usdc": (b"PXR-USDC" + bytes(80), "USD", "Blender"),
    "a.AMF": (write.AMF, "AMF", "prusa-slicer"), "packed.amf": (b"PK\3\4" + bytes(60), "AMF", "prusa-slicer"),
    "amf.stl": (write.AMF, "AMF", "prusa-slicer"), "amf.obj": (write.AMF, "AMF", "prusa-slicer"), "amf": (write.AMF, "AMF", "prusa-slicer"),
    "a.dxf": (write.DXF, "DXF", "Blender"), "b.dxf": (b"AutoCAD Binary DXF\r\n\x1a\0" + bytes(60), "DXF", "Blender"),
    "dxf.ply": (write.DXF, "DXF", "Blender"), "dxf": (write.DXF, "DXF", "Blender"),
    "dxf.part": (b"999\nfrom a program\n" + write.DXF, "DXF", "Blender")}


@pytest.mark.parametrize("name", UNREAD)
def test_a_format_that_is_not_read_is_named_with_a_converter(worker, tmp_path, name):
    data, kind, converter = UNREAD[name]
    if name == "part.step":
        data = data.replace(b"AP214_IFC_LIKE", b"AUTOMOTIVE_DESIGN { 1 0 10303 214 }")
    (tmp_path / name).write_bytes(data)
    done = worker({"version": 1, "surface": {"mesh": {"path": str(tmp_path / name)}}, "sampling": {"count": 100}})
    error = json.loads(done.stderr.splitlines()[-1])
    assert error["code"] == "input_unsupported" and "IFC:" not in error["message"], error
    assert kind in error["message"] and converter in error["message"] and name in error["message"], error


@pytest.mark.sanitized
def test_an_archive_that_is_no_3mf_is_refused(look, tmp_path):
    with zipfile.ZipFile(tmp_path / "a.3mf", "w") as archive:
        archive.writestr("readme.txt", "nothing")
    error = look(tmp_path / "a.3mf")
    assert error["code"] == "input_damaged" and "_rels/.rels is missing" in error["message"], error


# ---- the cases of the collection

@pytest.mark.parametrize("name, area, note", [("f_comment.obj", 11.67, None), ("nan_unused.ply", 12.51, "4 unused vertices"),
                                              ("inch.3mf", 7954.73, "inch"), ("gltfpack_default.glb", 12.33, None),
                                              ("quantized.glb", 110.97, None)])
def test_the_cases_are_read(inspect, shared_data, name, area, note):
    found = inspect(shared_data / "cases" / name)
    assert found["area"] == pytest.approx(area, rel=2e-3) and found["closed"]
    assert note in found["notes"][0] if note else found["notes"] == []


def test_the_compressed_case_is_refused_by_the_extension(inspect, shared_data):
    error = inspect(shared_data / "cases" / "meshopt.glb")
    assert error["code"] == "input_unsupported" and "EXT_meshopt_compression" in error["message"]
