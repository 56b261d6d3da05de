"""Codes that were trained together with the Gaussians, the paper's way."""

from collections.abc import Sequence

import torch
from numpy.typing import NDArray

from egosplat.language.lifting import lift
from egosplat.language.method import Coded, Method
from egosplat.language.views import CodeViews


def copy_joint_codes(views: CodeViews, levels: Sequence[str], stored: NDArray) -> Coded:
    """Take codes unnormalized, as training rendered them (docs/method.md#code-norm); lifting gives the
    shares. ``stored`` is (N, L * C) float32, ``features`` of splats.zarr."""
    _, share = lift(views)
    code = torch.from_numpy(stored).to(share.device).unflatten(1, (len(levels), -1))
    return Coded(code, share, list(levels))


METHOD = Method(copy_joint_codes)
