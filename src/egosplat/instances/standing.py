"""Tracks that stand still: their masks cover the same surfaces, whatever the transient network says of them."""

import numpy as np
from numpy.typing import NDArray

from egosplat.images import evenly_spaced
from egosplat.instances.lifted_masks import LiftedMasks
from egosplat.instances.merging import COMMON, Runs, overlaps
from egosplat.instances.options import InstancesOptions

APART_S = 1.0
"""Masks are compared with masks this much earlier or later: what moves is elsewhere by then."""

MOST_MASKS = 24
"""Masks of a track that are compared, evenly spaced, so that the time does not grow with the square of the frames."""

LEAST_PAIRS = 3
"""Pairs of masks that it takes to tell."""


def standing_tracks(
    masks: LiftedMasks, time_s: NDArray[np.float64], keys: InstancesOptions
) -> NDArray[np.int64]:
    """Find the tracks of which half of the pairs of masks are so alike that masks of single frames would be merged.

    Args:
        masks: of tracks; ``instance`` is the track of each.
        time_s: (T,) when each of the T frames was taken [s].
        keys: ``inside`` and ``merge_iou`` are used.

    Returns:
        The instances of these tracks, sorted. A track with too few pairs that show the same surfaces is not among them.
    """
    weight, found = masks.weight, []
    for one in np.unique(masks.instance):
        mine = np.flatnonzero(masks.instance == one)
        some = mine[evenly_spaced(len(mine), MOST_MASKS)]
        frame = masks.frame[some]
        runs = Runs(masks.votes[:, some].toarray().T, masks.seen[frame].toarray(), keys.inside)
        apart = np.abs(time_s[frame][:, None] - time_s[frame]) >= APART_S
        alike = overlaps(runs, weight, COMMON)[np.triu(apart, 1)]
        alike = alike[~np.isnan(alike)]
        if len(alike) >= LEAST_PAIRS and np.median(alike) >= keys.merge_iou:
            found.append(one)
    return np.array(found, np.int64)
