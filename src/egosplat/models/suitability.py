"""Warn if models that do not suit a real recording are used on it: those of apartments, and words of photographs."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from egosplat.artifacts.provenance import joint_origin
from egosplat.models.checkpoints import CLIP, SAM2
from egosplat.models.configs import PHOTOS, SMALL

if TYPE_CHECKING:
    from egosplat.artifacts.reader import Artifact

_FETCH = "Set models.set to published, and fetch the checkpoints with egosplat models download"

# The warning in the label of a table's row.
BRIEF = "trained on synthetic apartments only"


def notice(origin: str, checkpoints: Mapping[str, str], *, aria: bool = False) -> str | None:
    """One line of warning and advice if the models do not suit a real recording; else None.

    Args:
        origin: of the recording, ``real`` or ``synthetic``.
        checkpoints: by key of the configuration's section ``models``, its value.
        aria: whether Aria glasses filmed it.
    """
    if origin == "real" and PHOTOS in checkpoints.values():
        if aria:
            return (
                "models.set photos names hardly anything in the dark pictures of Aria glasses: answers are unreliable. "
                f"{_FETCH}"
            )
        return (
            "models.set photos: words are matched through ImageNet's 1,000 classes, and masks come from the small SAM2, "
            f"which was trained on synthetic apartments only. {_FETCH}, for better answers"
        )
    small = [f"models.{key}" for key, value in sorted(checkpoints.items()) if value == SMALL]
    if origin != "real" or not small:
        return None
    return (
        f"the small checkpoints ({', '.join(small)}) were trained on synthetic apartments only: results on a real "
        f"recording are unreliable. {_FETCH}"
    )


def notice_of_artifacts(artifacts: "Iterable[Artifact]") -> str | None:
    """The ``notice`` of a scene, from the provenance of its artifacts."""
    artifacts = list(artifacts)
    checkpoints: dict[str, str] = {}
    for artifact in artifacts:
        checkpoints |= {key: artifact.provenance["options"][key] for key in artifact.provenance["models"]}
        if "clip" in artifact.facts:  # features.zarr has it, in case view_features.zarr is deleted
            checkpoints[CLIP.checkpoint_key] = artifact.facts["clip"]["checkpoint"]
    # Aria glasses alone have a device frame.
    aria = any(artifact.facts.get("device_from_camera") is not None for artifact in artifacts)
    return notice(joint_origin(artifacts), checkpoints, aria=aria)


def configured_checkpoints(config: Mapping[str, Any]) -> dict[str, str]:
    """The checkpoints that a scene's configuration uses, by key; SAM2's only if it segments."""
    models = (SAM2, CLIP) if config["segments"]["segmenter"] == "sam2" else (CLIP,)
    return {model.checkpoint_key: config["models"][model.checkpoint_key] for model in models}
