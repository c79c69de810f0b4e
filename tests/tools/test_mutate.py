# SPDX-License-Identifier: Apache-2.0
"""measurements/mutations/mutate.py: which tests it leaves out, and what its results have."""
import sys

import pytest


@pytest.fixture
def mutate(source, monkeypatch):
    monkeypatch.syspath_prepend(source / "measurements/mutations")
    import mutate
    yield mutate
    sys.modules.pop("mutate")


def test_measuring_tests_of_any_folder_are_found(mutate, tmp_path, monkeypatch):
    for folder, test in (("src/spec", "tests/unit/test_spec"), ("src/io/points", "tests/unit/test_ply")):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "Makefile.inc").write_text(f"measuring_tests += \\\n\t{test}\n")
    monkeypatch.setattr(mutate, "SOURCE", tmp_path)
    assert sorted(mutate.measuring_tests()) == ["tests/unit/test_ply", "tests/unit/test_spec"]


def test_results_have_what_survives_with_its_reason(mutate, tmp_path, capsys):
    def record(name, result, tier=None):
        return {"id": name, "file": f"src/base/{name}.c", "line": 3, "operator": "missing free", "result": result, "tier": tier, "how": None,
                "changes": [{"line": 3, "before": "free(a);", "after": ";"}]}
    records = [record("one", "found", "basic"), record("two", "survived"), record("three", "survived"), record("four", "not executed")]
    document = {"mutants": {r["id"]: r for r in records}, "baseline": {}, "seed": 1, "limit": 0}
    mutate.write_results(document, {"three": "found since by test_three"}, {"two": record("two", "found", "extended")}, tmp_path)
    survivors = mutate.results.read(tmp_path / "survivors.csv")
    assert [(row["id"], row["executed"], row["reason"]) for row in survivors] == [("three", "yes", "found since by test_three"), ("four", "no", "")]
    summary = {row["quantity"]: row["number"] for row in mutate.results.read(tmp_path / "summary.csv")}
    assert summary["found by both tiers"] == "2" and summary["found by both tiers, with the tests that were added since"] == "3"
    counts = mutate.results.read(tmp_path / "counts.csv")
    assert [row["group"] for row in counts] == ["folder src/base", "kind missing free"]
    assert list(counts[1].values())[1:] == ["3", "1", "2", "1", "1"]
