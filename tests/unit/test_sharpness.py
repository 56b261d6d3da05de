"""Sharpness of an image: what lowers it, and what does not."""

import cv2
import numpy as np
import pytest

from egosplat.sharpness import measure_sharpness

EVERYWHERE = np.ones((96, 96), bool)
RNG = np.random.default_rng(0)


EDGES = np.where(cv2.GaussianBlur(RNG.normal(size=(96, 96)), (0, 0), 3) > 0, 150, 60).astype(np.float32)
"""Two shades with sharp edges in all directions."""


def sharpness(grey: np.ndarray, valid: np.ndarray = EVERYWHERE) -> float:
    return measure_sharpness(np.repeat(grey.clip(0, 255).astype(np.uint8)[..., None], 3, axis=2), valid)


@pytest.mark.parametrize("kernel", [(1, 5), (5, 1)])
def test_motion_in_either_direction_lowers_it(kernel):
    """Protects the mean over directions: motion blurs one of them only."""
    assert sharpness(EDGES) - sharpness(cv2.blur(EDGES, kernel)) > 1.0
    assert sharpness(cv2.blur(EDGES, kernel)) > sharpness(cv2.blur(EDGES, (7, 7)))


def test_exposure_and_noise_do_not_change_it():
    """Protects frames that are darker or noisier than their neighbors."""
    noisy = EDGES + RNG.normal(0, 4, EDGES.shape)
    for other in (0.5 * EDGES, EDGES + 60, noisy):
        assert sharpness(other) == pytest.approx(sharpness(EDGES), abs=0.15)


def test_only_valid_pixels_count():
    """Protects against the edge of the lens circle, which is sharp in every frame."""
    valid = EVERYWHERE.copy()
    valid[:, 60:] = False
    assert sharpness(np.where(valid, EDGES, 0), valid) == sharpness(EDGES, valid)


@pytest.mark.parametrize("grey", [np.zeros((96, 96)), np.full((96, 96), 255), np.full((4, 4), 7)])
def test_a_picture_without_edges_has_none(grey):
    """Protects against a decision on frames that show nothing."""
    assert np.isnan(sharpness(grey, np.ones(grey.shape, bool)))
