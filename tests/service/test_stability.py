# SPDX-License-Identifier: Apache-2.0
"""The interface of doc/stability.md. tests/stability/frozen.txt has exactly the rows of a release candidate (N.N.N~rcN). In other versions
rows of the file may not go or change, and additions are free.

To write the file anew: tests/stability/interface.py BUILD >tests/stability/frozen.txt. A line in NEWS.md names what the difference removes
or changes.
"""
import difflib
import pathlib
import subprocess
import sys

import pytest

STABILITY = pathlib.Path(__file__).parent.parent / "stability"
sys.path.insert(0, str(STABILITY))
import interface  # noqa: E402


@pytest.fixture(scope="module")
def now(build):
    return interface.interface(build)


@pytest.fixture(scope="module")
def frozen():
    return interface.read((STABILITY / "frozen.txt").read_text())


def faults_of(frozen, now, version):
    """What of the interface differs from the file; of a version with `~` every row that does."""
    if "~" not in version:
        return interface.broken(frozen, now)
    return [line for line in difflib.unified_diff(interface.written(frozen).splitlines(), interface.written(now).splitlines(),
                                                  "frozen.txt", "this build", n=0, lineterm="")]


def test_the_interface_is_that_of_the_file(build, frozen, now):
    version = subprocess.run([build / "hexad", "--version"], check=True, capture_output=True, text=True).stdout
    faults = faults_of(frozen, now, version)
    assert len(frozen) > 1000 and not faults, "\n".join(faults)


def test_an_additional_row_is_a_fault_until_the_release(frozen):
    more = {**frozen, "spec /sampling/new": ["number"]}
    assert "+spec /sampling/new: number" in faults_of(frozen, more, "hexad 1.0.0~rc1")
    assert not faults_of(frozen, more, "hexad 1.0.0") and not faults_of(frozen, frozen, "hexad 1.0.0~rc1")


@pytest.mark.sanitized
def test_rows_are_read_as_they_are_written(now):
    assert interface.read(interface.written(now)) == now


def changed(rows, key, said):
    assert key in rows
    return {**rows, key: said}


@pytest.mark.parametrize("key, said, told", [
    ("spec /sampling/count", None, "is gone"),
    ("spec /sampling/count", ["number", "minimum 4", "maximum 1e+08"], "was integer, and is number"),
    ("spec /sampling/count", ["integer", "minimum 5", "maximum 1e+08"], "narrower: minimum 5"),
    ("spec /sampling/count", ["integer", "minimum 4", "maximum 1000"], "narrower: maximum 1000"),
    ("spec /sampling/count", ["integer", "required", "minimum 4", "maximum 1e+08"], "has become required"),
    ('spec /attributes[]/interpolation = "cubic"', None, "is gone"),
    ("answer Version/name", ["string"], "need not be in answers any more"),
    ("answer Version/name", ["integer", "required"], "was string, and is integer"),
    ("problem conflict", ["400"], "was 409, and is 400"),
    ("status POST /v1/jobs 201", ["any"], "was Job, and is any"),
    ("setting drain_s", ["60 s"], "was 30 s, and is 60 s"),
    ("metric hexad_attempts_total", ["gauge"], "was counter, and is gauge"),
    ("exit hexadctl 6", None, "is gone"),
])
def test_a_change_is_noticed(frozen, key, said, told):
    mutated = changed(frozen, key, said) if said else {k: v for k, v in frozen.items() if k != key}
    assert len(mutated) >= len(frozen) - 1
    found = interface.broken(frozen, mutated)
    assert len(found) == 1 and key in found[0] and told in found[0], found


def test_a_member_that_must_be_sent_is_noticed(frozen):
    assert interface.broken(frozen, {**frozen, "spec /sampling/new": ["number", "required"]}) == \
        ["spec /sampling/new has become required"]


def test_additions_and_wider_ranges_are_free(frozen):
    more = {**frozen, "spec /sampling/new": ["number"], 'spec /attributes[]/interpolation = "new"': [], "route GET /v2/jobs": [],
            "spec /surface/new": ["object"], "spec /surface/new/path": ["string", "required"],
            "answer Version/new": ["string", "required"], "setting new": ["1"], "problem new": ["409"]}
    more = changed(more, "spec /sampling/count", ["integer", "minimum 1"])
    assert not interface.broken(frozen, changed(more, "answer Attempt/host", ["string", "required"]))
