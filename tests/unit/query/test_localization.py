"""The place of the largest relevancy."""

import numpy as np
import pytest

from egosplat.query.maps import localize


@pytest.fixture
def maps() -> np.ndarray:
    """(3, 4, 5) float32 with the largest value at level 1, row 2, column 3."""
    maps = np.full((3, 4, 5), 0.4, np.float32)
    maps[0, 0, 0], maps[1, 2, 3], maps[2, 3, 4] = 0.6, 0.7, 0.65
    return maps


def test_the_level_with_the_largest_value_is_taken(maps):
    found = localize(maps, np.ones(maps.shape, bool))
    assert (found.level, found.pixel, found.candidates.tolist()) == (1, (3, 2), [[3, 2]])
    assert found.score == pytest.approx(0.7)


def test_invisible_pixels_are_no_candidates(maps):
    seen = np.ones(maps.shape, bool)
    seen[1, 2, 3] = False
    assert (localize(maps, seen).level, localize(maps, seen).pixel) == (2, (4, 3))
    seen[1:] = False
    assert localize(maps, seen).pixel == (0, 0)


def test_ties_between_levels_take_the_first(maps):
    maps[0, 0, 0] = maps[1, 2, 3]
    assert localize(maps, np.ones(maps.shape, bool)).level == 0


def test_a_constant_map_has_all_pixels_as_candidates():
    found = localize(np.full((1, 5, 3), 0.5, np.float32), np.ones((1, 5, 3), bool))
    assert len(found.candidates) == 15 and found.pixel == (1, 2)


def test_the_pixel_is_a_candidate_even_if_their_middle_is_not():
    values = np.zeros((1, 1, 9), np.float32)
    values[0, 0, [0, 1, 8]] = 1.0
    assert localize(values, np.ones(values.shape, bool)).pixel == (1, 0)
