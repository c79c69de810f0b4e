# SPDX-License-Identifier: Apache-2.0
"""A bar with polygons of several sizes, bent by any angle, as mesh files; and the places of points on it, evaluated with numpy from the
numbers that the points carry."""
import numpy

AROUND, ALONG = 10, 24
LENGTH, RADIUS = 6.0, 0.7


def bar():
    """(vertices, faces): quadrangles around, and the ends as one polygon each."""
    turn = numpy.arange(AROUND) * 2 * numpy.pi / AROUND
    rings = [numpy.stack([numpy.full(AROUND, x), RADIUS * numpy.cos(turn), RADIUS * numpy.sin(turn)], axis=1)
             for x in numpy.linspace(-LENGTH / 2, LENGTH / 2, ALONG + 1)]
    faces = [[k * AROUND + a, k * AROUND + (a + 1) % AROUND, (k + 1) * AROUND + (a + 1) % AROUND, (k + 1) * AROUND + a]
             for k in range(ALONG) for a in range(AROUND)]
    ends = [list(range(AROUND)), [ALONG * AROUND + a for a in range(AROUND)]]
    return numpy.concatenate(rings), [ends[0][::-1], *faces, ends[1]]


def bent(vertices, angle):
    """The bar as an arc of `angle` radians in the plane of x and y; its axis keeps its length."""
    if angle == 0:
        return vertices.copy()
    radius = LENGTH / angle
    at = vertices[:, 0] / radius
    return numpy.stack([(radius - vertices[:, 1]) * numpy.sin(at), radius - (radius - vertices[:, 1]) * numpy.cos(at),
                        vertices[:, 2]], axis=1)


def write_obj(path, vertices, faces):
    path.write_text("".join("v %.17g %.17g %.17g\n" % tuple(v) for v in vertices) +
                    "".join("f " + " ".join(str(k + 1) for k in face) + "\n" for face in faces))


def write_ply(path, vertices, faces, heat=None):
    """`heat`: a number of each vertex."""
    names = ["x", "y", "z", *(["heat"] if heat is not None else [])]
    rows = numpy.asarray(vertices, "<f8") if heat is None else numpy.c_[vertices, heat].astype("<f8")
    head = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n" +
            "".join(f"property double {name}\n" for name in names) +
            f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n")
    body = b"".join(bytes([len(face)]) + numpy.array(face, "<i4").tobytes() for face in faces)
    path.write_bytes(head.encode() + rows.tobytes() + body)


def write_off(path, vertices, faces):
    path.write_text(f"OFF\n{len(vertices)} {len(faces)} 0\n" + "".join("%.17g %.17g %.17g\n" % tuple(v) for v in vertices) +
                    "".join(" ".join(map(str, [len(face), *face])) + "\n" for face in faces))


WRITERS = {"obj": write_obj, "ply": write_ply, "off": write_off}


def write(path, vertices, faces):
    WRITERS[path.suffix[1:]](path, vertices, faces)


def corners(places, faces):
    """Vertices of the three corners of each point that has a place."""
    return numpy.array([[faces[int(face)][int(k)] for k in corner]
                        for face, corner in zip(places["face"], places["corner"])])


def evaluate(places, vertices, faces):
    """Positions, and normals of the flat triangles, from the numbers alone."""
    at = vertices[corners(places, faces)]
    across = numpy.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])
    return (places["bary"][:, :, None] * at).sum(axis=1), across / numpy.linalg.norm(across, axis=1)[:, None]


def smooth_normals(places, vertices, faces, crease=0.7):
    """Normals between those of the corners. The normal at a corner of a face is the mean over all faces there that deviate from the face
    by no more than `crease`, weighted by their angles."""
    flat, at = [], {}
    for number, face in enumerate(faces):
        p = vertices[face]
        normal = sum(numpy.cross(p[k] - p[0], p[k + 1] - p[0]) for k in range(1, len(face) - 1))
        flat.append(normal / numpy.linalg.norm(normal))
        for k, vertex in enumerate(face):
            a, b = p[(k + 1) % len(face)] - p[k], p[k - 1] - p[k]
            angle = numpy.arccos(numpy.clip(a @ b / numpy.linalg.norm(a) / numpy.linalg.norm(b), -1, 1))
            at.setdefault(vertex, []).append((number, angle))

    def normal_at(face, vertex):
        total = sum(angle * flat[other] for other, angle in at[vertex] if flat[other] @ flat[face] >= numpy.cos(crease))
        return total / numpy.linalg.norm(total)

    out = []
    for face, corner, weight in zip(places["face"].astype(int), places["corner"].astype(int), places["bary"]):
        out.append(sum(w * normal_at(face, faces[face][k]) for k, w in zip(corner, weight)))
    return numpy.array(out) / numpy.linalg.norm(out, axis=1)[:, None]


def stretches(places, before, after, faces):
    """Least and largest stretch of the triangle of each point: singular values of the linear map between its two shapes."""
    index = corners(places, faces)

    def frames(vertices):
        at = vertices[index]
        return numpy.stack([at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]], axis=2)

    rest, now = frames(before), frames(after)
    metric = numpy.linalg.inv(rest.transpose(0, 2, 1) @ rest) @ (now.transpose(0, 2, 1) @ now)
    values = numpy.sqrt(numpy.linalg.eigvals(metric).real)
    return values.min(axis=1), values.max(axis=1)
