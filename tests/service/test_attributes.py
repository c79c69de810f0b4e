# SPDX-License-Identifier: Apache-2.0
"""What points carry over from files, held against scipy's interpolation of the same samples: rotated, mirrored and moved
spaces, vectors, staggered velocities, whole numbers, and what is not there."""
import json
import math
import zlib

import numpy
import pytest
from scipy import ndimage

from ply_files import write_ply
from readers import read_columns, read_exr
from volumes import Part, write_exr, write_nifti, write_nrrd

# Of the range of the values.
TOLERANCE = 1e-5
SIZE = 24
CORNER = numpy.array([-7, -5, -9])  # index of the first sample


def rotation(angle, axis=2):
    c, s = math.cos(angle), math.sin(angle)
    m = numpy.eye(4)
    a, b = [k for k in range(3) if k != axis]
    m[[a, a, b, b], [a, b, a, b]] = c, -s, s, c
    return m


def moved(offset):
    m = numpy.eye(4)
    m[:3, 3] = offset
    return m


SPACES = {
    "plain": numpy.diag([0.1, 0.1, 0.1, 1.0]),
    "rotated": moved((3, -1, 2)) @ rotation(0.7) @ rotation(0.4, 0) @ numpy.diag([0.1, 0.12, 0.08, 1.0]),
    "mirrored": moved((1, 1, 1)) @ rotation(0.3, 1) @ numpy.diag([-0.1, 0.1, 0.1, 1.0]),
}


EACH_SPACE = [pytest.param(space, marks=pytest.mark.extended if space == "plain" else ()) for space in SPACES]


def linear(samples, index):
    return ndimage.map_coordinates(samples, index.T, order=1, mode="nearest")


def nearest(samples, index):
    return ndimage.map_coordinates(samples, index.T, order=0, mode="nearest")


def cubic(samples, index):
    """Catmull and Rom's weights from their definition: Hermite's cubic with slopes of half the neighbours' difference."""
    low = numpy.floor(index).astype(int)
    t = index - low
    weights = numpy.stack([-t ** 3 + 2 * t ** 2 - t, 3 * t ** 3 - 5 * t ** 2 + 2, -3 * t ** 3 + 4 * t ** 2 + t,
                           t ** 3 - t ** 2]) / 2
    total = numpy.zeros(len(index))
    for x, y, z in numpy.ndindex(4, 4, 4):
        at = low + numpy.array([x, y, z]) - 1
        total += weights[x, :, 0] * weights[y, :, 1] * weights[z, :, 2] * samples[tuple(at.T)]
    return total


def apply(matrix, points):
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def lattice():
    return numpy.stack(numpy.meshgrid(*[numpy.arange(SIZE)] * 3, indexing="ij"), -1).astype(float)


def ball():
    """A fog that is thicker towards the middle; a surface at 0 of six samples' radius."""
    return (6 - numpy.linalg.norm(lattice() - (SIZE - 1) / 2, axis=-1)).astype("f4")


def fields(rng):
    """Samples that no polynomial gives: each stencil shows."""
    return {"temperature": rng.random((SIZE,) * 3).astype("f4") * 300 + 20,
            "velocity": (rng.random((SIZE, SIZE, SIZE, 3)) - 0.5).astype("f4")}


@pytest.fixture
def carry(solve):
    """Runs a surface with attributes; the columns and the report, or the error and None."""
    def run(surface, attributes, **parts):
        spec = {"version": 1, "surface": surface, "sampling": {"count": 600}, "attributes": attributes,
                "solver": {"threads": 1, "max_sweeps": 3}, "output": {"preview": False, "ply": {"precision": "double"}}, **parts}
        told, data = solve(spec)
        return (read_columns(data), told) if data else (told, None)
    return run


def places(columns):
    return numpy.stack([columns[name] for name in "xyz"], -1)


def vectors(columns, name):
    return numpy.stack([columns[f"{name}_{axis}"] for axis in "xyz"], -1)


def close(given, expected, spread):
    error = numpy.abs(given - expected).max() / spread
    assert error < TOLERANCE, error


# ---- OpenVDB

@pytest.fixture
def write_vdb(tmp_path):
    pyopenvdb = pytest.importorskip("pyopenvdb")

    def write(name, matrix, grids):
        """`grids`: name to samples, whose first has the index CORNER, or to (samples, class)."""
        written = []
        for grid_name, values in grids.items():
            values, kind = values if isinstance(values, tuple) else (values, None)
            make = (pyopenvdb.Vec3SGrid if values.ndim == 4 else
                    pyopenvdb.BoolGrid if values.dtype == bool else pyopenvdb.FloatGrid)
            grid = make(background=False) if values.dtype == bool else make()
            grid.copyFromArray(values, ijk=tuple(int(v) for v in CORNER))
            grid.transform = pyopenvdb.createLinearTransform([[float(v) for v in row] for row in matrix.T])
            grid.name = grid_name
            if kind:
                grid.gridClass = kind
            written.append(grid)
        pyopenvdb.write(str(tmp_path / name), grids=written)
        return str(tmp_path / name)
    return write


@pytest.mark.sanitized
@pytest.mark.parametrize("kind", ["mesh", "formula"])
def test_a_map_in_a_file_of_its_own(carry, write_vdb, tmp_path, diagnose, kind):
    """Spacings painted beside a torus, 5:1 along x: those of the points follow, and stand as they were asked for."""
    matrix = moved(-0.13 * (CORNER + 11.6)) @ numpy.diag([0.13, 0.13, 0.13, 1.0])
    x = apply(matrix, (lattice() + CORNER).reshape(-1, 3))[:, 0]
    painted = (3 + numpy.clip(2 * x / 1.4, -2, 2)).astype("f4").reshape((SIZE,) * 3)
    path = write_vdb("spacing.vdb", matrix, {"paint": painted})
    surface = {"analytic": {"shape": "torus", "major_radius": 1, "minor_radius": 0.4, "center": [0, 0, 0]}}
    if kind == "mesh":
        n = 60
        u, v = numpy.meshgrid(numpy.arange(n) * 2 * numpy.pi / n, numpy.arange(n) * 2 * numpy.pi / n)
        wide = 1 + 0.4 * numpy.cos(v)
        corners = numpy.stack([wide * numpy.cos(u), wide * numpy.sin(u), 0.4 * numpy.sin(v)], axis=-1).reshape(-1, 3)
        at = numpy.arange(n * n).reshape(n, n)
        right, up = numpy.roll(at, -1, 1), numpy.roll(at, -1, 0)
        faces = numpy.stack([at, right, numpy.roll(right, -1, 0), up], axis=-1).reshape(-1, 4)
        (tmp_path / "torus.off").write_text(f"OFF {n * n} {n * n} 0\n" + "".join("%g %g %g\n" % tuple(p) for p in corners) +
                                            "".join("4 %d %d %d %d\n" % tuple(f) for f in faces))
        surface = {"mesh": {"path": str(tmp_path / "torus.off"), "resolution": 100}}
    grid = {"path": path, "name": "paint"}
    columns, report = carry(surface, [], sampling={"count": 2000, "grid": grid}, solver={"threads": 1})
    asked = numpy.clip(3 + 2 * columns["x"] / 1.4, 1, 5)
    ratio = columns["spacing"] / asked
    diagnose(f"asked over painted cv {ratio.std() / ratio.mean():.4f}, {report['quality']['grading']}")
    assert ratio.std() / ratio.mean() < 0.01 and columns["spacing"].max() > 4.5 * columns["spacing"].min()
    assert report["quality"]["grading"]["cv"] <= 0.02
    assert [i["path"].split("/")[-1] for i in report["inputs"]][-1] == "spacing.vdb"
    own = ("attribute_missing", "\"paint\": choose one of") if kind == "mesh" else ("spec_invalid", "requires a path")
    for wrong, code, word in (({"name": "paint"}, *own),
                              ({"path": path, "name": "other"}, "grid_missing", "paint"),
                              ({"path": path + "x", "name": "paint"}, "input_missing", "spacing.vdbx")):
        e, _ = carry(surface, [], sampling={"count": 100, "grid": wrong})
        assert e["code"] == code and word in e["message"], e


@pytest.mark.sanitized
@pytest.mark.parametrize("space", EACH_SPACE)
def test_grids_of_a_fog(carry, write_vdb, space):
    """Temperature and velocity beside the fog that is sampled, in the file of the surface and in another."""
    rng = numpy.random.default_rng(7)
    matrix = SPACES[space]
    made = fields(rng)
    flags = rng.random((SIZE,) * 3) < 0.5
    path = write_vdb("fog.vdb", matrix, {"density": ball(), **made, "flag": flags})
    other = write_vdb("other.vdb", matrix, {"temperature": made["temperature"] + 1})
    columns, report = carry({"vdb": {"path": path, "grid": "density", "isovalue": 0}}, [
        {"name": "temperature"}, {"name": "temperature", "as": "smooth", "interpolation": "cubic"},
        {"name": "temperature", "as": "step", "interpolation": "nearest"}, {"name": "velocity", "as": "v"},
        {"name": "flag"}, {"from": other, "name": "temperature", "as": "warmer"}])
    assert report, columns
    index = apply(numpy.linalg.inv(matrix), places(columns)) - CORNER
    close(columns["temperature"], linear(made["temperature"], index), 300)
    close(columns["smooth"], cubic(made["temperature"], index), 300)
    close(columns["step"], nearest(made["temperature"], index), 300)
    close(columns["warmer"], linear(made["temperature"] + 1, index), 300)
    for axis in range(3):
        close(vectors(columns, "v")[:, axis], linear(made["velocity"][..., axis], index), 1)
    assert (columns["flag"] == nearest(flags.astype(float), index)).all()
    told = {a["name"]: a for a in report["attributes"]}
    assert [told[name]["type"] for name in ("temperature", "v", "flag")] == ["float", "vector", "int"]
    assert told["warmer"]["path"] == other and all(a["outside"] == 0 for a in told.values())
    assert told["temperature"]["minimum"] == columns["temperature"].min()
    assert not [w for w in report["surface"]["warnings"] if "attribute" in w]
    assert {i["path"] for i in report["inputs"]} == {path, other}


@pytest.mark.sanitized
def test_staggered_velocity(carry, write_vdb):
    """Each component half a voxel before the voxels' middle along its axis."""
    made = fields(numpy.random.default_rng(3))
    matrix = SPACES["rotated"]
    path = write_vdb("fog.vdb", matrix, {"density": ball(), "velocity": (made["velocity"], "staggered")})
    columns, report = carry({"vdb": {"path": path, "grid": "density", "isovalue": 0}}, [{"name": "velocity", "as": "v"}])
    assert report, columns
    index = apply(numpy.linalg.inv(matrix), places(columns)) - CORNER
    for axis in range(3):
        close(vectors(columns, "v")[:, axis], linear(made["velocity"][..., axis], index + 0.5 * numpy.eye(3)[axis]), 1)


@pytest.mark.parametrize("turn", ["rotated", "mirrored"])
def test_a_surface_that_is_moved_takes_its_attributes_along(carry, write_vdb, turn):
    """Vectors as vectors, normals as normals, numbers as they are; also those of a file beside the surface's."""
    made = fields(numpy.random.default_rng(11))
    matrix = SPACES["plain"]
    move = moved((5, 0, 1)) @ {"rotated": rotation(1.1, 1) @ numpy.diag([2.0, 1, 1, 1]),
                               "mirrored": numpy.diag([1.0, 1, -3, 1])}[turn]
    path = write_vdb("fog.vdb", matrix, {"density": ball(), **made})
    beside = write_vdb("beside.vdb", matrix, {"heat": made["temperature"]})
    columns, report = carry(
        {"transform": {"surface": {"vdb": {"path": path, "grid": "density", "isovalue": 0}},
                       "matrix": [float(v) for v in move.flat]}},
        [{"name": "velocity", "as": "v"}, {"name": "velocity", "as": "n", "type": "normal"}, {"name": "temperature"},
         {"from": beside, "name": "heat"}])
    assert report, columns
    index = apply(numpy.linalg.inv(move @ matrix), places(columns)) - CORNER
    before = numpy.stack([linear(made["velocity"][..., axis], index) for axis in range(3)], -1)
    close(vectors(columns, "v"), before @ move[:3, :3].T, 3)
    turned = before @ numpy.linalg.inv(move[:3, :3])
    close(vectors(columns, "n"), turned / numpy.linalg.norm(turned, axis=1)[:, None], 1)
    close(columns["temperature"], linear(made["temperature"], index), 300)
    close(columns["heat"], columns["temperature"], 300)


@pytest.mark.sanitized
def test_points_outside_have_the_background_and_are_counted(carry, write_vdb):
    made = fields(numpy.random.default_rng(5))["temperature"]
    made[SIZE // 2:] = 0  # the half is not there: voxels of the background are not active
    path = write_vdb("fog.vdb", SPACES["plain"], {"density": ball(), "temperature": made})
    columns, report = carry({"vdb": {"path": path, "grid": "density", "isovalue": 0}}, [{"name": "temperature"}])
    assert report, columns
    index = apply(numpy.linalg.inv(SPACES["plain"]), places(columns)) - CORNER
    outside = index[:, 0] >= SIZE // 2
    assert 200 < outside.sum() < 400 and (columns["temperature"][outside] == 0).all()
    assert report["attributes"][0]["outside"] == outside.sum()
    assert f"attribute \"temperature\": {outside.sum()} points are outside the data of the file" in " ".join(report["surface"]["warnings"])


@pytest.mark.sanitized
def test_the_points_grid_has_the_attributes(carry, write_vdb, tmp_path):
    """As its readers call them; the file was read again and compared when it was written."""
    made = fields(numpy.random.default_rng(5))
    path = write_vdb("fog.vdb", SPACES["plain"], {"density": ball(), **made})
    columns, report = carry({"vdb": {"path": path, "grid": "density", "isovalue": 0}},
                            [{"name": "velocity"}, {"name": "temperature"},
                             {"name": "velocity", "as": "tint", "type": "color"}],
                            output={"preview": False, "points_vdb": True})
    assert report, columns
    data = (tmp_path / "out" / "points.vdb").read_bytes()
    assert all(name in data for name in (b"\1\0\0\0v", b"temperature", b"Cd", b"pscale", b"id"))


# ---- dense volumes

def write_vectors(path, values, matrix, frame=None, kind="vector"):
    """An NRRD file with the components of a vector next to each other; `frame`: the directions that they are in."""
    columns = lambda m: " ".join("(" + ",".join(repr(float(v)) for v in m[:3, k]) + ")" for k in range(3))
    lines = ["NRRD0005", "type: float", "dimension: 4", "sizes: " + " ".join(map(str, [values.shape[3], *values.shape[:3]])),
             "encoding: raw", "endian: little", "space: left-posterior-superior", f"space directions: none {columns(matrix)}",
             "space origin: (" + ",".join(repr(float(v)) for v in matrix[:3, 3]) + ")", f"kinds: {kind} domain domain domain"]
    lines += [f"measurement frame: {columns(frame)}"] if frame is not None else []
    data = numpy.moveaxis(values, 3, 0).astype("<f4").tobytes(order="F")
    path.write_bytes(("\n".join(lines) + "\n\n").encode() + data)


@pytest.mark.sanitized
@pytest.mark.parametrize("space", EACH_SPACE)
def test_arrays_of_nrrd_and_nifti(carry, tmp_path, space):
    """Scalars and vectors of other files in the space of the surface's, in slices one after the other."""
    made = fields(numpy.random.default_rng(17))
    matrix, frame = SPACES[space], rotation(0.9, 0)
    write_nrrd(tmp_path / "ball.nrrd", ball(), matrix)
    write_nrrd(tmp_path / "heat.nrrd", made["temperature"], matrix, encoding="gzip")
    write_nifti(tmp_path / "heat.nii", made["temperature"], matrix)
    write_vectors(tmp_path / "wind.nrrd", made["velocity"], matrix)
    write_vectors(tmp_path / "turned.nrrd", made["velocity"], matrix, frame)
    write_vectors(tmp_path / "tint.nrrd", made["velocity"] + 0.5, matrix, kind="RGB-color")
    file = {name: str(tmp_path / name) for name in ("heat.nrrd", "heat.nii", "wind.nrrd", "turned.nrrd", "tint.nrrd")}
    columns, report = carry({"volume": {"path": str(tmp_path / "ball.nrrd"), "isovalue": 0}}, [
        {"from": file["heat.nrrd"], "as": "heat"}, {"from": file["heat.nrrd"], "as": "smooth", "interpolation": "cubic"},
        {"from": file["heat.nii"], "as": "nifti"}, {"from": file["wind.nrrd"], "as": "wind"},
        {"from": file["wind.nrrd"], "name": "2", "as": "up", "interpolation": "nearest"},
        {"from": file["turned.nrrd"], "as": "turned"}, {"from": file["tint.nrrd"], "as": "Cd", "type": "color"}])
    assert report, columns
    index = apply(numpy.linalg.inv(matrix), places(columns))
    close(columns["heat"], linear(made["temperature"], index), 300)
    close(columns["smooth"], cubic(made["temperature"], index), 300)
    close(columns["nifti"], columns["heat"], 300)
    wind = numpy.stack([linear(made["velocity"][..., axis], index) for axis in range(3)], -1)
    close(vectors(columns, "wind"), wind, 1)
    close(columns["up"], nearest(made["velocity"][..., 2], index), 1)
    close(vectors(columns, "turned"), wind @ frame[:3, :3].T, 1)
    for axis, (name, byte) in enumerate(zip("rgb", ("red", "green", "blue"))):
        close(columns[f"Cd_{name}"], wind[:, axis] + 0.5, 1)
        assert numpy.abs(columns[byte] - 255 * (wind[:, axis] + 0.5)).max() < 0.501
    assert all(a["outside"] == 0 for a in report["attributes"])


@pytest.mark.sanitized
def test_meta_images(carry, tmp_path):
    """A surface and an attribute of .mha and .mhd files, with vectors and a turned space."""
    made = fields(numpy.random.default_rng(37))
    turn = rotation(0.4)
    matrix = turn @ numpy.diag([0.1, 0.12, 0.1, 1.0])
    matrix[:3, 3] = 1, 2, 3

    def head(values, channels, file):
        return "\n".join(["ObjectType = Image", "NDims = 3", "BinaryData = True", f"BinaryDataByteOrderMSB = {file != 'LOCAL'}",
                          "CompressedData = False", "TransformMatrix = " + " ".join(repr(float(v)) for v in turn[:3, :3].T.flat),
                          "Offset = 1 2 3", "ElementSpacing = 0.1 0.12 0.1", f"DimSize = {SIZE} {SIZE} {SIZE}",
                          f"ElementNumberOfChannels = {channels}", "ElementType = MET_FLOAT", f"ElementDataFile = {file}"]) + "\n"
    (tmp_path / "ball.mha").write_bytes(head(ball(), 1, "LOCAL").encode() + ball().astype("<f4").tobytes(order="F"))
    (tmp_path / "wind.mhd").write_text(head(made["velocity"], 3, "wind.raw"))
    (tmp_path / "wind.raw").write_bytes(numpy.moveaxis(made["velocity"], 3, 0).astype(">f4").tobytes(order="F"))
    columns, report = carry({"volume": {"path": str(tmp_path / "ball.mha"), "isovalue": 0}},
                            [{"from": str(tmp_path / "wind.mhd"), "as": "wind"}])
    assert report, columns
    index = apply(numpy.linalg.inv(matrix), places(columns))
    assert numpy.abs(numpy.linalg.norm(index - (SIZE - 1) / 2, axis=1) - 6).max() < 0.05
    close(vectors(columns, "wind"), numpy.stack([linear(made["velocity"][..., k], index) for k in range(3)], -1), 1)
    assert {i["path"] for i in report["inputs"]} == {str(tmp_path / n) for n in ("ball.mha", "wind.mhd", "wind.raw")}
    assert report["surface"]["volume"]["format"] == "MetaImage"
    # packed by zlib, as ITK does, in one file and beside its header
    text = head(ball(), 1, "LOCAL").replace("CompressedData = False", "CompressedData = True")
    packed = zlib.compress(ball().astype("<f4").tobytes(order="F"))
    (tmp_path / "packed.mha").write_bytes(text.encode() + packed)
    (tmp_path / "packed.mhd").write_text(text.replace("LOCAL", "packed.zraw"))
    (tmp_path / "packed.zraw").write_bytes(packed)
    for name in ("packed.mha", "packed.mhd"):
        again, _ = carry({"volume": {"path": str(tmp_path / name), "isovalue": 0}}, [])
        assert (places(again) == places(columns)).all()
    (tmp_path / "plain.mha").write_bytes(text.encode() + ball().astype("<f4").tobytes(order="F"))
    (tmp_path / "half.mha").write_bytes(text.encode() + packed[:len(packed) // 2])
    (tmp_path / "cut.mha").write_bytes((tmp_path / "ball.mha").read_bytes()[:-1])
    for name, code, words in (("plain", "input_damaged", "not compressed correctly"), ("half", "input_damaged", "truncated"),
                              ("cut", "input_damaged", "bytes, but")):
        error, none = carry({"volume": {"path": str(tmp_path / f"{name}.mha"), "isovalue": 0}}, [])
        assert none is None and error["code"] == code and words in error["message"], error


@pytest.mark.sanitized
def test_a_second_channel_of_a_stack_of_images(carry, tmp_path):
    made = fields(numpy.random.default_rng(19))["temperature"]
    for k in range(SIZE):
        write_exr(tmp_path / f"slice.{k:04d}.exr", Part({"A": ball()[:, :, k], "heat": made[:, :, k]}))
    exr = {"path": str(tmp_path / "slice.####.exr"), "slices": f"0-{SIZE - 1}", "channel": "A", "isovalue": 0,
           "voxel_size": [0.1, 0.2, 0.1], "origin": [1, 2, 3]}
    columns, report = carry({"exr": exr}, [{"name": "heat"}, {"name": "A"}])
    assert report, columns
    index = (places(columns) - [1, 2, 3]) / [0.1, 0.2, 0.1]
    close(columns["heat"], linear(made, index), 300)
    close(columns["A"], linear(ball(), index), 12)
    error, none = carry({"exr": exr}, [{"name": "cold"}])
    assert none is None and error["code"] == "attribute_missing" and '"cold": choose one of A, heat' in error["message"]


@pytest.mark.sanitized
def test_what_is_missing_has_the_exit_code_of_bad_input(worker):
    spec = {"version": 1, "surface": {"analytic": {"shape": "sphere", "radius": 1}}, "sampling": {"count": 20},
            "attributes": [{"name": "heat"}]}
    assert worker(spec).returncode == 3


@pytest.mark.sanitized
def test_what_a_dense_file_does_not_have(carry, tmp_path):
    made = fields(numpy.random.default_rng(23))
    write_nrrd(tmp_path / "ball.nrrd", ball(), SPACES["plain"])
    write_vectors(tmp_path / "wind.nrrd", made["velocity"], SPACES["plain"])
    surface = {"volume": {"path": str(tmp_path / "ball.nrrd"), "isovalue": 0}}
    for attribute, words in (({"from": str(tmp_path / "wind.nrrd"), "name": "3"}, 'no "3"'),
                             ({"from": str(tmp_path / "wind.nrrd"), "name": "x"}, 'no "x"'),
                             ({"name": "1"}, "no volume 1: choose index from 0 to 0")):
        error, none = carry(surface, [{"as": "a", **attribute}])
        assert none is None and error["code"] == "attribute_missing" and words in error["message"], error
    error, none = carry({"volume": {"path": str(tmp_path / "wind.nrrd"), "isovalue": 0}}, [])
    assert none is None and error["code"] == "input_unsupported" and "3 values at each sample" in error["message"]
    # a smaller file beside: what is nearest stands beyond its ends, and is counted
    part = SIZE // 2
    write_nrrd(tmp_path / "half.nrrd", made["temperature"][:part], SPACES["plain"])
    columns, report = carry(surface, [{"from": str(tmp_path / "half.nrrd"), "as": "heat"}])
    assert report, columns
    index = apply(numpy.linalg.inv(SPACES["plain"]), places(columns))
    close(columns["heat"], linear(made["temperature"][:part], index), 300)
    assert report["attributes"][0]["outside"] == (index[:, 0] >= part).sum() > 100


# ---- meshes

def patchwork(n=10):
    """The cube from -1 to 1 as triangles of squares, with vertices shared within a side only: positions and triangles."""
    corners, faces = [], []
    at = numpy.stack(numpy.meshgrid(*[numpy.linspace(-1, 1, n)] * 2, indexing="ij"), -1).reshape(-1, 2)
    square = numpy.array([(i * n + j, (i + 1) * n + j, (i + 1) * n + j + 1, i * n + j + 1)
                          for i in range(n - 1) for j in range(n - 1)])
    for axis in range(3):
        for side in (-1, 1):
            place = numpy.insert(at, axis, side, axis=1)
            quads = square if (side > 0) == (axis != 1) else square[:, ::-1]
            faces.append(numpy.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]) + sum(map(len, corners)))
            corners.append(place)
    return numpy.concatenate(corners), numpy.concatenate(faces)


def on_nearest_triangle(vertices, faces, values, points):
    """Of each point the values at the nearest place of all triangles, by brute force: barycentric coordinates inside, and
    ends of edges otherwise."""
    corner = vertices[faces]
    best, found = numpy.full(len(points), numpy.inf), numpy.zeros((len(points), values.shape[1]))
    for (a, b, c), face in zip(corner, faces):
        basis = numpy.stack([b - a, c - a], 1)
        weight = (points - a) @ numpy.linalg.pinv(basis).T
        weight = numpy.column_stack([1 - weight.sum(1), weight])
        outside = (weight < 0).any(1)
        if outside.any():
            ways = []
            for k in range(3):
                p, q = (a, b, c)[k], (a, b, c)[(k + 1) % 3]
                s = numpy.clip((points[outside] - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1)
                w = numpy.zeros((outside.sum(), 3))
                w[:, k], w[:, (k + 1) % 3] = 1 - s, s
                ways.append(w)
            far = [numpy.linalg.norm(w @ numpy.array([a, b, c]) - points[outside], axis=1) for w in ways]
            weight[outside] = numpy.array(ways)[numpy.argmin(far, 0), numpy.arange(outside.sum())]
        distance = numpy.linalg.norm(weight @ numpy.array([a, b, c]) - points, axis=1)
        nearer = distance < best - 1e-12
        best[nearer] = distance[nearer]
        found[nearer] = weight[nearer] @ values[face]
    return found


@pytest.mark.sanitized
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_vertices_of_a_mesh(carry, tmp_path, form):
    """Colours, texture coordinates and properties of its own of a PLY file, where the points are nearest to it."""
    rng = numpy.random.default_rng(29)
    vertices, faces = patchwork(5)
    color = rng.integers(0, 256, (len(vertices), 3))
    uv, heat, number = rng.random((len(vertices), 2)), rng.random(len(vertices)), rng.integers(-99, 99, len(vertices))
    move = moved((3, 1, 2)) @ rotation(0.5) @ numpy.diag([1.0, -2, 1, 1])
    write_ply(tmp_path / "cube.ply", vertices, faces, {
        "s": ("float", uv[:, 0]), "t": ("float", uv[:, 1]), "heat": ("double", heat), "number": ("short", number),
        **{n: ("uchar", color[:, k]) for k, n in enumerate(("red", "green", "blue"))}}, form)
    attributes = [{"name": "color", "as": "Cd"}, {"name": "uv"}, {"name": "heat"}, {"name": "number"}]
    columns, report = carry({"transform": {"surface": {"mesh": {"path": str(tmp_path / "cube.ply"), "resolution": 40}},
                                           "matrix": [float(v) for v in move.flat]}}, attributes)
    assert report, columns
    before = apply(numpy.linalg.inv(move), places(columns))
    away = numpy.abs(numpy.abs(before) - 1).min(1)  # near an edge of the cube two sides are equally near
    flat = numpy.sort(numpy.abs(before), 1)[:, 1] < 0.9
    assert away.max() < 0.06 and flat.sum() > 300
    expected = on_nearest_triangle(vertices, faces, numpy.column_stack([color / 255, uv, heat, number]), before)
    close(numpy.stack([columns[f"Cd_{c}"] for c in "rgb"], -1)[flat], expected[flat, :3], 1)
    close(numpy.stack([columns["uv_s"], columns["uv_t"]], -1)[flat], expected[flat, 3:5], 1)
    close(columns["heat"][flat], expected[flat, 5], 1)
    close(columns["number"][flat], expected[flat, 6], 198)
    assert numpy.abs(columns["green"] - 255 * columns["Cd_g"]).max() < 0.501
    assert (columns["s"] == columns["uv_s"]).all() and (columns["t"] == columns["uv_t"]).all()
    assert [a["type"] for a in report["attributes"]] == ["color", "uv", "float", "float"]
    error, none = carry({"mesh": {"path": str(tmp_path / "cube.ply")}}, [{"name": "wool"}])
    assert none is None and error["code"] == "attribute_missing"
    assert '"wool": choose one of "color", "uv", ' in error["message"] and '"heat", "number"' in error["message"]


@pytest.mark.sanitized
def test_a_mesh_beside_a_volume(carry, tmp_path):
    """Normals, materials and groups of an OBJ file at the points of a fog."""
    matrix = SPACES["plain"]
    write_nrrd(tmp_path / "ball.nrrd", ball(), matrix)
    middle = apply(matrix, numpy.full((1, 3), (SIZE - 1) / 2))[0]
    vertices, faces = patchwork(12)
    sphere = vertices / numpy.linalg.norm(vertices, axis=1)[:, None]
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in middle + 0.6 * sphere]
    lines += [f"vn {x:.9f} {y:.9f} {z:.9f}" for x, y, z in sphere]
    for side, right in (("left", False), ("right", True)):
        for half, upper in (("low", False), ("high", True)):
            lines += [f"g {side}", f"usemtl {half}"]
            lines += ["f " + " ".join(f"{v + 1}//{v + 1}" for v in f) for f in faces
                      if (sphere[f, 2].mean() > 0) == upper and (sphere[f, 0].mean() > 0) == right]
    (tmp_path / "sphere.obj").write_text("\n".join(lines) + "\n")
    columns, report = carry({"volume": {"path": str(tmp_path / "ball.nrrd"), "isovalue": 0}}, [
        {"from": str(tmp_path / "sphere.obj"), "name": "normal", "as": "n"},
        {"from": str(tmp_path / "sphere.obj"), "name": "material"}, {"from": str(tmp_path / "sphere.obj"), "name": "group"}])
    assert report, columns
    outward = places(columns) - middle
    outward /= numpy.linalg.norm(outward, axis=1)[:, None]
    assert (vectors(columns, "n") * outward).sum(1).min() > 0.999
    for name, axis in (("material", 2), ("group", 0)):
        clear = numpy.abs(outward[:, axis]) > 0.15
        over = set(columns[name][clear & (outward[:, axis] > 0)])
        under = set(columns[name][clear & (outward[:, axis] < 0)])
        assert len(over) == len(under) == 1 and over != under, (name, over, under)


@pytest.mark.sanitized
def test_warnings_of_the_mesh_of_an_attribute_are_told_once(carry, tmp_path):
    vertices, faces = patchwork(5)
    lines = ["wobble 1", *(f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in vertices),
             *(f"vn {x:.9f} {y:.9f} {z:.9f}" for x, y, z in vertices)]
    lines += ["f " + " ".join(f"{v + 1}//{v + 1}" for v in f) for f in faces]
    (tmp_path / "cube.obj").write_text("\n".join(lines) + "\n")
    attributes = [{"from": str(tmp_path / "cube.obj"), "name": "normal", "as": name} for name in ("first", "second")]
    for surface, expected in (({"analytic": {"shape": "sphere", "radius": 1}}, 'attribute "first": lines that begin with '),
                              ({"mesh": {"path": str(tmp_path / "cube.obj")}}, "lines that begin with ")):
        report = carry(surface, attributes)[1]
        told = [text for text in report["surface"]["warnings"] if "wobble" in text]
        assert len(told) == 1 and told[0].startswith(expected), report["surface"]["warnings"]


# ---- the surface's own geometry

@pytest.mark.sanitized
def test_the_part_of_a_combination_and_principal_directions(carry):
    def sphere(x, radius):
        return {"analytic": {"shape": "sphere", "radius": radius, "center": [x, 0, 0]}}
    columns, report = carry({"union": [sphere(0, 1), sphere(1.2, 0.8), sphere(9, 0.5)]},
                            [{"from": "geometry", "name": "part"}])
    assert report, columns
    at = places(columns)
    distance = [numpy.abs(numpy.linalg.norm(at - [x, 0, 0], axis=1) - r) for x, r in ((0, 1), (1.2, 0.8), (9, 0.5))]
    assert (columns["part"] == numpy.argmin(distance, axis=0)).all() and set(columns["part"]) == {0, 1, 2}
    columns, report = carry({"analytic": {"shape": "torus", "center": [0, 0, 0], "major_radius": 1, "minor_radius": 0.3}},
                            [{"from": "geometry", "name": f"direction{k}"} for k in (1, 2)])
    assert report, columns
    at = places(columns)
    ring = numpy.stack([-at[:, 1], at[:, 0], 0 * at[:, 0]], -1) / numpy.hypot(at[:, 0], at[:, 1])[:, None]
    normal = numpy.stack([columns[name] for name in ("nx", "ny", "nz")], -1)
    first, second = (vectors(columns, f"direction{k}") for k in (1, 2))
    # the tube bends more than the ring, everywhere
    assert numpy.abs((second * ring).sum(1)).min() > 1 - 1e-9
    assert numpy.abs((first * numpy.cross(ring, normal)).sum(1)).min() > 1 - 1e-6
    assert numpy.abs(numpy.linalg.norm(first, axis=1) - 1).max() < 1e-9


# ---- what is not there, before anything is computed

@pytest.mark.sanitized
def test_what_is_missing_is_named_with_what_there_is(carry, write_vdb):
    path = write_vdb("fog.vdb", SPACES["plain"], {"density": ball(), "velocity": fields(numpy.random.default_rng(1))["velocity"]})
    fog = {"vdb": {"path": path, "grid": "density", "isovalue": 0}}
    for surface, attribute, code, words in (
            (fog, {"name": "heat"}, "attribute_missing", ["/attributes/0", path, '"heat"', '"density" (float)', '"velocity" (vec3s)']),
            (fog, {"name": "density", "type": "uv"}, "input_unsupported", ["1 component", "two"]),
            (fog, {"name": "density", "as": "kappa"}, "spec_invalid", ['"kappa"', "as `as`"]),
            (fog, {"name": "density", "as": "P"}, "spec_invalid", ['"P"', "as `as`"]),
            (fog, {"from": "geometry", "name": "part"}, "attribute_missing", ["not a combination"]),
            ({"analytic": {"shape": "sphere", "radius": 1}}, {"name": "heat"}, "attribute_missing", ["no file", '"heat"']),
            (fog, {"from": "/nowhere.vdb", "name": "heat"}, "input_missing", ["/attributes/0", "/nowhere.vdb"])):
        error, none = carry(surface, [attribute])
        assert none is None and error["code"] == code, error
        assert all(word in error["message"] for word in words), error["message"]
    error, none = carry(fog, [{"name": "velocity"}, {"name": "density", "as": "velocity"}])
    assert none is None and error["code"] == "spec_invalid" and 'two attributes have the name "velocity"' in error["message"]


def test_a_file_of_several_grids_is_refused_with_advice_for_its_member_of_the_spec(carry, write_vdb):
    two = write_vdb("two.vdb", SPACES["plain"], {"density": ball(), "heat": ball()})
    sphere = {"analytic": {"shape": "sphere", "radius": 1}}
    fog = {"vdb": {"path": two, "isovalue": 0}}
    for surface, attributes, parts, member in (
            (fog, [], {}, "/surface/vdb/grid=NAME"),
            ({"transform": {"surface": fog, "matrix": numpy.eye(4).ravel().tolist()}}, [], {}, "/surface/transform/surface/vdb/grid=NAME"),
            (sphere, [], {"region": {"inside": fog}}, "/region/inside/vdb/grid=NAME"),
            (sphere, [{"from": two, "as": "heat"}], {}, None)):
        error, none = carry(surface, attributes, **parts)
        assert none is None and error["code"] == "grid_ambiguous", error
        assert 'choose one of "density" (float), "heat" (float)' in error["message"], error
        assert (f"--set {member}" if member else "(float)") in error["message"] and ("--set" in error["message"]) == bool(member), error


# ---- frames

@pytest.mark.sanitized
def test_frames_of_a_sequence_carry_those_of_their_own_file(worker, write_vdb, tmp_path):
    """With few properties asked for, a frame still has what the next one begins with."""
    made = [fields(numpy.random.default_rng(41 + k)) for k in range(2)]
    for k in range(2):
        write_vdb(f"fog.{k + 1:04d}.vdb", SPACES["plain"], {"density": ball() + numpy.float32(0.1 * k), **made[k]})
    spec = {"version": 1, "surface": {"vdb": {"path": str(tmp_path / "fog.####.vdb"), "grid": "density", "isovalue": 0}},
            "sampling": {"count": 500}, "attributes": [{"name": "temperature"}], "queue": {"frames": "1-2", "coherent": True},
            "solver": {"threads": 1}, "output": {"preview": False, "ply": {"precision": "double", "properties": ["temperature"]},
                                                 "points_npz": True}}
    assert worker(spec, "--frame", 1, output="1").returncode in (0, 10, 11)
    done = worker(spec, "--frame", 2, "--previous", "1", output="2")
    assert done.returncode in (0, 10, 11), done.stderr
    assert json.loads((tmp_path / "2" / "report.json").read_text())["sequence"]["carried"] > 450
    for k in range(2):
        columns = read_columns((tmp_path / str(k + 1) / "points.ply").read_bytes())
        assert list(columns) == ["x", "y", "z", "temperature", "nx", "ny", "nz", "id"]
        index = apply(numpy.linalg.inv(SPACES["plain"]), places(columns)) - CORNER
        close(columns["temperature"], linear(made[k]["temperature"], index), 300)
        with numpy.load(tmp_path / str(k + 1) / "points.npz") as arrays:
            assert (arrays["id"] == columns["id"]).all() and arrays["velocity"].shape == (500, 3)


# ---- pictures

@pytest.mark.sanitized
def test_previews_show_an_attribute(carry, tmp_path):
    """Light of every hue that the disc of a point has is that of its attribute; read from the EXR, whose pixels say whose they are."""
    rng = numpy.random.default_rng(3)
    write_nrrd(tmp_path / "ball.nrrd", ball(), SPACES["plain"])
    slope = lattice()[..., 0].astype("f4") - (SIZE - 1) / 2
    write_nrrd(tmp_path / "slope.nrrd", slope, SPACES["plain"])
    colors = (0.1 + 0.8 * rng.random((SIZE, SIZE, SIZE, 3))).astype("f4")
    write_vectors(tmp_path / "colors.nrrd", colors, SPACES["plain"])
    surface = {"volume": {"path": str(tmp_path / "ball.nrrd"), "isovalue": 0}}
    attributes = [{"from": str(tmp_path / "slope.nrrd"), "as": "slope"},
                  {"from": str(tmp_path / "colors.nrrd"), "as": "Cd", "type": "color"},
                  {"from": str(tmp_path / "colors.nrrd"), "as": "arrow", "type": "vector"}]

    def picture(**preview):
        output = {"preview": {"size": 256, **preview}, "preview_exr": True, "ply": {"precision": "double"}}
        columns, report = carry(surface, attributes, output=output)
        assert report, columns
        _, _, image = read_exr((tmp_path / "out/preview.exr").read_bytes())
        shown = (image["id"] > 0) & (image["A"] == 1)
        assert shown.sum() > 5_000
        return columns, numpy.stack([image[c][shown] for c in "RGB"], -1).astype(float), image["id"][shown] - 1

    columns, light, whose = picture(attribute="Cd")
    meant = numpy.stack([columns[f"Cd_{c}"] for c in "rgb"], -1)[whose]
    meant = numpy.where(meant <= 0.04045, meant / 12.92, ((meant + 0.055) / 1.055) ** 2.4)
    cosine = (light * meant).sum(1) / numpy.linalg.norm(light, axis=1) / numpy.linalg.norm(meant, axis=1)
    assert numpy.median(cosine) > 0.9999 and numpy.quantile(cosine, 0.1) > 0.99  # edges of discs are of two points
    columns, light, whose = picture(attribute="slope", map="diverging", range=[-3, 3])
    slopes = columns["slope"][whose]
    redder = light[:, 0] > light[:, 2]
    clear = numpy.abs(slopes) > 1
    assert clear.sum() > 2_500 and (redder[clear] == (slopes[clear] > 0)).mean() > 0.999
    columns, light, whose = picture(attribute="arrow", map="gray")
    assert numpy.abs(light - light.mean(1, keepdims=True)).max() < 2e-3
    length = numpy.linalg.norm(vectors(columns, "arrow"), axis=1)[whose]
    assert numpy.corrcoef(length, light[:, 0])[0, 1] > 0.3
    error, none = carry(surface, attributes, output={"preview": {"attribute": "heat"}})
    assert none is None and error["code"] == "attribute_missing"
    assert '"heat": choose one of "slope", "Cd", "arrow"' in error["message"]
    for wrong in ([1], [2, 1], [1, 1], [0, 1, 2]):
        error, none = carry(surface, [], output={"preview": {"range": wrong}})
        assert none is None and error["errors"][0]["pointer"] == "/output/preview/range"


# ---- which properties, and in which order

def test_properties_of_points_ply(carry, write_vdb):
    path = write_vdb("fog.vdb", SPACES["plain"], {"density": ball(), **fields(numpy.random.default_rng(2))})
    fog = {"vdb": {"path": path, "grid": "density", "isovalue": 0}}
    carried = [{"name": "temperature"}, {"name": "velocity", "as": "Cd", "type": "color"}]
    place, normal, color = ["x", "y", "z"], ["nx", "ny", "nz"], ["red", "green", "blue"]
    for properties, names in (("minimal", place + normal),
                              ("blender", place + normal + color + ["radius", "temperature", "Cd_r", "Cd_g", "Cd_b"]),
                              (["temperature", "radius", "id"], place + ["temperature", "radius", "id"])):
        columns, report = carry(fog, carried, output={"preview": False, "ply": {"properties": properties}})
        assert report, columns
        assert list(columns) == names
    assert (columns["id"] == numpy.arange(600)).all()
    columns, report = carry(fog, carried)
    assert list(columns) == [*place, *normal, "spacing_local", *color, "temperature", "Cd_r", "Cd_g", "Cd_b"]
    assert (columns["red"] == numpy.round(numpy.clip(columns["Cd_r"], 0, 1) * 255)).all()
    # colours where no attribute has them: those of the picture
    columns, report = carry(fog, [], output={"preview": False, "ply": {"properties": "meshlab"}})
    assert list(columns) == place + normal + color + ["radius", "quality"]
    assert numpy.ptp(columns["green"]) > 20 and numpy.ptp(columns["radius"]) > 0
    error, none = carry(fog, carried, output={"preview": False, "ply": {"properties": ["heat"]}})
    assert none is None and error["code"] == "attribute_missing"
    assert "/output/ply/properties" in error["message"] and "temperature, Cd" in error["message"]
