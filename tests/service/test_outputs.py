# SPDX-License-Identifier: Apache-2.0
"""What a job writes on request: meshes, pictures from a given camera, turntables, and the report's word on them."""
import csv
import json
import math
import shutil
import struct
import subprocess

import numpy
import pytest
from scipy.spatial import ConvexHull, cKDTree
from scipy.stats import spearmanr

from readers import EVERY, Points, exr_attributes, read_columns, read_exr, read_mesh, read_png
from service import PATIENCE_S, sphere

ELLIPSOID = {"shape": "ellipsoid", "center": [0, 0, 0], "radii": [1, 1, 0.02]}


@pytest.fixture
def run(worker, tmp_path):
    """Runs a job that must succeed; its directory and report."""
    def call(spec, output="out"):
        done = worker(spec, output=output)
        assert done.returncode in (0, 10, 11), done.stderr
        return tmp_path / output, json.loads((tmp_path / output / "report.json").read_text())
    return call


def output(**asked):
    return {"preview": False, **asked}


# ---- mesh.ply

def directed_edges(faces):
    return numpy.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


@pytest.mark.parametrize("form", ["binary_little_endian", "ascii"])
def test_the_mesh_of_a_sphere(run, form):
    """On a sphere the restricted Delaunay triangulation is the convex hull."""
    where, report = run(sphere(400, output=output(mesh=True, ply={"format": form, "precision": "double"})))
    points = Points((where / "points.ply").read_bytes())
    names, vertices, faces = read_mesh((where / "mesh.ply").read_bytes())
    assert names == ["x", "y", "z", "nx", "ny", "nz", "spacing_local"]
    assert (vertices[:, :3] == points.position).all() and (vertices[:, 3:6] == points.normal).all()
    hull = ConvexHull(points.position)
    assert {tuple(sorted(f)) for f in faces} == {tuple(sorted(f)) for f in hull.simplices}
    edges = {tuple(e) for e in directed_edges(faces)}
    assert len(edges) == 3 * len(faces) and all((b, a) in edges for a, b in edges)  # closed, all facing one way
    a, b, c = (points.position[faces[:, k]] for k in range(3))
    assert abs((a * numpy.cross(b, c)).sum() / 6 / hull.volume - 1) < 1e-12  # which is outwards
    told = report["mesh"]
    assert told.pop("radius_ratio") > 0.95
    assert told == {"triangles": len(faces), "closing_triangles": 0, "euler": 2, "boundary_edges": 0, "rim_edges": 0, "nonmanifold_edges": 0, "seam_edges": 0,
                    "nonmanifold_vertices": 0, "closed": True}
    assert [o["name"] for o in report["outputs"]] == ["points.ply", "mesh.ply"]
    assert report["surface"]["warnings"] == []


def test_a_mesh_of_10_000_points_is_of_good_triangles(run):
    _, report = run(sphere(10000, output=output(mesh=True), surface={"analytic": {"shape": "quartic"}}))
    assert report["mesh"]["closed"] and report["mesh"]["euler"] == 2 and report["mesh"]["radius_ratio"] >= 0.97


def test_a_mesh_ends_at_rims_alone(run):
    half = {"min": [-2, -2, 0], "max": [2, 2, 2]}
    where, report = run(sphere(500, output=output(mesh=True), region=half))
    _, vertices, faces = read_mesh((where / "mesh.ply").read_bytes())
    edges = {tuple(e) for e in directed_edges(faces)}
    ends = {i for a, b in edges if (b, a) not in edges for i in (a, b)}
    assert len(ends) == report["mesh"]["boundary_edges"] == report["mesh"]["rim_edges"] > 20
    assert vertices[list(ends), 2].max() < 0.5 * report["spacing"]
    assert report["mesh"]["euler"] == 1 and not report["mesh"]["closed"]
    assert not any("mesh.ply" in w for w in report["surface"]["warnings"])


def test_sheets_that_are_not_told_apart_are_told(run):
    _, report = run(sphere(100, output=output(mesh=True), surface={"analytic": ELLIPSOID}))
    assert not report["mesh"]["closed"]
    assert any("mesh.ply has holes or non-manifold edges" in w for w in report["surface"]["warnings"])


# ---- pictures

def projected(matrix, places):
    """Row vectors times a 4 x 4, divided by the last."""
    moved = numpy.c_[places, numpy.ones(len(places))] @ matrix
    return moved[:, :3] / moved[:, 3:]


CAMERAS = [
    {},
    {"camera": {"position": [3, -2, 1], "target": [0.1, 0, 0], "fov": 0.9}},
    {"camera": {"position": [3, -2, 1], "target": [0.1, 0, 0], "up": [0, 1, 0], "orthographic": 3}},
]


@pytest.mark.parametrize("preview", CAMERAS)
def test_matrices_of_a_picture(run, preview):
    """As OpenEXR's standard attributes are defined."""
    where, report = run(sphere(300, output={"preview": {"size": [160, 120], "channels": "all", **preview}, "preview_exr": True}))
    data = (where / "preview.exr").read_bytes()
    width, height, image = read_exr(data)
    attributes = exr_attributes(data)
    to_camera, to_ndc = (numpy.array(struct.unpack("<16f", attributes[name])).reshape(4, 4)
                         for name in ("worldToCamera", "worldToNDC"))
    shown = image["id"] > 0
    rows, columns = numpy.nonzero(shown)
    places = numpy.stack([image[f"P.{axis}"][shown] for axis in "XYZ"], axis=1)
    assert len(places) > 1000
    ndc = projected(to_ndc, places)
    dots = numpy.abs(ndc[:, :2] - numpy.c_[(columns + 0.5) / width, (rows + 0.5) / height]) * [width, height]
    assert numpy.median(dots) < 1e-3 and numpy.quantile(dots, 0.99) < 1e-2  # at the silhouette a place is a point's
    seen = projected(to_camera, places)
    assert numpy.abs(seen[:, 2] - image["Z"][shown]).max() < 1e-5
    right, up, forward = to_camera[:3, :3].T
    assert numpy.allclose(numpy.cross(right, up), -forward, atol=1e-6)  # left-handed
    (wide,), middle = struct.unpack("<f", attributes["screenWindowWidth"]), struct.unpack(
        "<2f", attributes["screenWindowCenter"])
    depth = 1 if "orthographic" in preview.get("camera", {}) else seen[:, 2]
    across = (seen[:, 0] / depth - middle[0]) / wide + 0.5
    assert numpy.quantile(numpy.abs(across * width - columns - 0.5), 0.99) < 1e-2
    if preview:
        eye = projected(numpy.linalg.inv(to_camera), numpy.zeros((1, 3)))[0]
        assert numpy.allclose(eye, preview["camera"]["position"], atol=1e-5)


def test_channels_of_a_picture(run):
    """By default those from which, with the points, the others follow."""
    pictures = {}
    for channels in ({}, {"channels": "all"}):
        where, _ = run(sphere(300, output={"preview": {"size": 96, **channels}, "preview_exr": True}))
        pictures[len(channels)] = (where / "preview.exr").read_bytes()
    (_, _, few), (_, _, all_channels) = (read_exr(pictures[k]) for k in (0, 1))
    assert set(few) == {*"RGBAZ", "id"} and len(all_channels) == 14
    assert all((few[name] == all_channels[name]).all() for name in few)
    to_camera, to_ndc = (numpy.array(struct.unpack("<16f", exr_attributes(pictures[0])[name])).reshape(4, 4)
                         for name in ("worldToCamera", "worldToNDC"))
    shown = few["id"] > 0
    places = numpy.stack([all_channels[f"P.{axis}"][shown] for axis in "XYZ"], axis=1)
    rows, columns = numpy.nonzero(shown)
    to_clip = numpy.linalg.inv(to_camera) @ to_ndc  # from camera space; the ray through a pixel, as deep as Z says
    deep = few["Z"][shown]
    across = numpy.linalg.inv(to_clip[:2, :2].T) @ ((numpy.c_[columns, rows] + 0.5) / 96 * deep[:, None]
                                                    - deep[:, None] * to_clip[2, :2] - to_clip[3, :2]).T
    found = projected(numpy.linalg.inv(to_camera), numpy.c_[across.T, deep])
    assert numpy.quantile(numpy.abs(found - places), 0.99) < 1e-3  # at the silhouette a place is a point's


def test_the_picture_with_data_is_compressed_without_loss(run):
    """By default, and every pixel is as without compression."""
    read = {}
    for asked in ({}, {"compression": "none"}):
        where, _ = run(sphere(300, output={"preview": {"size": [96, 80], **asked}, "preview_exr": True}))
        read[len(asked)] = (where / "preview.exr").read_bytes()
    assert len(read[0]) < 0.4 * len(read[1])
    (wide, high, packed), (*_, plain) = read_exr(read[0]), read_exr(read[1])
    assert (wide, high) == (96, 80) and set(packed) == set(plain)
    assert all((packed[name] == plain[name]).all() for name in plain)


@pytest.mark.sanitized
def test_the_picture_with_data_is_written_on_request(run):
    spec = sphere(100, output={"preview": {"size": 64}, "preview_exr": True})
    for asked in (True, False):  # an earlier file of the directory goes
        if not asked:
            del spec["output"]["preview_exr"]
        where, report = run(spec)
        assert ("preview.exr" in [o["name"] for o in report["outputs"]]) == (where / "preview.exr").exists() == asked
        assert (where / "preview.png").exists()


def colour_and_value(where, value):
    """Of each point with a large disc in preview.exr: green over blue, which rises along the scale of colours (viridis), and its value."""
    _, _, picture = read_exr((where / "preview.exr").read_bytes())
    ids = picture["id"].astype(int)
    shown, pixels = numpy.unique(ids[ids > 0], return_counts=True)
    shown = shown[pixels > 12]
    return [numpy.median(picture["G"][ids == k] / picture["B"][ids == k]) for k in shown], value[shown - 1]


@pytest.mark.sanitized
@pytest.mark.parametrize("colour, name", [("alpha", "alpha"), ("curvature", "kappa"), ("energy", "energy"), ("spacing", "spacing_local")])
def test_colours_rise_with_the_quantity(run, colour, name):
    ellipsoid = {"analytic": {"shape": "ellipsoid", "center": [0, 0, 0], "radii": [1, 0.8, 0.5]}}
    sampling = {"count": 300, **({"alpha": {"d": 1}} if colour == "alpha" else {})}
    where, _ = run(sphere(surface=ellipsoid, sampling=sampling,
                          output={"preview": {"size": 128, "color": colour}, "preview_exr": True, "ply": EVERY}))
    colours, values = colour_and_value(where, read_columns((where / "points.ply").read_bytes())[name])
    assert len(values) > 50 and spearmanr(colours, values).statistic > 0.995


GRADED_ELLIPSOID = {"analytic": {"shape": "ellipsoid", "center": [0, 0, 0], "radii": [1, 0.8, 0.5]}}


@pytest.mark.parametrize("graded", [False, True])
def test_the_default_picture_is_shaded_or_shows_the_grading(run, graded):
    grading = {"curvature": {"ratio": 3}} if graded else {}
    where, _ = run(sphere(surface=GRADED_ELLIPSOID, sampling={"count": 300, **grading}, output={"preview": {"size": 128}, "preview_exr": True}))
    columns = read_columns((where / "points.ply").read_bytes())
    colours, spacings = colour_and_value(where, columns["spacing_local"])
    if graded:
        assert spearmanr(colours, spacings).statistic > 0.995
    else:
        assert numpy.ptp(colours) < 0.01 * colours[0]  # one colour, of any brightness
    _, _, picture = read_exr((where / "preview.exr").read_bytes())
    assert numpy.ptp(picture["G"][picture["id"] > 0]) > 0.3  # and shaded


def test_colours_of_points_are_those_of_the_curvature_whatever_the_picture_shows(run):
    def colours(color):
        preview = {"size": 64, **({"color": color} if color else {})}
        where, _ = run(sphere(surface=GRADED_ELLIPSOID, sampling={"count": 300}, output={"preview": preview, "ply": {"properties": ["nx", "ny", "nz", "kappa", "red", "green", "blue"]}}), output=f"of_{color}")
        columns = read_columns((where / "points.ply").read_bytes())
        return numpy.stack([columns[name] for name in ("red", "green", "blue")]), columns["kappa"]
    expected, kappa = colours("curvature")
    assert spearmanr(expected[1], kappa).statistic > 0.95
    for color in (None, "shading", "spacing", "degree"):
        assert (colours(color)[0] == expected).all(), color


@pytest.mark.parametrize("bounded", [False, True])
def test_frames_have_one_scale_from_the_spec_alone(build, tmp_path, bounded):
    """Without bounds of the spacing there is none, and frames are shaded."""
    bounds = {"min_spacing": 0.05, "max_spacing": 0.4} if bounded else {}
    spec = json.dumps({"version": 1, "surface": GRADED_ELLIPSOID, "sampling": {"count": 300, "curvature": {"ratio": 3}, **bounds},
                       "output": {"preview": {"size": 128}, "preview_exr": True},
                       "queue": {"frames": "1-2", "by_frame": {"/surface/analytic/radii": [[1, 0.8, 0.5], [2, 1.6, 1]]}}})
    found = []
    for frame in ("1", "2"):
        done = subprocess.run([build / "hexad-worker", "run", "-", "--output", tmp_path / frame, "--frame", frame], input=spec, text=True,
                              capture_output=True, timeout=PATIENCE_S)
        assert done.returncode in (0, 10), done.stderr
        columns = read_columns((tmp_path / frame / "points.ply").read_bytes())
        found.append(colour_and_value(tmp_path / frame, columns["spacing_local"]))
    colours, spacings = (numpy.concatenate(part) for part in zip(*found))
    if bounded:
        assert spearmanr(colours, spacings).statistic > 0.995
    else:
        assert numpy.ptp(colours) < 0.01 * colours[0]


@pytest.mark.sanitized
def test_points_with_five_and_seven_neighbours_have_a_colour_of_their_own(run):
    """On a sphere the neighbours are those of the convex hull."""
    where, _ = run(sphere(300, output={"preview": {"size": 128, "color": "degree"}, "preview_exr": True}))
    hull = ConvexHull(Points((where / "points.ply").read_bytes()).position)
    colours, degrees = colour_and_value(where, numpy.bincount(hull.simplices.ravel()))
    assert {5, 6} <= set(degrees) and len(set(zip(degrees, numpy.round(colours, 1)))) == len(set(degrees))
    assert spearmanr(numpy.round(colours, 1), degrees).statistic == pytest.approx(1)


@pytest.mark.sanitized
def test_a_turntable(run):
    """Its frames differ, are listed, and go when the next run asks for fewer."""
    ask = {"size": 64, "turntable": 3}
    where, report = run(sphere(100, surface={"analytic": {"shape": "gyroid", "period": 1}}, output={"preview": ask}))
    frames = [f"preview.{k:04d}.png" for k in (1, 2, 3)]
    assert [o["name"] for o in report["outputs"]] == ["points.ply", "preview.png", *frames]
    pictures = [read_png((where / name).read_bytes())[2] for name in frames]
    assert all((pictures[k] != pictures[k - 1]).any() for k in range(3))
    where, report = run(sphere(100, output={"preview": {**ask, "turntable": 1}}))
    assert sorted(p.name for p in where.iterdir()) == sorted(
        ["points.ply", "preview.png", "report.json", "summary.json", frames[0]])


@pytest.mark.sanitized
def test_convergence(run):
    where, report = run(sphere(200, output=output(convergence=True)))
    assert [o["name"] for o in report["outputs"]] == ["points.ply", "convergence.csv"]
    with open(where / "convergence.csv", newline="") as file:
        rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
    assert [row["sweep"] for row in rows] == list(range(1, report["sweeps_total"] + 1))
    assert rows and all(rows[sweep["sweep"] - 1] == sweep for sweep in report["sweeps"])


# ---- points.vdb, by readers that are not ours

@pytest.fixture
def grid_file(run):
    where, report = run(sphere(1000, output=output(points_vdb=True)))
    assert [o["name"] for o in report["outputs"]] == ["points.ply", "points.vdb"]
    return where / "points.vdb"


def tool(name):
    path = shutil.which(name)
    if not path:
        pytest.skip(f"there is no {name} (Debian: libopenvdb-tools)")
    return path


def test_vdb_print_lists_the_points(grid_file):
    done = subprocess.run([tool("vdb_print"), "-l", grid_file], capture_output=True, text=True, check=True,
                          timeout=PATIENCE_S)
    assert "Name: points\n" in done.stdout and "Type: Tree_ptdataidx32_5_4_3\n" in done.stdout
    (spacing,) = {float(line.split(":")[1]) for line in done.stdout.splitlines() if "voxel size:" in line}
    assert spacing == pytest.approx(3 * math.sqrt(8 * math.pi / (math.sqrt(3) * 1000)), rel=2e-3)  # of three digits


def test_vdb_tool_reads_the_points(grid_file, tmp_path):
    """OpenVDB's own conversion of a points grid to a PLY file, which has positions alone."""
    subprocess.run([tool("vdb_tool"), "-read", grid_file, "-vdb2points", "-write", tmp_path / "back.ply"], check=True,
                   capture_output=True, timeout=PATIENCE_S)
    head, _, body = (tmp_path / "back.ply").read_bytes().partition(b"end_header\n")
    assert b"element vertex 1000\n" in head
    back = numpy.frombuffer(body, "<f4", 3000).reshape(1000, 3)
    points = Points((grid_file.parent / "points.ply").read_bytes())
    apart, nearest = cKDTree(points.position).query(back)
    assert apart.max() < 2e-7 and len(set(nearest)) == 1000


def test_the_same_points_give_the_same_grid(run):
    first, again = (run(sphere(300, output=output(points_vdb=True)), output=name)[1]["outputs"][1]
                    for name in ("one", "two"))
    assert first == again
