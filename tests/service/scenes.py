# SPDX-License-Identifier: Apache-2.0
"""Points as glTF and USD, read by the definitions of these formats. Nothing here is hexad's."""
import json
import re
import struct

import numpy


def stack(columns, *names):
    return numpy.stack([columns[name] for name in names], -1)


def read_glb(data):
    """Attributes of the one primitive by name, and the document."""
    magic, version, length, json_length, kind = struct.unpack_from("<4sII I4s", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    document = json.loads(data[20:20 + json_length])
    (size, kind), binary = struct.unpack_from("<I4s", data, 20 + json_length), data[28 + json_length:]
    assert kind == b"BIN\0" and size == len(binary) == document["buffers"][0]["byteLength"]
    (primitive,) = document["meshes"][0]["primitives"]
    assert primitive["mode"] == 0
    found = {}
    for name, index in primitive["attributes"].items():
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        values = numpy.frombuffer(binary, "<f4", accessor["count"] * width, view["byteOffset"])
        found[name] = values.reshape(-1, width) if width > 1 else values
    return found, document


def read_usda(text):
    """{declaration: array} of one prim, and the stage's metadata."""
    assert text.startswith("#usda 1.0\n")
    found = {}
    for name, values in re.findall(r"^    (\w+\[\] [\w:]+)(?:.timeSamples = \{\n +\d+:| =) \[(.*)\]", text, re.M):
        rows = re.findall(r"\(([^)]*)\)", values)
        found[name] = numpy.array([[float(v) for v in row.split(",")] for row in rows] if rows else
                                  [float(v) for v in values.split(",")])
    return found, dict(re.findall(r"^    (\w+) = (\S+)$", text, re.M))
