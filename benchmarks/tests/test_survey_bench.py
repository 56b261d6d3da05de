"""Area under the ROC, and the recordings that limits are chosen on."""

from pathlib import Path

import pytest

from benchmarks.survey.__main__ import is_tuning
from egosplat.evaluation.presence import separation


def test_the_area_counts_ties_half():
    assert separation([1.0, 2.0], [0.0, 0.0]) == 1.0
    assert separation([0.0, 2.0], [0.0, 0.0]) == 0.75
    assert separation([0.0], [1.0]) == 0.0


@pytest.mark.parametrize(
    "name, tuning",
    [("all_once_still", True), ("poses_twice_moving", False), ("scene10", False), ("scene3", True)],
)
def test_the_validation_apartments_and_every_second_strength_are_left_out(name, tuning):
    assert is_tuning(Path("results", name)) is tuning
