"""Find the rests at the ends of carries: from when until when Gaussians explain the frames better than the scene alone
(docs/method.md#rests)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.gaussians.model import Gaussians
from egosplat.geometry import Array
from egosplat.histories.fitting import essential, explained, fit, start_points
from egosplat.histories.places import Place, PlaceView, Scenery
from egosplat.progress import track

# The sphere of a thing has this part of its size as radius, and this more, as a part of the mean size of all.
_OF_SIZE, _OF_MEAN = 0.6, 0.15
# A rest is learnt first from so many views beyond this time from the carry, whose end is told to half a second [s]; where it is
# shorter than _SURE_S, the carry may have ended later: it is learnt from later views, too.
_FIRST_VIEWS, _LEAST_VIEWS, _APART_S = 8, 3, (0.6, 2.0)

_SURE_S = 2.0
# Steps from the first views, from all of its time, and with the Gaussians that are kept.
_FIRST_STEPS, _STEPS, _LAST_STEPS = 120, 150, 60
# A view shows the thing if its Gaussians explain more than this share of the error; fewer changed pixels than this part of
# the median count for less.
_SHARE, _OF_MEDIAN = 0.1, 0.05
# A thing lies there if its Gaussians explain this share of the error, and so many are opaque to this degree.
_LEAST_GAIN, _LEAST_OPAQUE, _OPAQUE = 0.3, 8, 0.3
# Two rests are one if they are nearer than this part of the smaller radius.
_ONE = 0.6
# A carry belongs to a rest that begins or ends within this time of it [s].
_TOGETHER_S = 2.0


@dataclass(frozen=True, eq=False)
class End:
    """An end of a carry.

    Attributes:
        carry: its number.
        after: whether the thing rests after the carry; else before.
        place: the sphere in which it rests.
        size: of the thing [m].
        second: when the carry begins or ends [s].
    """

    carry: int
    after: bool
    place: Place
    size: float
    second: float


@dataclass(frozen=True, eq=False)
class Rest:
    """A thing that lies somewhere for a while.

    Attributes:
        place: where.
        size: of the thing [m].
        gaussians: what the photographs show of it on top of the scene.
        views: of this time.
        gain: share of the error that the Gaussians explain.
        absent: the last frame before and the first one after that show the place without it, -1 for none.
    """

    place: Place
    size: float
    gaussians: Gaussians
    views: tuple[PlaceView, ...]
    gain: float
    absent: tuple[int, int]

    @property
    def evidence(self) -> float:
        """What is explained, of all views together."""
        return self.gain * len(self.views)

    @property
    def frames(self) -> tuple[int, int]:
        """The first and the last frame that show it."""
        return self.views[0].frame, self.views[-1].frame

    @property
    def center(self) -> Array:
        """(3,) float64 mean of its Gaussians, by their opacity and surface [m]."""
        weight = self.gaussians.opacities * self.gaussians.scales.prod(dim=1) ** (2 / 3)
        weight = (weight / weight.sum()).double()
        return (self.gaussians.means.double() * weight[:, None]).sum(dim=0).cpu().numpy()


def ends_of(carries: Mapping[str, NDArray], seconds: Array) -> list[End]:
    """The ends of all carries, columns by name, whose place is known, in the order of carries."""
    names = ("instance", "first_frame", "last_frame", "start", "end", "size")
    known = [
        (number, after, center, float(size), float(seconds[frame]), int(instance))
        for number, (instance, first, last, start, end, size) in enumerate(
            zip(*(carries[name] for name in names), strict=True)
        )
        for after, center, frame in ((False, start, first), (True, end, last))
        if np.isfinite(center).all()
    ]
    mean = float(np.mean([size for _, _, _, size, _, _ in known])) if known else 0.0
    return [
        End(number, after, Place(center, _OF_SIZE * size + _OF_MEAN * mean, track), size, second)
        for number, after, center, size, second, track in known
    ]


def find_rests(
    ends: Sequence[End], views: Sequence[Sequence[PlaceView]], seconds: Array, scene: Scenery
) -> list[Rest]:
    """Find the rests of all ends of carries, in the order of time; an end at a rest that is known already joins it.

    Args:
        views: of the place of each end.
        seconds: (F,) time of each frame [s].
    """
    found: list[Rest] = []
    for end, seen in track([*zip(ends, views, strict=True)], "learning what rests", unit="end"):
        if any(_holds(one, end.place) and _covers(one, end, seconds) for one in found):
            continue
        rest = _learn(end, seen, seconds, scene)
        if rest is None:
            continue
        same = next((number for number, one in enumerate(found) if _are_one(one, rest)), None)
        if same is None:
            found.append(rest)
        elif rest.evidence > found[same].evidence:
            found[same] = rest
    return sorted(found, key=lambda one: one.frames)


def link(ends: Sequence[End], rests: Sequence[Rest], seconds: Array, carries: int) -> NDArray[np.int32]:
    """(2, C) int32 rest before and after each carry, -1 for none: that of the most evidence at its place and time."""
    found = np.full((2, carries), -1, np.int32)
    for end in ends:
        joined = [
            number
            for number, one in enumerate(rests)
            if _holds(one, end.place)
            and abs(seconds[one.frames[0 if end.after else 1]] - end.second) <= _TOGETHER_S
        ]
        if joined:
            found[int(end.after), end.carry] = max(joined, key=lambda number: rests[number].evidence)
    return found


def _holds(rest: Rest, place: Place) -> bool:
    """Whether a place is that of a rest."""
    apart = float(np.linalg.norm(rest.center - place.center))
    return apart <= min(rest.place.radius, place.radius)


def _covers(rest: Rest, end: End, seconds: Array) -> bool:
    """Whether a carry begins or ends in the time of a rest."""
    first, last = (seconds[frame] for frame in rest.frames)
    return bool(first - _TOGETHER_S <= end.second <= last + _TOGETHER_S)


def _are_one(rest: Rest, other: Rest) -> bool:
    """Whether two rests show one thing: they are at one place for half of the time of the shorter one."""
    apart = float(np.linalg.norm(rest.center - other.center))
    if apart > _ONE * min(rest.place.radius, other.place.radius):
        return False
    (first, last), (begin, end) = rest.frames, other.frames
    both = min(last, end) - max(first, begin)
    return both >= min(last - first, end - begin) / 2


def _learn(end: End, views: Sequence[PlaceView], seconds: Array, scene: Scenery) -> Rest | None:
    """Learn what lies at the end of a carry, and when; None if nothing does."""
    # Seconds from the end of the carry to each view, away from the carry.
    sign = 1.0 if end.after else -1.0
    beyond = np.array([sign * (seconds[view.frame] - end.second) for view in views], np.float64)
    found: Rest | None = None
    for apart in _APART_S:
        rest = _learn_from(beyond > apart, beyond, end, views, scene)
        if rest is not None and (found is None or rest.evidence > found.evidence):
            found = rest
        if found is not None and seconds[found.frames[1]] - seconds[found.frames[0]] >= _SURE_S:
            return found
    return found


def _learn_from(
    allowed: NDArray[np.bool_], beyond: Array, end: End, views: Sequence[PlaceView], scene: Scenery
) -> Rest | None:
    """Learn a thing from the first of the allowed views, then from all views that it explains; None if it explains few."""
    first = sorted(np.flatnonzero(allowed).tolist(), key=lambda number: beyond[number])[:_FIRST_VIEWS]
    if len(first) < _LEAST_VIEWS:
        return None
    some, place = [views[number] for number in first], end.place
    gaussians = fit(start_points(place, some, scene), some, scene, place.radius, _FIRST_STEPS)
    shown = _span(beyond, _shares(explained(gaussians, views, scene)))
    if shown.sum() < _LEAST_VIEWS:
        return None
    chosen = [views[number] for number in np.flatnonzero(shown).tolist()]
    gaussians = essential(fit(gaussians, chosen, scene, place.radius, _STEPS), chosen, scene)
    if int((gaussians.opacities >= _OPAQUE).sum()) < _LEAST_OPAQUE:
        return None
    gaussians = fit(gaussians, chosen, scene, place.radius, _LAST_STEPS)
    fewer, most, _ = explained(gaussians, chosen, scene).sum(axis=0)
    gain = float(fewer / most) if most > 0 else 0.0
    if gain < _LEAST_GAIN:
        return None
    return Rest(place, end.size, gaussians, tuple(chosen), gain, _absent(views, chosen))


def _absent(views: Sequence[PlaceView], chosen: Sequence[PlaceView]) -> tuple[int, int]:
    """The frames next to the chosen views that show the place, before and after them; -1 for none."""
    before = [view.frame for view in views if view.frame < chosen[0].frame]
    after = [view.frame for view in views if view.frame > chosen[-1].frame]
    return max(before, default=-1), min(after, default=-1)


def _shares(told: Array) -> Array:
    """(V,) share of the error that Gaussians explain in each view, below 0 where they add to it."""
    if not len(told):
        return np.zeros(0)
    fewer, most, pixels = told.T
    return fewer / np.maximum(most, max(1.0, _OF_MEDIAN * float(np.median(pixels))))


def _span(beyond: Array, shares: Array) -> NDArray[np.bool_]:
    """(V,) bool: views from just before the end of a carry to where the thing is gone: there the sum of what is explained is largest."""
    shown = np.zeros(len(beyond), bool)
    for side in (np.flatnonzero(beyond > 0), np.flatnonzero(beyond <= 0)):
        away = side[np.argsort(np.abs(beyond[side]), kind="stable")]
        total = np.cumsum(shares[away] - _SHARE)
        if len(total) and total.max() > 0:
            shown[away[: int(total.argmax()) + 1]] = True
    return shown & (shown[beyond > 0].any() if len(shown) else False) & (beyond > -_TOGETHER_S)
