# SPDX-License-Identifier: Apache-2.0
"""Files of every format, with one field varied: there twice, with text behind its number, with a decimal comma, with an unknown word, not
finite, other on one page, node or piece only, or declared with a number that its data contradict. What the file means is known: two balls. So is what is right: these two balls, an error,
or a new warning. A painted file has the spacings of points on two balls that are a formula: right are exactly the points of the file without a
variation.

As a program: `field_variations.py BUILD [--cases N] [--seed N] [--formats NAME,...]` runs N variations (0: all there are), spread evenly
over formats and fields, prints each that gives other points without a warning, and a table by format; ends with 1 if there is any.
`make field-variations` runs 5 000. `--list` prints the fields of each format, and how many ways of varying them there are. `--by-format`
and `--by-field` write what became of them as CSV.
"""
import argparse
import base64
import collections
import concurrent.futures
import csv
import io
import json
import os
import pathlib
import random
import re
import struct
import subprocess
import sys
import tempfile
import threading

import numpy

import library_meshes
from damaged_meshes import icosphere
from readers import read_columns
from volumes import NIFTI2_FIELDS, NIFTI_FIELDS, Part, change_nifti, write_exr, write_meta_image, write_nifti, write_nrrd, write_tiff
from vtk_files import write_xml
from zarr_files import multiscales, write_array_2, write_array_3, write_group_2, write_group_3

BALLS = ((numpy.array((10.0, 12.0, 14.0)), 6.0), (numpy.array((20.0, 14.0, 9.0)), 3.0))
AREA = sum(4 * numpy.pi * r ** 2 for _, r in BALLS)
# of the triangles and of the voxels, with room; wrong units, axes and steps are far beyond
AWAY, OF_AREA = 0.2, 0.04
# of the surface of a file whose variation changes nothing: the smallest triangle has 1.3e-4 of the area; volumes are scanned by their cells
SAME_AREA = {True: 1e-4, False: 2e-3}
OF_JUMP, OF_KEYHOLE = 0.01, 0.005
SIZE, STEP, ORIGIN = (26, 18, 28), numpy.array((1.0, 1.25, 0.8)), numpy.array((1.0, -0.5, 2.0))
TIMEOUT_S = 300
VERDICTS = ("right", "warned", "refused", "wrong", "crashed")
FAULTS = ("wrong", "crashed")
QUESTIONS = ("one_only", "twice", "contradicts", "to_its_end", "not_understood")


# ---- the balls, as samples and as triangles

# Of the files that this thread writes: change, of the samples (with_samples); parts, in the place of the balls (with_parts).
LOCAL = threading.local()


def samples(origin=ORIGIN, linear=None):
    """`linear`: from indices to the world, in the place of STEP."""
    index = numpy.stack(numpy.meshgrid(*map(numpy.arange, SIZE), indexing="ij"), -1)
    at = index @ (numpy.diag(STEP) if linear is None else linear).T + origin
    values = numpy.max([r - numpy.linalg.norm(at - c, axis=-1) for c, r in BALLS], axis=0)
    change = getattr(LOCAL, "change", None)
    return change(values) if change else values


def matrix(origin=ORIGIN):
    m = numpy.diag([*STEP, 1.0])
    m[:3, 3] = origin
    return m


def triangles():
    """A list for each ball: vertices, and faces that count from 0."""
    if getattr(LOCAL, "parts", None):
        return LOCAL.parts
    v, f = icosphere(3)
    return [(v * r + c, numpy.array(f)) for c, r in BALLS]


def joined():
    (a, f), (b, g) = triangles()
    return numpy.concatenate([a, b]), numpy.concatenate([f, g + len(a)])


# ---- fields of text: (name, begin and end of the value, begin and end of what is there twice)

Field = collections.namedtuple("Field", "name begin end first last")


def lines(text, separator, most=None, of=r"[^\s:=]+"):
    """`KEY separator VALUE` in the lines of the header."""
    found = [Field(m[1], m.start(2), m.end(2), m.start(), m.end() + 1)
             for m in re.finditer(rf"^({of}){separator}(.+)$", text[:most], re.MULTILINE)]
    return found


def attributes(text):
    """Attributes of XML, without names of namespaces. Twice: a second attribute of the name is not XML, so the element is."""
    return [Field(m[1], m.start(2), m.end(2), m.start(), m.end()) for m in re.finditer(r' ([\w:]+)="([^"<]*)"', text)
            if not m[1].startswith("xmlns")]


def members(text):
    """Scalars and flat arrays of JSON."""
    return [Field(m[1], m.start(2), m.end(2), m.start(), m.end())
            for m in re.finditer(r'"(\w+)": ("[^"]{0,60}"|[-\d.e]+|true|false|null|\[[^\[\]{}]{0,200}\])', text)]


NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")


def other_number(value):
    """The value with its last number replaced by another one."""
    found = list(NUMBER.finditer(value))
    if not found:
        return None
    m = found[-1]
    number = float(m[0])
    put = repr(number * 2 + 1) if m[1] or m[2] else str(int(number) + 1)
    return value[:m.start()] + put + value[m.end():]


def other_word(value):
    return re.sub(r"[A-Za-z][\w-]*", "frobnicate", value, count=1) if re.search("[A-Za-z]", value) else None


def replaced(value, put, last=True):
    found = list(NUMBER.finditer(value))
    if not found:
        return None
    m = found[-1 if last else 0]
    return value[:m.start()] + put + value[m.end():]


def comma(value):
    """The decimal point of the last number whose fraction is not 0."""
    found = list(re.finditer(r"\.(?=\d*[1-9])", value)) or list(re.finditer(r"(?<=\d)\.(?=\d)", value))
    return value[:found[-1].start()] + "," + value[found[-1].end():] if found else None


# text of the value -> text of the changed one, or None: does not apply
CHANGES = {
    "comma": comma,
    "text behind": lambda v: v + "x" if NUMBER.search(v[-1:]) else None,
    "word behind": lambda v: v + " units" if NUMBER.search(v[-1:]) else None,
    "number behind": lambda v: v + " 7" if NUMBER.search(v[-1:]) else None,
    "a number less": lambda v: v[:v.rindex(" ")] if " " in v.strip() and NUMBER.search(v) else None,
    "unknown word": other_word,
    "nan": lambda v: replaced(v, "nan"),
    "infinity": lambda v: replaced(v, "inf", False),
    "empty": lambda v: "",
    "exponent": lambda v: replaced(v, "1e400"),
}


def twice(text, field, change=None, before=False):
    """The field is there twice; `change`: of the second, or of the first."""
    whole = text[field.first:field.last]
    value = text[field.begin:field.end]
    if change:
        put = change(value)
        if put is None or put == value:
            return None
        other = text[field.first:field.begin] + put + text[field.end:field.last]
    else:
        other = whole
    between = ", " if whole.startswith('"') else ""
    pair = other + between + whole if before else whole + between + other
    return text[:field.first] + pair + text[field.last:]


TWICE = {"twice": lambda t, f: twice(t, f),
         "twice, the second is another number": lambda t, f: twice(t, f, other_number),
         "twice, the first is another number": lambda t, f: twice(t, f, other_number, True),
         "twice, the second is another word": lambda t, f: twice(t, f, other_word),
         "twice, the first is another word": lambda t, f: twice(t, f, other_word, True)}


def text_variations(text, fields):
    """(name of the field, name of the way, the changed text)"""
    for field in fields:
        value = text[field.begin:field.end]
        for name, change in CHANGES.items():
            put = change(value)
            if put is not None and put != value:
                yield field.name, name, text[:field.begin] + put + text[field.end:]
        for name, make in TWICE.items():
            put = make(text, field)
            if put is not None:
                yield field.name, name, put
        if field.name in DECLARED:
            for name, put in declared(value):
                yield field.name, name, text[:field.begin] + put + text[field.end:]


# Names of fields whose numbers the data contradict if they are changed alone: sizes, counts and types.
DECLARED = {"sizes", "dimension", "DimSize", "NDims", "shape", "SizeX", "SizeY", "SizeZ", "SizeC", "SizeT", "PlaneCount", "images", "slices",
            "element vertex", "element face", "POINTS", "POLYGONS", "NumberOfPoints", "NumberOfPolys", "NumberOfComponents", "NumberOfDataArrays", "Dim0", "Dim1",
            "Dimensionality", "POINT_DATA", "SCALARS", "count", "byteLength", "componentType", "min", "max", "stride", "counts"}


def declared(value):
    """Each number of the value replaced by one more, one less, twice, ten times and 0: (way, text)."""
    for n, m in enumerate(NUMBER.finditer(value)):
        number = float(m[0])
        for way, put in (("one more", number + 1), ("one less", number - 1), ("twice as much", 2 * number + (number == 0)), ("much more", 10 * number + 10), ("0", 0)):
            text = repr(put) if m[1] or m[2] else str(int(put))
            if put != number:
                yield f"number {n} declared: {way}", value[:m.start()] + text + value[m.end():]


def some(fields, rng, count):
    """Fields of rows of data: a few of many."""
    return rng.sample(fields, min(count, len(fields)))


# ---- formats: a generator of (field, way, function that writes into a folder and returns the surface)

def volume(name, isovalue=0, **members_of):
    return {"volume": {"path": name, "isovalue": isovalue, **members_of}}


def of_header(name, header, data, fields, surface, beside=None):
    """Variations of a header of text that data follow."""
    def case(text):
        def write(folder):
            (folder / name).write_bytes(text.encode("latin-1") + data)
            if beside:
                beside(folder)
            return surface
        return write
    yield "", "", case(header)
    for field, way, text in text_variations(header, fields):
        yield field, way, case(text)


def split(write, mark, name):
    """The file that a writer makes, as header (up to and with the mark) and data."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / name
        write(path)
        raw = path.read_bytes()
    at = raw.index(mark) + len(mark)
    return raw[:at].decode("latin-1"), raw[at:]


def nrrd(rng):
    extra = ["kinds: space space space", "space units: \"mm\" \"mm\" \"mm\""]
    header, data = split(lambda p: write_nrrd(p, samples().astype("f4"), matrix(), extra=extra), b"\n\n", "v.nrrd")
    yield from of_header("v.nrrd", header, data, lines(header, ": "), volume("v.nrrd"))


def nrrd_by_spacings(rng):
    low = " ".join(repr(float(v)) for v in ORIGIN)
    high = " ".join(repr(float(v)) for v in ORIGIN + STEP * (numpy.array(SIZE) - 1))
    extra = ["spacings: " + " ".join(repr(float(v)) for v in STEP), f"axis mins: {low}", f"axis maxs: {high}", "centerings: node node node"]
    header, data = split(lambda p: write_nrrd(p, samples().astype("f4"), None, "ascii", extra=extra), b"\n\n", "v.nrrd")
    yield from of_header("v.nrrd", header, data, lines(header, ": "), volume("v.nrrd"))


def nrrd_in_files(rng):
    values = samples().astype("f4")
    slices = [values[:, :, k].tobytes(order="F") for k in range(SIZE[2])]
    extra = ["line skip: 1", "byte skip: 2", f"data file: s %02d.raw 0 {SIZE[2] - 1} 1"]
    header, _ = split(lambda p: write_nrrd(p, values, matrix(), extra=extra), b"\n\n", "v.nrrd")

    def beside(folder):
        for k, data in enumerate(slices):
            (folder / f"s {k:02}.raw").write_bytes(b"line\n12" + data)
    yield from of_header("v.nhdr", header, b"", lines(header, ": ", of=r"[^:=\n]+"), volume("v.nhdr"), beside)


def meta_image(rng):
    fields = {"CenterOfRotation": "0 0 0", "AnatomicalOrientation": "RAI", "HeaderSize": "0", "ElementSize": " ".join(map(repr, STEP.tolist()))}
    header, data = split(lambda p: write_meta_image(p, samples().astype("f4"), matrix(), fields), b"ElementDataFile = LOCAL\n", "v.mha")
    yield from of_header("v.mha", header, data, lines(header, " = "), volume("v.mha"))
    aliases = {"Offset": ("Position", "Origin"), "TransformMatrix": ("Rotation", "Orientation"), "BinaryDataByteOrderMSB": ("ElementByteOrderMSB",)}
    for key, names in aliases.items():
        for name in names:
            line = next(k for k in header.splitlines(True) if k.startswith(key))
            value = line.split(" = ")[1].strip()
            put = {"False": "True"}.get(value) or other_number(value)
            for order in (f"{name} = {put}\n{line}", f"{line}{name} = {put}\n"):
                text = header.replace(line, order)
                yield key, f"contradicted by {name}", lambda folder, text=text: (
                    (folder / "v.mha").write_bytes(text.encode() + data), volume("v.mha"))[1]


def meta_image_in_a_file(rng):
    header, data = split(lambda p: write_meta_image(p, samples().astype("f4"), matrix()), b"ElementDataFile = LOCAL\n", "v.mha")
    header = header.replace("LOCAL", "v 50%.raw").replace("CompressedData", "HeaderSize = 3\nCompressedData")
    yield from of_header("v.mhd", header, b"", lines(header, " = "), volume("v.mhd"),
                         lambda folder: (folder / "v 50%.raw").write_bytes(b"abc" + data))


# not finite, zero, negative and large numbers of a NIfTI field
NIFTI_NUMBERS = {"f": (numpy.nan, numpy.inf, -numpy.inf, 1e38), "d": (numpy.nan, numpy.inf, 1e300), "h": (-1, 32767), "i": (-1, 2 ** 31 - 1),
                 "q": (-1, 2 ** 62), "B": (255,)}
# What NIfTI-1 and NIfTI-2 declare of the data: name, place and type.
NIFTI_DECLARED = {1: [*((f"dim{k}", 40 + 2 * k, "<h") for k in range(5)), ("datatype", 70, "<h"), ("bitpix", 72, "<h")],
                  2: [*((f"dim{k}", 16 + 8 * k, "<q") for k in range(5)), ("datatype", 12, "<h"), ("bitpix", 14, "<h")]}
# Fields that another one replaces, or that nothing is computed from.
NIFTI_UNUSED = ("intent", "slice", "cal_", "toffset", "descrip", "aux", "dim_info")


def put_number(path, at, kind, number):
    raw = bytearray(path.read_bytes())
    struct.pack_into(kind, raw, at, number)
    path.write_bytes(raw)


def nifti_of(version, quaternion):
    def run(rng):
        # from the first sample, right, anterior and superior: as the spec's world, without a rotation
        how = ({"quaternion": (0, 0, 0, *ORIGIN, 1), "voxel": STEP} if quaternion else {"matrix": matrix()})

        def write(folder, fields=None):
            write_nifti(folder / "v.nii", samples().astype("f4"), version=version, **how)
            if fields:
                change_nifti(folder / "v.nii", fields, version=version)
            return volume("v.nii")
        yield "", "", write
        table = NIFTI_FIELDS if version == 1 else NIFTI2_FIELDS
        for name, (_, kind) in table.items():
            for number in NIFTI_NUMBERS.get(kind, ()):
                yield name, f"is {number}", lambda folder, name=name, number=number: write(folder, {name: number})
        for name, at, kind in NIFTI_DECLARED[version]:
            for number in (0, 1, 2, 3, 4, 5, 9, 13, 16, 27, 64, 512, 20000):  # datatype 8 has as many bits
                yield name, f"declared: {number}", lambda folder, at=at, kind=kind, number=number: (
                    write(folder), put_number(folder / "v.nii", at, kind, number), volume("v.nii"))[2]
        for name in table:
            if quaternion and name.startswith("pixdim") and name[-1] in "123":
                yield name, "is 0", lambda folder, name=name: write(folder, {name: 0})
    return run


IMAGEJ = "ImageJ=1.53t\nimages={0}\nslices={0}\nunit=mm\nspacing={1}\nxorigin={2}\nyorigin={3}\nzorigin={4}\nloop=false\n"


def imagej_text():
    return IMAGEJ.format(SIZE[2], *(repr(float(v)) for v in (STEP[2], *(-ORIGIN / STEP))))


def tiff(path, text=None, pages=None, **how):
    write_tiff(path, pages or [samples().astype("f4")[:, :, k] for k in range(SIZE[2])], description=text,
               resolution=tuple(1 / STEP[:2]), **how)
    return volume(path.name)


def imagej(rng):
    text = imagej_text()
    yield "", "", lambda folder: tiff(folder / "v.tif", text)
    for field, way, changed in text_variations(text, lines(text, "=")):
        yield field, way, lambda folder, changed=changed: tiff(folder / "v.tif", changed)
    for axis in ("yunit", "zunit"):
        for unit in ("frames", "7"):
            yield axis, f"is {unit}", lambda folder, axis=axis, unit=unit: tiff(folder / "v.tif", f"{text}{axis}={unit}\n")


# SHORT tags that may differ on a page, and values that mean something else
PAGE_TAGS = {258: (16,), 262: (0,), 274: (2, 3, 4, 5, 6, 8), 277: (2,), 296: (2, 3), 339: (1, 2), 256: (SIZE[0] - 1,), 257: (SIZE[1] - 1,), 266: (2,), 317: (2, 3)}


def tiff_pages(rng):
    text = imagej_text()
    yield "", "", lambda folder: tiff(folder / "v.tif", text)
    for tag, values in PAGE_TAGS.items():
        for value in values:
            for page in (0, 13, SIZE[2] - 1):
                yield f"tag {tag}", f"{value} on page {page} only", lambda folder, tag=tag, value=value, page=page: tiff(
                    folder / "v.tif", text, page_tags={page: {tag: value}})
            yield f"tag {tag}", f"twice, {value}", lambda folder, tag=tag, value=value: tiff(folder / "v.tif", text, twice=[(tag, value)])


def tiff_stack(rng):
    pages = [samples(numpy.zeros(3)).astype("f4")[:, :, k] for k in range(SIZE[2])]  # images have no origin

    def write(folder, number=None, tags=None, resolution=None):
        for k, page in enumerate(pages):
            write_tiff(folder / f"s.{k:03}.tif", [page], resolution=resolution if k == number and resolution else tuple(1 / STEP[:2]),
                       tags=tags if k == number else None)
        return {"volume": {"path": "s.###.tif", "slices": f"0-{SIZE[2] - 1}", "isovalue": 0, "voxel_size": STEP.tolist()}}
    yield "", "", write
    for tag, values in PAGE_TAGS.items():
        for value in values:
            for number in (0, 13):
                yield f"tag {tag}", f"{value} in file {number} only", lambda folder, tag=tag, value=value, number=number: write(
                    folder, number, {tag: value})
    yield "resolution", "in one file only", lambda folder: write(folder, 13, None, (3, 3))


def ome(rng):
    steps = " ".join(f'PhysicalSize{a}="{float(s)!r}" PhysicalSize{a}Unit="mm"' for a, s in zip("XYZ", STEP))
    text = ('<?xml version="1.0" encoding="UTF-8"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">'
            f'<Pixels ID="Pixels:0" DimensionOrder="XYZCT" SizeX="{SIZE[0]}" SizeY="{SIZE[1]}" SizeZ="{SIZE[2]}" SizeC="1" SizeT="1" '
            f'Type="float" {steps}><TiffData IFD="0" FirstZ="0" PlaneCount="{SIZE[2]}"/></Pixels></Image></OME>')
    shifted = [samples(numpy.zeros(3)).astype("f4")[:, :, k] for k in range(SIZE[2])]  # OME-XML has no origin
    yield "", "", lambda folder: tiff(folder / "v.ome.tif", text, shifted)
    for field, way, changed in text_variations(text, attributes(text)):
        yield field, way, lambda folder, changed=changed: tiff(folder / "v.ome.tif", changed, shifted)


def zarr_of(version):
    def run(rng):
        steps, origin = STEP[::-1].tolist(), ORIGIN[::-1].tolist()
        described = multiscales([steps], [origin], version="0.4" if version == 2 else "0.5")
        values = samples().astype("f4").transpose(2, 1, 0)

        def write(folder, name=None, text=None):
            path = folder / "v.zarr"
            (write_group_2 if version == 2 else write_group_3)(path, described)
            (write_array_2 if version == 2 else write_array_3)(path / "0", values, (10, 9, 13), fill=-1.0)
            if name:
                (path / name).write_text(text)
            return volume("v.zarr")
        yield "", "", write
        with tempfile.TemporaryDirectory() as folder:
            write(pathlib.Path(folder))
            texts = {name: (pathlib.Path(folder) / "v.zarr" / name).read_text()
                     for name in ((".zattrs", ".zgroup", "0/.zarray") if version == 2 else ("zarr.json", "0/zarr.json"))}
        for name, text in texts.items():
            for field, way, changed in text_variations(text, members(text)):
                yield field, way, lambda folder, name=name, changed=changed: write(folder, name, changed)
    return run


MESH = {"mesh": {"path": None}}


def mesh(name):
    return {"mesh": {"path": name}}


def of_text(name, text, fields):
    def case(changed):
        def write(folder):
            (folder / name).write_text(changed)
            return mesh(name)
        return write
    yield "", "", case(text)
    for field, way, changed in text_variations(text, fields):
        yield field, way, case(changed)


def words_in_lines(text, key, rng, count):
    """Rows of data that begin with a key."""
    return some([Field(key, m.start(1), m.end(1), m.start(), m.end() + 1) for m in re.finditer(rf"^{key}(.+)$", text, re.MULTILINE)], rng, count)


def obj(rng):
    out = ["# two balls", "mtllib balls.mtl"]
    first = 1
    for k, (v, f) in enumerate(triangles()):
        out += [f"o ball{k}", "usemtl grey", "s 1"]
        out += ["v %r %r %r" % tuple(p) for p in v.tolist()] + ["f %d %d %d" % tuple(c) for c in (f + first).tolist()]
        first += len(v)
    text = "\n".join(out) + "\n"
    fields = [*words_in_lines(text, "v ", rng, 6), *words_in_lines(text, "f ", rng, 6), *words_in_lines(text, "mtllib ", rng, 1),
              *words_in_lines(text, "usemtl ", rng, 2), *words_in_lines(text, "s ", rng, 1), *words_in_lines(text, "o ", rng, 2)]
    yield from of_text("m.obj", text, fields)
    for way, old, new in (("a name that ends in \\", "mtllib balls.mtl", "mtllib C:\\balls\\"), ("a blank behind \\", "f 1 ", "f \\ \n1 "),
                          ("a line continued", "f 1 ", "f \\\n1 ")):
        yield "line", way, lambda folder, old=old, new=new: ((folder / "m.obj").write_text(text.replace(old, new, 1)), mesh("m.obj"))[1]


def ply(rng):
    v, f = joined()
    text = (f"ply\nformat ascii 1.0\ncomment two balls\nelement vertex {len(v)}\nproperty double x\nproperty double y\nproperty double z\n"
            f"element face {len(f)}\nproperty list uchar int vertex_indices\nend_header\n")
    rows = "".join("%r %r %r\n" % tuple(p) for p in v.tolist())
    text_rows = text + rows + "".join("3 %d %d %d\n" % tuple(c) for c in f)
    head = lines(text, " ", of=r"format|element vertex|element face|property double|property list")
    data = [Field("row", m.start(), m.end(), m.start(), m.end() + 1) for m in re.finditer(r"^[-\d].*$", text_rows, re.MULTILINE)]
    yield from of_text("m.ply", text_rows, [*head, *some(data, rng, 12)])
    binary = text.replace("ascii", "binary_little_endian")
    body = v.astype("<f8").tobytes() + b"".join(struct.pack("<B3i", 3, *c) for c in f)
    for field, way, changed in text_variations(binary, lines(binary, " ", of=r"format|element vertex|element face|property double|property list")):
        yield f"{field} (binary)", way, lambda folder, changed=changed: ((folder / "m.ply").write_bytes(changed.encode() + body), mesh("m.ply"))[1]


def stl_text(rng):
    out = []
    for k, (v, f) in enumerate(triangles()):
        out.append(f"solid ball{k}")
        for c in f:
            out.append(" facet normal 0 0 1\n  outer loop\n" + "".join("   vertex %r %r %r\n" % tuple(v[i].tolist()) for i in c) + "  endloop\n endfacet")
        out.append(f"endsolid ball{k}")
    text = "\n".join(out) + "\n"
    yield from of_text("m.stl", text, [*words_in_lines(text, "   vertex ", rng, 10), *words_in_lines(text, " facet normal ", rng, 3),
                                       *words_in_lines(text, "solid ", rng, 2), *words_in_lines(text, "endsolid ", rng, 2)])


def stl(rng):
    v, f = joined()

    def write(folder, head=b"two balls", count=len(f), more=None, tail=b""):
        rows = b"".join(struct.pack("<12fH", 0, 0, 0, *v[c].ravel(), len(more) if more else 0) + (more or b"") for c in f)
        (folder / "m.stl").write_bytes(head.ljust(80) + struct.pack("<I", count) + rows + tail)
        return mesh("m.stl")
    yield "", "", write
    for way, how in {"count is 0": {"count": 0}, "count is less": {"count": len(f) - 7}, "count is more": {"count": len(f) + 7},
                     "attribute bytes": {"more": b"abcdef"}, "head is solid": {"head": b"solid two balls"}, "a tail": {"tail": b"x" * 50},
                     "a short tail": {"tail": b"x" * 7}, "COLOR": {"head": b"COLOR=\x01\x02\x03\xff"}, "UNITS": {"head": b"two balls UNITS=inch"}}.items():
        yield "file", way, lambda folder, how=how: write(folder, **how)


def off_text():
    v, f = joined()
    return f"OFF\n{len(v)} {len(f)} 0\n" + "".join("%r %r %r\n" % tuple(p) for p in v.tolist()) + "".join("3 %d %d %d\n" % tuple(c) for c in f)


def off(rng):
    text = off_text()
    data = [Field("row", m.start(), m.end(), m.start(), m.end() + 1) for m in re.finditer(r"^[-\d].*$", text, re.MULTILINE)]
    yield from of_text("m.off", text, [data[0]._replace(name="counts"), *some(data[1:], rng, 12)])


def vtk_text(more=""):
    v, f = joined()
    return (f"# vtk DataFile Version 3.0\ntwo balls\nASCII\nDATASET POLYDATA\nPOINTS {len(v)} double\n" + "".join("%r %r %r\n" % tuple(p) for p in v.tolist()) +
            f"POLYGONS {len(f)} {4 * len(f)}\n" + "".join("3 %d %d %d\n" % tuple(c) for c in f) + more)


def vtk(rng):
    text = vtk_text("METADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 0 1\n\n")
    data = [Field("row", m.start(), m.end(), m.start(), m.end() + 1) for m in re.finditer(r"^[-\d].*$", text, re.MULTILINE)]
    yield from of_text("m.vtk", text, [*lines(text, " ", of="# vtk DataFile Version|DATASET|POINTS|POLYGONS"), *some(data, rng, 12)])
    parts = {"POINTS": text[text.index("POINTS"):text.index("POLYGONS")], "POLYGONS": text[text.index("POLYGONS"):text.index("METADATA")],
             "METADATA": text[text.index("METADATA"):]}
    values = f"POINT_DATA {len(joined()[0])}\nSCALARS s float\nLOOKUP_TABLE default\n" + "1 " * len(joined()[0]) + "\n"
    head = text[:text.index("POINTS")]
    for field, way, body in (("POINTS", "twice, the whole section", ("POINTS", "POINTS", "POLYGONS")), ("POLYGONS", "twice, the whole section", ("POINTS", "POLYGONS", "POLYGONS")),
                             ("POLYGONS", "before POINTS", ("POLYGONS", "POINTS")), ("POLYGONS", "behind values", ("POINTS", values, "POLYGONS")),
                             ("POLYGONS", "behind a byte 0", ("POINTS", "\0\n", "POLYGONS")), ("POLYGONS", "in two sections", ("POINTS", None)),
                             ("METADATA", "without an empty line", ("POINTS", parts["METADATA"].rstrip() + "\n", "POLYGONS"))):
        if body[-1] is None:
            rows = parts["POLYGONS"].splitlines()[1:]
            body = ("POINTS", *(f"POLYGONS {len(some_rows)} {4 * len(some_rows)}\n" + "\n".join(some_rows) + "\n" for some_rows in (rows[:50], rows[50:])))
        changed = head + "".join(parts.get(part, part) for part in body)
        yield field, way, lambda folder, changed=changed: ((folder / "m.vtk").write_text(changed), mesh("m.vtk"))[1]


def vtp_text(values=None):
    pieces, first = "", 0
    for v, f in triangles():
        pieces += f'<Piece NumberOfPoints="{len(v)}" NumberOfPolys="{len(f)}">'
        if values is not None:
            pieces += ('<PointData Scalars="quality"><DataArray type="Float32" Name="quality" format="ascii">' +
                       " ".join(map(repr, values[first:first + len(v)].tolist())) + "</DataArray></PointData>")
            first += len(v)
        pieces += ('<Points><DataArray type="Float64" Name="Points" NumberOfComponents="3" '
                   'format="ascii">' + " ".join(map(repr, v.ravel().tolist())) + '</DataArray></Points><Polys><DataArray type="Int64" Name="connectivity" '
                   'format="ascii">' + " ".join(map(str, f.ravel().tolist())) + '</DataArray><DataArray type="Int64" Name="offsets" format="ascii">' +
                   " ".join(map(str, range(3, 3 * len(f) + 1, 3))) + "</DataArray></Polys></Piece>")
    return f'<?xml version="1.0"?><VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt32"><PolyData>{pieces}</PolyData></VTKFile>'


def vtp(rng):
    text = vtp_text()
    arrays = [Field("DataArray", m.start(1), m.end(1), m.start(1), m.end(1)) for m in re.finditer(r">([-\d. e]+)</DataArray>", text)]
    yield from of_text("m.vtp", text, [*attributes(text), *arrays])
    for name in ("Points", "Polys"):
        at = text.rindex(f"</{name}>")
        array = text[text.rindex("<DataArray", 0, at):at]
        for way, put in (("twice, the same", array), ("twice, the second is another", array.replace(" 1", " 2").replace(">3 ", ">6 ")),
                         ("twice, the first is another", None)):
            changed = (text[:at] + put + text[at:] if put else text[:at - len(array)] + array.replace(" 1", " 2").replace(">3 ", ">6 ") + text[at - len(array):])
            yield f"array of {name}", way, lambda folder, changed=changed: ((folder / "m.vtp").write_text(changed), mesh("m.vtp"))[1]


def vtp_appended(rng):
    """Appended binary arrays: the attributes that say where and how they are."""
    with tempfile.TemporaryDirectory() as folder:
        v, f = joined()
        write_xml(pathlib.Path(folder) / "m.vtp", [(v, {"Polys": f.tolist()})], mode="appended")
        text = (pathlib.Path(folder) / "m.vtp").read_text()
    yield from of_text("m.vtp", text, [f for f in attributes(text) if f.name not in ("version", "Scalars")])
    for m in re.finditer(r' offset="\d+"', text):
        changed = text[:m.start()] + text[m.end():]
        yield "offset", "is not there", lambda folder, changed=changed: ((folder / "m.vtp").write_text(changed), mesh("m.vtp"))[1]


def three_mf(rng):
    import zipfile
    objects = "".join(
        f'<object id="{k + 1}" type="model"><mesh><vertices>' + "".join('<vertex x="%r" y="%r" z="%r"/>' % tuple(p) for p in v.tolist()) +
        "</vertices><triangles>" + "".join('<triangle v1="%d" v2="%d" v3="%d"/>' % tuple(c) for c in f) + "</triangles></mesh></object>"
        for k, (v, f) in enumerate(triangles()))
    text = ('<?xml version="1.0" encoding="UTF-8"?><model unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
            f'<resources>{objects}</resources><build><item objectid="1"/><item objectid="2" transform="1 0 0 0 1 0 0 0 1 0 0 0"/></build></model>')

    def case(changed, beside=None):
        def write(folder):
            with zipfile.ZipFile(folder / "m.3mf", "w") as archive:
                archive.writestr("[Content_Types].xml", '<?xml version="1.0" encoding="UTF-8"?><Types/>')
                archive.writestr("_rels/.rels", '<?xml version="1.0" encoding="UTF-8"?><Relationships><Relationship Id="r" Target="/3D/3dmodel.model" '
                                 'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>')
                archive.writestr("3D/3dmodel.model", changed)
                if beside:
                    archive.NameToInfo.clear()  # zipfile warns of a name that is there twice
                    archive.writestr("3D/3dmodel.model", beside)
            return mesh("m.3mf")
        return write
    yield "", "", case(text)
    other = text.replace("millimeter", "inch")
    for way, both in (("twice, the second is another", (text, other)), ("twice, the first is another", (other, text))):
        yield "part", way, case(*both)
    found = attributes(text)
    rows = [f for f in found if f.name in ("x", "y", "z", "v1", "v2", "v3")]
    for field, way, changed in text_variations(text, [f for f in found if f not in rows] + some(rows, rng, 10)):
        yield field, way, case(changed)
    for node in ("<item objectid=\"2\"", "<object id=\"1\" type=\"model\""):
        for put in (' printable="0"', ' unknown="7"', ' transform="2 0 0 0 2 0 0 0 2 0 0 0"'):
            if node.startswith("<item") and "transform" in put:
                continue
            yield node[1:7], f"has{put}", case(text.replace(node, node + put, 1))


def gltf(rng):
    parts, buffer = triangles(), b""
    views, accessors, meshes, nodes = [], [], [], []
    for k, (v, f) in enumerate(parts):
        move = numpy.round(v.mean(axis=0)) * (numpy.abs(v).max() > 1e4)  # positions are floats, and translations are not
        v = v - move
        for data, of in ((v.astype("<f4"), {"componentType": 5126, "type": "VEC3", "count": len(v), "min": v.astype("f4").min(axis=0).tolist(),
                                             "max": v.astype("f4").max(axis=0).tolist()}),
                         (f.astype("<u2"), {"componentType": 5123, "type": "SCALAR", "count": f.size})):
            views.append({"buffer": 0, "byteOffset": len(buffer), "byteLength": data.nbytes})
            accessors.append({"bufferView": len(views) - 1, "byteOffset": 0, **of})
            buffer += data.tobytes() + bytes(-data.nbytes % 4)
        meshes.append({"primitives": [{"attributes": {"POSITION": 2 * k}, "indices": 2 * k + 1, "mode": 4}]})
        nodes.append({"mesh": k, "translation": move.tolist(), "scale": [1.0, 1.0, 1.0], "name": f"ball{k}"})
    document = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}], "nodes": nodes, "meshes": meshes, "accessors": accessors,
                "bufferViews": views, "buffers": [{"byteLength": len(buffer), "uri": "data:application/octet-stream;base64," + base64.b64encode(buffer).decode()}]}
    text = json.dumps(document)
    yield from of_text("m.gltf", text, members(text))

    def with_node(change, used=()):
        changed = json.loads(text)
        change(changed["nodes"][1], changed)
        if used:
            changed["extensionsUsed"] = list(used)
        return lambda folder: ((folder / "m.gltf").write_text(json.dumps(changed)), mesh("m.gltf"))[1]
    for name, value in (("KHR_node_visibility", {"visible": False}), ("EXT_mesh_gpu_instancing", {"attributes": {"TRANSLATION": 0}}),
                        ("MSFT_lod", {"ids": [0]}), ("VENDOR_unknown", {"offset": 3})):
        yield "node 1", name, with_node(lambda node, _, name=name, value=value: node.update(extensions={name: value}), [name])
    yield "document", "CESIUM_RTC", with_node(lambda _, whole: whole.update(extensions={"CESIUM_RTC": {"center": [100, 0, 0]}}), ["CESIUM_RTC"])
    yield "node 1", "matrix and translation", with_node(lambda node, _: node.update(matrix=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1]))
    yield "node 1", "has two parents", with_node(lambda _, whole: whole["nodes"][0].update(children=[1]))


def gifti_text(values=None, encoding="ASCII"):
    def array(intent, kind, values, width, name=""):
        identity = " ".join("1" if k % 5 == 0 else "0" for k in range(16))
        system = (f"<CoordinateSystemTransformMatrix><DataSpace>NIFTI_XFORM_UNKNOWN</DataSpace><TransformedSpace>NIFTI_XFORM_UNKNOWN</TransformedSpace>"
                  f"<MatrixData>{identity}</MatrixData></CoordinateSystemTransformMatrix>") if "POINT" in intent else ""
        name = name and f"<MetaData><MD><Name>Name</Name><Value>{name}</Value></MD></MetaData>"
        data = " ".join(map(str, values.ravel().tolist())) if encoding == "ASCII" else base64.b64encode(values.tobytes()).decode()
        return (f'<DataArray Intent="{intent}" DataType="{kind}" ArrayIndexingOrder="RowMajorOrder" Dimensionality="2" Dim0="{len(values)}" Dim1="{width}" '
                f'Encoding="{encoding}" Endian="LittleEndian" ExternalFileName="" ExternalFileOffset="0">{name}{system}<Data>{data}</Data></DataArray>')
    v, f = joined()
    more = array("NIFTI_INTENT_SHAPE", "NIFTI_TYPE_FLOAT32", values.astype("<f4"), values.size // len(values), "quality") if values is not None else ""
    return (f'<?xml version="1.0" encoding="UTF-8"?><GIFTI Version="1.0" NumberOfDataArrays="{3 if more else 2}">' +
            array("NIFTI_INTENT_POINTSET", "NIFTI_TYPE_FLOAT32", v.astype("<f4"), 3) + array("NIFTI_INTENT_TRIANGLE", "NIFTI_TYPE_INT32", f.astype("<i4"), 3) + more + "</GIFTI>")


def gifti(rng):
    text = gifti_text()
    arrays = [Field("Data", m.start(1), m.end(1), m.start(1), m.end(1)) for m in re.finditer(r">([-\d. e]+)</(?:Data|MatrixData)>", text)]
    yield from of_text("m.gii", text, [*attributes(text), *arrays])
    begin, end = text.index("<Coord"), text.index("<Data>")
    other = text[begin:end].replace(">1 0", ">2 0")
    for way, put in (("twice, the second is another", text[begin:end] + other), ("twice, the first is another", other + text[begin:end]), ("is another", other)):
        yield "CoordinateSystemTransformMatrix", way, lambda folder, put=put: ((folder / "m.gii").write_text(text[:begin] + put + text[end:]), mesh("m.gii"))[1]
    data = text[end:text.index("</DataArray>")]
    for way, put in (("twice, the same", data + data), ("twice, the second is another", data + "<Data>7 8 9</Data>"), ("twice, the first is another", "<Data>7 8 9</Data>" + data)):
        yield "Data", way, lambda folder, put=put: ((folder / "m.gii").write_text(text.replace(data, put)), mesh("m.gii"))[1]


def gifti_base64(rng):
    text = gifti_text(encoding="Base64Binary")
    yield from of_text("m.gii", text, [f for f in attributes(text) if f.name not in ("encoding", "version", "Version")])


# ---- files with the spacings of points: those on two balls that are a formula

def spacings(positions):
    return 1 + numpy.abs(positions[:, 0] - 13) / 5


def painted(name, text, fields, value="quality", component=None, structures=()):
    """`structures`: more variations (field, way, changed text)."""
    def case(changed):
        def write(folder):
            (folder / name).write_text(changed)
            (folder / "balls.off").write_text(off_text())
            return {**mesh("balls.off"), "grid": {"path": name, "name": value, **({} if component is None else {"component": component})}}
        return write
    yield "", "", case(text)
    for field, way, changed in (*text_variations(text, fields), *structures):
        yield field, way, case(changed)


def painted_ply(rng):
    v, f = joined()
    text = (f"ply\nformat ascii 1.0\nelement vertex {len(v)}\nproperty double x\nproperty double y\nproperty double z\nproperty float quality\n"
            f"element face {len(f)}\nproperty list uchar int vertex_indices\nend_header\n")
    text += "".join("%r %r %r %r\n" % (*p, s) for p, s in zip(v.tolist(), spacings(v).tolist())) + "".join("3 %d %d %d\n" % tuple(c) for c in f)
    data = [Field("row", m.start(), m.end(), m.start(), m.end() + 1) for m in re.finditer(r"^[-\d].*$", text, re.MULTILINE)]
    yield from painted("map.ply", text, [*lines(text, " ", of="format|element vertex|element face|property float|property list"), *some(data, rng, 12)])


def painted_obj(rng):
    """Colours of vertices. A row that is there twice moves the numbers of the vertices behind it: the file is one of another mesh."""
    v, f = joined()
    text = "".join("v %r %r %r %r 0.25 0.5\n" % (*p, s / 4) for p, s in zip(v.tolist(), spacings(v).tolist())) + "".join("f %d %d %d\n" % tuple(c + 1) for c in f)
    rows = words_in_lines(text, "v ", rng, 12)
    yield from painted("map.obj", text, [], "color", 0, [v for v in text_variations(text, rows) if not v[1].startswith("twice")] +
                       [("f ", "empty", text.replace(m[0], "f\n", 1)) for m in some(list(re.finditer(r"f .*\n", text)), rng, 4)])


def painted_vtk(rng):
    v, _ = joined()
    numbers = "\n".join(map(repr, spacings(v).tolist())) + "\n"
    field = f"FIELD FieldData 1\nother 1 {len(v)} double\n" + "2.5 " * len(v) + "\n"
    text = vtk_text(f"POINT_DATA {len(v)}\nSCALARS quality double 1\nLOOKUP_TABLE default\n{numbers}{field}")
    data = [m for m in re.finditer(r"^[-\d].*$", text, re.MULTILINE) if m.start() > text.index("LOOKUP_TABLE")]
    rows = [Field("row", m.start(), m.end(), m.start(), m.end() + 1) for m in some(data[:len(v)], rng, 12)]
    scalars = text[text.index("SCALARS"):text.index("FIELD")]
    other = scalars.replace("1", "2")
    at = text.index("SCALARS")
    yield from painted("map.vtk", text, [*lines(text, " ", of="POINT_DATA|SCALARS|LOOKUP_TABLE|FIELD|other"), *rows], structures=[
        ("SCALARS", "twice, the whole array", text[:at] + scalars + text[at:]),
        ("SCALARS", "twice, the whole array, the first is another", text[:at] + other.replace("quality double 2", "quality double 1") + text[at:]),
        ("SCALARS", "in another case", text.replace("quality", "Quality")), ("POINT_DATA", "is CELL_DATA", text.replace("POINT_DATA", "CELL_DATA")),
        ("FIELD", "twice, an array of the name", text.replace("\nother ", "\nquality ")), ("row", "behind a byte 0", text[:at] + "\0\n" + text[at:])])


def painted_vtp(rng):
    text = vtp_text(spacings(joined()[0]))
    arrays = [Field("DataArray", m.start(1), m.end(1), m.start(1), m.end(1)) for m in re.finditer(r">([-\d. e]+)</DataArray>", text)]
    found = [f for f in attributes(text) if text.rfind("<", 0, f.begin) in (text.rfind("<PointData", 0, f.begin), text.find("<DataArray", text.rfind("<PointData", 0, f.begin)))]
    second = text.rindex("<PointData")
    array = text[text.index("<DataArray", second):text.index("</PointData>", second)]
    yield from painted("map.vtp", text, [*found, *arrays[0::4]], structures=[
        ("array of PointData", "twice, the same", text[:second] + text[second:].replace(array, 2 * array)),
        ("array of PointData", "twice, the first is another", text.replace(array, array.replace(">2", ">3") + array)),
        ("array of PointData", "of piece 1 only", text.replace(text[text.index("<PointData"):text.index("</PointData>") + 12], "", 1)),
        ("array of PointData", "of piece 0 only", text.replace(text[second:text.index("</PointData>", second) + 12], "", 1))])


def painted_gifti_of(encoding):
    def run(rng):
        text = gifti_text(spacings(joined()[0]), encoding)
        last = text.rindex("<DataArray")
        value = Field("name", text.index("quality"), text.index("quality") + 7, text.index("<MD>"), text.index("</MD>") + 5)
        array = text[last:text.rindex("</GIFTI>")]
        data = [Field("Data", m.start(1), m.end(1), m.start(1), m.end(1)) for m in re.finditer(r">([-\d. e]+)</Data>", text) if m.start() > last]
        yield from painted("map.gii", text, [*(f for f in attributes(text) if f.begin > last), value, *data], structures=[
            ("array of values", "twice, the same", text.replace(array, 2 * array)), ("array of values", "before the surface", text.replace(array, "").replace("<DataArray", array + "<DataArray", 1)),
            ("array of values", "of listed points only", text.replace(array, array.replace("SHAPE", "NODE_INDEX").replace("quality", "k") + array))])
    return run


# ---- formats that assimp reads

def parts():
    return [library_meshes.Part(v, f) for v, f in triangles()]


def arrays_of(text, pattern, name="array"):
    """Long rows of numbers: there twice is one behind the other."""
    return [Field(name, m.start(1), m.end(1), m.start(1), m.end(1)) for m in re.finditer(pattern, text)]


def fbx(rng):
    settings = [library_meshes.fbx_property(*row) for row in (("UpAxis", "int", 1), ("UpAxisSign", "int", 1), ("UnitScaleFactor", "double", 1.0))]
    text = library_meshes.fbx_text(parts(), settings)
    fields = [Field(m[1], m.start(2), m.end(2), m.start(), m.end() + 1) for m in re.finditer(r'^P: "([\w ]+)", .*?"A",(.+)$', text, re.MULTILINE)]
    fields += [Field(m[1], m.start(2), m.end(2), m.start(), m.end() + 1) for m in
               re.finditer(r"^(FBXVersion|FBXHeaderVersion|Version|GeometryVersion|Count|C): (.+)$", text, re.MULTILINE)]
    fields += [Field("count", m.start(1), m.end(1), m.start(1), m.end(1)) for m in re.finditer(r"\*(\d+) {", text)]
    yield from of_text("m.fbx", text, fields + arrays_of(text, r"\na: ([-\d.e,]+)\n"))


def collada(rng):
    text = library_meshes.collada_text(parts())
    fields = [f for f in attributes(text) if f.name not in ("version", "encoding")]
    fields += arrays_of(text, r"<float_array[^>]*>([-\d.e ]+)<") + arrays_of(text, r"<p>([\d ]+)<")
    fields += [Field(m[1], m.start(2), m.end(2), m.start(2), m.end(2)) for m in re.finditer(r"<(translate|rotate|scale|up_axis)>([^<]+)<", text)]
    yield from of_text("m.dae", text, fields)


def draco(rng):
    with tempfile.TemporaryDirectory() as folder:
        library_meshes.draco_gltf(parts()).write(pathlib.Path(folder) / "m.gltf")
        text = (pathlib.Path(folder) / "m.gltf").read_text()
    yield from of_text("m.gltf", text, members(text))


# ---- OpenEXR and OpenVDB

def attribute(name, kind, value):
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value


def exr(rng):
    slices = [samples(numpy.zeros(3)).astype("f4")[:, :, k] for k in range(SIZE[2])]  # images have no origin

    def write(folder, change=None, of=range(SIZE[2]), name="s.{:03}.exr", spec=None, twice=None):
        for k, values in enumerate(slices):
            channels, how = {"Y": values}, {}
            if change and k in of:
                channels, how = change(values)
            path = folder / name.format(k)
            write_exr(path, *(how.pop("parts", None) or [Part(channels, **how)]))
            if twice and k in of:  # before the end of the header
                raw = path.read_bytes()
                path.write_bytes(raw.replace(b"compression\0", twice + b"compression\0", 1))
        return {"exr": {"path": name.format(0).replace("000", "###"), "slices": f"0-{SIZE[2] - 1}", "isovalue": 0, "voxel_size": STEP.tolist(), **(spec or {})}}
    yield "", "", write
    changes = {("dataWindow", "is smaller"): lambda v: ({"Y": v[:-2, :-1]}, {}),
               ("channels", "is half"): lambda v: ({"Y": v.astype("f2")}, {}),
               ("channels", "has another name"): lambda v: ({"Z": v}, {}), ("channels", "has another one"): lambda v: ({"Y": v, "A": 0 * v}, {}),
               ("channels", "is subsampled"): lambda v: ({"Y": v[::2, ::2], "A": v}, {}), ("pixelAspectRatio", "is 2"): lambda v: ({"Y": v}, {"aspect": 2}),
               ("pixelAspectRatio", "is nan"): lambda v: ({"Y": v}, {"aspect": numpy.nan}), ("pixelAspectRatio", "is 0"): lambda v: ({"Y": v}, {"aspect": 0}),
               ("lineOrder", "is 1"): lambda v: ({"Y": v}, {"order": 1}), ("lineOrder", "is 7"): lambda v: ({"Y": v}, {"order": 7}),
               ("displayWindow", "is smaller"): lambda v: ({"Y": v}, {"display": (2, 2, 9, 9)}), ("tiles", "are there"): lambda v: ({"Y": v}, {"tile": (8, 8)}),
               ("tiles", "have levels"): lambda v: ({"Y": v}, {"tile": (8, 8), "levels": 7}), ("compression", "is zip"): lambda v: ({"Y": v}, {"compression": 3}),
               ("part", "has a name"): lambda v: ({"Y": v}, {"name": "one"}),
               ("part", "is the second of two"): lambda v: (None, {"parts": [Part({"Z": 0 * v}, name="first"), Part({"Y": v}, name="second")]}),
               ("part", "is there twice"): lambda v: (None, {"parts": [Part({"Y": v}, name="first"), Part({"Y": -v}, name="second")]})}
    for (field, way), change in changes.items():
        yield field, way, lambda folder, change=change: write(folder, change)
        for number in (0, 13, SIZE[2] - 1):
            yield field, f"{way} in file {number} only", lambda folder, change=change, number=number: write(folder, change, [number])
    box = struct.pack("<4i", 0, 0, SIZE[0] - 1, SIZE[1] - 1)
    for name, kind, value, other in (("dataWindow", "box2i", box, struct.pack("<4i", 5, 5, SIZE[0] + 4, SIZE[1] + 4)),
                                     ("pixelAspectRatio", "float", struct.pack("<f", 1), struct.pack("<f", 3)), ("lineOrder", "lineOrder", b"\0", b"\1")):
        for way, put in (("twice", value), ("twice, the first is another", other)):
            for of in (range(SIZE[2]), [13]):
                yield name, way + ("" if len(of) > 1 else " in file 13 only"), lambda folder, name=name, kind=kind, put=put, of=of: write(
                    folder, of=of, twice=attribute(name, kind, put))
    yield "dataWindow", "is moved in all files", lambda folder: write(folder, lambda v: ({"Y": v}, {"low": (3, 2)}), spec={"origin": (-STEP * (3, 2, 0)).tolist()})
    for number in (0, 13, SIZE[2] - 1):
        yield "dataWindow", f"is moved in file {number} only", lambda folder, number=number: write(folder, lambda v: ({"Y": v}, {"low": (3, 2)}), [number])
    yield "channels", "is whole in all files", lambda folder: write(folder, lambda v: ({"Y": (1000 * v + 50000).round().astype("u4")}, {}), spec={"isovalue": 50000})
    yield "channel", "is not ASCII", lambda folder: write(folder, lambda v: ({NOT_ASCII: v}, {}), spec={"channel": NOT_ASCII})
    yield "channel", "of the spec is not there", lambda folder: write(folder, spec={"channel": "density"})


def vdb(rng):
    try:
        import pyopenvdb as openvdb
    except ImportError:
        return

    def write(folder, grids):
        made = []
        for values, how in grids:
            grid = openvdb.FloatGrid(how.get("background", -2.0))
            values = numpy.asarray(values)
            grid.copyFromArray((values if how.get("whole") else values.clip(-2, 2)).astype("f4"), ijk=how.get("low", (0, 0, 0)))
            for index, number in how.get("broken", {}).items():
                grid.getAccessor().setValueOn(index, float(number))
            grid.transform = openvdb.createLinearTransform(how.get("matrix", matrix()).T.tolist())
            grid.name = how.get("name", "density")
            grid.gridClass = how.get("class", openvdb.GridClass.FOG_VOLUME)
            for key, value in how.get("meta", {}).items():
                grid[key] = value
            made.append(grid)
        openvdb.write(str(folder / "v.vdb"), grids=made)
        return {"vdb": {"path": "v.vdb", "isovalue": 0, **grids[0][1].get("spec", {})}}
    values, small = samples(), numpy.zeros((4, 4, 4))
    yield "", "", lambda folder: write(folder, [(values, {})])
    for kind, ways in SAMPLES.items():
        for way, change in ways.items():
            changed = change(values)
            yield kind, way, lambda folder, changed=changed: write(folder, [(changed, {"whole": True, "background": float(changed[0, 0, 0])})])
    # its own zero set is that of the balls, with the inside negative
    level_set = {"class": openvdb.GridClass.LEVEL_SET, "background": 2.0}
    shifted = matrix(ORIGIN - STEP * (3, -2, 5))
    sheared = matrix()
    sheared[0, 2] = 0.1
    cases = {("transform", "is in the low corner"): [(values, {"low": (3, -2, 5), "matrix": shifted})],
             ("transform", "has a shear"): [(samples(linear=sheared[:3, :3]), {"matrix": sheared})],
             ("class", "is level set"): [(-values, level_set)], ("class", "is unknown"): [(values, {"class": openvdb.GridClass.UNKNOWN})],
             ("class", "is staggered"): [(values, {"class": openvdb.GridClass.STAGGERED})],
             ("class", "is level set, of a density"): [(values, {**level_set, "background": -2.0})],
             ("name", "is not ASCII"): [(values, {"name": NOT_ASCII, "spec": {"grid": NOT_ASCII}})], ("name", "is empty"): [(values, {"name": ""})], ("name", "has blanks"): [(values, {"name": "a grid of 2,5"})],
             ("name", "twice"): [(values, {}), (small, {})], ("name", "twice, the second is meant"): [(small, {}), (values, {})],
             ("grids", "has another one"): [(values, {}), (small, {"name": "other"})], ("grids", "has another one first"): [(small, {"name": "other"}), (values, {})],
             ("grids", "named by the spec"): [(values, {"spec": {"grid": "density"}}), (small, {"name": "other"})],
             ("background", "is nan"): [(values, {"background": numpy.nan})],
             ("background", "is infinite"): [(values, {"background": -numpy.inf})]}
    for key, value in (("unit", "cm"), ("units", "inch"), ("is_local_space", True), ("file_voxel_count", 7), ("file_bbox_min", (0, 0, 0)), ("file_bbox_max", (1, 1, 1)),
                       ("file_mem_bytes", 3), ("voxel_size", 7.0), ("frobnicate", "7"), ("vector_type", "covariant"), ("is_saved_as_half_float", True)):
        cases["meta", f"{key} is {value}"] = [(values, {"meta": {key: value}})]
    for number in (numpy.nan, numpy.inf, -numpy.inf):
        for index in ((5, 5, 5), (9, 10, 7)):  # outside of the balls and inside of one
            cases["values", f"{number} at {index}"] = [(values, {"broken": {index: number}})]
            cases["values", f"{number} at {index} in a level set"] = [(-values, {**level_set, "broken": {index: number}})]
    for (field, way), grids in cases.items():
        yield field, way, lambda folder, grids=grids: write(folder, grids)
    with tempfile.TemporaryDirectory() as folder:
        write(pathlib.Path(folder), [(values, {})])
        raw = (pathlib.Path(folder) / "v.vdb").read_bytes()
    for field, old, puts in (("class", b"fog volume", (b"level set\0", b"frobnicate")), ("type", b"Tree_float_5_4_3", (b"Tree_int32_5_4_3", b"Tree_float_5_4_4")),
                             ("transform", b"UniformScaleTranslateMap", (b"UniformScaleTranslateMop",)), ("transform", b"ScaleTranslateMap", (b"NonlinearFrustumM",)),
                             ("name", b"density", (b"densitx",))):
        for put in puts:
            if old in raw:
                for count in (1, -1):
                    yield field, f"is {put.decode()}" + ("" if count < 0 else " in its first place only"), lambda folder, old=old, put=put, count=count: (
                        (folder / "v.vdb").write_bytes(raw.replace(old, put, count)), {"vdb": {"path": "v.vdb", "isovalue": 0}})[1]
    for at in (8, 12, 16, 20, 21):
        for put in (0, 1, 255):
            yield "header", f"byte {at} is {put}", lambda folder, at=at, put=put: (
                (folder / "v.vdb").write_bytes(raw[:at] + bytes([put]) + raw[at + 1:]), {"vdb": {"path": "v.vdb", "isovalue": 0}})[1]


FORMATS = {"nrrd": nrrd, "nrrd by spacings": nrrd_by_spacings, "nrrd in files": nrrd_in_files, "meta_image": meta_image,
           "meta_image in a file": meta_image_in_a_file, "nifti-1 sform": nifti_of(1, False), "nifti-1 qform": nifti_of(1, True),
           "nifti-2 sform": nifti_of(2, False), "nifti-2 qform": nifti_of(2, True), "imagej": imagej, "tiff pages": tiff_pages, "tiff stack": tiff_stack,
           "ome": ome, "zarr 2": zarr_of(2), "zarr 3": zarr_of(3), "obj": obj, "ply": ply, "stl text": stl_text, "stl": stl, "off": off, "vtk": vtk,
           "vtp": vtp, "vtp appended": vtp_appended, "3mf": three_mf, "gltf": gltf, "gifti": gifti, "gifti base64": gifti_base64, "fbx": fbx, "collada": collada,
           "gltf draco": draco, "exr": exr, "vdb": vdb,
           "painted ply": painted_ply, "painted obj": painted_obj, "painted vtk": painted_vtk, "painted vtp": painted_vtp,
           "painted gifti": painted_gifti_of("ASCII"), "painted gifti base64": painted_gifti_of("Base64Binary")}


# ---- kinds of inputs that readers of several formats can have

JUMP, SATURATED, BEYOND = "jump beside the surface", "saturated samples", "1e31 outside"
JUMPS = {**{f"{value:g} beyond {away}": lambda v, away=away, value=value: numpy.where(v < -away, value, v)
            for away in (2.5, 4, 5.5) for value in (-200, -9999, -32768, -1e20)}}
SAMPLES = {JUMP: JUMPS, SATURATED: {"65535 within 2.5": lambda v: numpy.where(v > 2.5, 65535, v)},
           BEYOND: {"1e31 beyond 3": lambda v: numpy.where(v < -3, 1e31, v)}}
VOLUMES = ("nrrd", "meta_image", "nifti-1 sform", "nifti-2 sform", "zarr 2", "zarr 3", "tiff pages", "tiff stack", "exr")
# The readers of the formats, for the table, and the beginnings of the formats' names.
READERS = {"NRRD": "nrrd", "MetaImage": "meta_image", "NIfTI": "nifti", "TIFF": ("tiff", "imagej", "ome"), "Zarr": "zarr", "OpenEXR": "exr", "OpenVDB": "vdb",
           "OBJ": "obj", "PLY": "ply", "STL": "stl", "OFF": "off", "VTK": ("vtk",), "VTK (XML)": "vtp", "GIfTI": "gifti", "glTF": "gltf", "3MF": "3mf",
           "COLLADA": "collada", "FBX": "fbx"}
VOLUME_READERS = tuple(READERS)[:7]
OF_XML = ("TIFF", "VTK (XML)", "GIfTI", "3MF", "COLLADA")
OF_TEXT = ("NRRD", "MetaImage", "TIFF", "Zarr", "OBJ", "PLY", "STL", "OFF", "VTK", "VTK (XML)", "GIfTI", "glTF", "3MF", "COLLADA", "FBX")
OF_POLYGONS = ("OBJ", "PLY", "OFF", "VTK", "VTK (XML)", "COLLADA", "FBX")
COLORS, RIMS, TWICE_A_CORNER, LIBRARIES = "colours of vertices", "rims far from the origin", "a vertex that is twice a corner", "several libraries"
MARK, ENCODING, ENDING, ZIP64, SKIPPED = "byte order mark", "encoding of XML", "ending of another format", "ZIP64", "only what is skipped"
NAME, OLDER, BLANK, TRANSFORM = "a name that is not ASCII", "an older version", "blank before a number", "transform with another count of numbers"
OLD_FACES, INDEX_0 = "faces of old files", "index 0"
# Readers that can have a kind; in the others it cannot occur.
CAN_HAVE = {
    **{kind: VOLUME_READERS for kind in SAMPLES}, MARK: OF_TEXT, ENCODING: OF_XML, ENDING: tuple(READERS), ZIP64: ("3MF",),
    NAME: tuple(r for r in READERS if r != "OFF"),
    OLDER: ("NRRD", "NIfTI", "Zarr", "OpenEXR", "OpenVDB", "VTK", "VTK (XML)", "glTF", "COLLADA", "FBX"), BLANK: OF_TEXT,
    TRANSFORM: ("NRRD", "MetaImage", "Zarr", "GIfTI", "glTF", "3MF", "COLLADA", "FBX"),
    SKIPPED: ("OpenVDB", "OBJ", "PLY", "OFF", "VTK", "VTK (XML)", "GIfTI", "glTF", "3MF", "COLLADA", "FBX"), OLD_FACES: ("OBJ",), INDEX_0: ("OBJ",),
    COLORS: tuple(r for r in READERS if r not in VOLUME_READERS), RIMS: tuple(r for r in READERS if r not in VOLUME_READERS),
    TWICE_A_CORNER: OF_POLYGONS, LIBRARIES: ("OBJ",)}


def base_of(name):
    """The function that writes the file of a format without a variation."""
    return next(iter(FORMATS[name](random.Random(1))))[2]


def with_samples(name, change):
    def write(folder):
        LOCAL.change = change
        try:
            return base_of(name)(folder)
        finally:
            LOCAL.change = None
    return write


def with_parts(name, parts):
    def write(folder):
        LOCAL.parts = parts
        try:
            return base_of(name)(folder)
        finally:
            LOCAL.parts = None
    return write


# The files of a format whose bytes are text, or that are the whole input.
FILES = {"nrrd": "v.nrrd", "nrrd by spacings": "v.nrrd", "nrrd in files": "v.nhdr", "meta_image": "v.mha", "meta_image in a file": "v.mhd",
         "nifti-1 sform": "v.nii", "nifti-2 sform": "v.nii", "tiff pages": "v.tif", "imagej": "v.tif", "ome": "v.ome.tif", "zarr 2": "v.zarr/.zattrs",
         "zarr 3": "v.zarr/zarr.json", "vdb": "v.vdb", "exr": "s.*.exr", "obj": "m.obj", "ply": "m.ply", "stl": "m.stl", "stl text": "m.stl", "off": "m.off",
         "vtk": "m.vtk", "vtp": "m.vtp", "gifti": "m.gii", "gltf": "m.gltf", "3mf": "m.3mf", "collada": "m.dae", "fbx": "m.fbx"}


def rewritten(name, change, also=None, zip64=False):
    """The files of a format with other bytes; of 3MF the model, of TIFF the description. `also`: changes the surface."""
    if name == "3mf":
        change = in_archive(change, zip64)
    elif name == "ome" or name == "imagej":
        change = in_description(change)

    def write(folder):
        surface = base_of(name)(folder)
        before = {path: path.read_bytes() for path in folder.glob(FILES[name])}
        after = {path: change(data) for path, data in before.items()}
        assert before and before != after, (name, "nothing was changed")
        for path, data in after.items():
            path.write_bytes(data)
        return also(surface, folder) if also else surface
    return write


def renamed(name, ending):
    """The files of a format with the ending of another one."""
    def write(folder):
        surface = base_of(name)(folder)
        (members,) = surface.values()
        parts = members["path"].split(".")
        for path in [folder / members["path"]] if "#" not in members["path"] else list(folder.glob(parts[0] + ".*")):
            path.rename(path.with_name(".".join([*path.name.split(".")[:len(parts) - 1], ending])))
        members["path"] = ".".join([*parts[:-1], ending])
        return surface
    return write


def named(name, file):
    """A painted file whose values have a name that is not ASCII."""
    def write(folder):
        surface = base_of(name)(folder)
        (folder / file).write_bytes((folder / file).read_bytes().replace(b"quality", NOT_ASCII.encode()))
        surface["grid"]["name"] = NOT_ASCII
        return surface
    return write


def in_description(change):
    """Changes the first image description of a TIFF: its text moves to the end of the file."""
    def of(raw):
        (at,) = struct.unpack_from("<I", raw, 4)
        for k in range(*struct.unpack_from("<H", raw, at)):
            entry = at + 2 + 12 * k
            tag, kind, count, where = struct.unpack_from("<HHII", raw, entry)
            if tag == 270:
                text = change(raw[where:where + count - 1]) + b"\0"
                data = bytearray(raw + bytes(len(raw) % 2) + text)
                struct.pack_into("<II", data, entry + 4, len(text), len(data) - len(text))
                return bytes(data)
        raise ValueError("no description")
    return of


def in_encoding(data, codec, declared_as):
    text = re.sub(r"^<\?xml[^>]*\?>", "", data.decode())
    return f'<?xml version="1.0" encoding="{declared_as}"?><!-- \u00e4 -->{text}'.encode(codec)


def zip_of(parts, zip64):
    """An archive, with sizes in ZIP64 fields."""
    import zlib
    local, central = b"", b""
    for name, data in parts.items():
        packer = zlib.compressobj(9, zlib.DEFLATED, -15)
        packed = packer.compress(data) + packer.flush()
        sizes = (len(packed), len(data))
        short = (2 ** 32 - 1, 2 ** 32 - 1) if zip64 else sizes
        extra = struct.pack("<HHQQ", 1, 16, *sizes[::-1]) if zip64 else b""
        head = struct.pack("<HHHHHIIIHH", 45, 0, 8, 0, 33, zlib.crc32(data), *short, len(name), len(extra))
        central += b"PK\1\2" + struct.pack("<H", 45) + head + struct.pack("<HHHII", 0, 0, 0, 0, len(local)) + name.encode() + extra
        local += b"PK\3\4" + head + name.encode() + extra + packed
    return local + central + b"PK\5\6" + struct.pack("<HHHHIIH", 0, 0, len(parts), len(parts), len(central), len(local), 0)


MODEL = "3D/3dmodel.model"


def in_archive(change, zip64=False):
    """Changes the model of a 3MF package."""
    import zipfile

    def of(raw):
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            parts = {name: archive.read(name) for name in archive.namelist()}
        model = parts[MODEL]
        parts[MODEL] = change(model)
        assert zip64 or parts[MODEL] != model, "nothing was changed"
        return zip_of(parts, zip64)
    return of


def put(old, new, count=-1):
    """Replaces bytes; texts are UTF-8."""
    old, new = (k.encode() if isinstance(k, str) else k for k in (old, new))
    return lambda data: data.replace(old, new, count)


def sub(pattern, new, count=0):
    return lambda data: re.sub(pattern.encode(), new.encode(), data, count=count)


NOT_ASCII = "gr\u00f6\u00dfe"
ENCODINGS = {"utf-16": "UTF-16", "utf-16-be": "UTF-16", "iso-8859-1": "ISO-8859-1", "cp1252": "windows-1252"}
BOM = b"\xef\xbb\xbf"
MARKED = ("nrrd", "meta_image", "ome", "zarr 2", "zarr 3", "obj", "ply", "stl text", "off", "vtk", "vtp", "gifti", "gltf", "3mf", "collada", "fbx")
MISNAMED = {"nrrd": ("mha", "nii"), "meta_image": ("nrrd", "tif"), "nifti-1 sform": ("nrrd", "mha"), "nifti-2 sform": ("nrrd",), "tiff pages": ("nrrd", "exr"),
            "zarr 2": ("nrrd",), "zarr 3": ("tif",), "exr": ("png", "tif"), "vdb": ("nrrd", "obj"), "obj": ("ply", "stl"), "ply": ("obj", "stl"), "stl": ("obj", "ply"),
            "stl text": ("obj", "off"), "off": ("obj", "ply"), "vtk": ("ply", "obj"), "vtp": ("stl", "vtk"), "gifti": ("off", "vtp"), "gltf": ("glb", "obj"),
            "3mf": ("obj", "stl"), "collada": ("obj", "fbx"), "fbx": ("obj", "dae")}
PAINTED = {"painted ply": "map.ply", "painted vtk": "map.vtk", "painted vtp": "map.vtp", "painted gifti": "map.gii"}
# The format's name and changes of its bytes.
NAMES = {"obj": {"of an object": put("o ball1", f"o {NOT_ASCII}"), "of a material": put("usemtl grey", f"usemtl {NOT_ASCII}")},
         "stl text": {"of a solid": put("solid ball1", f"solid {NOT_ASCII}")}, "gltf": {"of a node": put('"ball1"', f'"{NOT_ASCII}"')},
         "3mf": {"of an object": put('<object id="1"', f'<object id="1" name="{NOT_ASCII}"')}, "collada": {"of a node": put('<node id="n1"', f'<node id="n1" name="{NOT_ASCII}"'),
                                                                                                 "an id": put("part1", NOT_ASCII)},
         "fbx": {"of a model": put("Model::part1", f"Model::{NOT_ASCII}")}, "imagej": {"of an entry": put("loop=", f"{NOT_ASCII}=1\nloop=")},
         "ome": {"of the image": put('ID="Image:0"', f'ID="Image:0" Name="{NOT_ASCII}"')},
         "nifti-1 sform": {"description": lambda data: data[:148] + NOT_ASCII.encode().ljust(80, b"\0") + data[228:]},
         "nrrd in files": {"of data": put("s %02d.raw", f"{NOT_ASCII} %02d.raw")}, "meta_image in a file": {"of data": put("v 50%.raw", f"{NOT_ASCII}.raw")}}
OLDER_FILES = {"nrrd by spacings": {"NRRD0001": sub("^NRRD000.", "NRRD0001")}, "nifti-1 sform": {"Analyze 7.5": lambda data: data[:344] + bytes(4) + data[348:]},
               "zarr 2": {"1": None}, "exr": {"1": lambda data: data[:4] + b"\1" + data[5:]}, "vdb": {"file version 200": lambda data: data[:8] + struct.pack("<I", 200) + data[12:]},
               "vtk": {version: sub("Version 3.0", f"Version {version}") for version in ("1.0", "2.0")}, "vtp": {"0.1": put('version="1.0" byte', 'version="0.1" byte')},
               "gltf": {"1.0": put('"version": "2.0"', '"version": "1.0"')}, "collada": {"1.3.1": put('version="1.4.1"', 'version="1.3.1"')},
               "fbx": {"6100": put("FBXVersion: 7300", "FBXVersion: 6100")}}
BLANKS = {"nrrd": sub(r"(?m)^((?:sizes|space directions|space origin):)", r"\1  ") , "meta_image": sub("((?:DimSize|Offset|ElementSpacing) =)", r"\1 "),
          "imagej": sub("(images|spacing)=", r"\1= "), "ome": sub('(Size[XYZ]|PlaneCount)="', r'\1=" '), "zarr 2": sub(r"([\[ ])(\d)", r"\1  \2"), "zarr 3": sub(r"([\[ ])(\d)", r"\1  \2"),
          "obj": sub(r"(?m)^v ", "v   "), "ply": sub(r"(?m)^([-\d])", r"  \1"), "stl text": sub("vertex ", "vertex   "), "off": sub(r"(?m)^([-\d])", r" \1"),
          "vtk": sub(r"(?m)^([-\d])", r" \1"), "vtp": sub('(NumberOf[A-Z][a-z]+)="', r'\1=" '), "gifti": sub('(Dim[01]|Dimensionality|NumberOfDataArrays)="', r'\1=" '),
          "gltf": sub(r": (\d)", r":   \1"), "3mf": sub(r' (x|y|z|v1|v2|v3|objectid|transform)="', r' \1=" '), "collada": sub(' (count|stride|offset|meter)="', r' \1=" '),
          "fbx": sub(r"(,|a: |Count: |FBXVersion: )(\d)", r"\1 \2")}
TRANSFORMS = {"nrrd": {"two directions": sub(r" \([^()]*\)\n", "\n", 1), "two components": sub(r",[^,()]*\)", ")", 1)},
              "meta_image": {"8 numbers": sub(r"(TransformMatrix = .*) \S+\n", "\\1\n"), "10 numbers": sub("(TransformMatrix = .*)\n", "\\1 0\n")},
              "zarr 2": {"2 scales": sub(r'("scale": \[)[^,]*, ', r"\1")}, "zarr 3": {"4 scales": sub(r'("scale": \[)', r"\1 1, ")},
              "gifti": {"15 numbers": put("<MatrixData>1 ", "<MatrixData>"), "17 numbers": put("<MatrixData>1 ", "<MatrixData>1 0 ")},
              "gltf": {"matrix of 15": put('"translation": [0.0, 0.0, 0.0], "scale": [1.0, 1.0, 1.0]', '"matrix": [' + ", ".join(["1", *4 * "0"] * 3) + "]"),
                       "translation of 2": put("[0.0, 0.0, 0.0]", "[0.0, 0.0]"), "scale of 4": put("[1.0, 1.0, 1.0]", "[1.0, 1.0, 1.0, 1.0]")},
              "3mf": {"16 numbers": put('1 0 0 0"', '1 0 0 0 0 0 0 1"'), "rubbish behind": put('1 0 0 0"', '1 0 0 0 rubbish"'), "11 numbers": put('1 0 0 0"', '1 0 0"')},
              "collada": {"matrix of 15": sub("<translate>.*?</scale>", "<matrix>" + " ".join(["1", *4 * "0"] * 3) + "</matrix>"), "translate of 2": put("<translate>0.0 ", "<translate>"),
                          "scale of 4": put("<scale>", "<scale>1 ")},
              "fbx": {"translation of 2": sub('("Lcl Translation", "", "A",[^,]*,[^,\n]*),[^,\n]*\n', "\\1\n"), "scaling of 4": sub('("Lcl Scaling", "", "A".*)\n', "\\1,1.0\n")}}
HIDDEN = '"extensions": {"KHR_node_visibility": {"visible": false}}, "scale"'
ALL_SKIPPED = {"gltf": {"hidden nodes": put('"scale"', HIDDEN), "no scene's nodes": put('"nodes": [0, 1]', '"nodes": []')}, "obj": {"unknown words": put("\nf ", "\nface ")},
               "3mf": {"objects that are not built": sub("<build>.*</build>", "<build/>")}, "ply": {"another element": put("element face", "element strip")},
               "off": {"faces of two corners": sub(r"(?m)^3 (\d+ \d+) \d+$", r"2 \1")}, "vtk": {"lines": put("POLYGONS", "LINES")},
               "vtp": {"lines": lambda data: data.replace(b"Polys", b"Lines")}, "gifti": {"another intent": put("NIFTI_INTENT_TRIANGLE", "NIFTI_INTENT_SHAPE")},
               "collada": {"no scene's nodes": sub("<node .*</node>", "")}, "fbx": {"no connections": sub("(?s)Connections: {.*}", "Connections: {\n}")},
               "vdb": {"another type": put("Tree_float_5_4_3", "Tree_int32_5_4_3")}}


def by_table(kind, table):
    for name, ways in table.items():
        for way, change in ways.items():
            if change:
                yield name, kind, way, rewritten(name, change)


# ---- colours, far rims and keyholes, whose truths are their own

def colors_of(positions):
    """Linear in the place, so that triangles have the colours of their places."""
    return (positions - (4, 6, 6)) / (19, 12, 14)


def linear_light(color):
    return numpy.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)


def with_colors(file, write, name="color", column="c"):
    """`write(path, vertices, triangles, colours)`; `column`: of EXPECTED."""
    def run(folder):
        v, f = joined()
        write(folder / file, v, f, colors_of(v))
        return {**mesh(file), "attributes": [{"name": name, "as": column, "type": "color"}]}
    return run


def rows(values, form):
    return "".join(form % tuple(row) for row in numpy.asarray(values).tolist())


def color_files():
    """(format, way, write)"""
    def ply_of(kind, scale):
        def write(path, v, f, c):
            c = c * scale if kind in ("float", "double") else numpy.rint(c * scale).astype(int)
            path.write_text(f"ply\nformat ascii 1.0\nelement vertex {len(v)}\n" + "".join(f"property double {a}\n" for a in "xyz") +
                            "".join(f"property {kind} {a}\n" for a in ("red", "green", "blue")) +
                            f"element face {len(f)}\nproperty list uchar int vertex_indices\nend_header\n" +
                            "".join("%r %r %r " % tuple(p) + "%r %r %r\n" % tuple(q) for p, q in zip(v.tolist(), c.tolist())) + rows(f, "3 %d %d %d\n"))
        return with_colors("m.ply", write)
    for kind, scale in (("uchar", 255), ("ushort", 65535), ("float", 1), ("int", 255), ("double", 255), ("int", 1000)):
        yield "ply", f"{kind} to {scale}", ply_of(kind, scale)
    for scale in (1, 255):
        yield "obj", f"to {scale}", with_colors("m.obj", lambda path, v, f, c, scale=scale: path.write_text(
            rows(numpy.c_[v, c * scale], "v %r %r %r %r %r %r\n") + rows(f + 1, "f %d %d %d\n")))
        form = "%r %r %r " + ("%r %r %r 1.0\n" if scale == 1 else "%d %d %d 255\n")
        yield "off", f"to {scale}", with_colors("m.off", lambda path, v, f, c, scale=scale, form=form: path.write_text(
            f"COFF\n{len(v)} {len(f)} 0\n" + rows(numpy.c_[v, c * scale], form) + rows(f, "3 %d %d %d\n")))
    yield "vtk", "COLOR_SCALARS", with_colors("m.vtk", lambda path, v, f, c: path.write_text(
        vtk_text(f"POINT_DATA {len(v)}\nCOLOR_SCALARS rgb 3\n" + rows(c, "%r %r %r\n"))), "rgb")
    for kind, scale in (("f4", 1), ("u1", 255)):
        yield "vtp", f"{kind} to {scale}", with_colors("m.vtp", lambda path, v, f, c, kind=kind, scale=scale: write_xml(
            path, [(v, {"Polys": f.tolist()})], values=[{"rgb": (c * scale).round(8 if scale == 1 else 0).astype(kind)}]), "rgb", "c" if scale == 1 else "raw")
    yield "gifti", "float", with_colors("m.gii", lambda path, v, f, c: path.write_text(gifti_text(c)), "quality")
    for kind, number, scale in (("<f4", 5126, 1), ("u1", 5121, 255), ("<u2", 5123, 65535)):
        yield "gltf", f"{kind} to {scale}", with_colors("m.gltf", lambda path, v, f, c, kind=kind, number=number, scale=scale: write_gltf(
            path, v, f, numpy.c_[linear_light(c), numpy.ones(len(c))], kind, number, scale))
    yield "3mf", "group of colours", with_colors("m.3mf", write_3mf_colors, "base_color")
    for name, file, text in (("collada", "m.dae", library_meshes.collada_text), ("fbx", "m.fbx", library_meshes.fbx_text)):
        yield name, "floats", with_colors(file, lambda path, v, f, c, text=text: path.write_text(
            text([library_meshes.Part(v, f, color=numpy.c_[c, numpy.ones(len(c))])])))
    yield "stl", "attribute bytes", with_colors("m.stl", lambda path, v, f, c: path.write_bytes(
        b"COLOR=\x33\x66\xcc\xff".ljust(80) + struct.pack("<I", len(f)) + b"".join(struct.pack("<12fH", 0, 0, 0, *v[t].ravel(), 0x8000) for t in f)), column="one")


def write_gltf(path, v, f, c, kind, number, scale):
    stored = c.astype(kind) if scale == 1 else numpy.rint(c * scale).astype(kind)
    data = [v.astype("<f4").tobytes(), f.astype("<u2").tobytes(), stored.tobytes()]
    data = [d + bytes(-len(d) % 4) for d in data]
    starts = numpy.cumsum([0] + [len(d) for d in data]).tolist()
    accessors = [{"componentType": 5126, "type": "VEC3", "count": len(v), "min": v.astype("f4").min(axis=0).tolist(), "max": v.astype("f4").max(axis=0).tolist()},
                 {"componentType": 5123, "type": "SCALAR", "count": f.size}, {"componentType": number, "type": "VEC4", "count": len(v), "normalized": scale > 1}]
    path.write_text(json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 2}, "indices": 1}]}],
        "accessors": [{"bufferView": k, **of} for k, of in enumerate(accessors)],
        "bufferViews": [{"buffer": 0, "byteOffset": at, "byteLength": len(d)} for at, d in zip(starts, data)],
        "buffers": [{"byteLength": starts[-1], "uri": "data:application/octet-stream;base64," + base64.b64encode(b"".join(data)).decode()}]}))


def write_3mf_colors(path, v, f, c):
    group = "".join("<m:color color=\"#%02X%02X%02X\"/>" % tuple(k) for k in numpy.rint(255 * c).astype(int).tolist())
    text = ('<?xml version="1.0" encoding="UTF-8"?><model unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" '
            f'xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02"><resources><m:colorgroup id="7">{group}</m:colorgroup>'
            '<object id="1" type="model" pid="7" pindex="0"><mesh><vertices>' + rows(v, '<vertex x="%r" y="%r" z="%r"/>') + "</vertices><triangles>" +
            "".join('<triangle v1="{0}" v2="{1}" v3="{2}" pid="7" p1="{0}" p2="{1}" p3="{2}"/>'.format(*t) for t in f.tolist()) +
            '</triangles></mesh></object></resources><build><item objectid="1"/></build></model>')
    base_of("3mf")(path.parent)
    path.write_bytes(in_archive(lambda _: text.encode())(path.read_bytes()))


# Of columns: what their colours are. Values that a file has by their own name keep their numbers; in STL there is the colour of the header.
EXPECTED = {"c": lambda x: colors_of(x), "raw": lambda x: 255 * colors_of(x), "one": lambda x: numpy.full((len(x), 3), (0.2, 0.4, 0.8))}


def has_colors(report, columns, area, painted_as):
    (column,) = (c for c in EXPECTED if c + "_r" in columns)
    expected, found = EXPECTED[column](positions_of(columns)), numpy.stack([columns[f"{column}_{k}"] for k in "rgb"], axis=1)
    return is_unchanged(report, columns, area, None) and abs(found - expected).max() < 0.02 * max(1, expected.max())


SIDES, RADIUS, HEIGHT, FAR = 32, 0.3, 3, 5.8e6


def tubes():
    """Open tubes at the origin and far from it: their rims are vertices of one triangle each, and shorter than a float there."""
    angles = 2 * numpy.pi * numpy.arange(SIDES) / SIDES
    rim = numpy.c_[RADIUS * numpy.cos(angles), RADIUS * numpy.sin(angles), 0 * angles]
    k = numpy.arange(SIDES)
    after = (k + 1) % SIDES
    faces = numpy.r_[numpy.c_[k, after, SIDES + after], numpy.c_[k, SIDES + after, SIDES + k]]
    return [(numpy.r_[rim, rim + (0, 0, HEIGHT)] + (at, 0, 0), faces) for at in (0, FAR)]


def is_tubes(report, columns, area, painted_as):
    x = positions_of(columns)
    away = abs(numpy.min([numpy.hypot(x[:, 0] - at, x[:, 1]) for at in (0, FAR)], axis=0) - RADIUS)
    whole = 2 * HEIGHT * SIDES * 2 * RADIUS * numpy.sin(numpy.pi / SIDES)
    return away.max() < RADIUS * (1 - numpy.cos(numpy.pi / SIDES)) + 1e-3 and abs(report["surface"]["area"] / whole - 1) < 1e-5


def loop_around(faces):
    """The border of triangles, in their direction."""
    sides = {(int(f[k]), int(f[(k + 1) % 3])) for f in faces for k in range(3)}
    after = {a: b for a, b in sides if (b, a) not in sides}
    loop = [next(iter(sorted(after)))]
    while after[loop[-1]] != loop[0]:
        loop.append(after[loop[-1]])
    return loop


def keyhole():
    """The balls, with a polygon around six triangles: the way between both borders is there twice."""
    v, f = joined()
    inner = f[(f == 100).any(axis=1)]
    both = f[numpy.isin(f, inner).any(axis=1)]
    outer, hole = loop_around(both), loop_around(inner)[::-1]
    start = next(k for k, a in enumerate(outer) if any({a, hole[0]} <= set(t) for t in both.tolist()))
    outer = outer[start:] + outer[:start]
    kept = [t for t in f.tolist() if t not in both.tolist()] + inner.tolist()
    return v, [*kept, [*outer, outer[0], *hole, hole[0]]]


def has_keyhole(report, columns, area, painted_as):
    return is_right(report, positions_of(columns)) and abs(report["surface"]["area"] / area - 1) < OF_KEYHOLE


def keyhole_files():
    def words(faces, count=True):
        return "".join(" ".join(map(str, ([len(f)] if count else []) + list(f))) + "\n" for f in faces)

    def collada_of(v, f):
        text = library_meshes.collada_text([library_meshes.Part(v, [[0, 1, 2]])])
        return re.sub('<triangles count="1">(.*)<p>.*</p></triangles>', rf'<polylist count="{len(f)}">\1<vcount>{" ".join(str(len(p)) for p in f)}</vcount>'
                      rf"<p>{' '.join(str(k) for p in f for k in p)}</p></polylist>", text)

    def fbx_of(v, f):
        text = library_meshes.fbx_text([library_meshes.Part(v, [[0, 1, 2]])])
        numbers = [str(n) for p in f for n in (*p[:-1], -p[-1] - 1)]
        return text.replace("PolygonVertexIndex: *3 {\na: 0,1,-3\n", f"PolygonVertexIndex: *{len(numbers)} {{\na: {','.join(numbers)}\n")
    texts = {"obj": ("m.obj", lambda v, f: rows(v, "v %r %r %r\n") + "".join("f " + " ".join(str(k + 1) for k in p) + "\n" for p in f)),
             "ply": ("m.ply", lambda v, f: f"ply\nformat ascii 1.0\nelement vertex {len(v)}\nproperty double x\nproperty double y\nproperty double z\n"
                     f"element face {len(f)}\nproperty list uchar int vertex_indices\nend_header\n" + rows(v, "%r %r %r\n") + words(f)),
             "off": ("m.off", lambda v, f: f"OFF\n{len(v)} {len(f)} 0\n" + rows(v, "%r %r %r\n") + words(f)),
             "vtk": ("m.vtk", lambda v, f: f"# vtk DataFile Version 3.0\nballs\nASCII\nDATASET POLYDATA\nPOINTS {len(v)} double\n" + rows(v, "%r %r %r\n") +
                     f"POLYGONS {len(f)} {sum(len(p) + 1 for p in f)}\n" + words(f)),
             "collada": ("m.dae", collada_of), "fbx": ("m.fbx", fbx_of)}
    for name, (file, text) in texts.items():
        yield name, lambda folder, file=file, text=text: ((folder / file).write_text(text(*keyhole())), mesh(file))[1]

    def vtp_of(folder):
        v, f = keyhole()
        write_xml(folder / "m.vtp", [(v, {"Polys": f})])
        return mesh("m.vtp")
    yield "vtp", vtp_of


def libraries(folder):
    surface = rewritten("obj", put("mtllib balls.mtl", "mtllib a.mtl b.mtl"))(folder)
    for name, material in (("a.mtl", "other"), ("b.mtl", "grey")):
        (folder / name).write_text(f"newmtl {material}\nKd 0.25 0.5 0.75\n")
    return {**surface, "attributes": [{"name": "base_color", "as": "c"}]}


def has_color_of_library(report, columns, area, painted_as):
    return is_unchanged(report, columns, area, None) and all(abs(columns["c_" + k] - value).max() < 0.01 for k, value in zip("rgb", (0.25, 0.5, 0.75)))


def zarr_named(version):
    """An array whose name is not ASCII."""
    def write(folder):
        surface = rewritten(f"zarr {version}", put('"path": "0"', f'"path": "{NOT_ASCII}"'))(folder)
        (folder / "v.zarr/0").rename(folder / "v.zarr" / NOT_ASCII)
        return surface
    return write


def data_named(name):
    """Data in files whose names are not ASCII."""
    (change,) = NAMES[name].values()

    def also(surface, folder):
        for path in list(folder.glob("*.raw")):
            path.rename(path.with_name(path.name.replace("v 50%", NOT_ASCII).replace("s ", f"{NOT_ASCII} ")))
        return surface
    return rewritten(name, change, also)


def zarr_of_version_1(folder):
    base_of("zarr 2")(folder)
    for path in ("v.zarr/.zgroup", "v.zarr/0/.zarray"):
        (folder / path).write_text((folder / path).read_text().replace('"zarr_format": 2', '"zarr_format": 1'))
    return volume("v.zarr")


def grid_named(field, kind):
    """Of OpenVDB and OpenEXR: a grid or channel whose name is not ASCII."""
    return next(write for found, way, write in FORMATS[kind](random.Random(1)) if (found, way) == (field, "is not ASCII"))


def kinds():
    """(format, kind, way, write)"""
    for kind, ways in SAMPLES.items():
        for way, change in ways.items():
            for name in VOLUMES:
                yield name, kind, way, with_samples(name, change)
    for name in MARKED:
        yield name, MARK, "UTF-8", rewritten(name, lambda data: BOM + data)
    for name in ("vtp", "gifti", "collada", "3mf", "ome"):
        for codec, declared_as in ENCODINGS.items():
            if name != "ome" or "utf" not in codec:  # a description ends at a byte 0
                yield name, ENCODING, codec, rewritten(name, lambda data, codec=codec, declared_as=declared_as: in_encoding(data, codec, declared_as))
    for name, endings in MISNAMED.items():
        for ending in endings:
            yield name, ENDING, ending, renamed(name, ending)
    for name, file in PAINTED.items():
        yield name, NAME, "of values", named(name, file)
    for row in by_table(NAME, NAMES):
        yield (*row[:3], data_named(row[0])) if row[2] == "of data" else row
    for version in (2, 3):
        yield f"zarr {version}", NAME, "of an array", zarr_named(version)
    yield "vdb", NAME, "of a grid", grid_named("name", "vdb")
    yield "exr", NAME, "of a channel", grid_named("channel", "exr")
    yield from by_table(OLDER, OLDER_FILES)
    yield "zarr 2", OLDER, "1", zarr_of_version_1
    for name, change in BLANKS.items():
        yield name, BLANK, "of all", rewritten(name, change)
    yield from by_table(TRANSFORM, TRANSFORMS)
    yield from by_table(SKIPPED, ALL_SKIPPED)
    yield "3mf", ZIP64, "sizes", rewritten("3mf", lambda model: model, zip64=True)
    yield "obj", OLD_FACES, "fo", rewritten("obj", put("\nf ", "\nfo "))
    yield "obj", INDEX_0, "counted from 0", rewritten("obj", put("\nf 1 ", "\nf 0 "))
    yield "obj", LIBRARIES, "two", libraries
    for name, way, write in color_files():
        yield name, COLORS, way, write
    for name in ("obj", "ply", "stl text", "off", "vtk", "vtp", "gifti", "gltf", "3mf", "collada", "fbx"):
        yield name, RIMS, "tubes", with_parts(name, tubes())
    for name, write in keyhole_files():
        yield name, TWICE_A_CORNER, "around a hole", write


CANNOT = "cannot occur"


# ---- running and judging

def run(worker, write):
    """(report or None, message, columns of points.ply)"""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        surface = dict(write(folder))
        grid = {"grid": surface.pop("grid")} if "grid" in surface else {}
        attributes = {"attributes": surface.pop("attributes")} if "attributes" in surface else {}
        spec = {"version": 1, "surface": surface, "sampling": {"count": 120, **grid}, "output": {"preview": False},
                "solver": {"threads": 1, "max_sweeps": 1}, **attributes}
        done = subprocess.run([worker, "run", "-", "--output", folder / "out"], input=json.dumps(spec), cwd=folder, capture_output=True,
                              text=True, timeout=TIMEOUT_S)
        if not (folder / "out/report.json").exists():
            return None, done.stderr or done.stdout or f"status {done.returncode}", None
        report = json.loads((folder / "out/report.json").read_text())
        if not (folder / "out/points.ply").exists():
            return None, report.get("message", ""), None
        return report, "", read_columns((folder / "out/points.ply").read_bytes())


def positions_of(columns):
    return numpy.stack([columns[a] for a in "xyz"], axis=1)


def is_right(report, positions, area=None):
    """`area`: that of the file without a variation; a missing triangle changes it."""
    away = numpy.min([numpy.abs(numpy.linalg.norm(positions - c, axis=1) - r) for c, r in BALLS], axis=0)
    return away.max() < AWAY and abs(report["surface"]["area"] / (area or AREA) - 1) < (SAME_AREA["mesh" in report["surface"]] if area else OF_AREA)


def is_unchanged(report, columns, area, painted_as):
    """`painted_as`: the points of the painted file without a variation."""
    if painted_as is not None:
        return numpy.array_equal(positions_of(columns), painted_as)
    return is_right(report, positions_of(columns), area)


def is_beside_jump(report, columns, area, painted_as):
    return is_right(report, positions_of(columns)) and abs(report["surface"]["area"] / area - 1) < OF_JUMP


# What is right of the kinds that change the surface or add values.
RIGHT = {**{kind: is_beside_jump for kind in SAMPLES}, COLORS: has_colors, RIMS: is_tubes, TWICE_A_CORNER: has_keyhole, LIBRARIES: has_color_of_library}


def judge(worker, write, usual, area=None, painted_as=None, kind=""):
    """`right`, `warned`, `refused`, or a fault: `wrong` points without a new warning, `crashed`."""
    report, message, columns = run(worker, write)
    if report is None:
        return ("refused" if '"code"' in message or "input" in message else "crashed"), message
    if RIGHT.get(kind, is_unchanged)(report, columns, area, painted_as):
        return "right", ""
    if any(r["criterion"] == "ringing" for r in report["outcome_reasons"]):
        return "warned", "ringing"
    if kind in SAMPLES:
        return "wrong", f"area {report['surface']['area']:.5g}"
    new = [w for w in report["surface"]["warnings"] if w not in usual and "walls thinner" not in w]  # which says nothing of the file
    return ("warned", new[0]) if new else ("wrong", f"area {report['surface']['area']:.5g}")


def variations(seed, names=None):
    """(format, field, way, write), the base of each format first, with an empty field."""
    for name, make in FORMATS.items():
        if not names or name in names:
            for field, way, write in make(random.Random(seed)):
                yield name, field, way, write
    for name, field, way, write in kinds():
        if not names or name in names:
            yield name, field, way, write


def chosen(seed, count, names=None, of_kinds=False):
    """`count` of the variations, spread over formats and fields; the base of each format is always there. `of_kinds`: those of kinds()."""
    all_of_them = list(variations(seed, names))
    if of_kinds:
        all_of_them = [v for v in all_of_them if not v[1] or v[1] in CAN_HAVE]
        count = 0
    bases = [v for v in all_of_them if not v[1]]
    groups = collections.defaultdict(list)
    rng = random.Random(seed)
    for v in all_of_them:
        if v[1]:
            groups[v[0], v[1]].append(v)
    for group in groups.values():
        rng.shuffle(group)
    picked = []
    while any(groups.values()) and (not count or len(picked) < count):
        keys = [k for k in groups if groups[k]]
        rng.shuffle(keys)
        for key in keys:
            picked.append(groups[key].pop())
    return bases, picked[:count] if count else picked


def judged(worker, seed, count, names=None, report=print, of_kinds=False):
    """Runs variations; [(format, field, way, verdict)]. Reports the faults."""
    bases, picked = chosen(seed, count, names, of_kinds)
    usual, area, exact, found = {}, {}, {}, []
    for name, _, _, write in bases:
        base, message, columns = run(worker, write)
        assert base is not None and is_right(base, positions_of(columns)), (name, message, base and base["surface"])
        usual[name], area[name] = base["surface"]["warnings"], base["surface"]["area"]
        exact[name] = positions_of(columns) if name.startswith("painted") else None
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        verdicts = pool.map(lambda v: judge(worker, v[3], usual[v[0]], area[v[0]], exact[v[0]], v[1]), picked)
        for (name, field, way, _), (verdict, why) in zip(picked, verdicts):
            found.append((name, field, way, verdict))
            if verdict in FAULTS:
                report(f"{name}: {field}: {way}: {verdict}: {why.strip()}")
    return found


def count_by_format(found):
    """Number of each verdict, by format."""
    table = collections.defaultdict(collections.Counter)
    for name, _, _, verdict in found:
        table[name][verdict] += 1
    return table


def check(worker, seed, count, names=None, report=print):
    """Runs variations; (number of each verdict by format, faults)."""
    found = judged(worker, seed, count, names, report)
    return count_by_format(found), [row for row in found if row[3] in FAULTS]


# ---- tables

TO_ITS_END = {"comma", "text behind", "word behind", "number behind", "a number less", "exponent", "a tail", "a short tail",
              "a blank behind \\"}


def question_of(way):
    """The question that a way of varying a field asks of its reader."""
    if way.endswith(" only"):
        return "one_only"
    if way.startswith(("twice", "contradicted by")) or way in ("matrix and translation", "has two parents"):
        return "twice"
    if "declared: " in way:
        return "contradicts"
    return "to_its_end" if way in TO_ITS_END else "not_understood"


def write_by_format(path, table):
    with open(path, "w", newline="", encoding="utf-8") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(("format", "variations", *VERDICTS))
        total = collections.Counter()
        for name, counts in table.items():
            out.writerow((name, sum(counts.values()), *(counts[v] for v in VERDICTS)))
            total += counts
        out.writerow(("all", sum(total.values()), *(total[v] for v in VERDICTS)))


def write_by_field(path, found):
    """What became of each field, for each question. `places`: of the same field, each varied alone."""
    fields = collections.defaultdict(lambda: collections.defaultdict(set))
    places = collections.defaultdict(collections.Counter)
    for name, field, way, verdict in found:
        fields[name, field][question_of(way)].add(verdict)
        places[name, field][re.sub(r" \d+ only$", " only", way)] += 1
    with open(path, "w", newline="", encoding="utf-8") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(("format", "field", "places", *QUESTIONS))
        for (name, field), answers in sorted(fields.items()):
            out.writerow((name, field.strip(), max(places[name, field].values()),
                          *(" or ".join(v for v in VERDICTS if v in answers[q]) for q in QUESTIONS)))


def write_by_kind(path, found):
    """What became of each kind in each reader that can have it."""
    table = collections.defaultdict(set)
    for name, field, _, verdict in found:
        for reader, begin in READERS.items() if field in CAN_HAVE else ():
            if name.removeprefix("painted ").startswith(begin):
                table[field, reader].add(verdict)
    assert set(table) == {(kind, reader) for kind, readers in CAN_HAVE.items() for reader in readers}, "a kind was not measured, or cannot occur"
    with open(path, "w", newline="", encoding="utf-8") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(("kind", *READERS))
        for kind in sorted(CAN_HAVE):
            out.writerow((kind, *(" or ".join(v for v in VERDICTS if v in table[kind, n]) or CANNOT for n in READERS)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--cases", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--formats", type=lambda text: text.split(","))
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--by-format", type=pathlib.Path)
    parser.add_argument("--by-field", type=pathlib.Path)
    parser.add_argument("--by-kind", type=pathlib.Path)
    parser.add_argument("--kinds", action="store_true", help="all variations of kinds() instead")
    options = parser.parse_args()
    if options.list:
        found = collections.Counter((name, field) for name, field, _, _ in variations(options.seed, options.formats) if field)
        for (name, field), count in found.items():
            print(f"{name}\t{field}\t{count}")
        print(sum(found.values()))
        return 0
    found = judged(options.build.resolve() / "hexad-worker", options.seed, options.cases, options.formats, of_kinds=options.kinds)
    table, faults = count_by_format(found), [row for row in found if row[3] in FAULTS]
    if options.by_format:
        write_by_format(options.by_format, table)
    if options.by_field:
        write_by_field(options.by_field, found)
    if options.by_kind:
        write_by_kind(options.by_kind, found)
    for name, counts in table.items():
        print(f"{name:24}" + "".join(f"{verdict} {count:5}  " for verdict, count in sorted(counts.items())))
    print(f"{sum(sum(c.values()) for c in table.values())} variations, seed {options.seed}: {len(faults)} wrong")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
