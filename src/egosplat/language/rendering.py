"""Render codes of Gaussians: alpha compositing, as for colors, weighted by share."""

import torch
from torch import Tensor

from egosplat.rasterize.view import View, composite

# Below this coverage a pixel has code 0.
_LEAST_COVERAGE = 1e-6


def render_codes(view: View, code: Tensor, share: Tensor) -> tuple[Tensor, Tensor]:
    """Render (N, L, C) codes and (N, L) shares of language.zarr. (L, H, W, C) float32 weighted means, 0 where the coverage is 0; and (L, H,
    W) float32 coverage in [0, 1], accumulated compositing weight times share."""
    count, levels, channels = code.shape
    # A Gaussian counts by compositing weight times share: without labeled pixels it has no influence.
    values = torch.cat([(code * share[..., None]).reshape(count, -1), share], dim=1)
    image, _ = composite(view, values)
    sums, coverage = image.split([levels * channels, levels], dim=-1)
    sums = sums.unflatten(-1, (levels, channels)).movedim(-2, 0)
    coverage = coverage.movedim(-1, 0)
    # Decoders have biases, so the sum must be divided by its weight before it is decoded (docs/method.md#code-weight).
    covered = (coverage > _LEAST_COVERAGE)[..., None]
    codes = torch.where(covered, sums / coverage.clamp(min=_LEAST_COVERAGE)[..., None], 0.0)
    return codes, coverage
