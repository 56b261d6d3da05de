"""The instances of a video: how their masks overlap, which are one object, and which are kept."""

from collections.abc import Callable
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

# Instances that share fewer frames are not merged: in a single frame, two objects can overlap by chance.
MIN_COMMON_FRAMES = 2


@dataclass(frozen=True)
class Video:
    """The frames to segment.

    Attributes:
        length: number of frames.
        image: returns the (H, W, 3) uint8 RGB image of a frame.
        shown: returns the (H, W) bool pixels of a frame that show the scene.
    """

    length: int
    image: Callable[[int], NDArray[np.uint8]]
    shown: Callable[[int], NDArray[np.bool_]]


@dataclass(frozen=True)
class Track:
    """An instance as it was first found.

    Attributes:
        level: index into ``options.LEVELS``.
        first_frame: the frame whose prompts found it.
        predicted_iou, stability: scores of its first mask.
        moving: tracked because the transient network says that it moves.
    """

    level: int
    first_frame: int
    predicted_iou: float
    stability: float
    moving: bool = False


@dataclass(frozen=True)
class Segmented:
    """A segmented video, before duplicates are merged and fragments dropped.

    Attributes:
        labels: instance number of each pixel, by frame and level.
        instances: by number.
        same: pairs of numbers that are the same object.
        prompted: frames in which instances were searched for.
    """

    labels: LabelMaps
    instances: list[Track]
    same: list[tuple[int, int]]
    prompted: list[int]


@dataclass(frozen=True)
class FinalInstances:
    """The instances that are kept, and their new numbers.

    Attributes:
        table: (count + 1,) int32 new number of each instance, -1 if it is dropped. The last entry is -1, so that
            indexing with -1 (no instance) gives -1.
        kept: (N,) old numbers of the kept instances, in their new order.
        merged: number of instances that were merged into others.
    """

    table: NDArray[np.int32]
    kept: NDArray[np.int64]
    merged: int


def finalize_instances(segmented: Segmented, min_frames: int) -> FinalInstances:
    """Merge instances that are the same object, and drop those seen in fewer than ``min_frames`` frames."""
    count, frames = len(segmented.instances), len(segmented.labels)
    roots, seen = merge_roots(count, segmented.same), np.zeros(count, np.int64)
    for frame in range(frames):
        found = np.unique(segmented.labels[frame])
        seen[np.unique(roots[found[found >= 0]])] += 1
    # A video shorter than ``min_frames`` still has instances.
    least = max(1, min(min_frames, frames))
    kept = np.flatnonzero((roots == np.arange(count)) & (seen >= least))
    table = np.full(count + 1, -1, np.int32)
    table[kept] = np.arange(len(kept))
    table[:-1] = table[roots]
    return FinalInstances(table, kept, count - len(np.unique(roots)))


def merge_roots(count: int, pairs: list[tuple[int, int]]) -> Ints:
    """(count,) lowest number among all instances linked to each one by ``pairs``, directly or through others."""
    if count == 0:
        return np.zeros(0, dtype=np.int64)
    rows, columns = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    # Being the same object is transitive, although overlapping is not.
    links = coo_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    _, component = connected_components(links, directed=False)
    _, first = np.unique(component, return_index=True)
    return first[component]


class Overlaps:
    """Overlap between the masks of a level's instances, summed over the frames in which both are visible."""

    def __init__(self) -> None:
        self._shared = np.zeros((0, 0))
        self._area = np.zeros((0, 0))
        self._frames = np.zeros((0, 0), dtype=np.int64)

    def add(self, ids: list[int], masks: Tensor) -> None:
        """Add a frame: numbers of K instances of the level and their (K, M, M) bool masks."""
        self._add(ids, masks, ids, masks)

    def add_between(self, ids: list[int], masks: Tensor, other_ids: list[int], others: Tensor) -> None:
        """Add a frame, but only the overlaps between two sets of instances: numbers and (K, M, M) bool masks of each."""
        self._add(ids, masks, other_ids, others)
        self._add(other_ids, others, ids, masks)

    def _add(self, ids: list[int], masks: Tensor, other_ids: list[int], others: Tensor) -> None:
        missing = max([*ids, *other_ids], default=-1) + 1 - len(self._shared)
        if missing > 0:
            pad = ((0, missing), (0, missing))
            self._shared, self._area = np.pad(self._shared, pad), np.pad(self._area, pad)
            self._frames = np.pad(self._frames, pad)
        size, other_size = (areas(one).cpu().numpy().astype(np.float64) for one in (masks, others))
        # Only frames in which both are visible count: an occluded object must not lower the IoU.
        both = (size > 0)[:, None] & (other_size > 0)[None]
        at = np.ix_(ids, other_ids)
        self._shared[at] += intersections(masks, others).cpu().numpy()
        self._area[at] += size[:, None] * both
        self._frames[at] += both

    def same(self, iou_thresh: float, frames: int) -> list[tuple[int, int]]:
        """Pairs of instances whose IoU over their common frames is above the threshold, in a video of ``frames`` frames."""
        union = self._area + self._area.T - self._shared
        iou = np.divide(self._shared, union, out=np.zeros_like(union), where=union > 0)
        alike = (iou > iou_thresh) & (self._frames >= min(MIN_COMMON_FRAMES, frames))
        return [(int(a), int(b)) for a, b in np.argwhere(np.triu(alike, 1))]

    def state_dict(self) -> dict[str, Tensor]:
        """The accumulated counts as tensors."""
        return {name: torch.from_numpy(values.copy()) for name, values in vars(self).items()}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Replace the counts by those of a ``state_dict``."""
        for name, values in state.items():
            setattr(self, name, values.numpy())
