"""Group scenes into rows: one method, variant, origin and set of models. Validation apartments are separate rows."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from egosplat.errors import UserError
from egosplat.evaluation.scored_scenes import ScoredScene
from egosplat.models.suitability import BRIEF

# Names of the datasets in the paper.
NAMES = {"adt": "ADT", "hoi4d": "HOI4D"}

APARTMENTS = "synthetic apartments"
VALIDATION_APARTMENTS = "validation apartments"

# Name of egosplat's own rows.
OWN = "EgoSplat"

# Keys of the section ``metrics`` that decide queries and scores; they must be equal within a table.
PROTOCOL = ("min_area", "excluded", "people", "hit_region", "masks")


@dataclass(frozen=True, eq=False)
class Series:
    """Scenes whose scores may be averaged.

    Attributes:
        first: any scene, for what all have in common: dataset, variant, origin, method.
        scenes: scores by name of the scene.
    """

    first: ScoredScene
    checkpoints: str
    scenes: Mapping[str, ScoredScene]

    @property
    def own(self) -> bool:
        """Whether the method is EgoSplat."""
        return self.first.method is None

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
        by = "egosplat" if self.own else "reimplemented by egosplat"
        return f"{self.method} ({by}, {self.about})"


def find_series(scenes: Sequence[ScoredScene]) -> list[Series]:
    """Group scenes into series; egosplat's own come first, then sorted by method and checkpoints.

    Raises:
        UserError: two files have scores of one scene in one series.
    """
    groups: dict[tuple, dict[str, ScoredScene]] = {}
    # Scores of different data, variants or models must not be averaged.
    for scene in scenes:
        key = (scene.dataset, scene.variant, scene.origin, scene.validation, scene.method, scene.models)
        other = groups.setdefault(key, {}).setdefault(scene.scene, scene)
        if other is not scene:
            raise UserError(f"{scene.path} and {other.path}: are scores of the same scene; give one of them")
    # Sets of models with equal names get the beginning of the hashes.
    names = Counter({scene.models: scene.checkpoints for scene in scenes}.values())
    series = []
    for group in groups.values():
        first, scenes_by_name = next(iter(group.values())), dict(sorted(group.items()))
        hashes = "/".join(model.hash[:8] for model in first.models)
        checkpoints = f"{first.checkpoints} {hashes}" if names[first.checkpoints] > 1 else first.checkpoints
        series.append(Series(first, checkpoints, scenes_by_name))
    return sorted(series, key=lambda row: (not row.own, row.method, row.first.variant, row.checkpoints))


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
