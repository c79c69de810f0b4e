# SPDX-License-Identifier: Apache-2.0
"""A pyramid as a mesh, and the reader process of meshes."""
import struct
import subprocess

import numpy
import pytest

from service import PATIENCE_S

# The base has four corners; two triangles are polygons, two a strip.
POINTS = numpy.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [1, 1, 1.5]])
POLYS = [[3, 2, 1, 0], [0, 1, 4], [1, 2, 4]]
STRIP = [2, 3, 4, 0]
AREA = 4 + 4 * numpy.sqrt(1 + 1.5 ** 2)


@pytest.fixture
def mesh_reader(build):
    """What the reader process returns for a file: (vertices, triangles, warnings, others), or the text of a refusal. With the
    command read-mesh-values also the arrays by name: (kind, numbers of each vertex)."""
    def call(path, command="read-mesh"):
        with open(path, "rb") as file:
            done = subprocess.run([build / "hexad-worker", command, path.suffix[1:], str(512 << 20), "10"], stdin=file,
                                  capture_output=True, timeout=PATIENCE_S)
        assert done.returncode == 0, done.stderr
        magic, code, length, size = struct.unpack_from("<QIIQ", done.stdout)
        text = done.stdout[24:24 + length].decode()
        assert len(done.stdout) == 24 + length if code else size == 40
        if code:
            return text
        vertices, triangles, others, crossed, end = struct.unpack_from("<5Q", done.stdout, 24 + length)
        rest = done.stdout[24 + length + size:]
        answer = (numpy.frombuffer(rest, "<f8", 3 * vertices).reshape(-1, 3),
                  numpy.frombuffer(rest, "<u4", 3 * triangles, 24 * vertices).reshape(-1, 3), text, others)
        rest = rest[24 * vertices + 12 * triangles:]
        if command == "read-mesh-values":
            return (*answer, read_values(rest, vertices))
        assert not rest
        return answer
    return call


def read_values(data, vertices):
    (count,), at, arrays = struct.unpack_from("<I", data), 4, {}
    for _ in range(count):
        name, kind, components = struct.unpack_from("<64sII", data, at)
        numbers = numpy.frombuffer(data, "<f8", vertices * components, at + 72).reshape(vertices, components)
        arrays[name.split(b"\0")[0].decode()] = (("number", "whole", "normal", "color", "uv")[kind], numbers)
        at += 72 + numbers.nbytes
    assert at == len(data)
    return arrays


def area(vertices, triangles):
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return numpy.linalg.norm(numpy.cross(b - a, c - a), axis=1).sum() / 2


def assert_pyramid(answer, points=POINTS):
    assert not isinstance(answer, str), answer
    vertices, triangles, text, _ = answer
    assert text == "" and (vertices == points).all() and len(triangles) == 6
    assert area(vertices, triangles) == pytest.approx(AREA)
    # closed, and turned one way: every edge is there once in each direction
    edges = {(int(t[k]), int(t[(k + 1) % 3])) for t in triangles for k in range(3)}
    assert len(edges) == 18 and edges == {(b, a) for a, b in edges}
