"""A scene's Gaussians on one page: held-out frames beside their renders, and how training went."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from egosplat.alarms.artifact_alarms import warnings_of
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.splats import SPLATS
from egosplat.output_files import check_output, picture_kind
from egosplat.report.figure import draw_heading, label_log_axis, middles_of_parts, plt, save_figure

PAGE = picture_kind("egosplat splats-sheet")

PICTURES = 4
"""At most so many held-out frames are shown."""

CELL = 3.0
"""Height of a picture, in inches."""

ERROR_LIMIT = 0.3
"""Mean absolute error over the channels, of 1, that the error map shows in its brightest colour."""


def run(frames: Path, splats: Path, output: Path, *, title: str) -> None:
    """Draw the page as PNG; the file appears when it is complete."""
    check_output(output, PAGE)
    pictures, trained = open_artifact(frames, FRAMES), open_artifact(splats, SPLATS)
    shown = middles_of_parts(trained.shape("held_out/frame")[0], PICTURES)
    columns = max(len(shown), 2)
    _, height, width, _ = pictures.shape("rgb")
    cell = CELL * float(np.clip(width / height, 0.6, 1.8))
    figure = plt.figure(figsize=(4.6 + columns * cell, 3 * CELL + 1.2), layout="constrained")
    draw_heading(figure, f"{title}: {_summary(pictures, trained)}", warnings_of(trained), 13)
    left, right = figure.subfigures(1, 2, width_ratios=(4.6, columns * cell))
    _draw_curves(left.subplots(3, 1, sharex=True), trained)
    grid = right.subplots(3, columns, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for column, row in enumerate(shown):
        _draw_frame(grid[:, column], pictures, trained, row)
    if not shown:
        grid[0, 0].set_title("no frame was held out", loc="left")
    save_figure(figure, output, PAGE)


def _summary(pictures: Artifact, trained: Artifact) -> str:
    facts, psnr, ssim = trained.facts, trained.read("held_out/psnr"), trained.read("held_out/ssim")
    held_out = "no frame held out"
    if len(psnr):
        held_out = f"{len(psnr)} held out: PSNR {_mean(psnr):.2f} dB, SSIM {_mean(ssim):.3f}"
    return (
        f"{pictures.facts['recording']}, origin {trained.origin}\n"
        f"{trained.shape('means')[0]} Gaussians of iteration {facts['iteration']}, "
        f"{facts['views']['training']} training views, {held_out}; "
        f"{facts['training_s']:.0f} s of training, {facts['rasterizer']}"
    )


def _mean(values: NDArray[np.float64]) -> float:
    """Of those that are known; NaN where none is."""
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else float("nan")


def _draw_curves(axes: NDArray[np.object_], trained: Artifact) -> None:
    """Loss, PSNR and the number of Gaussians over the iterations."""
    iteration = trained.read("curve/iteration")
    above, middle, below = axes
    above.semilogy(iteration, trained.read("curve/loss"), color="0.75", linewidth=0.8)
    above.semilogy(iteration, _smoothed(trained.read("curve/loss")), color="tab:blue")
    above.set(ylabel="loss")
    label_log_axis(above.yaxis)
    _draw_psnr(middle, trained)
    below.plot(iteration, trained.read("curve/gaussians"), color="tab:green")
    below.set(ylabel="Gaussians", xlabel="iteration", ylim=(0, None))
    for one in axes:
        one.grid(alpha=0.3)


def _draw_psnr(axes: Axes, trained: Artifact) -> None:
    iteration = trained.read("history/iteration")
    for name, label in (("history/psnr", "held out"), ("history/validation_psnr", "validation")):
        values = trained.read(name)
        if np.isfinite(values).any():
            axes.plot(iteration, values, marker="o", markersize=4, label=label)
            axes.legend(loc="lower right")
    axes.set(ylabel="PSNR [dB]")


def _smoothed(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over a window of a fiftieth of all records, shorter at the ends."""
    half = len(values) // 100
    sums = np.concatenate([[0.0], np.cumsum(values)])
    low = np.maximum(np.arange(len(values)) - half, 0)
    high = np.minimum(np.arange(len(values)) + half + 1, len(values))
    return (sums[high] - sums[low]) / (high - low)


def _draw_frame(cells: NDArray[np.object_], pictures: Artifact, trained: Artifact, row: int) -> None:
    """A photograph, its render and their difference, one below the other."""
    frame = trained.read("held_out/frame")[row]
    photograph, picture = pictures.row("rgb", frame), trained.row("held_out/render", row)
    error = error_map(photograph, picture, pictures.read("valid"))
    psnr, ssim = trained.read("held_out/psnr")[row], trained.read("held_out/ssim")[row]
    above, middle, below = cells
    above.imshow(photograph)
    above.set_title(f"held out, frame {frame}", fontsize=10)
    middle.imshow(picture)
    middle.set_title(f"rendered: {psnr:.2f} dB, SSIM {ssim:.3f}", fontsize=10)
    below.imshow(error, cmap="inferno", vmin=0.0, vmax=ERROR_LIMIT)
    below.set_title(
        f"mean error {100 * np.nanmean(error) if np.isfinite(error).any() else 0:.1f} %", fontsize=10
    )


def error_map(
    photograph: NDArray[np.uint8], picture: NDArray[np.uint8], valid: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Mean absolute difference over the channels, of 1.

    Args:
        photograph, picture: (H, W, 3) uint8.
        valid: (H, W) bool.

    Returns:
        (H, W) float64; NaN where not valid.
    """
    difference = np.abs(photograph.astype(np.float64) - picture).mean(axis=-1) / 255.0
    return np.where(valid, difference, np.nan)
