"""Views of crops show the mask's bounding square, black outside the mask if masked, and never fully covered."""

import numpy as np
import torch

from training.small_models.clip_views import DEFAULT, IMAGE_PX, framed, plain_views
from training.small_models.patches import PATCH_PX


def rectangle(top: int, bottom: int, left: int, right: int) -> torch.Tensor:
    """(1, 1, S, S) mask."""
    mask = torch.zeros(1, 1, PATCH_PX, PATCH_PX)
    mask[..., top:bottom, left:right] = 1
    return mask


def test_a_mask_fills_the_view_in_its_longer_direction() -> None:
    mask = rectangle(10, 50, 20, 40)
    view = framed(mask.expand(1, 3, -1, -1), mask, torch.zeros(1))
    inside = view[0, 0] > 0.5
    assert inside.any(dim=1).sum() == IMAGE_PX
    assert abs(int(inside.any(dim=0).sum()) - IMAGE_PX // 2) <= 2
    assert inside[:, IMAGE_PX // 2].all()


def test_plain_views_are_black_outside_the_mask() -> None:
    patch = np.full((1, PATCH_PX, PATCH_PX, 4), 180, dtype=np.uint8)
    patch[..., 3] = 0
    patch[0, 4:68, 30:42, 3] = 255
    view = plain_views(patch)[0]
    torch.testing.assert_close(view[:, 30, 32], torch.full((3,), 180 / 255), atol=1e-5, rtol=0)
    assert not view[:, :, :20].any()


def test_unmasked_views_show_the_bounding_square_with_its_background() -> None:
    patches = np.full((8, PATCH_PX, PATCH_PX, 4), 180, dtype=np.uint8)
    patches[..., 3] = 0
    patches[:, 4:68, 30:42, :] = (90, 90, 90, 255)
    view = plain_views(patches, masked=False)[0]
    assert (view > 0.3).all()
    masked = torch.arange(8) < 4
    views = DEFAULT.views(patches, masked, torch.zeros(8), torch.Generator().manual_seed(1), "cpu")
    dark = (views < 0.05).all(dim=1).float().mean(dim=(1, 2))
    assert (dark[:4] > 0.5).all(), "masked crops are black outside the mask"
    assert not dark[4:].any(), "unmasked crops keep the background and are not covered"


def test_training_views_differ_and_keep_some_of_every_crop() -> None:
    patches = np.zeros((32, PATCH_PX, PATCH_PX, 4), dtype=np.uint8)
    patches[:, 4:68, 14:58] = (200, 100, 50, 255)
    masked = torch.ones(len(patches), dtype=torch.bool)
    first = DEFAULT.views(patches, masked, torch.zeros(len(patches)), torch.Generator().manual_seed(1), "cpu")
    same = DEFAULT.views(patches, masked, torch.zeros(len(patches)), torch.Generator().manual_seed(1), "cpu")
    other = DEFAULT.views(patches, masked, torch.zeros(len(patches)), torch.Generator().manual_seed(2), "cpu")
    torch.testing.assert_close(first, same, atol=0, rtol=0)
    assert (first - other).abs().max() > 0.1
    seen = (first[:, 0] > 0.2).sum(dim=(1, 2))
    plain = (plain_views(patches)[:, 0] > 0.2).sum(dim=(1, 2))
    assert (seen > 0.35 * plain).all()
    assert 0 <= float(first.min()) <= float(first.max()) <= 1
