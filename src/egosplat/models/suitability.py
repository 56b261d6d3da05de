"""Warn if models that do not suit a real recording are used on it: those of apartments, and words of photographs."""

from collections.abc import Iterable, Mapping
from typing import Any

from egosplat.artifacts.provenance import joint_origin
from egosplat.artifacts.reader import Artifact
from egosplat.models.checkpoints import CLIP, PHOTOS, SAM2, SMALL

_FETCH = "Set models.set to light: egosplat run fetches it, and so does egosplat models download --config models.set=light"

# The warning in the label of a table's row.
BRIEF = "trained on synthetic apartments only"


def notice(origin: str, checkpoints: Mapping[str, str]) -> str | None:
    """One line of warning and advice if checkpoints, by key of the configuration's section ``models``, do not suit a recording
    of an ``origin``, ``real`` or ``synthetic``; else None."""
    if origin != "real":
        return None
    if checkpoints.get(CLIP.checkpoint_key) == PHOTOS:
        return f"the set photos knows ImageNet's 1,000 classes, few in dark pictures; its SAM2 was {BRIEF}. {_FETCH}"
    small = [f"models.{key}" for key, value in sorted(checkpoints.items()) if value in (SMALL, PHOTOS)]
    told = f"the small checkpoints ({', '.join(small)}) were {BRIEF}: results on a real recording"
    return f"{told} are unreliable. {_FETCH}" if small else None


def notice_of_artifacts(artifacts: Iterable[Artifact]) -> str | None:
    """The ``notice`` of a scene, from the provenance of its artifacts."""
    artifacts = list(artifacts)
    checkpoints: dict[str, str] = {}
    for artifact in artifacts:
        checkpoints |= {key: artifact.provenance["options"][key] for key in artifact.provenance["models"]}
        if "clip" in artifact.facts:  # features.zarr has it, in case view_features.zarr is deleted
            checkpoints[CLIP.checkpoint_key] = artifact.facts["clip"]["checkpoint"]
    return notice(joint_origin(artifacts), checkpoints)


def configured_checkpoints(config: Mapping[str, Any]) -> dict[str, str]:
    """The checkpoints that a scene's configuration uses, by key; SAM2's only if it segments."""
    models = (SAM2, CLIP) if config["segments"]["segmenter"] == "sam2" else (CLIP,)
    return {model.checkpoint_key: config["models"][model.checkpoint_key] for model in models}
