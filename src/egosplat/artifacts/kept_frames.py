"""Select the frames to train on, from the survey."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.consistency import check_inputs
from egosplat.artifacts.reader import Artifact
from egosplat.pipeline.survey_file import Survey, frames_of_gaussians, read_survey


def kept_frames(frames: Artifact, survey_path: Path | None) -> tuple[NDArray[np.bool_], dict[str, str]]:
    """The (F,) bool frames that add views, and ``{"kept_frames": digest}`` for the provenance; all, and {}, without a survey.

    Raises:
        UserError: the survey cannot be read, or is of other frames.
    """
    return _selected(frames, survey_path, lambda found: (found["views"]["kept"], found["views"]["digest"]))


def frames_for_gaussians(
    frames: Artifact, survey_path: Path | None, masking: str
) -> tuple[NDArray[np.bool_], dict[str, str]]:
    """``kept_frames`` for the training of Gaussians, with ``masking`` the value of ``splats.masking``.

    A static scene without masks keeps every frame.
    """
    return _selected(frames, survey_path, lambda found: frames_of_gaussians(found, masking))


def _selected(
    frames: Artifact, path: Path | None, choose: Callable[[Survey], tuple[list[int], str] | None]
) -> tuple[NDArray[np.bool_], dict[str, str]]:
    """The frames that a survey chooses, with its digest; all frames without a survey or a choice."""
    chosen = None
    if path is not None:
        found = read_survey(path)
        check_inputs(path, found["provenance"]["inputs"], [frames])
        chosen = choose(found)
    kept = np.full(frames.shape("rgb")[0], chosen is None)
    if chosen is None:
        return kept, {}
    kept[chosen[0]] = True
    return kept, {"kept_frames": chosen[1]}
