"""Draw a scene on one page: frames, annotated evaluation frames, and the trajectory from above."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import hsv_to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import length_unit
from egosplat.drawing import add_name, empty_grid, ground_axes, inner_point, plt, show, split_page
from egosplat.images import evenly_spaced
from egosplat.report.sheets.sheet import sheet

# Maximum number of frames, and of evaluation frames.
PICTURES = 8

COLUMNS = 4

# Height of the page [inches].
HEIGHT = 11.0

# ADT's category of walls, floor and ceiling; it gets no tint and no name, so that the objects are easy to see.
ROOM = "shelter"

# Minimum extent of the view from above [m].
LEAST_EXTENT = 1.0

# Maximum number of named instances in an evaluation frame, the largest first.
LABELS = 10

# Minimum share of the image of a named instance.
LEAST_SHARE = 0.002


@sheet(warned=("frames", "poses"), fontsize=14)
def run(frames: Artifact, annotations: Artifact, poses: Artifact) -> tuple[Figure, str]:
    """Draw the contact sheet of a scene."""
    shown = evenly_spaced(frames.shape("rgb")[0], PICTURES)
    rows = evenly_spaced(annotations.shape("frame")[0], PICTURES)
    columns = min(COLUMNS, max(len(shown), len(rows)))
    above, below = (math.ceil(len(part) / columns) for part in (shown, rows))
    _, height, width, _ = frames.shape("rgb")
    cell = (HEIGHT - 0.8) / (above + below) - 0.3
    # The images fill the page's height, within limits.
    widths = (HEIGHT * 0.72, float(np.clip(columns * cell * width / height, 6.0, 16.0)))
    figure = plt.figure(figsize=(sum(widths), HEIGHT), layout="constrained")
    left, right = split_page(figure, 1, 2, width_ratios=widths)
    draw_from_above(left.subplots(), poses)
    grid = empty_grid(right, above + below, columns)
    times = frames.read("timestamp_ns")
    for cell, index in zip(grid[:above].flat, shown, strict=False):
        show(cell, frames.row("rgb", index), f"frame {index}, {(times[index] - times[0]) * 1e-9:.1f} s")
    _draw_evaluation_frames(grid[above:], frames, annotations, rows)
    return figure, _summary(frames, annotations, poses)


def _summary(frames: Artifact, annotations: Artifact, poses: Artifact) -> str:
    count, height, width, _ = frames.shape("rgb")
    seconds = float(np.ptp(frames.read("timestamp_ns"))) * 1e-9
    return (
        f"{frames.facts['recording']}, origin {frames.origin}\n"
        f"{count} frames {width}×{height} in {seconds:.1f} s: "
        f"{int(frames.read('train').sum())} for training, {int(frames.read('evaluation').sum())} for evaluation, "
        f"{int(poses.read('registered').sum())} with a pose; {len(annotations.facts['instances'])} instances"
    )


def draw_from_above(axes: Axes, poses: Artifact) -> None:
    """Draw points, trajectory and viewing directions of the poses artifact, seen from above."""
    up, registered = poses.read("up"), poses.read("registered")
    camera_to_world = poses.read("camera_to_world")[registered]
    plane = ground_axes(up)
    path = camera_to_world[:, :3, 3] @ plane.T
    # Above the highest camera is the ceiling, which would hide the room.
    highest = (camera_to_world[:, :3, 3] @ up).max()
    points = _scatter_points(axes, poses.read("points/xyz"), plane, up, highest)
    segments = np.stack([path[:-1], path[1:]], axis=1)
    line = LineCollection(list(segments), cmap="plasma", linewidths=2.2, zorder=3)
    line.set_array(np.linspace(0, 1, len(segments)))
    axes.add_collection(line)
    directions = camera_to_world[:, :3, 2] @ plane.T
    step = max(1, len(path) // 40)
    axes.quiver(*path[::step].T, *directions[::step].T, scale=28, width=0.0025, color="0.15", zorder=4)
    axes.scatter(*path[0], s=70, c="limegreen", edgecolors="k", zorder=5, label="start")
    axes.scatter(*path[-1], s=70, c="crimson", edgecolors="k", zorder=5, label="end")
    unit = length_unit(poses)
    if unit == "m":
        # Otherwise millimeters of noise in the poses fill the page like a real trajectory.
        for get, set_ in ((axes.get_xlim, axes.set_xlim), (axes.get_ylim, axes.set_ylim)):
            low, high = get()
            if high - low < LEAST_EXTENT:
                set_((low + high - LEAST_EXTENT) / 2, (low + high + LEAST_EXTENT) / 2)
    title = "From above: the points, and the trajectory from dark to light"
    axes.set(aspect="equal", title=title, xlabel=unit, ylabel=unit)
    if points is not None:
        bar = {"location": "bottom", "shrink": 0.6, "aspect": 40}
        axes.figure.colorbar(points, ax=axes, label=f"height of a point [{unit}]", **bar)
    axes.legend(loc="upper right")
    axes.grid(alpha=0.2)


def _scatter_points(
    axes: Axes, points: NDArray[np.float64], plane: NDArray[np.float64], up: NDArray[np.float64], below: float
) -> PathCollection | None:
    """Draw the points below a height; returns None if there are none."""
    points = points[points @ up < below]
    if len(points) > 60_000:
        points = points[:: len(points) // 60_000 + 1]
    if not len(points):
        return None
    flat, height = points @ plane.T, points @ up
    low, high = np.percentile(flat, [0.5, 99.5], axis=0)
    inside = ((flat >= low) & (flat <= high)).all(axis=1)
    return axes.scatter(
        *flat[inside].T,
        c=height[inside],
        s=float(np.clip(2e4 / len(flat), 1.2, 8)),
        cmap="viridis",
        linewidths=0,
        rasterized=True,
    )


def _draw_evaluation_frames(
    cells: NDArray[Any], frames: Artifact, annotations: Artifact, rows: list[int]
) -> None:
    names = [instance["category"] for instance in annotations.facts["instances"]]
    index, annotated = annotations.read("frame"), annotations.read("annotated")
    for cell, row in zip(cells.flat, rows, strict=False):
        image, title = frames.row("rgb", index[row]), f"evaluation frame {index[row]}"
        if annotated[row]:
            count = _draw_annotated(cell, image, annotations.row("instance_map", row), names)
            cell.set_title(f"{title}: {count} instances", fontsize=8)
        else:
            show(cell, image, f"{title}: not annotated", 8)


def _draw_annotated(
    cell: Axes, image: NDArray[np.uint8], instance_map: NDArray[np.int32], names: list[str]
) -> int:
    """Draw an image with tinted and named instances; return the number of visible instances."""
    rooms = [index for index, name in enumerate(names) if name == ROOM]
    cell.imshow(overlay(image, np.where(np.isin(instance_map, rooms), -1, instance_map)))
    values, sizes = np.unique(instance_map[instance_map >= 0], return_counts=True)
    objects = [value for value in values[np.argsort(-sizes, kind="stable")] if value not in rooms]
    for value in objects[:LABELS]:
        mask = instance_map == value
        if mask.mean() >= LEAST_SHARE:
            add_name(cell, *inner_point(mask), names[value])
    return len(values)


def overlay(picture: NDArray[np.uint8], instance_map: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Tint an (H, W, 3) uint8 image by instance; pixels without one, -1 in the (H, W) int32 map, keep their color."""
    # Golden-angle hues: neighboring indices get very different colors.
    hue = (np.arange(instance_map.max() + 2) * 0.618034) % 1.0
    colors = hsv_to_rgb(np.stack([hue, np.full_like(hue, 0.75), np.ones_like(hue)], axis=-1)) * 255
    tinted = 0.6 * picture + 0.4 * colors[instance_map]
    return np.where((instance_map >= 0)[..., None], tinted, picture).astype(np.uint8)
