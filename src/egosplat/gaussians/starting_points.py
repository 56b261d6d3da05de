"""Choose the points of a scene that training starts from."""

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.errors import UserError
from egosplat.gaussians.densify_init import Colours, densify
from egosplat.gaussians.initialization import (
    Points,
    from_points,
    random_points,
    random_subset,
    scene_extent,
    seen,
)
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.training_views import Views
from egosplat.progress import log

# Largest number of training views that are searched for empty cells, evenly spaced.
_DENSIFIED_VIEWS = 200

# Largest acceptable float32 step of positions, in scene extents: a quarter of a pixel at 2 m distance.
_COARSEST = 1e-3


def starting_gaussians(
    poses: Artifact,
    views: Views,
    *,
    max_points: int,
    densify_init: bool,
    sh_degree: int,
    near_plane: float,
    seed: int,
) -> Gaussians:
    """Initialize Gaussians at the points visible from training cameras, or at random points if there are none.

    Args:
        poses: poses artifact with the points.
        views: training views.
        max_points: size of the random subset of the points, or number of random points.
        densify_init: add points where a view shows none; see ``egosplat.gaussians.densify_init``.
        sh_degree: degree of the allocated SH coefficients.
        near_plane: smallest camera z of a visible point [m].
        seed: for all random draws.

    Returns:
        Gaussians on the views' device, without features, that do not require gradients.

    Raises:
        UserError: the scene is too far from the world's origin for float32.
    """
    cameras = views.camera_to_world
    _check_origin(poses, cameras)
    xyz, rgb = poses.read("points/xyz"), poses.read("points/rgb")
    visible = seen(xyz, views.camera, cameras, near_plane=near_plane)
    log(f"{visible.sum()} of {len(xyz)} points are visible in training views")
    xyz, rgb = xyz[visible], rgb[visible]
    if not len(xyz):
        log(f"no initial points: starting from {max_points} random points")
        xyz, rgb = random_points(max_points, views.camera, cameras, near_plane=near_plane, seed=seed)
    elif densify_init:
        xyz, rgb = _densify(*_subset(xyz, rgb, max_points, seed), views, max_points, near_plane, seed)
    start = from_points(xyz, rgb, sh_degree=sh_degree, feature_channels=0, max_points=max_points, seed=seed)
    return start.to(views.device)


def _densify(
    xyz: Points, rgb: Colours, views: Views, max_points: int, near_plane: float, seed: int
) -> tuple[Points, Colours]:
    """Add points where views show none, and thin the given points to at least half of ``max_points``."""
    chosen = np.unique(np.linspace(0, len(views) - 1, _DENSIFIED_VIEWS).round().astype(int))
    every, colours = densify(
        xyz,
        rgb,
        views.camera,
        views.camera_to_world[chosen],
        (views.pictures[view].numpy() for view in chosen),
        np.ones(views.pictures.shape[1:3], bool) if views.valid is None else views.valid.cpu().numpy() > 0,
        near_plane=near_plane,
    )
    given, added = len(xyz), len(every) - len(xyz)
    log(f"{added} points added where views show none")
    # New points get at most half of the budget.
    kept = _subset(xyz, rgb, max(max_points - added, max_points // 2), seed)
    new = _subset(every[given:], colours[given:], max_points - len(kept[0]), seed)
    return np.concatenate([kept[0], new[0]]), np.concatenate([kept[1], new[1]])


def _subset(xyz: Points, rgb: Colours, most: int, seed: int) -> tuple[Points, Colours]:
    chosen = random_subset(len(xyz), most, seed)
    return xyz[chosen], rgb[chosen]


def _check_origin(poses: Artifact, camera_to_world: NDArray[np.float64]) -> None:
    farthest = float(np.abs(camera_to_world[:, :3, 3]).max())
    step = float(np.spacing(np.float32(farthest)))
    if not step <= _COARSEST * scene_extent(camera_to_world):
        raise UserError(
            f"{poses.path}: cameras are {farthest:.3g} m from the world's origin, where float32 resolves positions to "
            f"{step:.2g} m only; move the origin into the scene"
        )
