# SPDX-License-Identifier: Apache-2.0
"""Coherent sequences end to end, through REST and by the worker alone: a torus that moves, turns and grows, and smoke that
drifts in a wind."""
import json
import pathlib
import shutil
import sys

import numpy
import pytest

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[2] / "measurements" / folder) for folder in ("common", "sequences")]

import measure  # noqa: E402
import sequence  # noqa: E402
from readers import read_columns  # noqa: E402

FRAMES, COUNT, VOXEL = 20, 1000, 0.08


@pytest.fixture(scope="module")
def footage(tmp_path_factory):
    pytest.importorskip("pyopenvdb", reason="there is no pyopenvdb to write level sets with")
    where = tmp_path_factory.mktemp("footage")
    for frame in range(1, FRAMES + 1):
        sequence.write_shape(sequence.Torus(frame, sequence.TORUS), VOXEL, where / f"torus.{frame:04d}.vdb")
    return where


def spec_of(footage, frames, **parts):
    return {"version": 1, "surface": {"vdb": {"path": str(footage / "torus.####.vdb")}}, "sampling": {"count": COUNT},
            "output": {"preview": False, "ply": {"properties": ["all"]}, **parts.pop("output", {})}, "queue": {"frames": frames, "coherent": True},
            **parts}


def read(where):
    return measure.read_ply(where / "points.ply"), json.loads((where / "report.json").read_text())


def ids_of(points):
    return points.columns["id"].astype(int)


@pytest.mark.parametrize("frames", [6, pytest.param(FRAMES, marks=pytest.mark.extended)])
def test_frames_are_one_job_of_points_that_stay_put(new_service, footage, frames):
    count = 2000
    service = new_service("--input_roots", footage).start()
    job = service.submit(spec_of(footage, f"1-{frames}", sampling={"count": count}))
    done = service.wait_state(job, "succeeded")
    assert done["outcome"] == "converged"
    # one after the other, however many workers there are
    tasks = service.get(f"/v1/jobs/{job}/tasks?limit={frames}").json["tasks"]
    assert all(a["finished"] <= b["started"] for a, b in zip(tasks, tasks[1:]))
    before = None
    for frame in range(1, frames + 1):
        points, report = read(service.state / "results" / f"{job}.{frame}")
        area = sequence.Torus(frame, sequence.TORUS).area()
        assert measure.measure(points, area)["hex_fraction"] >= sequence.HEX_LEAST
        assert len(set(ids_of(points))) == count
        told = report["sequence"]
        assert told["frame"] == frame and told["carried"] + told["born"] == count
        if before:
            assert told["previous_frame"] == frame - 1
            way = sequence.ways({"torus": sequence.TORUS}, frame, before, points)
            assert numpy.median(way) < sequence.DRIFT_MOST * measure.ideal_spacing(area, count)
            kept = numpy.intersect1d(ids_of(before), ids_of(points), return_indices=True)
            assert len(kept[0]) == told["carried"]
            velocity = numpy.stack([points.columns[f"velocity_{axis}"] for axis in "xyz"], axis=1)
            gone = points.position[kept[2]] - before.position[kept[1]]
            assert abs(velocity[kept[2]] - gone).max() < 1e-5
        before = points


PUFFS = numpy.array([[-0.5, 0.1, -0.8, 0.28], [0.35, -0.2, -0.6, 0.25], [-0.1, 0.3, -0.1, 0.24], [0.3, -0.1, 0.4, 0.21],
                     [-0.3, -0.15, 0.75, 0.19]])  # centre and width
BREEZE, SPREAD, FOG_VOXEL, FOG_FRAMES = 0.02, 1.004, 0.08, 6


def test_a_surface_that_stretches_is_eased_a_little_in_each_frame(worker, tmp_path, diagnose):
    """Its packing is strained in each frame: no frame moves the points far to relax it."""
    pytest.importorskip("pyopenvdb", reason="there is no pyopenvdb to write level sets with")
    case = {"bending": {"radii": [1.0, 0.4], "height": 0.03}}
    frames = range(1, 9)
    for frame in frames:
        sequence.write_shape(sequence.shape_of(case, frame), VOXEL, tmp_path / f"torus.{frame:04d}.vdb")
    spec, before, eased = spec_of(tmp_path, f"{frames[0]}-{frames[-1]}"), None, []
    for frame in frames:
        previous = ("--previous", tmp_path / str(frame - 1)) if before else ()
        assert worker(spec, "--frame", frame, *previous, output=str(frame)).returncode == 0
        points, report = read(tmp_path / str(frame))
        if before:
            h = measure.ideal_spacing(sequence.shape_of(case, frame).area(), COUNT)
            way = sequence.ways(case, frame, before, points) / h
            eased.append(report["rounds"][-1]["regime"] == "continued_with_longer_steps")
            diagnose(f"frame {frame}: {numpy.median(way):.3f} spacings, {report['sweeps_total']} sweeps, eased {eased[-1]}")
            assert len(way) == COUNT and numpy.median(way) < sequence.DRIFT_MOST and report["sweeps_total"] < 60
        before = points
    assert 2 <= sum(eased)


def wind(x):
    """A velocity without sources that turns from place to place (Arnold, Beltrami and Childress), along the last axis."""
    x, y, z = numpy.moveaxis(2 * x, -1, 0)
    return numpy.stack([0.3 * numpy.sin(z) + 0.2 * numpy.cos(y), 0.25 * numpy.sin(x) + 0.3 * numpy.cos(z),
                        0.2 * numpy.sin(y) + 0.25 * numpy.cos(x)], axis=-1)


def smoke(x, frame):
    """Density: puffs that spread, carried along by the wind; so each place is followed back to where its smoke was."""
    for _ in range(frame - 1):
        x = x - BREEZE * wind(x - BREEZE / 2 * wind(x))
    width = PUFFS[:, 3] * SPREAD ** (frame - 1)
    return sum(numpy.exp(-((x - p[:3])**2).sum(axis=-1) / (2 * w**2)) for p, w in zip(PUFFS, width))


@pytest.fixture(scope="module")
def fog(tmp_path_factory):
    openvdb = pytest.importorskip("pyopenvdb", reason="there is no pyopenvdb to write volumes with")
    where, reach = tmp_path_factory.mktemp("fog"), 22
    axis = numpy.arange(-reach, reach + 1) * FOG_VOXEL
    places = numpy.stack(numpy.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    for frame in range(1, FOG_FRAMES + 1):
        grid = openvdb.FloatGrid()
        grid.copyFromArray(smoke(places, frame).astype("f4"), ijk=(-reach,) * 3)
        grid.transform, grid.name = openvdb.createLinearTransform(FOG_VOXEL), "density"
        grid.gridClass = openvdb.GridClass.FOG_VOLUME
        openvdb.write(str(where / f"fog.{frame:04d}.vdb"), grids=[grid])
    return where


def slides(before, after, moved):
    """How far points went along the surface, beside its motion as a whole, which the report tells."""
    _, i, j = numpy.intersect1d(ids_of(before), ids_of(after), return_indices=True)
    centre = numpy.array(moved["center"])
    arm = (before.position[i] - centre) @ sequence.rotation(moved["rotation"]).T
    way = after.position[j] - (centre + moved["translation"] + moved["scale"] * arm)
    return numpy.linalg.norm(way - (way * after.normal[j]).sum(axis=1)[:, None] * after.normal[j], axis=1)


def test_points_stay_put_on_smoke_that_drifts_and_spreads(new_service, fog, diagnose):
    """At a spacing, so that the count grows with the surface, which changes its shape all over."""
    spacing = 0.06
    service = new_service("--input_roots", fog).start()
    job = service.submit(spec_of(fog, f"1-{FOG_FRAMES}", sampling={"spacing": spacing}, surface={
        "vdb": {"path": str(fog / "fog.####.vdb"), "isovalue": 0.4, "reconstruction": "smoothing"}}))
    assert service.wait_state(job, "succeeded")["outcome"] == "converged"
    before, born = None, 0
    for frame in range(1, FOG_FRAMES + 1):
        points, report = read(service.state / "results" / f"{job}.{frame}")
        told, hexes = report["sequence"], measure.measure(points, report["surface"]["area"])["hex_fraction"]
        assert hexes >= sequence.HEX_LEAST
        if before:
            assert abs(smoke(points.position, frame) - 0.4).max() < 0.02  # what voxels leave of the formula
            way = numpy.median(slides(before, points, told["motion"])) / spacing
            diagnose(f"frame {frame}: {points.count} points, {told['born']} born, hex {hexes:.3f}, way {way:.3f}")
            assert way < sequence.DRIFT_MOST
            assert told["carried"] > 0.98 * before.count
            born += told["born"]
        before = points
    assert born > 50


def test_what_follows_a_frame_that_fails_is_tried_again_with_it(new_service, footage, tmp_path):
    mine = tmp_path / "mine"
    mine.mkdir()
    for frame in (1, 3):
        shutil.copy(footage / f"torus.{frame:04d}.vdb", mine)
    service = new_service("--input_roots", mine).start()
    job = service.submit(spec_of(mine, "1-3"))
    failed = service.wait_state(job, "failed")
    assert failed["error"]["code"] == "input_missing"
    assert "2 of 3 frames failed; frame 2:" in failed["error"]["message"]
    assert [p.name for p in (service.state / "results").iterdir()] == [f"{job}.1"]
    shutil.copy(footage / "torus.0002.vdb", mine)
    assert service.post(f"/v1/jobs/{job}/retry").status == 200
    service.wait_state(job, "succeeded")
    for frame in (2, 3):
        told = read(service.state / "results" / f"{job}.{frame}")[1]["sequence"]
        assert told["previous_frame"] == frame - 1 and told["carried"] == COUNT


def test_a_frame_starts_from_one_with_the_default_properties(worker, footage, tmp_path):
    spec = spec_of(footage, "1-2", output={"ply": {}})
    for frame, previous in ((1, ()), (2, ("--previous", "1"))):
        assert worker(spec, "--frame", frame, *previous, output=str(frame)).returncode in (0, 10, 11)
    columns = read_columns((tmp_path / "2" / "points.ply").read_bytes())
    assert list(columns) == "x y z nx ny nz spacing_local id velocity_x velocity_y velocity_z".split()
    assert json.loads((tmp_path / "2" / "report.json").read_text())["sequence"]["carried"] > 0


def test_the_worker_alone_carries_points(worker, footage, tmp_path):
    spec = spec_of(footage, "1-5x2", output={"ply": {"format": "ascii", "properties": ["all"]}})
    assert worker(spec, "--frame", 1, output="1").returncode in (0, 10, 11)
    done = worker(spec, "--frame", 3, "--previous", "1", "--sandbox", "available", "--input-root", footage, output="3")
    assert done.returncode in (0, 10, 11), done.stderr
    again = worker(spec, "--frame", 3, "--previous", "1", "--threads", 1, output="again")
    assert again.returncode in (0, 10, 11), again.stderr
    first, then = read(tmp_path / "1")[0], read(tmp_path / "3")[0]
    assert (tmp_path / "3" / "points.ply").read_bytes() == (tmp_path / "again" / "points.ply").read_bytes()
    _, i, j = numpy.intersect1d(ids_of(first), ids_of(then), return_indices=True)
    velocity = numpy.stack([then.columns[f"velocity_{axis}"] for axis in "xyz"], axis=1)
    assert abs(2 * velocity[j] - (then.position[j] - first.position[i])).max() < 1e-5  # per frame, and these are two


def test_a_count_that_changes_is_met_by_births_and_deaths(worker, footage, tmp_path):
    assert worker(spec_of(footage, "1-3"), "--frame", 1, output="1").returncode in (0, 10, 11)
    more, fewer = (spec_of(footage, "1-3", sampling={"count": n}) for n in (COUNT + 20, COUNT - 20))
    assert worker(more, "--frame", 2, "--previous", "1", output="2").returncode in (0, 10, 11)
    assert worker(fewer, "--frame", 3, "--previous", "2", output="3").returncode in (0, 10, 11)
    second, third = read(tmp_path / "2"), read(tmp_path / "3")
    assert second[1]["sequence"]["born"] == 20 and set(ids_of(second[0])) == set(range(COUNT + 20))
    assert third[1]["sequence"]["died"] == 40 and third[1]["sequence"]["born"] == 0
    assert third[1]["sequence"]["next_id"] == COUNT + 20  # no id is used twice, whoever is gone
    assert third[0].count == COUNT - 20


@pytest.mark.parametrize("parts", [
    {"sampling": {"count": COUNT, "curvature": {"ratio": 4, "exponent": 1}}},
    {"region": {"min": [-3, -3, -3], "max": [0.3, 3, 3]}},
], ids=["graded", "region"])
def test_graded_and_cut_surfaces(worker, footage, tmp_path, parts):
    spec = spec_of(footage, "1-2", **parts)
    assert worker(spec, "--frame", 1, output="1").returncode in (0, 10, 11)
    assert worker(spec, "--frame", 2, "--previous", "1", output="2").returncode in (0, 10, 11)
    first, (second, report) = read(tmp_path / "1")[0], read(tmp_path / "2")
    assert report["sequence"]["carried"] > 0.9 * COUNT
    assert report["sequence"]["drift"]["median"] < sequence.DRIFT_MOST
    if "region" in parts:  # who is on the rim stays on it, unless the rim has become too short
        on_rim = [set(ids_of(p)[p.position[:, 0] == numpy.float32(0.3)]) for p in (first, second)]
        assert len(on_rim[0]) > 20 and len(on_rim[0] & on_rim[1]) > 0.8 * len(on_rim[0])


def test_another_surface_begins_anew(worker, footage, tmp_path):
    shutil.copy(footage / "torus.0001.vdb", tmp_path / "torus.0001.vdb")
    far = {**sequence.TORUS, "velocity": [9, 9, 9]}
    sequence.write_shape(sequence.Torus(2, far), VOXEL, tmp_path / "torus.0002.vdb")
    spec = spec_of(tmp_path, "1-2", output={"points_vdb": True})
    assert worker(spec, "--frame", 1, output="1").returncode in (0, 10, 11)
    assert worker(spec, "--frame", 2, "--previous", "1", output="2").returncode in (0, 10, 11)
    points, report = read(tmp_path / "2")
    told = report["sequence"]
    assert (told["previous_frame"], told["carried"], told["born"], told["died"]) == (1, 0, COUNT, COUNT)
    assert set(ids_of(points)) == set(range(COUNT, 2 * COUNT))
    assert not any(points.columns[f"velocity_{axis}"].any() for axis in "xyz")


@pytest.mark.parametrize("previous, code, words", [
    ("nowhere", "input_missing", "nowhere/points.ply"),
    ("plain", "input_damaged", "coherent sequence"),
    ("same", "input_damaged", "frame 2"),
    ("cut", "input_damaged", "its points.ply is damaged"),
])
def test_results_that_cannot_be_carried_are_refused(worker, footage, tmp_path, previous, code, words):
    spec = spec_of(footage, "1-3")
    if previous == "plain":
        alone = {**spec, "queue": {"frames": "1-3"}}
        assert worker(alone, "--frame", 1, output="plain").returncode in (0, 10, 11)
    elif previous != "nowhere":
        assert worker(spec, "--frame", 2, output=previous).returncode in (0, 10, 11)
    if previous == "cut":
        where = tmp_path / "cut" / "points.ply"
        where.write_bytes(where.read_bytes()[:-1])
    done = worker(spec, "--frame", 2 if previous == "same" else 3, "--previous", previous, output="out")
    told = json.loads(done.stderr.splitlines()[-1])
    assert told["code"] == code and words in told["message"], told


def test_previous_belongs_to_coherent_sequences(worker, footage):
    spec = spec_of(footage, "1-3")
    assert worker(spec, "--frame", 1, output="1").returncode in (0, 10, 11)
    done = worker({**spec, "queue": {"frames": "1-3"}}, "--frame", 2, "--previous", "1")
    assert done.returncode == 2 and "queue.coherent" in done.stderr


def drops(frame):
    """Two large drops part, and two small ones join them, in ten frames; as a density."""
    import pyopenvdb
    t, step = (frame - 1) / 9, 0.08
    cells = [slice(-size, size + 1) for size in (40, 32, 20)]
    at = numpy.moveaxis(numpy.mgrid[cells], 0, -1) * step
    places = [((-0.6 - 1.1 * t, 0, 0), 1.0), ((0.6 + 1.1 * t, 0.1 * t, 0), 0.9), ((0, 1.6 - 1.5 * t, 0.3), 0.5),
              ((0.2, -1.9 + 0.9 * t, -0.2), 0.45)]
    grid = pyopenvdb.FloatGrid(0.0)
    grid.name = "density"
    grid.copyFromArray(sum(numpy.exp(-((at - centre) ** 2).sum(-1) / radius ** 2) for centre, radius in places))
    grid.transform = pyopenvdb.createLinearTransform([[step, 0, 0, 0], [0, step, 0, 0], [0, 0, step, 0],
                                                      [*(-step * size for size in (40, 32, 20)), 1]])
    return grid


def write_drops(where, frame, kind):
    """A file of the frame, and the surface that it has, of which the frame is a part of the name."""
    import pyopenvdb
    path = where / f"drops.{frame:04d}.{'obj' if kind == 'mesh' else 'vdb'}"
    if kind == "vdb":
        pyopenvdb.write(str(path), [drops(frame)])
        return path, {"isovalue": 0.4}
    places, quads = drops(frame).convertToQuads(0.4)[:2]
    path.write_text("".join("v %.7g %.7g %.7g\n" % tuple(v) for v in places) +
                    "".join("f %d %d %d %d\n" % tuple(q[::-1] + 1) for q in quads))
    return path, {}


@pytest.mark.parametrize("kind", ["vdb", "mesh"])
@pytest.mark.parametrize("frames", [[3, 6, 9], pytest.param(list(range(1, 11)), marks=pytest.mark.extended)],
                         ids=["few", "ten"])
def test_frames_of_a_fluid_that_parts_are_in_as_good_order_as_alone(worker, tmp_path, frames, kind):
    pytest.importorskip("pyopenvdb", reason="there is no pyopenvdb to write volumes with")
    before = []
    for frame in frames:
        path, members = write_drops(tmp_path, frame, kind)
        spec = {"version": 1, "surface": {kind: {"path": str(path), **members}}, "sampling": {"count": 2000},
                "output": {"preview": False, "ply": {"properties": ["all"]}}}
        assert worker(spec, output="alone").returncode == 0
        spec["surface"][kind]["path"] = str(tmp_path / f"drops.####{path.suffix}")
        spec["queue"] = {"frames": "1-10", "coherent": True}
        assert worker(spec, "--frame", frame, *before, output=str(frame)).returncode == 0
        before = ["--previous", str(frame)]
        alone, coherent = (read(tmp_path / name)[1]["quality"] for name in ("alone", str(frame)))
        assert coherent["disorder"] <= 2 * alone["disorder"], frame


def write_bowl(path, place):
    """An open paraboloid; its rim is a circle of radius 1 about `place` + (0, 0, 0.5)."""
    rings, turns = 12, 48
    radius, angle = numpy.meshgrid(numpy.arange(rings + 1) / rings, 2 * numpy.pi * numpy.arange(turns) / turns,
                                   indexing="ij")
    places = numpy.stack([radius * numpy.cos(angle), radius * numpy.sin(angle), radius ** 2 / 2], -1).reshape(-1, 3)
    number = numpy.arange(len(places)).reshape(rings + 1, turns) + 1
    after = numpy.roll(number, -1, 1)
    quads = zip(*(n.ravel() for n in (number[:-1], number[1:], after[1:], after[:-1])))
    path.write_text("".join("v %.9g %.9g %.9g\n" % tuple(v) for v in places + place) +
                    "".join("f %d %d %d %d\n" % q for q in quads))


def test_points_go_with_an_open_mesh_and_stay_on_its_rim(worker, tmp_path):
    motion = numpy.array([0.2, -0.1, 0.15])
    for frame in (1, 2):
        write_bowl(tmp_path / f"bowl.{frame:04d}.obj", (frame - 1) * motion)
    spec = {"version": 1, "surface": {"mesh": {"path": str(tmp_path / "bowl.####.obj")}}, "sampling": {"count": 400},
            "output": {"preview": False, "ply": {"properties": ["all"]}}, "queue": {"frames": "1-2", "coherent": True}}
    assert worker(spec, "--frame", 1, output="1").returncode == 0
    assert worker(spec, "--frame", 2, "--previous", "1", output="2").returncode == 0
    first, (second, report) = read(tmp_path / "1")[0], read(tmp_path / "2")
    assert (report["sequence"]["carried"], report["sequence"]["born"], report["sequence"]["died"]) == (400, 0, 0)
    _, i, j = numpy.intersect1d(ids_of(first), ids_of(second), return_indices=True)
    assert abs(second.position[j] - first.position[i] - motion).max() < 0.1 * report["spacing"]
    on_rim = abs(first.position[i][:, 2] - 0.5) < 1e-6
    assert on_rim.sum() > 40 and abs(second.position[j][on_rim] - motion)[:, 2] == pytest.approx(0.5, abs=1e-6)


def test_points_on_the_edges_of_a_cube_turn_with_it(worker, tmp_path):
    corners = numpy.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    quads = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    turn = numpy.array([[0.98, -0.199, 0], [0.199, 0.98, 0], [0, 0, 1]])
    for frame, places in ((1, corners), (2, corners @ turn.T)):
        (tmp_path / f"cube.{frame:04d}.obj").write_text("".join("v %.9g %.9g %.9g\n" % tuple(v) for v in places) +
                                                        "".join("f %d %d %d %d\n" % q for q in quads))
    spec = {"version": 1, "surface": {"mesh": {"path": str(tmp_path / "cube.####.obj")}}, "sampling": {"count": 400},
            "output": {"preview": False, "ply": {"properties": ["all"]}}, "queue": {"frames": "1-2", "coherent": True}}
    assert worker(spec, "--frame", 1, output="1").returncode == 0
    assert worker(spec, "--frame", 2, "--previous", "1", output="2").returncode == 0
    first, (second, report) = read(tmp_path / "1")[0], read(tmp_path / "2")
    assert report["sequence"]["carried"] == 400 and report["curves"]["count"] == 12
    _, i, j = numpy.intersect1d(ids_of(first), ids_of(second), return_indices=True)
    before, after = first.position[i], second.position[j]
    on_edge = (abs(abs(before) - 1) < 1e-6).sum(axis=1) >= 2
    assert on_edge.sum() > 60 and abs(after - before @ turn.T)[on_edge].max() < 1e-5
    assert abs(after - before @ turn.T).max() < 0.2 * report["spacing"]
