"""Depths of the surfaces that Gaussians show."""

import torch
from torch import Tensor

from egosplat.geometry import invert
from egosplat.language.views import CodeViews
from egosplat.rasterize.view import pixel_lists

# Pixels listed at a time: their lists take about 100 MiB.
_PIXELS_AT_ONCE = 2**16


def surface_depths(views: CodeViews, index: int, pixels: Tensor) -> Tensor:
    """(P,) ``median_depths`` of (P, 2) pixels of a view, column and row."""
    inverse, view = torch.from_numpy(invert(views.camera_to_world[index])), views.view(index)
    depth = views.gaussians.means.cpu().double() @ inverse[2, :3] + inverse[2, 3]
    parts = pixels.split(_PIXELS_AT_ONCE) if len(pixels) else ()
    return torch.cat([depth[:0], *(median_depths(*pixel_lists(view, part), depth) for part in parts)])


def median_depths(begin: Tensor, gaussians: Tensor, weights: Tensor, depth: Tensor) -> Tensor:
    """(P,) float64 depths at which the transmittance of P pixels falls below 0.5 [m]; NaN where it does not.

    Args:
        begin, gaussians, weights: P lists, see ``egosplat.rasterize.view.pixel_lists``.
        depth: (N,) float64 camera z of all Gaussians [m].
    """
    pixel = torch.repeat_interleave(begin.diff())
    # float64: the sum runs over the lists of all pixels.
    total = torch.cat([weights.new_zeros(1, dtype=torch.float64), weights.double().cumsum(0)])
    falls = (1.0 - (total[1:] - total[begin[:-1]][pixel]) < 0.5).nonzero()[:, 0]
    first = torch.full((len(begin) - 1,), len(gaussians))
    first.scatter_reduce_(0, pixel[falls], falls, "amin")
    padded = torch.cat([depth[gaussians], depth.new_full((1,), float("nan"))])
    return padded[first]
