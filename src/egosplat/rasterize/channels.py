"""Helpers shared by the backends: usable Gaussians, stacked input channels, finished images."""

import torch
from torch import Tensor

from egosplat.rasterize.contract import MIN_DEPTH_ALPHA, shows_colors, shows_depth, shows_expected_depth


def usable_gaussians(quats: Tensor, *values: Tensor) -> Tensor:
    """Find the Gaussians with only finite numbers and a quaternion of nonzero length.

    Args:
        quats: (N, 4).
        values: any number of (N, ...) tensors.

    Returns:
        (N,) bool.
    """
    norms = torch.linalg.vector_norm(quats.detach(), dim=-1)
    usable = (norms > 0) & norms.isfinite()
    for value in values:
        usable = usable & value.detach()[..., None].isfinite().flatten(1).all(dim=-1)
    return usable


def camera_centers(viewmats: Tensor) -> Tensor:
    """(C, 4, 4) world_to_camera -> (C, 3) centers in the world; differentiable. The last row is ignored."""
    # A general inverse instead of the transpose: its gradients by the pose hold for any matrix.
    # ``solve_ex`` does not read its error flag, for which the CPU would wait for a GPU.
    return torch.linalg.solve_ex(viewmats[:, :3, :3], -viewmats[:, :3, 3]).result


def stack_channels(colors: Tensor, features: Tensor | None, depths: Tensor, render_mode: str) -> Tensor:
    """Stack the channels that the mode composites: colors, features, depth.

    Args:
        colors: (..., N, D).
        features: (N, F) or None.
        depths: (..., N).

    Returns:
        (..., N, X).
    """
    parts = []
    if shows_colors(render_mode):
        parts.append(colors)
        if features is not None:
            parts.append(features.expand(*colors.shape[:-1], -1))
    if shows_depth(render_mode):
        parts.append(depths[..., None])
    return torch.cat(parts, dim=-1)


def finish(composited: Tensor, alpha: Tensor, backgrounds: Tensor | None, render_mode: str) -> Tensor:
    """Blend colors and features with the background; convert accumulated to expected depth if needed.

    Args:
        composited: (C, H, W, X).
        alpha: (C, H, W, 1).
        backgrounds: (C, D + F) or None for zeros; a depth has no background.

    Returns:
        (C, H, W, X).
    """
    depth_channels = int(shows_depth(render_mode))
    colors, depth = composited.split([composited.shape[-1] - depth_channels, depth_channels], dim=-1)
    if backgrounds is not None and shows_colors(render_mode):
        colors = colors + (1.0 - alpha) * backgrounds[:, None, None, :]
    if shows_expected_depth(render_mode):
        depth = depth / alpha.clamp(min=MIN_DEPTH_ALPHA)
    return torch.cat([colors, depth], dim=-1)
