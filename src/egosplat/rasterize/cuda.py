"""The rasterizer on a CUDA device: gsplat."""

import importlib
from types import ModuleType
from typing import Any

import torch
from torch import Tensor

from egosplat.errors import UserError
from egosplat.rasterize import reference
from egosplat.rasterize.channels import camera_centers, usable_gaussians
from egosplat.rasterize.contract import shows_colors, shows_depth

OLDEST_GSPLAT = (1, 5, 3)

LARGEST_PASS = 33
"""Channels composited in one pass: gsplat is slow beyond 32, and 33 (32 and a depth) it compiles as they are."""

SMALLEST_DISTANCE = 1e-6
"""A Gaussian nearer to the camera's centre has no direction [m]; the near plane culls it."""


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
    """``api.rasterization`` by gsplat, in float32 on a CUDA device.

    Raises:
        UserError: there is no CUDA device, no gsplat of at least 1.5.3, or the tensors are not float32 on
            a CUDA device.
    """
    arguments = dict(locals())
    gsplat = load_gsplat()
    if means.dtype != torch.float32 or not means.is_cuda:
        raise UserError(
            f"backend cuda renders float32 on a CUDA device, not {means.dtype} on {means.device}: use auto"
        )
    # gsplat divides by the number of Gaussians.
    return render(gsplat, **arguments) if len(means) else reference.rasterization(**arguments)


def load_gsplat() -> ModuleType:
    """gsplat, which compiles itself when it is imported the first time.

    Raises:
        UserError: it is missing, too old or does not load, or there is no CUDA device.
    """
    # Without a device gsplat would still try to compile, and fail in words that mislead.
    if not torch.cuda.is_available():
        raise UserError("backend cuda: PyTorch finds no CUDA device; use the backend auto or cpu")
    advice = 'run: pip install "gsplat>=1.5.3" packaging ninja (it compiles itself once and needs nvcc)'
    try:
        gsplat = importlib.import_module("gsplat")
        compiled = importlib.import_module("gsplat.cuda._backend")._C
    except (ImportError, OSError, RuntimeError) as error:
        raise UserError(f"backend cuda: gsplat cannot be loaded ({error}); {advice}") from error
    version = tuple(int(part) for part in gsplat.__version__.split(".")[:3] if part.isdigit())
    if version < OLDEST_GSPLAT:
        raise UserError(f"backend cuda: gsplat {gsplat.__version__} is too old; {advice}")
    if compiled is None:
        raise UserError(f"backend cuda: gsplat found no CUDA toolkit to compile itself with; {advice}")
    return gsplat


def render(
    gsplat: ModuleType,
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
    near_plane: float,
    far_plane: float,
    radius_clip: float,
    eps2d: float,
    sh_degree: int | None,
    features: Tensor | None,
    backgrounds: Tensor | None,
    render_mode: str,
    rasterize_mode: str,
) -> tuple[Tensor, Tensor, dict[str, Any]]:
    """Translate one call of ``rasterization`` into gsplat's, for N > 0 Gaussians."""
    means, quats, scales, opacities, colors, features = _without_unusable(
        means, quats, scales, opacities, colors, features
    )
    if not shows_colors(render_mode):
        # gsplat checks colours that it does not show.
        channels, backgrounds = opacities[:, None], None
    else:
        if sh_degree is not None:
            colors = _view_colors(gsplat, means, colors, viewmats, sh_degree)
        channels = _append(colors, features)
    passed = channels.shape[-1] + shows_depth(render_mode)
    image, alpha, meta = gsplat.rasterization(
        means=means,
        quats=quats,
        scales=scales,
        opacities=opacities,
        colors=channels,
        viewmats=viewmats,
        Ks=Ks,
        width=width,
        height=height,
        near_plane=near_plane,
        far_plane=far_plane,
        radius_clip=radius_clip,
        eps2d=eps2d,
        # Packed results lose the (C, N) layout, and gsplat 1.5.3 fails on them where there are backgrounds.
        packed=False,
        backgrounds=backgrounds,
        render_mode=render_mode,
        rasterize_mode=rasterize_mode,
        channel_chunk=min(passed, LARGEST_PASS),
    )
    kept = ("means2d", "radii", "depths", "conics", "opacities", "width", "height", "n_cameras")
    return image, alpha, {name: meta[name] for name in kept}


def _without_unusable(
    means: Tensor, quats: Tensor, scales: Tensor, opacities: Tensor, colors: Tensor, features: Tensor | None
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor | None]:
    """Put harmless numbers, opacity 0 among them, in place of Gaussians that must be culled."""
    values = [value for value in (means, scales, opacities, colors, features) if value is not None]
    usable = usable_gaussians(quats, *values)
    if usable.all():
        return means, quats, scales, opacities, colors, features

    def replace(value: Tensor, by: float) -> Tensor:
        # Chosen, not multiplied: the gradient of what is left out is zero even where it is NaN.
        return torch.where(usable.reshape(-1, *[1] * (value.ndim - 1)), value, by)

    return (
        replace(means, 0.0),
        replace(quats, 1.0),
        replace(scales, 1.0),
        replace(opacities, 0.0),
        replace(colors, 0.0),
        None if features is None else replace(features, 0.0),
    )


def _view_colors(
    gsplat: ModuleType, means: Tensor, coeffs: Tensor, viewmats: Tensor, sh_degree: int
) -> Tensor:
    """(C, N, 3) colours; arbitrary for Gaussians at the camera's centre.

    Evaluated here because gsplat's own call takes no further channels beside spherical harmonics.
    """
    dirs = means - camera_centers(viewmats)[:, None, :]
    # gsplat would send NaN into the gradients of a Gaussian without direction.
    masks = torch.linalg.vector_norm(dirs.detach(), dim=-1) > SMALLEST_DISTANCE
    coeffs = coeffs.expand(len(viewmats), *coeffs.shape)
    colors = gsplat.spherical_harmonics(sh_degree, dirs, coeffs, masks=masks)
    return (colors + 0.5).clamp(min=0.0)


def _append(colors: Tensor, features: Tensor | None) -> Tensor:
    if features is None:
        return colors
    return torch.cat([colors, features.expand(*colors.shape[:-1], features.shape[-1])], dim=-1)
