"""Target codes for Gaussians: the code of each pixel's instance, at every level."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact


@dataclass(frozen=True, eq=False)
class Targets:
    """Target codes of one frame's pixels, at L levels with C channels each.

    Attributes:
        codes: (L, C, H, W) float32, 0 where there is none.
        known: (L, H, W) bool, pixels with a target.
    """

    codes: Tensor
    known: Tensor


class CodeTargets:
    """The supervision F of the paper's L_F, compressed; frames are read on request.

    In each frame, an instance has the code of its view. An instance too small to be encoded there has the consistent
    code, unless views are supervised by their own features only.

    Attributes:
        channels: C.
    """

    def __init__(self, instances: Artifact, features: Artifact, device: torch.device) -> None:
        """Load the codes; ``device`` is the device of the targets.

        Raises:
            UserError: the features were made from other instances.
        """
        self._instances, self._device = instances, device
        check_made_from(features, instances, axes=("instance",))
        self._instance, self._frame = features.read("instance"), features.read("frame")
        self._code = features.read("code")
        self._common = features.read("consistent_code")
        seen = features.read("views") > 0
        views_alone = features.provenance["options"]["supervision"] == "view"
        # Instances whose consistent code serves frames without a view of theirs.
        self._usable = np.zeros_like(seen) if views_alone else seen
        self._named = seen
        self._levels = np.unique(instances.read("instances/level"))
        names = instances.facts["levels"]
        self.levels = [names[level] for level in self._levels]
        self.channels = self._code.shape[1]

    def of(self, frame: int) -> Targets:
        """Return the targets of a frame, by its index in frames.zarr."""
        return self._look_up(frame, self._instances.row("labels", frame)[self._levels])

    def at(self, frame: int, pixels: NDArray[np.int64]) -> Targets:
        """Return the targets of some pixels of a frame, codes (L, C, P) and known (L, P).

        Args:
            pixels: (P, 2) column and row.
        """
        rows = self._instances.row("labels", frame)[self._levels]
        return self._look_up(frame, rows[:, pixels[:, 1], pixels[:, 0]])

    def _look_up(self, frame: int, rows: NDArray[np.int32]) -> Targets:
        table, usable = self._table(frame)
        # Half the bytes to copy to a GPU; the labels of nearly all scenes fit.
        small = rows.astype(np.int16) if len(self._named) <= np.iinfo(np.int16).max else rows
        labels = torch.from_numpy(small).to(self._device).long()
        # Label -1 indexes the last entry of both, which is empty.
        known = usable[labels]
        codes = torch.stack([table[:, level] for level in labels])
        return Targets(codes, known)

    def _table(self, frame: int) -> tuple[Tensor, Tensor]:
        """Return the (C, N + 1) code of each instance in the frame, and (N + 1,) whether it has one."""
        # The consistent code first; the code of the frame's own view replaces it where there is one.
        codes, usable = self._common.copy(), self._usable.copy()
        rows: NDArray[np.intp] = np.flatnonzero(self._frame == frame)
        owners = self._instance[rows]
        codes[owners] = self._code[rows]
        usable[owners] = self._named[owners]
        codes[~usable] = 0.0
        table = np.concatenate([codes, np.zeros((1, codes.shape[1]), codes.dtype)])
        flags = torch.from_numpy(np.append(usable, False))
        return torch.from_numpy(np.ascontiguousarray(table.T)).to(self._device), flags.to(self._device)
