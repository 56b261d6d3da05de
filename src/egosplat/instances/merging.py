"""Merge masks that show one thing, by the Gaussians that their frames have both seen (docs/method.md#instances-3d)."""

from heapq import heappop, heappush
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import sparse

from egosplat.arrays import Ints, Ints32, Reals
from egosplat.instances.lifted_masks import LEAST_SEEN, LiftedMasks, holds, masks_of

FRAMES_A_BLOCK = 8
"""Frames whose runs are merged at once. Blocks are then merged in pairs: work grows linearly with the frames."""

SAMPLE = 20_000
"""Gaussians, drawn at random, by which runs are compared."""


Row = tuple[Ints32, Reals]
"""Columns and values of a row of a sparse matrix."""

# Masks are compared only if their frames have both seen at least this share of the smaller one.
COMMON = 0.2

# Masks are merged from this IoU. Lower merges more, neighbors too; higher leaves one thing in pieces.
MERGE_IOU = 0.4


class Runs:
    """R groups of masks on n Gaussians, of which each has seen few.

    Attributes:
        held: by run, int32 Gaussians that belong to it.
        voters: (n, R) sparse, which runs have votes of each Gaussian; not changed by ``add``.
    """

    def __init__(self, votes: sparse.csr_array, seen: sparse.csr_array, weight: Reals) -> None:
        """Take (R, n) weights, summed inside the masks and in the frames of the masks [px]; the (n,) weight of each
        Gaussian in an IoU."""
        self._weight = weight
        self._votes, self._seen, self.voters = rows_of(votes), rows_of(seen), sparse.csr_array(votes.T)
        self.held = [self._holds(run) for run in range(len(self._votes))]
        self._size = np.array([weight[held].sum() for held in self.held])

    def _holds(self, run: int) -> Ints32:
        gaussian, votes = self._votes[run]
        return gaussian[holds(votes, _dense(self._seen[run], len(self._weight))[gaussian])]

    def _sees(self, run: int) -> Ints32:
        gaussian, seen = self._seen[run]
        return gaussian[seen >= LEAST_SEEN]

    def add(self, into: int, other: int) -> None:
        """Move what one run holds to another, in place."""
        for rows in (self._votes, self._seen):
            total = _dense(rows[into], len(self._weight))
            total[rows[other][0]] += rows[other][1]
            gaussian = np.flatnonzero(total).astype(np.int32)
            rows[into] = gaussian, total[gaussian]
        self.held[into], self.held[other] = self._holds(into), self.held[other][:0]
        self._size[into] = self._weight[self.held[into]].sum()

    def overlaps(self, one: int, others: Ints, least: float = 0.0) -> Reals:
        """(K,) IoU of a run with each of others on what both have seen; NaN where that is too small a part of the
        smaller run, or the IoU cannot reach ``least``."""
        weight, parts = self._weight, (self.held[one], self._sees(one))
        mine, visible = (_dense((gaussian, weight[gaussian]), len(weight)) for gaussian in parts)
        held, found = [self.held[other] for other in others], np.full(len(others), np.nan)
        shared, second = _sums(held, mine), _sums(held, visible)
        # The union has at least the second part. What runs see is many times what they hold, and few pairs are alike.
        some = np.flatnonzero(shared >= 0.99 * least * second)
        shared, second, others = shared[some], second[some], others[some]
        first = _sums([self._sees(other) for other in others], mine)
        union, smaller = first + second - shared, np.minimum(self._size[one], self._size[others])
        iou = np.divide(shared, union, out=np.zeros(len(others)), where=union > 0)
        found[some] = np.where(np.maximum(first, second) < COMMON * smaller, np.nan, iou)
        return found


def rows_of(matrix: Any) -> list[Row]:
    """Indices and values of each row of a sparse matrix, or column of one by columns, in order; views."""
    matrix.sort_indices()
    spans = [slice(*span) for span in pairwise(matrix.indptr.tolist())]
    return [(matrix.indices[span], matrix.data[span]) for span in spans]


def _columns(matrix: Any, rows: Ints32) -> Ints32:
    """The columns of the values of some rows; an index of SciPy takes many times as long for few rows."""
    ends = matrix.indptr[rows + 1]
    counts = ends - matrix.indptr[rows]
    return matrix.indices[np.repeat(ends - np.cumsum(counts), counts) + np.arange(counts.sum())]


def _dense(row: Row, length: int) -> Reals:
    found = np.zeros(length, row[1].dtype)
    found[row[0]] = row[1]
    return found


def _sums(gaussians: list[Ints32], values: Reals) -> Any:
    """(K,) sum of the (n,) values of the Gaussians of each of K lists."""
    owner = np.repeat(np.arange(len(gaussians)), [*map(len, gaussians)])
    return np.bincount(owner, values[np.concatenate([np.zeros(0, np.int32), *gaussians])], len(gaussians))


def merge(masks: LiftedMasks, run: Ints, weight: Reals) -> Ints:
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
        for mine in masks_of(block[run]):
            members, row = np.unique(thing[run[mine]], return_inverse=True)
            sums = _sum_masks(votes[mine], seen, masks.frame[mine], row)
            thing[members] = members[agglomerate(Runs(*sums, weight[some]))]
        thing = thing[thing]
        if not block.any():
            break
        block //= 2
    return thing


def _sum_masks(
    votes: sparse.csr_array, seen: sparse.csr_array, frame: Ints, row: Ints
) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Votes and seen weights of runs, as in ``Runs``, from those of their masks: ``row`` (V,) numbers the runs."""
    ones, count = np.ones(len(row), np.float32), int(row.max()) + 1
    which = sparse.csr_array((ones, (row, np.arange(len(row)))), (count, len(row)))
    # A frame counts once for a run, even if several of its masks belong to it.
    frames = sparse.csr_array((ones, (row, frame)), (count, len(seen.indptr) - 1))
    frames.sum_duplicates()
    frames.data[:] = 1.0
    return sparse.csr_array(which @ votes), sparse.csr_array(frames @ seen)


def agglomerate(runs: Runs) -> Ints:
    """Merge the two of R runs that are most alike, again and again, while they are one thing; changes the
    runs. Returns (R,) number of the run that each is merged into, at most its own."""
    into, merges = np.arange(len(runs.held)), np.zeros(len(runs.held), np.int64)
    # The most alike first, of equal pairs those of the lowest numbers; with the merges that both had until then.
    alike: list[tuple[float, int, int, int]] = []

    def compare(one: int, least: int) -> None:
        """Add the pairs of a run with the runs from the number ``least`` that share a Gaussian with it."""
        near = np.flatnonzero(np.bincount(into[_columns(runs.voters, runs.held[one])]))
        near = near[(near >= least) & (near != one)]
        iou = runs.overlaps(one, near, MERGE_IOU)
        chosen = iou >= MERGE_IOU
        for other, value in zip(near[chosen].tolist(), iou[chosen].tolist(), strict=True):
            heappush(alike, (-value, min(one, other), max(one, other), int(merges[one] + merges[other])))

    for one in range(len(into)):
        compare(one, one)
    while alike:
        _, one, other, before = heappop(alike)
        if before == merges[one] + merges[other]:
            into[into == other] = one
            merges[[one, other]] += 1
            runs.add(one, other)
            compare(one, 0)
    return into
