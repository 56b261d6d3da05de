"""The classical segmenter divides images into nested regions, and tracks them by optical flow."""

import cv2
import numpy as np
import pytest

from egosplat.segments import classical
from egosplat.segments.classical import segment_video
from egosplat.segments.video import Video

SIDE = 128


def segment(image: np.ndarray, shown: np.ndarray | None = None) -> np.ndarray:
    """The (3, H, W) regions of the levels subpart, part and whole."""
    every = np.ones(image.shape[:2], bool)
    return classical.partition(classical.WorkingImage(image, every if shown is None else shown))[1:]


def scene(side: int) -> tuple[np.ndarray, np.ndarray]:
    """A smooth image of a red box with a white lid before a green wall and a blue floor, and its label map."""
    what = np.zeros((256, 256), dtype=np.uint8)
    what[160:] = 1
    what[90:200, 80:180] = 2
    what[90:120, 80:180] = 3
    colors = np.array([[60, 120, 60], [40, 50, 130], [170, 40, 40], [240, 240, 235]], dtype=np.uint8)
    size = (side, side)
    image = cv2.resize(cv2.GaussianBlur(colors[what], (0, 0), 0.7), size, interpolation=cv2.INTER_AREA)
    return image, cv2.resize(what, size, interpolation=cv2.INTER_NEAREST)


def iou(left: np.ndarray, right: np.ndarray) -> float:
    return float((left & right).sum() / (left | right).sum())


def best_iou(levels: np.ndarray, mask: np.ndarray) -> float:
    """Best IoU of a mask with the regions at its middle pixel."""
    inside = np.argwhere(mask)
    row, column = inside[len(inside) // 2]
    return max(iou(level == level[row, column], mask) for level in levels)


def textured() -> np.ndarray:
    rng = np.random.default_rng(5)
    coarse = np.kron(rng.integers(0, 128, (8, 8, 3), dtype=np.uint8), np.ones((16, 16, 1), np.uint8))
    return coarse + rng.integers(0, 60, coarse.shape, dtype=np.uint8)


@pytest.mark.parametrize("side", [256, 512, 1408])
def test_objects_are_found_at_any_image_size(side):
    image, what = scene(side)
    levels = segment(image)
    assert levels.shape == (3, side, side) and levels.dtype == np.int32
    assert all(best_iou(levels, what == one) > 0.93 for one in range(4))


@pytest.mark.parametrize("image", [scene(128)[0], textured()], ids=["scene", "textured"])
def test_levels_are_nested_and_every_valid_pixel_has_a_region(image):
    levels = segment(image)
    assert levels.min() == 0
    counts = [len(np.unique(level)) for level in levels]
    for finer, coarser, count in zip(levels[:2], levels[1:], counts[:2], strict=True):
        assert len(np.unique(np.stack([finer, coarser]).reshape(2, -1), axis=1).T) == count
    assert counts == sorted(counts, reverse=True)


def test_invalid_pixels_have_no_region_and_no_influence():
    image, _ = scene(128)
    y, x = np.indices((128, 128))
    valid = (y - 64) ** 2 + (x - 64) ** 2 < 55**2
    levels = segment(image, valid)
    assert (levels[:, ~valid] == -1).all() and (levels[:, valid] >= 0).all()
    other = np.where(valid[..., None], image, textured())
    assert (segment(other, valid) == levels).all()
    assert (segment(image, np.zeros_like(valid)) == -1).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (2, 3), (8, 8), (37, 61), (200, 5)])
def test_odd_and_tiny_pictures_are_segmented_and_tracked(shape):
    image = np.random.default_rng(6).integers(0, 256, (*shape, 3), dtype=np.uint8)
    levels = segment(image)
    assert levels.shape == (3, *shape) and levels.min() == 0
    found = track([np.full_like(image, 90)] * 3)
    assert all((labels == 2).all() for labels in found), "after a subpart and a part"


def track(images, shown=None):
    """The labels of the whole things in each frame, as numbers of instances."""
    shown = [np.ones(images[0].shape[:2], bool)] * len(images) if shown is None else shown
    found = segment_video(Video(len(images), images.__getitem__, shown.__getitem__))
    return [found.labels[frame][2] for frame in range(len(images))]


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


def test_new_objects_get_new_tracks_and_lost_ones_end():
    images = [frame(column)[0] for column in (None, 40, None)]
    before, during, after = track(images)
    mask = frame(40)[1]
    (new,) = set(np.unique(during[mask & (cv2.erode(mask.astype(np.uint8), np.ones((9, 9))) > 0)]))
    assert new not in before
    assert iou(during == new, mask) > 0.8
    assert not (after == new)[~mask].any()


def test_a_box_keeps_its_track_and_pixels_that_a_frame_leaves_out_have_no_label():
    """The box moves, and is hidden in the third frame, and everything in the fourth."""
    images, masks = zip(*(frame(column) for column in (20, 25, 30, 35, 40)), strict=True)
    shown = [VALID, VALID, ~masks[2], ~VALID, VALID]
    found = track(images, shown)
    for labels, inside in zip(found, shown, strict=True):
        assert labels.dtype == np.int32 and labels.shape == VALID.shape
        assert (labels[~inside] == -1).all() and (labels >= 0).any() == inside.any()
    assert iou(found[1] == found[0][64, 40], masks[1]) > 0.8, "the box moves"
    assert iou(found[2] == found[1][10, 10], ~masks[2]) > 0.8, "the wall goes on"
