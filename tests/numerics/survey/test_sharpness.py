"""Sharpness of frames: black, white, noise alone, blurred beyond recognition."""

import cv2
import numpy as np
import pytest

from egosplat.images import measure_sharpness

RNG = np.random.default_rng(0)
EDGES = np.where(cv2.GaussianBlur(RNG.normal(size=(96, 96)), (0, 0), 3) > 0, 150.0, 60.0)


def sharpness(grey: np.ndarray) -> float:
    image = np.repeat(grey.clip(0, 255).round().astype(np.uint8)[..., None], 3, axis=2)
    return measure_sharpness(image, np.ones(grey.shape, bool))


@pytest.mark.numerics(
    "sharpness of edges at gains of 1/8 to 1.7, against that at gain 1",
    within=0.1,
    outside="a contrast below one grey level counts as none",
)
def test_gains(measured):
    for gain in (0.125, 0.25, 0.5, 1.0, 1.7):
        measured(abs(sharpness(gain * EDGES) - sharpness(EDGES)))
    assert np.isnan(sharpness(1e-3 * EDGES))


@pytest.mark.numerics(
    "sharpness of pictures that are black, white or without a valid pixel, of one pixel, of noise alone, and blurred by 60 px",
    outside="no edges: not measured; detail below the noise: 1 % of the contrast",
)
def test_pictures_without_detail():
    for grey in (np.zeros((96, 96)), np.full((96, 96), 255.0), np.zeros((1, 1)), cv2.blur(EDGES, (60, 60))):
        assert np.isnan(sharpness(grey)) or np.isfinite(sharpness(grey))
    assert np.isnan(measure_sharpness(np.zeros((96, 96, 3), np.uint8), np.zeros((96, 96), bool)))
    assert np.isfinite(sharpness(RNG.normal(128, 60, (96, 96))))
    # Only the contrast of the coarse edges remains.
    assert np.log(0.01) <= sharpness(cv2.GaussianBlur(EDGES, (0, 0), 3)) < sharpness(EDGES) - 3
