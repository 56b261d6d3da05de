"""The evaluation queries: every category in every annotated frame (docs/method.md#benchmark-queries)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from egosplat.arrays import Bools, Ints32
from egosplat.artifacts.reader import Artifact
from egosplat.evaluation.options import ScoringOptions
from egosplat.frames.recording import Instance

# Groups with separate scores, as in the paper's tables.
GROUPS = ("static", "dynamic", "all")


@dataclass(frozen=True)
class Query:
    """A category, as the dataset names it, in a frame with a row of annotations.zarr and an index in frames.zarr; with the
    indices of its visible instances by group: of a category with static and dynamic ones, all and those of each
    (docs/method.md#mixed-categories)."""

    row: int
    frame: int
    category: str
    instances: Mapping[str, tuple[int, ...]]


def find_queries(annotations: Artifact, valid: Bools, options: ScoringOptions) -> list[Query]:
    """Find all queries of an annotations artifact in (H, W) bool ``valid`` pixels, ordered by frame, then category."""
    instances = instances_of(annotations)
    annotated, frames = annotations.read("annotated"), annotations.read("frame")
    return [
        Query(int(row), int(frames[row]), category, groups)
        for row in np.flatnonzero(annotated)
        for category, groups in categories(read_layers(annotations, int(row), valid), instances, options)
    ]


def read_layers(annotations: Artifact, row: int, valid: Bools) -> Ints32:
    """(L, H, W) int32: the instance map of an evaluation frame, then those of the instances that others cover in part; invalid
    pixels are -1."""
    first = annotations.row("instance_map", row)[None]
    beside = [annotations.row("covered_map", row)] if annotations.has("covered_map") else []
    return np.where(valid, np.concatenate([first, *beside]), np.int32(-1))


def mask_of(layers: Ints32, members: Sequence[int]) -> Bools:
    """(H, W) bool: where any of (..., H, W) maps shows any of the instances."""
    return np.logical_or.reduce(np.isin(layers, members).reshape(-1, *layers.shape[-2:]), axis=0)


def phrases_to_ask(
    queries: Sequence[Query], instances: Sequence[Instance], options: ScoringOptions
) -> list[str]:
    """The phrases that answers to queries take, in alphabetical order: all categories of a recording for masks of classes."""
    if options.masks == "classes":
        return sorted({instance.category for instance in instances if _is_asked(instance, options)})
    return sorted({query.category for query in queries})


def instances_of(annotations: Artifact) -> list[Instance]:
    """The instances, by their index in the instance maps."""
    return [Instance(**entry) for entry in annotations.facts["instances"]]


def categories(
    layers: Ints32, instances: Sequence[Instance], options: ScoringOptions
) -> Iterator[tuple[str, dict[str, tuple[int, ...]]]]:
    """The categories to query in one frame of ``read_layers``, in alphabetical order, with their instances by group."""
    # An instance that others cover is whole in one layer, and in part in the first.
    area = np.max([np.bincount(layer[layer >= 0], minlength=len(instances)) for layer in layers], axis=0)
    # A share of the whole image, not of its valid pixels.
    least = options.min_area * layers[0].size
    seen: dict[str, list[int]] = {}
    for index in np.flatnonzero(area).tolist():
        if _is_asked(instances[index], options):
            seen.setdefault(instances[index].category, []).append(index)
    for category, members in sorted(seen.items()):
        groups = {}
        for group in GROUPS:
            own = [index for index in members if group in ("all", instances[index].motion_type)]
            # The limit holds for each group by itself: a category may count in "all" and in none of the others.
            if own and area[own].sum() >= least:
                groups[group] = tuple(own)
        if groups:
            yield category, groups


def _is_asked(instance: Instance, options: ScoringOptions) -> bool:
    # The paper does not say whether it asks for people. What moves is masked out of training.
    return instance.category not in options.excluded and instance.instance_type != "human"
