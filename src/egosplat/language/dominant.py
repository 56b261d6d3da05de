"""Lift instances instead of codes: each Gaussian takes the code of the instance that it shows most (docs/method.md#lifting)."""

import numpy as np
import torch

from egosplat.arrays import Bools, Floats, Ints
from egosplat.language.lifting import labeled_share
from egosplat.language.method import Coded, Method
from egosplat.language.targets import CodeTargets
from egosplat.language.views import CodeViews
from egosplat.progress import track

_VIEWS_AT_ONCE = 64
"""Views whose votes are held before they are added. Sums are in the order of the views, whatever the number is."""


def lift_instances(views: CodeViews, targets: CodeTargets, *_: object) -> Coded:
    """Method ``lift_instances``: at each level, the code of the instance with the largest share of the
    Gaussian's weight. A weight is alpha times transmittance times 1 - M at the pixel that holds the
    Gaussian's center. The code is the mean of the instance's targets by the weights in their views. A mean of
    the codes of two instances would decode to a feature of neither, and pixels around the center may show the
    neighbors."""
    (gaussian, instance, sums, weight), seen = sum_votes(views, targets)
    shape = len(seen), len(targets.levels)
    code, known = np.zeros((*shape, targets.channels), np.float32), np.zeros(shape, np.float32)
    for level in range(shape[1]):
        mine = targets.level[instance] == level
        best = dominant(gaussian, weight, mine)
        code[gaussian[best], level] = sums[best] / weight[best, None]
        known[:, level] = np.bincount(gaussian[mine], weight[mine], shape[0])
    share = labeled_share(torch.from_numpy(known), torch.from_numpy(seen)[:, None])
    code = torch.where(share[..., None] > 0, torch.from_numpy(code), 0.0)
    return Coded(code.to(views.device), share.to(views.device), targets.levels)


def dominant(gaussian: Ints, weight: Floats, chosen: Bools) -> Ints:
    """The pair with the largest weight of each Gaussian, among (P,) ``chosen`` ones; the first of equal ones."""
    order = np.flatnonzero(chosen)
    order = order[np.lexsort((-weight[order], gaussian[order]))]
    return order[np.unique(gaussian[order], return_index=True)[1]]


def sum_votes(views: CodeViews, targets: CodeTargets) -> tuple[tuple[Ints, Ints, Floats, Floats], Floats]:
    """Sum over views, of P pairs of a Gaussian and an instance: (P,) int64 numbers of both, sorted, the (P, C) target codes of
    the instance times the weights of the Gaussian at its center there, and the (P,) weights [px], above 0; and of each Gaussian
    the (N,) weight at its center, whatever that shows [px]. Memory grows with the pairs, not with the views."""
    (codes, owner), instances = targets.code_rows(), max(len(targets.level), 1)
    # The last column sums the weights.
    codes = np.column_stack([codes, np.ones(len(codes), np.float32)])
    pair, sums = np.zeros(0, np.int64), codes[:0]
    seen = np.zeros(views.gaussians.count, np.float32)
    held: list[tuple[Ints, Ints, Floats]] = []
    for index in track(range(len(views)), "lifting", unit="view"):
        centers = views.centers(index)
        weight = centers.weight * views.weight_at(index, centers.pixel)
        # Each Gaussian has one pixel in a view.
        seen[centers.gaussian] += weight
        rows = targets.rows_at(int(views.frame[index]), centers.pixel)
        place, level = np.nonzero(((rows >= 0) & (weight > 0)).T)
        row = rows[level, place]
        held.append((centers.gaussian[place] * instances + owner[row], row, weight[place]))
        if len(held) < _VIEWS_AT_ONCE and index < len(views) - 1:
            continue
        every = np.unique(np.concatenate([pair, *(pairs for pairs, _, _ in held)]))
        larger = np.zeros((len(every), codes.shape[1]), np.float32)
        larger[np.searchsorted(every, pair)] = sums
        pair, sums = every, larger
        for pairs, row, weight in held:
            sums[np.searchsorted(pair, pairs)] += weight[:, None] * codes.take(row, axis=0)
        held = []
    return (*np.divmod(pair, instances), sums[:, :-1], sums[:, -1]), seen


METHOD = Method(lift_instances)
