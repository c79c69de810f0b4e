# SPDX-License-Identifier: Apache-2.0
"""What doc/guide.md says can be typed in, typed in: its blocks of shell, in order, in one shell."""
import os
import re
import signal
import subprocess
import sys

import pytest

from service import PATIENCE_S, wait_until


@pytest.fixture
def page(source):
    return (source / "doc/guide.md").read_text()


def blocks(page):
    """(mark, commands): the mark behind ```sh is empty, `daemon` or `fails`."""
    return re.findall(r"^```sh *(\w*)\n(.*?)^```$", page, re.M | re.S)


@pytest.mark.extended
def test_the_whole_guide(build, source, page, tmp_path):
    for program in ("hexad", "hexadctl", "hexad-worker"):
        (tmp_path / "bin").mkdir(exist_ok=True)
        (tmp_path / "bin" / program).symlink_to(build / program)
    (tmp_path / "bin/python3").symlink_to(sys.executable)
    environment = {**os.environ, "PATH": f"{tmp_path}/bin:{os.environ['PATH']}", "HEXAD_LIBRARY": str(build / "libhexad.so.1"),
                   "PYTHONPATH": str(source / "clients/python")}
    (_, start), *rest = blocks(page)
    assert len(rest) >= 10 and [mark for mark, _ in rest].count("fails") == 1
    daemon = subprocess.Popen(["sh", "-c", start.replace("\nhexad", "\nexec hexad").rstrip().rstrip("&")], cwd=tmp_path,
                              env=environment)
    try:
        wait_until((tmp_path / "state/hexad.sock").exists, "the daemon of the guide")
        script = []
        for mark, block in rest:
            # one shell for all: variables of a block are there in the next
            script.append(block if not mark else f"if {{ {block}}}; then exit 99; fi\n")
        shown = subprocess.run(["sh", "-e", "-c", "".join(script)], cwd=tmp_path, env=environment, capture_output=True,
                               text=True, timeout=5 * PATIENCE_S)
        assert shown.returncode == 0, f"{shown.stdout}\n{shown.stderr}"
        assert shown.stdout.count("succeeded") >= 5 and "\n500 converged\n" in shown.stdout
        assert "open.obj: the mesh is open" in shown.stdout + shown.stderr
        for name in ("sphere", "sphere-alone", "delivered/ellipsoid"):
            assert {"points.ply", "report.json"} <= {p.name for p in (tmp_path / name).iterdir()}, name
    finally:
        daemon.send_signal(signal.SIGTERM)
        assert daemon.wait(PATIENCE_S) == 0
