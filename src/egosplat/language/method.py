"""What a way to give Gaussians codes consists of, and what it gives; docs/methods.md says how to add one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from egosplat.artifacts.schema import Schema
from egosplat.artifacts.schemas import FEATURES, INSTANCES
from egosplat.language.decoder import Decoder
from egosplat.language.targets import CodeTargets

# By value of ``segments.segmenter``.
SEGMENTERS = {"sam2": "SAM2", "classical": "a classical segmenter"}


@dataclass(frozen=True, eq=False)
class Coded:
    """Codes of N Gaussians at L levels, with C channels.

    Attributes:
        code: (N, L, C) float32.
        share: (N, L) float32 in [0, 1], how much of its compositing weight a Gaussian has in queries; 0 without a code.
        levels: name of each level.
        decoder: from codes to features, where the method learns its own; else that of features.zarr.
        curve: last iteration and mean loss of each record of training; empty if nothing is trained.
        stands_in: short sentences, each on a part of the published method that something else replaces.
        maps_only: no Gaussian has a code of its own: queries read rendered codes, whatever ``query.readout`` is.
    """

    code: Tensor
    share: Tensor
    levels: list[str]
    decoder: Decoder | None = None
    curve: Sequence[tuple[int, float]] = ()
    stands_in: tuple[str, ...] = ()
    maps_only: bool = False


@dataclass(frozen=True)
class Method:
    """A way to give Gaussians codes: the constant ``METHOD`` of each module that ``language.method`` chooses.

    Attributes:
        give_codes: function of views, targets, options and checkpoint. A method that trains resumes from the
            checkpoint, and raises UserError if it diverges.
        learns_from: schemas of the artifacts with the targets.
        open_targets: opens the targets from these artifacts, frames.zarr and the device; by default codes of instances.
        masks: what the masks replace in the published method, with {} for the segmenter; empty if nothing.
    """

    give_codes: Callable[..., Coded]
    learns_from: tuple[Schema, ...] = (INSTANCES, FEATURES)
    open_targets: Callable[..., Any] = lambda learnt_from, _, device: CodeTargets(*learnt_from, device)
    masks: str = ""
