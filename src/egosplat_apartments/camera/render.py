"""Images, labels and depth of a scene through the camera's lens, by ray casting."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import rotate
from egosplat_apartments.adt_format.sequence import View
from egosplat_apartments.arrays import Array, Floats, Ints, Rng
from egosplat_apartments.camera.lens import Lens, develop, tone, untone
from egosplat_apartments.camera.lighting import Lights, bake, face_normals
from egosplat_apartments.camera.raycasting import (
    Geometry,
    Hits,
    RayScene,
    body_scene,
    interpolated,
    lengths,
)
from egosplat_apartments.objects.atlas import Atlas

_SUBPIXELS = ((-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125))
_VISIBILITY_RAYS = 2500
# Pixels that measure the brightness of a view.
_METERED = 1000


@dataclass(frozen=True, eq=False)
class _Scenes:
    """Targets of the rays of one shot: static surfaces, each moving object and each person by instance id.

    ``full`` is all of it in few pieces.
    """

    static: RayScene
    things: dict[int, RayScene]
    people: dict[int, RayScene]

    full: list[RayScene]


class Renderer:
    """Renders one geometry many times.

    Attributes:
        geometry: the surfaces; lens: the camera's rays.
        atlas: the textures; static: the surfaces that never move.
    """

    def __init__(self, geometry: Geometry, lights: Lights, lens: Lens, rng: Rng) -> None:
        """Bake the light that does not change.

        Args:
            geometry: the surfaces; lights: the light sources; lens: the camera's rays.
        """
        self.geometry = geometry
        self.lens = lens
        self._lights = lights
        self.atlas = Atlas(geometry.textures)
        self.static = body_scene(geometry, *geometry.group("static"))
        self._baked = bake(geometry, self.static, self.atlas, lights, rng)
        self._ids = np.array([body.instance_id for body in geometry.bodies], dtype=np.uint64)
        self._static_alone: dict[int, RayScene] = {}

    def shoot(
        self, world_from_camera: Array, poses: dict[int, Array], gain: float, rng: Rng
    ) -> tuple[NDArray[np.uint8], View, View]:
        """Render the scene: its (H, W, 3) uint8 picture with people, and its ground truth with and without them.

        Args:
            world_from_camera: (4, 4) pose of the camera, in the lens's axes.
            poses: (4, 4) pose of every moving body, by its number in the geometry.
            gain: factor on all brightness; rng: for the sensor's noise.
        """
        scenes, turn, origin, rays = self._prepare(world_from_camera, poses)
        full, with_people, without_people = self._truth(scenes, origin, rays)
        rgb = self.develop(self._light(scenes, full, poses, origin, turn, rays), gain, rng)
        return rgb, with_people, without_people

    def truth(self, world_from_camera: Array, poses: dict[int, Array]) -> tuple[View, View]:
        """The ground truth of ``shoot`` alone, with and without people."""
        scenes, _, origin, rays = self._prepare(world_from_camera, poses)
        return self._truth(scenes, origin, rays)[1:]

    def _truth(self, scenes: _Scenes, origin: Floats, rays: Floats) -> tuple[Hits, View, View]:
        """The hits with people, and the ground truth with and without them."""
        empty = self._cast([scenes.static, *scenes.things.values()], origin, rays)
        full = empty
        for person in scenes.people.values():
            full = self._nearer(full, person, origin, rays)
        without = self._view(scenes, empty, origin, rays)
        return full, self._view(scenes, full, origin, rays) if scenes.people else without, without

    def radiance(self, world_from_camera: Array, poses: dict[int, Array]) -> Floats:
        """(N, 3) radiance of the lens's pixels in linear light.

        Args:
            world_from_camera: (4, 4) pose of the camera, or (H, 4, 4) of each row of the image.
            poses: as for ``shoot``.
        """
        if world_from_camera.ndim == 3:
            world_from_camera = world_from_camera.astype(np.float32)[np.nonzero(self.lens.valid)[0]]
        scenes, turn, origin, rays = self._prepare(world_from_camera, poses)
        return self._light(scenes, self._cast(scenes.full, origin, rays), poses, origin, turn, rays)

    def brightness(self, world_from_camera: Array, poses: dict[int, Array]) -> float:
        """Mean radiance of the scene, from a sample of the lens's pixels; arguments as for ``shoot``."""
        scenes, _, origin, rays = self._prepare(world_from_camera, poses)
        step = max(1, len(rays) // _METERED)
        rays, angle = rays[::step], self.lens.angle[::step]
        hits = self._cast(scenes.full, origin, rays)
        light = self._shade(scenes, self._rotations(poses), hits, origin, rays, angle)
        # Sums along axis 0 have the same order on every processor.
        return float(light.mean(axis=0, dtype=np.float64).sum() / 3)

    def picture(
        self, world_from_camera: Array, poses: dict[int, Array], gain: float, rng: Rng
    ) -> tuple[NDArray[np.uint8], Ints]:
        """Render the scene and the number of each pixel's visible face, -1 for none; arguments as for ``shoot``."""
        scenes, turn, origin, rays = self._prepare(world_from_camera, poses)
        hits = self._cast(scenes.full, origin, rays)
        rgb = self.develop(self._light(scenes, hits, poses, origin, turn, rays), gain, rng)
        return rgb, self._image(hits.face, np.int32, -1)

    def _prepare(
        self, world_from_camera: Array, poses: dict[int, Array]
    ) -> tuple[_Scenes, Floats, Floats, Floats]:
        """The ray targets, the rotation and origin of (..., 4, 4) ``world_from_camera``, and the rays in the world."""
        pose = world_from_camera.astype(np.float32)
        turn = pose[..., :3, :3]
        return self._scenes(poses), turn, pose[..., :3, 3], _turned(turn, self.lens.directions)

    def _light(
        self, scenes: _Scenes, hits: Hits, poses: dict[int, Array], origin: Floats, turn: Floats, rays: Floats
    ) -> Floats:
        """(N, 3) radiance at ray hits, with soft edges."""
        rotations = self._rotations(poses)
        # Shading and edge softening work in linear light; ``develop`` applies the tone curve.
        radiance = self._shade(scenes, rotations, hits, origin, rays, self.lens.angle)
        self._soften(scenes, rotations, hits, radiance, origin, turn)
        return radiance

    def develop(
        self, radiance: Floats, gain: float, rng: Rng, sensor: Callable[[Floats], Floats] | None = None
    ) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 image of (N, 3) radiance; arguments as for ``lens.develop``."""
        return self._image(develop(radiance, self.lens.radius, gain, rng, sensor), np.uint8)

    def _cast(self, scenes: list[RayScene], origin: Floats, rays: Floats) -> Hits:
        hits = scenes[0].cast(origin, rays)
        for scene in scenes[1:]:
            hits = self._nearer(hits, scene, origin, rays)
        return hits

    def _nearer(self, hits: Hits, scene: RayScene, origin: Floats, rays: Floats) -> Hits:
        """Keep the nearer of the given hits and those of another scene."""
        asked = np.flatnonzero(scene.may_meet(origin, rays))
        other = scene.cast(origin if origin.ndim == 1 else origin[asked], rays[asked])
        closer = other.distance < hits.distance[asked]
        merged = Hits(hits.face.copy(), hits.distance.copy(), hits.u.copy(), hits.v.copy())
        for name in ("face", "distance", "u", "v"):
            getattr(merged, name)[asked[closer]] = getattr(other, name)[closer]
        return merged

    def _image(self, values: NDArray, dtype: type, outside: int = 0) -> NDArray:
        """Values of the valid pixels as an image."""
        image = np.full((*self.lens.valid.shape, *values.shape[1:]), outside, dtype=dtype)
        image[self.lens.valid] = values
        return image

    def _scenes(self, poses: dict[int, Array]) -> _Scenes:
        geometry = self.geometry
        first, last = geometry.group("static")[1], len(geometry.bodies)
        moving = [body_scene(geometry, first, last, poses)] if last > first else []
        things, people = (self._posed(role, poses) for role in ("thing", "person"))
        return _Scenes(self.static, things, people, [self.static, *moving])

    def _posed(self, role: str, poses: dict[int, Array]) -> dict[int, RayScene]:
        """Each moving instance of a role at its current pose, by instance id."""
        first, last = self.geometry.group(role)
        scenes = {}
        for uid in np.unique(self._ids[first:last]).tolist():
            bodies = np.flatnonzero(self._ids == uid)
            scenes[uid] = body_scene(self.geometry, int(bodies[0]), int(bodies[-1]) + 1, poses)
        return scenes

    def _view(self, scenes: _Scenes, hits: Hits, origin: Floats, rays: Floats) -> View:
        body = self.geometry.part_body[self.geometry.face_part[hits.face]]
        ids = np.where(hits.face >= 0, self._ids[body], 0).astype(np.uint64)
        depth = np.where(hits.face >= 0, hits.distance * self.lens.directions[:, 2], 0)
        millimeters = np.clip(np.round(depth * 1000.0), 0, 65535)
        visibility = self._visibility(scenes, ids, origin, rays)
        return View(self._image(ids, np.uint64), self._image(millimeters, np.uint16), visibility)

    def _visibility(
        self, scenes: _Scenes, ids: NDArray[np.uint64], origin: Floats, rays: Floats
    ) -> dict[int, float]:
        """Unoccluded fraction of each instance's pixels, from a sample if there are many."""
        shares: dict[int, float] = {}
        for uid in np.unique(ids[ids > 0]).tolist():
            scene = scenes.things.get(uid) or scenes.people.get(uid) or self._alone(uid)
            asked = np.flatnonzero(scene.may_meet(origin, rays))
            seen = ids[asked] == uid
            stride = max(1, min(len(asked) // _VISIBILITY_RAYS, int(seen.sum()) // 300))
            asked, seen = asked[::stride], seen[::stride]
            # Pixels that the instance would cover alone, against those that it covers in the scene.
            covered = scene.cast(origin, rays[asked]).face >= 0
            shares[uid] = float(seen.sum() / max(1, (covered | seen).sum()))
        return shares

    def _alone(self, uid: int) -> RayScene:
        """A static instance alone."""
        if uid not in self._static_alone:
            body = int(np.flatnonzero(self._ids == uid)[0])
            self._static_alone[uid] = body_scene(self.geometry, body, body + 1)
        return self._static_alone[uid]

    def _rotations(self, poses: dict[int, Array]) -> Floats:
        """(B, 3, 3) ``world_from_body`` rotations for the geometry's arrays."""
        rotations = np.tile(np.eye(3, dtype=np.float32), (len(self.geometry.bodies), 1, 1))
        for number, pose in poses.items():
            rotations[number] = pose[:3, :3]
        return rotations

    def _shade(
        self, scenes: _Scenes, rotations: Floats, hits: Hits, origin: Floats, rays: Floats, angle: Floats
    ) -> Floats:
        """(N, 3) radiance in linear light."""
        geometry = self.geometry
        part = geometry.face_part[hits.face]
        normals, uv, light = interpolated(geometry, hits, geometry.normals, geometry.uv, self._baked)
        self._turn_moved(normals, geometry.part_body[part], rotations)
        normals /= np.maximum(lengths(normals)[:, None], 1e-12)
        facing = np.einsum("ni,ni->n", normals, rays)
        # Surfaces are visible from both sides: normals turn towards the camera.
        normals[facing > 0] *= -1
        distance = np.where(np.isfinite(hits.distance), hits.distance, 0)
        points = origin + distance[:, None] * rays
        light += self._lights.direct(scenes.full, points, normals)
        # A pixel covers more of a slanted surface; the bound keeps grazing views from blurring to one color.
        footprint = distance * angle / np.sqrt(np.maximum(np.abs(facing), 0.12))
        albedo = self.atlas.albedo(geometry.part_texture[part], uv, footprint)
        radiance = albedo * (light / np.float32(np.pi) + geometry.part_glow[part][:, None])
        radiance[hits.face < 0] = 0
        return radiance

    def _soften(
        self, scenes: _Scenes, rotations: Floats, hits: Hits, radiance: Floats, origin: Floats, turn: Floats
    ) -> None:
        """Antialias: replace pixels on edges by the mean of four rays."""
        lens = self.lens
        edge = np.flatnonzero(self._on_edge(hits, rotations))
        if turn.ndim == 3:
            turn, origin = turn[edge], origin[edge]
        total = np.zeros((len(edge), 3), dtype=np.float32)
        for dx, dy in _SUBPIXELS:
            rays = (
                lens.directions[edge] + np.float32(dx) * lens.right[edge] + np.float32(dy) * lens.down[edge]
            )
            rays = _turned(turn, rays / lengths(rays)[:, None])
            found = self._cast(scenes.full, origin, rays)
            # Average display values, not light: else edges of bright surfaces stay jagged.
            total += tone(self._shade(scenes, rotations, found, origin, rays, lens.angle[edge]))
        radiance[edge] = untone(total / len(_SUBPIXELS))

    def _on_edge(self, hits: Hits, rotations: Floats) -> NDArray[np.bool_]:
        """Pixels at a border between parts, at a bend of one part, or at a jump in depth."""
        geometry = self.geometry
        part = self._image(np.where(hits.face >= 0, geometry.face_part[hits.face], -1), np.int32, -2)
        inverse = self._image(1 / np.maximum(hits.distance, 0.05), np.float32)
        normals = self._image(self._flat_normals(hits, rotations), np.float32)
        edge = np.zeros(part.shape, dtype=bool)
        for here, there in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
            bend = np.einsum("hwi,hwi->hw", normals[here], normals[there]) < 0.85
            jump = np.abs(inverse[here] - inverse[there]) > 0.12 * np.minimum(inverse[here], inverse[there])
            differs = (part[here] != part[there]) | bend | jump
            edge[here] |= differs
            edge[there] |= differs
        return edge[self.lens.valid]

    def _flat_normals(self, hits: Hits, rotations: Floats) -> Floats:
        body = self.geometry.part_body[self.geometry.face_part[hits.face]]
        normals = face_normals(self.geometry, hits.face, np.zeros((len(body), 3), dtype=np.float32))
        self._turn_moved(normals, body, rotations)
        return normals

    def _turn_moved(self, normals: Floats, body: Ints, rotations: Floats) -> None:
        """Turn (N, 3) normals on (N,) bodies into world axes, where the body is not static."""
        moved = np.flatnonzero(body >= self.geometry.group("static")[1])
        normals[moved] = np.einsum("nij,nj->ni", rotations[body[moved]], normals[moved])


def _turned(turn: Floats, directions: Floats) -> Floats:
    """Rotate (N, 3) directions by a (3, 3) rotation or by (N, 3, 3) of their own."""
    if turn.ndim == 2:
        return rotate(turn, directions)
    x, y, z = (directions[:, axis : axis + 1] * turn[:, :, axis] for axis in range(3))
    return x + y + z
