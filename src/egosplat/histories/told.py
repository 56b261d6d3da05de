"""Where a thing was, by when it was carried from where to where."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np

from egosplat.arrays import Array
from egosplat.errors import UserError

# Two places are one if they are no farther apart than this many sizes of the thing: depth is that of the surface behind it.
APART = 3.0


def clock(second: float) -> str:
    """A time in minutes and whole seconds, such as "1:05"."""
    minutes, rest = divmod(int(second), 60)
    return f"{minutes}:{rest:02d}"


@dataclass(frozen=True, eq=False)
class Carried:
    """A thing of a size [m] that left its place and was put down at another one, between two seconds since the first frame.

    Attributes:
        score: relevancy of the query, 0..1.
        start, end: (3,) float64 the places; NaN if not known.
        frame, box: the frame that shows most of it, and x0, y0, x1, y1 around it there, the ends exclusive [px].
        certain: whether it left one place for another: else a hand may only have hidden it meanwhile.
    """

    score: float
    from_s: float
    until_s: float
    start: Array
    end: Array
    size: float
    frame: int
    box: tuple[int, int, int, int]
    certain: bool = True

    @property
    def told(self) -> str:
        """When it was carried, such as "0:04 to 0:07"."""
        return f"{clock(self.from_s)} to {clock(self.until_s)}"


@dataclass(frozen=True, eq=False)
class Place:
    """Where a thing was at a time, or whether it was ``carried`` on its way.

    Attributes:
        position: (3,) float64; None while it is carried, where neither carry tells it, and between two that do not meet.
        since_s, until_s: seconds for which it was so; None if nobody saw it come, or leave.
    """

    position: Array | None
    since_s: float | None
    until_s: float | None
    carried: bool = False

    @property
    def told(self) -> str:
        """In words, such as "here from 0:07 to 0:16"."""
        what = "here" if self.position is not None else "carried" if self.carried else "place unknown"
        if self.since_s is None:
            return what if self.until_s is None else f"{what} until {clock(self.until_s)}"
        return f"{what} from {clock(self.since_s)} {'on' if self.until_s is None else f'to {clock(self.until_s)}'}"


def read_second(given: object) -> float:
    """A time [s since the first frame] that a caller of the library gave (UserError: it is no number)."""
    if not isinstance(given, Real) or math.isnan(given):
        raise UserError(f"{given!r:.40} is no time; give seconds since the first frame, as 65")
    return float(given)


def place_at(history: Sequence[Carried], second: float) -> Place | None:
    """Where a thing was at a time [s], by its carries in the order of time; None without any (UserError: the time is NaN).

    A time before the recording is as its first frame, a time after it as its last.
    """
    second = read_second(second)
    now = next((one for one in history if one.from_s <= second <= one.until_s), None)
    if now is not None:
        return Place(None, now.from_s, now.until_s, carried=now.certain)
    last = max((one for one in history if one.until_s < second), key=lambda one: one.until_s, default=None)
    following = min((one for one in history if one.from_s > second), key=lambda one: one.from_s, default=None)
    if last is None and following is None:
        return None
    # Both carries show the place.
    places = ([] if last is None else [last.end]) + ([] if following is None else [following.start])
    known = [one for one in places if np.isfinite(one).all()]
    agree = last is None or meet(last, places[0], places[-1])
    position = np.mean(known, axis=0) if known and agree else None
    return Place(position, last and last.until_s, following and following.from_s)


def meet(carry: Carried, one: Array, other: Array) -> bool:
    """Whether two places may be one to a thing of the size of a carried one: so may one that is not known."""
    return not np.linalg.norm(one - other) > APART * carry.size
