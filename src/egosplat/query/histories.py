"""What was carried from where to where, as an answer to words (docs/method.md#carries)."""

import copy
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts.consistency import check_frames
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
        fits: relevancy from which a carry may be of a query.
    """

    fits = 0.5

    def __init__(self, carries: Artifact, seconds: Array) -> None:
        """Read carries.zarr; ``seconds`` (F,) time of each frame since the first. Raises ArtifactError if one lies outside of them."""
        names = ("first_frame", "last_frame", "start", "end", "size", "best_frame", "box")
        first, last, start, end, size, best, box = map(carries.read, names)
        check_frames(carries, len(seconds), first_frame=first, last_frame=last, best_frame=best)
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
        found = [one for one, named in zip(every, best, strict=True) if named and one.score > self.fits]
        kept: list[Carried] = []
        for one in sorted(found, key=lambda one: one.from_s - one.until_s):
            if not any(_together(one, other) for other in kept):
                kept.append(one)
        return tuple(_joined(sorted(kept, key=lambda one: one.from_s), every))


class ThingHistories(Histories):
    """The carries of things that are seen to rest somewhere: a history is that of one thing.

    Attributes:
        things: (C,) of each carry. A carry of no such thing is left out.
    """

    # A thing is a thing: that hands and tables around it are like the canonical phrases tells less against it.
    fits = 0.35

    def __init__(self, carries: Artifact, rests: Artifact, seconds: Array) -> None:
        """Read carries.zarr, and rests.zarr that was made from it; ``seconds`` as in ``Histories``."""
        super().__init__(carries, seconds)
        names = ("carries/thing", "carries/from_rest", "carries/to_rest")
        links = [
            (int(row), *map(int, one)) for row, one in enumerate(zip(*map(rests.read, names), strict=True))
        ]
        of_rests = rests.read("thing")
        absent = np.stack([rests.read("absent_before"), rests.read("absent_after")])
        told = []
        for thing in np.unique(of_rests).tolist():
            own = [(row, before, after) for row, of, before, after in links if of == thing]
            told += [
                (thing, *one) for one in _complete(own, np.flatnonzero(of_rests == thing).tolist(), absent)
            ]
        every = [(thing, row, self._between(rests, seconds, row, *ends)) for thing, row, *ends in told]
        # Two rests at one place, without a carry between them, are one that was not seen for a while.
        kept = [(thing, one) for thing, row, one in every if row >= 0 or not _is_one_place(one)]
        self.every = tuple(one for _, one in kept)
        self.things = np.array([thing for thing, _ in kept], np.int32)
        self.features = torch.from_numpy(rests.read("things/feature")[self.things])

    def _between(self, rests: Artifact, seconds: Array, row: int, before: int, after: int) -> Carried:
        """A carry from the end of the rest before it to the begin of the rest after it; -1 for a row or a rest that is not known.

        Where there is no rest, nothing confirms the place that the track tells.
        """
        center, nowhere = rests.read("center"), np.full(3, np.nan)
        rest = after if after >= 0 else before
        if row >= 0:
            known = self.every[row]
        else:
            frame, box = int(rests.read("best_frame")[rest]), tuple(rests.read("box")[rest].tolist())
            times = (seconds[rests.read(name)[rest]] for name in ("absent_before", "absent_after"))
            size, certain = float(rests.read("size")[rest]), min(before, after) >= 0
            known = Carried(0.0, *map(float, times), nowhere, nowhere, size, frame, box, certain)
        left = seconds[rests.read("until_frame")[before]] if before >= 0 else known.from_s
        came = seconds[rests.read("from_frame")[after]] if after >= 0 else known.until_s
        # A frame may show it at both places; it was on its way between these times all the same.
        from_s, until_s = sorted((float(left), float(came)))
        start, end = (center[one] if one >= 0 else nowhere for one in (before, after))
        return replace(known, from_s=from_s, until_s=until_s, start=start, end=end)

    def of(self, query: Texts, words: Texts, temperature: float) -> tuple[Carried, ...]:
        """Find the carries of the thing that fits a query best, by all of its views; otherwise as ``Histories.of``."""
        every = [Histories.of(one, query, words, temperature) for one in self._of_things()]
        return max(filter(None, every), key=lambda history: history[0].score, default=())

    def _of_things(self) -> Iterator[Histories]:
        for thing in np.unique(self.things):
            own = np.flatnonzero(self.things == thing)
            one = copy.copy(self)
            one.every, one.features = tuple(self.every[row] for row in own), self.features[own]
            yield one


def _complete(
    links: Sequence[tuple[int, int, int]], rests: Sequence[int], absent: NDArray[np.int64]
) -> Iterator[tuple[int, int, int]]:
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
    if rests and rests[0] not in {one[2] for one in rest} and absent[0, rests[0]] >= 0:
        yield (-1, -1, rests[0])
    if rests and rests[-1] not in {one[1] for one in rest} and absent[1, rests[-1]] >= 0:
        yield (-1, rests[-1], -1)


def _is_one_place(one: Carried) -> bool:
    return one.start_is_known and one.end_is_known and meet(one, one.start, one.end)


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
