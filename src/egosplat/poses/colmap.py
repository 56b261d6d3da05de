"""Estimate poses by structure from motion: COLMAP's incremental mapping through pycolmap, on the CPU. The
same images, options and seed give the same poses on one machine, with any number of threads: images get their
ids before features are extracted in parallel, RANSAC is seeded, and mapping runs on one thread."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from egosplat.calibration.colmap.choosing import choose_model, registered_images
from egosplat.calibration.colmap.mapping import reconstruct
from egosplat.geometry import Camera, invert, make_pose
from egosplat.poses.options import PosesOptions
from egosplat.poses.points import Views, colmap_camera, filter_points
from egosplat.poses.result import Poses, find_parallax, mean_camera_up


def colmap_poses(
    views: Views,
    camera: Camera,
    camera_known: bool,
    options: PosesOptions,
    *,
    threads: int | None = None,
    frame_keys: Mapping[str, Any] | None = None,
) -> Poses:
    """Estimate the poses of upright images of one camera, in order of time, in COLMAP's frame and scale.
    Arguments are as of ``mapping.reconstruct``; a known ``camera`` is kept, the focal lengths of a guess are
    refined. ``frame_keys``: of ``choose_model``. Frames outside of the largest model have no pose. Points
    are seen in ``MIN_TRACK_LENGTH`` images or more, with a mean error up to ``MAX_ERROR_PX``.
    UserError as for ``reconstruct``, without parallax, or with too few registered images."""
    entered = colmap_camera(camera, camera_known)
    models, notes = reconstruct("egosplat-colmap-", *views, entered, options.matching, threads)
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
