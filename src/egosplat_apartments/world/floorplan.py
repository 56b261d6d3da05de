"""The walkable floor of a room, and shortest routes on it."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from egosplat_apartments.arrays import Array
from egosplat_apartments.world.layout import Layout
from egosplat_apartments.world.room import Room, corridor_bounds

# Side of a cell of the grid.
_CELL_M = 0.06
# Distance that the middle of a walking person keeps from every obstacle.
_BODY_M = 0.27
# Objects above this height do not block a walking person.
_HEAD_ROOM_M = 1.95
# The grid extends beyond the room, to hold the corridor.
_MARGIN_M = 1.8


@dataclass(frozen=True)
class FloorPlan:
    """A grid over the floor of the room and the corridor.

    Attributes:
        origin: (2,) x and z of the center of cell (0, 0) [m].
        clearance: (X, Z) float64 distance to the nearest obstacle [m].
        inside: (X, Z) bool, connected cells of the room in which a person can stand.
        connected: (X, Z) bool, the same including the corridor.
        reaches_door: whether a person can leave through the door.
    """

    origin: Array
    clearance: Array
    inside: NDArray[np.bool_]
    connected: NDArray[np.bool_]
    reaches_door: bool

    @property
    def walkable_m2(self) -> float:
        """Area available to the middle of a person."""
        return float(self.inside.sum() * _CELL_M**2)

    def cell(self, place: Array) -> tuple[int, int]:
        """The cell at (2,) x and z, clipped to the grid."""
        index = np.round((np.asarray(place) - self.origin) / _CELL_M).astype(int)
        x, z = np.clip(index, 0, np.array(self.clearance.shape) - 1).tolist()
        return x, z

    def place(self, cells: NDArray[np.int64]) -> Array:
        """(..., 2) x and z of (..., 2) cells."""
        return self.origin + np.asarray(cells) * _CELL_M

    def clearance_at(self, places: Array) -> Array:
        """(N,) distance [m] of (N, 2) places from the nearest obstacle."""
        index = (np.asarray(places) - self.origin) / _CELL_M
        return ndimage.map_coordinates(self.clearance, index.T, order=1, mode="nearest")

    def nearest(self, place: Array, inside: bool = True) -> Array:
        """(2,) the nearest place where a person can stand."""
        cells = np.argwhere(self.inside if inside else self.connected)
        distance = np.linalg.norm(self.place(cells) - np.asarray(place), axis=1)
        return self.place(cells[distance.argmin()])

    @cached_property
    def _number(self) -> NDArray[np.int64]:
        """(X, Z) index of each connected cell, -1 elsewhere."""
        return np.where(self.connected, np.cumsum(self.connected).reshape(self.connected.shape) - 1, -1)

    @cached_property
    def _trees(self) -> dict[int, NDArray[np.int32]]:
        """Shortest-path trees by start cell, filled on demand: each cell's predecessor."""
        return {}

    @cached_property
    def _graph(self) -> csr_array:
        return _graph(self._number, self.clearance)

    def route(self, start: Array, end: Array) -> Array:
        """(N, 2) places about one cell apart on the way between two places, away from obstacles."""
        cells, number = np.argwhere(self.connected), self._number
        source, target = (int(number[self.cell(self.nearest(place, inside=False))]) for place in (start, end))
        if source not in self._trees:
            _, tree = dijkstra(self._graph, directed=False, indices=source, return_predecessors=True)
            self._trees[source] = tree
        before = self._trees[source]
        path = [target]
        while path[-1] != source:
            path.append(int(before[path[-1]]))
        return self.place(cells[path[::-1]])


def _graph(number: NDArray[np.int64], clearance: Array) -> csr_array:
    """Steps between neighboring cells; narrow places cost more."""
    # Clearance at either end makes a step dearer, so that routes keep off the furniture.
    cost = 1.0 + 0.6 / np.clip(clearance, 0.1, 1.0)
    rows, columns, weights = [], [], []
    for dx, dz in ((1, 0), (0, 1), (1, 1), (1, -1)):
        here = np.s_[: number.shape[0] - dx, max(0, -dz) : number.shape[1] - max(0, dz)]
        there = np.s_[dx:, max(0, dz) : number.shape[1] + min(0, dz)]
        both = (number[here] >= 0) & (number[there] >= 0)
        rows.append(number[here][both])
        columns.append(number[there][both])
        weights.append(np.hypot(dx, dz) * 0.5 * (cost[here][both] + cost[there][both]))
    count = int(number.max()) + 1
    return coo_array(
        (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), (count, count)
    ).tocsr()


def floor_plan(layout: Layout) -> FloorPlan:
    """The floor plan of a furnished room."""
    room = layout.room
    half = np.array([room.width / 2, room.depth / 2]) + _MARGIN_M
    size = np.ceil(2 * half / _CELL_M).astype(int)
    x, z = (-half[axis] + _CELL_M * np.arange(size[axis]) for axis in (0, 1))
    grid = np.stack(np.meshgrid(x, z, indexing="ij"), axis=-1)
    in_room = (np.abs(grid) < half - _MARGIN_M).all(axis=-1)
    free = in_room | _corridor_cells(room, grid)
    for lower, upper in (*(thing.bounds for thing in layout.placed), *room.blocks):
        if lower[1] < _HEAD_ROOM_M:
            free &= ~((grid > lower[[0, 2]]) & (grid < upper[[0, 2]])).all(axis=-1)
    distance: Any = ndimage.distance_transform_edt(free)
    clearance = distance * _CELL_M
    # Clearance is measured from the body's axis.
    standing = clearance > _BODY_M
    inside = _largest(standing & in_room)
    found: Any = ndimage.label(standing)
    labels = found[0]
    connected = labels == labels[inside].max() if inside.any() else inside
    outside = connected & ~in_room
    return FloorPlan(-half, clearance, inside, connected, bool(outside.any()))


def _largest(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    found: Any = ndimage.label(mask)
    labels, count = found
    if not count:
        return mask
    return labels == 1 + int(np.argmax(ndimage.sum_labels(mask, labels, np.arange(1, count + 1))))


def _corridor_cells(room: Room, grid: Array) -> NDArray[np.bool_]:
    """Cells of the doorway and of the corridor."""
    door = room.door
    left, _right, near, far = corridor_bounds(room)
    free = np.zeros(grid.shape[:2], dtype=bool)
    # The open door leaf blocks the right side of the corridor.
    for along, away in (((door.left, door.right), (0.05, -near)), ((left, door.right), (-near, -far))):
        ends = np.stack([room.at(door.wall, a, 0.0, d)[[0, 2]] for a, d in zip(along, away, strict=True)])
        free |= ((grid >= ends.min(axis=0)) & (grid <= ends.max(axis=0))).all(axis=-1)
    return free
