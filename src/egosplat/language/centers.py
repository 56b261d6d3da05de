"""What a view shows where the centers of Gaussians are projected."""

from dataclasses import dataclass

import numpy as np
import torch

from egosplat.arrays import Array, Floats, Ints
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, view_of
from egosplat.geometry import Camera, invert, transform
from egosplat.rasterize.view import own_weights


@dataclass(frozen=True, eq=False)
class Centers:
    """The M Gaussians whose center lies in a view, and the pixels that hold the centers.

    Attributes:
        gaussian: (M,) int64 index of each.
        pixel: (M, 2) int64, column and row.
        depth: (M,) float64 camera z of the center [m].
        weight: (M,) float32 alpha times transmittance of the Gaussian at its pixel; 0 if the pixel ends before it.
    """

    gaussian: Ints
    pixel: Ints
    depth: Array
    weight: Floats


def look_at_centers(
    gaussians: Gaussians, camera: Camera, camera_to_world: Array, settings: RenderSettings
) -> Centers:
    """Find what a view shows at the centers of the Gaussians in front of the near plane."""
    local = transform(invert(camera_to_world), gaussians.means.double().cpu().numpy())
    projected = camera.project(local)
    chosen = np.flatnonzero(camera.contains(projected) & (local[:, 2] >= settings.near_plane))
    # Pixel centers lie at integers + 0.5.
    pixel = np.floor(projected[chosen]).astype(np.int64)
    view = view_of(gaussians, camera, camera_to_world, settings)
    own = torch.full((gaussians.count, 2), -1)
    own[chosen] = torch.from_numpy(pixel)
    return Centers(chosen, pixel, local[chosen, 2], own_weights(view, own)[chosen].numpy())
