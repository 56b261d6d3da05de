"""The Gaussians that training starts from: at the points of the poses artifact, or random where there are none.

Arrays are NumPy's in float64 until the Gaussians are made; everything random is drawn from the given seed.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from egosplat.errors import UserError
from egosplat.gaussians.model import Gaussians
from egosplat.geometry import Camera, invert, transform

Points = NDArray[np.float64]

SH_C0 = 0.28209479177387814
"""The constant spherical harmonic 1 / (2 sqrt(pi)): colour = SH_C0 * coefficient + 0.5."""

INITIAL_OPACITY = 0.1
"""3DGS's."""

_LEAST_SQUARED_DISTANCE = 1e-7
"""To the neighbours [m²], 3DGS's floor: a Gaussian at a duplicated point is 0.3 mm wide, not zero."""

_LONE_SCALE = 0.1
"""Width [m] of the Gaussian of a single point, which has no neighbours."""

_LEAST_EXTENT = 1.0
"""Scene extent [m] of a camera that hardly moves: the scene is not smaller than what a still head sees."""

_REACH = 3.0
"""How far from the cameras random points are put, in scene extents (gsplat's ``init_extent``)."""


def scene_extent(camera_to_world: Points) -> float:
    """Size of the scene [m]: 1.1 times the largest distance of a camera from the mean camera (3DGS).

    Learning rate of the means and the sizes at which Gaussians are split and pruned are fractions of it, so
    it must not vanish where somebody stands still and only turns the head: it is 1 m at least.

    Args:
        camera_to_world: (F, 4, 4) float64, registered frames only, F >= 1.

    Raises:
        ValueError: no pose, or one that is not finite.
    """
    centres = camera_to_world[:, :3, 3]
    if not len(centres) or not np.isfinite(centres).all():
        raise ValueError(f"camera_to_world {camera_to_world.shape} has no pose or one that is not finite")
    distances = np.linalg.norm(centres - centres.mean(axis=0), axis=1)
    return max(1.1 * float(distances.max()), _LEAST_EXTENT)


def from_points(
    xyz: Points,
    rgb: NDArray[np.uint8],
    *,
    sh_degree: int,
    feature_channels: int,
    max_points: int,
    seed: int,
) -> Gaussians:
    """One round Gaussian at each point, as wide as the way to its neighbours (3DGS).

    Points that are not finite are dropped; of more than ``max_points`` a random subset is kept.
    Opacity 0.1, identity rotation, SH above degree 0 and features zero.

    Args:
        xyz: (P, 3) float64 points in the world [m]; duplicates may occur.
        rgb: (P, 3) uint8.
        sh_degree: degree that ``sh`` gets coefficients for.
        feature_channels: F.
        max_points: at least 1.
        seed: of the subset.

    Returns:
        On the CPU, not requiring gradients.

    Raises:
        ValueError: shapes or dtypes other than these.
        UserError: no point that is finite in float32.
    """
    if xyz.ndim != 2 or xyz.shape[1] != 3 or rgb.shape != xyz.shape or rgb.dtype != np.uint8:
        raise ValueError(f"xyz {xyz.shape} and rgb {rgb.shape} {rgb.dtype} are not (P, 3) and (P, 3) uint8")
    # In float32, which the Gaussians are of: NaN compares as False.
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
        log_scales=torch.from_numpy(np.log(neighbour_distance(points))).float()[:, None].repeat(1, 3),
        logit_opacities=torch.full((count,), INITIAL_OPACITY).logit(),
        sh=sh,
        features=torch.zeros(count, feature_channels),
    )


def random_subset(count: int, most: int, seed: int) -> NDArray[np.int64]:
    """Which of ``count`` things to keep, in their order, where at most so many may be: all, or a random subset."""
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(seed).choice(count, most, replace=False))


def neighbour_distance(points: Points) -> NDArray[np.float64]:
    """Root mean square distance [m] of each of (P, 3) points to its three nearest others; (P,) float64.

    Fewer where there are fewer; 0.1 m where there is no other point; never below 0.3 mm.
    """
    if len(points) < 2:
        return np.full(len(points), _LONE_SCALE)
    neighbours = min(3, len(points) - 1)
    # The nearest is the point itself, or a duplicate of it: either way at distance zero.
    distances, _ = cKDTree(points).query(points, k=neighbours + 1)
    return np.sqrt(np.maximum((distances[:, 1:] ** 2).mean(axis=1), _LEAST_SQUARED_DISTANCE))


def seen(points: Points, camera: Camera, camera_to_world: Points, *, near_plane: float) -> NDArray[np.bool_]:
    """Which points some camera has in its image; what hides behind a surface counts as seen.

    Args:
        points: (P, 3) float64 in the world [m].
        camera: of all pictures.
        camera_to_world: (F, 4, 4) float64, registered frames only.
        near_plane: least camera z [m].

    Returns:
        (P,) bool; False where the point is not finite.
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
    """(P,) bool: which points (P, 3), in the camera's axes [m], it has in its picture, at ``near_plane`` or beyond."""
    return camera.contains(camera.project(local)) & (local[:, 2] >= near_plane)


def random_points(
    count: int, camera: Camera, camera_to_world: Points, *, near_plane: float, seed: int
) -> tuple[Points, NDArray[np.uint8]]:
    """Points and colours for a scene without points: uniform in the volumes that the cameras look into.

    A camera is drawn, then a point uniformly within its viewing pyramid between ``near_plane`` and three
    scene extents: all points can be seen, and there are more of them where more cameras look.

    Args:
        count: number of points.
        camera: of all pictures.
        camera_to_world: (F, 4, 4) float64, registered frames only, F >= 1.
        near_plane: least camera z [m].
        seed: of everything drawn.

    Returns:
        (count, 3) float64 in the world [m] and (count, 3) uint8, for ``from_points``.

    Raises:
        ValueError: see ``scene_extent``.
    """
    generator = np.random.default_rng(seed)
    far_plane = near_plane + _REACH * scene_extent(camera_to_world)
    which = generator.integers(len(camera_to_world), size=count)
    # The section of a pyramid grows with z², so that z³ is uniform.
    depth = np.cbrt(generator.uniform(near_plane**3, far_plane**3, size=count))
    u, v = generator.uniform(size=(2, count)) * np.array([[camera.width], [camera.height]])
    local = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(count)], axis=1)
    pose = camera_to_world[which]
    points = np.einsum("nij,nj->ni", pose[:, :3, :3], local * depth[:, None]) + pose[:, :3, 3]
    return points, generator.integers(256, size=(count, 3), dtype=np.uint8)
