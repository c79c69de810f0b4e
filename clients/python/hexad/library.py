# SPDX-License-Identifier: Apache-2.0
"""libhexad by ctypes: a job in this process, on arrays of NumPy. `hexad.sample` is what to call; this module is private."""
from __future__ import annotations

import atexit
import ctypes
import functools
import importlib
import json
import os
import pathlib
import queue
import threading
from typing import Any, Callable, Sequence

from .errors import HexadError, JobFailed

NAME = "libhexad.so.1"
TYPES = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64")
TICK_S = 0.05  # between calls of the progress function
STATES = {"cancelled": "cancelled", "limit_time": "timed_out"}

Progress = Callable[[str, float], Any]


class Array(ctypes.Structure):
    """hexad_array"""

    _fields_ = [("data", ctypes.c_void_p), ("type", ctypes.c_int), ("dimensions", ctypes.c_int),
                ("size", ctypes.c_size_t * 3), ("stride", ctypes.c_ssize_t * 3)]


class Error(ctypes.Structure):
    """hexad_error"""

    _fields_ = [("code", ctypes.c_char * 32), ("message", ctypes.c_char * 1024)]


PROGRESS = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_double)
FUNCTIONS: dict[str, tuple[Any, list[Any]]] = {
    "version": (ctypes.c_char_p, []),
    "job_new": (ctypes.c_void_p, [ctypes.c_char_p]),
    "job_free": (None, [ctypes.c_void_p]),
    "job_add_mesh": (ctypes.c_int, [ctypes.c_void_p, ctypes.c_char_p] + [ctypes.POINTER(Array)] * 3 + [ctypes.POINTER(Error)]),
    "job_add_grid": (ctypes.c_int, [ctypes.c_void_p, ctypes.c_char_p, ctypes.POINTER(Array), ctypes.c_void_p,
                                    ctypes.POINTER(Error)]),
    "job_add_points": (ctypes.c_int, [ctypes.c_void_p, ctypes.c_char_p, ctypes.POINTER(Array), ctypes.POINTER(Error)]),
    "job_set_directory": (None, [ctypes.c_void_p, ctypes.c_char_p]),
    "job_add_root": (None, [ctypes.c_void_p, ctypes.c_char_p]),
    "job_set_progress": (None, [ctypes.c_void_p, PROGRESS, ctypes.c_void_p]),
    "job_run": (ctypes.c_int, [ctypes.c_void_p, ctypes.POINTER(Error)]),
    "job_report": (ctypes.c_char_p, [ctypes.c_void_p]),
    "job_array_name": (ctypes.c_char_p, [ctypes.c_void_p, ctypes.c_size_t]),
    "job_array": (ctypes.c_int, [ctypes.c_void_p, ctypes.c_char_p, ctypes.POINTER(Array)]),
}


def own_file(name: str) -> str | None:
    """A file of the wheel; None in an installation without it."""
    path = pathlib.Path(__file__).resolve().with_name("lib") / name
    return str(path) if path.exists() else None


@functools.lru_cache(maxsize=None)
def load() -> Any:
    """The library: HEXAD_LIBRARY, or the file in the wheel, or what the loader finds."""
    path = os.environ.get("HEXAD_LIBRARY") or own_file(NAME) or NAME
    try:
        library = ctypes.CDLL(path)
    except OSError as fault:
        raise HexadError(f"{path} cannot be loaded: {fault}. Install libhexad1, or set HEXAD_LIBRARY to its path.") from None
    for name, (result, arguments) in FUNCTIONS.items():
        function = getattr(library, f"hexad_{name}")
        function.restype, function.argtypes = result, arguments
    return library


@functools.lru_cache(maxsize=None)
def load_numpy() -> Any:
    try:
        return importlib.import_module("numpy")
    except ImportError:
        raise HexadError("a call on arrays requires NumPy: install python3-numpy, or pip install numpy") from None


def number_masked(values: Any) -> int:
    """The number of elements without a value, of an array or of rows, which asarray would give the values below the mask."""
    numpy = load_numpy()
    rows = values if isinstance(values, (list, tuple)) else [values]
    return sum(int(numpy.ma.count_masked(row)) for row in rows if isinstance(row, numpy.ma.MaskedArray))


def with_nan(values: Any) -> Any:
    """Values for a volume, in which those of masked elements are not finite: hexad skips and reports them."""
    if not number_masked(values):
        return values
    numpy = load_numpy()
    found = numpy.ma.asarray(values)
    return found.astype(numpy.result_type(found.dtype, numpy.float32)).filled(numpy.nan)


def usable(values: Any, what: str) -> Any:
    """An array of a type that the library has; the array itself if it is one. `what`: the name of the argument."""
    numpy = load_numpy()
    masked = number_masked(values)
    if masked:
        raise HexadError(f"{what} has {masked} masked elements: remove them, or give values for them, {what}.filled(...)")
    try:
        found = numpy.asarray(values)
        if found.dtype.kind == "O":  # numbers of Python, as columns of different types are given
            found = numpy.array(found.tolist())
    except ValueError:
        raise HexadError(f"{what} has rows of unequal lengths: give an array") from None
    if found.dtype.name in TYPES and found.dtype.isnative:
        return found
    kind = {"b": "uint8", "e": "float32", "f": "float32" if found.dtype.itemsize <= 4 else "float64", "i": "int64",
            "u": "uint64"}.get(found.dtype.kind)
    if kind is None or found.dtype.kind == "O":
        raise HexadError(f"{what} has the type {found.dtype}, which is not a number: convert it")
    if found.dtype.name in TYPES:  # of the other byte order
        kind = found.dtype.name
    return found.astype(kind)


def describe(values: Any, what: str) -> Array:
    """The description of an array, which must outlive it."""
    if values.ndim > 3:
        raise HexadError(f"{what} has {values.ndim} dimensions: give an array with at most 3")
    made = Array(values.ctypes.data, TYPES.index(values.dtype.name), values.ndim)
    for k in range(values.ndim):
        made.size[k], made.stride[k] = values.shape[k], values.strides[k]
    return made


class Job:
    """hexad_job, and the arrays that it reads."""

    def __init__(self, spec: str) -> None:
        self.library = load()
        self.handle: ctypes.c_void_p | None = ctypes.c_void_p(self.library.hexad_job_new(spec.encode()))
        self.kept: list[Any] = []

    def __del__(self) -> None:
        if hasattr(self, "handle"):
            self.library.hexad_job_free(self.handle)

    def check(self, result: int, error: Error) -> None:
        if result:
            code, message = error.code.decode(), error.message.decode("utf-8", "replace")
            raise JobFailed("", STATES.get(code, "failed"), {"code": code, "message": message})

    def pointer(self, values: Any, what: str) -> Any:
        if values is None:
            return None
        found = usable(values, what)
        self.kept.append(found)
        return ctypes.byref(describe(found, what))

    def add_mesh(self, name: str, vertices: Any, faces: Any, counts: Any = None) -> None:
        error = Error()
        self.check(self.library.hexad_job_add_mesh(self.handle, name.encode(), self.pointer(vertices, "vertices"),
                                                   self.pointer(faces, "faces"), self.pointer(counts, "counts"), ctypes.byref(error)), error)

    def add_grid(self, name: str, values: Any, affine: Any = None) -> None:
        error, numpy = Error(), load_numpy()
        matrix = None if affine is None else numpy.ascontiguousarray(usable(affine, "affine"), float)
        if matrix is not None and matrix.shape != (4, 4):
            raise HexadError(f"affine has the shape {matrix.shape}: it must have (4, 4)")
        self.check(self.library.hexad_job_add_grid(self.handle, name.encode(), self.pointer(values, "values"),
                                                   None if matrix is None else matrix.ctypes.data, ctypes.byref(error)), error)

    def add_points(self, name: str, rows: Any) -> None:
        error = Error()
        self.check(self.library.hexad_job_add_points(self.handle, name.encode(), self.pointer(rows, "points"), ctypes.byref(error)), error)

    def set_places(self, directory: str | None, roots: Sequence[str]) -> None:
        if directory:
            self.library.hexad_job_set_directory(self.handle, os.fsencode(directory))
        for root in roots:
            self.library.hexad_job_add_root(self.handle, os.fsencode(root))

    def run(self, progress: Progress | None) -> None:
        """Runs the job on a thread. This one waits, so that Ctrl-C ends the call: ctypes would drop the exception in a function
        that the library calls."""
        runs = Runs()
        run = Run(self, runs)
        try:
            run.start()
            while not run.has_ended:
                if progress and not runs.stopped and progress(*run.told):
                    runs.stopped = True
                runs.wait()
        finally:
            runs.stopped = True  # an interrupt may prevent the call
            runs.stop()
        run.check()

    def report(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.library.hexad_job_report(self.handle))
        return found

    def arrays(self) -> dict[str, Any]:
        """The arrays of the result, which are not copied: they keep the job."""
        numpy = load_numpy()
        found: dict[str, Any] = {}
        while True:
            name = self.library.hexad_job_array_name(self.handle, len(found))
            if name is None:
                return found
            a = Array()
            self.library.hexad_job_array(self.handle, name, ctypes.byref(a))
            kind = numpy.dtype(TYPES[a.type])
            shape = tuple(a.size[:a.dimensions])
            count = int(numpy.prod(shape, dtype=int))
            memory = (ctypes.c_char * (count * kind.itemsize)).from_address(a.data)
            memory.job = self
            found[name.decode()] = numpy.frombuffer(memory, kind, count).reshape(shape)


class Runs:
    """Runs that are stopped together."""

    def __init__(self) -> None:
        self.stopped = False
        self.active: set[Run] = set()  # whose threads have begun
        self.ended: queue.SimpleQueue[None] = queue.SimpleQueue()

    def wait(self) -> None:
        """Waits for the end of a run, or a tick."""
        try:
            self.ended.get(timeout=TICK_S)
        except queue.Empty:
            pass

    def stop(self) -> None:
        """Ends the runs soon, and waits for that. Interrupts meanwhile are raised afterwards."""
        self.stopped = True
        interrupt: BaseException | None = None
        while self.active:
            try:
                self.wait()
            except BaseException as fault:
                interrupt = fault
        if interrupt:
            raise interrupt


class Run:
    """A job on a thread of its own. The thread holds all that the library uses until the library has returned, because an interrupt
    may end the caller anywhere, also while it starts the thread or waits for its end."""

    def __init__(self, job: Job, runs: Runs) -> None:
        self.job, self.runs = job, runs
        self.told: tuple[str, float] = ("load", 0.0)
        self.has_ended = False
        self.result, self.error = -1, Error(b"cancelled", b"the job was cancelled before it began")

    def start(self) -> None:
        # a daemon: the interpreter ends the job and does not wait until it is done
        threading.Thread(target=self.work, name="hexad call", daemon=True).start()

    def hear(self, _: Any, phase: bytes, fraction: float) -> int:
        self.told = (phase.decode(), fraction)
        return self.runs.stopped

    def work(self) -> None:
        active.add(self)
        self.runs.active.add(self)
        try:
            if not self.runs.stopped:
                job, function = self.job, PROGRESS(self.hear)
                job.library.hexad_job_set_progress(job.handle, function, None)
                self.result = job.library.hexad_job_run(job.handle, ctypes.byref(self.error))
                job.library.hexad_job_set_progress(job.handle, PROGRESS(0), None)
                job.kept.clear()
        finally:
            self.has_ended = True
            self.runs.active.discard(self)
            active.discard(self)
            self.runs.ended.put(None)

    def check(self) -> None:
        self.job.check(self.result, self.error)


active: set[Run] = set()


@atexit.register
def stop_all() -> None:
    """The end of the interpreter ends threads that call Python, and with them memory that the library uses."""
    for run in [*active]:
        run.runs.stop()


def cancel_all() -> None:
    """A child of fork has no thread of the calls that were in progress. What the library was changing is not freed there."""
    for run in active:
        run.job.handle, run.has_ended, run.runs.stopped = None, True, True
        run.runs.active.clear()
    active.clear()


os.register_at_fork(after_in_child=cancel_all)
