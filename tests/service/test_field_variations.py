# SPDX-License-Identifier: Apache-2.0
"""Files of every format with one field varied (field_variations.py): the points are right, or there is an error or a warning. The long form
is `make field-variations`."""
import random

import pytest

import field_variations


@pytest.mark.parametrize("names", [sorted(field_variations.FORMATS)[0::2], sorted(field_variations.FORMATS)[1::2]], ids=["half 0", "half 1"])
def test_a_field_that_means_something_else_is_not_read_silently(build, names):
    seed = random.randrange(2 ** 31)
    print("seed", seed)
    table, faults = field_variations.check(build / "hexad-worker", seed, 60, names)
    assert not faults
    assert sum(sum(counts.values()) for counts in table.values()) == 60


def test_variations_reach_every_format():
    _, picked = field_variations.chosen(1, 600)
    assert {name for name, _, _, _ in picked} == set(field_variations.FORMATS)
