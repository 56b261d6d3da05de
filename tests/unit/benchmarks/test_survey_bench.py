"""Area under the ROC, and the probability that is fitted to shares of moving pixels."""

from pathlib import Path

import pytest

from benchmarks.survey.__main__ import fit_probability, is_tuning
from egosplat.evaluation.presence import separation


def test_the_area_counts_ties_half():
    assert separation([1.0, 2.0], [0.0, 0.0]) == 1.0
    assert separation([0.0, 2.0], [0.0, 0.0]) == 0.75
    assert separation([0.0], [1.0]) == 0.0


def test_the_fitted_probability_lies_between_the_groups():
    even, power = fit_probability([0.0] * 10, [2e-3, 5e-3, 1e-2] * 4)
    assert 1e-4 < even < 2e-3 and power > 1
    overlapping, flat = fit_probability([0.0, 3e-3] * 5, [1e-3, 1e-2] * 5)
    assert 1e-4 < overlapping < 1e-2 and flat < power


@pytest.mark.parametrize(
    "name, tuning",
    [("all_once_still", True), ("poses_twice_moving", False), ("scene10", False), ("scene3", True)],
)
def test_the_validation_apartments_and_every_second_strength_are_left_out(name, tuning):
    assert is_tuning(Path("results", name)) is tuning
