"""``survey.json``: the decisions that other stages follow."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

Survey = Mapping[str, Any]


def frames_of_gaussians(survey: Survey, masking: str) -> tuple[list[int], str] | None:
    """The frames that Gaussians train on, with their digest; None if they train on all, where too little moves to be masked."""
    # The number of iterations does not depend on the number of frames, so fewer frames save no time here. Where something is
    # masked, only kept frames have segments and masks; the other frames would show moving objects unmasked.
    if masking != "none" or survey["motion"]["masking"] != "none":
        return survey["views"]["kept"], survey["views"]["digest"]
    return None


def digest_of(part: Any) -> str:
    """SHA-256 of a list of frames, or of another part of a survey."""
    return hashlib.sha256(json.dumps(part).encode()).hexdigest()
