"""Closed-form lifting: each Gaussian gets the rendering-weighted mean code of its pixels (docs/method.md#mean-codes)."""

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from egosplat.language.targets import Targets
from egosplat.language.views import CodeViews
from egosplat.progress import track
from egosplat.rasterize.view import sum_over_pixels

# Smallest sum of compositing weights over all views [px] at which a Gaussian counts as seen.
_LEAST_WEIGHT = 1e-3


def lift(views: CodeViews) -> tuple[Tensor, Tensor]:
    """Average codes over all views, at least one: ``f_g = sum w_gp F(p) / sum w_gp`` over the pixels p with a
    code. (N, L, C) codes and (N, L) shares of N Gaussians at L levels, as in language.zarr. w is alpha times
    transmittance times 1 - M. A Gaussian that no view shows has share 0."""
    assert views.targets is not None
    sums = seen = None
    for index in track(range(len(views)), "lifting", unit="view"):
        targets = views.targets(int(views.frame[index]))
        weight = views.weight(index)
        pixels = _pixels(targets, weight)
        part = sum_over_pixels(views.view(index), pixels.permute(1, 2, 0))
        sums = part if sums is None else sums + part
        seen = targets
    assert sums is not None and seen is not None
    levels, channels = seen.codes.shape[:2]
    code, known, shown = sums.split([levels * channels, levels, 1], dim=1)
    # 0 where the weight is negligible.
    mean = code.unflatten(1, (levels, channels)) / known.clamp(min=_LEAST_WEIGHT)[..., None]
    return torch.where((known > _LEAST_WEIGHT)[..., None], mean, 0.0), labeled_share(known, shown)


def _pixels(targets: Targets, weight: Tensor | None) -> Tensor:
    """(L C + L + 1, H, W) codes, their weights and the weights of all pixels, which share one pass."""
    counted = targets.known.float() if weight is None else targets.known * weight
    levels, channels, *size = targets.codes.shape
    pixels = counted.new_empty(levels * channels + levels + 1, *size)
    codes, weights, shown = pixels.split([levels * channels, levels, 1])
    # Written in place: a copy of all codes takes as long as summing them.
    torch.mul(targets.codes, counted[:, None], out=codes.view(levels, channels, *size))
    weights.copy_(counted)
    shown.copy_(counted.new_ones(1, *size) if weight is None else weight)
    return pixels


def shares(views: CodeViews, known: Callable[[int], Tensor] | None = None) -> Tensor:
    """(N, L) shares alone, see ``lift``; ``known`` gives the (L, H, W) bool pixels of a frame with a target, None all at one level."""
    everywhere = torch.ones(1, views.camera.height, views.camera.width, dtype=torch.bool, device=views.device)

    def without_codes(frame: int) -> Targets:
        pixels = known(frame) if known else everywhere
        return Targets(pixels.new_zeros(len(pixels), 0, *pixels.shape[1:], dtype=torch.float32), pixels)

    return lift(replace(views, targets=without_codes))[1]


def labeled_share(known: Tensor, seen: Tensor) -> Tensor:
    """(N, L) share in [0, 1] of what Gaussians show that has a code; 0 where the weight is negligible.
    ``known`` (N, L) and ``seen`` (N, 1) are compositing weights in the pixels with a code, and in all pixels
    [px]."""
    # Above 1 by rounding only.
    share = (known / seen.clamp(min=_LEAST_WEIGHT)).clamp(max=1.0)
    return torch.where(known > _LEAST_WEIGHT, share, 0.0)
