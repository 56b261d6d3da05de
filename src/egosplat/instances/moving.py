"""Tracks: those of what moves are drawn over the things, which are merged without them; others stand still."""

import numpy as np
from scipy import sparse

from egosplat.arrays import Array, Bools, Ints, Ints32
from egosplat.artifacts.reader import Artifact
from egosplat.images import evenly_spaced
from egosplat.instances.lifted_masks import LiftedMasks, masks_of
from egosplat.instances.merging import MERGE_IOU, Runs

APART_S = 1.0
"""Masks are compared with masks this much earlier or later: what moves is elsewhere by then."""

MOST_MASKS = 24
"""Masks of a track that are compared, evenly spaced, so that the time does not grow with the square of the frames."""

LEAST_PAIRS = 3
"""Pairs of masks that it takes to tell."""


class MovingTracks:
    """The M tracks of segments.zarr that show what moves.

    Attributes:
        level, frames: (M,) int8, and (M,) int32 number of drawn frames that show each track.
        standing: (S,) int64 instances of segments.zarr that are tracks and stand still. Their masks are merged.
    """

    def __init__(self, segments: Artifact, standing: Ints | None = None) -> None:
        """Read which instances of segments.zarr move; ``standing``: those that do not, none by default."""
        tracked = segments.read("instances/moving")
        self.standing = np.zeros(0, np.int64) if standing is None else standing
        moving = tracked.copy()
        moving[self.standing] = False
        self.level = segments.read("instances/level")[moving]
        self.frames = np.zeros(len(self.level), np.int32)
        # Label -1 indexes the appended last entry: no instance is no track.
        self._number = np.append(np.where(moving, np.cumsum(moving) - 1, -1), -1).astype(np.int32)
        self._single = np.append(~tracked, False)

    def keep(self, labels: Ints32) -> tuple[Ints32, Bools]:
        """Labels (L, H, W) of segments.zarr of the tracks alone, and (H, W) bool, no pixel."""
        return np.where(self._number[labels] >= 0, labels, np.int32(-1)), np.zeros(labels.shape[1:], bool)

    def remove(self, labels: Ints32) -> tuple[Ints32, Bools]:
        """Labels (L, H, W) of segments.zarr without pixels of any track, and (H, W) bool, which pixels these are."""
        moving = np.asarray((self._number[labels] >= 0).any(axis=0))
        # A frame without masks of its own would count for the tracks that stand still, and against all others.
        voting = self._single[labels].any()
        return np.where(moving | ~voting, np.int32(-1), labels), moving

    def draw(self, labels: Ints32, over: Ints32, first: int) -> Ints32:
        """Draw the tracks in a frame's (L, H, W) labels, numbered from ``first``, over its (L, H, W) things.
        Where a track of any level is, no thing stays."""
        track = self._number[labels]
        shown = track >= 0
        self.frames[np.unique(track[shown])] += 1
        return np.where(shown.any(axis=0), np.where(shown, track + np.int32(first), -1), over)


def standing_tracks(masks: LiftedMasks, time_s: Array) -> Ints:
    """The sorted tracks of which half of the pairs of masks are so alike that masks of single frames would be
    merged. A track with too few pairs that show the same surfaces is not among them. ``time_s`` (T,) is when
    each frame was taken."""
    weight, found = masks.weight, []
    for mine in masks_of(masks.instance):
        some = mine[evenly_spaced(len(mine), MOST_MASKS)]
        frame = masks.frame[some]
        votes = sparse.csr_array(masks.votes[:, some].T)
        runs, everyone = Runs(votes, masks.seen[frame], weight), np.arange(len(some))
        apart = np.abs(time_s[frame][:, None] - time_s[frame]) >= APART_S
        alike = np.stack([runs.overlaps(run, everyone) for run in range(len(some))])[np.triu(apart, 1)]
        alike = alike[~np.isnan(alike)]
        if len(alike) >= LEAST_PAIRS and np.median(alike) >= MERGE_IOU:
            found.append(masks.instance[mine[0]])
    return np.array(found, np.int64)
