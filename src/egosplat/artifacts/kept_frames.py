"""Select the frames to train on, from the survey."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.consistency import check_inputs
from egosplat.artifacts.reader import Artifact
from egosplat.pipeline.survey_file import Survey, frames_of_gaussians, read_survey


def kept_frames(frames: Artifact, survey_path: Path | None) -> tuple[NDArray[np.bool_], dict[str, str]]:
    """Select the frames that add views, and the entry about it for the provenance of a stage.

    Args:
        survey_path: their survey; None to keep all.

    Returns:
        (F,) bool, and ``{"kept_frames": digest}``; an empty dictionary if every frame is kept without a survey.

    Raises:
        UserError: the survey cannot be read, or is of other frames.
    """
    if survey_path is None:
        return _selected(frames, None)
    views = _survey_of(frames, survey_path)["views"]
    return _selected(frames, (views["kept"], views["digest"]))


def frames_for_gaussians(
    frames: Artifact, survey_path: Path | None, masking: str
) -> tuple[NDArray[np.bool_], dict[str, str]]:
    """``kept_frames`` for the training of Gaussians, with ``masking`` the value of ``splats.masking``.

    A static scene without masks keeps every frame that is not blurred.
    """
    if survey_path is None:
        return _selected(frames, None)
    return _selected(frames, frames_of_gaussians(_survey_of(frames, survey_path), masking))


def _survey_of(frames: Artifact, path: Path) -> Survey:
    found = read_survey(path)
    check_inputs(path, found["provenance"]["inputs"], [frames])
    return found


def _selected(
    frames: Artifact, chosen: tuple[list[int], str] | None
) -> tuple[NDArray[np.bool_], dict[str, str]]:
    """The frames of a list with its digest; all frames without one."""
    count = frames.shape("rgb")[0]
    if chosen is None:
        return np.ones(count, bool), {}
    kept = np.zeros(count, bool)
    kept[chosen[0]] = True
    return kept, {"kept_frames": chosen[1]}
