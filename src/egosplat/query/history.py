"""Where a thing was, by when it was carried from where to where."""

from collections.abc import Sequence
from dataclasses import dataclass

from egosplat.geometry import Array


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
