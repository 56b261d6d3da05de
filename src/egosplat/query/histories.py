"""What was carried from where to where, as an answer to words (docs/method.md#carries)."""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
import torch

from egosplat.artifacts.reader import Artifact
from egosplat.geometry import Array
from egosplat.query.grades.evidence import other_meanings
from egosplat.query.history import Carried, meet
from egosplat.query.relevancy import relevancy
from egosplat.query.text import Texts
from egosplat.query.vocabulary import CARRIED

# Two carries show one thing if they share this part of the shorter one's time.
TOGETHER = 0.25


class Histories:
    """The carries of a scene, ready to be asked.

    Attributes:
        every: all carries, in the order of time, with score 0.
        features: (C, D) float32 of unit norm, of each; zeros without one.
    """

    def __init__(self, carries: Artifact, seconds: Array) -> None:
        """Read carries.zarr; ``seconds`` (F,) time of each frame since the first."""
        names = ("first_frame", "last_frame", "start", "end", "size", "best_frame", "box")
        first, last, start, end, size, best, box = map(carries.read, names)
        self.features = torch.from_numpy(carries.read("feature"))
        self.every = tuple(
            Carried(
                0.0,
                float(seconds[first[row]]),
                float(seconds[last[row]]),
                start[row],
                end[row],
                float(size[row]),
                int(best[row]),
                tuple(box[row].tolist()),
            )
            for row in range(len(first))
        )

    def of(self, query: Texts, words: Texts, temperature: float) -> tuple[Carried, ...]:
        """Find the carries of what a query means, in the order of time.

        A carry is one of them if no word with another meaning, of what people carry, fits its views better, and the query fits better
        than every canonical phrase. What stays has none. Of those at the same time, the longest stays: the others show a part of the way. Where two do not meet, a carry of any name that leads
        from the end of one to the start of the next is one, too.

        Args:
            query: one phrase.
            words: names of things; those of what people carry compete with it.
            temperature: as in ``relevancy``.
        """
        own = query.queries[0]
        carried = torch.tensor([word in CARRIED for word in words.phrases])
        if not self.every or not carried[(words.queries @ own).argmax()]:
            return ()
        others = words.queries[carried & other_meanings(query, words)]
        fits = self.features @ own
        best = fits > (self.features @ others.T).amax(dim=1) if len(others) else torch.ones_like(fits) > 0
        scores = relevancy(self.features, query.queries, query.canonical, temperature)[:, 0]
        every = [
            Carried(**vars(one) | {"score": float(score)})
            for one, score in zip(self.every, scores, strict=True)
        ]
        found = [one for one, named in zip(every, best, strict=True) if named and one.score > 0.5]
        kept: list[Carried] = []
        for one in sorted(found, key=lambda one: one.from_s - one.until_s):
            if not any(_together(one, other) for other in kept):
                kept.append(one)
        return tuple(_joined(sorted(kept, key=lambda one: one.from_s), every))


def _joined(history: list[Carried], every: Sequence[Carried]) -> Iterator[Carried]:
    """A history with the carries that lead from the end of one carry to the start of the next, where these do not meet."""
    for one, following in itertools.pairwise(history):
        yield one
        if meet(one, one.end, following.start):
            continue
        between = [
            each
            for each in every
            if one.until_s <= each.from_s
            and each.until_s <= following.from_s
            and each.start_is_known
            and each.end_is_known
            and meet(one, one.end, each.start)
            and meet(one, each.end, following.start)
        ]
        if between:
            yield min(between, key=lambda each: np.linalg.norm(one.end - each.start))
    yield from history[-1:]


def _together(one: Carried, other: Carried) -> bool:
    both = min(one.until_s, other.until_s) - max(one.from_s, other.from_s)
    return both >= TOGETHER * min(one.until_s - one.from_s, other.until_s - other.from_s)
