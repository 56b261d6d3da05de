"""Draw the segments on one page: frames of the video, with the instances of each level in colours."""

from pathlib import Path

import numpy as np
from matplotlib.colors import hsv_to_rgb
from numpy.typing import NDArray

from egosplat.alarms.artifact_alarms import warnings_of
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.segments import SEGMENTS
from egosplat.output_files import check_output, picture_kind
from egosplat.report.figure import draw_heading, evenly_spaced, plt, save_figure, show

PAGE = picture_kind("egosplat segments-sheet")

# Maximum number of frames, evenly spaced.
PICTURES = 6

# Width of an image on the page [inches].
CELL = 2.9

# Opacity of an instance's colour.
TINT = 0.55


def run(frames_path: Path, segments_path: Path, output: Path, *, title: str) -> None:
    """Draw the page as PNG, atomically.

    Raises:
        UserError: the segments were made from other frames.
    """
    check_output(output, PAGE)
    frames, segments = open_artifact(frames_path, FRAMES), open_artifact(segments_path, SEGMENTS)
    check_made_from(segments, frames, axes=("frame",))
    count, height, width, _ = frames.shape("rgb")
    shown = evenly_spaced(count, PICTURES)
    levels, repeats = segments.facts["levels"], segments.facts.get("repeats", {})
    size = (CELL * len(shown), (CELL * height / width + 0.25) * (1 + len(levels)) + 0.9)
    figure, grid = plt.subplots(
        1 + len(levels), len(shown), squeeze=False, figsize=size, layout="constrained"
    )
    draw_heading(figure, f"{title}: {_summary(segments)}", warnings_of(segments))
    colours = palette(segments.shape("instances/level")[0])
    for column, frame in enumerate(shown):
        image, labels = frames.row("rgb", frame), segments.row("labels", frame)
        show(grid[0, column], image, f"frame {frame}")
        for level, name in enumerate(levels):
            visible = len(np.unique(labels[level][labels[level] >= 0]))
            heading = (
                f"{name}: repeats {repeats[name]}" if name in repeats else f"{name}: {visible} instances"
            )
            show(grid[1 + level, column], tinted(image, labels[level], colours), heading)
    save_figure(figure, output, PAGE)


def _summary(segments: Artifact) -> str:
    facts = segments.facts
    by_level = ", ".join(f"{number} {name}s" for name, number in facts["instances"].items())
    keys = facts.get("key_frames")
    prompted = f"; prompted in {len(keys)} frames" if keys is not None else ""
    return (
        f"{by_level} by {facts['segmenter']}{prompted}, origin {segments.origin}\n"
        "an instance has the same colour in all frames"
    )


def palette(count: int) -> NDArray[np.float64]:
    """(count, 3) colours in 0..1; consecutive ones have very different hues."""
    hues = (np.arange(count) * 0.61803398875) % 1.0
    value = 0.75 + 0.25 * ((np.arange(count) // 7) % 2)
    hsv = np.stack([hues, np.full(count, 0.85), value], axis=1)
    return hsv_to_rgb(hsv).reshape(count, 3)


def tinted(
    picture: NDArray[np.uint8], labels: NDArray[np.int32], colours: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Tint and outline the instances of an image; the rest is grey.

    Args:
        picture: (H, W, 3) uint8.
        labels: (H, W) instances, -1 for none.
        colours: (N, 3) in 0..1.

    Returns:
        (H, W, 3) float64 in 0..1.
    """
    light = picture / 255.0
    grey = np.repeat(light.mean(axis=2, keepdims=True), 3, axis=2)
    if not len(colours):
        return 0.6 * grey
    tint = (1 - TINT) * grey + TINT * colours[np.maximum(labels, 0)]
    shown = np.where((labels >= 0)[..., None], tint, 0.6 * grey)
    shown[_borders(labels)] = 1.0
    return shown


def _borders(labels: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(H, W) bool pixels whose right or lower neighbour has another label."""
    borders = np.zeros(labels.shape, dtype=bool)
    borders[:, :-1] |= labels[:, :-1] != labels[:, 1:]
    borders[:-1] |= labels[:-1] != labels[1:]
    return borders
