"""Small holes of masks are filled; all other scores stay."""

import pytest
import torch

from egosplat.models.video_predictor import FILLED, fill_holes


def ring(side: int, hole: int) -> torch.Tensor:
    """A square of score 5 with a square hole of score -5 in its middle, on a background of -5."""
    scores = torch.full((16, 16), -5.0)
    scores[2 : 2 + side, 2 : 2 + side] = 5.0
    scores[4 : 4 + hole, 4 : 4 + hole] = -5.0
    return scores


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
@pytest.mark.parametrize("area, filled", [(8, False), (9, True)])
def test_a_hole_is_filled_up_to_the_given_area(area, filled, dtype):
    scores = ring(9, hole=3).to(dtype)
    result = fill_holes(scores, area)
    assert result.dtype == dtype
    hole = torch.zeros_like(scores, dtype=torch.bool)
    hole[4:7, 4:7] = filled
    assert torch.equal(result, torch.where(hole, torch.tensor(FILLED, dtype=dtype), scores))


def test_each_mask_is_filled_independently_and_no_hole_that_a_corner_connects():
    full, corner = torch.full((16, 16), 5.0), ring(9, 2)
    corner[3, 3] = corner[2, 2] = -5.0
    scores = torch.stack([full, ring(9, 1), -full, corner])[:, None]
    result = fill_holes(scores, 9)
    assert result[1, 0, 4, 4] == FILLED and (result != scores).sum() == 1
    assert fill_holes(scores[:0], 9).shape == (0, 1, 16, 16)
