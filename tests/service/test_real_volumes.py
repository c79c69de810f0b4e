# SPDX-License-Identifier: Apache-2.0
"""Real volumes through REST, as a user sends them: what comes back is held against what is known of the
file, against an independent interpolation of its grid, or against the error it must give."""
import hashlib
import json

import numpy
import pytest

from readers import EVERY, Points
from reference import Reference
from service import sphere

pytestmark = pytest.mark.extended  # all need the shared data

# Long jobs beside others on a machine that may be busy, with sanitizers at that.
JOB_PATIENCE_S = 900
# What 99 % of the points must keep to, and what the rest may not pass: of the smallest voxel edge.
NEAR_VOX, FAR_VOX = 0.1, 1.0


def vdb(path, count, grid=None, isovalue=None, **parts):
    surface = {"path": str(path)}
    if grid is not None:
        surface["grid"] = grid
    if isovalue is not None:
        surface["isovalue"] = isovalue
    spec = {"version": 1, "surface": {"vdb": surface}, "sampling": {"count": count},
            "solver": {"threads": 1}, "output": {"preview": False, "ply": EVERY}}
    spec.update(parts)
    return spec


def wait(service, job):
    """The job once it has ended, well or not."""
    return service.wait_state(job, "succeeded", "failed", "timed_out", "cancelled", seconds=JOB_PATIENCE_S)


def results(service, job):
    """The report and the points of a job that succeeded; what is served is what is listed."""
    done = wait(service, job)
    assert done["state"] == "succeeded", done
    assert len(done["attempts"]) == 1
    got = {}
    for listed in service.get(f"/v1/jobs/{job}/results").json["results"]:
        got[listed["name"]] = service.get(listed["href"]).body
        assert hashlib.sha256(got[listed["name"]]).hexdigest() == listed["sha256"]
    return json.loads(got["report.json"]), Points(got["points.ply"])


def assert_sound(report, points, count):
    """What holds for every result."""
    assert points.count == report["count"] == report["requested"]["count"] == count
    assert report["quality"]["lost"] == 0
    assert report["quality"]["max_residual"] <= 1e-3
    assert numpy.abs(numpy.linalg.norm(points.normal, axis=1) - 1).max() < 1e-6
    kappa = numpy.hypot(points.kappa1, points.kappa2)
    assert (points.kappa1 >= points.kappa2).all()
    assert numpy.abs(points.kappa - kappa).max() <= 1e-5 * kappa.max()


def figures(report, **more):
    q = report["quality"]
    told = {"outcome": report["outcome"], "hex_fraction": q["hex_fraction"], "edge_cv": q["edge_cv"],
            "min_spacing_ratio": q["min_spacing_ratio"], "max_residual": q["max_residual"], "euler": q["euler"],
            "total_s": report["timing_s"]["total"], **more}
    return ", ".join(f"{k} {v:.4g}" if isinstance(v, (int, float)) else f"{k} {v}" for k, v in told.items())


def second_opinion(path, grid, isovalue, report, points):
    """Distances and normals against the independent interpolation; returns figures to tell."""
    reference = Reference(path, grid)
    far = reference.distances_vox(points.position, isovalue or 0)
    # A surface may have a true crease, where the normal turns within the rounding of a position.
    agree = (reference.outward(points.position) * points.normal).sum(axis=1)
    assert numpy.quantile(far, 0.99) <= NEAR_VOX and far.max() <= FAR_VOX
    assert numpy.quantile(agree, 0.01) > 0.999
    return figures(report, distance_99_vox=numpy.quantile(far, 0.99), distance_max_vox=far.max(),
                   normal_agreement_1=numpy.quantile(agree, 0.01))


@pytest.fixture(scope="module")
def pyopenvdb():
    return pytest.importorskip("pyopenvdb", reason="there is no pyopenvdb to check against")


# ---- a level set whose truth is known

def test_the_sphere(data_service, shared_data, diagnose):
    voxel, radius, count = 0.05, 3.0, 2000
    job = data_service.submit(vdb(shared_data / "vdb" / "ls_sphere_half.vdb", count))
    report, points = results(data_service, job)
    assert_sound(report, points, count)
    length = numpy.linalg.norm(points.position, axis=1)
    off = (length - radius) / voxel
    k1, k2 = numpy.median(points.kappa1) * radius, numpy.median(points.kappa2) * radius
    diagnose(figures(report, off_max_vox=numpy.abs(off).max(), off_mean_vox=off.mean(), kappa1_r=k1, kappa2_r=k2))
    assert numpy.abs(off).max() <= 0.01
    assert abs(off.mean()) <= 0.002
    assert abs(k1 - 1) <= 0.02 and abs(k2 - 1) <= 0.02
    assert ((points.normal * points.position).sum(axis=1) / length).min() > 0.999  # outward
    quality = report["quality"]
    assert quality["hex_fraction"] >= 0.90 and quality["min_spacing_ratio"] >= 0.80
    assert quality["euler"] == 2
    assert abs(report["surface"]["area"] / (4 * numpy.pi * radius ** 2) - 1) < 1e-3


# ---- fog volumes, by a second opinion

FOG = {"vpt_dragon_rotated_xform.vdb": (None, 0.3, 2000),
       "wdas_cloud_sixteenth.vdb": (None, 0.2, 2000),
       "smoke1_half.vdb": (None, 0.3, 2000),
       "bifrost_torus01.vdb": (None, 50, 1000),
       "densityAndHeat.vdb": ("density", 0.3, 2000)}


@pytest.fixture(scope="module")
def fog_jobs(data_service, shared_data):
    """All at once, the longest first, so that every worker has something to do."""
    order = sorted(FOG, key=lambda name: -FOG[name][2])
    return {name: data_service.submit(vdb(shared_data / "vdb" / name, FOG[name][2], *FOG[name][:2])) for name in order}


@pytest.mark.parametrize("name", FOG)
def test_fog(data_service, shared_data, fog_jobs, pyopenvdb, diagnose, name):
    grid, isovalue, count = FOG[name]
    report, points = results(data_service, fog_jobs[name])
    assert_sound(report, points, count)
    diagnose(f"{name}: " + second_opinion(shared_data / "vdb" / name, grid, isovalue, report, points))


# Of the two volumes here that a second opinion takes seconds for; the opinion itself is right to 0.2 and
# 0.5 %. A voxel of the first is small against its tube, in the second the surface bends within a voxel.
AREAS = [("bifrost_torus01.vdb", 0.005), ("densityAndHeat.vdb", 0.02)]


@pytest.mark.parametrize("name, within", AREAS)
def test_the_area_of_fog(data_service, shared_data, fog_jobs, pyopenvdb, diagnose, name, within):
    grid, isovalue, _ = FOG[name]
    report, _ = results(data_service, fog_jobs[name])
    reference = Reference(shared_data / "vdb" / name, grid)
    area = reference.area(isovalue, 0.1 * isovalue, 12, numpy.random.default_rng(1))
    told = report["surface"]["area"]
    diagnose(f"{name}: area {told:.6g}, by the co-area formula {area:.6g}: {100 * (told / area - 1):+.2f} %")
    assert abs(told / area - 1) <= within


# ---- every awkward file: its clear error or its correct points

# Enough to see the shape, few enough for the whole table to take seconds.
AWKWARD_COUNT = 300
# folder, file, grid, isovalue; then the code and words that its message must hold, or None and what
# else is known of the points
AWKWARD = [
    ("vdb", "bifrost_torus01.vdb", None, 50, None, {"euler": 0}),
    ("vdb", "bifrost_torus01.vdb", None, None, "isovalue_required", ["voxel_fog_density", "fog"]),
    ("vdb", "bifrost_torus01.vdb", None, 1000, "no_surface", ["voxel_fog_density", "1000"]),
    ("vdb", "bifrost_torus01.vdb", "nothing", 50, "grid_missing", ["nothing", "voxel_fog_density"]),
    ("vdb", "blender_smoke_000001.vdb", None, 0.3, "grid_ambiguous", ["density", "shadow"]),
    ("vdb", "blender_smoke_000001.vdb", "density", 0.3, "no_surface", ["density", "no active voxel"]),
    ("vdb", "blender_smoke_000001.vdb", "obstacles", 0.3, "input_unsupported", ["obstacles", "int32"]),
    ("vdb", "blender_smoke_000002.vdb", "density", 0.3, None, {}),
    ("vdb", "blender_smoke_000003.vdb", "density", 0.3, None, {}),
    ("vdb", "densityAndHeat.vdb", None, 0.3, "grid_ambiguous", ["density", "heat"]),
    ("vdb", "densityAndHeat.vdb", "density", None, "isovalue_required", ["density"]),
    ("vdb", "densityAndHeat.vdb", "heat", 0.3, None, {}),
    ("vdb", "gaffer_sphere.vdb", None, 0.5, None, {"euler": 2}),
    ("vdb", "houdini_three_density.vdb", "density", 5, "grid_ambiguous", ["density[0]", "density[2]"]),
    ("vdb", "houdini_three_density.vdb", "density[0]", 5, None, {"box": ((3.5, -0.5, -0.5), (4.5, 0.5, 0.5))}),
    ("vdb", "houdini_three_density.vdb", "density[1]", 5, None, {"box": ((1.1, -1.3, -0.9), (2.9, 0.5, 1.2))}),
    ("vdb", "houdini_three_density.vdb", "density[2]", 5, None, {"box": ((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))}),
    ("vdb", "houdini_three_density.vdb", "density[3]", 5, "grid_missing", ["density[3]", "density[2]"]),
    ("vdb", "houdini_vel_vec3.vdb", "vel", 0.3, "input_unsupported", ["vel", "vec3s"]),
    ("vdb", "houdini_vel_vec3.vdb", None, 0.3, "input_unsupported", ["vel", "vec3s"]),
    ("vdb", "hsim_empty_density.vdb", None, 0.3, "no_surface", ["density", "no active voxel"]),
    ("vdb", "ls_cube_half.vdb", None, None, None, {"box": ((-5.51, -5.51, -5.51), (5.51, 5.51, 5.51))}),
    ("vdb", "ls_sphere_half.vdb", "ls_sphere", None, None, {"sphere": ((0, 0, 0), 3, 0.0005), "euler": 2}),
    ("vdb", "ls_sphere_half.vdb", None, 0.05, None, {"sphere": ((0, 0, 0), 3.05, 0.005)}),
    ("vdb", "ls_sphere_half.vdb", None, 0.14, "input_unsupported", ["ls_sphere", "narrow band", "0.14"]),
    ("vdb", "ls_sphere_half.vdb", None, 1, "no_surface", ["ls_sphere", "isovalue 1"]),
    ("vdb", "monkey_mantaflow.vdb", "density", 0.3, None, {}),
    ("vdb", "monkey_mantaflow.vdb", "temperature", 0.5, None, {}),
    ("vdb", "monkey_mantaflow.vdb", "flame", 0.3, "no_surface", ["flame", "no active voxel"]),
    ("vdb", "monkey_mantaflow.vdb", "shadow", 0.3, "no_surface", ["shadow", "0.3"]),
    ("vdb", "monkey_mantaflow.vdb", "velocity", 0.3, "input_unsupported", ["velocity", "vec3s"]),
    ("vdb", "monkey_mantaflow.vdb", None, 0.3, "grid_ambiguous", ["density", "temperature"]),
    ("vdb", "nebula_5grids.vdb", "distance", None, None, {}),
    ("vdb", "nebula_5grids.vdb", "density", 0.3, None, {}),
    ("vdb", "nebula_5grids.vdb", "color.x", 0.1, None, {}),
    ("vdb", "nebula_5grids.vdb", None, None, "grid_ambiguous", ["color.x", "distance"]),
    ("vdb", "oiio_sphere.vdb", None, 0.5, None, {"sphere": ((0, 0, 0), 0.848, 0.01), "euler": 2}),
    ("vdb", "oiio_sphereCd.vdb", None, 0.5, "input_unsupported", ["Cd", "vec3s"]),
    ("vdb", "pointgrid.vdb", None, 0.5, "input_unsupported", ["ptdataidx32"]),
    ("vdb", "smoke1_half.vdb", None, 0.3, None, {}),
    ("vdb", "smoke1_half.vdb", None, None, "isovalue_required", ["density"]),
    ("vdb", "vpt_box_bg1.vdb", None, 0.5, "no_surface", ["density", "are 1"]),
    ("vdb", "vpt_dragon_fog.vdb", None, 0.3, None, {}),
    ("vdb", "vpt_dragon_rotated_xform.vdb", None, 0.3, None, {}),
    ("vdb", "wdas_cloud_sixteenth.vdb", None, 0.2, None, {}),
    ("vdb", "zeno_ls_sphere_unnamed.vdb", "", None, None, {"sphere": ((-0.038, 0.4, 0.006), 0.2, 0.003), "euler": 2}),
    ("vdb", "zeno_ls_sphere_unnamed.vdb", None, None, None, {"sphere": ((-0.038, 0.4, 0.006), 0.2, 0.003)}),
    ("vdb", "zeno_ls_sphere_unnamed.vdb", "ls", None, "grid_missing", ["ls", '""']),
    ("malformed", "git_lfs_pointer.vdb", None, None, "input_damaged", ["git lfs pull"]),
    ("malformed/openvdb_damaged", "truncated.vdb", None, 0.5, "input_damaged", ["truncated"]),
    # Their bounding boxes are metadata, which nothing believes; none of them holds a voxel.
    ("malformed/openvdb_damaged", "bad-bbox-bomb.vdb", None, 0.5, "no_surface", ["no active voxel"]),
    ("malformed/openvdb_damaged", "bad-bbox-empty.vdb", None, 0.5, "no_surface", ["no active voxel"]),
    ("malformed/openvdb_damaged", "bad-bbox-huge.vdb", None, 0.5, "no_surface", ["no active voxel"]),
    ("malformed/openvdb_damaged", "bad-bbox-inverted.vdb", None, 0.5, "no_surface", ["no active voxel"]),
    ("malformed/openvdb_damaged", "bad-bbox-overflow.vdb", None, 0.5, "no_surface", ["no active voxel"]),
    ("malformed/openvdb_damaged", "bad-bbox-roundup.vdb", None, 0.5, "no_surface", ["no active voxel"]),
]
# A good job after each so many of the table: queued among the bad ones.
GOOD_EVERY = 10


def case_name(case):
    return "-".join(str(part) for part in case[1:4] if part is not None)


@pytest.fixture(scope="module")
def awkward_jobs(data_service, shared_data):
    """The jobs of the table, all queued at once, and the good jobs among them."""
    table, good = [], []
    for k, (folder, file, grid, isovalue, *_) in enumerate(AWKWARD):
        if k % GOOD_EVERY == 0:
            good.append(data_service.submit(sphere(name="good")))
        table.append(data_service.submit(vdb(shared_data / folder / file, AWKWARD_COUNT, grid, isovalue)))
    return table, good


def assert_known(points, report, known, voxel):
    """What the table knows beside the interpolation."""
    if "box" in known:
        low, high = known["box"]
        assert (points.position >= low).all() and (points.position <= high).all()
    if "sphere" in known:
        center, radius, within = known["sphere"]
        length = numpy.linalg.norm(points.position - center, axis=1)
        assert abs(length.mean() - radius) <= max(within, 1e-3 * voxel), length.mean()
    if "euler" in known:
        assert report["quality"]["euler"] == known["euler"]


@pytest.mark.parametrize("k", range(len(AWKWARD)), ids=[case_name(c) for c in AWKWARD])
def test_awkward_files(data_service, shared_data, awkward_jobs, pyopenvdb, diagnose, k):
    folder, file, grid, isovalue, code, more = AWKWARD[k]
    job = awkward_jobs[0][k]
    if code is None:
        report, points = results(data_service, job)
        assert_sound(report, points, AWKWARD_COUNT)
        assert_known(points, report, more, report["surface"]["voxel_size"])
        diagnose(f"{case_name(AWKWARD[k])}: " +
                 second_opinion(shared_data / folder / file, grid, isovalue, report, points))
        return
    done = wait(data_service, job)
    assert done["state"] == "failed" and done["error"]["code"] == code, done
    message = done["error"]["message"]
    assert all(word in message for word in [file] + more), message
    assert len(done["attempts"]) == 1  # said by the worker, which lived: not a crash, not tried again
    assert done["attempts"][0]["exit_status"] == (4 if code == "no_surface" else 3)
    assert data_service.get(f"/v1/jobs/{job}/results").status == 404
    diagnose(f"{code}: {message.replace(str(shared_data), '...')}")


def test_the_daemon_runs_on(data_service, awkward_jobs):
    table, good = awkward_jobs
    for job in table:
        wait(data_service, job)
    assert data_service.get("/healthz").json == {"status": "ok"}
    for job in good + [data_service.submit(sphere())]:
        done = wait(data_service, job)
        assert done["state"] == "succeeded" and done["attempt"] == 1, done
    assert data_service.process.poll() is None and data_service.starts == 1


def test_no_file_is_left_out(shared_data):
    there = {(folder, path.name) for folder in ("vdb", "malformed", "malformed/openvdb_damaged")
             for path in (shared_data / folder).glob("*.vdb")}
    assert there == {case[:2] for case in AWKWARD}
    assert len(list((shared_data / "malformed").rglob("*.vdb"))) == sum("malformed" in c[0] for c in AWKWARD)


def test_files_that_are_no_volumes(data_service, shared_data, diagnose):
    """Whatever else is malformed, named as a volume: refused as a file, by a worker that lives. One file for each ending
    and first 8 bytes, by which formats are recognised."""
    files = {(p.suffix, p.read_bytes()[:8]): p for p in sorted((shared_data / "malformed").rglob("*"))
             if p.is_file() and p.suffix != ".vdb"}.values()
    assert len(files) > 50
    jobs = [data_service.submit(vdb(p, AWKWARD_COUNT, None, 0.5)) for p in files]
    wrong = []
    for path, job in zip(files, jobs):
        done = wait(data_service, job)
        error = done["error"] or {}
        if not (done["state"] == "failed" and error["code"] in ("input_damaged", "input_unsupported") and
                path.name in error["message"] and len(done["attempts"]) == 1):
            wrong.append((path.name, done["state"], error))
    diagnose(f"{len(files)} files that are no volumes")
    assert not wrong


def test_paths_that_lead_nowhere(data_service, shared_data):
    for path, code in ((shared_data / "vdb" / "not-there.vdb", "input_missing"),
                       (shared_data / "vdb", "input_")):
        reply = data_service.post("/v1/jobs", vdb(path, AWKWARD_COUNT, None, 0.5))
        if reply.status == 201:
            error = wait(data_service, reply.json["id"])["error"]
        else:
            assert reply.status in (403, 422)
            error = {"code": reply.json["code"], "message": reply.body.decode()}
        assert error["code"].startswith(code) and path.name in error["message"], error


# ---- the same bytes again

def big_sphere(shared_data):
    return vdb(shared_data / "vdb" / "ls_sphere_half.vdb", 21000, solver={"max_sweeps": 15})


REPEATABLE = {
    "torus": lambda shared_data: sphere(1000, surface={"analytic": {
        "shape": "torus", "center": [0, 0, 0], "major_radius": 1, "minor_radius": 0.4}}),
    "graded quartic": lambda shared_data: sphere(1000, surface={"analytic": {"shape": "quartic"}}, sampling={
        "count": 1000, "alpha": {"d": 1}}),
    "rotated dragon": lambda shared_data: vdb(
        shared_data / "vdb" / "vpt_dragon_rotated_xform.vdb", 1500, None, 0.3,
        solver={"max_sweeps": 300}, output={"preview": {"size": [256, 256]}}),
    "many points": big_sphere,
}


@pytest.mark.parametrize("name", REPEATABLE)
def test_the_same_bytes_with_any_threads(data_service, shared_data, diagnose, name):
    jobs = []
    for threads, seed in ((1, 7), (1, 7), (8, 7), (1, 8)):
        spec = REPEATABLE[name](shared_data)
        spec["solver"] = {**spec.get("solver", {}), "threads": threads, "seed": seed}
        jobs.append(data_service.submit(spec))
    sums = []
    for job in jobs:
        assert wait(data_service, job)["state"] == "succeeded"
        listed = data_service.get(f"/v1/jobs/{job}/results").json["results"]
        listed = {r["name"]: r["sha256"] for r in listed if r["name"] != "report.json"}  # it tells the time
        points = data_service.get(f"/v1/jobs/{job}/results/points.ply").body
        assert hashlib.sha256(points).hexdigest() == listed["points.ply"]
        sums.append(listed)
    report = data_service.get(f"/v1/jobs/{jobs[2]}/results/report.json").json
    assert report["diagnostics"]["threads"] == 8
    diagnose(f"{name}: {report['count']} points, {report['sweeps_total']} sweeps, {sums[0]['points.ply'][:16]}")
    assert sums[0] == sums[1], "the same job twice"
    assert sums[0] == sums[2], "another number of threads"
    assert sums[0]["points.ply"] != sums[3]["points.ply"], "another seed"


def test_fog_with_walls_near_each_other_begins_on_a_coarse_level(worker, shared_data, tmp_path):
    """Before the first sweep 0.7 to 0.9 of the particles of its coarsest level have divergent normals; after convergence fewer."""
    done = worker(vdb(shared_data / "vdb/densityAndHeat.vdb", 5000, "density", 0.5))
    assert done.returncode in (0, 10, 11), done.stderr
    report = json.loads((tmp_path / "out/report.json").read_text())
    assert report["sweeps"][0]["count"] < report["count"] / 2
