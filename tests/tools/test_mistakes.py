# SPDX-License-Identifier: Apache-2.0
"""measurements/messages/mistakes.py: messages of typical mistakes name their object and what to do, and the results have every mistake."""
import pathlib
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "measurements" / "messages"))
import mistakes  # noqa: E402
from mistakes import results  # noqa: E402

QUICK = {
    "comment in JSON", "misspelt member", "count 0", "wrong path", "wrong grid", "isovalue out of range",
    "no server", "priority without --priority", "unknown id", "fetch before the end",
    "misspelt setting", "port in use", "two daemons on one state directory",
    "path outside the input roots", "scope is missing"}


def test_messages_name_their_object_and_what_to_do(build, tmp_path):
    found = {row[1] for row in mistakes.all_rows()}
    assert QUICK <= found
    made = list(mistakes.make_all(build, tmp_path, lambda row: row[1] in QUICK))
    assert {row[1] for row, _, _ in made} == QUICK
    assert not [fault for row, result, message in made for fault in mistakes.faults_of(row, result, message)]


@pytest.mark.parametrize("result, message, fault", [
    ("exit 2", "count is wrong: raise it", None),
    ("exit 1", "count is wrong: raise it", "the result is exit 1 instead of exit 2"),
    ("exit 2", "a member is wrong: raise it", "does not name count"),
    ("exit 2", "count is wrong", "has no instruction")])
def test_a_message_without_its_parts_is_a_fault(result, message, fault):
    row = ("worker", "count 0", "{}", "exit 2", "count", None)
    faults = mistakes.faults_of(row, result, message)
    assert not faults if fault is None else len(faults) == 1 and fault in faults[0]


def test_the_results_have_every_mistake(source):
    rows = [row["mistake"] for row in results.read(source / "measurements/messages/messages.csv")]
    assert len(rows) == len(set(rows)) >= 80
    assert {mistakes.name_of(row) for row in mistakes.all_rows()} == set(rows)
