"""Semantic Gaussians (Guo et al., 2024): project each Gaussian into views, and average the features that it meets."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import normalize

from egosplat.language.centers import Centers
from egosplat.language.method import Coded, Method
from egosplat.language.targets import CodeTargets
from egosplat.language.views import CodeViews
from egosplat.progress import track

# Every how manieth training view is used.
EVERY = 5

# A Gaussian this close to the border of a view, as a share of its width, is not seen there.
BORDER = 10 / 648

# Largest distance between a Gaussian and the surface at its pixel, as a share of the surface's depth.
TOLERANCE = 0.05


def project_views(views: CodeViews, targets: CodeTargets, *_: object) -> Coded:
    """Method ``project_views``: the mean feature of the pixels that show a Gaussian's center, over views, at one level.

    A pixel's feature is the sum of those of all masks that cover it, as a unit vector, or 0 without a mask. The mean is not
    normalized, and opacities play no part.
    """
    sums = torch.zeros(views.gaussians.count, targets.channels, device=views.device)
    seen = torch.zeros(views.gaussians.count, device=views.device)
    for index in track(range(0, len(views), EVERY), "projecting", unit="view"):
        centers = views.centers(index, median=True)
        inside = is_seen(centers, views.camera.width, views.camera.height)
        shown = inside & (views.weight_at(index, centers.pixel) > 0)
        rows = torch.from_numpy(centers.gaussian[shown]).to(views.device)
        found = targets.at(int(views.frame[index]), centers.pixel[shown])
        sums[rows] += pixel_features(found.codes)
        seen[rows] += 1
    code = sums / seen.clamp(min=1)[:, None]
    return Coded(code[:, None], (code != 0).any(1).float()[:, None], ["all"])


def is_seen(centers: Centers, width: int, height: int) -> NDArray[np.bool_]:
    """(M,) bool: Gaussians away from the border whose depth is the median depth, up to ``TOLERANCE``.

    A Gaussian at a pixel without a median depth is not seen.
    """
    assert centers.median_depth is not None
    border, size = BORDER * width, np.array([width, height])
    inside = (np.minimum(centers.pixel, size - 1 - centers.pixel) >= border).all(axis=1)
    return inside & (abs(centers.median_depth - centers.depth) <= TOLERANCE * centers.median_depth)


def pixel_features(codes: Tensor) -> Tensor:
    """(P, C) unit sums over the levels of (L, C, P) features; 0 where all are 0."""
    return normalize(codes.sum(dim=0).T, dim=-1)


METHOD = Method(project_views, masks="{} + OpenCLIP features in place of OpenSeg")
