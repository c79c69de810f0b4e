# SPDX-License-Identifier: Apache-2.0
"""Dense volumes, NRRD, NIfTI and stacks of EXR images, as a user hands them to the worker: the same surface from every way
of storing it, in its place in the world, or an error that says what is wrong and where."""
import gzip
import json
import re

import numpy
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from readers import EVERY, Points, read_mesh
from volumes import (Part, nrrd_data, nrrd_header, read_nifti, read_nrrd, write_exr, write_nifti, write_nrrd)

COUNT = 300
SIZE = (30, 26, 34)
# An ellipsoid in world space: where the values are 0.
CENTER, RADII = numpy.array([3.0, -2.0, 5.0]), numpy.array([2.0, 1.5, 2.5])


def turned(angle, axis):
    axis = numpy.array(axis) / numpy.linalg.norm(axis)
    k = numpy.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return numpy.eye(3) + numpy.sin(angle) * k + (1 - numpy.cos(angle)) * k @ k


def centred(linear, size=SIZE):
    """The matrix with that linear part whose volume has its middle at CENTER."""
    matrix = numpy.eye(4)
    matrix[:3, :3] = linear
    matrix[:3, 3] = CENTER - linear @ ((numpy.array(size) - 1) / 2)
    return matrix


MATRICES = {
    "plain": centred(numpy.diag([0.25, 0.25, 0.25])),
    "anisotropic": centred(numpy.diag([0.2, 0.3, 0.25])),
    "mirrored": centred(numpy.diag([-0.25, 0.25, 0.25])),
    "permuted": centred(numpy.array([[0, 0, 0.25], [0.25, 0, 0], [0, -0.25, 0.0]])),
    "turned": centred(turned(0.7, (1, 2, 3)) @ numpy.diag([0.22, 0.28, 0.25])),
    "sheared": centred(numpy.array([[-0.25, 0.06, 0], [0, 0.25, 0.05], [0.04, 0, 0.25]])),
}


def ellipsoid(matrix, size=SIZE, kind="f4"):
    """1 at the centre, 0 on the ellipsoid, falling outwards: a dense volume whose inside is above."""
    index = numpy.stack(numpy.meshgrid(*map(numpy.arange, size), indexing="ij"), -1)
    world = index @ matrix[:3, :3].T + matrix[:3, 3]
    return (1 - numpy.linalg.norm((world - CENTER) / RADII, axis=-1)).astype(kind)


@pytest.fixture
def sample(solve):
    """Runs a surface; the report and the points, or the error and None."""
    def run(surface, isovalue=0.0, kind="volume", **parts):
        member = {"isovalue": isovalue, **(surface if isinstance(surface, dict) else {"path": str(surface)})}
        spec = {"version": 1, "surface": {kind: member}, "sampling": {"count": COUNT}, "solver": {"threads": 1, "max_sweeps": 3},
                "output": {"preview": False, "ply": {"precision": "double"}}, **parts}
        told, data = solve(spec)
        return told, data and Points(data)
    return run


def assert_ellipsoid(points, near=2e-3, facing=0.99):
    """On it to `near`, and normals outwards, their cosine with the true ones at least `facing`."""
    scaled = (points.position - CENTER) / RADII
    length = numpy.linalg.norm(scaled, axis=1)
    gradient = scaled / RADII / length[:, None]
    assert numpy.abs((length - 1) / numpy.linalg.norm(gradient, axis=1)).max() < near
    outward = gradient / numpy.linalg.norm(gradient, axis=1)[:, None]
    assert (outward * points.normal).sum(axis=1).min() > facing


def spacing(report):
    return report["spacing"]


# ---- the world

@pytest.mark.sanitized
@pytest.mark.parametrize("name", MATRICES)
def test_space_directions_are_honoured(sample, tmp_path, name):
    write_nrrd(tmp_path / "v.nrrd", ellipsoid(MATRICES[name]), MATRICES[name])
    report, points = sample(tmp_path / "v.nrrd")
    assert_ellipsoid(points)
    assert report["surface"]["volume"] == {"size": list(SIZE), "format": "NRRD", "space": "left-posterior-superior"}
    assert report["quality"]["euler"] == pytest.approx(2)


@pytest.mark.sanitized
@pytest.mark.parametrize("version, name", [
    pytest.param(version, name, marks=pytest.mark.extended if version == 2 and name != "sheared" else ())
    for version in (1, 2) for name in MATRICES])
def test_an_sform_is_honoured(sample, tmp_path, name, version):
    write_nifti(tmp_path / "v.nii", ellipsoid(MATRICES[name]), MATRICES[name], version=version, voxel=(7, 7, 7))
    report, points = sample(tmp_path / "v.nii")
    assert_ellipsoid(points)
    assert report["surface"]["volume"]["space"] == "right-anterior-superior"


@pytest.mark.sanitized
@pytest.mark.parametrize("qfac", [1, -1])
def test_a_qform_is_honoured_where_there_is_no_sform(sample, tmp_path, qfac):
    turn = turned(2 * numpy.arccos(0.9), (1, -1, 2))  # the quaternion is (0.9, b, c, d)
    b, c, d = numpy.sqrt(1 - 0.81) * numpy.array([1, -1, 2]) / numpy.sqrt(6)
    voxel = (0.22, 0.28, 0.25)
    matrix = centred(turn @ numpy.diag([voxel[0], voxel[1], qfac * voxel[2]]))
    write_nifti(tmp_path / "v.nii", ellipsoid(matrix), quaternion=(b, c, d, *matrix[:3, 3], qfac), voxel=voxel)
    assert_ellipsoid(sample(tmp_path / "v.nii")[1])


def test_without_an_orientation_voxels_have_their_sizes(sample, tmp_path):
    values = ellipsoid(MATRICES["anisotropic"])
    write_nifti(tmp_path / "v.nii", values, voxel=(0.2, 0.3, 0.25))
    write_nrrd(tmp_path / "v.nrrd", values, extra=["spacings: 0.2 0.3 0.25"])
    for name in ("v.nii", "v.nrrd"):
        _, points = sample(tmp_path / name)
        points.position = points.position + MATRICES["anisotropic"][:3, 3]
        assert_ellipsoid(points)


@pytest.mark.parametrize("scale", (1e-24, 1, 1e20))
def test_values_of_any_size_have_one_area(sample, tmp_path, scale):
    """Densities between stars are 1e-24 g/cm3: their squares are no floats."""
    centre = numpy.indices((24,) * 3) - 11.5
    write_nrrd(tmp_path / "v.nrrd", ((8 - numpy.linalg.norm(centre, axis=0)) * scale).astype("f4"))
    report, _ = sample(tmp_path / "v.nrrd", solver={"max_sweeps": 1})
    assert report["surface"]["area"] == pytest.approx(4 * numpy.pi * 8 ** 2, rel=1e-4)


def test_long_voxels_hide_no_bends(sample, tmp_path):
    """Waves over voxels twenty times as high as wide."""
    x, _, z = numpy.indices((64, 32, 24))
    write_nrrd(tmp_path / "v.nrrd", (numpy.sin(2 * numpy.pi * x / 14) - 20 * (z - 12)).astype("f4"), numpy.diag([1, 1, 20, 1.0]))
    along = numpy.linspace(0, 63, 20001)
    length = numpy.hypot(*numpy.diff([along, numpy.sin(2 * numpy.pi * along / 14)])).sum()
    report, _ = sample(tmp_path / "v.nrrd", solver={"max_sweeps": 1})
    assert report["surface"]["area"] == pytest.approx(31 * length, rel=1e-4)


def test_axis_minima_of_cells_are_edges(sample, tmp_path):
    values, matrix = ellipsoid(MATRICES["plain"]), MATRICES["plain"]
    least = " ".join(repr(float(v - 0.125)) for v in matrix[:3, 3])
    write_nrrd(tmp_path / "v.nrrd", values, extra=["spacings: 0.25 0.25 0.25", f"axis mins: {least}",
                                                   "centerings: cell cell cell"])
    assert_ellipsoid(sample(tmp_path / "v.nrrd")[1])


# ---- ways of storing the same

@pytest.mark.sanitized
def test_every_way_of_storing_gives_the_same_bytes(sample, tmp_path):
    values, matrix = ellipsoid(MATRICES["turned"]), MATRICES["turned"]
    whole = nrrd_data(values)
    half = len(whole) // 2
    write_nrrd(tmp_path / "raw.nrrd", values, matrix)
    write_nrrd(tmp_path / "big.nrrd", values, matrix, endian="big")
    write_nrrd(tmp_path / "gzip.nrrd", values, matrix, encoding="gzip")
    write_nrrd(tmp_path / "ascii.nrrd", values, matrix, encoding="ascii")
    (tmp_path / "crlf.nrrd").write_bytes("\r\n".join(nrrd_header(values, matrix) + ["", ""]).encode() + whole)
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "all.raw").write_bytes(b"two\nlines\n" + b"xyz" + whole + b"end")
    (tmp_path / "data" / "all.raw.gz").write_bytes(gzip.compress(b"xyz" + whole))
    for k, piece in enumerate((whole[:half], whole[half:]), 3):
        (tmp_path / "data" / f"part{k:02}.raw").write_bytes(piece)
        (tmp_path / "data" / f"a part {k}.raw").write_bytes(piece)
    detached = {"skips": ["line skip: 2", "byte skip: 3", "data file: data/all.raw"],
                "end": ["byte skip: -4", "datafile: data/all.raw"],
                "packed": ["byte skip: 3", "data file: data/all.raw.gz"],
                "packed_end": ["byte skip: -1", "data file: data/all.raw.gz"],
                "numbered": ["data file: data/part%02d.raw 3 4 1"],
                "with blanks": ["data file: data/a part %d.raw 3 4 1 3"],
                "listed": ["data file: LIST", "data/part03.raw", "data/part04.raw"]}
    for name, extra in detached.items():
        packed = "gzip" if "packed" in name else "raw"
        (tmp_path / f"{name}.nhdr").write_text("\n".join(nrrd_header(values, matrix, packed, extra=extra)) + "\n")
    seen = {}
    for path in sorted([*tmp_path.glob("*.nrrd"), *tmp_path.glob("*.nhdr")]):
        report, points = sample(path)
        assert points is not None, (path.name, report)
        seen[path.name] = report["outputs"][0]["sha256"]
        if path.name == "listed.nhdr":
            assert [i["path"].split("/")[-1] for i in report["inputs"]] == ["listed.nhdr", "part03.raw", "part04.raw"]
    assert len(seen) == 12 and len(set(seen.values())) == 1, seen


@pytest.mark.parametrize("kind, name", [
    pytest.param(kind, name, marks=pytest.mark.extended if name != "v.nrrd" and kind not in ("u1", "i2", "f4") else ())
    for name in ("v.nrrd", "v.nii.gz") for kind in ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8")])
def test_every_type_in_either_order(sample, tmp_path, kind, name):
    """Whole numbers, which every type holds: -80 .. 60, or 0 .. 140 without a sign, and 200 steps a unit."""
    raise_by = 80 if kind.startswith("u") else 0
    values = (numpy.round(60 * ellipsoid(MATRICES["plain"], kind="f8")).clip(-80, 60) + raise_by).astype(kind)
    digests = set()
    for order in ("<", ">"):
        if name == "v.nrrd":
            write_nrrd(tmp_path / name, values, MATRICES["plain"], endian="little" if order == "<" else "big")
        else:
            write_nifti(tmp_path / name, values, MATRICES["plain"], endian=order)
        report, points = sample(tmp_path / name, isovalue=raise_by + 0.5)
        assert_ellipsoid(points, near=0.1, facing=0.95)
        digests.add(report["outputs"][0]["sha256"])
    assert len(digests) == 1


@pytest.mark.sanitized
def test_scaled_values_and_a_pair_of_files(sample, tmp_path):
    values = numpy.round(1000 * ellipsoid(MATRICES["plain"], kind="f8")).astype("i2")
    write_nifti(tmp_path / "v.hdr", values, MATRICES["plain"], slope=0.001, intercept=7, pair=tmp_path / "v.img")
    report, points = sample(tmp_path / "v.hdr", isovalue=7.0)
    assert_ellipsoid(points, near=0.01)
    assert [i["path"].split("/")[-1] for i in report["inputs"]] == ["v.hdr", "v.img"]


# ---- EXR

def stack(tmp_path, values, name="s", make=lambda k, pixels: [Part({"Y": pixels})]):
    """Slices name.0001.exr and so on; the members of surface.exr that name them."""
    for k in range(values.shape[2]):
        write_exr(tmp_path / f"{name}.{k + 1:04}.exr", *make(k, values[:, :, k]))
    return {"path": str(tmp_path / f"{name}.####.exr"), "slices": f"1-{values.shape[2]}", "voxel_size": [0.25, 0.25, 0.25],
            "origin": [float(v) for v in MATRICES["plain"][:3, 3]]}


def test_stacks_of_every_kind_give_the_same_bytes(sample, tmp_path):
    values = ellipsoid(MATRICES["plain"]).astype("f2").astype("f4")
    other = numpy.full(SIZE[:2], 7, "f4")
    few = other[::2, ::2].astype("f2")
    low = (-5, 11)
    ways = {
        "float": lambda k, p: [Part({"Y": p})],
        "half": lambda k, p: [Part({"Y": p.astype("f2")})],
        "zip": lambda k, p: [Part({"Y": p}, compression=3)],
        "zips": lambda k, p: [Part({"Y": p.astype("f2"), "R": other.astype("f2")}, compression=2)],
        "rgb": lambda k, p: [Part({"B": other, "G": other, "R": other, "Y": p, "id": other.astype("u4")})],
        "fewer": lambda k, p: [Part({"BY": few, "RY": few, "Y": p.astype("f2")}, compression=2)],
        "stored": lambda k, p: [Part({"Y": p.astype("f2")}, compression=6)],  # as it is: B44 would not be smaller
        "tiled": lambda k, p: [Part({"Y": p, "A": other}, tile=(16, 8))],
        "mipmapped": lambda k, p: [Part({"Y": p}, tile=(8, 8), levels=9)],
        "shifted": lambda k, p: [Part({"Y": p}, low=low)],
        "parts": lambda k, p: [Part({"Y": other}, name="left"), Part({"Y": p}, name="right"), Part({"A": other}, name="A")],
    }
    digests = {}
    for name, make in ways.items():
        surface = {**stack(tmp_path, values, name, make), "channel": "Y"}
        if name == "parts":
            surface["part"] = "right"
        if name == "shifted":
            surface["origin"] = [surface["origin"][0] - low[0] * 0.25, surface["origin"][1] - low[1] * 0.25,
                                 surface["origin"][2]]
        report, points = sample(surface, kind="exr")
        assert points is not None, (name, report)
        assert_ellipsoid(points, near=5e-3)
        assert len(report["inputs"]) == SIZE[2]
        if name == "shifted":  # its origin is rounded otherwise
            continue
        digests[name] = report["outputs"][0]["sha256"]
    assert len(set(digests.values())) == 1, digests


@pytest.mark.sanitized
@pytest.mark.parametrize("name", ["dwaa-rings", "dwab-tiles"])
def test_the_compression_of_dreamworks(sample, source, tmp_path, name):
    """Images whose values fall from their middle: six of them are a tube with a radius of 12. Y lost bits, Z did not."""
    image = source / "fuzz" / "corpus" / "exr" / f"{name}.exr"
    for k in range(6):
        (tmp_path / f"{name}.{k}.exr").symlink_to(image)
    for channel, near in (("Y", 0.1), ("Z", 1e-3)):
        surface = {"path": str(tmp_path / f"{name}.#.exr"), "slices": "0-5", "channel": channel}
        report, points = sample(surface, kind="exr")
        assert points is not None, report
        radius = numpy.linalg.norm(points.position[:, :2] - [3 + 19.5, -2 + 19.5], axis=1)
        assert numpy.abs(radius - 12).max() < near
    (tmp_path / "cut.0.exr").write_bytes(image.read_bytes()[:-400])
    (tmp_path / "cut.1.exr").symlink_to(image)
    e, _ = sample({**surface, "path": str(tmp_path / "cut.#.exr"), "slices": "0-1"}, kind="exr")
    assert e["code"] == "input_damaged" and "cut.0.exr: its pixels are missing or damaged" in e["message"]


def test_numbers_without_a_sign(sample, tmp_path):
    values = numpy.round(1e6 * (1 + ellipsoid(MATRICES["plain"], kind="f8"))).clip(0).astype("u4")
    _, points = sample(stack(tmp_path, values), kind="exr", isovalue=1e6)
    assert_ellipsoid(points, near=5e-3)


@pytest.mark.sanitized
def test_windows_that_differ_are_filled_with_zero(sample, tmp_path):
    """Slices cropped to what is above nothing, as compositing programs do."""
    values = ellipsoid(MATRICES["plain"]).clip(-0.4) + numpy.float32(0.4)

    def crop(k, pixels):
        rows = numpy.flatnonzero(pixels.any(axis=0))
        first, last = (rows[0], rows[-1] + 1) if len(rows) else (12, 14)
        return [Part({"Y": pixels[:, first:last]}, low=(0, int(first)))]

    whole, expected = sample(stack(tmp_path, values, "whole"), kind="exr", isovalue=0.4)
    report, points = sample(stack(tmp_path, values, "cropped", crop), kind="exr", isovalue=0.4)
    assert "pixels outside the data window of a slice are 0" in report["surface"]["warnings"][0]
    assert not whole["surface"]["warnings"]
    assert_ellipsoid(points, near=5e-3)


@pytest.mark.parametrize("voxels, lost, noted", [(0.4, True, False), (1.2, False, True), (4, False, False)])
def test_walls_between_samples_are_lost_and_thin_ones_noted(sample, tmp_path, voxels, lost, noted):
    """A shell around a ball with a radius of 16 voxels, with values that are distances."""
    away = numpy.linalg.norm(numpy.stack(numpy.meshgrid(*3 * [numpy.arange(40) - 19.4], indexing="ij"), -1), axis=-1)
    write_nrrd(tmp_path / "shell.nrrd", (voxels / 2 - abs(away - 16)).astype("f4"))
    report, points = sample(tmp_path / "shell.nrrd")
    reasons = {r["criterion"]: r["value"] for r in report["outcome_reasons"]}
    assert ("lost_walls" in reasons) == lost and (not lost or 0.1 < reasons["lost_walls"] < 0.6)
    assert any("walls thinner than two voxels" in w for w in report["surface"]["warnings"]) == noted


def test_values_that_are_not_finite_are_counted(sample, tmp_path):
    values = ellipsoid(MATRICES["plain"])
    values[2, 3, 4], values[15, 13, 17], values[1, 1, 20] = numpy.nan, numpy.inf, -numpy.inf
    halves = stack(tmp_path, values.astype("f2"), "halves")
    for surface, kind in ((stack(tmp_path, values), "exr"), (halves, "exr"), (tmp_path / "v.nrrd", "volume")):
        write_nrrd(tmp_path / "v.nrrd", values, MATRICES["plain"])
        report, points = sample(surface, kind=kind)
        assert report["surface"]["warnings"][0].startswith("3 values are not finite or beyond 1e+30, the first at (2, 3, 4)")
        assert_ellipsoid(points, near=5e-3)


def test_values_that_mean_no_data_are_counted(sample, tmp_path):
    values = ellipsoid(MATRICES["plain"])
    values[1, 1, 20:22], values[2, 3, 4], values[15, 13, 17] = -3.4e38, -1e31, 3.4028235e38
    write_nrrd(tmp_path / "v.nrrd", values, MATRICES["plain"])
    report, points = sample(tmp_path / "v.nrrd", kind="volume")
    assert report["surface"]["warnings"][0].startswith("4 values are not finite or beyond 1e+30, the first at (2, 3, 4)")
    assert_ellipsoid(points, near=5e-3)


def balls():
    """Distances inside two balls, and their area."""
    index = numpy.stack(numpy.meshgrid(*map(numpy.arange, (34, 30, 32)), indexing="ij"), -1)
    parts = ((11.3, 13.2, 15.1), 6), ((23.4, 15.2, 12.3), 4)
    return numpy.max([r - numpy.linalg.norm(index - c, axis=-1) for c, r in parts], axis=0), sum(4 * numpy.pi * r ** 2 for _, r in parts)


@pytest.mark.parametrize("away, value", ((2, -9999), (4, -9999), (4, -200), (6, -32768), (3, -1e20)))
def test_jumps_beside_the_surface_make_no_walls(sample, tmp_path, away, value):
    values, area = balls()
    write_nrrd(tmp_path / "v.nrrd", numpy.where(values < -away, value, values).astype("f4"))
    report, points = sample(tmp_path / "v.nrrd", attributes=[], output={"preview": False, "ply": EVERY})
    assert report["surface"]["area"] == pytest.approx(area, rel=0.01)
    assert f"as {numpy.float32(value):g} at voxel (" in report["surface"]["warnings"][0]
    assert "ringing" not in [r["criterion"] for r in report["outcome_reasons"]]
    undefined = points.kappa_defined == 0
    assert undefined.any() == (away < 4), "where the spline depends on limited samples"


def test_jumps_on_the_surface_are_unresolved(sample, tmp_path):
    values, _ = balls()
    for name, changed, isovalue in (("cut", numpy.where(values < -1, -9999, values), 0), ("smoke", numpy.clip(values / 2 + .5, 0, 1), .01)):
        write_nrrd(tmp_path / "v.nrrd", changed.astype("f4"))
        report, _ = sample(tmp_path / "v.nrrd", isovalue=isovalue)
        told = {r["criterion"]: r["message"] for r in report["outcome_reasons"]}
        assert "no_data" in told["ringing"] and "reconstruction" in told["ringing"], name


@pytest.mark.parametrize("offset", (0, 0.02, 0.5))
def test_faces_between_and_on_samples_are_no_jumps(sample, tmp_path, offset):
    """Distances of a box whose faces are parallel to the layers of samples, and such distances as whole numbers."""
    index = numpy.stack(numpy.meshgrid(*map(numpy.arange, (30, 28, 32)), indexing="ij"), -1) - numpy.array((15, 14, 16)) - offset
    distance = 9 - abs(index).max(axis=-1)
    for values, isovalue in ((distance, 0), (numpy.round(9 - numpy.linalg.norm(index, axis=-1)), 0)):
        write_nrrd(tmp_path / "v.nrrd", values.astype("f4"))
        report, _ = sample(tmp_path / "v.nrrd", isovalue=isovalue)
        assert "ringing" not in [r["criterion"] for r in report["outcome_reasons"]], report["outcome_reasons"]


def test_no_data_is_outside(sample, tmp_path):
    values, area = balls()
    for value in (-9999, 1e31, 3000):
        write_nrrd(tmp_path / "v.nrrd", numpy.where(values < -1.5, value, values).astype("f4"))
        report, _ = sample({"path": str(tmp_path / "v.nrrd"), "no_data": value})
        assert report["surface"]["area"] == pytest.approx(area, rel=0.01) and not report["surface"]["warnings"]


def test_values_beyond_all_others_are_no_walls(sample, tmp_path):
    values, _ = balls()
    write_nrrd(tmp_path / "v.nrrd", numpy.where(values < -4, 1e31, values).astype("f4"))
    e, _ = sample(tmp_path / "v.nrrd")
    assert e["code"] == "input_damaged" and "at (0, 0, 0)" in e["message"] and "give the value as no_data" in e["message"]


def test_no_data_of_the_file_is_named(sample, tmp_path):
    values, _ = balls()
    values[values < -4] = -9999
    write_nrrd(tmp_path / "v.nrrd", values.astype("f4"))
    text = (tmp_path / "v.nrrd").read_bytes()
    (tmp_path / "v.nrrd").write_bytes(text.replace(b"\n\n", b"\nnodata:=-9999\n\n", 1))
    report, _ = sample(tmp_path / "v.nrrd")
    assert 'the file states that -9999 means "no data": give it as no_data' in report["surface"]["warnings"]


@pytest.mark.sanitized
def test_infinity_is_no_surface_above_all_values(sample, tmp_path):
    values = ellipsoid(MATRICES["plain"])
    values[0, 0, 0] = numpy.inf
    e, _ = sample(stack(tmp_path, values), kind="exr", isovalue=1e6)
    assert e["code"] == "no_surface" and f"above its lowest value, {values.min():g}, and below its highest, {values[1:].max():g}" in e["message"], e


@pytest.mark.sanitized
def test_missing_and_damaged_slices_are_named(sample, tmp_path):
    surface = stack(tmp_path, ellipsoid(MATRICES["plain"]), make=lambda k, p: [Part({"Y": p}, compression=3)])
    for k in (4, 7, 8, 9):
        (tmp_path / f"s.{k:04}.exr").rename(tmp_path / f"away.{k}")
    e, _ = sample(surface, kind="exr")
    assert e["code"] == "input_missing" and "4 slices are missing (slices 4, 7-9)" in e["message"]
    for k in (4, 7, 8, 9):
        (tmp_path / f"away.{k}").rename(tmp_path / f"s.{k:04}.exr")
    cut = (tmp_path / "s.0030.exr").read_bytes()
    (tmp_path / "s.0030.exr").write_bytes(cut[:len(cut) // 2])
    body = bytearray((tmp_path / "s.0012.exr").read_bytes())
    packed = body.index(b"x\x9c")
    body[packed:packed + 50] = bytes(50)
    (tmp_path / "s.0012.exr").write_bytes(body)
    e, _ = sample(surface, kind="exr")
    assert e["code"] == "input_damaged" and "2 slices are damaged (slices 12, 30)" in e["message"], e
    assert "s.0012.exr: its rows from" in e["message"]


@pytest.mark.sanitized
def test_what_a_stack_cannot_be_is_refused(sample, tmp_path):
    values = ellipsoid(MATRICES["plain"])
    two = stack(tmp_path, values, "two", lambda k, p: [Part({"A": p, "Y": p})])
    e, _ = sample(two, kind="exr")
    assert e["code"] == "grid_ambiguous" and "channels A, Y: choose one with exr.channel" in e["message"]
    e, _ = sample({**two, "channel": "Z"}, kind="exr")
    assert e["code"] == "grid_missing" and 'no channel "Z": choose one of A, Y' in e["message"]
    parts = stack(tmp_path, values, "parts", lambda k, p: [Part({"Y": p}, name="l"), Part({"Y": p}, name="r")])
    e, _ = sample({**parts, "channel": "Y"}, kind="exr")
    assert e["code"] == "grid_ambiguous" and '"l", "r"): choose one with exr.part' in e["message"]
    e, _ = sample({**parts, "part": "m"}, kind="exr")
    assert e["code"] == "grid_missing" and 'no part "m": choose one of "l", "r"' in e["message"]
    for bad, word in (({"slices": "1"}, "slices"), ({"slices": "9-1"}, "slices"), ({"slices": "1-5y"}, "slices"),
                      ({"path": "a.exr"}, "path"), ({"path": "a.##.%02d.exr"}, "path"), ({"path": "a.%s.exr"}, "path")):
        e, _ = sample({**two, **bad}, kind="exr")
        assert e["code"] == "spec_invalid" and e["errors"][0]["pointer"] == f"/surface/exr/{word}", (bad, e)


# ---- all of them alike

@pytest.mark.parametrize("how", ["interpolating", "smoothing"])
def test_exr_nrrd_nifti_and_vdb_give_the_same_points(sample, tmp_path, diagnose, how):
    """Large enough that what is beyond its ends, background or a reflection, is beyond what is read."""
    pyopenvdb = pytest.importorskip("pyopenvdb", reason="python3-openvdb is not installed")
    size = (66, 60, 70)
    matrix = centred(numpy.diag([0.25, 0.25, 0.25]), size)
    values = ellipsoid(matrix, size)
    surface = {**stack(tmp_path, values), "origin": [float(v) for v in matrix[:3, 3]]}
    write_nrrd(tmp_path / "v.nrrd", values, matrix)
    write_nifti(tmp_path / "v.nii", values, matrix, version=2)
    grid = pyopenvdb.FloatGrid()
    grid.background = float(values.min())
    grid.copyFromArray(values)
    grid.name, grid.gridClass = "v", pyopenvdb.GridClass.FOG_VOLUME
    transform = pyopenvdb.createLinearTransform([[0.25, 0, 0, 0], [0, 0.25, 0, 0], [0, 0, 0.25, 0],
                                                 [*map(float, matrix[:3, 3]), 1]])
    grid.transform = transform
    pyopenvdb.write(str(tmp_path / "v.vdb"), grid)
    more = {"reconstruction": how}
    runs = [sample({**surface, **more}, kind="exr")]
    for name, kind in (("v.nrrd", "volume"), ("v.nii", "volume"), ("v.vdb", "vdb")):
        runs.append(sample({"path": str(tmp_path / name), **more}, kind=kind))
    first, apart = runs[0], 0.0
    for report, points in runs[1:]:
        assert points is not None, report
        apart = max(apart, numpy.abs(points.position - first[1].position).max() / spacing(first[0]))
    diagnose(f"{how}: EXR, NRRD, NIfTI and VDB of one volume part by {apart:.1e} spacings")
    assert apart < 1e-5


# ---- ends of the data

def test_where_the_data_end_the_surface_is_open(sample, tmp_path):
    values = ellipsoid(MATRICES["anisotropic"])[:, :, :20]
    write_nrrd(tmp_path / "v.nrrd", values, MATRICES["anisotropic"])
    report, points = sample(tmp_path / "v.nrrd")
    assert_ellipsoid(points)
    end = (MATRICES["anisotropic"] @ [0, 0, 19, 1])[2]
    assert points.position[:, 2].max() <= end + 1e-6
    assert (points.position[:, 2] > end - 1e-6).sum() > 10, "no row of points along the rim"
    assert report["quality"]["lost"] == 0


@pytest.mark.parametrize("period, isovalue", [(37, 3), pytest.param(61, 5, marks=pytest.mark.extended)])
def test_samples_that_are_the_isovalue(worker, tmp_path, period, isovalue):
    """A cell whose corner they are may have all its triangles there: it had all its points there, too."""
    i, j, k = numpy.meshgrid(*[numpy.arange(14)] * 3, indexing="ij")
    a, b, c = (5, 11, 23) if period == 37 else (3, 10, 19)
    write_nrrd(tmp_path / "rough.nrrd", ((a * i * i + b * j * j + c * k * k + 5 * i * j + 3 * j * k) % period).astype("u1"))
    done = worker({"version": 1, "surface": {"volume": {"path": str(tmp_path / "rough.nrrd"), "isovalue": isovalue}},
                   "sampling": {"count": 2000}, "output": {"preview": False}})
    assert done.returncode in (0, 10, 11), done.stderr
    points = Points((tmp_path / "out" / "points.ply").read_bytes())
    spacing = json.loads((tmp_path / "out" / "report.json").read_text())["spacing"]
    assert cKDTree(points.position).query(points.position, k=2)[0][:, 1].min() > 0.3 * spacing


def test_a_ball_of_a_few_voxels(worker, tmp_path):
    """Its area is that of the triangles between its points, and it is covered however many these are."""
    x = numpy.arange(9) - 4
    radius = numpy.sqrt(sum(g * g for g in numpy.meshgrid(x, x, x)))
    write_nrrd(tmp_path / "ball.nrrd", numpy.exp(-(radius / 3) ** 4).astype("f4"))
    done = worker({"version": 1, "surface": {"volume": {"path": str(tmp_path / "ball.nrrd"), "isovalue": 0.5}},
                   "sampling": {"count": 20000}, "output": {"preview": False, "mesh": True}})
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    _, vertices, triangles = read_mesh((tmp_path / "out" / "mesh.ply").read_bytes())
    corner = vertices[:, :3][triangles]
    area = 0.5 * numpy.linalg.norm(numpy.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1).sum()
    assert report["surface"]["area"] == pytest.approx(area, rel=1e-3) and report["mesh"]["closed"]


@pytest.mark.sanitized
def test_oblique_data_end_in_their_own_axes(sample, tmp_path):
    """The points are those of the same data that lie along the world's axes, turned; and so are mirrored ones."""
    for mirror in (1, -1):
        matrix = MATRICES["turned"] @ numpy.diag([1, 1, mirror, 1])
        lengths = numpy.linalg.norm(matrix[:3, :3], axis=0)
        turn = matrix[:3, :3] / lengths * [1, 1, mirror]
        values = ellipsoid(MATRICES["turned"])[:, :, :20]
        write_nrrd(tmp_path / "turned.nrrd", values, matrix)
        write_nrrd(tmp_path / "straight.nrrd", values, numpy.diag([*(lengths * [1, 1, mirror]), 1]))
        output = {"preview": False, "mesh": True, "ply": {"precision": "double"}}
        straight = sample(tmp_path / "straight.nrrd", output=output)
        report, points = sample(tmp_path / "turned.nrrd", output=output)
        assert points is not None and straight[1] is not None, (report, straight[0])
        expected = straight[1].position @ turn.T + matrix[:3, 3]
        assert numpy.abs(points.position - expected).max() < 1e-5
        assert numpy.abs(points.normal - straight[1].normal @ turn.T).max() < 1e-5
        assert report["quality"]["max_residual"] < 1e-3
        assert report["mesh"] == straight[0]["mesh"] and not report["mesh"]["closed"]
        box = report["surface"]["bounding_box"]
        assert numpy.abs(points.position.min(axis=0) - box["min"]).max() < 1
        assert numpy.abs(points.position.max(axis=0) - box["max"]).max() < 1
        if mirror == 1:
            assert_ellipsoid(points)


@pytest.mark.sanitized
def test_oblique_data_and_a_region(sample, tmp_path):
    """A region lies along the world's axes, and must be clear of the data's end then."""
    values = ellipsoid(MATRICES["turned"])[:, :, :20]
    write_nrrd(tmp_path / "v.nrrd", values, MATRICES["turned"])
    e, _ = sample(tmp_path / "v.nrrd", region={"min": [-100] * 3, "max": [100] * 3})
    assert e["code"] == "input_unsupported" and "give a region" in e["message"]
    clear = [float(x) for x in re.findall(r"[-+.e0-9]+", e["message"].split("is clear of it:")[1])]
    report, points = sample(tmp_path / "v.nrrd", region={"min": clear[:3], "max": clear[3:]})
    assert points is not None, report
    assert_ellipsoid(points)
    end = (MATRICES["turned"] @ [0, 0, 19, 1])[:3]
    normal = numpy.linalg.inv(MATRICES["turned"][:3, :3])[2]
    low = CENTER - RADII
    box = {"min": [float(v) for v in low - 1], "max": [float(v) for v in CENTER]}
    assert max(normal @ (numpy.array(c) - end) for c in (box["max"],)) < 0  # clear of the end
    report, points = sample(tmp_path / "v.nrrd", region=box)
    assert points is not None, report
    assert_ellipsoid(points)


# ---- errors and limits

def broken(tmp_path):
    values, matrix = ellipsoid(MATRICES["plain"]), MATRICES["plain"]
    raw = nrrd_data(values)

    def nrrd(lines, data=raw):
        return ("\n".join(lines) + "\n\n").encode() + data

    def header(**of):
        lines = nrrd_header(values, matrix, of.pop("encoding", "raw"))
        for key, value in of.items():
            lines = [x for x in lines if not x.startswith(key + ":")] + ([f"{key}: {value}"] if value else [])
        return lines

    yield "cut.nrrd", nrrd(header(), raw[:-1]), "input_damaged", "has 106079 bytes, but its header states 106080"
    yield "cut_gzip.nrrd", nrrd(header(encoding="gzip"), gzip.compress(raw)[:-3000]), "input_damaged", "truncated"
    yield "words.nrrd", nrrd(header(encoding="ascii"), b"1 2 x " * 26520), "input_damaged", "text among its numbers"
    yield "huge.nrrd", nrrd(header(sizes="100000 100000 100000")), "input_damaged", "its header states"
    yield "vast.nrrd", nrrd(header(sizes="1000000 1000000 1000000")), "input_damaged", "claims"
    skip = ["byte skip: 9223372036854775807"]
    yield "skip.nrrd", nrrd([*header(), *skip]), "input_damaged", "begin after 9223372036854775807 bytes"
    yield "negative.nrrd", nrrd(header(sizes="-3 4 5")), "input_damaged", "header cannot be read"
    yield "flat.nrrd", nrrd(header(sizes="1020 26 1"), raw), "no_surface", "at least two along each axis"
    yield "block.nrrd", nrrd(header(type="block")), "input_damaged", "block"
    yield "hex.nrrd", nrrd(header(encoding="hex")), "input_unsupported", "hex"
    yield "colour.nrrd", nrrd(header(kinds="RGB-color domain domain", sizes="3 260 34")), "input_unsupported", "RGB-color"
    yield "missing.nhdr", nrrd([*header(), "data file: nowhere.raw"]), "input_missing", "nowhere.raw"
    yield "pattern.nhdr", nrrd([*header(), "data file: %s%d 1 3 1"]), "input_damaged", "FORMAT MIN MAX STEP"
    wide = "data file: %999d 1 3 1"
    yield "wide.nhdr", nrrd([*header(), wide]), "input_damaged", "names beyond 511 bytes"
    far = "data file: %d 1 3 9223372036854775807"
    yield "far.nhdr", nrrd([*header(), far]), "input_damaged", "FORMAT MIN MAX STEP"
    yield "flat_axes.nrrd", nrrd([x for x in header() if not x.startswith("space directions")] +
                                 ["space directions: (1,0,0) (0,1,0) (1,1,0)"]), "input_damaged", "one plane"
    yield "other.nrrd", b"# vtk DataFile Version 3.0\n" + raw, "input_unsupported", "VTK file (3D Slicer saves a volume as NRRD"
    yield "other.vdb", b" BDV\0\0\0\0" + raw, "input_unsupported", "OpenVDB file (use surface.vdb)"
    yield "other.slc", b"11111\n66 66 66 8\n" + raw, "input_unsupported", "SLC volume of VolVis (ParaView saves it"
    yield "other.vol", b"VOL\3" + raw, "input_unsupported", "byte skip: 48"
    yield "unknown.vol", b"\7\6\5\4" + raw, "input_unsupported", "raw numbers need an NRRD header"
    write_nifti(tmp_path / "two.nii", values, matrix, version=2)
    two = bytearray((tmp_path / "two.nii").read_bytes())
    two[16:24] = b"\xa8" * 8  # the number of axes, which libnifti believes
    yield "axes.nii", two, "input_damaged", "is contradictory"
    yield "empty.nii", b"", "input_damaged", "empty"
    yield "lfs.nii", b"version https://git-lfs.github.com/spec/v1\n", "input_damaged", "Git LFS"


@pytest.mark.sanitized
def test_broken_files_say_what_is_wrong(sample, tmp_path):
    for name, data, code, word in broken(tmp_path):
        (tmp_path / name).write_bytes(data)
        e, points = sample(tmp_path / name)
        assert points is None and e["code"] == code and word in e["message"], (name, e)
        assert name in e["message"], e


@pytest.mark.sanitized
def test_of_several_volumes_one_is_chosen(sample, tmp_path):
    values, matrix = ellipsoid(MATRICES["plain"]), MATRICES["plain"]
    write_nifti(tmp_path / "v.nii", values, matrix)
    data = bytearray((tmp_path / "v.nii").read_bytes())
    data[40:42], data[48:50] = (4).to_bytes(2, "little"), (2).to_bytes(2, "little")
    other = numpy.full_like(values, values.min()).tobytes(order="F")
    (tmp_path / "four.nii").write_bytes(data[:352] + other + data[352:])
    e, _ = sample(tmp_path / "four.nii")
    assert e["code"] == "grid_ambiguous" and "choose one with index, 0 to 1" in e["message"]
    e, _ = sample({"path": str(tmp_path / "four.nii"), "index": 2})
    assert e["code"] == "grid_missing" and "no volume 2: choose index from 0 to 1" in e["message"]
    assert sample({"path": str(tmp_path / "four.nii"), "index": 0})[0]["code"] == "no_surface"
    assert_ellipsoid(sample({"path": str(tmp_path / "four.nii"), "index": 1})[1])
    lines = [x.replace("dimension: 3", "dimension: 4").replace("sizes: ", "sizes: 1 ") for x in nrrd_header(values)]
    (tmp_path / "v.nrrd").write_bytes(("\n".join(lines) + "\n\n").encode() + nrrd_data(values))
    assert sample(tmp_path / "v.nrrd")[1] is not None


@pytest.mark.sanitized
def test_an_isovalue_out_of_range_is_no_surface(sample, tmp_path):
    write_nrrd(tmp_path / "v.nrrd", ellipsoid(MATRICES["plain"]), MATRICES["plain"])
    e, _ = sample(tmp_path / "v.nrrd", isovalue=3.0)
    assert e["code"] == "no_surface" and "isovalue 3: choose an isovalue above" in e["message"]


@pytest.mark.parametrize("at_the_end", [False, True])
def test_the_value_of_the_background_is_no_isovalue(sample, tmp_path, at_the_end):
    values = numpy.full(SIZE, 120, "u1")
    values[:2 if at_the_end else 8] = 0  # one voxel of zeros beside the end of the data, or more
    values[-3:] = 200
    write_nifti(tmp_path / "a.nii", values)
    told, _ = sample(tmp_path / "a.nii", 0)
    assert told["code"] == "no_surface"
    assert "no surface at isovalue 0: in 100 % of the cells" in told["message"] and "Try 0.5" in told["message"]
    told, points = sample(tmp_path / "a.nii", 0.5)
    assert points is not None
    write_nifti(tmp_path / "b.nii", values.astype("f4") / 3 + numpy.float32(0.25))
    told, _ = sample(tmp_path / "b.nii", 0.25)
    assert "Choose an isovalue above 0.25 and below 66.9" in told["message"]


def test_the_advised_isovalues_do_not_contain_the_refused_one(sample, tmp_path):
    values = numpy.full(SIZE, 40.25, "f4")  # lower and higher values lie beside the background
    values[:8], values[-3:] = 0.25, 66.75
    write_nifti(tmp_path / "a.nii", values)
    told, _ = sample(tmp_path / "a.nii", 40.25)
    assert "Choose an isovalue above 40.25 and below 66.75" in told["message"]


def test_labels_are_advised_for_a_mask_with_walls_of_a_voxel(sample, tmp_path):
    rough = (ndimage.gaussian_filter(numpy.random.default_rng(4).normal(size=(30, 30, 30)), 1) > 0.25).astype("u1")
    codes = {}
    for name, values in (("mask", 255 * rough), ("levels", 255 * rough - rough * numpy.indices(rough.shape)[0].astype("u1"))):
        write_nrrd(tmp_path / f"{name}.nrrd", values.astype("u1"), MATRICES["plain"])
        report, _ = sample(tmp_path / f"{name}.nrrd", 127.5)
        assert report["outcome"] != "converged"
        codes[name] = [a["code"] for a in report["advice"] if "/surface/labels" in a["message"]]
    assert codes == {"mask": ["mask"], "levels": []}


@pytest.mark.sanitized
def test_data_files_stay_within_the_roots(worker, tmp_path):
    inside, outside = tmp_path / "inside", tmp_path / "outside.raw"
    inside.mkdir()
    values = ellipsoid(MATRICES["plain"])
    outside.write_bytes(nrrd_data(values))
    for k, name in enumerate(("../outside.raw", str(outside))):
        lines = nrrd_header(values, MATRICES["plain"], extra=[f"data file: {name}"])
        (inside / f"v{k}.nhdr").write_text("\n".join(lines) + "\n")
        spec = {"version": 1, "surface": {"volume": {"path": f"v{k}.nhdr", "isovalue": 0}}, "sampling": {"count": 100}}
        done = worker(spec, "--input-root", inside)
        assert json.loads(done.stderr.splitlines()[-1])["code"] == "path_forbidden", done.stderr


@pytest.mark.parametrize("n, limit_mb, peak_mb", [
    (288, 64, 84), pytest.param(384, 96, 200, marks=pytest.mark.extended)])
def test_a_large_volume_fits_in_a_small_memory(worker, sanitized, tmp_path, diagnose, n, limit_mb, peak_mb):
    """288^3 floats are 91 MiB and 384^3 floats 216 MiB; a sphere in them is sampled in less memory."""
    side, radius = numpy.arange(n, dtype="f4") - (n - 1) / 2, 60
    with (tmp_path / "v.nrrd").open("wb") as file:
        file.write(("\n".join(nrrd_header(numpy.empty((n, n, n), "f4"))) + "\n\n").encode())
        plane = side[:, None] ** 2 + side[None, :] ** 2
        for z in side:
            file.write((radius - numpy.sqrt(plane + z * z)).astype("<f4").tobytes())
    spec = {"version": 1, "surface": {"volume": {"path": str(tmp_path / "v.nrrd"), "isovalue": 0}},
            "sampling": {"count": 2000}, "output": {"preview": False}, "limits": {"memory_mb": limit_mb}}
    done = worker(spec)
    assert done.returncode in (0, 10, 11), done.stderr
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    diagnose(f"peak memory of a {n}^3 volume: {report['peak_memory_bytes'] / 2**20:.0f} MiB")
    if not sanitized:  # sanitizers have memory of their own
        assert report["peak_memory_bytes"] < peak_mb * 2**20
    assert report["surface"]["area"] == pytest.approx(4 * numpy.pi * radius**2, rel=1e-4)


# ---- real files, against a reading of their own

REAL = [("tooth.nhdr", 600, read_nrrd), ("fmob-c4h.nrrd", 0.5, read_nrrd), ("headsq/quarter.nhdr", 1200, read_nrrd),
        ("avg152T1_RL_nifti.nii.gz", 100, read_nifti), ("anatomical.nii", 5000, read_nifti),
        ("pynrrd/BallBinary30x30x30_gz.nrrd", 128, read_nrrd)]


@pytest.mark.parametrize("name,isovalue,read", REAL)
def test_real_files_against_an_independent_reading(sample, shared_data, name, isovalue, read):
    path = shared_data / "volumes" / name
    values, matrix = read(path)
    report, points = sample(path, isovalue)
    assert points is not None, report
    # natural ends: beyond them the data are reflected in their last sample
    pad = 12
    values = numpy.pad(values, pad, mode="reflect", reflect_type="odd")
    coefficients = ndimage.spline_filter(values, order=3, mode="mirror")
    index = numpy.linalg.solve(matrix[:3, :3], (points.position - matrix[:3, 3]).T) + pad

    def at(offset):
        return ndimage.map_coordinates(coefficients, index + numpy.array(offset)[:, None], order=3, prefilter=False)

    step = 1e-4
    gradient = numpy.array([at(step * u) - at(-step * u) for u in numpy.eye(3)]) / (2 * step)
    steep = numpy.linalg.norm(gradient, axis=0)
    far = numpy.abs(at([0, 0, 0]) - isovalue) / steep
    assert numpy.quantile(far, 0.99) < 1e-3 and far.max() < 0.1
    outward = -numpy.linalg.solve(matrix[:3, :3].T, gradient)
    outward /= numpy.linalg.norm(outward, axis=0)
    assert numpy.quantile((outward.T * points.normal).sum(axis=1), 0.01) > 0.999


# ---- through REST

def test_volumes_through_rest(new_service, tmp_path):
    """Names in the spec are relative to an input root; what is missing is told when the job is submitted."""
    root = tmp_path / "root"
    root.mkdir()
    values, matrix = ellipsoid(MATRICES["plain"]), MATRICES["plain"]
    (root / "v.nhdr").write_text("\n".join(nrrd_header(values, matrix, extra=["data file: v.raw"])) + "\n")
    (root / "v.raw").write_bytes(nrrd_data(values))
    exr = {**stack(root, values), "path": "s.####.exr"}
    ball = {"analytic": {"shape": "sphere", "radius": 1, "center": [float(v) for v in CENTER]}}
    surfaces = {"volume": {"volume": {"path": "v.nhdr", "isovalue": 0}}, "exr": {"exr": {**exr, "isovalue": 0}}}
    surfaces["difference"] = {"difference": [surfaces["volume"], ball]}
    service = new_service("--input_roots", root).start()
    jobs = {name: service.submit({"version": 1, "surface": surface, "sampling": {"count": COUNT}, "output": {"preview": False}})
            for name, surface in surfaces.items()}
    digests = {}
    for name, job in jobs.items():
        service.wait_state(job, "succeeded")
        listed = {r["name"]: r["sha256"] for r in service.get(f"/v1/jobs/{job}/results").json["results"]}
        digests[name] = listed["points.ply"]
    assert digests["volume"] == digests["exr"] != digests["difference"]
    (root / "s.0007.exr").unlink()
    reply = service.post("/v1/jobs", {"version": 1, "surface": surfaces["exr"], "sampling": {"count": COUNT}})
    assert reply.status >= 400 and reply.json["code"] == "input_missing"
    assert reply.json["errors"][0]["pointer"] == "/surface/exr/path" and "s.0007.exr" in reply.json["errors"][0]["detail"]
    nested = {"union": [ball, {"volume": {"path": "../v.nhdr", "isovalue": 0}}]}
    reply = service.post("/v1/jobs", {"version": 1, "surface": nested, "sampling": {"count": COUNT}})
    assert reply.json["code"] == "path_forbidden"
    assert reply.json["errors"][0]["pointer"] == "/surface/union/1/volume/path"


def test_a_speck_has_a_point_or_is_told(worker, tmp_path):
    """A part whose share of the count is a fifth of a point: the paper's method has none there, and says so."""
    x = numpy.arange(24) - 11.5
    values = numpy.clip(8.5 - numpy.sqrt(sum(g * g for g in numpy.meshgrid(x, x, x))), 0, 1).astype(numpy.float32)
    volume = {"path": "speck.nrrd", "isovalue": 0.5}
    for speck, method, told in ((0, "paper", False), (1, "paper", True), (1, "sized", False)):
        values[2, 2, 2] = speck
        write_nrrd(tmp_path / "speck.nrrd", values)
        done = worker({"version": 1, "surface": {"volume": volume}, "sampling": {"count": 60},
                       "solver": {"method": method}, "output": {"preview": False}})
        assert done.returncode in (0, 11), done.stderr
        report = json.loads((tmp_path / "out" / "report.json").read_text())
        assert (report["quality"]["coverage"] > 1.2) == told
        assert ("coverage" in [r["criterion"] for r in report["outcome_reasons"]]) == told
        points = Points((tmp_path / "out" / "points.ply").read_bytes())
        assert (numpy.linalg.norm(points.position - 2, axis=1) < 1).sum() == (speck and method == "sized")


@pytest.mark.parametrize("away, least", [(2.0, 0.75), (1.6, 0)])
def test_droplets_beside_a_surface_have_points(worker, tmp_path, away, least):
    """Droplets of a voxel, `away` voxels from a ball: their cells touch its cells, or are the same. All get their share of the
    points, as far as cells tell, and each some."""
    n, radius, count = 48, 14, 8000
    index = numpy.stack(numpy.meshgrid(*[numpy.arange(n)] * 3, indexing="ij"), -1)
    middle = (n - 1) / 2
    values = numpy.clip(radius - numpy.linalg.norm(index - middle, axis=-1), -1, 1).astype(numpy.float32)
    angles = numpy.arange(12) * numpy.pi / 6
    ways = numpy.stack([numpy.cos(angles), 0.8 * numpy.sin(angles), 0.6 * numpy.sin(angles)], -1)
    droplets = numpy.round(middle + (radius + away) * ways).astype(int)
    values[tuple(droplets.T)] = 0.5
    write_nrrd(tmp_path / "droplets.nrrd", values, numpy.eye(4))
    done = worker({"version": 1, "surface": {"volume": {"path": "droplets.nrrd", "isovalue": 0}},
                   "sampling": {"count": count}, "output": {"preview": False}})
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    points = Points((tmp_path / "out" / "points.ply").read_bytes())
    on_ball = numpy.linalg.norm(points.position - middle, axis=1) < radius + 0.45 * away
    found = numpy.array([(numpy.linalg.norm(points.position[~on_ball] - d, axis=1) < 0.8).sum() for d in droplets])
    share = (report["surface"]["area"] - 4 * numpy.pi * radius**2) / 12 / report["surface"]["area"] * count
    assert report["quality"]["coverage"] < 1.2 and found.min() >= max(1, least * share), (found, share)


def test_a_coarse_answer_is_even_in_space(worker, tmp_path):
    """A count that resolves nothing of what looks like smoke: no clumps (nearest of twelve seeds .556 to .707), no bare place, the same for any
    number of threads."""
    noise = numpy.random.default_rng(1).normal(size=(40, 40, 40))
    values = ndimage.gaussian_filter(noise, 1.3)
    values[[0, 1, -2, -1]] = values[:, [0, 1, -2, -1]] = values[:, :, [0, 1, -2, -1]] = -1
    write_nrrd(tmp_path / "smoke.nrrd", (values / values.std()).astype(numpy.float32))
    spec = {"version": 1, "surface": {"volume": {"path": "smoke.nrrd", "isovalue": 0.5}}, "sampling": {"count": 1200},
            "output": {"preview": False}}
    files = []
    for threads in (1, 3):
        done = worker({**spec, "solver": {"threads": threads}})
        assert done.returncode == 11, done.stderr
        files.append((tmp_path / "out" / "points.ply").read_bytes())
    assert files[0] == files[1]
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    points = Points(files[0])
    nearest = cKDTree(points.position).query(points.position, 2)[0][:, 1] / report["spacing"]
    assert report["count"] == len(points.position) == 1200 and report["quality"]["lost"] == 0
    assert report["quality"]["thin_count"] > 0.5 * report["count"] and report["quality"]["coverage"] < 1.2
    assert nearest.min() > 0.5 and report["quality"]["max_residual"] < 1e-4
    assert report["diagnostics"]["step_left"] is None and "step_left" not in [r["criterion"] for r in report["outcome_reasons"]]


@pytest.mark.sanitized
def test_a_support_does_not_vanish(worker, tmp_path):
    """On noise, the same in all slices, some points come to lie at one place, whose energy no support makes ideal: it was 1e-17
    of the spacing, and the job ended for want of memory or after 4 500 sweeps."""
    draws = numpy.random.default_rng(1)
    values = (draws.integers(0, 2, (6, 24, 24)) * 2 - 1) * 65504 * draws.random((6, 24, 24)) ** 8
    write_nrrd(tmp_path / "noise.nrrd", numpy.broadcast_to(values[:1], values.shape).astype(numpy.float32))
    done = worker({"version": 1, "surface": {"volume": {"path": "noise.nrrd", "isovalue": 0}}, "sampling": {"count": 1000},
                   "output": {"preview": False}})
    assert done.returncode in (0, 10, 11), done.stderr
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert min(r["sigma"] for r in report["rounds"]) > 0.5 * report["spacing"] and report["sweeps_total"] < 2000


@pytest.mark.extended
def test_the_papers_method_comes_to_rest_on_what_it_does_not_resolve(solve, tmp_path):
    """On a surface that is rough below the spacing particles lie on kinks, where no step makes the energy less."""
    x = numpy.linspace(-1, 1, 48)
    rough = ndimage.gaussian_filter(numpy.random.default_rng(3).standard_normal((48, 48, 48)), 1.3)
    values = 0.6 - numpy.sqrt(sum(g * g for g in numpy.meshgrid(x, x, x))) + 0.25 * rough / rough.std()
    write_nrrd(tmp_path / "rough.nrrd", numpy.pad(values[1:-1, 1:-1, 1:-1], 1, constant_values=-1).astype(numpy.float32))
    report, _ = solve({"version": 1, "surface": {"volume": {"path": "rough.nrrd", "isovalue": 0}},
                       "sampling": {"count": 600, "alpha": {"d": 2}}, "solver": {"method": "paper"}, "output": {"preview": False}})
    assert report["outcome"] == "unresolved" and report["sweeps_total"] < 2000
