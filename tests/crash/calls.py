# SPDX-License-Identifier: Apache-2.0
"""The file system calls of a program and of all that it starts, each looked at before the kernel does it.

A supervisor is a thread beside the test: the kernel hands it every call that launch.py names (seccomp user
notification), with the calling thread stopped, and it lets the call go on, fails it, does a part of it, or only claims
that it was done. So nothing is missed, however a program comes to its calls (stdio, SQLite, a library), and nothing is
preloaded or changed in the program. x86-64 with Linux 5.19 or newer; `why_not()` says what is missing.
"""
import ctypes
import errno
import fcntl
import os
import pathlib
import platform
import re
import select
import signal
import struct
import subprocess
import sys
import threading

import launch

NAMES = {number: name for name, number in launch.NUMBERS.items()} | {launch.MMAP: "mmap"}
RECEIVE, ANSWER, IS_VALID = 0xC0502100, 0xC0182101, 0x40082102  # ioctls of a listener
GO_ON = 1  # flag of an answer
PIDFD_GETFD = 438
AT_FDCWD = -100

# name: (arguments that hold directory and path), one pair for each path
PATHS = {
    "open": [(None, 0)], "creat": [(None, 0)], "truncate": [(None, 0)], "access": [(None, 0)],
    "mkdir": [(None, 0)], "rmdir": [(None, 0)], "unlink": [(None, 0)], "rename": [(None, 0), (None, 1)], "link": [(None, 0), (None, 1)],
    "symlink": [(None, 1)], "openat": [(0, 1)], "openat2": [(0, 1)], "mkdirat": [(0, 1)], "unlinkat": [(0, 1)],
    "newfstatat": [(0, 1)], "faccessat": [(0, 1)], "faccessat2": [(0, 1)],
    "renameat": [(0, 1), (2, 3)], "renameat2": [(0, 1), (2, 3)],
    "linkat": [(0, 1), (2, 3)], "symlinkat": [(1, 2)],
}
# name: the argument that is a descriptor
DESCRIPTORS = {"copy_file_range": 2, "mmap": 4, "sendfile": 0}
WRITES = {"write", "writev", "pwrite64", "pwritev", "pwritev2"}
REPLIES = {"write", "writev", "sendto", "sendmsg"}
SYNCS = {"fsync", "fdatasync"}
OPENS = {"open", "creat", "openat", "openat2"}


def why_not():
    """Why calls cannot be supervised here; None when they can."""
    if platform.machine() != "x86_64" or sys.platform != "linux":
        return "calls are supervised on x86-64 Linux only"
    try:
        with Supervisor("/nonexistent", None, ["/bin/true"], stdin=subprocess.DEVNULL) as s:
            return None if s.process.wait() == 0 else "a supervised program does not run"
    except OSError as e:
        return f"the kernel does not let calls be supervised: {e}"


class Call:
    """One call; `paths` are those below the supervised directory, relative to it, or None."""

    def __init__(self, supervisor, tid, name, arguments):
        self.supervisor, self.tid, self.name, self.arguments = supervisor, tid, name, arguments
        self.descriptor = None
        if name in PATHS:
            self.paths = [self.path_at(*where) for where in PATHS[name]]
        else:
            self.descriptor = ctypes.c_int32(arguments[DESCRIPTORS.get(name, 0)]).value
            try:
                self.link = os.readlink(f"/proc/{tid}/fd/{self.descriptor}")
            except OSError:
                self.link = ""
            self.paths = [supervisor.below(self.link)]

    @property
    def program(self):
        return "daemon" if self.supervisor.process_of(self.tid) == self.supervisor.process.pid else "worker"

    def memory(self, address, length):
        with open(f"/proc/{self.tid}/mem", "rb", buffering=0) as memory:
            memory.seek(address)
            return memory.read(length)

    def text_at(self, address):
        text = b""
        while b"\0" not in text:
            room = 4096 - address % 4096  # not across the end of a page that may be the last
            text += self.memory(address, room)
            address += room
        return text.partition(b"\0")[0].decode(errors="surrogateescape")

    def path_at(self, directory, where):
        path = self.text_at(self.arguments[where])
        if not path.startswith("/"):
            number = AT_FDCWD if directory is None else ctypes.c_int32(self.arguments[directory]).value
            base = "cwd" if number == AT_FDCWD else f"fd/{number}"
            try:
                path = os.path.join(os.readlink(f"/proc/{self.tid}/{base}"), path) if path else ""
            except OSError:
                return None
        return self.supervisor.below(os.path.normpath(path)) if path else None

    def pieces(self, vector, count):
        table = self.memory(vector, 16 * count)
        return b"".join(self.memory(*piece) for piece in struct.iter_unpack("QQ", table) if piece[1])

    def data(self):
        """What a call of WRITES or REPLIES writes."""
        if self.name in ("write", "pwrite64", "sendto"):
            return self.memory(self.arguments[1], self.arguments[2])
        if self.name == "sendmsg":
            _, _, vector, count = struct.unpack("QQQQ", self.memory(self.arguments[1], 32))
            return self.pieces(vector, count)
        return self.pieces(self.arguments[1], self.arguments[2])

    def offset(self):
        """Where a call of WRITES writes."""
        if self.name.startswith("pw"):
            return self.arguments[3]
        info = pathlib.Path(f"/proc/{self.tid}/fdinfo/{self.descriptor}").read_text()
        fields = dict(line.split(":\t", 1) for line in info.splitlines() if ":\t" in line)
        if int(fields["flags"], 8) & os.O_APPEND:
            return os.stat(f"/proc/{self.tid}/fd/{self.descriptor}").st_size
        return int(fields["pos"])

    def flags(self):
        """Of a call that opens."""
        if self.name == "creat":
            return os.O_CREAT | os.O_TRUNC | os.O_WRONLY
        if self.name == "openat2":
            return struct.unpack("Q", self.memory(self.arguments[2], 8))[0]
        return self.arguments[1 if self.name == "open" else 2]

    def creates(self):
        return self.name in OPENS and bool(self.flags() & os.O_CREAT)

    def borrow(self):
        """The call's own descriptor, as one of this process; to be closed."""
        number = self.supervisor.libc.syscall(
            PIDFD_GETFD, self.supervisor.pidfd_of(self.tid), self.descriptor, 0)
        if number < 0:
            raise OSError(ctypes.get_errno(), "pidfd_getfd")
        return number

    def write_part(self, length):
        """Does the first `length` bytes of a write."""
        part, fd = self.data()[:length], self.borrow()
        try:
            return os.pwrite(fd, part, self.arguments[3]) if self.name.startswith("pw") else os.write(fd, part)
        finally:
            os.close(fd)


class Supervisor:
    """Starts a program under supervision. `judge(call)` says what is to become of each call on a path below
    `directory`, and of each that writes to a socket: None, it goes on; ("error", number); ("value", number), a claim;
    ("call", function), whose result is the call's, found in a thread of its own. No judge: all go on."""

    def __init__(self, directory, judge, words, **more):
        self.directory, self.judge = os.path.realpath(directory), judge
        self.libc = ctypes.CDLL(None, use_errno=True)
        self.groups, self.pidfds, self.helpers, self.failure = {}, {}, [], None
        self.process, self.listener = self.start(words, more)
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()
        os.write(self.go, b"x")
        os.close(self.go)

    def start(self, words, more):
        told, tell = os.pipe()
        go, self.go = os.pipe()
        launcher = [sys.executable, "-I", "-S", launch.__file__, str(tell), str(go)]
        process = subprocess.Popen([*launcher, *map(str, words)], pass_fds=(tell, go), **more)
        os.close(tell)
        os.close(go)
        os.read(told, 1)
        os.close(told)
        pidfd = os.pidfd_open(process.pid)
        listener = self.libc.syscall(PIDFD_GETFD, pidfd, launch.LISTENER, 0)
        why = ctypes.get_errno()
        os.close(pidfd)
        if listener < 0:
            process.kill()
            process.wait()
            os.close(self.go)
            raise OSError(why, os.strerror(why))
        return process, listener

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self.thread.join()

    def below(self, path):
        if path == self.directory:
            return "."
        return path[len(self.directory) + 1:] if path.startswith(self.directory + "/") else None

    def process_of(self, tid):
        if tid not in self.groups:
            status = pathlib.Path(f"/proc/{tid}/status").read_text()
            self.groups[tid] = int(re.search(r"^Tgid:\t(\d+)", status, re.M)[1])
        return self.groups[tid]

    def pidfd_of(self, tid):
        process = self.process_of(tid)
        if process not in self.pidfds:
            self.pidfds[process] = os.pidfd_open(process)
        return self.pidfds[process]

    def answer(self, number, value=0, error=0, flags=0):
        try:
            fcntl.ioctl(self.listener, ANSWER, struct.pack("QqiI", number, value, -error, flags))
        except OSError as e:
            if e.errno not in (errno.ENOENT, errno.EINPROGRESS):  # it was killed meanwhile
                raise

    def is_waiting(self, number):
        """False when the caller was killed meanwhile."""
        try:
            fcntl.ioctl(self.listener, IS_VALID, struct.pack("Q", number))
        except OSError:
            return False
        return True

    def is_killed(self, tid):
        """A killed thread waits on until it is scheduled, when the files of its process may be gone already."""
        try:
            status = pathlib.Path(f"/proc/{tid}/status").read_text()
        except OSError:
            return True
        return int(re.search(r"^SigPnd:\t(\w+)", status, re.M)[1], 16) >> (signal.SIGKILL - 1) & 1 == 1

    def serve(self):
        """Until no process is left under the filter."""
        poll = select.poll()
        poll.register(self.listener, select.POLLIN)
        try:
            while not any(events & select.POLLHUP and not events & select.POLLIN for _, events in poll.poll()):
                notification = bytearray(80)
                try:
                    fcntl.ioctl(self.listener, RECEIVE, notification)
                except OSError as e:
                    if e.errno in (errno.ENOENT, errno.EINTR):  # killed before it was looked at
                        continue
                    raise
                number, tid, _, system_call = struct.unpack_from("QIIi", notification)
                self.handle(number, tid, NAMES[system_call], struct.unpack_from("6Q", notification, 32))
        finally:
            for helper in self.helpers:
                helper.join()
            for fd in [self.listener, *self.pidfds.values()]:
                os.close(fd)

    def handle(self, number, tid, name, arguments):
        verdict = None
        try:
            call = Call(self, tid, name, arguments) if self.judge else None
            if call and (any(call.paths) or name in REPLIES and call.link.startswith("socket:")):
                verdict = self.judge(call)
        except Exception as e:  # a fault of the test, which must not leave the program stopped
            if not self.is_killed(tid) and self.is_waiting(number):
                self.failure = self.failure or f"{name}: {e!r}"
        if verdict is None:
            self.answer(number, flags=GO_ON)
        elif verdict[0] == "error":
            self.answer(number, error=verdict[1])
        elif verdict[0] == "value":
            self.answer(number, value=verdict[1])
        else:
            self.helpers = [h for h in self.helpers if h.is_alive()]
            self.helpers.append(threading.Thread(target=self.do, args=(number, verdict[1]), daemon=True))
            self.helpers[-1].start()

    def do(self, number, function):
        try:
            self.answer(number, value=function() or 0)
        except OSError as e:
            self.answer(number, error=e.errno or errno.EIO)
