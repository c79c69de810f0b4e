# SPDX-License-Identifier: Apache-2.0
"""hexad and hexadctl as commands that end."""
import subprocess

from service import OPEN_TCP, PATIENCE_S


def run_hexad(build, *options):
    return subprocess.run([build / "hexad", *map(str, options)], capture_output=True, text=True, timeout=PATIENCE_S)


def settings_fault(service, *options):
    """What a daemon with a setting that is wrong says."""
    done = subprocess.run([service.build / "hexad", "--listen", "127.0.0.1:0", "--tcp_without_tokens", OPEN_TCP,
                           "--state_dir", service.base / "other", *options], capture_output=True, text=True,
                          timeout=PATIENCE_S)
    assert done.returncode == 2
    return done.stderr


def control(service, *words):
    done = subprocess.run([service.build / "hexadctl", *words], env=service.environment(), capture_output=True, text=True,
                          timeout=PATIENCE_S)
    return done.returncode, done.stdout, done.stderr
