# SPDX-License-Identifier: Apache-2.0
"""libhexad: the same points as hexad-worker, errors that name the argument, and what a call leaves in its process; the
examples in C and C++, and the function in Python (hexad.sample)."""
import ctypes
import json
import os
import pathlib
import pickle
import re
import shutil
import signal
import subprocess
import sys
import threading
import typing
import warnings
import zipfile

import numpy
import pytest

from label_shapes import Balls
from service import PATIENCE_S, wait_until
from solids import ball, drum, plate, prism, shell, write_points
from volumes import write_nrrd

SOURCE = pathlib.Path(__file__).parents[2]
sys.path.insert(0, str(SOURCE / "clients/python"))

import hexad  # noqa: E402

SEED = 85


@pytest.fixture(scope="module", autouse=True)
def library(build):
    """The library and the worker of the build, for this process and those that it starts."""
    before = {name: os.environ.get(name) for name in ("HEXAD_LIBRARY", "HEXAD_WORKER")}
    os.environ.update(HEXAD_LIBRARY=str(build / "libhexad.so.1"), HEXAD_WORKER=str(build / "hexad-worker"))
    yield build / "libhexad.so.1"
    for name, value in before.items():
        os.environ.pop(name)
        if value is not None:
            os.environ[name] = value


def solid(made):
    return made.vertices, made.triangles


def turned(made, seed=SEED):
    return solid(made.rotated(numpy.random.default_rng(seed)))


def grid(values, affine=None):
    """Values along an axis of an odd stride, and in the order of Fortran."""
    wide = numpy.zeros((*values.shape[:2], 2 * values.shape[2]), values.dtype, order="F")
    wide[:, :, ::2] = values
    return wide[:, :, ::2], numpy.eye(4) if affine is None else affine


def density(size=(26, 22, 24), kind="f4"):
    """Three blobs; above 0 is inside."""
    i = numpy.indices(size).astype(float)
    sum_of = sum(numpy.exp(-((i - numpy.reshape(c, (3, 1, 1, 1))) ** 2).sum(0) / 18) for c in ((9, 9, 9), (15, 12, 14), (12, 8, 16)))
    return (sum_of - 0.4).astype(kind) if kind[0] == "f" else (100 * sum_of).astype(kind)


OBLIQUE = numpy.array([[1.5, 0.4, 0, 7], [-0.4, 1.5, 0, -3], [0, 0, 0.8, 11], [0, 0, 0, 1]])
QUADS = (numpy.array([[x, y, z] for x in (0, 1) for y in (0, 2) for z in (0, 3)], "f4"),
         [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
HOUSE = ([(0, 0, 0), (2, 0, 0), (2, 0, 1), (1, 0, 2), (0, 0, 1), (0, 3, 0), (2, 3, 0), (2, 3, 1), (1, 3, 2), (0, 3, 1)],
         [[0, 1, 2, 3, 4], [9, 8, 7, 6, 5], [1, 0, 5, 6], [2, 1, 6, 7], [3, 2, 7, 8], [4, 3, 8, 9], [0, 4, 9, 5]])
OCTAHEDRON = ([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]],
              [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
BALL = ball(1, 2)
OPEN = (BALL.vertices, BALL.triangles[BALL.vertices[BALL.triangles].mean(1)[:, 2] < 0.5])
TORUS = {"shape": "torus", "major_radius": 1, "minor_radius": 0.4}
ON_BALL = BALL.vertices[::9]


def mesh(path, count=300, sampling=(), **own):
    return {"surface": {"mesh": {"path": path, **own}}, "sampling": {"count": count, **dict(sampling)}}


def volume(values, isovalue, affine=None, **own):
    return {"surface": {"volume": {"path": grid(values, affine), "isovalue": isovalue, **own}}, "sampling": {"count": 300}}


def formula(sampling=(), **shape):
    return {"surface": {"analytic": shape or TORUS}, "sampling": {"count": 300, **dict(sampling)}}


SPECS = {
    "ball": mesh(solid(BALL)),
    "plate, patches": mesh(turned(plate(0.7, 0.1))),
    "prism, features": mesh(turned(prism(40)), features={"angle": 0.5}),
    "drum": mesh(turned(drum(24)), 500),
    "shell": mesh(solid(shell(0.2, 2))),
    "mesh through a level set": mesh(solid(BALL), resolution=40),
    "mesh of floats and quadrangles": mesh(QUADS),
    "mesh of polygons": mesh(HOUSE),
    "open mesh": mesh(OPEN),
    "open mesh, filled": mesh(OPEN, holes="fill"),
    "mesh far from the origin": mesh((BALL.vertices + [5e5, -2e6, 1e5], BALL.triangles)),
    "mesh by spacing": {"surface": {"mesh": {"path": solid(BALL)}}, "sampling": {"spacing": 0.3}},
    "mesh, triangles between the points": {**mesh(solid(BALL)), "output": {"mesh": True}},
    "mesh with places": {**mesh(HOUSE), "attributes": [{"from": "geometry", "name": "source"}]},
    "mesh with weights": {**mesh(solid(BALL)), "attributes": [{"from": "geometry", "name": "weight"}]},
    "union of a mesh and a formula": {"surface": {"union": [{"mesh": {"path": solid(BALL), "resolution": 24}}, {"analytic": TORUS}]},
                                      "sampling": {"count": 300}},
    "transformed mesh in a region": {
        "surface": {"transform": {"surface": {"mesh": {"path": solid(BALL)}}, "matrix": OBLIQUE.ravel().tolist()}},
        "region": {"min": [5, -5, 10], "max": [9, -1, 12]}, "sampling": {"count": 300}},
    "volume of floats": volume(density(), 0),
    "volume of bytes": volume(density(kind="u1"), 40.5),
    "volume of shorts, oblique": volume(density(kind="i2"), 40.5, OBLIQUE),
    "volume of doubles, smoothed": volume(density(kind="f8"), 0, reconstruction="smoothing"),
    "volume, open at the end": volume(density(kind="f8"), -0.3),
    "volume in a region": {**volume(density(), 0), "region": {"min": [0, 0, 0], "max": [30, 30, 12]}},
    "labels": {"surface": {"labels": {"path": grid(Balls(20).labels)}}, "sampling": {"count": 400}},
    "labels, only one": {"surface": {"labels": {"path": grid(Balls(20).labels.astype("i8")), "labels": [2], "smooth": 0}},
                         "sampling": {"count": 300}},
    "formula": formula(),
    "formula with sharp edges": {"surface": {"difference": [{"analytic": {"shape": "box", "half_size": [1, 1, 1]}}, {"analytic": TORUS}]},
                                 "features": True, "sampling": {"count": 300}},
    "b-spline": {**json.loads((SOURCE / "examples/bspline-torus.json").read_text()), "sampling": {"count": 200}},
    "graded by curvature": mesh(turned(drum(24)), 400, {"curvature": {"ratio": 4}}),
    "graded by the feature size": mesh(solid(shell(0.5, 2)), 1500, {"feature": {"ratio": 1.5}}),
    "graded by a chord error": {"surface": {"analytic": TORUS}, "sampling": {"count": 300, "curvature": {"chord_error": 0.01}}},
    "blue noise": mesh(solid(BALL), 300, {"pattern": "blue_noise"}),
    "blue noise on a volume": {**volume(density(), 0), "sampling": {"count": 300, "pattern": "blue_noise"}},
    "given points, kept": mesh(solid(BALL), 300, {"points": {"path": ON_BALL, "mode": "keep"}}),
    "given points, refined": mesh(solid(BALL), 300, {"points": {"path": ON_BALL.astype("f4"), "mode": "refine"}}),
    "given points, avoided": mesh(solid(BALL), 200, {"points": {"path": ON_BALL, "mode": "avoid", "distance": 0.1}}),
    "order and orientation": {**formula(), "output": {"order": "progressive", "orient": {"seed": 3}}},
    "seed and paper's method": {**formula(), "solver": {"seed": 7, "method": "paper"}},
}

def on_disk(node, tmp_path, key=""):
    """The spec with files in place of the arrays."""
    if key == "path" and not isinstance(node, str):
        path = tmp_path / f"input{len(list(tmp_path.iterdir()))}"
        if isinstance(node, numpy.ndarray):
            return str(write_points(path.with_suffix(".ply"), node))
        if numpy.ndim(node[0]) == 3:
            write_nrrd(path.with_suffix(".nrrd"), node[0], node[1])
            return str(path.with_suffix(".nrrd"))
        lines = ["v %.17g %.17g %.17g" % tuple(v) for v in node[0]] + ["f " + " ".join(str(k + 1) for k in f) for f in node[1]]
        path.with_suffix(".obj").write_text("\n".join(lines) + "\n")
        return str(path.with_suffix(".obj"))
    if isinstance(node, dict):
        return {k: on_disk(value, tmp_path, k) for k, value in node.items()}
    return [on_disk(item, tmp_path) for item in node] if isinstance(node, list) else node


def by_worker(build, spec, directory):
    """The arrays of the worker's points.npz, and the triangles."""
    output = {**spec.get("output", {}), "preview": False, "points_npz": True, "ply": {"precision": "double"}}
    done = subprocess.run([build / "hexad-worker", "run", "-", "--output", directory],
                          input=json.dumps({"version": 1, **spec, "output": output}), capture_output=True, text=True)
    assert done.returncode in (0, 10, 11), done.stderr
    with zipfile.ZipFile(directory / "points.npz") as archive:
        found = {name[:-4]: numpy.load(archive.open(name)) for name in archive.namelist()}
    if (directory / "mesh.ply").exists():
        found["triangle"] = hexad.read_ply(directory / "mesh.ply").triangles
    return found, json.loads((directory / "report.json").read_text())


@pytest.mark.filterwarnings("ignore::hexad.OutcomeWarning")
@pytest.mark.parametrize("name", SPECS)
def test_function_and_worker_return_the_same_bytes(build, tmp_path, name):
    spec = SPECS[name]
    points = hexad.sample(spec, properties="all")
    expected, report = by_worker(build, on_disk(spec, tmp_path), tmp_path / "out")
    assert points.positions.dtype == numpy.float64
    found = {key: points[key] for key in points if key in expected}
    assert set(expected) - {"triangle"} == set(found)
    for key, array in found.items():
        assert array.shape == expected[key].shape and array.tobytes() == expected[key].tobytes(), key
    if "triangle" in expected:
        assert numpy.array_equal(points.triangles, expected["triangle"])
    assert points.outcome == report["outcome"]
    assert points.report["count"] == len(points.positions) and points.report["inputs"] == []


def test_parts_of_a_combination_have_no_more_voxels_than_few_points_show():
    """Two octahedra, one in the other."""
    surface = {"union": [{"mesh": {"path": (scale * numpy.array(OCTAHEDRON[0]), OCTAHEDRON[1])}} for scale in (1, 0.4)]}
    parts = hexad.sample({"surface": surface, "sampling": {"count": 60}}).report["surface"]["parts"]
    assert [part["mesh"]["resolution"] for part in parts] == [80, 80]


def test_a_map_in_an_array_grades_the_spacing():
    """A spacing that is linear in x is interpolated exactly."""
    x = numpy.indices((5, 5, 5))[0]
    spec = {"surface": {"analytic": {"shape": "sphere", "center": [0, 0, 0], "radius": 1}},
            "sampling": {"grid": {"path": (1 + 0.25 * x, numpy.array([[0.75, 0, 0, -1.5], [0, 0.75, 0, -1.5], [0, 0, 0.75, -1.5], [0, 0, 0, 1]])),
                                  "kind": "spacing"}, "count": 2000}}
    points = hexad.sample(spec)
    ratio = points["spacing"] / (1 + 0.25 * (points["x"] + 1.5) / 0.75)
    assert abs(ratio / ratio.mean() - 1).max() < 1e-3


# ---- arguments that are wrong

SQUARE = numpy.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
TWO = numpy.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize("vertices, faces, words", [
    (SQUARE[:, :2], TWO, "vertices has rows of 2 numbers"),
    (SQUARE.ravel(), TWO, "vertices must have 2 dimensions"),
    (SQUARE, TWO.astype(float), "faces must be of an integer type"),
    (SQUARE, TWO[:, :2], "faces has rows of 2 numbers"),
    (SQUARE, TWO + 2, "faces[0, 2] is 4"),
    (SQUARE, TWO - 1, "faces[0, 0] is -1"),
    (numpy.full_like(SQUARE, numpy.nan), TWO, "not finite"),
    (SQUARE, TWO[:0], "faces has no rows, and vertices has 4: give the triangles"),
    (SQUARE[:0], TWO, "faces[0, 0] is 0, and vertices has no rows"),
    (SQUARE[:0], (TWO.ravel(), numpy.array([3, 3])), "faces[0] is 0, and vertices has no rows"),
    (SQUARE, (TWO.ravel(), numpy.array([3, 4])), "counts[1] is 4"),
    (SQUARE, (TWO.ravel(), numpy.array([3, -1])), "counts[1] is -1"),
    (SQUARE, (TWO.ravel(), numpy.array([3])), "sum of counts is 3"),
])
def test_a_wrong_mesh_has_an_error_that_names_the_argument(vertices, faces, words):
    path = (vertices, *faces) if isinstance(faces, tuple) else (vertices, faces)
    with pytest.raises(hexad.JobFailed) as found:
        hexad.sample(mesh(path))
    assert words in str(found.value)


@pytest.mark.parametrize("path, words", [
    (numpy.zeros((3, 3)), "values must have 3 dimensions"),
    (numpy.zeros((3, 1, 3)), "values has 1 samples along axis 1"),
    ((density(), numpy.zeros((4, 4))), "last row of affine"),
    ((density(), numpy.diag([1, 1, 0, 1])), "affine cannot be inverted"),
    ((density(), numpy.diag([1, numpy.nan, 1, 1])), "affine[1, 1] is not finite"),
])
def test_a_wrong_grid_has_an_error_that_names_the_argument(path, words):
    with pytest.raises(hexad.JobFailed) as found:
        hexad.sample({"surface": {"volume": {"path": path, "isovalue": 0}}, "sampling": {"count": 100}})
    assert words in str(found.value)


@pytest.mark.parametrize("spec, code, words", [
    ({**formula(), "output": {"points_npz": True}}, "not_supported", "/output/points_npz"),
    ({**formula(), "output": {"directory": "/srv"}}, "not_supported", "/output/directory"),
    ({**formula(), "output": {"ply": {"format": "ascii"}}}, "not_supported", "/output/ply/format"),
    ({**formula(), "output": {"ply": {"properties": ["x", "warmth"]}}}, "attribute_missing", "warmth"),
    ({**formula(), "queue": {"priority": 3}}, "not_supported", "/queue"),
    ({**mesh(solid(BALL)), "attributes": [{"from": "surface", "name": "Cd"}]}, "not_supported", "has no attributes"),
    (mesh(solid(BALL), 10**8), "limit_memory", "limits.memory_mb"),
    (mesh(solid(BALL), 300, {"points": {"path": "/none.ply", "mode": "keep"}}), "not_supported", "all are files"),
    ({"surface": {}, "sampling": {"count": 100}}, "spec_invalid", "/surface"),
    ({"surface": {"volume": {"path": ON_BALL, "isovalue": 0}}, "sampling": {"count": 100}}, "spec_invalid", "3 dimensions"),
])
def test_specs_that_a_call_refuses(spec, code, words):
    with pytest.raises(hexad.JobFailed) as found:
        hexad.sample(spec)
    assert found.value.code == code and words in str(found.value)


def test_an_array_without_a_place_in_the_spec_is_refused(library):
    from hexad.library import Job
    job = Job(json.dumps({"version": 1, **formula()}))
    job.add_points("left over", ON_BALL)
    with pytest.raises(hexad.JobFailed, match="left over"):
        job.run(None)


# ---- limits, progress and cancelling

ENDLESS = {**formula({"count": 100000}), "solver": {"max_sweeps": 1000000, "step_tolerance": 1e-12, "energy_tolerance": 1e-12}}


def test_a_time_limit_ends_a_call():
    with pytest.raises(hexad.JobFailed) as found:
        hexad.sample({**ENDLESS, "limits": {"timeout_s": 0.3}})
    assert (found.value.code, found.value.state) == ("limit_time", "timed_out")


def test_progress_comes_on_the_calling_thread_and_cancels():
    told = []

    def hear(phase, fraction):
        told.append((threading.get_ident(), phase, fraction))
        return phase == "relax"

    with pytest.raises(hexad.JobFailed) as found:
        hexad.sample(ENDLESS, progress=hear)
    assert (found.value.code, found.value.state) == ("cancelled", "cancelled")
    assert {thread for thread, _, _ in told} == {threading.get_ident()}
    fractions = [fraction for _, _, fraction in told]
    assert fractions == sorted(fractions) and 0 <= fractions[0] and fractions[-1] <= 1


HUGE = numpy.broadcast_to(numpy.float32(1), (3000, 3000, 3000))  # minutes of reading
MANY = numpy.broadcast_to(BALL.vertices[:1], (10**8, 3))


@pytest.mark.parametrize("spec", [
    {"surface": {"volume": {"path": HUGE, "isovalue": 0}}, "sampling": {"count": 100}},
    {"surface": {"labels": {"path": HUGE[:1000, :1000, :1000]}}, "sampling": {"count": 100}},
    {"surface": {"analytic": TORUS}, "sampling": {"count": 100, "grid": {"path": HUGE, "kind": "spacing"}}},
    mesh((MANY, BALL.triangles)), mesh((BALL.vertices, numpy.broadcast_to(BALL.triangles[:1], (10**8, 3)))),
    mesh((MANY, QUADS[1])), mesh((BALL.vertices, numpy.broadcast_to(numpy.array([[0, 1, 2, 3]]), (10**8, 4)))),
    mesh((BALL.vertices, numpy.random.default_rng(SEED).integers(0, len(BALL.vertices), (1, 10**6)))), mesh(solid(BALL), 100, {"points": {"path": MANY, "mode": "avoid", "distance": 0.1}}),
], ids=["volume", "labels", "map", "vertices", "faces", "vertices of polygons", "polygons", "corners", "points"])
def test_a_call_is_cancelled_and_limited_while_arrays_are_read(spec):
    limits = {"memory_mb": 10**6}
    with pytest.raises(hexad.JobFailed) as found:
        hexad.sample({**spec, "limits": limits}, progress=lambda *_: True)
    assert found.value.code == "cancelled"
    with pytest.raises(hexad.JobFailed) as found:
        hexad.sample({**spec, "limits": {"timeout_s": 0.1, **limits}})
    assert found.value.code == "limit_time"


def test_a_call_that_is_cancelled_before_its_job_begins_says_so():
    runs = hexad.library.Runs()
    runs.stopped = True
    run = hexad.library.Run(hexad.library.Job(json.dumps({"version": 1, **ENDLESS})), runs)
    run.work()
    with pytest.raises(hexad.JobFailed, match="cancelled before it began") as found:
        run.check()
    assert (found.value.code, found.value.state) == ("cancelled", "cancelled")


def test_an_exception_of_the_progress_function_ends_the_call():
    with pytest.raises(ZeroDivisionError):
        hexad.sample(ENDLESS, progress=lambda *_: 1 / 0)


def test_an_interrupt_ends_a_call(library):
    program = f"import sys; sys.path.insert(0, {str(SOURCE / 'clients/python')!r}); import hexad, signal\n" \
              f"signal.signal(signal.SIGINT, signal.default_int_handler)\n" \
              f"hexad.sample({ENDLESS!r}, progress=lambda *_: print('runs', flush=True))"
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "runs\n"
        process.send_signal(signal.SIGINT)
        words = process.communicate(timeout=PATIENCE_S)[1]
    assert "KeyboardInterrupt" in words and process.returncode == -signal.SIGINT


def test_two_and_three_interrupts_end_a_call(library):
    """Seed and number of runs: HEXAD_SEED, HEXAD_INTERRUPTED_CALLS."""
    seed, runs = (os.environ.get(name, of) for name, of in (("HEXAD_SEED", str(SEED)), ("HEXAD_INTERRUPTED_CALLS", "20")))
    done = subprocess.run([sys.executable, SOURCE / "tests/library/interrupts.py", seed, runs], capture_output=True, text=True,
                          env={**os.environ, "PYTHONPATH": str(SOURCE / "clients/python")})
    assert done.returncode == 0 and f"seed {seed}: {runs} interrupted calls, 0 not" in done.stdout, done.stdout + done.stderr


# ---- what a call leaves in its process

def state():
    return (sorted(os.listdir("/proc/self/fd")), sorted(os.listdir("/proc/self/task")), os.getcwd(), os.umask(os.umask(0o22)),
            [signal.getsignal(k) for k in range(1, 32)], len(signal.pthread_sigmask(signal.SIG_BLOCK, ())))


def test_a_call_leaves_nothing_behind(tmp_path):
    BALL.write(tmp_path / "ball.obj")
    os.umask(0o22)
    before = state()
    hexad.sample(*solid(BALL), count=300)
    hexad.sample(tmp_path / "ball.obj", count=300)
    with pytest.raises(hexad.JobFailed):
        hexad.sample(tmp_path / "none.obj", count=300)
    # the kernel lists a thread for a moment after it was joined
    wait_until(lambda: state() == before, "the end of threads and descriptors")


def run_alone(program):
    """A program with hexad loaded, in a process of its own."""
    head = f"import sys; sys.path.insert(0, {str(SOURCE / 'clients/python')!r}); import hexad, numpy, os, signal, resource, threading\n" \
           "from hexad.library import load; load(); ball = numpy.array([[1,0,0],[-1,0,0],[0,1,0],[0,-1,0],[0,0,1],[0,0,-1]], float)\n" \
           "faces = numpy.array([[0,2,4],[2,1,4],[1,3,4],[3,0,4],[2,0,5],[1,2,5],[3,1,5],[0,3,5]])\n"
    done = subprocess.run([sys.executable, "-c", head + program], capture_output=True, text=True,
                          timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def test_a_call_on_arrays_opens_no_file_and_starts_no_process():
    """No descriptor can be opened, and no process started."""
    words = run_alone("hexad.sample(ball, faces, count=100)  # the interpreter has loaded what it needs\n"
                      "resource.setrlimit(resource.RLIMIT_NOFILE, (3, 3)); os.environ['HEXAD_WORKER'] = '/none'\n"
                      "p = hexad.sample(ball, faces, count=200); v = hexad.sample(numpy.pad(numpy.ones((4, 4, 4)), 3), isovalue=.5, count=100)\n"
                      "os.write(1, b'%d %d' % (p.count, v.count))")
    assert words == ("200 100", "")


def test_calls_work_after_fork():
    words, _ = run_alone("a = hexad.sample(ball, faces, count=200)\nif os.fork() == 0:\n"
                         "    b = hexad.sample(ball, faces, count=200); os.write(1, b'%d' % (a.positions == b.positions).all()); os._exit(0)\n"
                         "os.wait()")
    assert words == "1"


def test_a_process_that_is_forked_during_a_call_ends():
    words, _ = run_alone(f"told = threading.Event()\nthreading.Thread(target=hexad.sample, args=({ENDLESS!r},), daemon=True, "
                         "kwargs={'progress': lambda *_: told.set()}).start()\ntold.wait(); child = os.fork()\n"
                         "if child: os.write(1, b'%d' % os.waitpid(child, 0)[1])")
    assert words == "0"


def test_a_process_that_is_forked_by_the_progress_function_has_a_cancelled_call():
    words, _ = run_alone(f"children = []\ndef hear(*_):\n    children or children.append(os.fork())\n    return children[0]\n"
                         f"try: hexad.sample({ENDLESS!r}, progress=hear)\nexcept hexad.JobFailed as e: os.write(1, e.code.encode() + b' ')\n"
                         "if children[0]: os.write(1, b'%d' % os.waitpid(children[0], 0)[1])")
    assert words == "cancelled cancelled 0"


def test_files_are_read_from_short_threads_and_without_sigchld(tmp_path):
    BALL.write(tmp_path / "ball.obj")
    words, _ = run_alone("signal.signal(signal.SIGCHLD, signal.SIG_IGN); made = []\n"
                         f"def work(): made.append(hexad.sample({str(tmp_path / 'ball.obj')!r}, count=200).count)\n"
                         "for _ in range(3):\n    t = threading.Thread(target=work); t.start(); t.join()\n"
                         "try: hexad.sample('/none.obj', count=200)\nexcept hexad.JobFailed as e: made.append(e.code)\n"
                         "print(made)")
    assert words == "[200, 200, 200, 'input_missing']\n"


def test_jobs_in_several_threads_do_not_affect_each_other():
    alone = [hexad.sample(*solid(BALL), count=200 + 10 * k, threads=1).positions.tobytes() for k in range(6)]
    together = [None] * 6

    def work(k):
        together[k] = hexad.sample(*solid(BALL), count=200 + 10 * k, threads=2).positions.tobytes()

    threads = [threading.Thread(target=work, args=(k,)) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert together == alone


# ---- files, by a child

def test_files_by_the_function_and_by_the_worker_are_the_same(build, tmp_path):
    BALL.write(tmp_path / "ball.obj")
    spec = {"surface": {"mesh": {"path": "ball.obj"}}, "sampling": {"count": 300}, "output": {"mesh": True}}
    points = hexad.sample(spec, directory=tmp_path)
    expected, _ = by_worker(build, {**spec, "surface": {"mesh": {"path": str(tmp_path / "ball.obj")}}}, tmp_path / "out")
    assert points.positions.tobytes() == expected["position"].tobytes()
    assert numpy.array_equal(points.triangles, expected["triangle"])


def test_files_outside_the_roots_are_refused(tmp_path):
    (tmp_path / "inside").mkdir()
    BALL.write(tmp_path / "ball.obj")
    with pytest.raises(hexad.JobFailed) as found:
        hexad.sample(mesh(str(tmp_path / "ball.obj")), roots=[tmp_path / "inside"])
    assert found.value.code == "path_forbidden"


def test_without_the_worker_a_file_is_an_error_with_the_reason(monkeypatch, tmp_path):
    BALL.write(tmp_path / "ball.obj")
    monkeypatch.setenv("HEXAD_WORKER", "/none/hexad-worker")
    with pytest.raises(hexad.JobFailed, match="/none/hexad-worker, which cannot be started: No such file"):
        hexad.sample(tmp_path / "ball.obj", count=100)


def test_a_worker_that_dies_is_an_error(monkeypatch, tmp_path):
    (tmp_path / "dies").write_text("#!/bin/sh\nkill -9 $$\n")
    (tmp_path / "dies").chmod(0o755)
    monkeypatch.setenv("HEXAD_WORKER", str(tmp_path / "dies"))
    BALL.write(tmp_path / "ball.obj")
    with pytest.raises(hexad.JobFailed) as found:
        hexad.sample(tmp_path / "ball.obj", count=100)
    assert found.value.code == "internal"


def test_the_worker_of_a_call_has_a_short_environment(monkeypatch, tmp_path):
    (tmp_path / "shows").write_text(f"#!/bin/sh\n/usr/bin/env > {tmp_path}/environment\n")
    (tmp_path / "shows").chmod(0o755)
    BALL.write(tmp_path / "ball.obj")
    for name, value in {"HEXAD_WORKER": str(tmp_path / "shows"), "HEXAD_TOKEN": "hexad_secret", "ANY": "secret", "TZ": "Asia/Tokyo"}.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(hexad.JobFailed):
        hexad.sample(tmp_path / "ball.obj", count=100)
    seen = (tmp_path / "environment").read_text().splitlines()
    assert "TZ=Asia/Tokyo" in seen and not [line for line in seen if "secret" in line or line.startswith("HEXAD_")]


def test_a_call_on_a_file_is_cancelled_and_limited(tmp_path):
    BALL.write(tmp_path / "ball.obj")
    endless = {**ENDLESS, "surface": {"mesh": {"path": str(tmp_path / "ball.obj")}}}
    told = []
    with pytest.raises(hexad.JobFailed) as found:
        hexad.sample(endless, progress=lambda phase, _: told.append(phase) or phase == "relax")
    assert found.value.code == "cancelled" and "relax" in told
    with pytest.raises(hexad.JobFailed) as found:
        hexad.sample({**endless, "limits": {"timeout_s": 0.3}})
    assert found.value.code == "limit_time"


# ---- the header, the symbols, and the examples

def declared():
    return set(re.findall(r"^HEXAD_API [^(]*?(hexad_\w+)\(", (SOURCE / "include/hexad.h").read_text(), re.MULTILINE))


@pytest.mark.skipif(not shutil.which("nm"), reason="nm is missing")
def test_only_the_functions_of_the_header_are_symbols(library):
    lines = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True).stdout.splitlines()
    symbols = {line.split()[2].split("@")[0] for line in lines}
    assert symbols - {"HEXAD_1"} == declared()


def test_python_declares_the_functions_of_the_header():
    from hexad.library import FUNCTIONS
    assert {f"hexad_{name}" for name in FUNCTIONS} == declared()


@pytest.mark.parametrize("compiler, standard", [("cc", "c99"), ("cc", "c17"), ("c++", "c++11"), ("c++", "c++20")])
def test_the_example_compiles_without_warnings(library, tmp_path, compiler, standard):
    if not shutil.which(compiler):
        pytest.skip(f"{compiler} is missing")
    source = tmp_path / ("sample.c" if compiler == "cc" else "sample.cc")
    source.write_text((SOURCE / "examples/sample.c").read_text())
    subprocess.run([compiler, f"-std={standard}", "-Wall", "-Wextra", "-pedantic", "-Werror", f"-I{SOURCE / 'include'}", source, library,
                    f"-Wl,-rpath,{library.parent}", "-o", tmp_path / "sample"], check=True)
    words = subprocess.run([tmp_path / "sample"], capture_output=True, text=True, check=True).stdout
    assert re.fullmatch(r"2048 points, converged; the first at \S+ \S+ \S+\n", words)


@pytest.fixture(scope="module")
def calls(library, tmp_path_factory):
    """tests/library/calls.c, with the sanitizers of the build."""
    if not shutil.which("cc"):
        pytest.skip("cc is missing")
    made = tmp_path_factory.mktemp("calls") / "calls"
    flags = ["-fsanitize=address,undefined"] if os.environ.get("HEXAD_TIER") == "sanitized" else []
    subprocess.run(["cc", "-std=gnu11", "-D_GNU_SOURCE", "-g", "-O1", "-Wall", "-Wextra", "-Werror", *flags, f"-I{SOURCE / 'include'}",
                    SOURCE / "tests/library/calls.c", library, f"-Wl,-rpath,{library.parent}", "-lpthread", "-lm", "-o", made], check=True)
    return made


@pytest.mark.sanitized
@pytest.mark.parametrize("words", [(3, 16), ("fuzz", SEED, 2)], ids=["jobs that succeed, fail and are cancelled", "mutated arrays"])
def test_many_calls_in_c(calls, words):
    done = subprocess.run([calls, *map(str, words)], capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stdout + done.stderr


def test_results_do_not_depend_on_the_state_of_the_host(calls, tmp_path):
    """A locale with a decimal comma, rounding, subnormals that are zero, traps: the same bytes and messages; the host's
    progress function and what follows the call have the state that the host has set."""
    subprocess.run(["localedef", "-i", "de_DE", "-f", "UTF-8", tmp_path / "de_DE.UTF-8"], check=True)
    done = subprocess.run([calls, "host", "de_DE.UTF-8"], capture_output=True, text=True, timeout=PATIENCE_S,
                          env={**os.environ, "LOCPATH": str(tmp_path)})
    assert done.returncode == 0, done.stdout + done.stderr


# ---- Python

def test_sample_of_vertices_and_faces():
    points = hexad.sample(*solid(BALL), count=500, mesh=True, seed=3, threads=1)
    assert points.positions.shape == points.normals.shape == (500, 3) and points.triangles.shape[1] == 3
    assert points.outcome == "converged" and points.report["spec"]["solver"]["seed"] == 3
    assert points.positions.base is not None and numpy.shares_memory(points["x"], points.positions)
    assert (numpy.einsum("ij,ij->i", points.positions, points.normals) > 0.9).all()


def test_sample_of_a_volume_has_axes_i_j_k():
    i, j, k = numpy.indices((30, 20, 24))
    values = 1 - ((i - 14) / 10) ** 2 - ((j - 9) / 6) ** 2 - ((k - 11) / 8) ** 2
    affine = numpy.array([[0, 0, 2, 5], [3, 0, 0, -7], [0, 1, 0, 1], [0, 0, 0, 1.0]])
    points = hexad.sample(values, isovalue=0, affine=affine, count=400)
    index = (points.positions - affine[:3, 3]) @ numpy.linalg.inv(affine[:3, :3]).T
    assert abs((((index - [14, 9, 11]) / [10, 6, 8]) ** 2).sum(1) - 1).max() < 1e-3


@pytest.mark.parametrize("kind", ["?", "f2", ">f4", ">i4", "f8"])
def test_sample_of_arrays_of_other_types(kind):
    values = numpy.pad(numpy.ones((6, 6, 6)), 3).astype(kind)
    expected = hexad.sample(values.astype("f8"), isovalue=0.5, count=100)
    assert hexad.sample(values, isovalue=0.5, count=100).positions.tobytes() == expected.positions.tobytes()


@pytest.mark.parametrize("properties, names", [
    ("minimal", {"position", "normal"}), (["spacing"], {"position", "spacing"}), (["kappa2", "radius"], {"position", "kappa2", "radius"}),
    (["quality", "attributes"], {"position", "kappa", "feature", "patch", "kappa_defined"}),
    (None, {"position", "normal", "spacing_local", "feature", "patch"}),
    ("default", {"position", "normal", "spacing_local", "feature", "patch"}),
    (["spacing_local", "red"], {"position", "spacing_local", "rgb"}), ("meshlab", {"position", "normal", "rgb", "radius", "kappa", "feature",
                                                                                   "patch", "kappa_defined"})])
def test_properties_choose_arrays_and_change_no_value(properties, names):
    surface = solid(drum(24))
    chosen, every = (hexad.sample(*surface, count=300, **how) for how in ({"properties": properties}, {"properties": "all"}))
    assert {name for name in chosen if len(name) > 2} == names
    assert len(set(every) & names) >= len(names - {"rgb"})
    for name in names & set(every):
        assert chosen[name].tobytes() == every[name].tobytes(), name


def test_a_property_that_is_not_there_names_those_that_are_and_the_word_for_all():
    points = hexad.sample(*solid(BALL), count=100)
    with pytest.raises(KeyError, match=r'no kappa, but x, y, z, .*spacing_local.* "all"'):
        points["kappa"]
    assert "kappa" not in points and points.get("kappa") is None
    with pytest.raises(KeyError, match='no normal, but .*"all"'):
        hexad.sample(*solid(BALL), count=100, properties=["spacing"]).normals


@pytest.mark.parametrize("make", [
    lambda: hexad.sample(*solid(BALL), count=100), lambda: hexad.sample_many([solid(BALL)], 50),
    lambda: hexad.JobFailed("0123", "failed", {"code": "no_surface", "message": "nothing"}),
    lambda: hexad.JobFailed("0123", "cancelled", None),
    lambda: hexad.Problem(400, {"code": "spec_invalid", "detail": "what", "errors": [{"pointer": "/a", "detail": "b"}]}),
], ids=["points", "batch", "failed", "cancelled", "problem"])
def test_results_and_errors_pass_between_processes(make):
    """A pool of processes pickles what a function returns or raises; what it cannot read back stops the pool."""
    made = make()
    read = pickle.loads(pickle.dumps(made))
    assert type(read) is type(made) and str(read) == str(made)
    if isinstance(made, Exception):
        assert vars(read) == vars(made)
    else:
        assert (read.positions == made.positions).all() and repr(read) == repr(made)


def test_points_outlive_the_call():
    import gc
    positions = hexad.sample(*solid(BALL), count=300).positions
    copy = positions.copy()
    gc.collect()
    hexad.sample(*solid(BALL), count=300, seed=9)
    assert (positions == copy).all()


@pytest.mark.parametrize("call, words", [
    (lambda: hexad.sample(*solid(BALL), cuont=10), "cuont is no argument: did you mean count?"),
    (lambda: hexad.sample(*solid(BALL), count=10, isovalue=0), "a member of surface.volume, and the surface is a mesh"),
    *((lambda group=group: hexad.sample(*solid(BALL), count=10, **{group: {}}), f"{group} is no argument but a group of the spec: give a spec")
      for group in ("outcome", "limits", "solver")),
    (lambda: hexad.sample(*solid(BALL), count=10, curvature={"ratio": object()}), "neither a number"),
    (lambda: hexad.sample((*solid(BALL), None, None), count=10), "a tuple of 4 is no surface"),
    (lambda: hexad.sample([[0, 0, 0], [1, 0]], BALL.triangles, count=10), "vertices has rows of unequal lengths"),
    (lambda: hexad.sample(BALL.vertices, [], count=10), "faces has no rows"),
    (lambda: hexad.sample(BALL.vertices, [0, 1, 2], count=10), "faces is no list of polygons"),
    (lambda: hexad.sample((density(), numpy.eye(4)), isovalue=0, affine=numpy.eye(4), count=10), "affine is given twice"),
    (lambda: hexad.sample(density(), count=10), "isovalue"),
    (lambda: hexad.sample({**formula()}, count=10), "count"),
    (lambda: hexad.sample(BALL.vertices, count=10), "is no surface"),
    (lambda: hexad.sample(*solid(BALL), count=10, points={"path": ON_BALL, "mode": "keep"}), "points: 18 points are given, and the count"),
    (lambda: hexad.sample("/none/ball.obj", count=10), "/surface/mesh/path: cannot read /none/ball.obj: No such file"),
    (lambda: hexad.sample({**formula(), "region": {"inside": {"union": [{"analytic": TORUS}, {"mesh": {"path": "/none/ball.obj"}}]}}}), "/region/inside/union/1/mesh/path: cannot"),
    (lambda: hexad.sample({**formula(), "attributes": [{"from": "/none/a.vdb", "name": "heat"}]}), "/attributes/0/from: cannot read /none/a.vdb"),
    (lambda: hexad.sample(BALL.vertices.astype(object).astype(str), BALL.triangles, count=10), "not a number"),
])
def test_calls_that_are_wrong(call, words):
    with pytest.raises((TypeError, hexad.HexadError), match=words):
        call()


class Frame:
    """As a data frame of pandas with default columns: iteration gives the names of the columns."""

    def __init__(self, table):
        self.table = numpy.asarray(table)

    def __array__(self, dtype=None):
        return numpy.array(self.table, dtype)

    def __iter__(self):
        return iter(range(self.table.shape[1]))

    def __len__(self):
        return len(self.table)


@pytest.mark.parametrize("vertices, faces", [
    (BALL.vertices.astype(object), BALL.triangles), (BALL.vertices, BALL.triangles.astype(object)), (Frame(BALL.vertices), Frame(BALL.triangles)),
    (Frame(BALL.vertices.astype(object)), Frame(BALL.triangles.astype(object))), (BALL.vertices, numpy.fromiter(([*t] for t in BALL.triangles), object)),
    (numpy.ma.masked_array(BALL.vertices, mask=False), BALL.triangles),
])
def test_meshes_in_tables_of_objects_and_in_data_frames(vertices, faces):
    assert hexad.sample(vertices, faces, count=300).positions.tobytes() == hexad.sample(*solid(BALL), count=300).positions.tobytes()


def test_polygons_in_an_array_of_objects():
    faces = numpy.empty(len(HOUSE[1]), object)
    faces[:] = [numpy.array(face) for face in HOUSE[1]]
    assert hexad.sample(HOUSE[0], faces, count=300).positions.tobytes() == hexad.sample(*HOUSE, count=300).positions.tobytes()


def masked(values, at=(0, 0)):
    mask = numpy.zeros(numpy.shape(values), bool)
    mask[at] = True
    return numpy.ma.masked_array(values, mask=mask)


BLOCK = density()


@pytest.mark.parametrize("call, words", [
    (lambda: hexad.sample(masked(BALL.vertices), BALL.triangles, count=100), "vertices has 1 masked elements"),
    (lambda: hexad.sample([*BALL.vertices[1:], masked(BALL.vertices[0], 0)], BALL.triangles, count=100), "vertices has 1 masked"),
    (lambda: hexad.sample(BALL.vertices, masked(BALL.triangles), count=100), "faces has 1 masked"),
    (lambda: hexad.sample((QUADS[0], numpy.ravel(QUADS[1]), masked([4] * 6, 2)), count=100), "counts has 1 masked"),
    (lambda: hexad.sample(*solid(BALL), count=100, points=masked(ON_BALL)), "points has 1 masked"),
    (lambda: hexad.sample(BLOCK, isovalue=0, affine=masked(numpy.eye(4)), count=100), "affine has 1 masked"),
    (lambda: hexad.sample({"surface": {"labels": {"path": masked(Balls(20).labels, 0)}}, "sampling": {"count": 100}}), "values has 400 masked"),
    (lambda: hexad.sample(*solid(BALL), count=100, region={"min": masked([-2, -2, -2], 0), "max": [2, 2, 2]}), "/region/min has masked"),
    (lambda: hexad.sample(BLOCK, isovalue=numpy.ma.masked, count=100), "/surface/volume/isovalue has masked"),
    (lambda: hexad.sample(*solid(BALL), spacing=float("nan")), "/sampling/spacing is nan: give a finite number"),
    (lambda: hexad.sample(*solid(BALL), spacing=numpy.float32("inf")), "/sampling/spacing is inf"),
    (lambda: hexad.sample(*solid(BALL), count=100, region={"min": numpy.array([0, numpy.nan, 0]), "max": [1, 1, 1]}), "/region/min/1 is nan"),
    (lambda: hexad.sample({**formula(), "solver": {"step_tolerance": -numpy.inf}}), "/solver/step_tolerance is -inf"),
    (lambda: hexad.sample(BALL.vertices, numpy.array([[0, 1, None]]), count=100), "faces has the type object"),
    (lambda: hexad.sample("scan.mgz", isovalue=0, count=100), "/surface/volume/path: cannot read"),
    (lambda: hexad.sample("scan.IMG.gz"), "a volume requires isovalue"),
])
def test_values_that_are_missing_are_refused_by_name(call, words):
    with pytest.raises((TypeError, hexad.HexadError), match=words):
        call()


@pytest.mark.parametrize("kind", ["f4", "f8", "i2"])
def test_masked_values_of_a_volume_are_not_data(kind):
    """A distance within a mask, and a value beyond it as netCDF4 and rasterio give it."""
    i, j, k = numpy.indices((30, 28, 26))
    d = 6 - numpy.sqrt((i - 10.) ** 2 + (j - 12.) ** 2 + (k - 14.) ** 2)
    values = numpy.ma.masked_array(numpy.where(d < -4, 30000, 100 * d).astype(kind), mask=d < -4)
    with pytest.warns(hexad.SurfaceWarning, match="not finite"):
        points = hexad.sample(values, isovalue=0, count=900)
    assert abs(numpy.linalg.norm(points.positions - [10, 12, 14], axis=1) - 6).max() < 0.1
    with pytest.warns(hexad.SurfaceWarning, match="not finite"):
        same = hexad.sample({"surface": {"volume": {"path": (values, None), "isovalue": 0}}, "sampling": {"count": 900}})
    assert same.positions.tobytes() == points.positions.tobytes()


def test_points_are_a_mapping_of_their_properties():
    points = hexad.sample(*solid(BALL), count=300)
    assert len(points) == len(list(points)) == len(dict(points)) and points.count == 300


def test_a_mask_is_labels():
    i = numpy.indices((20, 20, 20)) - 9.5
    mask = (i ** 2).sum(0) < 49
    points = hexad.sample({"surface": {"labels": {"path": mask, "background": 0}}, "sampling": {"count": 1000}})
    radius = numpy.linalg.norm(points.positions - 9.5, axis=1)
    assert abs(radius - 7).max() < 0.5 and (points.normals * (points.positions - 9.5)).sum(1).min() > 0


def test_a_surface_may_be_one_argument():
    """As an item of sample_many and as a path of a spec."""
    assert hexad.sample(solid(BALL), count=300).positions.tobytes() == hexad.sample(*solid(BALL), count=300).positions.tobytes()
    in_a_tuple = hexad.sample((density(), OBLIQUE), isovalue=0, count=300)
    assert in_a_tuple.positions.tobytes() == hexad.sample(density(), affine=OBLIQUE, isovalue=0, count=300).positions.tobytes()


@pytest.mark.parametrize("call", [
    lambda: hexad.sample(solid(BALL), cuont=3), lambda: hexad.sample(BALL.vertices, [0, 1, 2], count=10)])
def test_errors_of_python_have_no_code(call):
    with pytest.raises((TypeError, hexad.HexadError)) as found:
        call()
    assert getattr(found.value, "code", None) is None


def test_keywords_are_the_members_of_sampling_and_of_surfaces():
    from hexad import spec
    from hexad.sample import SURFACES, members_of
    kinds = ("Sampling", SURFACES["mesh"], SURFACES["volume"], SURFACES["vdb"])
    assert set(typing.get_type_hints(spec.SampleMembers)) == set().union(*map(members_of, kinds)) - {"path", "count"}


def test_the_warning_of_an_outcome_states_the_criterion_that_failed():
    """The torus is resolved: only the required regularity is missed."""
    with pytest.warns(hexad.OutcomeWarning, match="the outcome is unresolved: .*hex_fraction") as told:
        points = hexad.sample({**formula(), "outcome": {"require": {"hex_fraction": 1}}})
    assert points.count == 300 and points.outcome == "unresolved" and "thin" not in str(told[0].message)
    assert points.outcome_reasons[0]["message"] in str(told[0].message)


def test_a_result_that_has_not_converged_is_a_warning():
    with pytest.warns(hexad.OutcomeWarning, match="not_converged: rms_step: .* Raise solver.max_sweeps") as told:
        points = hexad.sample({**formula(), "solver": {"max_sweeps": 1}})
    assert points.count == 300 and points.outcome == "not_converged" and told[0].filename == __file__
    assert "not_converged" in repr(points)


def test_the_report_has_attributes_of_the_points():
    points = hexad.sample(formula())
    assert points.outcome_reasons == points.advice == points.warnings == []
    assert points.ratings["hex_fraction"]["rating"] == "good"


TWICE = (BALL.vertices, numpy.concatenate([BALL.triangles, BALL.triangles[:5]]))


def test_warnings_of_the_report_are_warnings():
    with pytest.warns(hexad.SurfaceWarning, match="5 of .* triangles") as told:
        points = hexad.sample(*TWICE, count=300)
    assert [str(each.message) for each in told if each.category is hexad.SurfaceWarning] == points.warnings
    assert told[0].filename == __file__


UNCONVERGED = {**formula(), "solver": {"max_sweeps": 1}}


def test_sample_many_warns_once_and_leaves_the_filters():
    surfaces = [solid(BALL), UNCONVERGED, TWICE, UNCONVERGED, solid(BALL)] * 4
    before = list(warnings.filters)
    with pytest.warns() as told:
        hexad.sample_many(surfaces, 300, processors=4)
    words = {each.category: str(each.message) for each in told}
    assert len(told) == 2 and all(each.filename == __file__ for each in told) and warnings.filters == before
    assert "8 of 20 surfaces are not_converged: 1, 3, 6, 8, 11, 13, 16, 18. surfaces[1]: rms_step" in words[hexad.OutcomeWarning]
    assert "4 of 20 surfaces have warnings: 2, 7, 12, 17. surfaces[2]: " in words[hexad.SurfaceWarning]


def test_sample_many_returns_the_batch_where_a_filter_makes_warnings_exceptions():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = hexad.sample_many([solid(BALL), UNCONVERGED, TWICE], 300)
    assert made.outcomes == ["converged", "not_converged", "converged"] and not numpy.isnan(made.positions).any()
    assert made.errors[0] is None
    assert [str(error)[:30] for error in made.errors[1:]] == ["surfaces[1] is not_converged: ", "surfaces[2] has warnings: 5 of"]


def test_an_interrupt_ends_sample_many(library):
    program = f"import sys; sys.path.insert(0, {str(SOURCE / 'clients/python')!r}); import hexad, signal, threading\n" \
              f"signal.signal(signal.SIGINT, signal.default_int_handler)\n" \
              f"hexad.sample_many([{ENDLESS!r}] * 3, 100000, processors=2, progress=lambda *_: print('runs', flush=True))"
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "runs\n"
        process.send_signal(signal.SIGINT)
        words = process.communicate(timeout=PATIENCE_S)[1]
    assert "KeyboardInterrupt" in words and process.returncode == -signal.SIGINT


BROKEN = (BALL.vertices, BALL.triangles + 1000)


def test_sample_many():
    surfaces = [turned(BALL, k) for k in range(4)] + [BROKEN, formula(), grid(density(), OBLIQUE)]
    made = hexad.sample_many(surfaces[:-1], 300)
    assert made.positions.shape == (6, 300, 3)
    failed = [error is not None for error in made.errors]
    assert failed == [False] * 4 + [True, False] and made.errors[4].code == "input_damaged"
    assert str(made.errors[4]).startswith("input_damaged: surfaces[4]: faces[0, 0] is 1048")
    assert numpy.isnan(made.positions).all(axis=(1, 2)).tolist() == failed
    assert [outcome is None for outcome in made.outcomes] == [report is None for report in made.reports] == failed
    assert set(made.reports[5]) == set(hexad.sample(formula()).report) - {"sweeps"}
    assert made.reports[5]["count"] == 300 and made.reports[5]["surface"]["area"] > 0
    for k in range(4):
        assert made.positions[k].tobytes() == hexad.sample(*surfaces[k], count=300).positions.tobytes()
    volumes = hexad.sample_many([grid(density(), OBLIQUE), density()], 300, isovalue=0)
    assert volumes.positions[0].tobytes() == hexad.sample(density(), affine=OBLIQUE, isovalue=0, count=300).positions.tobytes()
    assert volumes.errors == [None, None]


@pytest.mark.parametrize("item, words", [
    (BROKEN, "input_damaged: surfaces[1]: faces[0, 0] is 1048"),
    ((BALL.vertices,), "surfaces[1]: a tuple of 1 is no surface"),
    (([[0, 0, 0], [1, 0]], BALL.triangles), "surfaces[1]: the surface has rows of unequal lengths"),
    ((BALL.vertices, [[0, 1, 2], [0, 2, 3, "x"]]), "surfaces[1]: faces"),
    ((BALL.vertices[:, :2], BALL.triangles), "spec_invalid: surfaces[1]: vertices has rows of 2 numbers"),
    ((BALL.vertices, BALL.triangles, None, 3), "surfaces[1]: a tuple of 4"),
    (density(), "surfaces[1]: a volume requires isovalue"),
    (None, "surfaces[1]: None is no surface"),
    ("/none.obj", "input_missing: surfaces[1]: "),
    ({}, "spec_invalid: surfaces[1]: /surface"),
    ({"surface": {"mesh": {"path": BROKEN}}}, "input_damaged: surfaces[1]/surface/mesh: faces[0, 0]"),
    (formula({"spacing": 0.1, "count": 300}), "surfaces[1]: /sampling/spacing gives unequal numbers"),
    (formula({"count": 200}), "surfaces[1]: /sampling/count is 200, and the batch has 300"),
])
def test_a_wrong_surface_does_not_end_its_batch(item, words):
    made = hexad.sample_many([solid(BALL), item, solid(BALL)], 300)
    assert made.outcomes == ["converged", None, "converged"] and str(made.errors[1]).startswith(words), made.errors[1]


@pytest.mark.parametrize("keywords, words", [
    ({"cuont": 3}, "did you mean count"), ({"mesh": True}, "mesh: a batch returns positions"), ({"properties": "all"}, "properties: a batch"),
    ({"spacing": 0.1}, "spacing gives unequal numbers"), ({"density": 3}, "density gives unequal"), ({"isovalue": 0}, "surface is a mesh"),
    ({"curvature": {"ratoi": 3}}, "did you mean 'ratio'"), ({"seed": "x"}, "/solver/seed"), ({"limits": {}}, "group of the spec"),
    ({"points": [[0, 0]]}, "points has rows of 2 numbers"), ({"affine": numpy.eye(3)}, "affine has the shape"),
    ({"count": 0}, "count is 0"), ({"processors": -1}, "processors is -1"), ({"count": "many"}, "integer"),
    ({"region": {"min": [0, 0]}}, "/region"),
])
def test_a_wrong_argument_of_a_batch_is_raised(keywords, words):
    with pytest.raises((TypeError, ValueError, hexad.HexadError), match=words):
        hexad.sample_many([solid(BALL), BROKEN, solid(BALL)], **{"count": 300, **keywords})


def test_progress_of_a_batch_counts_surfaces_and_cancels():
    told = []
    hexad.sample_many([solid(BALL), None, BROKEN], 300, progress=lambda *at: told.append((threading.get_ident(), *at)))
    assert {thread for thread, *_ in told} == {threading.get_ident()}
    assert told[0][1:] == (1, 3) and told[-1][1:] == (3, 3) and told == sorted(told)
    made = hexad.sample_many([solid(BALL)] * 2 + [{**ENDLESS, "sampling": {}}] * 3, 300, processors=1, progress=lambda done, _: done == 2)
    assert made.outcomes == ["converged"] * 2 + [None] * 3 and not numpy.isnan(made.positions[:2]).any()
    assert [error.code for error in made.errors[2:]] == ["cancelled"] * 3


def test_points_of_an_earlier_result_are_placed_again(worker, tmp_path):
    """Their report has no ratings."""
    vertices, triangles = solid(BALL)
    for name, by in (("first", 1), ("second", 2)):
        (tmp_path / f"{name}.obj").write_text("".join("v %r %r %r\n" % tuple(v) for v in (by * vertices).tolist()) +
                                              "".join("f %d %d %d\n" % tuple(t + 1) for t in triangles))
    spec = {"version": 1, "surface": {"mesh": {"path": str(tmp_path / "first.obj")}}, "sampling": {"count": 300},
            "attributes": [{"from": "geometry", "name": "source"}]}
    before = hexad.sample(spec)
    assert worker({**spec, "output": {"ply": {"precision": "double"}}}).returncode == 0
    after = hexad.sample({"surface": {"mesh": {"path": str(tmp_path / "second.obj")}}, "sampling": {"attach": str(tmp_path / "out/points.ply")}})
    assert after.ratings == {} and before.ratings and after.outcome == "converged" and after.outcome_reasons == after.advice == []
    assert numpy.abs(after.positions - 2 * before.positions).max() < 1e-9
