# SPDX-License-Identifier: Apache-2.0
"""Level sets whose voxels are not as they should be: an inside with the sign of the outside, NaN, and bands that are too narrow or cut
open. Each is sampled as the intact one, with a warning, or refused with its cause."""
import numpy
import pytest

pyopenvdb = pytest.importorskip("pyopenvdb", reason="python3-openvdb is not installed")


SIDE = 44


def places(low=0):
    return numpy.stack(numpy.meshgrid(*3 * [numpy.arange(SIDE)], indexing="ij"), -1) - (SIDE - 1) / 2 + 0.25


def ball(radius, at=(0, 0, 0)):
    return numpy.linalg.norm(places() - at, axis=-1) - radius


def torus():
    x = places()
    return numpy.hypot(numpy.hypot(x[..., 0], x[..., 1]) - 12, x[..., 2]) - 5


def box():
    x = numpy.abs(places()) - (16, 12, 9)
    return numpy.linalg.norm(x.clip(0), axis=-1) + x.max(axis=-1).clip(None, 0)


# Distances in voxels; the last ones are a cavity, two balls, and one that is thinner than its band.
SHAPES = {"ball": lambda: ball(16), "torus": torus, "box": box, "cavity": lambda: numpy.maximum(ball(18), 9 - numpy.abs(ball(0))),
          "two": lambda: numpy.minimum(ball(7, (-11, 0, 0)), ball(8, (10, 3, 0))), "small": lambda: ball(2.5)}


def write(path, values, fill=True, low=(0, 0, 0), half=3.0, step=0.5, beyond=1):
    """The band of distances in voxels, clamped at `half`; beyond it voxels are inactive, of the right sign if `fill`, else of the
    sign of `beyond`."""
    grid = pyopenvdb.FloatGrid()
    grid.background = beyond * half * step
    band = numpy.where(numpy.abs(values) < half, values * step, beyond * half * step)
    grid.copyFromArray(band.astype("f4"), ijk=low)
    if fill:
        grid.signedFloodFill()
    for at in numpy.argwhere(~numpy.isfinite(values)):
        grid.getAccessor().setValueOn(tuple(int(v) for v in at + low), float(values[tuple(at)]))
    grid.name, grid.gridClass = "surface", pyopenvdb.GridClass.LEVEL_SET
    grid.transform = pyopenvdb.createLinearTransform(voxelSize=step)
    pyopenvdb.write(str(path), grid)


@pytest.fixture
def told(solve):
    def run(path, **members):
        report, _ = solve({"version": 1, "surface": {"vdb": {"path": str(path), **members}}, "sampling": {"count": 80},
                           "solver": {"threads": 1, "max_sweeps": 2}, "output": {"preview": False}})
        return report
    return run


def digest(report):
    assert "outputs" in report, report
    return report["outputs"][0]["sha256"]


def filled(report):
    return [w for w in report["surface"]["warnings"] if "inside with the sign of the outside" in w]


@pytest.mark.parametrize("shape", SHAPES)
def test_an_inside_with_the_sign_of_the_outside_is_filled(told, tmp_path, shape):
    values = SHAPES[shape]()
    write(tmp_path / "intact.vdb", values)
    write(tmp_path / "open.vdb", values, fill=False)
    intact, repaired = told(tmp_path / "intact.vdb"), told(tmp_path / "open.vdb")
    assert digest(repaired) == digest(intact) and not filled(intact)
    # a ball that is all band has no inactive inside
    assert len(filled(repaired)) == (shape != "small")


@pytest.mark.sanitized
def test_an_outside_with_the_sign_of_the_inside_is_filled(told, tmp_path):
    write(tmp_path / "intact.vdb", ball(16))
    write(tmp_path / "inverse.vdb", ball(16), fill=False, beyond=-1)
    repaired = told(tmp_path / "inverse.vdb")
    assert digest(repaired) == digest(told(tmp_path / "intact.vdb")) and len(filled(repaired)) == 1


@pytest.mark.parametrize("low, members", [((-4096 - 20, 4096 - 30, 100), {}), ((-22, -22, -22), {"isovalue": 0.25}),
                                          ((0, 0, 0), {"isovalue": -0.25})])
def test_filling_reaches_across_nodes_and_holds_for_other_isovalues(told, tmp_path, low, members):
    write(tmp_path / "intact.vdb", ball(16), low=low)
    write(tmp_path / "open.vdb", ball(16), fill=False, low=low)
    repaired = told(tmp_path / "open.vdb", **members)
    assert digest(repaired) == digest(told(tmp_path / "intact.vdb", **members)) and len(filled(repaired)) == 1


@pytest.mark.sanitized
@pytest.mark.parametrize("values", [[numpy.nan], [numpy.inf], [-numpy.inf], [numpy.nan] * 5, [numpy.nan, numpy.inf]])
@pytest.mark.parametrize("fill", [True, False])
def test_voxels_that_are_not_finite_are_named(told, tmp_path, values, fill):
    distances, middle = ball(16), (SIDE - 1) // 2
    for k, value in enumerate(values):
        distances[middle, middle + k, middle + 16] = value
    write(tmp_path / "v.vdb", distances, fill, low=(-5, 7, 9))
    error = told(tmp_path / "v.vdb")
    first = f"({middle - 5}, {middle + 7}, {middle + 16 + 9})"
    assert error["code"] == "input_damaged" and first in error["message"], error
    assert f"{len(values)} " in error["message"] and "half-width" not in error["message"]


@pytest.mark.parametrize("shape", ["ball", "torus", "box", "cavity", "two"])
@pytest.mark.parametrize("half, fill", [(1.0, True), (0.8, True), (1.0, False)])
def test_a_band_that_is_too_narrow_is_told(told, tmp_path, shape, half, fill):
    write(tmp_path / "v.vdb", SHAPES[shape](), fill, half=half)
    error = told(tmp_path / "v.vdb")
    assert error["code"] == "input_unsupported" and f"({half:.3g} voxels)" in error["message"], error
    assert "half-width of at least 3 voxels" in error["message"] and "NaN" not in error["message"]


@pytest.mark.parametrize("begin, code, words", [
    (b"NanoVDB0", "input_unsupported", "NanoVDB file: convert it (`nanovdb_convert"), (b"NRRD0004", "input_damaged", "use surface.volume for NRRD")])
def test_other_files_are_named_with_a_converter(told, tmp_path, begin, code, words):
    (tmp_path / "v.vdb").write_bytes(begin + bytes(1000))
    error = told(tmp_path / "v.vdb")
    assert error["code"] == code and words in error["message"], error


@pytest.mark.parametrize("fill", [True, False])
def test_a_band_with_a_hole_is_told(told, tmp_path, fill):
    distances = ball(16)
    distances[:10, 18:24, 18:24] = 100
    write(tmp_path / "v.vdb", distances, fill)
    error = told(tmp_path / "v.vdb")
    assert error["code"] == "input_unsupported" and " is cut open or clamped at " in error["message"], error
