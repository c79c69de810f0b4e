# SPDX-License-Identifier: Apache-2.0
"""Maps of spacings on the vertices of meshes (sampling.grid): the points have the spacings of the same function as they would have by
a volume, whatever the format and the surface; what is refused; and that the file is an input like all others."""
import base64
import hashlib
import json

import numpy
import pytest

import gifti_files
from ply_files import write_ply
from readers import read_columns
from service import expect_problem
from vtk_files import write_xml

N = 72
TORUS = {"analytic": {"shape": "torus", "major_radius": 1, "minor_radius": 0.4, "center": [0, 0, 0]}}


def torus():
    """Vertices and triangles of a torus."""
    u, v = numpy.meshgrid(numpy.arange(N) * 2 * numpy.pi / N, numpy.arange(N) * 2 * numpy.pi / N)
    wide = 1 + 0.4 * numpy.cos(v)
    vertices = numpy.stack([wide * numpy.cos(u), wide * numpy.sin(u), 0.4 * numpy.sin(v)], -1).reshape(-1, 3)
    at = numpy.arange(N * N).reshape(N, N)
    right, up = numpy.roll(at, -1, 1), numpy.roll(at, -1, 0)
    quads = numpy.stack([at, right, numpy.roll(right, -1, 0), up], -1).reshape(-1, 4)
    return vertices, numpy.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def painted(x):
    """Spacings of 1 to 5 along x."""
    return 3 + 2 * numpy.clip(x / 1.4, -1, 1)


def density(x):
    return painted(x) ** -2


@pytest.fixture
def sample(solve):
    """Columns and report of a job with this map, or the error and None."""
    def run(surface, grid, count=2000, **sampling):
        told, data = solve({"version": 1, "surface": surface, "sampling": {"count": count, "grid": grid, **sampling},
                            "solver": {"threads": 1}, "output": {"preview": False, "ply": {"precision": "double"}}})
        return (read_columns(data), told) if data else (told, None)
    return run


def write_vtp(path, vertices, faces, name, values):
    write_xml(path, [(vertices, {"Polys": faces.tolist()})], mode="appended", values=[{name: values}])


def write_gifti(path, vertices, faces, name, values):
    gifti_files.write(path, gifti_files.array("POINTSET", vertices), gifti_files.array("TRIANGLE", faces.astype("i4")),
                      gifti_files.array("SHAPE", values.astype("f4"), name=name))


def colors(red, green):
    return {"red": ("uchar", red), "green": ("uchar", green), "blue": ("uchar", numpy.zeros(len(red), int))}


# What is written, and the map beside its path. In colours a step is 1/255, so the range is 5:1 from 51 to 255.
PAINTINGS = {
    "quality": (lambda p, v, f: write_ply(p, v, f, {"quality": ("float", painted(v[:, 0]))}, "binary_little_endian"), "m.ply", {"name": "quality"}),
    "density": (lambda p, v, f: write_ply(p, v, f, {"weight": ("double", 7 * density(v[:, 0]))}, "ascii"), "m.ply",
                {"name": "weight", "kind": "density"}),
    "color": (lambda p, v, f: write_ply(p, v, f, colors(numpy.full(len(v), 9), numpy.rint(51 * painted(v[:, 0])).astype(int)), "binary_big_endian"),
              "m.ply", {"name": "color", "component": 1}),
    "a name of the library": (lambda p, v, f: write_ply(p, v, f, {"group": ("float", painted(v[:, 0]))}, "ascii"), "m.ply", {"name": "group"}),
    "GIfTI": (lambda p, v, f: write_gifti(p, v, f, "size", painted(v[:, 0])), "m.surf.gii", {"name": "size"}),
    "VTK": (lambda p, v, f: write_vtp(p, v, f, "size field", numpy.stack([0 * v[:, 0], 3e-4 * painted(v[:, 0])], -1)), "m.vtp",
            {"name": "size field", "component": 1}),
}


@pytest.mark.sanitized
@pytest.mark.parametrize("painting", PAINTINGS)
@pytest.mark.parametrize("is_surface", [True, False], ids=["the mesh is the surface", "the surface is a formula"])
def test_points_have_the_painted_spacings(sample, diagnose, tmp_path, painting, is_surface):
    write, name, grid = PAINTINGS[painting]
    write(tmp_path / name, *torus())
    surface = {"mesh": {"path": name}} if is_surface else TORUS
    columns, report = sample(surface, grid if is_surface else {"path": name, **grid})
    assert report, columns
    ratio = columns["spacing"] / painted(columns["x"])
    grading = report["quality"]["grading"]
    diagnose(f"requested over painted cv {ratio.std() / ratio.mean():.4f}, {grading}")
    assert ratio.std() / ratio.mean() < 0.01 and columns["spacing"].max() > 4.5 * columns["spacing"].min()
    assert grading["cv"] <= 0.02 and abs(grading["exponent"] - 1) < 0.02
    assert [i["path"] for i in report["inputs"]] == [name]
    assert report["inputs"][0]["sha256"] == hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()


def test_bounds_of_the_spacing_hold_for_painted_meshes(sample, tmp_path):
    vertices, faces = torus()
    write_ply(tmp_path / "m.ply", vertices, faces, {"quality": ("float", painted(vertices[:, 0]))}, "ascii")
    free, _ = sample({"mesh": {"path": "m.ply"}}, {"name": "quality"})
    low, high = 1.5 * free["spacing"].min(), 0.7 * free["spacing"].max()
    held, report = sample({"mesh": {"path": "m.ply"}}, {"name": "quality"}, min_spacing=low, max_spacing=high)
    assert report, held
    assert held["spacing"].min() > 0.999 * low and held["spacing"].max() < 1.001 * high
    assert (held["spacing"] < 1.001 * low).mean() > 0.05 and (held["spacing"] > 0.999 * high).mean() > 0.05


def test_a_density_of_0_leaves_the_spacing_to_its_growth(sample, tmp_path):
    vertices, faces = torus()
    write_ply(tmp_path / "m.ply", vertices, faces, {"d": ("float", vertices[:, 0] > 0)}, "ascii")
    columns, report = sample({"mesh": {"path": "m.ply"}}, {"name": "d", "kind": "density"}, gradation=0.5)
    assert report, columns
    assert columns["spacing"][columns["x"] > 0.4].std() < 0.01 * columns["spacing"].min()
    assert columns["spacing"][columns["x"] < -1].min() > 3 * columns["spacing"].min()


def step(x):
    """Spacings of 1 to 4 within a quarter of the torus's tube."""
    return 1 + 3 / (1 + numpy.exp(x / 0.05))


@pytest.mark.parametrize("kind, gradation", [("spacing", 0.2), ("density", 0.2), ("spacing", 1)])
def test_a_map_that_gradation_cuts_is_told(sample, diagnose, tmp_path, kind, gradation):
    """The share and the largest cut are those of the points."""
    vertices, faces = torus()
    values = step(vertices[:, 0]) if kind == "spacing" else step(vertices[:, 0]) ** -2
    write_ply(tmp_path / "m.ply", vertices, faces, {"quality": ("float", values)}, "ascii")
    columns, report = sample({"mesh": {"path": "m.ply"}}, {"name": "quality", "kind": kind}, gradation=gradation)
    grading = report["grading"]
    asked = step(columns["x"]) * grading["scale"] * (1 if kind == "spacing" else numpy.sqrt(2 / numpy.sqrt(3)))
    cut = 1 - columns["spacing"] / asked
    diagnose(f"{(cut > 0.05).mean():.3f} of the points, up to {cut.max():.3f}; {grading}")
    assert abs(grading["cut_share"] - (cut > 0.05).mean()) < 0.015 and abs(grading["largest_cut"] - cut.max()) < 0.05
    told = [text for text in report["surface"]["warnings"] if "sampling.gradation" in text]
    assert len(told) == (grading["cut_share"] > 0.05) == (gradation == 0.2)
    assert all(f"by up to {100 * grading['largest_cut']:.3g} %" in text for text in told)


@pytest.mark.parametrize("aside, is_far", [(0, False), (0.02, False), (0.5, True), (50, True)])
def test_a_mesh_beside_the_surface_is_told(solve, tmp_path, aside, is_far):
    """A map, and the mesh of an attribute."""
    vertices, faces = torus()
    write_ply(tmp_path / "m.ply", vertices + [aside, 0, 0], faces, {"quality": ("float", painted(vertices[:, 0]))}, "ascii")
    for name, words in (("sampling", "sampling.grid: "), ("attributes", 'attribute "paint": ')):
        more = ({"sampling": {"count": 1000, "grid": {"path": "m.ply", "name": "quality"}}} if name == "sampling"
                else {"sampling": {"count": 1000}, "attributes": [{"from": "m.ply", "name": "quality", "as": "paint"}]})
        report, data = solve({"version": 1, "surface": TORUS, "output": {"preview": False}, **more})
        assert data, report
        told = [text for text in report["surface"]["warnings"] if "farther than a spacing" in text]
        assert len(told) == is_far and all(text.startswith(words) and "units" in text for text in told)


def test_voxels_beside_the_surface_are_told(solve, tmp_path):
    """Those of half of the surface: elsewhere the map requests nothing."""
    vdb = pytest.importorskip("pyopenvdb", reason="there is no pyopenvdb to write maps with")
    for low, is_far in ((-15, False), (0, True)):
        grid = vdb.FloatGrid(0.0)
        grid.name = "spacing"
        grid.transform = vdb.createLinearTransform(voxelSize=0.1)
        grid.copyFromArray(numpy.ones((16 - low, 31, 31), numpy.float32), ijk=(low, -15, -15))
        vdb.write(str(tmp_path / "map.vdb"), grids=[grid])
        report, data = solve({"version": 1, "surface": TORUS, "output": {"preview": False},
                              "sampling": {"count": 1000, "grid": {"path": "map.vdb", "name": "spacing"}}})
        assert data, report
        assert any("farther than a spacing from the map" in text for text in report["surface"]["warnings"]) == is_far


FAULTS = {
    "no name": ({"name": "qualify"}, "attribute_missing", 'm.ply: the mesh has no "qualify": choose one of "color", '),
    "no component": ({"name": "color"}, "input_unsupported", '"color" has 4 components: set /sampling/grid/component to one of 0 to 3'),
    "a component too many": ({"name": "quality", "component": 1}, "input_unsupported", '"quality" has 1 component: set /sampling/grid/component'),
    "a component of a grid": ({"path": "EXAMPLE", "name": "trefoil", "component": 0}, "spec_invalid", "/sampling/grid/component: "),
    "0": ({"name": "zero"}, "input_unsupported", "the value 0 at a place of the surface: a spacing is above 0"),
    "0 everywhere": ({"name": "zero", "kind": "density"}, "input_unsupported", "requests no points anywhere"),
    "not a number": ({"name": "hole"}, "input_damaged", 'm.ply: "hole" is not finite at vertex 7: replace its value'),
    "no mesh": ({"path": "notes.txt", "name": "quality"}, "input_unsupported", "notes.txt: its format is not known"),
}


@pytest.mark.sanitized
@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_refused(sample, example, tmp_path, fault):
    grid, code, words = FAULTS[fault]
    vertices, faces = torus()
    hole = numpy.ones(len(vertices))
    hole[7] = numpy.nan
    write_ply(tmp_path / "m.ply", vertices, faces, {"quality": ("float", painted(vertices[:, 0])), "zero": ("float", 0 * hole[0] * vertices[:, 0]),
                                                    "hole": ("float", hole), **colors(numpy.arange(len(vertices)) % 256, vertices[:, 0] > 0)},
              "binary_little_endian")
    (tmp_path / "notes.txt").write_text("wider at the ears\n")
    error, none = sample({"mesh": {"path": "m.ply"}}, {k: str(example) if v == "EXAMPLE" else v for k, v in grid.items()}, 100)
    assert none is None and error["code"] == code and words in error["message"], error


@pytest.mark.sanitized
@pytest.mark.parametrize("at", [2, 5])
@pytest.mark.parametrize("name", ["map.ply", "map.obj"])
def test_a_number_of_a_map_in_another_file_is_read_to_its_end(sample, tmp_path, name, at):
    """A decimal comma in row 7 of the vertices, in z or a colour."""
    vertices, faces = torus()
    write_ply(tmp_path / name, vertices, faces, colors(numpy.full(len(vertices), 9), 51 * numpy.ones(len(vertices), int)), "ascii")
    rows = (tmp_path / name).read_text().splitlines()
    head = rows.index("end_header") + 1
    row = rows[head + 7].split()
    rows[head + 7] = " ".join([*row[:at], row[at] + ",5", *row[at + 1:]])
    if name == "map.obj":
        rows = [*("v " + r for r in rows[head:head + len(vertices)]), *("f %d %d %d" % tuple(f + 1) for f in faces)]
        head = 0
    (tmp_path / name).write_text("\n".join(rows) + "\n")
    told, report = sample(TORUS, {"path": name, "name": "color", "component": 1}, 100)
    if name == "map.obj" and at == 5:
        assert "/sampling/grid: 1 vertices: a word after x y z is not a number; the rest of the line is skipped" in report["surface"]["warnings"]
    else:
        assert report is None and told["code"] == "input_damaged" and f"{name}: line {head + 8} of the " in told["message"], told


def test_warnings_about_a_map_in_another_file_name_the_map(sample, tmp_path):
    vertices, faces = torus()
    write_vtp(tmp_path / "m.vtp", vertices, faces, "size", painted(vertices[:, 0]))
    text = (tmp_path / "m.vtp").read_bytes().replace(b"<Piece ", b'<Piece NumberOfVerts="1" ', 1)
    verts = b'<Verts><DataArray type="Int64" Name="connectivity" format="ascii">0</DataArray><DataArray type="Int64" Name="offsets" format="ascii">1</DataArray></Verts>'
    (tmp_path / "m.vtp").write_bytes(text.replace(b"</Piece>", verts + b"</Piece>", 1))
    for surface, begin in ((TORUS, "/sampling/grid: the mesh has 1 points or lines"), ({"mesh": {"path": "m.vtp"}}, "the mesh has 1 points or lines")):
        _, report = sample(surface, {"path": "m.vtp", "name": "size"}, 200)
        (warning,) = (w for w in report["surface"]["warnings"] if "points or lines" in w)
        assert warning.startswith(begin)


def test_a_part_without_the_value_is_not_black(sample, solve, tmp_path):
    """glTF: the second primitive has no COLOR_0."""
    vertices, faces = torus()
    data = vertices.astype("f4").tobytes() + faces.astype("u4").tobytes() + numpy.full((len(vertices), 4), 0.5, "f4").tobytes()
    views, at = [], 0
    for length in (vertices.size * 4, faces.size * 4, len(vertices) * 16):
        views.append({"buffer": 0, "byteOffset": at, "byteLength": length})
        at += length
    half = faces.size // 2
    accessors = [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": len(vertices), "min": [-2, -2, -2], "max": [2, 2, 2]},
                 *({"bufferView": 1, "byteOffset": 4 * half * k, "componentType": 5125, "type": "SCALAR", "count": half} for k in (0, 1)),
                 {"bufferView": 2, "componentType": 5126, "type": "VEC4", "count": len(vertices)}]
    primitives = [{"attributes": {"POSITION": 0, "COLOR_0": 3}, "indices": 1}, {"attributes": {"POSITION": 0}, "indices": 2}]
    (tmp_path / "m.gltf").write_text(json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], "meshes": [{"primitives": primitives}],
        "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(data), "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}]}))
    error, none = sample({"mesh": {"path": "m.gltf"}}, {"name": "color", "component": 0, "kind": "density"}, 100)
    assert none is None and error["code"] == "input_damaged" and '"color" is not finite at vertex' in error["message"], error
    report, data = solve({"version": 1, "surface": {"mesh": {"path": "m.gltf"}}, "sampling": {"count": 200}, "attributes": [{"name": "color"}],
                          "output": {"preview": False}})
    assert data and any("have a value that is not finite" in w for w in report["surface"]["warnings"]), report


def test_frames_have_maps_of_their_own(worker, tmp_path):
    """The map is in the file of the frame, which is the surface's."""
    vertices, faces = torus()
    for frame, sign in ((1, 1), (2, -1)):
        write_ply(tmp_path / f"m{frame}.ply", vertices, faces, {"quality": ("float", painted(sign * vertices[:, 0]))}, "ascii")
    spec = {"version": 1, "surface": {"mesh": {"path": "m%d.ply"}}, "sampling": {"count": 600, "grid": {"name": "quality"}},
            "queue": {"frames": "1-2"}, "output": {"preview": False}}
    for frame, sign in ((1, 1), (2, -1)):
        assert worker(spec, "--frame", frame, output=f"out{frame}").returncode == 0
        columns = read_columns((tmp_path / f"out{frame}" / "points.ply").read_bytes())
        assert (columns["spacing"] * sign)[columns["x"] > 1].mean() > (columns["spacing"] * sign)[columns["x"] < -1].mean()


def test_the_service_checks_the_map_as_any_input(service, tmp_path):
    """Roots, uploads and estimates."""
    vertices, faces = torus()
    write_ply(tmp_path / "m.ply", vertices, faces, {"quality": ("float", painted(vertices[:, 0]))}, "ascii")
    spec = {"version": 1, "surface": TORUS, "sampling": {"count": 500, "grid": {"path": "/etc/m.ply", "name": "quality"}},
            "output": {"preview": False}}
    expect_problem(service.post("/v1/jobs", spec), 403, "path_forbidden", "/sampling/grid/path")
    data = (tmp_path / "m.ply").read_bytes()
    digest = hashlib.sha256(data).hexdigest()
    spec["sampling"]["grid"]["path"] = f"sha256:{digest}.ply"
    expect_problem(service.post("/v1/jobs", spec), 422, "input_missing", "/sampling/grid/path")
    assert service.request("PUT", f"/v1/inputs/{digest}", data).status == 201
    estimate = service.post("/v1/jobs:validate", spec).json["estimate"]
    assert estimate["count"] == 500 and estimate["memory_bytes"] > 0
    job = service.submit(spec)
    service.wait_state(job, "succeeded")
    assert [i["sha256"] for i in service.get(f"/v1/jobs/{job}/results/report.json").json["inputs"]] == [digest]
    spec["sampling"]["grid"]["name"] = "qualify"
    expect_problem(service.post("/v1/jobs:validate", spec), 422, "attribute_missing")


def test_an_inspection_lists_the_values_of_vertices(worker, tmp_path):
    vertices, faces = torus()
    write_vtp(tmp_path / "m.vtp", vertices, faces, "size", numpy.stack([painted(vertices[:, 0]), vertices[:, 2]], -1))
    found = json.loads(worker("m.vtp", "--json", command="inspect", output=None).stdout)["mesh"]["values"]
    (size,) = found
    assert size["name"] == "size" and size["minimum"] == pytest.approx([1, -0.4]) and size["maximum"] == pytest.approx([5, 0.4])
    assert '  values     "size" 1 -0.4 to 5 0.4\n' in worker("m.vtp", command="inspect", output=None).stdout
