"""COLMAP's third step: incremental mapping, and which of its models is the scene."""

import math
import time

import pycolmap

from egosplat.errors import UserError
from egosplat.poses.colmap.database import Project
from egosplat.poses.colmap.matching import Matched
from egosplat.progress import log

FEWEST_PICTURES = 3
FEWEST_POINTS = 50
"""A model with fewer points is an accident of noise, not a scene."""

_UNMOVED_PX = 1.0
_RANGES = 12
"""So many runs of frames are named in a message."""
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
    models: list[pycolmap.Reconstruction], matched: Matched, project: Project, min_registered: float
) -> pycolmap.Reconstruction:
    """The model with the most pictures.

    Args:
        models: all that were found.
        matched: what matching found, which tells why there is no model.
        project: with the names of all pictures.
        min_registered: share of them that it must hold.

    Raises:
        UserError: there is no model, or it holds too few pictures.
    """
    if not models:
        raise UserError(_why_no_model(matched))
    model = max(models, key=lambda found: (found.num_reg_images(), found.num_points3D()))
    frames = len(project.names)
    if model.num_reg_images() < min_registered * frames:
        held = {id(found): frames_of_model(found, project) for found in models}
        others = [held[id(found)] for found in models if found is not model]
        raise UserError(too_few(held[id(model)], others, frames, min_registered, matched.strategy))
    return model


def frames_of_model(model: pycolmap.Reconstruction, project: Project) -> set[int]:
    """The frames whose pictures a model registers."""
    return {project.frame_of(model.images[number].name) for number in model.reg_image_ids()}


def too_few(held: set[int], others: list[set[int]], frames: int, min_registered: float, strategy: str) -> str:
    """Why the largest model holds too few frames, and what to do.

    Args:
        held: the frames that it holds; others: those of each other model.
        frames: their number in all.
        min_registered: the share asked for.
        strategy: of matching, ``exhaustive`` or ``sequential``.
    """
    lost = ranges(set(range(frames)) - held)
    what = (
        f"COLMAP registers {len(held)} of {frames} frames, and poses.min_registered asks for {min_registered:.0%}; "
        f"not registered, counted from 0: {lost}"
    )
    if others:
        second = max(others, key=len)
        what += f". A second model holds {len(second)} ({ranges(second)}): the two share too few views"
    share = math.floor(100 * len(held) / frames) / 100
    wider = "set poses.matching=exhaustive or a larger poses.overlap, " if strategy == "sequential" else ""
    return (
        f"{what}\nFilm or keep the views between (a smaller frames.stride), leave out blurred and blank pictures, "
        f"{wider}or accept the loss: poses.min_registered={share:g}"
    )


def ranges(frames: set[int]) -> str:
    """Numbers in order, runs as ``3 to 7``; at most ``_RANGES`` of them."""
    runs: list[list[int]] = []
    for frame in sorted(frames):
        if runs and frame == runs[-1][1] + 1:
            runs[-1][1] = frame
        else:
            runs.append([frame, frame])
    told = [str(first) if first == last else f"{first} to {last}" for first, last in runs[:_RANGES]]
    return ", ".join([*told, *(["..."] if len(runs) > _RANGES else [])])


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
