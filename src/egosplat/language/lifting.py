"""The share of what each Gaussian shows that has a code."""

from collections.abc import Callable

import torch
from torch import Tensor

from egosplat.language.views import CodeViews
from egosplat.progress import track
from egosplat.rasterize.view import sum_over_pixels

# Smallest sum of compositing weights over all views [px] at which a Gaussian counts as seen.
LEAST_WEIGHT = 1e-3


def shares(views: CodeViews, known: Callable[[int], Tensor] | None = None) -> Tensor:
    """(N, L) shares in [0, 1] of what N Gaussians show, over all views, at least one, that has a target, as in language.zarr; ``known``
    gives the (L, H, W) bool pixels of a frame with a target, None all at one level. A Gaussian that no view shows has share 0."""
    everywhere = torch.ones(1, views.camera.height, views.camera.width, dtype=torch.bool, device=views.device)
    total = torch.zeros((), device=views.device)
    for index in track(range(len(views)), "lifting", unit="view"):
        pixels, weight = known(int(views.frame[index])) if known else everywhere, views.weight(index)
        shown = everywhere.float() if weight is None else weight[None]
        total = total + sum_over_pixels(
            views.view(index), torch.cat([pixels * shown, shown]).permute(1, 2, 0)
        )
    return labeled_share(total[:, :-1], total[:, -1:])


def labeled_share(known: Tensor, seen: Tensor) -> Tensor:
    """(N, L) share in [0, 1] of what Gaussians show that has a code; 0 where the weight is negligible. ``known`` (N, L) and ``seen`` (N,
    1) are compositing weights in the pixels with a code, and in all pixels [px]."""
    # Above 1 by rounding only.
    share = (known / seen.clamp(min=LEAST_WEIGHT)).clamp(max=1.0)
    return torch.where(known > LEAST_WEIGHT, share, 0.0)
