# SPDX-License-Identifier: Apache-2.0
"""hexad turns surfaces into points.

`sample` is a function on arrays of NumPy, and needs no service:

    >>> import hexad
    >>> points = hexad.sample(vertices, faces, count=10_000)      # a mesh: (V, 3) and (F, 3)
    >>> points = hexad.sample(volume, isovalue=0.5, count=10_000)
    >>> points.positions, points.normals, points["spacing_local"], points.outcome, points.report

help(hexad.sample) lists its arguments. `sample_many` puts the same number of points on each of many surfaces.

`Client` is a client of the service, and `Local` runs the same jobs on this machine.
"""
from .client import Client, RemoteJob
from .errors import Damaged, FaultWarning, HexadError, JobFailed, OutcomeWarning, Problem, RowWarning, SurfaceWarning, Unreachable, WaitTimeout
from .events import Event
from .job import Job, Result, Service
from .local import Local
from .points import Points, Stack, obj_of, read_ply
from .sample import Sampled, Samples, sample, sample_many

__all__ = ["Client", "Damaged", "Event", "FaultWarning", "HexadError", "Job", "JobFailed", "Local", "OutcomeWarning", "Points", "Problem",
           "RemoteJob", "Result", "RowWarning", "Sampled", "Samples", "Service", "Stack", "SurfaceWarning", "Unreachable", "WaitTimeout", "obj_of", "read_ply", "sample", "sample_many"]
