# SPDX-License-Identifier: Apache-2.0
"""Headers of dense volumes: every field that can change values, positions or units is honoured, or refused, or a warning says that
it is ignored. Files are written by volumes.py with fields that have other values than their defaults; what is the same volume
as an NRRD file gives the same bytes of points."""
import gzip
import json
import shutil
import struct
import subprocess

import numpy
import pytest

from readers import Points
from volumes import (Part, change_nifti, meta_image_data, nrrd_data, nrrd_header, write_exr, write_meta_image, write_nifti, write_nrrd)

SIZE = (15, 13, 14)
# Numbers that floats hold; the volume is mirrored, its axes are exchanged, and no two sides of a voxel are alike.
MATRIX = numpy.array([[0, 0.5, 0, -3.25], [-0.25, 0, 0, 7.5], [0, 0, 0.375, 100.75], [0, 0, 0, 1.0]])


def ball(kind="f4", steps=64):
    """Whole multiples of 1/steps, 0 on an ellipsoid: exact as floats, and as numbers that are scaled."""
    index = numpy.stack(numpy.meshgrid(*map(numpy.arange, SIZE), indexing="ij"), -1) - (numpy.array(SIZE) - 1) / 2 - 0.125
    return (numpy.round(steps * (5 - numpy.linalg.norm(index * (0.9, 1.1, 1), axis=-1))) / steps).astype(kind)


@pytest.fixture
def told(solve):
    """Runs a volume; its report, or the error, with the member `digest` of the points."""
    def run(path, isovalue=0.0, kind="volume", **members):
        report, data = solve({"version": 1, "surface": {kind: {"isovalue": isovalue, "path": str(path), **members}},
                              "sampling": {"count": 60}, "solver": {"threads": 1, "max_sweeps": 2},
                              "output": {"preview": False, "ply": {"precision": "double"}}})
        return {**report, "digest": report["outputs"][0]["sha256"], "points": Points(data)} if data else report
    return run


@pytest.fixture
def plain(told, tmp_path):
    """The digest of the volume as an NRRD file without other fields than it needs."""
    write_nrrd(tmp_path / "plain.nrrd", ball(), MATRIX)
    report = told(tmp_path / "plain.nrrd")
    assert not report["surface"]["warnings"]
    return report["digest"]


def warnings(report):
    assert "surface" in report, report
    return [w for w in report["surface"]["warnings"] if "are unresolved" not in w and "walls thinner" not in w]  # of flat voxels


def expect_same(report, digest):
    assert report.get("digest") == digest and not warnings(report), report.get("message") or warnings(report)


def expect_warning(report, *words):
    assert len(warnings(report)) == 1 and all(word in warnings(report)[0] for word in words), warnings(report)


def expect_error(report, code, words):
    assert report.get("code") == code and words in report["message"], report.get("message")


# ---- NRRD

QUIET_NRRD = ["content: a ball", "thicknesses: 0.1 0.2 0.3", "kinds: space domain space", 'labels: "x" "y" "z"',
              "sample units: Hounsfield", "centerings: cell node cell", 'space units: "mm" "mm" "mm"',
              "measurement frame: (0,1,0) (0,0,-1) (1,0,0)", "min: -7", "max: 12", "key:=value", "DWMRI_b-value:=1000"]


@pytest.mark.parametrize("endian, encoding", [("big", "gzip"), ("little", "ascii"), ("big", "raw")])
def test_nrrd_fields_that_change_nothing(told, plain, tmp_path, endian, encoding):
    write_nrrd(tmp_path / "v.nrrd", ball(), MATRIX, endian=endian, encoding=encoding, extra=QUIET_NRRD)
    expect_same(told(tmp_path / "v.nrrd"), plain)


@pytest.mark.sanitized
@pytest.mark.parametrize("field", ["labels: {}", 'space units: "{}" "m" "m"', "kinds: {} domain domain", "centerings: {}", "space: {}"])
def test_an_nrrd_field_that_is_too_long_is_refused(told, tmp_path, field):
    write_nrrd(tmp_path / "v.nrrd", ball(), MATRIX, extra=[field.format("x" * 1200)])
    report = told(tmp_path / "v.nrrd")
    assert report["code"] == "input_damaged" and "characters" in report["message"], report


def test_nrrd_comments_and_keys_may_have_any_length(told, plain, tmp_path):
    write_nrrd(tmp_path / "v.nrrd", ball(), MATRIX, extra=["# " + "x" * 5000, "key:=" + "x" * 5000, "k" * 5000 + ":=x"])
    expect_same(told(tmp_path / "v.nrrd"), plain)


def test_nrrd_data_beside_other_bytes(told, plain, tmp_path):
    data = b"one\ntwo\n" + b"12345" + nrrd_data(ball(), endian="big")
    (tmp_path / "v.raw").write_bytes(data)
    lines = nrrd_header(ball(), MATRIX, endian="big", extra=QUIET_NRRD + ["line skip: 2", "byte skip: 5", "data file: v.raw"])
    (tmp_path / "v.nhdr").write_text("\n".join(lines) + "\n")
    expect_same(told(tmp_path / "v.nhdr"), plain)


@pytest.mark.parametrize("change", [
    lambda text: text.replace("space: left-posterior-superior", "space dimension: 3"), lambda text: text.replace("NRRD0005", "NRRD0004"),
    lambda text: text.replace("\n", "\r\n"), lambda text: text.replace("type: float", "number: 2730\ntype: float"),
    lambda text: text.replace("encoding: raw", "encoding: RAW").replace("left-posterior-superior", "LPS"),
    lambda text: text.replace("space origin", "spaceorigin")])
def test_other_ways_to_write_an_nrrd_header(told, plain, tmp_path, change):
    (tmp_path / "v.nrrd").write_bytes(change("\n".join(nrrd_header(ball(), MATRIX)) + "\n\n").encode() + nrrd_data(ball()))
    expect_same(told(tmp_path / "v.nrrd"), plain)


def straight(tmp_path, told, extra):
    write_nrrd(tmp_path / "v.nrrd", ball(), extra=extra)
    return told(tmp_path / "v.nrrd")


@pytest.mark.parametrize("extra", [
    ["spacings: 0.5 0.25 2", "axis mins: -1 2 3.5", "centerings: node node node"],
    ["axis mins: -1 2 3.5", "axis maxs: 6 5 29.5", "centerings: node node node"],
    ["axis mins: -1.25 1.875 2.5", "axis maxs: 6.25 5.125 30.5", "centerings: cell cell cell"],
    ["spacings: 0.5 0.25 2", "axis maxs: 6 5 29.5", "centerings: node node node"],
    ["spacings: 0.5 0.25 2", "axis maxs: 6.25 5.125 30.5", "centerings: cell cell cell"],
    ["spacings: 0.5 0.25 2", "axis mins: -1.25 1.875 2.5", "axis maxs: 6.25 5.125 30.5", "centerings: cell cell cell"]])
def test_ends_of_nrrd_axes(told, tmp_path, extra):
    write_nrrd(tmp_path / "w.nrrd", ball(), numpy.array([[0.5, 0, 0, -1], [0, 0.25, 0, 2], [0, 0, 2, 3.5], [0, 0, 0, 1]]))
    expect_same(straight(tmp_path, told, extra), told(tmp_path / "w.nrrd")["digest"])


@pytest.mark.parametrize("extra, words", [
    (["spacings: 0.5 0.25 2", "axis mins: -1 2 3.5"], ("no centerings",)),
    (["spacings: 0.5 0.25 2", "axis mins: -1 2 3.5", "axis maxs: 60 5 29.5", "centerings: node node node"], ("contradict",)),
    (["spacings: 0.5 0.25 2", 'units: "um" "um" "um"'], ('"um"',)),
    (["old min: -1000", "old max: 3000"], ("old min (-1000)", "unu unquantize"))])
def test_nrrd_fields_that_are_ignored_have_a_warning(told, tmp_path, extra, words):
    expect_warning(straight(tmp_path, told, extra), *words)


def test_units_of_an_nrrd_space(told, plain, tmp_path):
    write_nrrd(tmp_path / "v.nrrd", ball(), MATRIX, extra=['space units: "m" "m" "m"'])
    report = told(tmp_path / "v.nrrd")
    assert report["digest"] == plain
    expect_warning(report, '"m"', "positions are in that unit")


# ---- MetaImage

QUIET_META = {"Comment": "a ball = round", "ObjectSubType": "none", "Name": "", "ID": "7", "ParentID": "-1", "Color": "1 0 0 1",
              "TransformType": "Rigid", "AnatomicalOrientation": "PRI", "DistanceUnits": "mm", "Modality": "MET_MOD_CT",
              "SequenceID": "1 2 3", "ElementMin": "-7", "ElementMax": "12", "ElementSize": "3 4 5", "CompressionLevel": "2",
              "0008|0060": "CT", "0020|000d": "1.2.840", "My_Key": "some text", "_ITK 2 key": "x", "Slope2": "9"}


@pytest.mark.parametrize("how", [{}, {"big": True}, {"packed": True}, {"text": True}])
def test_meta_image_fields_that_change_nothing(told, plain, tmp_path, how):
    write_meta_image(tmp_path / "v.mha", ball(), MATRIX, QUIET_META, **how)
    expect_same(told(tmp_path / "v.mha"), plain)
    write_meta_image(tmp_path / "v.mhd", ball(), MATRIX, QUIET_META, tmp_path / "v.data", **how)
    expect_same(told(tmp_path / "v.mhd"), plain)


@pytest.mark.sanitized
@pytest.mark.parametrize("key", ["0008|0005", "Patient_Name", "Key2", "a.b-c:d", "ITK InputFilterName", "k" * 300, "\u00e9"])
def test_keys_of_users_are_passed_over(told, plain, tmp_path, key):
    write_meta_image(tmp_path / "v.mha", ball(), MATRIX, {key: "ISO_IR 100", key + "2": "", key + "3": "x" * 3000})
    expect_same(told(tmp_path / "v.mha"), plain)


@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u4", "i8", "f8"])
def test_meta_image_as_text(told, tmp_path, kind):
    values = (numpy.round(8 * ball("f8")).clip(-60, 60) + (64 if kind[0] == "u" else 0)).astype(kind)
    write_nrrd(tmp_path / "v.nrrd", values, MATRIX)
    write_meta_image(tmp_path / "v.mha", values, MATRIX, text=True)
    isovalue = 64.5 if kind[0] == "u" else 0.5
    expect_same(told(tmp_path / "v.mha", isovalue), told(tmp_path / "v.nrrd", isovalue)["digest"])


@pytest.mark.parametrize("how", [{}, {"packed": True}, {"text": True}])
def test_header_size_counts_from_the_beginning_of_the_file_with_the_data(told, plain, tmp_path, how):
    """As MetaIO reads it, packed or not."""
    write_meta_image(tmp_path / "v.mhd", ball(), MATRIX, {"HeaderSize": "11"}, tmp_path / "v.data", b"eleven byte", **how)
    expect_same(told(tmp_path / "v.mhd"), plain)
    write_meta_image(tmp_path / "u.mha", ball(), MATRIX, {"HeaderSize": "2000"}, **how)
    raw = (tmp_path / "u.mha").read_bytes()
    head = len(raw) - len(meta_image_data(ball(), **how))
    (tmp_path / "u.mha").write_bytes(raw[:head] + bytes(2000 - head) + raw[head:])
    expect_same(told(tmp_path / "u.mha"), plain)


def test_header_size_from_the_end(told, plain, tmp_path):
    write_meta_image(tmp_path / "v.mhd", ball(), MATRIX, {"HeaderSize": "-1"}, tmp_path / "v.data", b"eleven byte")
    expect_same(told(tmp_path / "v.mhd"), plain)


@pytest.mark.parametrize("fields", [
    {"ElementSize": "0.5 0.25 2"}, {"ElementSize": "1 1 1", "ElementSpacing": "0.5 0.25 2"},
    {"ElementSpacing": "0.5 0.25 2", "ElementSize": "0.1 0.1 0.1"}, {"Modality": "MET_MOD_MR", "ElementSize": ".5 .25 2.0"}])
def test_the_size_of_elements_is_the_spacing_where_there_is_none(told, tmp_path, fields):
    write_nrrd(tmp_path / "v.nrrd", ball(), extra=["spacings: 0.5 0.25 2"])
    write_meta_image(tmp_path / "v.mha", ball(), None, fields)
    expect_same(told(tmp_path / "v.mha"), told(tmp_path / "v.nrrd")["digest"])


FIELDS_THAT_ARE_REFUSED = {
    "contradicting names of the byte order": ({"BinaryDataByteOrderMSB": "False", "ElementByteOrderMSB": "True"},
                                              "BinaryDataByteOrderMSB = False and ElementByteOrderMSB = True contradict each other"),
    "contradicting names of the origin": ({"Origin": "0 0 1"}, "Origin = 0 0 1 contradict each other"),
    "too many numbers": ({"ElementSize": "0.5 0.25 2 7"}, "ElementSize has more than 3 numbers (0.5 0.25 2 7)"),
    "a decimal comma": ({"ElementSpacing": "0,5 0,25 2,0"}, "ElementSpacing has too few numbers (0,5 0,25 2,0)"),
    "text behind a number": ({"HeaderSize": "0 bytes"}, "HeaderSize has more than 1 number (0 bytes)"),
    "no switch": ({"CompressedData": "No"}, 'CompressedData is "No"')}


@pytest.mark.parametrize("name", FIELDS_THAT_ARE_REFUSED)
def test_meta_image_fields_that_are_refused(told, tmp_path, name):
    fields, words = FIELDS_THAT_ARE_REFUSED[name]
    write_meta_image(tmp_path / "v.mha", ball(), MATRIX, fields)
    report = told(tmp_path / "v.mha")
    assert report["code"] == "input_damaged" and words in report["message"], report


def test_a_meta_image_field_that_is_there_twice(told, plain, tmp_path):
    write_meta_image(tmp_path / "v.mha", ball(), MATRIX)
    raw = (tmp_path / "v.mha").read_bytes()
    line = next(line for line in raw.split(b"\n") if line.startswith(b"DimSize"))
    (tmp_path / "v.mha").write_bytes(raw.replace(line, line + b"\n" + line, 1))
    expect_same(told(tmp_path / "v.mha"), plain)
    (tmp_path / "v.mha").write_bytes(raw.replace(line, line + b"\nDimSize = 2 2 2", 1))
    report = told(tmp_path / "v.mha")
    assert report["code"] == "input_damaged" and "contradict each other" in report["message"], report


def test_meta_image_fields_that_may_be_misspelt_are_named(told, plain, tmp_path):
    write_meta_image(tmp_path / "v.mha", ball(), MATRIX, {"ElementSpacng": "1 1 2", "offset": "1 2 3"})
    report = told(tmp_path / "v.mha")
    assert report["digest"] == plain and "ElementSpacng, offset are not known" in warnings(report)[0]


def test_a_name_of_a_data_file_with_a_percent_sign_that_is_no_pattern(told, plain, tmp_path):
    for name in ("50%.raw", "a%20b.raw", "%s.raw"):
        write_meta_image(tmp_path / "v.mhd", ball(), MATRIX, data_path=tmp_path / name)
        expect_same(told(tmp_path / "v.mhd"), plain)


@pytest.mark.parametrize("names", [("Position", "Rotation"), ("Origin", "Orientation")])
def test_other_names_of_meta_image_fields(told, plain, tmp_path, names):
    whole = {"Offset": None, "TransformMatrix": None, names[0]: "-3.25 7.5 100.75", names[1]: "0 -1 0 1 0 0 0 0 1"}
    write_meta_image(tmp_path / "v.mha", ball(), MATRIX, whole)
    expect_same(told(tmp_path / "v.mha"), plain)


def test_meta_image_values_are_scaled(told, plain, tmp_path):
    values = (64 * ball("f8")).astype("i2")
    for name, how in (("v.mha", {}), ("text.mha", {"text": True})):
        write_meta_image(tmp_path / name, values - 80, MATRIX, {"ElementToIntensityFunctionSlope": "0.015625",
                                                               "ElementToIntensityFunctionOffset": "1.25"}, **how)
        expect_same(told(tmp_path / name), plain)


@pytest.mark.parametrize("fields, words", [
    ({"DistanceUnits": "um"}, ('"um"', "positions are in that unit")),
    ({"CenterOfRotation": "1 2 3"}, ("CenterOfRotation is ignored",)),
    ({"AnatomicalOrientation": "RAI"}, ("AnatomicalOrientation = RAI contradicts TransformMatrix and is ignored",))])
def test_meta_image_fields_that_are_ignored_have_a_warning(told, plain, tmp_path, fields, words):
    write_meta_image(tmp_path / "v.mha", ball(), MATRIX, fields)
    report = told(tmp_path / "v.mha")
    assert report["digest"] == plain
    expect_warning(report, *words)


@pytest.mark.sanitized
@pytest.mark.parametrize("fields, code, word", [
    ({"CompressedData": "True", "BinaryData": "False"}, "input_unsupported", "BinaryData = False and CompressedData = True"),
    ({"HeaderSize": "-1", "BinaryData": "False"}, "input_unsupported", "needs binary data"),
    ({"HeaderSize": "-2"}, "input_damaged", "HeaderSize of -2"),
    ({"ElementSpacing": "1 2"}, "input_damaged", "ElementSpacing has too few numbers"),
    ({"ElementNumberOfChannels": "5"}, "input_damaged", "5 values at each sample"),
    ({"ElementType": "MET_LONG"}, "input_unsupported", "MET_LONG"),
    ({"ElementToIntensityFunctionSlope": "nan"}, "input_damaged", "not finite"),
    ({"NDims": "2"}, "input_unsupported", "three dimensions"),
    ({"NDims": "2", "DimSize": "13 14", "ElementSpacing": "1 1"}, "input_unsupported", "three dimensions"),
    ({"ElementSpacing": "1 0 1"}, "input_damaged", "one plane")])
def test_meta_image_fields_that_are_refused(told, tmp_path, fields, code, word):
    write_meta_image(tmp_path / "v.mha", ball(), MATRIX, fields)
    report = told(tmp_path / "v.mha")
    assert report["code"] == code and word in report["message"], report


# ---- NIfTI

QUIET_NIFTI = {"dim_info": 57, "intent_p1": 1.5, "intent_p2": 2.5, "intent_p3": 3.5, "intent_code": 1002, "slice_start": 1,
               "slice_end": 9, "slice_code": 3, "slice_duration": 0.5, "toffset": 4.5, "cal_max": 3, "cal_min": -3,
               "xyzt_units": 2 | 8, "descrip": b"a ball", "aux_file": b"none.txt", "intent_name": b"ball", "pixdim4": 2.5}
EXTENSIONS = [(6, b"comment " * 3), (44, b"\0" * 56)]


def nifti(path, values=None, version=1, endian="<", fields=None, extensions=(), **more):
    write_nifti(path, ball() if values is None else values, MATRIX, version=version, endian=endian, voxel=(0.25, 0.5, 0.375), **more)
    change_nifti(path, fields or {}, extensions, version, endian)


@pytest.mark.sanitized
@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("endian", ["<", ">"])
def test_nifti_fields_that_change_nothing(told, plain, tmp_path, version, endian):
    values = (64 * ball("f8")).astype("i2") - 80
    nifti(tmp_path / "v.nii", values, version, endian, {**QUIET_NIFTI, "scl_slope": 0.015625, "scl_inter": 1.25}, EXTENSIONS)
    expect_same(told(tmp_path / "v.nii"), plain)
    (tmp_path / "v.nii.gz").write_bytes(gzip.compress((tmp_path / "v.nii").read_bytes()))
    expect_same(told(tmp_path / "v.nii.gz"), plain)


@pytest.mark.parametrize("qfac", [1, -1])
def test_a_nifti_quaternion(told, tmp_path, qfac):
    """A half turn about x; beside it an sform of the same place, which makes no warning."""
    matrix = numpy.array([[0.25, 0, 0, 8], [0, -0.5, 0, 16], [0, 0, -0.375 * qfac, -4], [0, 0, 0, 1.0]])
    write_nrrd(tmp_path / "v.nrrd", ball(), matrix)
    digest = told(tmp_path / "v.nrrd")["digest"]
    write_nifti(tmp_path / "v.nii", ball(), None, quaternion=(1, 0, 0, 8, 16, -4, qfac), voxel=(0.25, 0.5, 0.375))
    expect_same(told(tmp_path / "v.nii"), digest)
    write_nifti(tmp_path / "v.nii", ball(), matrix, quaternion=(1, 0, 0, 8, 16, -4, qfac), voxel=(0.25, 0.5, 0.375))
    expect_same(told(tmp_path / "v.nii"), digest)


@pytest.mark.sanitized
@pytest.mark.parametrize("version, endian, extensions", [
    (1, "<", []), (1, ">", []), (2, "<", []), (2, ">", []), (1, "<", EXTENSIONS), (1, ">", EXTENSIONS), (2, "<", EXTENSIONS)])
def test_without_vox_offset_data_begin_behind_the_header(told, plain, tmp_path, version, endian, extensions):
    nifti(tmp_path / "v.nii", None, version, endian, {"vox_offset": 0}, extensions)
    expect_same(told(tmp_path / "v.nii"), plain)


def test_without_vox_offset_packed_data_begin_behind_the_header(told, plain, tmp_path):
    for name, extensions in (("v", []), ("x", EXTENSIONS)):
        nifti(tmp_path / f"{name}.nii", fields={"vox_offset": 0}, extensions=extensions)
        (tmp_path / f"{name}.nii.gz").write_bytes(gzip.compress((tmp_path / f"{name}.nii").read_bytes()))
    expect_same(told(tmp_path / "v.nii.gz"), plain)
    report = told(tmp_path / "x.nii.gz")
    assert report["code"] == "input_unsupported" and "unpack it" in report["message"]


def test_data_that_look_like_an_extension(told, tmp_path):
    """The first numbers are 16 and 0: the length and the code of an extension, if there were any."""
    values = (8 * ball("f8")).astype("i4")
    values[0, 0, 0], values[1, 0, 0] = 16, 0
    write_nrrd(tmp_path / "v.nrrd", values, MATRIX)
    nifti(tmp_path / "v.nii", values, fields={"vox_offset": 0}, extensions=EXTENSIONS)
    expect_same(told(tmp_path / "v.nii", 0.5), told(tmp_path / "v.nrrd", 0.5)["digest"])


@pytest.mark.parametrize("fields, apart", [
    ({"qoffset_x": 9}, True), ({"qoffset_z": 100.75, "pixdim0": 1}, True), ({"quatern_b": 0.1}, True),
    ({"pixdim1": 0.26}, True), ({"pixdim3": 0.5}, True), ({}, False), ({"qoffset_x": 7.5000010}, False)])
def test_an_sform_that_is_not_the_qform_is_used_with_a_warning(told, tmp_path, fields, apart):
    matrix = numpy.array([[0.25, 0, 0, 7.5], [0, -0.5, 0, 16], [0, 0, 0.375, 100.75], [0, 0, 0, 1.0]])
    write_nrrd(tmp_path / "v.nrrd", ball(), matrix)
    write_nifti(tmp_path / "v.nii", ball(), matrix, quaternion=(1, 0, 0, 7.5, 16, 100.75, -1), voxel=(0.25, 0.5, 0.375))
    change_nifti(tmp_path / "v.nii", fields)
    report = told(tmp_path / "v.nii")
    assert report["digest"] == told(tmp_path / "v.nrrd")["digest"]
    if apart:
        expect_warning(report, "sform (code 1) and qform (code 1)", "the sform is used")
    else:
        assert not warnings(report)


@pytest.mark.parametrize("fields, words", [
    ({"xyzt_units": 1}, ('"m"',)), ({"xyzt_units": 3 | 8}, ('"um"',)),
    ({"scl_inter": 5.0}, ("scl_slope is 0 and scl_inter is 5",))])
def test_nifti_fields_that_are_ignored_have_a_warning(told, plain, tmp_path, fields, words):
    nifti(tmp_path / "v.nii", fields=fields)
    report = told(tmp_path / "v.nii")
    assert report["digest"] == plain
    expect_warning(report, *words)


def test_a_nifti_slope_that_is_no_number_is_none(told, plain, tmp_path):
    """nibabel writes it so."""
    nifti(tmp_path / "v.nii", fields={"scl_slope": numpy.nan, "scl_inter": numpy.nan})
    expect_same(told(tmp_path / "v.nii"), plain)


@pytest.mark.parametrize("version, endian", [(1, "<"), (1, ">"), (2, "<"), (2, ">")])
def test_sizes_of_voxels_that_the_library_replaces(told, tmp_path, version, endian):
    for size in (0, numpy.nan, numpy.inf):
        write_nifti(tmp_path / "v.nii", ball(), voxel=(0.25, 0.5, size), version=version, endian=endian)
        expect_warning(told(tmp_path / "v.nii"), f"pixdim 3 is {size:g}", "1 is used")


def test_sizes_of_voxels_that_are_none(told, tmp_path):
    write_nifti(tmp_path / "v.nii", ball(), voxel=(0.25, -0.5, 0.375))
    expect_warning(told(tmp_path / "v.nii"), "pixdim 2 is -0.5", "0.5 is used")


@pytest.mark.sanitized
@pytest.mark.parametrize("version, qfac", [(1, numpy.nan), (1, numpy.inf), (1, -numpy.inf), (2, -numpy.inf)])
def test_a_handedness_that_is_not_finite_is_refused(told, tmp_path, version, qfac):
    """pixdim[0], for a qform without an sform."""
    write_nifti(tmp_path / "v.nii", ball(), version=version, quaternion=(1, 0, 0, 8, 16, -4, qfac), voxel=(0.25, 0.5, 0.375))
    expect_error(told(tmp_path / "v.nii"), "input_damaged", "pixdim[0]")


@pytest.mark.sanitized
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("factor", [1e8, 1e38])
def test_voxels_of_very_different_sides_are_refused(told, tmp_path, axis, factor):
    """Their parts could not be divided until they are as small as a spacing."""
    matrix = numpy.diag([0.25, 0.5, 0.375, 1])
    matrix[axis, axis] *= factor
    write_nrrd(tmp_path / "v.nrrd", ball(), matrix)
    expect_error(told(tmp_path / "v.nrrd"), "input_damaged", "the sides of its voxels")


@pytest.mark.sanitized
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_volume_so_far_away_that_voxels_coincide_is_refused(told, tmp_path, axis):
    matrix = numpy.diag([0.25, 0.5, 0.375, 1])
    matrix[axis, 3] = -1e20
    write_nrrd(tmp_path / "v.nrrd", ball(), matrix)
    expect_error(told(tmp_path / "v.nrrd"), "input_damaged", "its origin")


@pytest.mark.sanitized
@pytest.mark.parametrize("version, offset", [(1, 347), (1, 1), (1, -16), (1, numpy.nan), (2, 539), (2, -1)])
def test_a_vox_offset_within_the_header_is_refused(told, tmp_path, version, offset):
    nifti(tmp_path / "v.nii", version=version, fields={"vox_offset": offset})
    report = told(tmp_path / "v.nii")
    assert report["code"] == "input_damaged" and "vox_offset" in report["message"], report


# ---- numbers that are not exact

def quaternion_matrix(b, c, d):
    a = numpy.sqrt(1 - b * b - c * c - d * d)
    return numpy.array([[a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
                        [2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b)],
                        [2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - b * b - c * c]])


def farthest(report, other):
    assert "points" in report and "points" in other, (report, other)
    return numpy.abs(report["points"].position - other["points"].position).max() / other["spacing"]


@pytest.mark.parametrize("seed", [1, 2, pytest.param(3, marks=pytest.mark.extended), pytest.param(4, marks=pytest.mark.extended)])
def test_any_places_are_those_of_the_header(told, tmp_path, seed):
    """Random turns, sides of voxels and origins: points lie within 1e-6 spacings of those of an NRRD file with that matrix."""
    print(f"seed {seed}")
    draws = numpy.random.default_rng(seed)
    turn = draws.normal(size=4)
    bcd = numpy.float32(turn / numpy.linalg.norm(turn) * numpy.sign(turn[0]))[1:].astype("f8")
    voxel, origin = numpy.float32(draws.uniform(0.4, 0.6, 3)).astype("f8"), numpy.float32(draws.uniform(-200, 200, 3)).astype("f8")
    qfac = int(draws.choice([-1, 1]))
    matrix = numpy.eye(4)
    matrix[:3, :3] = quaternion_matrix(*bcd) @ numpy.diag(voxel * (1, 1, qfac))
    matrix[:3, 3] = origin
    write_nrrd(tmp_path / "v.nrrd", ball(), matrix)
    exact = told(tmp_path / "v.nrrd")
    for version in (1, 2):
        write_nifti(tmp_path / "q.nii", ball(), version=version, quaternion=(*bcd, *origin, qfac), voxel=voxel)
        assert farthest(told(tmp_path / "q.nii"), exact) < 1e-6
    write_nifti(tmp_path / "s.nii", ball(), matrix, version=2)
    write_meta_image(tmp_path / "v.mha", ball(), matrix)
    for name in ("s.nii", "v.mha"):
        assert farthest(told(tmp_path / name), exact) < 1e-6
    write_nrrd(tmp_path / "single.nrrd", ball(), numpy.float32(matrix).astype("f8"))
    write_nifti(tmp_path / "s.nii", ball(), matrix)
    expect_same(told(tmp_path / "s.nii"), told(tmp_path / "single.nrrd")["digest"])


@pytest.mark.parametrize("field", ["spacings: 1 1,5 2", "spacings: 1 1.5x 2", "axis mins: 0 0 1,25", "axismaxs: 9 9 9;", "old min: 0,5"])
def test_a_number_of_an_nrrd_header_is_read_to_its_end(told, tmp_path, field):
    extra = [field] if field.startswith("spacings") else ["spacings: 1 1 1", field]
    write_nrrd(tmp_path / "v.nrrd", ball(), None, extra=extra)
    report = told(tmp_path / "v.nrrd")
    assert report.get("code") == "input_damaged" and "which is not a number" in report["message"] and field.split(":")[0][:4] in report["message"], report


@pytest.mark.parametrize("field", ["ElementSpacing", "ElementSize", "Offset", "TransformMatrix", "CenterOfRotation", "HeaderSize"])
@pytest.mark.parametrize("number", ["nan", "inf", "1e400"])
def test_a_number_of_a_meta_image_that_is_not_finite_is_refused(told, tmp_path, field, number):
    values = {"TransformMatrix": f"1 0 0 0 {number} 0 0 0 1", "HeaderSize": number}.get(field, f"1 {number} 1")
    write_meta_image(tmp_path / "v.mha", ball(), MATRIX, {field: values})
    report = told(tmp_path / "v.mha")
    assert report.get("code") == "input_damaged" and field in report["message"] and "not finite" in report["message"], report


def shorter(path, old, new):
    path.write_bytes(path.read_bytes().replace(old, new, 1))


def test_bytes_behind_the_data_are_warned_of(told, tmp_path):
    """A size in the header is too small. A volume of several is none of these, nor a line break behind the data."""
    write_nrrd(tmp_path / "v.nrrd", ball(), MATRIX)
    assert warnings(told(tmp_path / "v.nrrd")) == []
    (tmp_path / "v.nrrd").write_bytes((tmp_path / "v.nrrd").read_bytes() + b"\n")
    assert warnings(told(tmp_path / "v.nrrd")) == []
    for old, new in ((b"sizes: 15 13 14", b"sizes: 15 13 13"), (b"sizes: 15 13 13", b"sizes: 15 12 13"), (b"sizes: 15 12 13", b"sizes: 14 12 13")):
        shorter(tmp_path / "v.nrrd", old, new)
        assert any("more data follow those of" in w for w in warnings(told(tmp_path / "v.nrrd")))
    for encoding in ("gzip", "ascii"):
        write_nrrd(tmp_path / "v.nrrd", ball(), MATRIX, encoding)
        assert warnings(told(tmp_path / "v.nrrd")) == []
        shorter(tmp_path / "v.nrrd", b"sizes: 15 13 14", b"sizes: 15 13 13")
        assert any("more data follow those of" in w for w in warnings(told(tmp_path / "v.nrrd"))), encoding
    write_nifti(tmp_path / "v.nii.gz", ball(), MATRIX)
    assert warnings(told(tmp_path / "v.nii.gz")) == []
    raw = bytearray(gzip.decompress((tmp_path / "v.nii.gz").read_bytes()))
    struct.pack_into("<h", raw, 46, 13)
    (tmp_path / "v.nii.gz").write_bytes(gzip.compress(raw))
    assert any("more data follow those of" in w for w in warnings(told(tmp_path / "v.nii.gz")))
    write_meta_image(tmp_path / "v.mha", ball(), MATRIX)
    assert warnings(told(tmp_path / "v.mha")) == []
    shorter(tmp_path / "v.mha", b"DimSize = 15 13 14", b"DimSize = 15 13 12")
    assert any("more data follow those of 15 x 13 x 12" in w for w in warnings(told(tmp_path / "v.mha")))
    for version, at, kind in ((1, 46, "<h"), (2, 40, "<q")):
        write_nifti(tmp_path / "v.nii", ball(), MATRIX, version=version)
        assert warnings(told(tmp_path / "v.nii")) == []
        raw = bytearray((tmp_path / "v.nii").read_bytes())
        struct.pack_into(kind, raw, at, 13)
        (tmp_path / "v.nii").write_bytes(raw)
        assert any("more data follow those of 15 x 13 x 13" in w for w in warnings(told(tmp_path / "v.nii")))


@pytest.mark.parametrize("version, at", [(1, 72), (2, 14)])
def test_a_bitpix_that_the_datatype_contradicts_is_warned_of(told, tmp_path, version, at):
    write_nifti(tmp_path / "v.nii", ball(), MATRIX, version=version)
    plain = told(tmp_path / "v.nii")
    raw = bytearray((tmp_path / "v.nii").read_bytes())
    struct.pack_into("<h", raw, at, 16)
    (tmp_path / "v.nii").write_bytes(raw)
    report = told(tmp_path / "v.nii")
    assert report["digest"] == plain["digest"]
    expect_warning(report, "bitpix is 16", "32 bits")


# ---- EXR

def stack(tmp_path, name, **of_part):
    """The ball as images; what names it."""
    values = of_part.pop("values", ball())
    for k in range(SIZE[2]):
        write_exr(tmp_path / f"{name}.{k}.exr", Part({"Y": values[:, :, k]}, **of_part))
    return {"path": str(tmp_path / f"{name}.#.exr"), "slices": f"0-{SIZE[2] - 1}", "kind": "exr",
            "voxel_size": [0.5, 0.25, 2], "origin": [-1, 2, 3.5]}


def attribute(name, kind, value):
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value


@pytest.mark.parametrize("of_part", [
    {"aspect": 2}, {"order": 1, "compression": 2}, {"order": 1, "tile": (4, 5)}, {"display": (5, 6, 7, 8)},
    {"extra": attribute("worldToCamera", "m44f", struct.pack("<16f", *range(16))) +
     attribute("chromaticities", "chromaticities", struct.pack("<8f", *range(8)))}])
def test_exr_fields_that_change_nothing(told, tmp_path, of_part):
    write_nrrd(tmp_path / "v.nrrd", ball(), numpy.array([[0.5, 0, 0, -1], [0, 0.25, 0, 2], [0, 0, 2, 3.5], [0, 0, 0, 1]]))
    expect_same(told(**stack(tmp_path, "s", **of_part)), told(tmp_path / "v.nrrd")["digest"])


def test_pixels_of_an_aspect_that_the_job_does_not_have(told, tmp_path):
    expect_warning(told(**stack(tmp_path, "s", aspect=1.5)), f"{SIZE[2]} slices have a pixelAspectRatio", "1.5", "voxel_size")


# ---- other files

OTHERS = [(b"# vtk DataFile Version 3.0\n", "VTK file (3D Slicer saves a volume as NRRD"),
          (b'<?xml version="1.0"?>\n<VTKFile type="ImageData">', "VTK XML file (ParaView saves a volume as MetaImage"),
          (b'<?xml version="1.0"?>\n<GIFTI Version="1.0">', "GIfTI file, which holds a mesh (name it as /surface/mesh/path"),
          (b'{"zarr_format": 2, "shape": [8, 8, 8]}', "Zarr volume (name its directory"),
          (b"PK\3\4", "ZIP archive (unpack it; name the directory"), (bytes(128) + b"DICM", "DICOM file (`dcm2niix FOLDER`"),
          (b"\x89HDF\r\n\x1a\n", "HDF5 file (`h5dump -d DATASET -b LE -o FILE`"), (b"CDF\1", "MINC file (`mnc2nii`"),
          (bytes(208) + b"MAP ", "MRC or CCP4 map (1024 bytes"), (struct.pack("<i", 348), "ANALYZE 7.5 header (`fslchfiletype"),
          (struct.pack(">i", 348), "ANALYZE 7.5 header (`fslchfiletype"), (b"\7\6\5", "raw numbers need an NRRD header: `unu make")]


@pytest.mark.sanitized
@pytest.mark.parametrize("begin, words", OTHERS)
def test_other_files_are_named_with_a_converter(told, tmp_path, begin, words):
    (tmp_path / "file").write_bytes(begin + bytes(1000))
    report = told(tmp_path / "file")
    assert report["code"] == "input_unsupported" and words in report["message"], report


def test_what_is_packed_is_named_with_a_converter(told, tmp_path):
    for begin, words in ((b"\0\0\0\1", "FreeSurfer (`mri_convert"), (b"# vtk DataFile", "VTK file"), (b"other", "not a volume in a known")):
        (tmp_path / "v.mgz").write_bytes(gzip.compress(begin + bytes(1000)))
        report = told(tmp_path / "v.mgz")
        assert report["code"] == "input_unsupported" and "compressed by gzip and contains " in report["message"]
        assert words in report["message"], report


def test_a_directory_is_named_with_a_converter(told, tmp_path):
    (tmp_path / "v.zarr").mkdir()
    report = told(tmp_path / "v.zarr")
    assert report["code"] == "input_unsupported" and "Zarr" in report["message"] and "dcm2niix" in report["message"], report


@pytest.mark.parametrize("begin, name", [(b"II*\0", "TIFF"), (b"MM\0*", "TIFF"), (b"\x89PNG", "PNG"), (b"\xff\xd8\xff\xe0", "JPEG"),
                                         (b"SDPX", "DPX")])
def test_other_images_of_a_stack_are_named_with_a_converter(told, tmp_path, begin, name):
    named = stack(tmp_path, "s")
    (tmp_path / "s.3.exr").write_bytes(begin + bytes(1000))
    report = told(**named)
    assert report["code"] == "input_unsupported" and f"{name} image: " in report["message"], report
    assert ("/surface/volume/path with slices" if name == "TIFF" else "`oiiotool") in report["message"]
    assert "slice 3" in report["message"]


# ---- isovalues

@pytest.mark.parametrize("kind", ["f8", "i4", "u4", "i8", "u8"])
def test_isovalues_are_subtracted_before_values_become_floats(told, tmp_path, kind):
    """Numbers around one that floats hold to 128 or 0.06 at best."""
    whole = kind != "f8"
    far = 2.0**30 if whole else 1e6
    values = 1000 * ball("f8") if whole else ball("f8")
    write_nrrd(tmp_path / "near.nrrd", numpy.round(values).astype(kind.replace("u", "i")) if whole else values, MATRIX)
    write_nrrd(tmp_path / "far.nrrd", ((numpy.round(values) if whole else values) + far).astype(kind), MATRIX)
    near, isovalue = told(tmp_path / "near.nrrd", 0.3125), far + 0.3125
    expect_same(told(tmp_path / "far.nrrd", isovalue), near["digest"])
    report = told(tmp_path / "far.nrrd", isovalue)
    assert report["surface"]["isovalue"] == isovalue
    error = told(tmp_path / "far.nrrd", far + 1e7)
    assert error["code"] == "no_surface" and f"isovalue {far + 1e7:g}" in error["message"]


# ---- an inspection tells the same

def test_an_inspection_has_the_warnings(worker, tmp_path):
    nifti(tmp_path / "v.nii", fields={"xyzt_units": 3})
    done = worker(str(tmp_path / "v.nii"), "--json", output=None, command="inspect")
    volume = json.loads(done.stdout)["volume"]
    assert len(volume["warnings"]) == 1 and '"um"' in volume["warnings"][0]
    assert f"  warning    {volume['warnings'][0]}\n" in worker(str(tmp_path / "v.nii"), output=None, command="inspect").stdout


def test_an_attribute_has_the_warnings_of_its_file(solve, plain, tmp_path):
    nifti(tmp_path / "v.nii", fields={"xyzt_units": 3})
    report, _ = solve({"version": 1, "surface": {"volume": {"path": str(tmp_path / "plain.nrrd"), "isovalue": 0}},
                       "attributes": [{"from": str(tmp_path / "v.nii"), "as": "heat"}], "sampling": {"count": 20},
                       "solver": {"max_sweeps": 1}, "output": {"preview": False}})
    told = [w for w in report["surface"]["warnings"] if w.startswith('attribute "heat": ')]
    assert len(told) == 1 and '"um"' in told[0], report


# ---- files that other libraries write

@pytest.mark.extended
@pytest.mark.parametrize("version, endian", [(1, "<"), (1, ">"), (2, "<"), (2, ">")])
def test_files_of_nibabel(told, plain, tmp_path, version, endian):
    nibabel = pytest.importorskip("nibabel", reason="python3-nibabel is not installed")
    kind = {1: nibabel.Nifti1Image, 2: nibabel.Nifti2Image}[version]
    header = kind.header_class(endianness=endian)
    header.set_data_dtype("i2")
    header.set_xyzt_units("mm", "sec")
    header.set_intent("label", (), "regions")
    header.set_dim_info(0, 1, 2)
    header["toffset"], header["cal_max"], header["cal_min"], header["descrip"] = 3, 2, 1, b"a ball"
    header["slice_code"], header["slice_end"], header["slice_duration"] = 1, 7, 0.25
    header.extensions.append(nibabel.nifti1.Nifti1Extension("comment", b"of any length"))
    image = kind((64 * ball("f8")).astype("i2") - 80, MATRIX, header)  # a slope that is set leaves them as they are
    image.set_sform(MATRIX, code=4)
    image.set_qform(MATRIX, code=2)
    image.header.set_slope_inter(0.015625, 1.25)
    for name in ("v.nii", "v.nii.gz"):
        nibabel.save(image, tmp_path / name)
        expect_same(told(tmp_path / name), plain)
    image.set_qform(MATRIX + 0.5 * numpy.eye(4, k=3), code=2)
    nibabel.save(image, tmp_path / "v.nii")
    assert told(tmp_path / "v.nii")["digest"] == plain
    expect_warning(told(tmp_path / "v.nii"), "sform (code 4) and qform (code 2)")
    nibabel.save(kind(ball(), MATRIX), tmp_path / "v.nii")  # without a slope, which it writes as NaN
    expect_same(told(tmp_path / "v.nii"), plain)


@pytest.mark.extended
def test_files_of_teem(told, plain, tmp_path):
    unu = shutil.which("teem-unu") or shutil.which("unu")
    if not unu:
        pytest.skip("teem-apps is not installed")
    write_nrrd(tmp_path / "v.nrrd", ball(), MATRIX)
    for name, words in (("gzip.nrrd", ["-f", "nrrd", "-e", "gzip"]), ("text.nrrd", ["-f", "nrrd", "-e", "ascii"]),
                        ("v.nhdr", ["-f", "nrrd", "-e", "raw", "-en", "big"])):
        subprocess.run([unu, "axinfo", "-a", "0", "1", "2", "-l", "l", "-k", "space", "-c", "cell", "-i", "v.nrrd", "-o", "w.nrrd"],
                       cwd=tmp_path, check=True, timeout=60)
        subprocess.run([unu, "save", *words, "-i", "w.nrrd", "-o", name], cwd=tmp_path, check=True, timeout=60)
        expect_same(told(tmp_path / name), plain)
