"""The classical segmenter divides images into nested regions."""

import cv2
import numpy as np
import pytest

from egosplat.segments.classical import partition as module
from egosplat.segments.classical.partition import partition, reduce_image


def segment(image: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """The (3, H, W) regions of the levels subpart, part and whole."""
    return partition(reduce_image(image, shown))[1:]


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


def everywhere(image: np.ndarray) -> np.ndarray:
    return np.ones(image.shape[:2], dtype=bool)


def iou(left: np.ndarray, right: np.ndarray) -> float:
    return float((left & right).sum() / (left | right).sum())


def best_iou(levels: np.ndarray, mask: np.ndarray) -> float:
    """Best IoU of a mask with the regions at its middle pixel."""
    inside = np.argwhere(mask)
    row, column = inside[len(inside) // 2]
    return max(iou(level == level[row, column], mask) for level in levels)


def textured(side: int = 96) -> np.ndarray:
    rng = np.random.default_rng(5)
    coarse = rng.integers(0, 256, (8, 8, 3), dtype=np.uint8)
    return cv2.resize(coarse, (side, side), interpolation=cv2.INTER_NEAREST) // 2 + rng.integers(
        0, 60, (side, side, 3), dtype=np.uint8
    )


@pytest.mark.parametrize("side", [256, 512, 1408])
def test_objects_are_found_at_any_image_size(side):
    image, what = scene(side)
    levels = segment(image, everywhere(image))
    assert levels.shape == (3, side, side) and levels.dtype == np.int32
    assert all(best_iou(levels, what == one) > 0.93 for one in range(4))


@pytest.mark.parametrize("image", [scene(128)[0], textured()], ids=["scene", "textured"])
def test_levels_are_nested_and_every_valid_pixel_has_a_region(image):
    levels = segment(image, everywhere(image))
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
    other = np.where(valid[..., None], image, textured(128))
    assert (segment(other, valid) == levels).all()
    assert (segment(image, np.zeros_like(valid)) == -1).all()


def test_textures_of_equal_mean_color_are_separated():
    rng = np.random.default_rng(4)
    amplitude = np.where(np.arange(128) < 64, 4, 90)[None, :, None]
    image = (120 + amplitude * rng.uniform(-1, 1, (128, 128, 1)) + np.zeros(3)).astype(np.uint8)
    levels = segment(image, everywhere(image))
    left = np.broadcast_to(np.arange(128) < 64, (128, 128))
    assert best_iou(levels, left) > 0.85


def test_small_and_thin_regions_are_merged_into_similar_neighbors(monkeypatch):
    image = np.full((128, 128, 3), (200, 40, 40), dtype=np.uint8)
    image[:, 64:] = (40, 40, 200)
    image[60:62, 63:65] = (190, 50, 50)
    image[:, 30] = (180, 60, 60)
    found = []
    for area, width in ((1e-4, 0.0), (1e-3, 9.0)):
        monkeypatch.setattr(module, "LEAST_AREA", area)
        monkeypatch.setattr(module, "_LEAST_WIDTH", width)
        found.append(segment(image, everywhere(image))[0])
    kept, cleaned = found
    assert len(np.unique(cleaned)) <= 3 < len(np.unique(kept))
    assert set(cleaned[:, 30]) <= {cleaned[0, 10], cleaned[0, 50]}
    assert cleaned[60, 50] != cleaned[60, 80]


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (2, 3), (8, 8), (37, 61), (200, 5)])
def test_odd_and_tiny_pictures_are_segmented(shape):
    image = np.random.default_rng(6).integers(0, 256, (*shape, 3), dtype=np.uint8)
    levels = segment(image, everywhere(image))
    assert levels.shape == (3, *shape) and levels.min() == 0
