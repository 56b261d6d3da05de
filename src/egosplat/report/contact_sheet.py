"""A scene on one page: its pictures, the annotations of its evaluation frames, and the walk from above."""

import math
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from egosplat.artifacts.annotations import ANNOTATIONS
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reading import Artifact, open_artifact
from egosplat.atomic import whole_file

PICTURES = 8
"""At most so many pictures, and as many annotated evaluation frames."""

COLUMNS = 4

HEIGHT = 11.0
"""Of the page, in inches."""

ROOM = "shelter"
"""ADT's category of walls, floor and ceiling; left untinted, so that the things in it stand out."""

LEAST_EXTENT = 1.0
"""Metres that the view from above shows at least."""

LABELS = 10
"""At most so many of an evaluation frame's instances are named in the picture, the largest first."""


def run(frames: Path, annotations: Path, poses: Path, output: Path, *, title: str) -> None:
    """Draw the contact sheet of a scene as PNG; the file appears when it is complete."""
    pictures, labels, walk = (
        open_artifact(path, schema)
        for path, schema in ((frames, FRAMES), (annotations, ANNOTATIONS), (poses, POSES))
    )
    shown, rows = _spread(pictures.shape("rgb")[0]), _spread(labels.shape("frame")[0])
    columns = min(COLUMNS, max(len(shown), len(rows)))
    widths = (
        HEIGHT * 0.72,
        _grid_width(pictures, columns, math.ceil(len(shown) / columns) + math.ceil(len(rows) / columns)),
    )
    figure = plt.figure(figsize=(sum(widths), HEIGHT), layout="constrained")
    figure.suptitle(f"{title}: {_summary(pictures, labels, walk)}", fontsize=14)
    left, right = figure.subfigures(1, 2, width_ratios=widths)
    draw_from_above(left.subplots(), walk)
    _draw_pictures(right, pictures, labels, shown, rows, columns)
    with whole_file(output) as scratch:
        figure.savefig(scratch, dpi=90, format="png")
    plt.close(figure)


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
    if not len(points):
        return
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


def _draw_pictures(
    figure: "matplotlib.figure.SubFigure",
    pictures: Artifact,
    labels: Artifact,
    shown: list[int],
    rows: list[int],
    columns: int,
) -> None:
    above, below = (math.ceil(len(part) / columns) for part in (shown, rows))
    grid = figure.subplots(above + below, columns, squeeze=False)
    for cell in grid.flat:
        cell.set_axis_off()
    times = (pictures.read("timestamp_ns") - pictures.read("timestamp_ns")[0]) * 1e-9
    for cell, index in zip(grid[:above].flat, shown, strict=False):
        cell.imshow(pictures.row("rgb", index))
        cell.set_title(f"frame {index}, {times[index]:.1f} s", fontsize=9)
    for cell, row in zip(grid[above:].flat, rows, strict=False):
        _draw_annotated(cell, pictures, labels, row)


def _spread(count: int) -> list[int]:
    """At most ``PICTURES`` indices below ``count``, evenly spread from the first to the last."""
    return np.unique(np.linspace(0, count - 1, min(count, PICTURES)).round().astype(int)).tolist()


def _draw_annotated(cell: Axes, pictures: Artifact, labels: Artifact, row: int) -> None:
    index = int(labels.read("frame")[row])
    picture = pictures.row("rgb", index)
    if not labels.read("annotated")[row]:
        cell.imshow(picture)
        cell.set_title(f"evaluated, frame {index}: not annotated", fontsize=9)
        return
    names = [instance["category"] for instance in labels.facts["instances"]]
    instance_map = labels.row("instance_map", row)
    rooms = [index for index, name in enumerate(names) if name == ROOM]
    cell.imshow(overlay(picture, np.where(np.isin(instance_map, rooms), -1, instance_map)))
    seen = len(np.unique(instance_map[instance_map >= 0]))
    cell.set_title(f"evaluated, frame {index}: {seen} instances", fontsize=9)
    for u, v, name in _label_places(instance_map, names):
        box = {"facecolor": "black", "alpha": 0.55, "pad": 1, "edgecolor": "none"}
        cell.text(u, v, name, color="white", fontsize=7, ha="center", va="center", bbox=box, clip_on=True)


def _label_places(instance_map: NDArray[np.int32], names: list[str]) -> list[tuple[int, int, str]]:
    """Column, row and name of the largest instances, those left out whose label would lie on another's."""
    values, sizes = np.unique(instance_map[instance_map >= 0], return_counts=True)
    height, width = instance_map.shape
    places: list[tuple[int, int, str]] = []
    for value, size in sorted(zip(values, sizes, strict=True), key=lambda pair: -pair[1]):
        v, u = _inner_point(instance_map == value)
        free = all(abs(u - x) > 0.2 * width or abs(v - y) > 0.06 * height for x, y, _ in places)
        if size >= 0.002 * instance_map.size and free and len(places) < LABELS:
            places.append((u, v, names[value]))
    return places


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
    colours = (
        matplotlib.colors.hsv_to_rgb(np.stack([hue, np.full_like(hue, 0.75), np.ones_like(hue)], axis=-1))
        * 255
    )
    tinted = 0.6 * picture + 0.4 * colours[instance_map]
    return np.where((instance_map >= 0)[..., None], tinted, picture).astype(np.uint8)


def _inner_point(mask: NDArray[np.bool_]) -> tuple[int, int]:
    """Row and column of the mask's pixel that is nearest to its median: always inside."""
    rows, columns = np.nonzero(mask)
    middle = np.argmin((rows - np.median(rows)) ** 2 + (columns - np.median(columns)) ** 2)
    return int(rows[middle]), int(columns[middle])
