# SPDX-License-Identifier: Apache-2.0
"""What doc/guide.md says can be typed in, typed in: its blocks of shell, in order, in one shell; and the outputs that pages show."""
import os
import signal
import subprocess
import sys

import pytest

from page_blocks import blocks, missing_lines
from service import PATIENCE_S, wait_until

END_OF_BLOCK = "---- the end of a block"


def test_a_line_that_was_not_printed_is_found():
    printed = "job 01m8\nspec: {}\n1000 points, spacing 0.12\n"
    assert missing_lines("1000 points, spacing ...\njob ...\n", printed) == []
    assert missing_lines("5738 points, spacing 0.12\njob 01m9...\n1000 points\n", printed) == [
        "5738 points, spacing 0.12", "job 01m9...", "1000 points"]


@pytest.mark.parametrize("name", ["inspect", "worker"])
def test_commands_of_the_worker_print_what_the_page_shows(build, source, tmp_path, name):
    environment = {**os.environ, "PATH": f"{build}:{os.environ['PATH']}"}
    shown = [(commands, output) for _, commands, output in blocks((source / f"doc/{name}.md").read_text()) if output]
    assert shown
    for commands, output in shown:
        done = subprocess.run(["sh", "-e", "-c", commands], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)
        assert done.returncode == 0 and missing_lines(output, done.stdout + done.stderr) == [], done


@pytest.mark.extended
def test_the_whole_guide(build, source, tmp_path):
    for program in ("hexad", "hexadctl", "hexad-worker"):
        (tmp_path / "bin").mkdir(exist_ok=True)
        (tmp_path / "bin" / program).symlink_to(build / program)
    (tmp_path / "bin/python3").symlink_to(sys.executable)
    environment = {**os.environ, "PATH": f"{tmp_path}/bin:{os.environ['PATH']}", "HEXAD_LIBRARY": str(build / "libhexad.so.1"),
                   "PYTHONPATH": str(source / "clients/python")}
    (_, start, _), *rest = blocks((source / "doc/guide.md").read_text())
    assert len(rest) >= 10 and [mark for mark, _, _ in rest].count("fails") == 1
    daemon = subprocess.Popen(["sh", "-c", start.replace("\nhexad", "\nexec hexad").rstrip().rstrip("&")], cwd=tmp_path,
                              env=environment)
    try:
        wait_until((tmp_path / "state/hexad.sock").exists, "the daemon of the guide")
        script = []
        for mark, block, _ in rest:
            # one shell for all: variables of a block are there in the next
            script.append(block if not mark else f"if {{ {block}}}; then exit 99; fi\n")
            script.append(f"echo '{END_OF_BLOCK}'; echo '{END_OF_BLOCK}' >&2\n")
        shown = subprocess.run(["sh", "-e", "-c", "".join(script)], cwd=tmp_path, env=environment, capture_output=True,
                               text=True, timeout=5 * PATIENCE_S)
        assert shown.returncode == 0, f"{shown.stdout}\n{shown.stderr}"
        printed = zip(rest, shown.stdout.split(END_OF_BLOCK), shown.stderr.split(END_OF_BLOCK))
        missing = [(line, out + err) for (_, _, output), out, err in printed for line in missing_lines(output, out + err)]
        assert not missing and sum(1 for _, _, output in rest if output) >= 4
        assert shown.stdout.count("succeeded") >= 5 and "\n500 converged\n" in shown.stdout
        for name in ("sphere", "sphere-alone", "delivered/ellipsoid"):
            assert {"points.ply", "report.json"} <= {p.name for p in (tmp_path / name).iterdir()}, name
    finally:
        daemon.send_signal(signal.SIGTERM)
        assert daemon.wait(PATIENCE_S) == 0
