"""What the README says can be typed in, typed in: its blocks of shell, in order, in one shell."""
import json
import os
import pathlib
import re
import signal
import subprocess

import pytest

from service import wait_until

BOOTSTRAP = "./bootstrap"  # run by `bootstrap check` itself, which is where this test comes from


def blocks(source):
    text = (source / "README.md").read_text()
    return re.findall(r"^```sh\n(.*?)^```$", text, re.M | re.S)


@pytest.fixture
def source():
    return pathlib.Path(os.environ["HEXAD_SOURCE"])


def test_the_first_job(build, source, tmp_path):
    build = pathlib.Path(build)
    (tmp_path / "build" / "example").mkdir(parents=True)
    for program in ("hexad", "hexadctl", "hexad-worker"):
        (tmp_path / "build" / program).symlink_to(build / program)
    (tmp_path / "examples").symlink_to(source / "examples")
    subprocess.run([build / "hexad-worker", "make-example", tmp_path / "build/example/trefoil.vdb"], check=True)

    def here(block):
        return block.replace("/tmp/hexad-state", str(tmp_path / "state")).replace("/tmp/quartic", str(tmp_path / "quartic"))

    shell, *rest = [here(b) for b in blocks(source) if BOOTSTRAP not in b]
    daemon = subprocess.Popen(
        ["sh", "-c", "exec " + shell.strip().rstrip("&")], cwd=tmp_path, start_new_session=True
    )
    try:
        wait_until(
            lambda: subprocess.run(
                ["curl", "-sf", "--unix-socket", tmp_path / "state/hexad.sock", "http://hexad/healthz"], capture_output=True
            ).returncode == 0,
            "the daemon of the README",
        )
        outputs = [
            subprocess.run(["sh", "-e", "-c", b], cwd=tmp_path, capture_output=True, text=True) for b in rest
        ]
        for block, done in zip(rest, outputs):
            assert done.returncode == 0, f"{block}\n{done.stdout}\n{done.stderr}"
        posted, _ = json.JSONDecoder().raw_decode(outputs[0].stdout)
        assert posted["state"] in ("queued", "running") and posted["id"]
        assert "succeeded" in outputs[1].stdout
        report = json.loads((tmp_path / "quartic/report.json").read_text())
        assert report["outcome"] == "converged" and report["count"] == 1000
    finally:
        daemon.send_signal(signal.SIGTERM)
        assert daemon.wait(60) == 0


def test_links_lead_somewhere(source):
    for target in re.findall(r"\]\(([^)#]+)\)", (source / "README.md").read_text()):
        assert (source / target).exists(), target
