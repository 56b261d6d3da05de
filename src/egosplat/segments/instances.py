"""The instances of a video: how their masks overlap, which are one object, and which are kept."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from torch import Tensor

from egosplat.segments.label_maps import LabelMaps
from egosplat.segments.nms import areas, intersections

Ints = NDArray[np.int64]

MIN_COMMON_FRAMES = 2
"""Instances that are seen together in fewer frames are never merged: a single frame may deceive."""


@dataclass(frozen=True)
class Track:
    """What began an instance.

    Attributes:
        level: index into ``options.LEVELS``; first_frame: whose prompts found it.
        predicted_iou, stability: of the mask that began it.
    """

    level: int
    first_frame: int
    predicted_iou: float
    stability: float


@dataclass(frozen=True)
class Segmented:
    """A segmented video, before duplicates and fragments are dealt with.

    Attributes:
        labels: number of the instance at each pixel, by frame and level.
        instances: by their number.
        same: pairs of numbers that are one thing.
        notes: what is worth keeping of how it went; plain JSON values.
    """

    labels: LabelMaps
    instances: list[Track]
    same: list[tuple[int, int]]
    notes: dict[str, object]


@dataclass(frozen=True)
class FinalInstances:
    """What stays of a segmented video, and under which number.

    Attributes:
        table: (count + 1,) int32 new number of each instance, -1 of those that are dropped; the last entry is the
            one that -1 picks: nothing stays nothing.
        staying: (N,) old numbers of those that stay, in their new order.
        merged: how many were the same as others.
    """

    table: NDArray[np.int32]
    staying: NDArray[np.int64]
    merged: int


def finalize_instances(segmented: Segmented, min_frames: int) -> FinalInstances:
    """Merge what is one thing and drop what is seen in too few frames, see ``merging``."""
    roots = merge_roots(len(segmented.instances), segmented.same)
    seen = frames_seen(segmented.labels, roots)
    new, staying = number_kept(roots, seen, min_frames, len(segmented.labels))
    return FinalInstances(
        np.append(new, -1).astype(np.int32), staying, int((roots != np.arange(len(roots))).sum())
    )


def frames_seen(labels: LabelMaps, roots: NDArray[np.int64]) -> NDArray[np.int64]:
    """(count,) in how many frames each root, from ``merging.merged``, is seen at any pixel."""
    seen = np.zeros(len(roots), dtype=np.int64)
    for frame in range(len(labels)):
        found = np.unique(labels[frame])
        seen[np.unique(roots[found[found >= 0]])] += 1
    return seen


class Overlaps:
    """How much the masks of a level's instances overlap, over all frames in which both are seen."""

    def __init__(self) -> None:
        self._shared = np.zeros((0, 0))
        self._area = np.zeros((0, 0))
        self._frames = np.zeros((0, 0), dtype=np.int64)

    def add(self, ids: list[int], masks: Tensor) -> None:
        """One frame: numbers of K instances of the level and their (K, M, M) bool masks."""
        self._grow(ids)
        size = _sizes(masks)
        both = (size > 0)[:, None] & (size > 0)[None]
        at = np.ix_(ids, ids)
        self._shared[at] += intersections(masks, masks).cpu().numpy()
        self._area[at] += size[:, None] * both
        self._frames[at] += both

    def add_between(self, ids: list[int], masks: Tensor, other_ids: list[int], others: Tensor) -> None:
        """One frame, but only how instances overlap others: numbers and (K, M, M) bool masks of both."""
        self._grow([*ids, *other_ids])
        size, other_size = _sizes(masks), _sizes(others)
        shared = intersections(masks, others).cpu().numpy()
        both = (size > 0)[:, None] & (other_size > 0)[None]
        for at, values, areas_, seen in (
            (np.ix_(ids, other_ids), shared, size[:, None], both),
            (np.ix_(other_ids, ids), shared.T, other_size[:, None], both.T),
        ):
            self._shared[at] += values
            self._area[at] += areas_ * seen
            self._frames[at] += seen

    def same(self, iou_thresh: float, frames: int) -> list[tuple[int, int]]:
        """Pairs of numbers whose pooled IoU is above the threshold.

        Args:
            frames: length of the video; shorter ones than ``MIN_COMMON_FRAMES`` ask for no more frames than they have.
        """
        union = self._area + self._area.T - self._shared
        iou = np.divide(self._shared, union, out=np.zeros_like(union), where=union > 0)
        alike = (iou > iou_thresh) & (self._frames >= min(MIN_COMMON_FRAMES, frames))
        return [(int(a), int(b)) for a, b in np.argwhere(np.triu(alike, 1))]

    def state_dict(self) -> dict[str, Tensor]:
        """All that was added, as arrays."""
        return {name: torch.from_numpy(values.copy()) for name, values in vars(self).items()}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Take what ``state_dict`` gave in place of all that was added."""
        for name, values in state.items():
            setattr(self, name, values.numpy())

    def _grow(self, ids: list[int]) -> None:
        missing = max(ids, default=-1) + 1 - len(self._shared)
        if missing > 0:
            pad = ((0, missing), (0, missing))
            self._shared, self._area = np.pad(self._shared, pad), np.pad(self._area, pad)
            self._frames = np.pad(self._frames, pad)


def _sizes(masks: Tensor) -> NDArray[np.float64]:
    return areas(masks).cpu().numpy().astype(np.float64)


def merge_roots(count: int, pairs: list[tuple[int, int]]) -> Ints:
    """(count,) for each instance the lowest number of those that it is the same as, through any of them."""
    if count == 0:
        return np.zeros(0, dtype=np.int64)
    rows, columns = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    links = coo_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    _, component = connected_components(links, directed=False)
    _, first = np.unique(component, return_index=True)
    return first[component]


def number_kept(roots: Ints, frames_seen: Ints, min_frames: int, frames: int) -> tuple[Ints, Ints]:
    """Number the instances that stay.

    Args:
        roots: from ``merged``.
        frames_seen: (count,) in how many frames each root is seen, at its own number.
        min_frames: fewer are too few; a video shorter than that asks for all of its frames.

    Returns:
        (count,) new number of each instance, -1 of those that are dropped, and the (N,) roots that stay.
    """
    least = max(1, min(min_frames, frames))
    staying = np.flatnonzero((roots == np.arange(len(roots))) & (frames_seen >= least))
    new = np.full(len(roots), -1, dtype=np.int64)
    new[staying] = np.arange(len(staying))
    return (new[roots] if len(roots) else new), staying
