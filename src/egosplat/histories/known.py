"""What histories.zarr tells of a scene: what lies somewhere for a while, and the carries of each thing in the order of time
(docs/answers.md#carries)."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from egosplat.arrays import Array, Bools, Ints, Ints32
from egosplat.artifacts.integrity import damaged
from egosplat.artifacts.reader import Artifact
from egosplat.gaussians.io import read_gaussians
from egosplat.gaussians.model import Gaussians
from egosplat.histories.told import Carried, meet

# Two carries of a thing show one way if they share this part of the shorter one's time.
_TOGETHER = 0.25

_NOWHERE = np.full(3, np.nan)


def read_spans(histories: Artifact, group: str, names: Sequence[str], count: int) -> list[Ints]:
    """Read ``names``, arrays of ``carries`` or ``rests`` with frames: those in which spans begin, those in which they end, and others
    (ArtifactError: a frame is none of ``count``, or a span ends before it begins, as in a file that was edited)."""
    frames = {f"{group}/{name}": histories.read(f"{group}/{name}") for name in names}
    for name, values in frames.items():
        if (values >= count).any():
            what = f"{name!r} tells of frame {values.max()}, and the recording has {count}"
            raise damaged(histories.path, what)
    first, last, *_ = frames.values()
    if (back := first > last).any():
        raise damaged(histories.path, f"{back.sum()} of {len(back)} {group} end before they begin")
    return [*frames.values()]


@dataclass(frozen=True, eq=False)
class Rests:
    """K Gaussians of R rests of T things.

    Attributes:
        rest: (K,) int64 rest of each of the Gaussians, which are on the device of the renderer.
        thing: (R,) int64 thing of each rest; ``feature`` (T, D) float32 of unit norm, of each thing; zeros without one.
        from_s, until_s: (R,) float64 seconds since the first frame, both included.
        absent_s: (2, R) float64 time of the last frame before and the first one after that shows the place without it; NaN without one.
        center, size: (R, 3) float64 in the world, and (R,) [m].
        frame, box: (R,) int64 the frame that shows most of it, and (R, 4) x0, y0, x1, y1 around it there [px].
        links: (3, C) int32 of each carry: its thing, the rest before and the rest after it, -1 for none.
    """

    gaussians: Gaussians
    rest: Ints
    thing: Ints
    from_s: Array
    until_s: Array
    feature: Tensor
    absent_s: Array
    center: Array
    size: Array
    frame: Ints
    box: Ints32
    links: Ints32

    @staticmethod
    def read(histories: Artifact, seconds: Array, device: torch.device) -> "Rests":
        """Read the rests of histories.zarr; ``seconds`` (F,) are those of the frames. Raises as ``read_spans``."""
        names = ("from_frame", "until_frame", "absent_before", "absent_after", "best_frame")
        first, last, before, after, best = read_spans(histories, "rests", names, len(seconds))
        absent = np.stack([before, after])
        return Rests(
            read_gaussians(histories, "gaussians/").to(device),
            histories.read("gaussians/rest").astype(np.int64),
            histories.read("rests/thing").astype(np.int64),
            seconds[first],
            seconds[last],
            torch.from_numpy(histories.read("things/feature")).to(device),
            np.where(absent < 0, np.nan, seconds[absent]),
            histories.read("rests/center"),
            histories.read("rests/size"),
            best,
            histories.read("rests/box"),
            np.stack([histories.read(f"carries/{name}") for name in ("thing", "from_rest", "to_rest")]),
        )

    def at(self, second: float) -> Tensor:
        """(M,) int64 indices of the Gaussians that are there at a time."""
        covers = (self.from_s <= second) & (second <= self.until_s)
        return torch.from_numpy(np.flatnonzero(covers[self.rest])).to(self.feature.device)


class Histories:
    """The carries of T things that are seen to rest somewhere, in the order of time, with score 0; and their (T, D) float32
    ``features`` of unit norm, zeros without one."""

    def __init__(self, histories: Artifact, rests: Rests, seconds: Array) -> None:
        """Read the carries of histories.zarr; ``rests`` are of the same artifact. Raises as ``read_spans``."""
        tracked, things = _read(histories, seconds), {}
        for thing in np.unique(rests.thing).tolist():
            own = np.flatnonzero(rests.links[0] == thing)
            links = np.stack([own, *rests.links[1:, own]], axis=1).tolist()
            lying = np.flatnonzero(rests.thing == thing).tolist()
            ends = _complete(links, lying, np.isfinite(rests.absent_s))
            every = [(row, _between(tracked, rests, row, *sides)) for row, *sides in ends]
            # Two rests at one place, without a carry between them, are one that was not seen for a while.
            if ways := _ways([one for row, one in every if row >= 0 or _moved(one)]):
                things[thing] = ways
        self.things: tuple[tuple[Carried, ...], ...] = tuple(things.values())
        self.features = rests.feature[list(things)].cpu()


def _read(histories: Artifact, seconds: Array) -> list[Carried]:
    """Read the carries that tracks tell, without their places."""
    names = ("first_frame", "last_frame", "best_frame")
    first, last, best = read_spans(histories, "carries", names, len(seconds))
    size, box = (histories.read(f"carries/{name}") for name in ("size", "box"))
    columns = (seconds[first], seconds[last], size, best, box)
    return [
        Carried(0.0, from_s, until_s, _NOWHERE, _NOWHERE, size, frame, tuple(box))
        for from_s, until_s, size, frame, box in zip(*(one.tolist() for one in columns), strict=True)
    ]


def _between(tracked: Sequence[Carried], rests: Rests, row: int, before: int, after: int) -> Carried:
    """A carry from the end of the rest before it to the begin of the rest after it; -1 for a row or a rest that is not known."""
    rest = after if after >= 0 else before
    if row >= 0:
        known = tracked[row]
    else:
        frame, box = int(rests.frame[rest]), tuple(rests.box[rest].tolist())
        (left, came), certain = rests.absent_s[:, rest].tolist(), min(before, after) >= 0
        known = Carried(0.0, left, came, _NOWHERE, _NOWHERE, float(rests.size[rest]), frame, box, certain)
    left = float(rests.until_s[before]) if before >= 0 else known.from_s
    came = float(rests.from_s[after]) if after >= 0 else known.until_s
    # A frame may show it at both places; it was on its way between these times all the same.
    from_s, until_s = sorted((left, came))
    start, end = (rests.center[one] if one >= 0 else _NOWHERE for one in (before, after))
    return replace(known, from_s=from_s, until_s=until_s, start=start, end=end)


def _complete(links: Sequence[Sequence[int]], rests: Sequence[int], absent: Bools) -> Iterator[Sequence[int]]:
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


def _moved(one: Carried) -> bool:
    return not (np.isfinite([one.start, one.end]).all() and meet(one, one.start, one.end))


def _ways(carries: Sequence[Carried]) -> tuple[Carried, ...]:
    """The carries of one thing in the order of time: of those at the same time, the longest."""
    kept: list[Carried] = []
    for one in sorted(carries, key=lambda one: one.from_s - one.until_s):
        # The other ones are longer.
        both = [min(one.until_s, other.until_s) - max(one.from_s, other.from_s) for other in kept]
        if not any(time >= _TOGETHER * (one.until_s - one.from_s) for time in both):
            kept.append(one)
    return tuple(sorted(kept, key=lambda one: one.from_s))
