"""The Gaussians that a scene's training starts from."""

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts.reading import Artifact
from egosplat.errors import UserError
from egosplat.geometry import Camera
from egosplat.progress import log
from egosplat.splats.gaussians import Gaussians
from egosplat.splats.initialise import from_points, random_points, scene_extent, seen

_COARSEST = 1e-3
"""Smallest difference of two float32 positions, as a share of the scene's extent: a quarter of a pixel 2 m away."""


def starting_gaussians(
    poses: Artifact,
    camera: Camera,
    camera_to_world: NDArray[np.float64],
    *,
    max_points: int,
    sh_degree: int,
    near_plane: float,
    seed: int,
    device: torch.device,
) -> Gaussians:
    """Gaussians at the points that some training camera sees; at random ones where there are none.

    Args:
        poses: the poses artifact, which has the points.
        camera: of all pictures.
        camera_to_world: (V, 4, 4) float64 poses of the training views.
        max_points: of more points a random subset is kept; and so many random ones are made.
        sh_degree: degree that the colours get coefficients for.
        near_plane: least camera z at which a point is seen [m].
        seed: of everything random.
        device: where they are to be trained.

    Returns:
        Without features, not requiring gradients.

    Raises:
        UserError: the scene lies so far from the world's origin that float32 cannot hold it.
    """
    _check_origin(poses, camera_to_world)
    xyz, rgb = poses.read("points/xyz"), poses.read("points/rgb")
    visible = seen(xyz, camera, camera_to_world, near_plane=near_plane)
    log(f"{visible.sum()} of {len(xyz)} points are seen from training views")
    xyz, rgb = xyz[visible], rgb[visible]
    if not len(xyz):
        log(f"no points to start from: {max_points} random ones are taken")
        xyz, rgb = random_points(max_points, camera, camera_to_world, near_plane=near_plane, seed=seed)
    start = from_points(xyz, rgb, sh_degree=sh_degree, feature_channels=0, max_points=max_points, seed=seed)
    return start.to(device)


def _check_origin(poses: Artifact, camera_to_world: NDArray[np.float64]) -> None:
    farthest = float(np.abs(camera_to_world[:, :3, 3]).max())
    step = float(np.spacing(np.float32(farthest)))
    if not step <= _COARSEST * scene_extent(camera_to_world):
        raise UserError(
            f"{poses.path}: cameras stand {farthest:.3g} m from the world's origin, where float32 holds places to "
            f"{step:.2g} m only; move the origin into the scene"
        )
