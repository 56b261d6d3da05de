"""Overlap of masks and NMS: reference values of LangSplat's rules, ties, and empty input."""

from dataclasses import replace

import pytest
import torch

from egosplat.compute import choose_compute
from egosplat.segments.masks import areas, box_nms, boxes, intersections, mask_iou, mask_nms, stability_score
from egosplat.segments.options import MaskFilter

LIMITS = MaskFilter(0.0, 0.0, 0.1, 0.7)


def squares(*corners: tuple[int, int, int, int], side: int = 40) -> torch.Tensor:
    masks = torch.zeros(len(corners), side, side, dtype=torch.bool)
    for mask, (x0, y0, x1, y1) in zip(masks, corners, strict=True):
        mask[y0:y1, x0:x1] = True
    return masks


def test_overlaps_are_exact_where_models_multiply_in_bfloat16():
    """bfloat16 has 8 bits: 257 pixels would be 256, and 1601 of 1999 would not be above an IoU of 0.8."""
    side = 45
    flat = torch.zeros(3, side * side, dtype=torch.bool)
    flat[0, :257], flat[1, :1601], flat[2, :1999] = True, True, True
    masks = flat.reshape(3, side, side)
    with choose_compute("cpu", "bfloat16").inference():
        shared, sizes, iou = intersections(masks, masks), areas(masks), mask_iou(masks, masks)
        kept = mask_nms(masks[1:], torch.tensor([0.9, 0.95]), LIMITS)
    assert shared.dtype == iou.dtype == torch.float32
    assert shared.tolist() == [[257, 257, 257], [257, 1601, 1601], [257, 1601, 1999]]
    assert sizes.tolist() == [257, 1601, 1999]
    assert iou[1, 2] == torch.tensor(1601.0) / 1999 and iou[1, 2] > 0.8
    assert kept.tolist() == [False, True]


def test_boxes_are_those_of_the_pixels_and_rank_by_score():
    found = boxes(squares((3, 5, 10, 7), (0, 0, 40, 40), (2, 2, 2, 2)))
    assert found.tolist() == [[3, 5, 10, 7], [0, 0, 40, 40], [0, 0, 0, 0]]
    masks = squares((0, 0, 20, 20), (1, 0, 20, 20), (30, 30, 40, 40))
    assert box_nms(masks, torch.tensor([0.5, 0.9, 0.1]), 0.7).tolist() == [1, 2]


def test_stability_is_the_iou_of_two_cuts():
    logits = torch.full((3, 10, 10), -5.0)
    logits[0, :5] = 5.0
    logits[1, :5], logits[1, 5:] = 5.0, 0.0
    torch.testing.assert_close(stability_score(logits, 1.0), torch.tensor([1.0, 0.5, 0.0]))


NESTED = [(0, 0, 40, 25), (5, 5, 15, 15)]
ALIKE = [(0, 0, 20, 20), (0, 0, 20, 21), (25, 25, 35, 35)]


@pytest.mark.parametrize(
    ("corners", "scores", "inner", "kept"),
    [
        # Area 1000 around area 100: A B = 0.1, and 0.9 > 0.5, whatever the scores.
        (NESTED, [0.9, 0.95], 0.5, [True, False]),
        (NESTED, [0.9, 0.95], 0.0, [True, True]),
        (ALIKE, [0.8, 0.9, 0.75], 0.5, [False, True, True]),
        # The earlier of equal scores.
        (ALIKE, [0.9, 0.9, 0.9], 0.5, [True, False, True]),
        (ALIKE, [0.7, 0.71, 0.7], 0.5, [False, True, False]),
    ],
)
def test_nested_overlapping_and_bad_masks_are_dropped(corners, scores, inner, kept):
    limits = replace(LIMITS, nms_inner_thresh=inner)
    assert mask_nms(squares(*corners), torch.tensor(scores), limits).tolist() == kept
