"""PSNR and SSIM of held-out renders, of all, static and dynamic pixels, as in EgoLifter."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.evaluation.queries import GROUPS, InstanceMap, Mask
from egosplat.frames.recording import Instance
from egosplat.image_quality import mean_ssim, psnr, ssim_map

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class RegionScore:
    """PSNR [dB], infinite for equal images, and mean SSIM of one region of an image; NaN without a pixel with a value."""

    pixels: int
    psnr: float
    ssim: float


def summarise_rendering(scores: Sequence[Mapping[str, RegionScore]]) -> dict[str, dict[str, float]]:
    """Number of images with a pixel, mean PSNR and mean SSIM of each of ``GROUPS``, as in ``metrics.json``; NaN without any."""
    return {name: _mean([one[name] for one in scores if name in one]) for name in GROUPS}


def _mean(scores: Sequence[RegionScore]) -> dict[str, float]:
    # An image without a dynamic pixel has no score for that group.
    seen = [score for score in scores if score.pixels]
    values = {
        "psnr": [one.psnr for one in seen],
        "ssim": [one.ssim for one in seen if not math.isnan(one.ssim)],
    }
    means = {name: float(np.mean(own)) if own else math.nan for name, own in values.items()}
    return {"frames": len(seen)} | means


def regions(instance_map: InstanceMap, instances: Sequence[Instance], valid: Mask) -> dict[str, Mask]:
    """The (H, W) bool valid pixels of each group; those without annotation, -1 in the int32 map, are static."""
    # Index -1 selects the last entry.
    is_dynamic = np.array([*(one.motion_type == "dynamic" for one in instances), False])
    dynamic = is_dynamic[instance_map] & valid
    return {"static": valid & ~dynamic, "dynamic": dynamic, "all": valid}


def region_scores(
    render: Picture, photograph: Picture, valid: Mask, groups: Mapping[str, Mask]
) -> dict[str, RegionScore]:
    """PSNR and SSIM of groups of valid pixels in (H, W, 3) uint8 images, see ``egosplat.image_quality``.

    Raises:
        ValueError: shapes differ.
    """
    if render.shape != photograph.shape or valid.shape != photograph.shape[:2]:
        raise ValueError(
            f"render {render.shape}, photograph {photograph.shape} and valid {valid.shape} differ"
        )
    image, target = torch.from_numpy(render), torch.from_numpy(photograph)
    # SSIM compares windows of 11 x 11 pixels, so it also depends on pixels just outside a region.
    ssim = ssim_map(image, target, torch.from_numpy(valid))
    return {
        name: RegionScore(int(mask.sum()), psnr(image, target, mask), mean_ssim(ssim, mask))
        for name, mask in zip(groups, map(torch.from_numpy, groups.values()), strict=True)
    }
