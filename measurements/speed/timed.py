# SPDX-License-Identifier: Apache-2.0
"""Runs a command and tells what it took, as JSON on standard output: timed.py SECONDS COMMAND...

A process of its own, and a small one, because a child's peak of memory begins with its parent's. The command's
standard output goes nowhere; after SECONDS it is killed, with its children."""
import json
import os
import signal
import sys
import time


def main():
    limit, command = float(sys.argv[1]), sys.argv[2:]
    nowhere = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
    start = time.monotonic()
    child = os.posix_spawnp(command[0], command, os.environ, file_actions=nowhere, setpgroup=0)
    stopped = []

    def stop(*_):
        stopped.append(True)
        os.killpg(child, signal.SIGKILL)

    signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, limit)
    _, status, usage = os.wait4(child, 0)
    signal.setitimer(signal.ITIMER_REAL, 0)
    json.dump({"code": os.waitstatus_to_exitcode(status), "stopped": bool(stopped),
               "cpu_s": usage.ru_utime + usage.ru_stime, "wall_s": time.monotonic() - start,
               "peak_mb": usage.ru_maxrss / 1024}, sys.stdout)


main()
