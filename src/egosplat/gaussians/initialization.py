"""Initialize Gaussians at the points of the poses artifact, or at random points.

Points are float64 NumPy arrays; the resulting Gaussians are float32 tensors. Random numbers depend on the seed only.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from egosplat.errors import UserError
from egosplat.gaussians.model import Gaussians
from egosplat.geometry import Camera, invert, transform

Points = NDArray[np.float64]

# The constant spherical harmonic 1 / (2 sqrt(pi)): color = SH_C0 * coefficient + 0.5.
SH_C0 = 0.28209479177387814

# As in 3DGS.
INITIAL_OPACITY = 0.1

# Lengths are in near planes, so that a scene in any unit starts as the same scene in meters does; in meters, the near
# plane is 0.1. Floor of the squared neighbor distance, as in 3DGS: a Gaussian at a duplicate point is 0.3 mm wide, not 0.
_LEAST_SQUARED_DISTANCE = 1e-5

# Width of the Gaussian at a lone point, which has no neighbors.
_LONE_SCALE = 1.0

# Scene extent for a camera that hardly moves.
_LEAST_EXTENT = 10.0

# Largest distance of random points from their camera, in scene extents (gsplat's ``init_extent``).
_REACH = 3.0


def scene_extent(camera_to_world: Points, near_plane: float = 0.1) -> float:
    """Return the scene size [m]: 1.1 times the largest distance of a camera from the mean camera (3DGS).

    The learning rate of the means and the split and prune sizes scale with it.

    Args:
        camera_to_world: (F, 4, 4) float64, registered frames only, F >= 1.
        near_plane: smallest camera z [m]; the result is at least 10 times as large.

    Raises:
        ValueError: there is no pose, or a pose is not finite.
    """
    centers = camera_to_world[:, :3, 3]
    if not len(centers) or not np.isfinite(centers).all():
        raise ValueError(f"camera_to_world {camera_to_world.shape} has no pose or one that is not finite")
    distances = np.linalg.norm(centers - centers.mean(axis=0), axis=1)
    # A camera that only rotates has extent 0; the floor keeps learning rates and prune sizes positive.
    return max(1.1 * float(distances.max()), _LEAST_EXTENT * near_plane)


def from_points(
    xyz: Points,
    rgb: NDArray[np.uint8],
    *,
    sh_degree: int,
    feature_channels: int,
    max_points: int,
    seed: int,
    near_plane: float = 0.1,
) -> Gaussians:
    """Place one isotropic Gaussian at each point, scaled by the distance to its neighbors (3DGS).

    Drops points that are not finite and keeps a random subset of at most ``max_points``. Opacity is 0.1, rotation
    the identity; features and SH coefficients above degree 0 are zero.

    Args:
        xyz: (P, 3) float64 world points [m]; duplicates are allowed.
        rgb: (P, 3) uint8.
        sh_degree: degree of the allocated SH coefficients.
        feature_channels: F.
        max_points: at least 1.
        near_plane: smallest camera z [m], the unit of the least sizes.

    Returns:
        Gaussians on the CPU that do not require gradients.

    Raises:
        ValueError: wrong shape or dtype.
        UserError: no point is finite in float32.
    """
    if xyz.ndim != 2 or xyz.shape[1] != 3 or rgb.shape != xyz.shape or rgb.dtype != np.uint8:
        raise ValueError(f"xyz {xyz.shape} and rgb {rgb.shape} {rgb.dtype} are not (P, 3) and (P, 3) uint8")
    # Gaussians are float32, so points must be finite in float32. NaN compares as False.
    kept = np.flatnonzero((np.abs(xyz) <= np.finfo(np.float32).max).all(axis=1))
    if not len(kept):
        raise UserError("splats: no finite point to start from; start from random points instead")
    kept = kept[random_subset(len(kept), max_points, seed)]
    points, count = xyz[kept], len(kept)
    sh = torch.zeros(count, (sh_degree + 1) ** 2, 3)
    sh[:, 0] = torch.from_numpy((rgb[kept] / 255.0 - 0.5) / SH_C0)
    return Gaussians(
        means=torch.from_numpy(points).float(),
        quats=torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        log_scales=torch.from_numpy(np.log(neighbor_distance(points, near_plane)))
        .float()[:, None]
        .repeat(1, 3),
        logit_opacities=torch.full((count,), INITIAL_OPACITY).logit(),
        sh=sh,
        features=torch.zeros(count, feature_channels),
    )


def random_subset(count: int, most: int, seed: int) -> NDArray[np.int64]:
    """Return sorted indices of at most ``most`` of ``count`` items: all, or a random subset."""
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(seed).choice(count, most, replace=False))


def neighbor_distance(points: Points, near_plane: float = 0.1) -> NDArray[np.float64]:
    """Return the (P,) float64 RMS distance [m] of each of (P, 3) points to its three nearest neighbors.

    Uses fewer neighbors if there are fewer. A lone point gets the near plane; the minimum is 0.3 % of it.
    """
    if len(points) < 2:
        return np.full(len(points), _LONE_SCALE * near_plane)
    neighbors = min(3, len(points) - 1)
    # The nearest match is the point itself or a duplicate of it, at distance zero.
    distances, _ = cKDTree(points).query(points, k=neighbors + 1)
    least = _LEAST_SQUARED_DISTANCE * near_plane**2
    return np.sqrt(np.maximum((distances[:, 1:] ** 2).mean(axis=1), least))


def seen(points: Points, camera: Camera, camera_to_world: Points, *, near_plane: float) -> NDArray[np.bool_]:
    """Test which points lie in the image of at least one camera. Occlusion is ignored.

    Args:
        points: (P, 3) float64 world points [m].
        camera_to_world: (F, 4, 4) float64, registered frames only.
        near_plane: smallest camera z [m].

    Returns:
        (P,) bool; False for a point that is not finite.
    """
    result = np.zeros(len(points), dtype=bool)
    unseen = np.flatnonzero(np.isfinite(points).all(axis=1))
    for world_to_camera in invert(camera_to_world):
        local = transform(world_to_camera, points[unseen])
        inside = in_picture(local, camera, near_plane=near_plane)
        result[unseen[inside]] = True
        unseen = unseen[~inside]
        if not len(unseen):
            break
    return result


def in_picture(local: Points, camera: Camera, *, near_plane: float) -> NDArray[np.bool_]:
    """Test which points (P, 3) in camera axes [m] lie in the image, at ``near_plane`` or beyond; (P,) bool."""
    return camera.contains(camera.project(local)) & (local[:, 2] >= near_plane)


def random_points(
    count: int, camera: Camera, camera_to_world: Points, *, near_plane: float, seed: int
) -> tuple[Points, NDArray[np.uint8]]:
    """Sample points and colors for a scene without points, uniformly in the viewing volumes.

    Draws a camera, then a point in its frustum between ``near_plane`` and three scene extents. Every point is
    visible, and regions seen by more cameras get more points.

    Args:
        camera_to_world: (F, 4, 4) float64, registered frames only, F >= 1.
        near_plane: smallest camera z [m].

    Returns:
        (count, 3) float64 world points [m] and (count, 3) uint8 colors, for ``from_points``.

    Raises:
        ValueError: see ``scene_extent``.
    """
    generator = np.random.default_rng(seed)
    far_plane = near_plane + _REACH * scene_extent(camera_to_world, near_plane)
    which = generator.integers(len(camera_to_world), size=count)
    # The cross-section of a frustum grows with z², so z³ is uniform.
    depth = np.cbrt(generator.uniform(near_plane**3, far_plane**3, size=count))
    u, v = generator.uniform(size=(2, count)) * np.array([[camera.width], [camera.height]])
    local = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(count)], axis=1)
    pose = camera_to_world[which]
    points = np.einsum("nij,nj->ni", pose[:, :3, :3], local * depth[:, None]) + pose[:, :3, 3]
    return points, generator.integers(256, size=(count, 3), dtype=np.uint8)
