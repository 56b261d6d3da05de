"""Light: a ceiling lamp, the sun through the windows, and one bounce of both, baked at vertices."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, diags_array

from egosplat_apartments.arrays import Floats, Rng
from egosplat_apartments.camera.raycasting import Geometry, RayScene, lengths
from egosplat_apartments.objects.atlas import Atlas
from egosplat_apartments.world.room import Light, Room

# Stands in for light that has bounced more than once.
_AMBIENT = np.array([0.3, 0.29, 0.28], dtype=np.float32)
# Rays of a vertex; ``_smoothed`` averages over its neighbors, too.
_BAKE_RAYS = 40
# Vertices at a time, which bounds the memory.
_CHUNK = 16_000
# Rays start this far from the surface, so that it does not shadow itself.
_OFF_SURFACE_M = 0.004


@dataclass(frozen=True, eq=False)
class Lights:
    """The light sources.

    Attributes:
        lamp: (3,) float32 position in the world; sun: (3,) float32 unit vector towards it.
        windows: (3,) lower left corner, width and height vectors and inward normal of each window.
        lamp_power, sun_power: (3,) float32 in red, green and blue.
    """

    lamp: Floats
    sun: Floats
    windows: tuple[tuple[Floats, Floats, Floats, Floats], ...]
    lamp_power: Floats = field(default_factory=lambda: np.array(Light().lamp, dtype=np.float32))
    sun_power: Floats = field(default_factory=lambda: np.array(Light().sun, dtype=np.float32))

    def direct(self, scenes: list[RayScene], points: Floats, normals: Floats) -> Floats:
        """(N, 3) irradiance from lamp and sun, with shadows, at (N, 3) points with (N, 3) unit normals."""
        origins = points + _OFF_SURFACE_M * normals
        way = self.lamp - origins
        distance = lengths(way)
        way /= distance[:, None]
        facing = np.einsum("ni,ni->n", way, normals)
        # The 0.5 bounds the light close to the lamp.
        strength = np.maximum(facing, 0) / (0.5 + distance**2)
        # Surfaces within 0.12 m of the lamp's position cast no shadow.
        strength[_blocked(scenes, origins, way, distance - 0.12, strength > 0)] = 0
        return strength[:, None] * self.lamp_power + self._sunlight(scenes, origins, normals)

    def _sunlight(self, scenes: list[RayScene], origins: Floats, normals: Floats) -> Floats:
        """Sunlight; shadow rays are cast only where the sun is visible through a window."""
        facing = np.maximum(_dot(normals, self.sun), 0)
        reach = np.full(len(origins), np.inf, dtype=np.float32)
        for corner, right, up, inward in self.windows:
            towards = float(_dot(self.sun, -inward))
            if towards < 0.05:
                continue
            distance = _dot(origins - corner, inward) / towards
            local = origins + distance[:, None] * self.sun - corner
            a, b = (_dot(local, side) / _dot(side, side) for side in (right, up))
            through = (distance > 0) & (a > 0) & (a < 1) & (b > 0) & (b < 1)
            reach[through] = np.minimum(reach[through], distance[through])
        lit = np.isfinite(reach) & (facing > 0)
        way = np.broadcast_to(self.sun, origins.shape)
        # The window's frame lies a little beyond the wall's plane and casts a shadow too.
        lit &= ~_blocked(scenes, origins, way, reach + 0.11, lit)
        return (facing * lit)[:, None] * self.sun_power


def _dot(vectors: Floats, other: Floats) -> Floats:
    """(...) dot products of (..., 3) vectors with one vector, summed in the same order on every processor."""
    x, y, z = (vectors[..., axis] * other[axis] for axis in range(3))
    return x + y + z


def _blocked(
    scenes: list[RayScene], origins: Floats, ways: Floats, reach: Floats, asked: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    blocked = np.zeros(len(origins), dtype=bool)
    for scene in scenes:
        open_rays = np.flatnonzero(asked & ~blocked)
        # Half the time of indexing.
        begun, along = (np.take(vectors, open_rays, axis=0) for vectors in (origins, ways))
        blocked[open_rays] = scene.blocks(begun, along, reach[open_rays].astype(np.float32))
    return blocked


def make_lights(room: Room, rng: Rng) -> Lights:
    """The room's lamp and windows, and a sun that shines through one of them."""
    windows = []
    for hole in room.windows:
        corner = room.at(hole.wall, hole.left, hole.bottom)
        right = room.right(hole.wall) * (hole.right - hole.left)
        up = np.array([0.0, hole.top - hole.bottom, 0.0])
        windows.append(
            tuple(np.asarray(x, dtype=np.float32) for x in (corner, right, up, room.normal(hole.wall)))
        )
    wall = room.windows[0].wall
    sun = (
        -room.normal(wall)
        + room.right(wall) * rng.uniform(-0.7, 0.7)
        + np.array([0.0, rng.uniform(*room.light.sun_rise), 0.0])
    )
    x, z = room.light.place
    vectors = (
        np.array([x, room.height - room.light.drop, z]),
        sun / np.linalg.norm(sun, axis=-1),
        room.light.lamp,
        room.light.sun,
    )
    lamp, sun, lamp_power, sun_power = (np.asarray(one, dtype=np.float32) for one in vectors)
    return Lights(lamp, sun, tuple(windows), lamp_power, sun_power)


def bake(geometry: Geometry, scene: RayScene, atlas: Atlas, lights: Lights, rng: Rng) -> Floats:
    """(V, 3) float32 irradiance at every vertex from windows, from lamps and from one bounce.

    Moving objects and people get the room's median, more of it from above than from below.
    """
    count = int(geometry.body_vertices[geometry.group("static")[1]])
    points, normals = geometry.vertices[:count], geometry.normals[:count]
    baked = np.empty((len(geometry.vertices), 3), dtype=np.float32)
    for first in range(0, count, _CHUNK):
        here = slice(first, first + _CHUNK)
        baked[here][: count - first] = _gather(
            geometry, scene, atlas, lights, points[here], normals[here], rng
        )
    baked[:count] = _smoothed(geometry, baked[:count])
    mean = np.median(baked[:count], axis=0)
    baked[count:] = mean * (0.95 + 0.35 * geometry.normals[count:, 1:2])
    return baked


def _gather(
    geometry: Geometry,
    scene: RayScene,
    atlas: Atlas,
    lights: Lights,
    points: Floats,
    normals: Floats,
    rng: Rng,
) -> Floats:
    """Irradiance by rays over the hemisphere, cosine-weighted around the normal."""
    # A sunflower pattern on the disc, turned at random per point; lifted to the hemisphere it is
    # distributed like the cosine.
    index = np.arange(_BAKE_RAYS) + 0.5
    radius = np.sqrt(index / _BAKE_RAYS)
    turn = index * np.pi * (3 - np.sqrt(5)) + rng.uniform(0, 2 * np.pi, (len(points), 1))
    disc = np.stack(
        [radius * np.cos(turn), radius * np.sin(turn), np.broadcast_to(np.sqrt(1 - radius**2), turn.shape)],
        -1,
    )
    side = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 0, 1.0]])
    tangent = np.cross(side, normals)
    tangent /= lengths(tangent)[:, None]
    frame = np.stack([tangent, np.cross(normals, tangent), normals], axis=1)
    rays = np.einsum("nki,nij->nkj", disc, frame).reshape(-1, 3).astype(np.float32)
    origins = np.repeat(points + _OFF_SURFACE_M * normals, _BAKE_RAYS, axis=0)
    hits = scene.cast(origins, rays)
    part = geometry.face_part[hits.face]
    albedo = atlas.mean_albedo[geometry.part_texture[part]]
    where = origins + np.where(np.isfinite(hits.distance), hits.distance, 0)[:, None] * rays
    radiance = albedo * (
        lights.direct([scene], where, face_normals(geometry, hits.face, rays)) / np.pi + _AMBIENT
    )
    radiance += albedo * geometry.part_glow[part][:, None]
    radiance[hits.face < 0] = 0
    return radiance.reshape(len(points), _BAKE_RAYS, 3).mean(axis=1) * np.pi


def face_normals(geometry: Geometry, face: NDArray[np.int32], towards: Floats) -> Floats:
    """(N, 3) unit normals of static faces, on the side from which rays along ``towards`` arrive."""
    normals = np.take(geometry.face_normals, face, axis=0)
    return np.where(np.einsum("ni,ni->n", normals, towards)[:, None] > 0, -normals, normals)


def _smoothed(geometry: Geometry, values: Floats) -> Floats:
    """Average values with those of neighboring vertices, twice; removes the noise of few rays."""
    count = len(values)
    faces = geometry.faces[: geometry.body_faces[geometry.group("static")[1]]]
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    # Each inner edge occurs in two faces and in both directions; the vertex itself has weight 6.
    ends = np.concatenate([ends, ends[:, ::-1]])
    links = coo_array((np.ones(len(ends), np.float32), (ends[:, 0], ends[:, 1])), (count, count)).tocsr()
    links = links + diags_array(np.full(count, 6.0, np.float32))
    mean = diags_array(1 / links.sum(axis=1)) @ links
    return (mean @ (mean @ values)).astype(np.float32)
