"""Masking of transient pixels in training: none, the network's prediction, or the refined masks."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.masks import MASKS
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.transient import TRANSIENT
from egosplat.errors import UserError
from egosplat.gaussians.stored_rows import StoredRows, stored_rows

# Artifact, schema and array, by kind of masking.
_SOURCES = {"initial": ("transient", TRANSIENT, "probability"), "refined": ("masks", MASKS, "refined")}


@dataclass(frozen=True)
class Masking:
    """Probability that a pixel is transient, the paper's M in the weight 1 - M; 1 for pixels that the user masks.

    Attributes:
        artifact: transient or masks artifact; None if nothing is transient.
        array: name of its (F, H, W) array.
        masked: frames artifact, if masks of single frames came with the recording; else None.
    """

    artifact: Artifact | None
    array: str
    masked: Artifact | None = None

    @property
    def artifacts(self) -> tuple[Artifact, ...]:
        """The artifact, for the provenance of a stage; empty if nothing is transient."""
        return () if self.artifact is None else (self.artifact,)

    def frames(self, rows: NDArray[np.integer]) -> Tensor | StoredRows | None:
        """Get M of the frames ``rows`` on the CPU: (V, H, W) bool, or float16 in [0, 1]; None if nothing is masked."""
        found = [(one, name) for one, name in ((self.artifact, self.array), (self.masked, "masked")) if one]
        if not found:
            return None
        artifact, array = found[0]
        _, height, width = artifact.shape(array)
        dtype = artifact.schema.fields[array].dtype

        # Read row by row: most frames may be unused.
        def read(position: int) -> NDArray:
            values = [one.row(name, rows[position]) for one, name in found]
            return np.maximum.reduce(values, dtype=dtype)

        return stored_rows(len(rows), (height, width), dtype, read)

    def of_the_user(self) -> "Masking":
        """What came with the recording alone."""
        return Masking(None, "", self.masked)


def open_masking(
    kind: str, frames: Artifact, *, transient_path: Path | None, masks_path: Path | None
) -> Masking:
    """Open the artifact that a kind of masking needs.

    Args:
        kind: ``none``, ``initial`` (M of the network) or ``refined`` (M of the instances).
        frames: the frames to mask.
        transient_path, masks_path: only the artifact that is needed is opened.

    Raises:
        UserError: the kind is ``auto``, which only the workflow resolves; or the artifact is missing, unreadable or
            made from other frames.
    """
    masked = frames if frames.has("masked") else None
    if kind == "none":
        return Masking(None, "", masked)
    if kind == "auto":
        raise UserError(
            "splats.masking = auto: only the workflow resolves it, from survey.json; "
            "here give --masking none or refined"
        )
    name, schema, array = _SOURCES[kind]
    path = {"transient": transient_path, "masks": masks_path}[name]
    if path is None:
        raise UserError(f"splats.masking = {kind} needs the {name} artifact: give --{name}")
    artifact = open_artifact(path, schema)
    check_made_from(artifact, frames, axes=("frame", "height", "width"))
    return Masking(artifact, array, masked)
