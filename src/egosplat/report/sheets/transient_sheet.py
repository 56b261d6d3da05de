"""Draw transient objects on one page: frames, predicted probability, masks, and renders without them."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from egosplat.arrays import Array, Bools, Bytes
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import camera_poses, seconds_of
from egosplat.drawing import add_name, draw_outline, empty_grid, plt, show, split_page
from egosplat.gaussians.io import read_trained_scene
from egosplat.images import evenly_spaced
from egosplat.query.maps import innermost
from egosplat.report.sheets.sheet import sheet, tint

# Maximum number of frames, and of those with masked pixels.
PICTURES, MOVING = 5, 4

# Maximum number of named instances in a frame, the largest first.
LABELS = 4

# Width of an image, and height of the chart [inches].
CELL, CHART = 2.9, 2.6

# Colors of transient instances, of static ones, and of those above the threshold that are not masked.
MASKED, STATIC, LEFT_OUT = "crimson", "0.7", "lightpink"

# Opacity of the heat map.
HEAT = 0.75


@sheet("transient", "masks")
def run(
    frames: Artifact,
    poses: Artifact,
    transient: Artifact,
    instances: Artifact,
    masks: Artifact,
    splats: Artifact,
) -> tuple[Figure, str]:
    """Draw frames, predicted probability, masks, renders, and the scores of all instances."""
    count, height, width, _ = frames.shape("rgb")
    shares = np.array([masks.row("refined", frame).mean() for frame in range(count)])
    shown = choose_frames(shares, poses.read("registered"))
    pictures = 4 * (CELL * height / width + 0.25)
    size = (CELL * max(len(shown), 3) + 0.9, pictures + CHART + 1.0)
    figure = plt.figure(figsize=size, layout="constrained")
    above, below = split_page(figure, 2, 1, height_ratios=(pictures, CHART))
    grid, heat = empty_grid(above, 4, max(len(shown), 3)), None
    scene, seconds = read_trained_scene(splats, "auto"), seconds_of(frames)
    camera_to_world = camera_poses(poses, splats)
    for column, frame in zip(grid.T, shown, strict=False):
        photograph = frames.row("rgb", frame)
        probability = transient.row("probability", frame).astype(np.float32)
        show(column[0], photograph, f"frame {frame}, {seconds[frame]:.1f} s")
        about = f"transient probability: mean {probability.mean():.1%}"
        show(column[1], photograph.mean(axis=2), about, cmap="gray")
        heat = column[1].imshow(probability, cmap="inferno", vmin=0.0, vmax=1.0, alpha=HEAT)
        _draw_mask(column[2], photograph, masks, instances, frame)
        render = scene.picture(scene.camera, camera_to_world[frame])
        show(column[3], render, "rendered from the Gaussians")
    if heat:
        bar = above.colorbar(heat, ax=grid[1].tolist(), pad=0.01, label="transient probability")
        assert bar.solids is not None
        bar.solids.set_alpha(1.0)
    _draw_scores(below.subplots(), masks)
    facts, masking = masks.facts, splats.provenance["options"]["masking"]
    trained_on = {"none": "all pixels", "initial": "all pixels, less where the probability is high"}
    return figure, (
        f"{facts['transient']} of {facts['instances']} instances are transient, {facts['masked_share']:.1%} of all "
        f"pixels; origin {masks.origin}\n"
        f"An instance is transient if its mean probability is {facts['threshold']:g} or more. "
        f"The Gaussians were trained on {trained_on.get(masking, 'the unmasked pixels')}."
    )


def choose_frames(masked: Array, posed: Bools) -> list[int]:
    """Choose the frames to show, in order of time, by their (F,) masked shares and whether they have a pose, to be rendered.

    The frames with masked pixels are split into ``MOVING`` equal parts; each part gives the frame with the largest masked
    share. The remaining frames have no masked pixel and are evenly spaced.
    """
    moving, still = np.flatnonzero(posed & (masked > 0)), np.flatnonzero(posed & (masked == 0))
    # The outer quarters of a part are left out, so that no two frames are neighbors.
    middles = [part[len(part) // 4 : len(part) - len(part) // 4] for part in np.array_split(moving, MOVING)]
    most = [int(middle[np.argmax(masked[middle])]) for middle in middles if len(middle)]
    return sorted(most + still[evenly_spaced(len(still), PICTURES - len(most))].tolist())


def _draw_mask(axes: Axes, photograph: Bytes, masks: Artifact, instances: Artifact, frame: int) -> None:
    """Tint and outline the masked pixels, and name their largest instances."""
    mask = masks.row("refined", frame)
    heading = f"{mask.mean():.1%} masked; instance: mean probability" if mask.any() else "nothing is masked"
    show(axes, tint(photograph, mask.astype(int) - 1, np.array([to_rgb(MASKED)])), heading)
    draw_outline(axes, mask)
    labels, moves = instances.row("labels", frame), masks.read("instances/transient")
    sizes = np.bincount(labels[labels >= 0], minlength=len(moves)) * moves
    for instance in np.argsort(-sizes, kind="stable")[: min(LABELS, np.count_nonzero(sizes))]:
        name = f"{instance}: {masks.read('instances/score')[instance]:.2f}"
        add_name(axes, *innermost((labels == instance).any(axis=0)), name)


def _draw_scores(axes: Axes, masks: Artifact) -> None:
    """Draw the mean probabilities of all instances, sorted, and the threshold."""
    scores, moves = masks.read("instances/score"), masks.read("instances/transient")
    threshold, order = masks.facts["threshold"], np.argsort(-scores, kind="stable")
    above = scores >= threshold
    groups = {
        "transient": (moves, MASKED),
        "above the threshold, not masked": (~moves & above, LEFT_OUT),
        "static": (~moves & ~above, STATIC),
    }
    for label, (chosen, color) in groups.items():
        bars = np.flatnonzero(chosen[order])
        # Antialiasing would draw seams between many narrow bars.
        if len(bars):
            axes.bar(bars, scores[order[bars]], 1.0, antialiased=False, color=color, label=label)
    axes.axhline(threshold, color="black", linestyle="--", linewidth=1.2, label=f"threshold {threshold:g}")
    axes.set_title("The mean transient probability of each instance in the training frames", fontsize=10)
    axes.set(
        xlabel="instances, sorted",
        ylabel="mean transient probability",
        ylim=(0, 1),
        xlim=(-0.8, max(len(order), 10) - 0.2),
    )
    axes.legend(loc="upper right", fontsize=8)
