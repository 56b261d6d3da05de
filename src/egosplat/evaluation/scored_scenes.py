"""Read the scores of scenes from ``metrics.json`` files."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from egosplat.alarms.artifact_alarms import warning_lines
from egosplat.alarms.table import Alarm
from egosplat.errors import UserError
from egosplat.evaluation.intervals import Clusters, cluster
from egosplat.pipeline.validation import read_document

# Name of the variant in a scene's own folder.
FULL = "full"

# Validation apartments in ADT format: defaults are chosen on adt/scene1 to adt/scene5, and some were on these.
VALIDATION = tuple(f"scene{index}" for index in range(6, 11))

# Constant answers by their key in the scores: their accuracy is the chance level.
CHANCE = {"random_pixel": "a random pixel", "middle_pixel": "the middle of the picture"}

_PATH = re.compile(
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


@dataclass(frozen=True, eq=False)
class ScoredScene:
    """A scene's scores; ``method`` is the name of another method, or None for EgoSplat."""

    path: Path
    dataset: str
    scene: str
    variant: str
    method: str | None
    models: tuple[Model, ...]
    document: Mapping[str, Any]

    @property
    def origin(self) -> str:
        """``real`` or ``synthetic``."""
        return self.document["origin"]

    @property
    def validation(self) -> bool:
        """Whether it is one of ``VALIDATION``."""
        return (self.dataset, self.origin) == ("adt", "synthetic") and self.scene in VALIDATION

    @property
    def checkpoints(self) -> str:
        """The models in words; empty without any."""
        if self.models and all(model.small for model in self.models):
            return "small checkpoints"
        names = (f"{model.key.removesuffix('_checkpoint')} {model.checkpoint}" for model in self.models)
        return f"checkpoints {', '.join(names)}" if self.models else ""

    @property
    def alarms(self) -> list[Alarm]:
        """The alarms of the scene's stages, in their order."""
        return [Alarm(**alarm) for alarm in self.document["alarms"]]

    @property
    def warnings(self) -> list[str]:
        """Reasons not to trust the scores, one line each: the notice, then the alarms."""
        return warning_lines(self.document["notice"], self.alarms)

    def cell(self, metric: str, group: str) -> Cell:
        """A score in percent, with its interval if it has one."""
        score = self.document["scores"][group]
        return Cell(
            _percent(score[metric]),
            percent_bounds(score[f"{metric}_interval"]),
            score["count"],
            score["categories"],
        )

    def chance(self, answerer: str, group: str) -> Cell:
        """The accuracy [%] of one of ``CHANCE`` on the queries of a group."""
        return Cell(_percent(self.document["scores"][group][answerer]))

    def clusters(self, metric: str, group: str) -> Clusters:
        """The values of a group's queries by category; ``metric`` is ``accuracy`` or ``mean_iou``."""
        value = {"accuracy": "hit", "mean_iou": "iou"}[metric]
        queries = [query for query in self.document["queries"] if group in query["groups"]]
        values = [float(query["groups"][group][value]) for query in queries]
        return cluster(values, [query["category"] for query in queries])


def read_scored_scene(path: Path) -> ScoredScene:
    """Read a ``metrics.json``.

    The path ``results/DATASET/SCENE/`` names the scene, with ``variants/NAME/`` for a variant. Elsewhere, the file's
    ``scene`` names it: DATASET/SCENE or DATASET/SCENE, VARIANT.

    Raises:
        UserError: the file cannot be read, is not a ``metrics.json``, or does not name its scene.
    """
    document = read_document(path, "metrics")
    method, models = document.get("method"), sorted(document["models"].items())
    return ScoredScene(
        path,
        *_names(path, document["scene"]),
        None if method is None else one_line(method),
        tuple(
            Model(key, one_line(Path(used["checkpoint"]).name), used["hash"], used["small"])
            for key, used in models
        ),
        document,
    )


def one_line(text: str) -> str:
    """Put a given name on one line, without control characters."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())


def percent_bounds(bounds: Sequence[float] | None) -> tuple[float, float] | None:
    """The bounds of an interval in percent."""
    return None if bounds is None else (100 * bounds[0], 100 * bounds[1])


def _names(path: Path, title: str) -> tuple[str, str, str]:
    """Dataset, scene and variant."""
    below, named = _PATH.search(path.as_posix()), _NAME.fullmatch(title)
    if (match := below or named) is None:
        raise UserError(
            f"{path}: is not in a folder results/DATASET/SCENE, and its scene {title!r} is not DATASET/SCENE; "
            "move it, for example to results/adt/scene1/variants/NAME/metrics.json"
        )
    if below and named and below.groupdict() != named.groupdict():
        raise UserError(f"{path}: holds the scores of {title}, which belong to another folder; rebuild it")
    dataset, scene, variant = match.group("dataset", "scene", "variant")
    return dataset, scene, variant or FULL


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share
