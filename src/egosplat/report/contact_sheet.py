"""A scene on one page: its pictures, the annotations of its evaluation frames, and the walk from above."""

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import hsv_to_rgb
from numpy.typing import NDArray

from egosplat.alarms.artifact_alarms import warnings_of
from egosplat.artifacts.annotations import ANNOTATIONS
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.output_files import check_output, picture_kind
from egosplat.report.figure import draw_heading, evenly_spaced, plt, save_figure
from egosplat.report.page_text import add_name

PAGE = picture_kind("egosplat contact-sheet")

PICTURES = 8
"""At most so many pictures, and as many annotated evaluation frames."""

COLUMNS = 4

HEIGHT = 11.0
"""Of the page, in inches."""

ROOM = "shelter"
"""ADT's category of walls, floor and ceiling; left untinted and without a name, so that the things in it stand out."""

LEAST_EXTENT = 1.0
"""Metres that the view from above shows at least."""

LABELS = 10
"""At most so many of an evaluation frame's instances are named in the picture, the largest first."""

LEAST_SHARE = 0.002
"""Of the picture, that an instance must cover to be named."""


def run(frames: Path, annotations: Path, poses: Path, output: Path, *, title: str) -> None:
    """Draw the contact sheet of a scene as PNG; the file appears when it is complete."""
    check_output(output, PAGE)
    pictures, labels, walk = (
        open_artifact(path, schema)
        for path, schema in ((frames, FRAMES), (annotations, ANNOTATIONS), (poses, POSES))
    )
    shown = evenly_spaced(pictures.shape("rgb")[0], PICTURES)
    rows = evenly_spaced(labels.shape("frame")[0], PICTURES)
    columns = min(COLUMNS, max(len(shown), len(rows)))
    above, below = (math.ceil(len(part) / columns) for part in (shown, rows))
    widths = (HEIGHT * 0.72, _grid_width(pictures, columns, above + below))
    figure = plt.figure(figsize=(sum(widths), HEIGHT), layout="constrained")
    draw_heading(figure, f"{title}: {_summary(pictures, labels, walk)}", warnings_of(pictures, walk), 14)
    left, right = figure.subfigures(1, 2, width_ratios=widths)
    draw_from_above(left.subplots(), walk)
    grid = right.subplots(above + below, columns, squeeze=False)
    for cell in grid.flat:
        cell.set_axis_off()
    _draw_pictures(grid[:above], pictures, shown)
    _draw_annotated_pictures(grid[above:], pictures, labels, rows)
    save_figure(figure, output, PAGE)


def _grid_width(pictures: Artifact, columns: int, rows: int) -> float:
    """Inches that ``rows`` of pictures need in width to fill the page's height, within reason."""
    _, height, width, _ = pictures.shape("rgb")
    cell = (HEIGHT - 0.8) / rows - 0.3
    return float(np.clip(columns * cell * width / height, 6.0, 16.0))


def _summary(pictures: Artifact, labels: Artifact, walk: Artifact) -> str:
    count, height, width, _ = pictures.shape("rgb")
    seconds = float(np.ptp(pictures.read("timestamp_ns"))) * 1e-9
    return (
        f"{pictures.facts['recording']}, origin {pictures.origin}\n"
        f"{count} frames {width}×{height} in {seconds:.1f} s: "
        f"{int(pictures.read('train').sum())} to train, {int(pictures.read('evaluation').sum())} to evaluate, "
        f"{int(walk.read('registered').sum())} with a pose; {len(labels.facts['instances'])} instances"
    )


def ground_axes(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Two unit vectors that span the plane across ``up``.

    Args:
        up: (3,) float64 unit vector.

    Returns:
        (2, 3) float64; seen from above, the first points right and the second up the page.
    """
    # The world axis that is least parallel to up makes the best-conditioned cross product.
    helper = np.eye(3)[np.argmin(np.abs(up))]
    right = np.cross(helper, up)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(up, right)])


def draw_from_above(axes: Axes, walk: Artifact) -> None:
    """Draw points, trajectory and viewing directions, seen against ``up``."""
    up, registered = walk.read("up"), walk.read("registered")
    poses = walk.read("camera_to_world")[registered]
    plane = ground_axes(up)
    path = poses[:, :3, 3] @ plane.T
    _scatter_points(axes, walk, plane, up, heights=poses[:, :3, 3] @ up)
    segments = np.stack([path[:-1], path[1:]], axis=1)
    line = LineCollection(list(segments), cmap="plasma", linewidths=2.2, zorder=3)
    line.set_array(np.linspace(0, 1, len(segments)))
    axes.add_collection(line)
    looking = poses[:, :3, 2] @ plane.T
    step = max(1, len(path) // 40)
    axes.quiver(*path[::step].T, *looking[::step].T, scale=28, width=0.0025, color="0.15", zorder=4)
    axes.scatter(*path[0], s=70, c="limegreen", edgecolors="k", zorder=5, label="start")
    axes.scatter(*path[-1], s=70, c="crimson", edgecolors="k", zorder=5, label="end")
    _widen(axes, LEAST_EXTENT)
    unit = "arbitrary unit" if walk.facts["notes"].get("scale") == "arbitrary" else "m"
    axes.set(aspect="equal", title="From above: points by height, the walk by time", xlabel=unit, ylabel=unit)
    axes.legend(loc="upper right")
    axes.grid(alpha=0.2)


def _widen(axes: Axes, least: float) -> None:
    """Let each axis show at least so much: a walk of a few millimetres is not to look like one."""
    for get, set_ in ((axes.get_xlim, axes.set_xlim), (axes.get_ylim, axes.set_ylim)):
        low, high = get()
        if high - low < least:
            set_((low + high - least) / 2, (low + high + least) / 2)


def _scatter_points(
    axes: Axes,
    walk: Artifact,
    plane: NDArray[np.float64],
    up: NDArray[np.float64],
    heights: NDArray[np.float64],
) -> None:
    points = walk.read("points/xyz")
    # The ceiling would hide the room.
    points = points[points @ up < heights.max()]
    if len(points) > 60_000:
        points = points[:: len(points) // 60_000 + 1]
    if not len(points):
        return
    flat, height = points @ plane.T, points @ up
    low, high = np.percentile(flat, [0.5, 99.5], axis=0)
    inside = ((flat >= low) & (flat <= high)).all(axis=1)
    axes.scatter(
        *flat[inside].T,
        c=height[inside],
        s=float(np.clip(2e4 / len(flat), 1.2, 8)),
        cmap="viridis",
        linewidths=0,
        rasterized=True,
    )


def _draw_pictures(cells: NDArray[np.object_], pictures: Artifact, shown: list[int]) -> None:
    times = pictures.read("timestamp_ns")
    for cell, index in zip(cells.flat, shown, strict=False):
        cell.imshow(pictures.row("rgb", index))
        cell.set_title(f"frame {index}, {(times[index] - times[0]) * 1e-9:.1f} s", fontsize=9)


def _draw_annotated_pictures(
    cells: NDArray[np.object_], pictures: Artifact, labels: Artifact, rows: list[int]
) -> None:
    names = [instance["category"] for instance in labels.facts["instances"]]
    frames, annotated = labels.read("frame"), labels.read("annotated")
    for cell, row in zip(cells.flat, rows, strict=False):
        picture, title = pictures.row("rgb", frames[row]), f"evaluated, frame {frames[row]}"
        if annotated[row]:
            seen = _draw_annotated(cell, picture, labels.row("instance_map", row), names)
            cell.set_title(f"{title}: {seen} instances", fontsize=8)
        else:
            cell.imshow(picture)
            cell.set_title(f"{title}: not annotated", fontsize=8)


def _draw_annotated(
    cell: Axes, picture: NDArray[np.uint8], instance_map: NDArray[np.int32], names: list[str]
) -> int:
    """Draw the tinted and labelled picture; give back how many instances are seen in it."""
    rooms = [index for index, name in enumerate(names) if name == ROOM]
    cell.imshow(overlay(picture, np.where(np.isin(instance_map, rooms), -1, instance_map)))
    values, sizes = np.unique(instance_map[instance_map >= 0], return_counts=True)
    things = [value for value in values[np.argsort(-sizes, kind="stable")] if value not in rooms]
    for value in things[:LABELS]:
        mask = instance_map == value
        if mask.mean() >= LEAST_SHARE:
            v, u = _inner_point(mask)
            add_name(cell, u, v, names[value])
    return len(values)


def overlay(picture: NDArray[np.uint8], instance_map: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Tint a picture by instance.

    Args:
        picture: (H, W, 3) uint8.
        instance_map: (H, W) int32, -1 where nothing is annotated.

    Returns:
        (H, W, 3) uint8; unannotated pixels keep their colour.
    """
    # Golden-angle hues: neighbouring indices get colours far apart.
    hue = (np.arange(instance_map.max() + 2) * 0.618034) % 1.0
    colours = hsv_to_rgb(np.stack([hue, np.full_like(hue, 0.75), np.ones_like(hue)], axis=-1)) * 255
    tinted = 0.6 * picture + 0.4 * colours[instance_map]
    return np.where((instance_map >= 0)[..., None], tinted, picture).astype(np.uint8)


def _inner_point(mask: NDArray[np.bool_]) -> tuple[int, int]:
    """Row and column of the mask's pixel that is nearest to its median: always inside."""
    rows, columns = np.nonzero(mask)
    middle = np.argmin((rows - np.median(rows)) ** 2 + (columns - np.median(columns)) ** 2)
    return int(rows[middle]), int(columns[middle])
