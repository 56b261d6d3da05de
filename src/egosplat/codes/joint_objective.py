"""The paper's joint loss: colours and codes of one model, rendered in one pass."""

from typing import Any

import torch
from torch import Tensor

from egosplat.codes.targets import CodeTargets, Targets
from egosplat.gaussians.objective import L1Ssim
from egosplat.gaussians.training_views import Views


def code_l1(rendered: Tensor, targets: Targets, weight: Tensor | None) -> Tensor:
    """L_F-w with d_F = L1: ``mean over all values of weight |F - F̂|``, 0 where there is no target.

    Args:
        rendered: (L, C, H, W) float32.
        targets: of the same picture.
        weight: (H, W) in [0, 1], or None for ones.

    Returns:
        () tensor; pixels that do not count are in the denominator all the same (docs/method.md#loss-denominator).
    """
    counted = targets.known.to(rendered.dtype)
    if weight is not None:
        counted = counted * weight
    return ((rendered - targets.codes).abs() * counted[:, None]).mean()


class JointLanguage:
    """L_RGB-w + feature_weight L_F-w; the features of the Gaussians are the codes of all levels, side by side.

    Attributes:
        advice: what the user may change where training diverges.
    """

    advice = "lower splats.position_lr or splats.feature_weight, or raise splats.near_plane"

    def __init__(self, ssim_lambda: float, feature_weight: float, targets: CodeTargets) -> None:
        """``feature_weight``: weight of the codes' loss; ``ssim_lambda``: see ``L1Ssim``."""
        self._colours = L1Ssim(ssim_lambda)
        self._lambda1, self._targets = feature_weight, targets

    def loss(self, image: Tensor, views: Views, index: int) -> Tensor:
        """See ``egosplat.gaussians.objective.Objective``."""
        targets = self._targets.of(int(views.frame[index]))
        codes = image[..., 3:].permute(2, 0, 1).unflatten(0, targets.codes.shape[:2])
        colours = self._colours.loss(image, views, index)
        return colours + self._lambda1 * code_l1(codes, targets, views.weight(index))

    def step(self) -> None:
        """Nothing is trained beside the Gaussians."""

    def state_dict(self) -> dict[str, Any]:
        """Nothing."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Nothing to do."""


def with_codes(count: int, targets: CodeTargets, device: torch.device) -> Tensor:
    """(N, L * C) zeros: where the codes of ``count`` Gaussians start."""
    return torch.zeros(count, len(targets.levels) * targets.channels, device=device)
