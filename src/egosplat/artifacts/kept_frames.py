"""Select the frames to train on, from the survey."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.consistency import check_inputs
from egosplat.artifacts.reader import Artifact
from egosplat.pipeline.survey_file import Survey, gaussians_use_all_frames, read_survey


def kept_frames(frames: Artifact, survey_path: Path | None) -> tuple[NDArray[np.bool_], dict[str, str]]:
    """Select the frames that add views, and the entry about it for the provenance of a stage.

    Args:
        survey_path: their survey; None to keep all.

    Returns:
        (F,) bool, and ``{"kept_frames": digest}``; an empty dictionary if every frame is kept without a survey.

    Raises:
        UserError: the survey cannot be read, or is of other frames.
    """
    return _kept(frames, None if survey_path is None else _survey_of(frames, survey_path))


def frames_for_gaussians(
    frames: Artifact, survey_path: Path | None, masking: str
) -> tuple[NDArray[np.bool_], dict[str, str]]:
    """``kept_frames`` for the training of Gaussians, with ``masking`` the value of ``splats.masking``.

    A static scene without masks keeps every frame.
    """
    found = None if survey_path is None else _survey_of(frames, survey_path)
    if found is not None and gaussians_use_all_frames(found, masking):
        found = None
    return _kept(frames, found)


def _survey_of(frames: Artifact, path: Path) -> Survey:
    found = read_survey(path)
    check_inputs(path, found["provenance"]["inputs"], [frames])
    return found


def _kept(frames: Artifact, survey: Survey | None) -> tuple[NDArray[np.bool_], dict[str, str]]:
    """The frames that a survey keeps; all frames without one."""
    count = frames.shape("rgb")[0]
    if survey is None:
        return np.ones(count, bool), {}
    kept = np.zeros(count, bool)
    kept[survey["views"]["kept"]] = True
    return kept, {"kept_frames": survey["views"]["digest"]}
