"""What a scene answers to a query: the things that match in 3D, or the pixels of one view."""

from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

import numpy as np

from egosplat.arrays import Array, Bools, Floats, Ints
from egosplat.histories.told import Carried, Place, clock, place_at
from egosplat.query.reading import Question


@dataclass(frozen=True)
class Evidence:
    """What tells whether a thing is what a query means."""

    # Where its level of detail is: a share of those that are as fine or finer.
    level: float
    # Log-odds of its score.
    fit: float
    # Its score less the best score of another thing that matches the query; 0 stands for none.
    apart: float
    # By how much its log-odds, of looks alone, are above those of the best name of another thing, and of every canonical phrase.
    lead: float


@dataclass(frozen=True, eq=False)
class Thing:
    """A connected set of Gaussians that match a query at a level of detail; ``members`` are their (M,) int64 indices.

    Attributes:
        score: 0..1, see ``things.find_things``; above 0.5 it fits better than every canonical phrase.
        center, size: (3,) float64 mean of its Gaussians by visible share, and sides of its box along the axes of the world.
        frame, share: the one that shows it best, and the share of it that it fills, 0..1.
        evidence, probability: of that it is what the query means; no probability without a calibration.
    """

    score: float
    level: str
    center: Array
    size: Array
    frame: int
    members: Ints = field(repr=False)
    share: float = 0.0
    evidence: Evidence | None = field(default=None, repr=False)
    probability: float | None = None

    @property
    def rating(self) -> float:
        """What it is graded by: its probability, or without a calibration its score."""
        return self.score if self.probability is None else self.probability


@dataclass(frozen=True, eq=False)
class Moving:
    """What matches a query and is masked because it moves, so it has no place in 3D; ``tracks`` are its instances.

    Attributes:
        rating: as of a thing; None for the wearer, who is known by another rule.
        frame: one that shows much of it.
        spans: first and last second, since the first frame, of each time in which it is seen, in order.
    """

    rating: float | None
    frame: int
    tracks: Ints = field(repr=False)
    spans: tuple[tuple[float, float], ...]

    @property
    def told(self) -> str:
        """When it is seen, such as "0:02 to 0:07, 0:12 to 0:19"."""
        return ", ".join(f"{clock(first)} to {clock(last)}" for first, last in self.spans)


@dataclass(frozen=True, eq=False)
class ViewMatch:
    """What matches a query in one view of (H, W) pixels; a view without any code has score 0, an empty mask, and no place.

    Attributes:
        score, level: largest smoothed relevancy, 0..1, and the level that has it; of a thing that is shown, its own.
        pixel: column and row of the best match; the innermost if several match as well.
        position: (3,) float64 place in the world that this pixel shows; None without depth.
        relevancy: (H, W) float32 in 0..1 at ``level``, not smoothed; 0 where no code is visible.
        mask: (H, W) bool pixels, at ``mask_level``.
    """

    phrase: str
    score: float
    level: str | None
    pixel: tuple[int, int] | None
    position: Array | None
    relevancy: Floats = field(repr=False)
    mask_level: str | None
    mask: Bools = field(repr=False)


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer to one query.

    Attributes:
        grade: ``found``, ``best guess``, ``seen moving``, ``not found`` or ``not asked`` (docs/answers.md#grades), by ``rating``, which is as that of a thing.
        score, probability: of the best match by score; no probability for a view.
        refusal: the reason why nothing is found; None if something is, or is guessed.
        untaught: words of the query that the OpenCLIP checkpoint was not trained on.
        things: things in 3D of this grade, by decreasing score; empty if refused, or if one view was asked.
        candidates: the best things, two at least if there are, whether they fit or not.
        moving: when it is seen moving, where nothing is found in 3D.
        history: when what the query means was carried, and from where to where, in the order of time.
        question: how a text was read, if it was one of ``Scene.ask``.
        also: other names of the thing, in a catalog.
        view: what matches in the view that was asked; None if refused, if the view shows nothing, or without a view.
    """

    phrase: str
    grade: str
    score: float
    probability: float | None = None
    refusal: str | None = None
    untaught: tuple[str, ...] = ()
    things: tuple[Thing, ...] = ()
    candidates: tuple[Thing, ...] = field(default=(), repr=False)
    moving: Moving | None = None
    history: tuple[Carried, ...] = ()
    also: tuple[str, ...] = ()
    view: ViewMatch | None = None
    question: Question | None = field(default=None, repr=False)

    def at(self, second: float) -> Place | None:
        """Where it was at a time [s since the first frame], by its history; None if it was not carried."""
        return place_at(self.history, second)

    @property
    def rating(self) -> float:
        """What it is graded by."""
        return self.score if self.probability is None else self.probability

    @property
    def asked(self) -> str:
        """What was asked, as it was read."""
        return self.question.read if self.question else self.phrase


def as_json(value: Any) -> Any:
    """An answer, a place or a part of them for JSON: the attributes that ``print`` shows; None for a place that is not known."""
    if is_dataclass(value):
        return {one.name: as_json(getattr(value, one.name)) for one in fields(value) if one.repr}
    if isinstance(value, np.ndarray):
        return value.tolist() if np.isfinite(value).all() else None
    return [*map(as_json, value)] if isinstance(value, tuple | list) else value
