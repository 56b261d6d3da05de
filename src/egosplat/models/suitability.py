"""Whether a scene's models know what it shows: the small checkpoints know synthetic apartments alone.

The condition and its sentence are here, and nowhere else.
"""

from collections.abc import Iterable, Mapping
from typing import Any, Protocol

from egosplat.artifacts.provenance import joint_origin
from egosplat.models.checkpoints import CLIP, SAM2
from egosplat.models.configs import SMALL

BRIEF = "which know synthetic apartments alone"
"""Said of small checkpoints in the label of a table's row on a real recording."""


class Made(Protocol):
    """An artifact."""

    @property
    def origin(self) -> str: ...
    @property
    def provenance(self) -> dict[str, Any]: ...
    @property
    def facts(self) -> dict[str, Any]: ...


def notice(origin: str, checkpoints: Mapping[str, str]) -> str | None:
    """One line where small checkpoints are used on a real recording, with what to do; else None.

    Args:
        origin: of the recording, ``real`` or ``synthetic``.
        checkpoints: value of each checkpoint's key of the configuration's section ``models``.
    """
    small = [f"models.{key}" for key, value in sorted(checkpoints.items()) if value == SMALL]
    if origin != "real" or not small:
        return None
    return (
        f"the small checkpoints ({', '.join(small)}) know synthetic apartments alone: answers on a real recording "
        "mean little. Set the keys of models to published checkpoints; egosplat doctor --config preset=paper names them"
    )


def notice_of_artifacts(artifacts: Iterable[Made]) -> str | None:
    """The ``notice`` of a scene by what its artifacts tell of how they were made."""
    artifacts = list(artifacts)
    checkpoints: dict[str, str] = {}
    for artifact in artifacts:
        checkpoints |= {key: artifact.provenance["options"][key] for key in artifact.provenance["models"]}
        if "clip" in artifact.facts:  # features.zarr tells it where view_features.zarr is gone
            checkpoints[CLIP.checkpoint_key] = artifact.facts["clip"]["checkpoint"]
    return notice(joint_origin(*(artifact.origin for artifact in artifacts)), checkpoints)


def configured_checkpoints(config: Mapping[str, Any]) -> dict[str, str]:
    """The checkpoints that a scene's configuration uses, by key; SAM2's only where it segments."""
    models = (SAM2, CLIP) if config["segments"]["segmenter"] == "sam2" else (CLIP,)
    return {model.checkpoint_key: config["models"][model.checkpoint_key] for model in models}
