# SPDX-License-Identifier: Apache-2.0
"""interrupts.py SEED RUNS: calls of hexad in processes that get two or three SIGINT at random times, as from Ctrl-C. Exits with 1
if one of them is ended by another signal, such as SIGSEGV, or if threads are left after a call."""
import os
import random
import signal
import sys
import time

import numpy

import hexad
from hexad.library import load

LONG = {"surface": {"analytic": {"shape": "torus", "major_radius": 1, "minor_radius": 0.4}}, "sampling": {"count": 100000},
        "solver": {"max_sweeps": 1000000, "step_tolerance": 1e-12, "energy_tolerance": 1e-12}, "limits": {"timeout_s": 60}}
GRID = numpy.broadcast_to(numpy.float32(1), (400, 400, 400))
VERTICES = numpy.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
FACES = numpy.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
BATCH = [{**LONG, "sampling": {}}] * 5

CALLS = {
    "sample": lambda: hexad.sample(LONG),
    "progress": lambda: hexad.sample(LONG, progress=lambda *_: None),
    "short": lambda: [hexad.sample(VERTICES, FACES, count=100) for _ in range(100)],
    "volume": lambda: hexad.sample(GRID, isovalue=0, count=100),
    "sample_many": lambda: hexad.sample_many(BATCH, 100000, processors=3),
}


def threads():
    return len(os.listdir("/proc/self/task"))


def interrupted(call, goes_on):
    """What a child does. Its end is that of an interpreter, with an exception or, if it goes on, without."""
    before = threads()
    try:
        call()
    except KeyboardInterrupt:
        if not goes_on:
            raise
        while threads() > before:  # the kernel lists a thread for a moment after it has ended
            pass
        assert len(hexad.sample(VERTICES, FACES, count=100).positions) == 100


def main(seed, runs):
    draw, failed = random.Random(seed), 0
    signal.signal(signal.SIGINT, signal.default_int_handler)
    load()
    for run in range(runs):
        name, goes_on = draw.choice(list(CALLS)), draw.random() < 0.5
        delays = [draw.choice((0.001, 0.01, 0.3)) * draw.random() for _ in range(draw.choice((2, 3)))]
        begins, tells = os.pipe()
        child = os.fork()
        if child == 0:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # tracebacks
            os.write(tells, b"x")
            return interrupted(CALLS[name], goes_on)
        os.close(tells)
        os.read(begins, 1)
        os.close(begins)
        for delay in delays:
            time.sleep(delay)
            os.kill(child, signal.SIGINT)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if code < 0 and code != -signal.SIGINT:
            failed += 1
            print(f"run {run}: {name} ended by signal {-code}, with interrupts after {delays} s, goes on: {goes_on}")
    print(f"seed {seed}: {runs} interrupted calls, {failed} not as expected")
    return failed > 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2])))
