# SPDX-License-Identifier: Apache-2.0
"""A call: arrays in, arrays out, in this process (libhexad)."""
from __future__ import annotations

import difflib
import json
import math
import operator
import os
import warnings
from typing import TYPE_CHECKING, Any, Callable, Iterable, Mapping, Sequence, Union

from . import spec as spec_module
from .errors import HexadError, JobFailed, OutcomeWarning, SurfaceWarning
from .job import PathLike, with_version
from .library import Job, Progress, Run, Runs, load_numpy, number_masked, with_nan
from .points import Points

if TYPE_CHECKING:
    from typing_extensions import Unpack

__all__ = ["Samples", "Sampled", "sample", "sample_many"]

VOLUMES = (".nrrd", ".nhdr", ".nii", ".nii.gz", ".hdr", ".img", ".img.gz", ".mha", ".mhd", ".tif", ".tiff", ".btf", ".zarr", ".vti", ".slc",
           ".vol", ".dcm", ".mgz", ".mgh", ".nc", ".mnc", ".mrc", ".ccp4", ".raw", ".h5", ".hdf5", ".zip")  # also of formats not read
Properties = Union[str, Sequence[str]]
SURFACES = {"mesh": "SurfaceMesh", "volume": "SurfaceVolume", "labels": "SurfaceLabels", "vdb": "SurfaceVdb"}
CONVERGED = "converged"
KEYWORDS = ("faces", "count", "affine", "seed", "threads", "region", "attributes", "mesh", "properties", "directory", "roots",
            "progress")  # of sample, without members of sampling and of surfaces
UNEQUAL = ("spacing", "density", "control", "resolve", "attach")  # targets other than count
GROUPS = ("/surface", "/sampling", "/solver", "/region", "/attributes", "/output")  # where keywords are in the spec
SHOWN = 10  # indices in a warning of sample_many


class KeywordError(TypeError):
    """A keyword that does not suit the call."""


class Keywords(spec_module.SampleMembers, total=False):
    """Keywords of `sample_many`."""

    affine: Any
    seed: int
    threads: int
    region: spec_module.Region
    directory: PathLike
    roots: Sequence[PathLike]


class Sampled(Points):
    """The points of a call: the properties that `Points` has, and the arrays of the result by their names.

    positions, normals: arrays (N, 3), not copied
    triangles: with mesh=True, an array (T, 3)
    report: the report as a dict (doc/report.md)
    outcome: converged, unresolved or not_converged
    outcome_reasons: the criteria of the outcome that failed: `criterion`, `value`, `bound` and `message` of each
    advice: changes to the spec: `code`, `message` and `set` of each
    ratings: how regular the packing is: of each measure its `value` and its `rating`, `good`, `fair`, `poor` or None;
        empty if the points of an earlier result were placed again
    warnings: what hexad repaired, assumed or could not resolve

    count: the number of points; len() returns the number of properties, because this is a mapping
    """

    def __init__(self, arrays: dict[str, Any], report: dict[str, Any]) -> None:
        triangles = arrays.pop("triangle", None)
        columns = dict(zip("xyz", arrays["position"].T))
        if "normal" in arrays:
            columns.update(zip(("nx", "ny", "nz"), arrays["normal"].T))
        super().__init__({**columns, **arrays}, len(arrays["position"]), triangles)
        self.report, self.outcome = report, str(report["outcome"])

    def __repr__(self) -> str:
        return f"<{self.count} points, {self.outcome}, with {', '.join(self.columns)}>"

    @property
    def outcome_reasons(self) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = self.report["outcome_reasons"]
        return found

    @property
    def advice(self) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = self.report["advice"]
        return found

    @property
    def ratings(self) -> dict[str, dict[str, Any]]:
        found: dict[str, dict[str, Any]] = self.report.get("ratings", {})
        return found

    @property
    def warnings(self) -> list[str]:
        found: list[str] = self.report["surface"]["warnings"]
        return found

    @property
    def positions(self) -> Any:
        return self.columns["position"]

    @property
    def normals(self) -> Any:
        return self["normal"]


class Samples:
    """The points of many surfaces.

    positions, normals: arrays (M, N, 3); NaN where a surface failed
    outcomes: of each surface; None where it failed
    reports: of each surface the report as a dict, without `sweeps`, nine tenths of its memory; None where it failed
    errors: of each surface the exception, or None
    """

    def __init__(self, surfaces: int, count: int) -> None:
        numpy = load_numpy()
        self.positions = numpy.full((surfaces, count, 3), numpy.nan)
        self.normals = numpy.full((surfaces, count, 3), numpy.nan)
        self.outcomes: list[str | None] = [None] * surfaces
        self.reports: list[dict[str, Any] | None] = [None] * surfaces
        self.errors: list[HexadError | None] = [None] * surfaces

    def __repr__(self) -> str:
        return f"<{len(self.outcomes)} x {self.positions.shape[1]} points, {self.outcomes.count(None)} failed>"


def kind_of_file(path: str) -> str:
    lower = path.rstrip("/").lower()
    return "vdb" if lower.endswith(".vdb") else "volume" if lower.endswith(VOLUMES) else "mesh"


def with_counts(faces: Any) -> tuple[Any, Any]:
    """Faces as an array; polygons of several sizes, in a list, as their corners and their counts."""
    numpy = load_numpy()
    if hasattr(faces, "__array__"):  # also a data frame, which iterates over the names of its columns
        table = faces if isinstance(faces, numpy.ndarray) else numpy.asarray(faces)
        if table.dtype.kind != "O":
            return table, None
        faces = table.tolist()
    try:
        counts = numpy.array([len(face) for face in faces])
        if not counts.size:
            raise HexadError("faces has no rows: give the triangles")
        if len(set(counts.tolist())) == 1:
            return faces, None
        return numpy.concatenate([numpy.asarray(face, None if len(face) else "int64") for face in faces]), counts
    except (TypeError, ValueError) as fault:
        raise HexadError(f"faces is no list of polygons, each a list of indices: {fault}") from None


def add_array(job: Job, name: str, place: tuple[str, ...], given: Any) -> None:
    """Gives the job the arrays that it reads in place of the file at this place of the spec."""
    parent = place[-1]
    if parent == "mesh":
        if not isinstance(given, (tuple, list)) or len(given) not in (2, 3):
            raise HexadError(f"{name}: give (vertices, faces) or (vertices, faces, counts)")
        vertices, faces = given[0], given[1]
        job.add_mesh(name, vertices, *((faces, given[2]) if len(given) == 3 else with_counts(faces)))
    elif parent == "points":
        job.add_points(name, given)
    elif isinstance(given, tuple):
        if len(given) != 2:
            raise HexadError(f"{name}: give values or (values, affine)")
        job.add_grid(name, with_nan(given[0]) if parent == "volume" else given[0], given[1])
    else:
        job.add_grid(name, with_nan(given) if parent == "volume" else given)


Found = list[tuple[str, tuple[str, ...], Any]]  # arrays: name, place in the spec, what is given


def take_arrays(node: Any, place: tuple[str, ...], found: Found, name_of: Callable[[tuple[str, ...]], str]) -> Any:
    """A copy of a part of a spec, with names in place of the arrays that are values of `path`."""
    if isinstance(node, Mapping):
        made = {}
        for key, value in node.items():
            if key == "path" and isinstance(value, os.PathLike):
                value = os.fspath(value)
            elif key == "path" and not isinstance(value, str):
                found.append((name_of(place), place, value))
                value = found[-1][0]
            made[key] = take_arrays(value, (*place, str(key)), found, name_of)
        return made
    if isinstance(node, (list, tuple)):
        return [take_arrays(item, (*place, str(k)), found, name_of) for k, item in enumerate(node)]
    if hasattr(node, "tolist"):
        if number_masked(node):
            raise KeywordError(f"{pointer_to(place)} has masked elements: give numbers")
        return take_arrays(node.tolist(), place, found, name_of)
    if isinstance(node, float) and not math.isfinite(node):
        raise KeywordError(f"{pointer_to(place)} is {node}: give a finite number")
    return node


def members_of(kind: str) -> set[str]:
    """The members of a class of hexad.spec."""
    found = getattr(spec_module, kind)
    return {name for base in found.__mro__ for name in getattr(base, "__annotations__", {})}


def dimensions_of(values: Any) -> int:
    try:
        return int(load_numpy().ndim(values))
    except ValueError:
        raise HexadError("the surface has rows of unequal lengths: give an array") from None


def surface_of(surface: Any, faces: Any, affine: Any) -> tuple[str, Any]:
    """The kind of a surface that is no spec, and its path in a spec."""
    if isinstance(surface, (str, os.PathLike)):
        if faces is None and affine is None:
            name = os.path.abspath(os.fspath(surface))
            return kind_of_file(name), name
        raise KeywordError(f"{'faces' if affine is None else 'affine'} belongs to arrays, and the surface is a file: omit it")
    if faces is None and isinstance(surface, tuple) and len(surface) not in (2, 3):
        raise HexadError(f"a tuple of {len(surface)} is no surface: give (vertices, faces), (vertices, faces, counts) or (values, affine)")
    if faces is None and isinstance(surface, (tuple, list)) and len(surface) in (2, 3):
        if len(surface) == 2 and dimensions_of(surface[0]) == 3:
            if affine is not None:
                raise KeywordError("affine is given twice: omit the keyword")
            return "volume", tuple(surface)
        path: Any = tuple(surface)
    elif faces is not None:
        path = (surface, faces)
    elif dimensions_of(surface) == 3:
        return "volume", (surface, affine)
    else:
        raise HexadError(f"{'an array of shape ' + str(load_numpy().shape(surface)) if dimensions_of(surface) else repr(surface)} is no "
                         "surface: give vertices and faces, a volume of three dimensions, the name of a file, or a spec")
    if affine is not None:
        raise KeywordError("affine belongs to a volume, and the surface is a mesh: omit it")
    return "mesh", path


def explain_keyword(key: str, kind: str) -> str:
    """Why a keyword is refused, and what to do."""
    others = [other for other, name in SURFACES.items() if key in members_of(name)]
    if others:
        return f"{key} is a member of surface.{others[0]}, and the surface is a {kind}: omit it"
    if key in members_of("Spec"):
        return f"{key} is no argument but a group of the spec: give a spec, {{'surface': ..., 'sampling': ..., {key!r}: ...}}"
    near = difflib.get_close_matches(key, [*KEYWORDS, *members_of("Sampling"), *members_of(SURFACES[kind])], 1)
    return f"{key} is no argument: " + (f"did you mean {near[0]}?" if near else f"arguments are members of sampling and of surface.{kind}")


def make_spec(surface: Any, faces: Any, affine: Any, keywords: Mapping[str, Any]) -> dict[str, Any]:
    """The spec of a mesh, a volume or a file, with keywords as members."""
    kind, path = surface_of(surface, faces, affine)
    own: dict[str, Any] = {"path": path}
    sampling: dict[str, Any] = {}
    spec: dict[str, Any] = {"surface": {kind: own}, "sampling": sampling}
    for key, value in keywords.items():
        is_own = key in members_of(SURFACES[kind]) and key != "path"
        if is_own and not (key == "grid" and not isinstance(value, str)):
            own[key] = value
        elif key in members_of("Sampling"):
            sampling[key] = {"path": value} if key == "points" and not isinstance(value, Mapping) else value
        else:
            raise KeywordError(explain_keyword(key, kind))
    if kind == "volume" and "isovalue" not in own:
        raise KeywordError("a volume requires isovalue=: values above it are inside")
    return spec


def put(spec: dict[str, Any], group: str | None, key: str, value: Any) -> None:
    """Sets a member that is given as a keyword."""
    if value is None:
        return
    if group is None:
        spec[key] = value
    elif isinstance(spec.get(group, {}), Mapping):  # otherwise the library refuses the group
        spec[group] = {**spec.get(group, {}), key: value}


class Call:
    """A spec as text, and the arrays that it names."""

    def __init__(self, spec: Mapping[str, Any], name_of: Callable[[tuple[str, ...]], str]) -> None:
        self.found: Found = []
        document = with_version(take_arrays(spec, (), self.found, name_of))
        try:
            self.text = json.dumps(document)
        except (TypeError, ValueError) as fault:
            raise KeywordError(f"a value is neither a number, a text nor an array: {fault}") from None

    def job(self, directory: PathLike | None, roots: Sequence[PathLike]) -> Job:
        job = Job(self.text)
        for name, place, given in self.found:
            add_array(job, name, place, given)
        job.set_places(os.fspath(directory) if directory else None, [os.fspath(root) for root in roots])
        return job

    def run(self, directory: PathLike | None, roots: Sequence[PathLike], progress: Progress | None) -> Sampled:
        job = self.job(directory, roots)
        job.run(progress)
        return points_of(job)


def points_of(job: Job) -> Sampled:
    return Sampled(job.arrays(), job.report())


def put_properties(spec: dict[str, Any], properties: Properties | None) -> None:
    output = spec.get("output", {})
    ply = output.get("ply", {}) if isinstance(output, Mapping) else {}
    if properties is not None and isinstance(ply, Mapping):
        put(spec, "output", "ply", {**ply, "properties": properties})


def pointer_to(place: tuple[str, ...]) -> str:
    """The name of an array in a spec: the JSON Pointer of the member that has it as its path."""
    return "/" + "/".join(place)


def last_of(place: tuple[str, ...]) -> str:
    """The name of an array in a call with keywords: mesh, volume, points or grid."""
    return place[-1]


def first_reason(points: Sampled) -> str:
    """Why an outcome is not converged: the message of the first criterion that failed."""
    messages = [str(reason["message"]) for reason in points.outcome_reasons]
    more = f" outcome_reasons has {len(messages)} messages." if len(messages) > 1 else ""
    return " ".join(messages[:1]) + more + (" advice has values for the spec." if points.advice else "")


def sample(surface: Any, faces: Any = None, *, count: int | None = None, affine: Any = None, seed: int | None = None,
           threads: int | None = None, region: spec_module.Region | None = None,
           attributes: Sequence[spec_module.AttributesItem] | None = None, mesh: bool | None = None,
           properties: Properties | None = None,
           directory: PathLike | None = None, roots: Sequence[PathLike] = (), progress: Progress | None = None,
           **keywords: Unpack[spec_module.SampleMembers]) -> Sampled:
    """Evenly packed points on a surface: `sample(vertices, faces, count=10_000)`.

    surface: one of
        vertices (V, 3) with `faces` (F, n), or a list of polygons; or (vertices, faces)
        a volume of three dimensions, axes i, j, k, with isovalue=; affine: from indices to space, (4, 4), as nibabel has it; or
        (values, affine); masked values are no data
        the name of a file, which hexad-worker reads
        a spec, in which each `path` may be an array: (vertices, faces), (values, affine) or values, and rows of points
    seed, threads, region, attributes, mesh: members of the spec; mesh=True: triangles between the points
    properties: output.ply.properties of the spec: the names of the properties that the points have. "all": every property. "minimal":
        positions and normals. The curvature of a mesh takes time: it is computed if "all", `kappa` or colours are among them
    directory, roots: where files are, and below which directories they must be; for a spec
    progress: a function of the phase (load, start, relax, measure, curvature, weights, write) and the fraction of the whole call, 0 to 1,
        which never falls; if its result is true, the call is cancelled
    count: the number of points
    keywords: further members of `sampling` (spacing, curvature, pattern, points, ...) and of the surface (isovalue, features, ...)

    A call that fails raises JobFailed with a code. The outcomes unresolved and not_converged are warnings (OutcomeWarning), and so
    are the warnings of the report about the surface (SurfaceWarning).
    """
    members: dict[str, Any] = dict(keywords)
    if count is not None:
        members["count"] = count
    is_spec = isinstance(surface, Mapping)
    if is_spec:
        if faces is not None or affine is not None or members:
            raise KeywordError("a spec has all members: put these into it: " +
                               ", ".join([*(["faces"] if faces is not None else []), *(["affine"] if affine is not None else []),
                                          *members]))
        spec: dict[str, Any] = dict(surface)
    else:
        spec = make_spec(surface, faces, affine, members)
    put(spec, "solver", "seed", seed)
    put(spec, "solver", "threads", threads)
    put(spec, None, "region", region)
    put(spec, None, "attributes", attributes)
    put(spec, "output", "mesh", mesh)
    put_properties(spec, properties)
    made = Call(spec, pointer_to if is_spec else last_of).run(directory, roots, progress)
    for text in dict.fromkeys(made.warnings):
        warnings.warn(text, SurfaceWarning, 2)
    if made.outcome != CONVERGED:
        warnings.warn(f"the outcome is {made.outcome}: {first_reason(made)}", OutcomeWarning, 2)
    return made


def warn_of_batch(made: Samples, kind: type[Warning], texts: Mapping[int, str], one: str, several: str) -> None:
    """One warning of some surfaces of a batch. If a filter makes it an exception, these surfaces have an error: the batch is returned."""
    if not texts:
        return
    listed = sorted(texts)
    shown = ", ".join(map(str, listed[:SHOWN])) + (f" and {len(listed) - SHOWN} more" if len(listed) > SHOWN else "")
    try:
        warnings.warn(f"{len(listed)} of {len(made.outcomes)} surfaces {one if len(listed) == 1 else several}: {shown}. surfaces[{listed[0]}]: {texts[listed[0]]}",
                      kind, 3)
    except kind:
        for k in listed:
            made.errors[k] = made.errors[k] or HexadError(f"surfaces[{k}] {one}: {texts[k]}")


Surface = Union[PathLike, Sequence[Any], Mapping[str, Any], Any]


def name_in_batch(k: int, is_spec: bool) -> Callable[[tuple[str, ...]], str]:
    """The names of the arrays of one surface."""
    if is_spec:
        return lambda place: f"surfaces[{k}]{pointer_to(place)}"
    return lambda place: f"surfaces[{k}]" if place[0] == "surface" else last_of(place)


def item_of_batch(k: int, surface: Surface, count: int, keywords: Mapping[str, Any]) -> Call:
    """The call of one surface."""
    own = {key: keywords[key] for key in ("affine", "seed", "threads", "region") if key in keywords}
    members = {key: value for key, value in keywords.items() if key not in own}
    affine = own.pop("affine", None)
    if isinstance(surface, Mapping):
        if members or affine is not None:
            raise KeywordError(f"a spec has all members: put these into it: {', '.join([*members, *(['affine'] if affine is not None else [])])}")
        spec: dict[str, Any] = dict(surface)
        sampling = spec.get("sampling", {})
        if isinstance(sampling, Mapping):
            target = next((key for key in UNEQUAL if sampling.get(key)), None)
            if target:
                raise HexadError(f"/sampling/{target} gives unequal numbers of points: remove it; the batch has count")
            if sampling.get("count", count) != count:
                raise HexadError(f"/sampling/count is {sampling['count']}, and the batch has {count} points: remove it")
            spec["sampling"] = {**sampling, "count": count}
    else:
        spec = make_spec(surface, None, affine, {**members, "count": count})
    put(spec, "solver", "seed", own.get("seed"))
    put(spec, "solver", "threads", own.get("threads", 1))
    put(spec, None, "region", own.get("region"))
    put_properties(spec, "minimal")
    return Call(spec, name_in_batch(k, isinstance(surface, Mapping)))


def check_batch(keywords: Mapping[str, Any]) -> None:
    """Refuses arguments that all surfaces have in common and that do not suit a batch."""
    for key, value in keywords.items():
        if value is None or value is False:
            continue
        if key in UNEQUAL:
            raise KeywordError(f"{key} gives unequal numbers of points, and a batch has count: call sample for each surface")
        if key in ("mesh", "properties", "attributes"):
            raise KeywordError(f"{key}: a batch returns positions and normals only: call sample for each surface")
    probe, points, grid = Job("{}"), keywords.get("points"), keywords.get("grid")
    if keywords.get("affine") is not None:
        probe.add_grid("affine", load_numpy().zeros((2, 2, 2)), keywords["affine"])
    for name, given in (("points", points), ("grid", grid)):
        path = given.get("path") if isinstance(given, Mapping) else given if name == "points" else None
        if path is not None and not isinstance(path, (str, os.PathLike)):
            add_array(probe, name, (name,), path)


def error_of_item(k: int, fault: Exception) -> HexadError:
    """A fault with the index of its surface."""
    def named(text: str) -> str:
        return text if text.startswith(f"surfaces[{k}]") else f"surfaces[{k}]: {text}"

    if isinstance(fault, JobFailed) and fault.error:
        return JobFailed("", fault.state, {**fault.error, "message": named(fault.error["message"])})
    if isinstance(fault, (HexadError, KeywordError)):
        return HexadError(named(str(fault)))
    made = HexadError(named(f"{type(fault).__name__}: {fault}"))
    made.__cause__ = fault
    return made


def is_common(surface: Surface, fault: Exception) -> bool:
    """Whether a fault is in the arguments that the surfaces have in common. A spec has none."""
    if isinstance(fault, JobFailed) and fault.error:
        return not isinstance(surface, Mapping) and fault.error["message"].startswith(GROUPS)
    return isinstance(fault, KeywordError)


class Batch:
    """The calls of `sample_many`; some of them run at a time."""

    def __init__(self, surfaces: list[Surface], count: int, keywords: dict[str, Any]) -> None:
        self.surfaces, self.made = surfaces, Samples(len(surfaces), count)
        self.directory, self.roots = keywords.pop("directory", None), keywords.pop("roots", ())
        self.common: list[Exception] = []  # faults
        self.reasons: dict[int, str] = {}  # of outcomes
        self.texts: dict[int, str] = {}  # of surfaces
        self.waiting: dict[int, Call] = {}
        self.running: dict[int, Run] = {}
        self.runs = Runs()
        for k, surface in enumerate(surfaces):
            try:
                self.waiting[k] = item_of_batch(k, surface, count, keywords)
            except Exception as fault:  # a surface never ends the others
                self.fail(k, fault)

    def fail(self, k: int, fault: Exception) -> None:
        self.made.errors[k] = error_of_item(k, fault)
        if is_common(self.surfaces[k], fault):
            self.common.append(fault)

    def begin(self, k: int) -> None:
        try:
            self.running[k] = Run(self.waiting.pop(k).job(self.directory, self.roots), self.runs)
            self.running[k].start()
        except Exception as fault:
            self.running.pop(k, None)
            self.fail(k, fault)

    def end(self, k: int) -> None:
        made = self.made
        try:
            run = self.running.pop(k)
            run.check()
            points = points_of(run.job)
            if points.count != made.positions.shape[1]:
                raise HexadError(f"the surface has {points.count} points instead of {made.positions.shape[1]}")
            made.positions[k], made.normals[k] = points.positions, points.normals
            made.outcomes[k] = points.outcome
            made.reports[k] = {name: value for name, value in points.report.items() if name != "sweeps"}
            if points.outcome != CONVERGED:
                self.reasons[k] = first_reason(points)
            if points.warnings:
                self.texts[k] = points.warnings[0]
        except Exception as fault:
            self.fail(k, fault)

    def cancel(self) -> None:
        self.runs.stopped = True
        for k in [*self.waiting]:
            del self.waiting[k]
            self.fail(k, JobFailed("", "cancelled", {"code": "cancelled", "message": "the batch was cancelled before this surface"}))

    def run(self, processors: int, progress: Callable[[int, int], Any] | None) -> None:
        try:
            while True:
                left = len(self.waiting) + len(self.running)
                if progress and not self.runs.stopped and progress(len(self.surfaces) - left, len(self.surfaces)):
                    self.cancel()
                if not left:
                    return
                for k in [*self.waiting][:processors - len(self.running)]:
                    self.begin(k)
                if self.running:
                    self.runs.wait()
                for k in [k for k, run in self.running.items() if run.has_ended]:
                    self.end(k)
        finally:
            self.runs.stopped = True  # an interrupt may prevent the call
            self.runs.stop()


def sample_many(surfaces: Iterable[Surface], count: int = 2048, *, processors: int | None = None,
                progress: Callable[[int, int], Any] | None = None, **keywords: Unpack[Keywords]) -> Samples:
    """The same number of points on each of many surfaces: `sample_many([(vertices, faces), ...], count=2048)`.

    surfaces: of each what `sample` takes: (vertices, faces), a volume, (values, affine), the name of a file, or a spec
    processors: how many surfaces are sampled at a time, with one thread each; default: all
    progress: a function of the number of surfaces that have ended, and of all; if its result is true, the others are cancelled
    keywords: those of `sample`, for all surfaces

    A surface that fails has NaN, and its exception in `errors`. A fault in the keywords is raised.
    """
    listed = list(surfaces)
    given: dict[str, Any] = dict(keywords)
    if operator.index(count) < 1:
        raise ValueError(f"count is {count}: give at least 1")
    if processors is not None and processors < 1:
        raise ValueError(f"processors is {processors}: give at least 1")
    check_batch(given)
    batch = Batch(listed, count, given)
    batch.run(processors or len(os.sched_getaffinity(0)), progress)
    made = batch.made
    if batch.common and made.outcomes.count(None) == len(listed):
        raise batch.common[0]
    warn_of_batch(made, SurfaceWarning, batch.texts, "has warnings", "have warnings")
    for outcome in ("unresolved", "not_converged"):
        warn_of_batch(made, OutcomeWarning, {k: text for k, text in batch.reasons.items() if made.outcomes[k] == outcome},
                      f"is {outcome}", f"are {outcome}")
    return made
