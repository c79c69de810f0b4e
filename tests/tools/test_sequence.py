# SPDX-License-Identifier: Apache-2.0
"""The formula of the torus' motion, against which sequences are measured, and what is told of a frame that misses."""
import pathlib
import sys

import numpy
import pytest

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[2] / "measurements" / folder) for folder in ("common", "sequences")]

import results  # noqa: E402
import sequence  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service

TORUS = sequence.TORUS


def points_on(torus, count=500):
    u, v = numpy.random.default_rng(1).uniform(0, 2 * numpy.pi, (2, count))
    out = torus.major + torus.minor * numpy.cos(v)
    local = numpy.stack([out * numpy.cos(u), out * numpy.sin(u), torus.minor * numpy.sin(v)], axis=1)
    return torus.centre + local @ torus.axes.T


def test_points_are_carried_onto_the_next_torus():
    for growth in ([1.01, 1.01], [1.0, 1.05]):
        shape = {**TORUS, "growth": growth}
        here, there = sequence.Torus(3, shape), sequence.Torus(4, shape)
        start = points_on(here)
        assert abs(here.distance(start)).max() < 1e-12
        assert abs(there.distance(here.carry(start, there))).max() < 1e-12


def test_a_torus_that_stands_still_or_spins_moves_nobody():
    for turn in ([0, 0, 0], [0, 0, 0.3]):  # about its own axis in frame 1
        shape = {**TORUS, "velocity": [0, 0, 0], "turn": turn, "growth": [1, 1]}
        here, there = sequence.Torus(1, shape), sequence.Torus(2, shape)
        start = points_on(here)
        assert abs(here.carry(start, there) - start).max() < 1e-12


def test_a_measure_that_misses_is_told(tmp_path):
    good = {"frame": 2, "count": 9, "hex": 0.95, "area_cv": 0.02, "born": 0, "died": 0, "sweeps": 1, "kept": 1, "processor_s": 0.5, "median": 0.01,
            "p95": 0.1}
    assert sequence.is_good({}, good) and sequence.is_good({}, {**good, "median": None})
    for bad in ({"hex": 0.9}, {"median": 0.11}):
        assert not sequence.is_good({}, {**good, **bad})
        sequence.write_results(tmp_path / "sequences.csv", {"torus": [good, {**good, **bad}], "smoke": "skipped"})
        torus, smoke = results.read(tmp_path / "sequences.csv")
        assert torus["missed"] == "1" and smoke["missed"] == "skipped"
        assert [row["row"] for row in results.read(tmp_path / "sequences_frames.csv")] == ["torus 2", "torus 2"]
