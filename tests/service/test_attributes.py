"""What points carry over from files, held against scipy's interpolation of the same samples: rotated, mirrored and moved
spaces, vectors, staggered velocities, whole numbers, and what is not there."""
import json
import math

import numpy
import pytest
from scipy import ndimage

from readers import read_columns
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
def carry(worker, tmp_path):
    """Runs a surface with attributes; the columns and the report, or the error and None."""
    def run(surface, attributes, **parts):
        spec = {"version": 1, "surface": surface, "sampling": {"count": 600}, "attributes": attributes,
                "solver": {"threads": 1}, "output": {"preview": False, "ply": {"precision": "double"}}, **parts}
        done = worker(spec)
        if done.returncode not in (0, 10, 11):
            return json.loads(done.stderr.splitlines()[-1]), None
        return (read_columns((tmp_path / "out" / "points.ply").read_bytes()),
                json.loads((tmp_path / "out" / "report.json").read_text()))
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


@pytest.mark.parametrize("space", SPACES)
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
    assert f"attribute \"temperature\": {outside.sum()} points lie where" in " ".join(report["surface"]["warnings"])


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


@pytest.mark.parametrize("space", SPACES)
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
    assert none is None and error["code"] == "attribute_missing" and '"cold": its channels are A, heat' in error["message"]


def test_what_a_dense_file_does_not_have(carry, tmp_path):
    made = fields(numpy.random.default_rng(23))
    write_nrrd(tmp_path / "ball.nrrd", ball(), SPACES["plain"])
    write_vectors(tmp_path / "wind.nrrd", made["velocity"], SPACES["plain"])
    surface = {"volume": {"path": str(tmp_path / "ball.nrrd"), "isovalue": 0}}
    for attribute, words in (({"from": str(tmp_path / "wind.nrrd"), "name": "3"}, 'no "3"'),
                             ({"from": str(tmp_path / "wind.nrrd"), "name": "x"}, 'no "x"'),
                             ({"name": "1"}, "no volume 1: it has 1")):
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


# ---- the surface's own geometry

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

def test_what_is_missing_is_named_with_what_there_is(carry, write_vdb):
    path = write_vdb("fog.vdb", SPACES["plain"], {"density": ball(), "velocity": fields(numpy.random.default_rng(1))["velocity"]})
    fog = {"vdb": {"path": path, "grid": "density", "isovalue": 0}}
    for surface, attribute, code, words in (
            (fog, {"name": "heat"}, "attribute_missing", ["/attributes/0", path, '"heat"', '"density" (float)', '"velocity" (vec3s)']),
            (fog, {"name": "density", "type": "uv"}, "input_unsupported", ["1 component", "two"]),
            (fog, {"name": "density", "as": "kappa"}, "spec_invalid", ['"kappa"', "give another as"]),
            (fog, {"from": "geometry", "name": "part"}, "attribute_missing", ["no combination"]),
            ({"analytic": {"shape": "sphere", "radius": 1}}, {"name": "heat"}, "attribute_missing", ["no file", '"heat"']),
            (fog, {"from": "/nowhere.vdb", "name": "heat"}, "input_missing", ["/attributes/0", "/nowhere.vdb"])):
        error, none = carry(surface, [attribute])
        assert none is None and error["code"] == code, error
        assert all(word in error["message"] for word in words), error["message"]
    error, none = carry(fog, [{"name": "velocity"}, {"name": "density", "as": "velocity"}])
    assert none is None and error["code"] == "spec_invalid" and 'two attributes are called "velocity"' in error["message"]


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
    assert list(columns)[-7:] == [*color, "temperature", "Cd_r", "Cd_g", "Cd_b"]
    assert (columns["red"] == numpy.round(numpy.clip(columns["Cd_r"], 0, 1) * 255)).all()
    # colours where no attribute has them: those of the picture
    columns, report = carry(fog, [], output={"preview": False, "ply": {"properties": "meshlab"}})
    assert list(columns) == place + normal + color + ["radius", "quality"]
    assert numpy.ptp(columns["green"]) > 20 and numpy.ptp(columns["radius"]) > 0
    error, none = carry(fog, carried, output={"preview": False, "ply": {"properties": ["heat"]}})
    assert none is None and error["code"] == "attribute_missing"
    assert "/output/ply/properties" in error["message"] and "temperature, Cd" in error["message"]
