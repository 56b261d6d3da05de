"""Poses by structure from motion: COLMAP's incremental mapping through pycolmap, on the CPU, offline.

The world keeps the frame in which COLMAP leaves it: the cameras lie around the origin and span about ten
units, which are not metres, in no particular orientation (``Poses.up`` tells where up is).

Same pictures, options and seed give the same poses on one machine, whatever the number of threads: the
pictures get their ids before features are extracted in parallel, RANSAC is seeded, and mapping runs on one
thread, because on several its bundle adjustment adds up in no fixed order and its choices depend on their
number. On two cores the single thread costs no time (50 pictures, 150,000 observations: 18 s against 19 s).
"""

import contextlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.files import scratch_directory
from egosplat.geometry import Camera, invert, make_pose
from egosplat.poses.colmap.database import Project, check_features
from egosplat.poses.colmap.mapping import FEWEST_PICTURES, build_models, largest_model
from egosplat.poses.colmap.matching import Matching, match
from egosplat.poses.result import Poses, mean_camera_up, unregistered

SHORTEST_TRACK = 3
"""Two views alone leave a point's depth unchecked."""
LARGEST_ERROR_PX = 2.0

_FATAL_ONLY = 3


def colmap_poses(
    pictures: Iterable[NDArray[np.uint8]],
    valid: NDArray[np.bool_],
    camera: Camera,
    camera_known: bool,
    *,
    matching: Matching,
    overlap: int,
    min_registered: float,
    seed: int,
    threads: int | None = None,
    workdir: Path | None = None,
) -> Poses:
    """Poses of upright pictures of one camera, in order of time.

    Args:
        pictures: F pictures, (H, W, 3) uint8 RGB; read once.
        valid: (H, W) bool: pixels that show the scene; features are found there only.
        camera: of all pictures, without distortion.
        camera_known: whether ``camera`` is a calibration, which is kept, or a guess, whose focal lengths are
            refined.
        matching: which pictures are compared; see ``colmap_matching.match``.
        overlap: for sequential matching: with how many next pictures.
        min_registered: share of the pictures, 0 to 1, that must be registered.
        seed: of everything random in COLMAP.
        threads: for features and matches; None: as many as this process may use. No result depends on it.
        workdir: folder in which the temporary folder is made, a few MB a picture; None: the system's.

    Returns:
        Poses in COLMAP's own frame and scale, of the largest model; frames outside of it are not registered.
        Points are those seen in ``SHORTEST_TRACK`` pictures or more, with a mean reprojection error
        up to ``LARGEST_ERROR_PX``.

    Raises:
        UserError: too few pictures, features or matches, no parallax, too small a model, or too full a disk.
    """
    threads = threads or len(os.sched_getaffinity(0))
    with scratch_directory("egosplat-colmap-", workdir) as folder, _quiet_colmap():
        project = Project(folder)
        project.write_pictures(pictures, camera)
        frames = len(project.names)
        if frames < FEWEST_PICTURES:
            raise UserError(
                f"COLMAP needs {FEWEST_PICTURES} pictures or more, not {frames}: take more frames"
            )
        pycolmap.set_random_seed(seed)
        project.write_mask(valid)
        project.import_pictures(camera, camera_known)
        features = project.extract(camera, threads)
        check_features(features)
        matched = match(project, matching, overlap, seed, threads)
        models = build_models(project, camera_known, seed)
        model = largest_model(models, matched, project, min_registered)
        notes = {
            "frames": frames,
            "features_median": float(np.median(features)),
            "matching": matched.strategy,
            "pairs_compared": matched.compared,
            "pairs_verified": matched.verified,
            "pairs_with_parallax": matched.with_parallax,
            "models": sorted((found.num_reg_images() for found in models), reverse=True),
        }
        return _poses(project, model, camera_known, notes)


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
    points, colours, point_notes = kept_points(model)
    notes = {
        **notes,
        "registered": int(registered.sum()),
        "reprojection_error_px": model.compute_mean_reprojection_error(),
        "track_length": model.compute_mean_track_length(),
        "camera_refined": not camera_known,
        "scale": "arbitrary",
        **point_notes,
    }
    up = mean_camera_up(camera_to_world[registered])
    return Poses(camera_to_world, registered, _camera(model), points, colours, up, notes).check()


def kept_points(
    model: pycolmap.Reconstruction,
) -> tuple[NDArray[np.float64], NDArray[np.uint8], dict[str, Any]]:
    """The points of a model that enough pictures see, and see well enough.

    Returns:
        (P, 3) float64 positions, (P, 3) uint8 RGB, and how many were left out and why, for the notes.
    """
    every = [point for _, point in sorted(model.points3D.items())]
    track_length = np.array([point.track.length() for point in every])
    error = np.array([point.error for point in every])
    short, far = track_length < SHORTEST_TRACK, ~(error <= LARGEST_ERROR_PX)
    kept = [point for point, bad in zip(every, short | far, strict=True) if not bad]
    notes = {
        "points": len(kept),
        "points_read": len(every),
        "points_rejected": {"track_length": int(short.sum()), "reprojection_error": int(far.sum())},
    }
    positions = np.array([point.xyz for point in kept], dtype=np.float64).reshape(-1, 3)
    return positions, np.array([point.color for point in kept], dtype=np.uint8).reshape(-1, 3), notes


def _camera(model: pycolmap.Reconstruction) -> Camera:
    (camera,) = model.cameras.values()
    return Camera(camera.width, camera.height, *(float(value) for value in camera.params))


@contextlib.contextmanager
def _quiet_colmap() -> Iterator[None]:
    """Silence COLMAP's log, a line for every picture and pair; what matters becomes a UserError."""
    before = pycolmap.logging.minloglevel
    pycolmap.logging.minloglevel = _FATAL_ONLY
    try:
        yield
    finally:
        pycolmap.logging.minloglevel = before
