"""A SAM2 for tests of tracking."""

import pytest
import torch

from egosplat.compute import choose_compute
from egosplat.models.checkpoints import SMALL_SAM2
from egosplat.models.sam2_loader import Sam2, build_predictor, set_image_size


@pytest.fixture(scope="module")
def sam2():
    """The small architecture with random weights, biased so that every object counts as present."""
    torch.manual_seed(1)
    predictor = build_predictor(SMALL_SAM2).eval().requires_grad_(False)
    set_image_size(predictor, 256)
    torch.nn.init.constant_(predictor.sam_mask_decoder.pred_obj_score_head.layers[-1].bias, 5.0)
    return Sam2(predictor, choose_compute("cpu", "float32"))
