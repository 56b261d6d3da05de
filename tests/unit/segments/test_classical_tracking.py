"""The classical segmenter tracks regions and masks by optical flow."""

import cv2
import numpy as np
import pytest

from egosplat.segments.classical.segmenter import (
    LEVELS,
    ClassicalOptions,
    propagate,
    propagate_masks,
    segment,
    track,
    track_levels,
)
from egosplat.segments.classical.tracking import open_tracks

OPTIONS = ClassicalOptions()
SIDE = 128


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
    found = list(track(iter(images), VALID, "whole", OPTIONS))
    number = found[0][64, 40]
    assert all(labels.dtype == np.int32 and labels.shape == VALID.shape for labels in found)
    assert all(iou(labels == number, mask) > 0.8 for labels, mask in zip(found, masks, strict=True))


def test_the_first_frame_has_the_regions_of_segment():
    image, _ = frame(40)
    (labels,) = track([image], VALID, "part", OPTIONS)
    assert (labels == segment(image, VALID, OPTIONS)[1]).all()


def test_new_objects_get_new_tracks_and_lost_ones_end():
    images = [frame(column)[0] for column in (None, 40, None)]
    before, during, after = track(images, VALID, "whole", OPTIONS)
    mask = frame(40)[1]
    (new,) = set(np.unique(during[mask & (cv2.erode(mask.astype(np.uint8), np.ones((9, 9))) > 0)]))
    assert new not in before
    assert iou(during == new, mask) > 0.8
    assert not (after == new)[~mask].any()


def test_tracking_twice_gives_the_same():
    images = [frame(column)[0] for column in (20, 24, 28)]
    first, second = (np.stack(list(track(images, VALID, "subpart", OPTIONS))) for _ in range(2))
    assert (first == second).all()


def test_tracking_holds_two_frames_in_memory():
    alive = []

    def images():
        import weakref

        for column in (20, 24, 28, 32, 36):
            image = frame(column)[0]
            alive.append(weakref.ref(image))
            yield image
            del image
            assert sum(one() is not None for one in alive) <= 2

    for _ in track(images(), VALID, "whole", OPTIONS):
        pass
    assert len(alive) == 5


def test_labels_are_propagated_and_unlabelled_pixels_stay_unlabelled():
    (previous, mask), (current, moved) = frame(20), frame(26)
    labels = np.where(mask, np.int32(7), np.int32(-1))
    regions = np.where(moved, np.int32(1), np.int32(0))
    carried = propagate(labels, previous, current, regions, OPTIONS)
    assert iou(carried == 7, moved) > 0.97
    assert set(np.unique(carried)) == {-1, 7}


def test_pixels_without_support_have_no_label():
    (previous, mask), (current, _) = frame(40), frame(None)
    labels = np.where(mask, np.int32(7), np.int32(3))
    regions = segment(current, VALID, OPTIONS)[0]
    noise = np.random.default_rng(0).integers(0, 256, current.shape, dtype=np.uint8)
    assert (propagate(np.full_like(labels, -1), previous, current, regions, OPTIONS) == -1).all()
    assert (propagate(labels, previous, noise, regions, OPTIONS) == -1).mean() > 0.5


def test_nothing_is_propagated_outside_of_the_regions():
    previous, current = frame(20)[0], frame(24)[0]
    regions = np.zeros(VALID.shape, dtype=np.int32)
    regions[:, :30] = -1
    carried = propagate(np.zeros_like(regions), previous, current, regions, OPTIONS)
    assert ((carried == -1) == (regions == -1)).all()


def test_large_uncovered_regions_become_tracks():
    regions = np.repeat(np.array([[0, 0, 1, 2, -1]], dtype=np.int32), 4, axis=0)
    labels = np.repeat(np.array([[5, -1, -1, -1, -1]], dtype=np.int32), 4, axis=0)
    labels[1:, 3] = 6
    opened = open_tracks(labels, regions, 9, least_pixels=4)
    assert opened[0].tolist() == [5, 9, 10, -1, -1]
    assert opened[1:, 3].tolist() == [6, 6, 6]


def test_overlapping_masks_are_propagated():
    images, masks = zip(*(frame(column) for column in (20, 25, 30)), strict=True)
    half = masks[0].copy()
    half[64:] = False
    found = list(propagate_masks(np.stack([masks[0], half, ~masks[0]]), images, VALID, OPTIONS))
    assert (found[0] == np.stack([masks[0], half, ~masks[0]])).all()
    assert found[2].dtype == bool and found[2].shape == (3, SIDE, SIDE)
    assert iou(found[2][0], masks[2]) > 0.9
    assert iou(found[2][2], ~masks[2]) > 0.9
    lower = masks[2].copy()
    lower[64:] = False
    assert iou(found[2][1], lower) > 0.75


def test_tracking_without_masks_works():
    found = list(propagate_masks(np.zeros((0, SIDE, SIDE), dtype=bool), [frame(20)[0]] * 2, VALID, OPTIONS))
    assert [one.shape for one in found] == [(0, SIDE, SIDE)] * 2


@pytest.mark.parametrize("shape", [(1, 1), (8, 8), (5, 40), (33, 61)])
def test_tiny_and_odd_pictures_are_tracked(shape):
    image = np.full((*shape, 3), 90, dtype=np.uint8)
    found = list(track([image] * 3, np.ones(shape, dtype=bool), "whole", OPTIONS))
    assert all((labels == 0).all() for labels in found)


def test_pictures_larger_than_the_flow_are_tracked_alike():
    pair = [frame(column) for column in (20, 26)]
    large = [
        [cv2.resize(one.astype(np.uint8), (512, 512), interpolation=cv2.INTER_NEAREST) for one in both]
        for both in pair
    ]
    options = ClassicalOptions(flow_side=128)
    masks = large[0][1][None] > 0
    _, found = propagate_masks(masks, [one for one, _ in large], np.ones((512, 512), dtype=bool), options)
    assert iou(found[0], large[1][1] > 0) > 0.9


def test_wrong_input_is_rejected_at_once():
    image, mask = frame(20)
    labels = np.zeros(VALID.shape, dtype=np.int32)
    with pytest.raises(ValueError, match="level"):
        track([image], VALID, "piece", OPTIONS)
    with pytest.raises(ValueError, match="masks"):
        propagate_masks(mask, [image], VALID, OPTIONS)
    with pytest.raises(ValueError, match="masks"):
        propagate_masks(mask[None].astype(np.uint8), [image], VALID, OPTIONS)
    with pytest.raises(ValueError, match="labels"):
        propagate(labels[:-1], image, image, labels, OPTIONS)
    with pytest.raises(ValueError, match="regions"):
        propagate(labels, image, image, labels.astype(np.int64), OPTIONS)
    with pytest.raises(ValueError, match="image"):
        propagate(labels, image.astype(float), image, labels, OPTIONS)
    with pytest.raises(ValueError, match="image"):
        list(track([image[..., 0]], VALID, "whole", OPTIONS))


def test_track_levels_equals_track_of_each_level() -> None:
    rng = np.random.default_rng(4)
    coarse = rng.integers(0, 255, (6, 8, 3), dtype=np.uint8)
    large = np.repeat(np.repeat(coarse, 10, 0), 10, 1)
    images, valid = [np.roll(large, 2 * frame, axis=1) for frame in range(3)], np.ones((60, 80), bool)
    together = list(track_levels(images, valid, ClassicalOptions()))
    for number, level in enumerate(LEVELS):
        for frame, alone in enumerate(track(images, valid, level, ClassicalOptions())):
            assert np.array_equal(together[frame][number], alone)
