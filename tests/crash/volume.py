# SPDX-License-Identifier: Apache-2.0
"""A small file system of its own, which a ballast file fills and empties."""
import os
import subprocess
import tempfile

PAGE, MIB = 4096, 1 << 20
TRIES = 20


def why_not():
    """Why no file system can be mounted here; None when one can."""
    if os.geteuid() != 0:
        return "only root can mount a file system"
    with tempfile.TemporaryDirectory() as where:
        done = mount(where, 1)
        if done.returncode != 0:
            return f"no file system can be mounted: {done.stderr.strip()}"
        unmount(where)
    return None


def mount(where, megabytes):
    words = ["mount", "-t", "tmpfs", "-o", f"size={megabytes}m,mode=700", "hexad-crashtest", str(where)]
    return subprocess.run(words, capture_output=True, text=True)


def unmount(where):
    """At once, or, while a process that was killed still holds it, when that has gone."""
    subprocess.run(["umount", "-l", str(where)], check=True, capture_output=True)


class Volume:
    """Mounted from `with` to its end. Sizes are in bytes, of whole pages."""

    def __init__(self, where, megabytes):
        self.where, self.megabytes = where, megabytes
        self.ballast = where / "ballast"

    def __enter__(self):
        self.where.mkdir(parents=True, exist_ok=True)
        done = mount(self.where, self.megabytes)
        if done.returncode != 0:
            raise RuntimeError(f"mount: {done.stderr}")
        return self

    def __exit__(self, *_):
        unmount(self.where)

    def free(self):
        info = os.statvfs(self.where)
        return info.f_bavail * info.f_frsize

    def leave(self, room):
        """Makes the ballast so long that about so many bytes are free; exactly, when nobody else writes."""
        with open(self.ballast, "ab") as file:
            for _ in range(TRIES):
                size = file.seek(0, os.SEEK_END) + self.free() - room
                size -= size % PAGE
                if size <= file.tell():
                    return file.truncate(max(0, size))
                try:
                    return os.posix_fallocate(file.fileno(), 0, size)
                except OSError:  # others were faster
                    continue
        return None

    def empty(self):
        self.ballast.unlink(missing_ok=True)
