# SPDX-License-Identifier: Apache-2.0
"""Meshes with images: PNG files of every kind, a cube and a sphere with texture coordinates, and the formats that hold them."""
import struct
import zlib

import numpy


def png(samples, kind, depth=8, palette=None, holes=None, extra=()):
    """The bytes of a PNG image. samples: rows x columns x components, whole numbers of `depth` bits; kind: the colour type.
    extra: further chunks (name, data) before the pixels."""
    samples = numpy.asarray(samples)
    rows = []
    for row in samples.reshape(len(samples), -1):
        if depth == 16:
            data = row.astype(">u2").tobytes()
        elif depth == 8:
            data = row.astype("u1").tobytes()
        else:
            bits = "".join(f"{v:0{depth}b}" for v in row)
            data = bytes(int(bits[k:k + 8].ljust(8, "0"), 2) for k in range(0, len(bits), 8))
        rows.append(b"\0" + data)

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    head = struct.pack(">IIBBBBB", samples.shape[1], len(samples), depth, kind, 0, 0, 0)
    more = [*extra]
    if palette is not None:
        more.append((b"PLTE", numpy.asarray(palette, "u1").tobytes()))
    if holes is not None:
        more.append((b"tRNS", holes))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + b"".join(chunk(n, d) for n, d in more) +
            chunk(b"IDAT", zlib.compress(b"".join(rows))) + chunk(b"IEND", b""))


def cube():
    """Corners of the cube from -1 to 1, its six squares, outward, and uv of each corner of each square: the whole image."""
    corners = numpy.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    squares = numpy.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    uv = numpy.tile(numpy.array([[0, 0], [1, 0], [1, 1], [0, 1]], float), (6, 1, 1))
    return corners, squares, uv


def sphere(rings=12, sectors=16):
    """A globe of triangles: corners, triangles, and uv of each corner of each triangle: longitude and latitude."""
    corner, uv = [], []
    for i in range(rings + 1):
        for k in range(sectors + 1):
            polar, turn = numpy.pi * i / rings, 2 * numpy.pi * (k % sectors) / sectors
            corner.append([numpy.sin(polar) * numpy.cos(turn), numpy.sin(polar) * numpy.sin(turn), numpy.cos(polar)])
            uv.append([k / sectors, 1 - i / rings])
    faces = []
    for i in range(rings):
        for k in range(sectors):
            a, b = i * (sectors + 1) + k, (i + 1) * (sectors + 1) + k
            faces += [[a, b, b + 1]] * (i + 1 < rings) + [[a, b + 1, a + 1]] * (i > 0)
    faces, uv = numpy.array(faces), numpy.array(uv)
    return numpy.array(corner), faces, uv[faces]


def triangulate(faces, uv):
    """The triangles of polygons, fans of their first corners, with the same numbers of corners."""
    faces, uv = numpy.asarray(faces), numpy.asarray(uv)
    fans = [[0, k, k + 1] for k in range(1, faces.shape[1] - 1)]
    return (numpy.concatenate([faces[:, f] for f in fans]), numpy.concatenate([uv[:, f] for f in fans]))


def obj(vertices, faces, uv, library="a.mtl", material="paint"):
    """OBJ text; v of uv is upwards. material: a name, or one for each face."""
    names = [material] * len(faces) if isinstance(material, str) else material
    lines = [f"mtllib {library}"] + [f"v {x!r} {y!r} {z!r}" for x, y, z in numpy.asarray(vertices).tolist()]
    number, last = 0, None
    for face, places, name in zip(numpy.asarray(faces).tolist(), numpy.asarray(uv).tolist(), names):
        lines += [f"vt {u!r} {v!r}" for u, v in places]
        if name != last:
            lines.append(f"usemtl {name}")
        last = name
        lines.append("f " + " ".join(f"{v + 1}/{number + k + 1}" for k, v in enumerate(face)))
        number += len(face)
    return "\n".join(lines) + "\n"
