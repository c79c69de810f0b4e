# SPDX-License-Identifier: Apache-2.0
"""VTK files of PolyData as meshes: what the process that reads answers, for each way of storing the same mesh, and what is refused."""
import json
import struct

import numpy
import pytest

from pyramid import AREA, POINTS, POLYS, STRIP, assert_pyramid
from readers import read_columns
from vtk_files import LEGACY_TYPES, numbers_of, write_legacy, write_xml

LEGACY_CELLS = {"VERTICES": [[0], [1, 2]], "LINES": [[0, 1, 2]], "POLYGONS": POLYS, "TRIANGLE_STRIPS": [STRIP]}
XML_CELLS = {"Verts": [[0]], "Lines": [[0, 1]], "Strips": [STRIP], "Polys": POLYS}


@pytest.mark.sanitized
@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("version", ["1.0", "4.2", "5.1"])
def test_legacy_files(mesh_reader, tmp_path, binary, version):
    for kind in ("f4", "f8", "i4"):
        points = numpy.round(2 * POINTS).astype(kind) if kind == "i4" else POINTS.astype(kind)
        write_legacy(tmp_path / "v.vtk", points, LEGACY_CELLS, binary, version)
        answer = mesh_reader(tmp_path / "v.vtk")
        if kind == "i4":
            answer = (answer[0] / 2, *answer[1:])
        assert_pyramid(answer)
        assert answer[3] == 3  # two verts and a line


@pytest.mark.parametrize("binary", [False, True])
def test_what_is_around_the_cells_of_a_legacy_file(mesh_reader, tmp_path, binary):
    field = b"FIELD FieldData 3\nTIME 1 1 double\n" + (struct.pack(">d", 0.5) + b"\n" if binary else b"0.5\n")
    field += b"bits 1 11 bit\n" + (b"\xff\xe0\n" if binary else b"1 " * 11 + b"\n")
    field += b"names 1 2 string\n" + (b"\xc3abc\x80\x02xy\n" if binary else b"a%20b\nxy\n")
    data = b"METADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 0 1\n\nPOINT_DATA 5\nSCALARS s float\nLOOKUP_TABLE default\n"
    write_legacy(tmp_path / "v.vtk", POINTS, LEGACY_CELLS, binary, before=field, behind=data)
    assert_pyramid(mesh_reader(tmp_path / "v.vtk"))
    text = (tmp_path / "v.vtk").read_bytes()
    if not binary:
        (tmp_path / "v.vtk").write_bytes(text.replace(b"\n", b"\r\n"))
        assert_pyramid(mesh_reader(tmp_path / "v.vtk"))


WAYS = [{"mode": "ascii"}, {"mode": "binary"}, {"mode": "binary", "packed": True, "long_heads": True},
        {"mode": "appended"}, {"mode": "appended", "packed": True, "big": True}, {"mode": "appended", "encoding": "raw", "big": True},
        {"mode": "appended", "encoding": "raw", "packed": True, "long_heads": True, "index": "i4"},
        {"mode": "binary", "packed": True, "block": 1 << 15, "index": "u1"}]


@pytest.mark.sanitized
@pytest.mark.parametrize("way", WAYS, ids=str)
def test_xml_files(mesh_reader, tmp_path, way):
    for kind in ("f4", "f8"):
        write_xml(tmp_path / "v.vtp", [(POINTS.astype(kind), XML_CELLS)], **way)
        answer = mesh_reader(tmp_path / "v.vtp")
        assert_pyramid(answer)
        assert answer[3] == 2


def test_pieces_have_points_of_their_own(mesh_reader, tmp_path):
    write_xml(tmp_path / "v.vtp", [(POINTS, {"Polys": POLYS}), (numpy.zeros((0, 3)), {"Polys": []}), (POINTS + 5, {"Strips": [STRIP]})],
              mode="appended", packed=True)
    vertices, triangles, _, _ = mesh_reader(tmp_path / "v.vtp")
    assert len(vertices) == 10 and (triangles[:4] < 5).all() and (triangles[4:] >= 5).all() and len(triangles) == 6


def test_a_legacy_file_with_the_other_name(mesh_reader, tmp_path):
    write_legacy(tmp_path / "v.vtp", POINTS, LEGACY_CELLS)
    assert_pyramid(mesh_reader(tmp_path / "v.vtp"))


def test_as_jobs_and_as_an_inspection(solve, worker, tmp_path):
    write_legacy(tmp_path / "v.vtk", POINTS, LEGACY_CELLS, binary=True)
    report, data = solve({"version": 1, "surface": {"mesh": {"path": "v.vtk"}}, "sampling": {"count": 40}, "solver": {"max_sweeps": 1},
                          "output": {"preview": False}})
    assert data and report["surface"]["area"] == pytest.approx(AREA) and report["surface"]["mesh"]["triangles"] == 6
    assert report["surface"]["warnings"][0].startswith("the mesh has 3 points or lines")
    seen = json.loads(worker("v.vtk", "--json", command="inspect", output=None).stdout)
    assert seen["format"] == "mesh" and seen["mesh"]["triangles"] == 6 and seen["mesh"]["closed"]
    write_legacy(tmp_path / "v.vtk", POINTS, {"POLYGONS": [[0, 1, 7]]})
    error, none = solve({"version": 1, "surface": {"mesh": {"path": "v.vtk"}}, "sampling": {"count": 40}})
    assert error["code"] == "input_damaged" and error["message"].startswith("v.vtk: cell 0 of Polys has the point 7"), error


# ---- what is refused

LEGACY_FAULTS = {
    "a volume": (b"DATASET POLYDATA", b"DATASET STRUCTURED_POINTS", "STRUCTURED_POINTS, and PolyData is read: it is a volume"),
    "another data set": (b"DATASET POLYDATA", b"DATASET UNSTRUCTURED_GRID", "Extract Surface in ParaView"),
    "no numbers": (b"POINTS 5", b"POINTS five", 'line 5 of the VTK file has "five" in place of the number of points'),
    "many points": (b"POINTS 5", b"POINTS 5000000000000000000", "too many points"),
    "more points": (b"POINTS 5", b"POINTS 500", "begins 1500 numbers of the points, and the file has"),
    "a type": (b"double", b"string", 'the type "string"'),
    "a word": (b"0.0 0.0 0.0", b"0.0 x 0.0", 'line 6 of the VTK file has "x" in place of a number of the points'),
    "a section": (b"LINES", b"PLANES", '"PLANES" in place of POINTS, POLYGONS'),
    "a long cell": (b"POLYGONS 3 13\n4 ", b"POLYGONS 3 13\n40 ", "a cell of Polys with 40 points, and 12 numbers are left"),
    "more numbers": (b"POLYGONS 3 13", b"POLYGONS 2 13", "of which 4 numbers belong to no cell"),
    "a negative point": (b"3 0 1 4", b"3 0 -1 4", "cell 1 of Polys has the point -1, and there are 5 points"),
    "a header": (b"ASCII", b"BASCII", '"BASCII" in place of ASCII or BINARY'),
    "a version": (b"Version 3.0", b"Version three", "line 1 of the VTK file has a version that is not a number"),
    "no header": (b"# vtk DataFile", b"# vkt DataFile", 'does not begin with "# vtk DataFile Version"'),
}


def test_a_binary_field_that_ends_early_is_refused(mesh_reader, tmp_path):
    """By one byte: in a text file the last number needs no blank behind it, in a binary one each byte counts."""
    for count, is_whole in ((8, True), (7, False)):
        write_legacy(tmp_path / "v.vtk", POINTS, LEGACY_CELLS, binary=True,
                     behind=b"FIELD FieldData 1\nx 1 1 double\n" + struct.pack(">d", 0.5)[:count])
        answer = mesh_reader(tmp_path / "v.vtk")
        if is_whole:
            assert_pyramid((*answer[:2], "", answer[3]))  # but for the warning of points and lines
        else:
            assert "begins 1 numbers of a field, and the file has 7 bytes more" in answer


@pytest.mark.parametrize("fault", LEGACY_FAULTS)
def test_legacy_files_that_are_refused(mesh_reader, tmp_path, fault):
    find, put, words = LEGACY_FAULTS[fault]
    write_legacy(tmp_path / "v.vtk", POINTS, LEGACY_CELLS)
    text = (tmp_path / "v.vtk").read_bytes()
    assert text.count(find) >= 1
    (tmp_path / "v.vtk").write_bytes(text.replace(find, put, 1))
    answer = mesh_reader(tmp_path / "v.vtk")
    assert isinstance(answer, str) and words in answer, answer


VALUES = b"POINT_DATA 5\nSCALARS s float\nLOOKUP_TABLE default\n0.5 1.5 2 3 4\n"
METADATA = b"METADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 0 1\n"
MISPLACED = {"twice": (b"TRIANGLE_STRIPS 1 4\n3 0 1 2\n", "begins Strips for the second time"), "behind values": (VALUES, "has POLYGONS after values"),
             "in metadata": (METADATA, "has POLYGONS in METADATA, which an empty line has to end"),
             "behind a byte 0": (b"\0\n", "has a byte 0 in place of a word")}


@pytest.mark.sanitized
@pytest.mark.parametrize("command", ["read-mesh", "read-mesh-values"])
@pytest.mark.parametrize("fault", MISPLACED)
def test_cells_that_would_be_lost_are_refused(mesh_reader, tmp_path, fault, command):
    before, words = MISPLACED[fault]
    write_legacy(tmp_path / "v.vtk", POINTS, {"TRIANGLE_STRIPS": [STRIP]}, behind=before + b"POLYGONS 1 4\n3 0 1 2\n")
    answer = mesh_reader(tmp_path / "v.vtk", command)
    assert isinstance(answer, str) and (words in answer or (command, fault) == ("read-mesh-values", "behind values") and '"POLYGONS"' in answer), answer


NAMED_LINES = b"CELL_DATA 6\nFIELD FieldData 2\nlines 1 6 float\n0 1 2 3 4 5\npolygons 2 6 int\n0 1 2 3 4 5 6 7 8 9 10 11\n"


@pytest.mark.parametrize("behind", [VALUES, METADATA, METADATA + b"\n" + VALUES, b"\n\0\0\0", NAMED_LINES, VALUES + NAMED_LINES])
def test_what_follows_the_cells_changes_no_triangle(mesh_reader, tmp_path, behind):
    write_legacy(tmp_path / "v.vtk", POINTS, LEGACY_CELLS, behind=behind)
    assert_pyramid((*mesh_reader(tmp_path / "v.vtk")[:2], "", 0))


XML_FAULTS = {
    "a volume": ({"kind": "ImageData"}, None, 'the type "ImageData", and PolyData is read: it is a volume'),
    "another type": ({"kind": "UnstructuredGrid"}, None, "Extract Surface in ParaView"),
    "a document type": ({"extra": '<!DOCTYPE a [<!ENTITY b "c">]>'}, None, "document type"),
    "a compressor": ({"packed": True, "mode": "binary"}, (b"vtkZLib", b"vtkLZ4"), "vtkLZ4DataCompressor"),
    "xml": ({}, (b"</Points>", b"</Point>"), "is not valid XML (mismatched tag)"),
    "a number of points": ({}, (b'NumberOfPoints="5"', b'NumberOfPoints="5x"'), 'NumberOfPoints="5x", which is not a number'),
    "more points": ({}, (b'NumberOfPoints="5"', b'NumberOfPoints="6"'), "array Points of piece 0 of the VTK file has 15 numbers, and 18"),
    "many points": ({"mode": "binary"}, (b'NumberOfPoints="5"', b'NumberOfPoints="400000000"'), "has at most"),
    "more bytes": ({"mode": "binary"}, (b'NumberOfPoints="5"', b'NumberOfPoints="4"'), "has 120 bytes, and 96 are expected"),
    "more packed bytes": ({"mode": "binary", "packed": True}, (b'NumberOfPoints="5"', b'NumberOfPoints="4"'), "has 120 bytes, and 96 are expected"),
    "a point": ({}, (b"0 1 4", b"0 1 5"), "cell 1 of Polys has the point 5, and there are 5 points"),
    "an offset": ({}, (b"\n4 7 10\n", b"\n4 3 10\n"), "offsets that do not grow"),
    "a type": ({}, (b'type="Int64" Name="offsets"', b'type="Float64" Name="offsets"'), "indices are whole"),
    "a format": ({}, (b'Name="Points" NumberOfComponents="3" format="ascii"', b'Name="Points" NumberOfComponents="3" format="hex"'), 'the format "hex"'),
    "an encoding": ({"mode": "appended"}, (b'encoding="base64"', b'encoding="hex"'), 'encoding "hex"'),
    "no data": ({"mode": "appended"}, (b"\n_", b"\n "), 'do not begin with "_"'),
    "an offset of data": ({"mode": "appended"}, (b'offset="32"', b'offset="99999999"'), "begins behind the end of the file"),
    "fewer points": ({}, (b'NumberOfPoints="5"', b'NumberOfPoints="4"'), "array Points of piece 0 of the VTK file has more numbers"),
    "fewer cells": ({}, (b'NumberOfPolys="3"', b'NumberOfPolys="2"'), "array offsets of Polys of piece 0 of the VTK file has more numbers"),
    "a tail": ({}, (b"\n4 7 10\n", b"\n4 7 10x\n"), "or a damaged one"),
    "points twice": ({}, (b"</Points>", b'<DataArray type="Float64" NumberOfComponents="3" format="ascii">0 0 0</DataArray></Points>'),
                     "begins an array of its piece for the second time"),
    "a byte order": ({}, (b"LittleEndian", b"MiddleEndian"), 'the byte_order "MiddleEndian"'),
    "a type of lengths": ({}, (b'header_type="UInt32"', b'header_type="UInt16"'), 'the header_type "UInt16"'),
    "no offset": ({"mode": "appended"}, (b' offset="32"', b""), "an appended array without an offset"),
    "another element": ({}, (b"VTKFile", b"KTVFile"), 'the element "KTVFile"'),
}


@pytest.mark.sanitized
@pytest.mark.parametrize("fault", XML_FAULTS)
def test_xml_files_that_are_refused(mesh_reader, tmp_path, fault):
    how, change, words = XML_FAULTS[fault]
    write_xml(tmp_path / "v.vtp", [(POINTS, XML_CELLS)], **how)
    text = (tmp_path / "v.vtp").read_bytes()
    if change:
        assert change[0] in text, text[:600]
        (tmp_path / "v.vtp").write_bytes(text.replace(*change))
    answer = mesh_reader(tmp_path / "v.vtp")
    assert isinstance(answer, str) and words in answer, answer


@pytest.mark.sanitized
def test_files_that_end_early(mesh_reader, tmp_path):
    for name, write in (("v.vtk", lambda p: write_legacy(p, POINTS, LEGACY_CELLS, binary=True)),
                        ("v.vtp", lambda p: write_xml(p, [(POINTS, XML_CELLS)], mode="appended", encoding="raw", packed=True))):
        write(tmp_path / name)
        whole = (tmp_path / name).read_bytes()
        for share in (0.2, 0.5, 0.8, 0.9):
            (tmp_path / name).write_bytes(whole[:int(share * len(whole))])
            answer = mesh_reader(tmp_path / name)
            assert isinstance(answer, str) or len(answer[1]) < 6, (name, share, answer)


# ---- values of points

def legacy_array(head, values, binary):
    """An array of values with its first line, in which TYPE is the type; SCALARS have a table."""
    line = head.replace("TYPE", LEGACY_TYPES[values.dtype.str[1:]])
    return (f"{line}\n" + ("LOOKUP_TABLE default\n" if line.startswith("SCALARS") else "")).encode() + numbers_of(values, binary)


def random_values(seed):
    rng = numpy.random.default_rng(seed)
    of = {"curvature": rng.random(5).astype("f8"), "two words": rng.random((5, 2)).astype("f4"), "wind": rng.random((5, 3)).astype("f4"),
          "up": rng.random((5, 3)).astype("f4"), "st": rng.random((5, 2)).astype("f4"), "stress": rng.random((5, 9)).astype("f4"),
          "number": rng.integers(-99, 99, 5).astype("i2"), "pair": rng.integers(0, 99, (5, 2)).astype("i4")}
    return of, rng


@pytest.mark.sanitized
@pytest.mark.parametrize("binary", [False, True])
def test_values_of_legacy_files(mesh_reader, tmp_path, binary):
    of, rng = random_values(3)
    cells, table = rng.random(7).astype("f4"), rng.integers(0, 256, (2, 4)).astype("u1")
    paint = rng.integers(0, 256, (5, 3)).astype("u1")
    bytes_of = (lambda v: numbers_of(v, True)) if binary else (lambda v: numbers_of(v / 255, False))
    behind = b"CELL_DATA 7\n" + legacy_array("SCALARS curvature TYPE", cells, binary) + b"POINT_DATA 5\n"
    behind += legacy_array("SCALARS curvature TYPE", of["curvature"], binary)
    behind += b"METADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 0 1\n\n"
    behind += legacy_array("SCALARS two%20words TYPE 2", of["two words"], binary)
    behind += b"LOOKUP_TABLE ramp 2\n" + bytes_of(table) + b"COLOR_SCALARS paint 3\n" + bytes_of(paint)
    behind += legacy_array("VECTORS wind TYPE", of["wind"], binary) + legacy_array("NORMALS up TYPE", of["up"], binary)
    behind += legacy_array("TEXTURE_COORDINATES st 2 TYPE", of["st"], binary) + legacy_array("TENSORS stress TYPE", of["stress"], binary)
    behind += b"FIELD FieldData 3\n" + legacy_array("number 1 5 TYPE", of["number"], binary)
    behind += b"names 1 5 string\n" + (b"\xc1a" * 5 if binary else b"a\n" * 5) + legacy_array("\npair 2 5 TYPE", of["pair"], binary)
    write_legacy(tmp_path / "v.vtk", POINTS, LEGACY_CELLS, binary, behind=behind)
    answer = mesh_reader(tmp_path / "v.vtk", "read-mesh-values")
    assert not isinstance(answer, str), answer
    assert_pyramid((*answer[:2], "", answer[3]))
    found = answer[4]
    assert {n: k for n, (k, _) in found.items()} == {"curvature": "number", "two words": "number", "paint": "color", "wind": "number",
                                                     "up": "normal", "st": "uv", "number": "number", "pair": "number"}
    for name, (_, values) in found.items():
        expected = paint / 255 if name == "paint" else of[name]
        assert values == pytest.approx(expected.reshape(5, -1), rel=1e-6), name


@pytest.mark.sanitized
@pytest.mark.parametrize("way", WAYS, ids=str)
def test_values_of_xml_files(mesh_reader, tmp_path, way):
    of, _ = random_values(4)
    empty = (numpy.zeros((0, 3)), {"Polys": []})
    pieces = [empty, (POINTS, {"Polys": POLYS, "Strips": [STRIP]}), (POINTS + 5, {"Polys": POLYS})]
    turned = {name: of[name] + 1 for name in reversed(of)}
    write_xml(tmp_path / "v.vtp", pieces, values=[{}, of, turned], names='Normals="up" TCoords="st"', **way)
    *_, found = mesh_reader(tmp_path / "v.vtp", "read-mesh-values")
    assert {n: k for n, (k, _) in found.items()} == {**{n: "number" for n in of if n != "stress"}, "up": "normal", "st": "uv"}
    for name, (_, values) in found.items():
        assert values == pytest.approx(numpy.concatenate([of[name], turned[name]]).reshape(10, -1), rel=1e-6), name


VALUE_FAULTS = {
    "another number of points": (b"POINT_DATA 5", b"POINT_DATA 6", "begins values of 6 points, and there are 5 points"),
    "no array": (b"SCALARS", b"COLOURS", '"COLOURS" in place of SCALARS, FIELD'),
    "no table": (b"LOOKUP_TABLE", b"LOCKUP_TABLE", 'the array SCALARS "s", whose first lines are damaged'),
    "a type": (b"float", b"fleet", 'the type "fleet"'),
    "a word": (b"0.5 1.5", b"0.5 one", '"one" in place of a number of a field'),
    "another number of values": (b"SCALARS s float\nLOOKUP_TABLE default\n0.5", b"FIELD f 1\ns 1 4 float\n", 'begins 4 values "s", and there are 5 points'),
    "many components": (b"float\n", b"float 4000000000\n", "begins 20000000000 numbers of a field"),
}


@pytest.mark.sanitized
@pytest.mark.parametrize("fault", VALUE_FAULTS)
def test_values_that_are_damaged_are_refused_where_they_are_requested(mesh_reader, tmp_path, fault):
    find, put, words = VALUE_FAULTS[fault]
    behind = b"POINT_DATA 5\nSCALARS s float\nLOOKUP_TABLE default\n0.5 1.5 2 3 4\n"
    write_legacy(tmp_path / "v.vtk", POINTS, LEGACY_CELLS, behind=behind.replace(find, put))
    answer = mesh_reader(tmp_path / "v.vtk", "read-mesh-values")
    assert isinstance(answer, str) and words in answer, answer
    assert not isinstance(mesh_reader(tmp_path / "v.vtk"), str)


def test_a_piece_without_the_values_of_another_is_refused(mesh_reader, tmp_path):
    pieces = [(POINTS, {"Polys": POLYS}), (POINTS + 5, {"Polys": POLYS})]
    write_xml(tmp_path / "v.vtp", pieces, values=[{"s": numpy.arange(5.0), "t": numpy.arange(5.0)}, {"t": numpy.arange(5.0)}])
    assert 'piece 1 of the VTK file has no values "s" of 1 components, which piece 0 has' in mesh_reader(tmp_path / "v.vtp", "read-mesh-values")


def test_values_that_a_piece_has_twice_are_refused(mesh_reader, tmp_path):
    pieces = [(POINTS, {"Polys": POLYS}), (POINTS + 5, {"Polys": POLYS})]
    write_xml(tmp_path / "v.vtp", pieces, values=[{"s": numpy.arange(5.0)}, {"s": numpy.arange(5.0), "t": numpy.arange(5.0)}])
    (tmp_path / "v.vtp").write_bytes((tmp_path / "v.vtp").read_bytes().replace(b'"t"', b'"s"'))
    assert 'piece 1 of the VTK file has the values "s" twice' in mesh_reader(tmp_path / "v.vtp", "read-mesh-values")


def test_values_of_one_name_are_refused(solve, tmp_path):
    write_legacy(tmp_path / "v.vtk", POINTS, {"POLYGONS": POLYS, "TRIANGLE_STRIPS": [STRIP]},
                 behind=VALUES + b"SCALARS s float\nLOOKUP_TABLE default\n9 8 7 6 5\n")
    for more in ({"attributes": [{"name": "s", "as": "size"}]}, {"sampling": {"count": 60, "grid": {"name": "s"}}}):
        error, none = solve({"version": 1, "surface": {"mesh": {"path": "v.vtk"}}, "sampling": {"count": 60}, "output": {"preview": False}, **more})
        assert none is None and error["code"] == "input_unsupported" and '2 values with the name "s": rename one of them' in error["message"], error


def test_values_of_points_are_attributes(solve, tmp_path):
    """The points of a pyramid carry a linear function of its corners."""
    write_legacy(tmp_path / "v.vtk", POINTS, {"POLYGONS": POLYS, "TRIANGLE_STRIPS": [STRIP]},
                 behind=b"POINT_DATA 5\n" + legacy_array("VECTORS place TYPE", POINTS.astype("f4"), False))
    report, data = solve({"version": 1, "surface": {"mesh": {"path": "v.vtk"}}, "sampling": {"count": 60}, "attributes": [{"name": "place"}],
                          "output": {"preview": False, "ply": {"precision": "double"}}})
    columns = read_columns(data)
    assert {a["name"]: a["type"] for a in report["attributes"]}["place"] == "vector"
    for axis in "xyz":
        assert columns[f"place_{axis}"] == pytest.approx(columns[axis], abs=1e-3)
