"""Draw the corrections of a training: poses from above, and the exposure over time."""

import numpy as np
from matplotlib.axes import Axes

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.splats import AS_GIVEN, FITTED
from egosplat.drawing import ground_axes

# Length of the longest arrow, as a part of the extent of the trajectory.
_ARROW = 0.25

_ORANGE, _GREY = "tab:orange", "0.6"


def has_corrections(splats: Artifact) -> bool:
    """Whether there is something to draw."""
    return splats.has("corrections/shift")


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
        axes.quiver(
            *before[rows].T,
            *factor * moved[rows].T,
            angles="xy",
            scale_units="xy",
            scale=1.0,
            width=0.003,
            color=color,
            label=label,
            zorder=2,
        )
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
