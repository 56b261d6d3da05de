"""Masks from relevancy."""

import numpy as np
import pytest

from egosplat.query.maps import segment


def seen(maps: np.ndarray) -> np.ndarray:
    return np.ones(maps.shape, bool)


def test_the_threshold_is_relative_and_not_included():
    values = np.array([[[0.0, 0.5, 0.6999, 0.7001, 1.0]]], np.float32)
    found = segment(values, values, seen(values), 0.7, 1)
    assert found.mask.tolist() == [[False, False, False, True, True]]
    squeezed = segment(values * 0.01 + 0.4, values * 0.01 + 0.4, seen(values), 0.7, 1)
    np.testing.assert_array_equal(squeezed.mask, found.mask)
    exact = np.array([[[0.0, 0.5, 1.0]]], np.float32)
    assert segment(exact, exact, seen(exact), 0.5, 1).mask.tolist() == [[False, False, True]]


@pytest.mark.parametrize("seed", range(3))
def test_mask_follows_langsplats_rule(seed):
    raw, filtered = np.random.default_rng(seed).random((2, 1, 30, 30), dtype=np.float32)
    mean = (0.5 * (raw + filtered)).astype(np.float64)
    scaled = (mean - mean.min()) / (mean.max() - mean.min() + 1e-9)
    expected = np.clip(2 * scaled - 1, 0, 1) > 0.4
    np.testing.assert_array_equal(segment(raw, filtered, seen(raw), 0.7, 1).mask, expected[0])


def test_the_level_is_that_of_the_largest_mean():
    raw, filtered = np.full((2, 2, 1, 4), 0.1, np.float32)
    raw[0, 0, 0], filtered[0, 0, 0] = 0.9, 0.3
    raw[1, 0, 3], filtered[1, 0, 3] = 0.8, 0.7
    found = segment(raw, filtered, seen(raw), 0.7, 1)
    assert found.level == 1 and found.mask.tolist() == [[False, False, False, True]]


def test_invisible_pixels_do_not_count_in_the_mask():
    values = np.array([[[0.0, 0.4, 0.5, 0.6, 9.0]]], np.float32)
    shown = np.array([[[False, True, True, True, False]]])
    assert segment(values, values, shown, 0.7, 1).mask.tolist() == [[False, False, False, True, False]]


def test_majority_filter_takes_the_majority():
    values = np.zeros((1, 20, 20), np.float32)
    values[0, 5:15, 5:15] = 1.0
    values[0, 0, 19] = 1.0
    assert segment(values, values, seen(values), 0.7, 1).mask[0, 19]
    mask = segment(values, values, seen(values), 0.7, 7).mask
    assert not mask[0, 19] and mask[7:13, 7:13].all() and not mask[:3].any()
