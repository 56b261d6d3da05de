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
    """Scores of one region of an image; NaN if the region is empty.

    Attributes:
        psnr: [dB]; infinite if render and photograph are equal.
        ssim: mean of the SSIM map over the region's pixels with a value; NaN without any.
    """

    pixels: int
    psnr: float
    ssim: float


@dataclass(frozen=True)
class RenderingScore:
    """Mean scores of one region over several images; NaN if the region is empty in all of them.

    Attributes:
        frames: number of images with a pixel of the region.
        psnr, ssim: means over the images that have a value.
    """

    frames: int
    psnr: float
    ssim: float


def summarise_rendering(scores: Sequence[Mapping[str, RegionScore]]) -> dict[str, RenderingScore]:
    """The mean over images for each of ``GROUPS``; images where a group is empty do not count."""
    return {name: _mean([one[name] for one in scores if name in one]) for name in GROUPS}


def _mean(scores: Sequence[RegionScore]) -> RenderingScore:
    # An image without a dynamic pixel has no score for that group.
    seen = [score for score in scores if score.pixels]
    if not seen:
        return RenderingScore(0, float("nan"), float("nan"))
    ssims = [one.ssim for one in seen if not math.isnan(one.ssim)]
    ssim = float(np.mean(ssims)) if ssims else math.nan
    return RenderingScore(len(seen), float(np.mean([one.psnr for one in seen])), ssim)


def regions(instance_map: InstanceMap, instances: Sequence[Instance], valid: Mask) -> dict[str, Mask]:
    """The pixels of each group.

    Args:
        instance_map: (H, W) int32, -1 without annotation, which counts as static.
        instances: instances by their index in the map.
        valid: (H, W) bool pixels that show the scene.

    Returns:
        (H, W) bool for ``static``, ``dynamic`` and ``all`` valid pixels.
    """
    # Index -1 selects the last entry.
    is_dynamic = np.array([*(one.motion_type == "dynamic" for one in instances), False])
    dynamic = is_dynamic[instance_map] & valid
    return {"static": valid & ~dynamic, "dynamic": dynamic, "all": valid}


def region_scores(
    render: Picture, photograph: Picture, valid: Mask, groups: Mapping[str, Mask]
) -> dict[str, RegionScore]:
    """PSNR and SSIM of each group of pixels, see ``egosplat.image_quality``.

    Args:
        render, photograph: (H, W, 3) uint8.
        valid: (H, W) bool pixels that show the scene.
        groups: (H, W) bool masks of valid pixels, by name.

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
    regions = {name: torch.from_numpy(mask) for name, mask in groups.items()}
    return {
        name: RegionScore(int(mask.sum()), psnr(image, target, mask), mean_ssim(ssim, mask))
        for name, mask in regions.items()
    }
