"""What was carried from where to where, as an answer to words (docs/method.md#carries)."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts.consistency import check_spans
from egosplat.artifacts.reader import Artifact
from egosplat.geometry import Array
from egosplat.query.grades.evidence import other_meanings
from egosplat.query.history import Carried, meet
from egosplat.query.relevancy import relevancy
from egosplat.query.rests import Rests
from egosplat.query.text import Texts
from egosplat.query.vocabulary import CARRIED

# Relevancy from which a thing may be what a query means: it is as like the query as the most alike canonical phrase.
FITS = 0.5

# Two carries of a thing show one way if they share this part of the shorter one's time.
_TOGETHER = 0.25

_NOWHERE = np.full(3, np.nan)


class Histories:
    """The carries of things that are seen to rest somewhere, ready to be asked.

    Attributes:
        things: of each thing its carries, in the order of time, with score 0.
        features: (T, D) float32 of unit norm, of each thing; zeros without one.
    """

    def __init__(self, carries: Artifact, rests: Rests, seconds: Array) -> None:
        """Read carries.zarr.

        Args:
            rests: what was made from it.
            seconds: (F,) float64 time of each frame since the first.

        Raises:
            ArtifactError: a carry lies outside of these frames, or ends before it begins.
        """
        tracked, things = _read(carries, seconds), {}
        for thing in np.unique(rests.thing).tolist():
            own = np.flatnonzero(rests.links[0] == thing)
            links = np.stack([own, *rests.links[1:, own]], axis=1).tolist()
            ends = _complete(
                links, np.flatnonzero(rests.thing == thing).tolist(), np.isfinite(rests.absent_s)
            )
            every = [(row, _between(tracked, rests, row, *sides)) for row, *sides in ends]
            # Two rests at one place, without a carry between them, are one that was not seen for a while.
            if ways := _ways([one for row, one in every if row >= 0 or not _is_one_place(one)]):
                things[thing] = ways
        self.things = tuple(things.values())
        self.features = rests.feature[list(things)].cpu()

    @property
    def every(self) -> tuple[Carried, ...]:
        """The carries of all things, in the order of time."""
        return tuple(sorted(itertools.chain.from_iterable(self.things), key=lambda one: one.from_s))

    def of(self, query: Texts, words: Texts, temperature: float) -> tuple[Carried, ...]:
        """Find the carries of the thing that fits a query best, in the order of time.

        No word with another meaning, of what people carry, fits it better, and the query fits it as well as every canonical
        phrase. What stays has no carries.

        Args:
            query: one phrase.
            words: names of things; those of what people carry compete with it.
            temperature: as in ``relevancy``.
        """
        own = query.queries[0]
        carried = torch.tensor([word in CARRIED for word in words.phrases])
        if not self.things or not carried[(words.queries @ own).argmax()]:
            return ()
        others = words.queries[carried & other_meanings(query, words)]
        unnamed = (self.features @ others.T >= (self.features @ own)[:, None]).any(dim=1)
        scores = relevancy(self.features, query.queries, query.canonical, temperature)[:, 0]
        score, best = scores.masked_fill(unnamed, 0.0).max(dim=0)
        if not score > FITS:
            return ()
        return tuple(replace(one, score=float(score)) for one in self.things[best])


def _read(carries: Artifact, seconds: Array) -> list[Carried]:
    """Read the carries that tracks tell, without their places."""
    frames = {name: carries.read(name) for name in ("first_frame", "last_frame", "best_frame")}
    check_spans(carries, len(seconds), frames)
    first, last, best = frames.values()
    columns = (seconds[first], seconds[last], carries.read("size"), best, carries.read("box"))
    return [
        Carried(0.0, from_s, until_s, _NOWHERE, _NOWHERE, size, frame, tuple(box))
        for from_s, until_s, size, frame, box in zip(*(one.tolist() for one in columns), strict=True)
    ]


def _between(tracked: Sequence[Carried], rests: Rests, row: int, before: int, after: int) -> Carried:
    """A carry from the end of the rest before it to the begin of the rest after it; -1 for a row or a rest that is not known.

    Where there is no rest, nothing confirms the place that the track tells.
    """
    rest = after if after >= 0 else before
    if row >= 0:
        known = tracked[row]
    else:
        frame, box = int(rests.frame[rest]), tuple(rests.box[rest].tolist())
        times, certain = rests.absent_s[:, rest].tolist(), min(before, after) >= 0
        known = Carried(0.0, *times, _NOWHERE, _NOWHERE, float(rests.size[rest]), frame, box, certain)
    left = float(rests.until_s[before]) if before >= 0 else known.from_s
    came = float(rests.from_s[after]) if after >= 0 else known.until_s
    # A frame may show it at both places; it was on its way between these times all the same.
    from_s, until_s = sorted((left, came))
    start, end = (rests.center[one] if one >= 0 else _NOWHERE for one in (before, after))
    return replace(known, from_s=from_s, until_s=until_s, start=start, end=end)


def _complete(
    links: Sequence[Sequence[int]], rests: Sequence[int], absent: NDArray[np.bool_]
) -> Iterator[Sequence[int]]:
    """The carries of a thing, (carry, rest before, rest after) each, -1 for none: between two of its ``rests``, in the order of time, is
    one, which may have been missed, and so before the first and after the last, if ``absent`` (2, R) tells that it was elsewhere."""
    whole = [one for one in links if min(one[1:]) >= 0]
    begun, ended = ({one[side] for one in whole} for side in (1, 2))
    used = {one[0] for one in whole}
    yield from whole
    for before, after in itertools.pairwise(rests):
        if before in begun or after in ended:
            continue
        known = [carry for carry, first, second in links if after == second or before == first]
        used.update(known)
        yield (max(known, default=-1), before, after)
    rest = [one for one in links if one[0] not in used]
    yield from rest
    if rests and rests[0] not in {one[2] for one in rest} and absent[0, rests[0]]:
        yield (-1, -1, rests[0])
    if rests and rests[-1] not in {one[1] for one in rest} and absent[1, rests[-1]]:
        yield (-1, rests[-1], -1)


def _is_one_place(one: Carried) -> bool:
    return one.start_is_known and one.end_is_known and meet(one, one.start, one.end)


def _ways(carries: Sequence[Carried]) -> tuple[Carried, ...]:
    """The carries of one thing in the order of time: of those at the same time, the longest."""
    kept: list[Carried] = []
    for one in sorted(carries, key=lambda one: one.from_s - one.until_s):
        if not any(_together(one, other) for other in kept):
            kept.append(one)
    return tuple(sorted(kept, key=lambda one: one.from_s))


def _together(one: Carried, other: Carried) -> bool:
    both = min(one.until_s, other.until_s) - max(one.from_s, other.from_s)
    return both >= _TOGETHER * min(one.until_s - one.from_s, other.until_s - other.from_s)
