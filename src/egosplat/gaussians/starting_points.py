"""The Gaussians that a scene's training starts from."""

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.errors import UserError
from egosplat.gaussians.densify_init import Colours, covered
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

_COVERED_VIEWS = 200
"""Of more training views so many are looked at, evenly."""

_COARSEST = 1e-3
"""Smallest difference of two float32 positions, as a share of the scene's extent: a quarter of a pixel 2 m away."""


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
    """Gaussians at the points that some training camera sees; at random ones where there are none.

    Args:
        poses: the poses artifact, which has the points.
        views: the training views.
        max_points: of more points a random subset is kept; and so many random ones are made.
        densify_init: add points where a view shows none; see ``egosplat.gaussians.densify_init``.
        sh_degree: degree that the colours get coefficients for.
        near_plane: least camera z at which a point is seen [m].
        seed: of everything random.

    Returns:
        On the views' device, without features, not requiring gradients.

    Raises:
        UserError: the scene lies so far from the world's origin that float32 cannot hold it.
    """
    cameras = views.camera_to_world
    _check_origin(poses, cameras)
    xyz, rgb = poses.read("points/xyz"), poses.read("points/rgb")
    visible = seen(xyz, views.camera, cameras, near_plane=near_plane)
    log(f"{visible.sum()} of {len(xyz)} points are seen from training views")
    xyz, rgb = xyz[visible], rgb[visible]
    if not len(xyz):
        log(f"no points to start from: {max_points} random ones are taken")
        xyz, rgb = random_points(max_points, views.camera, cameras, near_plane=near_plane, seed=seed)
    elif densify_init:
        xyz, rgb = _covered(*_some(xyz, rgb, max_points, seed), views, max_points, near_plane, seed)
    start = from_points(xyz, rgb, sh_degree=sh_degree, feature_channels=0, max_points=max_points, seed=seed)
    return start.to(views.device)


def _covered(
    xyz: Points, rgb: Colours, views: Views, max_points: int, near_plane: float, seed: int
) -> tuple[Points, Colours]:
    """The points, thinned to half of ``max_points`` at least, and as many new ones as there is room for."""
    chosen = np.unique(np.linspace(0, len(views) - 1, _COVERED_VIEWS).round().astype(int))
    every, colours = covered(
        xyz,
        rgb,
        views.camera,
        views.camera_to_world[chosen],
        (views.pictures[view].numpy() for view in chosen),
        np.ones(views.pictures.shape[1:3], bool) if views.valid is None else views.valid.cpu().numpy() > 0,
        near_plane=near_plane,
    )
    given, added = len(xyz), len(every) - len(xyz)
    log(f"{added} points are added where views show none")
    kept = _some(xyz, rgb, max(max_points - added, max_points // 2), seed)
    new = _some(every[given:], colours[given:], max_points - len(kept[0]), seed)
    return np.concatenate([kept[0], new[0]]), np.concatenate([kept[1], new[1]])


def _some(xyz: Points, rgb: Colours, most: int, seed: int) -> tuple[Points, Colours]:
    chosen = random_subset(len(xyz), most, seed)
    return xyz[chosen], rgb[chosen]


def _check_origin(poses: Artifact, camera_to_world: NDArray[np.float64]) -> None:
    farthest = float(np.abs(camera_to_world[:, :3, 3]).max())
    step = float(np.spacing(np.float32(farthest)))
    if not step <= _COARSEST * scene_extent(camera_to_world):
        raise UserError(
            f"{poses.path}: cameras stand {farthest:.3g} m from the world's origin, where float32 holds places to "
            f"{step:.2g} m only; move the origin into the scene"
        )
