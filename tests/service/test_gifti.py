# SPDX-License-Identifier: Apache-2.0
"""GIfTI surfaces as meshes: what the process that reads answers, for each way of storing the same mesh, and what is refused."""
import base64
import json
import zlib

import numpy
import pytest

from pyramid import AREA, POINTS, assert_pyramid

TRIANGLES = numpy.array([[3, 2, 1], [3, 1, 0], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
IDENTITY = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"
TYPES = {"f4": "NIFTI_TYPE_FLOAT32", "f8": "NIFTI_TYPE_FLOAT64", "i4": "NIFTI_TYPE_INT32", "i8": "NIFTI_TYPE_INT64", "u1": "NIFTI_TYPE_UINT8"}


def array(intent, values, encoding="GZipBase64Binary", big=False, by_column=False, matrix=IDENTITY, **changes):
    order = ">" if big else "<"
    flat = values.flatten(order="F" if by_column else "C")
    data = flat.astype(order + values.dtype.str[1:]).tobytes()
    text = {"ASCII": lambda: " ".join(map(repr, flat.tolist())), "Base64Binary": lambda: base64.b64encode(data).decode(),
            "GZipBase64Binary": lambda: base64.b64encode(zlib.compress(data)).decode(), "ExternalFileBinary": str}[encoding]()
    attributes = {"Intent": f"NIFTI_INTENT_{intent}", "DataType": TYPES[values.dtype.str[1:]],
                  "ArrayIndexingOrder": "ColumnMajorOrder" if by_column else "RowMajorOrder", "Dimensionality": values.ndim,
                  **{f"Dim{k}": n for k, n in enumerate(values.shape)}, "Encoding": encoding,
                  "Endian": "BigEndian" if big else "LittleEndian", "ExternalFileName": "", "ExternalFileOffset": 0, **changes}
    system = "" if intent != "POINTSET" else (
        "<CoordinateSystemTransformMatrix><DataSpace><![CDATA[NIFTI_XFORM_UNKNOWN]]></DataSpace><TransformedSpace>"
        f"<![CDATA[NIFTI_XFORM_TALAIRACH]]></TransformedSpace><MatrixData>{matrix}</MatrixData></CoordinateSystemTransformMatrix>")
    words = " ".join(f'{k}="{v}"' for k, v in attributes.items())
    return f"<DataArray {words}><MetaData></MetaData>{system}<Data>{text}</Data></DataArray>\n"


def write(path, *arrays, doctype='<!DOCTYPE GIFTI SYSTEM "http://www.nitrc.org/frs/download.php/115/gifti.dtd">'):
    path.write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n{doctype}\n<GIFTI Version="1.0" NumberOfDataArrays="{len(arrays)}">\n'
                    + "<MetaData></MetaData><LabelTable></LabelTable>\n" + "".join(arrays) + "</GIFTI>\n")


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


@pytest.mark.parametrize("declared", [1, 3, 0])
def test_a_number_of_arrays_that_the_file_does_not_have_is_a_warning(mesh_reader, tmp_path, declared):
    write(tmp_path / "a.gii", *surface())
    path = tmp_path / "a.gii"
    path.write_text(path.read_text().replace('NumberOfDataArrays="2"', f'NumberOfDataArrays="{declared}"'))
    answer = mesh_reader(path)
    assert_pyramid((answer[0], answer[1], "", answer[3]))
    assert f"NumberOfDataArrays is {declared}, and the file has 2" in answer[2], answer[2]


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


@pytest.mark.extended
def test_a_file_of_nibabel(mesh_reader, tmp_path):
    nibabel = pytest.importorskip("nibabel", reason="python3-nibabel is not installed")
    of = nibabel.gifti.GiftiDataArray
    nibabel.save(nibabel.gifti.GiftiImage(darrays=[of(POINTS.astype("f4"), "NIFTI_INTENT_POINTSET"), of(
        TRIANGLES.astype("i4"), "NIFTI_INTENT_TRIANGLE")]), str(tmp_path / "a.gii"))
    assert_pyramid(mesh_reader(tmp_path / "a.gii"))
