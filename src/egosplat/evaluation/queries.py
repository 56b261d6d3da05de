"""The benchmark's queries: every category that an annotated frame shows (docs/method.md#benchmark-queries)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.frames.recording import Instance

GROUPS = ("static", "dynamic", "all")
"""What is reported separately, as in the paper's tables."""

InstanceMap = NDArray[np.int32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class BenchmarkQueries:
    """Which pairs of a frame and a category are asked.

    Attributes:
        min_area: a group of a category counts in a frame that shows at least this share of the picture of it.
        excluded: categories that are not asked, such as ADT's ``shelter``, the rooms themselves.
        people: whether people are asked for.
    """

    min_area: float
    excluded: tuple[str, ...]
    people: bool


@dataclass(frozen=True)
class Query:
    """A category in a frame, with all of its instances there.

    A category that owns static and dynamic instances in a frame counts once in ``all``, and in each of the other
    groups with the instances of this kind as the truth (docs/method.md#mixed-categories).

    Attributes:
        row: of the frame in annotations.zarr.
        frame: its index in frames.zarr.
        category: the text that is asked, as the dataset has it.
        instances: of each group in which the query counts, one at least: indices of the instances that are seen.
    """

    row: int
    frame: int
    category: str
    instances: Mapping[str, tuple[int, ...]]


def find_queries(annotations: Artifact, valid: Mask, options: BenchmarkQueries) -> list[Query]:
    """All queries of an annotations artifact, by frame, then category.

    Args:
        annotations: the artifact.
        valid: (H, W) bool, of frames.zarr: pixels that show the scene.
        options: which are asked.
    """
    instances = instances_of(annotations)
    annotated, frames = annotations.read("annotated"), annotations.read("frame")
    return [
        Query(int(row), int(frames[row]), category, groups)
        for row in np.flatnonzero(annotated)
        for category, groups in categories(read_map(annotations, int(row), valid), instances, options)
    ]


def read_map(annotations: Artifact, row: int, valid: Mask) -> InstanceMap:
    """(H, W) int32 instance map of an evaluation frame; -1 also outside of what is valid."""
    return np.where(valid, annotations.row("instance_map", row), np.int32(-1))


def instances_of(annotations: Artifact) -> list[Instance]:
    """What the instance maps' indices mean."""
    return [Instance(**entry) for entry in annotations.facts["instances"]]


def categories(
    instance_map: InstanceMap, instances: Sequence[Instance], options: BenchmarkQueries
) -> Iterator[tuple[str, dict[str, tuple[int, ...]]]]:
    """The categories that are asked in one frame, in alphabetical order, with the instances of each group.

    Args:
        instance_map: (H, W) int32 index into the instances, -1 for none.
        instances: of the recording.
        options: which categories are asked.
    """
    area = np.bincount(instance_map[instance_map >= 0], minlength=len(instances))
    least = options.min_area * instance_map.size
    seen: dict[str, list[int]] = {}
    for index in np.flatnonzero(area):
        if _is_asked(instances[index], options):
            seen.setdefault(instances[index].category, []).append(int(index))
    for category, members in sorted(seen.items()):
        kinds = {kind: [one for one in members if instances[one].motion_type == kind] for kind in GROUPS[:2]}
        groups = kinds | {"all": members}
        large = {name: tuple(own) for name, own in groups.items() if own and area[own].sum() >= least}
        if large:
            yield category, large


def _is_asked(instance: Instance, options: BenchmarkQueries) -> bool:
    person = instance.instance_type == "human"
    return instance.category not in options.excluded and (options.people or not person)
