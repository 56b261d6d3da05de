"""Read the scores of scenes from ``metrics.json`` files, and group them into rows: one method, variant, origin and set of models."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from egosplat.errors import UserError
from egosplat.evaluation.document import describe_models, one_line
from egosplat.evaluation.intervals import Clusters, cluster
from egosplat.evaluation.scores import CHANCE
from egosplat.models.suitability import BRIEF
from egosplat.pipeline.validation import read_document
from egosplat_rivals.compared import NAMES

# Names of the variant in a scene's own folder, of those asked by pixels and without sizes, and of egosplat's own rows.
FULL, PIXELS, NO_SIZES, OWN = "full", "pixels", "no_sizes", "EgoSplat"
APARTMENTS, VALIDATION_APARTMENTS = "synthetic apartments", "validation apartments"

# Validation apartments in ADT format: defaults are chosen on adt/scene1 to adt/scene5, and some were on these.
VALIDATION = tuple(f"scene{index}" for index in range(6, 11))

# Keys of the section ``metrics`` that decide queries and scores; they must be equal within a table.
PROTOCOL = ("min_area", "excluded", "masks", "held_out")

_PATH = re.compile(
    r"(?:^|/)results/(?P<dataset>[a-z0-9_]+)/(?P<scene>[A-Za-z0-9_-]+)/"
    r"(?:variants/(?P<variant>[^/]+)/)?[^/]+$"
)
_NAME = re.compile(r"(?P<dataset>[a-z0-9_]+)/(?P<scene>[A-Za-z0-9_-]+)(?:, (?P<variant>[A-Za-z0-9_-]+))?")


@dataclass(frozen=True)
class Cell:
    """A score [%] with the bounds of its interval, of a measured one its queries and categories, of an average its scenes."""

    percent: float | None = None
    interval: tuple[float, float] | None = None
    queries: int | None = None
    categories: int | None = None
    scenes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ScoredScene:
    """A scene's scores; ``method`` is the name of another method, or None for EgoSplat.

    ``models`` has for each model the configuration key, file name and content hash of its checkpoint.
    """

    path: Path
    dataset: str
    scene: str
    variant: str
    method: str | None
    models: tuple[str, ...]
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
    def readout(self) -> str:
        """How queries were asked: ``pixels``, ``gaussians``, or ``sizes``: Gaussians with sizes of things, which EgoSplat alone has."""
        options = self.document["provenance"]["options"]
        sized = self.method is None and options.get("size_weight", 0.0) > 0
        return "sizes" if sized and options["readout"] != PIXELS else options.get("readout", "")

    def cell(self, metric: str, group: str) -> Cell:
        """A score in percent, with its interval if it has one; or the accuracy of one of ``CHANCE``, alone."""
        score = self.document["scores"][group]
        percent = None if score[metric] is None else 100 * score[metric]
        if metric in CHANCE:
            return Cell(percent)
        interval = percent_bounds(score[f"{metric}_interval"])
        return Cell(percent, interval, score["count"], score["categories"])

    def clusters(self, metric: str, group: str) -> Clusters:
        """The values of a group's queries by category; ``metric`` is ``accuracy`` or ``mean_iou``."""
        value = {"accuracy": "hit", "mean_iou": "iou"}[metric]
        queries = [query for query in self.document["queries"] if group in query["groups"]]
        values = [float(query["groups"][group][value]) for query in queries]
        return cluster(values, [query["category"] for query in queries])


def read_scored_scene(path: Path) -> ScoredScene:
    """Read a ``metrics.json`` (UserError: it cannot be read, is none, or does not name its scene).

    The path ``results/DATASET/SCENE/`` names the scene, with ``variants/NAME/`` for a variant. Elsewhere, the file's
    ``scene`` names it: DATASET/SCENE or DATASET/SCENE, VARIANT.
    """
    document = read_document(path, "metrics")
    method = one_line(document["method"]) if "method" in document else None
    models = tuple(
        f"{key} {one_line(Path(used['checkpoint']).name)} {used['hash']}"
        for key, used in sorted(document["models"].items())
    )
    return ScoredScene(path, *_names(path, document["scene"]), method, models, document)


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


@dataclass(frozen=True, eq=False)
class Series:
    """Scenes whose scores may be averaged, by name; ``first`` is any of them, for what all have in common."""

    first: ScoredScene
    checkpoints: str
    scenes: Mapping[str, ScoredScene]

    @property
    def method(self) -> str:
        """Name of the method."""
        return self.first.method or OWN

    @property
    def data(self) -> str:
        """Name of the data."""
        if self.first.origin == "synthetic":
            return VALIDATION_APARTMENTS if self.first.validation else APARTMENTS
        return NAMES.get(self.first.dataset, self.first.dataset)

    @property
    def notice(self) -> str:
        """Notice that the models do not suit the recordings, and what to do; empty if they do."""
        notices = (scene.document["notice"] for scene in self.scenes.values())
        return next(filter(None, notices), "")

    @property
    def about(self) -> str:
        """Data and checkpoints."""
        return ", ".join(filter(None, (self.data, self.checkpoints, BRIEF if self.notice else "")))

    @property
    def label(self) -> str:
        """Method, data and checkpoints."""
        by = "egosplat" if self.first.method is None else "reimplemented by egosplat"
        asked = {PIXELS: ", asked by pixels", "sizes": ", asked with sizes"}.get(self.first.readout, "")
        return f"{self.method} ({by}, {self.about}{asked})"


def find_series(scenes: Sequence[ScoredScene]) -> list[Series]:
    """Group scenes into series, egosplat's own first, then by method and checkpoints (UserError: a scene has two files)."""
    groups: dict[tuple, dict[str, ScoredScene]] = {}
    # Scores of different data, variants or models must not be averaged.
    for scene in scenes:
        key = (scene.dataset, scene.variant, scene.origin, scene.validation, scene.method, scene.models)
        other = groups.setdefault(key, {}).setdefault(scene.scene, scene)
        if other is not scene:
            raise UserError(f"{scene.path} and {other.path}: are scores of the same scene; give one of them")
    # Sets of models with equal names get the beginning of the hashes.
    names = {scene.models: describe_models(scene.document["models"]) for scene in scenes}
    counts = Counter(names.values())
    series = []
    for group in groups.values():
        first = next(iter(group.values()))
        hashes = "/".join(model.rpartition(" ")[2][:8] for model in first.models)
        name = names[first.models]
        checkpoints = f"{name} {hashes}" if counts[name] > 1 else name
        series.append(Series(first, checkpoints, dict(sorted(group.items()))))
    return sorted(series, key=lambda row: (row.method != OWN, row.method, row.first.variant, row.checkpoints))


def check_protocol(scenes: Sequence[ScoredScene]) -> None:
    """Raise UserError unless all scenes of a dataset were scored with one protocol."""
    first: dict[str, ScoredScene] = {}
    for scene in scenes:
        other = first.setdefault(scene.dataset, scene)
        for key in PROTOCOL:
            mine, theirs = (each.document["provenance"]["options"].get(key) for each in (scene, other))
            if mine != theirs:
                raise UserError(
                    f"{scene.path}: was scored with metrics.{key} = {mine!r}, {other.path} with {theirs!r}.\n"
                    "Numbers in one table need the same value; rebuild one of them"
                )
