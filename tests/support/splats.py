"""Gaussians for tests of what renders and writes them, and the pixels of a render that rounding may change."""

import math
from dataclasses import replace

import torch
from torch import Tensor

from egosplat.gaussians.model import Gaussians
from egosplat.rasterize.contract import ALPHA_THRESHOLD, MAX_ALPHA, MIN_TRANSMITTANCE


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


def undecided(meta: dict) -> Tensor:
    """(C, H, W) bool of a reference's meta: where a Gaussian is so close to a threshold that rounding decides."""
    masks = []
    for camera, depths in enumerate(meta["depths"]):
        order = depths.argsort(stable=True)
        order = order[(meta["radii"][camera, order] > 0).all(dim=-1)]
        (x, y), (xx, xy, yy) = meta["means2d"][camera, order].T, meta["conics"][camera, order].T
        dx = torch.arange(meta["width"])[None, :, None] + 0.5 - x
        dy = torch.arange(meta["height"])[:, None, None] + 0.5 - y
        raw = meta["opacities"][camera, order] * torch.exp(
            -0.5 * (xx * dx * dx + yy * dy * dy) - xy * dx * dy
        )
        left = (1 - torch.where(raw >= ALPHA_THRESHOLD, raw.clamp(max=MAX_ALPHA), 0.0)).cumprod(dim=-1)
        shares = (raw / ALPHA_THRESHOLD, raw / MAX_ALPHA, left / MIN_TRANSMITTANCE)
        masks.append(torch.stack([(share - 1).abs() < 1e-4 for share in shares]).any(dim=0).any(dim=-1))
    return torch.stack(masks)
