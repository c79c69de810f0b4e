"""The wall clock of a program that a test starts, which the test sets (set_clock.c)."""
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
    """`environment` is for the program; step() sets its clock forward or back."""

    def __init__(self, where):
        library, self.path = pathlib.Path(where) / "set_clock.so", pathlib.Path(where) / "clock"
        subprocess.run(["cc", "-O1", "-shared", "-fPIC", "-o", library, pathlib.Path(__file__).parent / "set_clock.c"], check=True)
        self.path.write_bytes(struct.pack("q", 0))
        with open(self.path, "r+b") as file:
            self.map = mmap.mmap(file.fileno(), 8)
        self.environment = {**os.environ, "LD_PRELOAD": str(library), "HEXAD_SET_CLOCK": str(self.path)}

    def step(self, seconds):
        ahead, = struct.unpack("q", self.map[:])
        self.map[:] = struct.pack("q", ahead + round(1000 * seconds))
