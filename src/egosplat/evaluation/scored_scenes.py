"""Read the scores of scenes from ``metrics.json`` files."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from egosplat.alarms.table import Alarm
from egosplat.alarms.texts import warning_lines
from egosplat.errors import UserError
from egosplat.evaluation.intervals import Clusters, cluster, scaled
from egosplat.pipeline.validation import read_document

# Name of the variant in a scene's own folder.
FULL = "full"

# Keys of the section ``metrics`` that decide queries and scores; they must be equal within a table.
PROTOCOL = ("min_area", "excluded", "people", "hit_region", "masks")

# Validation apartments in ADT format: defaults are chosen on adt/scene1 to adt/scene5, and some were on these.
VALIDATION = tuple(f"scene{number}" for number in range(6, 11))

# Constant answers by their key in the scores: their accuracy is the chance level.
CHANCE = {"random_pixel": "a random pixel", "middle_pixel": "the middle of the picture"}

# The value of a query that each score averages.
_VALUES = {"accuracy": "hit", "mean_iou": "iou"}

_PLACE = re.compile(
    r"(?:^|/)results/(?P<dataset>[a-z0-9_]+)/(?P<scene>[A-Za-z0-9_-]+)/"
    r"(?:variants/(?P<variant>[^/]+)/)?[^/]+$"
)
_NAME = re.compile(r"(?P<dataset>[a-z0-9_]+)/(?P<scene>[A-Za-z0-9_-]+)(?:, (?P<variant>[A-Za-z0-9_-]+))?")


@dataclass(frozen=True)
class Model:
    """A model used for a scene: configuration key, file name and content hash of its checkpoint; whether it is small."""

    key: str
    checkpoint: str
    hash: str
    small: bool


@dataclass(frozen=True)
class Cell:
    """A score [%] with the bounds of its interval, and of a measured one the numbers of queries and categories.

    ``scenes`` are those of a measured average.
    """

    percent: float | None = None
    interval: tuple[float, float] | None = None
    queries: int | None = None
    categories: int | None = None
    scenes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Cost:
    """CPU time of all threads [min] and the largest memory [GiB] that a scene takes, from its frames to its codes."""

    cpu_min: float
    memory_gib: float


@dataclass(frozen=True, eq=False)
class ScoredScene:
    """A scene's scores.

    Attributes:
        method: name of another method, or None for EgoSplat.
        origin: ``real`` or ``synthetic``.
    """

    path: Path
    dataset: str
    scene: str
    variant: str
    method: str | None
    origin: str
    models: tuple[Model, ...]
    document: Mapping[str, Any]

    @property
    def stands_in(self) -> tuple[str, ...]:
        """Sentences on what replaces a part of the method."""
        return tuple(self.document.get("stands_in", ())) if self.method is not None else ()

    @property
    def cost(self) -> Cost | None:
        """What the making of the codes took, from the frames on; None if an artifact is lost."""
        made = {name: one for name, one in self.document["artifacts"].items() if name != "annotations.zarr"}
        if not made or None in made.values():
            return None
        return Cost(
            cpu_min=sum(one["cpu_s"] for one in made.values()) / 60,
            memory_gib=max(one["peak_memory_mb"] for one in made.values()) / 1024,
        )

    @property
    def validation(self) -> bool:
        """Whether it is one of ``VALIDATION``."""
        return (self.dataset, self.origin) == ("adt", "synthetic") and self.scene in VALIDATION

    @property
    def protocol(self) -> dict[str, Any]:
        """The values of ``PROTOCOL``; None for a key that the file does not have."""
        options = self.document["provenance"]["options"]
        return {key: options.get(key) for key in PROTOCOL}

    @property
    def warnings(self) -> list[str]:
        """Reasons not to trust the scores, one line each: the notice, then the alarms."""
        return warning_lines(self.document["notice"], self.alarms)

    @property
    def alarms(self) -> list[Alarm]:
        """The alarms of the scene's stages, in their order."""
        return [Alarm(**alarm) for alarm in self.document["alarms"]]

    def cell(self, metric: str, group: str) -> Cell:
        """A score in percent, with its interval if it has one."""
        score = self.document["scores"][group]
        return Cell(
            percent=_percent(score[metric]),
            interval=scaled(score[f"{metric}_interval"], 100),
            queries=score["count"],
            categories=score["categories"],
        )

    def chance(self, answerer: str, group: str) -> Cell:
        """The accuracy [%] of one of ``CHANCE`` on the queries of a group."""
        return Cell(percent=_percent(self.document["scores"][group][answerer]))

    def clusters(self, metric: str, group: str) -> Clusters:
        """The values of a group's queries by category; ``metric`` is ``accuracy`` or ``mean_iou``."""
        rows = [row for row in self.document["queries"] if group in row["groups"]]
        values = [float(row["groups"][group][_VALUES[metric]]) for row in rows]
        return cluster(values, [row["category"] for row in rows])


def read_scored_scene(path: Path) -> ScoredScene:
    """Read a ``metrics.json``.

    The path ``results/DATASET/SCENE/`` names the scene, with ``variants/NAME/`` for a variant. Elsewhere, the file's
    ``scene`` names it: DATASET/SCENE or DATASET/SCENE, VARIANT.

    Raises:
        UserError: the file cannot be read, is not a ``metrics.json``, or does not name its scene.
    """
    document = read_document(path, "metrics")
    dataset, scene, variant = _place(path, document["scene"])
    method = document.get("method")
    return ScoredScene(
        path=path,
        dataset=dataset,
        scene=scene,
        variant=variant,
        method=None if method is None else one_line(method),
        origin=document["origin"],
        models=tuple(
            Model(key, one_line(Path(used["checkpoint"]).name), used["hash"], used["small"])
            for key, used in sorted(document["models"].items())
        ),
        document=document,
    )


def check_protocol(scenes: Sequence[ScoredScene]) -> None:
    """Raise UserError unless all scenes of a dataset were scored with one protocol."""
    for key in PROTOCOL:
        first: dict[str, ScoredScene] = {}
        for scene in scenes:
            other = first.setdefault(scene.dataset, scene)
            mine, theirs = scene.protocol[key], other.protocol[key]
            if mine != theirs:
                raise UserError(
                    f"{scene.path}: was scored with metrics.{key} = {mine!r}, {other.path} with {theirs!r}.\n"
                    "Numbers in one table need the same value; rebuild one of them"
                )


def one_line(text: str) -> str:
    """Put a given name on one line, without control characters."""
    return " ".join("".join(one if one.isprintable() else " " for one in text).split())


def _place(path: Path, title: str) -> tuple[str, str, str]:
    below, named = _PLACE.search(path.as_posix()), _NAME.fullmatch(title)
    if (place := below or named) is None:
        raise UserError(
            f"{path}: is not in a folder results/DATASET/SCENE, and its scene {title!r} is not DATASET/SCENE; "
            "move it, for example to results/adt/scene1/variants/NAME/metrics.json"
        )
    parts = ("dataset", "scene", "variant")
    if below and named and below.group(*parts) != named.group(*parts):
        raise UserError(f"{path}: holds the scores of {title}, which belong to another folder; rebuild it")
    dataset, scene, variant = place.group(*parts)
    return dataset, scene, variant or FULL


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share
