"""Merge masks that show one thing, by the Gaussians that their frames have both seen (docs/method.md#instances-3d)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from egosplat.instances.lifted_masks import LEAST_SEEN, LiftedMasks, holds
from egosplat.instances.options import InstancesOptions

FRAMES_A_BLOCK = 8
"""Frames whose runs are merged at once. Blocks are then merged in pairs: work grows linearly with the frames."""

SAMPLE = 20_000
"""Gaussians, drawn at random, by which runs are compared."""

Ints = NDArray[np.int64]
Floats = NDArray[np.floating]

# Masks are compared only if their frames have both seen at least this share of the smaller one.
COMMON = 0.2


@dataclass(frozen=True, eq=False)
class Runs:
    """R groups of masks on n Gaussians.

    Attributes:
        votes: (R, n) float32, summed weight inside the masks [px].
        seen: (R, n) float32, summed weight in the frames of the masks [px].
        inside: share of a Gaussian's weight from which it belongs to a run.
    """

    votes: Floats
    seen: Floats
    inside: float

    def has_seen(self, run: int | slice = slice(None)) -> NDArray[np.bool_]:
        """(R, n) bool, which Gaussians the frames of each run have seen."""
        return self.seen[run] >= LEAST_SEEN

    def holds(self, run: int | slice = slice(None)) -> NDArray[np.bool_]:
        """(R, n) bool, which Gaussians belong to each run."""
        return holds(self.votes[run], self.seen[run], self.inside)

    def add(self, into: int, other: int) -> None:
        """Add one run to another, in place."""
        self.votes[into] += self.votes[other]
        self.seen[into] += self.seen[other]


def merge(masks: LiftedMasks, run: Ints, weight: Floats, keys: InstancesOptions) -> Ints:
    """(R,) thing of each run of masks of one level: the lowest number of the runs that are merged, as they
    show one thing. ``run`` (V,) numbers the runs in the order of their first frames; ``weight`` (N,) is that
    of each Gaussian in an IoU."""
    count = int(run.max(initial=-1)) + 1
    some = np.random.default_rng(0).permutation(len(weight))[:SAMPLE]
    votes, seen = sparse.csr_array(masks.votes.T)[:, some], masks.seen[:, some]
    first = np.full(count, len(masks.row))
    np.minimum.at(first, run, masks.frame)
    thing, block = np.arange(count), first // FRAMES_A_BLOCK
    while count:
        for one in np.unique(block):
            members = np.flatnonzero((block == one) & (thing == np.arange(count)))
            runs = Runs(*_sum_masks(votes, seen, masks.frame, thing[run], members), keys.inside)
            thing[members] = members[agglomerate(runs, weight[some], keys)]
            thing = thing[thing]
        if not block.any():
            break
        block //= 2
    return thing


def _sum_masks(
    votes: sparse.csr_array, seen: sparse.csr_array, frame: Ints, group: Ints, members: Ints
) -> tuple[Floats, Floats]:
    """Votes and seen weights of the groups ``members`` of masks, as in ``Runs``."""
    chosen = np.flatnonzero(np.isin(group, members))
    row = np.searchsorted(members, group[chosen])
    ones = np.ones(len(chosen), np.float32)
    which = sparse.csr_array((ones, (row, chosen)), (len(members), len(group)))
    # A frame counts once for a group, even if several of its masks belong to it.
    frames = sparse.csr_array((ones, (row, frame[chosen])), (len(members), len(seen.indptr) - 1))
    frames.sum_duplicates()
    frames.data[:] = 1.0
    return sparse.csr_array(which @ votes).toarray(), sparse.csr_array(frames @ seen).toarray()


def agglomerate(runs: Runs, weight: Floats, keys: InstancesOptions) -> Ints:
    """Merge the two of R runs that are most alike, again and again, while they are one thing; changes the
    runs. Returns (R,) number of the run that each is merged into, at most its own. ``weight``: as in
    ``merge``."""
    pairs, into = _Pairs(runs, weight), np.arange(len(runs.votes))
    while pairs.largest.max() >= keys.merge_iou:
        row = int(pairs.largest.argmax())
        one, other = sorted((row, int(pairs.partner[row])))
        into[into == other] = one
        pairs.merge(one, other)
    return into


class _Pairs:
    """The IoU of each two of R runs while runs are merged; a merge takes time for the runs that share a Gaussian with it.

    Attributes:
        largest, partner: (R,) the largest IoU of each run, and the first run that has it.
    """

    def __init__(self, runs: Runs, weight: Floats) -> None:
        self._runs, self._weight = runs, weight
        self._by_run = runs.holds()
        # By Gaussian, too: what the others hold of a few Gaussians lies together.
        self._held, self._seen = np.ascontiguousarray(self._by_run.T), np.ascontiguousarray(runs.has_seen().T)
        self._size = self._by_run @ weight
        self._iou = np.nan_to_num(overlaps(runs, weight))
        np.fill_diagonal(self._iou, 0.0)
        self.largest, self.partner = self._iou.max(axis=1), self._iou.argmax(axis=1)

    def merge(self, one: int, other: int) -> None:
        """Add run ``other`` to run ``one``, and compare it with the others."""
        self._runs.add(one, other)
        self._by_run[other] = self._held[:, other] = self._seen[:, other] = False
        self._by_run[one] = self._held[:, one] = self._runs.holds(one)
        self._seen[:, one] = self._runs.has_seen(one)
        self._size[other], self._size[one] = 0.0, self._weight[self._by_run[one]].sum()
        row = self._compare(one)
        changed = np.isin(self.partner, (one, other))
        self._iou[one] = self._iou[:, one] = row
        self._iou[other] = self._iou[:, other] = 0.0
        changed[[one, other]] = True
        better = ~changed & ((row > self.largest) | ((row == self.largest) & (one < self.partner)))
        self.largest[better], self.partner[better] = row[better], one
        anew = self._iou[changed]
        self.largest[changed], self.partner[changed] = anew.max(axis=1), anew.argmax(axis=1)

    def _compare(self, one: int) -> Floats:
        """(R,) IoU of a run with each other run, 0 with itself."""
        mine = np.flatnonzero(self._by_run[one])
        share = self._weight[mine]
        shared = share @ self._held[mine]
        shared[one] = 0.0
        near = np.flatnonzero(shared)
        visible = share @ self._seen[np.ix_(mine, near)]
        seen = self._by_run[near] @ (self._weight * self._seen[:, one])
        row = np.zeros(len(shared), np.float32)
        row[near] = np.nan_to_num(_iou(shared[near], visible, seen, self._size[one], self._size[near]))
        return row


def overlaps(runs: Runs, weight: Floats) -> Floats:
    """(R, R) IoU of each two runs on what both have seen; NaN where that is too small a part of the smaller run."""
    held = runs.holds() * weight
    size = held.sum(1)
    # [a, b]: weight of what a holds and b has seen.
    few = sparse.csr_array(held)
    visible = few @ runs.has_seen().T.astype(np.float32)
    shared = few @ (held > 0).T.astype(np.float32)
    return _iou(shared, visible, visible.T, size[:, None], size[None])


def _iou(shared: Floats, first: Floats, second: Floats, size: Floats, other: Floats) -> Floats:
    """``overlaps`` from the weights that both hold, that one holds and the other has seen, and that each holds."""
    union = first + second - shared
    iou = np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)
    return np.where(np.maximum(first, second) < COMMON * np.minimum(size, other), np.nan, iou)
