"""What the sheets share: opening artifacts, headings with warnings, colors of things, and what a view from above shows."""

import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.colors import hsv_to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from egosplat.alarms.artifact_alarms import warnings_of
from egosplat.arrays import Array, Bools, Bytes
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.lineage import open_inputs
from egosplat.artifacts.reader import Artifact
from egosplat.drawing import draw_heading, save_figure

# Draws artifacts; returns the figure and a summary for its heading.
Draw = Callable[..., tuple[Figure, str]]

# Points up to this share of the cameras' height above the floor are drawn from above: no ceiling hides the rest.
BELOW = 1.1

# Maximum number of points that are drawn from above.
POINTS = 60_000


def sheet(*warned: str, fontsize: int = 12) -> Callable[[Draw], Callable[..., None]]:
    """Make the function of a stage from one that draws its artifacts, which are named as they are.

    The made function takes their paths as ``NAME_path``, ``output`` and ``title``. It writes a PNG, whole or not at all, with
    notices and alarms of those ``warned`` in a heading of ``fontsize`` [points] (UserError: one is damaged, or made from another one).
    """

    def decorate(draw: Draw) -> Callable[..., None]:
        @functools.wraps(draw)
        def run(*, output: Path, title: str, **paths: Path) -> None:
            opened = open_inputs(paths)
            for artifact in opened.values():
                check_made_from(artifact, *(other for other in opened.values() if other is not artifact))
            figure, summary = draw(**opened)
            warnings = warnings_of(*(opened[name] for name in warned if name in opened))
            draw_heading(figure, f"{title}: {summary}", warnings, fontsize)
            save_figure(figure, output)

        return run

    return decorate


def below_cameras(poses: Artifact, xyz: Array) -> Bools:
    """(N,) bool: which of (N, 3) points show the scene from above, without what is higher than the cameras."""
    if not len(xyz):
        return np.zeros(0, bool)
    up = poses.read("up")
    height = xyz @ up
    camera = np.median(poses.read("camera_to_world")[poses.read("registered"), :3, 3] @ up)
    # Stray points far outside would shrink the rest.
    low, high = np.percentile(xyz, [1, 99], axis=0)
    floor = np.percentile(height, 1)
    return ((xyz >= low) & (xyz <= high)).all(axis=1) & (height < floor + BELOW * (camera - floor))


def palette(count: int) -> Array:
    """(count, 3) colors in 0..1; consecutive ones have very different hues."""
    hues = (np.arange(count) * 0.61803398875) % 1.0
    value = 0.75 + 0.25 * ((np.arange(count) // 7) % 2)
    return hsv_to_rgb(np.stack([hues, np.full(count, 0.85), value], axis=1)).reshape(count, 3)


def tint(picture: Bytes, labels: NDArray[np.integer], colors: Array, opacity: float = 0.4) -> Bytes:
    """Tint an (H, W, 3) uint8 image by (H, W) labels in (N, 3) colors in 0..1; pixels without a label, -1, stay as they are."""
    if not len(colors):
        return picture
    mixed = (1 - opacity) * picture + opacity * 255 * colors[labels]
    return np.where((labels >= 0)[..., None], mixed, picture).astype(np.uint8)
