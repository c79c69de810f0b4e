# SPDX-License-Identifier: Apache-2.0
"""Jobs on this machine without a service: hexad-worker, one process for each job or frame."""
from __future__ import annotations

import hashlib
import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import threading
import time
import uuid
from typing import Any, Iterator, Sequence

from .errors import HexadError, Problem, WaitTimeout
from .events import Event
from .job import AnySpec, Job, PathLike, Result, Service, chunks_of, hash_file, save, wait_as_asked, with_version
from .library import own_file
from .problems import BY_CODE, Conflict, IdempotencyMismatch

__all__ = ["Local", "LocalJob"]

SUCCEEDED = (0, 10, 11)  # exit codes of the worker
OUTCOMES = ("converged", "unresolved", "not_converged")  # from best to worst
BAD_SPEC, NO_SURFACE, CANCELLED = 2, 4, 6


def frames_of(text: str) -> list[int]:
    """The numbers of "1-100x2,200"."""
    if text == "all":
        raise ValueError('only a service finds the numbers of the frames "all": write the numbers')
    numbers: list[int] = []
    for part in text.split(","):
        ends, _, step = part.partition("x")
        first, _, last = ends.partition("-")
        numbers += range(int(first), int(last or first) + 1, int(step or 1))
    return numbers


def files_of(files: Any) -> list[str]:
    """The names of a data set."""
    if isinstance(files, str):
        raise ValueError("only a service finds the names of a pattern: write a list")
    return [str(name) for name in files]


def last_words(log: pathlib.Path) -> dict[str, Any]:
    """Why a worker has failed: the object that it ends with."""
    try:
        words = json.loads(log.read_text("utf-8", "replace").splitlines()[-1])
    except (IndexError, ValueError):
        words = None
    return words if isinstance(words, dict) else {"code": "internal", "message": f"the worker has failed: see {log}"}


def refusal_of(words: dict[str, Any]) -> Problem:
    """What a service would answer."""
    return BY_CODE.get(words["code"], Problem)(422, {**words, "detail": words["message"]})


class LocalJob(Job):
    """A job of this machine. A thread runs its frames, one after another."""

    def __init__(self, local: Local, id: str, spec: dict[str, Any]) -> None:
        super().__init__({"id": id, "name": spec.get("name"), "state": "queued", "outcome": None, "accepted": None,
                          "error": None, "spec": spec})
        self.local, self.spec = local, spec
        queue = spec.get("queue", {})
        self.coherent = bool(queue.get("coherent"))
        self.files = files_of(queue["files"]) if "files" in queue else []
        self.all_frames: list[int | None] = ([*frames_of(queue["frames"])] if "frames" in queue else
                                             [*range(len(self.files))] if self.files else [None])
        self.directory = local.directory / id
        self.done: list[int | None] = []
        self.told: list[Event] = []
        self.refusal: Problem | None = None
        self.process: subprocess.Popen[bytes] | None = None
        self.changed = threading.Condition()
        self.thread = threading.Thread(target=self.run, name=f"hexad {id}", daemon=True)
        self.tell("state", state="queued", outcome=None)

    # ---- in the job's thread

    def tell(self, kind: str, **members: Any) -> None:
        with self.changed:
            self.told.append(Event(str(len(self.told) + 1), kind, {"job": self.id, **members}))
            self.changed.notify_all()

    def enter(self, state: str, outcome: str | None = None, error: dict[str, Any] | None = None) -> None:
        with self.changed:
            if self.has_ended:
                return
            self.document.update(state=state, outcome=outcome, error=error)
            self.tell("state", state=state, outcome=outcome)

    def place_of(self, frame: int | None) -> pathlib.Path:
        return self.directory / ("result" if frame is None else str(frame))

    def log_of(self, frame: int | None) -> pathlib.Path:
        return self.directory / ("worker.log" if frame is None else f"worker.{frame}.log")

    def run(self) -> None:
        try:
            failed: tuple[int, int | None] | None = None  # the first: exit code and frame
            for frame in self.all_frames:
                code = self.run_frame(frame)
                if code in SUCCEEDED:
                    self.done.append(frame)
                    continue
                if self.coherent and code == NO_SURFACE:
                    continue  # the frame is passed over, as the service does
                failed = failed or (code, frame)
                if self.coherent or code == CANCELLED:
                    break
            self.settle(failed)
        except Exception as fault:
            self.enter("failed", None, {"code": "internal", "message": str(fault)})
        finally:
            self.local.places.release()

    def run_frame(self, frame: int | None) -> int:
        place = self.place_of(frame)
        words = [self.local.worker, "run", "-", "--output", str(place), *self.local.options]
        if frame is not None:
            words += ["--frame", str(frame)]
        if self.coherent and self.done:
            words += ["--previous", str(self.place_of(self.done[-1]))]
        read_end, write_end = os.pipe()
        with open(read_end, "rb") as progress, open(self.log_of(frame), "wb") as log:
            try:
                with self.changed:
                    if self.has_ended:
                        return CANCELLED
                    self.process = subprocess.Popen([*words, "--progress-fd", str(write_end)], stdin=subprocess.PIPE,
                                                    stderr=log, pass_fds=[write_end])
            finally:
                os.close(write_end)
            try:
                assert self.process.stdin
                with self.process.stdin as stdin:
                    stdin.write(json.dumps(self.spec).encode())
            except BrokenPipeError:
                pass  # it has ended: its exit code says why
            for line in progress:
                if self.state == "queued":
                    self.enter("running")
                self.tell("progress", frame=frame, progress=json.loads(line))
        return self.process.wait()

    def settle(self, failed: tuple[int, int | None] | None) -> None:
        if not failed:
            outcomes = [json.loads((self.place_of(f) / "report.json").read_bytes())["outcome"] for f in self.done]
            self.document["accepted"] = set(outcomes) <= set(self.spec.get("queue", {}).get("accept", OUTCOMES))
            self.enter("succeeded", max(outcomes, key=OUTCOMES.index, default=None))
            return
        code, frame = failed
        if code == CANCELLED:
            self.enter("cancelled")
            return
        words = last_words(self.log_of(frame))
        if code == BAD_SPEC:
            self.refusal = refusal_of(words)
        state = "timed_out" if words["code"] == "limit_time" else "failed"
        self.enter(state, None, {"code": words["code"], "message": words["message"]})

    # ---- in the threads of callers

    def wait_for_start(self) -> None:
        """Until the worker has accepted the spec or refused it."""
        with self.changed:
            self.changed.wait_for(lambda: self.state != "queued")
        if self.refusal:
            raise self.refusal

    def refresh(self) -> LocalJob:
        return self

    def wait(self, timeout: float | None = None, check: bool = True) -> LocalJob:
        with self.changed:
            if not self.changed.wait_for(lambda: self.has_ended, timeout):
                raise WaitTimeout(f"the wait for job {self.id} ended after {timeout} s; the job is {self.state} and goes on: wait again")
        if check:
            self.check()
        return self

    def events(self, after: str | None = None) -> Iterator[Event]:
        told = int(after or 0)
        while True:
            with self.changed:
                self.changed.wait_for(lambda: len(self.told) > told)
                news = self.told[told:]
            for event in news:
                yield event
                if event.is_end:
                    return
            told += len(news)

    def cancel(self) -> LocalJob:
        with self.changed:
            if self.has_ended and self.state != "cancelled":
                raise Conflict(409, {"code": "conflict", "detail": f"job {self.id} is {self.state}"})
            process = self.process
            if process and process.poll() is None:
                process.terminate()
            else:
                self.enter("cancelled")
        return self.wait(check=False)

    def log(self, frame: int | None = None) -> str:
        return self.log_of(frame).read_text("utf-8", "replace")

    def frames(self) -> Sequence[int | None]:
        return list(self.done)

    def file_names(self) -> list[tuple[int | None, str, bool]]:
        names = self.files or [self.id if frame is None else str(frame) for frame in self.all_frames]
        return [(frame, name, frame in self.done) for frame, name in zip(self.all_frames, names)]

    def results(self, frame: int | None = None) -> list[Result]:
        place = self.place_of(frame)
        report = place / "report.json"
        if not report.exists():
            raise HexadError(f"job {self.id} has no results" + ("" if frame is None else f" of frame {frame}"))
        listed = [Result(o["name"], o["bytes"], o["sha256"], frame) for o in json.loads(report.read_bytes())["outputs"]]
        return [*listed, Result("report.json", report.stat().st_size, hash_file(report), frame)]

    def fetch_file(self, result: Result, path: pathlib.Path) -> None:
        with open(self.place_of(result.frame) / result.name, "rb") as file:
            save(result, chunks_of(file), path)


class Local(Service):
    """Runs jobs on this machine with hexad-worker, without a service; the members are those of Client.

    worker: the program; by default HEXAD_WORKER, or hexad-worker of the wheel or on the PATH
    directory: where results and files that are made readable are kept; by default a temporary one, which goes with this
        object (a context manager)
    input_roots: directories that jobs may read from; by default paths are opened as they are
    workers: how many jobs may run at once; submit waits for a place
    """

    def __init__(self, worker: PathLike | None = None, directory: PathLike | None = None,
                 input_roots: Sequence[PathLike] = (), workers: int = 1) -> None:
        found = worker or os.environ.get("HEXAD_WORKER") or own_file("hexad-worker") or shutil.which("hexad-worker")
        if not found:
            raise HexadError("there is no hexad-worker on the PATH: install it, or set HEXAD_WORKER to its path")
        self.worker = os.fspath(found)
        self.temporary = None if directory else tempfile.TemporaryDirectory(prefix="hexad.")
        self.directory = pathlib.Path(directory or (self.temporary.name if self.temporary else "")).absolute()
        self.options = [word for root in input_roots for word in ("--input-root", os.fspath(root))]
        self.places = threading.BoundedSemaphore(workers)
        self.submitted: list[LocalJob] = []
        self.keys: dict[str, LocalJob] = {}

    def __enter__(self) -> Local:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Cancels what runs, and removes the temporary directory."""
        for job in self.submitted:
            if not job.has_ended:
                job.cancel()
            job.thread.join()
        if self.temporary:
            self.temporary.cleanup()

    def submit(self, spec: AnySpec, wait: bool | float = False, key: str | None = None) -> LocalJob:
        whole = with_version(spec)
        if key in self.keys:
            job = self.keys[key]
            if job.spec != whole:
                raise IdempotencyMismatch(422, {"code": "idempotency_mismatch", "detail": f"{key} names another submission"})
        else:
            job = self.start(whole)
            if key:
                self.keys[key] = job
        wait_as_asked(job, wait)
        return job

    def start(self, spec: dict[str, Any]) -> LocalJob:
        self.places.acquire()
        try:
            job = LocalJob(self, f"{time.time_ns():x}{uuid.uuid4().hex[:8]}", spec)
            job.directory.mkdir(parents=True)
            job.thread.start()
        except BaseException:
            self.places.release()
            raise
        job.wait_for_start()
        self.submitted.append(job)
        return job

    def jobs(self) -> Iterator[LocalJob]:
        return reversed(list(self.submitted))

    def upload(self, file: PathLike | bytes, suffix: str | None = None) -> str:
        if not isinstance(file, bytes):
            return str(pathlib.Path(file).absolute())
        path = self.directory / (hashlib.sha256(file).hexdigest() + (suffix or ""))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(file)
        return str(path)

    def ask(self, command: str, document: dict[str, Any], *words: str) -> dict[str, Any]:
        """The JSON document that the worker prints on standard output."""
        done = subprocess.run([self.worker, command, "-", *words, *self.options], input=json.dumps(document).encode(),
                              capture_output=True)
        if done.returncode == 0:
            answer: dict[str, Any] = json.loads(done.stdout)
            return answer
        raise refusal_of(json.loads(done.stderr.splitlines()[-1]))

    def estimate(self, spec: AnySpec) -> dict[str, Any]:
        with tempfile.TemporaryDirectory() as directory:
            return self.ask("estimate", with_version(spec), "--output", directory)

    def inspect(self, path: str) -> dict[str, Any]:
        return self.ask("inspect", {"path": path}, "--json")
