"""Codes that were trained together with the Gaussians, the paper's way."""

import torch
from numpy.typing import NDArray

from egosplat.language.lifting import shares
from egosplat.language.method import Coded, Method
from egosplat.language.targets import CodeTargets
from egosplat.language.views import CodeViews


def copy_joint_codes(views: CodeViews, targets: CodeTargets, stored: NDArray) -> Coded:
    """Take codes unnormalized, as training rendered them (docs/method.md#code-norm); lifting gives the
    shares. ``stored`` is (N, L * C) float32, ``features`` of splats.zarr."""
    share = shares(views, targets.known)
    code = torch.from_numpy(stored).to(share.device).unflatten(1, (len(targets.levels), -1))
    return Coded(code, share, targets.levels)


METHOD = Method(copy_joint_codes)
