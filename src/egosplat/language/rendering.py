"""Render codes of Gaussians: alpha compositing, as for colors, weighted by share."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, view_of
from egosplat.geometry import Camera
from egosplat.rasterize.view import composite

# Below this coverage a pixel has code 0.
_LEAST_COVERAGE = 1e-6


def render_codes(
    gaussians: Gaussians,
    code: Tensor,
    share: Tensor,
    camera: Camera,
    camera_to_world: NDArray[np.float64],
    settings: RenderSettings,
) -> tuple[Tensor, Tensor]:
    """Render (N, L, C) codes and (N, L) shares of language.zarr; other arguments as of
    ``gaussians.render.view_of``. (L, H, W, C) float32 weighted means, 0 where the coverage is 0; and (L, H,
    W) float32 coverage in [0, 1], accumulated compositing weight times share."""
    count, levels, channels = code.shape
    # A Gaussian counts by compositing weight times share: without labeled pixels it has no influence.
    values = torch.cat([(code * share[..., None]).reshape(count, -1), share], dim=1)
    image, _ = composite(view_of(gaussians, camera, camera_to_world, settings), values)
    sums, coverage = image.split([levels * channels, levels], dim=-1)
    sums = sums.unflatten(-1, (levels, channels)).movedim(-2, 0)
    coverage = coverage.movedim(-1, 0)
    # Decoders have biases, so the sum must be divided by its weight before it is decoded (docs/method.md#code-weight).
    covered = (coverage > _LEAST_COVERAGE)[..., None]
    codes = torch.where(covered, sums / coverage.clamp(min=_LEAST_COVERAGE)[..., None], 0.0)
    return codes, coverage
