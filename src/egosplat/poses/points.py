"""Points of poses: those that COLMAP finds with them, or that are triangulated where poses are given without any."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pycolmap

from egosplat.arrays import Array, Bools, Bytes
from egosplat.calibration.colmap.database import TooFewError
from egosplat.calibration.colmap.mapping import MIN_POINTS, reconstruct
from egosplat.calibration.lens import Lens
from egosplat.errors import UserError
from egosplat.geometry import OPENGL_AXES, Camera, invert
from egosplat.poses.options import PosesOptions
from egosplat.poses.result import MAX_ERROR_PX, MIN_TRACK_LENGTH, Poses, find_parallax
from egosplat.progress import log

# What makes poses of matrices that are meant otherwise, and how many times the points have to come of it.
_INVERT = "invert each pose"
_TURN = "multiply the second and third column of each matrix from camera to world by -1"
_BOTH = f"{_INVERT}, and {_TURN}"
_TIMES = 4

# Images, and the pixels that show the scene in all and in each, as of ``mapping.reconstruct``.
Views = tuple[Iterable[Bytes], Bools, Iterable[Bools] | None]


def colmap_camera(camera: Camera, known: bool) -> pycolmap.Camera:
    """A camera as COLMAP has it, which keeps it if it is known."""
    params = camera.fx, camera.fy, camera.cx, camera.cy
    entered = Lens("PINHOLE", camera.width, camera.height, params).colmap()
    entered.has_prior_focal_length = known
    return entered


def add_points(poses: Poses, views: Views, options: PosesOptions, *, opengl: bool) -> Poses:
    """Triangulate points with poses that have none; these stay as they are. Frames with too few features give no points.

    ``views``: of the frames with a pose. ``opengl``: whether the file of the poses has OpenGL's camera axes. UserError, with a remedy, if
    far more points come of its matrices read another way.
    """
    given, own = poses.camera_to_world[poses.registered], OPENGL_AXES if opengl else np.ones(4)
    inverse = invert(given * own)
    meant = {_TURN: given * own * OPENGL_AXES, _INVERT: inverse, _BOTH: inverse * OPENGL_AXES}
    readings = [given, *(each * own for each in meant.values())]
    about = *views, colmap_camera(poses.camera, True), options.matching
    try:
        (model, *others), _ = reconstruct("egosplat-points-", *about, poses=readings)
    except TooFewError as error:
        log(f"no points: {error}")
        return poses
    points, colors = filter_points(model)
    for remedy, other in zip(meant, others, strict=True):
        if (count := len(filter_points(other)[0])) > max(MIN_POINTS, _TIMES * len(points)):
            raise UserError(
                f"{poses.notes.get('file', 'the poses')}: {len(points)} points fit the poses and the frames, and {count} if the "
                f"poses are read another way\nCorrect the file: {remedy}. Or set frames.known_poses=none: COLMAP estimates them"
            )
    error_px, parallax_deg = model.compute_mean_reprojection_error(), find_parallax(given[:, :3, 3], points)
    notes = poses.notes | {"reprojection_error_px": error_px, "parallax_deg": parallax_deg}
    return replace(poses, points=points, point_rgb=colors, notes=notes)


def filter_points(model: pycolmap.Reconstruction) -> tuple[Array, Bytes]:
    """(P, 3) float64 points of long enough tracks and small enough errors, and (P, 3) uint8 RGB."""
    kept = [
        point
        for _, point in sorted(model.points3D.items())
        if point.track.length() >= MIN_TRACK_LENGTH and point.error <= MAX_ERROR_PX
    ]
    positions = np.array([point.xyz for point in kept], dtype=np.float64).reshape(-1, 3)
    return positions, np.array([point.color for point in kept], dtype=np.uint8).reshape(-1, 3)
