"""Render Gaussians into one camera."""

from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import pad

from egosplat.arrays import Array, Floats
from egosplat.gaussians.model import Gaussians
from egosplat.geometry import Camera, invert
from egosplat.rasterize.contract import check_cameras
from egosplat.rasterize.view import View
from egosplat.rasterize.view import render as render_view

# By the recipe of a training.
BACKGROUNDS = {"own": "black", "paper": "white"}


@dataclass(frozen=True)
class RenderSettings:
    """Render settings, for training and afterwards.

    Attributes:
        near_plane: smallest rendered camera z [m].
        background: ``black`` or ``white``.
    """

    near_plane: float
    background: str
    backend: str

    @property
    def color_behind(self) -> Tensor | None:
        """(3,) float32 background color; None for black."""
        return torch.ones(3) if self.background == "white" else None


def view_of(
    gaussians: Gaussians,
    camera: Camera,
    camera_to_world: Array | Tensor,
    settings: RenderSettings,
) -> View:
    """Return what the functions of ``egosplat.rasterize.view`` take; the background of the settings is not
    used. ``camera_to_world`` is (4, 4) float64, OpenCV axes, meters; a tensor gets a gradient."""
    # Inverted in float64: far from the origin, float32 would lose millimeters.
    world_to_camera = _world_to_camera(camera_to_world).to(torch.float32)[None]
    intrinsics = torch.from_numpy(camera.matrix).to(torch.float32)[None]
    device = gaussians.means.device
    if device.type != "cpu":  # or else ``check`` reads their numbers
        check_cameras(world_to_camera, intrinsics)
    return View(
        gaussians.means,
        gaussians.quats,
        gaussians.scales,
        gaussians.opacities,
        gaussians.sh[:, 0],
        world_to_camera.to(device),
        intrinsics.to(device),
        camera.width,
        camera.height,
        near_plane=settings.near_plane,
        backend=settings.backend,
    )


def render(
    gaussians: Gaussians,
    camera: Camera,
    camera_to_world: Array | Tensor,
    settings: RenderSettings,
    *,
    sh_degree: int,
    background: Tensor | None,
    render_mode: str = "RGB",
) -> tuple[Tensor, Tensor, dict[str, Any]]:
    """Render colors, then features, then depth (in modes that have it), in one pass.

    ValueError: see ``egosplat.rasterize.api.rasterization``.

    Args:
        camera_to_world: (4, 4) float64, OpenCV axes, meters; a tensor gets a gradient.
        sh_degree: active SH degree, at most ``gaussians.sh_degree``.
        background: (3,) float32 color behind the scene, None for black, whatever the settings say. Features and depth have 0.
        render_mode: "RGB", "D", "ED", "RGB+D" or "RGB+ED"; "D" and "ED" render neither colors nor features.

    Returns:
        (H, W, X) float32 image, X = 3 + F, plus 1 for depth (1 alone in "D" and "ED"); (H, W, 1) accumulated opacity; and
        the rasterizer's meta for one camera: ``means2d`` (1, N, 2), ``radii`` (1, N, 2), ...
    """
    channels = gaussians.features.shape[1]
    # The color, then zeros for the features.
    backgrounds = None if background is None else pad(background.to(gaussians.means), (0, channels))[None]
    view = replace(
        view_of(gaussians, camera, camera_to_world, settings),
        colors=gaussians.sh,
        sh_degree=sh_degree,
        # Colors and features are composited in one pass, by the same weights (docs/method.md#renderer).
        features=gaussians.features if channels else None,
        backgrounds=backgrounds,
        render_mode=render_mode,
    )
    images, alphas, meta = render_view(view)
    # Not ``images[0]``, whose gradient is a copy among zeros.
    return images.squeeze(0), alphas.squeeze(0), meta


@dataclass(frozen=True, eq=False)
class TrainedScene:
    """N trained Gaussians, on any device, with the camera of the training views and the degree of harmonics in use."""

    gaussians: Gaussians
    settings: RenderSettings
    camera: Camera
    sh_degree: int

    @torch.no_grad()
    def picture(self, camera: Camera, camera_to_world: Array) -> Floats:
        """Render (H, W, 3) float32 sRGB in [0, 1], on the background of the training."""
        return self.rendered(camera, camera_to_world).clamp(0.0, 1.0).cpu().numpy()

    def rendered(self, camera: Camera, camera_to_world: Array | Tensor) -> Tensor:
        """The (H, W, 3) colors on the device, which may exceed 1."""
        how = {"sh_degree": self.sh_degree, "background": self.settings.color_behind}
        return render(self.gaussians, camera, camera_to_world, self.settings, **how)[0][..., :3]


def _world_to_camera(camera_to_world: Array | Tensor) -> Tensor:
    """Inverse of a (4, 4) rigid motion in float64; differentiable by a tensor."""
    if not isinstance(camera_to_world, Tensor):
        return torch.from_numpy(invert(camera_to_world))
    rotation = camera_to_world[:3, :3].T
    above = torch.cat([rotation, -(rotation @ camera_to_world[:3, 3:])], dim=1)
    return torch.cat([above, camera_to_world[3:]])
