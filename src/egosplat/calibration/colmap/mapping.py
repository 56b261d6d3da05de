"""COLMAP's three steps on the images of one camera; the third is incremental mapping."""

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
from egosplat.progress import track

# Frames that each frame is matched with if matching is sequential. Frames 1, 2, 4, 8, ... later and similar-looking
# frames (loops) are matched, too.
OVERLAP = 12

# A model with fewer points is noise, not a scene.
MIN_POINTS = 50

# Of COLMAP's random choices. Trainings with several seeds have the same poses.
SEED = 0


def reconstruct(
    prefix: str,
    images: Iterable[NDArray[np.uint8]],
    valid: NDArray[np.bool_],
    shown: Iterable[NDArray[np.bool_]] | None,
    camera: pycolmap.Camera,
    matching: str,
    overlap: int = OVERLAP,
    threads: int | None = None,
) -> tuple[list[pycolmap.Reconstruction], dict[str, Any]]:
    """Find models of images, named by their numbers, in a temporary folder of a prefix.

    Args:
        images: (H, W, 3) uint8 RGB in order of time; read once.
        valid, shown: (H, W) bool pixels that show the scene in all images, and in each (None: as ``valid``).
        camera: of all images; its focal lengths and distortion are refined unless it ``has_prior_focal_length``.
        matching, overlap, threads: as of ``match_images``; None: all threads of this process.

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
        notes = match_images(project, matching, overlap, SEED, threads)
        project.check_free_space()
        notes = {"frames": len(features), "features_median": float(np.median(features))} | notes
        return _map(project), notes


def _map(project: Project) -> list[pycolmap.Reconstruction]:
    guessed = not project.camera.has_prior_focal_length
    options = pycolmap.IncrementalPipelineOptions(
        # With more threads, the result depends on their order.
        num_threads=1,
        random_seed=SEED,
        min_model_size=MIN_IMAGES,
        ba_refine_focal_length=guessed,
        # A principal point is hardly observable.
        ba_refine_principal_point=False,
        ba_refine_extra_params=guessed,
    )
    options.mapper.abs_pose_refine_focal_length = guessed
    progress = track(project.names, "COLMAP: mapping", unit="image")

    def advance() -> None:
        next(progress, None)

    # The first pair is one call, and the end of the last image another.
    advance()
    (written := project.folder / "models").mkdir()
    models = pycolmap.incremental_mapping(
        project.database,
        project.images,
        written,
        options,
        initial_image_pair_callback=advance,
        next_image_callback=advance,
    )
    advance()
    return [model for model in models.values() if model.num_points3D() >= MIN_POINTS]
