"""What training makes small for each picture, and what is trained beside the Gaussians for it."""

from dataclasses import dataclass
from typing import Any, Protocol

from torch import Tensor

from egosplat.gaussians.loss import l1_ssim
from egosplat.gaussians.training_views import Views


class Objective(Protocol):
    """How a render is compared with its photograph.

    Attributes:
        advice: what the user may change where training diverges.
    """

    @property
    def advice(self) -> str: ...

    def loss(self, image: Tensor, views: Views, index: int) -> Tensor:
        """The loss of one iteration.

        Args:
            image: (H, W, 3 + F) float32 render, colours and features, on the device of the views.
            views: the photographs.
            index: which of them is rendered.

        Returns:
            () tensor, differentiable by ``image``.
        """
        ...

    def step(self) -> None:
        """Called after the gradients of each loss, for what is trained beside the Gaussians."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """All that ``load_state_dict`` needs to go on: tensors, numbers, texts, and nests of them."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state_dict``; its tensors are on the device of the Gaussians."""
        ...


@dataclass(frozen=True)
class L1Ssim:
    """The loss of 3DGS, weighted by 1 - M within the lens circle; nothing is trained beside the Gaussians.

    Attributes:
        ssim_lambda: share of 1 - SSIM in the loss; the rest is L1.
    """

    ssim_lambda: float
    advice: str = "lower splats.position_lr, or raise splats.near_plane"

    def loss(self, image: Tensor, views: Views, index: int) -> Tensor:
        """``egosplat.gaussians.loss.l1_ssim`` of the colours."""
        return l1_ssim(image[..., :3], views.picture(index), views.weight(index), self.ssim_lambda)

    def step(self) -> None:
        """Nothing to do."""

    def state_dict(self) -> dict[str, Any]:
        """Nothing."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Nothing to do."""
