"""Which frames learn: the one place where stages ask for what a survey leaves out."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reading import Artifact
from egosplat.artifacts.survey import Survey, made_anew, read_survey
from egosplat.errors import UserError


def kept_frames(frames: Artifact, survey: Path | None) -> tuple[NDArray[np.bool_], dict[str, str]]:
    """Which frames add views, by a survey of them, and what a stage's provenance says of that beside its keys.

    Args:
        frames: the frames artifact.
        survey: path of their survey; None to keep all.

    Returns:
        (F,) bool, and ``{"kept_frames": digest}``, or nothing where no survey is followed.

    Raises:
        UserError: the survey cannot be read, or is of other frames.
    """
    count = frames.shape("rgb")[0]
    if survey is None:
        return np.ones(count, bool), {}
    found = read_survey(survey)
    if found["provenance"]["inputs"].get("frames.zarr") != frames.digest:
        raise UserError(f"{survey}: is of other frames than {frames.path}. {made_anew(survey)}")
    kept = np.zeros(count, bool)
    kept[found["views"]["kept"]] = True
    return kept, {"kept_frames": found["views"]["digest"]}


def gaussians_learn_from_all(survey: Survey, masking: str) -> bool:
    """Whether Gaussians are trained on what a survey leaves out, too: where nothing moves, and nothing is masked.

    Their training has as many iterations of however many frames, so leaving some out saves nothing there. Where
    something moves only frames that stay are segmented, and so masked; the others would teach what moves.
    """
    return masking == "none" and survey["motion"]["static"]


def frames_for_gaussians(
    frames: Artifact, survey: Path | None, masking: str
) -> tuple[NDArray[np.bool_], dict[str, str]]:
    """As ``kept_frames``, of the frames that Gaussians may be trained on where ``masking`` is masked."""
    kept, said = kept_frames(frames, survey)
    if survey is not None and gaussians_learn_from_all(read_survey(survey), masking):
        return np.ones_like(kept), {}
    return kept, said
