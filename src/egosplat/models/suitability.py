"""Warn if the small checkpoints, trained on synthetic apartments only, are used on a real recording."""

from collections.abc import Iterable, Mapping
from typing import Any, Protocol

from egosplat.artifacts.provenance import joint_origin
from egosplat.models.checkpoints import CLIP, SAM2
from egosplat.models.configs import SMALL

# The warning in the label of a table's row.
BRIEF = "trained on synthetic apartments only"


class HasProvenance(Protocol):
    """The properties of an artifact that are read here."""

    @property
    def origin(self) -> str: ...
    @property
    def provenance(self) -> dict[str, Any]: ...
    @property
    def facts(self) -> dict[str, Any]: ...


def notice(origin: str, checkpoints: Mapping[str, str]) -> str | None:
    """One line of warning and advice if small checkpoints are used on a real recording; else None.

    Args:
        origin: of the recording, ``real`` or ``synthetic``.
        checkpoints: by key of the configuration's section ``models``, its value.
    """
    small = [f"models.{key}" for key, value in sorted(checkpoints.items()) if value == SMALL]
    if origin != "real" or not small:
        return None
    return (
        f"the small checkpoints ({', '.join(small)}) were trained on synthetic apartments only: results on a real "
        "recording are unreliable. Set models.set to published, and fetch the checkpoints with egosplat models download"
    )


def notice_of_artifacts(artifacts: Iterable[HasProvenance]) -> str | None:
    """The ``notice`` of a scene, from the provenance of its artifacts."""
    artifacts = list(artifacts)
    checkpoints: dict[str, str] = {}
    for artifact in artifacts:
        checkpoints |= {key: artifact.provenance["options"][key] for key in artifact.provenance["models"]}
        if "clip" in artifact.facts:  # features.zarr has it, in case view_features.zarr is deleted
            checkpoints[CLIP.checkpoint_key] = artifact.facts["clip"]["checkpoint"]
    return notice(joint_origin(*(artifact.origin for artifact in artifacts)), checkpoints)


def configured_checkpoints(config: Mapping[str, Any]) -> dict[str, str]:
    """The checkpoints that a scene's configuration uses, by key; SAM2's only if it segments."""
    models = (SAM2, CLIP) if config["segments"]["segmenter"] == "sam2" else (CLIP,)
    return {model.checkpoint_key: config["models"][model.checkpoint_key] for model in models}
