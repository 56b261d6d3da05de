"""Which scenes make one row: those of one method and variant, of one origin, with the same models.

Untouched apartments make rows of their own.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from egosplat.errors import UserError
from egosplat.models.suitability import BRIEF
from egosplat.tables.scored_scenes import Model, ScoredScene

NAMES = {"adt": "ADT", "hoi4d": "HOI4D"}
"""What the paper calls the datasets."""

APARTMENTS = "synthetic apartments"
UNTOUCHED_APARTMENTS = "untouched synthetic apartments"

OWN = "EgoSplat"
"""What a row of egosplat itself is called."""


@dataclass(frozen=True, eq=False)
class Series:
    """Scores that may be averaged.

    Attributes:
        dataset, variant, origin: of all of them.
        untouched: whether they are apartments that nothing was chosen by, see ``UNTOUCHED``.
        method: its name in a table.
        own: whether it is egosplat itself.
        checkpoints: in words.
        scenes: by name.
    """

    dataset: str
    variant: str
    origin: str
    untouched: bool
    method: str
    own: bool
    checkpoints: str
    scenes: Mapping[str, ScoredScene]

    @property
    def data(self) -> str:
        """What it was measured on."""
        if self.origin == "synthetic":
            return UNTOUCHED_APARTMENTS if self.untouched else APARTMENTS
        return NAMES.get(self.dataset, self.dataset)

    @property
    def notice(self) -> str | None:
        """That the models do not know what the recordings show, and what to do; None where they do."""
        return next((told for scene in self.scenes.values() if (told := scene.document["notice"])), None)

    @property
    def about(self) -> str:
        """Data and checkpoints."""
        parts = (self.data, self.checkpoints, BRIEF if self.notice else "")
        return ", ".join(filter(None, parts))

    @property
    def label(self) -> str:
        """Method, data and checkpoints."""
        return f"{self.method} ({'egosplat' if self.own else 'scored by egosplat'}, {self.about})"


def find_series(scenes: Sequence[ScoredScene]) -> list[Series]:
    """Scenes by what makes a row; egosplat itself first, then by method and checkpoints.

    Raises:
        UserError: two files have the scores of one scene for one row.
    """
    found: dict[tuple, dict[str, ScoredScene]] = {}
    for one in scenes:
        key = (one.dataset, one.variant, one.origin, one.untouched, one.method, one.models)
        other = found.setdefault(key, {}).setdefault(one.scene, one)
        if other is not one:
            raise UserError(f"{one.path} and {other.path}: are scores of the same; give one of them")
    names = _checkpoint_names({models for *_, models in found})
    series = [
        Series(
            dataset,
            variant,
            origin,
            untouched,
            method or OWN,
            method is None,
            names[models],
            dict(sorted(own.items())),
        )
        for (dataset, variant, origin, untouched, method, models), own in found.items()
    ]
    return sorted(series, key=lambda one: (not one.own, one.method, one.checkpoints))


def _checkpoint_names(kinds: set[tuple[Model, ...]]) -> dict[tuple[Model, ...], str]:
    """Names of sets of models; with the beginning of the hashes where they would not tell two of them apart."""
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
