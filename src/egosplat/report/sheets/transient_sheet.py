"""Draw transient objects on one page: frames, predicted probability, masks, and renders without them."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import camera_poses
from egosplat.drawing import add_name, empty_grid, inner_point, middles_of_parts, plt, show, split_page
from egosplat.query.scene import read_trained_scene
from egosplat.report.sheets.sheet import sheet

# Maximum number of frames.
PICTURES = 5

# Maximum number of frames with masked pixels.
MOVING = 4

# Maximum number of bars with a name: more names would overlap.
NAMED_BARS = 80

# Maximum number of named instances in a frame, the largest first.
LABELS = 4

# Width of an image on the page [inches].
CELL = 2.9

# Height of the chart [inches].
CHART = 2.6

# Colors of transient instances, of static ones, and of those above the threshold at a level that is not used.
MASKED, STATIC, OTHER_LEVEL = "crimson", "0.7", "lightpink"

# Opacity of the color of masked pixels.
TINT = 0.4

# Opacity of the heat map.
HEAT = 0.75


@sheet(warned=("transient", "masks"))
def run(
    frames: Artifact,
    poses: Artifact,
    transient: Artifact,
    instances: Artifact,
    masks: Artifact,
    splats: Artifact,
) -> tuple[Figure, str]:
    """Draw frames, predicted probability, masks, renders, and the scores of all instances."""
    shares = [masks.row("refined", frame).mean() for frame in range(masks.shape("refined")[0])]
    shown = choose_frames(np.array(shares), poses.read("registered"))
    _, height, width, _ = frames.shape("rgb")
    columns = max(len(shown), 3)
    pictures = 4 * (CELL * height / width + 0.25)
    figure = plt.figure(figsize=(CELL * columns + 0.9, pictures + CHART + 1.0), layout="constrained")
    above, below = split_page(figure, 2, 1, height_ratios=(pictures, CHART))
    grid = empty_grid(above, 4, columns)
    times, scene = frames.read("timestamp_ns"), read_trained_scene(splats, "auto")
    camera_to_world = camera_poses(poses, splats)
    heat = None
    for column, frame in enumerate(shown):
        photograph = frames.row("rgb", frame)
        show(grid[0, column], photograph, f"frame {frame}, {(times[frame] - times[0]) * 1e-9:.1f} s")
        heat = _draw_probability(grid[1, column], photograph, transient.row("probability", frame))
        _draw_mask(grid[2, column], photograph, masks, instances, frame)
        render = scene.picture(scene.camera, camera_to_world[frame])
        show(grid[3, column], render, "rendered from the Gaussians")
    if heat is not None:
        bar = above.colorbar(heat, ax=grid[1].tolist(), pad=0.01, label="transient probability")
        assert bar.solids is not None
        bar.solids.set_alpha(1.0)
    _draw_scores(below.subplots(), masks, instances)
    return figure, _summary(masks, splats)


def choose_frames(masked: NDArray[np.float64], posed: NDArray[np.bool_]) -> list[int]:
    """Choose the frames to show, in order of time, by their (F,) masked shares and whether they have a pose, to be rendered.

    The frames with masked pixels are split into ``MOVING`` equal parts; each part gives the frame with the largest masked
    share. The remaining frames have no masked pixel and are evenly spaced.
    """
    moving, still = np.flatnonzero(posed & (masked > 0)), np.flatnonzero(posed & (masked == 0))
    # The outer quarters of a part are left out, so that no two frames are neighbors.
    middles = [part[len(part) // 4 : len(part) - len(part) // 4] for part in np.array_split(moving, MOVING)]
    most = [int(middle[np.argmax(masked[middle])]) for middle in middles if len(middle)]
    spread = still[middles_of_parts(len(still), PICTURES - len(most))].tolist()
    return sorted(most + spread)


def _summary(masks: Artifact, splats: Artifact) -> str:
    facts, masking = masks.facts, splats.provenance["options"]["masking"]
    trained_on = {"none": "all pixels"}
    trained_on["initial"] = "all pixels, with less weight where the probability is high"
    return (
        f"{facts['transient']} of {facts['instances']} instances are transient, {facts['masked_share']:.1%} of all "
        f"pixels; origin {masks.origin}\n"
        f"an instance is transient if its score is {facts['threshold']:g} or more (levels: {facts['level']}); "
        f"the Gaussians were trained on {trained_on.get(masking, 'the unmasked pixels')}"
    )


def _draw_probability(
    cell: Axes, photograph: NDArray[np.uint8], probability: NDArray[np.float16]
) -> AxesImage:
    """Draw the probability over the photograph, shown in gray."""
    values = probability.astype(np.float32)
    show(cell, photograph.mean(axis=2), f"transient probability: mean {values.mean():.1%}", cmap="gray")
    return cell.imshow(values, cmap="inferno", vmin=0.0, vmax=1.0, alpha=HEAT)


def _draw_mask(
    cell: Axes, photograph: NDArray[np.uint8], masks: Artifact, instances: Artifact, frame: int
) -> None:
    """Tint and outline the masked pixels, and name their largest instances."""
    mask = masks.row("refined", frame)
    tint = 255.0 * np.array(to_rgb(MASKED))
    shown = np.where(mask[..., None], (1 - TINT) * photograph + TINT * tint, photograph)
    heading = f"masked: {mask.mean():.1%}, instance: score" if mask.any() else "nothing masked"
    show(cell, shown.astype(np.uint8), heading)
    if mask.any() and not mask.all():
        cell.contour(mask, levels=[0.5], colors="white", linewidths=1.2)
    labels, scores = instances.row("labels", frame), masks.read("instances/score")
    for instance in largest(labels, masks.read("instances/transient")):
        add_name(cell, *inner_point((labels == instance).any(axis=0)), f"{instance}: {scores[instance]:.2f}")


def largest(labels: NDArray[np.int32], moves: NDArray[np.bool_]) -> list[int]:
    """The instances to name, the largest first: of (L, H, W) labels, -1 for none, those that the (N,) flags allow."""
    sizes = np.bincount(labels[labels >= 0], minlength=len(moves)) * moves
    return [int(one) for one in np.argsort(-sizes, kind="stable")[:LABELS] if sizes[one]]


def _draw_scores(axes: Axes, masks: Artifact, instances: Artifact) -> None:
    """Draw the scores of all instances, sorted, and the threshold."""
    scores, moves = masks.read("instances/score"), masks.read("instances/transient")
    level, names = instances.read("instances/level"), instances.facts["levels"]
    threshold = masks.facts["threshold"]
    order = np.argsort(-scores, kind="stable")
    named = len(order) <= NAMED_BARS
    other = ~moves & (scores >= threshold)
    groups = ((moves, MASKED, "transient"), (other, OTHER_LEVEL, "at a level that is not used"))
    for chosen, color, label in (*groups, (~moves & ~other, STATIC, "static")):
        places = np.flatnonzero(chosen[order])
        # Antialiasing would draw seams between many narrow bars.
        options = {"width": 0.8 if named else 1.0, "antialiased": False, "color": color, "label": label}
        if len(places):
            axes.bar(places, scores[order[places]], **options)
    axes.axhline(threshold, color="black", linestyle="--", linewidth=1.2, label=f"threshold {threshold:g}")
    if named:
        ticks = [f"{instance} {names[level[instance]]}" for instance in order]
        axes.set_xticks(range(len(order)), ticks, rotation=90, fontsize=6)
    else:
        axes.set_xlabel("instances, sorted by score")
    axes.set_title(
        "score: mean transient probability over all pixels of an instance in the training frames", fontsize=10
    )
    axes.set(ylabel="score", ylim=(0, 1), xlim=(-0.8, max(len(order), 10) - 0.2))
    axes.legend(loc="upper right", fontsize=8)
