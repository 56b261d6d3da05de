"""Pixels of a render that rounding may change."""

import torch
from torch import Tensor

from egosplat.rasterize.contract import ALPHA_THRESHOLD, MAX_ALPHA, MIN_TRANSMITTANCE


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
