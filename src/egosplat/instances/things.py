"""Things of one level: runs of masks, merged, without masks and things that contradict the others."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from egosplat.instances.lifted_masks import LEAST_SEEN, LiftedMasks, holds, masks_of
from egosplat.instances.merging import COMMON, merge
from egosplat.instances.options import InstancesOptions

Ints = NDArray[np.int64]
Floats = NDArray[np.floating]

_FEW_MASKS = 3
"""Things of fewer masks keep them all: two masks that disagree do not tell which of them is wrong."""

_SURE_FRAMES = 3
"""Frames with a mask of a thing from which its masks count in full: a single wrong mask must not displace what many frames show."""

# With the source ``both``, a track is cut between two masks that overlap less, on what both frames have seen.
_CUT_IOU = 0.5

# A mask that overlaps its own instance less has no vote, if the instance has other masks.
_DROP_IOU = 0.3

# An instance is dropped if instances of more masks hold more than this share of its Gaussians.
_CLAIMED = 0.5


def find_things(
    masks: LiftedMasks, run: Ints, weight: Floats, keys: InstancesOptions
) -> tuple[Ints, dict[str, int]]:
    """(V,) thing that each mask of one level shows, numbered 0 to K - 1, -1 for a mask without a vote; and
    counts. ``run`` (V,) are masks that are one thing already; ``weight`` (N,) is that of each Gaussian in an
    IoU."""
    merged = merge(masks, run, weight, keys)
    thing = merged[run] if len(run) else run
    dropped = _outlier_masks(masks, thing, keys)
    thing = np.where(dropped, -1, thing)
    claimed = _claimed_things(masks, thing, weight, keys)
    thing = np.where(np.isin(thing, claimed), -1, thing)
    names = np.unique(thing[thing >= 0])
    counts = {
        "masks": len(masks.instance),
        "runs": len(merged),
        "dropped": int(dropped.sum()),
        "claimed": len(claimed),
        "things": len(names),
    }
    return np.where(thing < 0, -1, np.searchsorted(names, thing)), counts


def single_masks(masks: LiftedMasks) -> Ints:
    """(V,) each mask as a run of its own."""
    return np.argsort(np.argsort(masks.frame, kind="stable"), kind="stable")


def cut_tracks(masks: LiftedMasks, keys: InstancesOptions) -> Ints:
    """(V,) runs of consecutive masks of a track; a track is cut where two consecutive masks disagree."""
    run = np.zeros(len(masks.instance), np.int64)
    for last, mask in pairwise(np.lexsort((masks.frame, masks.instance)).tolist()):
        same = masks.instance[last] == masks.instance[mask] and _agree(masks, last, mask, keys)
        run[mask] = run[last] + (not same)
    # Numbered by first frame, as merging expects.
    first = np.full(run.max(initial=-1) + 1, len(masks.row))
    np.minimum.at(first, run, masks.frame)
    return np.argsort(np.argsort(first, kind="stable"), kind="stable")[run]


def _agree(masks: LiftedMasks, one: int, other: int, keys: InstancesOptions) -> bool:
    """Whether two masks hold the same of what both frames have seen, and have seen enough in common."""
    seen, also = masks.seen_at(masks.frame[one]), masks.seen_at(masks.frame[other])
    first, second = masks.members(one, seen, keys.inside), masks.members(other, also, keys.inside)
    both = np.where(np.minimum(seen, also) >= LEAST_SEEN, np.minimum(seen, also), 0.0)
    shared = both[np.intersect1d(first, second, assume_unique=True)].sum()
    mine, its = both[first].sum(), both[second].sum()
    smaller = min(seen[first].sum(), also[second].sum())
    union = mine + its - shared
    return max(mine, its) >= COMMON * smaller and union > 0 and shared >= _CUT_IOU * union


def _outlier_masks(masks: LiftedMasks, thing: Ints, keys: InstancesOptions) -> NDArray[np.bool_]:
    """(V,) masks that overlap their thing too little on what their frame has seen."""
    dropped = np.zeros(len(thing), bool)
    for mine in masks_of(thing):
        if len(mine) < _FEW_MASKS:
            continue
        whole = _holds(masks, mine, keys.inside)
        for mask in mine:
            seen = masks.seen_at(int(masks.frame[mask]))
            members = masks.members(int(mask), seen, keys.inside)
            shared = seen[members][whole[members]].sum()
            union = seen[members].sum() + seen[whole & (seen >= LEAST_SEEN)].sum() - shared
            dropped[mask] = shared < _DROP_IOU * union
    return dropped


def _claimed_things(masks: LiftedMasks, thing: Ints, weight: Floats, keys: InstancesOptions) -> list[int]:
    """Things whose Gaussians belong to things of more masks by more than the share ``claimed``: suppression in 3D."""
    taken = np.zeros(len(weight), bool)
    gone = []
    for mine in sorted(masks_of(thing), key=len, reverse=True):
        own = _holds(masks, mine, keys.inside)
        size = weight[own].sum()
        if size == 0 or weight[own & taken].sum() > _CLAIMED * size:
            gone.append(int(thing[mine[0]]))
        else:
            taken |= own
    return gone


def _holds(masks: LiftedMasks, chosen: Ints, inside: float) -> NDArray[np.bool_]:
    """(N,) bool, Gaussians that belong to the union of masks."""
    votes = np.asarray(masks.votes[:, chosen].sum(1)).ravel()
    seen = masks.seen[np.unique(masks.frame[chosen])].sum(0)
    return holds(votes, seen, inside)


def beliefs(masks: LiftedMasks, thing: Ints) -> sparse.csr_array:
    """(N, K) share of each Gaussian's weight that the masks of each of the K things hold, in the frames of
    these masks. Frames in which a thing is visible but has no mask do not count against it: a segmenter
    misses small things often, and what they lie on seldom. The share of a thing of fewer than
    ``_SURE_FRAMES`` frames is smaller in proportion."""
    voting = np.flatnonzero(thing >= 0)
    count = int(thing.max(initial=-1)) + 1
    ones = np.ones(len(voting), np.float32)
    which = sparse.csr_array((ones, (voting, thing[voting])), (len(thing), count))
    shares = sparse.csc_array(masks.votes @ which)
    for name, mine in enumerate(masks_of(thing)):
        span = slice(shares.indptr[name], shares.indptr[name + 1])
        frames = np.unique(masks.frame[mine])
        seen = masks.seen[frames].sum(0)[shares.indices[span]]
        shares.data[span] *= min(1.0, len(frames) / _SURE_FRAMES) / np.maximum(seen, LEAST_SEEN)
    return sparse.csr_array(shares)
