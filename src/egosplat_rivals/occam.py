"""Occam's LGS (Cheng et al., 2024): average the features at the pixels that hold a Gaussian's center, by its weight there."""

import numpy as np
import torch

from egosplat.language.method import Coded, Method
from egosplat.language.targets import CodeTargets
from egosplat.language.views import CodeViews
from egosplat.progress import track


def average_at_centers(views: CodeViews, targets: CodeTargets, *_: object) -> Coded:
    """Method ``center``: ``f_g = sum_v w F(u_g) / sum_v w`` with the feature F and the weight w at the center's pixel u_g.

    Views whose pixel has no mask at a level do not count there. A Gaussian that no view shows has no code.
    """
    shape = views.gaussians.count, len(targets.levels)
    sums = torch.zeros(*shape, targets.channels, device=views.device)
    total = torch.zeros(shape, device=views.device)
    for index in track(range(len(views)), "looking at centers", unit="view"):
        centers = views.centers(index)
        shown = np.flatnonzero((centers.weight > 0) & (views.weight_at(index, centers.pixel) > 0))
        rows = torch.from_numpy(centers.gaussian[shown]).to(views.device)
        found = targets.at(int(views.frame[index]), centers.pixel[shown])
        weight = found.known * torch.from_numpy(centers.weight[shown]).to(views.device)
        # Each Gaussian has one pixel in a view.
        sums[rows] += (found.codes * weight[:, None]).permute(2, 0, 1)
        total[rows] += weight.T
    known = total > 0
    # The smallest weight of a listed Gaussian is 1e-4 / 255.
    code = sums / torch.where(known, total, 1.0)[..., None]
    return Coded(code, known.float(), targets.levels)


METHOD = Method(average_at_centers, masks="{} in place of SAM")
