"""The interface of densification strategies, and the change of rows that they share."""

from abc import ABC, abstractmethod
from typing import Any

import torch
from torch import Tensor

from egosplat.errors import UserError
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.optimizer import Adam


class Strategy(ABC):
    """Decides after each iteration which Gaussians exist: ``DensityControl`` or ``Mcmc``.

    Attributes:
        opacity_reg, scale_reg: loss weights of the mean opacity and the mean scale; may be 0.
    """

    opacity_reg = 0.0
    scale_reg = 0.0

    def observe(  # noqa: B027
        self, means2d_grad: Tensor | None, radii: Tensor, width: int, height: int
    ) -> None:
        """Collect statistics of one iteration; called after ``backward``, before ``step``.

        Args:
            means2d_grad: (C, N, 2) float32, d loss / d means2d in pixels, for a loss that is the mean over the C
                cameras; None if the loss does not depend on any Gaussian.
            radii: (C, N, 2) int32 screen radii of the rasterizer [px]; 0 if culled.
            width, height: image size [px].
        """

    @abstractmethod
    def step(
        self, iteration: int, gaussians: Gaussians, optimizer: Adam, generator: torch.Generator
    ) -> Gaussians:
        """Change Gaussians and optimizer together; called after the optimizer's step.

        Args:
            iteration: the iteration just done, from 1.
            gaussians: leaves, attached to ``optimizer``.
            optimizer: optimizer of these Gaussians.

        Returns:
            Gaussians attached to ``optimizer``; the same object if no row was added or removed.

        Raises:
            UserError: no Gaussian would be left.
        """

    def state_dict(self) -> dict[str, Any]:
        """Return copies of the statistics by name, for ``load_state_dict``."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:  # noqa: B027
        """Restore a state from ``state_dict``; its tensors may be on any device."""


def replace_rows(
    gaussians: Gaussians, optimizer: Adam, keep: Tensor, new: Gaussians | None = None
) -> Gaussians:
    """Keep the rows ``keep`` and append ``new`` with zero moments, in Gaussians and optimizer.

    Args:
        keep: (N,) bool.
        new: Gaussians to append.

    Returns:
        Leaves that require gradients, attached to ``optimizer``; ``gaussians`` itself if nothing changes.

    Raises:
        UserError: no Gaussian would be left.
    """
    added = new.count if new is not None else 0
    if not added and bool(keep.all()) and gaussians.count:
        return gaussians
    kept = gaussians.detach().select(keep)
    result = Gaussians.concatenate([kept, new.detach()]) if new is not None else kept
    if not result.count:
        raise UserError(
            f"splats: none of {gaussians.count} Gaussians is left to train: all were too transparent, too large "
            "or not finite; check the poses and the masks"
        )
    optimizer.select(keep)
    optimizer.append(added)
    result.requires_grad_()
    optimizer.attach(result)
    return result


def random_normal(like: Tensor, generator: torch.Generator) -> Tensor:
    """Sample standard normal numbers with the shape and device of ``like``; the generator is on the CPU.

    A GPU draws the numbers itself, from a seed that the generator draws: copying them would take longer than an
    iteration.
    """
    if like.device.type == "cuda":
        seed = int(torch.randint(2**62, (), generator=generator))
        generator = torch.Generator(like.device).manual_seed(seed)
    return torch.randn(like.shape, generator=generator, device=generator.device).to(like)
