"""Lift instances instead of codes: each Gaussian takes the code of the instance that it shows most (docs/method.md#lifting)."""

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse

from egosplat.language.lifting import labeled_share
from egosplat.language.method import Coded, Method
from egosplat.language.targets import CodeTargets
from egosplat.language.views import CodeViews
from egosplat.progress import track


def lift_instances(views: CodeViews, targets: CodeTargets, *_: object) -> Coded:
    """Method ``lift_instances``: at each level, the code of the instance with the largest share of the
    Gaussian's weight. A weight is alpha times transmittance times 1 - M at the pixel that holds the
    Gaussian's center. The code is the mean of the instance's targets by the weights in their views. A mean of
    the codes of two instances would decode to a feature of neither, and pixels around the center may show the
    neighbors."""
    votes, seen = target_votes(views, targets)
    codes, instance = targets.code_rows()
    shape = (views.gaussians.count, len(targets.levels))
    code, known = np.zeros((*shape, targets.channels), np.float32), np.zeros(shape, np.float32)
    for level in range(shape[1]):
        rows = np.flatnonzero(targets.level[instance] == level)
        code[:, level], known[:, level] = mean_of_dominant(votes[:, rows], instance[rows], codes[rows])
    share = labeled_share(torch.from_numpy(known), torch.from_numpy(seen)[:, None])
    code = torch.where(share[..., None] > 0, torch.from_numpy(code), 0.0)
    return Coded(code.to(views.device), share.to(views.device), targets.levels)


def mean_of_dominant(
    votes: sparse.csr_array, instance: NDArray[np.int64], codes: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Average the codes of each Gaussian's dominant instance.

    Args:
        votes: (N, R) weights of N Gaussians on R targets, which have the (R,) ``instance`` and (R, C) ``codes``.

    Returns:
        (N, C) mean codes by weight, 0 without votes, and (N,) float32 votes for all instances.
    """
    names, column = np.unique(instance, return_inverse=True)
    member = sparse.csr_array(
        (np.ones(len(column), np.float32), (np.arange(len(column)), column)), shape=(len(column), len(names))
    )
    if not len(names):
        empty = np.zeros((len(votes.indptr) - 1, codes.shape[1] + 1), np.float32)
        return empty[:, 1:], empty[:, 0]
    by_instance = votes @ member
    best = by_instance.argmax(axis=1)
    entries = votes.tocoo()
    row, target = entries.coords
    mine = column[target] == best[row]
    kept = sparse.csr_array((entries.data[mine], (row[mine], target[mine])), shape=votes.shape)
    total = kept.sum(axis=1)
    inverse = np.divide(1.0, total, out=np.zeros_like(total), where=total > 0)
    return (kept @ codes) * inverse[:, None], by_instance.sum(axis=1)


def target_votes(views: CodeViews, targets: CodeTargets) -> tuple[sparse.csr_array, NDArray[np.float32]]:
    """Sum the compositing weights of each Gaussian at its center over all views. (N, R) sparse float32
    weights in the pixels of each target of ``CodeTargets.code_rows``; and (N,) in all pixels [px]."""
    shape = (views.gaussians.count, len(targets.code_rows()[1]))
    seen = np.zeros(shape[0], np.float32)
    weights, places = [], []
    for index in track(range(len(views)), "lifting", unit="view"):
        centers = views.centers(index)
        weight = centers.weight * views.weight_at(index, centers.pixel)
        # Each Gaussian has one pixel in a view.
        seen[centers.gaussian] += weight
        rows = targets.rows_at(int(views.frame[index]), centers.pixel)
        level, place = np.nonzero((rows >= 0) & (weight > 0))
        weights.append(weight[place])
        places.append(np.stack([centers.gaussian[place], rows[level, place]]))
    return sparse.csr_array((np.concatenate(weights), np.concatenate(places, axis=1)), shape=shape), seen


METHOD = Method(lift_instances)
