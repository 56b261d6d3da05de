"""How well a held-out photograph is rendered: of all, of static and of dynamic pixels, as EgoLifter."""

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
    """Of one region of a picture; NaN where it has no pixel.

    Attributes:
        pixels: its size.
        psnr: [dB], infinite where render and photograph are equal.
        ssim: mean of the SSIM map over the region's pixels that have a value; NaN too where none has.
    """

    pixels: int
    psnr: float
    ssim: float


@dataclass(frozen=True)
class RenderingScore:
    """Of one region in several pictures; NaN where none has it.

    Attributes:
        frames: pictures that have a pixel of it.
        psnr, ssim: means over those of these pictures that have one, as papers have them.
    """

    frames: int
    psnr: float
    ssim: float


def summarise_rendering(scores: Sequence[Mapping[str, RegionScore]]) -> dict[str, RenderingScore]:
    """The mean over pictures of each of ``GROUPS``; pictures without a pixel of a region do not count there."""
    return {name: _mean([one[name] for one in scores if name in one]) for name in GROUPS}


def _mean(scores: Sequence[RegionScore]) -> RenderingScore:
    seen = [score for score in scores if score.pixels]
    if not seen:
        return RenderingScore(0, float("nan"), float("nan"))
    ssims = [one.ssim for one in seen if not math.isnan(one.ssim)]
    ssim = float(np.mean(ssims)) if ssims else math.nan
    return RenderingScore(len(seen), float(np.mean([one.psnr for one in seen])), ssim)


def regions(instance_map: InstanceMap, instances: Sequence[Instance], valid: Mask) -> dict[str, Mask]:
    """The pixels of each group.

    Args:
        instance_map: (H, W) int32, -1 where nothing is annotated; that counts as static.
        instances: that the map's indices mean.
        valid: (H, W) bool pixels that show the scene.

    Returns:
        (H, W) bool for ``static``, ``dynamic`` and ``all``, the valid pixels.
    """
    # The last entry is the one that -1 picks.
    moves = np.array([*(one.motion_type == "dynamic" for one in instances), False])
    dynamic = moves[instance_map] & valid
    return {"static": valid & ~dynamic, "dynamic": dynamic, "all": valid}


def region_scores(
    render: Picture, photograph: Picture, valid: Mask, groups: Mapping[str, Mask]
) -> dict[str, RegionScore]:
    """PSNR and SSIM of each group of pixels, see ``egosplat.image_quality``.

    SSIM compares the 11 x 11 pixels around each, so that a region's border also shows what lies beyond it.

    Args:
        render, photograph: (H, W, 3) uint8.
        valid: (H, W) bool pixels that show the scene.
        groups: (H, W) bool each, within the valid ones.

    Raises:
        ValueError: shapes differ.
    """
    if render.shape != photograph.shape or valid.shape != photograph.shape[:2]:
        raise ValueError(
            f"render {render.shape}, photograph {photograph.shape} and valid {valid.shape} differ"
        )
    image, truth = torch.from_numpy(render), torch.from_numpy(photograph)
    alike = ssim_map(image, truth, torch.from_numpy(valid))
    regions = {name: torch.from_numpy(own) for name, own in groups.items()}
    return {
        name: RegionScore(int(own.sum()), psnr(image, truth, own), mean_ssim(alike, own))
        for name, own in regions.items()
    }
