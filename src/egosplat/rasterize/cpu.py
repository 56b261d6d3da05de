"""The rasterizer by the compiled kernels: float32 on the CPU."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from egosplat.errors import UserError
from egosplat.kernels import library
from egosplat.kernels.raster import View, composite, project
from egosplat.rasterize.contract import MIN_DEPTH_ALPHA, shows_colors, shows_depth, shows_expected_depth


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
    """``api.rasterization`` by the compiled kernels; the images are views of planar ones.

    Raises:
        UserError: the kernels are not compiled, or the tensors are not float32 on the CPU.
    """
    if why_not := library.why_not():
        raise UserError(why_not)
    if means.dtype != torch.float32 or means.device.type != "cpu":
        raise UserError(
            f"backend cpu renders float32 on the CPU, not {means.dtype} on {means.device}: use reference"
        )
    sh, extra = _sources(colors, features, sh_degree, render_mode)
    views = [
        View(
            width,
            height,
            (K[0, 0].item(), K[1, 1].item(), K[0, 2].item(), K[1, 2].item()),
            near_plane,
            far_plane,
            radius_clip,
            eps2d,
            rasterize_mode == "antialiased",
            0 if sh is None else (sh_degree + 1) ** 2,
            shows_depth(render_mode),
        )
        for K in Ks
    ]
    projected = [
        project(means, quats, scales, opacities, sh, extra, viewmat, view)
        for viewmat, view in zip(viewmats, views, strict=True)
    ]
    means2d, conics, depths, seen, _, _, radii = (_batch(each) for each in zip(*projected, strict=True))
    images = [
        # The batch of centres, not what it was made of: its gradient is what density control reads.
        composite(
            means2d[index],
            *projected[index][1:],
            _background(backgrounds, index, render_mode),
            width,
            height,
        )
        for index in range(len(views))
    ]
    renders = _batch([_finished(*image, render_mode).permute(1, 2, 0) for image in images])
    alphas = _batch([alpha[..., None] for _, alpha in images])
    meta = {"means2d": means2d, "radii": radii, "depths": depths, "conics": conics, "opacities": seen}
    return renders, alphas, meta | {"width": width, "height": height, "n_cameras": len(views)}


def _sources(
    colors: Tensor, features: Tensor | None, sh_degree: int | None, render_mode: str
) -> tuple[Tensor | None, Tensor | None]:
    """Spherical harmonics to evaluate, and channels to take as they are."""
    if not shows_colors(render_mode):
        return None, None
    if sh_degree is not None:
        return colors, features
    return None, colors if features is None else torch.cat([colors, features], dim=-1)


def _background(backgrounds: Tensor | None, index: int, render_mode: str) -> Tensor | None:
    if backgrounds is None or not shows_colors(render_mode):
        return None
    background = backgrounds[index]
    return torch.nn.functional.pad(background, (0, 1)) if shows_depth(render_mode) else background


def _finished(render: Tensor, alpha: Tensor, render_mode: str) -> Tensor:
    """(X, H, W) with accumulated turned into expected depth, where that is asked for."""
    if not shows_expected_depth(render_mode):
        return render
    return torch.cat([render[:-1], render[-1:] / alpha.clamp(min=MIN_DEPTH_ALPHA)])


def _batch(tensors: Sequence[Tensor]) -> Tensor:
    """Stack along a new first axis; of one tensor, without a copy."""
    return tensors[0][None] if len(tensors) == 1 else torch.stack(list(tensors))
