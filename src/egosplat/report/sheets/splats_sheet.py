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
from egosplat.artifacts.schemas import AS_GIVEN, FITTED, length_unit, shown_pixels
from egosplat.drawing import empty_grid, label_log_axis, plt, show, split_page
from egosplat.gaussians.evaluation import describe
from egosplat.geometry import ground_axes
from egosplat.images import evenly_spaced
from egosplat.report.sheets.sheet import sheet

# Maximum number of held-out frames, height of an image and of the corrections [inches].
PICTURES, CELL, CORRECTIONS = 4, 3.0, 4.0

# Mean absolute error over the channels, 0..1, with the brightest color of the error map.
ERROR_LIMIT = 0.3

# Length of the longest arrow, as a part of the extent of the trajectory.
ARROW = 0.25


@sheet("splats", fontsize=13)
def run(frames: Artifact, poses: Artifact, splats: Artifact) -> tuple[Figure, str]:
    """Draw the training curves, and held-out frames with their renders."""
    shown = evenly_spaced(splats.shape("held_out/frame")[0], PICTURES)
    columns = max(len(shown), 2)
    _, height, width, _ = frames.shape("rgb")
    cell = CELL * float(np.clip(width / height, 0.6, 1.8))
    heights = [3 * CELL + 1.2] + ([CORRECTIONS] if splats.has("corrections/shift") else [])
    figure = plt.figure(figsize=(5.4 + columns * cell, sum(heights)), layout="constrained")
    page, *below = split_page(figure, len(heights), 1, height_ratios=heights)
    for part in below:
        from_above, over_time = part.subplots(1, 2)
        _draw_poses(from_above, splats, length_unit(poses))
        _draw_gains(over_time, splats)
    left, right = split_page(page, 1, 2, width_ratios=(4.6, columns * cell + 0.8))
    if len(splats.read("curve/iteration")):  # otherwise Gaussians of another program, or of cells
        _draw_curves(left.subplots(3, 1, sharex=True), splats)
    grid, error = empty_grid(right, 3, columns), None
    for column, row in zip(grid.T, shown, strict=False):
        error = _draw_frame(column, frames, splats, row)
    if error is None:
        grid[0, 0].set_title("no frame was held out; frames.evaluation_frames=4 holds four out", loc="left")
    else:
        about = "error, mean over the channels"
        bar = right.colorbar(error, ax=grid[2].tolist(), extend="max", label=about, format="{x:.0%}")
        bar.set_ticks([0.0, ERROR_LIMIT / 2, ERROR_LIMIT])
    return figure, _summary(frames, splats)


def _summary(frames: Artifact, splats: Artifact) -> str:
    def quality(given: str = "") -> str:
        return describe(*(splats.read(f"held_out/{name}{given}") for name in ("psnr", "ssim")))

    facts, count = splats.facts, splats.shape("held_out/frame")[0]
    held_out = f"{count} held out: {quality()}" if count else "no frame held out"
    if count and splats.has("corrections/shift"):
        held_out += f" with fitted corrections (as given {quality('_given')})"
    trained = "trained elsewhere, maybe on these frames, too"
    if (source := facts.get("source")) is None:
        trained = f"{facts['iteration']} iterations, {facts['views']['training']} training views"
        trained += f", {facts['training_s']:.0f} s of training"
    file = "" if source is None else f" of {source['file']}"
    return (
        f"{frames.facts['recording']}, origin {splats.origin}\n"
        f"{splats.shape('means')[0]} Gaussians{file}: {trained}; {held_out}; {facts['rasterizer']}"
    )


def _draw_curves(axes: NDArray[Any], splats: Artifact) -> None:
    """Draw loss, PSNR and number of Gaussians over the iterations."""
    iteration, loss, psnr = (splats.read(name) for name in ("curve/iteration", "curve/loss", "history/psnr"))
    above, middle, below = axes
    # A moving average over a fiftieth of all values; the window is shorter at the ends.
    window = np.ones(2 * (len(loss) // 100) + 1)
    smooth = np.convolve(loss, window, "same") / np.convolve(np.ones(len(loss)), window, "same")
    above.semilogy(iteration, loss, color="0.75", linewidth=0.8)
    above.semilogy(iteration, smooth, color="tab:blue")
    label_log_axis(above.yaxis)
    if np.isfinite(psnr).any():
        middle.plot(splats.read("history/iteration"), psnr, marker="o", markersize=4, label="held out")
        middle.legend(loc="lower right")
    else:
        middle.set_yticks([])
        middle.text(0.5, 0.5, "no frame was held out", transform=middle.transAxes, ha="center", va="center")
    below.plot(iteration, splats.read("curve/gaussians"), color="tab:green")
    below.set(xlabel="iteration", ylim=(0, None))
    for one, label in zip(axes, ("loss", "PSNR [dB]", "Gaussians"), strict=True):
        one.set_ylabel(label)
        one.grid(alpha=0.3)


def _draw_frame(cells: NDArray[Any], frames: Artifact, splats: Artifact, row: int) -> AxesImage:
    """Draw a photograph, its render and their difference in one column; returns the difference."""
    frame = int(splats.read("held_out/frame")[row])
    photograph, render = frames.row("rgb", frame), splats.row("held_out/render", row)
    error = np.abs(photograph.astype(np.float64) - render).mean(axis=-1) / 255.0
    error[~shown_pixels(frames, frame, frames.read("valid"))] = np.nan
    psnr, ssim = (splats.read(f"held_out/{name}")[row] for name in ("psnr", "ssim"))
    show(cells[0], photograph, f"held out, frame {frame}", 10)
    show(cells[1], render, f"rendered: {psnr:.2f} dB, SSIM {ssim:.3f}", 10)
    mean = 100 * np.nanmean(error) if np.isfinite(error).any() else 0
    return show(cells[2], error, f"mean error {mean:.1f} %", 10, cmap="inferno", vmin=0.0, vmax=ERROR_LIMIT)


def _draw_poses(axes: Axes, splats: Artifact, unit: str) -> None:
    """Draw the trajectory from above, with an arrow from each camera towards its corrected place."""
    center = splats.read("corrections/camera_to_world")[:, :3, 3]
    known, plane = np.isfinite(center).all(axis=1), ground_axes(np.array(splats.facts["up"]))
    shift, turn, source = (splats.read(f"corrections/{name}")[known] for name in ("shift", "turn", "source"))
    moved = shift @ plane.T
    before = center[known] @ plane.T - moved
    longest, extent = np.linalg.norm(moved, axis=1).max(initial=0.0), np.ptp(before, axis=0).max(initial=0.0)
    factor = max(ARROW * extent / longest, 1.0) if longest > 0 else 1.0
    axes.plot(*before.T, color="0.6", linewidth=1.0, zorder=1)
    in_place = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.003, "zorder": 2}
    held_out = source == FITTED
    trained = ~held_out & (source != AS_GIVEN)
    for rows, color, label in ((trained, "tab:blue", "training"), (held_out, "tab:orange", "held out")):
        axes.quiver(*before[rows].T, *factor * moved[rows].T, color=color, label=label, **in_place)
    # The limits do not follow the heads of arrows by themselves.
    axes.update_datalim(before + factor * moved)
    axes.set_aspect("equal", adjustable="datalim")
    size = np.linalg.norm(shift, axis=1)
    rms_size, rms_turn = (np.sqrt(np.mean(values**2)) for values in (size, turn))
    title = (
        f"Pose corrections from above, drawn {factor:.0f} times longer\n"
        f"RMS {rms_size:.2g} {unit} and {rms_turn:.2f}°, largest {size.max():.2g} {unit} and {turn.max():.2f}°"
    )
    axes.set(title=title, xlabel=unit)
    axes.legend(loc="best", fontsize=8)
    axes.grid(alpha=0.3)


def _draw_gains(axes: Axes, splats: Artifact) -> None:
    """Draw the gains of red, green and blue over the frames."""
    gain, source = splats.read("corrections/gain"), splats.read("corrections/source")
    frame, fitted = np.flatnonzero(source != AS_GIVEN), np.flatnonzero(source == FITTED)
    for channel, color in enumerate(("tab:red", "tab:green", "tab:blue")):
        axes.plot(frame, gain[frame, channel], color=color, linewidth=1.2)
    axes.plot(fitted, gain[fitted].mean(axis=1), "o", c="tab:orange", markersize=4, label="held out (mean)")
    axes.axhline(1.0, color="0.6", linewidth=0.8)
    axes.set(title="Gain of each frame's colors; 1 is the mean exposure", xlabel="frame", ylabel="gain")
    axes.legend(loc="best", fontsize=8)
    axes.grid(alpha=0.3)
