"""What OpenCLIP was shown of some instances, on one page: their crops in order of time, outlier views struck out."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from egosplat.alarms.artifact_alarms import warnings_of
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.features import FEATURES
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.segments import SEGMENTS
from egosplat.artifacts.view_features import VIEW_FEATURES
from egosplat.codes.vectors import unit, usable
from egosplat.features.aggregation import disagreement
from egosplat.features.crops import cut_crop
from egosplat.output_files import check_output, picture_kind
from egosplat.report.figure import draw_heading, evenly_spaced, plt, save_figure

PAGE = picture_kind("egosplat crops-sheet")

COLUMNS = 12
"""At most so many views of an instance are shown."""

DISTINCT = 6
"""So many instances are shown that are seen often and differ most in what they mean."""

OFTEN = 0.5
"""This share of all instances, those with the most views, count as seen often: rows of a view or two say little."""

MOST_OUTLIERS = 2
"""So many more are shown, those with the most outliers."""

SAME_THING = 0.5
"""Intersection over union of two instances' boxes, on average over all frames of either, from which on they are taken
for one thing at two levels."""

NUMBERS = {
    "element": "the share of the feature's channels in which it disagrees with the other views",
    "euclidean": "its distance to the median of all views",
    "cosine": "1 - its cosine to the median of all views",
    "none": "nothing, for every view counts",
}
"""By the key ``features.mad_norm``, the number above each crop: the one that decides which views are outliers."""

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
    """Of R views, sorted by instance, then frame: instance and frame (R,) int32, box (R, 4) int32, inlier (R,) bool;
    of N instances: level (N,) int8, consistent (N, D) float64 features of unit norm, 0 without views."""

    instance: NDArray[np.int32]
    frame: NDArray[np.int32]
    box: NDArray[np.int32]
    inlier: NDArray[np.bool_]
    level: NDArray[np.int8]
    consistent: NDArray[np.float64]

    def rows(self, instance: int) -> NDArray[np.int64]:
        """Of the views of an instance."""
        return np.arange(*np.searchsorted(self.instance, [instance, instance + 1]))


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
    height = max(len(chosen), 1)
    figure = plt.figure(figsize=(COLUMNS * CELL + 0.4, height * (CELL + 0.62) + 1.0), layout="constrained")
    draw_heading(figure, f"{title}: {_summary(sources, table)}", warnings_of(sources.features))
    strips = figure.subfigures(height, 1, squeeze=False)[:, 0]
    for strip, instance in zip(strips, chosen, strict=False):
        numbers, limit = _numbers(sources, table, instance)
        strip.suptitle(_caption(sources, table, instance, limit), fontsize=10, x=0.01, ha="left")
        cells = strip.subplots(1, COLUMNS, squeeze=False)[0]
        rows = choose_views(table, instance)
        _draw_views(cells, sources, table, rows, [numbers[row] for row in rows.tolist()])
    save_figure(figure, output, PAGE)


def _read(views: Artifact, features: Artifact) -> Table:
    check_made_from(features, views, axes=("view",))
    return Table(
        views.read("instance"),
        views.read("frame"),
        views.read("box"),
        features.read("inlier"),
        views.read("instances/level"),
        unit(features.read("consistent")),
    )


def choose_instances(table: Table) -> list[int]:
    """The instances to show, each of another thing.

    First the one with the most views, then, of those that are seen often, the one that is least alike in meaning to all
    before it, and so on; at last those with the most outliers.
    """
    views = np.bincount(table.instance, minlength=len(table.level))
    outliers = np.bincount(table.instance[~table.inlier], minlength=len(table.level))
    often = (views > 0) & (views >= np.quantile(views[views > 0], 1 - OFTEN) if views.any() else False)
    alike = np.full(len(views), -1.0)
    shown: list[int] = []
    while len(shown) < DISTINCT and often.any():
        one = int(np.lexsort((-views, np.where(often, alike, np.inf)))[0])
        often[one] = False
        if _is_new(table, one, shown):
            shown.append(one)
            alike = np.maximum(alike, table.consistent @ table.consistent[one])
    end = len(shown) + MOST_OUTLIERS
    for one in np.argsort(-outliers, kind="stable").tolist():
        if len(shown) < end and outliers[one] and _is_new(table, one, shown):
            shown.append(one)
    return shown


def _is_new(table: Table, instance: int, shown: list[int]) -> bool:
    """Whether an instance is neither among those shown nor one of their things at another level."""
    return instance not in shown and all(overlap(table, instance, one) < SAME_THING for one in shown)


def overlap(table: Table, one: int, other: int) -> float:
    """Intersection over union of two instances' boxes, on average over all frames in which either is."""
    first, second = table.rows(one), table.rows(other)
    common, left, right = np.intersect1d(table.frame[first], table.frame[second], return_indices=True)
    a, b = table.box[first[left]].astype(np.int64), table.box[second[right]].astype(np.int64)
    sides = np.minimum(a[:, 2:], b[:, 2:]) - np.maximum(a[:, :2], b[:, :2])
    both = np.clip(sides, 0, None).prod(axis=1)
    either = (a[:, 2:] - a[:, :2]).prod(axis=1) + (b[:, 2:] - b[:, :2]).prod(axis=1) - both
    frames = len(first) + len(second) - len(common)
    return float((both / np.maximum(either, 1)).sum() / max(frames, 1))


def choose_views(table: Table, instance: int) -> NDArray[np.int64]:
    """Rows of the views to show, in order of time: evenly spread, outliers first, up to half of the strip."""
    rows = table.rows(instance)
    outliers, others = rows[~table.inlier[rows]], rows[table.inlier[rows]]
    outliers = outliers[evenly_spaced(len(outliers), COLUMNS // 2)]
    others = others[evenly_spaced(len(others), COLUMNS - len(outliers))]
    return np.sort(np.concatenate([outliers, others]))


def _draw_views(
    cells: NDArray[np.object_], sources: _Sources, table: Table, rows: NDArray[np.int64], numbers: list[str]
) -> None:
    for cell in cells:
        cell.set_axis_off()
    turned = sources.views.facts["turned"]
    for cell, row, number in zip(cells, rows, numbers, strict=False):
        frame, instance = table.frame[row], table.instance[row]
        labels = sources.segments.row("labels", frame)[table.level[instance]]
        crop = cut_crop(sources.frames.row("rgb", frame), labels, instance, table.box[row])
        _draw_crop(cell, np.rot90(crop, -1) if turned else crop, bool(table.inlier[row]))
        colour = "black" if table.inlier[row] else "crimson"
        cell.set_title(f"{frame}: {number}" if number else f"{frame}", fontsize=8, pad=2, color=colour)


def _draw_crop(cell: Axes, crop: NDArray[np.uint8], inlier: bool) -> None:
    shown = np.where((crop == 0).all(axis=2, keepdims=True), np.uint8(255 * BACKGROUND), crop)
    cell.imshow(shown, interpolation="nearest" if len(crop) < 24 else "antialiased")
    if not inlier:
        cell.plot([0, 1], [0, 1], color="crimson", linewidth=2.5, transform=cell.transAxes)


def _numbers(sources: _Sources, table: Table, instance: int) -> tuple[dict[int, str], float]:
    """Of each view of an instance, by its row, the number that decides whether it counts; and the largest that counts."""
    options = sources.features.provenance["options"]
    rows = table.rows(instance)
    feature = sources.views.read("feature")[rows]
    good = usable(feature)
    if options["mad_norm"] == "none" or not good.any():
        return dict.fromkeys(rows.tolist(), ""), 0.0
    found, limit = disagreement(feature[good], options["mad_norm"], options["mad_k"])
    told = dict.fromkeys(rows.tolist(), "no feature")
    return told | {int(row): f"{number:.2f}" for row, number in zip(rows[good], found, strict=True)}, limit


def _caption(sources: _Sources, table: Table, instance: int, limit: float) -> str:
    rows = table.rows(instance)
    level = sources.features.facts["levels"][table.level[instance]]
    outliers = int((~table.inlier[rows]).sum())
    struck = f", struck out above {limit:.2f}" if outliers else ""
    return f"instance {instance}, {level}: {len(rows)} views, {outliers} outliers{struck}"


def _summary(sources: _Sources, table: Table) -> str:
    facts, options = sources.features.facts, sources.features.provenance["options"]
    model = "small" if facts["clip"]["small"] else facts["clip"]["model"]
    norm = options["mad_norm"]
    return (
        f"crops as OpenCLIP ({model}) sees them, origin {sources.features.origin}\n"
        f"{len(table.instance)} views of {len(np.unique(table.instance))} instances, {facts['outliers']} outliers "
        f"(MAD {norm}, k = {options['mad_k']:g}) struck out; above each its frame and {NUMBERS[norm]}"
    )
