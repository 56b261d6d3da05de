"""Group scenes into rows: one method, variant, origin and set of models. Validation apartments are separate rows."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from egosplat.errors import UserError
from egosplat.evaluation.scored_scenes import Model, ScoredScene
from egosplat.models.suitability import BRIEF

# Names of the datasets in the paper.
NAMES = {"adt": "ADT", "hoi4d": "HOI4D"}

APARTMENTS = "synthetic apartments"
VALIDATION_APARTMENTS = "validation apartments"

# Name of egosplat's own rows.
OWN = "EgoSplat"


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
        parts = (self.data, self.checkpoints, BRIEF if self.notice else "")
        return ", ".join(filter(None, parts))

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
    found: dict[tuple, dict[str, ScoredScene]] = {}
    # Scores of different data, variants or models must not be averaged.
    for one in scenes:
        key = (one.dataset, one.variant, one.origin, one.validation, one.method, one.models)
        other = found.setdefault(key, {}).setdefault(one.scene, one)
        if other is not one:
            raise UserError(f"{one.path} and {other.path}: are scores of the same scene; give one of them")
    names = _checkpoint_names({models for *_, models in found})
    series = [
        Series(next(iter(own.values())), names[models], dict(sorted(own.items())))
        for (*_, models), own in found.items()
    ]
    return sorted(series, key=lambda one: (not one.own, one.method, one.first.variant, one.checkpoints))


def _checkpoint_names(kinds: set[tuple[Model, ...]]) -> dict[tuple[Model, ...], str]:
    """Names of sets of models; equal names get the beginning of the hashes."""
    plain = {models: _checkpoints(models) for models in kinds}
    times = Counter(plain.values())
    return {
        models: f"{name} {'/'.join(model.hash[:8] for model in models)}" if times[name] > 1 else name
        for models, name in plain.items()
    }


def _checkpoints(models: Sequence[Model]) -> str:
    if not models:
        return ""
    if all(model.small for model in models):
        return "small checkpoints"
    parts = (f"{model.key.removesuffix('_checkpoint')} {model.checkpoint}" for model in models)
    return f"checkpoints {', '.join(parts)}"
