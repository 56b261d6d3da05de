"""The surfaces of a scene in flat arrays, rigid body by rigid body, and ray casting against them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import rotate, transform
from egosplat_apartments.arrays import Array, Floats, Ints
from egosplat_apartments.objects.shapes import Part
from egosplat_apartments.objects.textures import Texture
from egosplat_apartments.rays.triangles import Triangles


@dataclass(frozen=True, eq=False)
class Body:
    """Parts of one instance that move together.

    Attributes:
        instance_id: instance id of its pixels; parts: in the body's axes.
        pose: (4, 4) ``world_from_body`` at the beginning.
        role: ``static`` (never moves), ``thing`` (moves), ``person`` (a limb).
    """

    instance_id: int
    parts: tuple[Part, ...]
    pose: Array
    role: str


@dataclass(frozen=True, eq=False)
class Geometry:
    """Surfaces of many bodies; static ones in world axes, others in their own.

    Attributes:
        bodies: static bodies first, then moving objects, then people's limbs.
        vertices, normals: (V, 3) float32; uv: (V, 2) float32.
        faces: (F, 3) int32; face_part: (F,) int32 index of the part.
        body_faces, body_vertices: (B + 1,) first face and vertex of each body, and the end.
        part_names: "instance id/part"; part_body, part_texture: (P,) int32; part_glow: (P,) float32.
        textures: by number, without duplicates.
    """

    bodies: tuple[Body, ...]
    vertices: Floats
    normals: Floats
    uv: Floats
    faces: Ints
    face_part: Ints
    body_faces: Ints
    body_vertices: Ints
    part_names: tuple[str, ...]
    part_body: Ints
    part_texture: Ints
    part_glow: Floats
    textures: tuple[Texture, ...]

    def group(self, role: str) -> tuple[int, int]:
        """First index and end index of the bodies of a role."""
        numbers = [number for number, body in enumerate(self.bodies) if body.role == role]
        return (numbers[0], numbers[-1] + 1) if numbers else (0, 0)

    @cached_property
    def face_normals(self) -> Floats:
        """(F, 3) float32 unit normals of the faces, in the axes of their vertices."""
        first, second, third = (self.vertices[corner] for corner in self.faces.T)
        normals = np.cross(second - first, third - first)
        return normals / np.maximum(lengths(normals)[:, None], 1e-20)


def build_geometry(bodies: Sequence[Body]) -> Geometry:
    """Concatenate the surfaces of bodies."""
    order = {"static": 0, "thing": 1, "person": 2}
    ordered = sorted(bodies, key=lambda body: order[body.role])
    parts = [(number, part) for number, body in enumerate(ordered) for part in body.parts]
    shapes = [_in_place(ordered[number], part) for number, part in parts]
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in shapes)])
    counts = [len(part.shape.faces) for _, part in parts]
    part_body = np.array([number for number, _ in parts], dtype=np.int32)
    numbers = {
        texture: number for number, texture in enumerate(dict.fromkeys(part.texture for _, part in parts))
    }
    ends = np.searchsorted(part_body, np.arange(len(ordered) + 1))
    return Geometry(
        tuple(ordered),
        np.concatenate([vertices for vertices, _ in shapes]).astype(np.float32),
        np.concatenate([normals for _, normals in shapes]).astype(np.float32),
        np.concatenate([part.shape.uv for _, part in parts]).astype(np.float32),
        np.concatenate(
            [part.shape.faces + start for (_, part), start in zip(parts, starts, strict=False)]
        ).astype(np.int32),
        np.repeat(np.arange(len(parts)), counts).astype(np.int32),
        np.cumsum([0, *counts])[ends].astype(np.int32),
        starts[ends].astype(np.int32),
        tuple(f"{ordered[number].instance_id}/{part.name}" for number, part in parts),
        part_body,
        np.array([numbers[part.texture] for _, part in parts], dtype=np.int32),
        np.array([part.glow for _, part in parts], dtype=np.float32),
        tuple(numbers),
    )


def _in_place(body: Body, part: Part) -> tuple[Array, Array]:
    if body.role != "static":
        return part.shape.vertices, part.shape.normals
    return transform(body.pose, part.shape.vertices), rotate(body.pose[:3, :3], part.shape.normals)


@dataclass(frozen=True, eq=False)
class Hits:
    """First intersections of rays with a surface.

    Attributes:
        face: (N,) int32 number of the face in the geometry, -1 for none.
        distance: (N,) float32 along the ray, infinite for none; u, v: (N,) float32 barycentric.
    """

    face: Ints
    distance: Floats
    u: Floats
    v: Floats


class RayScene:
    """Some faces of a geometry at their current positions, for ray casting."""

    def __init__(self, vertices: Floats, faces: Ints, first_face: int) -> None:
        self._triangles = Triangles(vertices, faces)
        self._first_face = first_face
        self.center = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        self.reach = float(lengths(vertices - self.center).max())

    def cast(self, origins: Floats, directions: Floats) -> Hits:
        """First hits of rays from (N, 3) or (3,) origins along (N, 3) unit directions."""
        face, distance, u, v = self._triangles.cast(origins, directions)
        return Hits(np.where(face < 0, -1, face + self._first_face).astype(np.int32), distance, u, v)

    def blocks(self, origins: Floats, directions: Floats, distances: Floats) -> NDArray[np.bool_]:
        """Whether anything lies between (N, 3) origins and ``distances`` [m] along (N, 3) unit directions."""
        return self._triangles.blocks(origins, directions, distances)

    def may_meet(self, origins: Floats, directions: Floats) -> NDArray[np.bool_]:
        """Whether rays, given as for ``cast``, may meet the bounding sphere; cheaper than ``cast``."""
        origin, reach = origins, self.reach
        if origins.ndim == 2:
            # From their middle, to a sphere that is larger by the spread of the origins.
            origin = origins.mean(axis=0)
            reach += float(lengths(origins - origin).max())
        # The angle to the sphere's center against the angle that its radius covers, with a small margin.
        way = self.center - origin
        distance = float(np.linalg.norm(way, axis=-1))
        if distance <= reach * 1.001:
            return np.ones(len(directions), dtype=bool)
        # Column by column: a sum over three numbers a row takes several times as long.
        x, y, z = directions.T * (way / distance).astype(np.float32)[:, None]
        return x + y + z >= np.sqrt(1 - (reach / distance) ** 2) - 1e-4


def lengths(vectors: Floats) -> Floats:
    """(N,) lengths of (N, 3) vectors, to the bit those of ``np.linalg.norm``, which takes several times as long."""
    x, y, z = vectors.T
    return np.sqrt(x * x + y * y + z * z)


def body_scene(geometry: Geometry, first: int, last: int, poses: dict[int, Array] | None = None) -> RayScene:
    """Bodies ``first`` to ``last`` - 1 at ``poses``, by body number; without poses, in the geometry's own axes."""
    vertices = []
    for number in range(first, last):
        own = geometry.vertices[slice(*geometry.body_vertices[[number, number + 1]])]
        if poses is not None:
            pose = poses[number].astype(np.float32)
            own = rotate(pose[:3, :3], own) + pose[:3, 3]
        vertices.append(own)
    begin, end = geometry.body_faces[[first, last]]
    faces = geometry.faces[begin:end] - geometry.body_vertices[first]
    return RayScene(np.concatenate(vertices), faces, int(begin))


def interpolated(geometry: Geometry, hits: Hits, *values: Floats) -> list[Floats]:
    """Interpolate each (V, D) values at the geometry's vertices to (N, D) values at hits."""
    corners = np.take(geometry.faces, hits.face, axis=0).T.copy()
    weights = [weight[:, None] for weight in (1 - hits.u - hits.v, hits.u, hits.v)]
    pairs = [*zip(corners, weights, strict=True)]
    return [reduce(np.add, (np.take(each, at, axis=0) * weight for at, weight in pairs)) for each in values]
