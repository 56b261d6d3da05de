"""Resizing images, masks and label maps."""

import numpy as np
import pytest

from egosplat.images import resize_image, resize_labels, resize_mask, shrunk_size


@pytest.mark.parametrize("factor", [1, 2, 3, 4])
def test_labels_are_taken_under_the_center_of_each_pixel(factor):
    labels = np.arange(24 * 12).reshape(24, 12)
    middle = factor // 2
    assert (resize_labels(labels, 12 // factor, 24 // factor) == labels[middle::factor, middle::factor]).all()


def test_labels_do_not_shift_when_the_sizes_do_not_divide():
    columns = np.broadcast_to(np.arange(100), (100, 100))
    small = resize_labels(columns, 37, 37)
    centers = (np.arange(37) + 0.5) * 100 / 37
    assert (small[0] == np.floor(centers)).all()
    assert (small[0] + small[0][::-1] >= 98).all() and (small[0] + small[0][::-1] <= 100).all()


def test_a_mask_keeps_pixels_that_are_wholly_inside():
    mask = np.ones((30, 30), bool)
    mask[7, 8] = False
    expected = np.ones((20, 20), bool)
    expected[4:6, 5] = False
    # Rows 7..8 of the large mask reach into rows 4 and 5 of the small one, column 8 into column 5 only.
    assert (resize_mask(mask, 20, 20) == expected).all()


def test_areas_are_averaged_and_an_image_of_the_wanted_size_is_not_copied():
    image = np.random.default_rng(0).integers(0, 256, (60, 80, 3), dtype=np.uint8)
    small = resize_image(image, 20, 15)
    assert np.abs(small - image.reshape(15, 4, 20, 4, 3).mean(axis=(1, 3))).max() <= 0.5
    assert resize_image(image, 80, 60) is image


@pytest.mark.parametrize(
    ("longest", "size"), [(None, (64, 48)), (1000, (64, 48)), (64, (64, 48)), (32, (32, 24)), (1, (1, 1))]
)
def test_the_longer_side_shrinks_and_never_grows(longest, size):
    assert shrunk_size(64, 48, longest) == size
