"""Render codes of Gaussians: alpha compositing, as for colors, weighted by share."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor

from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings
from egosplat.geometry import Camera, invert
from egosplat.rasterize import api as rasterize

# Below this coverage a pixel has code 0.
_LEAST_COVERAGE = 1e-6


@dataclass(frozen=True, eq=False)
class RenderedCodes:
    """Code image at L levels.

    Attributes:
        codes: (L, H, W, C) float32, weighted means of the Gaussians' codes; 0 where the coverage is 0.
        coverage: (L, H, W) float32 in [0, 1], accumulated compositing weight times share.
    """

    codes: Tensor
    coverage: Tensor


def render_values(
    gaussians: Gaussians,
    values: Tensor,
    camera: Camera,
    camera_to_world: NDArray[np.float64],
    settings: RenderSettings,
) -> tuple[Tensor, Tensor]:
    """Composite (N, X) values of Gaussians, for any X; differentiable by the values.

    Args:
        gaussians: their geometry is used.
        values: (N, X) float32 on the same device.
        camera_to_world: (4, 4) float64, OpenCV axes, meters.

    Returns:
        (H, W, X) float32 on background 0, and (H, W) accumulated opacity.
    """
    device = gaussians.means.device
    images, alphas, _ = rasterize.rasterization(
        gaussians.means,
        gaussians.quats,
        gaussians.scales,
        gaussians.opacities,
        values,
        torch.from_numpy(invert(camera_to_world)).to(device, torch.float32)[None],
        torch.from_numpy(camera.matrix).to(device, torch.float32)[None],
        camera.width,
        camera.height,
        near_plane=settings.near_plane,
        rasterize_mode="antialiased" if settings.antialiased else "classic",
        backend=settings.backend,
    )
    return images[0], alphas[0, ..., 0]


def geometry_of(gaussians: Gaussians) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Means, quaternions, scales and opacities, as the functions of ``egosplat.rasterize.api`` take them."""
    return gaussians.means, gaussians.quats, gaussians.scales, gaussians.opacities


def view_arguments(
    camera: Camera, camera_to_world: NDArray[np.float64], settings: RenderSettings, device: torch.device
) -> dict[str, Any]:
    """Arguments of one view and of the settings, for the functions of ``egosplat.rasterize.api`` that take one camera."""
    return {
        "viewmat": torch.from_numpy(invert(camera_to_world)).to(device, torch.float32),
        "K": torch.from_numpy(camera.matrix).to(device, torch.float32),
        "near_plane": settings.near_plane,
        "rasterize_mode": "antialiased" if settings.antialiased else "classic",
        "backend": settings.backend,
    }


def sum_over_pixels(
    gaussians: Gaussians,
    image: Tensor,
    camera: Camera,
    camera_to_world: NDArray[np.float64],
    settings: RenderSettings,
) -> Tensor:
    """Transposed map of ``render_values``: sum an image over each Gaussian's compositing weights.

    Args:
        gaussians: their geometry is used.
        image: (H, W, X) float32 on the same device.
        camera, camera_to_world, settings: as in ``render_values``.

    Returns:
        (N, X) float32.
    """
    view = view_arguments(camera, camera_to_world, settings, gaussians.means.device)
    return rasterize.sum_over_pixels(*geometry_of(gaussians), image, **view)


def render_sparse_values(
    gaussians: Gaussians,
    values: sparse.csr_array,
    camera: Camera,
    camera_to_world: NDArray[np.float64],
    settings: RenderSettings,
) -> Tensor:
    """Composite (N, X) values of Gaussians of which few are not 0; not differentiable.

    Args:
        gaussians, camera, camera_to_world, settings: as in ``render_values``.
        values: (N, X) float32.

    Returns:
        (X, H, W) float32 on background 0.
    """
    device = gaussians.means.device
    begin, channel = (
        torch.from_numpy(each).to(device, torch.int64) for each in (values.indptr, values.indices)
    )
    rows = begin, channel, torch.from_numpy(values.data).to(device)
    view = view_arguments(camera, camera_to_world, settings, device)
    size = {"width": camera.width, "height": camera.height}
    return rasterize.sparse_values(*geometry_of(gaussians), *rows, values.shape[1], **view, **size)


def pixel_renderer(
    gaussians: Gaussians,
    pixels: Tensor,
    camera: Camera,
    camera_to_world: NDArray[np.float64],
    settings: RenderSettings,
) -> Callable[[Tensor], Tensor]:
    """Prepare ``render_values`` of single pixels.

    Args:
        gaussians: their geometry is used.
        pixels: (P, 2) integers, column and row, on the CPU.
        camera, camera_to_world, settings: as in ``render_values``.

    Returns:
        A function of (N, X) values that gives (P, X), differentiable by the values.
    """
    view = view_arguments(camera, camera_to_world, settings, gaussians.means.device)
    size = {"width": camera.width, "height": camera.height}
    return rasterize.pixel_renderer(*geometry_of(gaussians), pixels, **view, **size)


def render_codes(
    gaussians: Gaussians,
    code: Tensor,
    share: Tensor,
    camera: Camera,
    camera_to_world: NDArray[np.float64],
    settings: RenderSettings,
) -> RenderedCodes:
    """Render the codes of Gaussians.

    Args:
        gaussians: the scene, on any device.
        code, share: (N, L, C) and (N, L) of language.zarr, on the same device.
        camera, camera_to_world: see ``render_values``.
    """
    count, levels, channels = code.shape
    # A Gaussian counts by compositing weight times share: without labeled pixels it has no influence.
    values = torch.cat([(code * share[..., None]).reshape(count, -1), share], dim=1)
    image, _ = render_values(gaussians, values, camera, camera_to_world, settings)
    sums, coverage = image.split([levels * channels, levels], dim=-1)
    sums = sums.unflatten(-1, (levels, channels)).movedim(-2, 0)
    coverage = coverage.movedim(-1, 0)
    # Decoders have biases, so the sum must be divided by its weight before it is decoded (docs/method.md#code-weight).
    covered = (coverage > _LEAST_COVERAGE)[..., None]
    codes = torch.where(covered, sums / coverage.clamp(min=_LEAST_COVERAGE)[..., None], 0.0)
    return RenderedCodes(codes, coverage)
