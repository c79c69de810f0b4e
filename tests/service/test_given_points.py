# SPDX-License-Identifier: Apache-2.0
"""sampling.points: points that are given, refined, kept in the result or avoided."""
import hashlib
import io
import json
import re
import struct
import zipfile

import numpy
import pytest
from scipy.spatial import ConvexHull, cKDTree

from readers import read_columns
from scenes import stack
from service import sphere
from solids import write_points


@pytest.fixture
def run(worker, tmp_path):
    """Runs a job that must succeed: its report, and the columns of points.ply."""
    def call(spec, where="out"):
        done = worker(spec, output=where)
        assert done.returncode in (0, 10, 11), done.stderr
        return (json.loads((tmp_path / where / "report.json").read_text()),
                read_columns((tmp_path / where / "points.ply").read_bytes()))
    return call


@pytest.fixture
def refuse(worker):
    """Runs a job that must fail: its error."""
    def call(spec):
        done = worker(spec)
        assert done.returncode not in (0, 10, 11), done.stdout
        return json.loads(done.stderr.splitlines()[-1])
    return call


TORUS = {"analytic": {"shape": "torus", "center": [0, 0, 0], "axis": [0, 0, 1], "major_radius": 2, "minor_radius": 0.7}}


def job(count, path=None, mode="refine", surface=None, output=None, **points):
    spec = sphere(count, output={"preview": False, "ply": {"precision": "double"}, **(output or {})})
    if surface:
        spec["surface"] = surface
    if path:
        spec["sampling"]["points"] = {"path": str(path), "mode": mode, **points}
    return spec


def on_sphere(count, seed=1):
    """Points far enough from each other to be neighbours of a packing (Fibonacci)."""
    k = numpy.arange(count) + 0.5
    polar, turn = numpy.arccos(1 - 2 * k / count), numpy.pi * (1 + 5 ** 0.5) * k + seed
    return numpy.stack([numpy.cos(turn) * numpy.sin(polar), numpy.sin(turn) * numpy.sin(polar), numpy.cos(polar)], 1)


def npy(array, text=None):
    """The bytes of an array in NumPy's format 1.0; `text`: its header instead of the right one."""
    text = text or f"{{'descr': '{array.dtype.str}', 'fortran_order': False, 'shape': {array.shape}, }}"
    header = text.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header + array.tobytes()


def write_npz(path, name="position.npy", data=b""):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(name, data)
    return path


# ---- refine

@pytest.mark.sanitized
@pytest.mark.parametrize("surface", [None, TORUS], ids=["sphere", "torus"])
def test_refined_points_are_as_good_as_those_of_an_ordinary_job(run, tmp_path, surface):
    run(job(1000, surface=surface, output={"points_npz": True}), "coarse")
    _, plain = run(job(4000, surface=surface), "plain")
    report, fine = run(job(4000, tmp_path / "coarse" / "points.npz", surface=surface))
    ordinary = json.loads((tmp_path / "plain" / "report.json").read_text())
    assert report["outcome"] == "converged" and report["count"] == 4000 == len(fine["x"])
    for name in ("hex_fraction", "coverage"):
        assert abs(report["quality"][name] - ordinary["quality"][name]) < 0.02, name
    assert report["points"] == {"path": str(tmp_path / "coarse" / "points.npz"), "mode": "refine", "count": 1000,
                                "max_distance": report["points"]["max_distance"]}
    assert report["points"]["max_distance"] < 1e-9
    assert [i["path"] for i in report["inputs"]] == [str(tmp_path / "coarse" / "points.npz")]


def test_a_count_that_is_no_power_of_four_times_the_given_one_converges(run, tmp_path):
    path = write_points(tmp_path / "few.ply", on_sphere(300))
    for count in (300, 500, 2500):
        report, columns = run(job(count, path))
        assert report["outcome"] == "converged" and len(columns["x"]) == count
        assert report["quality"]["hex_fraction"] > 0.8, count


def test_equal_rows_start_one_point(run, tmp_path):
    path = write_points(tmp_path / "twice.ply", numpy.concatenate([on_sphere(200), on_sphere(200)]))
    report, columns = run(job(400, path))
    assert report["outcome"] == "converged" and len(columns["x"]) == 400 and report["points"]["count"] == 400


def test_given_points_in_ascii_and_with_faces_are_read(run, tmp_path):
    rows = on_sphere(100)
    text = "ply\nformat ascii 1.0\nelement vertex 100\nproperty float x\nproperty float y\nproperty uchar red\n"
    text += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    text += "".join(f"{x:.9g} {y:.9g} 7 {z:.9g}\n" for x, y, z in rows) + "3 0 1 2\n"
    (tmp_path / "faces.ply").write_text(text)
    report, _ = run(job(400, tmp_path / "faces.ply"))
    assert report["points"]["count"] == 100 and report["points"]["max_distance"] < 1e-5


# ---- keep

def test_kept_points_are_first_and_bit_identical(run, tmp_path):
    given = on_sphere(250) + 1e-9  # not where a projection would put them
    path = write_points(tmp_path / "kept.ply", given)
    report, columns = run(job(1000, path, "keep", output={"points_npz": True}))
    at = stack(columns, *"xyz")
    assert at[:250].tobytes() == given.tobytes()
    assert (columns["kept"][:250] == 1).all() and (columns["kept"][250:] == 0).all() and len(at) == 1000
    with numpy.load(tmp_path / "out" / "points.npz") as arrays:
        assert arrays["position"][:250].tobytes() == given.tobytes() and (arrays["kept"] == columns["kept"]).all()
    assert report["outcome"] == "converged" and report["quality"]["max_residual"] < 1e-6
    apart, _ = cKDTree(at[:250]).query(at[250:])
    assert apart.min() > 0.25 * report["spacing"]


@pytest.mark.parametrize("missing", [1, 3, 30])
@pytest.mark.parametrize("surface", [{"analytic": {"shape": "ellipsoid", "radii": [1, 1, 0.08]}},
                                     {"analytic": {"shape": "box", "half_size": [1, 1, 1]}}], ids=["sharp rim", "edges"])
def test_points_that_are_missing_are_put_back(run, tmp_path, diagnose, surface, missing):
    """The others leave no place but theirs."""
    spec = job(300, surface=surface)
    spec["features"] = "box" in surface["analytic"]
    report, columns = run(spec)
    points = numpy.stack([columns[axis] for axis in "xyz"], axis=1)
    for seed in (1, 2):
        write_npz(tmp_path / "kept.npz", data=npy(numpy.delete(points, numpy.random.default_rng(seed).permutation(300)[:missing], axis=0)))
        spec["sampling"]["points"] = {"path": "kept.npz", "mode": "keep"}
        again, _ = run(spec, "again")
        diagnose(f"seed {seed}: {again['quality']['coverage']:.3f} after {report['quality']['coverage']:.3f}")
        assert again["count"] == 300 and again["quality"]["coverage"] < report["quality"]["coverage"] + 0.05


def test_a_count_without_room_for_the_points_on_curves_is_refused(run, refuse, tmp_path):
    """The points within the faces of a box are given: its edges need points of their own."""
    spec = {**job(300, surface={"analytic": {"shape": "box", "half_size": [1, 1, 1]}}), "features": True}
    _, columns = run(spec)
    points = numpy.stack([columns[axis] for axis in "xyz"], axis=1)[columns["feature"] == 0]
    write_npz(tmp_path / "kept.npz", data=npy(points))
    spec["sampling"] = {"count": len(points) + 2, "points": {"path": "kept.npz", "mode": "keep"}}
    told = refuse(spec)
    assert told["code"] == "spec_invalid" and told["message"].startswith(f"/sampling/points: {len(points)} points are given, and curves, ")
    spec["sampling"]["count"] = int(re.search(r"ask for at least (\d+) points", told["message"])[1])
    assert len(points) + 20 < spec["sampling"]["count"] == run(spec)[0]["count"]


def test_floats_of_a_result_come_back_as_the_same_floats(run, tmp_path):
    run(job(400, output={"ply": {"precision": "float"}}), "first")
    before = stack(read_columns((tmp_path / "first" / "points.ply").read_bytes()), *"xyz")
    half = before[before[:, 2] > 0]
    path = write_points(tmp_path / "half.ply", half, "float")
    report, columns = run(job(400, path, "keep", output={"ply": {"precision": "float"}}))
    assert (stack(columns, *"xyz")[:len(half)] == half).all() and report["outcome"] == "converged"
    assert b"property float x" in (tmp_path / "out" / "points.ply").read_bytes()[:400]


def test_a_region_is_sampled_anew(run, tmp_path):
    """The rest stays, and the packing is as good as before, from another seed."""
    before, old = run(job(4000, surface=TORUS), "before")
    at = stack(old, *"xyz")
    kept = at[at[:, 0] < 1.5]
    path = write_points(tmp_path / "rest.ply", kept)
    spec = job(4000, path, "keep", surface=TORUS)
    spec["solver"] = {"seed": 7}
    report, columns = run(spec)
    assert (stack(columns, *"xyz")[:len(kept)] == kept).all()
    assert report["outcome"] == "converged"
    assert report["quality"]["hex_fraction"] > before["quality"]["hex_fraction"] - 0.03
    assert report["quality"]["coverage"] < 1 and report["quality"]["min_spacing_ratio"] > 0.7


def test_distances_between_kept_points_are_no_criterion(run, tmp_path):
    """Pairs of given points nearer than .25 spacings, and one of equal rows."""
    base = on_sphere(100)
    beside = base + 0.02 * numpy.cross(base, [0, 0, 1])
    beside /= numpy.linalg.norm(beside, axis=1)[:, None]
    given = numpy.concatenate([base, beside, base[:1]])
    report, columns = run(job(800, write_points(tmp_path / "pairs.ply", given), "keep"))
    at = stack(columns, *"xyz")
    assert (at[:201] == given).all() and len(at) == 800
    assert report["outcome"] == "converged", report["outcome_reasons"]
    assert report["quality"]["close_share"] == 0 and report["quality"]["coincident"] == 0
    apart, _ = cKDTree(given).query(at[201:])
    assert apart.min() > 0.25 * report["spacing"]


def test_kept_points_off_the_surface_do_not_count_as_residual(run, tmp_path):
    given = 1.004 * on_sphere(150)
    report, columns = run(job(600, write_points(tmp_path / "off.ply", given), "keep"))
    assert (stack(columns, *"xyz")[:150] == given).all()
    assert report["outcome"] == "converged" and report["quality"]["max_residual"] < 1e-6
    assert report["points"]["max_distance"] == pytest.approx(0.004 / report["spacing"], rel=1e-3)


def test_threads_do_not_change_the_result(run, tmp_path):
    for mode in ("keep", "refine"):
        path, seen = write_points(tmp_path / "given.ply", on_sphere(800)), set()
        for threads in (1, 3):
            spec = job(3000, path, mode)
            spec["solver"] = {"threads": threads}
            run(spec, f"{mode}{threads}")
            seen.add((tmp_path / f"{mode}{threads}" / "points.ply").read_bytes())
        assert len(seen) == 1, mode


def test_an_order_mixes_kept_and_new_points(run, tmp_path):
    given = on_sphere(100)
    _, columns = run(job(400, write_points(tmp_path / "given.ply", given), "keep", output={"order": "spatial"}))
    at = stack(columns, *"xyz")
    kept = columns["kept"] == 1
    assert kept.sum() == 100 and not kept[:100].all()
    assert sorted(map(tuple, at[kept])) == sorted(map(tuple, given))


# ---- patches: meshes and sharp edges

@pytest.fixture
def ball(tmp_path):
    """A mesh of triangles between points on the unit sphere."""
    at = on_sphere(2000)
    faces = ConvexHull(at).simplices
    head = f"ply\nformat ascii 1.0\nelement vertex {len(at)}\nproperty double x\nproperty double y\nproperty double z\n"
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    text = "".join(f"{x:.17g} {y:.17g} {z:.17g}\n" for x, y, z in at) + "".join(f"3 {a} {b} {c}\n" for a, b, c in faces)
    (tmp_path / "ball.ply").write_text(head + text)
    return {"mesh": {"path": str(tmp_path / "ball.ply")}}


CUBE = {"analytic": {"shape": "box", "center": [0, 0, 0], "half_size": [1, 1, 1]}}


def on_cube(spec):
    return {**spec, "surface": CUBE, "features": True}


@pytest.mark.sanitized
def test_points_on_a_mesh_are_refined_and_kept(run, tmp_path, ball):
    run(job(500, surface=ball, output={"points_npz": True}), "coarse")
    ordinary, _ = run(job(2000, surface=ball), "plain")
    given = tmp_path / "coarse" / "points.npz"
    report, columns = run(job(2000, given, surface=ball), "fine")
    assert report["outcome"] == "converged" and len(columns["x"]) == 2000
    for name in ("hex_fraction", "coverage"):
        assert abs(report["quality"][name] - ordinary["quality"][name]) < 0.05, name
    report, columns = run(job(2000, given, "keep", surface=ball), "kept")
    with numpy.load(given) as arrays:
        assert (stack(columns, *"xyz")[:500] == arrays["position"]).all()
    assert report["outcome"] == "converged" and (columns["kept"] == 1).sum() == 500


@pytest.mark.sanitized
def test_points_on_sharp_edges_are_kept_and_refined(run, tmp_path):
    """Given points take the places of samples of the edges that are near."""
    _, old = run(on_cube(job(600)), "before")
    at = stack(old, *"xyz")
    kept = at[at[:, 0] < 0.3]
    path = write_points(tmp_path / "rest.ply", kept)
    report, columns = run(on_cube(job(600, path, "keep")), "after")
    place = stack(columns, *"xyz")
    assert (place[:len(kept)] == kept).all() and len(place) == 600
    assert report["outcome"] == "converged", report["outcome_reasons"]
    assert (columns["feature"] == 2).sum() == 8
    assert report["quality"]["hex_fraction"] > 0.75 and report["quality"]["coverage"] < 1
    report, columns = run(on_cube(job(2400, write_points(tmp_path / "all.ply", at))), "fine")
    assert report["outcome"] == "converged" and len(columns["x"]) == 2400 and report["quality"]["hex_fraction"] > 0.8


# ---- avoid

@pytest.mark.sanitized
def test_points_keep_the_distance_from_given_ones(run, tmp_path):
    given = on_sphere(40)
    for count in (300, 2000):
        report, columns = run(job(count, write_points(tmp_path / "given.ply", given), "avoid", distance=0.15))
        at = stack(columns, *"xyz")
        apart, _ = cKDTree(given).query(at)
        assert len(at) == count == report["count"] and apart.min() >= 0.15
        assert report["points"]["nearest"] == pytest.approx(apart.min(), rel=1e-12)
        assert report["outcome"] == "converged" and report["points"]["packed"] > count
        assert report["reached"] == {"count": count}
        # the area that is left has points everywhere: each place of it has one within 1.2 spacings
        places = on_sphere(20000)
        far = cKDTree(given).query(places)[0] > 0.15 + report["spacing"]
        assert cKDTree(at).query(places[far])[0].max() < 1.2 * report["spacing"]


def test_floats_keep_the_distance_too(run, tmp_path):
    given = on_sphere(40) + [100, 0, 0]
    spec = job(400, write_points(tmp_path / "given.ply", given), "avoid", distance=0.15, output={"ply": {"precision": "float"}})
    spec["surface"]["analytic"]["center"] = [100, 0, 0]
    report, columns = run(spec)
    apart, _ = cKDTree(given).query(stack(columns, *"xyz"))
    assert apart.min() >= 0.15 and report["outcome"] == "converged"


def test_two_layers_on_a_mesh_with_a_varying_spacing_stay_apart(run, tmp_path, ball):
    _, first = run(job(30, surface=ball), "first")
    path = write_points(tmp_path / "first.ply", stack(first, *"xyz"))
    spec = job(1000, path, "avoid", distance=0.12, surface=ball, output={"order": "progressive", "points_npz": True})
    spec["sampling"]["curvature"] = {"ratio": 2}
    report, columns = run(spec)
    at = stack(columns, *"xyz")
    assert len(at) == 1000 and cKDTree(stack(first, *"xyz")).query(at)[0].min() >= 0.12
    with numpy.load(tmp_path / "out" / "points.npz") as arrays:
        assert (arrays["position"] == at).all()


def test_a_spacing_takes_all_points_that_are_far_enough(run, tmp_path):
    given = on_sphere(40)
    spec = job(300, write_points(tmp_path / "given.ply", given), "avoid", distance=0.2)
    del spec["sampling"]["count"]
    spec["sampling"]["spacing"] = 0.08
    report, columns = run(spec)
    at = stack(columns, *"xyz")
    free = (cKDTree(given).query(on_sphere(20000))[0] >= 0.2).mean()
    assert len(at) == report["count"] < report["points"]["packed"]
    assert len(at) == pytest.approx(free * report["points"]["packed"], rel=0.05)
    assert cKDTree(given).query(at)[0].min() >= 0.2


# ---- errors

def test_a_point_off_the_surface_is_named_by_its_row(refuse, tmp_path):
    given = on_sphere(50)
    given[17] *= 1.2
    for mode, more in (("keep", {}), ("refine", {}), ("avoid", {"distance": 0.1})):
        error = refuse(job(200, write_points(tmp_path / "given.ply", given), mode, **more))
        assert error["code"] == "input_unsupported" and "row 17 (from 0)" in error["message"], error
        assert "given.ply" in error["message"] and "0.1 spacings" in error["message"]
        away = float(re.search(r"is ([\d.]+) spacings from the surface", error["message"])[1])
        assert away == pytest.approx(0.2 / (8 * numpy.pi / 200 / 3 ** 0.5) ** 0.5, rel=0.01), error
    given[17] = 0  # the gradient vanishes there
    error = refuse(job(200, write_points(tmp_path / "given.ply", given), "keep"))
    assert "row 17 (from 0), at (0, 0, 0), is more than 0.1 spacings from the surface" in error["message"]


@pytest.mark.parametrize("points, where, words", [
    ({"mode": "keep"}, "/sampling/points", "path"),
    ({"path": "a.ply"}, "/sampling/points", "mode"),
    ({"path": "a.ply", "mode": "hold"}, "/sampling/points/mode", "keep"),
    ({"path": "a.ply", "mode": "avoid"}, "/sampling/points", "distance"),
    ({"path": "a.ply", "mode": "keep", "distance": 1}, "/sampling/points/distance", "avoid"),
    ({"path": "a.ply", "mode": "avoid", "distance": 0}, "/sampling/points/distance", "0"),
])
def test_members_that_do_not_fit_are_refused(refuse, points, where, words):
    spec = sphere(100)
    spec["sampling"]["points"] = points
    error = refuse(spec)
    assert error["code"] == "spec_invalid" and where in error["message"] and words in error["message"], error


@pytest.mark.parametrize("more, words", [
    ({"sampling": {"control": {"min_count": 50, "max_sigma": 0.5}}}, "control"),
    ({"sampling": {"count": 100, "alpha": {}}}, "sampling.points"),
    ({"solver": {"method": "paper"}}, "sized"),
    ({"solver": {"init": "random"}}, "sampling.points"),
])
def test_members_that_exclude_given_points_are_named(refuse, more, words):
    spec = {**sphere(100), **more}
    spec["sampling"]["points"] = {"path": "a.ply", "mode": "refine"}
    error = refuse(spec)
    assert error["code"] == "spec_invalid" and words in error["message"], error


def test_the_count_includes_kept_points(refuse, tmp_path):
    path = write_points(tmp_path / "given.ply", on_sphere(100))
    error = refuse(job(100, path, "keep"))
    assert error["code"] == "spec_invalid" and "more than 100" in error["message"]
    error = refuse(job(99, path, "refine"))
    assert error["code"] == "spec_invalid" and "at least 100" in error["message"]


def test_a_mesh_of_an_avoiding_job_is_refused(refuse, tmp_path):
    path = write_points(tmp_path / "given.ply", on_sphere(20))
    error = refuse(job(100, path, "avoid", distance=0.1, output={"mesh": True}))
    assert error["code"] == "spec_invalid" and "/output/mesh" in error["message"]


def test_a_distance_that_leaves_nothing_is_refused(refuse, tmp_path):
    error = refuse(job(100, write_points(tmp_path / "given.ply", on_sphere(20)), "avoid", distance=3))
    assert error["code"] == "no_surface" and "reduce the distance" in error["message"]


GOOD = numpy.ones((2, 3))


@pytest.mark.parametrize("names, code, words", [(("position.npy", "points.npy"), "input_unsupported", 'an array "position" and an array "points"'),
                                                (("position.npy", "position.npy"), "input_damaged", 'array "position" of the NPZ file is there twice')])
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_archives_with_two_arrays_of_points_are_refused(refuse, tmp_path, names, code, words):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for k, name in enumerate(names):
            archive.writestr(name, npy((k + 1) * GOOD))
    error = refuse(job(100, tmp_path / "a.npz"))
    assert error["code"] == code and words in error["message"], error


def test_names_of_arrays_are_case_sensitive(run, tmp_path):
    given = on_sphere(250)
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for name, array in (("Position", GOOD), ("POINTS", GOOD), ("points", given), ("Points", GOOD)):
            archive.writestr(f"{name}.npy", npy(array))
    report, columns = run(job(1000, tmp_path / "a.npz", "keep"))
    assert stack(columns, *"xyz")[:250].tobytes() == given.tobytes() and report["points"]["count"] == 250


@pytest.mark.sanitized
@pytest.mark.parametrize("name, data, code, words", [
    ("Position.npy", npy(GOOD), "input_unsupported", '"position" or "points"'),
    ("positions.npy", npy(GOOD), "input_unsupported", '"position" or "points"'),
    ("position.npy", npy(GOOD)[:-1], "input_damaged", "as many bytes"),
    ("position.npy", npy(GOOD) + b"\0", "input_damaged", "as many bytes"),
    ("position.npy", npy(GOOD)[:60], "input_damaged", "within its header"),
    ("position.npy", npy(GOOD)[:9], "input_damaged", "1.0"),
    ("position.npy", npy(GOOD.astype("<i8")), "input_unsupported", "float64"),
    ("position.npy", npy(GOOD.astype(">f8")), "input_unsupported", "little-endian"),
    ("position.npy", npy(numpy.ones((3, 2))), "input_unsupported", "(N, 3)"),
    ("position.npy", npy(numpy.ones(6)), "input_unsupported", "(N, 3)"),
    ("position.npy", npy(GOOD, "{'descr': '<f8', 'fortran_order': True, 'shape': (2, 3), }"), "input_unsupported", "Fortran"),
    ("position.npy", npy(GOOD, "{'descr': '<f8', 'fortran_order': False, 'shape': (0, 3), }"), "input_unsupported", "(N, 3)"),
    ("position.npy", npy(GOOD, "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 3), }"), "input_unsupported",
     "(N, 3)"),
    ("position.npy", npy(GOOD, "{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), } x"), "input_damaged", "header"),
    ("position.npy", npy(numpy.array([[1, 0, 0], [numpy.nan, 0, 0]])), "input_damaged", "row 1"),
])
def test_archives_that_do_not_hold_points_are_refused(refuse, tmp_path, name, data, code, words):
    error = refuse(job(100, write_npz(tmp_path / "a.npz", name, data)))
    assert error["code"] == code and words in error["message"] and "a.npz" in error["message"], error


@pytest.mark.sanitized
def test_files_that_hold_no_points_are_refused(refuse, tmp_path):
    (tmp_path / "no.npz").write_bytes(b"PK\3\4" + bytes(40))
    assert refuse(job(100, tmp_path / "no.npz"))["code"] in ("input_damaged", "input_unsupported")
    (tmp_path / "a.txt").write_text("1 0 0\n")
    error = refuse(job(100, tmp_path / "a.txt"))
    assert error["code"] == "input_unsupported" and ".ply or .npz" in error["message"]
    write_points(tmp_path / "none.ply", numpy.empty((0, 3)))
    error = refuse(job(100, tmp_path / "none.ply"))
    assert error["code"] == "input_damaged" and "no points" in error["message"]
    assert refuse(job(100, tmp_path / "missing.ply"))["code"] == "input_missing"


def test_arrays_of_numpy_are_read_in_both_precisions(run, tmp_path):
    rows = on_sphere(64)
    for kind in ("<f4", "<f8"):
        for save in (numpy.savez, numpy.savez_compressed):
            buffer = io.BytesIO()
            save(buffer, points=rows.astype(kind))
            (tmp_path / "a.npz").write_bytes(buffer.getvalue())
            _, columns = run(job(100, tmp_path / "a.npz", "keep"))
            assert (stack(columns, *"xyz")[:64] == rows.astype(kind)).all()


# ---- an input like all others

def test_the_file_is_hashed_and_must_lie_below_an_input_root(worker, tmp_path):
    (tmp_path / "below").mkdir()
    path = write_points(tmp_path / "below" / "given.ply", on_sphere(100))
    spec = job(400, "given.ply", "keep")
    assert worker(spec, "--input-root", tmp_path / "below").returncode == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    (used,) = report["inputs"]
    assert used["path"] == "given.ply" and used["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert [a["name"] for a in report["attributes"]] == ["kept"]
    (tmp_path / "other").mkdir()
    refused = worker(job(400, path, "keep"), "--input-root", tmp_path / "other", output="none")
    assert json.loads(refused.stderr.splitlines()[-1])["code"] == "path_forbidden"


def test_an_estimate_has_the_count_of_the_result(worker, tmp_path):
    path = write_points(tmp_path / "given.ply", on_sphere(50))
    for mode, more in (("keep", {}), ("avoid", {"distance": 0.1})):
        done = worker(job(500, path, mode, **more), command="estimate")
        assert done.returncode == 0, done.stderr
        estimate = json.loads((tmp_path / "out" / "estimate.json").read_text())
        assert estimate["count"] == 500 and estimate["seconds"] is None and "points are given" in estimate["seconds_missing"]
