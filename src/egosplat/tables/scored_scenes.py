"""The scores of scenes as ``metrics.json`` files tell them."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from egosplat.alarms.alarm import Alarm, warning_lines
from egosplat.errors import UserError
from egosplat.evaluation.intervals import Clusters, cluster, scaled
from egosplat.files import read_json
from egosplat.pipeline import config as configuration
from egosplat.tables.table import Cell

FULL = "full"
"""The variant of a scene's own folder."""

PROTOCOL = ("min_area", "excluded", "people", "hit_region", "confidence")
"""Keys of the section ``metrics`` that decide what is asked and how it is scored: they are the same in a table."""

UNTOUCHED = tuple(f"scene{number}" for number in range(6, 11))
"""The synthetic apartments of ADT's name that are for reporting alone: no default, threshold or design is chosen by them."""

CHANCE = {"random_pixel": "a random pixel", "middle_pixel": "the middle of the picture"}
"""What answers without looking, by its key among the scores: what an accuracy has to be above."""

_VALUES = {"accuracy": "hit", "mean_iou": "iou"}
"""Of a query, what each score is the mean of."""

_PLACE = re.compile(
    r"(?:^|/)results/(?P<dataset>[a-z0-9_]+)/(?P<scene>[A-Za-z0-9_-]+)/"
    r"(?:variants/(?P<variant>[^/]+)/|methods/[^/]+/)?[^/]+$"
)
_NAME = re.compile(r"(?P<dataset>[a-z0-9_]+)/(?P<scene>[A-Za-z0-9_-]+)(?:, (?P<variant>[A-Za-z0-9_-]+))?")


@dataclass(frozen=True)
class Model:
    """A model on the way: key and file name of its checkpoint, what the files hold, whether it is the small one."""

    key: str
    checkpoint: str
    hash: str
    small: bool


@dataclass(frozen=True, eq=False)
class ScoredScene:
    """A scene's scores.

    Attributes:
        path: of the file.
        dataset, scene, variant: of which scene; another method has the variant ``FULL``.
        method: another method's name, or None for egosplat itself.
        origin: ``real`` or ``synthetic``.
        models: by key.
        document: the file's values.
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
    def untouched(self) -> bool:
        """Whether it is one of ``UNTOUCHED``."""
        return (self.dataset, self.origin) == ("adt", "synthetic") and self.scene in UNTOUCHED

    @property
    def protocol(self) -> dict[str, Any]:
        """The values of ``PROTOCOL``; None of a key that the file does not tell."""
        options = self.document["provenance"]["options"]
        return {key: options.get(key) for key in PROTOCOL}

    @property
    def warnings(self) -> list[str]:
        """Why the scores are not to be trusted, a line each: the notice, then the alarms."""
        alarms = (Alarm(**alarm) for alarm in self.document["alarms"])
        return warning_lines(self.document["notice"], alarms)

    def cell(self, metric: str, group: str) -> Cell:
        """A score in percent, with its interval where it has one."""
        score = self.document["scores"][group]
        return Cell(
            percent=_percent(score[metric]),
            interval=scaled(score[f"{metric}_interval"], 100),
            queries=score["count"],
            categories=score["categories"],
        )

    def chance(self, answerer: str, group: str) -> Cell:
        """The accuracy [%] of one of ``CHANCE`` on the queries of a group."""
        score = self.document["scores"][group]
        return Cell(percent=_percent(score[answerer]))

    def clusters(self, metric: str, group: str) -> Clusters:
        """The values of a group's queries by category; ``metric`` is ``accuracy`` or ``mean_iou``."""
        rows = [row for row in self.document["queries"] if group in row["groups"]]
        values = [float(row["groups"][group][_VALUES[metric]]) for row in rows]
        return cluster(values, [row["category"] for row in rows])


def read_scored_scene(path: Path) -> ScoredScene:
    """Read a ``metrics.json``.

    Which scene it is of is told by its path ``results/DATASET/SCENE/``, below which ``variants/NAME/`` is a variant
    and ``methods/NAME/`` another method's; elsewhere by its own ``scene``, DATASET/SCENE or DATASET/SCENE, VARIANT.

    Raises:
        UserError: the file cannot be read, is no ``metrics.json``, or does not say which scene it is of.
    """
    document = _read(path)
    _check_format(document, path)
    configuration.check(document, str(path), against="metrics")
    dataset, scene, variant = _place(path, document["scene"])
    method = document.get("method")
    return ScoredScene(
        path=path,
        dataset=dataset,
        scene=scene,
        variant=variant if method is None else FULL,
        method=None if method is None else one_line(method),
        origin=document["origin"],
        models=tuple(
            Model(key, one_line(Path(used["checkpoint"]).name), used["hash"], used["small"])
            for key, used in sorted(document["models"].items())
        ),
        document=document,
    )


def check_protocol(scenes: Sequence[ScoredScene]) -> None:
    """Check that all scenes of a dataset were asked and scored alike, and that all intervals have one confidence.

    Raises:
        UserError: names two that were not.
    """
    for key in PROTOCOL:
        first: dict[str, ScoredScene] = {}
        for scene in scenes:
            other = first.setdefault("all" if key == "confidence" else scene.dataset, scene)
            mine, theirs = scene.protocol[key], other.protocol[key]
            if mine != theirs:
                raise UserError(
                    f"{scene.path}: was scored with metrics.{key} = {mine!r}, {other.path} with {theirs!r}.\n"
                    "Numbers in one table need the same; make one of them anew"
                )


def one_line(text: str) -> str:
    """A name that someone gave, on one line and without control characters."""
    return " ".join("".join(one if one.isprintable() else " " for one in text).split())


def _read(path: Path) -> dict[str, Any]:
    try:
        return read_json(path, parse_constant=_refuse)
    except FileNotFoundError:
        raise UserError(f"{path}: does not exist. Make it: snakemake --cores 2 {path}") from None
    except (OSError, ValueError) as error:
        reason = str(error).partition("\n")[0]
        raise UserError(f"{path}: cannot be read as JSON ({reason}). Make it anew") from None


def _check_format(document: Mapping[str, Any], path: Path) -> None:
    expected = configuration.schema("metrics")["properties"]["format_version"]["const"]
    found = document.get("format_version", expected) if isinstance(document, Mapping) else expected
    if found != expected:
        raise UserError(
            f"{path}: has format {found!r}, and this egosplat reads {expected}.\n"
            f"Make it anew: snakemake --cores 2 --force {path}"
        )


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is no number of JSON")


def _place(path: Path, told: str) -> tuple[str, str, str]:
    below, named = _PLACE.search(path.as_posix()), _NAME.fullmatch(told)
    if below is None and named is None:
        raise UserError(
            f"{path}: lies below no results/DATASET/SCENE and its scene {told!r} is no DATASET/SCENE; "
            "move it there, as results/adt/scene1/methods/NAME/metrics.json"
        )
    parts = ("dataset", "scene", "variant")
    if below and named and below.group(*parts) != named.group(*parts):
        raise UserError(f"{path}: holds the scores of {told}, which lie elsewhere; make it anew")
    dataset, scene, variant = (below or named).group(*parts)
    return dataset, scene, variant or FULL


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share
