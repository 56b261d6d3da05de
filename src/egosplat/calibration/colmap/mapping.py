"""COLMAP's three steps on the images of one camera; the third is global mapping (GLOMAP, Pan et al. 2024)."""

import os
from collections.abc import Iterable
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray

from egosplat.calibration.colmap.database import MIN_IMAGES, Project
from egosplat.calibration.colmap.matching import match_images
from egosplat.calibration.colmap.movement import check_camera_moves
from egosplat.files import scratch_directory
from egosplat.progress import log

# A model with fewer points is noise, not a scene.
MIN_POINTS = 50

# An image that sees fewer of a model's points may lie anywhere.
MIN_SEEN = 30

# Of COLMAP's random choices. Trainings with several seeds have the same poses.
SEED = 0


def reconstruct(
    prefix: str,
    images: Iterable[NDArray[np.uint8]],
    valid: NDArray[np.bool_],
    shown: Iterable[NDArray[np.bool_]] | None,
    camera: pycolmap.Camera,
    matching: str,
    threads: int | None = None,
) -> tuple[list[pycolmap.Reconstruction], dict[str, Any]]:
    """Find models of images, named by their numbers, in a temporary folder of a prefix.

    Args:
        images: (H, W, 3) uint8 RGB in order of time; read once.
        valid, shown: (H, W) bool pixels that show the scene in all images, and in each (None: as ``valid``).
        camera: of all images; its focal lengths and distortion are refined unless it ``has_prior_focal_length``.
        matching, threads: as of ``match_images``; None: all threads of this process.

    Returns the models with enough points (images without common views end in different ones, or in none) and numbers for the notes.
    UserError if there are too few images or features, the camera stands still, or the disk is full.
    """
    threads = threads or len(os.sched_getaffinity(0))
    with scratch_directory(prefix) as folder:
        project = Project(folder, camera)
        project.write_images(images)
        project.write_masks(valid, shown)
        check_camera_moves(project)
        pycolmap.set_random_seed(SEED)
        project.import_images()
        features = project.extract(threads)
        notes = match_images(project, matching, SEED, threads)
        project.check_free_space()
        notes = {"frames": len(features), "features_median": float(np.median(features))} | notes
        return _map(project), notes


def _map(project: Project) -> list[pycolmap.Reconstruction]:
    guessed = not project.camera.has_prior_focal_length
    if guessed:
        # All rotations, then all places are solved at once: a focal length that is far off bends them.
        calibration = pycolmap.ViewGraphCalibrationOptions(random_seed=SEED)
        pycolmap.calibrate_view_graph(project.database, calibration)
    options = pycolmap.GlobalPipelineOptions(random_seed=SEED, min_model_size=MIN_IMAGES)
    # With more threads, the result depends on their order.
    options.num_threads = options.mapper.num_threads = 1
    options.mapper.random_seed = SEED
    adjustment = options.mapper.bundle_adjustment
    adjustment.refine_focal_length = adjustment.refine_extra_params = guessed
    (written := project.folder / "models").mkdir()
    log(f"COLMAP: mapping {len(project.names)} images, all at once")
    models = pycolmap.global_mapping(project.database, project.images, written, options)
    for model in models.values():
        drop_loose_images(model)
    return [model for model in models.values() if model.num_points3D() >= MIN_POINTS]


def drop_loose_images(model: pycolmap.Reconstruction) -> None:
    """Take the pose of images that see too few points of a model to hold it."""
    images = [model.images[number] for number in model.reg_image_ids()]
    for loose in [image.frame_id for image in images if image.num_points3D < MIN_SEEN]:
        model.deregister_frame(loose)
