# SPDX-License-Identifier: Apache-2.0
"""VTK files of PolyData by their definition, legacy and XML, for tests. Nothing here is hexad's."""
import base64
import struct
import zlib

import numpy

LEGACY_TYPES = {"f4": "float", "f8": "double", "i4": "int", "i8": "vtktypeint64", "i2": "short", "u1": "unsigned_char"}
SCALARS = 'Scalars="s"'
XML_TYPES = {"f4": "Float32", "f8": "Float64", "i1": "Int8", "u1": "UInt8", "i2": "Int16", "i4": "Int32", "u4": "UInt32", "i8": "Int64", "u8": "UInt64"}


def numbers_of(values, binary):
    values = numpy.asarray(values)
    if binary:
        return values.astype(">" + values.dtype.str[1:]).tobytes() + b"\n"
    return (" ".join(repr(v) for v in values.ravel().tolist()) + "\n").encode()


def write_legacy(path, points, cells, binary=False, version="3.0", before=b"", behind=b""):
    """`cells`: lists of lists of points by section: VERTICES, LINES, POLYGONS, TRIANGLE_STRIPS. Version 5 has offsets."""
    points = numpy.asarray(points)
    out = f"# vtk DataFile Version {version}\na title\n{'BINARY' if binary else 'ASCII'}\nDATASET POLYDATA\n".encode() + before
    out += f"POINTS {len(points)} {LEGACY_TYPES[points.dtype.str[1:]]}\n".encode() + numbers_of(points, binary)
    for name, of_kind in cells.items():
        if float(version) >= 5:
            offsets = numpy.cumsum([0] + [len(c) for c in of_kind])
            out += f"{name} {len(offsets)} {offsets[-1]}\nOFFSETS vtktypeint64\n".encode() + numbers_of(offsets.astype("i8"), binary)
            out += b"CONNECTIVITY vtktypeint64\n" + numbers_of(numpy.array([i for c in of_kind for i in c], "i8"), binary)
        else:
            flat = [i for c in of_kind for i in (len(c), *c)]
            out += f"{name} {len(of_kind)} {len(flat)}\n".encode() + numbers_of(numpy.array(flat, "i4"), binary)
    path.write_bytes(out + behind)


def _packed(data, head, block):
    blocks = [data[k:k + block] for k in range(0, len(data), block)]
    packed = [zlib.compress(b) for b in blocks]
    last = len(data) % block
    heads = struct.pack(f"{head[0]}{3 + len(blocks)}{head[1]}", len(blocks), block, last, *map(len, packed))
    return heads, b"".join(packed)


def write_xml(path, pieces, mode="ascii", encoding="base64", packed=False, big=False, long_heads=False, index="i8", kind="PolyData",
              block=48, extra="", values=(), names=""):
    """Each piece has points and cells by section: Verts, Lines, Strips, Polys. `mode`: ascii, binary or appended. `values`: for
    each piece the arrays of its points by name; `names`: the attributes of their element."""
    order, head = (">" if big else "<"), ((">" if big else "<"), "Q" if long_heads else "I")
    appended = b""

    def array(name, values, components=None):
        nonlocal appended
        values = numpy.asarray(values)
        data = values.astype(order + values.dtype.str[1:]).tobytes()
        of = f'<DataArray type="{XML_TYPES[values.dtype.str[1:]]}" Name="{name}"' + (f' NumberOfComponents="{components}"' if components else "")
        if mode == "ascii":
            text = " ".join(repr(v) for v in values.ravel().tolist())
            return f'{of} format="ascii">\n{text}\n<InformationKey name="L2_NORM_RANGE" location="vtkDataArray"/></DataArray>\n'
        length = struct.pack("".join(head), len(data))
        as_text = mode == "binary" or encoding == "base64"
        if packed:
            heads, body = _packed(data, head, block)
            block_bytes = base64.b64encode(heads) + base64.b64encode(body) if as_text else heads + body
        else:
            block_bytes = base64.b64encode(length + data) if as_text else length + data
        if mode == "binary":
            return f'{of} format="binary">\n    {block_bytes.decode()}\n  </DataArray>\n'
        at = len(appended)
        appended += block_bytes
        return f'{of} format="appended" offset="{at}"/>\n'

    body = ""
    for at, (points, cells) in enumerate(pieces):
        body += f'<Piece NumberOfPoints="{len(points)}"' + "".join(f' NumberOf{k}="{len(v)}"' for k, v in cells.items()) + ">\n"
        own = values[at] if at < len(values) else {"s": numpy.arange(len(points), dtype="f4")}
        body += f"<PointData {names or SCALARS}>" + "".join(array(n, v, 0 if v.ndim < 2 else v.shape[1]) for n, v in own.items())
        body += "</PointData>\n"
        body += "<Points>\n" + array("Points", points, 3) + "</Points>\n"
        for name, of_kind in cells.items():
            body += f"<{name}>\n" + array("connectivity", numpy.array([i for c in of_kind for i in c], index))
            body += array("offsets", numpy.cumsum([len(c) for c in of_kind]).astype(index)) + f"</{name}>\n"
        body += "</Piece>\n"
    text = (f'<?xml version="1.0"?>\n{extra}<VTKFile type="{kind}" version="1.0" byte_order="{"BigEndian" if big else "LittleEndian"}" '
            f'header_type="{"UInt64" if long_heads else "UInt32"}"' + (' compressor="vtkZLibDataCompressor"' if packed else "")
            + f">\n<PolyData>\n{body}</PolyData>\n").encode()
    if mode == "appended":
        text += f'<AppendedData encoding="{encoding}">\n_'.encode() + appended + b"\n</AppendedData>\n"
    path.write_bytes(text + b"</VTKFile>\n")
