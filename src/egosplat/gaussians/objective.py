"""The training objective: the loss of one image and the parameters trained along with the Gaussians."""

from dataclasses import dataclass
from typing import Any, Protocol

from torch import Tensor

from egosplat.gaussians.loss import l1_ssim
from egosplat.gaussians.training_views import Views


class Objective(Protocol):
    """Compares a render with its photograph.

    Attributes:
        advice: keys that the user may change if training diverges.
    """

    @property
    def advice(self) -> str: ...

    def loss(self, image: Tensor, views: Views, index: int) -> Tensor:
        """Return the loss of one iteration.

        Args:
            image: (H, W, 3 + F) float32 render, colors and features, on the device of the views.

        Returns:
            () tensor, differentiable by ``image``.
        """
        ...

    def step(self) -> None:
        """Update the objective's own parameters, if any; called after each backward pass."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """Return the state for ``load_state_dict``: tensors, numbers and strings, possibly nested."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state from ``state_dict``; its tensors are on the device of the Gaussians."""
        ...


@dataclass(frozen=True)
class L1Ssim:
    """The loss of 3DGS, weighted by 1 - M inside the lens circle; it has no parameters of its own.

    Attributes:
        ssim_lambda: share of 1 - SSIM in the loss; the rest is L1.
    """

    ssim_lambda: float
    advice: str = "lower splats.position_lr, or raise splats.near_plane"

    def loss(self, image: Tensor, views: Views, index: int) -> Tensor:
        """Return ``egosplat.gaussians.loss.l1_ssim`` of the colors."""
        return l1_ssim(image[..., :3], views.picture(index), views.weight(index), self.ssim_lambda)

    def step(self) -> None:
        """Do nothing."""

    def state_dict(self) -> dict[str, Any]:
        """Return an empty state."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Do nothing."""
