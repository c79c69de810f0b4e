# SPDX-License-Identifier: Apache-2.0
"""Small disks that fill up, and services on them."""
import os
import re
import subprocess

import pytest

from service import sphere, wait_until

MIB = 1 << 20


class Disk:
    """A file system in memory, and a ballast file that fills it."""

    def __init__(self, path):
        self.path, self.ballast = path, path / "ballast"

    def free(self):
        info = os.statvfs(self.path)
        return info.f_bavail * info.f_frsize

    def fill(self, leave=0):
        """Until no more than `leave` bytes are free; again when something was freed."""
        with open(self.ballast, "ab") as ballast:
            while self.free() > leave:
                size = os.fstat(ballast.fileno()).st_size
                os.posix_fallocate(ballast.fileno(), size, self.free() - leave)

    def empty(self):
        self.ballast.unlink()


@pytest.fixture
def new_disk(tmp_path):
    mounted = []

    def make(mib):
        path = tmp_path / f"disk.{len(mounted)}"
        path.mkdir()
        done = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={mib}m", "tmpfs", path], text=True,
                              stderr=subprocess.PIPE)
        if done.returncode:
            pytest.skip(f"no small disk can be mounted: {done.stderr.strip()}")
        mounted.append(path)
        return Disk(path)

    yield make
    for path in mounted:
        subprocess.run(["umount", "-l", path], check=True)


def small(seed, **parts):
    return sphere(50, solver={"seed": seed}, output={"preview": False}, **parts)


def service_on(disk, new_service, *options):
    """A service that has checked its database. The check takes room on the disk for a while, for a copy."""
    service = new_service("--retry_s", 0.05, "--retry_most_s", 0.2, *options)
    service.state = disk.path / "state"
    service.start()
    wait_until(lambda: figure(service, "hexad_database_last_check_timestamp_seconds"), "the quick check")
    return service


def figure(service, name):
    return float(re.search(rf"^{name} (\S+)$", service.get("/metrics").body.decode(), re.M)[1])
