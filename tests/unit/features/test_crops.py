"""Regions cover their instances, and crops show one instance on black, centered and upright."""

import numpy as np
import pytest

from egosplat.features.crops import cut_crop, fill_hull, find_regions, resize


def test_each_instance_has_its_area_and_box_at_any_level():
    """Also of masks in two parts, and of none."""
    labels = np.full((2, 6, 8), -1, np.int32)
    labels[0, 1:3, 2:5] = 3
    labels[0, 5, 7] = labels[0, 3, 6] = 0
    labels[1, :, :] = 2
    labels[1, 2:4, 2:4] = -1
    found = find_regions(labels, 5)
    assert found.instance.tolist() == [0, 2, 3]
    assert found.area.tolist() == [2, 44, 6]
    assert found.box.tolist() == [[6, 3, 8, 6], [0, 0, 8, 6], [2, 1, 5, 3]]
    for shape, count in (((1, 4, 4), 0), ((0, 4, 4), 0), ((2, 3, 3), 4)):
        nothing = find_regions(np.full(shape, -1, np.int32), count)
        assert len(nothing.instance) == len(nothing.area) == 0 and nothing.box.shape == (0, 4)


def test_a_crop_is_black_outside_of_the_mask_and_centered_in_a_square():
    rgb = np.arange(10 * 12 * 3, dtype=np.uint8).reshape(10, 12, 3) + 1
    labels = np.full((10, 12), -1, np.int32)
    labels[2:4, 3:9] = 7
    labels[2, 3] = 1
    crop = cut_crop(rgb, labels, 7, np.array([3, 2, 9, 4]))
    assert crop.shape == (6, 6, 3)
    assert (crop[2, 1:] == rgb[2, 4:9]).all() and (crop[3] == rgb[3, 3:9]).all()
    assert not crop[[0, 1, 4, 5]].any() and not crop[2, 0].any()


@pytest.mark.parametrize("height, width, top, left", [(1, 1, 0, 0), (5, 2, 0, 1), (2, 5, 1, 0), (3, 4, 0, 0)])
def test_every_shape_is_centered(height, width, top, left):
    labels = np.zeros((6, 6), np.int32)
    crop = cut_crop(np.full((6, 6, 3), 9, np.uint8), labels, 0, np.array([0, 0, width, height]))
    side = max(height, width)
    expected = np.zeros((side, side), bool)
    expected[top : top + height, left : left + width] = True
    assert ((crop == 9).all(axis=2) == expected).all()


@pytest.mark.parametrize("interpolation", ["bicubic", "bilinear"])
@pytest.mark.parametrize("side", [1, 31, 32, 200])
def test_crops_get_the_model_s_size_and_keep_their_brightness(side, interpolation):
    resized = resize(np.full((side, side, 3), 77, np.uint8), (32, 48), interpolation)
    assert resized.shape == (32, 48, 3) and (resized == 77).all()


def test_shrinking_averages():
    stripes = np.zeros((64, 64, 3), np.uint8)
    stripes[:, ::2] = 200
    assert np.abs(resize(stripes, (8, 8), "bicubic").astype(int)[:, 1:-1] - 100).max() < 8


def test_a_hull_fills_what_a_mask_leaves_out_and_its_crop_shows_the_picture_there():
    mask = np.zeros((7, 9), bool)
    mask[1:6, 1] = mask[1, 1:8] = mask[5, 1:8] = True
    expected = np.zeros((7, 9), bool)
    expected[1:6, 1:8] = True
    np.testing.assert_array_equal(fill_hull(mask), expected)
    for empty_or_thin in (np.zeros((3, 3), bool), np.eye(1, dtype=bool), np.eye(5, dtype=bool)):
        np.testing.assert_array_equal(fill_hull(empty_or_thin), empty_or_thin)
    rgb = np.arange(7 * 9 * 3, dtype=np.uint8).reshape(7, 9, 3) + 1
    crop = cut_crop(rgb, np.where(mask, 3, -1), 3, np.array([1, 1, 8, 6]), hull=True)
    np.testing.assert_array_equal(crop[1:6], rgb[1:6, 1:8])
    assert not crop[[0, 6]].any()
