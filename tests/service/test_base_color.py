# SPDX-License-Identifier: Apache-2.0
"""base_color: colours of the images of meshes, held against scipy's interpolation of the same images on a cube and a sphere."""
import base64
import hashlib
import json
import zipfile

import numpy
import pytest
from scipy import ndimage

import library_meshes
import mesh_files
import textured
from readers import read_columns
from service import aged
from solids import write_points


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


# ---- glTF

WRAP = {"repeat": 10497, "mirror": 33648, "clamp": 33071}


def linear(color):
    return numpy.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)


def encoded(light):
    return numpy.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)


def write_glb(path, *arguments, **more):
    path.write_bytes(textured.glb(*textured.gltf(*arguments, **more)))
    return path


@pytest.mark.sanitized
def test_texel_centres_of_glb(carry, tmp_path):
    corners, squares, uv = textured.cube()
    faces, places = textured.triangulate(squares, uv)
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    mesh = write_glb(tmp_path / "a.glb", corners, faces, [places], [textured.png(IMAGE, 2)], [material], [{"source": 0}])
    given, texels = texel_centres(corners, squares[4], uv[4], IMAGE.shape)
    at, color, report = carry(mesh, given=given)
    assert color is not None, at
    order = numpy.argmin(numpy.linalg.norm(at[:, None] - given[None], axis=2), 1)
    assert numpy.abs(color[:, :3] * 255 - IMAGE[tuple(texels[order].T)]).max() < 1e-3 and (color[:, 3] == 1).all()
    assert [i["path"] for i in report["inputs"]][0] == str(mesh) and "inode" in report["inputs"][0]


def test_memory_for_an_image_that_is_insufficient_beside_the_other_image_is_an_error_at_the_begin(carry, tmp_path):
    corners, squares, uv = textured.cube()
    faces, places = textured.triangulate(squares, uv)
    materials = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": k}}} for k in (0, 1)]
    large = textured.png(numpy.zeros((4000, 4000, 1), "u1"), 0)  # its pixels are 61 MiB
    held = textured.png(IMAGE, 2) + bytes(40 << 20)
    mesh = write_glb(tmp_path / "a.glb", corners, faces, [places], [large, held], materials, [{"source": 0}, {"source": 1}])
    refused = {}
    for memory in (90, 100, 105, 110, 115, 200):
        places, color, _ = carry(mesh, count=100, limits={"memory_mb": memory})
        if color is None:
            refused[memory] = places["message"]
            assert places["code"] == "limit_memory" and places["message"].startswith("/attributes/0: "), places
    assert max(refused) < 200 and 'the image "image 0": its 4000 x 4000 pixels require' in refused[max(refused)]


@pytest.mark.parametrize("shape", ["cube", "sphere"])
@pytest.mark.parametrize("wrap", WRAP)
def test_wraps_and_factors_of_glb(carry, tmp_path, shape, wrap):
    """Texels are interpolated in linear light. The coordinates go beyond the image on all sides."""
    vertices, faces, uv = getattr(textured, shape)()
    faces, uv = textured.triangulate(faces, uv)
    uv = 2.5 * uv - 0.75
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [0.5, 1, 0.25, 0.5]},
                "alphaMode": "BLEND"}
    samplers = [{"wrapS": WRAP[wrap], "wrapT": WRAP[wrap]}]
    mesh = write_glb(tmp_path / "a.glb", vertices, faces, [uv], [textured.png(IMAGE, 2)], [material],
                     [{"source": 0, "sampler": 0}], samplers)
    places, color, _ = carry(mesh)
    assert color is not None, places
    _, at, sure = on_triangles(places, vertices, faces, uv)
    expected = encoded(look_up(linear(IMAGE / 255), at, wrap) * [0.5, 1, 0.25])
    assert numpy.abs(color[:, :3] - expected)[sure].max() < 1e-4 and numpy.abs(color[:, 3] - 0.5).max() < 1e-9


def test_transform_and_second_set_of_coordinates(carry, tmp_path):
    """KHR_texture_transform as its table says: the image turns clockwise, v is downwards."""
    vertices, faces, uv = textured.sphere()
    second = uv @ numpy.array([[0.5, 0.25], [-0.25, 0.75]]) + [0.25, 0.5]
    turn, offset, scale = 0.4, numpy.array([0.125, -0.375]), numpy.array([2, 0.75])
    extension = {"rotation": turn, "offset": offset.tolist(), "scale": scale.tolist(), "texCoord": 1}
    material = {"pbrMetallicRoughness": {"baseColorTexture": {
        "index": 0, "texCoord": 0, "extensions": {"KHR_texture_transform": extension}}}}
    mesh = write_glb(tmp_path / "a.glb", vertices, faces, [uv, second], [textured.png(IMAGE, 2)], [material], [{"source": 0}])
    places, color, _ = carry(mesh)
    assert color is not None, places
    _, at, sure = on_triangles(places, vertices, faces, second)
    down = (at * [1, -1] + [0, 1]) * scale
    turned = numpy.stack([numpy.cos(turn) * down[:, 0] + numpy.sin(turn) * down[:, 1],
                          -numpy.sin(turn) * down[:, 0] + numpy.cos(turn) * down[:, 1]], -1) + offset
    expected = encoded(look_up(linear(IMAGE / 255), turned * [1, -1] + [0, 1]))
    assert numpy.abs(color[:, :3] - expected)[sure].max() < 1e-4


def test_quarter_of_the_image_that_the_extension_shows(carry, tmp_path):
    """The first example of KHR_texture_transform: the lower left quadrant of the image only."""
    vertices, faces, uv = textured.cube()
    faces, uv = textured.triangulate(faces, uv)
    image = numpy.zeros((8, 8, 3), int)
    image[4:, :4] = 255
    extension = {"offset": [0, 1], "rotation": numpy.pi / 2, "scale": [0.5, 0.5]}
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": extension}}}}
    mesh = write_glb(tmp_path / "a.glb", vertices, faces, [uv], [textured.png(image, 2)], [material], [{"source": 0}])
    places, color, _ = carry(mesh)
    assert color is not None, places
    inner = numpy.sort(numpy.abs(places), 1)[:, 1] < 0.7  # away from the sides of the quadrant
    assert inner.sum() > 100 and (color[inner, :3] > 0.999).all()


def test_several_materials_and_colours_of_vertices(carry, tmp_path):
    """An image, a factor alone, and no material; times COLOR_0, which is in linear light."""
    vertices, faces, uv = textured.sphere()
    tint = numpy.random.default_rng(3).random((len(vertices), 4))[faces]
    of = numpy.arange(len(faces)) % 3 - 1
    materials = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "alphaMode": "BLEND"},
                 {"pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.4, 0.6, 0.8]}, "alphaMode": "MASK"}]
    mesh = write_glb(tmp_path / "a.glb", vertices, faces, [uv], [textured.png(IMAGE, 2)], materials, [{"source": 0}], of=of,
                     colors=tint)
    places, color, _ = carry(mesh)
    assert color is not None, places
    number, at, sure = on_triangles(places, vertices, faces, uv)
    _, red_green, _ = on_triangles(places, vertices, faces, tint[..., :2])
    _, blue_alpha, _ = on_triangles(places, vertices, faces, tint[..., 2:])
    light = numpy.column_stack([red_green, blue_alpha])
    kind = of[number]
    light[kind == 0, :3] *= look_up(linear(IMAGE / 255), at)[kind == 0]
    light[kind == 1] *= [0.2, 0.4, 0.6, 0.8]
    light[kind == -1, 3] = 1
    # on an edge of two triangles the material is that of either
    sure &= are_off_edges(places, vertices[faces[number]])
    assert sure.sum() > 100 and {-1, 0, 1} == set(kind[sure].tolist())
    assert numpy.abs(color[:, :3] - encoded(light[:, :3]))[sure].max() < 1e-4
    assert numpy.abs(color[:, 3] - light[:, 3])[sure].max() < 1e-5


@pytest.mark.parametrize("kind", ["u1", "u2"])
def test_coordinates_of_whole_numbers(carry, tmp_path, kind):
    vertices, faces, uv = textured.cube()
    faces, uv = textured.triangulate(faces, uv)
    mesh = write_glb(tmp_path / "a.glb", vertices, faces, [uv], [textured.png(IMAGE, 2)],
                     [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}], [{"source": 0}], kinds=[kind])
    places, color, _ = carry(mesh)
    assert color is not None, places
    _, at, sure = on_triangles(places, vertices, faces, uv)
    assert numpy.abs(color[:, :3] - encoded(look_up(linear(IMAGE / 255), at)))[sure].max() < 1e-4


def test_images_of_gltf_text(carry, tmp_path):
    """A data URI, and a file whose name is percent-encoded, relative to the document."""
    vertices, faces, uv = textured.cube()
    faces, uv = textured.triangulate(faces, uv)
    data = textured.png(IMAGE, 2)
    material = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    (tmp_path / "my images").mkdir()
    (tmp_path / "my images" / "a.png").write_bytes(data)
    for uri in ("data:image/png;base64," + base64.b64encode(data).decode(), "my%20images/../my%20images/a.png"):
        document, chunk = textured.gltf(vertices, faces, [uv], [{"uri": uri}], material, [{"source": 0}])
        document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(chunk).decode()
        (tmp_path / "a.gltf").write_text(json.dumps(document))
        places, color, report = carry(tmp_path / "a.gltf")
        assert color is not None, places
        _, at, sure = on_triangles(places, vertices, faces, uv)
        assert numpy.abs(color[:, :3] - encoded(look_up(linear(IMAGE / 255), at)))[sure].max() < 1e-4
    assert [i["path"] for i in report["inputs"]][1:] == [str(tmp_path / "my images" / "a.png")]


# ---- PLY

@pytest.mark.sanitized
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("wedges", [True, False], ids=["of_faces", "of_vertices"])
def test_ply_with_texture_files(carry, tmp_path, form, wedges):
    """Two images, by the number of each face; the values of the images are not converted."""
    vertices, faces, uv = textured.sphere()
    images = [IMAGE, IMAGE[::-1, :6]]
    for k, image in enumerate(images):
        (tmp_path / f"my {k}.png").write_bytes(textured.png(image, 2))
    numbers = numpy.where(vertices[faces].mean(1)[:, 2] > 0, 0, 1)
    (tmp_path / "a.ply").write_bytes(textured.ply(vertices, faces, uv, ["my 0.png", "my 1.png"], form, wedges, numbers))
    places, color, report = carry(tmp_path / "a.ply")
    assert color is not None, places
    number, at, sure = on_triangles(places, vertices, faces, uv)
    sure &= numpy.abs(places[:, 2]) > 0.01
    expected = numpy.where(numbers[number][:, None] == 0, look_up(images[0] / 255, at), look_up(images[1] / 255, at))
    assert numpy.abs(color[:, :3] - expected)[sure].max() < 1e-4
    assert len(report["inputs"]) == 3


def test_ply_of_polygons(carry, tmp_path):
    vertices, faces, uv = textured.cube()
    (tmp_path / "a.png").write_bytes(textured.png(IMAGE, 2))
    (tmp_path / "a.ply").write_bytes(textured.ply(vertices, faces, uv, ["a.png"]))
    places, color, _ = carry(tmp_path / "a.ply")
    assert color is not None, places
    faces, uv = textured.triangulate(faces, uv)
    _, at, sure = on_triangles(places, vertices, faces, uv)
    assert numpy.abs(color[:, :3] - look_up(IMAGE / 255, at))[sure].max() < 1e-4


# ---- 3MF

def write_3mf(path, shape, wraps=("wrap", "wrap"), image=None, more="", extra=(), of_object=""):
    """A package with an image for all triangles. extra: attributes of further triangles by their number."""
    vertices, faces, uv = shape
    places = "".join('<m:tex2coord u="%.17g" v="%.17g"/>' % tuple(p) for p in uv.reshape(-1, 2))
    extra = dict(extra)

    def named(k):
        return extra.get(k, f'pid="2" p1="{3 * k}" p2="{3 * k + 1}" p3="{3 * k + 2}"')
    resources = (f'<m:texture2d id="1" path="/3D/Texture/a.png" contenttype="image/png" tilestyleu="{wraps[0]}" '
                 f'tilestylev="{wraps[1]}"/><m:texture2dgroup id="2" texid="1">{places}</m:texture2dgroup>{more}'
                 f'<object id="7" {of_object}>{textured.part_of_3mf(vertices, faces, named)}</object>')
    mesh_files.write_3mf(path, resources, '<item objectid="7"/>',
                         'xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02"')
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("3D/Texture/a.png", image or textured.png(IMAGE, 2))
    return path


@pytest.mark.sanitized
@pytest.mark.parametrize("wrap", ["wrap", "mirror", "clamp"])
def test_wraps_of_3mf(carry, tmp_path, wrap):
    vertices, faces, uv = textured.cube()
    faces, uv = textured.triangulate(faces, uv)
    uv = 2.5 * uv - 0.75
    places, color, _ = carry(write_3mf(tmp_path / "a.3mf", (vertices, faces, uv), (wrap, wrap)))
    assert color is not None, places
    _, at, sure = on_triangles(places, vertices, faces, uv)
    expected = look_up(IMAGE / 255, at, {"wrap": "repeat"}.get(wrap, wrap))
    assert numpy.abs(color[:, :3] - expected)[sure].max() < 1e-4 and (color[:, 3] == 1).all()


def test_outside_of_an_image_that_is_not_repeated(carry, tmp_path):
    """3MF none and MTL -clamp on: beyond the image the material is as without it."""
    vertices, faces, uv = textured.cube()
    faces, uv = textured.triangulate(faces, uv)
    uv = 2.5 * uv - 0.75
    obj = write_obj(tmp_path, (vertices, faces, uv), textured.png(IMAGE, 2), "Kd 1 0.5 1\nmap_Kd -clamp on a.png\n")
    for mesh, factor in ((write_3mf(tmp_path / "a.3mf", (vertices, faces, uv), ("none", "none")), [1, 1, 1]), (obj, [1, 0.5, 1])):
        places, color, _ = carry(mesh)
        assert color is not None, places
        _, at, sure = on_triangles(places, vertices, faces, uv)
        outside = (at < 0).any(1) | (at > 1).any(1)
        expected = numpy.where(outside[:, None], 1, look_up(IMAGE / 255, at, "clamp")) * factor
        assert 50 < outside.sum() < 350 and numpy.abs(color[:, :3] - expected)[sure].max() < 1e-4


def are_off_edges(points, corners):
    """Whether each point lies off the edges of its triangle."""
    return numpy.min([numpy.linalg.norm(numpy.cross(b - a, points - a), axis=1) / numpy.linalg.norm(b - a, axis=1)
                      for a, b in ((corners[:, k - 1], corners[:, k]) for k in range(3))], 0) > 1e-5


def test_colours_and_materials_of_3mf(carry, tmp_path):
    """A base material, a group of colours with a gradient, and what is not read."""
    vertices, faces, uv = textured.cube()
    faces, uv = textured.triangulate(faces, uv)
    more = ('<basematerials id="3"><base name="a" displaycolor="#336699"/><base name="b" displaycolor="#0000FF80"/></basematerials>'
            '<m:colorgroup id="4"><m:color color="#FF0000"/><m:color color="#00FF00"/><m:color color="#0000FF"/></m:colorgroup>'
            '<m:multiproperties id="5" pids="3 4"><m:multi pindices="0 0"/></m:multiproperties>')
    extra = {0: 'pid="3" p1="1"', 1: 'pid="4" p1="0" p2="1" p3="2"', 2: 'pid="5" p1="0"', 3: 'pid="3" p1="0"', 4: ""}
    places, color, report = carry(write_3mf(tmp_path / "a.3mf", (vertices, faces, uv), more=more, extra=extra))
    assert color is not None, places
    number, at, sure = on_triangles(places, vertices, faces, uv)
    gradient = on_triangles(places, vertices, faces, numpy.tile(numpy.eye(3)[None, :, :2], (len(faces), 1, 1)))[1]
    expected = numpy.column_stack([look_up(IMAGE / 255, at), numpy.ones(len(at))])
    expected[number == 0] = [0, 0, 1, 128 / 255]
    expected[number == 1, :2], expected[number == 1, 2] = gradient[number == 1], 1 - gradient[number == 1].sum(1)
    expected[(number == 2) | (number == 4)] = 1
    expected[number == 3] = [0x33 / 255, 0x66 / 255, 0x99 / 255, 1]
    sure &= are_off_edges(places, vertices[faces[number]])
    assert numpy.abs(color - expected)[sure].max() < 1e-4


def test_a_triangle_of_3mf_can_name_indices_in_the_resource_of_its_object(carry, tmp_path):
    vertices, faces, uv = textured.cube()
    faces, uv = textured.triangulate(faces, uv)
    more = '<m:colorgroup id="4"><m:color color="#FF0000"/><m:color color="#00FF00"/><m:color color="#0000FF"/></m:colorgroup>'
    extra = {k: 'p1="2"' for k in range(len(faces))}
    extra |= {0: "", 1: 'p1="1"', 2: 'pid="4"', 3: 'p1="0" p2="1" p3="2"'}
    places, color, _ = carry(write_3mf(tmp_path / "a.3mf", (vertices, faces, uv), more=more, extra=extra, of_object='pid="4" pindex="1"'))
    assert color is not None, places
    number, at, sure = on_triangles(places, vertices, faces, numpy.tile(numpy.eye(3)[None, :, :2], (len(faces), 1, 1)))
    expected = numpy.tile([0.0, 0, 1, 1], (len(at), 1))
    expected[number < 3] = [0, 1, 0, 1]
    gradient = number == 3
    expected[gradient, :2], expected[gradient, 2] = at[gradient], 1 - at[gradient].sum(1)
    sure &= are_off_edges(places, vertices[faces[number]])
    assert gradient.sum() > 5 and numpy.abs(color - expected)[sure].max() < 1e-4


def test_multiproperties_have_a_warning(carry, tmp_path):
    vertices, faces, uv = textured.cube()
    faces, uv = textured.triangulate(faces, uv)
    more = '<m:multiproperties id="5" pids="2"><m:multi pindices="0"/></m:multiproperties>'
    _, color, report = carry(write_3mf(tmp_path / "a.3mf", (vertices, faces, uv), more=more, extra={2: 'pid="5" p1="0"'}), count=100)
    assert color is not None
    found, = warnings_of(report)
    assert "1 triangles are white: their pid names multiproperties" in found


# ---- COLLADA

@pytest.mark.sanitized
def test_texel_centres_of_collada(carry, tmp_path):
    """Squares, and a file whose name is percent-encoded."""
    corners, squares, uv = textured.cube()
    (tmp_path / "my a.png").write_bytes(textured.png(IMAGE, 2))
    (tmp_path / "a.dae").write_text(textured.collada(corners, squares, [uv], [("./my%20a.png", 0)]))
    given, texels = texel_centres(corners, squares[2], uv[2], IMAGE.shape)
    at, color, report = carry(tmp_path / "a.dae", given=given)
    assert color is not None, at
    order = numpy.argmin(numpy.linalg.norm(at[:, None] - given[None], axis=2), 1)
    assert numpy.abs(color[:, :3] * 255 - IMAGE[tuple(texels[order].T)]).max() < 1e-3 and (color[:, 3] == 1).all()
    assert report["inputs"][-1]["path"] == str(tmp_path / "my a.png")
    assert not warnings_of(report)


@pytest.mark.parametrize("wrap", ["WRAP", "MIRROR", "CLAMP"])
def test_wraps_of_collada(carry, tmp_path, wrap):
    vertices, faces, uv = textured.cube()
    uv = 2.5 * uv - 0.75
    (tmp_path / "a.png").write_bytes(textured.png(IMAGE, 2))
    (tmp_path / "a.dae").write_text(textured.collada(vertices, faces, [uv], [("a.png", 0)], wrap=wrap))
    places, color, report = carry(tmp_path / "a.dae")
    assert color is not None, places
    faces, uv = textured.triangulate(faces, uv)
    _, at, sure = on_triangles(places, vertices, faces, uv)
    expected = look_up(IMAGE / 255, at, {"WRAP": "repeat"}.get(wrap, wrap.lower()))
    assert numpy.abs(color[:, :3] - expected)[sure].max() < 1e-4 and not warnings_of(report)


def test_materials_and_sets_of_collada(carry, tmp_path):
    """An image on the second set of coordinates, which repeat it, and a colour alone."""
    vertices, faces, uv = textured.sphere()
    second = 2.5 * uv - 0.75
    (tmp_path / "a.png").write_bytes(textured.png(IMAGE, 2))
    of = numpy.where(vertices[faces].mean(1)[:, 2] > 0, 0, 1)
    (tmp_path / "a.dae").write_text(textured.collada(vertices, faces, [uv, second], [("a.png", 1), (0.2, 0.4, 0.6, 1.0)], of))
    places, color, report = carry(tmp_path / "a.dae")
    assert color is not None, places
    _, at, sure = on_triangles(places, vertices, faces, second)
    expected = numpy.where(places[:, 2:] > 0, look_up(IMAGE / 255, at), [0.2, 0.4, 0.6])
    sure &= numpy.abs(places[:, 2]) > 0.01
    assert numpy.abs(color[:, :3] - expected)[sure].max() < 1e-4 and (color[:, 3] == 1).all() and not warnings_of(report)


def test_what_is_not_read_of_collada_has_a_warning(carry, tmp_path):
    vertices, faces, uv = textured.cube()
    (tmp_path / "a.png").write_bytes(textured.png(IMAGE, 2))
    text = textured.collada(vertices, faces, [uv, uv], [("a.png", 1)], numbers=[1, 3], wrap="BORDER")
    unbound = textured.collada(vertices, faces, [uv], [("a.png", 0)]).replace('material="symbol0"', 'material="other"')
    clear = textured.collada(vertices, faces, [uv], [("a.png", 0)]).replace(
        "</lambert>", "<transparency><float>0.5</float></transparency></lambert>")
    for written, *words in ((text, "2 wrap modes are not WRAP, MIRROR or CLAMP", "1 sets of texture coordinates are not numbered"),
                            (unbound, "No material specified"), (clear, 'the transparency of the material "paint 0" is not read')):
        (tmp_path / "a.dae").write_text(written)
        _, color, report = carry(tmp_path / "a.dae", count=100)
        assert color is not None
        for word in words:
            assert word in " ".join(warnings_of(report))
    (tmp_path / "a.dae").write_text(textured.collada(vertices, faces, [uv], []).replace("</mesh>", (
        '<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles></mesh>')))
    error, none, _ = carry(tmp_path / "a.dae", count=100)
    assert none is None and error["code"] == "attribute_missing"


# ---- images

PALETTE = RNG.integers(0, 256, (4, 3))
NUMBERS = RNG.integers(0, 4, (8, 8))
GREY, GREY_ALPHA, RGBA = RNG.integers(0, 256, (8, 8, 1)), RNG.integers(0, 256, (8, 8, 2)), RNG.integers(0, 256, (8, 8, 4))
DEEP = RNG.integers(0, 65536, (8, 8, 4))
HOLED = numpy.column_stack([PALETTE, [10, 128, 255, 255]])
OPAQUE = numpy.full((8, 8, 1), 255)
# the file, and its values as red, green, blue, opacity from 0 to 1
PNG = {
    "grey": (textured.png(GREY, 0), numpy.concatenate([GREY.repeat(3, 2), OPAQUE], 2) / 255),
    "grey of 2 bits": (textured.png(NUMBERS[..., None], 0, 2), numpy.concatenate([NUMBERS[..., None].repeat(3, 2) * 85, OPAQUE], 2) / 255),
    "grey, opacity": (textured.png(GREY_ALPHA, 4), GREY_ALPHA[..., [0, 0, 0, 1]] / 255),
    "colours, opacity": (textured.png(RGBA, 6), RGBA / 255),
    "16 bits": (textured.png(DEEP, 6, 16), DEEP / 65535),
    "grey of 16 bits": (textured.png(DEEP[..., :1], 0, 16), numpy.concatenate([DEEP[..., :1].repeat(3, 2), OPAQUE * 257], 2) / 65535),
    "palette": (textured.png(NUMBERS[..., None], 3, 2, palette=PALETTE), numpy.concatenate([PALETTE[NUMBERS], OPAQUE], 2) / 255),
    "palette with holes": (textured.png(NUMBERS[..., None], 3, 4, palette=PALETTE, holes=bytes([10, 128])), HOLED[NUMBERS] / 255),
    "colour that is a hole": (textured.png(PALETTE[NUMBERS], 2, holes=PALETTE[2].astype(">u2").tobytes()),
                              numpy.concatenate([PALETTE[NUMBERS], 255 * (NUMBERS[..., None] != 2)], 2) / 255),
}


@pytest.mark.sanitized
@pytest.mark.parametrize("kind", PNG)
def test_kinds_of_png(carry, tmp_path, kind):
    vertices, faces, uv = textured.cube()
    data, values = PNG[kind]
    mesh = write_obj(tmp_path, (vertices, faces, uv), data)
    places, color, report = carry(mesh, count=200)
    assert color is not None, places
    faces, uv = textured.triangulate(faces, uv)
    _, at, sure = on_triangles(places, vertices, faces, uv)
    assert numpy.abs(color - look_up(values, at))[sure].max() < 1e-4
    assert not [w for w in report["surface"]["warnings"] if "base_color" in w]


def warnings_of(report):
    return [w for w in report["surface"]["warnings"] if '"base_color"' in w]


@pytest.mark.sanitized
def test_missing_images_and_formats_that_are_not_read(carry, tmp_path):
    """A warning with the name, and the colour of the factor. Without the identities of inputs the service uses no result again."""
    (tmp_path / "b.webp").write_bytes(b"RIFF\0\0\0\0WEBPVP8 ")
    for name, words, identified in (("none.png", "is missing", False), ("b.webp", "is WebP, which is not read", True)):
        mesh = write_obj(tmp_path, textured.cube(), None, f"Kd 0.25 0.5 1\nmap_Kd {name}\n")
        places, color, report = carry(mesh, count=100)
        assert color is not None, places
        assert numpy.abs(color - [0.25, 0.5, 1, 1]).max() < 1e-9
        found, = warnings_of(report)
        assert f'the image "{name}" {words}' in found
        assert all(("inode" in i) == identified for i in report["inputs"])


@pytest.mark.sanitized
def test_what_is_ignored_has_a_warning(carry, tmp_path):
    mesh = write_obj(tmp_path, textured.cube(), textured.png(IMAGE, 2, extra=[(b"iCCP", b"a\0\0x"), (b"eXIf", b"MM\0*")]),
                     "Kd 0 0 0\nmap_Kd -mm 0 2 a.png\n")
    _, color, report = carry(mesh, count=100)
    text = " ".join(warnings_of(report))
    assert not color[:, :3].any()
    for words in ("option -mm", "so that its image is black", "(ICC), which is not applied", "EXIF data"):
        assert words in text


def test_many_warnings_are_counted(carry, tmp_path):
    """Forty materials whose images are missing: the first ones by name, the number of the others."""
    vertices, faces, uv = textured.sphere()
    names = [f"paint{k % 40}" for k in range(len(faces))]
    (tmp_path / "a.obj").write_text(textured.obj(vertices, faces, uv, material=names))
    (tmp_path / "a.mtl").write_text("".join(f"newmtl paint{k}\nmap_Kd {k}.png\n" for k in range(40)))
    _, color, report = carry(tmp_path / "a.obj", count=100)
    assert color is not None
    found = warnings_of(report)
    assert 'the image "0.png" is missing' in found[0] and f"{41 - len(found)} further warnings" in found[-1]


def test_triangles_without_coordinates_have_a_warning(carry, tmp_path):
    mesh = write_obj(tmp_path, textured.cube(), textured.png(IMAGE, 2), "Kd 0.5 0.25 1\nmap_Kd a.png\n")
    lines = [" ".join(word.split("/")[0] for word in line.split(" ")) for line in mesh.read_text().splitlines()
             if not line.startswith("vt")]
    mesh.write_text("\n".join(lines) + "\n")
    _, color, report = carry(mesh, count=100)
    assert (color[:, :3] == [0.5, 0.25, 1]).all()
    found, = warnings_of(report)
    assert "points lie on triangles that have an image, but no coordinates on it" in found


@pytest.mark.sanitized
def test_fields_of_mtl_that_are_there_twice_or_not_understood(carry, tmp_path):
    for mtl, color, words in (
            ("Kd 0.5 0.5 0.5x\n", [1, 1, 1, 1], "Kd of the material \"paint\" is not one or three numbers"),
            ("Kd 0.5 0.25\n", [1, 1, 1, 1], "Kd of the material \"paint\" is not one or three numbers"),
            ("Kd 0.5\nd half\n", [0.5, 0.5, 0.5, 1], "d of the material \"paint\" is not a number"),
            ("Kd 1 1 1\nTr 0.25\nKd 0.5 0.25 1\n", [0.5, 0.25, 1, 0.75], "has Kd twice: the last one is used"),
            ("Tr 1\n", [1, 1, 1, 0], "has an opacity of 0 by its d or Tr"),
            ("Kd 0.5 0.25 1\nnewmtl paint\nKd 1 1 1\n", [0.5, 0.25, 1, 1], "is there twice: the first one is used"),
            ("Kd 0.5 0.25 1\nmap_kd a.png\nKs 1 1 1\n", [0.5, 0.25, 1, 1], "map_kd of the material \"paint\" is not read")):
        places, found, report = carry(write_obj(tmp_path, textured.cube(), None, mtl), count=100)
        assert found is not None, places
        assert numpy.abs(found - color).max() < 1e-6
        warning, = warnings_of(report)
        assert words in warning


@pytest.mark.sanitized
def test_fields_of_gltf_and_3mf_that_are_not_understood(carry, tmp_path):
    vertices, faces, uv = textured.cube()
    faces, uv = textured.triangulate(faces, uv)

    def refused(mesh, words):
        error, none, _ = carry(mesh, count=100)
        assert none is None and error["code"] == "input_damaged" and words in error["message"], error
    for texture, material, sampler, words in (
            ({}, {"baseColorFactor": [1, 1]}, {}, "wrong factor of material 0"), ({"texCoord": -1}, {}, {}, "wrong texCoord"),
            ({"extensions": {"KHR_texture_transform": {"offset": "x"}}}, {}, {}, "wrong KHR_texture_transform"),
            ({"extensions": {"KHR_texture_transform": {"rotation": [1]}}}, {}, {}, "wrong KHR_texture_transform"),
            ({}, {}, {"wrapS": 3}, "wrong sampler"), ({}, {}, {"wrapT": "x"}, "wrong sampler")):
        of = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **texture}, **material}}
        refused(write_glb(tmp_path / "a.glb", vertices, faces, [uv], [textured.png(IMAGE, 2)], [of],
                          [{"source": 0, "sampler": 0}], [sampler]), words)
    for more, extra, style, words in (
            ('<m:colorgroup id="4"><m:color color="#12345"/></m:colorgroup>', {}, "wrap", "a colour is not of the form"),
            ('<m:colorgroup id="4"><m:color color="#12345678 "/></m:colorgroup>', {}, "wrap", "a colour is not of the form"),
            ('<m:colorgroup id="4"/><m:colorgroup id="4"/>', {}, "wrap", "two resources have the same id"),
            ("", {0: 'pid="2" p1="one"'}, "wrap", "is not a number"), ("", {0: 'pid="2" p1="99"'}, "wrap", "that is missing"),
            ("", {}, "odd", "a tile style is none of")):
        refused(write_3mf(tmp_path / "a.3mf", (vertices, faces, uv), (style, "wrap"), more=more, extra=extra), words)


def test_faces_of_ply_without_their_image(carry, tmp_path):
    vertices, faces, uv = textured.cube()
    faces, uv = textured.triangulate(faces, uv)
    (tmp_path / "a.png").write_bytes(textured.png(IMAGE, 2))
    (tmp_path / "a.ply").write_bytes(textured.ply(vertices, faces, uv, ["  a.png "], numbers=numpy.arange(len(faces)) // 8))
    _, color, report = carry(tmp_path / "a.ply")
    found, = warnings_of(report)
    assert f"{len(faces) - 8} faces have a texnumber for which there is no TextureFile" in found
    assert 0 < (color[:, :3] == 1).all(1).sum() < len(color)


@pytest.mark.sanitized
def test_refused_images_and_meshes(carry, tmp_path):
    for data, words in ((textured.png(IMAGE, 2)[:-40], 'the image "a.png": it is damaged'), (b"text", "neither a PNG nor a JPEG")):
        error, none, _ = carry(write_obj(tmp_path, textured.cube(), data))
        assert none is None and error["code"] == "input_damaged" and words in error["message"], error
    (tmp_path / "a.png").write_bytes(textured.png(IMAGE, 2))
    error, none, _ = carry(tmp_path / "a.obj", limits={"image_pixels": 63})
    assert none is None and error["code"] == "input_unsupported" and "limits.image_pixels" in error["message"]
    (tmp_path / "a.mtl").unlink()
    error, none, _ = carry(tmp_path / "a.obj")
    assert none is None and error["code"] == "input_missing" and "a.mtl" in error["message"]
    (tmp_path / "b.obj").write_text("\n".join(line for line in (tmp_path / "a.obj").read_text().splitlines()
                                              if not line.startswith(("mtllib", "usemtl"))))
    error, none, _ = carry(tmp_path / "b.obj")
    assert none is None and error["code"] == "attribute_missing"
    (tmp_path / "c.off").write_text("OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n")
    error, none, _ = carry(tmp_path / "c.off")
    assert none is None and error["code"] == "input_unsupported" and "save it as glTF" in error["message"]


@pytest.mark.parametrize("ending", ["fbx", "glb"])
def test_formats_whose_materials_are_not_read_are_refused(carry, tmp_path, ending):
    """By assimp: FBX, and glTF with Draco."""
    vertices, faces, uv = textured.sphere()
    library_meshes.WRITERS[ending](tmp_path / f"a.{ending}", [library_meshes.Part(vertices, faces)])
    error, none, _ = carry(tmp_path / f"a.{ending}", count=100)
    assert none is None and error["code"] == "input_unsupported"
    assert ("Draco" if ending == "glb" else "save it as glTF, OBJ, PLY, 3MF or COLLADA") in error["message"], error


def test_paths_of_windows_and_of_parents(carry, tmp_path):
    (tmp_path / "mesh").mkdir()
    (tmp_path / "images").mkdir()
    data = textured.png(IMAGE, 2)
    for name, place in (("..\\images\\a.png", tmp_path / "images/a.png"), ("C:\\my\\b.png", tmp_path / "mesh/b.png"),
                        (str(tmp_path / "images/a.png"), tmp_path / "images/a.png")):
        place.write_bytes(data)
        mesh = write_obj(tmp_path / "mesh", textured.cube(), None, f"map_Kd {name}\n")
        _, color, report = carry(mesh, count=100)
        assert str(place) in [i["path"] for i in report["inputs"]] and not warnings_of(report)


def test_colours_in_every_format_of_points(carry, tmp_path):
    """base_color is the colour of the points, as color is."""
    mesh = write_obj(tmp_path, textured.cube(), textured.png(IMAGE, 2))
    carry(mesh, count=100, output={"points_npz": True, "points_glb": True, "points_usda": True, "points_vtp": True})
    columns = read_columns((tmp_path / "out" / "points.ply").read_bytes())
    assert numpy.abs(columns["red"] - 255 * columns["base_color_r"]).max() < 0.501
    archive = numpy.load(tmp_path / "out" / "points.npz")
    assert numpy.abs(archive["base_color"][:, 0] - columns["base_color_r"]).max() < 1e-6
    assert b"_BASE_COLOR" in (tmp_path / "out" / "points.glb").read_bytes()
    assert "primvars:base_color" in (tmp_path / "out" / "points.usda").read_text()


# ---- the service

def job_of(path):
    return {"version": 1, "surface": {"mesh": {"path": path}}, "sampling": {"count": 100}, "output": {"preview": False},
            "attributes": [{"name": "base_color"}]}


def test_a_result_without_its_image_is_not_used_again(new_service, tmp_path):
    """The image may be there when the next equal job runs."""
    inputs = tmp_path / "inputs"
    inputs.mkdir()
    mesh = write_obj(inputs, textured.cube(), None)
    for name in ("a.obj", "a.mtl"):
        aged(inputs / name)
    service = new_service("--input_roots", inputs).start()

    def run():
        return service.wait_state(service.submit(job_of(str(mesh))), "succeeded")
    run()
    assert run()["cached_from"] is None
    (inputs / "a.png").write_bytes(textured.png(IMAGE, 2))
    aged(inputs / "a.png")
    complete = run()
    report = service.get(f"/v1/jobs/{complete['id']}/results/report.json").json
    assert complete["cached_from"] is None and not warnings_of(report) and len(report["inputs"]) == 3
    assert run()["cached_from"] == complete["id"]
    (inputs / "a.png").write_bytes(textured.png(IMAGE[::-1], 2))
    assert run()["cached_from"] is None


def test_uploads_have_embedded_images_only(service):
    vertices, faces, uv = textured.cube()
    faces, uv = textured.triangulate(faces, uv)
    material = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 0, 0, 1]}}]
    made = {"embedded": [textured.png(IMAGE, 2)], "separate": [{"uri": "a.png"}]}
    for kind, images in made.items():
        data = textured.glb(*textured.gltf(vertices, faces, [uv], images, material, [{"source": 0}]))
        name = hashlib.sha256(data).hexdigest()
        assert service.request("PUT", f"/v1/inputs/{name}", data).status in (200, 201, 204)
        job = service.wait_state(service.submit(job_of(f"sha256:{name}.glb")), "succeeded")
        report = service.get(f"/v1/jobs/{job['id']}/results/report.json").json
        text = "".join(warnings_of(report))
        assert ('the image "a.png" is a separate file, which an uploaded mesh cannot name' in text) == (kind == "separate")
        assert len(report["inputs"]) == 1
    data = textured.obj(vertices, faces, uv).encode()
    name = hashlib.sha256(data).hexdigest()
    service.request("PUT", f"/v1/inputs/{name}", data)
    job = service.wait_state(service.submit(job_of(f"sha256:{name}.obj")), "failed")
    assert job["error"]["code"] == "attribute_missing" and "upload a .glb file" in job["error"]["message"]
