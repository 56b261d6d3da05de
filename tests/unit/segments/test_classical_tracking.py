"""The classical segmenter tracks regions and masks by optical flow."""

import cv2
import numpy as np
import pytest

from egosplat.segments.classical.flow import find_origins
from egosplat.segments.classical.partition import partition, reduce_image
from egosplat.segments.classical.segmenter import open_tracks, propagate, segment_video
from egosplat.segments.instances import Video
from egosplat.segments.options import LEVELS

SIDE = 128


def track(images, level, shown=None):
    """The labels of one level in each frame, as numbers of instances."""
    shown = [np.ones(images[0].shape[:2], bool)] * len(images) if shown is None else shown
    found = segment_video(Video(len(images), images.__getitem__, shown.__getitem__))
    return [found.labels[frame][LEVELS.index(level)] for frame in range(len(images))]


def propagated(labels, previous, current, regions):
    """Labels that optical flow brings from one image to the next."""
    images = (reduce_image(image, regions >= 0) for image in (previous, current))
    return propagate(labels, *find_origins(*images), regions)


def texture(seed: int, low: int, high: int, side: int) -> np.ndarray:
    noise = np.random.default_rng(seed).uniform(0, 1, (side, side, 1)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    smooth = (smooth - smooth.min()) / np.ptp(smooth)
    return np.rint(low + (high - low) * smooth[..., None]).astype(np.uint8)


WALL = texture(1, 90, 140, SIDE) * np.array([0, 1, 0], dtype=np.uint8)
BOX = texture(2, 150, 250, 40) * np.array([1, 0, 0], dtype=np.uint8)
VALID = np.ones((SIDE, SIDE), dtype=bool)


def frame(column: int | None) -> tuple[np.ndarray, np.ndarray]:
    """A red box on a green wall, and its mask; no box for None."""
    image, mask = WALL.copy(), np.zeros_like(VALID)
    if column is not None:
        image[44:84, column : column + 40], mask[44:84, column : column + 40] = BOX, True
    return image, mask


def iou(left: np.ndarray, right: np.ndarray) -> float:
    return float((left & right).sum() / (left | right).sum())


def test_a_moving_box_keeps_its_track():
    images, masks = zip(*(frame(column) for column in (20, 25, 30, 35)), strict=True)
    found = track(images, "whole")
    number = found[0][64, 40]
    assert all(labels.dtype == np.int32 and labels.shape == VALID.shape for labels in found)
    assert all(iou(labels == number, mask) > 0.8 for labels, mask in zip(found, masks, strict=True))


def test_the_first_frame_has_the_regions_of_segment():
    image, _ = frame(40)
    (labels,) = track([image], "part")
    expected = partition(reduce_image(image, VALID))[1:3]
    assert (labels == expected[1] + expected[0].max() + 1).all(), "numbered after the subparts"


def test_new_objects_get_new_tracks_and_lost_ones_end():
    images = [frame(column)[0] for column in (None, 40, None)]
    before, during, after = track(images, "whole")
    mask = frame(40)[1]
    (new,) = set(np.unique(during[mask & (cv2.erode(mask.astype(np.uint8), np.ones((9, 9))) > 0)]))
    assert new not in before
    assert iou(during == new, mask) > 0.8
    assert not (after == new)[~mask].any()


def test_labels_are_propagated_and_unlabeled_pixels_stay_unlabeled():
    (previous, mask), (current, moved) = frame(20), frame(26)
    labels = np.where(mask, np.int32(7), np.int32(-1))
    regions = np.where(moved, np.int32(1), np.int32(0))
    carried = propagated(labels, previous, current, regions)
    assert iou(carried == 7, moved) > 0.97
    assert set(np.unique(carried)) == {-1, 7}


def test_large_uncovered_regions_become_tracks():
    regions = np.repeat(np.array([[0, 0, 1, 2, -1]], dtype=np.int32), 4, axis=0)
    labels = np.repeat(np.array([[5, -1, -1, -1, -1]], dtype=np.int32), 4, axis=0)
    labels[1:, 3] = 6
    opened = open_tracks(labels, regions, 9, least_pixels=4)
    assert opened[0].tolist() == [5, 9, 10, -1, -1]
    assert opened[1:, 3].tolist() == [6, 6, 6]


@pytest.mark.parametrize("shape", [(1, 1), (8, 8), (5, 40), (33, 61)])
def test_tiny_and_odd_pictures_are_tracked(shape):
    image = np.full((*shape, 3), 90, dtype=np.uint8)
    found = track([image] * 3, "whole")
    assert all((labels == 2).all() for labels in found), "after a subpart and a part"


def test_pictures_larger_than_the_flow_are_tracked_alike(monkeypatch):
    """Optical flow at a smaller size moves labels as far as at the image's own."""
    (before, mask), (after, moved) = (
        [
            cv2.resize(one.astype(np.uint8), (512, 512), interpolation=cv2.INTER_NEAREST)
            for one in frame(column)
        ]
        for column in (20, 26)
    )
    fine = partition(reduce_image(after, np.ones((512, 512), bool)))[0]
    monkeypatch.setattr("egosplat.segments.classical.partition._SIDE", 128)
    images = (reduce_image(image, fine >= 0) for image in (before, after))
    labels = propagate(mask.astype(np.int32), *find_origins(*images), fine)
    assert iou(labels == 1, moved > 0) > 0.9


def test_pixels_that_a_frame_leaves_out_have_no_label():
    """The box is hidden in the third frame, and everything in the fourth."""
    images, masks = zip(*(frame(column) for column in (20, 25, 30, 35, 40)), strict=True)
    shown = [VALID, VALID, ~masks[2], ~VALID, VALID]
    found = track(images, "whole", shown)
    for labels, inside in zip(found, shown, strict=True):
        assert (labels[~inside] == -1).all() and (labels >= 0).any() == inside.any()
    assert iou(found[2] == found[1][10, 10], ~masks[2]) > 0.8, "the wall goes on"
