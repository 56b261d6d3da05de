"""IoU."""

import numpy as np
import pytest
import torch

from egosplat.evaluation.scores import iou


def square(x0: int, y0: int, size: int) -> np.ndarray:
    mask = np.zeros((20, 20), bool)
    mask[y0 : y0 + size, x0 : x0 + size] = True
    return mask


@pytest.mark.parametrize(
    "predicted, expected",
    [(square(2, 2, 4), 1.0), (square(10, 10, 4), 0.0), (square(4, 2, 4), 8 / 24), (square(2, 2, 0), 0.0)],
)
def test_iou_agrees_with_a_hand_computed_value(predicted, expected):
    assert iou(predicted, square(2, 2, 4), None) == pytest.approx(expected)


def test_iou_agrees_with_torchmetrics():
    from torchmetrics.functional.classification import binary_jaccard_index

    one, other = np.random.default_rng(0).random((2, 20, 20)) > 0.4
    expected = binary_jaccard_index(torch.from_numpy(one).int(), torch.from_numpy(other).int())
    assert iou(one, other, None) == pytest.approx(float(expected), abs=1e-6)


def test_only_valid_pixels_count():
    predicted, truth = square(0, 0, 20), square(2, 2, 4)
    assert iou(predicted, truth, square(2, 2, 5)) == pytest.approx(16 / 25)
    assert iou(predicted, truth, square(2, 2, 4)) == 1.0


def test_undefined_iou_is_rejected():
    with pytest.raises(ValueError, match="visible"):
        iou(square(2, 2, 4), square(2, 2, 0), None)
    with pytest.raises(ValueError, match="visible"):
        iou(square(2, 2, 4), square(2, 2, 4), square(10, 10, 3))
    with pytest.raises(ValueError, match="differ"):
        iou(square(2, 2, 4)[:-1], square(2, 2, 4), None)
