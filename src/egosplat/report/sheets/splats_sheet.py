"""Draw the training of a scene's Gaussians on one page: training curves, and held-out frames with their renders.

Where poses or exposures were corrected, also the corrections.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import AS_GIVEN, FITTED, shown_pixels
from egosplat.drawing import (
    empty_grid,
    ground_axes,
    hide_axes,
    label_log_axis,
    middles_of_parts,
    plt,
    show,
    split_page,
)
from egosplat.gaussians.evaluation import Scores
from egosplat.report.sheets.sheet import sheet

# Maximum number of held-out frames.
PICTURES = 4

# Height of an image [inches].
CELL = 3.0

# Mean absolute error over the channels, 0..1, with the brightest color of the error map.
ERROR_LIMIT = 0.3


@sheet(warned=("splats",), fontsize=13)
def run(frames: Artifact, splats: Artifact) -> tuple[Figure, str]:
    """Draw the training curves, and held-out frames with their renders."""
    shown = middles_of_parts(splats.shape("held_out/frame")[0], PICTURES)
    columns = max(len(shown), 2)
    _, height, width, _ = frames.shape("rgb")
    cell = CELL * float(np.clip(width / height, 0.6, 1.8))
    more = 4.0 if splats.has("corrections/shift") else 0.0
    figure = plt.figure(figsize=(5.4 + columns * cell, 3 * CELL + 1.2 + more), layout="constrained")
    page = figure
    if more:
        page, below = split_page(figure, 2, 1, height_ratios=(3 * CELL + 1.2, more))
        from_above, over_time = below.subplots(1, 2)
        draw_poses(from_above, splats)
        draw_gains(over_time, splats)
    left, right = split_page(page, 1, 2, width_ratios=(4.6, columns * cell + 0.8))
    _draw_curves(left.subplots(3, 1, sharex=True), splats)
    grid = empty_grid(right, 3, columns)
    errors = [_draw_frame(grid[:, column], frames, splats, row) for column, row in enumerate(shown)]
    if errors:
        about = "error, mean over the channels"
        bar = right.colorbar(errors[0], ax=grid[2].tolist(), extend="max", label=about)
        ticks = [0.0, ERROR_LIMIT / 2, ERROR_LIMIT]
        bar.set_ticks(ticks, labels=[f"{tick:.0%}" for tick in ticks])
    else:
        grid[0, 0].set_title("no frame was held out", loc="left")
    return figure, _summary(frames, splats)


def _summary(frames: Artifact, splats: Artifact) -> str:
    facts, scores = splats.facts, Scores(splats.read("held_out/psnr"), splats.read("held_out/ssim"))
    held_out = "no frame held out"
    if count := len(scores.psnr):
        held_out = f"{count} held out: PSNR {scores.mean_psnr:.2f} dB, SSIM {scores.mean_ssim:.3f}"
    if count and splats.has("corrections/shift"):
        given = Scores(splats.read("held_out/psnr_given"), splats.read("held_out/ssim_given"))
        held_out += f" with fitted corrections (as given {given.mean_psnr:.2f} dB, {given.mean_ssim:.3f})"
    known = f"{frames.facts['recording']}, origin {splats.origin}\n{splats.shape('means')[0]} Gaussians"
    if given := facts.get("source"):
        return (
            f"{known} of {given['file']}, trained elsewhere, maybe on these frames, too: "
            f"PSNR {scores.mean_psnr:.2f} dB, SSIM {scores.mean_ssim:.3f}; {facts['rasterizer']}"
        )
    return (
        f"{known} of iteration {facts['iteration']}, "
        f"{facts['views']['training']} training views, {held_out}; "
        f"{facts['training_s']:.0f} s of training, {facts['rasterizer']}"
    )


def _draw_curves(axes: NDArray[Any], splats: Artifact) -> None:
    """Draw loss, PSNR and number of Gaussians over the iterations."""
    iteration = splats.read("curve/iteration")
    above, middle, below = axes
    if not len(iteration):  # Gaussians of another program
        for one in axes:
            hide_axes(one)
        return
    above.semilogy(iteration, splats.read("curve/loss"), color="0.75", linewidth=0.8)
    above.semilogy(iteration, _smoothed(splats.read("curve/loss")), color="tab:blue")
    above.set(ylabel="loss")
    label_log_axis(above.yaxis)
    _draw_psnr(middle, splats)
    below.plot(iteration, splats.read("curve/gaussians"), color="tab:green")
    below.set(ylabel="Gaussians", xlabel="iteration", ylim=(0, None))
    for one in axes:
        one.grid(alpha=0.3)


def _draw_psnr(axes: Axes, splats: Artifact) -> None:
    values = splats.read("history/psnr")
    if np.isfinite(values).any():
        axes.plot(splats.read("history/iteration"), values, marker="o", markersize=4, label="held out")
        axes.legend(loc="lower right")
    else:
        axes.set_yticks([])
        axes.text(0.5, 0.5, "no frame was held out", transform=axes.transAxes, ha="center", va="center")
    axes.set(ylabel="PSNR [dB]")


def _smoothed(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Moving average over a fiftieth of all values; the window is shorter at the ends."""
    half = len(values) // 100
    sums = np.concatenate([[0.0], np.cumsum(values)])
    low = np.maximum(np.arange(len(values)) - half, 0)
    high = np.minimum(np.arange(len(values)) + half + 1, len(values))
    return (sums[high] - sums[low]) / (high - low)


def _draw_frame(cells: NDArray[Any], frames: Artifact, splats: Artifact, row: int) -> AxesImage:
    """Draw a photograph, its render and their difference in one column; returns the difference."""
    frame = splats.read("held_out/frame")[row]
    photograph, render = frames.row("rgb", frame), splats.row("held_out/render", row)
    error = error_map(photograph, render, shown_pixels(frames, int(frame), frames.read("valid")))
    psnr, ssim = splats.read("held_out/psnr")[row], splats.read("held_out/ssim")[row]
    above, middle, below = cells
    show(above, photograph, f"held out, frame {frame}", 10)
    show(middle, render, f"rendered: {psnr:.2f} dB, SSIM {ssim:.3f}", 10)
    mean = 100 * np.nanmean(error) if np.isfinite(error).any() else 0
    return show(below, error, f"mean error {mean:.1f} %", 10, cmap="inferno", vmin=0.0, vmax=ERROR_LIMIT)


def error_map(
    photograph: NDArray[np.uint8], render: NDArray[np.uint8], valid: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Mean absolute difference of (H, W, 3) uint8 images over the channels, (H, W) float64 in 0..1; NaN where not valid."""
    difference = np.abs(photograph.astype(np.float64) - render).mean(axis=-1) / 255.0
    return np.where(valid, difference, np.nan)


# Length of the longest arrow, as a part of the extent of the trajectory.
_ARROW = 0.25

_ORANGE, _GREY = "tab:orange", "0.6"


def draw_poses(axes: Axes, splats: Artifact) -> None:
    """Draw the trajectory from above, with an arrow from each camera towards its corrected place."""
    source = splats.read("corrections/source")
    center = splats.read("corrections/camera_to_world")[:, :3, 3]
    known = np.isfinite(center).all(axis=1)
    shift, plane = splats.read("corrections/shift")[known], ground_axes(np.array(splats.facts["up"]))
    after, moved, source = center[known] @ plane.T, shift @ plane.T, source[known]
    before = after - moved
    longest, extent = np.linalg.norm(moved, axis=1).max(initial=0.0), np.ptp(before, axis=0).max(initial=0.0)
    factor = max(_ARROW * extent / longest, 1.0) if longest > 0 else 1.0
    axes.plot(*before.T, color=_GREY, linewidth=1.0, zorder=1)
    for fitted, color, label in ((False, "tab:blue", "training"), (True, _ORANGE, "held out")):
        rows = (source == FITTED) == fitted
        rows &= source != AS_GIVEN
        in_place = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.003, "zorder": 2}
        axes.quiver(*before[rows].T, *factor * moved[rows].T, color=color, label=label, **in_place)
    turn = splats.read("corrections/turn")[known]
    size = 1e3 * np.linalg.norm(shift, axis=1)
    # The limits do not follow the heads of arrows by themselves.
    axes.update_datalim(before + factor * moved)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(
        title=f"pose corrections from above, {factor:.0f} times longer\n"
        f"RMS {np.sqrt(np.mean(size**2)):.1f} mm and {np.sqrt(np.mean(turn**2)):.2f}°, "
        f"largest {size.max():.1f} mm and {turn.max():.2f}°",
        xlabel="m",
    )
    axes.legend(loc="best", fontsize=8)
    axes.grid(alpha=0.3)


def draw_gains(axes: Axes, splats: Artifact) -> None:
    """Draw the gains of red, green and blue over the frames."""
    gain, source = splats.read("corrections/gain"), splats.read("corrections/source")
    frame = np.flatnonzero(source != AS_GIVEN)
    for channel, color in enumerate(("tab:red", "tab:green", "tab:blue")):
        axes.plot(frame, gain[frame, channel], color=color, linewidth=1.2)
    fitted = np.flatnonzero(source == FITTED)
    axes.plot(fitted, gain[fitted].mean(axis=1), "o", color=_ORANGE, markersize=4, label="held out (mean)")
    axes.axhline(1.0, color=_GREY, linewidth=0.8)
    axes.set(title="gain of each frame's colors, 1 = mean exposure", xlabel="frame", ylabel="gain")
    if len(fitted):
        axes.legend(loc="best", fontsize=8)
    axes.grid(alpha=0.3)
