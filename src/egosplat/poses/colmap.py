"""Estimate poses by structure from motion: COLMAP's incremental mapping through pycolmap, on the CPU.

The world has COLMAP's frame: cameras around the origin spanning about ten arbitrary units, in no particular orientation.

The same images, options and seed give the same poses on one machine, with any number of threads: images get their ids
before features are extracted in parallel, RANSAC is seeded, and mapping runs on one thread. With more threads, bundle
adjustment sums in no fixed order, and is not faster on two cores (50 images, 150,000 observations: 19 s against 18 s).
"""

import os
from collections.abc import Iterable
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray

from egosplat.calibration.colmap.database import Project, check_features, open_project
from egosplat.calibration.colmap.mapping import build_models, choose_model
from egosplat.calibration.colmap.matching import match_images
from egosplat.geometry import Camera, invert, make_pose
from egosplat.poses.options import PosesOptions
from egosplat.poses.result import (
    MAX_REPROJECTION_ERROR_PX,
    MIN_TRACK_LENGTH,
    Poses,
    find_parallax,
    mean_camera_up,
    unregistered,
)

# Frames that each frame is matched with if matching is sequential. Frames 1, 2, 4, 8, ... later and similar-looking
# frames (loops) are matched, too.
OVERLAP = 12

# Of COLMAP's random choices. Trainings with several seeds have the same poses.
SEED = 0


def colmap_poses(
    images: Iterable[NDArray[np.uint8]],
    valid: NDArray[np.bool_],
    camera: Camera,
    camera_known: bool,
    options: PosesOptions,
    *,
    overlap: int = OVERLAP,
    threads: int | None = None,
    shown: Iterable[NDArray[np.bool_]] | None = None,
) -> Poses:
    """Estimate the poses of upright images of one camera, in order of time.

    Args:
        images: F images, (H, W, 3) uint8 RGB; read once.
        valid: (H, W) bool: pixels that show the scene; features are extracted there only.
        camera_known: True: ``camera`` is a calibration and kept. False: it is a guess, and its focal lengths are
            refined.
        overlap, threads: see ``matching.match_images``; None: all threads of this process.
        shown: (H, W) bool of each image, if some show the scene in fewer pixels than ``valid``; read once.

    Returns:
        Poses of the largest model in COLMAP's frame and scale, with the models that share frames with it; other frames are not registered. Points are seen in
        ``MIN_TRACK_LENGTH`` images or more, with a mean reprojection error up to ``MAX_REPROJECTION_ERROR_PX``.

    Raises:
        UserError: there are too few images, features, matches or registered images, no parallax, or no disk space, or
            the camera stands still.
    """
    threads = threads or len(os.sched_getaffinity(0))
    with open_project("egosplat-colmap-", images, camera, valid, shown) as project:
        pycolmap.set_random_seed(SEED)
        project.import_images(camera, camera_known)
        features = project.extract(camera, threads)
        check_features(features)
        matches = match_images(project, options.matching, overlap, SEED, threads)
        models = build_models(project, camera_known, SEED)
        chosen = choose_model(models, matches, project, camera_known, options.min_registered)
        notes = {
            "frames": len(project.names),
            "features_median": float(np.median(features)),
            "matching": matches.strategy,
            "pairs_compared": matches.compared,
            "pairs_verified": matches.verified,
            "pairs_with_parallax": matches.with_parallax,
            "models": [model.num_reg_images() for model in (chosen.model, *chosen.others)],
            "models_joined": chosen.parts,
        }
        return _poses(project, chosen.model, camera_known, notes)


def _poses(
    project: Project, model: pycolmap.Reconstruction, camera_known: bool, notes: dict[str, Any]
) -> Poses:
    frames = len(project.names)
    camera_to_world, registered = unregistered(frames), np.zeros(frames, dtype=np.bool_)
    for image_id in model.reg_image_ids():
        image = model.images[image_id]
        matrix = image.cam_from_world().matrix()
        frame = project.frame_of(image.name)
        camera_to_world[frame] = invert(make_pose(matrix[:, :3], matrix[:, 3]))
        registered[frame] = True
    points, colors, point_notes = filter_points(model)
    notes = {
        **notes,
        "registered": int(registered.sum()),
        "reprojection_error_px": model.compute_mean_reprojection_error(),
        "track_length": model.compute_mean_track_length(),
        "parallax_deg": find_parallax(camera_to_world[registered, :3, 3], points),
        "camera_refined": not camera_known,
        "scale": "arbitrary",
        **point_notes,
    }
    up = mean_camera_up(camera_to_world[registered])
    (pinhole,) = model.cameras.values()
    camera = Camera(pinhole.width, pinhole.height, *map(float, pinhole.params))
    return Poses(camera_to_world, registered, camera, points, colors, up, notes).check()


def filter_points(
    model: pycolmap.Reconstruction,
) -> tuple[NDArray[np.float64], NDArray[np.uint8], dict[str, Any]]:
    """(P, 3) float64 points of long enough tracks and small enough errors, (P, 3) uint8 RGB, and numbers for the notes."""
    every = [point for _, point in sorted(model.points3D.items())]
    track_length = np.array([point.track.length() for point in every])
    error = np.array([point.error for point in every])
    short, far = track_length < MIN_TRACK_LENGTH, ~(error <= MAX_REPROJECTION_ERROR_PX)
    kept = [point for point, bad in zip(every, short | far, strict=True) if not bad]
    notes = {
        "points": len(kept),
        "points_read": len(every),
        "points_rejected": {"track_length": int(short.sum()), "reprojection_error": int(far.sum())},
    }
    positions = np.array([point.xyz for point in kept], dtype=np.float64).reshape(-1, 3)
    return positions, np.array([point.color for point in kept], dtype=np.uint8).reshape(-1, 3), notes
