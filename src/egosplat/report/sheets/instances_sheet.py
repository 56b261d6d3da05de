"""Draw the instances on one page: in frames of the video, from above, and crops before and after merging."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.drawing import ground_axes, hide_axes, plt, show
from egosplat.images import evenly_spaced
from egosplat.report.sheets.from_above import below_cameras, palette
from egosplat.report.sheets.sheet import sheet

# Maximum number of frames, evenly spaced.
PICTURES = 6

# Width of an image on the page [inches].
CELL = 2.9

# Height of a crop relative to that of an image.
CROP = 0.6

# Opacity of an instance's color.
TINT = 0.55


@sheet(warned=("instances",))
def run(frames: Artifact, poses: Artifact, segments: Artifact, instances: Artifact) -> tuple[Figure, str]:
    """Draw the instances in frames, from above, and crops before and after merging."""
    count, height, width, _ = frames.shape("rgb")
    shown = evenly_spaced(count, PICTURES)
    levels = instances.facts["levels"]
    in_3d = instances.shape("gaussians/xyz")[0] > 0
    columns = len(shown) + in_3d
    # Tracks are what they were before.
    seen = shown_in(segments, instances) if in_3d else {}
    cropped = largest_and_most_changed(instances, seen) if in_3d else []
    heights = [1.0] * (1 + len(levels)) + [CROP] * (2 * len(cropped))
    size = (CELL * columns, sum(CELL * height / width * part + 0.25 for part in heights) + 0.9)
    figure, grid = plt.subplots(
        len(heights), columns, squeeze=False, figsize=size, layout="constrained", height_ratios=heights
    )
    colors = palette(instances.shape("instances/level")[0])
    for column, frame in enumerate(shown):
        image, labels = frames.row("rgb", frame), instances.row("labels", frame)
        show(grid[0, column], image, f"frame {frame}")
        for level, name in enumerate(levels):
            visible = len(np.unique(labels[level][labels[level] >= 0]))
            tint = tinted(image, labels[level], colors)
            show(grid[1 + level, column], tint, f"{name}: {visible} instances")
    if in_3d:
        _draw_from_above(grid[: 1 + len(levels), -1], poses, instances, colors)
    for place, instance in enumerate(cropped):
        rows = grid[1 + len(levels) + 2 * place :][:2]
        hide_axes(rows[0, -1]), hide_axes(rows[1, -1])
        draw_merged_crops(rows[:, :-1], frames, segments, instances, instance, seen)
    return figure, _summary(instances)


def _summary(instances: Artifact) -> str:
    facts = instances.facts
    by_level = ", ".join(f"{number} {name}s" for name, number in facts["instances"].items())
    made = "tracks" if facts["source"] == "tracks" else "masks merged in 3D"
    return f"{by_level} ({made}), origin {instances.origin}\nan instance has the same color everywhere"


def _draw_from_above(
    cells: NDArray[Any], poses: Artifact, instances: Artifact, colors: NDArray[np.float64]
) -> None:
    """Draw the Gaussians of each level's instances from above, without what is higher than the cameras."""
    up = poses.read("up")
    plane, xyz = ground_axes(up), instances.read("gaussians/xyz").astype(np.float64)
    owner, height, inside = instances.read("gaussians/instance"), xyz @ up, below_cameras(poses, xyz)
    hide_axes(cells[0])
    for level, name in enumerate(instances.facts["levels"]):
        drawn = np.flatnonzero(inside & (owner[:, level] >= 0))
        drawn = drawn[np.argsort(height[drawn], kind="stable")]
        cell = cells[1 + level]
        cell.scatter(*(xyz[drawn] @ plane.T).T, s=0.6, c=colors[owner[drawn, level]], linewidths=0)
        cell.set(aspect="equal", xticks=[], yticks=[])
        cell.set_title(f"{name}: from above", fontsize=9)


def tinted(
    picture: NDArray[np.uint8], labels: NDArray[np.int32], colors: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Tint and outline the instances of an (H, W, 3) uint8 image, (H, W) labels, -1 for none; the rest is gray.

    Args:
        colors: (N, 3) in 0..1, as the (H, W, 3) float64 result.
    """
    light = picture / 255.0
    gray = np.repeat(light.mean(axis=2, keepdims=True), 3, axis=2)
    if not len(colors):
        return 0.6 * gray
    tint = (1 - TINT) * gray + TINT * colors[np.maximum(labels, 0)]
    shown = np.where((labels >= 0)[..., None], tint, 0.6 * gray)
    # Pixels whose right or lower neighbor has another label.
    shown[:, :-1][labels[:, :-1] != labels[:, 1:]] = 1.0
    shown[:-1][labels[:-1] != labels[1:]] = 1.0
    return shown


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
    """The largest instance of the coarsest level, if any, and of the next ones that whose masks were changed most."""
    owner = instances.read("gaussians/instance")[:, -1]
    counts = np.bincount(owner[owner >= 0])
    largest = [int(one) for one in np.argsort(-counts, kind="stable")[:_LARGEST] if counts[one]]
    if len(largest) < 2:
        return largest
    kept = {instance: np.mean([*ious.values()]) for instance, ious in shown.items()}
    return [largest[0], min(largest[1:], key=lambda one: kept.get(one, 1.0))]


def draw_merged_crops(
    cells: NDArray[Any],
    frames: Artifact,
    segments: Artifact,
    instances: Artifact,
    instance: int,
    shown: Shown,
) -> None:
    """Draw crops of a merged instance of the coarsest level in frames through the video, in (2, C) axes.

    Above, the mask of segments.zarr that holds most of the instance; below, the instance.
    """
    for cell in cells.flat:
        hide_axes(cell)
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
