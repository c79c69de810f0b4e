# SPDX-License-Identifier: Apache-2.0
"""Writers of the mesh formats that assimp reads: FBX (text), COLLADA, and glTF with Draco. Each writes parts at places: local
vertices are computed from the given ones, so that the file has the given vertices after its transforms, units and axes."""
import struct

import numpy

from mesh_files import Gltf


def rotation(axis, angle):
    """The matrix of a right-handed rotation, in radians."""
    x, y, z = numpy.array(axis, float) / numpy.linalg.norm(axis)
    k = numpy.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return numpy.eye(3) + numpy.sin(angle) * k + (1 - numpy.cos(angle)) * k @ k


class Part:
    """vertices and triangles; values of vertices: normal (3), color (4), uv (2), or None; the node of the part: move, turn (axis, angle
    in radians) and scale."""

    def __init__(self, vertices, faces, move=(0, 0, 0), turn=((0, 0, 1), 0), scale=(1, 1, 1), normal=None, color=None, uv=None):
        self.vertices, self.faces = numpy.array(vertices, float), numpy.array(faces)
        self.move, self.turn, self.scale = numpy.array(move, float), turn, numpy.array(scale, float)
        self.normal, self.color, self.uv = normal, color, uv

    def matrix(self):
        return rotation(*self.turn) @ numpy.diag(self.scale)

    def local(self):
        return (self.vertices - self.move) @ numpy.linalg.inv(self.matrix()).T

    def local_normal(self):
        n = self.normal @ self.matrix()
        return n / numpy.linalg.norm(n, axis=1, keepdims=True)


def text_of(numbers, separator=" "):
    return separator.join(repr(v) for v in numpy.ravel(numbers).tolist())


# ---- FBX

def angles(matrix):
    """Degrees about x, then y, then z."""
    y = numpy.arcsin(-matrix[2, 0])
    return numpy.degrees([numpy.arctan2(matrix[2, 1], matrix[2, 2]), y, numpy.arctan2(matrix[1, 0], matrix[0, 0])])


def fbx_property(name, kind, *values):
    return f'P: "{name}", "{kind}", "", "A",{",".join(map(repr, values))}\n'


def fbx_layer(what, values, plural, of):
    numbers = numpy.array(values, float)
    return (f'LayerElement{what}: 0 {{\nVersion: 101\nName: ""\nMappingInformationType: "ByVertice"\nReferenceInformationType: "Direct"\n'
            f"{plural}: *{numbers.size} {{\na: {text_of(numbers, ',')}\n}}\n}}\n",
            f'LayerElement: {{\nType: "LayerElement{what}"\nTypedIndex: 0\n}}\n')


def fbx_text(parts, settings=(), properties=(), parents=None):
    """`settings`, `properties`: lines of fbx_property of the file and of each model; `parents`: the number of the parent of a model."""
    objects = connections = ""
    for k, part in enumerate(parts):
        local = part.local()
        layers = [fbx_layer(*row) for row in (("Normal", part.normal is not None and part.local_normal(), "Normals", 3), ("Color", part.color, "Colors", 4),
                                              ("UV", part.uv, "UV", 2)) if row[1] is not None and row[1] is not False]
        own = "".join(properties[k]) if k < len(properties) else ""
        objects += (f'Geometry: {1000 + k}, "Geometry::part{k}", "Mesh" {{\nVertices: *{local.size} {{\na: {text_of(local, ",")}\n}}\n'
                    f"PolygonVertexIndex: *{part.faces.size} {{\na: " + ",".join(f"{a},{b},{-c - 1}" for a, b, c in part.faces.tolist()) +
                    "\n}\nGeometryVersion: 124\n" + "".join(a for a, _ in layers) +
                    ("Layer: 0 {\nVersion: 100\n" + "".join(b for _, b in layers) + "}\n" if layers else "") + "}\n"
                    f'Model: {2000 + k}, "Model::part{k}", "Mesh" {{\nVersion: 232\nProperties70: {{\n' +
                    fbx_property("Lcl Translation", "Lcl Translation", *part.move.tolist()) +
                    fbx_property("Lcl Rotation", "Lcl Rotation", *angles(rotation(*part.turn)).tolist()) +
                    fbx_property("Lcl Scaling", "Lcl Scaling", *part.scale.tolist()) + own + "}\n}\n")
        parent = (parents or {}).get(k)
        connections += f'C: "OO",{2000 + k},{0 if parent is None else 2000 + parent}\nC: "OO",{1000 + k},{2000 + k}\n'
    return ("; FBX 7.3.0 project file\nFBXHeaderExtension: {\nFBXHeaderVersion: 1003\nFBXVersion: 7300\n}\nGlobalSettings: {\nVersion: 1000\n"
            "Properties70: {\n" + "".join(settings) + f"}}\n}}\nDefinitions: {{\nVersion: 100\nCount: {2 * len(parts)}\n}}\n"
            f"Objects: {{\n{objects}}}\nConnections: {{\n{connections}}}\n")


# ---- COLLADA

def to_up(vertices, up):
    """From y up to the axis up of a COLLADA file (1.4.1, 5-11)."""
    x, y, z = numpy.asarray(vertices, float).T
    return numpy.stack({"Y_UP": (x, y, z), "Z_UP": (x, -z, y), "X_UP": (y, -x, z)}[up], 1)


def collada_text(parts, up="Y_UP", meter=1, nodes=None, scene=""):
    """Vertices in metres and y up; `nodes`: texts of the transforms of each node, in the place of its own; `scene`: further nodes."""
    geometries = places = ""
    for k, part in enumerate(parts):
        given = Part(to_up(part.vertices, up) / meter, part.faces, part.move, part.turn, part.scale)
        sources = inputs = ""
        for name, values, of, semantic in (("p", given.local(), "XYZ", None),
                                           ("n", None if part.normal is None else Part(given.vertices, part.faces, (0, 0, 0), part.turn, part.scale,
                                                                                       to_up(part.normal, up)).local_normal(), "XYZ", "NORMAL"),
                                           ("c", part.color, "RGBA", "COLOR"), ("t", part.uv, "ST", "TEXCOORD")):
            if values is None:
                continue
            params = "".join(f'<param name="{axis}" type="float"/>' for axis in of)
            sources += (f'<source id="{name}{k}"><float_array id="{name}a{k}" count="{numpy.size(values)}">{text_of(values)}</float_array><technique_common>'
                        f'<accessor source="#{name}a{k}" count="{len(values)}" stride="{len(of)}">{params}</accessor></technique_common></source>')
            if semantic:
                inputs += f'<input semantic="{semantic}" source="#{name}{k}" offset="0" set="0"/>'
        geometries += (f'<geometry id="part{k}"><mesh>{sources}<vertices id="v{k}"><input semantic="POSITION" source="#p{k}"/></vertices>'
                       f'<triangles count="{len(part.faces)}"><input semantic="VERTEX" source="#v{k}" offset="0"/>{inputs}'
                       f"<p>{text_of(part.faces)}</p></triangles></mesh></geometry>")
        axis, angle = part.turn
        own = nodes[k] if nodes else (f"<translate>{text_of(part.move)}</translate><rotate>{text_of(numpy.array(axis, float) / numpy.linalg.norm(axis))} "
                                      f"{float(numpy.degrees(angle))!r}</rotate><scale>{text_of(part.scale)}</scale>")
        places += f'<node id="n{k}">{own}<instance_geometry url="#part{k}"/></node>'
    return ('<?xml version="1.0" encoding="utf-8"?>\n<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
            f'<asset><unit name="unit" meter="{meter!r}"/><up_axis>{up}</up_axis></asset><library_geometries>{geometries}</library_geometries>'
            f'<library_visual_scenes><visual_scene id="s">{places}{scene}</visual_scene></library_visual_scenes>'
            '<scene><instance_visual_scene url="#s"/></scene></COLLADA>\n')


# ---- glTF with Draco

def varint(number):
    out = b""
    while number > 127:
        out += bytes([number & 127 | 128])
        number >>= 7
    return out + bytes([number])


def draco(faces, *attributes):
    """A mesh in sequential encoding, with uncompressed corners and values of floats (bitstream 2.2); attributes: (type, values)."""
    count = len(attributes[0][1])
    out = b"DRACO" + bytes([2, 2, 1, 0, 0, 0]) + varint(len(faces)) + varint(count) + b"\1"
    out += numpy.ravel(faces).astype("u1" if count < 256 else "<u2").tobytes()
    out += b"\1" + varint(len(attributes))
    for number, (kind, values) in enumerate(attributes):
        out += bytes([kind, 9, numpy.shape(values)[1], 0]) + varint(number)
    out += bytes(len(attributes))
    return out + b"".join(numpy.asarray(values, "<f4").tobytes() for _, values in attributes)


DRACO = "KHR_draco_mesh_compression"


def draco_gltf(parts):
    g = Gltf(extensionsUsed=[DRACO], extensionsRequired=[DRACO])
    g.document["scenes"] = [{"nodes": list(range(len(parts)))}]
    for k, part in enumerate(parts):
        local = part.local().astype("f4")
        rows = [("POSITION", 0, local), ("NORMAL", 1, part.normal is not None and part.local_normal()), ("COLOR_0", 2, part.color),
                ("TEXCOORD_0", 3, part.uv)]
        rows = [row for row in rows if row[2] is not None and row[2] is not False]
        accessors = {name: g.add({"componentType": 5126, "count": len(values), "type": f"VEC{numpy.shape(values)[1]}",
                                  **({"min": local.min(0).tolist(), "max": local.max(0).tolist()} if name == "POSITION" else {})})
                     for name, _, values in rows}
        indices = g.add({"componentType": 5123, "count": part.faces.size, "type": "SCALAR"})
        compressed = {"bufferView": g.view(draco(part.faces, *((kind, values) for _, kind, values in rows))),
                      "attributes": {name: number for number, (name, _, _) in enumerate(rows)}}
        g.document["meshes"].append({"primitives": [{"attributes": accessors, "indices": indices, "extensions": {DRACO: compressed}}]})
        axis, angle = part.turn
        turned = [*(numpy.sin(angle / 2) * numpy.array(axis, float) / numpy.linalg.norm(axis)).tolist(), float(numpy.cos(angle / 2))]
        g.document["nodes"].append({"mesh": k, "translation": part.move.tolist(), "rotation": turned, "scale": part.scale.tolist()})
    return g


# ---- all

WRITERS = {"fbx": lambda path, parts: path.write_text(fbx_text(parts)), "dae": lambda path, parts: path.write_text(collada_text(parts)),
           "glb": lambda path, parts: draco_gltf(parts).write(path)}
