# SPDX-License-Identifier: Apache-2.0
"""Counts of constants, statements and circles of calls in C code (tools/complexity.py)."""
import pathlib
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools"))

import complexity  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service

SOURCE = """/* 5 in a comment; and 6 */
#include "a3.h"
#define MOST 30
static const double LEAST = 0.25, BOTH[2] = {3, 1};
enum { ROUNDS = 7, FEW };

double f(double x)
{
    for (int k = 0; k < ROUNDS; k++) x += 0.5 * k;
    const char *said = "8; 9";
    return x < 1e-3 ? 1 : x / (2 - 4.5) * BOTH[9];
}
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "f.c"
    path.write_text(SOURCE)
    return path


def test_constants_are_counted_by_name_and_elsewhere(file):
    # 30, 0.25, 3, 7; and 1e-3, 4.5
    assert complexity.constants_of(file) == (4, 2)


def test_a_statement_is_a_semicolon_outside_of_the_head_of_a_loop(file):
    # two declarations and the body of the loop among five
    assert complexity.statements_of(file) == 5


def test_files_that_call_each_other_are_a_circle(tmp_path):
    (tmp_path / "a.c").write_text("void a(void)\n{\n    b();\n}\n")
    (tmp_path / "b.c").write_text("void b(void)\n{\n    c();\n}\n")
    (tmp_path / "c.c").write_text("static void own(void)\n{\n}\n\nvoid c(void)\n{\n    own();\n}\n")
    files = [tmp_path / name for name in ("a.c", "b.c", "c.c")]
    assert complexity.circles(files) == []
    (tmp_path / "c.c").write_text("void c(void)\n{\n    a();\n}\n")
    assert complexity.circles(files) == [files]
