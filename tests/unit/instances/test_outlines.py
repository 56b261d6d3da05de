"""Things have the outlines of their masks where they have some, and are rendered elsewhere."""

import numpy as np

from egosplat.instances.scene import draw_masks, keep_outlines


def labels(*rows: list[int]) -> np.ndarray:
    """(1, H, W) labels."""
    return np.array([rows], np.int32)


def test_a_mask_takes_the_name_of_its_thing_in_its_own_frame():
    """A track may show one thing in one frame and another in the next."""
    named = np.array([[0, 0, 3], [7, 2, 7], [1, -1, 4]])
    assert draw_masks(named, 0, labels([7, 2, -1, 5])).tolist() == [[[1, -1, -1, -1]]]
    assert draw_masks(named, 3, labels([7, 2, -1, 5])).tolist() == [[[4, -1, -1, -1]]]
    assert draw_masks(named, 1, labels([7, 2, -1, 5])).tolist() == [[[-1, -1, -1, -1]]]


def test_a_mask_replaces_the_rendering_of_its_thing_and_of_what_it_covers():
    rendered, drawn = labels([0, 0, 0, 1, 1, 2]), labels([-1, 0, 0, 0, -1, -1])
    # Thing 0 ends where its mask ends; 1 and 2 have no mask, and stay where 0 is not.
    assert keep_outlines(rendered, drawn).tolist() == [[[-1, 0, 0, 0, 1, 2]]]
