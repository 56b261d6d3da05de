"""Round Gaussians."""

import math

import torch

from egosplat.gaussians.model import Gaussians


def blobs(means: list[list[float]], opacities: list[float], size: float = 0.3) -> Gaussians:
    """Gaussians at ``means``, with standard deviation ``size`` [m]."""
    count = len(means)
    return Gaussians(
        means=torch.tensor(means, dtype=torch.float32).reshape(-1, 3),
        quats=torch.tensor([[1.0, 0, 0, 0]]).repeat(count, 1),
        log_scales=torch.full((count, 3), math.log(size)),
        logit_opacities=torch.logit(torch.tensor(opacities)),
        sh=torch.zeros(count, 1, 3),
        features=torch.zeros(count, 0),
    )
