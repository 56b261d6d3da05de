"""How much of each view every Gaussian fills, by its compositing weights."""

from collections.abc import Iterable

import numpy as np
import torch
from torch import Tensor

from egosplat.codes.rendering import Lens, sum_over_pixels
from egosplat.gaussians.model import Gaussians
from egosplat.geometry import Array, Camera
from egosplat.query.smoothing import Mask


def visible_shares(
    gaussians: Gaussians, camera: Camera, poses: Iterable[Array], valid: Mask | None, lens: Lens
) -> Tensor:
    """Share of each view that every Gaussian fills, with what stands in front of it taken into account.

    A picture is linear in the values of the Gaussians. The transposed map of a picture of ones therefore sums the
    compositing weights of each Gaussian. Pixels count less towards the border, where things are cut off: by a half sine
    along each axis, with mean 1 over the picture.

    Args:
        gaussians: the scene.
        camera: of all views, at the resolution to measure in.
        poses: V (4, 4) float64 camera_to_world.
        valid: (height, width) bool pixels of the camera that show the scene, or None for all.
        lens: how to render.

    Returns:
        (V, N) float32 on the device of the Gaussians, each row with a sum of at most about 1.
    """
    ones = torch.from_numpy(_window(camera, valid)).to(gaussians.means.device)
    rows = [sum_over_pixels(gaussians, ones[..., None], camera, pose, lens)[:, 0] for pose in poses]
    return torch.stack(rows) if rows else ones.new_zeros(0, gaussians.count)


def _window(camera: Camera, valid: Mask | None) -> np.ndarray:
    """(H, W) float32 share of the picture that each pixel counts as."""
    down, right = (np.sin(np.pi * (np.arange(side) + 0.5) / side) for side in (camera.height, camera.width))
    window = np.outer(down, right)
    window /= window.sum()
    return np.where(True if valid is None else valid, window, 0.0).astype(np.float32)
