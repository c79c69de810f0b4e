# SPDX-License-Identifier: Apache-2.0
"""Templates for other farm managers (share/): frames without hexad's queue. Slurm and GNU parallel run theirs. What the
schema of OpenJD and the script engine of Flamenco would say is not known here: their forms are looked at, and what they
would run is run."""
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess

import pytest

import cluster
from service import PATIENCE_S, long_sphere, sphere

SHARE = pathlib.Path(os.environ.get("HEXAD_SOURCE", pathlib.Path(__file__).parents[2])).resolve() / "share"
FRAMES = {"frames": "1-3", "by_frame": {"/surface/analytic/radius": [1, 2, 3]}}


@pytest.fixture
def place(build, tmp_path, monkeypatch):
    """A directory with a spec of three frames, in which templates find their programs."""
    monkeypatch.setenv("PATH", f"{SHARE}:{build.resolve()}:{cluster.PATH}")
    (tmp_path / "spec.json").write_text(json.dumps(sphere(output={"preview": False}, queue=FRAMES)))
    return tmp_path


def run(place, *words, **more):
    return subprocess.run(list(map(str, words)), cwd=place, text=True, capture_output=True, timeout=PATIENCE_S, **more)


def assert_done(place, frames=(1, 2, 3)):
    for frame in frames:
        assert json.loads((place / f"out/{frame}/report.json").read_text())["count"] == 200


def test_a_frame_tells_its_progress_and_its_end(place):
    for frame, style, form in ((1, "openjd", r"openjd_progress: \d+\.\d"), (2, "opencue", r"\d+%"), (3, "plain", r"progress \d+")):
        done = run(place, "hexad-frame", "spec.json", "out", frame, style)
        assert done.returncode == 0 and any(re.fullmatch(form, line) for line in done.stdout.splitlines()), done
    assert_done(place)
    again = run(place, "hexad-frame", "spec.json", "out", 1)
    assert again.returncode == 0 and not again.stdout
    assert run(place, "hexad-frame", "spec.json", "out", 9).returncode == 2


def write_spec(place, **more):
    (place / "spec.json").write_text(json.dumps(sphere(output={"preview": False}, **more), indent=1))


def test_a_coherent_frame_requires_the_result_of_the_frame_before(place):
    write_spec(place, queue={"frames": "1-3x2,7", "coherent": True, "by_frame": {"/surface/analytic/radius": [1, 2, 3]}})
    done = run(place, "hexad-frame", "spec.json", "out", 3)
    assert done.returncode == 2 and "continues frame 1" in done.stderr and not (place / "out/3").exists()
    for frame in (1, 3, 7):
        assert run(place, "hexad-frame", "spec.json", "out", frame).returncode == 0
    sequences = [json.loads((place / f"out/{frame}/report.json").read_text())["sequence"] for frame in (1, 3, 7)]
    assert [s.get("previous_frame") for s in sequences] == [None, 1, 3]


def test_a_spec_without_frames(place):
    write_spec(place)
    assert run(place, "hexad-frame", "spec.json", "out/a", "-").returncode == 0
    assert json.loads((place / "out/a/report.json").read_text())["count"] == 200


def test_a_result_of_another_spec_is_refused(place):
    queue = dict(FRAMES)
    assert run(place, "hexad-frame", "spec.json", "out", 1).returncode == 0
    write_spec(place, queue={**queue, "frames": "1,4-5"})  # other frames, and other spaces
    assert run(place, "hexad-frame", "spec.json", "out", 1).returncode == 0
    write_spec(place, queue=queue, solver={"seed": 7})
    done = run(place, "hexad-frame", "spec.json", "out", 1)
    assert done.returncode == 2 and "another spec" in done.stderr
    (place / "out/1/spec.sha256").unlink()
    assert run(place, "hexad-frame", "spec.json", "out", 1).returncode == 0


def test_strict_status_has_the_outcome(place, monkeypatch):
    write_spec(place, queue=FRAMES, solver={"max_sweeps": 1})
    assert run(place, "hexad-frame", "spec.json", "out", 1).returncode == 0
    monkeypatch.setenv("HEXAD_STRICT", "1")
    assert run(place, "hexad-frame", "spec.json", "out", 1).returncode == 10  # of the result that is there
    assert run(place, "hexad-frame", "spec.json", "out", 2).returncode == 10


def test_a_frame_ends_when_it_is_told_to(place):
    (place / "spec.json").write_text(json.dumps(long_sphere(queue=FRAMES)))
    frame = subprocess.Popen(["hexad-frame", "spec.json", "out", "1"], cwd=place, text=True, stdout=subprocess.PIPE)
    assert frame.stdout.readline().startswith("progress")
    frame.send_signal(signal.SIGTERM)
    frame.communicate(timeout=PATIENCE_S)
    assert frame.returncode == 6


@pytest.mark.extended
@pytest.mark.skipif(cluster.missing() is not None, reason=str(cluster.missing()))
def test_an_array_of_slurm(place, monkeypatch):
    slurm = cluster.Cluster()
    try:
        slurm.start()
        monkeypatch.setenv("SLURM_CONF", slurm.environment["SLURM_CONF"])
        done = run(place, "sbatch", "--wait", "--array=1-3", "--mem=500", SHARE / "slurm-array.sh", "spec.json", "out")
        assert done.returncode == 0, done
        assert_done(place)
    finally:
        slurm.clean_up()


@pytest.mark.extended
@pytest.mark.skipif(not shutil.which("parallel"), reason="no parallel")
def test_gnu_parallel(place):
    assert run(place, SHARE / "gnu-parallel.sh", "spec.json", "out", 1, 3).returncode == 0
    assert_done(place)
    assert run(place, SHARE / "gnu-parallel.sh", "spec.json", "out", 3, 4).returncode == 1  # the number of failed ones


def test_openjd(place):
    yaml = pytest.importorskip("yaml")
    template = yaml.safe_load((SHARE / "openjd.yaml").read_text())
    assert template["specificationVersion"] == "jobtemplate-2023-09"
    values = {"Param.Spec": "spec.json", "Param.Output": "out", "Param.Frames": "1-3", "Task.Param.Frame": "2"}
    (step,) = template["steps"]
    action = step["script"]["actions"]["onRun"]
    words = [action["command"], *action["args"]]
    for name, value in values.items():
        words = [word.replace("{{%s}}" % name, value) for word in words]
    assert run(place, *words).returncode == 0
    assert_done(place, [2])
    assert {p["name"] for p in template["parameterDefinitions"]} == {"Spec", "Output", "Frames"}


@pytest.mark.extended
@pytest.mark.skipif(not shutil.which("node"), reason="no node")
def test_flamenco(place):
    manager = """
const tasks = [], author = {Task: (name, type) => ({name, type, commands: [], addCommand(c) { this.commands.push(c); }}),
                            Command: (name, parameters) => ({name, parameters})};
const frameChunker = frames => frames.split(",");
const settings = Object.fromEntries(JOB_TYPE.settings.map(s => [s.key, {spec: "spec.json", output: "out", frames: "2,3"}[s.key]]));
compileJob({settings, addTask(task) { tasks.push(task); }});
console.log(JSON.stringify(tasks));
"""
    (place / "all.js").write_text((SHARE / "flamenco.js").read_text() + manager)
    tasks = json.loads(run(place, "node", "all.js").stdout)
    for task in tasks:
        (command,) = task["commands"]
        assert command["name"] == "exec"
        assert run(place, command["parameters"]["exe"], *command["parameters"]["args"]).returncode == 0
    assert_done(place, [2, 3])


def test_opencue_compiles():
    compile((SHARE / "opencue.py").read_text(), "opencue.py", "exec")
