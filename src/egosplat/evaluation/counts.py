"""How much there was of everything."""

from typing import Any

import numpy as np

from egosplat.artifacts.lineage import Lineage
from egosplat.artifacts.masks import MASKS
from egosplat.artifacts.reader import Artifact
from egosplat.evaluation.evaluation_frames import Evaluation


def counts_of(
    evaluation: Evaluation, features: Artifact, language: Artifact, made_from: Lineage
) -> dict[str, Any]:
    """Counts of frames, instances, views and Gaussians.

    Args:
        evaluation: the evaluation frames, and what they are of.
        features, language: the artifacts.
        made_from: all artifacts, of which the masks tell how many instances are transient; None without them.
    """
    levels, frames = features.facts["levels"], evaluation.frames
    found = np.bincount(features.read("instances/level"), minlength=len(levels))
    masks = next((one for one in made_from.found.values() if one.schema.name == MASKS.name), None)
    taught = (language.read("share") > 0).sum(axis=0)
    return {
        "frames": evaluation.pictures.shape("rgb")[0],
        "training_frames": evaluation.splats.facts["views"]["training"],
        "evaluation_frames": len(frames),
        "evaluation_frames_annotated": sum(frame.annotated for frame in frames),
        "evaluation_frames_asked": sum(frame.asked for frame in frames),
        "evaluation_frames_trained_on": sum(frame.trained_on for frame in frames),
        "evaluation_frames_without_pose": sum(not frame.registered for frame in frames),
        "annotated_instances": len(evaluation.instances),
        "instances": dict(zip(levels, found.tolist(), strict=True)),
        "transient_instances": None if masks is None else masks.facts["transient"],
        "views": features.shape("instance")[0],
        "gaussians": evaluation.splats.shape("means")[0],
        "gaussians_with_code": dict(zip(language.facts["levels"], taught.tolist(), strict=True)),
        "code_channels": language.shape("code")[2],
    }
