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
from egosplat_rivals.surface import surface_depths

# Every how manieth training view is used; how close to the border of a view a Gaussian is not seen, as a share of the width;
# the largest distance between a Gaussian and the surface at its pixel, as a share of the surface's depth.
EVERY, BORDER, TOLERANCE = 5, 10 / 648, 0.05


def project_views(views: CodeViews, targets: CodeTargets, *_: object) -> Coded:
    """Method ``project_views``: the mean over views of the ``pixel_features`` that show a Gaussian's center, not normalized."""
    sums = torch.zeros(views.gaussians.count, targets.channels, device=views.device)
    seen = torch.zeros(views.gaussians.count, device=views.device)
    for index in track(range(0, len(views), EVERY), "projecting", unit="view"):
        centers = views.centers(index)
        surface = surface_depths(views, index, torch.from_numpy(centers.pixel)).numpy()
        inside = is_seen(centers, surface, views.camera.width, views.camera.height)
        shown = inside & (views.weight_at(index, centers.pixel) > 0)
        rows = torch.from_numpy(centers.gaussian[shown]).to(views.device)
        found = targets.at(int(views.frame[index]), centers.pixel[shown])
        sums[rows] += pixel_features(found.codes)
        seen[rows] += 1
    code = sums / seen.clamp(min=1)[:, None]
    return Coded(code[:, None], (code != 0).any(1).float()[:, None], ["all"])


def is_seen(centers: Centers, surface: NDArray[np.float64], width: int, height: int) -> NDArray[np.bool_]:
    """(M,) bool: Gaussians away from the border whose depth is that of the surface, NaN for none, up to ``TOLERANCE``."""
    border, size = BORDER * width, np.array([width, height])
    inside = (np.minimum(centers.pixel, size - 1 - centers.pixel) >= border).all(axis=1)
    return inside & (abs(surface - centers.depth) <= TOLERANCE * surface)


def pixel_features(codes: Tensor) -> Tensor:
    """(P, C) unit sums over the levels of the (L, C, P) features of masks; 0 without a mask."""
    return normalize(codes.sum(dim=0).T, dim=-1)


METHOD = Method(project_views, masks="{} + OpenCLIP features in place of OpenSeg")
