# SPDX-License-Identifier: Apache-2.0
"""What may go wrong. All are HexadError. What the service refuses is a Problem, of a class for its code (hexad.problems)."""
from __future__ import annotations

from typing import Any

__all__ = ["Damaged", "FaultWarning", "HexadError", "JobFailed", "OutcomeWarning", "Problem", "RowWarning", "SurfaceWarning", "Unreachable", "WaitTimeout"]


class HexadError(Exception):
    """Any fault.

    code: what is wrong, in a word that does not change; None: the client found it
    """

    code: str | None = None


class Unreachable(HexadError):
    """There was no answer, however often the client asked (`patience`)."""


class FaultWarning(UserWarning):
    """The inputs of a job that was accepted have a fault, with which it would fail."""


class OutcomeWarning(UserWarning):
    """The outcome of a call is not `converged`."""


class RowWarning(UserWarning):
    """A row of the arrays of frames is not the same point in each frame."""


class SurfaceWarning(UserWarning):
    """A warning in the report of a call: what hexad repaired, assumed or could not resolve."""


class Damaged(HexadError):
    """The bytes of a file do not have the hash that was announced."""


class WaitTimeout(HexadError, TimeoutError):
    """A job has not ended in the time that a caller wanted to wait."""


class Problem(HexadError):
    """The service refuses a request.

    code: what is wrong, in a word that does not change; such as `spec_invalid`
    status: of HTTP
    detail: what is wrong here, and what to do
    errors: of a spec, its faults: dicts with `pointer`, the place, and `detail`
    """

    def __init__(self, status: int, document: dict[str, Any]) -> None:
        self.status = status
        self.code = document.get("code", "unknown")
        self.detail: str = document.get("detail", "")
        self.errors: list[dict[str, str]] = document.get("errors", [])
        self._document = document
        super().__init__(f"{self.code}: {self.detail or document.get('title', status)}")

    def __reduce__(self) -> tuple[Any, ...]:  # a pool of processes returns exceptions as bytes
        return type(self), (self.status, self._document)


class JobFailed(HexadError):
    """A job has ended without a result.

    job: its id; "" of a call
    state: `failed`, `cancelled` or `timed_out`
    error: its `code` and `message`; None of a job that was cancelled before it ran
    code: of its error, such as `no_surface`
    """

    def __init__(self, job: str, state: str, error: dict[str, Any] | None) -> None:
        self.job, self.state, self.error = job, state, error
        self.code = error["code"] if error else None
        why = f"{error['code']}: {error['message']}" if error else ""
        super().__init__(why if not job else f"job {job} ended as {state}" + (f": {why}" if why else ""))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.job, self.state, self.error)
