"""Augmented views of crops for a small OpenCLIP: inaccurate masks, occlusion, low resolution, other light."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as F

# OpenCLIP's mean and standard deviation of red, green and blue.
MEAN, STD = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)

IMAGE_PX = 64

# Smallest fraction of a mask that stays uncovered.
_LEAST_LEFT = 0.4


def split_patches(patches: NDArray[np.uint8], device: torch.device | str) -> tuple[Tensor, Tensor]:
    """(B, S, S, 4) patches -> (B, 3, S, S) images and (B, 1, S, S) masks, float32 0..1."""
    values = torch.from_numpy(patches).to(device).permute(0, 3, 1, 2).float() / 255
    return values[:, :3], values[:, 3:]


def normalized(pictures: Tensor) -> Tensor:
    """Normalize (B, 3, H, W) images 0..1 for the model."""
    mean, std = (pictures.new_tensor(values)[:, None, None] for values in (MEAN, STD))
    return (pictures - mean) / std


def plain_views(patches: NDArray[np.uint8], masked: bool = True) -> Tensor:
    """(B, 3, IMAGE_PX, IMAGE_PX) crops without augmentation, 0..1; if masked, black outside the mask."""
    pictures, masks = split_patches(patches, "cpu")
    return framed(pictures * masks if masked else pictures, masks, torch.zeros(len(patches)))


def framed(pictures: Tensor, masks: Tensor, angles: Tensor, flips: Tensor | None = None) -> Tensor:
    """Crop the bounding squares of masks and resize them.

    Args:
        pictures: (B, 3, S, S); masks: (B, 1, S, S); angles: (B,) rotation [rad].
        flips: (B,) 1, or -1 to mirror.
    """
    inside = masks[:, 0] > 0.5
    center_x, size_x = _extent(inside.any(dim=1))
    center_y, size_y = _extent(inside.any(dim=2))
    half = torch.maximum(size_x, size_y) / 2
    cos, sin = half * angles.cos(), half * angles.sin()
    mirror = torch.ones_like(half) if flips is None else flips
    rows = [
        torch.stack([cos * mirror, -sin, center_x], dim=1),
        torch.stack([sin * mirror, cos, center_y], dim=1),
    ]
    size = [len(pictures), 3, IMAGE_PX, IMAGE_PX]
    grid = F.affine_grid(torch.stack(rows, dim=1), size, align_corners=False)
    # A rotated square can reach beyond an unmasked picture.
    return F.grid_sample(pictures, grid, padding_mode="border", align_corners=False)


def _extent(used: Tensor) -> tuple[Tensor, Tensor]:
    """Center and length, in -1..1, of the used range in (B, S); all of it if nothing is used."""
    side = used.shape[1]
    place = torch.arange(side, device=used.device)
    low = torch.where(used, place, side).amin(dim=1)
    high = torch.where(used, place + 1, 0).amax(dim=1)
    low, high = torch.where(high > 0, low, 0), torch.where(high > 0, high, side)
    return (low + high) / side - 1, 2 * (high - low) / side


def turned_hues(pictures: Tensor, angles: Tensor) -> Tensor:
    """Rotate the colors of (B, 3, S, S) images 0..1 about the grey axis by (B,) angles [rad]."""
    third = (1 - angles.cos()) / 3
    root = angles.sin() / 3**0.5
    same, next_, last = angles.cos() + third, third - root, third + root
    matrix = torch.stack([same, next_, last, last, same, next_, next_, last, same], dim=1).view(-1, 3, 3)
    return torch.einsum("bij,bjhw->bihw", matrix, pictures).clamp(0, 1)


@dataclass(frozen=True)
class Augmentation:
    """Augmentation of training crops.

    Attributes:
        masks: fraction of the crops whose mask is grown, shrunk or gets holes. An unmasked crop shows the
            bounding square of this mask.
        covered: fraction that is occluded, by up to 60 %; unmasked crops are not.
        coarse: fraction that loses resolution, down to between ``least_px`` and 48 px across.
        turn: largest rotation [rad]; light: largest relative change of brightness, tint: of one channel.
    """

    masks: float = 0.5
    covered: float = 0.4
    coarse: float = 0.4
    least_px: int = 11
    turn: float = 0.2
    light: float = 0.25
    tint: float = 0.05

    def views(
        self,
        patches: NDArray[np.uint8],
        masked: Tensor,
        hues: Tensor,
        rng: torch.Generator,
        device: torch.device | str,
    ) -> Tensor:
        """Augmented views of crops.

        Args:
            patches: (B, S, S, 4) uint8, B at least 8; neighbors must be unrelated, because they occlude each other.
            masked: (B,) bool: whether the crop is black outside its mask.
            hues: (B,) rotation of each crop's hues [rad].

        Returns:
            (B, 3, IMAGE_PX, IMAGE_PX), 0..1.
        """
        pictures, masks = split_patches(patches, device)
        pictures = turned_hues(pictures, hues.to(device))
        count = len(patches)
        masked = masked.to(device)[:, None, None, None]
        spoiled = _spoil(masks, self.masks, rng)
        masks = torch.where(masked, _cover(spoiled, self.covered, rng), spoiled)
        pictures = torch.where(masked, pictures * masks, pictures)
        angles = self.turn * (2 * torch.rand(count, generator=rng) - 1)
        flips = torch.sign(torch.rand(count, generator=rng) - 0.5)
        views = framed(pictures, masks, angles.to(device), flips.to(device))
        views = self._coarser(views, rng)
        change = 1 + self.light * (2 * torch.rand((count, 1, 1, 1), generator=rng) - 1)
        change = change * (1 + self.tint * (2 * torch.rand((count, 3, 1, 1), generator=rng) - 1))
        return (views * change.to(device)).clamp(0, 1)

    def _coarser(self, views: Tensor, rng: torch.Generator) -> Tensor:
        """Lower the resolution of some views, to four sizes per batch."""
        chosen = torch.randperm(len(views), generator=rng)[: round(self.coarse * len(views))]
        views = views.clone()
        for few in chosen.chunk(4):
            side = int(torch.randint(self.least_px, 49, (), generator=rng))
            small = F.interpolate(views[few], (side, side), mode="bilinear", antialias=True)
            views[few] = F.interpolate(small, (IMAGE_PX, IMAGE_PX), mode="bilinear")
        return views


def _spoil(masks: Tensor, share: float, rng: torch.Generator) -> Tensor:
    """Spoil some masks as a segmenter might: too wide, too narrow, with holes, or ragged."""
    masks = masks.clone()
    chosen = torch.randperm(len(masks), generator=rng)[: round(share * len(masks))]
    wider, narrower, holed, torn = chosen.tensor_split(4)
    masks[wider] = _grown(masks[wider])
    masks[narrower] = _unless_gone(masks[narrower], 1 - _grown(1 - masks[narrower]))
    masks[holed] = _unless_gone(masks[holed], masks[holed] * (_clouds(len(holed), 9, masks, rng) < 0.78))
    masks[torn] = _unless_gone(masks[torn], masks[torn] * (_clouds(len(torn), 24, masks, rng) < 0.7))
    return masks


def _grown(masks: Tensor, radius: int = 2) -> Tensor:
    """Grow masks by ``radius`` pixels; they must stay clear of the edge of their patch."""
    # Several times faster than max_pool2d on a CPU.
    for dim in (2, 3):
        masks = torch.stack([masks.roll(shift, dim) for shift in range(-radius, radius + 1)]).amax(dim=0)
    return masks


def _clouds(count: int, cells: int, like: Tensor, rng: torch.Generator) -> Tensor:
    """(count, 1, S, S) smooth noise 0..1 with ``cells`` cells across."""
    coarse = torch.rand((count, 1, cells, cells), generator=rng).to(like.device)
    return F.interpolate(coarse, like.shape[2:], mode="bilinear")


def _cover(masks: Tensor, share: float, rng: torch.Generator) -> Tensor:
    """Cover some masks by a half plane or by the shape of another mask."""
    masks = masks.clone()
    chosen = torch.randperm(len(masks), generator=rng)[: round(share * len(masks))]
    planes, shapes = chosen.tensor_split(2)
    masks[planes] = _unless_gone(masks[planes], masks[planes] * half_planes(masks[planes], rng))
    shifts = torch.randint(-30, 31, (2,), generator=rng).tolist()
    # The next mask of the batch, shifted, is the occluder.
    others = masks[(shapes + 1) % len(masks)].roll(shifts, dims=(2, 3))
    masks[shapes] = _unless_gone(masks[shapes], masks[shapes] * (others < 0.5))
    return masks


def half_planes(masks: Tensor, rng: torch.Generator, share: float | None = None) -> Tensor:
    """(B, 1, S, S) bool: one side of a random line; with ``share``, that fraction of the mask is on the other."""
    count, side = len(masks), masks.shape[-1]
    angle = 2 * torch.pi * torch.rand((count, 1, 1, 1), generator=rng).to(masks.device)
    place = torch.linspace(-1, 1, side, device=masks.device)
    along = angle.cos() * place[None, None, None] + angle.sin() * place[None, None, :, None]
    if share is not None:
        inside = torch.where(masks > 0.5, along, torch.nan).flatten(1)
        return along > inside.nanquantile(share, dim=1)[:, None, None, None]
    total = masks.sum(dim=(2, 3), keepdim=True).clamp(min=1)
    mean = (along * masks).sum(dim=(2, 3), keepdim=True) / total
    spread = ((along - mean).square() * masks).sum(dim=(2, 3), keepdim=True).div(total).sqrt()
    return along > mean + spread * (1.4 * torch.rand((count, 1, 1, 1), generator=rng).to(masks.device) - 1.2)


def _unless_gone(before: Tensor, after: Tensor) -> Tensor:
    """``after`` where enough of ``before`` is left, else ``before``."""
    left = (after > 0.5).sum(dim=(1, 2, 3)) >= _LEAST_LEFT * (before > 0.5).sum(dim=(1, 2, 3))
    return torch.where(left[:, None, None, None], after, before)


DEFAULT = Augmentation()
