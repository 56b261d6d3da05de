"""What moves and is left out of training: nothing, what the network says, or the refined masks."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.masks import MASKS
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.transient import TRANSIENT
from egosplat.errors import UserError

_SOURCES = {"initial": ("transient", TRANSIENT, "probability"), "refined": ("masks", MASKS, "refined")}
"""By the kind of masking: the artifact, its schema, and the array in it."""


@dataclass(frozen=True)
class Masking:
    """How probable it is that a pixel shows something transient: the paper's M in its weights 1 - M.

    Attributes:
        artifact: transient or masks; None where nothing is masked.
        array: name of the (F, H, W) array in it.
    """

    artifact: Artifact | None
    array: str

    def frames(self, rows: NDArray[np.integer]) -> Tensor | None:
        """(V, H, W) bool, or float16 in [0, 1], of the frames ``rows``, on the CPU; None where nothing is masked."""
        artifact = self.artifact
        if artifact is None:
            return None
        _, height, width = artifact.shape(self.array)
        found = np.empty((len(rows), height, width), artifact.schema.fields[self.array].dtype)
        for position, row in enumerate(rows):
            found[position] = artifact.row(self.array, row)
        return torch.from_numpy(found)


def open_masking(kind: str, frames: Artifact, *, transient: Path | None, masks: Path | None) -> Masking:
    """The masking of a kind.

    Args:
        kind: ``none``, ``initial`` (M of the network) or ``refined`` (M of the instances).
        frames: the pictures that are to be masked.
        transient, masks: paths of these artifacts; only the one that the kind is made from is opened.

    Raises:
        UserError: the kind is ``auto``, which the workflow decides, or the artifact is not given, cannot be read, or is of other frames.
    """
    if kind == "none":
        return Masking(None, "")
    if kind == "auto":
        raise UserError(
            "splats.masking = auto: the workflow takes it from survey.json; "
            "here give --masking none or refined, as that says"
        )
    name, schema, array = _SOURCES[kind]
    path = {"transient": transient, "masks": masks}[name]
    if path is None:
        raise UserError(f"splats.masking = {kind} needs the {name} artifact: give --{name}")
    artifact = open_artifact(path, schema)
    check_made_from(artifact, frames, axes=("frame", "height", "width"))
    return Masking(artifact, array)
