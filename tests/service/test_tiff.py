# SPDX-License-Identifier: Apache-2.0
"""TIFF files of several pages and stacks of TIFF files, as volumes and as labels. Files are written by volumes.py; what is the same volume
as an NRRD file gives the same bytes of points."""
import json
import struct

import numpy
import pytest

from readers import read_columns
from volumes import write_exr, write_nrrd, write_tiff, Part

SIZE = (15, 13, 14)
VOXEL = (0.5, 0.25, 0.75)
IMAGEJ = "ImageJ=1.53t\nimages=14\nslices=14\nunit=micron\nspacing=0.75\nloop=false\n"


def ball(kind="f4", steps=8):
    index = numpy.stack(numpy.meshgrid(*map(numpy.arange, SIZE), indexing="ij"), -1) - (numpy.array(SIZE) - 1) / 2 - 0.125
    return numpy.round(steps * (6 - numpy.linalg.norm(index * (0.9, 1.1, 1), axis=-1)).clip(0)).astype(kind)


def pages_of(values):
    return [values[:, :, k] for k in range(values.shape[2])]


@pytest.fixture
def told(solve):
    """Runs a surface; its report, or the error, with the member `digest` of the points."""
    def run(path, isovalue=8.5, kind="volume", **members):
        surface = {"path": str(path), **({} if kind == "labels" else {"isovalue": isovalue}), **members}
        report, data = solve({"version": 1, "surface": {kind: surface}, "sampling": {"count": 30},
                              "solver": {"threads": 1, "max_sweeps": 1},
                              "output": {"preview": False, "ply": {"precision": "double"}}})
        return {**report, "digest": report["outputs"][0]["sha256"]} if data else report
    return run


@pytest.fixture
def plain(told, tmp_path):
    """The digest of the volume as an NRRD file."""
    def run(matrix=numpy.diag([*VOXEL, 1])):
        write_nrrd(tmp_path / "plain.nrrd", ball("u2"), matrix)
        return told(tmp_path / "plain.nrrd")["digest"]
    return run


def warnings(report):
    assert "surface" in report, report
    return [w for w in report["surface"]["warnings"] if "are unresolved" not in w and "walls thinner" not in w]


def expect_same(report, digest, *words):
    assert report.get("digest") == digest, report.get("message") or report["surface"]
    assert len(warnings(report)) == len(words) and all(w in " ".join(warnings(report)) for w in words), warnings(report)


# ---- ways of storing the same

WAYS = {"BigTIFF, big-endian": {"big": True, "endian": ">"}, "packed strips": {"rows": 4, "packed": True},
        "packed tiles": {"tile": (16, 32), "packed": True, "endian": ">"}}


@pytest.mark.sanitized
def test_every_way_of_storing_gives_the_same_points(told, plain, tmp_path):
    digest = plain()
    for name, way in WAYS.items():
        write_tiff(tmp_path / "v.tif", pages_of(ball("u2")), **way)
        report = told(tmp_path / "v.tif", voxel_size=VOXEL)
        expect_same(report, digest)
        assert report["surface"]["volume"] == {"size": list(SIZE), "format": "TIFF"}, name
        assert len(report["inputs"]) == 1


@pytest.mark.sanitized
@pytest.mark.parametrize("kind", [pytest.param(kind, marks=pytest.mark.extended if kind not in ("i1", "u4", "f2") else ())
                                  for kind in ("u1", "i1", "i2", "u4", "i4", "i8", "f2", "f4", "f8")])
def test_every_type(told, plain, tmp_path, kind):
    write_tiff(tmp_path / "v.tif", pages_of(ball(kind)), endian=">", rows=3)
    report = told(tmp_path / "v.tif", voxel_size=VOXEL)
    expect_same(report, plain())


@pytest.mark.parametrize("bits", [1, pytest.param(2, marks=pytest.mark.extended), 4])
def test_masks_of_few_bits(told, tmp_path, bits):
    most = (1 << bits) - 1
    values = ball("u1").clip(0, most)
    write_nrrd(tmp_path / "v.nrrd", values, numpy.eye(4))
    write_tiff(tmp_path / "v.tif", pages_of(values), bits=bits, rows=4)
    expect_same(told(tmp_path / "v.tif", isovalue=0.5, voxel_size=(1, 1, 1)), told(tmp_path / "v.nrrd", isovalue=0.5)["digest"])


def test_a_stack_of_files(told, plain, tmp_path):
    for k, page in enumerate(pages_of(ball("u2"))):
        write_tiff(tmp_path / f"s.{2 * k + 1:03}.tif", [page], resolution=(2, 4), unit=3)
    report = told(tmp_path / "s.###.tif", slices="1-27x2", voxel_size=VOXEL)
    expect_same(report, plain())
    assert len(report["inputs"]) == SIZE[2]
    flat = told(tmp_path / "s.###.tif", slices="1-27x2")
    expect_same(flat, plain(numpy.diag([0.5, 0.25, 0.5, 1])), "distance of its slices: 0.5", 'unit of length is "cm"')


def test_a_stack_of_exr_images_as_a_volume(told, plain, tmp_path):
    for k, page in enumerate(pages_of(ball("f4"))):
        write_exr(tmp_path / f"s.{k}.exr", Part({"Y": page}))
    expect_same(told(tmp_path / "s.#.exr", slices="0-13", voxel_size=VOXEL), plain())
    assert "slices" in json.dumps(told(tmp_path / "s.#.exr", slices="0-13", index=0))


# ---- what the description says

@pytest.mark.sanitized
def test_sizes_of_imagej(told, plain, tmp_path):
    write_tiff(tmp_path / "v.tif", pages_of(ball("u2")), description=IMAGEJ, resolution=(2, 4))
    expect_same(told(tmp_path / "v.tif"), plain(), 'unit of length is "um"')
    for unit in ("\\u00B5m", b"\xb5m"):
        text = IMAGEJ.encode().replace(b"micron", unit if isinstance(unit, bytes) else unit.encode())
        write_tiff(tmp_path / "v.tif", pages_of(ball("u2")), description=text, resolution=(2, 4))
        assert 'unit of length is "um"' in warnings(told(tmp_path / "v.tif"))[0]


def test_units_of_each_axis_of_imagej(told, plain, tmp_path):
    pages = pages_of(ball("u2"))
    write_tiff(tmp_path / "v.tif", pages, description=IMAGEJ.replace("spacing=0.75", "spacing=750\nzunit=nm"), resolution=(2, 4))
    expect_same(told(tmp_path / "v.tif"), plain(), 'unit of length is "um"')
    write_tiff(tmp_path / "v.tif", pages, description=IMAGEJ + "yunit=mm\nzunit=um\n", resolution=(2, 4000))
    expect_same(told(tmp_path / "v.tif"), plain(), 'unit of length is "um"')


LINES_OF_IMAGEJ = {"comma": ("spacing=0.75", "spacing=0,75", "spacing=0,75, which is not a number"),
                   "word": ("slices=14", "slices=14 (z)", "slices=14 (z), which is not a number"),
                   "fraction": ("slices=14", "slices=14.5", "slices=14.5, which is not a number of pages"),
                   "not finite": ("spacing=0.75", "spacing=NaN", "spacing=NaN"),
                   "twice": ("spacing=0.75", "spacing=0.75\nspacing=0.5", 'spacing twice, as "0.75" and as "0.5"'),
                   "units": ("unit=micron", "unit=micron\nzunit=frames", 'zunit "frames" beside unit "micron"')}


@pytest.mark.parametrize("line", LINES_OF_IMAGEJ)
def test_lines_of_imagej_that_are_refused(told, tmp_path, line):
    old, new, words = LINES_OF_IMAGEJ[line]
    write_tiff(tmp_path / "v.tif", pages_of(ball("u2")), description=IMAGEJ.replace(old, new), resolution=(2, 4))
    report = told(tmp_path / "v.tif")
    assert report["code"] == "input_unsupported" and words in report["message"], report


def test_slices_that_are_saved_as_channels_or_times(told, plain, tmp_path):
    for axis, others in (("channels", "frames"), ("frames", "channels")):
        text = IMAGEJ.replace("slices=14", f"{axis}=14\nslices=1\n{others}=1").replace("micron", "mm")
        write_tiff(tmp_path / "v.tif", pages_of(ball("u2")), description=text, resolution=(2, 4))
        expect_same(told(tmp_path / "v.tif"), plain(), f"14 {axis} of one slice each")
    text = ome('DimensionOrder="XYCZT" SizeZ="1" SizeC="14" SizeT="1" PhysicalSizeX="0.5" PhysicalSizeY="0.25" PhysicalSizeZ="0.75" '
               'PhysicalSizeXUnit="mm" PhysicalSizeYUnit="mm" PhysicalSizeZUnit="mm"')
    write_tiff(tmp_path / "v.ome.tif", pages_of(ball("u2")), description=text)
    expect_same(told(tmp_path / "v.ome.tif"), plain(), "14 channels of one slice each")


def test_an_origin_and_one_directory_of_imagej(told, plain, tmp_path):
    text = IMAGEJ.replace("micron", "mm") + "xorigin=4\nyorigin=2\nzorigin=8\n"
    matrix = numpy.diag([*VOXEL, 1.0])
    matrix[:3, 3] = [-2, -0.5, -6]
    for endian in "<>":
        write_tiff(tmp_path / "v.tif", pages_of(ball("u2")), description=text, resolution=(2, 4), contiguous=True, endian=endian)
        expect_same(told(tmp_path / "v.tif"), plain(matrix))
    (tmp_path / "v.tif").write_bytes((tmp_path / "v.tif").read_bytes()[:2000])
    report = told(tmp_path / "v.tif")
    assert report["code"] == "input_damaged", report


def test_channels_and_times_are_volumes(told, plain, tmp_path):
    other, digest = numpy.zeros(SIZE[:2], "u2"), plain()
    pages = [p for t in range(2) for page in pages_of(ball("u2")) for p in [page if (c, t) == (2, 1) else other for c in range(3)]]
    text = "ImageJ=1.53t\nimages=84\nchannels=3\nslices=14\nframes=2\nhyperstack=true\nunit=mm\nspacing=0.75\n"
    write_tiff(tmp_path / "v.tif", pages, description=text, resolution=(2, 4))
    report = told(tmp_path / "v.tif")
    assert report["code"] == "grid_ambiguous" and "6 volumes of 15 x 13 x 14" in report["message"], report
    expect_same(told(tmp_path / "v.tif", index=5), digest)
    assert told(tmp_path / "v.tif", index=6)["code"] == "grid_missing"


def ome(pixels, more=""):
    return ('<?xml version="1.0" encoding="UTF-8"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06">'
            f'<Image ID="Image:0"><Pixels ID="Pixels:0" {pixels}>{more}</Pixels></Image></OME>')


@pytest.mark.sanitized
def test_sizes_and_order_of_ome_xml(told, plain, tmp_path):
    text = ome('DimensionOrder="XYZCT" SizeX="15" SizeY="13" SizeZ="14" SizeC="1" SizeT="1" Type="uint16" PhysicalSizeX="500" '
               'PhysicalSizeY="250" PhysicalSizeZ="0.75" PhysicalSizeXUnit="µm" PhysicalSizeZUnit="mm"',
               '<TiffData IFD="3" FirstZ="3"/>')
    write_tiff(tmp_path / "v.ome.tif", pages_of(ball("u2")), description=text)
    expect_same(told(tmp_path / "v.ome.tif"), plain(numpy.diag([500, 250, 750, 1])), 'unit of length is "um"')
    pages = [p for page in pages_of(ball("u2")) for p in (numpy.zeros_like(page), page)]
    text = ome('DimensionOrder="XYCZT" SizeZ="14" SizeC="2" SizeT="1" PhysicalSizeX="0.5" PhysicalSizeY="0.25" PhysicalSizeZ="0.75" '
               'PhysicalSizeXUnit="mm" PhysicalSizeYUnit="mm" PhysicalSizeZUnit="mm"')
    write_tiff(tmp_path / "v.ome.tif", pages, description=text)
    expect_same(told(tmp_path / "v.ome.tif", index=1), plain())


@pytest.mark.parametrize("old, new, words", [
    ('SizeX="15"', 'SizeX="16"', ("SizeX 16 and SizeY 13", "15 x 13 pixels")), ('SizeY="13"', 'SizeY="1300"', ("SizeY 1300",)),
    ('Type="uint16"', 'Type="float"', ('the Type "float"', "uint16")), ('Type="uint16"', 'Type="frobnicate"', ('the Type "frobnicate"',)),
    ('PlaneCount="14"', 'PlaneCount="28"', ("28 planes", "give 14")), ('ID="Pixels:0"', 'ID="Pixels:7"', None)])
def test_what_ome_xml_states_and_the_image_contradicts_is_warned_of(told, plain, tmp_path, old, new, words):
    text = ome('DimensionOrder="XYZCT" SizeX="15" SizeY="13" SizeZ="14" SizeC="1" SizeT="1" Type="uint16" PhysicalSizeX="0.5" '
               'PhysicalSizeY="0.25" PhysicalSizeZ="0.75" PhysicalSizeXUnit="mm" PhysicalSizeYUnit="mm" PhysicalSizeZUnit="mm"',
               '<TiffData IFD="0" PlaneCount="14"/>')
    write_tiff(tmp_path / "v.ome.tif", pages_of(ball("u2")), description=text.replace(old, new))
    report = told(tmp_path / "v.ome.tif")
    assert report["digest"] == plain()
    assert len(warnings(report)) == bool(words) and all(word in " ".join(warnings(report)) for word in words or ()), warnings(report)


def test_a_number_of_images_of_imagej_that_the_file_does_not_have(told, plain, tmp_path):
    text = IMAGEJ.replace("images=14", "images=15").replace("micron", "mm")
    write_tiff(tmp_path / "v.tif", pages_of(ball("u2")), description=text, resolution=(2, 4))
    expect_same(told(tmp_path / "v.tif"), plain(), "15 images, and the file has 14")


FAULTS_OF_OME = {
    "other pages": (ome('DimensionOrder="XYZCT" SizeZ="7" SizeC="1" SizeT="1"'), "7 slices, 1 channels and 1 times, and the file has 14"),
    "order": (ome('DimensionOrder="XYZZT" SizeZ="14" SizeC="1" SizeT="1"'), "invalid DimensionOrder"),
    "size": (ome('DimensionOrder="XYZCT" SizeZ="-14" SizeC="1" SizeT="1"'), 'SizeZ "-14"'),
    "planes": (ome('DimensionOrder="XYZCT" SizeZ="14" SizeC="1" SizeT="1"', '<TiffData IFD="0" FirstZ="13"/>'), "another order"),
    "plane": (ome('DimensionOrder="XYZCT" SizeZ="14" SizeC="1" SizeT="1"', '<TiffData IFD="0 " FirstZ="0,5"/>'), "another order"),
    "xml": ("<?xml version='1.0'?><OME><Image>", "not valid XML (line 1"),
    "entities": ('<?xml version="1.0"?><!DOCTYPE OME [<!ENTITY a "b">]><OME>&a;</OME>', "document type")}


@pytest.mark.parametrize("fault", FAULTS_OF_OME)
def test_ome_xml_that_is_refused(told, tmp_path, fault):
    text, words = FAULTS_OF_OME[fault]
    write_tiff(tmp_path / "v.ome.tif", pages_of(ball("u1")), description=text)
    report = told(tmp_path / "v.ome.tif")
    assert report["code"] == "input_unsupported" and words in report["message"], report


def test_a_size_of_ome_xml_that_is_no_number(told, plain, tmp_path):
    text = ome('DimensionOrder="XYZCT" SizeZ="14" SizeC="1" SizeT="1" PhysicalSizeX="0.5" PhysicalSizeY="0.25" PhysicalSizeZ="0,75" '
               'PhysicalSizeXUnit="mm" PhysicalSizeYUnit="mm" PhysicalSizeZUnit="mm"')
    write_tiff(tmp_path / "v.ome.tif", pages_of(ball("u2")), description=text)
    expect_same(told(tmp_path / "v.ome.tif"), plain(numpy.diag([0.5, 0.25, 0.5, 1])), 'PhysicalSizeZ of its OME-XML is "0,75"',
                "distance of its slices")


def test_a_file_without_sizes(told, plain, tmp_path):
    write_tiff(tmp_path / "v.tif", pages_of(ball("u2")))
    expect_same(told(tmp_path / "v.tif"), plain(numpy.eye(4)), "does not state the size of its voxels: 1 x 1 x 1")


def test_tags_that_are_not_used(told, plain, tmp_path):
    reduced = [numpy.zeros((7, 6), "u2")]
    write_tiff(tmp_path / "v.tif", pages_of(ball("u2")), tags={262: 0, 274: 3})
    expect_same(told(tmp_path / "v.tif", voxel_size=VOXEL), plain(), "WhiteIsZero", "Orientation is 3")
    write_tiff(tmp_path / "r.tif", reduced, tags={254: 1})
    write_tiff(tmp_path / "v.tif", pages_of(ball("u2")))
    first, small = (tmp_path / "v.tif").read_bytes(), (tmp_path / "r.tif").read_bytes()
    assert len(first) % 2 == 0
    # the small page's directory behind the last one, its places moved by what precedes it
    moved = bytearray(small)
    directory = struct.unpack_from("<I", small, 4)[0]
    for k in range(struct.unpack_from("<H", small, directory)[0]):
        at = directory + 2 + 12 * k
        if struct.unpack_from("<H", small, at)[0] == 273:
            struct.pack_into("<I", moved, at + 8, struct.unpack_from("<I", small, at + 8)[0] + len(first))
    whole = bytearray(first + moved)
    at = 4
    while (place := struct.unpack_from("<I", whole, at)[0]):
        at = place + 2 + 12 * struct.unpack_from("<H", whole, place)[0]
    struct.pack_into("<I", whole, at, len(first) + directory)
    (tmp_path / "v.tif").write_bytes(whole)
    expect_same(told(tmp_path / "v.tif", voxel_size=VOXEL), plain(), "1 pages of reduced resolution")


PAGES_THAT_DIFFER = {"FillOrder": (266, 2, "page 5 has the FillOrder 2, and page 0 has 1"),
                     "Orientation": (274, 3, "page 5 has the Orientation 3, and page 0 has 1"),
                     "WhiteIsZero": (262, 0, "PhotometricInterpretation of page 5 is WhiteIsZero"),
                     "SampleFormat": (339, 2, "page 5 has 15 x 13 pixels of 16 bits (signed integers)")}


@pytest.mark.parametrize("tag", PAGES_THAT_DIFFER)
def test_a_page_whose_numbers_mean_something_else_is_refused(told, tmp_path, tag):
    number, value, words = PAGES_THAT_DIFFER[tag]
    pages = pages_of(ball("u2"))
    write_tiff(tmp_path / "v.tif", pages, page_tags={5: {number: value}})
    report = told(tmp_path / "v.tif")
    assert report["code"] == "input_unsupported" and words in report["message"], report
    for k, page in enumerate(pages):
        write_tiff(tmp_path / f"s.{k:03}.tif", [page], tags={number: value} if k == 5 else None)
    report = told(tmp_path / "s.###.tif", slices="0-13", voxel_size=VOXEL)
    assert report["code"] == "input_unsupported" and "s.005.tif" in report["message"], report


def test_a_page_of_another_resolution(told, plain, tmp_path):
    pages = pages_of(ball("u2"))
    write_tiff(tmp_path / "v.tif", pages, resolution=(2, 4), page_tags={7: {296: 3}})
    expect_same(told(tmp_path / "v.tif", voxel_size=VOXEL), plain(), "page 7 has another resolution or position")
    for k, page in enumerate(pages):
        write_tiff(tmp_path / f"s.{k:03}.tif", [page], resolution=(4, 4) if k > 6 else (2, 4))
    expect_same(told(tmp_path / "s.###.tif", slices="0-13", voxel_size=VOXEL), plain(), "s.007.tif has another size of pixels")


def test_a_tag_that_is_there_twice_is_refused(told, tmp_path):
    for tag, value in ((256, 15), (257, 12), (339, 2), (274, 3), (296, 3)):
        write_tiff(tmp_path / "v.tif", pages_of(ball("u2")), resolution=(2, 4), tags={274: 1}, twice=[(tag, value)])
        report = told(tmp_path / "v.tif")
        assert report["code"] == "input_damaged" and f"page 0 has the tag {tag} twice" in report["message"], report


# ---- labels, attributes, inspection

@pytest.mark.sanitized
def test_labels(told, worker, tmp_path):
    values = numpy.ones((6, 5, 4), "u1")
    values[3:], values[:, 2:] = 2, 0
    write_nrrd(tmp_path / "v.nrrd", values, numpy.diag([*VOXEL, 1]))
    same = told(tmp_path / "v.nrrd", kind="labels")["digest"]
    write_tiff(tmp_path / "v.tif", pages_of(values), description=IMAGEJ.replace("14", "4"), resolution=(2, 4))
    assert told(tmp_path / "v.tif", kind="labels")["digest"] == same
    for k, page in enumerate(pages_of(values)):
        write_tiff(tmp_path / f"s.{k:03}.tif", [page])
    assert told(tmp_path / "s.###.tif", kind="labels", slices="0-3", voxel_size=VOXEL)["digest"] == same
    seen = json.loads(worker("s.002.tif", "--json", command="inspect", output=None).stdout)
    assert seen["format"] == "TIFF" and seen["images"] == 4 and seen["volume"]["type"] == "uint8"
    assert [k["label"] for k in seen["volume"]["labels"]] == [0, 1, 2]
    assert seen["suggestions"][0]["spec"]["surface"]["labels"] == {"path": "s.###.tif", "slices": "0-3"}
    seen = json.loads(worker("v.tif", "--json", command="inspect", output=None).stdout)
    assert seen["volume"]["voxel_size"] == list(VOXEL) and seen["volume"]["size"] == [6, 5, 4]


def test_an_attribute(solve, tmp_path):
    write_tiff(tmp_path / "v.tif", pages_of(ball("u2")))
    write_tiff(tmp_path / "x.tif", pages_of(numpy.indices(SIZE)[0].astype("f4")))
    spec = {"version": 1, "surface": {"volume": {"path": "v.tif", "isovalue": 8.5, "voxel_size": [2, 2, 2]}}, "sampling": {"count": 50},
            "attributes": [{"name": "0", "as": "own"}, {"from": "x.tif", "as": "column", "name": "0"}],
            "output": {"preview": False}}
    report, data = solve(spec)
    columns = read_columns(data)
    assert numpy.abs(columns["own"] - 8.5).max() < 4
    inside = columns["x"] < SIZE[0] - 1
    assert numpy.allclose(columns["column"][inside], columns["x"][inside], atol=1e-3)


# ---- what is refused

def test_files_that_are_refused(told, tmp_path):
    values = pages_of(ball("u2"))
    faults = {
        "colour": ({"tags": {277: 3}}, "input_unsupported", "3 numbers at each pixel (a colour image)"),
        "bits": ({"tags": {258: 24}}, "input_unsupported", "integers of 24 bits"),
        "complex": ({"tags": {339: 6}}, "input_unsupported", "other numbers of 16 bits"),
        "compression": ({"tags": {259: 34712}}, "input_unsupported", "compression 34712"),
        "depth": ({"tags": {32997: 4}}, "input_unsupported", "ImageDepth 4"),
        "packing": ({"tags": {259: 8}}, "input_damaged", "page 0"),
        "height": ({"tags": {257: 60000, 278: 60000}}, "input_damaged", "fewer than 14 pages"),
    }
    for name, (how, code, words) in faults.items():
        write_tiff(tmp_path / "v.tif", values, **how)
        report = told(tmp_path / "v.tif")
        assert report["code"] == code and words in report["message"], (name, report)
    write_tiff(tmp_path / "v.tif", [*values[:3], values[0][:, :5]])
    report = told(tmp_path / "v.tif")
    assert report["code"] == "input_unsupported" and "page 3 has 15 x 5 pixels" in report["message"], report
    write_tiff(tmp_path / "v.tif", values[:1])
    report = told(tmp_path / "v.tif")
    assert report["code"] == "no_surface" and "15 x 13 x 1 samples" in report["message"], report


def test_a_page_beyond_the_memory_limit(told, tmp_path):
    write_tiff(tmp_path / "v.tif", pages_of(ball("u1")), packed=True, rows=13, tags={})
    raw = bytearray((tmp_path / "v.tif").read_bytes())
    for tag in (256, 257, 278):
        at = 0
        while (at := raw.find(struct.pack("<2HI", tag, 4, 1), at)) >= 0:
            struct.pack_into("<I", raw, at + 8, 400000)
            at += 1
    (tmp_path / "v.tif").write_bytes(raw)
    report = told(tmp_path / "v.tif")
    assert report["code"] == "limit_memory" and "400000 x 400000 pixels" in report["message"], report


@pytest.mark.sanitized
def test_files_that_end_early(told, tmp_path):
    write_tiff(tmp_path / "v.tif", pages_of(ball("u2")), rows=4, packed=True)
    whole = (tmp_path / "v.tif").read_bytes()
    for share in (0.001, 0.3, 0.7, 0.95):
        (tmp_path / "v.tif").write_bytes(whole[:8 + int(share * len(whole))])
        report = told(tmp_path / "v.tif")
        assert report["code"] == "input_damaged" and report["message"].startswith(str(tmp_path / "v.tif")), (share, report)


def test_slices_that_are_missing_or_damaged(told, tmp_path):
    for k, page in enumerate(pages_of(ball("u2"))):
        write_tiff(tmp_path / f"s.{k:02}.tif", [page])
    (tmp_path / "s.00.tif").unlink()
    (tmp_path / "s.05.tif").unlink()
    report = told(tmp_path / "s.##.tif", slices="0-13")
    assert report["code"] == "input_missing" and "2 slices are missing (slices 0, 5)" in report["message"], report
    write_tiff(tmp_path / "s.00.tif", [ball("u2")[:, :, 0]])
    write_tiff(tmp_path / "s.05.tif", [ball("u1")[:, :, 0]])
    report = told(tmp_path / "s.##.tif", slices="0-13")
    assert report["code"] == "input_unsupported" and "slice 5" in report["message"] and "uint8" in report["message"], report
    write_tiff(tmp_path / "s.05.tif", pages_of(ball("u2")))
    report = told(tmp_path / "s.##.tif", slices="0-13")
    assert report["code"] == "input_unsupported" and "the file has 14 pages" in report["message"], report
    (tmp_path / "s.05.tif").write_bytes(b"II*\0" + bytes(100))
    report = told(tmp_path / "s.##.tif", slices="0-13")
    assert report["code"] == "input_damaged" and "slice 5 is damaged: " in report["message"], report


# ---- files of another writer

@pytest.mark.extended
@pytest.mark.parametrize("how", [{}, {"bigtiff": True, "byteorder": ">"},
                                 {"imagej": True, "metadata": {"spacing": 0.75, "unit": "mm", "axes": "ZYX"}},
                                 {"ome": True, "metadata": {"axes": "ZYX", "PhysicalSizeX": 0.5, "PhysicalSizeXUnit": "mm",
                                                            "PhysicalSizeY": 0.25, "PhysicalSizeYUnit": "mm",
                                                            "PhysicalSizeZ": 0.75, "PhysicalSizeZUnit": "mm"}}], ids=str)
def test_files_of_tifffile(told, plain, tmp_path, how):
    tifffile = pytest.importorskip("tifffile", reason="python3-tifffile is not installed")
    values = ball("u2").transpose(2, 1, 0)
    tifffile.imwrite(tmp_path / "v.tif", values, resolution=(2, 4), photometric="minisblack", **how)
    sized = how.get("imagej") or how.get("ome")
    report = told(tmp_path / "v.tif", **({} if sized else {"voxel_size": VOXEL}))
    expect_same(report, plain())
