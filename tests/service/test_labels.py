# SPDX-License-Identifier: Apache-2.0
"""The interfaces of a segmentation, as a user hands it to the worker: each once, with its labels, where the shapes truly
are; or an error that says what is wrong."""
import json
import re
import zlib

import numpy
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from label_shapes import PLAIN, TURNED, Balls, Sectors, places
from readers import read_columns, read_face_labels, read_mesh
from service import Service
from volumes import Part, write_exr, write_meta_image, write_nifti, write_nrrd

SIZE, COUNT = 40, 1500
ON_LINE = 1


class Points:
    def __init__(self, data):
        table = read_columns(data)
        self.position, self.normal = (numpy.stack([table[p + a] for a in "xyz"], axis=1) for p in ("", "n"))
        self.feature, self.label_a, self.label_b = (table[n].astype(int) for n in ("feature", "label_a", "label_b"))


@pytest.fixture
def sample(solve, tmp_path):
    """Runs a segmentation; the report and the points, or the error and None."""
    def run(values, count=COUNT, solver=(), output=(), matrix=None, **members):
        write_nrrd(tmp_path / "v.nrrd", values, matrix)
        spec = {"version": 1, "surface": {"labels": {"path": "v.nrrd", **members}}, "sampling": {"count": count},
                "solver": {"threads": 1, **dict(solver)}, "output": {"preview": False, "mesh": True, **dict(output)}}
        told, data = solve(spec)
        return told, data and Points(data)
    return run


def interfaces(report):
    return {tuple(i["labels"]): i for i in report["surface"]["labels"]["interfaces"]}


@pytest.mark.parametrize("turn", [pytest.param(PLAIN, marks=pytest.mark.extended), TURNED], ids=["plain", "turned"])
@pytest.mark.parametrize("kind", [Sectors, Balls])
def test_interfaces_and_lines_lie_where_the_shapes_meet(sample, kind, turn):
    shape = kind(SIZE, turn)
    report, points = sample(shape.labels)
    assert report["outcome"] == "converged"
    assert report["quality"]["coverage"] < 1 and report["quality"]["hex_fraction"] > 0.9
    pairs = numpy.stack([points.label_a, points.label_b], axis=1)
    for pair in interfaces(report):
        of = (points.feature == 0) & (pairs == pair).all(axis=1)
        off = shape.off_interface(points.position[of], pair)
        assert abs(off.mean()) < 0.1 and numpy.sqrt((off ** 2).mean()) < 0.15, pair
        ahead = shape.off_interface(points.position[of] + points.normal[of], pair)
        assert (ahead - off).mean() > 0.97, f"normals of {pair} do not point from the first to the second"
    lines = points.position[points.feature >= ON_LINE]
    inner = (abs(lines - (SIZE - 1) / 2) < SIZE / 2 - 1).all(axis=1)  # the ends of the data are lines, too
    assert inner.sum() > 10
    assert numpy.sqrt((shape.off_lines(lines[inner]) ** 2).mean()) < 0.2


@pytest.mark.extended
@pytest.mark.parametrize("turn", [PLAIN, TURNED], ids=["plain", "turned"])
@pytest.mark.parametrize("kind", [Sectors, Balls])
def test_no_place_of_a_line_is_a_fifth_of_a_voxel_off(sample, kind, turn):
    shape = kind(96, turn)
    points = sample(shape.labels, count=30000, output={"mesh": False})[1]
    lines = points.position[points.feature >= ON_LINE]
    assert shape.off_lines(lines[(abs(lines - 47.5) < 47).all(axis=1)]).max() < 0.2


@pytest.mark.parametrize("kind", [pytest.param(Sectors, marks=pytest.mark.extended), Balls])
def test_smooth_interfaces_tell_their_lines_to_a_twentieth_of_a_voxel(sample, kind):
    """What one window of a few voxels tells is .08 to .1 off."""
    shape = kind(96, TURNED)
    points = sample(shape.labels, count=4000, solver={"max_sweeps": 40}, output={"mesh": False})[1]
    lines = points.position[points.feature >= ON_LINE]
    off = shape.off_lines(lines[(abs(lines - 47.5) < 46).all(axis=1)])
    assert numpy.sqrt((off ** 2).mean()) < 0.05


def test_areas_are_those_of_the_shapes(sample):
    shape = Balls(96, TURNED)
    report, _ = sample(shape.labels, count=300, solver={"max_sweeps": 1}, output={"mesh": False})
    found = interfaces(report)
    for pair, area in shape.areas().items():
        assert found[pair]["area"] == pytest.approx(area, rel=0.005), pair
        assert found[pair]["components"] == 1


@pytest.mark.sanitized
def test_seams_close_and_points_keep_their_distance(sample):
    report, points = sample(Balls(SIZE).labels, count=3000)
    edges = report["mesh"]
    assert edges["boundary_edges"] == 0 and edges["nonmanifold_edges"] == edges["seam_edges"] > 0
    assert not any("mesh.ply has holes" in w for w in report["surface"]["warnings"])
    inside = points.feature == 0
    pairs = points.label_a[inside] * 1000 + points.label_b[inside]
    trees = {p: cKDTree(points.position[inside][pairs == p]) for p in set(pairs)}
    for a in trees:
        for b in trees:
            if a < b:
                assert trees[a].query(trees[b].data)[0].min() > 0.6 * report["spacing"]
    assert len(report["curves"]["list"]) == 4 and report["curves"]["corners"] == 2
    assert sorted(map(sorted, (c["labels"] for c in report["curves"]["list"]))) == [
        [0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]


def cells(count, size):
    """A foam of that many labels."""
    seeds = numpy.random.default_rng(5).uniform(0, size, (count, 3))
    x = numpy.stack(numpy.meshgrid(*3 * [numpy.arange(size)], indexing="ij"), -1)
    return cKDTree(seeds).query(x.reshape(-1, 3))[1].reshape(x.shape[:3]).astype("u2")


@pytest.mark.extended
def test_seams_close_where_interfaces_are_small(sample):
    """Some lines are shorter than the spacing, and corners stand for two."""
    report, _ = sample(cells(12, 48), count=3000, closed=True)
    assert min(c["length"] for c in report["curves"]["list"] if not c["closed"]) < 0.5 * report["spacing"]
    told = report["mesh"]
    assert told["boundary_edges"] <= 8 and told["nonmanifold_vertices"] == 0  # of 9 000; patches of a few points may have a hole
    assert told["nonmanifold_edges"] - told["seam_edges"] <= 4


@pytest.mark.parametrize("style", ["ascii", pytest.param("binary_little_endian", marks=pytest.mark.extended)])
def test_each_label_has_a_closed_mesh_whose_faces_its_neighbours_share(sample, tmp_path, style):
    shape = Balls(64)
    report, _ = sample(shape.labels, count=2000, output={"label_meshes": True, "ply": {"format": style}})
    whole = (tmp_path / "out" / "mesh.ply").read_bytes()
    _, vertices, triangles = read_mesh(whole)
    labels = read_face_labels(whole)
    assert {tuple(pair) for pair in labels} == set(interfaces(report))
    assert {o["name"] for o in report["outputs"]} == {"points.ply", "mesh.ply", *(f"mesh_label_{k}.ply" for k in range(4))}
    fine = Balls(160)  # the truth, by its voxels
    for told in report["mesh"]["labels"]:
        label = told["label"]
        names, part, faces = read_mesh((tmp_path / "out" / told["name"]).read_bytes())
        number = part[:, names.index("point")].astype(int)
        assert numpy.allclose(part[:, :3], vertices[number][:, :3])
        around = labels == label
        shared = {(tuple(sorted(t)), side) for t, side in zip(triangles[around.any(axis=1)], around[around.any(axis=1), 0])}
        assert {tuple(sorted(t)) for t in number[faces]} == {t for t, _ in shared}
        edges = numpy.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        assert len(set(map(tuple, edges))) == len(edges) == told["triangles"] * 3, "each edge once each way: manifold"
        assert set(map(tuple, edges)) == set(map(tuple, edges[:, ::-1])), "closed"
        assert told["open_edges"] == 0 == told["nonmanifold_edges"]
        corner = part[faces][:, :, :3]
        volume = (corner[:, 0] * numpy.cross(corner[:, 1], corner[:, 2])).sum() / 6
        assert volume == pytest.approx(told["volume"], rel=1e-4)
        truth = ((fine.labels == label) if label else -(fine.labels > 0).astype(float)).sum() * (64 / 160) ** 3
        assert volume == pytest.approx(truth, rel=0.015)  # chords have 0.8 % of it
    sample(shape.labels, count=300)
    assert not list((tmp_path / "out").glob("mesh_label_*"))


@pytest.mark.sanitized
def test_too_many_labels_have_no_meshes_of_their_own(sample):
    told, _ = sample(numpy.arange(1000).reshape(10, 10, 10).astype("u2"), output={"label_meshes": True})
    assert told["code"] == "spec_invalid" and "1000 labels" in told["message"] and "groups" in told["message"]
    told, _ = sample(numpy.arange(8).reshape(2, 2, 2).astype("u1"), output={"label_meshes": True, "mesh": False})
    assert told["code"] == "spec_invalid" and "requires mesh: true" in json.dumps(told)


def test_a_ball_of_two_labels_is_the_ball(sample):
    x = numpy.stack(numpy.meshgrid(*3 * [numpy.arange(32.0)], indexing="ij"), -1) - 15.6
    report, points = sample((numpy.linalg.norm(x, axis=-1) < 10).astype("i4") * -7)
    off = numpy.linalg.norm(points.position - 15.6, axis=1) - 10
    assert abs(off.mean()) < 0.05 and numpy.sqrt((off ** 2).mean()) < 0.1
    assert report["surface"]["area"] == pytest.approx(400 * numpy.pi, rel=0.01)
    assert set(points.label_a) == {-7} and set(points.label_b) == {0}
    assert report["quality"]["euler"] == pytest.approx(2) and report["mesh"]["closed"]


# ---- which labels

def blocks():
    """Along x the labels 1, 2, 3, 4, each six voxels wide."""
    labels = numpy.zeros((24, 12, 12), "u2")
    for k in range(4):
        labels[6 * k:6 * k + 6] = k + 1
    return labels


@pytest.mark.sanitized
@pytest.mark.parametrize("members, pairs", [
    ({}, {(1, 2), (2, 3), (3, 4)}),
    ({"labels": [2]}, {(2, 0)}),
    ({"labels": [2, 3], "background": 9}, {(2, 3), (2, 9), (3, 9)}),
    ({"background": 1}, {(2, 1), (2, 3), (3, 4)}),
    ({"groups": [[2, 3]]}, {(1, 2), (2, 4)}),
    ({"interfaces": [[3, 2], [3, 4]]}, {(2, 3), (3, 4)}),
    ({"closed": True}, {(1, 2), (2, 3), (3, 4), (1, -1), (2, -1), (3, -1), (4, -1)}),
    ({"closed": True, "background": 4}, {(1, 2), (2, 3), (3, 4), (1, 4), (2, 4)}),
])
def test_labels_are_chosen_merged_and_closed(sample, members, pairs):
    report, points = sample(blocks(), count=250, **members)
    if members == {"closed": True, "background": 4}:
        pairs = pairs | {(3, 4)}
    assert set(interfaces(report)) == pairs
    assert set(zip(points.label_a, points.label_b)) == pairs
    closed = "closed" in members
    assert (report["mesh"]["boundary_edges"] == 0) == closed


def thin():
    """A sheet and a thread of one voxel, and one voxel alone."""
    labels = numpy.zeros((28, 28, 28), "u1")
    labels[6, 4:24, 4:24], labels[14, 14, 4:24], labels[21, 21, 14] = 1, 2, 3
    return labels


def test_what_is_one_voxel_thin_stays(sample):
    report, points = sample(thin(), count=1200, output={"mesh": False})
    found = interfaces(report)
    assert set(found) == {(0, 1), (0, 2), (0, 3)}
    sheet = points.position[points.label_b == 1]
    middle = (abs(sheet[:, 1:] - 13.5) < 7).all(axis=1)
    assert abs(abs(sheet[middle, 0] - 6) - 0.5).max() < 0.15, "a flat sheet keeps its thickness"
    thread = points.position[points.label_b == 2]
    middle = abs(thread[:, 2] - 13.5) < 7
    assert numpy.linalg.norm(thread[middle, :2] - 14, axis=1).min() > 0.25
    assert (points.label_b == 3).sum() > 0


@pytest.mark.sanitized
def test_small_parts_have_a_point_each(sample):
    labels = thin()
    labels[14, 14, 4:24] = 0
    labels[8::6, 4, 4], labels[4, 8::6, 24] = 3, 3  # eight voxels alone, each far less than a spacing
    report, _ = sample(labels, count=80)
    assert report["spacing"] > 3 and len(report["patches"]["list"]) == 10
    assert min(p["points"] for p in report["patches"]["list"]) >= 1
    assert report["quality"]["coverage"] < 1


def test_small_parts_near_each_other_share_a_point(sample):
    """Half as many parts as points, none of which is worth one: in each heap of eight one has it."""
    labels = numpy.zeros((40, 40, 40), "u1")
    labels[3:12, 4:36, 4:36] = 1
    for x, y, z in [(36, 4, 4), (36, 4, 33), (36, 33, 4), (36, 33, 33), (24, 18, 18), (36, 18, 18)]:
        labels[x:x + 3:2, y:y + 3:2, z:z + 3:2] = 2
    report, points = sample(labels, count=100)
    assert report["patches"]["count"] == 49 and report["spacing"] > 5
    assert report["quality"]["coverage"] < 1
    many, = (i["area"] / (points.label_b == 1).sum() for i in report["surface"]["labels"]["interfaces"] if i["labels"] == [0, 1])
    assert (points.label_b == 1).sum() > 80, "the large part has nearly all"
    assert report["spacing"] == pytest.approx((2 * many / 3 ** 0.5) ** 0.5, rel=0.01), "and is as dense as is told"


def test_small_parts_that_lead_away_from_all_points_get_one(sample):
    """Threads that begin near another, whose point is theirs, too, and end farther away than the spacing."""
    values = numpy.zeros((64, 64, 64), "u1")
    values[6:58, 6:58, 52] = 1  # its two sides are near each other: points crowd there
    for x in range(8, 56, 16):
        for y in range(8, 56, 16):
            values[x:x + 10, y, 20] = 2
            values[x, y + 3:y + 12, 20] = 3
    report, _ = sample(values, count=183)
    assert report["quality"]["coverage"] < 1.2
    assert not any("coverage" in reason for reason in report["outcome_reasons"])


def test_a_mesh_is_whole_where_sheets_are_near_each_other(sample):
    """A slab of two labels, thinner than the spacing: points tell its sides apart by their normals alone."""
    labels = numpy.zeros((48, 48, 48), "u1")
    labels[22:25, 6:42, 6:42], labels[25:28, 6:42, 6:30] = 1, 2
    labels[10:22, 20:23, 20:28] = 1
    report, _ = sample(labels, count=420, output={"label_meshes": True})
    assert report["mesh"]["boundary_edges"] == 0 and report["mesh"]["nonmanifold_edges"] == report["mesh"]["seam_edges"]
    assert [(m["open_edges"], m["nonmanifold_edges"]) for m in report["mesh"]["labels"]] == 3 * [(0, 0)]


@pytest.mark.sanitized
def test_two_hundred_labels(sample):
    """Most interfaces are smaller than the spacing: the points are those of lines."""
    report, points = sample(cells(200, 30), count=2000, solver={"max_sweeps": 10}, output={"mesh": False})
    assert len(report["surface"]["labels"]["materials"]) == 200
    assert set(zip(points.label_a, points.label_b)) <= set(interfaces(report))
    assert len(report["patches"]["list"]) == min(1000, report["patches"]["count"])


# ---- what is thin, and what a user is told of it

@pytest.fixture(scope="module")
def send(build, tmp_path_factory):
    """Sends a job of a segmentation to the daemon; how it ends."""
    where = tmp_path_factory.mktemp("send")
    service = Service(build, where, "--input_roots", where).start()

    def run(values, spec):
        write_nrrd(where / "v.nrrd", values)
        spec["output"] = {"preview": False}
        job = service.submit(spec)
        done = service.wait_state(job, "succeeded", "failed")
        return done["notes"] if done["state"] == "succeeded" else done["error"]
    yield run
    service.clean_up()


def of_labels(count, **members):
    return {"version": 1, "surface": {"labels": {"path": "v.nrrd", **members}}, "sampling": {"count": count}}


def advice(notes, code):
    return next(a for a in notes["advice"] if a["code"] == code)


def follow(spec, item):
    """The spec with what an item of advice sets."""
    again = json.loads(json.dumps(spec))
    for pointer, value in item["set"].items():
        *way, last = pointer.strip("/").split("/")
        at = again
        for step in way:
            at = at.setdefault(step, {})
        at[last] = value
    return again


def layers():
    """The label 1 along one side of the data, and a sheet of label 2, one voxel thin."""
    labels = numpy.zeros((16, 20, 12), "u1")
    labels[:4], labels[9, 4:16] = 1, 2
    return labels


def ball_and_speck(size=24):
    labels = (numpy.linalg.norm(places(size), axis=-1) < 5).astype("u1")
    labels[20, 20, 20] = 2
    return labels


def thin_in_foam():
    """Small cells, whose edges are shorter than the spacing, and a sheet of label 20 through them, one voxel thin."""
    labels = cells(12, 18)
    labels[9, 4:14] = 20
    return labels


def test_a_label_one_voxel_thin_is_named(send):
    """Each of its two walls has its points: a warning, and no fault of the result."""
    notes = send(layers(), of_labels(150))
    assert any(w.startswith("label 2: 144 of its 144 voxels are in parts one voxel thin, ") for w in notes["warnings"])
    assert notes["outcome_reasons"] == [] and {a["code"] for a in notes["advice"]} <= {"thin_walls"}


def test_groups_are_advised_where_points_of_thin_labels_are_close(sample):
    report, _ = sample(thin_in_foam(), count=200, output={"mesh": False})
    assert "close_share" in {r["criterion"] for r in report["outcome_reasons"]}
    (group,) = advice(report, "thin_labels")["set"]["/surface/labels/groups"]
    assert group[-1] == 20 and len(group) == 2
    report, _ = sample(thin_in_foam(), count=200, output={"mesh": False}, groups=[group])
    assert "thin_labels" not in {a["code"] for a in report["advice"]}
    assert not any("thin" in w and "label 20" in w for w in report["surface"]["warnings"])


def test_advice_adds_to_the_groups_that_there_are(sample):
    report, _ = sample(thin_in_foam(), count=200, groups=[[0, 1]], output={"mesh": False})
    first, *others = advice(report, "thin_labels")["set"]["/surface/labels/groups"]
    assert first[:2] == [0, 1] and (20 in first or [20 in group for group in others] == [True])


def test_a_single_voxel_is_named_and_has_its_points(send):
    notes = send(ball_and_speck(), of_labels(600))
    (warning,) = notes["warnings"]
    assert warning.startswith("label 2 is a single voxel, at (20, 20, 20), too thin for a regular packing")
    assert notes["outcome_reasons"] == [] == notes["advice"]


@pytest.mark.parametrize("count", [20, 100])
def test_of_a_voxel_or_a_row_alone_it_is_said_that_few_counts_help(send, count):
    labels = numpy.zeros((14, 14, 14), "u1")
    labels[7, 7, 7:7 + (1 if count == 20 else 5)] = 1
    assert send(labels, of_labels(count))["outcome_reasons"] == []
    notes = send(labels, {**of_labels(count), "outcome": {"require": {"hex_fraction": 1}}})
    told = advice(notes, "thin_labels")
    assert told["set"] == {} and "do not form a regular packing" in told["message"] and len(notes["advice"]) == 1
    assert any("single voxel" in w for w in notes["warnings"])
    assert [r["criterion"] for r in notes["outcome_reasons"]] == ["hex_fraction"]


@pytest.mark.parametrize("seed", range(3))
def test_lines_that_touch_share_their_points(sample, seed):
    """Lines between labels touch where a label is pinched, mostly at no corner of theirs."""
    print(f"seed {seed}")
    random = numpy.random.default_rng(seed)
    inner = numpy.argmax([ndimage.gaussian_filter(random.normal(size=(20,) * 3), 1) for _ in range(4)], axis=0)
    report, points = sample(numpy.pad(inner.astype("u1"), 2), count=4000, solver={"max_sweeps": 1}, output={"mesh": False})
    assert report["quality"]["coincident"] == 0 and (points.feature >= ON_LINE).sum() > 1000


def test_points_that_all_lie_near_curves_are_measured(sample):
    """A foam of cells two spacings wide: nothing is left out, and the doubled points along short curves are found."""
    report, _ = sample(cells(12, 18), count=200, output={"mesh": False})
    quality = report["quality"]
    assert 0 < quality["hex_fraction"] < 1 and quality["unmeasured_share"] < 0.1 and quality["missing_share"] == 0
    assert "close_share" in {r["criterion"] for r in report["outcome_reasons"]} and quality["close_share"] > 0.01


@pytest.mark.extended
def test_a_foam_of_large_cells_has_no_close_points(send):
    assert send(cells(30, 24), of_labels(3000))["outcome_reasons"] == []


def test_a_label_that_fills_all_is_refused_and_the_advice_helps(send):
    labels = numpy.full((10, 10, 10), 5, "u1")
    told = send(labels, of_labels(300))
    assert told["code"] == "no_surface" and "set /surface/labels/closed" in told["message"]
    assert send(labels, of_labels(300, closed=True))["outcome_reasons"] == []


def test_a_preview_is_coloured_by_label(sample):
    def run(shown):
        return sample(blocks(), count=300, output={"mesh": False, "preview": {"size": 64, "attribute": shown}})[0]
    assert "preview.png" in [o["name"] for o in run("label_b")["outputs"]]
    error = run("label_c")
    assert error["code"] == "attribute_missing" and "label_b" in error["message"], error


# ---- numbers of labels

# The kind of the volume, the labels, and the PLY type that holds them.
NUMBERS = [("u4", (0, 312782628, 312782629), "int"), ("u4", (16777216, 16777217, 16777218), "int"),
           ("u4", (0, 2**31, 2**32 - 1), "uint"), ("i8", (-5, 2**31, 2**31 + 1), "double"),
           ("i8", (-2**53 + 1, 2**32, 2**53 - 1), "double"), ("f8", (0, 2**40, 2**40 + 1), "double"),
           ("u8", (1, 2**32, 2**32 + 1), "double"), ("i4", (-2**31, 7, 2**31 - 1), "int")]


def shells(labels, kind):
    """A ball within a ball within a box."""
    far = numpy.linalg.norm(places(16), axis=-1)
    return numpy.select([far < 3.6, far < 6.4], labels[:0:-1], labels[0]).astype(kind)


def glb_values(data, name):
    """An attribute of numbers of a glTF file, through the table in `extras`."""
    length = int.from_bytes(data[12:16], "little")
    scene, body = json.loads(data[20:20 + length]), data[28 + length:]
    (primitive,) = scene["meshes"][0]["primitives"]
    accessor = scene["accessors"][primitive["attributes"][name]]
    at = scene["bufferViews"][accessor["bufferView"]]["byteOffset"]
    numbers = numpy.frombuffer(body, "<f4", accessor["count"], at)
    table = primitive.get("extras", {}).get(name)
    return [int(v) if table is None else table[int(v)] for v in numbers]


@pytest.mark.parametrize("kind, labels, of_ply", NUMBERS)
@pytest.mark.parametrize("style", [{"format": "ascii"}, {}, pytest.param({"precision": "double"}, marks=pytest.mark.extended)])
def test_numbers_of_labels_are_exact_in_all_outputs(sample, tmp_path, kind, labels, of_ply, style):
    out, pairs = tmp_path / "out", {(labels[0], labels[1]), (labels[1], labels[2])}
    report, points = sample(shells(labels, kind), count=200, solver={"max_sweeps": 3}, output={
        "ply": style, "points_glb": True, "points_usda": True, "points_npz": True, "mesh_usda": True, "label_meshes": True})
    assert points is not None, report
    assert [m["label"] for m in report["surface"]["labels"]["materials"]] == list(labels)
    assert set(interfaces(report)) == {tuple(c["labels"]) for c in report["patches"]["list"]} == pairs
    data = (out / "mesh.ply").read_bytes()
    assert f"property {of_ply} label_a\nproperty {of_ply} label_b\nend_header\n".encode() in data
    for where in (read_columns((out / "points.ply").read_bytes()),
                  dict(zip(("label_a", "label_b"), read_face_labels(data).T))):
        assert set(zip(map(int, where["label_a"]), map(int, where["label_b"]))) == pairs
    glb = (out / "points.glb").read_bytes()
    assert list(zip(glb_values(glb, "_LABEL_A"), glb_values(glb, "_LABEL_B"))) == list(zip(points.label_a, points.label_b))
    with numpy.load(out / "points.npz") as arrays:
        assert (arrays["label_b"] == points.label_b).all()
    usda = (out / "points.usda").read_text()
    assert f"{'int' if of_ply == 'int' else 'int64'}[] primvars:label_b = [" in usda
    assert usda.split("primvars:label_b = [")[1].split("]")[0] == ", ".join(map(str, points.label_b))
    assert {m["label"] for m in report["mesh"]["labels"]} == set(labels)
    assert {f"mesh_label_{n}.ply" for n in labels} <= {p.name for p in out.iterdir()}


def test_large_numbers_of_labels_in_a_spec(sample):
    low, middle, high = 2**31, 2**52 + 1, 2**53 - 1
    values = shells((low, middle, high), "i8")
    report, points = sample(values, count=100, solver={"max_sweeps": 3}, labels=[middle, high], background=low,
                            interfaces=[[middle, high]])
    assert set(zip(points.label_a, points.label_b)) == {(middle, high)}, report
    assert report["spec"]["surface"]["labels"]["labels"] == [middle, high]
    report, points = sample(values, count=100, solver={"max_sweeps": 3}, groups=[[high, middle]])
    assert set(interfaces(report)) == {(low, high)}
    error, _ = sample(values, labels=[middle + 1])
    assert error["code"] == "spec_invalid" and f"no voxel has the label {middle + 1}" in error["message"]
    error, _ = sample(values, labels=[2**53])
    assert error["code"] == "spec_invalid" and "9007199254740991" in error["message"]


def test_large_numbers_of_labels_in_other_files(sample, solve, tmp_path):
    """NIfTI files, MetaImage as text and images of whole numbers, which are no floats on the way."""
    labels = (16777217, 16777219, 2**32 - 1)
    values, told = shells(labels, "u4"), {}
    write_nifti(tmp_path / "v.nii", values, endian=">")
    write_meta_image(tmp_path / "v.mha", values, text=True)
    for k in range(16):
        write_exr(tmp_path / f"s.{k}.exr", Part({"id": values[:, :, k]}, compression=2))
    stack = {"path": "s.#.exr", "slices": "0-15", "voxel_size": [1, 1, 1]}
    for name, surface in (("nifti", {"path": "v.nii"}), ("text", {"path": "v.mha"}), ("images", stack)):
        report, _ = solve({"version": 1, "surface": {"labels": surface}, "sampling": {"count": 60}, "output": {"preview": False},
                           "solver": {"max_sweeps": 2}})
        told[name] = [m["label"] for m in report["surface"]["labels"]["materials"]]
    assert told == dict.fromkeys(told, list(labels))


def test_large_numbers_of_labels_in_an_inspection(worker, tmp_path):
    write_nrrd(tmp_path / "v.nrrd", shells((0, 2**31, 2**53 - 1), "i8"))
    text = worker("v.nrrd", output=None, command="inspect").stdout
    assert "label 9007199254740991: " in text and "touches 0 9007199254740991\n" in text, text


# ---- what cannot be

@pytest.mark.sanitized
@pytest.mark.parametrize("values, members, code, words", [
    (numpy.full((8, 8, 8), 5, "u1"), {}, "no_surface", "all voxels have the label 5"),
    (numpy.full((8, 8, 8), 0.5, "f4"), {}, "input_unsupported", "0.5 is not a label"),
    (numpy.full((8, 8, 8), 1 << 53, "i8"), {}, "input_unsupported", "the value 9007199254740992 is not a label"),
    (numpy.full((8, 8, 8), (1 << 53) + 1, "i8"), {}, "input_unsupported", "the value 9007199254740993 is not a label"),
    (numpy.full((8, 8, 8), -(1 << 62) - 1, "i8"), {}, "input_unsupported", "the value -4611686018427387905 is not a label"),
    (numpy.full((8, 8, 8), (1 << 64) - 1, "u8"), {}, "input_unsupported", "the value 18446744073709551615 is not a label"),
    (numpy.full((8, 8, 8), 1e16, "f8"), {}, "input_unsupported", "the value 10000000000000000 is not a label"),
    (numpy.full((8, 8, 8), 16777217.5, "f8"), {}, "input_unsupported", "the value 16777217.5 is not a label"),
    (numpy.full((8, 8, 8), numpy.nan, "f4"), {}, "input_unsupported", "the value nan is not a label"),
    (blocks(), {"labels": [7]}, "spec_invalid", "has the label 7"),
    (blocks(), {"interfaces": [[1, 4]]}, "no_surface", "interfaces do not touch"),
])
def test_what_has_no_interfaces_is_said(sample, values, members, code, words):
    error, _ = sample(values, **members)
    assert error["code"] == code and words in error["message"], error


def test_what_fills_all_is_sampled_when_closed(sample):
    report, points = sample(numpy.full((12, 12, 12), 5, "u1"), count=500, closed=True)
    assert set(interfaces(report)) == {(5, -1)} and report["mesh"]["boundary_edges"] == 0


# ---- what was segmented by hand

def shifted_slices(size=44, most=3):
    """A ball of label 1 whose slices do not fit to each other, and voxels alone of label 2."""
    random = numpy.random.default_rng(24)
    inside = numpy.linalg.norm(places(size), axis=-1) < 0.3 * size
    labels = numpy.stack([numpy.roll(s, random.integers(-most, most + 1, 2), axis=(0, 1)) for s in inside]).astype("u1")
    labels[tuple(random.integers(0, size, (3, 30)))] = 2
    return labels


@pytest.mark.sanitized
def test_a_majority_takes_out_jitter_and_strays(sample):
    labels, radius = shifted_slices(), 0.3 * 44
    rough, _ = sample(labels, solver={"max_sweeps": 5}, output={"mesh": False})
    report, points = sample(labels, majority=3)
    assert list(advice(rough, "ragged_labels")["set"]) == ["/surface/labels/majority"]
    codes = [a["code"] for a in rough["advice"]]
    assert codes[0] == "ragged_labels" and codes[-1] in ("unresolved", "thin_walls")  # the cause before the count
    assert rough["outcome"] in ("unresolved", "not_converged") and rough["surface"]["area"] > 1.3 * 4 * numpy.pi * radius ** 2
    assert report["outcome"] == "converged" and report["quality"]["hex_fraction"] > 0.93
    assert report["surface"]["area"] == pytest.approx(4 * numpy.pi * radius ** 2, rel=0.04)
    assert abs(numpy.linalg.norm(points.position - 21.5, axis=1) - radius).max() < 2.5
    assert "/surface/labels/majority removes more than a quarter of the voxels of 1 label: 2 (all)" in report["surface"]["warnings"]
    assert interfaces(report).keys() == {(0, 1)}
    assert [m["label"] for m in sample(labels, majority=3, output={"label_meshes": True})[0]["mesh"]["labels"]] == [0, 1]


def test_a_majority_is_advised_before_groups(sample):
    """Most labels are ragged, and label 3 is a sheet one voxel thin, which groups would merge."""
    labels = shifted_slices()
    labels[:, 8:36, 22][labels[:, 8:36, 22] == 1] = 3
    report, _ = sample(labels, solver={"max_sweeps": 5}, output={"mesh": False})
    assert [a["code"] for a in report["advice"] if a["code"] != "thin_walls"] == ["ragged_labels", "thin_labels", "unresolved"]


@pytest.mark.parametrize("kind", ["labels", "volume"])
def test_inspections_estimates_and_reports_advise_the_same_count(worker, tmp_path, kind):
    """Slices that do not match, and noise, have walls thinner than half a voxel. The count is of walls of half a voxel,
    whatever the present count."""
    print("seed 24")
    noise = ndimage.gaussian_filter(numpy.random.default_rng(24).normal(size=(24,) * 3), 0.7).astype("f4")
    write_nrrd(tmp_path / "v.nrrd", shifted_slices(30) if kind == "labels" else noise)
    suggestions = json.loads(worker("v.nrrd", "--json", command="inspect", output=None).stdout)["suggestions"]
    inspected = next(s for s in suggestions if kind in s["spec"]["surface"])
    counts = [inspected["count"]]
    for count in (400, 1600):
        spec = {"version": 1, "surface": inspected["spec"]["surface"], "sampling": {"count": count}, "output": {"preview": False}}
        estimate = json.loads(worker(spec, command="estimate", output=f"estimate{count}").stdout)
        worker(spec, output=f"out{count}")
        report = json.loads((tmp_path / f"out{count}" / "report.json").read_text())
        print(report["outcome"], report["advice"])
        counts += [int(re.search("ask for ([0-9]+) points", " ".join([*warnings, *(a["message"] for a in advised)]))[1])
                   for warnings, advised in ((estimate["warnings"], estimate["advice"]), (report["surface"]["warnings"], report["advice"]))]
    assert max(counts) <= 1.1 * min(counts), counts


@pytest.mark.extended
def test_advice_of_a_majority_brings_slices_into_order(send):
    spec = of_labels(700)
    notes = send(shifted_slices(30, 2), spec)
    item = advice(notes, "ragged_labels")
    again = send(shifted_slices(30, 2), follow(spec, item))
    assert again["outcome_reasons"] == [] == again["advice"], (item, again)


def test_a_majority_is_not_advised_where_slices_fit(sample):
    """Plates and small balls that points cannot show are not ragged, whether they went through a majority or not."""
    plate, balls = numpy.zeros((60, 60, 20), "u1"), numpy.zeros((48, 48, 48), "u1")
    plate[10:50, 10:50, 8:11] = 1
    for k in range(27):
        center = 8 + 16 * numpy.array([k // 9, k // 3 % 3, k % 3])
        balls[numpy.linalg.norm(places(48) - center, axis=-1) < 4] = 1 + k
    for labels, members in ((plate, {}), (plate, {"majority": 0.7}), (balls, {})):
        report, _ = sample(labels, count=120, output={"mesh": False}, **members)
        assert not any(a["code"] == "ragged_labels" for a in report["advice"]), report["advice"]


def test_what_a_majority_takes_is_told_of_what_is_asked_for(sample):
    labels = (numpy.linalg.norm(places(32), axis=-1) < 11).astype("u1")
    labels[2:5, 2:5, 2:5], labels[24:27, 24, 24] = 2, 3

    def told(**members):
        report, _ = sample(labels, count=300, solver={"max_sweeps": 1}, output={"mesh": False}, **members)
        return report["surface"]["warnings"]

    taken = "/surface/labels/majority removes more than a quarter of the voxels of %s (all)"
    assert told(majority=3) == [taken % "2 labels: 2 (all), 3"]
    assert told(majority=3, interfaces=[[0, 1]]) == [] == told(interfaces=[[0, 1]])
    assert told(majority=3, interfaces=[[0, 1], [0, 3]]) == [taken % "1 label: 3"]
    for chosen, words in ({"labels": [2]}, "label 0 after surface.labels.majority"), ({"interfaces": [[0, 2]]}, "touch after surface.labels.majority"):
        error, _ = sample(labels, majority=3, **chosen)
        assert error["code"] == "no_surface" and words in error["message"], error


@pytest.mark.parametrize("members, threads", [
    ({}, 2), pytest.param({}, 1, marks=pytest.mark.extended),
    pytest.param({"closed": True}, 1, marks=pytest.mark.extended)])
def test_the_majority_is_that_of_smoothed_indicators_with_weights_that_keep_volume(sample, members, threads):
    """More than one block of them along an axis; what lies beyond the end counts for none. Voxels are longer along one axis."""
    smooth = ndimage.gaussian_filter(numpy.random.default_rng(1).normal(size=(4, 70, 18, 23)), (0, 2, 2, 2))
    labels = (smooth + numpy.reshape([0, 0, 0, -0.05], (4, 1, 1, 1))).argmax(0).astype("u1")
    stray = numpy.random.default_rng(2).random(labels.shape) < 0.02
    labels[stray] = (labels[stray] + 1) % 4
    shares = numpy.stack([ndimage.gaussian_filter((labels == k).astype("f8"), (2, 2, 1), mode="constant", truncate=3) for k in range(4)])
    voxels, weights = numpy.bincount(labels.ravel()), numpy.ones(4)
    for _ in range(200):
        true = numpy.argmax(shares * weights[:, None, None, None], 0)
        weights *= (voxels / numpy.bincount(true.ravel(), minlength=4)) ** 0.5
    assert weights.max() > 1.1 * weights.min()
    report, _ = sample(labels, count=300, solver={"max_sweeps": 1, "threads": threads}, output={"mesh": False}, majority=2,
                       matrix=numpy.diag([1, 1, 2, 1]), **members)
    told = report["surface"]["labels"]
    assert told["changed_voxels"] == pytest.approx((true != labels).sum(), rel=0.01)
    assert [m["voxels"] for m in told["materials"] if not m["background"]] == pytest.approx(voxels, rel=0.002)


def test_a_majority_keeps_the_volumes_of_balls_sheets_and_foams(sample):
    """Smoothed indicators alone take 53 % of the small ball and the whole sheet."""
    centre, labels = numpy.indices((40,) * 3), numpy.zeros((40,) * 3, "u1")
    labels[ndimage.distance_transform_edt(centre[0] != 30) < 1.1] = 1  # three voxels thin
    labels[sum((centre[k] - at) ** 2 for k, at in enumerate((12, 12, 12))) < 7 ** 2] = 2
    labels[sum((centre[k] - at) ** 2 for k, at in enumerate((11, 27, 26))) < 10 ** 2] = 3
    foam = numpy.argmin([((centre.T - at) ** 2).sum(-1) for at in numpy.random.default_rng(3).uniform(0, 40, (20, 3))], 0).astype("u1")
    for of in labels, foam:
        told = sample(of, count=300, solver={"max_sweeps": 1}, output={"mesh": False}, majority=3)[0]["surface"]
        assert [m["voxels"] for m in told["labels"]["materials"]] == pytest.approx(numpy.bincount(of.ravel()), rel=0.005)
        assert not any("majority" in w for w in told["warnings"])


def test_a_majority_keeps_about_the_volume_of_a_sheet_between_two_labels(sample):
    """Its layers are won as a whole or not at all, so that weights go back and forth: the best round counts."""
    labels = numpy.zeros((36,) * 3, "u1")
    labels[:, :18], labels[17:19] = 2, 1
    told = sample(labels, count=300, solver={"max_sweeps": 1}, output={"mesh": False}, majority=2)[0]["surface"]["labels"]
    assert [m["voxels"] for m in told["materials"] if m["label"] == 1] == pytest.approx([2 * 36 ** 2], rel=0.1)


def test_a_majority_keeps_flat_sides_and_thick_sheets(sample):
    labels = numpy.zeros((24, 24, 24), "u1")
    labels[:6], labels[12:16] = 1, 2
    report, _ = sample(labels, count=300, majority=2.5)
    assert "changed_voxels" not in report["surface"]["labels"]


# ---- ways of storing labels

def meta_image(labels, said=None):
    """A packed .mha that says so many bytes."""
    packed = zlib.compress(labels.tobytes(order="F"))
    return ("ObjectType = Image\nNDims = 3\nBinaryData = True\nCompressedData = True\n"
            f"CompressedDataSize = {len(packed) if said is None else said}\nElementSpacing = 1 1 1\n"
            f"DimSize = {' '.join(map(str, labels.shape))}\nElementType = MET_UCHAR\n"
            "ElementDataFile = LOCAL\n").encode() + packed


@pytest.mark.sanitized
@pytest.mark.parametrize("said, cut, warned", [(None, 0, False), (20, 0, True), (9999, 0, True), (20, 30, None)])
def test_a_header_that_disagrees_is_a_warning_where_data_are_whole(worker, tmp_path, said, cut, warned):
    image = meta_image(blocks().astype("u1"), said)
    (tmp_path / "v.mha").write_bytes(image[:len(image) - cut])
    done = worker({"version": 1, "surface": {"labels": {"path": "v.mha"}}, "sampling": {"count": 300},
                   "output": {"preview": False}})
    if warned is None:
        assert json.loads(done.stderr.splitlines()[-1])["code"] == "input_damaged"
        return
    warnings = json.loads((tmp_path / "out" / "report.json").read_text())["surface"]["warnings"]
    assert any("compressed data" in w for w in warnings) == warned, warnings


def test_an_inspection_lists_labels(worker, tmp_path):
    write_nrrd(tmp_path / "v.nrrd", blocks())
    done = worker("v.nrrd", "--json", command="inspect", output=None)
    told = json.loads(done.stdout)
    labels = told["volume"]["labels"]
    assert [(k["label"], k["voxels"], k["neighbours"]) for k in labels] == [
        (1, 864, [2]), (2, 864, [1, 3]), (3, 864, [2, 4]), (4, 864, [3])]
    assert labels[1]["low"] == [6, 0, 0] and labels[1]["high"] == [11, 11, 11]
    assert [list(s["spec"]["surface"]) for s in told["suggestions"]][:2] == [["labels"], ["volume"]], "more than two: first"
    write_nrrd(tmp_path / "w.nrrd", numpy.random.default_rng(1).integers(0, 200, (16, 16, 16)).astype("u1"))
    assert "labels" not in json.loads(worker("w.nrrd", "--json", command="inspect", output=None).stdout)["volume"]


def test_an_inspection_states_the_area_of_labels_that_it_does_not_scan(worker, tmp_path):
    """Two planes between three slabs, of more triangles than an inspection scans."""
    side = 320
    slabs = numpy.repeat(numpy.arange(3, dtype=numpy.uint8), 2)
    write_nrrd(tmp_path / "v.nrrd", numpy.ones((side, side, 1), numpy.uint8) * slabs)
    told = json.loads(worker("v.nrrd", "--json", command="inspect", output=None).stdout)["suggestions"][0]
    assert list(told["spec"]["surface"]) == ["labels"] and told["cells"] > 400000 and not told["measured"]
    assert told["area"] == pytest.approx(2 * (side - 1) ** 2, rel=1e-6)


def test_a_stack_of_images_is_a_segmentation(sample, solve, worker, tmp_path):
    size, count = 24, 600
    labels = Balls(size).labels
    report, points = sample(labels, count=count, solver={"max_sweeps": 20}, output={"mesh": False})
    for k in range(size):
        write_exr(tmp_path / f"s.{k:03}.exr", Part({"id": labels[:, :, k].astype("u4")}))
    stack = {"path": "s.###.exr", "slices": f"0-{size - 1}", "voxel_size": [2, 2, 2], "origin": [1, 0, 0]}
    spec = {"version": 1, "surface": {"labels": stack}, "sampling": {"count": count},
            "solver": {"threads": 1, "max_sweeps": 20}, "output": {"preview": False}}
    told, data = solve(spec)
    assert told["surface"]["area"] == pytest.approx(4 * report["surface"]["area"], rel=1e-6)
    assert len(told["inputs"]) == size and set(interfaces(told)) == set(interfaces(report))
    assert numpy.allclose(Points(data).position, 2 * points.position + [1, 0, 0], atol=0.2)  # as they come to rest
    spec["surface"]["labels"] = {"path": "v.nrrd", "origin": [1, 0, 0]}
    assert "requires slices" in json.dumps(solve(spec)[0])
    seen = json.loads(worker("s.000.exr", "--json", command="inspect", output=None).stdout)
    assert [k["label"] for k in seen["stacks"][0]["labels"]] == [0, 1, 2, 3]
    assert seen["suggestions"][0]["spec"]["surface"]["labels"]["slices"] == stack["slices"]


@pytest.mark.sanitized
def test_an_image_is_refused_before_it_takes_all_memory(solve, tmp_path):
    """Of a volume of intensities nearly all voxels differ, so that triangles are everywhere."""
    write_nrrd(tmp_path / "v.nrrd", numpy.random.default_rng(5).integers(0, 200, (60, 60, 60)).astype(numpy.uint8))
    error, none = solve({"version": 1, "surface": {"labels": {"path": "v.nrrd"}}, "sampling": {"count": 100},
                         "limits": {"memory_mb": 500}})
    assert none is None and error["code"] == "limit_memory" and "use surface.volume with an isovalue" in error["message"]


@pytest.mark.sanitized
def test_a_spec_that_was_written_anew_means_the_same(solve, tmp_path):
    """As the daemon hands it on, with all defaults."""
    write_nrrd(tmp_path / "v.nrrd", blocks())
    spec = {"version": 1, "surface": {"labels": {"path": "v.nrrd"}}, "sampling": {"count": 300},
            "output": {"preview": False, "mesh": True, "label_meshes": True}}
    report, data = solve(spec)
    again, same = solve(report["spec"])
    assert same == data and again["outputs"] == report["outputs"]


def test_one_of_several_volumes_is_the_segmentation(sample, solve, worker, tmp_path):
    _, points = sample(blocks(), count=500, output={"mesh": False})
    write_nifti(tmp_path / "v.nii", blocks(), numpy.eye(4))
    data = bytearray((tmp_path / "v.nii").read_bytes())
    data[40:42], data[48:50] = (4).to_bytes(2, "little"), (2).to_bytes(2, "little")
    (tmp_path / "four.nii").write_bytes(data[:352] + bytes(len(data) - 352) + data[352:])
    spec = {"version": 1, "surface": {"labels": {"path": "four.nii"}}, "sampling": {"count": 500},
            "solver": {"threads": 1}, "output": {"preview": False}}
    told, _ = solve(spec)
    assert told["code"] == "grid_ambiguous" and "choose one with index, 0 to 1" in told["message"]
    spec["surface"]["labels"]["index"] = 1
    assert (Points(solve(spec)[1]).position == points.position).all()


def test_disorder_that_descent_leaves_is_mended(sample):
    """Halves of a ball with bumps as wide as a few spacings; without mending hex_fraction is .860."""
    size = 64
    bumps = ndimage.gaussian_filter(numpy.random.default_rng(1).normal(size=(size,) * 3), 4)
    off = numpy.linalg.norm(places(size) - (size - 1) / 2, axis=-1) / size - 0.33 + 0.08 * bumps / bumps.std()
    halves = numpy.where(off < 0, 1 + (numpy.arange(size) >= size // 2)[:, None, None], 0).astype("u1")
    report, points = sample(halves, count=3000)
    again = sample(halves, count=3000, solver={"threads": 3})[1]
    assert report["quality"]["hex_fraction"] > 0.89
    assert report["quality"]["coverage"] < 1
    assert (points.position == again.position).all()
