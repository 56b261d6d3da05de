"""COLMAP's third step: incremental mapping, and which of its models is the scene."""

import time

import pycolmap

from egosplat.errors import UserError
from egosplat.poses.colmap_database import Project
from egosplat.poses.colmap_matching import Matched
from egosplat.progress import log

FEWEST_PICTURES = 3
FEWEST_POINTS = 50
"""A model with fewer points is an accident of noise, not a scene."""

_UNMOVED_PX = 1.0
_SECONDS_BETWEEN_LINES = 5.0


def build_models(project: Project, camera_known: bool, seed: int) -> list[pycolmap.Reconstruction]:
    """Map incrementally, with bundle adjustment.

    Args:
        project: with verified matches.
        camera_known: whether the focal lengths are kept.
        seed: of RANSAC and of the choice of pictures.

    Returns:
        Every model that holds a scene; pictures that share nothing end in different ones, or in none.
    """
    project.check_room()
    options = pycolmap.IncrementalPipelineOptions(
        num_threads=1,
        random_seed=seed,
        min_model_size=FEWEST_PICTURES,
        ba_refine_focal_length=not camera_known,
        ba_refine_principal_point=False,
        ba_refine_extra_params=False,
    )
    options.mapper.abs_pose_refine_focal_length = not camera_known
    progress = _MappingProgress(len(project.names))
    models = pycolmap.incremental_mapping(
        project.database,
        project.images,
        project.models,
        options,
        initial_image_pair_callback=progress.started,
        next_image_callback=progress.registered,
    )
    progress.tell()
    return [model for model in models.values() if model.num_points3D() >= FEWEST_POINTS]


class _MappingProgress:
    """Says every few seconds how many pictures are registered in the model that is being built."""

    def __init__(self, frames: int) -> None:
        self.frames = frames
        self.count = 0
        self.last = time.perf_counter()

    def started(self) -> None:
        self.count = 2

    def registered(self) -> None:
        self.count += 1
        if time.perf_counter() - self.last >= _SECONDS_BETWEEN_LINES:
            self.tell()

    def tell(self) -> None:
        self.last = time.perf_counter()
        log(f"COLMAP: mapping: {self.count} of {self.frames} pictures in this model")


def largest_model(
    models: list[pycolmap.Reconstruction], matched: Matched, frames: int, min_registered: float
) -> pycolmap.Reconstruction:
    """The model with the most pictures.

    Args:
        models: all that were found.
        matched: what matching found, which tells why there is no model.
        frames: number of pictures.
        min_registered: share of them that it must hold.

    Raises:
        UserError: there is no model, or it holds too few pictures.
    """
    if not models:
        raise UserError(_why_no_model(matched))
    model = max(models, key=lambda found: (found.num_reg_images(), found.num_points3D()))
    registered = model.num_reg_images()
    if registered < min_registered * frames:
        raise UserError(
            f"COLMAP registers {registered} of {frames} pictures in its largest model; min_registered asks"
            f" for {min_registered:.0%}: use a smaller stride or a larger overlap, or leave out blurred"
            " and blank pictures"
        )
    return model


def _why_no_model(matched: Matched) -> str:
    if matched.verified == 0:
        return (
            f"COLMAP finds no two pictures that show the same things ({matched.compared} pairs compared):"
            " use a smaller stride, or sharper pictures"
        )
    if matched.median_shift_px < _UNMOVED_PX:
        return (
            f"COLMAP finds no parallax: features move by {matched.median_shift_px:.2f} px between pictures,"
            " so they are copies of one view; use frames of a camera that moves, or a larger stride"
        )
    if matched.with_parallax == 0:
        return (
            f"COLMAP finds no parallax in {matched.verified} pairs of pictures: the camera only turns,"
            " or all it sees is flat; use frames in which it moves sideways, or a larger stride"
        )
    return (
        f"COLMAP makes no model, although {matched.verified} pairs of pictures match"
        f" ({matched.with_parallax} with parallax): use more frames, a smaller stride, or larger pictures"
    )
