"""Gaussians with all that a file of them can hold."""

from dataclasses import replace

import torch

from egosplat.gaussians.model import Gaussians


def colorful(gaussians: Gaussians, degree: int) -> Gaussians:
    """Long, turned Gaussians of different opacity, whose colors depend on the direction up to ``degree``."""
    random = torch.Generator().manual_seed(degree)

    def noise(*shape: int) -> torch.Tensor:
        return torch.randn(gaussians.count, *shape, generator=random)

    rest = 0.15 * noise((degree + 1) ** 2 - 1, 3)
    return replace(
        gaussians,
        quats=noise(4),
        log_scales=gaussians.log_scales + 0.3 * noise(3),
        logit_opacities=2 + noise(),
        sh=torch.cat([gaussians.sh[:, :1], rest], dim=1),
    )
