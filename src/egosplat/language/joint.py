"""The paper's joint training: colors and codes of one model, rendered in one pass; and the codes that it leaves."""

from collections.abc import Sequence

import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.gaussians.loss import L1Ssim, Objective
from egosplat.gaussians.training_views import Views
from egosplat.language.lifting import lift
from egosplat.language.method import Coded, Method
from egosplat.language.targets import CodeTargets, Targets
from egosplat.language.views import CodeViews


def code_l1(rendered: Tensor, targets: Targets, weight: Tensor | None) -> Tensor:
    """L_F-w with d_F = L1: ``mean over all values of weight |F - F̂|``, 0 where there is no target.

    ``rendered`` is (L, C, H, W) float32, ``weight`` (H, W) in [0, 1], or None for ones.
    """
    counted = targets.known.to(rendered.dtype)
    if weight is not None:
        counted = counted * weight
    # The mean is over all values, also those of weight 0 (docs/method.md#loss-denominator).
    return ((rendered - targets.codes).abs() * counted[:, None]).mean()


class JointLanguage(Objective):
    """L_RGB-w + feature_weight L_F-w; the Gaussians' features are the concatenated codes of all levels."""

    advice = "lower splats.feature_weight, or raise run.near_plane"

    def __init__(self, ssim_lambda: float, feature_weight: float, targets: CodeTargets) -> None:
        """Take the weight of the code loss; ``ssim_lambda`` as in ``L1Ssim``."""
        self._colors = L1Ssim(ssim_lambda)
        self._feature_weight, self._targets = feature_weight, targets

    def loss(self, image: Tensor, views: Views, index: int) -> Tensor:
        """See ``egosplat.gaussians.loss.Objective``."""
        targets = self._targets.of(int(views.frame[index]))
        # Channels 0 to 2 are colors; the codes of all levels follow.
        codes = image[..., 3:].permute(2, 0, 1).unflatten(0, targets.codes.shape[:2])
        colors = self._colors.loss(image, views, index)
        return colors + self._feature_weight * code_l1(codes, targets, views.weight(index))


def copy_joint_codes(views: CodeViews, levels: Sequence[str], stored: NDArray) -> Coded:
    """Take codes unnormalized, as training rendered them (docs/method.md#code-norm); lifting gives the shares.

    ``stored`` is (N, L * C) float32, ``features`` of splats.zarr.
    """
    share = lift(views).share
    code = torch.from_numpy(stored).to(share.device).unflatten(1, (len(levels), -1))
    return Coded(code, share, list(levels))


METHOD = Method(copy_joint_codes)
