"""What a way to give Gaussians codes consists of; docs/methods.md says how to add one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from torch import device

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schema import Schema
from egosplat.artifacts.schemas import FEATURES, INSTANCES
from egosplat.codes.targets import CodeTargets
from egosplat.language.result import Coded

_SEGMENTERS = {"sam2": "SAM2", "classical": "a classical segmenter"}


def open_code_targets(learnt_from: Sequence[Artifact], frames: Artifact, device: device) -> CodeTargets:
    """Open the codes of instances as targets; raises as ``CodeTargets``."""
    return CodeTargets(*learnt_from, device)


@dataclass(frozen=True)
class Method:
    """A way to give Gaussians codes: the constant ``METHOD`` of each module that ``language.method`` chooses.

    Attributes:
        give_codes: function of views, targets, options and checkpoint. A method that trains resumes from the
            checkpoint, and raises UserError if it diverges.
        learns_from: schemas of the artifacts with the targets.
        open_targets: opens the targets from these artifacts, frames.zarr and the device.
        masks: what the masks replace in the published method, with {} for the segmenter; empty if nothing.
    """

    give_codes: Callable[..., Coded]
    learns_from: tuple[Schema, ...] = (INSTANCES, FEATURES)
    open_targets: Callable[[Sequence[Artifact], Artifact, device], Any] = open_code_targets
    masks: str = ""

    def list_stand_ins(self, segmenter: str) -> list[str]:
        """List what stands in for the masks of the published method, by value of ``segments.segmenter``."""
        return [self.masks.format(_SEGMENTERS[segmenter])] if self.masks else []
