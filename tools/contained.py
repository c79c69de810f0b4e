"""Runs a command, and ends every process that it leaves behind. tools/mutate.py runs each test in this way.

The command runs under a process that becomes the parent of orphaned descendants (PR_SET_CHILD_SUBREAPER) and kills them
when the command ends, when its time is over, when its memory is over, or when the calling process dies.
"""
import ctypes
import os
import pathlib
import signal
import subprocess
import sys
import time

PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36
OUT_OF_MEMORY = 97  # exit status: the descendants had more memory than allowed
TIME_OVER = 98      # exit status: the time was over


def run(command, seconds, memory, log, **more):
    """Runs the command with its output in the file `log`. Returns (exit status, seconds)."""
    start = time.monotonic()
    with open(log, "wb") as out:
        process = subprocess.Popen([sys.executable, "-I", "-S", "-B", __file__, str(memory), *map(str, command)],
                                   stdin=subprocess.DEVNULL, stdout=out, stderr=out, start_new_session=True, **more)
        try:
            status = process.wait(seconds)
        except subprocess.TimeoutExpired:
            status = TIME_OVER
        finally:
            if process.poll() is None:
                process.terminate()
                process.wait()
    return status, time.monotonic() - start


def descendants(of):
    parents, pages = {}, {}
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                fields = pathlib.Path(f"/proc/{entry}/stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            parents[int(entry)], pages[int(entry)] = int(fields[1]), int(fields[21])
    found, heads = set(), {of}
    while heads:
        heads = {pid for pid, parent in parents.items() if parent in heads} - found
        found |= heads
    return found, sum(pages[pid] for pid in found) * os.sysconf("SC_PAGESIZE")


def end_descendants():
    while True:
        for pid in descendants(os.getpid())[0]:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:
            return
        time.sleep(0.005)


def main(memory, *command):
    prctl = ctypes.CDLL(None).prctl
    prctl(PR_SET_CHILD_SUBREAPER, 1)
    prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    watched = {signal.SIGCHLD, signal.SIGTERM, signal.SIGINT, signal.SIGHUP}
    signal.pthread_sigmask(signal.SIG_BLOCK, watched)
    child = os.fork()
    if child == 0:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, watched)
        try:
            os.execvp(command[0], command)
        except OSError as why:
            print(f"{command[0]}: {why}", file=sys.stderr)
        os._exit(126)
    status = None
    while status is None:
        got = signal.sigtimedwait(watched, 1)
        if got and got.si_signo != signal.SIGCHLD:
            status = TIME_OVER
            break
        if not got and descendants(os.getpid())[1] > int(memory):
            status = OUT_OF_MEMORY
            break
        try:
            while True:
                pid, ended = os.waitpid(-1, os.WNOHANG)
                if pid == 0:
                    break
                if pid == child:
                    status = os.waitstatus_to_exitcode(ended)
        except ChildProcessError:
            pass
    end_descendants()
    return status if status >= 0 else 128 - status


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
