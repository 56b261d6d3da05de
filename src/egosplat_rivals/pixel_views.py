"""Training on a random sample of a view's pixels: the expected loss is that of the whole image, at a small part of its cost."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from egosplat.language.views import CodeViews
from egosplat.rasterize.view import pixel_renderer


@dataclass(frozen=True, eq=False)
class PixelViews:
    """V views, in each of which ``count`` pixels are drawn."""

    views: CodeViews
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
            pixels = (torch.rand(self.count, 2, generator=generator) * size).long()
            return pixels, torch.ones(self.count, device=self.views.device)
        allowed = weight.cpu().flatten().nonzero()[:, 0]
        if not len(allowed):
            return torch.zeros(0, 2, dtype=torch.int64), weight.new_zeros(0)
        chosen = allowed[torch.randint(len(allowed), (self.count,), generator=generator)]
        pixels = torch.stack([chosen % camera.width, chosen // camera.width], dim=1)
        return pixels, weight.flatten()[chosen.to(weight.device)]

    def renderer(self, view: int, pixels: Tensor) -> Callable[[Tensor], Tensor]:
        """See ``egosplat.rasterize.view.pixel_renderer``."""
        return pixel_renderer(self.views.view(view), pixels)
