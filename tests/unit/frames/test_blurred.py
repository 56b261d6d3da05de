"""Blurred and blank frames are counted."""

import cv2
import numpy as np
import pytest

from egosplat.frames.stage import BLURRED, count_blurred
from egosplat.images import measure_sharpness

NAN = np.nan


@pytest.mark.parametrize(
    ("sharpness", "count"),
    [
        ([1.0, 1.0, 1.0, 1.0 - BLURRED], 0),
        ([1.0, 1.0, 1.0, 1.0 - BLURRED - 1e-9], 1),
        ([NAN, NAN, NAN, 5.0], 3),
        ([NAN, NAN], 2),
    ],
)
def test_frames_below_the_limit_and_blank_frames_are_counted(sharpness, count):
    assert count_blurred(np.array(sharpness)) == count


def test_a_blurred_frame_among_sharp_ones_is_counted():
    noise = np.random.default_rng(0).normal(size=(96, 96, 3))
    edges = np.where(cv2.GaussianBlur(noise, (0, 0), 3) > 0, 150, 60).astype(np.uint8)
    blurred, valid = cv2.blur(edges, (5, 5)), np.ones((96, 96), bool)
    frames = [edges, edges, blurred, edges, np.zeros_like(edges)]
    assert count_blurred(np.array([measure_sharpness(frame, valid) for frame in frames])) == 2
