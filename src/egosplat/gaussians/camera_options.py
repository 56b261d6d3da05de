"""The keys of the section ``camera``, for the stages that train Gaussians."""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TypeVar

from egosplat.gaussians.corrections import CorrectionOptions, Corrections, scene_depth
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.training_views import Views
from egosplat.pipeline.survey_file import read_survey


@dataclass(frozen=True, kw_only=True)
class CameraOptions:
    """Keys of the section ``camera``; ``config.schema.yaml`` describes each."""

    refine_poses: str
    compensate_exposure: str

    @property
    def corrections(self) -> CorrectionOptions:
        """Which corrections are optimized, once ``resolved``."""
        return CorrectionOptions(self.refine_poses == "on", self.compensate_exposure == "on")


Options = TypeVar("Options", bound=CameraOptions)


def resolved(options: Options, survey_path: Path | None) -> Options:
    """Replace ``auto`` by the decision of the survey, or by ``off`` without one. The workflow gives no ``auto``.

    Raises:
        UserError: the survey cannot be read.
    """
    keys = [key.name for key in fields(CameraOptions) if getattr(options, key.name) == "auto"]
    decisions = read_survey(survey_path)["camera"] if keys and survey_path is not None else {}
    return replace(options, **{name: "on" if decisions.get(name) else "off" for name in keys})


def make_corrections(
    options: CorrectionOptions, start: Gaussians, views: Views, near_plane: float, iterations: int
) -> Corrections | None:
    """The corrections of a training that starts from ``start``; None if nothing is corrected."""
    if not options.active:
        return None
    depth = scene_depth(start.means.double().cpu().numpy(), views, near_plane)
    return Corrections(options, views, depth, iterations)
