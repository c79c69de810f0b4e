# SPDX-License-Identifier: Apache-2.0
"""The clocks of a program that a test starts, which the test sets (set_clock.c)."""
import mmap
import os
import pathlib
import shutil
import struct
import subprocess


def why_not():
    """Why the clock cannot be set here; None when it can."""
    return None if shutil.which("cc") else "no cc"


class Clock:
    """`environment` is for the program; step() sets its wall clock forward or back, and step_monotonic() the monotonic one, which
    each reading advances by `per_reading` seconds."""

    def __init__(self, where, per_reading=0):
        library, self.path = pathlib.Path(where) / "set_clock.so", pathlib.Path(where) / "clock"
        subprocess.run(["cc", "-O1", "-shared", "-fPIC", "-o", library, pathlib.Path(__file__).parent / "set_clock.c"], check=True)
        self.path.write_bytes(struct.pack("3q", 0, 0, round(1000 * per_reading)))
        with open(self.path, "r+b") as file:
            self.map = mmap.mmap(file.fileno(), 24)
        self.environment = {**os.environ, "LD_PRELOAD": str(library), "HEXAD_SET_CLOCK": str(self.path)}

    def step(self, seconds):
        self._add(0, seconds)

    def step_monotonic(self, seconds):
        self._add(1, seconds)

    def _add(self, index, seconds):
        ahead, = struct.unpack_from("q", self.map, 8 * index)
        struct.pack_into("q", self.map, 8 * index, ahead + round(1000 * seconds))
