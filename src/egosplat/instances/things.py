"""Things of one level: runs of masks, merged, without masks and things that contradict the others."""

import numpy as np
from scipy import sparse

from egosplat.arrays import Bools, Ints, Reals
from egosplat.instances.lifted_masks import INSIDE, LEAST_SEEN, LiftedMasks, holds, masks_of
from egosplat.instances.merging import merge, rows_of

_FEW_MASKS = 3
"""Things of fewer masks keep them all: two masks that disagree do not tell which of them is wrong."""

_SURE_FRAMES = 3
"""Frames with a mask of a thing from which its masks count in full: a single wrong mask must not displace what many frames show."""

# A mask that overlaps its own instance less has no vote, if the instance has other masks.
_DROP_IOU = 0.3

# An instance is dropped if instances of more masks hold more than this share of its Gaussians.
_CLAIMED = 0.5


def find_things(masks: LiftedMasks, weight: Reals) -> tuple[Ints, dict[str, int]]:
    """(V,) thing that each mask of one level shows, numbered 0 to K - 1, -1 for a mask without a vote; and
    counts. ``weight`` (N,) is that of each Gaussian in an IoU."""
    # Each mask by itself, in the order of frames.
    run = np.argsort(np.argsort(masks.frame, kind="stable"), kind="stable")
    thing = merge(masks, run, weight)[run]
    dropped = _outlier_masks(masks, thing)
    thing = np.where(dropped, -1, thing)
    claimed = _claimed_things(masks, thing, weight)
    thing = np.where(np.isin(thing, claimed), -1, thing)
    names = np.unique(thing[thing >= 0])
    counts = {
        "masks": len(masks.instance),
        "dropped": int(dropped.sum()),
        "claimed": len(claimed),
        "things": len(names),
    }
    return np.where(thing < 0, -1, np.searchsorted(names, thing)), counts


def _outlier_masks(masks: LiftedMasks, thing: Ints) -> Bools:
    """(V,) masks that overlap their thing too little on what their frame has seen."""
    dropped, votes, frames = np.zeros(len(thing), bool), rows_of(masks.votes), rows_of(masks.seen)
    for mine in masks_of(thing):
        if len(mine) < _FEW_MASKS:
            continue
        whole = _holds(masks, mine)
        for mask in mine:
            (gaussian, weight), (shown, seen) = votes[mask], frames[masks.frame[mask]]
            # A vote is all that is seen of the Gaussian in the frame.
            member = weight >= INSIDE * LEAST_SEEN
            shared = weight[member & whole[gaussian]].sum()
            union = weight[member].sum() + seen[whole[shown] & (seen >= LEAST_SEEN)].sum() - shared
            dropped[mask] = shared < _DROP_IOU * union
    return dropped


def _claimed_things(masks: LiftedMasks, thing: Ints, weight: Reals) -> list[int]:
    """Things whose Gaussians belong to things of more masks by more than the share ``claimed``: suppression in 3D."""
    taken = np.zeros(len(weight), bool)
    gone = []
    for mine in sorted(masks_of(thing), key=len, reverse=True):
        own = _holds(masks, mine)
        size = weight[own].sum()
        if size == 0 or weight[own & taken].sum() > _CLAIMED * size:
            gone.append(int(thing[mine[0]]))
        else:
            taken |= own
    return gone


def _holds(masks: LiftedMasks, chosen: Ints) -> Bools:
    """(N,) bool, Gaussians that belong to the union of masks."""
    votes = np.asarray(masks.votes[:, chosen].sum(1)).ravel()
    return holds(votes, masks.seen[np.unique(masks.frame[chosen])].sum(0))


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
