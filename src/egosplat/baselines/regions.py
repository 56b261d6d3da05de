"""Region-balanced losses over sampled pixels, as GAGS (Peng et al. 2024) has them over all."""

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Sample:
    """S pixels drawn from R regions.

    Attributes:
        pixel: (S,) int64 index among the pixels that were drawn from.
        region: (S,) int64 in [0, R), sorted.
        size: (R,) int64 pixels that each region has in all.
    """

    pixel: Tensor
    region: Tensor
    size: Tensor


def sample_regions(region: Tensor, count: int, draw: torch.Generator) -> Sample:
    """Draw about ``count`` pixels, equally many of each region, none twice.

    The mean over regions of the mean over a region's drawn pixels has the expectation of that over all pixels, and
    so has a region's variance.

    Args:
        region: (Q,) int64 region of each pixel, any numbers; negative for none. On the CPU.
        count: pixels to draw; at least 2 of each region. If that is too many, regions are drawn, too.
        draw: generator.
    """
    inside = (region >= 0).nonzero()[:, 0]
    names, place, size = region[inside].unique(return_inverse=True, return_counts=True)
    if (most := max(1, count // 2)) < len(names):
        kept = torch.zeros(len(names), dtype=torch.bool)
        kept[torch.randperm(len(names), generator=draw)[:most]] = True
        inside, size = inside[kept[place]], size[kept]
        place = (kept.cumsum(0) - 1)[place[kept[place]]]
    # In random order, then sorted by region: the first pixels of a region are a random part of it.
    order = torch.randperm(len(inside), generator=draw)
    order = order[place[order].argsort(stable=True)]
    first = size.cumsum(0) - size
    rank = torch.arange(len(order)) - first[place[order]]
    drawn = order[rank < max(2, count // max(1, len(size)))]
    return Sample(inside[drawn], place[drawn], size)


def mean_over_regions(values: Tensor, sample: Sample) -> Tensor:
    """() mean over regions of the mean of each region's (S,) values; 0 without regions."""
    regions = len(sample.size)
    sums = values.new_zeros(regions).index_add(0, sample.region.to(values.device), values)
    return (sums / _drawn(sample).to(values).clamp(min=1)).sum() / max(1, regions)


def variance_within(values: Tensor, sample: Sample, pixels: int) -> Tensor:
    """() sum over regions of pixels * mean over channels of the unbiased variance within, over all pixels.

    Args:
        values: (S, C).
        pixels: of the whole image. A region of one pixel does not count.
    """
    drawn, region = _drawn(sample).to(values)[:, None], sample.region.to(values.device)
    sums = values.new_zeros(len(sample.size), values.shape[1])
    means = sums.index_add(0, region, values) / drawn.clamp(min=1)
    squares = sums.index_add(0, region, (values - means[region]).square())
    variance = torch.where(drawn > 1, squares / (drawn - 1).clamp(min=1), 0.0).mean(dim=1)
    return (sample.size.to(values) * variance).sum() / pixels


def _drawn(sample: Sample) -> Tensor:
    """(R,) drawn pixels of each region."""
    return sample.region.bincount(minlength=len(sample.size))
