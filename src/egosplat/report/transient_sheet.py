"""What moves, on one page: photographs, where the network sees something move, what is masked, and what is left."""

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
from egosplat.artifacts.masks import MASKS
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.segments import SEGMENTS
from egosplat.artifacts.splats import SPLATS
from egosplat.artifacts.transient import TRANSIENT
from egosplat.output_files import check_output, picture_kind
from egosplat.query.scene import read_trained_scene
from egosplat.report.figure import draw_heading, middles_of_parts, plt, save_figure
from egosplat.report.page_text import add_name

PAGE = picture_kind("egosplat transient-sheet")

PICTURES = 5
"""At most so many frames are shown."""

MOVING = 4
"""At most so many of them with something masked."""

NAMED_BARS = 80
"""At most so many bars are named: more names would lie on one another."""

LABELS = 4
"""At most so many instances of a frame are named, the largest first."""

CELL = 2.9
"""Width of a picture on the page, in inches."""

CHART = 2.6
"""Height of the chart, in inches."""

MASKED, STATIC, OTHER_LEVEL = "crimson", "0.7", "lightpink"
"""Colours of instances that move, that do not, and that would but are of a level that is not asked for."""

TINT = 0.4
"""Share of the colour over what is masked."""

HEAT = 0.75
"""Share of the heat map over the photograph."""


@dataclass(frozen=True)
class _Sources:
    frames: Artifact
    poses: Artifact
    transient: Artifact
    segments: Artifact
    masks: Artifact
    splats: Artifact


def run(
    frames: Path,
    poses: Path,
    transient: Path,
    segments: Path,
    masks: Path,
    splats: Path,
    output: Path,
    *,
    title: str,
) -> None:
    """Draw the page as PNG; the file appears when it is complete.

    Raises:
        UserError: the inputs do not belong together.
    """
    check_output(output, PAGE)
    sources = _open(frames, poses, transient, segments, masks, splats)
    shown = choose_frames(_masked_shares(sources.masks), sources.poses.read("registered"))
    _, height, width, _ = sources.frames.shape("rgb")
    columns = max(len(shown), 3)
    pictures = 4 * (CELL * height / width + 0.25)
    figure = plt.figure(figsize=(CELL * columns + 0.9, pictures + CHART + 1.0), layout="constrained")
    draw_heading(figure, f"{title}: {_summary(sources)}", warnings_of(sources.transient, sources.masks))
    above, below = figure.subfigures(2, 1, height_ratios=(pictures, CHART))
    _draw_frames(above, sources, shown, columns)
    _draw_scores(below.subplots(), sources.masks, sources.segments)
    save_figure(figure, output, PAGE)


def _open(frames: Path, poses: Path, transient: Path, segments: Path, masks: Path, splats: Path) -> _Sources:
    pictures, found = open_artifact(frames, FRAMES), open_artifact(segments, SEGMENTS)
    predicted, refined = open_artifact(transient, TRANSIENT), open_artifact(masks, MASKS)
    walk, trained = open_artifact(poses, POSES), open_artifact(splats, SPLATS)
    check_made_from(trained, walk)
    for artifact in (walk, found, predicted, trained):
        check_made_from(artifact, pictures)
    check_made_from(refined, found, predicted)
    check_made_from(trained, predicted, refined)
    return _Sources(pictures, walk, predicted, found, refined, trained)


def _masked_shares(masks: Artifact) -> NDArray[np.float64]:
    """(F,) share of each frame that is masked."""
    return np.array([masks.row("refined", frame).mean() for frame in range(masks.shape("refined")[0])])


def choose_frames(masked: NDArray[np.float64], posed: NDArray[np.bool_]) -> list[int]:
    """The frames to show, in order of time.

    Of each of ``MOVING`` equally long parts of the frames with something masked the one with the most, not too near
    the part's ends, that no two are neighbours; the rest are frames without anything masked, evenly spread.

    Args:
        masked: (F,) share of each frame that is masked.
        posed: (F,) which frames have a pose; only they can be rendered.
    """
    moving, still = np.flatnonzero(posed & (masked > 0)), np.flatnonzero(posed & (masked == 0))
    middles = [part[len(part) // 4 : len(part) - len(part) // 4] for part in np.array_split(moving, MOVING)]
    most = [int(middle[np.argmax(masked[middle])]) for middle in middles if len(middle)]
    spread = still[middles_of_parts(len(still), PICTURES - len(most))].tolist()
    return sorted(most + spread)


def _summary(sources: _Sources) -> str:
    facts, masking = sources.masks.facts, sources.splats.provenance["options"]["masking"]
    trained = {"none": "all pixels", "initial": "all pixels, less where the probability is high"}
    return (
        f"{facts['transient']} of {facts['instances']} instances move, {facts['masked_share']:.1%} of all pixels; "
        f"origin {sources.masks.origin}\n"
        f"instances move whose score is {facts['threshold']:g} or more (levels: {facts['level']}); "
        f"the Gaussians were trained on {trained.get(masking, 'what is not masked')}"
    )


def _draw_frames(page: SubFigure, sources: _Sources, shown: list[int], columns: int) -> None:
    grid = page.subplots(4, columns, squeeze=False)
    for cell in grid.flat:
        cell.set_axis_off()
    times, scene = sources.frames.read("timestamp_ns"), read_trained_scene(sources.splats, "auto")
    poses = sources.poses.read("camera_to_world")
    heat = None
    for column, frame in enumerate(shown):
        photograph = sources.frames.row("rgb", frame)
        _show(grid[0, column], photograph, f"frame {frame}, {(times[frame] - times[0]) * 1e-9:.1f} s")
        heat = _draw_probability(grid[1, column], photograph, sources.transient.row("probability", frame))
        _draw_mask(grid[2, column], photograph, sources, frame)
        _show(grid[3, column], scene.picture(scene.camera, poses[frame]), "rendered from the Gaussians")
    if heat is not None:
        bar = page.colorbar(heat, ax=grid[1].tolist(), pad=0.01, label="probability of moving")
        bar.solids.set_alpha(1.0)


def _draw_probability(
    cell: Axes, photograph: NDArray[np.uint8], probability: NDArray[np.float16]
) -> AxesImage:
    """Lay the probability over the photograph in grey."""
    values = np.nan_to_num(probability.astype(np.float32))
    _show(
        cell, photograph.mean(axis=2), f"probability of moving: {values.mean():.1%} on average", cmap="gray"
    )
    return cell.imshow(values, cmap="inferno", vmin=0.0, vmax=1.0, alpha=HEAT)


def _draw_mask(cell: Axes, photograph: NDArray[np.uint8], sources: _Sources, frame: int) -> None:
    """Tint and outline what is masked, and name its largest instances."""
    mask = sources.masks.row("refined", frame)
    tint = 255.0 * np.array(to_rgb(MASKED))
    shown = np.where(mask[..., None], (1 - TINT) * photograph + TINT * tint, photograph)
    heading = f"masked: {mask.mean():.1%}, instance: score" if mask.any() else "nothing masked"
    _show(cell, shown.astype(np.uint8), heading)
    if mask.any() and not mask.all():
        cell.contour(mask, levels=[0.5], colors="white", linewidths=1.2)
    scores, moves = sources.masks.read("instances/score"), sources.masks.read("instances/transient")
    for u, v, instance in label_places(sources.segments.row("labels", frame), moves):
        add_name(cell, u, v, f"{instance}: {scores[instance]:.2f}")


def label_places(labels: NDArray[np.int32], moves: NDArray[np.bool_]) -> list[tuple[int, int, int]]:
    """Column, row and number of the instances to name, the largest first.

    One whose name would lie on another's is left out, as a part is at the place of its whole.

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
        _, rows, columns = np.nonzero(labels == instance)
        # The pixel nearest to the middle: the middle itself may lie outside.
        nearest = np.argmin((rows - np.median(rows)) ** 2 + (columns - np.median(columns)) ** 2)
        u, v = int(columns[nearest]), int(rows[nearest])
        if all(abs(u - x) > 0.25 * width or abs(v - y) > 0.08 * height for x, y, _ in places):
            places.append((u, v, int(instance)))
    return places


def _draw_scores(axes: Axes, masks: Artifact, segments: Artifact) -> None:
    """The instances by score, and the threshold."""
    scores, moves = masks.read("instances/score"), masks.read("instances/transient")
    level, names = segments.read("instances/level"), segments.facts["levels"]
    threshold = masks.facts["threshold"]
    order = np.argsort(-scores, kind="stable")
    named = len(order) <= NAMED_BARS
    other = ~moves & (scores >= threshold)
    groups = ((moves, MASKED, "moves"), (other, OTHER_LEVEL, "of a level not asked for"))
    for chosen, colour, label in (*groups, (~moves & ~other, STATIC, "stays")):
        places = np.flatnonzero(chosen[order])
        # Without smoothed edges many narrow bars show no seams.
        options = {"width": 0.8 if named else 1.0, "antialiased": False, "color": colour, "label": label}
        if len(places):
            axes.bar(places, scores[order[places]], **options)
    axes.axhline(threshold, color="black", linestyle="--", linewidth=1.2, label=f"threshold {threshold:g}")
    if named:
        ticks = [f"{instance} {names[level[instance]]}" for instance in order]
        axes.set_xticks(range(len(order)), ticks, rotation=90, fontsize=6)
    else:
        axes.set_xlabel("instances, by score")
    axes.set_title("score: mean probability over all pixels of the instance in all frames", fontsize=10)
    axes.set(ylabel="score", ylim=(0, 1), xlim=(-0.8, max(len(order), 10) - 0.2))
    axes.legend(loc="upper right", fontsize=8)


def _show(cell: Axes, picture: NDArray, title: str, **options: str) -> None:
    cell.imshow(picture, **options)
    cell.set_title(title, fontsize=9)
