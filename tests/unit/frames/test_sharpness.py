"""Blurred and blank frames are detected."""

import cv2
import numpy as np

from egosplat.frames.stage import BLURRED, count_blurred, sharpness

EVERYWHERE = np.ones((64, 64), bool)


def image(sigma: float = 0.0) -> np.ndarray:
    """Noise, blurred by a Gaussian of ``sigma`` pixels."""
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), sigma) if sigma else noise


def test_blurred_and_blank_frames_are_less_sharp():
    sharp, soft = (sharpness(image(sigma), EVERYWHERE) for sigma in (0.0, 1.5))
    assert 0 < soft < BLURRED * sharp
    assert sharpness(np.full((64, 64, 3), 90, np.uint8), EVERYWHERE) == 0.0


def test_the_border_of_the_lens_circle_is_no_edge():
    valid = np.hypot(*(np.indices((64, 64)) - 31.5)) < 25
    circle = np.repeat(np.where(valid, 200, 0).astype(np.uint8)[..., None], 3, axis=2)
    assert sharpness(circle, valid) == 0.0 < sharpness(circle, EVERYWHERE)
    assert sharpness(image(), np.zeros((64, 64), bool)) == 0.0


def test_frames_below_the_limit_are_counted():
    assert count_blurred([1.0, 1.0, 1.0, BLURRED]) == 0
    assert count_blurred([1.0, 1.0, 1.0, BLURRED - 1e-9]) == 1
    assert count_blurred([0.0, 0.0, 0.0, 5.0]) == 3, "most are blank: the median is no measure"
