"""The rasterizer in plain PyTorch: the definition that the other backends are tested against."""

from typing import Any

import torch
from torch import Tensor

from egosplat.rasterize.channels import camera_centers, finish, stack_channels, usable_gaussians
from egosplat.rasterize.contract import Arguments, Render, shows_colors
from egosplat.rasterize.reference.composite import composite
from egosplat.rasterize.reference.projection import Projected, project
from egosplat.rasterize.reference.spherical_harmonics import spherical_harmonics


def rasterization(arguments: Arguments) -> Render:
    """``api.rasterization`` with autograd, in float32 or float64, on any device."""
    a = arguments
    values = [value for value in (a.means, a.scales, a.opacities, a.colors, a.features) if value is not None]
    # ``project`` culls a Gaussian of opacity 0, whatever its other numbers are.
    opacities = torch.where(usable_gaussians(a.quats, *values), a.opacities, 0.0)
    projections = [
        project(
            a.means,
            a.quats,
            a.scales,
            opacities,
            viewmat,
            K,
            a.width,
            a.height,
            near_plane=a.near_plane,
            far_plane=a.far_plane,
            radius_clip=a.radius_clip,
            eps2d=a.eps2d,
            antialiased=a.antialiased,
        )
        for viewmat, K in zip(a.viewmats, a.Ks, strict=True)
    ]
    meta = _stack(projections)
    seen_colors = [a.colors] * len(a.viewmats)
    if a.sh_degree is not None and shows_colors(a.render_mode):
        cameras = zip(camera_centers(a.viewmats), meta["radii"], strict=True)
        seen_colors = [
            view_colors(a.means, a.colors, center, a.sh_degree, radii) for center, radii in cameras
        ]
    images = [
        composite(
            meta["means2d"][index],
            meta["conics"][index],
            meta["opacities"][index],
            stack_channels(seen_colors[index], a.features, meta["depths"][index], a.render_mode),
            meta["depths"][index],
            meta["radii"][index],
            a.width,
            a.height,
        )
        for index in range(len(a.viewmats))
    ]
    composited, alpha = (torch.stack(parts) for parts in zip(*images, strict=True))
    meta |= {"width": a.width, "height": a.height, "n_cameras": len(a.viewmats)}
    return finish(composited, alpha, a.backgrounds, a.render_mode), alpha, meta


def view_colors(means: Tensor, coeffs: Tensor, center: Tensor, sh_degree: int, radii: Tensor) -> Tensor:
    """Colours of the visible Gaussians from a camera centre: ``max(SH + 0.5, 0)``; 0 for the others.

    Args:
        means: (N, 3) [m].
        coeffs: (N, K, 3).
        center: (3,) camera centre in the world [m].
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
