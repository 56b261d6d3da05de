"""What a view shows where the centers of Gaussians are projected."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, view_of
from egosplat.geometry import Camera, invert, transform
from egosplat.rasterize.view import own_weights, pixel_lists

# Pixels listed at a time: their lists take about 100 MiB.
_PIXELS_AT_ONCE = 2**16


@dataclass(frozen=True, eq=False)
class Centers:
    """The M Gaussians whose center lies in a view, and the pixels that hold the centers.

    Attributes:
        gaussian: (M,) int64 index of each.
        pixel: (M, 2) int64, column and row.
        depth: (M,) float64 camera z of the center [m].
        weight: (M,) float32 alpha times transmittance of the Gaussian at its pixel; 0 if the pixel ends before it.
        median_depth: (M,) float64 [m], see ``median_depths``; None if it was not asked for.
    """

    gaussian: NDArray[np.int64]
    pixel: NDArray[np.int64]
    depth: NDArray[np.float64]
    weight: NDArray[np.float32]
    median_depth: NDArray[np.float64] | None


def look_at_centers(
    gaussians: Gaussians,
    camera: Camera,
    camera_to_world: NDArray[np.float64],
    settings: RenderSettings,
    *,
    median: bool = True,
) -> Centers:
    """Find what a view shows at the centers of the Gaussians in front of the near plane; ``median`` takes most of the time."""
    chosen, pixel, depth = project_centers(gaussians, camera, camera_to_world, settings)
    view = view_of(gaussians, camera, camera_to_world, settings)
    own = torch.full((gaussians.count, 2), -1)
    own[chosen] = torch.from_numpy(pixel)
    weight = own_weights(view, own)[chosen].numpy()
    if not median:
        return Centers(chosen, pixel, depth[chosen], weight, None)
    depths = [np.zeros(0)]
    for begin in range(0, len(chosen), _PIXELS_AT_ONCE):
        shown = pixel_lists(view, torch.from_numpy(pixel[begin : begin + _PIXELS_AT_ONCE]))
        depths.append(median_depths(*shown, torch.from_numpy(depth)).numpy())
    return Centers(chosen, pixel, depth[chosen], weight, np.concatenate(depths))


def project_centers(
    gaussians: Gaussians, camera: Camera, camera_to_world: NDArray[np.float64], settings: RenderSettings
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """The M Gaussians in front of the near plane whose center lies in a view. (M,) index of each; (M, 2)
    column and row of the pixel that holds its center; (N,) camera z of all Gaussians [m]."""
    local = transform(invert(camera_to_world), gaussians.means.double().cpu().numpy())
    projected = camera.project(local)
    chosen = np.flatnonzero(camera.contains(projected) & (local[:, 2] >= settings.near_plane))
    # Pixel centers lie at integers + 0.5.
    return chosen, np.floor(projected[chosen]).astype(np.int64), local[:, 2]


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
