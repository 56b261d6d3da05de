"""Estimate poses by structure from motion: COLMAP's incremental mapping through pycolmap, on the CPU. The
same images, options and seed give the same poses on one machine, with any number of threads: images get their
ids before features are extracted in parallel, RANSAC is seeded, and mapping runs on one thread. With more
threads, bundle adjustment sums in no fixed order, and is not faster on two cores (50 images, 150,000
observations: 19 s against 18 s)."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray

from egosplat.calibration.colmap.choosing import choose_model, registered_images
from egosplat.calibration.colmap.mapping import reconstruct
from egosplat.geometry import Camera, invert, make_pose
from egosplat.poses.options import PosesOptions
from egosplat.poses.result import (
    MAX_REPROJECTION_ERROR_PX,
    MIN_TRACK_LENGTH,
    Poses,
    find_parallax,
    mean_camera_up,
)


def colmap_poses(
    images: Iterable[NDArray[np.uint8]],
    valid: NDArray[np.bool_],
    camera: Camera,
    camera_known: bool,
    options: PosesOptions,
    *,
    threads: int | None = None,
    shown: Iterable[NDArray[np.bool_]] | None = None,
    frame_keys: Mapping[str, Any] | None = None,
) -> Poses:
    """Estimate the poses of upright images of one camera, in order of time, in COLMAP's frame and scale.
    Arguments are as of ``mapping.reconstruct``; a known ``camera`` is kept, the focal lengths of a guess are
    refined. ``frame_keys``: of ``choose_model``. Frames outside of the largest model have no pose. Points
    are seen in ``MIN_TRACK_LENGTH`` images or more, with a mean error up to ``MAX_REPROJECTION_ERROR_PX``.
    UserError as for ``reconstruct``, without parallax, or with too few registered images."""
    params = [camera.fx, camera.fy, camera.cx, camera.cy]
    entered = pycolmap.Camera(model="PINHOLE", width=camera.width, height=camera.height, params=params)
    entered.has_prior_focal_length = camera_known
    models, notes = reconstruct("egosplat-colmap-", images, valid, shown, entered, options.matching, threads)
    model = choose_model(models, notes, options.min_registered, frame_keys or {})
    camera_to_world = np.full((notes["frames"], 4, 4), np.nan)
    for frame, image in registered_images(model):
        matrix = image.cam_from_world().matrix()
        camera_to_world[frame] = invert(make_pose(matrix[:, :3], matrix[:, 3]))
    points, colors = filter_points(model)
    registered = camera_to_world[np.isfinite(camera_to_world).all(axis=(1, 2))]
    notes |= {
        "reprojection_error_px": model.compute_mean_reprojection_error(),
        "parallax_deg": find_parallax(registered[:, :3, 3], points),
        "scale": "arbitrary",
    }
    (refined,) = model.cameras.values()
    pinhole = Camera(refined.width, refined.height, *map(float, refined.params))
    return Poses(camera_to_world, pinhole, points, colors, mean_camera_up(registered), notes)


def filter_points(model: pycolmap.Reconstruction) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """(P, 3) float64 points of long enough tracks and small enough errors, and (P, 3) uint8 RGB."""
    kept = [
        point
        for _, point in sorted(model.points3D.items())
        if point.track.length() >= MIN_TRACK_LENGTH and point.error <= MAX_REPROJECTION_ERROR_PX
    ]
    positions = np.array([point.xyz for point in kept], dtype=np.float64).reshape(-1, 3)
    return positions, np.array([point.color for point in kept], dtype=np.uint8).reshape(-1, 3)
