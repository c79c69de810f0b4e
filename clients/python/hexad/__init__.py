# SPDX-License-Identifier: Apache-2.0
"""A client of hexad, the service that turns surfaces into points."""
from .client import Client, RemoteJob
from .errors import Damaged, FaultWarning, HexadError, JobFailed, Problem, Unreachable, WaitTimeout
from .events import Event
from .job import Job, Result, Service
from .local import Local
from .points import Points, obj_of, read_ply

__all__ = ["Client", "Damaged", "Event", "FaultWarning", "HexadError", "Job", "JobFailed", "Local", "Points", "Problem", "RemoteJob",
           "Result", "Service", "Unreachable", "WaitTimeout", "obj_of", "read_ply"]
