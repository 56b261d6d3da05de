"""The training objective: the loss of one image and the parameters trained along with the Gaussians."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from egosplat.gaussians.loss import l1_ssim
from egosplat.gaussians.training_views import Views


class Objective(ABC):
    """Compares a render with its photograph. By default it has no parameters of its own.

    Attributes:
        advice: keys that the user may change if training diverges.
    """

    advice = "raise run.near_plane"

    @abstractmethod
    def loss(self, image: Tensor, views: Views, index: int) -> Tensor:
        """Return the loss of one iteration.

        Args:
            image: (H, W, 3 + F) float32 render, colors and features, on the device of the views.

        Returns:
            () tensor, differentiable by ``image``.
        """

    def step(self) -> None:  # noqa: B027
        """Update the objective's own parameters, if any; called after each backward pass."""

    def state_dict(self) -> dict[str, Any]:
        """Return the state for ``load_state_dict``: tensors, numbers and strings, possibly nested."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:  # noqa: B027
        """Restore a state from ``state_dict``; its tensors are on the device of the Gaussians."""


@dataclass(frozen=True)
class L1Ssim(Objective):
    """The loss of 3DGS, weighted by 1 - M inside the lens circle. ``ssim_lambda`` is the share of 1 - SSIM, the rest L1."""

    ssim_lambda: float

    def loss(self, image: Tensor, views: Views, index: int) -> Tensor:
        """Return ``egosplat.gaussians.loss.l1_ssim`` of the colors."""
        return l1_ssim(image[..., :3], views.picture(index), views.weight(index), self.ssim_lambda)
