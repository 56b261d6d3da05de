"""Box filter, majority filter, and the values of pixels that show nothing."""

import cv2
import numpy as np
import pytest

from egosplat.query.maps import box_filter, fill_unseen, majority


def picture(height: int, width: int) -> np.ndarray:
    return np.random.default_rng(0).random((height, width), dtype=np.float32)


@pytest.mark.parametrize("shape", [(64, 50), (9, 70), (1, 12), (1, 1)])
@pytest.mark.parametrize("size", [30, 7])
def test_box_filter_equals_opencvs_filter2d(shape, size):
    values = picture(*shape)
    kernel = np.full((size, size), 1 / size**2, np.float32)
    np.testing.assert_allclose(box_filter(values, size), cv2.filter2D(values, -1, kernel), atol=2e-7)
    before, behind = size // 2, (size - 1) // 2
    padded = np.pad(values.astype(np.float64), (before, behind), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (size, size))
    np.testing.assert_allclose(box_filter(values, size), windows.mean(axis=(-1, -2)), atol=1e-6)


def test_constants_stay_constant_to_the_last_bit():
    values = np.full((50, 60), 0.3, np.float32)
    np.testing.assert_array_equal(box_filter(values, 30), values)


def test_a_side_of_one_changes_nothing():
    values = picture(9, 8)
    np.testing.assert_array_equal(box_filter(values, 1), values)
    np.testing.assert_array_equal(majority(values > 0.5, 1), values > 0.5)


@pytest.mark.parametrize("size", [3, 7])
def test_the_majority_counts_visible_pixels_only(size):
    mask, half = picture(20, 17) > 0.5, size // 2
    found = majority(mask, size)
    for row, column in np.ndindex(mask.shape):
        around = mask[max(0, row - half) : row + half + 1, max(0, column - half) : column + half + 1]
        assert found[row, column] == (2 * around.sum() > around.size)


def test_invisible_pixels_get_the_lowest_visible_value():
    values = np.array([[0.0, 0.4, 0.6]], np.float32)
    filled = fill_unseen(values, np.array([[False, True, True]]))
    np.testing.assert_array_equal(filled, np.array([[0.4, 0.4, 0.6]], np.float32))
    assert not fill_unseen(values, np.zeros((1, 3), bool)).any()
