"""Cut a long recording into cells of the ground, on each of which Gaussians are trained by a job of its own, as VastGaussian does
(Lin et al. 2024): each holds about as many cameras, trains on those around it, too, and keeps what lies in it."""

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

from egosplat.arrays import Array, Bools
from egosplat.geometry import ground_axes, lie_within, rotate

# A cell trains on the cameras within this share of its sides, and this many depths, of its border.
_MARGIN, _DEPTHS = 0.2, 0.5

# The depth is that of the frames that see least through walls: points behind them count, too.
_OPEN = 0.25


def find_cells(
    poses: Array, depths: Array, usable: Bools, counted: Bools, up: Array, most: int
) -> list[dict[str, Any]]:
    """The section ``cells`` of survey.json; empty if a single training can do. A cell with more than ``most``
    cameras, 0 for any number, is halved at their median along its longer side, if this is longer than the depth that they
    see: cameras of a narrower one see its neighbors anyway. ``poses``, ``depths``: (F, 4, 4) camera_to_world, and (F,) median
    depths of their views [m], NaN if unknown. ``usable``, ``counted``: (F,) bool frames with a pose that training may use, and
    those among them that add a view. ``up``: (3,) unit vector. ValueError: the pose of a usable frame is not finite."""
    if not np.isfinite(poses[usable]).all():
        raise ValueError("a pose is not finite")
    known, places = depths[usable & np.isfinite(depths)], rotate(ground_axes(up), poses[usable, :3, 3])
    depth = float(np.quantile(known, _OPEN)) if len(known) else 0.0
    # Numbers, because JSON has no infinity.
    everything, chosen = sys.float_info.max * np.array([[-1.0, -1.0], [1.0, 1.0]]), places[counted[usable]]
    cells = [*_halved(chosen, everything, most, depth)] if most else []
    return [] if len(cells) < 2 else [_cell(box, np.flatnonzero(usable), places, depth) for box in cells]


def _halved(places: Array, box: Array, most: int, least: float) -> Iterator[Array]:
    """Yield the boxes, (2, 2) lower and upper limits, of the parts of one that holds the (N, 2) places."""
    sides = np.ptp(places, axis=0) if len(places) else np.zeros(2)
    axis = int(sides.argmax())
    if len(places) <= most or sides[axis] <= least:
        yield box
        return
    along = np.sort(places[:, axis])
    middle = len(along) // 2
    # Where the camera stands still at the median, some must lie below the cut.
    cut = max((along[middle - 1] + along[middle]) / 2, along[along > along[0]][0])
    below, above = box.copy(), box.copy()
    below[1, axis] = above[0, axis] = cut
    yield from _halved(places[places[:, axis] < cut], below, most, least)
    yield from _halved(places[places[:, axis] >= cut], above, most, least)


def _cell(box: Array, frames: Array, places: Array, depth: float) -> dict[str, Any]:
    margin = _MARGIN * np.ptp(places[lie_within(places, box)], axis=0) + _DEPTHS * depth
    near = frames[lie_within(places, box + np.stack([-margin, margin]))]
    return {"limits": box.tolist(), "margin": margin.tolist(), "frames": near.tolist()}
