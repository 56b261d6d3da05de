"""The rasterizer in plain PyTorch: the definition that every other backend is tested against."""

from typing import Any

import torch
from torch import Tensor

from egosplat.rasterize.channels import camera_centers, finish, stack_channels, usable_gaussians
from egosplat.rasterize.composite_reference import composite
from egosplat.rasterize.contract import shows_colors
from egosplat.rasterize.projection_reference import Projected, project
from egosplat.rasterize.sh_reference import spherical_harmonics


def rasterization(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    colors: Tensor,
    viewmats: Tensor,
    Ks: Tensor,
    width: int,
    height: int,
    *,
    near_plane: float = 0.1,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    eps2d: float = 0.3,
    sh_degree: int | None = None,
    features: Tensor | None = None,
    backgrounds: Tensor | None = None,
    render_mode: str = "RGB",
    rasterize_mode: str = "classic",
) -> tuple[Tensor, Tensor, dict[str, Any]]:
    """``api.rasterization`` with autograd, in float32 or float64, on any device."""
    values = [value for value in (means, scales, opacities, colors, features) if value is not None]
    # A Gaussian of opacity 0 is culled, whatever its other numbers are.
    opacities = torch.where(usable_gaussians(quats, *values), opacities, 0.0)
    projections = [
        project(
            means,
            quats,
            scales,
            opacities,
            viewmat,
            K,
            width,
            height,
            near_plane=near_plane,
            far_plane=far_plane,
            radius_clip=radius_clip,
            eps2d=eps2d,
            antialiased=rasterize_mode == "antialiased",
        )
        for viewmat, K in zip(viewmats, Ks, strict=True)
    ]
    meta = _stack(projections)
    seen_colors = [colors] * len(viewmats)
    if sh_degree is not None and shows_colors(render_mode):
        cameras = zip(camera_centers(viewmats), meta["radii"], strict=True)
        seen_colors = [view_colors(means, colors, center, sh_degree, radii) for center, radii in cameras]
    images = [
        composite(
            meta["means2d"][index],
            meta["conics"][index],
            meta["opacities"][index],
            stack_channels(seen_colors[index], features, meta["depths"][index], render_mode),
            meta["depths"][index],
            meta["radii"][index],
            width,
            height,
        )
        for index in range(len(viewmats))
    ]
    composited, alpha = (torch.stack(parts) for parts in zip(*images, strict=True))
    meta |= {"width": width, "height": height, "n_cameras": len(viewmats)}
    return finish(composited, alpha, backgrounds, render_mode), alpha, meta


def view_colors(means: Tensor, coeffs: Tensor, center: Tensor, sh_degree: int, radii: Tensor) -> Tensor:
    """Colours of the visible Gaussians seen from a camera centre: ``max(SH + 0.5, 0)``; 0 for the rest.

    Args:
        means: (N, 3) [m].
        coeffs: (N, K, 3).
        center: (3,) of the camera in the world [m].
        radii: (N, 2), 0 where culled.

    Returns:
        (N, 3).
    """
    rows = (radii > 0).all(dim=-1).nonzero().squeeze(-1)
    dirs = means.index_select(0, rows) - center
    colors = (spherical_harmonics(sh_degree, dirs, coeffs.index_select(0, rows)) + 0.5).clamp(min=0.0)
    return colors.new_zeros(len(means), 3).index_copy(0, rows, colors)


def _stack(projections: list[Projected]) -> dict[str, Any]:
    names = ("means2d", "conics", "depths", "radii", "opacities")
    return {name: torch.stack([getattr(each, name) for each in projections]) for name in names}
