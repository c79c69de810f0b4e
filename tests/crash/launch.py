# SPDX-License-Identifier: Apache-2.0
"""Becomes a program whose file system calls are put before a supervisor (calls.py) before the kernel does them.

    launch.py TELL GO PROGRAM ARGUMENT...

Closes TELL when the filter is in force, waits for a byte on GO, becomes PROGRAM. Descriptor LISTENER is then the
supervisor's, who takes it by its number. What PROGRAM starts is under the same filter.
"""
import ctypes
import fcntl
import os
import struct
import sys

LISTENER = 200  # no program here has so many

# system calls of x86-64
NUMBERS = {
    "read": 0, "write": 1, "open": 2, "pread64": 17, "pwrite64": 18, "readv": 19, "writev": 20, "access": 21,
    "sendfile": 40, "sendto": 44, "sendmsg": 46, "flock": 73, "fsync": 74, "fdatasync": 75, "truncate": 76,
    "ftruncate": 77, "rename": 82,
    "mkdir": 83, "rmdir": 84, "creat": 85, "link": 86, "unlink": 87, "symlink": 88, "getdents64": 217,
    "openat": 257, "mkdirat": 258, "newfstatat": 262, "unlinkat": 263, "renameat": 264, "linkat": 265,
    "symlinkat": 266, "faccessat": 269, "sync_file_range": 277, "fallocate": 285, "preadv": 295, "pwritev": 296,
    "renameat2": 316,
    "copy_file_range": 326, "preadv2": 327, "pwritev2": 328, "openat2": 437, "faccessat2": 439,
}
MMAP, SECCOMP, ARCHITECTURE = 9, 317, 0xC000003E
MAP_SHARED, PROT_WRITE = 1, 2
LOAD, JUMP_EQUAL, JUMP_BITS, RETURN = 0x20, 0x15, 0x45, 0x06
ALLOW, NOTIFY = 0x7FFF0000, 0x7FC00000
AT_NUMBER, AT_ARCHITECTURE, AT_ARGUMENTS = 0, 4, 16  # in struct seccomp_data
NEW_LISTENER, NO_SPECULATION_LIMITS, KILLABLE = 1 << 3, 1 << 2, 1 << 5


def make_filter():
    """Notifies of the calls in NUMBERS and of mappings that write to a file; all others pass."""
    numbers = list(NUMBERS.values())
    lines = [(LOAD, 0, 0, AT_ARCHITECTURE), (JUMP_EQUAL, 0, len(numbers) + 6, ARCHITECTURE), (LOAD, 0, 0, AT_NUMBER)]
    for k, number in enumerate(numbers):
        lines.append((JUMP_EQUAL, len(numbers) - k + 5, 0, number))
    lines += [(JUMP_EQUAL, 0, 4, MMAP),
              (LOAD, 0, 0, AT_ARGUMENTS + 8 * 3), (JUMP_BITS, 0, 2, MAP_SHARED),
              (LOAD, 0, 0, AT_ARGUMENTS + 8 * 2), (JUMP_BITS, 1, 0, PROT_WRITE),
              (RETURN, 0, 0, ALLOW), (RETURN, 0, 0, NOTIFY)]
    return b"".join(struct.pack("HBBI", *line) for line in lines), len(lines)


def main():
    tell, go, program = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]
    os.set_inheritable(tell, False)
    os.set_inheritable(go, False)
    libc = ctypes.CDLL(None, use_errno=True)
    text, length = make_filter()
    held = ctypes.create_string_buffer(text)
    described = struct.pack("HxxxxxxP", length, ctypes.addressof(held))
    if libc.prctl(38, 1, 0, 0, 0) != 0:  # PR_SET_NO_NEW_PRIVS
        sys.exit("launch.py: no_new_privs")
    listener = libc.syscall(SECCOMP, 1, NEW_LISTENER | NO_SPECULATION_LIMITS | KILLABLE, described)
    if listener < 0:
        os._exit(77)
    # from here on nothing that the filter names, before the supervisor is there
    fcntl.fcntl(listener, fcntl.F_DUPFD_CLOEXEC, LISTENER)
    os.close(listener)
    os.close(tell)
    os.read(go, 1)
    os.execv(program[0], program)


if __name__ == "__main__":
    main()
