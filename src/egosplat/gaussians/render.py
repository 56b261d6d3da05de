"""One camera's picture of the Gaussians."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.gaussians.model import Gaussians
from egosplat.geometry import Camera, invert
from egosplat.rasterize.api import rasterization
from egosplat.rasterize.contract import shows_colors


@dataclass(frozen=True)
class RenderSettings:
    """How Gaussians are rendered, in training and afterwards.

    Attributes:
        near_plane: nearest camera z that is rendered [m].
        background: ``black``, ``white``, or ``random``: another colour in each training iteration, black elsewhere.
        antialiased: dim Gaussians that are smaller than a pixel (Yu et al. 2024) rather than inflate them.
        backend: see ``egosplat.rasterize.api.rasterization``.
    """

    near_plane: float
    background: str
    antialiased: bool
    backend: str

    @property
    def still_background(self) -> Tensor | None:
        """(3,) float32 background colour of evaluation and pages; None for black."""
        return torch.ones(3) if self.background == "white" else None


def render(
    gaussians: Gaussians,
    camera: Camera,
    camera_to_world: NDArray[np.float64],
    settings: RenderSettings,
    *,
    sh_degree: int,
    background: Tensor | None,
    render_mode: str = "RGB",
) -> tuple[Tensor, Tensor, dict[str, Any]]:
    """Render colours, then features, then depth (in the modes that have it), in one pass.

    Args:
        gaussians: the scene.
        camera: pinhole camera of the picture.
        camera_to_world: (4, 4) float64, OpenCV axes, metres.
        settings: how to render; ``background`` decides the colour behind the scene, not ``settings.background``.
        sh_degree: degree up to which ``sh`` is used; at most ``gaussians.sh_degree``.
        background: (3,) float32 colour behind the scene, None for black. Behind features and depth is zero.
        render_mode: "RGB", "D", "ED", "RGB+D" or "RGB+ED"; "D" and "ED" render no colours and features.

    Returns:
        render: (H, W, X) float32; X = 3 + F, and 1 more (or 1 alone) for depth.
        alpha: (H, W, 1) float32, accumulated opacity.
        meta: as the rasterizer gives it, with one camera: ``means2d`` (1, N, 2), ``radii`` (1, N, 2), ...

    Raises:
        ValueError: see ``egosplat.rasterize.api.rasterization``.
    """
    device = gaussians.means.device
    # Far from the world's origin a pose inverted in float32 would lose millimetres.
    world_to_camera = torch.from_numpy(invert(camera_to_world)).to(device, torch.float32)
    intrinsics = torch.from_numpy(camera.matrix).to(device, torch.float32)
    images, alphas, meta = rasterization(
        gaussians.means,
        gaussians.quats,
        gaussians.scales,
        gaussians.opacities,
        gaussians.sh,
        world_to_camera[None],
        intrinsics[None],
        camera.width,
        camera.height,
        near_plane=settings.near_plane,
        sh_degree=sh_degree,
        features=gaussians.features if gaussians.features.shape[1] else None,
        backgrounds=_backgrounds(background, gaussians) if shows_colors(render_mode) else None,
        render_mode=render_mode,
        rasterize_mode="antialiased" if settings.antialiased else "classic",
        backend=settings.backend,
    )
    return images[0], alphas[0], meta


def _backgrounds(background: Tensor | None, gaussians: Gaussians) -> Tensor | None:
    """(1, 3 + F) for the rasterizer: the colour, and zeros behind the features."""
    if background is None:
        return None
    colour = background.to(gaussians.means)
    return torch.cat([colour, colour.new_zeros(gaussians.features.shape[1])])[None]
