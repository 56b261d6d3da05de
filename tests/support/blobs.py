"""Round Gaussians."""

import math

import torch

from egosplat.gaussians.model import Gaussians


def crowd() -> Gaussians:
    """300 Gaussians before and behind the camera and beside the image, some of which end pixels."""
    generator = torch.Generator().manual_seed(3)
    means = torch.randn(300, 3, generator=generator) + torch.tensor([0.0, 0.0, 2.5])
    opacities = 0.05 + 0.945 * torch.rand(300, generator=generator)
    return blobs(means.tolist(), opacities.tolist(), size=0.1)


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
