# SPDX-License-Identifier: Apache-2.0
"""What the README says can be typed in, typed in: its blocks of shell, in order, with packages and from a clone."""
import json
import os
import re
import signal
import subprocess
import sys

from service import PATIENCE_S, wait_until

BOOTSTRAP = "./bootstrap"  # run by `bootstrap check` itself, which is where this test comes from


def blocks(source, kind):
    """Those of a kind, the text behind ```sh; those of bootstrap and of packages are not typed in here."""
    text = (source / "README.md").read_text()
    found = re.findall(rf"^```sh{kind}\n(.*?)^```$", text, re.M | re.S)
    return [block for block in found if BOOTSTRAP not in block and "apt-get" not in block]


def test_the_function_in_python(build, source):
    text = (source / "README.md").read_text()
    lines, = re.findall(r"^```python\n(.*?)^```$", text, re.M | re.S)
    environment = {**os.environ, "HEXAD_LIBRARY": str(build / "libhexad.so.1"), "PYTHONPATH": str(source / "clients/python")}
    program = lines + "print(points.positions.shape, points.normals.shape, points.outcome)"
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=PATIENCE_S)
    assert len(lines.splitlines()) == 3 and done.stdout == "(2000, 3) (2000, 3) converged\n", done.stderr


def type_in(block, where, environment):
    """In a directory without the clone."""
    block = block.replace("/tmp/hexad-state", str(where / "state")).replace("/tmp/quartic", str(where / "quartic"))
    done = subprocess.run(["bash", "-eu", "-c", block], cwd=where, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, f"{block}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def the_first_job(source, where, environment):
    first, rest, local = blocks(source, "")
    assert "succeeded" in type_in(first, where, environment)
    (where / "points.ply").unlink(missing_ok=True)
    told = type_in(rest, where, environment)
    uploaded, end = json.JSONDecoder().raw_decode(told)
    job, _ = json.JSONDecoder().raw_decode(told[end:].lstrip())
    assert uploaded["sha256"] in (where / "trefoil/spec.json").read_text()
    assert b"element vertex 3000" in (where / "trefoil/points.ply").read_bytes()
    assert job["name"] == "trefoil" and job["state"] == "succeeded"
    assert b"element vertex 3000" in (where / "points.ply").read_bytes()
    type_in(local, where, environment)
    report = json.loads((where / "quartic/report.json").read_text())
    assert report["outcome"] == "converged" and report["count"] == 1000


def test_the_first_job_with_packages(build, source, new_service, tmp_path):
    """The service runs, and its programs are on the PATH."""
    service = new_service("--listen", f"unix:{tmp_path}/hexad.sock").start()
    where = tmp_path / "home"
    where.mkdir()
    the_first_job(source, where, {**os.environ, "PATH": f"{build}:{os.environ['PATH']}", "HEXAD_SERVER": service.address})


def test_the_first_job_from_a_clone(build, source, tmp_path):
    """The daemon's block sets what the others use."""
    (tmp_path / "build").symlink_to(build)
    daemon, = blocks(source, " daemon")
    socket = tmp_path / "state/hexad.sock"
    typed = daemon.replace("/tmp/hexad-state", str(tmp_path / "state")).replace("hexad --", "exec hexad --").replace(" &\n", "\n")
    process = subprocess.Popen(["bash", "-eu", "-c", typed], cwd=tmp_path, start_new_session=True)
    try:
        ask = ["curl", "-sf", "--unix-socket", socket, "http://hexad/healthz"]
        wait_until(lambda: subprocess.run(ask, capture_output=True).returncode == 0, "the daemon of the README")
        exported = daemon.splitlines()[0].replace("/tmp/hexad-state", str(tmp_path / "state"))
        told = type_in(f"{exported}\necho $PATH; echo $HEXAD_SERVER", tmp_path, os.environ).split()
        the_first_job(source, tmp_path, {**os.environ, "PATH": told[0], "HEXAD_SERVER": told[1]})
    finally:
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0
