# SPDX-License-Identifier: Apache-2.0
"""base_color: colours of the images of meshes, held against scipy's interpolation of the same images on a cube and a sphere."""
import hashlib
import json

import numpy
import pytest
from scipy import ndimage

import textured
from readers import read_columns
from solids import write_points

BYTE = 0.5 / 255  # the rounding of a byte
MODES = {"repeat": "grid-wrap", "mirror": "reflect", "clamp": "nearest"}  # of scipy
RNG = numpy.random.default_rng(86)
IMAGE = RNG.integers(0, 256, (8, 8, 3))


@pytest.fixture
def carry(worker, tmp_path):
    """Samples a mesh file and returns the points, their base colours (three or four columns) and the report; of a job that
    fails, its error and None."""
    def call(mesh, count=400, given=None, output=None, limits=None, **more):
        spec = {"version": 1, "surface": {"mesh": {"path": str(mesh)}}, "sampling": {"count": count, **more},
                "attributes": [{"name": "base_color"}],
                "output": {"preview": False, "ply": {"precision": "double"}, **(output or {})}, "solver": {"max_sweeps": 40},
                "limits": limits or {}}
        if given is not None:
            write_points(tmp_path / "given.ply", given)
            spec["sampling"].update(count=len(given) + 200, points={"path": str(tmp_path / "given.ply"), "mode": "keep"})
        done = worker(spec)
        if done.returncode not in (0, 10, 11):
            return json.loads(done.stderr.splitlines()[-1]), None, None
        columns = read_columns((tmp_path / "out" / "points.ply").read_bytes())
        report = json.loads((tmp_path / "out" / "report.json").read_text())
        places = numpy.stack([columns[k] for k in "xyz"], -1)
        color = numpy.stack([columns[f"base_color_{c}"] for c in "rgba"], -1)
        if given is not None:
            kept = columns["kept"] == 1
            assert kept.sum() == len(given)
            places, color = places[kept], color[kept]
        return places, color, report
    return call


def texel_centres(corners, square, uv, shape):
    """Points of a square at the centres of the texels, and which texel each is of: rows from the top."""
    a, b, d = corners[square[0]], corners[square[1]], corners[square[3]]
    points, texels = [], []
    for j in range(shape[0]):
        for i in range(shape[1]):
            u, v = (i + 0.5) / shape[1], 1 - (j + 0.5) / shape[0]
            points.append(a + u * (b - a) + v * (d - a))
            texels.append((j, i))
    return numpy.array(points), numpy.array(texels)


def on_triangles(points, vertices, faces, uv):
    """The triangle, and the coordinates, of points on triangles, and which of them lie on one place of the image only: not on
    an edge between two parts of it."""
    away, places = [], []
    for face, place in zip(faces, uv):
        a, b, c = vertices[face]
        w = (points - a) @ numpy.linalg.pinv(numpy.stack([b - a, c - a], 1)).T
        w = numpy.column_stack([1 - w.sum(1), w])
        away.append(numpy.linalg.norm(w @ vertices[face] - points, axis=1) + 10 * numpy.maximum(-w.min(1) - 1e-9, 0))
        places.append(w @ place)
    away, places = numpy.array(away), numpy.array(places)
    number = away.argmin(0)
    found = places[number, numpy.arange(len(points))]
    differ = (away < 1e-6) & (numpy.abs(places - found).max(2) > 1e-5)
    assert away.min(0).max() < 1e-6 and (~differ.any(0)).sum() > 100
    return number, found, ~differ.any(0)


def look_up(image, uv, wrap="repeat"):
    """scipy's linear interpolation of an image (0 to 1) at coordinates with v upwards."""
    height, width = image.shape[:2]
    place = [(1 - uv[:, 1]) * height - 0.5, uv[:, 0] * width - 0.5]
    return numpy.stack([ndimage.map_coordinates(image[..., c], place, order=1, mode=MODES[wrap])
                        for c in range(image.shape[2])], -1)


def write_obj(path, shape, image, mtl="map_Kd a.png\n", scale=1, **more):
    vertices, faces, uv = shape
    (path / "a.obj").write_text(textured.obj(vertices, faces, scale * uv, **more))
    (path / "a.mtl").write_text("newmtl paint\n" + mtl)
    if image is not None:
        (path / "a.png").write_bytes(image)
    return path / "a.obj"


@pytest.mark.sanitized
def test_texel_centres_have_the_bytes_of_the_image(carry, tmp_path):
    corners, squares, uv = textured.cube()
    mesh = write_obj(tmp_path, textured.cube(), textured.png(IMAGE, 2))
    given, texels = texel_centres(corners, squares[1], uv[1], IMAGE.shape)
    places, color, report = carry(mesh, given=given)
    assert color is not None, places
    order = numpy.argmin(numpy.linalg.norm(places[:, None] - given[None], axis=2), 1)
    expected = IMAGE[tuple(texels[order].T)]
    assert numpy.abs(color[:, :3] * 255 - expected).max() < 1e-3 and (color[:, 3] == 1).all()
    found = {i["path"]: i for i in report["inputs"]}
    for name in ("a.obj", "a.mtl", "a.png"):
        entry = found[str(tmp_path / name)]
        assert entry["sha256"] == hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() and "inode" in entry


@pytest.mark.parametrize("shape", ["cube", "sphere"])
@pytest.mark.parametrize("scale", [1, 3])
def test_colours_between_texels_are_linear(carry, tmp_path, shape, scale):
    vertices, faces, uv = getattr(textured, shape)()
    mesh = write_obj(tmp_path, (vertices, faces, uv), textured.png(IMAGE, 2), "Kd 0.5 1 0.25\nd 0.5\nmap_Kd a.png\n", scale)
    places, color, report = carry(mesh)
    assert color is not None, places
    faces, uv = textured.triangulate(faces, uv)
    _, at, sure = on_triangles(places, vertices, faces, scale * uv)
    assert numpy.abs(color[:, :3] - look_up(IMAGE / 255, at) * [0.5, 1, 0.25])[sure].max() < 1e-4
    assert numpy.abs(color[:, 3] - 0.5).max() < 1e-9 and not [w for w in report["surface"]["warnings"] if "base_color" in w]
