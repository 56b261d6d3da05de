"""A video and its segmentation: label maps, tracks, how much their masks overlap, and which of them are kept."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from torch import Tensor

from egosplat.arrays import Bools, Bytes, Ints, Ints32
from egosplat.artifacts.checkpoint import read_state, write_state
from egosplat.segments.masks import areas, intersections

# Instances that share fewer frames are not merged: in a single frame, two objects can overlap by chance.
MIN_COMMON_FRAMES = 2

# IoU over the frames that show both, above which two instances of a level are one.
SAME_IOU = 0.6


# Numbers of K instances of a level and their (K, M, M) float32 logits, or bool masks, in one frame.
LevelMasks = tuple[list[int], Tensor]


@dataclass(frozen=True)
class Video:
    """``length`` frames to segment: ``image`` gives the (H, W, 3) uint8 RGB of one, ``shown`` its (H, W) bool pixels of the scene."""

    length: int
    image: Callable[[int], Bytes]
    shown: Callable[[int], Bools]


@dataclass(frozen=True)
class Track:
    """An instance of a level, an index into ``options.LEVELS``, as it was first found.

    Attributes:
        first_frame: the frame whose prompts found it.
        predicted_iou, stability: scores of its first mask.
        moving: tracked because the transient network says that it moves.
    """

    level: int
    first_frame: int
    predicted_iou: float
    stability: float
    moving: bool = False


def pack(labels: Ints32) -> Tensor:
    """Compress int32 label maps to a uint8 tensor."""
    # They have long runs of one value: level 1, the fastest, already reduces them to about 1 %.
    return torch.frombuffer(bytearray(zlib.compress(labels.astype(np.int32).tobytes(), 1)), dtype=torch.uint8)


def unpack(packed: Tensor, shape: tuple[int, ...]) -> Ints32:
    """Get back label maps of a shape."""
    return np.frombuffer(zlib.decompress(packed.numpy().tobytes()), np.int32).reshape(shape).copy()


class LabelMaps:
    """(F, L, H, W) int32 labels, compressed in memory; written and read by frame. -1, no label, until written."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        self._frames: dict[int, Tensor] = {}
        # Frames that no file of a checkpoint holds yet, and the number of its files.
        self._changed: set[int] = set()
        self._files = 0

    def __len__(self) -> int:
        return self._shape[0]

    def __setitem__(self, frame: int, labels: Ints32) -> None:
        self._frames[frame] = pack(labels)
        self._changed.add(frame)

    def __getitem__(self, frame: int) -> Ints32:
        packed = self._frames.get(frame)
        return np.full(self._shape[1:], -1, np.int32) if packed is None else unpack(packed, self._shape[1:])

    def save(self, folder: Path) -> int:
        """Write the frames set since the last call, as one more file; returns the number of files."""
        changed = {frame: self._frames[frame] for frame in sorted(self._changed)}
        write_state(folder / f"labels{self._files}", "labels", {"frames": changed})
        self._files, self._changed = self._files + 1, set()
        return self._files

    def load(self, folder: Path, files: int) -> None:
        """Replace the content by that of so many files; OSError or UnusableState if they do not hold it."""
        frames: dict[int, Tensor] = {}
        for number in range(files):
            frames |= read_state(folder / f"labels{number}", "labels")["frames"]
        self._frames, self._files, self._changed = frames, files, set()


@dataclass(frozen=True)
class Segmented:
    """A segmented video, before duplicates are merged and fragments dropped. ``labels`` number the instance
    of each pixel, by frame and level; ``same`` are pairs of numbers that are one object, and ``prompted`` the
    frames in which instances were searched for."""

    labels: LabelMaps
    instances: list[Track]
    same: list[tuple[int, int]]
    prompted: list[int]


def finalize_instances(segmented: Segmented, min_frames: int) -> tuple[Ints32, Ints, int]:
    """Merge instances that are the same object, and drop those seen in fewer than ``min_frames`` frames.
    (count + 1,) int32 new number of each instance, -1 if it is dropped, and -1 last, so that indexing with -1
    gives -1; the (N,) old numbers of the kept instances, in their new order; the number of those merged into
    others."""
    count, frames = len(segmented.instances), len(segmented.labels)
    pairs = np.array(segmented.same, np.int64).reshape(-1, 2)
    # Being the same object is transitive, although overlapping is not.
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(count + 1, count + 1))
    _, component = connected_components(links, directed=False)
    roots = np.unique(component, return_index=True)[1][component][:count]
    seen = np.zeros(count, np.int64)
    for frame in range(frames):
        numbers = np.unique(segmented.labels[frame])
        seen[np.unique(roots[numbers[numbers >= 0]])] += 1
    # A video shorter than ``min_frames`` still has instances.
    kept = np.flatnonzero((roots == np.arange(count)) & (seen >= max(1, min(min_frames, frames))))
    table = np.full(count + 1, -1, np.int32)
    table[kept] = np.arange(len(kept))
    table[:-1] = table[roots]
    return table, kept, count - len(np.unique(roots))


class Overlaps:
    """Overlap between the masks of a level's instances, summed over the frames in which both are visible.

    Attributes:
        pairs: (P,) int64, sorted: the lower number of two that are visible at once, times 2^32, plus the higher one.
        sums: (P, 3) float64 shared pixels, pixels of either, and frames that show both.
    """

    def __init__(self) -> None:
        self.pairs, self.sums = np.zeros(0, np.int64), np.zeros((0, 3))

    def add(self, masks: LevelMasks, others: LevelMasks | None = None) -> None:
        """Add a frame's pairs among the masks of the level; or pairs of one of them and one of ``others``."""
        (ids, mine), (other_ids, its) = masks, others or masks
        first, second = np.array(ids, np.int64)[:, None], np.array(other_ids, np.int64)
        size, other_size = (areas(each).cpu().numpy().astype(np.float64) for each in (mine, its))
        # Only frames in which both are visible count: an occluded object must not lower the IoU.
        both = (size > 0)[:, None] & (other_size > 0) & (first != second if others else first < second)
        shared = intersections(mine, its).cpu().numpy()
        sums = np.stack([shared, size[:, None] + other_size - shared, both], axis=-1)[both]
        pairs = (np.minimum(first, second) * 2**32 + np.maximum(first, second))[both]
        found = np.unique(pairs)
        new = found[np.append(self.pairs, -1)[np.searchsorted(self.pairs, found)] != found]
        place = np.searchsorted(self.pairs, new)
        self.pairs, self.sums = np.insert(self.pairs, place, new), np.insert(self.sums, place, 0.0, axis=0)
        np.add.at(self.sums, np.searchsorted(self.pairs, pairs), sums)

    def same(self, frames: int) -> list[tuple[int, int]]:
        """Pairs of instances whose IoU over their common frames is above ``SAME_IOU``, in a video of ``frames`` frames."""
        shared, either, common = self.sums.T
        alike = (shared / either > SAME_IOU) & (common >= min(MIN_COMMON_FRAMES, frames))
        return [divmod(pair, 2**32) for pair in self.pairs[alike].tolist()]
