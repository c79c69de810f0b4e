# SPDX-License-Identifier: Apache-2.0
"""measurements/mutations/mutate.py: which tests it leaves out."""
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
