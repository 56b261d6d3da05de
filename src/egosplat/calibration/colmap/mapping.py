"""COLMAP's three steps on the images of one camera; the third is incremental mapping, or triangulation with known poses.

Global mapping takes longer (a fox 11 CPU-seconds, not 6), and bends what hands carry before the camera: it puts floors of one
room at 74 degrees to each other, where incremental mapping leaves 8.
"""

import os
from collections.abc import Iterable, Sequence
from typing import Any

import pycolmap

from egosplat.arrays import Array, Bools, Bytes
from egosplat.calibration.colmap.database import MIN_IMAGES, Project
from egosplat.calibration.colmap.matching import SEED, match_images
from egosplat.calibration.colmap.movement import check_camera_moves
from egosplat.files import scratch_directory
from egosplat.geometry import invert
from egosplat.progress import track

# A model with fewer points is noise, not a scene.
MIN_POINTS = 50

# Points of a model that an image sees, to get and to keep a pose. Of 25 photographs of a kitchen, those that see 16 to 40 lie
# within 0.3 % of the extent of where twice the size puts them; COLMAP's own limit, 30, leaves four of them out.
MIN_SEEN = 15
# Their largest error, as a share of the longer side, and at least [px]. With COLMAP's 12 px, eight frames of 96 px had rotations wrong
# by 65 degrees (root mean square), and now by 3.
_MAX_POSE_ERROR, _LEAST_POSE_ERROR_PX = 0.012, 2.0


def reconstruct(
    prefix: str,
    images: Iterable[Bytes],
    valid: Bools,
    shown: Iterable[Bools] | None,
    camera: pycolmap.Camera,
    matching: str,
    threads: int | None = None,
    poses: Sequence[Array] = (),
) -> tuple[list[pycolmap.Reconstruction], dict[str, Any]]:
    """Find models of images, named by their numbers, in a temporary folder of a prefix.

    Args:
        images: (H, W, 3) uint8 RGB in order of time; read once.
        valid, shown: (H, W) bool pixels that show the scene in all images, and in each (None: as ``valid``).
        camera: of all images; its focal lengths and distortion are refined unless it ``has_prior_focal_length``.
        matching, threads: as of ``match_images``; None: all threads of this process.
        poses: (N, 4, 4) camera_to_world of all images; each makes one model, with these poses and triangulated points.

    Returns the models with enough points (images without common views end in different ones, or in none) and numbers for the notes.
    UserError: too few images or features (``TooFewError``), or, without poses, a camera that stands still. OSError: a full disk.
    """
    threads = threads or len(os.sched_getaffinity(0))
    with scratch_directory(prefix) as folder:
        project = Project(folder, camera)
        project.write_images(images)
        project.write_masks(valid, shown)
        if not poses:
            check_camera_moves(project)
        pycolmap.set_random_seed(SEED)
        project.import_images()
        project.extract(threads)
        notes = {"frames": len(project.names)} | match_images(project, matching, threads)
        project.check_free_space()
        return [_triangulate(project, each) for each in poses] if poses else _map(project), notes


def _triangulate(project: Project, camera_to_world: Array) -> pycolmap.Reconstruction:
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(project.camera)
    with pycolmap.Database.open(project.database) as database:
        images = sorted(database.read_all_images(), key=lambda image: image.name)
    for image, matrix in zip(images, invert(camera_to_world)[:, :3], strict=True):
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(matrix))
    # With more threads, the result depends on their order.
    options = pycolmap.IncrementalPipelineOptions(num_threads=1, random_seed=SEED)
    (written := project.folder / "points").mkdir(exist_ok=True)
    return pycolmap.triangulate_points(model, project.database, project.images, written, options=options)


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
    options.mapper.abs_pose_min_num_inliers = MIN_SEEN
    side = max(project.camera.width, project.camera.height)
    options.mapper.abs_pose_max_error = max(_LEAST_POSE_ERROR_PX, _MAX_POSE_ERROR * side)
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
    for model in models.values():
        drop_loose_images(model)
    return [
        model
        for model in models.values()
        if model.num_points3D() >= MIN_POINTS and model.num_reg_images() >= MIN_IMAGES
    ]


def drop_loose_images(model: pycolmap.Reconstruction) -> None:
    """Take the pose of images that see too few points of a model to hold it."""
    images = [model.images[number] for number in model.reg_image_ids()]
    for loose in [image.frame_id for image in images if image.num_points3D < MIN_SEEN]:
        model.deregister_frame(loose)
