"""Tests of the growth of stages: the exponent, the rows, the expected exponents."""

import pytest

from benchmarks.growth.__main__ import growth, row


@pytest.mark.parametrize("exponent", [0.5, 1.0, 2.0])
def test_what_a_command_takes_at_its_start_does_not_count(exponent):
    assert growth([7.0 + size**exponent for size in (5, 50, 500)], 0.1) == pytest.approx(exponent)


def test_noise_makes_no_growth():
    assert growth([10.8, 10.7, 27.0], 1.0) == pytest.approx(1.21, abs=0.01)
    assert growth([3.0, 3.1, 5.0], 1.0) is None


def test_a_row_names_a_growth_of_time_or_memory_above_its_law():
    linear, square = [(3.0, 300.0), (4.0, 300.0), (14.0, 300.0)], [(3.0, 300.0), (4.0, 310.0), (104.0, 310.0)]
    assert row("splats", linear, 1) == [
        "`splats`",
        "3.0",
        "4.0",
        "14.0",
        "1.0",
        "300",
        "300",
        "300",
        "-",
        "1",
    ]
    assert row("splats", linear, 0)[-1] == "0, **worse**"
    assert row("splats", square, 1)[4:] == ["2.0", "300", "310", "310", "-", "1, **worse**"]
    assert (
        row("splats", [(3.0, memory) for _, memory in linear[:2]] + [(3.0, 1900.0)], 1)[-1] == "1, **worse**"
    )
