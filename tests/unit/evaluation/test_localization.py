"""Hits and accuracy."""

import numpy as np
import pytest

from egosplat.evaluation.scores import bounding_boxes, is_hit, middle_hit, random_hit, target_area


@pytest.fixture
def ring() -> np.ndarray:
    """(20, 20) int32: instance 0 is a ring whose middle is instance 1; 2 is one pixel."""
    labels = np.full((20, 20), -1, np.int32)
    labels[4:13, 6:15] = 0
    labels[7:10, 9:12] = 1
    labels[19, 0] = 2
    return labels


def test_boxes_hold_their_first_and_last_pixel(ring):
    assert bounding_boxes(ring, (0, 2)).tolist() == [[6, 4, 14, 12], [0, 19, 0, 19]]
    assert bounding_boxes(ring, (5,)).shape == (0, 4)


@pytest.mark.parametrize(
    "pixel, box, mask",
    [
        ((6, 4), True, True),
        ((14, 12), True, True),
        ((15, 12), False, False),
        ((5, 4), False, False),
        ((10, 8), True, False),
    ],
)
def test_a_pixel_hits_the_box_or_the_mask_of_an_instance(ring, pixel, box, mask):
    assert is_hit(pixel, target_area(ring, (0,), "box")) is box
    assert is_hit(pixel, target_area(ring, (0,), "mask")) is mask


@pytest.mark.parametrize("target", ["box", "mask"])
def test_any_instance_of_the_category_is_hit(ring, target):
    assert is_hit((0, 19), target_area(ring, (0, 2), target))
    assert not is_hit((0, 19), target_area(ring, (0, 1), target))
    assert not is_hit(None, target_area(ring, (0, 1, 2), target))
    assert not is_hit((6, 4), target_area(ring, (7,), target))


def test_a_box_is_one_instances(ring):
    """Between two instances is in the box of neither."""
    assert not is_hit((3, 16), target_area(ring, (0, 2), "box"))


def test_chance_is_the_share_of_valid_pixels_that_hit(ring):
    """The ring's box has 9x9 pixels, its mask nine fewer; overlapping boxes count once."""
    box, mask = (target_area(ring, (0, 1), target) for target in ("box", "mask"))
    assert random_hit(box, None) == 81 / 400 == random_hit(mask, None)
    assert random_hit(target_area(ring, (0,), "mask"), None) == 72 / 400
    left = np.zeros((20, 20), bool)
    left[:, :8] = True
    assert random_hit(box, left) == 9 * 2 / (20 * 8)


def test_the_middle_of_the_picture(ring):
    """Pixel (10, 10) of 20x20: in the ring's box, in its mask, and outside of the other two."""
    assert [middle_hit(target_area(ring, (one,), "box")) for one in (0, 1, 2)] == [True, False, False]
    assert middle_hit(target_area(ring, (0,), "mask"))
