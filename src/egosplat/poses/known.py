"""Poses of a plain recording that are known already, from a COLMAP model or a ``transforms.json``."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.files import known_poses_path
from egosplat.calibration.known_poses import match_pictures, read_known_poses
from egosplat.calibration.lens import Lens
from egosplat.errors import UserError
from egosplat.geometry import Camera, compose, make_pose, rotate, transform
from egosplat.poses.options import PosesOptions
from egosplat.poses.result import (
    MAX_REPROJECTION_ERROR_PX,
    MIN_TRACK_LENGTH,
    Poses,
    find_parallax,
    mean_camera_up,
)
from egosplat.progress import format_ranges, log

# The up axis of a camera with OpenCV axes.
_UP = np.array([0.0, -1.0, 0.0])


def known_poses(
    recording: Path,
    kind: str,
    lenses: list[Lens],
    pinhole: Camera,
    pictures: Sequence[str],
    camera: Camera,
    options: PosesOptions,
) -> Poses:
    """Take the poses of a recording's frames from its file, as they are, and in meters if their scale is given.

    ``kind`` is a key of ``KNOWN_POSES``; the full-size pictures were rectified from ``lenses`` to ``pinhole``; ``pictures`` are the
    names of the frames' pictures, and ``camera`` that of the frames. Points as for ``colmap_poses``; all of a file without views.
    UserError if the file is damaged or has changed since the frames were read, or too few frames have a pose.
    """
    path = known_poses_path(recording, kind)
    known = read_known_poses(recording, kind, lenses[0].width, lenses[0].height)
    if known.lenses != lenses:
        raise UserError(f"{path}: has changed since the frames were read. Rebuild frames.zarr.")
    row, _ = match_pictures(known.names, pictures, path)
    registered = row >= 0
    _check_share(registered, path, options.min_registered)
    scale = options.meters_per_unit or 1.0
    camera_to_world = np.full((len(row), 4, 4), np.nan)
    camera_to_world[registered] = known.camera_to_world[row[registered]]
    camera_to_world[registered, :3, 3] *= scale
    finite = np.isfinite(known.points).all(axis=1)
    if not finite.all():
        log(f"{path}: leaves out {(~finite).sum()} of {len(known.points)} points, which are not finite")
    # Errors in pixels of the frames. A file without views says nothing about its points' depths.
    near = known.point_error_px * (camera.width / pinhole.width) <= MAX_REPROJECTION_ERROR_PX
    kept = finite & near & ((known.point_views >= MIN_TRACK_LENGTH) | ~known.point_views.any())
    points, up = known.points[kept] * scale, mean_camera_up(camera_to_world[registered])
    notes = {
        "source": "known",
        "file": str(path.relative_to(recording.parent)),
        "frames": len(row),
        "registered": int(registered.sum()),
        "points": int(kept.sum()),
        "points_read": len(known.points),
        "scale": "arbitrary" if options.meters_per_unit is None else "meters",
        "parallax_deg": find_parallax(camera_to_world[registered, :3, 3], points),
        **known.notes,
    }
    arbitrary = "a scene unit (poses.meters_per_unit makes it meters)"
    unit = f"{scale:g} m" if options.meters_per_unit else arbitrary
    log(f"poses as in {path}; one unit of the file is {unit}")
    if kind == "colmap" and (gsplat := gsplat_world(known.camera_to_world, known.points[finite])) is not None:
        notes["gsplat_world"] = gsplat.tolist()
    return Poses(camera_to_world, camera, points, known.point_rgb[kept], up, notes)


def _check_share(registered: NDArray[np.bool_], path: Path, wanted: float) -> None:
    """Log the frames without a pose, or raise UserError if they are too many."""
    without = format_ranges(set(np.flatnonzero(~registered).tolist()))
    if registered.sum() < wanted * len(registered):
        raise UserError(
            f"{path}: has poses of {registered.sum()} of {len(registered)} frames, and poses.min_registered requires "
            f"{wanted:.0%}; without a pose (indices from 0): {without}\n"
            "Add them, leave these frames out, or accept the loss by poses.min_registered"
        )
    if without:
        log(f"{path}: has no pose of the frames {without} (indices from 0); they are not used")


def gsplat_world(
    camera_to_world: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """The (4, 4) similarity from the world of a COLMAP model to that in which gsplat's example trainer trains, or None.

    The .ply file of gsplat does not tell of it. It is determined up to the signs of two axes, which depend on gsplat's version and
    its linear algebra.

    Args:
        camera_to_world: (F, 4, 4), all images of the model.
        points: (P, 3), all finite points of the model.
    """
    by_cameras = _of_cameras(camera_to_world)
    if len(points) < 3 or not np.isfinite(by_cameras).all():
        return None
    points = transform(by_cameras, points)
    # The median goes to the origin, and the principal axes to x, y, z.
    center = np.median(points, axis=0)
    values, axes = np.linalg.eigh(np.cov(points - center, rowvar=False))
    axes = axes[:, values.argsort()[::-1]]
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    return compose(make_pose(axes.T, -rotate(axes.T, center)), by_cameras)


def _of_cameras(camera_to_world: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bring the mean up axis to -y, the median of the points looked at to the origin, the median distance to 1."""
    up = -camera_to_world[:, :3, 1].mean(axis=0)
    # Cameras without a common up axis, upside down or at one place give no number.
    with np.errstate(divide="ignore", invalid="ignore"):
        up /= np.linalg.norm(up)
        x, y, z = np.cross(up, _UP)
        skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turn = np.eye(3) + skew + skew @ skew / (1 + up @ _UP)
        centers = rotate(turn, camera_to_world[:, :3, 3])
        ahead = rotate(turn, camera_to_world[:, :3, 2])
        # The point of each camera's axis that is nearest to the origin.
        nearest = centers - (ahead * centers).sum(axis=1, keepdims=True) * ahead
        shift = -np.median(nearest, axis=0)
        scale = 1.0 / np.median(np.linalg.norm(centers + shift, axis=1))
        return make_pose(scale * turn, scale * shift)
