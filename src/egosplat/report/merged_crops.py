"""Draw crops of instances before and after masks were merged in 3D."""

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.report.figure import show
from egosplat.sampling import evenly_spaced

# Grey level around a crop's mask, 0..1.
_BACKGROUND = 0.12

# Frames that are searched for an instance, and least share of a frame's pixels that it must cover to be shown.
_SEARCHED = 60
_LEAST_SHARE = 0.01

# Instances, the largest, from which the most changed one is chosen.
_LARGEST = 12


def largest_and_most_changed(segments: Artifact, instances: Artifact) -> list[int]:
    """The largest instance of the coarsest level, and of the next largest ones that whose masks were changed most.

    Returns:
        Two instances; fewer if there are not as many.
    """
    owner = instances.read("gaussians/instance")[:, -1]
    counts = np.bincount(owner[owner >= 0])
    largest = [int(one) for one in np.argsort(-counts, kind="stable")[:_LARGEST] if counts[one]]
    if len(largest) < 2:
        return largest
    kept = _kept(segments, instances)
    return [largest[0], min(largest[1:], key=lambda one: kept.get(one, 1.0))]


def _kept(segments: Artifact, instances: Artifact) -> dict[int, float]:
    """Mean IoU of each instance, in frames that show enough of it, with the mask that holds most of it."""
    prompted = np.unique(segments.read("instances/first_frame"))
    found: dict[int, list[float]] = {}
    for frame in prompted[evenly_spaced(len(prompted), _SEARCHED)].tolist():
        before, after = _labels(segments, instances, frame)
        sizes = np.bincount(before[before >= 0], minlength=1)
        for instance, count in zip(*np.unique(after[after >= 0], return_counts=True), strict=True):
            within = before[(after == instance) & (before >= 0)]
            if count >= _LEAST_SHARE * after.size and len(within):
                common = np.bincount(within)
                mask = int(common.argmax())
                iou = common[mask] / (count + sizes[mask] - common[mask])
                found.setdefault(int(instance), []).append(float(iou))
    return {instance: float(np.mean(values)) for instance, values in found.items()}


def draw_merged_crops(
    cells: NDArray[np.object_], frames: Artifact, segments: Artifact, instances: Artifact, instance: int
) -> None:
    """Draw crops of one instance in frames through the video.

    Args:
        cells: (2, C) axes. Above, the mask of segments.zarr that holds most of the instance; below, the instance.
        frames, segments, instances: artifacts.
        instance: number of a merged instance of the coarsest level.
    """
    for cell in cells.flat:
        cell.set_axis_off()
    merged = int(instances.read("instances/masks")[instance])
    chosen = _frames_with_both(segments, instances, instance)
    for column, place in enumerate(evenly_spaced(len(chosen), cells.shape[1])):
        frame = chosen[place]
        rgb, before, after = frames.row("rgb", frame), *_labels(segments, instances, frame)
        mask = int(np.bincount(before[(after == instance) & (before >= 0)]).argmax())
        _draw(cells[0, column], rgb, before == mask, f"frame {frame}: mask {mask} of segments.zarr")
        _draw(cells[1, column], rgb, after == instance, f"instance {instance}, merged from {merged} masks")


def _frames_with_both(segments: Artifact, instances: Artifact, instance: int) -> list[int]:
    """Frames that show enough of the instance, some of it in masks of segments.zarr."""
    found = []
    prompted = np.unique(segments.read("instances/first_frame"))
    for frame in prompted[evenly_spaced(len(prompted), _SEARCHED)].tolist():
        before, after = _labels(segments, instances, frame)
        shown = after == instance
        if shown.mean() >= _LEAST_SHARE and (before[shown] >= 0).any():
            found.append(frame)
    return found


def _labels(
    segments: Artifact, instances: Artifact, frame: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """(H, W) labels of the coarsest level, of segments and of instances."""
    return segments.row("labels", frame)[-1], instances.row("labels", frame)[-1]


def _draw(cell: Axes, rgb: NDArray[np.uint8], mask: NDArray[np.bool_], title: str) -> None:
    rows, columns = np.nonzero(mask)
    box = slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)
    show(cell, np.where(mask[box][..., None], rgb[box], np.uint8(255 * _BACKGROUND)), title)
