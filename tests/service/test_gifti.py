# SPDX-License-Identifier: Apache-2.0
"""GIfTI surfaces as meshes: what the process that reads answers, for each way of storing the same mesh, and what is refused."""
import json

import numpy
import pytest

from gifti_files import IDENTITY, array, write
from pyramid import AREA, POINTS, assert_pyramid

TRIANGLES = numpy.array([[3, 2, 1], [3, 1, 0], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])


def surface(points="f4", triangles="i4", **how):
    return array("POINTSET", POINTS.astype(points), **how), array("TRIANGLE", TRIANGLES.astype(triangles), **{
        k: v for k, v in how.items() if k != "matrix"})


@pytest.mark.sanitized
@pytest.mark.parametrize("encoding", ["ASCII", "Base64Binary", "GZipBase64Binary"])
def test_every_encoding(mesh_reader, tmp_path, encoding):
    write(tmp_path / "a.surf.gii", *surface(encoding=encoding))
    assert_pyramid(mesh_reader(tmp_path / "a.surf.gii"))
    write(tmp_path / "a.gii", *surface("f8", "u1", encoding=encoding, big=True))
    assert_pyramid(mesh_reader(tmp_path / "a.gii"))


@pytest.mark.parametrize("encoding", ["ASCII", "GZipBase64Binary"])
def test_columns_and_other_arrays(mesh_reader, tmp_path, encoding):
    values = array("SHAPE", numpy.arange(5, dtype="f4"))
    write(tmp_path / "a.gii", values, *reversed(surface(encoding=encoding, by_column=True)))
    assert_pyramid(mesh_reader(tmp_path / "a.gii"))


def test_a_transform_is_a_warning(mesh_reader, tmp_path):
    write(tmp_path / "a.gii", *surface(matrix=IDENTITY.replace("0", "2", 1)))
    vertices, _, text, _ = mesh_reader(tmp_path / "a.gii")
    assert (vertices == POINTS).all()
    assert text == 'the GIfTI file has a transform to "NIFTI_XFORM_TALAIRACH", which is not applied: points are in its data space, "NIFTI_XFORM_UNKNOWN"'


@pytest.mark.parametrize("matrix", [IDENTITY.replace("1", "1,5", 1), IDENTITY[2:], IDENTITY + " 0", IDENTITY.replace("0", "nan", 1)])
def test_a_matrix_that_is_not_understood_is_a_warning(mesh_reader, tmp_path, matrix):
    write(tmp_path / "a.gii", *surface(matrix=matrix))
    assert "has a transform" in mesh_reader(tmp_path / "a.gii")[2]


def test_each_transform_is_looked_at(mesh_reader, tmp_path):
    points, triangles = surface(matrix=IDENTITY.replace("0", "2", 1))
    begin, end = points.index("<Coord"), points.index("<Data>")
    write(tmp_path / "a.gii", points[:end] + surface()[0][begin:], triangles)
    assert "has a transform" in mesh_reader(tmp_path / "a.gii")[2]


@pytest.mark.parametrize("declared", [1, 3, 0, "2x", "2,5", ""])
def test_a_number_of_arrays_that_the_file_does_not_have_is_a_warning(mesh_reader, tmp_path, declared):
    write(tmp_path / "a.gii", *surface())
    path = tmp_path / "a.gii"
    path.write_text(path.read_text().replace('NumberOfDataArrays="2"', f'NumberOfDataArrays="{declared}"'))
    answer = mesh_reader(path)
    assert_pyramid((answer[0], answer[1], "", answer[3]))
    assert f'NumberOfDataArrays is "{declared}", and the file has 2' in answer[2], answer[2]


def test_as_a_job_and_as_an_inspection(solve, worker, tmp_path):
    write(tmp_path / "a.surf.gii", *surface())
    report, data = solve({"version": 1, "surface": {"mesh": {"path": "a.surf.gii"}}, "sampling": {"count": 40}, "solver": {"max_sweeps": 1},
                          "output": {"preview": False}})
    assert data and report["surface"]["area"] == pytest.approx(AREA) and report["surface"]["mesh"]["triangles"] == 6
    seen = json.loads(worker("a.surf.gii", "--json", command="inspect", output=None).stdout)
    assert seen["format"] == "mesh" and seen["mesh"]["triangles"] == 6 and seen["mesh"]["closed"]


POINTS_OF, TRIANGLES_OF = surface()
FAULTS = {
    "values alone": ([array("SHAPE", numpy.arange(5, dtype="f4"))], "no array with the intent NIFTI_INTENT_POINTSET"),
    "no triangles": ([POINTS_OF], "no array with the intent NIFTI_INTENT_TRIANGLE"),
    "two surfaces": ([POINTS_OF, POINTS_OF, TRIANGLES_OF], "2 arrays with the intent NIFTI_INTENT_POINTSET"),
    "real corners": ([POINTS_OF, array("TRIANGLE", TRIANGLES.astype("f4"))], "numbers that are not read: save it with NIFTI_TYPE_INT32"),
    "pairs": ([array("POINTSET", POINTS[:, :2].astype("f4")), TRIANGLES_OF], "not rows of three numbers"),
    "a corner": ([POINTS_OF, array("TRIANGLE", TRIANGLES.astype("i4") + 1)], "triangle 2 of the GIfTI file has the point 5"),
    "another file": ([POINTS_OF, array("TRIANGLE", TRIANGLES.astype("i4"), "ExternalFileBinary", ExternalFileName="/etc/hosts")],
                     "array 1 of the GIfTI file has its data in another file"),
    "an encoding": ([POINTS_OF, array("TRIANGLE", TRIANGLES.astype("i4"), Encoding="Hex")], 'has the Encoding "Hex"'),
    "a size": ([array("POINTSET", POINTS.astype("f4"), Dim0=2000000000), TRIANGLES_OF], "has 6000000000 values, and its data have"),
    "a side": ([array("POINTSET", POINTS.astype("f4"), Dim0=-3), TRIANGLES_OF], 'the Dim0 "-3"'),
    "a number of axes": ([array("POINTSET", POINTS.astype("f4"), Dimensionality="2,5"), TRIANGLES_OF], "not rows of three numbers"),
    "an order": ([array("POINTSET", POINTS.astype("f4"), ArrayIndexingOrder="Diagonal"), TRIANGLES_OF], 'array 0 of the GIfTI file has the ArrayIndexingOrder "Diagonal"'),
    "a byte order": ([POINTS_OF, array("TRIANGLE", TRIANGLES.astype("i4"), Endian="MiddleEndian")], 'array 1 of the GIfTI file has the Endian "MiddleEndian"'),
    "data twice": ([POINTS_OF.replace("</Data>", "</Data><Data>eJw=</Data>"), TRIANGLES_OF], "array 0 of the GIfTI file has its data twice"),
    "axes": ([array("POINTSET", POINTS.astype("f4"), Dimensionality=7), TRIANGLES_OF], "not rows of three numbers"),
}


@pytest.mark.sanitized
@pytest.mark.parametrize("fault", FAULTS)
def test_files_that_are_refused(mesh_reader, tmp_path, fault):
    arrays, words = FAULTS[fault]
    write(tmp_path / "a.gii", *arrays)
    answer = mesh_reader(tmp_path / "a.gii")
    assert isinstance(answer, str) and words in answer, answer


@pytest.mark.sanitized
def test_xml_that_is_refused(mesh_reader, tmp_path):
    write(tmp_path / "a.gii", *surface(), doctype='<!DOCTYPE GIFTI [<!ENTITY a "b">]>')
    assert "declarations in its document type" in mesh_reader(tmp_path / "a.gii")
    write(tmp_path / "a.gii", *surface())
    whole = (tmp_path / "a.gii").read_bytes()
    for share in (0.3, 0.7, 0.99):
        (tmp_path / "a.gii").write_bytes(whole[:int(share * len(whole))])
        assert "is not valid XML" in mesh_reader(tmp_path / "a.gii")
    (tmp_path / "a.gii").write_bytes(whole.replace(b"GIFTI", b"GITFI"))
    assert 'the element "GITFI"' in mesh_reader(tmp_path / "a.gii")


@pytest.mark.parametrize("encoding", ["ASCII", "Base64Binary", "GZipBase64Binary"])
def test_data_of_fewer_numbers(mesh_reader, tmp_path, encoding):
    write(tmp_path / "a.gii", array("POINTSET", POINTS.astype("f4"), encoding, Dim0=6), surface(encoding=encoding)[1])
    answer = mesh_reader(tmp_path / "a.gii")
    assert isinstance(answer, str) and "array 0 of the GIfTI file (NIFTI_INTENT_POINTSET)" in answer and "Save it again" in answer, answer


# ---- values of points

RNG = numpy.random.default_rng(5)
VALUES = {"thickness": RNG.random(5).astype("f4"), "a direction": RNG.random((5, 3)).astype("f8"), "region": RNG.integers(0, 99, 5).astype("i4"),
          "column": RNG.random((5, 1)).astype("f4")}


@pytest.mark.sanitized
@pytest.mark.parametrize("by_column", [False, True])
@pytest.mark.parametrize("encoding", ["ASCII", "Base64Binary", "GZipBase64Binary"])
def test_values_of_points(mesh_reader, tmp_path, encoding, by_column):
    how = {"encoding": encoding, "by_column": by_column, "big": by_column}
    thickness, direction, region, column = (array("LABEL" if name == "region" else "SHAPE", values, name=name, **how) for name, values in VALUES.items())
    write(tmp_path / "a.gii", thickness, *surface(**how), direction, array("TENSOR", RNG.random((5, 9)).astype("f4")), region, column,
          array("NONE", numpy.arange(5, dtype="f4")))
    *mesh, found = mesh_reader(tmp_path / "a.gii", "read-mesh-values")
    assert_pyramid(mesh)
    expected = {**VALUES, "array 7": numpy.arange(5)}
    assert {name: kind for name, (kind, _) in found.items()} == {name: "whole" if name == "region" else "number" for name in expected}
    for name, (_, values) in found.items():
        assert values == pytest.approx(expected[name].reshape(5, -1), rel=1e-6), name


VALUE_FAULTS = {
    "fewer values": (array("SHAPE", numpy.arange(4, dtype="f4"), name="t"), "array 2 of the GIfTI file (t) does not have a row of numbers for each of the 5 points"),
    "a type": (array("SHAPE", numpy.arange(5, dtype="f4"), DataType="NIFTI_TYPE_RGBA32"), "array 2 of the GIfTI file (array 2) does not have a row of numbers"),
    "fewer data": (array("SHAPE", numpy.arange(5, dtype="f4"), "ASCII").replace("3.0 4.0", "3.0"), "array 2 of the GIfTI file (array 2) has 4 numbers, and 5 are expected"),
    "points that are listed": (array("NODE_INDEX", numpy.arange(5, dtype="i4")), "values of some points (NIFTI_INTENT_NODE_INDEX)"),
    "another file": (array("SHAPE", numpy.arange(5, dtype="f4"), "ExternalFileBinary"), "array 2 of the GIfTI file has its data in another file"),
}


@pytest.mark.sanitized
@pytest.mark.parametrize("fault", VALUE_FAULTS)
def test_values_that_are_damaged_are_refused_where_they_are_requested(mesh_reader, tmp_path, fault):
    values, words = VALUE_FAULTS[fault]
    write(tmp_path / "a.gii", *surface(), values)
    answer = mesh_reader(tmp_path / "a.gii", "read-mesh-values")
    assert isinstance(answer, str) and words in answer, answer
    assert_pyramid(mesh_reader(tmp_path / "a.gii"))


def test_values_alone_name_the_remedy(solve, tmp_path):
    write(tmp_path / "a.surf.gii", *surface())
    write(tmp_path / "a.func.gii", array("SHAPE", numpy.ones(5, "f4")))
    error, none = solve({"version": 1, "surface": {"mesh": {"path": "a.surf.gii"}}, "sampling": {"count": 40, "grid": {"path": "a.func.gii", "name": "array 0"}}})
    assert none is None and error["code"] == "input_unsupported" and "Append the arrays of values to that file" in error["message"], error


@pytest.mark.extended
def test_a_file_of_nibabel(mesh_reader, tmp_path):
    nibabel = pytest.importorskip("nibabel", reason="python3-nibabel is not installed")
    of = nibabel.gifti.GiftiDataArray
    nibabel.save(nibabel.gifti.GiftiImage(darrays=[of(POINTS.astype("f4"), "NIFTI_INTENT_POINTSET"), of(
        TRIANGLES.astype("i4"), "NIFTI_INTENT_TRIANGLE")]), str(tmp_path / "a.gii"))
    assert_pyramid(mesh_reader(tmp_path / "a.gii"))
