"""Scores of segmented videos: perfect is perfect, switches and fragments are counted."""

import numpy as np
import pytest

from benchmarks.instances.video_scores import score_level


def video(columns: list[int], frames: int = 6) -> list[np.ndarray]:
    return [np.repeat(np.array(columns, np.int32)[None], 10, axis=0) for _ in range(frames)]


def test_true_labels_score_perfectly_under_any_numbering():
    true = video([0] * 5 + [1] * 5 + [-1] * 2)
    found = score_level(zip(true, video([7] * 5 + [3] * 5 + [-1] * 2), strict=True))
    assert (found.instances, found.found) == (2, 2)
    assert (found.coverage, found.iou, found.switches, found.fragments, found.held) == (1, 1, 0, 1, 1)


def test_switches_and_fragments_are_counted():
    true = video([0] * 5 + [1] * 5)
    found = [np.where(one == 0, 4 if frame % 2 else 5, 1).astype(np.int32) for frame, one in enumerate(true)]
    result = score_level(zip(true, found, strict=True))
    assert result.switches == 2.5, "five for one of two"
    assert result.fragments == 1.5 and result.held == 1 and result.iou == pytest.approx(0.75)


def test_no_prediction_scores_zero():
    result = score_level(zip(video([0] * 8), video([-1] * 8), strict=True))
    assert (result.found, result.coverage, result.iou, result.fragments, result.held) == (0, 0, 0, 0, 0)


def test_tiny_and_brief_instances_are_not_scored():
    true = video([0] * 9 + [1])
    for frame in true[2:]:
        frame[frame == 1] = 0
    result = score_level(zip(true, true, strict=True))
    assert result.instances == 1
