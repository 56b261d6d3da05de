"""The place of the largest relevancy."""

import numpy as np
import pytest

from egosplat.query.maps import PLATEAU, localize


@pytest.fixture
def maps() -> np.ndarray:
    """(3, 4, 5) float32 with the largest value at level 1, row 2, column 3."""
    maps = np.full((3, 4, 5), 0.4, np.float32)
    maps[0, 0, 0], maps[1, 2, 3], maps[2, 3, 4] = 0.6, 0.7, 0.65
    return maps


def test_the_level_with_the_largest_value_is_taken(maps):
    found = localize(maps, np.ones(maps.shape, bool))
    assert (found.level, found.pixel) == (1, (3, 2))
    assert found.score == pytest.approx(0.7)


def test_invisible_pixels_are_not_found(maps):
    seen = np.ones(maps.shape, bool)
    seen[1, 2, 3] = False
    assert (localize(maps, seen).level, localize(maps, seen).pixel) == (2, (4, 3))
    seen[1:] = False
    assert localize(maps, seen).pixel == (0, 0)


def test_ties_between_levels_take_the_first(maps):
    maps[0, 0, 0] = maps[1, 2, 3]
    assert localize(maps, np.ones(maps.shape, bool)).level == 0


def test_a_constant_map_is_found_in_its_middle():
    found = localize(np.full((1, 5, 3), 0.5, np.float32), np.ones((1, 5, 3), bool))
    assert found.pixel == (1, 2)


def test_the_innermost_of_equal_pixels_is_found_whatever_their_rounding():
    values = np.zeros((1, 30, 40), np.float32)
    values[0, 5:20, 10:25] = 0.8
    # The largest value, by rounding alone, lies in a corner of the square.
    values[0, 5, 10] += 5e-7
    found = localize(values, np.ones(values.shape, bool))
    assert found.pixel == (17, 12)


def test_a_larger_value_is_found_wherever_it_lies():
    values = np.full((1, 30, 40), 0.8, np.float32)
    values[0, 29, 39] += 2 * PLATEAU
    assert localize(values, np.ones(values.shape, bool)).pixel == (39, 29)


def test_the_pixel_has_the_largest_value_even_if_the_middle_has_not():
    values = np.zeros((1, 1, 9), np.float32)
    values[0, 0, [0, 1, 8]] = 1.0
    assert localize(values, np.ones(values.shape, bool)).pixel == (1, 0)
