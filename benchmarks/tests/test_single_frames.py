"""The benchmark of masks of single frames: settings, and the IoU of the mask that fits best."""

import numpy as np
import pytest

from benchmarks.single_frames.__main__ import best_ious, options
from egosplat.errors import UserError
from egosplat.segments.options import SegmentsOptions


def test_a_setting_changes_its_keys_alone():
    """Numbers keep their type; no setting is the defaults; a key that is gone is named."""
    assert options("") == SegmentsOptions()
    assert options("crops_per_side=3,min_area=0.5") == SegmentsOptions(crops_per_side=3, min_area=0.5)
    with pytest.raises(UserError, match="pred_iou_thresh"):
        options("pred_iou_thresh=0.5")


def test_the_best_mask_of_any_level_counts():
    """A thing of 100 pixels: half of it at one level, all of it and as much again at another, nothing at the third."""
    truth = np.full((40, 40), -1)
    truth[:10, :10] = 4
    found = np.full((3, 40, 40), -1)
    found[0, :5, :10] = 7
    found[1, :10, :15] = 8
    assert list(best_ious(truth, found)) == [("> 5 %", pytest.approx(100 / 150))]


def test_a_thing_without_a_mask_counts_as_zero_and_a_tiny_one_not():
    """Things below 40 pixels are not scored."""
    truth = np.full((40, 40), -1)
    truth[:10, :10], truth[20, :5] = 1, 2
    assert list(best_ious(truth, np.full((3, 40, 40), -1))) == [("> 5 %", 0.0)]
