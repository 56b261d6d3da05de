"""Draw a scene on one page: frames, annotated evaluation frames, and the trajectory from above."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import length_unit, seconds_of
from egosplat.drawing import add_name, empty_grid, plt, show, split_page
from egosplat.geometry import ground_axes
from egosplat.images import evenly_spaced
from egosplat.query.maps import innermost
from egosplat.report.sheets.sheet import POINTS, below_cameras, palette, sheet, tint

# Maximum number of frames, and of evaluation frames, and of pictures in a row.
PICTURES, COLUMNS = 8, 4

# Height of the page [inches].
HEIGHT = 11.0

# ADT's category of walls, floor and ceiling; it gets no tint and no name, so that the objects are easy to see.
ROOM = "shelter"

# Minimum extent of the view from above [m].
LEAST_EXTENT = 1.0

# Maximum number of named instances in an evaluation frame, the largest first, and minimum share of the image of each.
LABELS, LEAST_SHARE = 10, 0.002


@sheet("frames", "poses", fontsize=14)
def run(
    frames: Artifact, annotations: Artifact | None = None, poses: Artifact | None = None
) -> tuple[Figure, str]:
    """Draw frames, annotated evaluation frames, and the trajectory from above; of a scene in the making what is there."""
    count, height, width, _ = frames.shape("rgb")
    shown = evenly_spaced(count, PICTURES)
    rows = [] if annotations is None else evenly_spaced(annotations.shape("frame")[0], PICTURES)
    columns = min(COLUMNS, max(len(shown), len(rows)))
    above, below = (-(-len(pictures) // columns) for pictures in (shown, rows))
    cell = (HEIGHT - 0.8) / (above + below) - 0.3
    # The images fill the page's height, within limits.
    widths = (HEIGHT * 0.72, float(np.clip(columns * cell * width / height, 6.0, 16.0)))
    figure = plt.figure(figsize=(sum(widths), HEIGHT), layout="constrained")
    left, right = split_page(figure, 1, 2, width_ratios=widths)
    if poses is not None:
        _draw_from_above(left.subplots(), poses)
    grid, seconds = empty_grid(right, above + below, columns), seconds_of(frames)
    for axes, index in zip(grid[:above].flat, shown, strict=False):
        show(axes, frames.row("rgb", index), f"frame {index}, {seconds[index]:.1f} s")
    for axes, row in zip(grid[above:].flat, rows, strict=False):
        _draw_evaluation_frame(axes, frames, annotations, row)
    told = f"{int(frames.read('train').sum())} for training, {int(frames.read('evaluation').sum())} for evaluation"
    told += "" if poses is None else f", {int(poses.read('registered').sum())} with a pose"
    told += "" if annotations is None else f"; {len(annotations.facts['instances'])} instances"
    size = f"{count} frames {width}×{height} in {np.ptp(seconds):.1f} s"
    return figure, f"{frames.facts['recording']}, origin {frames.origin}\n{size}: {told}"


def _draw_from_above(axes: Axes, poses: Artifact) -> None:
    """Draw the points, the trajectory and the viewing directions, seen from above."""
    unit, up = length_unit(poses), poses.read("up")
    plane, camera_to_world = ground_axes(up), poses.read("camera_to_world")[poses.read("registered")]
    xyz = poses.read("points/xyz")
    xyz = xyz[below_cameras(poses, xyz)]
    if len(xyz := xyz[:: len(xyz) // POINTS + 1]):
        size = float(np.clip(2e4 / len(xyz), 1.2, 8))
        points = axes.scatter(*(xyz @ plane.T).T, c=xyz @ up, s=size, cmap="viridis", linewidths=0)
        bar = {"location": "bottom", "shrink": 0.6, "aspect": 40}
        axes.figure.colorbar(points, ax=axes, label=f"height of a point [{unit}]", **bar)
    path, directions = (camera_to_world[:, :3, column] @ plane.T for column in (3, 2))
    segments = np.stack([path[:-1], path[1:]], axis=1)
    times = np.linspace(0, 1, len(segments))
    axes.add_collection(LineCollection(list(segments), array=times, cmap="plasma", linewidths=2.2, zorder=3))
    step = max(1, len(path) // 40)
    axes.quiver(*path[::step].T, *directions[::step].T, scale=28, width=0.0025, color="0.15", zorder=4)
    for place, color, label in ((path[0], "limegreen", "start"), (path[-1], "crimson", "end")):
        axes.scatter(*place, s=70, c=color, edgecolors="k", zorder=5, label=label)
    if unit == "m":
        # Otherwise millimeters of noise in the poses fill the page like a real trajectory.
        axes.update_datalim(path.mean(axis=0) + LEAST_EXTENT * np.array([[-0.5, -0.5], [0.5, 0.5]]))
    title = "From above: the points, and the trajectory from dark to light"
    axes.set(aspect="equal", title=title, xlabel=unit, ylabel=unit)
    axes.legend(loc="upper right")
    axes.grid(alpha=0.2)


def _draw_evaluation_frame(axes: Axes, frames: Artifact, annotations: Artifact, row: int) -> None:
    """Draw an evaluation frame, with tinted and named instances if it is annotated."""
    index = annotations.read("frame")[row]
    image = frames.row("rgb", index)
    if not annotations.read("annotated")[row]:
        show(axes, image, f"evaluation frame {index}: not annotated", 8)
        return
    names = [instance["category"] for instance in annotations.facts["instances"]]
    labels = annotations.row("instance_map", row)
    values, sizes = np.unique(labels[labels >= 0], return_counts=True)
    objects = [value for value in values[np.argsort(-sizes, kind="stable")] if names[value] != ROOM]
    tinted = tint(image, np.where(np.isin(labels, objects), labels, -1), palette(len(names)))
    show(axes, tinted, f"evaluation frame {index}: {len(values)} instances", 8)
    for value in objects[:LABELS]:
        if (mask := labels == value).mean() >= LEAST_SHARE:
            add_name(axes, *innermost(mask), names[value])
