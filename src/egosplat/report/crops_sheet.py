"""What OpenCLIP was shown of some instances, on one page: their crops in order of time, outlier views struck out."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from egosplat.alarms.found import warnings_of
from egosplat.artifacts.features import FEATURES
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.reading import Artifact, open_artifact
from egosplat.artifacts.segments import SEGMENTS
from egosplat.artifacts.view_features import VIEW_FEATURES
from egosplat.errors import UserError
from egosplat.features.crops import cut_crop
from egosplat.output_files import check_output, picture_kind
from egosplat.plotting import plt, save_picture
from egosplat.report.heading import draw_heading

PAGE = picture_kind("egosplat crops-sheet")

COLUMNS = 12
"""At most so many views of an instance are shown."""

INSTANCES_A_LEVEL = 2
"""So many instances of each level are shown, those with the most views."""

MOST_OUTLIERS = 2
"""So many more are shown, of all levels those with the most outliers."""

CELL = 1.25
"""Side of a crop on the page, in inches."""

BACKGROUND = 0.12
"""Grey around crops, 0..1, so that the black of what is masked out is told from the page."""


@dataclass(frozen=True)
class _Sources:
    frames: Artifact
    segments: Artifact
    views: Artifact
    features: Artifact


@dataclass(frozen=True)
class Table:
    """Of R views, sorted by instance, then frame: instance and frame (R,) int32, box (R, 4) int32, inlier (R,) bool,
    cosine (R,) to the instance's consistent feature; level (N,) int8 of each instance."""

    instance: NDArray[np.int32]
    frame: NDArray[np.int32]
    box: NDArray[np.int32]
    inlier: NDArray[np.bool_]
    cosine: NDArray[np.float64]
    level: NDArray[np.int8]


def run(
    frames: Path, segments: Path, view_features: Path, features: Path, output: Path, *, title: str
) -> None:
    """Draw the page as PNG; the file appears when it is complete.

    Raises:
        UserError: features are of other views than ``view_features``.
    """
    check_output(output, PAGE)
    sources = _Sources(
        open_artifact(frames, FRAMES),
        open_artifact(segments, SEGMENTS),
        open_artifact(view_features, VIEW_FEATURES),
        open_artifact(features, FEATURES),
    )
    table = _read(sources.views, sources.features)
    chosen = choose_instances(table)
    rows = max(len(chosen), 1)
    figure = plt.figure(figsize=(COLUMNS * CELL + 0.4, rows * (CELL + 0.62) + 1.0), layout="constrained")
    draw_heading(figure, f"{title}: {_summary(sources, table)}", warnings_of(sources.features))
    strips = figure.subfigures(rows, 1, squeeze=False)[:, 0]
    for strip, instance in zip(strips, chosen, strict=False):
        strip.suptitle(_caption(sources, table, instance), fontsize=10, x=0.01, ha="left")
        cells = strip.subplots(1, COLUMNS, squeeze=False)[0]
        _draw_views(cells, sources, table, choose_views(table, instance))
    save_picture(figure, output, PAGE)


def _read(views: Artifact, features: Artifact) -> Table:
    instance, frame = views.read("instance"), views.read("frame")
    if features.shape("instance") != instance.shape or (features.read("instance") != instance).any():
        raise UserError(f"{features.path}: was made from other views than {views.path}; make it anew")
    cosine = (views.read("feature") * features.read("consistent")[instance]).sum(axis=1)
    length = np.linalg.norm(features.read("consistent"), axis=1)[instance]
    return Table(
        instance,
        frame,
        views.read("box"),
        features.read("inlier"),
        cosine / np.where(length > 0, length, 1.0),
        views.read("instances/level"),
    )


def choose_instances(table: Table) -> list[int]:
    """The instances to show: by level those with the most views, then of all those with the most outliers.

    One that is the same in every frame as one before it, as a thing without parts is at every level, is left out.
    """
    views = np.bincount(table.instance, minlength=len(table.level))
    outliers = np.bincount(table.instance[~table.inlier], minlength=len(table.level))
    shown: dict[bytes, int] = {}
    for level in np.unique(table.level):
        _add(shown, table, np.where(table.level == level, views, 0), INSTANCES_A_LEVEL)
    _add(shown, table, outliers, MOST_OUTLIERS)
    return list(shown.values())


def _add(shown: dict[bytes, int], table: Table, weight: NDArray[np.int64], most: int) -> None:
    """Add the heaviest instances, those of no weight never, by where they are in each frame."""
    end = len(shown) + most
    for instance in np.argsort(-weight, kind="stable"):
        if len(shown) == end or weight[instance] == 0:
            return
        rows = table.instance == instance
        shown.setdefault(table.frame[rows].tobytes() + table.box[rows].tobytes(), int(instance))


def choose_views(table: Table, instance: int) -> NDArray[np.int64]:
    """Rows of the views to show, in order of time: evenly spread, outliers first, up to half of the strip."""
    rows = np.flatnonzero(table.instance == instance)
    outliers = _spread(rows[~table.inlier[rows]], COLUMNS // 2)
    others = _spread(rows[table.inlier[rows]], COLUMNS - len(outliers))
    return np.sort(np.concatenate([outliers, others]))


def _spread(rows: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """At most so many of the rows, evenly spread from the first to the last."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), most)).round().astype(int))]


def _draw_views(cells: NDArray[np.object_], sources: _Sources, table: Table, rows: NDArray[np.int64]) -> None:
    for cell in cells:
        cell.set_axis_off()
    turned = sources.views.facts["turned"]
    for cell, row in zip(cells, rows, strict=False):
        frame, instance = table.frame[row], table.instance[row]
        labels = sources.segments.row("labels", frame)[table.level[instance]]
        crop = cut_crop(sources.frames.row("rgb", frame), labels, instance, table.box[row])
        _draw_crop(cell, np.rot90(crop, -1) if turned else crop, bool(table.inlier[row]))
        colour = "black" if table.inlier[row] else "crimson"
        cell.set_title(f"{frame}: {table.cosine[row]:.2f}", fontsize=8, pad=2, color=colour)


def _draw_crop(cell: Axes, crop: NDArray[np.uint8], inlier: bool) -> None:
    shown = np.where((crop == 0).all(axis=2, keepdims=True), np.uint8(255 * BACKGROUND), crop)
    cell.imshow(shown, interpolation="nearest" if len(crop) < 24 else "antialiased")
    if not inlier:
        cell.plot([0, 1], [0, 1], color="crimson", linewidth=2.5, transform=cell.transAxes)


def _caption(sources: _Sources, table: Table, instance: int) -> str:
    rows = table.instance == instance
    level = sources.features.facts["levels"][table.level[instance]]
    return (
        f"instance {instance}, {level}: {int(rows.sum())} views, {int((~table.inlier[rows]).sum())} outliers; "
        f"cosine to the consistent feature {table.cosine[rows].mean():.2f} on average"
    )


def _summary(sources: _Sources, table: Table) -> str:
    facts, options = sources.features.facts, sources.features.provenance["options"]
    model = "small" if facts["clip"]["small"] else facts["clip"]["model"]
    return (
        f"crops as OpenCLIP ({model}) sees them, origin {sources.features.origin}\n"
        f"{len(table.instance)} views of {len(np.unique(table.instance))} instances, {facts['outliers']} outliers "
        f"(MAD {options['mad_norm']}, k = {options['mad_k']:g}) struck out; above each its frame and its cosine to "
        "the consistent feature"
    )
