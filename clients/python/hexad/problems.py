# SPDX-License-Identifier: Apache-2.0
"""The errors of the service, a class for each code. Written by generate.py; do not edit."""
from typing import Dict, Type

from .errors import Problem

__all__ = [
    "AttributeMissing",
    "BodyTooLarge",
    "Conflict",
    "DatabaseDamaged",
    "DigestMismatch",
    "Forbidden",
    "Gone",
    "GridAmbiguous",
    "GridMissing",
    "IdempotencyMismatch",
    "InputDamaged",
    "InputMissing",
    "InputUnsupported",
    "Internal",
    "IsovalueRequired",
    "JsonInvalid",
    "LimitMemory",
    "MediaTypeUnsupported",
    "MethodNotAllowed",
    "MisdirectedRequest",
    "NoSurface",
    "NotFound",
    "NotSupported",
    "OriginForbidden",
    "OutputTaken",
    "OutputUnwritable",
    "PathForbidden",
    "PreconditionFailed",
    "PriorityForbidden",
    "RangeNotSatisfiable",
    "RequestInvalid",
    "ResultsFull",
    "SpecInvalid",
    "StateLost",
    "StorageFull",
    "TooManyJobs",
    "TooManyRequests",
    "TooManySubmissions",
    "TooManyTasks",
    "Unauthorized",
    "Unavailable",
    "BY_CODE",
]


class JsonInvalid(Problem):
    """The body is not valid JSON (400)."""


class RequestInvalid(Problem):
    """The request is not valid (400)."""


class Unauthorized(Problem):
    """The caller is unknown (401)."""


class Forbidden(Problem):
    """The caller may not do this (403)."""


class OriginForbidden(Problem):
    """Pages of this origin may not send requests (403)."""


class PathForbidden(Problem):
    """Jobs may not use this path (403)."""


class NotFound(Problem):
    """The resource does not exist (404)."""


class MethodNotAllowed(Problem):
    """The method is not allowed here (405)."""


class Conflict(Problem):
    """The state of the job does not allow this (409)."""


class Gone(Problem):
    """The resource was removed from the service (410)."""


class OutputTaken(Problem):
    """A result of another user is in the output directory (409)."""


class PreconditionFailed(Problem):
    """The resource has changed (412)."""


class BodyTooLarge(Problem):
    """The body is too large (413)."""


class MediaTypeUnsupported(Problem):
    """The media type is not supported (415)."""


class RangeNotSatisfiable(Problem):
    """The range is beyond the end (416)."""


class MisdirectedRequest(Problem):
    """The request is for another host (421)."""


class IdempotencyMismatch(Problem):
    """The key was used for another request (422)."""


class DigestMismatch(Problem):
    """The bytes do not have the announced SHA-256 (422)."""


class SpecInvalid(Problem):
    """The job spec is not valid (422)."""


class NotSupported(Problem):
    """The job spec requests something that is not supported (422)."""


class InputMissing(Problem):
    """The input file is missing (422)."""


class InputUnsupported(Problem):
    """The format of the input is not supported (422)."""


class InputDamaged(Problem):
    """The input cannot be read (422)."""


class GridMissing(Problem):
    """The input has no such grid (422)."""


class AttributeMissing(Problem):
    """The input has no such attribute (422)."""


class GridAmbiguous(Problem):
    """The input has more than one such grid (422)."""


class IsovalueRequired(Problem):
    """The input needs an isovalue (422)."""


class NoSurface(Problem):
    """There is no surface (422)."""


class TooManyRequests(Problem):
    """The client or user has reached a limit of simultaneous requests (429)."""


class Unavailable(Problem):
    """The service cannot do this now (503)."""


class DatabaseDamaged(Problem):
    """The database of the service is damaged (503)."""


class StateLost(Problem):
    """The state directory of the service is lost (503)."""


class OutputUnwritable(Problem):
    """The service cannot write to the output directory (422)."""


class LimitMemory(Problem):
    """The job needs more memory than there is (422)."""


class TooManyJobs(Problem):
    """The user has too many jobs (429)."""


class TooManyTasks(Problem):
    """The user has too many tasks (429)."""


class ResultsFull(Problem):
    """The results have reached their bound (507)."""


class TooManySubmissions(Problem):
    """The user has submitted too many jobs (429)."""


class PriorityForbidden(Problem):
    """The caller may not give this priority (403)."""


class StorageFull(Problem):
    """The storage is full (507)."""


class Internal(Problem):
    """The service has failed (500)."""


BY_CODE: Dict[str, Type[Problem]] = {
    "json_invalid": JsonInvalid,
    "request_invalid": RequestInvalid,
    "unauthorized": Unauthorized,
    "forbidden": Forbidden,
    "origin_forbidden": OriginForbidden,
    "path_forbidden": PathForbidden,
    "not_found": NotFound,
    "method_not_allowed": MethodNotAllowed,
    "conflict": Conflict,
    "gone": Gone,
    "output_taken": OutputTaken,
    "precondition_failed": PreconditionFailed,
    "body_too_large": BodyTooLarge,
    "media_type_unsupported": MediaTypeUnsupported,
    "range_not_satisfiable": RangeNotSatisfiable,
    "misdirected_request": MisdirectedRequest,
    "idempotency_mismatch": IdempotencyMismatch,
    "digest_mismatch": DigestMismatch,
    "spec_invalid": SpecInvalid,
    "not_supported": NotSupported,
    "input_missing": InputMissing,
    "input_unsupported": InputUnsupported,
    "input_damaged": InputDamaged,
    "grid_missing": GridMissing,
    "attribute_missing": AttributeMissing,
    "grid_ambiguous": GridAmbiguous,
    "isovalue_required": IsovalueRequired,
    "no_surface": NoSurface,
    "too_many_requests": TooManyRequests,
    "unavailable": Unavailable,
    "database_damaged": DatabaseDamaged,
    "state_lost": StateLost,
    "output_unwritable": OutputUnwritable,
    "limit_memory": LimitMemory,
    "too_many_jobs": TooManyJobs,
    "too_many_tasks": TooManyTasks,
    "results_full": ResultsFull,
    "too_many_submissions": TooManySubmissions,
    "priority_forbidden": PriorityForbidden,
    "storage_full": StorageFull,
    "internal": Internal,
}
