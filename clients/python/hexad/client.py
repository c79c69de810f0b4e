# SPDX-License-Identifier: Apache-2.0
"""A service that is reached over REST."""
from __future__ import annotations

import hashlib
import http.client
import pathlib
import ssl
import time
import urllib.parse
import uuid
import warnings
from typing import Any, Iterator, Sequence

from .errors import FaultWarning, HexadError, Problem, WaitTimeout
from .events import Event, follow
from .job import AnySpec, Job, PathLike, Result, Service, chunks_of, hash_file, save, wait_as_asked, with_version
from .problems import Conflict, NotFound
from .transport import Transport, body_of, with_query

__all__ = ["Client", "RemoteJob"]

LONGEST_WAIT_S = 30.0
FAULTS_WITHIN_S = 0.2  # what a submission may take longer for a look at its inputs


class RemoteJob(Job):
    """A job of a service."""

    def __init__(self, transport: Transport, document: dict[str, Any]) -> None:
        super().__init__(document)
        self.transport = transport
        self.path = f"/v1/jobs/{self.id}"

    @property
    def spec(self) -> dict[str, Any] | None:
        """With its defaults; None: of another user."""
        if "spec" not in self.document:
            self.refresh()
        spec: dict[str, Any] | None = self.document["spec"]
        return spec

    def refresh(self) -> RemoteJob:
        self.document = self.transport.get(self.path)
        return self

    def wait(self, timeout: float | None = None, check: bool = True) -> RemoteJob:
        end = None if timeout is None else time.monotonic() + timeout
        step = min(LONGEST_WAIT_S, self.transport.timeout / 2)
        while not self.has_ended:
            left = step if end is None else min(step, end - time.monotonic())
            if left < 0:
                raise WaitTimeout(f"the wait for job {self.id} ended after {timeout} s; the job is {self.state} and goes on: wait again")
            self.document = self.transport.get(self.path, headers={"Prefer": f"wait={max(1, round(left))}"})
        if check:
            self.check()
        return self

    def events(self, after: str | None = None) -> Iterator[Event]:
        return follow(self.transport, f"{self.path}/events", {}, after, whole_job=True)

    def command(self, word: str, repeat: bool = True) -> RemoteJob:
        self.document = self.transport.send("POST", f"{self.path}/{word}", repeat=repeat)
        return self

    def cancel(self) -> RemoteJob:
        try:
            return self.command("cancel")
        except Conflict:
            if self.refresh().state != "cancelled":  # before, perhaps by a request whose answer was lost
                raise
            return self

    def pause(self) -> RemoteJob:
        """Starts no attempt of it until it is resumed."""
        return self.command("pause")

    def resume(self) -> RemoteJob:
        return self.command("resume")

    def retry(self, dependents: bool = False) -> RemoteJob:
        """Runs what has failed of it again; with `dependents` also the jobs that failed because of it. What became of these
        is in `document["dependents"]`."""
        return self.command("retry?dependents=1" if dependents else "retry", repeat=False)

    def deliver(self) -> RemoteJob:
        """Has its results copied to its output directory again. The member `delivery` of its document says what became of that."""
        return self.command("deliver", repeat=False)

    def edit(self, **members: Any) -> RemoteJob:
        """Changes `priority`, `labels`, `retention_s`, `accept` or `max_running`."""
        self.document = self.transport.send("PATCH", self.path, members)
        return self

    def delete(self) -> None:
        """Deletes a job that has ended, with its results."""
        self.transport.send("DELETE", self.path, repeat=False)

    def log(self, frame: int | None = None) -> str:
        path = f"{self.path}/log" + ("" if frame is None else f"?frame={frame}")
        return self.transport.ask("GET", path, read=lambda response: response.read().decode("utf-8", "replace"))

    def tasks(self) -> Iterator[dict[str, Any]]:
        """How far each frame is."""
        after = None
        while True:
            page = self.transport.get(f"{self.path}/tasks", {"after": after, "limit": 500})
            yield from page["tasks"]
            after = page["next"]
            if after is None:
                return

    def frames(self) -> Sequence[int | None]:
        if not self.document["array"]:
            return [None]
        return [task["frame"] for task in self.tasks() if task["state"] == "succeeded"]

    def file_names(self) -> list[tuple[int | None, str, bool]]:
        return [(task.get("frame"), str(task.get("file", task.get("frame", self.id))), task["state"] == "succeeded") for task in self.tasks()]

    def results(self, frame: int | None = None) -> list[Result]:
        listed = self.transport.get(f"{self.path}/results", {"frame": frame})["results"]
        return [Result(r["name"], r["bytes"], r["sha256"], frame) for r in listed]

    def fetch_file(self, result: Result, path: pathlib.Path) -> None:
        # the service keeps undelivered results longer, so it is notified of a file that is here already
        known = path.is_file() and path.stat().st_size == result.bytes and hash_file(path) == result.sha256
        query = "" if result.frame is None else f"?frame={result.frame}"

        def read(response: http.client.HTTPResponse) -> None:
            if response.status != 304:
                save(result, chunks_of(response), path)

        self.transport.ask("GET", f"{self.path}/results/{urllib.parse.quote(result.name)}{query}",
                           headers={"If-None-Match": f'"{result.sha256}"'} if known else {}, read=read)


class Client(Service):
    """A service.

    server: unix:PATH, http://HOST:PORT or https://HOST:PORT; by default HEXAD_SERVER, or the socket of the system's service
    token: for TCP, by default HEXAD_TOKEN
    timeout: seconds of silence after which a connection is given up
    patience: seconds for which a request whose answer is lost is repeated; a submission is repeated with a key, so that
        there is one job
    context: of TLS
    """

    def __init__(self, server: str | None = None, token: str | None = None, *, timeout: float = 60.0,
                 patience: float = 60.0, context: ssl.SSLContext | None = None) -> None:
        self.transport = Transport(server, token, timeout, patience, context)

    def submit(self, spec: AnySpec, wait: bool | float = False, key: str | None = None) -> RemoteJob:
        """Submits a job. If the service finds a fault of its inputs within 0.2 s, such as a wrong grid, there is a FaultWarning."""
        fault = self.fault_of(spec)
        headers = {"Idempotency-Key": key or uuid.uuid4().hex}
        job = RemoteJob(self.transport, self.transport.send("POST", "/v1/jobs", with_version(spec), headers))
        if fault:
            warnings.warn(f"job {job.id} is accepted, and fails if this is still so when it runs: {fault}", FaultWarning, stacklevel=2)
        wait_as_asked(job, wait)
        return job

    def fault_of(self, spec: AnySpec) -> Problem | None:
        """Why a job would fail, where the service finds that out at once; no answer counts as none."""
        asker = Transport(self.transport.server, self.transport.token, FAULTS_WITHIN_S, 0, self.transport.context)
        try:
            asker.send("POST", f"/v1/jobs:validate?within_ms={1000 * FAULTS_WITHIN_S:.0f}", with_version(spec), repeat=False)
        except Problem as problem:
            return problem if problem.status == 422 else None
        except HexadError:
            pass
        return None

    def job(self, id: str) -> RemoteJob:
        return RemoteJob(self.transport, self.transport.get(f"/v1/jobs/{urllib.parse.quote(id)}"))

    def jobs(self, **filters: Any) -> Iterator[RemoteJob]:
        """The jobs, the newest first. Filters are those of the list in REST: `state`, `owner`, `label`, `name`, `text`,
        `depends_on`, `created_after`, `created_before`; and `sort`."""
        cursor = None
        while True:
            page = self.transport.get("/v1/jobs", {**filters, "limit": 500, "cursor": cursor})
            for document in page["jobs"]:
                yield RemoteJob(self.transport, document)
            cursor = page["next"]
            if cursor is None:
                return

    def events(self, after: str | None = None, **filters: Any) -> Iterator[Event]:
        """What happens to the caller's jobs, from now on or after the event with this id; without an end. Filters: `job`,
        `owner`, `label`, and `progress=1` for progress as well."""
        return follow(self.transport, "/v1/events", filters, after, whole_job=False)

    def upload(self, file: PathLike | bytes, suffix: str | None = None, again: bool = False) -> str:
        """As of any Service. `again`: sends the bytes also if the service has the file, and replaces it if it is damaged."""
        if isinstance(file, bytes):
            return self.send(hashlib.sha256(file).hexdigest(), file, None, again) + (suffix or "")
        path = pathlib.Path(file)
        ending = "".join(path.suffixes[-2:]) if path.suffix == ".gz" else path.suffix
        return self.send(hash_file(path), path, path.name, again) + (ending if suffix is None else suffix)

    def send(self, sha256: str, body: bytes | pathlib.Path, name: str | None, again: bool) -> str:
        try:
            known = self.transport.get(f"/v1/inputs/{sha256}")
            if not again and known["sent"] is not None and (name is None or known["name"] == name):
                return str(known["path"])
            body = body if again else b""  # the service has the file; it becomes an upload of the caller, or gets another name
        except NotFound:
            pass
        where = with_query(f"/v1/inputs/{sha256}", {"name": name})
        known = self.transport.ask("PUT", where, body, {"Content-Type": "application/octet-stream"}, read=body_of)
        return str(known["path"])

    def uploads(self) -> Iterator[dict[str, Any]]:
        """The uploads of the caller, the newest first: name, path, length, times, and the caller's jobs that read the file."""
        cursor = None
        while True:
            page = self.transport.get("/v1/inputs", {"limit": 500, "cursor": cursor})
            yield from page["inputs"]
            cursor = page["next"]
            if cursor is None:
                return

    def delete_upload(self, path: str) -> None:
        """Deletes an upload of the caller, given by its path in a spec. Jobs that have not ended can still read it."""
        sha256 = path.removeprefix("sha256:").partition(".")[0]
        self.transport.send("DELETE", f"/v1/inputs/{urllib.parse.quote(sha256)}")

    def validate(self, spec: AnySpec) -> dict[str, Any]:
        """Checks a spec as submit would: the spec with its defaults, and an estimate."""
        answer: dict[str, Any] = self.transport.send("POST", "/v1/jobs:validate", with_version(spec))
        return answer

    def estimate(self, spec: AnySpec) -> dict[str, Any]:
        answer = self.validate(spec)
        if answer["estimate"] is None:
            raise HexadError(f"the spec is valid, and the job was not estimated: {answer['estimate_missing']}")
        estimate: dict[str, Any] = answer["estimate"]
        return estimate

    def inspect(self, path: str) -> dict[str, Any]:
        answer: dict[str, Any] = self.transport.send("POST", "/v1/inputs:inspect", {"path": path})
        return answer

    def version(self) -> str:
        return str(self.transport.get("/version")["version"])
