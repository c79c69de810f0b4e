# SPDX-License-Identifier: Apache-2.0
"""Dense volumes as files: writers and readers of NRRD, NIfTI and OpenEXR by their definitions, for tests. Arrays are
indexed [x, y, z]; matrices are 4x4, index to world. Nothing here is hexad's."""
import gzip
import re
import struct
import zlib

import numpy

NRRD_TYPES = {"i1": "int8", "u1": "uint8", "i2": "int16", "u2": "uint16", "i4": "int32", "u4": "uint32", "i8": "int64",
              "u8": "uint64", "f4": "float", "f8": "double"}
NIFTI_TYPES = {"u1": 2, "i2": 4, "i4": 8, "f4": 16, "f8": 64, "i1": 256, "u2": 512, "u4": 768, "i8": 1024, "u8": 1280}


def _kind(values):
    return values.dtype.str[1:]


def nrrd_header(values, matrix=None, encoding="raw", endian="little", extra=()):
    """The lines, without the empty one that ends them."""
    lines = ["NRRD0005", "# a comment", f"type: {NRRD_TYPES[_kind(values)]}", "dimension: 3",
             "sizes: " + " ".join(map(str, values.shape)), f"encoding: {encoding}", f"endian: {endian}"]
    if matrix is not None:
        vectors = " ".join("(" + ",".join(repr(float(v)) for v in matrix[:3, k]) + ")" for k in range(3))
        lines += ["space: left-posterior-superior", f"space directions: {vectors}",
                  "space origin: (" + ",".join(repr(float(v)) for v in matrix[:3, 3]) + ")"]
    return lines + list(extra)


def nrrd_data(values, encoding="raw", endian="little"):
    if encoding == "ascii":
        return "\n".join(repr(v) for v in values.flatten(order="F").tolist()).encode()
    data = values.astype(("<" if endian == "little" else ">") + _kind(values)).tobytes(order="F")
    return gzip.compress(data) if encoding == "gzip" else data


def write_nrrd(path, values, matrix=None, encoding="raw", endian="little", extra=()):
    header = "\n".join(nrrd_header(values, matrix, encoding, endian, extra)) + "\n\n"
    path.write_bytes(header.encode() + nrrd_data(values, encoding, endian))


def write_nifti(path, values, matrix=None, version=1, endian="<", quaternion=None, voxel=(1, 1, 1), slope=0, intercept=0,
                pair=None):
    """`matrix` as the sform, or a quaternion (b, c, d, x, y, z, qfac) with the voxel's sizes as the qform, or neither.
    With `pair` the data go there, and the header says so."""
    dim = [3, *values.shape, 1, 1, 1, 1]
    qfac = quaternion[6] if quaternion else 1
    pixdim = [qfac, *voxel, 0, 0, 0, 0]
    rows = [list(map(float, row)) for row in matrix[:3]] if matrix is not None else [[0.0] * 4] * 3
    codes = (1 if quaternion else 0, 1 if matrix is not None else 0)
    q = list(map(float, (quaternion or (0,) * 7)[:6]))
    bits = values.dtype.itemsize * 8
    if version == 1:
        h = struct.pack(endian + "i35xb", 348, 0) + struct.pack(endian + "8h", *dim)
        h += struct.pack(endian + "3f4h", 0, 0, 0, 0, NIFTI_TYPES[_kind(values)], bits, 0)
        h += struct.pack(endian + "8f", *pixdim) + struct.pack(endian + "3f", 0 if pair else 352, slope, intercept)
        h += struct.pack(endian + "h2b4f2i", 0, 0, 2, 0, 0, 0, 0, 0, 0) + bytes(80 + 24)
        h += struct.pack(endian + "2h6f", *codes, *q) + b"".join(struct.pack(endian + "4f", *r) for r in rows)
        h += bytes(16) + (b"ni1\0" if pair else b"n+1\0")
        assert len(h) == 348
    else:
        h = struct.pack(endian + "i8s2h", 540, b"ni2\0\r\n\x1a\n" if pair else b"n+2\0\r\n\x1a\n",
                        NIFTI_TYPES[_kind(values)], bits)
        h += struct.pack(endian + "8q3d8d", *dim, 0, 0, 0, *pixdim) + struct.pack(endian + "q", 0 if pair else 544)
        h += struct.pack(endian + "2d4d2q", slope, intercept, 0, 0, 0, 0, 0, 0) + bytes(80 + 24)
        h += struct.pack(endian + "2i6d", *codes, *q) + b"".join(struct.pack(endian + "4d", *r) for r in rows)
        h += struct.pack(endian + "3i16s", 0, 2, 0, b"") + bytes(1 + 15)
        assert len(h) == 540
    data = values.astype(endian + _kind(values)).tobytes(order="F")
    if pair:
        path.write_bytes(h)
        pair.write_bytes(data)
    else:
        data = h + bytes(4) + data
        path.write_bytes(gzip.compress(data) if path.suffix == ".gz" else data)


META_TYPES = {"i1": "MET_CHAR", "u1": "MET_UCHAR", "i2": "MET_SHORT", "u2": "MET_USHORT", "i4": "MET_INT", "u4": "MET_UINT",
              "i8": "MET_LONG_LONG", "u8": "MET_ULONG_LONG", "f4": "MET_FLOAT", "f8": "MET_DOUBLE"}


def meta_image_fields(values, matrix=None, big=False, packed=False, text=False):
    """Lines `key = value` by key, the last of them for data that follow; a caller may change and add some."""
    fields = {"ObjectType": "Image", "NDims": "3", "BinaryData": str(not text), "BinaryDataByteOrderMSB": str(big),
              "CompressedData": str(packed), "DimSize": " ".join(map(str, values.shape[:3]))}
    if matrix is not None:
        steps = numpy.linalg.norm(matrix[:3, :3], axis=0)
        fields["TransformMatrix"] = " ".join(repr(float(v)) for v in (matrix[:3, :3] / steps).T.flatten())
        fields["Offset"] = " ".join(repr(float(v)) for v in matrix[:3, 3])
        fields["ElementSpacing"] = " ".join(repr(float(v)) for v in steps)
    if values.ndim == 4:
        fields["ElementNumberOfChannels"] = str(values.shape[3])
    return {**fields, "ElementType": META_TYPES[_kind(values)], "ElementDataFile": "LOCAL"}


def meta_image_data(values, big=False, packed=False, text=False):
    flat = values.transpose(2, 1, 0, *range(3, values.ndim)).flatten()
    if text:
        return (" ".join(repr(v) for v in flat.tolist()) + "\n").encode()
    data = flat.astype((">" if big else "<") + _kind(values)).tobytes()
    return zlib.compress(data) if packed else data


def write_meta_image(path, values, matrix=None, fields=None, data_path=None, before=b"", **how):
    """`fields` replace others of the same key, or are added before the last line; those that are None are left out. `before`: bytes
    before the data."""
    all_of_them = meta_image_fields(values, matrix, **how)
    last = all_of_them.pop("ElementDataFile") if data_path is None else data_path.name
    lines = {**{k: v for k, v in all_of_them.items() if k != "ElementDataFile"}, **(fields or {}), "ElementDataFile": last}
    head = "".join(f"{key} = {value}\n" for key, value in lines.items() if value is not None).encode()
    data = before + meta_image_data(values, **how)
    path.write_bytes(head + (data if data_path is None else b""))
    if data_path is not None:
        data_path.write_bytes(data)


# Of a NIfTI-1 header: where a field is, and of which type.
NIFTI_FIELDS = {"dim_info": (39, "B"), "intent_p1": (56, "f"), "intent_p2": (60, "f"), "intent_p3": (64, "f"),
                "intent_code": (68, "h"), "slice_start": (74, "h"), "pixdim0": (76, "f"), "pixdim1": (80, "f"),
                "pixdim2": (84, "f"), "pixdim3": (88, "f"), "pixdim4": (92, "f"),
                "vox_offset": (108, "f"), "scl_slope": (112, "f"), "scl_inter": (116, "f"), "slice_end": (120, "h"),
                "slice_code": (122, "B"), "xyzt_units": (123, "B"), "cal_max": (124, "f"), "cal_min": (128, "f"),
                "slice_duration": (132, "f"), "toffset": (136, "f"), "descrip": (148, "80s"), "aux_file": (228, "24s"),
                "qform_code": (252, "h"), "sform_code": (254, "h"), "quatern_b": (256, "f"), "quatern_c": (260, "f"),
                "quatern_d": (264, "f"), "qoffset_x": (268, "f"), "qoffset_y": (272, "f"), "qoffset_z": (276, "f"),
                "intent_name": (328, "16s")}
# The same of NIfTI-2.
NIFTI2_FIELDS = {"intent_p1": (80, "d"), "intent_p2": (88, "d"), "intent_p3": (96, "d"), "pixdim0": (104, "d"),
                 "pixdim1": (112, "d"), "pixdim2": (120, "d"), "pixdim3": (128, "d"), "pixdim4": (136, "d"),
                 "vox_offset": (168, "q"), "scl_slope": (176, "d"), "scl_inter": (184, "d"), "cal_max": (192, "d"),
                 "cal_min": (200, "d"), "slice_duration": (208, "d"), "toffset": (216, "d"), "slice_start": (224, "q"),
                 "slice_end": (232, "q"), "descrip": (240, "80s"), "aux_file": (320, "24s"), "qform_code": (344, "i"),
                 "sform_code": (348, "i"), "quatern_b": (352, "d"), "quatern_c": (360, "d"), "quatern_d": (368, "d"),
                 "qoffset_x": (376, "d"), "qoffset_y": (384, "d"), "qoffset_z": (392, "d"), "slice_code": (496, "i"),
                 "xyzt_units": (500, "i"), "intent_code": (504, "i"), "intent_name": (508, "16s"), "dim_info": (524, "B")}


def change_nifti(path, fields, extensions=(), version=1, endian="<"):
    """Changes fields of the single file that write_nifti made, and puts extensions (code, bytes) between header and data."""
    raw = bytearray(path.read_bytes())
    head = 348 if version == 1 else 540
    blocks = b"".join(struct.pack(endian + "2i", 8 + len(body), code) + body for code, body in extensions)
    raw[head:head + 4] = bytes([1 if blocks else 0, 0, 0, 0])
    raw[head + 4:head + 4] = blocks
    known = NIFTI_FIELDS if version == 1 else NIFTI2_FIELDS
    for name, value in {"vox_offset": head + 4 + len(blocks), **fields}.items():
        at, kind = known[name]
        struct.pack_into(endian + kind, raw, at, value)
    path.write_bytes(raw)


def _attribute(name, kind, value):
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value


def _pack_zip(data):
    """OpenEXR's ZIP: even bytes before odd ones, differences, deflate; as it is where that is not shorter."""
    raw = numpy.frombuffer(data, numpy.uint8)
    turned = numpy.concatenate([raw[0::2], raw[1::2]]).astype(numpy.int16)
    turned[1:] = turned[1:] - turned[:-1] + 128
    packed = zlib.compress(turned.astype(numpy.uint8).tobytes())
    return packed if len(packed) < len(data) else data


EXR_TYPES = {"u4": (0, "<u4"), "f2": (1, "<f2"), "f4": (2, "<f4")}


class Part:
    """channels: arrays [x, y] by name, smaller ones have a sample for every few pixels; low: the first pixel of the data
    window; tile: (width, height), or scanlines; levels: tiled with mip-maps, each further level filled with `levels`; order: 1: rows
    from below; display: the display window; extra: further attributes."""

    def __init__(self, channels, low=(0, 0), name=None, tile=None, levels=None, compression=0, aspect=1, order=0, display=None,
                 extra=b""):
        self.channels = dict(sorted(channels.items()))
        self.low, self.name, self.tile, self.levels, self.compression = low, name, tile, levels, compression
        self.aspect, self.order, self.extra, self.display = aspect, order, extra, display or (0, 0, 99, 79)
        self.size = tuple(numpy.max([v.shape for v in channels.values()], axis=0))

    def header(self, chunks):
        x, y = self.low
        box = struct.pack("<4i", x, y, x + self.size[0] - 1, y + self.size[1] - 1)
        channels = b"".join(name.encode() + b"\0" + struct.pack("<iB3xii", EXR_TYPES[_kind(v)][0], 0, *self._steps(v))
                            for name, v in self.channels.items()) + b"\0"
        head = _attribute("channels", "chlist", channels)
        head += _attribute("compression", "compression", bytes([self.compression]))
        head += _attribute("dataWindow", "box2i", box)
        head += _attribute("displayWindow", "box2i", struct.pack("<4i", *self.display))
        head += _attribute("lineOrder", "lineOrder", bytes([self.order])) + self.extra
        head += _attribute("pixelAspectRatio", "float", struct.pack("<f", self.aspect))
        head += _attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0))
        head += _attribute("screenWindowWidth", "float", struct.pack("<f", 1))
        if self.name is not None:
            head += _attribute("name", "string", self.name.encode())
            head += _attribute("type", "string", b"tiledimage" if self.tile else b"scanlineimage")
            head += _attribute("chunkCount", "int", struct.pack("<i", len(chunks)))
        if self.tile:
            head += _attribute("tiles", "tiledesc", struct.pack("<2IB", *self.tile, 1 if self.levels is not None else 0))
        return head + b"\0"

    def _steps(self, v):
        """Columns and rows from one sample to the next."""
        return self.size[0] // v.shape[0], self.size[1] // v.shape[1]

    def _pixels(self, channels, x, y, columns, rows):
        height = max(v.shape[1] for v in channels.values())
        data = b"".join(v[x:x + columns, row * v.shape[1] // height].astype(EXR_TYPES[_kind(v)][1]).tobytes()
                        for row in range(y, min(y + rows, height)) for v in channels.values()
                        if row * v.shape[1] % height == 0)
        return _pack_zip(data) if self.compression in (2, 3) else data

    def chunks(self):
        """Each chunk without the number of its part."""
        if not self.tile:
            rows = {0: 1, 2: 1, 3: 16, 6: 32}[self.compression]
            for y in range(0, self.size[1], rows):
                data = self._pixels(self.channels, 0, y, self.size[0], rows)
                yield struct.pack("<2i", self.low[1] + y, len(data)) + data
            return
        level, channels = 0, self.channels
        while True:
            width, height = next(iter(channels.values())).shape
            for y in range(0, height, self.tile[1]):
                for x in range(0, width, self.tile[0]):
                    data = self._pixels(channels, x, y, self.tile[0], self.tile[1])
                    yield struct.pack("<5i", x // self.tile[0], y // self.tile[1], level, level, len(data)) + data
            if self.levels is None or (width == 1 and height == 1):
                return
            level += 1
            channels = {name: numpy.full((max(width // 2, 1), max(height // 2, 1)), self.levels, v.dtype)
                        for name, v in channels.items()}


def write_exr(path, *parts):
    """One part, or several with names; single parts have no name."""
    several = len(parts) > 1 or parts[0].name is not None
    chunks = [list(p.chunks()) for p in parts]
    version = 2 | (0x1000 if several else 0x200 if parts[0].tile else 0)
    head = struct.pack("<2I", 20000630, version)
    head += b"".join(p.header(c) for p, c in zip(parts, chunks)) + (b"\0" if several else b"")
    at = len(head) + 8 * sum(map(len, chunks))
    table, body = b"", b""
    for number, of_part in enumerate(chunks):
        places = [0] * len(of_part)
        for k in sorted(range(len(of_part)), reverse=parts[number].order == 1):
            places[k] = at + len(body)
            body += (struct.pack("<i", number) if several else b"") + of_part[k]
        table += struct.pack(f"<{len(places)}Q", *places)
    path.write_bytes(head + table + body)


def read_nrrd(path):
    """Values [x, y, z] as doubles and the matrix of a three-dimensional raw or gzip NRRD."""
    raw = path.read_bytes()
    head, _, body = raw.partition(b"\n\n")
    head = head.replace(b"\r", b"")
    fields = dict(m.groups() for m in re.finditer(r"^([^:#\n]+): *(.*)$", head.decode(), re.M))
    size = [int(v) for v in fields["sizes"].split()]
    types = {"unsigned char": "u1", "short": "i2", "unsigned short": "u2", "float": "f4", "double": "f8", "int16": "i2"}
    kind = (">" if fields.get("endian") == "big" else "<") + types[fields["type"]]
    name = fields.get("data file", "").split()
    if len(name) == 4:
        body = b"".join((path.parent / (name[0] % k)).read_bytes() for k in range(int(name[1]), int(name[2]) + 1))
    elif name:
        body = (path.parent / name[0]).read_bytes()
    if fields["encoding"].startswith("gz"):
        body = gzip.decompress(body)
    matrix = numpy.eye(4)
    if "space directions" in fields:
        vectors = [[float(v) for v in s.split(",")] for s in re.findall(r"\(([^)]*)\)", fields["space directions"])]
        matrix[:3, :3] = numpy.array(vectors).T
        matrix[:3, 3] = [float(v) for v in fields.get("space origin", "(0,0,0)").strip("()").split(",")]
    elif "spacings" in fields:
        matrix[:3, :3] = numpy.diag([float(v) for v in fields["spacings"].split()])
    return numpy.frombuffer(body, kind, numpy.prod(size)).reshape(size, order="F").astype(float), matrix


def read_nifti(path):
    """Values and sform of a NIfTI-1 file of one volume."""
    raw = path.read_bytes()
    raw = gzip.decompress(raw) if raw[:2] == b"\x1f\x8b" else raw
    order = "<" if raw[0:4] == struct.pack("<i", 348) else ">"
    size = struct.unpack(order + "8h", raw[40:56])[1:4]
    (code,) = struct.unpack(order + "h", raw[70:72])
    (offset,) = struct.unpack(order + "f", raw[108:112])
    assert struct.unpack(order + "h", raw[254:256])[0] > 0, "no sform"
    matrix = numpy.eye(4)
    matrix[:3] = numpy.array(struct.unpack(order + "12f", raw[280:328])).reshape(3, 4)
    kind = order + {v: k for k, v in NIFTI_TYPES.items()}[code]
    values = numpy.frombuffer(raw, kind, numpy.prod(size), int(offset))
    return values.reshape(size, order="F").astype(float), matrix


# ---- TIFF

TIFF_FORMATS = {"u": 1, "i": 2, "f": 3}


def _tiff_rational(number):
    """A number as two integers, exactly if it is a binary fraction of few digits."""
    below = 1
    while number * below != int(number * below) and below < 1 << 20:
        below *= 2
    return round(number * below), below


def _pack_bits(rows, bits):
    return b"".join(numpy.packbits((row[:, None] >> numpy.arange(bits - 1, -1, -1)) & 1).tobytes() for row in rows)


def write_tiff(path, pages, endian="<", big=False, packed=False, rows=None, tile=None, bits=None, description=None,
               resolution=None, unit=1, tags=None, page_tags=None, twice=(), contiguous=False):
    """Each page is an array [x, y]. `rows`: of a strip; `tile`: (width, height); `packed`: by Deflate; `bits`: fewer than eight;
    `resolution`: pixels in a unit along x and y; `tags`: further ones of SHORT, or in the place of these, by number; `page_tags`: the
    same for one page, by its number; `twice`: pairs (tag, value) of SHORT, each as a second entry of its tag; `contiguous`: one
    directory, that of the first page."""
    kind = pages[0].dtype.str[1:]
    word, size, count_word, entry = ("Q", 8, "Q", 20) if big else ("I", 4, "H", 12)
    head = (b"II" if endian == "<" else b"MM") + struct.pack(endian + "H", 43 if big else 42)
    if big:
        head += struct.pack(endian + "2H", 8, 0)
    out = bytearray(head + bytes(size))
    link = len(head)  # where the place of the next directory goes

    def numbers(part):
        data = _pack_bits(part.T, bits) if bits else part.astype(endian + kind).tobytes(order="F")
        return zlib.compress(data) if packed else data

    def add(data):
        at = len(out)
        out.extend(data)
        return at, len(data)

    for number, page in enumerate(pages[:1] if contiguous else pages):
        width, height = page.shape
        if tile:
            filled = numpy.zeros(tuple(-(-n // t) * t for n, t in zip(page.shape, tile)), page.dtype)
            filled[:width, :height] = page
            parts = [filled[x:x + tile[0], y:y + tile[1]] for y in range(0, height, tile[1]) for x in range(0, width, tile[0])]
        else:
            parts = [page[:, y:y + (rows or height)] for y in range(0, height, rows or height)]
        places = [add(numbers(part)) for part in parts]
        if contiguous:
            add(b"".join(map(numbers, pages[1:])))
        fields = {256: ("I", [width]), 257: ("I", [height]), 258: ("H", [bits or page.dtype.itemsize * 8]),
                  259: ("H", [8 if packed else 1]), 262: ("H", [1]), 277: ("H", [1]), 339: ("H", [TIFF_FORMATS[kind[0]]])}
        fields.update({322: ("I", [tile[0]]), 323: ("I", [tile[1]]), 324: (word, [p[0] for p in places]),
                       325: (word, [p[1] for p in places])} if tile else
                      {273: (word, [p[0] for p in places]), 278: ("I", [rows or height]), 279: (word, [p[1] for p in places])})
        if description is not None and number == 0:
            fields[270] = ("s", description.encode() if isinstance(description, str) else description)
        if resolution:
            fields.update({282: ("R", _tiff_rational(resolution[0])), 283: ("R", _tiff_rational(resolution[1])), 296: ("H", [unit])})
        fields.update({tag: ("H", [value]) for tag, value in {**(tags or {}), **(page_tags or {}).get(number, {})}.items()})
        entries = b""
        for tag, (code, values) in sorted([*fields.items(), *((tag, ("H", [value])) for tag, value in twice)]):
            if code == "s":
                data, count, of_type = values + b"\0", len(values) + 1, 2
            elif code == "R":
                data, count, of_type = struct.pack(endian + "2I", *values), 1, 5
            else:
                data, count, of_type = struct.pack(f"{endian}{len(values)}{code}", *values), len(values), {"H": 3, "I": 4, "Q": 16}[code]
            if len(data) > size:
                data = struct.pack(endian + word, add(data + bytes(len(data) % 2))[0])
            entries += struct.pack(f"{endian}2H{word}", tag, of_type, count) + data.ljust(size, b"\0")
        out.extend(bytes(len(out) % 2))
        struct.pack_into(endian + word, out, link, len(out))
        out.extend(struct.pack(endian + count_word, len(entries) // entry) + entries)
        link = len(out)
        out.extend(bytes(size))
    path.write_bytes(out)
