"""Find the rests at the ends of carries: from when until when Gaussians explain the frames better than the scene alone
(docs/answers.md#rests)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from egosplat.arrays import Array, Bools, Ints32
from egosplat.gaussians.model import Gaussians
from egosplat.histories.fitting import essential, explained, fit, start_points
from egosplat.histories.moves import Carry
from egosplat.histories.places import End, PlaceView, Recording
from egosplat.images import evenly_spaced
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
# Views of a rest that are kept, for OpenCLIP: all those of an hour do not fit into memory.
VIEWS = 16
# A thing lies there if its Gaussians explain this share of the error, and so many are opaque to this degree.
_LEAST_GAIN, _LEAST_OPAQUE, _OPAQUE = 0.3, 8, 0.3
# Two rests are one if they are nearer than this part of the smaller radius.
_ONE = 0.6
# A carry belongs to a rest that begins or ends within this time of it [s].
_TOGETHER_S = 2.0


@dataclass(frozen=True, eq=False)
class Rest:
    """A thing of a size [m] that lies somewhere for a while, looked for in a sphere of a radius [m].

    Its Gaussians, on top of the scene, explain the share ``gain`` of the error of the views of this time, of which a few are kept, and
    the ``evidence`` of all of them together. ``frames`` are the first and the last that show it, ``absent`` the last one before and the
    first one after that show the place without it, -1 for none.
    """

    radius: float
    size: float
    gaussians: Gaussians
    views: tuple[PlaceView, ...]
    gain: float
    evidence: float
    frames: tuple[int, int]
    absent: tuple[int, int]

    @cached_property
    def center(self) -> Array:
        """(3,) float64 mean of its Gaussians, by their opacity and surface [m]."""
        weight = self.gaussians.opacities * self.gaussians.scales.prod(dim=1) ** (2 / 3)
        weight = (weight / weight.sum()).double()
        return (self.gaussians.means.double() * weight[:, None]).sum(dim=0).cpu().numpy()


def ends_of(carries: Sequence[Carry], seconds: Array) -> list[End]:
    """The ends of all carries whose place is known, in the order of carries."""
    known = [
        (number, after, place, carry.size, float(seconds[frame]), carry.track)
        for number, carry in enumerate(carries)
        for after, place, frame in ((False, carry.start, carry.first), (True, carry.end, carry.last))
        if np.isfinite(place).all()
    ]
    mean = float(np.mean([size for _, _, _, size, _, _ in known])) if known else 0.0
    return [
        End(number, after, place, _OF_SIZE * size + _OF_MEAN * mean, size, second, instance)
        for number, after, place, size, second, instance in known
    ]


def find_rests(
    ends: Sequence[End], views: Iterable[Sequence[PlaceView]], seconds: Array, recording: Recording
) -> list[Rest]:
    """Find the rests of all ends of carries, by views of each, in the order of time [s]; an end at a rest that is known joins
    it."""
    rests: list[Rest] = []
    for end, seen in track(zip(ends, views, strict=True), "learning what rests", len(ends), "end"):
        times = [seconds[[*rest.frames]] + (-_TOGETHER_S, _TOGETHER_S) for rest in rests if _holds(rest, end)]
        if any(first <= end.second <= last for first, last in times):
            continue
        learnt = _learn(end, seen, seconds, recording)
        if learnt is None:
            continue
        same = next((index for index, rest in enumerate(rests) if _are_one(rest, learnt)), None)
        if same is None:
            rests.append(learnt)
        elif learnt.evidence > rests[same].evidence:
            rests[same] = learnt
    return sorted(rests, key=lambda rest: rest.frames)


def link(ends: Sequence[End], rests: Sequence[Rest], seconds: Array, carries: int) -> Ints32:
    """(2, C) int32 rest before and after each carry, -1 for none: that of the most evidence at its place and time."""
    links = np.full((2, carries), -1, np.int32)
    for end in ends:
        joined = [
            number
            for number, rest in enumerate(rests)
            if _holds(rest, end)
            and abs(seconds[rest.frames[0 if end.after else 1]] - end.second) <= _TOGETHER_S
        ]
        if joined:
            links[int(end.after), end.carry] = max(joined, key=lambda number: rests[number].evidence)
    return links


def _holds(rest: Rest, end: End) -> bool:
    """Whether the place of an end of a carry is that of a rest."""
    return bool(np.linalg.norm(rest.center - end.center) <= min(rest.radius, end.radius))


def _are_one(rest: Rest, other: Rest) -> bool:
    """Whether two rests show one thing: they are at one place for half of the time of the shorter one."""
    if np.linalg.norm(rest.center - other.center) > _ONE * min(rest.radius, other.radius):
        return False
    (first, last), (begin, end) = rest.frames, other.frames
    return min(last, end) - max(first, begin) >= min(last - first, end - begin) / 2


def _learn(end: End, views: Sequence[PlaceView], seconds: Array, recording: Recording) -> Rest | None:
    """Learn what lies at the end of a carry, and when; None if nothing does."""
    # Seconds from the end of the carry to each view, away from the carry.
    sign = 1.0 if end.after else -1.0
    beyond = np.array([sign * (seconds[view.frame] - end.second) for view in views], np.float64)
    best: Rest | None = None
    for apart in _APART_S:
        rest = _learn_from(beyond > apart, beyond, end, views, recording)
        if rest is not None and (best is None or rest.evidence > best.evidence):
            best = rest
        if best is not None and seconds[best.frames[1]] - seconds[best.frames[0]] >= _SURE_S:
            return best
    return best


def _learn_from(
    allowed: Bools, beyond: Array, end: End, views: Sequence[PlaceView], recording: Recording
) -> Rest | None:
    """Learn a thing from the first of the allowed views, then from all views that it explains; None if it explains few."""
    first = sorted(np.flatnonzero(allowed).tolist(), key=lambda number: beyond[number])[:_FIRST_VIEWS]
    if len(first) < _LEAST_VIEWS:
        return None
    some = [views[number] for number in first]
    gaussians = fit(start_points(end, some, recording), some, recording.seed, end.radius, _FIRST_STEPS)
    shown = _span(beyond, _shares(explained(gaussians, views)))
    if shown.sum() < _LEAST_VIEWS:
        return None
    chosen = [views[number] for number in np.flatnonzero(shown).tolist()]
    gaussians = essential(fit(gaussians, chosen, recording.seed, end.radius, _STEPS), chosen)
    if int((gaussians.opacities >= _OPAQUE).sum()) < _LEAST_OPAQUE:
        return None
    gaussians = fit(gaussians, chosen, recording.seed, end.radius, _LAST_STEPS)
    fewer, most, _ = explained(gaussians, chosen).sum(axis=0)
    gain = float(fewer / most) if most > 0 else 0.0
    if gain < _LEAST_GAIN:
        return None
    # The frames next to the chosen views that show the place.
    before = max((view.frame for view in views if view.frame < chosen[0].frame), default=-1)
    after = min((view.frame for view in views if view.frame > chosen[-1].frame), default=-1)
    few = tuple(chosen[number] for number in evenly_spaced(len(chosen), VIEWS))
    spans = (chosen[0].frame, chosen[-1].frame), (before, after)
    return Rest(end.radius, end.size, gaussians, few, gain, gain * len(chosen), *spans)


def _shares(told: Array) -> Array:
    """(V,) share of the error that Gaussians explain in each view, below 0 where they add to it."""
    if not len(told):
        return np.zeros(0)
    fewer, most, pixels = told.T
    return fewer / np.maximum(most, max(1.0, _OF_MEDIAN * float(np.median(pixels))))


def _span(beyond: Array, shares: Array) -> Bools:
    """(V,) bool: views from just before the end of a carry to where the thing is gone: there the sum of what is explained is largest."""
    shown = np.zeros(len(beyond), bool)
    for side in (np.flatnonzero(beyond > 0), np.flatnonzero(beyond <= 0)):
        away = side[np.argsort(np.abs(beyond[side]), kind="stable")]
        total = np.cumsum(shares[away] - _SHARE)
        if len(total) and total.max() > 0:
            shown[away[: int(total.argmax()) + 1]] = True
    return shown & (shown[beyond > 0].any() if len(shown) else False) & (beyond > -_TOGETHER_S)
