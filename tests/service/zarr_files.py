# SPDX-License-Identifier: Apache-2.0
"""Zarr arrays and OME-Zarr images by their definition, versions 2 and 3, for tests. Arrays are indexed as stored, [z, y, x] or with more axes
in front. Nothing here is hexad's."""
import gzip
import itertools
import json
import struct
import zlib

import numpy

NAMES_3 = {"b1": "bool", "i1": "int8", "u1": "uint8", "i2": "int16", "u2": "uint16", "i4": "int32", "u4": "uint32", "i8": "int64",
           "u8": "uint64", "f4": "float32", "f8": "float64"}


def crc32c(data):
    table = []
    for k in range(256):
        for _ in range(8):
            k = k >> 1 ^ (0x82f63b78 if k & 1 else 0)
        table.append(k)
    crc = 0xffffffff
    for byte in data:
        crc = table[(crc ^ byte) & 255] ^ crc >> 8
    return struct.pack("<I", crc ^ 0xffffffff)


def stored_by_zstd(data):
    """A frame with its size and blocks that are stored as they are, of at most 128 KiB."""
    blocks = [data[k:k + (1 << 17)] for k in range(0, len(data), 1 << 17)] or [b""]
    body = b"".join(struct.pack("<I", len(b) << 3 | (k == len(blocks) - 1))[:3] + b for k, b in enumerate(blocks))
    return b"\x28\xb5\x2f\xfd" + bytes([0xa0]) + struct.pack("<I", len(data)) + body


def stored_by_blosc(data):
    """A container whose flag says that the bytes are as they are."""
    return struct.pack("<4B3I", 2, 1, 2, 1, len(data), len(data), len(data) + 16) + data


PACK = {"zstd": stored_by_zstd, "blosc": stored_by_blosc, None: bytes, "zlib": zlib.compress, "gzip": gzip.compress, "crc32c": lambda d: d + crc32c(d)}


def _chunks(values, side):
    """(numbers of a chunk, its values filled up with zeros)."""
    counts = [-(-n // c) for n, c in zip(values.shape, side)]
    for at in itertools.product(*map(range, counts)):
        part = values[tuple(slice(k * c, (k + 1) * c) for k, c in zip(at, side))]
        full = numpy.zeros(side, values.dtype)
        full[tuple(map(slice, part.shape))] = part
        yield at, full


def write_array_2(path, values, chunks, compressor=None, order="C", endian="<", separator=".", fill=0, pack=None, **changes):
    """`pack`: a function in the place of those of PACK."""
    path.mkdir(parents=True, exist_ok=True)
    kind = values.dtype.str[1:]
    described = {"zarr_format": 2, "shape": values.shape, "chunks": chunks, "dtype": ("|" if kind[1] == "1" else endian) + kind,
                 "compressor": {"id": compressor} if compressor else None, "fill_value": fill, "order": order, "filters": None}
    if separator != ".":
        described["dimension_separator"] = separator
    (path / ".zarray").write_text(json.dumps({**described, **changes}))
    for at, part in _chunks(values, chunks):
        if (part == fill).all():
            continue
        file = path / separator.join(map(str, at))
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes((pack or PACK[compressor])(part.astype(endian + kind).tobytes(order=order)))


def write_array_3(path, values, chunks, codecs=(), big=False, separator="/", key="default", fill=0, transpose=None, shards=None,
                  index_first=False, index_checksum=True, attributes=None, **changes):
    """`codecs`: names in PACK, in the order in which they are applied; `shards`: the shape of a file of chunks."""
    path.mkdir(parents=True, exist_ok=True)
    kind = values.dtype.str[1:]
    chain = [{"name": "transpose", "configuration": {"order": list(transpose)}}] if transpose else []
    chain += [{"name": "bytes", "configuration": {"endian": "big" if big else "little"}}, *({"name": name} for name in codecs)]

    def packed(part):
        data = (part.transpose(transpose) if transpose else part).astype((">" if big else "<") + kind).tobytes()
        for name in codecs:
            data = PACK[name](data)
        return data

    if shards:
        index_codecs = [{"name": "bytes", "configuration": {"endian": "little"}}, *([{"name": "crc32c"}] if index_checksum else [])]
        chain = [{"name": "sharding_indexed", "configuration": {"chunk_shape": chunks, "codecs": chain, "index_codecs": index_codecs,
                                                                "index_location": "start" if index_first else "end"}}]
    described = {"zarr_format": 3, "node_type": "array", "shape": values.shape, "data_type": NAMES_3[kind],
                 "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": shards or chunks}},
                 "chunk_key_encoding": {"name": key, "configuration": {"separator": separator}}, "fill_value": fill, "codecs": chain,
                 "attributes": attributes or {}}
    (path / "zarr.json").write_text(json.dumps({**described, **changes}))
    for at, part in _chunks(values, shards or chunks):
        if (part == fill).all():
            continue
        file = path / separator.join([*(["c"] if key == "default" else []), *map(str, at)])
        file.parent.mkdir(parents=True, exist_ok=True)
        if not shards:
            file.write_bytes(packed(part))
            continue
        body, index = b"", b""
        count = int(numpy.prod([s // c for s, c in zip(shards, chunks)]))
        size = 16 * count + (4 if index_checksum else 0)
        for _, inner in _chunks(part, chunks):
            data = b"" if (inner == fill).all() else packed(inner)
            index += struct.pack("<2Q", len(body) + (size if index_first else 0), len(data)) if data else b"\xff" * 16
            body += data
        index += crc32c(index) if index_checksum else b""
        file.write_bytes(index + body if index_first else body + index)


def multiscales(scales, translations=None, axes="zyx", unit="millimeter", version="0.4", whole=None):
    """One dataset for each entry of `scales`."""
    kinds = {"t": "time", "c": "channel"}
    listed = [{"name": a, "type": kinds.get(a, "space"), **({"unit": unit} if a in "xyz" and unit else {})} for a in axes]
    datasets = [{"path": str(k), "coordinateTransformations": [{"type": "scale", "scale": list(scale)}] + (
        [{"type": "translation", "translation": list(translations[k])}] if translations else [])} for k, scale in enumerate(scales)]
    one = {"axes": listed, "datasets": datasets, "name": "test", **({"version": version} if version == "0.4" else {})}
    if whole:
        one["coordinateTransformations"] = whole
    return [one]


def write_group_2(path, described):
    path.mkdir(parents=True, exist_ok=True)
    (path / ".zgroup").write_text('{"zarr_format": 2}')
    (path / ".zattrs").write_text(json.dumps({"multiscales": described}))


def write_group_3(path, described):
    path.mkdir(parents=True, exist_ok=True)
    (path / "zarr.json").write_text(json.dumps({"zarr_format": 3, "node_type": "group",
                                                "attributes": {"ome": {"version": "0.5", "multiscales": described}}}))
