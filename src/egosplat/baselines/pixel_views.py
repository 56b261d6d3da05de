"""Training on a random sample of a view's pixels: the expected loss is that of the whole image, at a small part of its cost."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, view_of
from egosplat.language.views import CodeViews
from egosplat.rasterize.view import pixel_renderer


@dataclass(frozen=True, eq=False)
class PixelViews:
    """Gaussians with frozen geometry in front of V views.

    Attributes:
        gaussians: they require no gradients.
        views: their poses, valid pixels and masking.
        settings: of rendering.
        count: pixels to draw.
    """

    gaussians: Gaussians
    views: CodeViews
    settings: RenderSettings
    count: int

    def frame(self, view: int) -> int:
        """Index of a view in frames.zarr."""
        return int(self.views.frame[view])

    def draw(self, view: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Draw pixels that show the scene, each independently of the others.

        Returns:
            (P, 2) int64 columns and rows on the CPU, and their (P,) float32 weights, see ``CodeViews.weight``.
        """
        weight, camera = self.views.weight(view), self.views.camera
        if weight is None:
            size = torch.tensor([camera.width, camera.height])
            return (torch.rand(self.count, 2, generator=generator) * size).long(), torch.ones(
                self.count, device=self.views.device
            )
        allowed = weight.cpu().flatten().nonzero()[:, 0]
        if not len(allowed):
            return torch.zeros(0, 2, dtype=torch.int64), weight.new_zeros(0)
        chosen = allowed[torch.randint(len(allowed), (self.count,), generator=generator)]
        pixels = torch.stack([chosen % camera.width, chosen // camera.width], dim=1)
        return pixels, weight.flatten()[chosen.to(weight.device)]

    def renderer(self, view: int, pixels: Tensor) -> Callable[[Tensor], Tensor]:
        """See ``egosplat.rasterize.view.pixel_renderer``."""
        pose = self.views.camera_to_world[view]
        return pixel_renderer(view_of(self.gaussians, self.views.camera, pose, self.settings), pixels)
