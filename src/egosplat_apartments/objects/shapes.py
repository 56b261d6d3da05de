"""Building blocks of objects: surfaces of triangles with normals and texture coordinates.

Object axes: x to the right as seen from the object's front, y up, z out of its front. Meters.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from egosplat.geometry import rotate
from egosplat_apartments.arrays import Array
from egosplat_apartments.objects.textures import Texture

# Turns what a lathe makes from upright to the front.
FORWARD = Rotation.from_euler("x", 90, degrees=True)

# Flat faces are cut into cells of at most this size, because light is stored at vertices.
_STEP_M = 0.16


@dataclass(frozen=True)
class Shape:
    """A surface of triangles; vertices are repeated at edges and texture seams.

    Attributes:
        vertices: (V, 3) float64 [m]; normals: (V, 3) float64 unit vectors, outward.
        uv: (V, 2) float64 texture coordinates [m], v downwards.
        faces: (F, 3) int64 vertex numbers.
    """

    vertices: Array
    normals: Array
    uv: Array
    faces: NDArray[np.int64]

    def moved(self, translation: ArrayLike = (0, 0, 0), rotation: Rotation | None = None) -> "Shape":
        """Rotate the shape about its origin, then translate it."""
        turn = np.eye(3) if rotation is None else rotation.as_matrix()
        return replace(
            self,
            vertices=rotate(turn, self.vertices) + np.asarray(translation),
            normals=rotate(turn, self.normals),
        )

    def stretched(self, factors: ArrayLike) -> "Shape":
        """Scale the shape along its axes by (3,) positive factors."""
        scale = np.asarray(factors, dtype=np.float64)
        normals = self.normals / scale
        return replace(
            self,
            vertices=self.vertices * scale,
            normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        )


@dataclass(frozen=True)
class Part:
    """A named piece of an object ("leg") with one texture.

    Attributes:
        glow: emitted light, as a multiple of its texture; 0 for nearly everything.
    """

    name: str
    shape: Shape
    texture: Texture
    glow: float = 0.0


def join(shapes: Iterable[Shape]) -> Shape:
    """Join several shapes into one."""
    pieces = list(shapes)
    starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
    faces = [piece.faces + start for piece, start in zip(pieces, starts[:-1], strict=True)]
    return Shape(
        np.concatenate([piece.vertices for piece in pieces]),
        np.concatenate([piece.normals for piece in pieces]),
        np.concatenate([piece.uv for piece in pieces]),
        np.concatenate(faces),
    )


def sheet(corner: ArrayLike, right: ArrayLike, down: ArrayLike, step: float = _STEP_M) -> Shape:
    """A flat rectangle, seen from the side where ``right`` and ``down`` appear so; uv is 0 at ``corner``."""
    corner, right, down = (np.asarray(value, dtype=np.float64) for value in (corner, right, down))
    width, height = np.linalg.norm(right, axis=-1), np.linalg.norm(down, axis=-1)
    columns, rows = (max(1, int(np.ceil(length / step - 1e-9))) for length in (width, height))
    s, t = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    s, t = s.ravel()[:, None], t.ravel()[:, None]
    normal = np.cross(down, right)
    normals = np.tile(normal / np.linalg.norm(normal, axis=-1), (len(s), 1))
    uv = np.hstack([s * width, t * height])
    return Shape(corner + s * right + t * down, normals, uv, _grid_faces(rows, columns))


def box(lower: ArrayLike, upper: ArrayLike, step: float = _STEP_M) -> Shape:
    """A box between two corners; the texture of each face begins at its top left as seen from outside."""
    (x0, y0, z0), (x1, y1, z1) = np.asarray(lower).tolist(), np.asarray(upper).tolist()
    w, h, d = x1 - x0, y1 - y0, z1 - z0
    return join(
        [
            sheet((x0, y1, z1), (w, 0, 0), (0, -h, 0), step),
            sheet((x1, y1, z0), (-w, 0, 0), (0, -h, 0), step),
            sheet((x1, y1, z1), (0, 0, -d), (0, -h, 0), step),
            sheet((x0, y1, z0), (0, 0, d), (0, -h, 0), step),
            sheet((x0, y1, z0), (w, 0, 0), (0, 0, d), step),
            sheet((x0, y0, z1), (w, 0, 0), (0, 0, -d), step),
        ]
    )


def slab(width: float, depth: float, low: float, high: float) -> Shape:
    """A box centered on the y axis."""
    return box((-width / 2, low, -depth / 2), (width / 2, high, depth / 2))


def at_corners(piece: Callable[[float, float], Shape], x: float, z: float) -> Shape:
    """A piece at each of the four corners (±x, ±z)."""
    return join(piece(side * x, sign * z) for side in (-1, 1) for sign in (-1, 1))


def cushion(lower: ArrayLike, upper: ArrayLike, radius: float) -> Shape:
    """A box with rounded edges and corners; ``radius`` is at most half of its smallest side."""
    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    flat = box(lower, upper, step=max(0.03, float((upper - lower).max()) / 10))
    core = np.clip(flat.vertices, lower + radius, upper - radius)
    outward = flat.vertices - core + 1e-6 * flat.normals
    normals = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    return replace(flat, vertices=core + radius * normals, normals=normals)


def lathe(profile: ArrayLike, segments: int = 24, sharp_deg: float = 40.0) -> Shape:
    """Revolve a profile about the y axis.

    Args:
        profile: (K, 2) radius and height [m], ordered from the bottom upwards along the outside, with the
            surface on its right. It is closed where it begins and ends at radius 0.
        segments: number around the axis.
        sharp_deg: stronger bends of the profile are edges, weaker ones are smooth.
    """
    outline = np.asarray(profile, dtype=np.float64)
    along = np.diff(outline, axis=0)
    keep = np.linalg.norm(along, axis=1) > 1e-9
    along = along[keep]
    starts, ends = outline[:-1][keep], outline[1:][keep]
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    first, last = outward.copy(), outward.copy()
    smooth = (outward[:-1] * outward[1:]).sum(axis=1) > np.cos(np.radians(sharp_deg))
    blend = outward[:-1] + outward[1:]
    blend[smooth] /= np.linalg.norm(blend[smooth], axis=1, keepdims=True)
    last[:-1][smooth], first[1:][smooth] = blend[smooth], blend[smooth]
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(along, axis=1))])
    bands = [
        _band(np.stack([starts[i], ends[i]]), np.stack([first[i], last[i]]), lengths[i : i + 2], segments)
        for i in range(len(along))
    ]
    return join(bands)


def cylinder(radius: float, bottom: float, top: float, segments: int = 24) -> Shape:
    """An upright closed cylinder about the y axis."""
    return lathe([(0, bottom), (radius, bottom), (radius, top), (0, top)], segments)


def ellipsoid(radii: ArrayLike, center: ArrayLike = (0, 0, 0), segments: int = 18) -> Shape:
    """An ellipsoid with semi-axes along x, y, z."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, segments // 2 + 1)
    profile = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    profile[[0, -1], 0] = 0.0
    scale = np.asarray(radii, dtype=np.float64)
    ball = replace(unit := lathe(profile, segments, 90.0), uv=unit.uv * scale.mean())
    return ball.stretched(scale).moved(center)


def rod(start: ArrayLike, end: ArrayLike, radius: float, end_radius: float | None = None) -> Shape:
    """A round bar with rounded ends between two points, possibly tapering."""
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(end - start, axis=-1))
    r0, r1 = radius, radius if end_radius is None else end_radius
    angle = np.radians([-90, -50, -10])
    low = np.stack([r0 * np.cos(angle), 0.6 * r0 * np.sin(angle)], axis=1)
    high = np.stack([r1 * np.cos(angle[::-1]), length - 0.6 * r1 * np.sin(angle[::-1])], axis=1)
    profile = np.concatenate([low, high])
    profile[[0, -1], 0] = 0.0
    # Many rotations map the y axis to the direction; any of them suits a round bar.
    turn = Rotation.align_vectors([end - start], [[0.0, 1.0, 0.0]])[0]
    return lathe(profile, 12, 60.0).moved(start, turn)


def leaf(length: float, width: float, droop: float) -> Shape:
    """A thin leaf along +z from the origin, its tip ``droop`` meters lower; visible from both sides."""
    t, s = np.meshgrid(np.linspace(0, 1, 6), np.linspace(-1, 1, 3), indexing="ij")
    half = 0.5 * width * np.sin(np.pi * np.clip(0.06 + 0.94 * t, 0, 1)) ** 0.8
    x = s * half
    y = length * 0.25 * t * (1 - t) - droop * t**2 + 0.15 * np.abs(s) * half
    vertices = np.stack([x, y, t * length], axis=-1).reshape(-1, 3)
    faces = _grid_faces(5, 2)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(sums, faces[:, corner], normals)
    sums[np.linalg.norm(sums, axis=1) < 1e-12] = (0, 1, 0)
    uv = np.stack([x.ravel() + width / 2, (t * length).ravel()], axis=1)
    return Shape(vertices, sums / np.linalg.norm(sums, axis=1, keepdims=True), uv, faces)


def _band(ends: Array, outward: Array, lengths: Array, segments: int) -> Shape:
    """The surface between two circles; ``ends`` and ``outward`` are (2, 2): radius and height."""
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    circle = np.stack([np.sin(angle), np.cos(angle)], axis=1)

    def ring(values: Array) -> Array:
        return np.stack(
            [values[0] * circle[:, 0], np.full(len(angle), values[1]), values[0] * circle[:, 1]], axis=1
        )

    vertices = np.concatenate([ring(ends[1]), ring(ends[0])])
    normals = np.concatenate([ring(outward[1]), ring(outward[0])])
    around = angle * max(ends[0, 0], ends[1, 0])
    flat = abs(outward[0, 1]) > 0.9 and abs(outward[1, 1]) > 0.9
    # Discs carry their texture as seen from above, not bent around the axis.
    planar = vertices[:, [0, 2]] + max(ends[0, 0], ends[1, 0])
    bent = np.stack([np.tile(around, 2), np.repeat(lengths[-1] - lengths[::-1] + 1.0, len(angle))], axis=1)
    faces = _grid_faces(1, segments)
    area = np.linalg.norm(
        np.cross(
            vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]
        ),
        axis=1,
    )
    return Shape(vertices, normals, planar if flat else bent, faces[area > 1e-12])


def _grid_faces(rows: int, columns: int) -> NDArray[np.int64]:
    """Two triangles per cell of a grid of (rows + 1) x (columns + 1) vertices, numbered row by row."""
    number = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    return np.concatenate([np.stack([a, c, b], -1).reshape(-1, 3), np.stack([b, c, d], -1).reshape(-1, 3)])
