"""Artifacts belong together: each was made from those that it is used with, and a survey chooses among its own frames."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from egosplat.arrays import Bools
from egosplat.artifacts.integrity import rebuild_command
from egosplat.artifacts.reader import Artifact
from egosplat.errors import UserError
from egosplat.pipeline.survey_file import frames_of_gaussians
from egosplat.pipeline.validation import read_document


def check_made_from(made: Artifact, *sources: Artifact, axes: Sequence[str] = ()) -> None:
    """Check that an artifact was made from ``sources``; UserError if a digest, or the size of one of the
    ``axes``, differs. Sources whose file name its provenance does not record are compared by ``axes``
    alone."""
    inputs = made.provenance["inputs"]
    for source in sources:
        same = inputs.get(source.path.name, source.digest) == source.digest
        if not same or any(made.sizes[axis] != source.sizes[axis] for axis in axes):
            raise made_from_another(made.path, source.path)


def check_inputs(path: Path, inputs: Mapping[str, str], sources: Sequence[Artifact]) -> None:
    """Raise UserError unless a JSON result at ``path``, by the digests of its inputs, was made from ``sources``."""
    for source in sources:
        if source.digest not in inputs.values():
            raise made_from_another(path, source.path)


def made_from_another(path: Path, source: Path) -> UserError:
    """The error for a result that was made from another artifact than ``source``."""
    wrong = f"was made from another {source.name} than {source}"
    return UserError(f"{path}: {wrong}. Rebuild it: {rebuild_command(path)}")


def kept_frames(
    frames: Artifact, survey_path: Path | None, masking: str | None = None
) -> tuple[Bools, dict[str, str]]:
    """The (F,) bool frames to train on, and ``{"kept_frames": digest}`` for the provenance; all, and {},
    without a survey. They are those that add views. Gaussians of a static scene without masks take every
    frame: ``masking``, the value of ``splats.masking``, asks for theirs. UserError if the survey cannot be
    read, or is of other frames."""
    kept = np.zeros(frames.shape("rgb")[0], bool)
    if survey_path is None:
        return ~kept, {}
    survey = read_document(survey_path, "survey")
    check_inputs(survey_path, survey["provenance"]["inputs"], [frames])
    views = survey["views"]["kept"], survey["views"]["digest"]
    if (chosen := views if masking is None else frames_of_gaussians(survey, masking)) is None:
        return ~kept, {}
    kept[chosen[0]] = True
    return kept, {"kept_frames": chosen[1]}
