# SPDX-License-Identifier: Apache-2.0
"""What doc/stability.md promises: nothing of tests/stability/frozen.txt goes or changes. Additions are free.

To add what a release has brought: tests/stability/interface.py BUILD >tests/stability/frozen.txt, and see in the difference that
lines were added only.
"""
import pathlib
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


def test_nothing_that_is_promised_is_gone(frozen, now):
    assert len(frozen) > 1000 and {key.split()[0] for key in frozen} == {key.split()[0] for key in now}
    assert not interface.broken(frozen, now)


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
