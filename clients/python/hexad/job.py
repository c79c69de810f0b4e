# SPDX-License-Identifier: Apache-2.0
"""What jobs of a service and of this machine have in common."""
from __future__ import annotations

import hashlib
import json
import os
import pathlib
import tempfile
import threading
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, BinaryIO, Iterable, Iterator, Mapping, Sequence, Union

from .errors import Damaged, HexadError, JobFailed
from .events import ENDED, Event
from .points import Points, Stack, read_ply
from .spec import Spec

__all__ = ["AnySpec", "Job", "PathLike", "Result", "Service"]

PathLike = Union[str, "os.PathLike[str]"]
AnySpec = Union[Spec, Mapping[str, Any]]
CHUNK = 1 << 20


@dataclass(frozen=True)
class Result:
    """A file of a result; `frame` is None of a job without frames."""

    name: str
    bytes: int
    sha256: str
    frame: int | None


def hash_file(path: pathlib.Path) -> str:
    if path.exists() and not path.is_file():  # an open of a pipe would wait
        raise OSError(f"{path} is not a regular file: give the path of a file")
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        for chunk in iter(lambda: file.read(CHUNK), b""):
            digest.update(chunk)
    return digest.hexdigest()


def save(result: Result, chunks: Iterable[bytes], path: pathlib.Path) -> None:
    """Writes a file under a temporary name; it gets its own once its hash is the announced one."""
    digest = hashlib.sha256()
    part = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}")
    try:
        with open(part, "wb") as file:
            for chunk in chunks:
                digest.update(chunk)
                file.write(chunk)
        if digest.hexdigest() != result.sha256:
            raise Damaged(f"{result.name}: the received bytes do not have the SHA-256 that the service states: the file is damaged in the "
                          "service, or on the way. Submit the job again, which computes it again; to fetch it again helps only against "
                          "damage on the way.")
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def chunks_of(file: BinaryIO) -> Iterator[bytes]:
    return iter(lambda: file.read(CHUNK), b"")


class Job(ABC):
    """A job. Its state is that of the last look; `refresh` and `wait` look again."""

    def __init__(self, document: dict[str, Any]) -> None:
        self.document = document

    @property
    def id(self) -> str:
        return str(self.document["id"])

    @property
    def name(self) -> str | None:
        """The name in its spec."""
        name: str | None = self.document["name"]
        return name

    @property
    def state(self) -> str:
        """`blocked`, `queued`, `running`, and at its end `succeeded`, `failed`, `cancelled` or `timed_out`."""
        return str(self.document["state"])

    @property
    def outcome(self) -> str | None:
        """The outcome of a succeeded job: `converged`, `unresolved` or `not_converged`; else None."""
        outcome: str | None = self.document["outcome"]
        return outcome

    @property
    def accepted(self) -> bool | None:
        """Whether `queue.accept` of its spec contains the outcomes of all frames; None: it has not succeeded."""
        accepted: bool | None = self.document["accepted"]
        return accepted

    @property
    def error(self) -> dict[str, Any] | None:
        """The `code` and `message` of a failed job."""
        error: dict[str, Any] | None = self.document["error"]
        return error

    @property
    def has_ended(self) -> bool:
        return self.state in ENDED

    def __repr__(self) -> str:
        return f"<job {self.id}: {self.outcome or self.state}>"

    def check(self) -> None:
        """Raises JobFailed of a job that has ended without a result."""
        if self.has_ended and self.state != "succeeded":
            raise JobFailed(self.id, self.state, self.error)

    @abstractmethod
    def refresh(self) -> Job:
        """Looks again."""

    @abstractmethod
    def wait(self, timeout: float | None = None, check: bool = True) -> Job:
        """Waits until the job has ended. WaitTimeout: it has not in this time. JobFailed: it has no result, if `check`."""

    @abstractmethod
    def events(self, after: str | None = None) -> Iterator[Event]:
        """What happens to the job, and its progress, until its end; `after`: the id of the last event that is known."""

    @abstractmethod
    def cancel(self) -> Job:
        """Ends it. hexad.problems.Conflict: it has ended otherwise."""

    @abstractmethod
    def log(self, frame: int | None = None) -> str:
        """The end of the log of its worker."""

    @abstractmethod
    def frames(self) -> Sequence[int | None]:
        """The frames that have results; of a job without frames None, once it has some."""

    @abstractmethod
    def file_names(self) -> list[tuple[int | None, str, bool]]:
        """Each frame, the name of its file (`queue.files`; of other arrays its number), and whether it has a result."""

    @abstractmethod
    def results(self, frame: int | None = None) -> list[Result]:
        """The files of a result."""

    @abstractmethod
    def fetch_file(self, result: Result, path: pathlib.Path) -> None:
        """Brings one file here, verified by its hash, unless it is here."""

    def fetch(self, directory: PathLike, frame: int | None = None) -> list[pathlib.Path]:
        """Brings all files of a result here, each verified by its hash, report.json last. Frames go into directories of
        their own below, and the USD stage of all frames into the directory itself; files that are here already are not
        brought again."""
        paths = []
        for each in self.frames() if frame is None else [frame]:
            where = pathlib.Path(directory) / ("" if each is None else str(each))
            where.mkdir(parents=True, exist_ok=True)
            for result in self.results(each):
                if result.name.startswith(".") or "/" in result.name or "\\" in result.name:
                    raise HexadError(f"job {self.id} has a result whose name contains a path, {result.name!r}: report this as a fault")
                path = (pathlib.Path(directory) if result.name.endswith("_stage.usda") else where) / result.name
                self.fetch_file(result, path)
                paths.append(path)
        return paths

    def fetch_named(self, name: str, frame: int | None, directory: str) -> pathlib.Path:
        for result in self.results(frame):
            if result.name == name:
                path = pathlib.Path(directory) / "file"
                self.fetch_file(result, path)
                return path
        raise HexadError(f"job {self.id} has no result {name}: results() lists its files")

    def read(self, name: str, frame: int | None = None) -> bytes:
        """The bytes of one file of a result."""
        with tempfile.TemporaryDirectory() as directory:
            return self.fetch_named(name, frame, directory).read_bytes()

    def report(self, frame: int | None = None) -> dict[str, Any]:
        """report.json: how good the points are."""
        document: dict[str, Any] = json.loads(self.read("report.json", frame))
        return document

    def outcome_reasons(self, frame: int | None = None) -> list[dict[str, Any]]:
        """The criteria of the outcome that failed: `criterion`, `value`, `bound` and `message` of each."""
        reasons: list[dict[str, Any]] = self.report(frame)["outcome_reasons"]
        return reasons

    def ratings(self, frame: int | None = None) -> dict[str, dict[str, Any]]:
        """How regular the packing is: of each measure its `value` and its `rating`, `good`, `fair`, `poor` or None. Results of
        builds without ratings have none."""
        ratings: dict[str, dict[str, Any]] = self.report(frame).get("ratings", {})
        return ratings

    def points(self, frame: int | None = None, name: str = "points.ply") -> Points:
        """The points, as arrays; `mesh.ply` has triangles as well."""
        with tempfile.TemporaryDirectory() as directory:
            return read_ply(self.fetch_named(name, frame, directory))


    def stack(self, name: str = "points.ply") -> Stack:
        """The points of all frames, in arrays with a row for each frame that has a result. ValueError: two results have unequal numbers
        of points, or other properties."""
        frames = self.file_names()
        there = [(frame, text) for frame, text, has_result in frames if has_result]
        sets = ((text, self.points(frame, name)) for frame, text in there)
        return Stack(sets, [frame for frame, _ in there], [text for _, text, has_result in frames if not has_result])


class Service(ABC):
    """Where jobs run: hexad.Client or hexad.Local."""

    @abstractmethod
    def submit(self, spec: AnySpec, wait: bool | float = False, key: str | None = None) -> Job:
        """Begins a job. `wait`: true waits for its end, as Job.wait does; a number is a limit in seconds. `key`: a name for this submission;
        when it is repeated, it returns the same job. A spec with a fault is a Problem; its `errors` say where."""

    @abstractmethod
    def jobs(self) -> Iterator[Job]:
        """The jobs, the newest first."""

    @abstractmethod
    def upload(self, file: PathLike | bytes, suffix: str | None = None) -> str:
        """Makes a file readable for jobs; returns the path by which a spec names it. `suffix`: such as ".obj", of bytes."""

    @abstractmethod
    def estimate(self, spec: AnySpec) -> dict[str, Any]:
        """The points, memory and time that a job takes."""

    @abstractmethod
    def inspect(self, path: str) -> dict[str, Any]:
        """The contents of a file, and specs that sample it. `path`: as a spec names it."""


def wait_as_asked(job: Job, wait: bool | float) -> None:
    """What `wait` of submit means."""
    if wait is not False:
        job.wait(None if wait is True else wait)


def with_version(spec: AnySpec) -> dict[str, Any]:
    return {"version": 1, **spec}
