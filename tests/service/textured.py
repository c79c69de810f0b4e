# SPDX-License-Identifier: Apache-2.0
"""Meshes with images: PNG files of every kind, a cube and a sphere with texture coordinates, and the formats that hold them."""
import json
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


def gltf(vertices, faces, sets, images, materials, textures, samplers=(), of=None, colors=None, kinds=None):
    """A glTF document and its binary chunk: one primitive of triangles for each material. sets: arrays of uv of each corner of
    each face, v upwards (glTF has it downwards); images: bytes, or a dict; of: the material of each face, None for none;
    colors: of each corner of each face; kinds: the numbers of each set, "f4", "u1" or "u2" (normalised)."""
    chunk, views, accessors = bytearray(), [], []
    of = numpy.zeros(len(faces), int) if of is None else numpy.asarray(of)
    faces, sets = numpy.asarray(faces), [numpy.asarray(s, float) for s in sets]

    def view(data):
        chunk.extend(bytes(-len(chunk) % 4))
        views.append({"buffer": 0, "byteOffset": len(chunk), "byteLength": len(data)})
        chunk.extend(data)
        return len(views) - 1

    def accessor(array, kind="f4"):
        scale = {"f4": 1, "u1": 255, "u2": 65535}[kind]
        name = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[array.shape[1]]
        stored = array.astype("f4") if kind == "f4" else numpy.rint(array * scale).astype(kind)
        step = stored.dtype.itemsize * array.shape[1]
        padded = numpy.zeros((len(array), (step + 3) // 4 * 4), "u1")
        padded[:, :step] = stored.reshape(len(array), -1).view("u1").reshape(len(array), step)
        where = view(padded.tobytes())
        views[where]["byteStride"] = padded.shape[1]
        accessors.append({"bufferView": where, "componentType": {"f4": 5126, "u1": 5121, "u2": 5123}[kind], "count": len(array),
                          "type": name, **({} if kind == "f4" else {"normalized": True})})
        return len(accessors) - 1
    primitives = []
    for number in sorted(set(of.tolist())):
        mine = of == number
        attributes = {"POSITION": accessor(vertices[faces[mine]].reshape(-1, 3))}
        for k, uv in enumerate(sets):
            attributes[f"TEXCOORD_{k}"] = accessor((uv[mine] * [1, -1] + [0, 1]).reshape(-1, 2), (kinds or ["f4"] * 9)[k])
        if colors is not None:
            attributes["COLOR_0"] = accessor(colors[mine].reshape(-1, colors.shape[2]))
        primitives.append({"attributes": attributes, **({"material": number} if number >= 0 else {})})
    listed = [i if isinstance(i, dict) else {"bufferView": view(i), "mimeType": "image/png"} for i in images]
    document = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
                "meshes": [{"primitives": primitives}], "accessors": accessors, "bufferViews": views, "images": listed,
                "materials": materials, "textures": textures, "samplers": list(samplers),
                "buffers": [{"byteLength": len(chunk)}]}
    return document, bytes(chunk)


def glb(document, chunk):
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunk += bytes(-len(chunk) % 4)
    return (struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(chunk)) + struct.pack("<II", len(text), 0x4E4F534A) + text +
            struct.pack("<II", len(chunk), 0x004E4942) + chunk)


def ply(vertices, faces, uv, files, form="ascii", wedges=True, numbers=None):
    """PLY with comments TextureFile. wedges: uv in a list of each face; otherwise uv of each vertex. numbers: texnumber."""
    vertices, faces, uv = numpy.asarray(vertices), numpy.asarray(faces), numpy.asarray(uv)
    head = ["ply", f"format {form} 1.0", *[f"comment TextureFile {name}" for name in files],
            f"element vertex {len(vertices)}", *[f"property double {axis}" for axis in "xyz"]]
    rows = [[("d", v) for v in place] for place in vertices.tolist()]
    if not wedges:
        head += ["property float s", "property float t"]
        of = numpy.zeros((len(vertices), 2))
        of[faces.reshape(-1)] = uv.reshape(-1, 2)
        rows = [row + [("f", v) for v in place] for row, place in zip(rows, of.tolist())]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    if wedges:
        head.append("property list uchar double texcoord")
    if numbers is not None:
        head.append("property int texnumber")
    for k, face in enumerate(faces.tolist()):
        row = [("B", len(face))] + [("i", v) for v in face]
        if wedges:
            row += [("B", 2 * len(face))] + [("d", v) for v in uv[k].reshape(-1).tolist()]
        if numbers is not None:
            row.append(("i", int(numbers[k])))
        rows.append(row)
    text = "\n".join(head + ["end_header", ""]).encode()
    if form == "ascii":
        return text + "".join(" ".join(repr(v) for _, v in row) + "\n" for row in rows).encode()
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}[form]
    return text + b"".join(struct.pack(order + "".join(t for t, _ in row), *[v for _, v in row]) for row in rows)


def part_of_3mf(vertices, faces, property_of):
    """The mesh of an object; property_of: the attributes of triangle k."""
    places = "".join('<vertex x="%.17g" y="%.17g" z="%.17g"/>' % tuple(v) for v in vertices)
    triangles = "".join('<triangle v1="%d" v2="%d" v3="%d" %s/>' % (*f, property_of(k)) for k, f in enumerate(faces))
    return f"<mesh><vertices>{places}</vertices><triangles>{triangles}</triangles></mesh>"


def collada(vertices, faces, sets, materials, of=None, numbers=None, wrap=None):
    """COLLADA 1.4 text, in metres with y upwards: one polylist for each material. sets: arrays of uv of each corner of each
    face, v upwards; materials: for each an image file and a number of a set, or a colour; of: the material of each face;
    numbers: of the sets; wrap: the wrap mode of all samplers."""
    of = numpy.zeros(len(faces), int) if of is None else numpy.asarray(of)
    faces, numbers = numpy.asarray(faces), range(len(sets)) if numbers is None else numbers

    def source(name, values, of_each):
        text = " ".join(repr(v) for v in numpy.ravel(values).tolist())
        params = "".join(f'<param name="{axis}" type="float"/>' for axis in of_each)
        return (f'<source id="{name}"><float_array id="{name}-array" count="{numpy.size(values)}">{text}</float_array><technique_common>'
                f'<accessor source="#{name}-array" count="{len(values)}" stride="{len(of_each)}">{params}</accessor></technique_common></source>')
    sources = source("p", vertices, "XYZ") + "".join(source(f"t{k}", numpy.reshape(uv, (-1, 2)), "ST") for k, uv in enumerate(sets))
    primitives = images = effects = listed = bound = ""
    for k, material in enumerate(materials):
        mine = numpy.flatnonzero(of == k)
        corners = [f"{v} " + " ".join([str(faces.shape[1] * f + n)] * len(sets)) for f in mine for n, v in enumerate(faces[f])]
        inputs = "".join(f'<input semantic="TEXCOORD" source="#t{n}" offset="{n + 1}" set="{number}"/>' for n, number in enumerate(numbers))
        primitives += (f'<polylist material="symbol{k}" count="{len(mine)}"><input semantic="VERTEX" source="#v" offset="0"/>{inputs}'
                       f'<vcount>{" ".join([str(faces.shape[1])] * len(mine))}</vcount><p>{" ".join(corners)}</p></polylist>')
        sampler, binding = "", ""
        if isinstance(material, tuple) and isinstance(material[0], str):
            images += f'<image id="image{k}"><init_from>{material[0]}</init_from></image>'
            mode = f"<wrap_s>{wrap}</wrap_s><wrap_t>{wrap}</wrap_t>" if wrap else ""
            sampler = (f'<newparam sid="surface{k}"><surface type="2D"><init_from>image{k}</init_from></surface></newparam>'
                       f'<newparam sid="sampler{k}"><sampler2D><source>surface{k}</source>{mode}</sampler2D></newparam>')
            diffuse = f'<texture texture="sampler{k}" texcoord="MAP"/>'
            binding = f'<bind_vertex_input semantic="MAP" input_semantic="TEXCOORD" input_set="{material[1]}"/>'
        else:
            diffuse = "<color>" + " ".join(map(repr, material)) + "</color>"
        effects += (f'<effect id="effect{k}"><profile_COMMON>{sampler}<technique sid="common"><lambert><diffuse>{diffuse}</diffuse></lambert>'
                    "</technique></profile_COMMON></effect>")
        listed += f'<material id="material{k}" name="paint {k}"><instance_effect url="#effect{k}"/></material>'
        bound += f'<instance_material symbol="symbol{k}" target="#material{k}">{binding}</instance_material>'
    return ('<?xml version="1.0" encoding="utf-8"?>\n<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
            '<asset><unit name="meter" meter="1"/><up_axis>Y_UP</up_axis></asset>'
            f"<library_images>{images}</library_images><library_effects>{effects}</library_effects><library_materials>{listed}</library_materials>"
            f'<library_geometries><geometry id="g"><mesh>{sources}<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>{primitives}'
            "</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id=\"s\"><node id=\"n\"><instance_geometry url=\"#g\">"
            f"<bind_material><technique_common>{bound}</technique_common></bind_material></instance_geometry></node></visual_scene>"
            '</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>\n')
