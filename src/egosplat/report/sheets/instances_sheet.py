"""Draw the instances on one page: in frames of the video, and from above."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from egosplat.arrays import Array, Bytes, Ints32
from egosplat.artifacts.reader import Artifact
from egosplat.drawing import empty_grid, plt, show
from egosplat.geometry import ground_axes
from egosplat.images import evenly_spaced
from egosplat.report.sheets.sheet import below_cameras, palette, sheet, tint

# Maximum number of frames, evenly spaced.
PICTURES = 6

# Width of an image on the page [inches].
CELL = 2.9

# Opacity of an instance's color, and light of pixels without an instance.
TINT, DARK = 0.55, 0.6


@sheet("instances")
def run(frames: Artifact, poses: Artifact, instances: Artifact) -> tuple[Figure, str]:
    """Draw the instances in frames, and from above."""
    count, height, width, _ = frames.shape("rgb")
    shown, levels = evenly_spaced(count, PICTURES), instances.facts["levels"]
    in_3d = instances.shape("gaussians/xyz")[0] > 0
    rows, columns = 1 + len(levels), len(shown) + in_3d
    size = (CELL * columns, rows * (CELL * height / width + 0.25) + 0.9)
    grid = empty_grid(figure := plt.figure(figsize=size, layout="constrained"), rows, columns)
    colors = palette(instances.shape("instances/level")[0])
    for column, frame in zip(grid.T, shown, strict=False):
        image, labels = frames.row("rgb", frame), instances.row("labels", frame)
        show(column[0], image, f"frame {frame}")
        for axes, of_level, name in zip(column[1:], labels, levels, strict=True):
            visible = len(np.unique(of_level[of_level >= 0]))
            show(axes, tinted(image, of_level, colors), f"{name}: {visible} instances")
    if in_3d:
        _draw_from_above(grid[1:, -1], poses, instances, colors)
    by_level = ", ".join(f"{number} {name}s" for name, number in instances.facts["instances"].items())
    made = "tracks" if instances.facts["source"] == "tracks" else "masks merged in 3D"
    return (
        figure,
        f"{by_level} ({made}), origin {instances.origin}\nEach instance has one color in all pictures.",
    )


def tinted(picture: Bytes, labels: Ints32, colors: Array) -> Bytes:
    """Tint and outline the instances of an (H, W, 3) uint8 image as ``tint`` does; all else is gray."""
    gray = picture.mean(axis=2, keepdims=True) * np.where(labels >= 0, 1, DARK)[..., None]
    shown = tint(np.repeat(gray, 3, axis=2).astype(np.uint8), labels, colors, TINT)
    # Pixels whose right or lower neighbor has another label.
    shown[:, :-1][labels[:, :-1] != labels[:, 1:]] = 255
    shown[:-1][labels[:-1] != labels[1:]] = 255
    return shown


def _draw_from_above(cells: NDArray[Any], poses: Artifact, instances: Artifact, colors: Array) -> None:
    """Draw the Gaussians of each level's instances from above, the highest last, without what is higher than the cameras."""
    up, xyz = poses.read("up"), instances.read("gaussians/xyz").astype(np.float64)
    rows = np.argsort(xyz @ up, kind="stable")
    rows = rows[below_cameras(poses, xyz)[rows]]
    owners = instances.read("gaussians/instance").T
    for axes, owner, name in zip(cells, owners, instances.facts["levels"], strict=True):
        drawn = rows[owner[rows] >= 0]
        axes.scatter(*(xyz[drawn] @ ground_axes(up).T).T, s=0.6, c=colors[owner[drawn]], linewidths=0)
        axes.set(aspect="equal")
        axes.set_title(f"{name}: from above", fontsize=9)
