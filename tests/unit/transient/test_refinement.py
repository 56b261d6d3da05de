"""Instance scores pool pixels over frames; masks are unions of transient instances."""

import numpy as np
import pytest

from egosplat.moving_regions import InstanceScores
from egosplat.transient.masks_stage import refined_mask, transient_instances


def frame(pixels: int) -> np.ndarray:
    """(1, 1, 40) labels in which instance 0 has ``pixels`` pixels."""
    labels = np.full((1, 1, 40), -1, np.int32)
    labels[..., :pixels] = 0
    return labels


def test_pixels_are_pooled_over_the_frames():
    scores = InstanceScores(1)
    scores.add(frame(10), np.full((1, 40), 0.12))
    scores.add(frame(30), np.zeros((1, 40)))
    assert scores.scores == pytest.approx([0.03]) and scores.pixels.tolist() == [40]
    chosen = [
        transient_instances(scores.scores, scores.pixels, np.zeros(1, np.int8), t, {0}) for t in (0.02, 0.04)
    ]
    assert [one.tolist() for one in chosen] == [[True], [False]]


def test_levels_are_scored_separately():
    labels = np.full((2, 1, 4), -1, np.int32)
    labels[0, 0, :2], labels[1, 0] = 0, 1
    scores = InstanceScores(3)
    scores.add(labels, np.array([[1.0, 0.5, 0.0, 0.0]]))
    assert scores.scores == pytest.approx([0.75, 0.375, 0.0])
    assert scores.pixels.tolist() == [2, 4, 0]


def test_an_instance_without_pixels_or_of_another_level_is_never_transient():
    level = np.array([0, 1, 2, 0], np.int8)
    chosen = transient_instances(np.array([0.5, 0.5, 0.5, 0.0]), np.array([9, 9, 9, 0]), level, 0.0, {0, 1})
    assert chosen.tolist() == [True, True, False, False]


def test_the_mask_is_the_union_over_levels():
    labels = np.array([[[0, 0, -1, -1]], [[-1, 1, 1, 2]]], np.int32)
    assert refined_mask(labels, np.array([True, False, False])).tolist() == [[True, True, False, False]]
    assert refined_mask(labels, np.array([True, True, False])).tolist() == [[True, True, True, False]]
    assert not refined_mask(labels, np.zeros(3, bool)).any()
