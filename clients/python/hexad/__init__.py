# SPDX-License-Identifier: Apache-2.0
"""hexad turns surfaces into points: a function on arrays (`sample`), and a client of the service."""
from .client import Client, RemoteJob
from .errors import Damaged, FaultWarning, HexadError, JobFailed, OutcomeWarning, Problem, SurfaceWarning, Unreachable, WaitTimeout
from .events import Event
from .job import Job, Result, Service
from .local import Local
from .points import Points, Stack, obj_of, read_ply
from .sample import Sampled, Samples, sample, sample_many

__all__ = ["Client", "Damaged", "Event", "FaultWarning", "HexadError", "Job", "JobFailed", "Local", "OutcomeWarning", "Points", "Problem",
           "RemoteJob", "Result", "Sampled", "Samples", "Service", "Stack", "SurfaceWarning", "Unreachable", "WaitTimeout", "obj_of", "read_ply", "sample", "sample_many"]
