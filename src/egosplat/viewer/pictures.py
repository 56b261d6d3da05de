"""Pictures of a scene from any viewpoint, with its own colors, relevancy as heat, or instances as colors."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.gaussians.initialization import SH_C0
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import render
from egosplat.geometry import Array, Camera
from egosplat.query.scene import TrainedScene

Colors = NDArray[np.float32]

# Depth of pixels that show nothing, in the unit of the scene: farther than the browser can tell.
NOTHING = 1e3

# Alpha below which a pixel has no depth.
LEAST_ALPHA = 0.5

# Brightness of Gaussians that do not fit a query, relative to their own.
DIM = 0.6

# Quantile of the fitting Gaussians' relevancy from which the heat is red.
BEST = 0.9

# Share of the heat's or an instance's color in a Gaussian; the rest is its own brightness.
STRENGTH = 0.75


@dataclass(frozen=True, eq=False)
class Painted:
    """Gaussians with the colors to draw them in.

    Attributes:
        sh_degree: active degree of their spherical harmonics.
    """

    gaussians: Gaussians
    sh_degree: int

    @staticmethod
    def of(scene: TrainedScene) -> "Painted":
        """The scene in its own colors."""
        return Painted(scene.gaussians, scene.sh_degree)

    def colored(self, colors: Colors) -> "Painted":
        """The same Gaussians in (N, 3) colors in 0..1 that no longer depend on the direction of view."""
        sh = (torch.from_numpy(colors).to(self.gaussians.means) - 0.5) / SH_C0
        return Painted(replace(self.gaussians, sh=sh[:, None]), 0)

    def only(self, chosen: NDArray[np.bool_]) -> "Painted":
        """Only the (N,) chosen Gaussians."""
        index = torch.from_numpy(chosen).to(self.gaussians.means.device)
        return Painted(self.gaussians.select(index), self.sh_degree)

    @property
    def colors(self) -> Colors:
        """(N, 3) colors in 0..1, without the part that depends on the direction of view."""
        return np.clip(self.gaussians.sh[:, 0].cpu().numpy() * np.float32(SH_C0) + 0.5, 0.0, 1.0)


def heat(own: Colors, fit: NDArray[np.float32], threshold: float) -> Colors:
    """Colors that show how well each Gaussian fits a query.

    Args:
        own: (N, 3) colors of the Gaussians in 0..1.
        fit: (N,) relevancy in 0..1.
        threshold: Gaussians below it are dim and gray; above it, colors go from blue at the threshold to red for
            the best tenth of those above it.

    Returns:
        (N, 3) float32 in 0..1.
    """
    gray = own.mean(axis=1, keepdims=True)
    fitting = fit[fit >= threshold]
    # A few Gaussians fit far better than all others; scaled by them, an answer would be blue throughout.
    best = float(np.quantile(fitting, BEST)) if len(fitting) else 1.0
    scaled = np.clip((fit - threshold) / max(1e-6, best - threshold), 0.0, 1.0)
    # The darkest blue and red of the scale are hard to tell from black.
    codes = (40 + 190 * scaled).round().astype(np.uint8)
    turbo = cv2.applyColorMap(codes[:, None], cv2.COLORMAP_TURBO)[:, 0, ::-1].astype(np.float32) / 255
    hot = STRENGTH * turbo + (1 - STRENGTH) * gray
    return np.where((fit >= threshold)[:, None], hot, DIM * gray).astype(np.float32)


def instances(own: Colors, owner: NDArray[np.int64], palette: NDArray[np.float64]) -> Colors:
    """Colors by instance.

    Args:
        own: (N, 3) colors of the Gaussians in 0..1.
        owner: (N,) instance of each Gaussian, -1 for none.
        palette: (I, 3) colors of the instances in 0..1.

    Returns:
        (N, 3) float32 in 0..1; Gaussians without an instance are dim and gray.
    """
    gray = own.mean(axis=1, keepdims=True)
    tinted = STRENGTH * palette[owner] + (1 - STRENGTH) * gray
    return np.where((owner >= 0)[:, None], tinted, DIM * gray).astype(np.float32)


def browser_camera(fov: float, width: int, height: int) -> Camera:
    """The camera of a window.

    Args:
        fov: vertical field of view [rad].
        width, height: size of the picture [px].
    """
    focal = height / 2 / np.tan(fov / 2)
    return Camera(width, height, focal, focal, width / 2, height / 2)


@torch.inference_mode()
def draw(
    scene: TrainedScene, painted: Painted, camera: Camera, camera_to_world: Array
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Draw Gaussians of a scene.

    Args:
        scene: its render settings are used.
        painted: what to draw.

    Returns:
        (H, W, 3) uint8 sRGB, and (H, W) float32 camera z, ``NOTHING`` where the view is empty.
    """
    height, width = camera.height, camera.width
    if not painted.gaussians.count:
        return np.zeros((height, width, 3), np.uint8), np.full((height, width), NOTHING, np.float32)
    image, alpha, _ = render(
        painted.gaussians,
        camera,
        camera_to_world,
        scene.settings,
        sh_degree=painted.sh_degree,
        background=scene.settings.still_background,
        render_mode="RGB+ED",
    )
    rgb = (image[..., :3].clamp(0.0, 1.0) * 255).round().to(torch.uint8).cpu().numpy()
    depth = torch.where(alpha[..., 0] > LEAST_ALPHA, image[..., 3], NOTHING).cpu().numpy()
    return rgb, depth
