"""Levels that repeat another are found and dropped."""

import numpy as np
import pytest
from egosplat.segments.duplicate_levels import drop_levels, find_duplicate_levels

from egosplat.segments.label_maps import LabelMaps

EACH = 25
"""Instances per level, one in each row."""


def film(*levels, frames=2):
    """Labels of levels with one instance per row of 20 pixels, each narrowed by a number of pixels; the table; the levels."""
    labels = LabelMaps((len(levels), EACH, 20))
    for frame in range(frames):
        maps = np.full((len(levels), EACH, 20), -1, np.int32)
        for level, narrowed in enumerate(levels):
            for row in range(EACH):
                if narrowed[row] is not None:
                    maps[level, row, narrowed[row] :] = level * EACH + row
        labels[frame] = maps
    numbers = np.arange(len(levels) * EACH)
    level = np.array([int(number // EACH) for number in numbers], np.int8)
    return labels, np.append(numbers, -1).astype(np.int32), level


SAME = [0] * EACH
NARROW = [10] * EACH
"""IoU 0.5 with full rows."""


@pytest.mark.parametrize(
    ("levels", "expected"),
    [
        ((SAME, SAME, SAME), {0: 2, 1: 2}),
        ((NARROW, SAME, SAME), {1: 2}),
        ((SAME, NARROW, SAME), {0: 2}),
        ((SAME, SAME, NARROW), {0: 1}),
        ((NARROW, SAME, [5] * EACH), {}),  # an IoU of 0.75 is too low
        (([0] * 24 + [10], SAME, NARROW), {0: 1}),  # 96 % repeat
        (([0] * 23 + [10] * 2, SAME, NARROW), {}),  # 92 % repeat: too few
        ((SAME, [4] * EACH, NARROW), {}),  # 0.8 exactly is not above
        # The first equals only the second, and the second equals the third.
        ((SAME, [3] * EACH, [5] * EACH), {0: 2, 1: 2}),
    ],
)
def test_a_level_repeats_another_with_the_same_instances(levels, expected):
    assert find_duplicate_levels(*film(*levels), 3) == expected


def test_a_subset_of_another_level_repeats_it_and_a_superset_does_not():
    few = [0] * 5 + [None] * 20
    labels, table, level = film(few, SAME)
    shown = np.append(np.where((np.arange(2 * EACH) >= 5) & (np.arange(2 * EACH) < EACH), -1, 0), -1)
    new = np.append(np.cumsum(shown[:-1] >= 0) - 1, -1)
    table = np.where(shown >= 0, new, -1).astype(np.int32)
    level = np.array([0] * 5 + [1] * EACH, np.int8)
    assert find_duplicate_levels(labels, table, level, 2) == {0: 1}
    assert find_duplicate_levels(labels, table, 1 - level, 2) == {1: 0}


def test_a_level_without_instances_repeats_none():
    labels, table, level = film([None] * EACH, SAME)
    table[:EACH] = -1
    table[EACH:-1] -= EACH
    assert find_duplicate_levels(labels, table, level[EACH:], 2) == {}


def test_remaining_levels_are_renumbered():
    table = np.array([0, 1, -1, 2, 3, -1], np.int32)
    level = np.array([0, 1, 0, 1], np.int8)
    assert drop_levels({0: 1}, table, level).tolist() == [-1, 0, -1, -1, 1, -1]
    assert drop_levels({}, table, level).tolist() == table.tolist()
