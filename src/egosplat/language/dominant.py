"""Lift instances instead of codes: each Gaussian takes the code of the instance that it shows most (docs/method.md#lifting)."""

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse

from egosplat.artifacts.language import GAUSSIANS
from egosplat.codes.centers import look_at_centers
from egosplat.codes.targets import CodeTargets
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings
from egosplat.language.lifting import labeled_share
from egosplat.language.method import Method
from egosplat.language.result import Coded
from egosplat.language.views import CodeViews
from egosplat.progress import track


def lift_instances(
    gaussians: Gaussians, views: CodeViews, settings: RenderSettings, targets: CodeTargets, *_: object
) -> Coded:
    """Method ``lift_instances``: the code of the instance with the largest share of the Gaussian's weight, at each level.

    A weight is alpha times transmittance times 1 - M at the pixel that holds the Gaussian's center, summed over all views. A mean
    of the codes of two instances would decode to a feature of neither, and pixels around the center may show the neighbors.
    """
    votes, seen = instance_votes(gaussians, views, settings, targets)
    codes, shape = targets.instance_codes(), (gaussians.count, len(targets.levels))
    code, known = np.zeros((*shape, targets.channels), np.float32), np.zeros(shape, np.float32)
    for level in range(shape[1]):
        owners = np.flatnonzero(targets.level == level)
        own = votes[:, owners]
        known[:, level] = own.sum(axis=1)
        code[:, level] = codes[owners[own.argmax(axis=1)]]
    share = labeled_share(torch.from_numpy(known), torch.from_numpy(seen)[:, None])
    code = torch.where(share[..., None] > 0, torch.from_numpy(code), 0.0)
    return Coded(code.to(views.device), share.to(views.device), targets.levels, decoded=GAUSSIANS)


def instance_votes(
    gaussians: Gaussians, views: CodeViews, settings: RenderSettings, targets: CodeTargets
) -> tuple[sparse.csr_array, NDArray[np.float32]]:
    """Sum the compositing weights of each Gaussian at its center over all views, by instance.

    Returns:
        (N, I) sparse float32 weights in the pixels of each instance with a code, and (N,) in all pixels [px].
    """
    shape = (gaussians.count, len(targets.level))
    votes, seen = sparse.csr_array(shape, dtype=np.float32), np.zeros(gaussians.count, np.float32)
    for index in track(range(len(views)), "lifting", unit="view"):
        pose = views.camera_to_world[index]
        centers = look_at_centers(gaussians, views.camera, pose, settings, median=False)
        weight = centers.weight * views.weight_at(index, centers.pixel)
        # Each Gaussian has one pixel in a view.
        seen[centers.gaussian] += weight
        owner = targets.instances_at(int(views.frame[index]), centers.pixel)
        level, place = np.nonzero((owner >= 0) & (weight > 0))
        where = centers.gaussian[place], owner[level, place]
        votes = votes + sparse.csr_array((weight[place], where), shape)
    return votes, seen


METHOD = Method(lift_instances)
