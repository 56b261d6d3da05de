"""Draw transient objects on one page: frames, predicted probability, masks, and renders without them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import SubFigure
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from egosplat.alarms.artifact_alarms import warnings_of
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.instances import INSTANCES
from egosplat.artifacts.masks import MASKS
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.splats import SPLATS, camera_poses
from egosplat.artifacts.transient import TRANSIENT
from egosplat.drawing import add_name, draw_heading, inner_point, middles_of_parts, plt, save_figure, show
from egosplat.query.scene import read_trained_scene

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

# Colors of transient instances, of static ones, and of those above the threshold at a level that is not
# used.
MASKED, STATIC, OTHER_LEVEL = "crimson", "0.7", "lightpink"

# Opacity of the color of masked pixels.
TINT = 0.4

# Opacity of the heat map.
HEAT = 0.75


@dataclass(frozen=True)
class _Sources:
    frames: Artifact
    poses: Artifact
    transient: Artifact
    instances: Artifact
    masks: Artifact
    splats: Artifact


def run(
    frames_path: Path,
    poses_path: Path,
    transient_path: Path,
    instances_path: Path,
    masks_path: Path,
    splats_path: Path,
    output: Path,
    *,
    title: str,
) -> None:
    """Draw the page as PNG, atomically.

    Raises:
        UserError: the inputs do not belong together.
    """
    paths = (frames_path, poses_path, transient_path, instances_path, masks_path, splats_path)
    sources = _Sources(*map(open_artifact, paths, (FRAMES, POSES, TRANSIENT, INSTANCES, MASKS, SPLATS)))
    _check(sources)
    shown = choose_frames(_masked_shares(sources.masks), sources.poses.read("registered"))
    _, height, width, _ = sources.frames.shape("rgb")
    columns = max(len(shown), 3)
    pictures = 4 * (CELL * height / width + 0.25)
    figure = plt.figure(figsize=(CELL * columns + 0.9, pictures + CHART + 1.0), layout="constrained")
    draw_heading(figure, f"{title}: {_summary(sources)}", warnings_of(sources.transient, sources.masks))
    above, below = figure.subfigures(2, 1, height_ratios=(pictures, CHART))
    _draw_frames(above, sources, shown, columns)
    _draw_scores(below.subplots(), sources.masks, sources.instances)
    save_figure(figure, output)


def _check(sources: _Sources) -> None:
    check_made_from(sources.splats, sources.poses)
    for artifact in (sources.poses, sources.instances, sources.transient, sources.splats):
        check_made_from(artifact, sources.frames)
    check_made_from(sources.masks, sources.instances, sources.transient)
    check_made_from(sources.splats, sources.transient, sources.masks)


def _masked_shares(masks: Artifact) -> NDArray[np.float64]:
    """(F,) masked share of each frame."""
    return np.array([masks.row("refined", frame).mean() for frame in range(masks.shape("refined")[0])])


def choose_frames(masked: NDArray[np.float64], posed: NDArray[np.bool_]) -> list[int]:
    """Choose the frames to show, in order of time.

    The frames with masked pixels are split into ``MOVING`` equal parts; each part gives the frame with the largest masked
    share. The remaining frames have no masked pixel and are evenly spaced.

    Args:
        masked: (F,) masked share of each frame.
        posed: (F,) which frames have a pose; only these can be rendered.
    """
    moving, still = np.flatnonzero(posed & (masked > 0)), np.flatnonzero(posed & (masked == 0))
    # The outer quarters of a part are left out, so that no two frames are neighbors.
    middles = [part[len(part) // 4 : len(part) - len(part) // 4] for part in np.array_split(moving, MOVING)]
    most = [int(middle[np.argmax(masked[middle])]) for middle in middles if len(middle)]
    spread = still[middles_of_parts(len(still), PICTURES - len(most))].tolist()
    return sorted(most + spread)


def _summary(sources: _Sources) -> str:
    facts, masking = sources.masks.facts, sources.splats.provenance["options"]["masking"]
    trained_on = {
        "none": "all pixels",
        "initial": "all pixels, with less weight where the probability is high",
    }
    return (
        f"{facts['transient']} of {facts['instances']} instances are transient, {facts['masked_share']:.1%} of all "
        f"pixels; origin {sources.masks.origin}\n"
        f"an instance is transient if its score is {facts['threshold']:g} or more (levels: {facts['level']}); "
        f"the Gaussians were trained on {trained_on.get(masking, 'the unmasked pixels')}"
    )


def _draw_frames(page: SubFigure, sources: _Sources, shown: list[int], columns: int) -> None:
    grid = page.subplots(4, columns, squeeze=False)
    for cell in grid.flat:
        cell.set_axis_off()
    times, scene = sources.frames.read("timestamp_ns"), read_trained_scene(sources.splats, "auto")
    poses = camera_poses(sources.poses, sources.splats)
    heat = None
    for column, frame in enumerate(shown):
        photograph = sources.frames.row("rgb", frame)
        show(grid[0, column], photograph, f"frame {frame}, {(times[frame] - times[0]) * 1e-9:.1f} s")
        heat = _draw_probability(grid[1, column], photograph, sources.transient.row("probability", frame))
        _draw_mask(grid[2, column], photograph, sources, frame)
        show(grid[3, column], scene.picture(scene.camera, poses[frame]), "rendered from the Gaussians")
    if heat is not None:
        bar = page.colorbar(heat, ax=grid[1].tolist(), pad=0.01, label="transient probability")
        bar.solids.set_alpha(1.0)


def _draw_probability(
    cell: Axes, photograph: NDArray[np.uint8], probability: NDArray[np.float16]
) -> AxesImage:
    """Draw the probability over the photograph, shown in gray."""
    values = np.nan_to_num(probability.astype(np.float32))
    show(cell, photograph.mean(axis=2), f"transient probability: mean {values.mean():.1%}", cmap="gray")
    return cell.imshow(values, cmap="inferno", vmin=0.0, vmax=1.0, alpha=HEAT)


def _draw_mask(cell: Axes, photograph: NDArray[np.uint8], sources: _Sources, frame: int) -> None:
    """Tint and outline the masked pixels, and name their largest instances."""
    mask = sources.masks.row("refined", frame)
    tint = 255.0 * np.array(to_rgb(MASKED))
    shown = np.where(mask[..., None], (1 - TINT) * photograph + TINT * tint, photograph)
    heading = f"masked: {mask.mean():.1%}, instance: score" if mask.any() else "nothing masked"
    show(cell, shown.astype(np.uint8), heading)
    if mask.any() and not mask.all():
        cell.contour(mask, levels=[0.5], colors="white", linewidths=1.2)
    scores, moves = sources.masks.read("instances/score"), sources.masks.read("instances/transient")
    for u, v, instance in label_places(sources.instances.row("labels", frame), moves):
        add_name(cell, u, v, f"{instance}: {scores[instance]:.2f}")


def label_places(labels: NDArray[np.int32], moves: NDArray[np.bool_]) -> list[tuple[int, int, int]]:
    """Column, row and index of the instances to name, the largest first.

    Args:
        labels: (L, H, W) instance at each level, -1 for none.
        moves: (N,) which instances may be named.
    """
    _, height, width = labels.shape
    sizes = np.bincount(labels[labels >= 0], minlength=len(moves)) * moves
    places: list[tuple[int, int, int]] = []
    for instance in np.argsort(-sizes, kind="stable"):
        if len(places) == LABELS or sizes[instance] == 0:
            break
        u, v = inner_point((labels == instance).any(axis=0))
        # A part and its whole have about the same middle: only one of their names fits.
        if all(abs(u - x) > 0.25 * width or abs(v - y) > 0.08 * height for x, y, _ in places):
            places.append((u, v, int(instance)))
    return places


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
