# SPDX-License-Identifier: Apache-2.0
"""A generator of mesh files: a surface in each format, with every header field that can change values, positions or units at a value
that is not its default. `box(r)` is a box at a random place; each writer returns nothing, and the file has the box at that place."""
import base64
import json
import struct
import zipfile

import numpy

FACES = numpy.array([(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4),
                     (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5)])


def box(r):
    """Corners of a box, multiples of 1/256, so that floats hold them."""
    low, size = r.integers(-2000, 2000, 3) / 256, r.integers(64, 1000, 3) / 256
    return numpy.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]) * size + low


def area(corners):
    return sum(numpy.linalg.norm(numpy.cross(corners[b] - corners[a], corners[c] - corners[a])) / 2 for a, b, c in FACES)


# ---- glTF

COMPONENTS = {"i1": 5120, "u1": 5121, "<i2": 5122, "<u2": 5123, "<u4": 5125, "<f4": 5126}


class Gltf:
    """A document that grows: views, accessors and the data of one buffer."""

    def __init__(self, **members):
        self.data = b""
        self.document = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [], "meshes": [],
                         "accessors": [], "bufferViews": [], **members}

    def view(self, data, **members):
        self.data += bytes(-len(self.data) % 4)
        self.document["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **members})
        self.data += data
        return len(self.document["bufferViews"]) - 1

    def accessor(self, values, kind, stride=0, **members):
        """Rows of numbers; with a stride there are other bytes between them."""
        rows = numpy.asarray(values).astype(kind)
        rows = rows.reshape(len(rows), -1)
        width = rows.dtype.itemsize * rows.shape[1]
        packed = b"".join(row.tobytes().ljust(max(stride, width), b"\xAA") for row in rows)
        view = self.view(packed, **({"byteStride": stride} if stride else {}))
        return self.add({"bufferView": view, "componentType": COMPONENTS[kind], "count": len(rows),
                         "type": {1: "SCALAR", 3: "VEC3"}[rows.shape[1]], **members})

    def add(self, accessor):
        self.document["accessors"].append(accessor)
        return len(self.document["accessors"]) - 1

    def mesh(self, position, indices=None, **members):
        primitive = {"attributes": {"POSITION": position}, **({"indices": indices} if indices is not None else {}), **members}
        self.document["meshes"].append({"primitives": [primitive]})
        return len(self.document["meshes"]) - 1

    def write(self, path, uri=None):
        document = {**self.document, "buffers": [{"byteLength": len(self.data), **({"uri": uri} if uri else {})}]}
        if path.suffix == ".gltf" and not uri:
            document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        text = json.dumps(document).encode()
        if path.suffix == ".gltf":
            path.write_bytes(text)
            return
        text += b" " * (-len(text) % 4)
        data = self.data + bytes(-len(self.data) % 4)
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data)) + struct.pack("<I4s", len(text), b"JSON") + text +
                         struct.pack("<I4s", len(data), b"BIN\0") + data)


def quantised(path, corners, kind, normalised, stride, required=True):
    """Positions as integers, by scale and translation of the node, as gltfpack writes them."""
    g = Gltf(**({"extensionsUsed": ["KHR_mesh_quantization"], "extensionsRequired": ["KHR_mesh_quantization"]} if required else {}))
    info = numpy.iinfo(numpy.dtype(kind))
    low, high = corners.min(0), corners.max(0)
    unit = info.max if normalised else 1
    steps = (info.max - max(info.min, -info.max)) / unit
    least = max(info.min, -info.max)
    rows = numpy.round((corners - low) / (high - low) * (info.max - least) + least)
    position = g.accessor(rows, kind, stride, **({"normalized": True} if normalised else {}))
    indices = g.accessor(FACES.ravel(), "<u2")
    scale = (high - low) / steps
    g.document["nodes"] = [{"mesh": g.mesh(position, indices), "scale": scale.tolist(),
                            "translation": (low - least / unit * scale).tolist()}]
    g.write(path)


def quaternion(axis, angle):
    axis = numpy.array(axis) / numpy.linalg.norm(axis)
    return [*(numpy.sin(angle / 2) * axis), numpy.cos(angle / 2)]


def nested_nodes(path, corners):
    """A matrix above a rotation above a translation and a scale: together the identity."""
    g = Gltf()
    quarter = quaternion((1, 2, 2), 2 * numpy.pi / 3)
    local = corners / 4 - (1, 2, 3)
    x, y, z, w = quarter
    turn = numpy.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    matrix = numpy.identity(4)
    matrix[:3, :3] = 4 * turn.T
    mesh = g.mesh(g.accessor(local, "<f4"), g.accessor(FACES.ravel(), "u1"))
    g.document["nodes"] = [{"children": [1], "matrix": matrix.T.ravel().tolist()}, {"children": [2], "rotation": quarter},
                           {"mesh": mesh, "translation": [1, 2, 3]}]
    g.write(path)


def sparse(path, corners):
    """Two corners are replaced, in a view of zeros and in one without a view at all."""
    g = Gltf()
    indices = g.view(numpy.array([1, 6], "<u2").tobytes())
    values = g.view(corners[[1, 6]].astype("<f4").tobytes())
    wrong = corners.copy()
    wrong[[1, 6]] = 77
    position = g.accessor(wrong, "<f4", sparse={"count": 2, "indices": {"bufferView": indices, "componentType": 5123},
                                                "values": {"bufferView": values}})
    mesh = g.mesh(position, g.accessor(FACES.ravel(), "<u4"))
    g.document["nodes"] = [{"mesh": mesh}]
    g.write(path)


def sparse_of_nothing(path, corners):
    g = Gltf()
    indices = g.view(numpy.arange(8, dtype="u1").tobytes())
    values = g.view(corners.astype("<f4").tobytes())
    position = g.add({"componentType": 5126, "count": 8, "type": "VEC3",
                      "sparse": {"count": 8, "indices": {"bufferView": indices, "componentType": 5121}, "values": {"bufferView": values}}})
    g.document["nodes"] = [{"mesh": g.mesh(position, g.accessor(FACES.ravel(), "<u2"))}]
    g.write(path)


def without_indices(path, corners):
    g = Gltf()
    g.document["nodes"] = [{"mesh": g.mesh(g.accessor(corners[FACES.ravel()], "<f4", stride=20))}]
    g.write(path)


def strips(path, corners):
    """Each side as a strip of two triangles, in six primitives."""
    g = Gltf()
    position = g.accessor(corners, "<f4")
    sides = [FACES[k:k + 2] for k in range(0, 12, 2)]
    primitives = []
    for (a, b, c), (_, _, d) in sides:  # a b c and a c d
        primitives.append({"attributes": {"POSITION": position}, "indices": g.accessor([b, c, a, d], "<u2"), "mode": 5})
    g.document["meshes"] = [{"primitives": primitives}]
    g.document["nodes"] = [{"mesh": 0}]
    g.write(path)


def fans(path, corners):
    g = Gltf()
    position = g.accessor(corners, "<f4")
    g.document["meshes"] = [{"primitives": [
        {"attributes": {"POSITION": position}, "indices": g.accessor([a, b, c, d], "<u2"), "mode": 6}
        for (a, b, c), (_, _, d) in (FACES[k:k + 2] for k in range(0, 12, 2))]}]
    g.document["nodes"] = [{"mesh": 0}]
    g.write(path)


def as_text(path, corners):
    without_indices(path, corners)


def far_node(path, corners):
    """Local coordinates near 0 and a translation that floats do not hold."""
    g = Gltf()
    middle = numpy.round(corners.mean(0))
    mesh = g.mesh(g.accessor(corners - middle, "<f4"), g.accessor(FACES.ravel(), "<u2"))
    g.document["nodes"] = [{"children": [1], "translation": (middle + 123456789.125).tolist()},
                           {"mesh": mesh, "translation": [-123456789.125] * 3}]
    g.write(path)


# ---- 3MF

MODEL = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
UNITS = {"micron": 0.001, "millimeter": 1, "centimeter": 10, "inch": 25.4, "foot": 304.8, "meter": 1000}


def mesh_of_3mf(corners):
    vertices = "".join('<vertex x="%.17g" y="%.17g" z="%.17g"/>' % tuple(v) for v in corners)
    triangles = "".join('<triangle v1="%d" v2="%d" v3="%d"/>' % tuple(f) for f in FACES)
    return f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>"


def write_3mf(path, resources, build, attributes="", parts=None, entry="3D/3dmodel.model"):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", '<?xml version="1.0" encoding="UTF-8"?><Types/>')
        archive.writestr("_rels/.rels", f"""<?xml version="1.0" encoding="UTF-8"?>
<!-- <Relationship Target="/no.model" Type="http://x/3dmodel"/> --><Relationships><Relationship Id="t" Target="/t.png" Type="http://x/thumbnail"/>
<Relationship Target="/{entry}" Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>""")
        for name, text in {entry: (resources, build), **(parts or {})}.items():
            of, items = text if isinstance(text, tuple) else (text, "")
            archive.writestr(name, f'<?xml version="1.0" encoding="UTF-8"?>\n<model {attributes} xml:lang="en-US" xmlns="{MODEL}">'
                                   f"<metadata name=\"Title\">a &lt;vertex x=\"1\"/> b</metadata><resources>{of}</resources><build>{items}</build></model>")


def in_unit(path, corners, unit):
    write_3mf(path, f'<object id="7">{mesh_of_3mf(corners / UNITS[unit])}</object>', '<item objectid="7"/>', f'unit="{unit}"')


def transform(matrix, move):
    """Rows of a matrix for row vectors, and the translation."""
    return " ".join("%.17g" % v for v in [*numpy.ravel(matrix), *move])


def with_transforms(path, corners):
    """An item, a component and a component of a component, each with a transform, in centimetres."""
    scale, turn, swap = numpy.diag([2., 4, 8]), numpy.array([[0., 1, 0], [0, 0, 1], [1, 0, 0]]), numpy.diag([1., -1, 1])
    local = corners / 10
    for matrix, move in ((scale, (1, 2, 3)), (turn, (4, 5, 6)), (swap, (7, 8, 9))):  # outermost first
        local = (local - move) @ numpy.linalg.inv(matrix)
    write_3mf(path, f'<object id="1">{mesh_of_3mf(local)}</object>'
              f'<object id="2"><components><component objectid="1" transform="{transform(swap, (7, 8, 9))}"/></components></object>'
              f'<object id="3"><components><component objectid="2" transform="{transform(turn, (4, 5, 6))}"/></components></object>',
              f'<item objectid="3" transform="{transform(scale, (1, 2, 3))}"/>', 'unit="centimeter"')


def of_production(path, corners):
    """The mesh in another part of the package, as slicers write it."""
    write_3mf(path, f'<object id="5"><components><component p:path="/3D/Objects/a.model" objectid="1"/></components></object>',
              '<item objectid="5"/>', f'unit="inch" xmlns:p="{PRODUCTION}" requiredextensions="p"',
              {"3D/Objects/a.model": f'<object id="1">{mesh_of_3mf(corners / 25.4)}</object>'})


# a tetrahedron
AMF = ("""<?xml version="1.0" encoding="utf-8"?>\n<!-- a part -->\n<amf unit="inch"><object id="0"><mesh><vertices>""" +
       "".join("<vertex><coordinates><x>%d</x><y>%d</y><z>%d</z></coordinates></vertex>" % v for v in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))) +
       "</vertices><volume>" + "".join("<triangle><v1>%d</v1><v2>%d</v2><v3>%d</v3></triangle>" % f for f in ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3))) +
       "</volume></mesh></object></amf>").encode()

# four faces, as AutoCAD writes them
DXF = ("  0\r\nSECTION\r\n  2\r\nENTITIES\r\n" +
       "".join("  0\r\n3DFACE\r\n  8\r\n0\r\n" + "".join(f" {10 * axis + k + 10}\r\n{v[axis]}.0\r\n" for k, v in enumerate(f) for axis in range(3))
               for f in (((0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 0, 0)), ((0, 0, 0), (1, 0, 0), (0, 0, 1), (0, 0, 1)),
                         ((1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 1)), ((0, 1, 0), (0, 0, 0), (0, 0, 1), (0, 0, 1)))) +
       "  0\r\nENDSEC\r\n  0\r\nEOF\r\n").encode()


def fbx(path, corners, unit):
    """As text; `unit` in centimetres."""
    numbers = ",".join(map(repr, corners.ravel().tolist()))
    indices = ",".join(f"{a},{b},{-c - 1}" for a, b, c in FACES)
    path.write_text(f"""; FBX 7.3.0 project file
FBXHeaderExtension:  {{\n FBXHeaderVersion: 1003\n FBXVersion: 7300\n}}
GlobalSettings:  {{\n Version: 1000\n Properties70:  {{\n  P: "UnitScaleFactor", "double", "Number", "",{unit}\n }}\n}}
Objects:  {{
 Geometry: 1001, "Geometry::box", "Mesh" {{\n  Vertices: *24 {{\n   a: {numbers}\n  }}\n  PolygonVertexIndex: *36 {{\n   a: {indices}\n  }}
  GeometryVersion: 124\n }}\n Model: 2001, "Model::box", "Mesh" {{\n  Version: 232\n }}\n}}
Connections:  {{\n C: "OO",2001,0\n C: "OO",1001,2001\n}}
""")


# ---- OBJ, PLY and OFF

def obj_lines(corners):
    return ["v %r %r %r" % tuple(v) for v in corners.tolist()], [" ".join(str(k + 1) for k in f) for f in FACES.tolist()]


def obj(path, corners, vertex="{}", face="f {}", before="", after="", end="\n"):
    """`vertex` and `face` say how a line is written."""
    vertices, faces = obj_lines(corners)
    lines = [before, *(vertex.format(v) for v in vertices), *(face.format(f) for f in faces), after]
    path.write_bytes(end.join(line for line in lines if line).encode() + end.encode())


def ply(path, corners, layout="binary_little_endian", kind="double", unused=(), used=(), extra=""):
    """`unused`: more vertices, of no face; `used`: vertices of faces that are replaced, {index: place}."""
    rows = numpy.array([*corners, *unused], float).reshape(-1, 3)
    order = numpy.roll(numpy.arange(len(rows)), 3)  # unused ones are not the last
    new = numpy.argsort(order)
    rows = rows[order]
    for index, place in dict(used).items():
        rows[new[index]] = place
    faces = new[FACES]
    head = (f"ply\nformat {layout} 1.0\n{extra}element vertex {len(rows)}\n" + "".join(f"property {kind} {axis}\n" for axis in "xyz") +
            f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n").encode()
    if layout == "ascii":
        path.write_bytes(head + "".join("%r %r %r\n" % tuple(v) for v in rows.tolist()).encode() +
                         "".join("3 %d %d %d\n" % tuple(f) for f in faces).encode())
        return
    sign = ">" if "big" in layout else "<"
    path.write_bytes(head + rows.astype(sign + {"double": "f8", "float": "f4"}[kind]).tobytes() +
                     b"".join(struct.pack(sign + "B3i", 3, *f) for f in faces))


def odd_ply(path, corners, layout="binary_big_endian"):
    """Elements and properties between those of the shape, a list at each vertex, and corners of 16 bits with lists of 32."""
    sign, head = ">" if "big" in layout else "<", (
        f"ply\nformat {layout} 1.0\ncomment property double x\nobj_info num_cols 7\nelement camera 1\nproperty float view_px\nelement vertex 8\n"
        "property uchar red\nproperty double z\nproperty list ushort float weights\nproperty double x\nproperty int flags\nproperty double y\n"
        "element edge 1\nproperty int vertex1\nproperty int vertex2\nelement face 12\nproperty float quality\n"
        "property list uint ushort vertex_index\nproperty list uchar float texcoord\nend_header\n")
    data = struct.pack(sign + "f", 5)
    for k, (x, y, z) in enumerate(corners):
        data += struct.pack(sign + f"BdH{k}fdid", 200, z, k, *[9] * k, x, -7, y)
    data += struct.pack(sign + "2i", 0, 1)
    for f in FACES:
        data += struct.pack(sign + "fI3HB6f", 0.5, 3, *f, 6, *[0.25] * 6)
    path.write_bytes(head.encode() + data)


def strips_of_ply(path, corners, layout="binary_little_endian"):
    """Triangle strips of doubles, one for each side, with -1 between them."""
    strips = [k for (a, b, c), (_, _, d) in (FACES[n:n + 2] for n in range(0, 12, 2)) for k in (b, c, a, d, -1)]
    head = (f"ply\nformat {layout} 1.0\nelement vertex 8\n" + "".join(f"property double {axis}\n" for axis in "xyz") +
            "element tristrips 1\nproperty list int int vertex_indices\nend_header\n").encode()
    if layout == "ascii":
        path.write_bytes(head + "".join("%r %r %r\n" % tuple(v) for v in corners.tolist()).encode() +
                         " ".join(map(str, [len(strips), *strips])).encode() + b"\n")
        return
    sign = ">" if "big" in layout else "<"
    path.write_bytes(head + corners.astype(sign + "f8").tobytes() + struct.pack(f"{sign}{1 + len(strips)}i", len(strips), *strips))


def stl(path, corners, head=b"", solids=1, text=False):
    """`head`: of the binary header; attribute bytes and normals are wrong; `solids`: how many share the triangles, in text."""
    if text:
        facets = ["facet normal 0 0 7\n outer loop\n" + "".join("  vertex %r %r %r\n" % tuple(corners[k].tolist()) for k in f) +
                  " endloop\nendfacet\n" for f in FACES]
        path.write_text("".join(f"solid part {n} UNITS=inch\n" + "".join(facets[n::solids]) + f"endsolid part {n}\n" for n in range(solids)))
        return
    rows = b"".join(struct.pack("<12fH", 3, 0, 0, *corners[f].ravel(), 0x8421 + n) for n, f in enumerate(FACES))
    path.write_bytes(head.ljust(80, b" ") + struct.pack("<I", len(FACES)) + rows)


def off(path, corners, prefix="", binary=False, dimensions=None, w=None, colours=0):
    """`prefix` of ST, C, N, 4; `colours`: floats behind each face."""
    r = numpy.random.default_rng(5)
    beside = 4 * ("C" in prefix) + 3 * ("N" in prefix) + 2 * ("ST" in prefix)
    rows = corners * (w if w else 1)
    rows = numpy.c_[rows, numpy.full(8, w)] if "4" in prefix else rows
    rows = numpy.c_[rows, r.random((8, beside))]
    size = f" {dimensions}" if dimensions else ""
    name = prefix + ("n" if dimensions else "") + "OFF"
    if binary:
        counts = ([dimensions] if dimensions else []) + [8, 12, 0]
        faces = b"".join(struct.pack(f">4i i {colours}f", 3, *f, colours, *[0.5] * colours) for f in FACES)
        path.write_bytes(f"{name} BINARY\n".encode() + struct.pack(f">{len(counts)}i", *counts) + rows.astype(">f4").tobytes() + faces)
    else:
        path.write_text(f"# a comment\n{name}{size}\n# another\n8 12 # edges are not told\n" +
                        "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist()) +
                        "".join("3 %d %d %d" % tuple(f) + " 0.5" * colours + " # c\n" for f in FACES))
