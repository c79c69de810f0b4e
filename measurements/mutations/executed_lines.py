# SPDX-License-Identifier: Apache-2.0
"""Which lines of src each test executes, from a build that measurements/mutations/trace_blocks.c is linked to.

A traced program sets a byte for each basic block that it executes. The lines of a block are those of the line table
between the block's call of the tracing function and the next one in the same function.
"""
import array
import base64
import bisect
import collections
import mmap
import os
import pathlib
import re
import subprocess
import zlib

FUNCTION = re.compile(r"^([0-9a-f]+) <[^>]+>:$")
INSTRUCTION = re.compile(r"^ *([0-9a-f]+):\t(.*)$")
ROW = re.compile(r"^(\S+) +(\d+) +0x([0-9a-f]+)")


class Program:
    """A traced program: its blocks and their lines."""

    def __init__(self, path):
        listing = subprocess.run(["objdump", "-d", "--no-show-raw-insn", path], capture_output=True, text=True, check=True)
        starts, calls, called = [], [], None
        for line in listing.stdout.splitlines():
            found = INSTRUCTION.match(line)
            if found:
                if called is not None:
                    calls.append((called, int(found[1], 16)))
                called = int(found[1], 16) if "<__sanitizer_cov_trace_pc>" in found[2] else None
            elif FUNCTION.match(line):
                if called is not None:  # the call is the last instruction of a function
                    calls.append((called, called + 5))
                    called = None
                starts.append(int(FUNCTION.match(line)[1], 16))
        self.call_at = [call for call, _ in calls]
        self.returns = [after for _, after in calls]
        self.starts = starts
        self.size = (self.returns[-1] if calls else 0) + 1
        self.lines = collections.defaultdict(set)  # return address -> (file, line)
        self.read_rows(path)

    def block_of(self, address):
        """The return address of the block that has an address, or None."""
        f = bisect.bisect_right(self.starts, address) - 1
        if f < 0:
            return None
        end = self.starts[f + 1] if f + 1 < len(self.starts) else address + 1
        i = bisect.bisect_right(self.call_at, address) - 1
        if i < 0 or self.call_at[i] < self.starts[f]:
            i += 1  # before the first call of the function
        return self.returns[i] if i < len(self.call_at) and self.starts[f] <= self.call_at[i] < max(end, address) else None

    def read_rows(self, path):
        rows = subprocess.run(["readelf", "-W", "--debug-dump=decodedline", path], capture_output=True, text=True, check=True)
        unit = name = None
        for line in rows.stdout.splitlines():
            if line.startswith("CU: "):
                at = line.find("src/")
                unit = re.sub(r":.*$", "", line[at:]) if at >= 0 else None
                name = unit and unit.rsplit("/", 1)[-1]
                continue
            found = ROW.match(line)
            if found and unit and found[1] == name:
                block = self.block_of(int(found[3], 16))
                if block is not None:
                    self.lines[block].add((unit, int(found[2])))


def prepare(path, program, directory):
    """Makes the file in which a program records its blocks."""
    record = pathlib.Path(directory, pathlib.Path(path).name)
    record.write_bytes(bytes(program.size))
    record.chmod(0o666)


def pack(addresses):
    return base64.b64encode(zlib.compress(array.array("I", addresses).tobytes())).decode()


def unpack(text):
    found = array.array("I")
    found.frombytes(zlib.decompress(base64.b64decode(text)))
    return found


def take(directory):
    """The blocks that are recorded in the files of a directory, by program; clears them."""
    hits = {}
    for name in sorted(os.listdir(directory)):
        with open(os.path.join(directory, name), "r+b") as file:
            size = os.fstat(file.fileno()).st_size
            if size == 0:
                continue
            with mmap.mmap(file.fileno(), size) as mapped:
                data = bytes(mapped)
                found = [m.start() for m in re.finditer(b"\x01", data)]
                for at in found:
                    mapped[at] = 0
        if found:
            hits[name] = pack(found)
    return hits
