"""COLMAP's third step: incremental mapping, and the choice of the model."""

import time

import pycolmap

from egosplat.calibration.colmap.database import MIN_IMAGES, Project
from egosplat.calibration.colmap.joining import Joined, join_models
from egosplat.calibration.colmap.matching import MatchingResult
from egosplat.calibration.files import accept_advice
from egosplat.errors import UserError
from egosplat.progress import format_ranges, log

# A model with fewer points is noise, not a scene.
MIN_POINTS = 50

# Frames whose longer side is shorter have few features: 16 photographs and a video of 70 frames got half as many poses [px].
_FEW_PIXELS = 512

_SECONDS_BETWEEN_LINES = 5.0


def build_models(
    project: Project, camera_known: bool, seed: int, distortion: bool = False
) -> list[pycolmap.Reconstruction]:
    """The models with enough points by incremental mapping; images without common views end in different ones, or in none.

    Args:
        camera_known: whether the focal lengths are kept fixed.
        distortion: whether the distortion of the camera in the database is estimated.
    """
    project.check_free_space()
    options = pycolmap.IncrementalPipelineOptions(
        # With more threads, the result depends on their order.
        num_threads=1,
        random_seed=seed,
        min_model_size=MIN_IMAGES,
        ba_refine_focal_length=not camera_known,
        # A principal point is hardly observable.
        ba_refine_principal_point=False,
        ba_refine_extra_params=distortion,
    )
    options.mapper.abs_pose_refine_focal_length = not camera_known
    count, last = 0, time.perf_counter()

    def tell() -> None:
        log(f"COLMAP: mapping: {count} of {len(project.names)} images in this model")

    def started() -> None:
        nonlocal count
        count = 2  # the initial pair

    def registered() -> None:
        nonlocal count, last
        count += 1
        if time.perf_counter() - last >= _SECONDS_BETWEEN_LINES:
            last = time.perf_counter()
            tell()

    models = pycolmap.incremental_mapping(
        project.database,
        project.images,
        project.models,
        options,
        initial_image_pair_callback=started,
        next_image_callback=registered,
    )
    tell()
    return [model for model in models.values() if model.num_points3D() >= MIN_POINTS]


def choose_model(
    models: list[pycolmap.Reconstruction],
    matches: MatchingResult,
    project: Project,
    camera_known: bool,
    min_registered: float,
) -> Joined:
    """The largest model, joined with others; log what has no pose. UserError if it registers too few images, or is none."""
    if not models:
        raise UserError(_no_model_message(matches))
    joined = join_models(models, camera_known)
    frames, registered = len(project.names), frames_of_model(joined.model, project)
    others = [frames_of_model(other, project) for other in joined.others]
    if len(registered) < min_registered * frames:
        if matches.with_parallax == 0:
            raise UserError(_no_model_message(matches))
        side = max(max(camera.width, camera.height) for camera in joined.model.cameras.values())
        raise UserError(too_few_message(registered, others, frames, min_registered, matches.strategy, side))
    for line in model_lines(joined.parts, registered, others, joined.reasons, frames):
        log(f"COLMAP: {line}")
    return joined


def frames_of_model(model: pycolmap.Reconstruction, project: Project) -> set[int]:
    """The frames that a model registers."""
    return {project.frame_of(model.images[number].name) for number in model.reg_image_ids()}


def model_lines(
    parts: int, registered: set[int], others: list[set[int]], reasons: list[str], frames: int
) -> list[str]:
    """Lines about ``parts`` joined models, models that are left out with reasons, and frames without a pose."""
    lines, lost = [], set(range(frames)) - registered
    if parts > 1:
        lines.append(f"{parts} models share frames and are joined to one of {len(registered)} frames")
    for other, reason in zip(others, reasons, strict=True):
        lines.append(f"a model of {len(other)} frames ({format_ranges(other)}) is left out: it {reason}")
    if others:
        lines.append("to connect the models, record the ways between them, or lower frames.stride")
    if lost:
        lines.append(
            f"{len(lost)} of {frames} frames have no pose and are not used (indices from 0): {format_ranges(lost)}; "
            "they are blurred, blank, or share too little with the others"
        )
    return lines


def too_few_message(
    registered: set[int],
    others: list[set[int]],
    frames: int,
    min_registered: float,
    strategy: str,
    side: int = _FEW_PIXELS,
) -> str:
    """The error of a largest model with the frames ``registered`` of a longer side [px], beside others; it advises."""
    lost = format_ranges(set(range(frames)) - registered)
    problem = (
        f"COLMAP registers {len(registered)} of {frames} frames, and poses.min_registered requires "
        f"{min_registered:.0%}; not registered (indices from 0): {lost}"
    )
    if others:
        second = max(others, key=len)
        problem += (
            f". A second model registers {len(second)} ({format_ranges(second)}): the two share too few views"
        )
    larger = f"set frames.resolution={_FEW_PIXELS}, as {side} px show few details"
    advice = [
        larger if side < _FEW_PIXELS else "",
        "add views in between (a smaller frames.stride)",
        "take the part that shows one place (frames.start_s, frames.end_s)",
        "remove blurred and blank frames",
        "set poses.matching=exhaustive" if strategy == "sequential" else "",
        accept_advice(len(registered), frames),
    ]
    advised = ", or ".join(filter(None, advice))
    return f"{problem}\n{advised[0].upper()}{advised[1:]}"


def _no_model_message(matches: MatchingResult) -> str:
    if matches.verified == 0:
        return (
            f"COLMAP finds no two frames of the same scene ({matches.compared} pairs compared):"
            " use a smaller frames.stride, or sharper frames"
        )
    if matches.with_parallax == 0:
        return (
            f"COLMAP finds no parallax in {matches.verified} pairs of frames: the camera only turns,"
            " or the scene is flat; use frames in which it moves sideways, or a larger frames.stride"
        )
    return (
        f"COLMAP builds no model, although {matches.verified} pairs of frames match"
        f" ({matches.with_parallax} with parallax): use more frames, a smaller frames.stride, or larger frames"
    )
