# SPDX-License-Identifier: Apache-2.0
"""A call: arrays in, arrays out, in this process (libhexad)."""
from __future__ import annotations

import concurrent.futures
import os
import warnings
from typing import TYPE_CHECKING, Any, Iterable, Mapping, Sequence, Union

from . import spec as spec_module
from .errors import HexadError, OutcomeWarning, SurfaceWarning
from .job import PathLike, with_version
from .library import Job, Progress, load_numpy
from .points import Points

if TYPE_CHECKING:
    from typing_extensions import Unpack

__all__ = ["Samples", "Sampled", "sample", "sample_many"]

VOLUMES = (".nrrd", ".nhdr", ".nii", ".nii.gz", ".mha", ".mhd", ".tif", ".tiff", ".zarr", ".ome.zarr")
Properties = Union[str, Sequence[str]]
SURFACES = {"mesh": "SurfaceMesh", "volume": "SurfaceVolume", "labels": "SurfaceLabels", "vdb": "SurfaceVdb"}
CONVERGED = "converged"
SHOWN = 10  # indices in a warning of sample_many


class Keywords(spec_module.SampleMembers, total=False):
    """Keywords of `sample_many`."""

    affine: Any
    seed: int
    threads: int
    region: spec_module.Region
    attributes: Sequence[spec_module.AttributesItem]
    mesh: bool
    properties: Properties
    directory: PathLike
    roots: Sequence[PathLike]
    progress: Progress


class Sampled(Points):
    """The points of a call: the properties that `Points` has, and the arrays of the result by their names.

    positions, normals: arrays (N, 3), not copied
    triangles: with mesh=True, an array (T, 3)
    report: the report as a dict (doc/report.md)
    outcome: converged, unresolved or not_converged
    outcome_reasons: the criteria of the outcome that failed: `criterion`, `value`, `bound` and `message` of each
    advice: changes to the spec: `code`, `message` and `set` of each
    ratings: how regular the packing is: of each measure its `value` and its `rating`, `good`, `fair`, `poor` or None
    warnings: what hexad repaired, assumed or could not resolve

    len() is the number of properties, as of every mapping; `count` is the number of points.
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
        found: dict[str, dict[str, Any]] = self.report["ratings"]
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
        return self.columns["normal"]


class Samples:
    """The points of many surfaces.

    positions, normals: arrays (M, N, 3); NaN where a surface failed
    outcomes: of each surface; None where it failed
    errors: of each surface the exception, or None
    """

    def __init__(self, surfaces: int, count: int) -> None:
        numpy = load_numpy()
        self.positions = numpy.full((surfaces, count, 3), numpy.nan)
        self.normals = numpy.full((surfaces, count, 3), numpy.nan)
        self.outcomes: list[str | None] = [None] * surfaces
        self.errors: list[HexadError | None] = [None] * surfaces

    def __repr__(self) -> str:
        failed = sum(error is not None for error in self.errors)
        return f"<{len(self.outcomes)} x {self.positions.shape[1]} points, {failed} failed>"


def kind_of_file(path: str) -> str:
    lower = path.rstrip("/").lower()
    return "vdb" if lower.endswith(".vdb") else "volume" if lower.endswith(VOLUMES) else "mesh"


def with_counts(faces: Any) -> tuple[Any, Any]:
    """Faces as an array; polygons of several sizes, in a list, as their corners and their counts."""
    numpy = load_numpy()
    if isinstance(faces, numpy.ndarray) or len({len(face) for face in faces}) == 1:
        return faces, None
    counts = numpy.array([len(face) for face in faces])
    return numpy.concatenate([numpy.asarray(face, "int64") for face in faces]), counts


def add_array(job: Job, name: str, place: tuple[str, ...], given: Any) -> None:
    """Gives the job the arrays that it reads in place of the file at this place of the spec."""
    parent = place[-1]
    if parent == "mesh":
        if not isinstance(given, (tuple, list)) or len(given) not in (2, 3):
            raise HexadError(f"/{'/'.join(place)}/path: give (vertices, faces) or (vertices, faces, counts)")
        vertices, faces = given[0], given[1]
        job.add_mesh(name, vertices, *((faces, given[2]) if len(given) == 3 else with_counts(faces)))
    elif parent == "points":
        job.add_points(name, given)
    elif isinstance(given, tuple):
        job.add_grid(name, *given)
    else:
        job.add_grid(name, given)


def take_arrays(node: Any, place: tuple[str, ...], found: list[tuple[str, tuple[str, ...], Any]]) -> Any:
    """A copy of a part of a spec, with names in place of the arrays that are values of `path`."""
    if isinstance(node, Mapping):
        made = {}
        for key, value in node.items():
            if key == "path" and isinstance(value, os.PathLike):
                value = os.fspath(value)
            elif key == "path" and not isinstance(value, str):
                found.append((f"{'/'.join(place)} {len(found)}", place, value))
                value = found[-1][0]
            made[key] = take_arrays(value, (*place, key), found)
        return made
    if isinstance(node, (list, tuple)):
        return [take_arrays(item, place, found) for item in node]
    return node.item() if hasattr(node, "item") and getattr(node, "ndim", None) == 0 else \
        node.tolist() if hasattr(node, "tolist") else node


def members_of(kind: str) -> set[str]:
    """The members of a class of hexad.spec."""
    found = getattr(spec_module, kind)
    return {name for base in found.__mro__ for name in getattr(base, "__annotations__", {})}


def make_spec(surface: Any, faces: Any, affine: Any, keywords: Mapping[str, Any]) -> dict[str, Any]:
    """The spec of a mesh, a volume or a file, with keywords as members."""
    numpy = load_numpy()
    if isinstance(surface, (str, os.PathLike)):
        path: Any = os.path.abspath(os.fspath(surface))
        kind = kind_of_file(path)
    elif faces is not None:
        kind, path = "mesh", (surface, faces)
    elif numpy.ndim(surface) == 3:
        kind, path = "volume", (numpy.asarray(surface), affine)
    else:
        raise HexadError(f"an array of shape {numpy.shape(surface)} is no surface: give vertices and faces, a volume of three "
                         "dimensions, the name of a file, or a spec")
    if affine is not None and (kind != "volume" or isinstance(path, str)):
        raise HexadError("affine belongs to a volume that is an array: omit it")
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
            raise TypeError(f"{key} is a member neither of sampling nor of surface.{kind}: give a spec instead")
    if kind == "volume" and "isovalue" not in own:
        raise TypeError("a volume requires isovalue=: values above it are inside")
    return spec


def put(spec: dict[str, Any], group: str | None, key: str, value: Any) -> None:
    """Sets a member that is given as a keyword."""
    if value is None:
        return
    if group is None:
        spec[key] = value
    else:
        spec[group] = {**spec.get(group, {}), key: value}


def run(spec: Mapping[str, Any], directory: PathLike | None, roots: Sequence[PathLike], progress: Progress | None) -> Sampled:
    found: list[tuple[str, tuple[str, ...], Any]] = []
    job = Job(with_version(take_arrays(spec, (), found)))
    for name, place, given in found:
        add_array(job, name, place, given)
    job.set_places(os.fspath(directory) if directory else None, [os.fspath(root) for root in roots])
    job.run(progress)
    return Sampled(job.arrays(), job.report())


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
        vertices (V, 3) with `faces` (F, n), or a list of polygons
        a volume of three dimensions, axes i, j, k, with isovalue=; affine: from indices to space, (4, 4), as nibabel has it
        the name of a file, which hexad-worker reads
        a spec, in which each `path` may be an array: (vertices, faces), (values, affine) or values, and rows of points
    seed, threads, region, attributes, mesh: members of the spec; mesh=True: triangles between the points
    properties: output.ply.properties of the spec: the names of the properties that the points have (default: all). "minimal": positions
        and normals. Without `kappa` the curvature of a mesh is not computed, which saves time
    directory, roots: where files are, and below which directories they must be; for a spec
    progress: a function of the phase and the fraction; if its result is true, the call is cancelled
    count: the number of points
    keywords: further members of `sampling` (spacing, curvature, pattern, points, ...) and of the surface (isovalue, features, ...)

    A call that fails raises JobFailed with a code. The outcomes unresolved and not_converged are warnings (OutcomeWarning), and so
    are the warnings of the report about the surface (SurfaceWarning).
    """
    made = sample_quietly(surface, faces, count=count, affine=affine, seed=seed, threads=threads, region=region, attributes=attributes,
                          mesh=mesh, properties=properties, directory=directory, roots=roots, progress=progress, **keywords)
    for text in dict.fromkeys(made.warnings):
        warnings.warn(text, SurfaceWarning, 2)
    if made.outcome != CONVERGED:
        warnings.warn(f"the outcome is {made.outcome}: {first_reason(made)}", OutcomeWarning, 2)
    return made


def sample_quietly(surface: Any, faces: Any = None, *, count: int | None = None, affine: Any = None, seed: int | None = None,
                   threads: int | None = None, region: Any = None, attributes: Any = None, mesh: bool | None = None,
                   properties: Properties | None = None, directory: PathLike | None = None, roots: Sequence[PathLike] = (),
                   progress: Progress | None = None, **keywords: Any) -> Sampled:
    """`sample` without Python's warnings, whose filters belong to the whole process."""
    members: dict[str, Any] = dict(keywords)
    if count is not None:
        members["count"] = count
    if isinstance(surface, Mapping):
        if faces is not None or affine is not None or members:
            raise TypeError("a spec has all members: put these into it: " +
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
    if properties is not None:
        put(spec, "output", "ply", {**spec.get("output", {}).get("ply", {}), "properties": properties})
    return run(spec, directory, roots, progress)


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


def sample_many(surfaces: Iterable[Surface], count: int = 2048, *, processors: int | None = None,
                **keywords: Unpack[Keywords]) -> Samples:
    """The same number of points on each of many surfaces: `sample_many([(vertices, faces), ...], count=2048)`.

    surfaces: of each what `sample` takes: (vertices, faces), a volume, the name of a file, or a spec
    processors: how many surfaces are sampled at a time, with one thread each; default: all
    keywords: those of `sample`

    A surface that fails has NaN, and its exception in `errors`.
    """
    listed = list(surfaces)
    made = Samples(len(listed), count)
    stopped: list[bool] = []
    reasons: dict[int, str] = {}  # of outcomes
    texts: dict[int, str] = {}  # of surfaces
    follow = keywords.get("progress")

    def hear(phase: str, fraction: float) -> bool:
        return bool(stopped) or bool(follow and follow(phase, fraction))

    def one(k: int) -> None:
        surface = listed[k]
        pair = surface if isinstance(surface, (tuple, list)) else (surface,)
        members: dict[str, Any] = {"threads": 1, "properties": "minimal", **keywords, "progress": hear}
        if not isinstance(pair[0], Mapping):
            members["count"] = count
        try:
            points = sample_quietly(*pair, **members)
            if points.count != count:
                raise HexadError(f"surface {k} has {points.count} points instead of {count}")
            made.positions[k], made.normals[k] = points.positions, points.normals
            made.outcomes[k] = points.outcome
            if points.outcome != CONVERGED:
                reasons[k] = first_reason(points)
            if points.warnings:
                texts[k] = points.warnings[0]
        except HexadError as fault:
            made.errors[k] = fault

    with concurrent.futures.ThreadPoolExecutor(processors or len(os.sched_getaffinity(0)), "hexad") as pool:
        waiting = [pool.submit(one, k) for k in range(len(listed))]
        try:
            for done in waiting:
                done.result()
        except BaseException:
            stopped.append(True)
            for left in waiting:
                left.cancel()
            raise
    warn_of_batch(made, SurfaceWarning, texts, "has warnings", "have warnings")
    for outcome in ("unresolved", "not_converged"):
        warn_of_batch(made, OutcomeWarning, {k: text for k, text in reasons.items() if made.outcomes[k] == outcome},
                      f"is {outcome}", f"are {outcome}")
    return made
