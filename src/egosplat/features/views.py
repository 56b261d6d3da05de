"""Select the views of instances to encode, and cut their crops."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.frames import lies_on_its_side
from egosplat.artifacts.reader import Artifact
from egosplat.features.crops import Regions, cut_crop, find_regions, resize
from egosplat.models.open_clip_loader import Preprocessing
from egosplat.progress import track

Ints = NDArray[np.int32]


@dataclass(frozen=True)
class InstanceViews:
    """R views, sorted by instance, then frame.

    Attributes:
        instance, frame, area: (R,) int32.
        box: (R, 4) int32 x0, y0, x1, y1 [px].
    """

    instance: Ints
    frame: Ints
    area: Ints
    box: Ints

    def __len__(self) -> int:
        return len(self.instance)

    def chosen(self, which: NDArray) -> "InstanceViews":
        """Select views by a mask or row indices."""
        return InstanceViews(self.instance[which], self.frame[which], self.area[which], self.box[which])

    @property
    def by_frame(self) -> NDArray[np.int64]:
        """(R,) row order by frame, then instance: the order of encoding."""
        return np.lexsort((self.instance, self.frame))


def find_views(frames: Artifact, segments: Artifact, min_area: float, max_views: int | None) -> InstanceViews:
    """Find the views to encode.

    Args:
        min_area: smallest mask as a fraction of the image; at least one pixel.
        max_views: largest number of views per instance, evenly spaced; None for all.
    """
    count = segments.shape("instances/level")[0]
    _, _, height, width = segments.shape("labels")
    least = max(1.0, min_area * height * width)
    # Training frames only: evaluation frames must not influence the result.
    chosen = np.flatnonzero(frames.read("train"))
    found: list[Regions] = []
    for frame in track(chosen, "finding instances"):
        regions = find_regions(segments.row("labels", frame), count)
        found.append(regions.chosen(regions.area >= least))
    views = InstanceViews(
        _joined([one.instance for one in found]),
        np.repeat(chosen, [len(one.instance) for one in found]).astype(np.int32),
        _joined([one.area for one in found]),
        _joined([one.box for one in found]).reshape(-1, 4),
    )
    views = views.chosen(np.lexsort((views.frame, views.instance)))
    return views if max_views is None else views.chosen(spread(views.instance, max_views))


def spread(instance: Ints, most: int) -> NDArray[np.bool_]:
    """(R,) bool: at most ``most`` evenly spaced rows per instance, always including the first.

    Args:
        instance: (R,) sorted.
        most: at least 1.
    """
    _, first, counts = np.unique(instance, return_index=True, return_counts=True)
    place = np.arange(len(instance)) - np.repeat(first, counts)
    total = np.repeat(np.maximum(counts, most), counts)
    # A row is kept where place * most / total reaches the next integer.
    return place * most // total != (place - 1) * most // total


def cut_crops(
    frames: Artifact, segments: Artifact, views: InstanceViews, wanted: Preprocessing
) -> Iterator[NDArray[np.uint8]]:
    """Yield the upright (H, W, 3) uint8 crop of each view at the model's size; holds one frame at a time.

    Args:
        views: in the order ``by_frame``.
    """
    level = segments.read("instances/level")
    turned = lies_on_its_side(frames)
    at = -1
    for frame, instance, box in zip(views.frame, views.instance, views.box, strict=True):
        if frame != at:
            rgb, labels, at = frames.row("rgb", frame), segments.row("labels", frame), frame
        crop = cut_crop(rgb, labels[level[instance]], instance, box)
        yield resize(np.rot90(crop, -1) if turned else crop, wanted.image_size, wanted.interpolation)


def _joined(parts: list[Ints]) -> Ints:
    return np.concatenate(parts) if parts else np.zeros(0, np.int32)
