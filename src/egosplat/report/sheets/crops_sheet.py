"""Draw the OpenCLIP crops of some instances on one page, in order of time, with outlier views struck out."""

import numpy as np
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray

from egosplat.arrays import Array, Bools, Ints, Ints32
from egosplat.artifacts.reader import Artifact
from egosplat.drawing import empty_grid, plt, split_page
from egosplat.features.aggregation import MAD_K, disagreement
from egosplat.features.crops import cut_crop
from egosplat.images import evenly_spaced
from egosplat.language.vectors import unit
from egosplat.models.checkpoints import PHOTOS
from egosplat.report.sheets.sheet import sheet

# Maximum number of views of an instance.
COLUMNS = 12

# Number of often seen instances with the most different features, and of further ones, those with the most outliers.
DISTINCT, MOST_OUTLIERS = 6, 2

# Share of the instances, those with the most views, that count as often seen: rows of one or two views say little.
OFTEN = 0.5

# Side of a crop [inches], and gray level around objects, 0..255: it separates masked pixels from dark objects.
CELL, BACKGROUND = 1.25, 30


@sheet("features")
def run(
    frames: Artifact, instances: Artifact, view_features: Artifact, features: Artifact
) -> tuple[Figure, str]:
    """Draw the crops of some instances in order of time, with outlier views struck out."""
    facts, norm = features.facts, features.provenance["options"]["mad_norm"]
    owner, level = view_features.read("instance"), view_features.read("instances/level")
    inlier = features.read("inlier")
    chosen = choose_instances(owner, inlier, level, unit(features.read("consistent")))
    height = max(len(chosen), 1)
    figure = plt.figure(figsize=(COLUMNS * CELL + 0.4, height * (CELL + 0.62) + 1.0), layout="constrained")
    for strip, instance in zip(split_page(figure, height, 1), chosen, strict=False):
        name = f"instance {instance}, {facts['levels'][level[instance]]}"
        rows = np.flatnonzero(owner == instance)
        _draw_instance(strip, frames, instances, view_features, features, rows, name)
    model = "small" if facts["clip"]["small"] else facts["clip"]["model"]
    encoder = "ImageNet's classes" if model == PHOTOS else f"OpenCLIP ({model})"
    return figure, (
        f"crops encoded by {encoder}, origin {features.origin}\n"
        f"{len(owner)} views of {len(np.unique(owner))} instances; the {facts['outliers']} outliers (MAD {norm}, k = {MAD_K:g}) are "
        "struck out. Above each crop are its frame and the share of feature channels that disagree with the other views."
    )


def choose_instances(owner: Ints32, inlier: Bools, level: NDArray[np.int8], feature: Array) -> list[int]:
    """Choose the instances to show.

    First the instance with the most views, then, repeatedly, the often seen one whose feature is least similar to all chosen
    ones: all of the coarsest level, where no two show one thing. Last, of all levels, the instances with the most outliers.

    Args:
        owner, inlier: (R,) instance of each view, and whether the view counts.
        level, feature: (N,) level of each instance, and (N, D) feature of unit norm, 0 without views.
    """
    views, outliers = (np.bincount(rows, minlength=len(level)) for rows in (owner, owner[~inlier]))
    seen = (views > 0) & (level == level.max(initial=0))
    often = seen & (views >= np.quantile(views[seen], 1 - OFTEN)) if seen.any() else seen
    similarity = np.where(often, -1.0, np.inf)
    shown: list[int] = []
    while len(shown) < DISTINCT and np.isfinite(similarity).any():
        shown.append(int(np.lexsort((-views, similarity))[0]))
        similarity = np.maximum(similarity, feature @ feature[shown[-1]])
        similarity[shown] = np.inf
    worst = np.argsort(-outliers, kind="stable").tolist()
    return shown + [one for one in worst if outliers[one] and one not in shown][:MOST_OUTLIERS]


def choose_views(inlier: Bools) -> Ints:
    """Choose the views of an instance to show, in order of time: evenly spaced; outliers take up to half of the strip."""
    outliers, others = np.flatnonzero(~inlier), np.flatnonzero(inlier)
    outliers = outliers[evenly_spaced(len(outliers), COLUMNS // 2)]
    return np.sort(np.concatenate([outliers, others[evenly_spaced(len(others), COLUMNS - len(outliers))]]))


def _draw_instance(
    strip: SubFigure,
    frames: Artifact,
    instances: Artifact,
    views: Artifact,
    features: Artifact,
    rows: Ints,
    name: str,
) -> None:
    """Draw the views of an instance, which have these rows, below its name, each with its frame and the number that decides."""
    options, inlier = features.provenance["options"], features.read("inlier")[rows]
    values, limit = disagreement(views.read("feature")[rows], options["mad_norm"], MAD_K)
    struck = "" if inlier.all() else f", struck out above {limit:.2f}"
    caption = f"{name}: {len(rows)} views, {int((~inlier).sum())} outliers{struck}"
    strip.suptitle(caption, fontsize=10, x=0.01, ha="left")
    at, boxes, owner = (views.read(key)[rows] for key in ("frame", "box", "instance"))
    level, hull = views.read("instances/level")[owner[0]], views.provenance["options"]["cut"] == "hull"
    for axes, view in zip(empty_grid(strip, 1, COLUMNS)[0], choose_views(inlier), strict=False):
        frame = int(at[view])
        labels = instances.row("labels", frame)[level]
        crop = cut_crop(frames.row("rgb", frame), labels, owner[0], boxes[view], hull=hull)
        crop = np.rot90(crop, -1) if views.facts["turned"] else crop
        shown = np.where((crop == 0).all(axis=2, keepdims=True), np.uint8(BACKGROUND), crop)
        axes.imshow(shown, interpolation="nearest" if len(crop) < 24 else "antialiased")
        if not inlier[view]:
            axes.plot([0, 1], [0, 1], color="crimson", linewidth=2.5, transform=axes.transAxes)
        color = "black" if inlier[view] else "crimson"
        axes.set_title(f"{frame}: {values[view]:.2f}", fontsize=8, pad=2, color=color)
