"""A SAM2 with random weights, and five small frames, for tests of tracking."""

import numpy as np
import pytest
import torch

from egosplat.compute import choose_compute
from egosplat.models.checkpoints import SMALL_SAM2
from egosplat.models.sam2_loader import Sam2, build_predictor, set_image_size
from egosplat.segments.options import MASK_FILTERS, MaskFilter, SegmentsOptions
from egosplat.segments.video import Video

FRAMES, HEIGHT, WIDTH = 5, 40, 56
VALID = np.ones((HEIGHT, WIDTH), bool)
OPTIONS = SegmentsOptions(points_per_side=4, min_area=0.001, min_frames=1)


@pytest.fixture(scope="module")
def sam2():
    """The small architecture with random weights, biased so that every object counts as present."""
    torch.manual_seed(1)
    predictor = build_predictor(SMALL_SAM2).eval().requires_grad_(False)
    set_image_size(predictor, 256)
    torch.nn.init.constant_(predictor.sam_mask_decoder.pred_obj_score_head.layers[-1].bias, 5.0)
    return Sam2(predictor, choose_compute("cpu", "float32"))


@pytest.fixture(scope="module")
def all_masks():
    """No mask is dropped for its quality."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(MASK_FILTERS, "auto", MaskFilter(0.0, 0.0, 0.1, 0.0, nms_inner_thresh=0.0))
        yield


@pytest.fixture(scope="module")
def images():
    coarse = np.random.default_rng(0).integers(0, 255, (FRAMES, 5, 7, 3), dtype=np.uint8)
    return np.repeat(np.repeat(coarse, 8, 1), 8, 2)


def video_of(images, asked=None, shown=lambda _: VALID, reads=None) -> Video:
    """A video that notes in ``asked`` the frames that are read, and is killed after a number of ``reads``."""

    def read(frame: int) -> np.ndarray:
        if asked is not None:
            if len(asked) == reads:
                raise KeyboardInterrupt
            asked.append(frame)
        return images[frame]

    return Video(len(images), read, shown)
