"""What all ways of changing the number of Gaussians share: their interface, and the surgery itself."""

from typing import Any, Protocol

import torch
from torch import Tensor

from egosplat.errors import UserError
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.optimizer import Adam


class Population(Protocol):
    """Decides after each iteration which Gaussians there are: ``DensityControl`` or ``Mcmc``.

    Attributes:
        opacity_reg, scale_reg: weights in the loss of the mean opacity and of the mean scale; may be 0.
    """

    opacity_reg: float
    scale_reg: float

    def observe(self, means2d_grad: Tensor | None, radii: Tensor, width: int, height: int) -> None:
        """Take note of one iteration's gradients; after ``backward``, before ``step``.

        Args:
            means2d_grad: (C, N, 2) float32, d loss / d means2d in pixels, of a loss that is the mean over the
                C cameras; None where the loss depends on no Gaussian.
            radii: (C, N, 2) int32 as the rasterizer gives it [px]; 0 where culled.
            width, height: image size [px].
        """

    def step(
        self, iteration: int, gaussians: Gaussians, optimizer: Adam, generator: torch.Generator
    ) -> Gaussians:
        """Change the Gaussians and the optimizer alike; after the optimizer's own step.

        Args:
            iteration: the one that has just been done, from 1.
            gaussians: leaves, attached to ``optimizer``.
            optimizer: of these Gaussians.
            generator: of everything random; on any device.

        Returns:
            The Gaussians to go on with, attached to ``optimizer``: the same object where none came or went.

        Raises:
            UserError: no Gaussian would be left.
        """

    def state_dict(self) -> dict[str, Any]:
        """All that ``load_state_dict`` needs to go on: copies of tensors by name."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state_dict``, whose tensors may be on any device."""


def replace_rows(
    gaussians: Gaussians, optimizer: Adam, keep: Tensor, new: Gaussians | None = None
) -> Gaussians:
    """Drop the rows outside of ``keep``, then add ``new`` with zero moments; in Gaussians and optimizer.

    Args:
        keep: (N,) bool.
        new: to be added at the end.

    Returns:
        Leaves that require gradients, attached to ``optimizer``; ``gaussians`` itself where nothing changes.

    Raises:
        UserError: nothing would be left.
    """
    added = new.count if new is not None else 0
    if not added and bool(keep.all()) and gaussians.count:
        return gaussians
    kept = gaussians.detach().select(keep)
    result = Gaussians.concatenate([kept, new.detach()]) if new is not None else kept
    if not result.count:
        raise UserError(
            f"splats: none of {gaussians.count} Gaussians is left to train: all were too transparent, too large "
            "or not finite; check the poses and what the masks leave visible"
        )
    optimizer.select(keep)
    optimizer.append(added)
    result.requires_grad_()
    optimizer.attach(result)
    return result


def random_normal(like: Tensor, generator: torch.Generator) -> Tensor:
    """Standard normal numbers with the shape and device of ``like``, whatever device the generator is on."""
    return torch.randn(like.shape, generator=generator, device=generator.device).to(like)
