"""Draw crops of instances before and after masks were merged in 3D."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.drawing import show
from egosplat.images import evenly_spaced

# Gray level around a crop's mask, 0..1.
_BACKGROUND = 0.12

# Frames that are searched for an instance, and least share of a frame's pixels that it must cover to be shown.
_SEARCHED = 60
_LEAST_SHARE = 0.01

# Instances, the largest, from which the most changed one is chosen.
_LARGEST = 12


# By instance of the coarsest level: the frames that show enough of it, each with the IoU of the instance and the mask of
# segments.zarr that holds most of it.
Shown = Mapping[int, Mapping[int, float]]


def shown_in(segments: Artifact, instances: Artifact) -> Shown:
    """Search frames through the video for the instances of the coarsest level, some of each in masks of segments.zarr."""
    prompted = np.unique(segments.read("instances/first_frame"))
    found: dict[int, dict[int, float]] = {}
    for frame in prompted[evenly_spaced(len(prompted), _SEARCHED)].tolist():
        before, after = _labels(segments, instances, frame)
        sizes = np.bincount(before[before >= 0], minlength=1)
        for instance, count in zip(*np.unique(after[after >= 0], return_counts=True), strict=True):
            within = before[(after == instance) & (before >= 0)]
            if count >= _LEAST_SHARE * after.size and len(within):
                common = np.bincount(within)
                mask = int(common.argmax())
                iou = common[mask] / (count + sizes[mask] - common[mask])
                found.setdefault(int(instance), {})[frame] = float(iou)
    return found


def largest_and_most_changed(instances: Artifact, shown: Shown) -> list[int]:
    """The largest instance of the coarsest level, and of the next largest ones that whose masks were changed most.

    Returns:
        Two instances; fewer if there are not as many.
    """
    owner = instances.read("gaussians/instance")[:, -1]
    counts = np.bincount(owner[owner >= 0])
    largest = [int(one) for one in np.argsort(-counts, kind="stable")[:_LARGEST] if counts[one]]
    if len(largest) < 2:
        return largest
    kept = {instance: np.mean([*ious.values()]) for instance, ious in shown.items()}
    return [largest[0], min(largest[1:], key=lambda one: kept.get(one, 1.0))]


def draw_merged_crops(
    cells: NDArray[np.object_],
    frames: Artifact,
    segments: Artifact,
    instances: Artifact,
    instance: int,
    shown: Shown,
) -> None:
    """Draw crops of one instance in frames through the video.

    Args:
        cells: (2, C) axes. Above, the mask of segments.zarr that holds most of the instance; below, the instance.
        frames, segments, instances: artifacts.
        instance: number of a merged instance of the coarsest level.
        shown: of ``shown_in``.
    """
    for cell in cells.flat:
        cell.set_axis_off()
    merged = int(instances.read("instances/masks")[instance])
    count_of_masks = "1 mask" if merged == 1 else f"{merged} masks"
    chosen = [*shown.get(instance, ())]
    for column, place in enumerate(evenly_spaced(len(chosen), cells.shape[1])):
        frame = chosen[place]
        rgb, before, after = frames.row("rgb", frame), *_labels(segments, instances, frame)
        mask = int(np.bincount(before[(after == instance) & (before >= 0)]).argmax())
        _draw(cells[0, column], rgb, before == mask, f"frame {frame}: mask {mask} of segments.zarr")
        _draw(cells[1, column], rgb, after == instance, f"instance {instance}, merged from {count_of_masks}")


def _labels(
    segments: Artifact, instances: Artifact, frame: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """(H, W) labels of the coarsest level, of segments and of instances."""
    return segments.row("labels", frame)[-1], instances.row("labels", frame)[-1]


def _draw(cell: Axes, rgb: NDArray[np.uint8], mask: NDArray[np.bool_], title: str) -> None:
    rows, columns = np.nonzero(mask)
    box = slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)
    show(cell, np.where(mask[box][..., None], rgb[box], np.uint8(255 * _BACKGROUND)), title)
