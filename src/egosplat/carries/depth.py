"""The depth of the surfaces that the Gaussians of a scene show."""

import torch

from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, render
from egosplat.geometry import Array, Camera
from egosplat.images import shrunk_size

# Longer side of the renders that give the depth [px]: a place needs no finer surface.
_SIDE = 256


class SceneDepth:
    """The depth of each frame, as the scene's Gaussians show it."""

    def __init__(
        self, gaussians: Gaussians, settings: RenderSettings, camera: Camera, camera_to_world: Array
    ) -> None:
        """Take the scene's Gaussians on the device of the renderer, the camera of the frames, and their (F, 4, 4) poses."""
        self._gaussians, self._settings = gaussians, settings
        self._camera = camera.scaled_to(*shrunk_size(camera.width, camera.height, _SIDE))
        self._poses = camera_to_world

    @torch.inference_mode()
    def of(self, frame: int) -> Array:
        """(h, w) float64 expected camera z [m]; 0 where the frame is empty."""
        view = self._gaussians, self._camera, self._poses[frame], self._settings
        depth, _, _ = render(*view, sh_degree=0, background=None, render_mode="ED")
        return depth[..., 0].double().cpu().numpy()
