"""Regions that the transient network is sure of for several frames: something moves there, whatever the tracks say."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from egosplat.arrays import Array, Bools, Ints32
from egosplat.images import resize_labels, shrunk_size
from egosplat.moving_regions import Region, large_regions, lasting_regions, meetings
from egosplat.progress import track

Link = tuple[Region, Region]
Look = Callable[[int], Ints32]
"""Finds the regions of a frame, see ``find_regions``; those of all frames of an hour do not fit into memory."""

# Regions are found at this longer side [px]: the network sees no more.
_SIDE = 256

# Least share of the picture that a region covers. Of smaller ones most are wrong (docs/method.md#sure-regions).
_MIN_AREA = 0.01

# Least share of a region's pixels that stand out, and where instances that stand still have more than ``_EXPLAINED`` of it.
_STANDS_OUT, _STANDS_OUT_THOUGH_EXPLAINED, _EXPLAINED = 0.7, 0.8, 0.8

# A single frame without the region does not end it.
_MOST_APART = 2


def find_regions(sure: Bools, explained: Bools, outstanding: Bools | None) -> Ints32:
    """Number the regions of one frame from 1, at a longer side of ``_SIDE``; 0 elsewhere. (H, W) pixels that
    the network is ``sure`` of, of instances that stand still, which ``explained`` them, and that stand out
    from the Gaussians of the warm-up, None if that was not measured."""
    labels = large_regions(_shrink(sure))
    area = np.bincount(labels.ravel())

    def share(mask: Bools) -> Array:
        return np.bincount(labels[_shrink(mask)], minlength=len(area)) / np.maximum(area, 1)

    is_explained = share(explained) > _EXPLAINED
    if outstanding is None:
        kept = ~is_explained
    else:
        kept = share(outstanding) >= np.where(is_explained, _STANDS_OUT_THOUGH_EXPLAINED, _STANDS_OUT)
    kept &= area >= _MIN_AREA * labels.size
    kept[0] = False
    return np.where(kept[labels], labels, 0)


def link_regions(look: Look, rows: list[int]) -> list[Link]:
    """Link the regions of the frames ``rows`` that overlap, each to the row before or, if it meets none there, to the one before that."""
    links: list[Link] = []
    for position, frame in enumerate(track(rows, "finding regions")):
        met: set[int] = set()
        for before in reversed(rows[max(position - _MOST_APART, 0) : position]):
            pairs = [pair for pair in meetings(look(before), look(frame)) if pair[1] not in met]
            links += [((before, one), (frame, other)) for one, other in pairs]
            met |= {other for _, other in pairs}
    return links


@dataclass(frozen=True)
class RegionMasks:
    """What moves in each frame: its own lasting regions, and those of the frames before and after a gap.

    Attributes:
        look: finds the regions of a frame again.
        own: by frame, the numbers of its regions.
        gaps: by frame, for each region that is seen before and after it, the regions there.
    """

    look: Look
    own: Mapping[int, list[int]]
    gaps: Mapping[int, list[Link]]

    def mask(self, frame: int, sure: Bools, marked: Bools) -> Bools:
        """(H, W) moving pixels of a frame, among those that the network is ``sure`` of, in a gap those that it has ``marked``."""
        found = np.zeros_like(sure)
        if frame in self.own:
            found |= _enlarge(np.isin(self.look(frame), self.own[frame]), sure) & sure
        for link in self.gaps.get(frame, ()):
            before, after = (self.look(row) == number for row, number in link)
            between = _enlarge(before | after, sure) & marked
            # Something that moves does not vanish for a frame.
            found |= between if between.any() else _enlarge(before & after, sure)
        return found


def lasting_masks(look: Look, rows: Iterable[int]) -> RegionMasks:
    """The regions that last for at least three of the frames ``rows``, and the frames between two that show one."""
    links = link_regions(look, sorted(rows))
    lasting = lasting_regions(links)
    own: dict[int, list[int]] = {}
    gaps: dict[int, list[Link]] = {}
    for frame, number in lasting:
        own.setdefault(frame, []).append(number)
    for first, last in links:
        if {first, last} <= lasting:
            for frame in range(first[0] + 1, last[0]):
                gaps.setdefault(frame, []).append((first, last))
    return RegionMasks(look, own, gaps)


def _shrink(mask: Bools) -> Bools:
    return resize_labels(mask, *shrunk_size(mask.shape[1], mask.shape[0], _SIDE))


def _enlarge(mask: Bools, like: Bools) -> Bools:
    return resize_labels(mask, like.shape[1], like.shape[0])
