# SPDX-License-Identifier: Apache-2.0
"""PLY files of triangles whose vertices have values, for tests. Nothing here is hexad's."""
import numpy


def write_ply(path, vertices, faces, values, form):
    """`values`: name to (type, numbers)."""
    names = ["property float x", "property float y", "property float z", *(f"property {t} {n}" for n, (t, _) in values.items())]
    head = "\n".join(["ply", f"format {form} 1.0", f"element vertex {len(vertices)}", *names, f"element face {len(faces)}",
                      "property list uchar int vertex_indices", "end_header"]) + "\n"
    if form == "ascii":
        rows = numpy.column_stack([vertices, *(v for _, v in values.values())])
        body = "".join(" ".join(f"{v:.9g}" for v in row) + "\n" for row in rows)
        body += "".join("3 " + " ".join(map(str, f)) + "\n" for f in faces)
        path.write_bytes((head + body).encode())
        return
    order = "<" if "little" in form else ">"
    kinds = {"float": "f4", "uchar": "u1", "double": "f8", "short": "i2"}
    table = numpy.empty(len(vertices), [(a, order + "f4") for a in "xyz"] + [(n, order + kinds[t]) for n, (t, _) in values.items()])
    for axis, name in enumerate("xyz"):
        table[name] = vertices[:, axis]
    for name, (_, numbers) in values.items():
        table[name] = numbers
    packed = numpy.empty(len(faces), [("n", "u1"), ("corner", order + "i4", 3)])
    packed["n"], packed["corner"] = 3, faces
    path.write_bytes(head.encode() + table.tobytes() + packed.tobytes())
