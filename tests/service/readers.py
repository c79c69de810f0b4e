# SPDX-License-Identifier: Apache-2.0
"""Readers of hexad's results that share no code with it: PLY, PNG and EXR by their definitions."""
import struct
import zlib

import numpy

PLY_DEFAULT = "x y z nx ny nz spacing_local".split()
PLY_GRADED = "x y z nx ny nz spacing spacing_local".split()
PLY_ALL = "x y z nx ny nz kappa kappa1 kappa2 alpha energy spacing spacing_local".split()
EVERY = {"properties": ["all"]}  # output.ply of a spec
PLY_OF_PATCHES = ["feature", "patch"]


class Points:
    """A points.ply, its header as text lines; raises when it is not as the contract says."""

    def __init__(self, data):
        head, mark, body = data.partition(b"end_header\n")
        assert mark, "a PLY header without an end"
        self.header = head.decode("ascii").splitlines()
        assert self.header[0] == "ply"
        kind, self.format, version = self.header[1].split()
        assert (kind, version) == ("format", "1.0")
        words = [line.split() for line in self.header[2:]]
        words = [w for w in words if w[0] != "comment"]
        assert words[0][:2] == ["element", "vertex"] and all(w[0] == "property" for w in words[1:])
        names = [w[2] for w in words[1:]]
        own = names[:-1] if names[-1] == "kappa_defined" else names  # of surfaces with a mesh
        self.of_patches = own[-2:] == PLY_OF_PATCHES
        own = own[:-2] if self.of_patches else own
        assert own in (PLY_DEFAULT, PLY_GRADED, PLY_ALL, [*PLY_ALL, "kappa_scale"])
        (self.type,) = {w[1] for w in words[1:][:len(own)]}
        assert {w[1] for w in words[1:][len(own):]} <= {"int"} and self.format in ("ascii", "binary_little_endian")
        self.count = int(words[0][2])
        table = read_columns(data)
        assert all(len(column) == self.count and numpy.isfinite(column).all() for column in table.values())
        self.position = numpy.stack([table[a] for a in "xyz"], axis=1)
        self.normal = numpy.stack([table["n" + a] for a in "xyz"], axis=1)
        for name in names[6:]:
            setattr(self, name, table[name])


def read_columns(data):
    """{name: array} of the vertices of a points.ply with properties of any types."""
    head, mark, body = data.partition(b"end_header\n")
    assert mark, "a PLY header without an end"
    words = [line.split() for line in head.decode("ascii").splitlines()]
    count = int([w for w in words if w[:2] == ["element", "vertex"]][0][2])
    kinds = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4", "uint": "<u4"}
    types = [(w[2], kinds[w[1]]) for w in words if w[0] == "property"]
    if words[1][1] == "ascii":
        assert body.count(b"\n") == count
        rows = numpy.fromstring(body.decode("ascii"), sep=" ").reshape(count, len(types))
        return {name: rows[:, k] for k, (name, _) in enumerate(types)}
    table = numpy.frombuffer(body, types)
    assert len(table) == count
    return {name: table[name].astype(float) for name, _ in types}


def _read_faces(data):
    """(names of the vertices' properties, vertices, of each face the count of its corners, these, and its other properties)."""
    head, mark, body = data.partition(b"end_header\n")
    assert mark, "a PLY header without an end"
    words = [line.split() for line in head.decode("ascii").splitlines() if not line.startswith("comment")]
    at = [w[:2] for w in words].index(["element", "face"])
    assert words[0] == ["ply"] and words[2][:2] == ["element", "vertex"]
    assert words[at + 1] == ["property", "list", "uchar", "int", "vertex_indices"]
    count, faces, more = int(words[2][2]), int(words[at][2]), words[at + 2:]
    names = [w[2] for w in words[3:at]]
    if words[1][1] == "ascii":
        lines = body.decode("ascii").splitlines()
        assert len(lines) == count + faces
        vertices = numpy.array([[float(v) for v in line.split()] for line in lines[:count]])
        rows = numpy.array([[int(v) for v in line.split()] for line in lines[count:]])
    else:
        kinds = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4", "uint": "<u4"}
        table = numpy.frombuffer(body, [(w[2], kinds[w[1]]) for w in words[3:at]], count)
        vertices = numpy.stack([table[name].astype(float) for name in names], axis=1)
        packed = numpy.frombuffer(body, [("n", "u1"), ("corner", "<i4", 3)] + [(w[2], kinds[w[1]]) for w in more],
                                  offset=table.nbytes)
        assert len(packed) == faces
        rows = numpy.c_[packed["n"], packed["corner"], *(packed[w[2]].astype("i8") for w in more)]
    assert (rows[:, 0] == 3).all() and rows.shape[1] == 4 + len(more)
    return names, vertices, rows, [w[2] for w in more]


def read_mesh(data):
    """(names of the vertices' properties, vertices, triangles) of a mesh.ply."""
    names, vertices, rows, _ = _read_faces(data)
    return names, vertices, rows[:, 1:4]


def read_face_labels(data):
    """Of each triangle of a mesh.ply between labels both."""
    _, _, rows, names = _read_faces(data)
    assert names == ["label_a", "label_b"]
    return rows[:, 4:]


def read_png(data):
    """Rows of bytes (height, width * channels), every checksum verified, filters undone."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, packed, header = 8, b"", None
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + length]
        assert zlib.crc32(kind + body) == struct.unpack(">I", data[at + 8 + length:at + 12 + length])[0]
        at += 12 + length
        if kind == b"IHDR":
            header = struct.unpack(">IIBBBBB", body)
        elif kind == b"IDAT":
            packed += body
    assert kind == b"IEND" and at == len(data)
    width, height, depth, colour, _, _, interlace = header
    assert depth == 8 and interlace == 0
    pixel = {0: 1, 2: 3, 4: 2, 6: 4}[colour]
    lines = numpy.frombuffer(zlib.decompress(packed), numpy.uint8).reshape(height, 1 + width * pixel)
    rows = numpy.zeros((height, width * pixel), numpy.uint8)
    above = bytearray(width * pixel)
    for y, line in enumerate(lines):
        above = _unfilter(line[0], bytearray(line[1:].tobytes()), above, pixel)
        rows[y] = numpy.frombuffer(bytes(above), numpy.uint8)
    return width, height, rows


def _unfilter(kind, line, above, pixel):
    if kind == 1:  # of each channel the sum of all before
        sums = numpy.cumsum(numpy.frombuffer(line, numpy.uint8).reshape(-1, pixel), axis=0, dtype=numpy.uint8)
        return bytearray(sums.tobytes())
    if kind == 2:
        return bytearray((numpy.frombuffer(line, numpy.uint8) + numpy.frombuffer(above, numpy.uint8)).tobytes())
    for x in range(len(line) if kind else 0):
        a = line[x - pixel] if x >= pixel else 0
        b = above[x]
        c = above[x - pixel] if x >= pixel else 0
        if kind == 3:
            guess = (a + b) // 2
        else:
            guess = min((abs(b - c), 0, a), (abs(a - c), 1, b), (abs(a + b - 2 * c), 2, c))[2]
        line[x] = (line[x] + guess) & 255
    return line


def exr_attributes(data):
    """The bytes of a file's attributes by name."""
    return _exr_header(data)[0]


def _exr_header(data):
    assert struct.unpack("<II", data[:8]) == (20000630, 2)  # one part, scan lines, short names
    at, attributes = 8, {}
    while data[at]:
        name, kind = data[at:].split(b"\0", 2)[:2]
        at += len(name) + len(kind) + 2
        (size,) = struct.unpack("<i", data[at:at + 4])
        attributes[name.decode()] = data[at + 4:at + 4 + size]
        at += 4 + size
    return attributes, at + 1


def _exr_channels(data):
    at, channels = 0, []
    while data[at]:
        name = data[at:].split(b"\0", 1)[0]
        at += len(name) + 1
        kind, _, x, y = struct.unpack("<iB3xii", data[at:at + 16])
        assert (x, y) == (1, 1)
        channels.append((name.decode(), {0: "<u4", 1: "<f2", 2: "<f4"}[kind]))
        at += 16
    return channels


def _exr_unzipped(packed, length):
    """The bytes of a chunk, as OpenEXR describes its ZIP: differences to the byte before, first bytes of pairs before second."""
    if len(packed) == length:  # packing would have made it longer
        return packed
    bytes_ = numpy.frombuffer(zlib.decompress(packed), numpy.uint8)
    assert len(bytes_) == length
    summed = numpy.cumsum(numpy.r_[bytes_[:1], bytes_[1:] - numpy.uint8(128)], dtype=numpy.uint8)
    whole = numpy.empty(length, numpy.uint8)
    half = (length + 1) // 2
    whole[::2], whole[1::2] = summed[:half], summed[half:]
    return whole.tobytes()


EXR_LINES = {0: 1, 2: 1, 3: 16}  # of a chunk: without compression, ZIPS, ZIP


def read_exr(data):
    """(width, height, {channel: array}) of a scan line file."""
    attributes, at = _exr_header(data)
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    compression, = attributes["compression"]
    most, chunks = EXR_LINES[compression], -(-height // EXR_LINES[compression])
    channels = _exr_channels(attributes["channels"])
    images = {name: numpy.empty((height, width), kind) for name, kind in channels}
    line = sum(width * numpy.dtype(kind).itemsize for _, kind in channels)
    for offset in struct.unpack(f"<{chunks}Q", data[at:at + 8 * chunks]):
        y, size = struct.unpack("<ii", data[offset:offset + 8])
        lines = min(most, y1 + 1 - y)
        raw = data[offset + 8:offset + 8 + size]
        if compression:
            raw = _exr_unzipped(raw, lines * line)
        assert len(raw) == lines * line
        start = 0
        for row in range(lines):
            for name, kind in channels:
                images[name][y + row - y0] = numpy.frombuffer(raw, kind, width, start)
                start += width * numpy.dtype(kind).itemsize
    return width, height, images
