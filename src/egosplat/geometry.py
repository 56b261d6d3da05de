"""Cameras and rigid motions, in the conventions of the whole package (docs/conventions.md).

- Camera axes are OpenCV's: x right, y down, z forward. Meters.
- A pose is ``camera_to_world``, a 4x4 float64 matrix: ``x_world = R x_camera + t``.
- Images are (height, width); a point of the image is (u, v) = (right, down) in pixels.
- The center of the pixel in column i and row j is (i + 0.5, j + 0.5), as in COLMAP and gsplat.
  projectaria-tools puts it at (i, j): see ``ARIA_PIXEL_OFFSET``.
- Rotations become quaternions only through ``scipy.spatial.transform.Rotation``.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from egosplat.arrays import Array, Bools, Ints, Reals

# Added to projectaria-tools' image coordinates (pixel center at the integer) to get this package's.
ARIA_PIXEL_OFFSET = 0.5

# A pose times this turns OpenCV's camera axes into OpenGL's (x right, y up, z backward), and back.
OPENGL_AXES = np.array([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Camera:
    """A pinhole camera: ``u = fx x / z + cx``, ``v = fy y / z + cy``, in pixels; the middle is (width / 2, height / 2)."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @property
    def matrix(self) -> Array:
        """The (3, 3) float64 intrinsic matrix K."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @classmethod
    def from_matrix(cls, matrix: Array, width: int, height: int) -> "Camera":
        """The camera of a (3, 3) intrinsic matrix without skew."""
        k = np.asarray(matrix, dtype=np.float64)
        return cls(width, height, float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2]))

    def scaled_to(self, width: int, height: int) -> "Camera":
        """Return this camera with its image resized to ``width`` x ``height``."""
        sx, sy = width / self.width, height / self.height
        return Camera(width, height, self.fx * sx, self.fy * sy, self.cx * sx, self.cy * sy)

    def project(self, points: Array) -> Array:
        """Project (..., 3) float64 points in camera axes [m] to (..., 2) pixels; NaN where z <= 0."""
        x, y, z = np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)
        depth = np.where(z > 0, z, np.nan)
        return np.stack([self.fx * x / depth + self.cx, self.fy * y / depth + self.cy], axis=-1)

    def contains(self, pixels: Array) -> Bools:
        """(...) bool: which of (..., 2) image points lie inside the image; NaN does not."""
        return lie_within(np.asarray(pixels), np.array([[0.0, 0.0], [self.width, self.height]]))


# ``sensor_from_upright``: maps camera axes of the clockwise-rotated image to those of the sensor image.
CLOCKWISE = np.array(
    [[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)


def known_poses(camera_to_world: Array) -> Ints:
    """Indices of the (F, 4, 4) poses that are finite; a frame without a pose has NaN."""
    return np.flatnonzero(np.isfinite(camera_to_world).all(axis=(1, 2)))


def make_pose(rotation: Array, translation: Array) -> Array:
    """(..., 3, 3) rotations and (..., 3) translations -> (..., 4, 4) float64."""
    translation = np.asarray(translation, dtype=np.float64)
    pose = np.zeros((*translation.shape[:-1], 4, 4))
    pose[..., :3, :3] = rotation
    pose[..., :3, 3] = translation
    pose[..., 3, 3] = 1.0
    return pose


def invert(pose: Array) -> Array:
    """Inverse of (..., 4, 4) rigid motions, by transposing the rotation."""
    rotation = np.swapaxes(pose[..., :3, :3], -1, -2)
    return make_pose(rotation, -np.einsum("...ij,...j->...i", rotation, pose[..., :3, 3]))


def transform(pose: Array, points: Array) -> Array:
    """Apply a (4, 4) rigid or similarity motion to (..., 3) points."""
    return rotate(pose[:3, :3], np.asarray(points, dtype=np.float64)) + pose[:3, 3]


def rotate(rotation: NDArray, vectors: NDArray) -> NDArray:
    """Rotate (..., 3) vectors by a (3, 3) rotation, or project them on (2, 3) axes, in their dtype."""
    # ``@`` calls BLAS, whose order of summation depends on the processor.
    x, y, z = (vectors[..., axis : axis + 1] * rotation[:, axis] for axis in range(3))
    return x + y + z


def compose(first: Reals, second: Reals) -> Array:
    """Product ``first @ second`` of (..., 4, 4) poses or (..., 3, 3) rotations."""
    # einsum has the same order of summation on every processor, as ``rotate``.
    return np.einsum("...ij,...jk->...ik", first, second)


def is_rigid(pose: Array, tolerance: float = 1e-6) -> Bools:
    """(...) bool: which of (..., 4, 4) matrices are finite, orthonormal, right-handed, with last row 0 0 0 1."""
    pose = np.asarray(pose, dtype=np.float64)
    finite = np.asarray(np.isfinite(pose).all(axis=(-1, -2)))
    safe = np.where(finite[..., None, None], pose, np.eye(4))
    rotation = safe[..., :3, :3]
    gram = rotation @ np.swapaxes(rotation, -1, -2)
    orthonormal = np.abs(gram - np.eye(3)).max(axis=(-1, -2)) <= tolerance
    last_row = np.abs(safe[..., 3, :] - np.array([0.0, 0.0, 0.0, 1.0])).max(axis=-1) <= tolerance
    return finite & orthonormal & last_row & (np.linalg.det(rotation) > 0)


def interpolate_poses(times: Ints, poses: Array, at: Ints) -> Array:
    """Interpolate (N, 4, 4) poses: translations linearly, rotations along the shortest arc; (M, 4, 4) at ``at``.

    ``times`` (N,) and ``at`` (M,) are int64 nanoseconds. ValueError: fewer than two times, not strictly increasing, or ``at``
    reaches outside of them.
    """
    times, at = np.asarray(times, dtype=np.int64), np.asarray(at, dtype=np.int64)
    if len(times) < 2 or (np.diff(times) <= 0).any():
        raise ValueError("pose times must be at least two and strictly increasing")
    if len(at) and (at.min() < times[0] or at.max() > times[-1]):
        raise ValueError("a time lies outside the trajectory")
    # Seconds from the start: nanoseconds since the epoch do not fit a float64.
    grid, query = (times - times[0]) * 1e-9, (at - times[0]) * 1e-9
    rotation = Slerp(grid, Rotation.from_matrix(poses[:, :3, :3]))(query).as_matrix()
    translation = np.stack([np.interp(query, grid, poses[:, axis, 3]) for axis in range(3)], axis=-1)
    return make_pose(rotation, translation)


def rotation_angle(pose: Array) -> Array:
    """(...) angle of the rotation of (..., 4, 4) poses [rad]."""
    # scipy's magnitude is accurate for small angles, unlike the arc cosine of the trace.
    flat = np.asarray(pose, dtype=np.float64).reshape(-1, 4, 4)
    return Rotation.from_matrix(flat[:, :3, :3]).magnitude().reshape(pose.shape[:-2])


def ground_axes(up: Array) -> Array:
    """(2, 3) float64 unit vectors that span the plane perpendicular to ``up``, a (3,) unit vector.

    Seen from above, the first points to the right of the page and the second to its top.
    """
    # The world axis least parallel to up gives the best-conditioned cross product.
    helper = np.eye(3)[np.argmin(np.abs(up))]
    right = np.cross(helper, up)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(up, right)])


def lie_within(places: Array, limits: Array) -> Bools:
    """(...) bool: which of (..., A) places lie within (2, A) limits, on the lower ones, too, but not on the upper ones."""
    return ((places >= limits[0]) & (places < limits[1])).all(axis=-1)
