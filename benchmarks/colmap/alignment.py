"""Distance of an estimated trajectory from a true one with another frame and scale."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from egosplat.geometry import invert, is_rigid, make_pose, rotation_angle

# Of the camera positions across their main direction, relative to the spread along it.
_LEAST_SPREAD = 1e-6


def similarity(
    source: NDArray[np.float64], target: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Least-squares similarity (Umeyama 1991) with ``target = scale * rotation @ source + translation``.

    Args:
        source: (N, 3) float64, N >= 3.
        target: (N, 3) float64.

    Returns:
        scale, (3, 3) rotation, (3,) translation.

    Raises:
        ValueError: fewer than three points, or points (nearly) on one line, which leave a rotation free.
    """
    if source.shape != target.shape or source.ndim != 2 or source.shape[1] != 3 or len(source) < 3:
        raise ValueError(f"three or more pairs of points are needed, not {source.shape} and {target.shape}")
    for points in (source, target):
        if np.linalg.matrix_rank(points - points.mean(axis=0), rtol=_LEAST_SPREAD) < 2:
            raise ValueError("the points lie on one line: their alignment is not determined")
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    centered, wanted = source - source_mean, target - target_mean
    # pycolmap.estimate_sim3d (4.2) finds nothing for cameras in one plane, which is no degenerate case.
    rotation = Rotation.align_vectors(wanted, centered)[0].as_matrix()
    scale = float(np.sum(wanted * (centered @ rotation.T)) / np.sum(centered**2))
    return scale, rotation, target_mean - scale * rotation @ source_mean


def align(estimated: NDArray[np.float64], true: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Move estimated poses into the frame and scale of the true ones, by the positions of the cameras.

    Args:
        estimated: (N, 4, 4) float64 ``camera_to_world``, registered frames only.
        true: (N, 4, 4) float64, the same frames.

    Returns:
        (N, 4, 4) float64 rigid poses, and the scale that was applied to the estimated positions.

    Raises:
        ValueError: a pose is not a rigid motion, or see ``similarity``.
    """
    if not (is_rigid(estimated).all() and is_rigid(true).all()):
        raise ValueError("a pose is not a rigid motion: leave out the frames that are not registered")
    scale, rotation, translation = similarity(estimated[:, :3, 3], true[:, :3, 3])
    positions = scale * estimated[:, :3, 3] @ rotation.T + translation
    return make_pose(rotation @ estimated[:, :3, :3], positions), scale


def trajectory_error(estimated: NDArray[np.float64], true: NDArray[np.float64]) -> dict[str, float]:
    """Absolute trajectory error after similarity alignment (Sturm et al. 2012, Sim(3) as for monocular SLAM).

    Args:
        estimated: (N, 4, 4) float64 ``camera_to_world``, registered frames only.
        true: (N, 4, 4) float64, the same frames.

    Returns:
        ``ate_rmse_m``: root mean square distance of the positions, in the true trajectory's unit;
        ``rotation_rmse_deg``: root mean square angle between the rotations;
        ``scale``: what the estimated positions are multiplied by.

    Raises:
        ValueError: see ``align``.
    """
    aligned, scale = align(estimated, true)
    distance = np.linalg.norm(aligned[:, :3, 3] - true[:, :3, 3], axis=1)
    angle = rotation_angle(invert(true) @ aligned)
    return {
        "ate_rmse_m": float(np.sqrt(np.mean(distance**2))),
        "rotation_rmse_deg": float(np.degrees(np.sqrt(np.mean(angle**2)))),
        "scale": scale,
    }
