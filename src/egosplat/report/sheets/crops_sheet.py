"""Draw the OpenCLIP crops of some instances on one page, in order of time, with outlier views struck out."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.drawing import empty_grid, plt, split_page
from egosplat.features.aggregation import disagreement
from egosplat.features.crops import cut_crop
from egosplat.images import evenly_spaced
from egosplat.language.vectors import unit
from egosplat.models.configs import PHOTOS
from egosplat.report.sheets.sheet import sheet

# Maximum number of views of an instance.
COLUMNS = 12

# Number of often seen instances with the most different features.
DISTINCT = 6

# Share of all instances, those with the most views, that count as often seen: rows of one or two views say little.
OFTEN = 0.5

# Number of further instances, those with the most outliers.
MOST_OUTLIERS = 2

# Minimum IoU of two instances' boxes, averaged over the frames of either, at which they show one object at
# two levels.
SAME_THING = 0.5

# Description of the number above each crop, by ``features.mad_norm``; the number decides which views are
# outliers.
NUMBERS = {
    "element": "the share of feature channels that disagree with the other views",
    "euclidean": "its distance to the median of all views",
    "cosine": "1 - its cosine to the median of all views",
    "none": "no number, because every view counts",
}

# Side of a crop on the page [inches].
CELL = 1.25

# Gray level around objects, 0..1: it separates masked pixels from dark objects.
BACKGROUND = 0.12


@dataclass(frozen=True)
class Table:
    """R views, sorted by instance, then frame, of N instances; boxes are (R, 4) int32.

    Attributes:
        consistent: (N, D) float64 features of unit norm, 0 without views.
        hull: whether crops show convex hulls, see ``cut_crop``.
    """

    instance: NDArray[np.int32]
    frame: NDArray[np.int32]
    box: NDArray[np.int32]
    inlier: NDArray[np.bool_]
    level: NDArray[np.int8]
    consistent: NDArray[np.float64]
    hull: bool

    def rows(self, instance: int) -> NDArray[np.int64]:
        """Rows of the views of an instance."""
        return np.arange(*np.searchsorted(self.instance, [instance, instance + 1]))


@sheet(warned=("features",))
def run(
    frames: Artifact, instances: Artifact, view_features: Artifact, features: Artifact
) -> tuple[Figure, str]:
    """Draw the crops of some instances in order of time, with outlier views struck out."""
    instance, frame, box = map(view_features.read, ("instance", "frame", "box"))
    table = Table(
        instance,
        frame,
        box,
        features.read("inlier"),
        view_features.read("instances/level"),
        unit(features.read("consistent")),
        view_features.provenance["options"]["cut"] == "hull",
    )
    chosen = choose_instances(table)
    height = max(len(chosen), 1)
    figure = plt.figure(figsize=(COLUMNS * CELL + 0.4, height * (CELL + 0.62) + 1.0), layout="constrained")
    strips = split_page(figure, height, 1)
    for strip, instance in zip(strips, chosen, strict=False):
        numbers, limit = _numbers(view_features, features, table.rows(instance))
        strip.suptitle(_caption(features, table, instance, limit), fontsize=10, x=0.01, ha="left")
        cells = empty_grid(strip, 1, COLUMNS)[0]
        rows = choose_views(table, instance)
        _draw_views(cells, frames, instances, table, rows, numbers, view_features.facts["turned"])
    return figure, _summary(features, table)


def choose_instances(table: Table) -> list[int]:
    """Choose the instances to show, each of a different object.

    First the instance with the most views. Then, repeatedly, the often seen instance whose feature is least similar to
    all chosen ones. Last, the instances with the most outliers.
    """
    views = np.bincount(table.instance, minlength=len(table.level))
    outliers = np.bincount(table.instance[~table.inlier], minlength=len(table.level))
    often = (views > 0) & (views >= np.quantile(views[views > 0], 1 - OFTEN) if views.any() else False)
    similarity = np.full(len(views), -1.0)
    shown: list[int] = []
    while len(shown) < DISTINCT and often.any():
        instance = int(np.lexsort((-views, np.where(often, similarity, np.inf)))[0])
        often[instance] = False
        if _is_new(table, instance, shown):
            shown.append(instance)
            similarity = np.maximum(similarity, table.consistent @ table.consistent[instance])
    end = len(shown) + MOST_OUTLIERS
    for instance in np.argsort(-outliers, kind="stable").tolist():
        if len(shown) < end and outliers[instance] and _is_new(table, instance, shown):
            shown.append(instance)
    return shown


def _is_new(table: Table, instance: int, shown: list[int]) -> bool:
    """Whether an instance is not shown yet, at this or at another level."""
    return instance not in shown and all(overlap(table, instance, one) < SAME_THING for one in shown)


def overlap(table: Table, one: int, other: int) -> float:
    """IoU of two instances' boxes, averaged over all frames that show either."""
    first, second = table.rows(one), table.rows(other)
    common, left, right = np.intersect1d(table.frame[first], table.frame[second], return_indices=True)
    a, b = table.box[first[left]].astype(np.int64), table.box[second[right]].astype(np.int64)
    sides = np.minimum(a[:, 2:], b[:, 2:]) - np.maximum(a[:, :2], b[:, :2])
    both = np.clip(sides, 0, None).prod(axis=1)
    either = (a[:, 2:] - a[:, :2]).prod(axis=1) + (b[:, 2:] - b[:, :2]).prod(axis=1) - both
    frames = len(first) + len(second) - len(common)
    return float((both / np.maximum(either, 1)).sum() / max(frames, 1))


def choose_views(table: Table, instance: int) -> NDArray[np.int64]:
    """Choose the rows of views to show, in order of time: evenly spaced; outliers take up to half of the strip."""
    rows = table.rows(instance)
    outliers, others = rows[~table.inlier[rows]], rows[table.inlier[rows]]
    outliers = outliers[evenly_spaced(len(outliers), COLUMNS // 2)]
    others = others[evenly_spaced(len(others), COLUMNS - len(outliers))]
    return np.sort(np.concatenate([outliers, others]))


def _draw_views(
    cells: NDArray[Any],
    frames: Artifact,
    instances: Artifact,
    table: Table,
    rows: NDArray[np.int64],
    numbers: Mapping[int, str],
    turned: bool,
) -> None:
    for cell, row in zip(cells, rows.tolist(), strict=False):
        frame, instance = int(table.frame[row]), int(table.instance[row])
        labels = instances.row("labels", frame)[table.level[instance]]
        crop = cut_crop(frames.row("rgb", frame), labels, instance, table.box[row], hull=table.hull)
        crop = np.rot90(crop, -1) if turned else crop
        shown = np.where((crop == 0).all(axis=2, keepdims=True), np.uint8(255 * BACKGROUND), crop)
        cell.imshow(shown, interpolation="nearest" if len(crop) < 24 else "antialiased")
        if not table.inlier[row]:
            cell.plot([0, 1], [0, 1], color="crimson", linewidth=2.5, transform=cell.transAxes)
        color = "black" if table.inlier[row] else "crimson"
        number = f": {numbers[row]}" if numbers[row] else ""
        cell.set_title(f"{frame}{number}", fontsize=8, pad=2, color=color)


def _numbers(views: Artifact, features: Artifact, rows: NDArray[np.int64]) -> tuple[dict[int, str], float]:
    """The number above each view of an instance, by row, and the limit above which a view is an outlier."""
    options = features.provenance["options"]
    if options["mad_norm"] == "none":
        return dict.fromkeys(rows.tolist(), ""), 0.0
    values, limit = disagreement(views.read("feature")[rows], options["mad_norm"], options["mad_k"])
    return {int(row): f"{value:.2f}" for row, value in zip(rows, values, strict=True)}, limit


def _caption(features: Artifact, table: Table, instance: int, limit: float) -> str:
    rows = table.rows(instance)
    level = features.facts["levels"][table.level[instance]]
    outliers = int((~table.inlier[rows]).sum())
    struck = f", struck out above {limit:.2f}" if outliers else ""
    return f"instance {instance}, {level}: {len(rows)} views, {outliers} outliers{struck}"


def _summary(features: Artifact, table: Table) -> str:
    facts, options = features.facts, features.provenance["options"]
    model = "small" if facts["clip"]["small"] else facts["clip"]["model"]
    encoder = "ImageNet's classes" if model == PHOTOS else f"OpenCLIP ({model})"
    norm = options["mad_norm"]
    return (
        f"crops encoded by {encoder}, origin {features.origin}\n"
        f"{len(table.instance)} views of {len(np.unique(table.instance))} instances, {facts['outliers']} outliers "
        f"(MAD {norm}, k = {options['mad_k']:g}) struck out; above each crop: its frame and {NUMBERS[norm]}"
    )
