# SPDX-License-Identifier: Apache-2.0
"""The fuzz targets: replays of all stored files without clang, and, with clang, a few seconds of fuzzing."""
import itertools
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

import pytest

SOURCE = pathlib.Path(__file__).resolve().parents[2]
TARGETS = re.search(r"^fuzz_targets = (.*)", (SOURCE / "Makefile.am").read_text(), re.M)[1].split()
# targets that are fuzzed here, with the modules that clang instruments; the build's libraries provide the rest
SMOKE = {"spec": ["src/base/json/*.c", "src/spec/*.c"],
         "ply": ["src/io/points/ply.c", "src/io/points/column.c"],
         "mesh": ["src/io/meshes/plain_*.c", "src/io/meshes/ply_*.c", "src/io/meshes/polygon.c",
                  "src/io/meshes/zip_entry.c"]}
SMOKE_S = 2  # of each target
# what a target reads of the shared data
SHARED = {"spec": ["json/JSONTestSuite", "json/naughty_strings"], "vdb": ["malformed/openvdb_damaged"],
          "exr": ["malformed/openexr_tests", "malformed/exrs_fuzzed", "malformed/exr_damaged"]}
# of a sanitized build; OpenVDB loses nodes of trees that are cut short, the process that reads headers what it reads
SANITIZER = {"vdb": "detect_leaks=0:max_allocation_size_mb=256", "dense": "detect_leaks=0"}


def replay(build, target, folders):
    files = [path for folder in folders for path in folder.rglob("*") if path.is_file()]
    done = subprocess.run([build / "fuzz" / f"replay_{target}", *folders], capture_output=True, text=True,
                          env={**os.environ, "ASAN_OPTIONS": SANITIZER.get(target, "")})
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stdout == f"{len(files)} files\n" and files


@pytest.mark.sanitized
@pytest.mark.parametrize("target", TARGETS)
def test_kept_files(build, source, target):
    kept = [source / "fuzz" / kind / target for kind in ("corpus", "regressions")]
    replay(build, target, [folder for folder in kept if folder.is_dir()])


@pytest.mark.sanitized
def test_any_two_surfaces_in_one_spec(build, source, tmp_path):
    """The seeds of the target for specs: each pair of members of /surface, drawn from the worker's schema. A sanitized
    build reports what a replay does not free."""
    made = subprocess.run([sys.executable, "-B", source / "fuzz" / "pairs.py", build / "hexad-worker", tmp_path / "pairs"],
                          capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    kinds = json.loads(subprocess.run([build / "hexad-worker", "schema"], check=True, capture_output=True,
                                      text=True).stdout)["properties"]["surface"]["properties"]
    named = {frozenset(json.loads(path.read_text())["surface"]) for path in (tmp_path / "pairs").iterdir()}
    assert {frozenset(pair) for pair in itertools.combinations(kinds, 2)} <= named
    replay(build, "spec", [tmp_path / "pairs"])


@pytest.mark.sanitized
@pytest.mark.parametrize("target", SHARED)
def test_shared_files(build, shared_data, target):
    replay(build, target, [shared_data / folder for folder in SHARED[target]])


@pytest.mark.sanitized
def test_a_worker_outlives_what_was_found(build, source, tmp_path):
    """As a job, with the modules that a worker loads."""
    found = sorted((source / "fuzz" / "regressions" / "vdb").iterdir())
    told = {}
    for path in found:
        spec = {"version": 1, "surface": {"vdb": {"path": str(path), "isovalue": 0.5}}, "sampling": {"count": 100}}
        done = subprocess.run([build / "hexad-worker", "run", "-", "--output", tmp_path / path.name], text=True,
                              input=json.dumps(spec), capture_output=True,
                              env={**os.environ, "ASAN_OPTIONS": "detect_leaks=0"})  # OpenVDB loses nodes, as above
        assert done.returncode in (0, 3, 4, 10), (path, done.returncode, done.stderr)
        told[path.name] = done.stderr
    assert "whose number differs from that of their node" in told["length-of-values"]


def test_no_file_is_passed_over(build, tmp_path):
    done = subprocess.run([build / "fuzz" / "replay_spec", tmp_path / "none"], capture_output=True, text=True)
    assert done.returncode == 1 and "No such file" in done.stderr


def build_fuzzer(target, build, source, clang, where):
    """Instruments the modules of SMOKE only, since clang takes minutes for all of them."""
    settings = (build / "Makefile").read_text()
    libs = " ".join(re.findall(r"^(?:CJSON|EXPAT|MINIZIP|ZLIB|SECCOMP|SYSTEMD)_LIBS = (.*)$", settings, re.M)).split()
    modules = [path for pattern in SMOKE[target] for path in sorted(source.glob(pattern))]
    subprocess.run([clang, "-std=gnu11", "-g", "-O1", "-fsanitize=fuzzer,address", "-D_GNU_SOURCE", "-DHAVE_CONFIG_H",
                    f"-I{build}", f"-I{source}", f"-I{source}/src", source / "fuzz" / f"{target}.c", *modules,
                    build / "libvolume.a", build / "libhexad.a", *libs, "-lm", "-lpthread",
                    "-o", where / f"fuzz_{target}"], check=True)


@pytest.mark.extended
def test_a_few_seconds_of_most(build, source, tmp_path):
    """The targets of SMOKE find no fault in a few seconds.

    `make fuzz-smoke` instruments all modules and runs all targets. It is not part of CI: its build takes minutes."""
    clang = next((found for found in map(shutil.which, ("clang", "clang-14")) if found), None)
    if not clang:
        pytest.skip("there is no clang, which the fuzzers are built with")
    (tmp_path / "fuzz").mkdir()
    for target in SMOKE:
        build_fuzzer(target, build, source, clang, tmp_path / "fuzz")
    done = subprocess.run([source / "fuzz" / "run", str(SMOKE_S), "smoke", *SMOKE], cwd=tmp_path, capture_output=True,
                          text=True, env={k: v for k, v in os.environ.items() if k != "HEXAD_SHARED"})
    logs = "".join(path.read_text(errors="replace")[-3000:] for path in (tmp_path / "smoke").glob("*/log"))
    assert done.returncode == 0, done.stdout + done.stderr + logs
    told = dict(re.findall(r"^(\w+): (\d+) executions", done.stdout, re.M))
    assert set(told) == set(SMOKE) and all(int(count) > 0 for count in told.values()), done.stdout


@pytest.mark.extended
def test_random_specs(build, source, tmp_path):
    """A few specs, with files that the program writes. `make fuzz-specs` runs for an hour, with the shared data."""
    done = subprocess.run([sys.executable, "-B", source / "fuzz" / "specs.py", build / "hexad-worker", tmp_path,
                           "--runs", "4", "--seed", "22", "--cpu-seconds", "2"], capture_output=True, text=True,
                          env={k: v for k, v in os.environ.items() if k != "HEXAD_SHARED"})
    assert done.returncode == 0 and re.search(r"^0 of \d+ broke something$", done.stdout, re.M), done.stdout + done.stderr
    assert re.search(r"\d+ (converged|unresolved)", done.stdout), done.stdout


def give_wrong(build, source, folder, *words, **more):
    done = subprocess.run([sys.executable, "-B", source / "fuzz" / "specs.py", build / "hexad-worker", folder, "--seed", "1",
                           "--wrong", *words], capture_output=True, text=True, **more)
    assert done.returncode == 0 and re.search(r"^0 of \d+ specs with wrong values broke something$", done.stdout, re.M), \
        done.stdout + done.stderr
    return done.stdout


@pytest.mark.sanitized
def test_wrong_values_of_every_member_are_refused(build, source, tmp_path):
    """Alone and in pairs, in one process. These specs have every kind of the faults that measurements/reliability/fuzz_faults.csv lists."""
    told = give_wrong(build, source, tmp_path, "lines", "--program", build / "fuzz" / "lines_spec", "--runs", "5000")
    assert "5000 lines" in told


def members_of_specs(build):
    """JSON Pointers of all members."""
    rows = subprocess.run([build / "hexad-worker", "spec-help", "all"], check=True, capture_output=True, text=True).stdout
    return set(re.findall(r"^(/\S+) \(", rows, re.M))


def test_the_dictionary_of_the_target_for_specs_has_every_member(build, source):
    words = set(re.findall(r'\\"(\w+)\\"', (source / "fuzz" / "spec.dict").read_text()))
    assert {pointer.rpartition("/")[2] for pointer in members_of_specs(build)} <= words


def test_wrong_values_are_tried_for_every_member(build, source, monkeypatch):
    monkeypatch.syspath_prepend(source / "fuzz")
    import specs
    schema = json.loads(subprocess.run([build / "hexad-worker", "schema"], check=True, capture_output=True, text=True).stdout)
    made = specs.wrong_specs(schema, 1)
    assert [next(made) for _ in range(50)] == list(itertools.islice(specs.wrong_specs(schema, 1), 50))
    members = members_of_specs(build)
    places = specs.wrong_places(schema)
    assert members <= {re.sub(r"/0", "", place) for place in places}
    assert {"/surface/union/0/mesh/path", "/region/inside/exr/slices", "/attributes/0"} <= places


def test_a_spec_that_breaks_the_target_is_kept(build, source, tmp_path):
    program = tmp_path / "breaks"
    program.write_text("#!/bin/sh\nread -r one\nprintf '1\\n2\\nAddressSanitizer\\n' >&2\nexit 7\n")
    program.chmod(0o700)
    done = subprocess.run([sys.executable, "-B", source / "fuzz" / "specs.py", build / "hexad-worker", tmp_path, "--seed", "1",
                           "--wrong", "lines", "--program", program, "--runs", "9"], capture_output=True, text=True)
    assert done.returncode == 1 and "exit status 7 at spec 2" in done.stdout, done.stdout + done.stderr
    assert json.loads((tmp_path / "broken.2.json").read_text())


@pytest.mark.extended
def test_wrong_values_are_refused_by_a_worker(build, source, tmp_path):
    told = give_wrong(build, source, tmp_path, "worker", "--runs", "40")
    assert "spec_invalid" in told


@pytest.mark.extended
def test_wrong_values_are_refused_by_a_service(build, source, tmp_path):
    told = give_wrong(build, source, tmp_path, "service", "--runs", "300")
    assert " with status 422" in told, told


def test_random_specs_see_what_is_wrong(build, source, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(source / "fuzz")
    import specs
    spec = {"version": 1, "surface": {"analytic": {"shape": "sphere", "radius": 1}}, "sampling": {"count": 50},
            "output": {"preview": False}}
    made = tmp_path / "made"
    done = subprocess.run([build / "hexad-worker", "run", "-", "--output", made], input=json.dumps(spec), text=True,
                          capture_output=True)
    assert done.returncode in specs.ENDS and specs.fault_of(made, done.returncode, done.stderr) is None
    assert specs.fault_of(made, -11, "") == "exit status -11"
    assert specs.fault_of(made, 5, '{"code":"internal"}') == "error code internal"
    assert specs.fault_of(made, 5, '{"code":"limit_memory"}') == "a report of a run that failed"
    (made / "points.ply").write_bytes((made / "points.ply").read_bytes().replace(b"vertex 50", b"vertex 49"))
    assert "49 in points.ply" in specs.fault_of(made, done.returncode, "")
