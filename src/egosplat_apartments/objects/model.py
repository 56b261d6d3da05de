"""Models of objects: parts in the object's axes, and surfaces on which other objects may stand."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from egosplat.geometry import make_pose, transform
from egosplat_apartments.arrays import Array, Rng
from egosplat_apartments.objects.shapes import Part


@dataclass(frozen=True)
class Surface:
    """A rectangle on an object that can support others, in the object's axes [m].

    Attributes:
        use: ``table``, ``shelf``, ``soft`` (seats and beds), ``bed`` (for a mattress) or ``television``.
        lower, upper: (x, z) of its corners; height: its y; headroom: free height above it.
    """

    use: str
    lower: tuple[float, float]
    upper: tuple[float, float]
    height: float
    headroom: float = 2.0


@dataclass(frozen=True)
class Model:
    """An object in its own axes: its parts, and its supporting surfaces."""

    parts: tuple[Part, ...]
    surfaces: tuple[Surface, ...] = ()


Builder = Callable[[Rng], Model]


def assemble(*parts: Part, surfaces: tuple[Surface, ...] = ()) -> Model:
    """An object of these parts."""
    return Model(parts, surfaces)


def bounds_at(model: Model, pose: Array) -> tuple[Array, Array]:
    """Lower and upper corner (3,) of a model's box in world axes."""
    points = transform(pose, np.concatenate([part.shape.vertices for part in model.parts]))
    return points.min(axis=0), points.max(axis=0)


def boxes_touch(first: Array, second: Array, gap: float) -> bool:
    """Whether two (2, 3) boxes come closer than ``gap`` [m]."""
    return bool((first[0] < second[1] + gap).all() and (second[0] < first[1] + gap).all())


def yaw_pose(yaw: float, place: Array) -> Array:
    """(4, 4) pose at ``place``, turned about the vertical."""
    return make_pose(Rotation.from_euler("y", yaw).as_matrix(), np.asarray(place, dtype=np.float64))
