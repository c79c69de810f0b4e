# SPDX-License-Identifier: Apache-2.0
"""Templates for other farm managers (share/) and job bundles of OpenJD: frames without hexad's queue. Slurm and GNU parallel run
theirs. What the schema of OpenJD and the script engine of Flamenco would say is not known here: their forms are looked at, and what
they would run is run."""
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


def test_a_range_runs_its_frames_in_order(place):
    done = run(place, "hexad-frame", "spec.json", "out", "1-3:2", "openjd")
    assert done.returncode == 0
    assert_done(place, [1, 3])
    assert not (place / "out/2").exists()
    told = [line.split(": ", 1) for line in done.stdout.splitlines() if line.startswith("openjd_")]
    fractions = [float(value) for name, value in told if name == "openjd_progress"]
    assert fractions == sorted(fractions) and fractions[0] == 0 and 50 in fractions and 95 < fractions[-1] <= 100
    states = [value for name, value in told if name == "openjd_status"]
    assert states == [f"frame {n}: {state}" for n in (1, 3) for state in ("load", "start", "relax", "measure", "curvature", "weights", "write", "converged")]
    for frames in ("3-1", "1-", "a", "1-3:0", "1-3,", ""):
        assert run(place, "hexad-frame", "spec.json", "out", frames).returncode == 2


def test_a_failed_frame_does_not_stop_the_others_of_a_range(place):
    done = run(place, "hexad-frame", "spec.json", "out", "1,9,3", "openjd")
    assert done.returncode == 2
    assert_done(place, [1, 3])
    (failure,) = [line for line in done.stdout.splitlines() if line.startswith("openjd_fail: ")]
    assert failure.startswith('openjd_fail: frame 9: /queue/frames: the spec is a sequence, "1-3": choose one'), failure
    assert json.loads(done.stderr.splitlines()[-1])["code"] == "spec_invalid"


def test_a_coherent_range_continues_each_frame_and_stops_at_a_failure(place):
    """The value of frame 4 is not valid."""
    write_spec(place, queue={"frames": "1-5", "coherent": True, "by_frame": {"/surface/analytic/radius": [1, 2, 3, -1, 4]}})
    done = run(place, "hexad-frame", "spec.json", "out", "1-5", "openjd")
    assert done.returncode == 2 and "openjd_fail: frame 4: /queue/by_frame" in done.stdout and not (place / "out/5").exists(), done
    sequences = [json.loads((place / f"out/{frame}/report.json").read_text())["sequence"] for frame in (1, 2, 3)]
    assert [s.get("previous_frame") for s in sequences] == [None, 1, 2]


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


def test_a_range_ends_when_it_is_told_to(place):
    (place / "spec.json").write_text(json.dumps(long_sphere(queue=FRAMES)))
    frames = subprocess.Popen(["hexad-frame", "spec.json", "out", "1-3"], cwd=place, text=True, stdout=subprocess.PIPE)
    assert frames.stdout.readline().startswith("progress")
    frames.send_signal(signal.SIGTERM)
    frames.communicate(timeout=PATIENCE_S)
    assert frames.returncode == 6 and [p.name for p in (place / "out").iterdir()] == ["1"]


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


# ---- job bundles of OpenJD

def frames_of(text):
    """The frames of a range of OpenJD."""
    found = []
    for part in text.split(","):
        ends, _, step = part.partition(":")
        first, _, last = ends.partition("-")
        found += range(int(first), int(last or first) + 1, int(step or 1))
    return found


def tasks_of(template, values):
    """The command of each task of a template, with the values of its parameters."""
    def put(text, more):
        for name, value in {**{f"Param.{n}": v for n, v in values.items()}, **more}.items():
            text = str(text).replace("{{%s}}" % name, str(value))
        assert "{{" not in text, text
        return text
    (step,) = template["steps"]
    action = step["script"]["actions"]["onRun"]
    parameters = step.get("parameterSpace", {"taskParameterDefinitions": []})["taskParameterDefinitions"]
    choices = [{}]
    for of in parameters:
        frames = frames_of(put(of["range"], {}))
        count = int(put(of["chunks"]["defaultTaskCount"], {})) if of["type"] == "CHUNK[INT]" else 1
        assert of["type"] in ("INT", "CHUNK[INT]") and len(parameters) == 1 and ("chunks" in of) == (of["type"] != "INT")
        choices = [{f"Task.Param.{of['name']}": ",".join(map(str, frames[k:k + count]))} for k in range(0, len(frames), count)]
    return [[put(word, choice) for word in (action["command"], *action["args"])] for choice in choices]


BUNDLES = {
    "chunks": (FRAMES, [], "CHUNK[INT]", [[1, 2, 3]]),
    "chunks of the spec": ({**FRAMES, "frames": "1-5x2", "chunk": 2}, [], "CHUNK[INT]", [[1, 3], [5]]),
    "tasks of one frame": ({**FRAMES, "frames": "1-5x2"}, ["int"], "INT", [[1], [3], [5]]),
    "a coherent sequence": ({**FRAMES, "coherent": True}, [], None, [[1, 2, 3]]),
    "a coherent sequence, one frame": ({**FRAMES, "coherent": True}, ["int"], None, [[1, 2, 3]]),
    "no frames": (None, [], None, [["-"]]),
}


@pytest.mark.parametrize("bundle", BUNDLES)
def test_a_bundle_runs_all_frames_elsewhere(place, bundle):
    yaml = pytest.importorskip("yaml")
    queue, words, kind, expected = BUNDLES[bundle]
    write_spec(place, **({"queue": queue} if queue else {}))
    made = run(place, "hexad-frame", "--openjd-bundle", "spec.json", "bundle", *words)
    assert made.returncode == 0 and not made.stderr, made
    template = yaml.safe_load((place / "bundle/template.yaml").read_text())
    assert template.get("extensions") == (["TASK_CHUNKING"] if kind == "CHUNK[INT]" else None)
    values = {p["name"]: p.get("default") for p in template["parameterDefinitions"]}
    values |= {"Spec": place / "bundle" / values["Spec"], "Output": place / "out"}
    tasks = tasks_of(template, values)
    assert [[n if n == "-" else int(n) for n in (frames_of(t[3]) if t[3] != "-" else ["-"])] for t in tasks] == expected
    if kind:
        assert template["steps"][0]["parameterSpace"]["taskParameterDefinitions"][0]["type"] == kind
    (place / "elsewhere").mkdir()
    for task in tasks:
        assert run(place / "elsewhere", *task).returncode == 0, task
    reports = [place / "out/report.json"] if not queue else [place / f"out/{f}/report.json" for f in sum(expected, [])]
    sequences = [json.loads(path.read_text()).get("sequence", {}).get("previous_frame") for path in reports]
    assert sequences == ([None, 1, 2] if "coherent" in bundle else [None] * len(reports))


def test_hosts_of_a_bundle_have_what_the_estimate_states(place, worker):
    """The memory of the largest of the first, the middle and the last frame; limits of the spec come before it."""
    yaml = pytest.importorskip("yaml")

    def required(**more):
        write_spec(place, **more)
        assert run(place, "hexad-frame", "--openjd-bundle", "spec.json", "bundle").returncode == 0
        (step,) = yaml.safe_load((place / "bundle/template.yaml").read_text())["steps"]
        host = step["hostRequirements"]
        assert host["attributes"] == [{"name": "attr.worker.os.family", "anyOf": ["linux"]}]
        return {of["name"]: of["min"] for of in host["amounts"]}

    queue = {"frames": "1-3", "by_frame": {"/sampling/count": [200, 300, 60000]}}
    found = required(queue=queue)
    assert run(place, "hexad-worker", "estimate", "spec.json", "--frame", 3, "--output", "estimate").returncode == 0
    told = json.loads((place / "estimate/estimate.json").read_text())["memory_bytes"] / 2 ** 20
    assert found["amount.worker.vcpu"] == 1 and 1.1 * told < found["amount.worker.memory"] < 1.3 * told + 1
    found = required(queue=queue, limits={"memory_mb": 512}, solver={"threads": 3})
    assert found == {"amount.worker.vcpu": 3, "amount.worker.memory": 512}


@pytest.mark.parametrize("fault", ["a relative path", "frames of files", "no spec", "a spec that is not valid"])
def test_a_bundle_that_could_not_run_is_refused(place, fault):
    spec, more, words = {"a relative path": ("spec.json", {"surface": {"mesh": {"path": "m.obj"}}}, "does not begin with /"),
                         "frames of files": ("spec.json", {"surface": {"mesh": {"path": "/m%d.obj"}}, "queue": {"frames": "all"}}, "list the frames"),
                         "no spec": ("none.json", {}, "cannot read none.json"),
                         "a spec that is not valid": ("spec.json", {"sampling": {"count": 3}}, "/sampling/count")}[fault]
    write_spec(place, **more)
    done = run(place, "hexad-frame", "--openjd-bundle", spec, "bundle")
    assert done.returncode == 2 and words in done.stderr and not (place / "bundle").exists(), done


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
