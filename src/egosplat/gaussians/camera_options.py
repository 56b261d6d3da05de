"""The keys of the section ``camera``, for the stages that train Gaussians."""

from pathlib import Path
from typing import TypeVar

from egosplat.gaussians.corrections import CorrectionOptions, Corrections, scene_depth
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.training_views import Views
from egosplat.pipeline.shared_options import CameraOptions
from egosplat.pipeline.survey_file import read_survey

Options = TypeVar("Options", bound=CameraOptions)


def resolve_camera(options: Options, survey_path: Path | None) -> Options:
    """Replace ``auto`` by the decision of the survey, or by ``off`` without one. The workflow gives no ``auto``.

    Raises:
        UserError: the survey cannot be read.
    """
    keys = [key for key in CameraOptions.model_fields if getattr(options, key) == "auto"]
    decisions = read_survey(survey_path)["camera"] if keys and survey_path is not None else {}
    return options.change(**{name: "on" if decisions.get(name) else "off" for name in keys})


def chosen_corrections(options: CameraOptions) -> CorrectionOptions:
    """Which corrections are optimized, once ``options`` are ``resolve_camera``."""
    return CorrectionOptions(options.refine_poses == "on", options.compensate_exposure == "on")


def make_corrections(
    options: CorrectionOptions, start: Gaussians, views: Views, near_plane: float, iterations: int
) -> Corrections | None:
    """The corrections of a training that starts from ``start``; None if nothing is corrected."""
    if not options.active:
        return None
    depth = scene_depth(start.means.double().cpu().numpy(), views, near_plane)
    return Corrections(options, views, depth, iterations)
