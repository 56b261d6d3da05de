"""Find carries among the sightings of tracks: a thing leaves a place, moves, and lies still again (docs/answers.md#carries)."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from egosplat.arrays import Array, Bools
from egosplat.histories.sightings import Nesting, Sightings

# A track that no frame shows for longer than this begins anew [s].
_GAP_S = 0.7
# Carries of fewer frames are chance.
_LEAST_FRAMES = 4
# A track whose median mask has a larger share of its pixels at the picture's edge is the wearer's arm or body.
_MOST_EDGE = 0.01
# A track slips to another thing where it jumps farther: in the world by this many sizes, and before the camera by this angle [rad].
_JUMP_SIZES, _JUMP_ANGLE = 2.0, 0.25
# Half of the window in which a thing at rest stays at its place, and the shortest rest between two carries [s].
_STILL_S, _REST_S = 0.4, 1.0
# Distance within which a thing is at one place: this share of its size, and of its depth, which the Gaussians tell no better.
_OF_SIZE, _OF_DEPTH = 0.25, 0.04
# A carried thing goes farther from where it was than this many of its sizes.
_FAR = 2.0
# A mask shows the same as a larger one that covers this share of it on average, in the frames of the shorter carry.
_COVERED = 0.5
# What is seen last at this speed is still on its way, and the depth behind it is not its own [sizes per s]; measured over this time at least [s].
_FAST, _FAST_S = 5.0, 0.15
# Frames of rest before and after a carry that tell the place.
_TELLING = 5


@dataclass(frozen=True, eq=False)
class Carry:
    """A thing on its way, which is ``lost`` if it is fast where it is seen last; ``others`` are tracks of the same or of parts
    of it.

    ``seen`` is the track that shows most of it, in the order of time, with the rests before and after; (S,) bool of them are
    ``moving``.
    """

    seen: Sightings
    moving: Bools
    lost: bool = False
    others: tuple[int, ...] = ()

    @property
    def track(self) -> int:
        """Number of the instance."""
        return int(self.seen.track[0])

    @property
    def first(self) -> int:
        """The frame in which it leaves its place."""
        return int(self.seen.frame[self.moving][0])

    @property
    def last(self) -> int:
        """The frame from which it lies still again, or the last that shows it."""
        return int(self.seen.frame[self.moving][-1])

    @property
    def start(self) -> Array:
        """(3,) where it lay before [m]; NaN if no frame shows it at rest there: a track often begins when it is in the hand."""
        rest = ~self.moving & (self.seen.frame < self.first)
        if not rest.any():
            return np.full(3, np.nan)
        return np.median(self.seen.center[rest][-_TELLING:], axis=0)

    @property
    def end(self) -> Array:
        """(3,) where it is put down [m], or where it is seen last: a track often ends when it lies still. NaN if it is lost."""
        rest = ~self.moving & (self.seen.frame > self.last)
        if not rest.any():
            return np.full(3, np.nan) if self.lost else self.seen.center[self.moving][-1]
        return np.median(self.seen.center[rest][:_TELLING], axis=0)

    @property
    def size(self) -> float:
        """Median size [m]."""
        return float(np.median(self.seen.side))


def find_carries(seen: Sightings, inside: Nesting, seconds: Array) -> list[Carry]:
    """Find the carries of a recording, in the order of time, in what ``see_tracks`` tells of all tracks of what moves, by the
    (F,) float64 time of each frame [s]."""
    every = [carry for run in _runs(seen, seconds) for carry in _carries(run, seconds)]
    # The longest first: it stands for all that show the same.
    every.sort(key=lambda one: (-len(one.seen), -float(np.median(one.seen.area)), one.track))
    kept: list[Carry] = []
    for carry in every:
        same = next((index for index, longer in enumerate(kept) if _same(longer, carry, inside)), None)
        if same is None:
            kept.append(carry)
        else:
            kept[same] = replace(kept[same], others=(*kept[same].others, carry.track))
    return sorted(kept, key=lambda one: (one.first, one.track))


def _runs(seen: Sightings, seconds: Array) -> Iterator[Sightings]:
    """Stretches of a track without a gap or a jump, but those of the wearer's arms."""
    seen = seen[np.lexsort((seen.frame, seen.track))]
    ends = (np.diff(seconds[seen.frame]) > _GAP_S) | (np.diff(seen.track) > 0) | _jumps(seen)
    for begin, end in pairwise([0, *np.flatnonzero(ends) + 1, len(seen)]):
        if end - begin >= _LEAST_FRAMES and np.median(seen.edge[begin:end]) <= _MOST_EDGE:
            yield seen[begin:end]


def _jumps(run: Sightings) -> Bools:
    """(S - 1,) bool: whether the next sighting is elsewhere. What the wearer carries moves little before the camera, a still thing in the world."""
    larger = np.maximum(run.side[:-1], run.side[1:])
    far = np.linalg.norm(np.diff(run.center, axis=0), axis=1) > _JUMP_SIZES * larger
    # The depth of what is held is not known: Gaussians show what is behind it.
    ray = run.local / np.linalg.norm(run.local, axis=1, keepdims=True)
    return far & (np.linalg.norm(np.diff(ray, axis=0), axis=1) > _JUMP_ANGLE)


def _carries(run: Sightings, seconds: Array) -> Iterator[Carry]:
    """The ways of a run, between rests."""
    time = seconds[run.frame]
    moving = _moving(run, time)
    for begin, end in _stretches(~moving):
        if time[end - 1] - time[begin] < _REST_S and 0 < begin and end < len(moving):
            moving[begin:end] = True
    ways = _stretches(moving)
    for number, (begin, end) in enumerate(ways):
        after = ways[number - 1][1] if number else 0
        before = ways[number + 1][0] if number + 1 < len(ways) else len(moving)
        rows = np.arange(after, before)
        carry = Carry(run[rows], (rows >= begin) & (rows < end))
        way = [*carry.seen.center[carry.moving], carry.end]
        far = np.linalg.norm(way - (carry.start if begin > after else way[0]), axis=1).max()
        if end - begin >= _LEAST_FRAMES - 1 and far > _FAR * carry.size:
            # It is lost where it is fast when it is seen last.
            earlier = np.flatnonzero(time[end - 1] - time[:end] >= _FAST_S)[-1:]
            step, span = run.center[end - 1] - run.center[earlier], time[end - 1] - time[earlier]
            lost = bool((np.linalg.norm(step, axis=1) > _FAST * carry.size * span).any())
            yield replace(carry, lost=lost)


def _moving(run: Sightings, time: Array) -> Bools:
    """(S,) bool: sightings around which the thing does not stay at one place."""
    away = np.zeros(len(time))
    for row, now in enumerate(time):
        near = run.center[np.abs(time - now) <= _STILL_S]
        away[row] = np.linalg.norm(near - np.median(near, axis=0), axis=1).max()
    return away > _OF_SIZE * run.side + _OF_DEPTH * run.local[:, 2]


def _stretches(chosen: Bools) -> list[tuple[int, int]]:
    """Begin and end of each stretch of true values."""
    steps = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return list(zip(steps[::2].tolist(), steps[1::2].tolist(), strict=True))


def _same(longer: Carry, other: Carry, inside: Nesting) -> bool:
    """Whether the masks of the shorter carry lie in those of the longer one, or these in them, while it moves."""
    frames = np.intersect1d(longer.seen.frame, other.seen.frame[other.moving])
    if len(frames) < max(1, _COVERED * other.moving.sum()) or longer.track == other.track:
        return False
    pairs = (other.track, longer.track), (longer.track, other.track)
    shares = [max(inside.get((frame, *pair), 0.0) for pair in pairs) for frame in frames.tolist()]
    return float(np.mean(shares)) >= _COVERED
