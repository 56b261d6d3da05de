"""Relevancy maps: smoothed, localized, masked."""

import numpy as np
import pytest

from egosplat.query.maps import PLATEAU, Maps, box_filter, fill_unseen, localize, majority, read_maps, segment
from tests.support.langsplat import LANGSPLAT

SIZE = 48
OPTIONS = LANGSPLAT.change(box_filter=6 / SIZE, majority_filter=7 / SIZE)
ALL = np.ones((SIZE, SIZE), bool)


def find(maps: np.ndarray, valid: np.ndarray = ALL):
    """Level, score and pixel, and level and mask."""
    read = read_maps(maps, valid, OPTIONS)
    return localize(read.smooth, read.shown), segment(read, 0.7, OPTIONS.majority_px(SIZE))


def everywhere(maps: np.ndarray) -> np.ndarray:
    return np.ones_like(maps, bool)


@pytest.mark.parametrize("share", [0.0, 0.25, 0.7])
def test_a_threshold_lies_between_the_least_and_the_largest_relevancy_of_its_level(share):
    maps = np.full((2, SIZE, SIZE), 0.5, np.float32)
    maps[1, 10:30, 10:30], maps[1, :5], maps[0, 0, 0] = 0.9, 0.1, np.nan
    assert read_maps(maps, ALL, OPTIONS).threshold(1, share) == pytest.approx(0.1 + 0.8 * share + PLATEAU)
    # What is hidden, or not valid, moves nothing.
    maps[1, :5] = np.nan
    hidden = read_maps(maps, ALL, OPTIONS)
    assert hidden.threshold(1, share) == pytest.approx(0.5 + 0.4 * share + PLATEAU)
    assert not hidden.shown[1, :5].any() and hidden.shown[1, 5:].all()


def test_there_is_no_answer_outside_of_what_is_valid():
    valid = ALL.copy()
    valid[:, SIZE // 2 :] = False
    maps = np.full((1, SIZE, SIZE), 0.1, np.float32)
    maps[0, :, 30:] = 1.0
    maps[0, 10:20, 5:15] = 0.5
    (_, _, pixel), (_, mask) = find(maps, valid)
    assert 5 <= pixel[0] < 15 and 10 <= pixel[1] < 20
    assert not mask[:, SIZE // 2 :].any() and mask[12:18, 7:13].all()
    # What lies outside moves nothing inside.
    np.testing.assert_array_equal(mask, find(np.where(valid, maps, np.float32(0.3)), valid)[1][1])


def test_the_largest_visible_value_of_all_levels_is_found():
    maps = np.full((3, 4, 5), 0.4, np.float32)
    maps[0, 0, 0], maps[1, 2, 3], maps[2, 3, 4] = 0.6, 0.7, 0.65
    assert localize(maps, everywhere(maps)) == (1, pytest.approx(0.7), (3, 2))
    seen = everywhere(maps)
    seen[1, 2, 3] = False
    assert localize(maps, seen)[::2] == (2, (4, 3))
    seen[1:] = False
    assert localize(maps, seen)[::2] == (0, (0, 0))
    # The first of equal ones.
    maps[0, 0, 0] = maps[1, 2, 3]
    assert localize(maps, everywhere(maps))[0] == 0


def test_the_innermost_of_equal_pixels_is_found_whatever_their_rounding():
    square = np.zeros((30, 40), np.float32)
    square[5:20, 10:25] = 0.8
    # The largest value, by rounding alone, lies in a corner of the square.
    square[5, 10] += 5e-7
    larger = np.full((30, 40), 0.8, np.float32)
    larger[29, 39] += 2 * PLATEAU
    # The middle of a tie has not the largest value.
    apart = np.float32([[1, 1, 0, 0, 0, 0, 0, 0, 1]])
    constant = np.full((5, 3), 0.5, np.float32)
    for values, pixel in ((square, (17, 12)), (larger, (39, 29)), (apart, (1, 0)), (constant, (1, 2))):
        assert localize(values[None], everywhere(values[None]))[2] == pixel


def mask_of(raw: np.ndarray, smooth: np.ndarray | None = None, shown=None, threshold=0.7):
    """The mask of (L, H, W) maps."""
    smooth, shown = raw if smooth is None else smooth, everywhere(raw) if shown is None else shown
    return segment(Maps(raw, smooth, shown), threshold, 1)[1]


def test_the_threshold_is_relative_and_not_included():
    values = np.array([[[0.0, 0.5, 0.6999, 0.7001, 1.0]]], np.float32)
    for one in (values, values * 0.01 + 0.4):
        assert mask_of(one).tolist() == [[False, False, False, True, True]]
    exact = np.array([[[0.0, 0.5, 1.0]]], np.float32)
    assert mask_of(exact, threshold=0.5).tolist() == [[False, False, True]]
    # Invisible pixels do not count; the level is that of the largest mean.
    values[..., [0, 4]] = -9.0, 9.0
    assert mask_of(values, shown=np.abs(values) < 9).tolist() == [[False, False, True, True, False]]
    raw, smooth = np.full((2, 2, 1, 4), 0.1, np.float32)
    raw[0, 0, 0], smooth[0, 0, 0], raw[1, 0, 3], smooth[1, 0, 3] = 0.9, 0.3, 0.8, 0.7
    assert mask_of(raw, smooth).tolist() == [[False, False, False, True]]


def test_constants_stay_constant_to_the_last_bit():
    constant = np.full((50, 60), 0.3, np.float32)
    np.testing.assert_array_equal(box_filter(constant, 30), constant)


@pytest.mark.parametrize("size", [1, 3, 7])
def test_the_majority_counts_visible_pixels_only(size):
    mask, half = np.random.default_rng(0).random((20, 17)) > 0.5, size // 2
    found = majority(mask, size)
    for row, column in np.ndindex(mask.shape):
        around = mask[max(0, row - half) : row + half + 1, max(0, column - half) : column + half + 1]
        assert found[row, column] == (2 * around.sum() > around.size)


def test_invisible_pixels_get_the_lowest_visible_value():
    values = np.array([[0.0, 0.4, 0.6]], np.float32)
    filled = fill_unseen(values, np.array([[False, True, True]]))
    np.testing.assert_array_equal(filled, np.array([[0.4, 0.4, 0.6]], np.float32))
