"""What was carried from where to where, as an answer to words (docs/method.md#carries)."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from egosplat.artifacts.reader import Artifact
from egosplat.geometry import Array
from egosplat.query.grades.evidence import SYNONYM
from egosplat.query.relevancy import relevancy
from egosplat.query.text import Texts

# Two carries show one thing if they share this part of the shorter one's time.
_TOGETHER = 0.5


def clock(second: float) -> str:
    """A time in minutes and whole seconds, such as "1:05"."""
    minutes, rest = divmod(int(second), 60)
    return f"{minutes}:{rest:02d}"


@dataclass(frozen=True, eq=False)
class Carried:
    """A thing that left its place and was put down at another one.

    Attributes:
        score: relevancy of the query, 0..1.
        from_s, until_s: seconds since the first frame.
        start, end: (3,) float64 the places.
        frame: the frame that shows most of it.
        box: x0, y0, x1, y1 around it in that frame, the ends exclusive [px].
    """

    score: float
    from_s: float
    until_s: float
    start: Array
    end: Array
    frame: int
    box: tuple[int, int, int, int]

    @property
    def told(self) -> str:
        """When it was carried, such as "0:04 to 0:07"."""
        return f"{clock(self.from_s)} to {clock(self.until_s)}"


@dataclass(frozen=True, eq=False)
class Place:
    """Where a thing was at a time.

    Attributes:
        position: (3,) float64; None while it is carried.
        since_s, until_s: seconds for which it was so; None if nobody saw it come, or leave.
    """

    position: Array | None
    since_s: float | None
    until_s: float | None

    @property
    def told(self) -> str:
        """In words, such as "since 0:07, until 0:16"."""
        parts = (("since", self.since_s), ("until", self.until_s))
        times = ", ".join(f"{word} {clock(second)}" for word, second in parts if second is not None)
        return times if self.position is not None else f"carried {times}"


def place_at(history: Sequence[Carried], second: float) -> Place | None:
    """Where a thing with a history was at a time [s]; None without a history."""
    now = next((one for one in history if one.from_s <= second <= one.until_s), None)
    if now is not None:
        return Place(None, now.from_s, now.until_s)
    before = [one for one in history if one.until_s < second]
    after = [one for one in history if one.from_s > second]
    until = min((one.from_s for one in after), default=None)
    if before:
        last = max(before, key=lambda one: one.until_s)
        return Place(last.end, last.until_s, until)
    return Place(min(after, key=lambda one: one.from_s).start, None, until) if after else None


class Histories:
    """The carries of a scene, ready to be asked.

    Attributes:
        every: all carries, in the order of time, with score 0.
    """

    def __init__(self, carries: Artifact, seconds: Array) -> None:
        """Read carries.zarr; ``seconds`` (F,) time of each frame since the first."""
        names = ("first_frame", "last_frame", "start", "end", "best_frame", "box")
        first, last, start, end, best, box = map(carries.read, names)
        self._features = torch.from_numpy(carries.read("feature"))
        self.every = tuple(
            Carried(
                0.0,
                float(seconds[first[row]]),
                float(seconds[last[row]]),
                start[row],
                end[row],
                int(best[row]),
                tuple(box[row].tolist()),
            )
            for row in range(len(first))
        )

    def of(self, query: Texts, words: Texts, temperature: float) -> tuple[Carried, ...]:
        """Find the carries of what a query means, in the order of time.

        A carry is one of them if no word with another meaning fits its views better, and the query fits better than every
        canonical phrase. Of those at the same time, the best one stays.

        Args:
            query: one phrase.
            words: names of things, which compete with it.
            temperature: as in ``relevancy``.
        """
        if not self.every:
            return ()
        own = query.queries[0]
        others = words.queries[words.queries @ own < SYNONYM]
        fits = self._features @ own
        best = fits > (self._features @ others.T).amax(dim=1) if len(others) else torch.ones_like(fits) > 0
        scores = relevancy(self._features, query.queries, query.canonical, temperature)[:, 0]
        found = [
            Carried(**vars(one) | {"score": float(score)})
            for one, score, named in zip(self.every, scores, best, strict=True)
            if named and score > 0.5
        ]
        kept: list[Carried] = []
        for one in sorted(found, key=lambda one: -one.score):
            if not any(_together(one, other) for other in kept):
                kept.append(one)
        return tuple(sorted(kept, key=lambda one: one.from_s))


def _together(one: Carried, other: Carried) -> bool:
    both = min(one.until_s, other.until_s) - max(one.from_s, other.from_s)
    return both >= _TOGETHER * min(one.until_s - one.from_s, other.until_s - other.from_s)
