"""Subparts, parts and wholes of a synthetic world, from its surfaces.

A *whole* is an object, a person, or a piece of the building (one wall, one window). A *part* is a piece that its
builder names (the legs of a table). A *subpart* is a connected piece of a part (one leg).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from egosplat_apartments.camera.raycasting import Geometry
from egosplat_apartments.world.world import World

Ints = NDArray[np.int32]

LEVELS = ("subpart", "part", "whole")

# Parts of the building that form one whole together; every other part of the building is its own whole.
_BUILDING = {
    "lamp base": "lamp",
    "window reveal": "window",
    "window frame": "window",
    "window sill": "window",
    "view": "window",
    "door reveal": "door",
    "door frame": "door",
}

_WELD_M = 1e-5


@dataclass(frozen=True, eq=False)
class Levels:
    """Tables of the levels of a world.

    Attributes:
        face_subpart: (F,) int32 subpart of each face.
        subpart_part: (S,) int32 part of each subpart; part_whole: (P,) int32 whole of each part.
        part_names: (P,) names of parts; whole_names: (W,) category of objects and people, name of building pieces.
        whole_instance: (W,) index into ``World.instances``.
    """

    face_subpart: Ints
    subpart_part: Ints
    part_whole: Ints
    part_names: tuple[str, ...]
    whole_names: tuple[str, ...]
    whole_instance: Ints


def find_levels(world: World) -> Levels:
    """Find the subparts, parts and wholes of a world."""
    geometry = world.geometry
    face_subpart = _connected(geometry)
    subpart_part = np.zeros(face_subpart.max() + 1, dtype=np.int32)
    subpart_part[face_subpart] = geometry.face_part
    numbers = {one.instance_id: number for number, one in enumerate(world.instances)}
    names = [name.partition("/")[2] for name in geometry.part_names]
    part_instance = [numbers[geometry.bodies[body].instance_id] for body in geometry.part_body]
    keys = _whole_keys(part_instance, names)
    wholes = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    categories = [one.category for one in world.instances]
    return Levels(
        face_subpart,
        subpart_part,
        np.array([wholes[key] for key in keys], dtype=np.int32),
        tuple(names),
        tuple(name or categories[instance] for instance, name, _ in wholes),
        np.array([instance for instance, _, _ in wholes], dtype=np.int32),
    )


def _whole_keys(part_instance: list[int], names: list[str]) -> list[tuple[int, str, int]]:
    """Key of the whole of each part: instance, building piece and running number."""
    seen: dict[str, int] = {}
    keys = []
    for instance, name in zip(part_instance, names, strict=True):
        if instance != 0:
            keys.append((instance, "", 0))
            continue
        # The n-th reveal, frame and view belong to the n-th window.
        number = seen[name] = seen.get(name, -1) + 1
        keys.append((instance, _BUILDING.get(name, name), number))
    return keys


def _connected(geometry: Geometry) -> Ints:
    """(F,) index of the connected component of its part that each face belongs to."""
    # Vertices are repeated at edges and seams. Weld those of one part at the same place.
    corners = geometry.faces.reshape(-1)
    part = np.repeat(geometry.face_part, 3)
    place = np.round(geometry.vertices[corners] / _WELD_M).astype(np.int64)
    _, vertex = np.unique(np.column_stack([part, place]), axis=0, return_inverse=True)
    a, b, c = vertex.reshape(-1, 3).T
    links = coo_array(
        (np.ones(2 * len(a)), (np.concatenate([a, b]), np.concatenate([b, c]))), (vertex.max() + 1,) * 2
    )
    _, piece = connected_components(links, directed=False)
    _, numbered = np.unique(piece[a], return_inverse=True)
    return numbered.astype(np.int32)
