"""Target codes for Gaussians: the code of each pixel's instance, at every level; and the loss of joint training."""

from copy import copy
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from egosplat.arrays import Floats, Ints
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact
from egosplat.gaussians.loss import L1Ssim, Objective
from egosplat.gaussians.training_views import Views


@dataclass(frozen=True, eq=False)
class Targets:
    """Target codes of one frame's pixels: (L, C, H, W) float32, 0 where there is none, and (L, H, W) whether there is one."""

    codes: Tensor
    known: Tensor


class CodeTargets:
    """The supervision F of the paper's L_F, compressed to ``channels``; frames are read on request. In each
    frame, an instance has the code of its view. An instance too small to be encoded there has the consistent
    code, unless views are supervised by their own features only. ``levels`` are named, and ``level`` (I,) of
    each instance. ``options`` are those of the features; codes have ``unit_norm`` or not."""

    def __init__(self, instances: Artifact, features: Artifact, device: torch.device) -> None:
        """Load the codes; ``device`` is the device of the targets (UserError: the features were made from other instances)."""
        self._instances, self._features, self._device = instances, features, device
        check_made_from(features, instances, axes=("instance",))
        self._instance, frame = features.read("instance"), features.read("frame")
        counts = np.bincount(frame, minlength=instances.shape("labels")[0])
        self._views = np.split(np.argsort(frame, kind="stable"), np.cumsum(counts)[:-1])
        # Those of the views, then those of the instances.
        self._codes = np.concatenate([features.read("code"), features.read("consistent_code")])
        self.options = features.provenance["options"]
        # The norm of a linear code carries information; all others have unit norm.
        self.unit_norm = self.options["compression"] != "linear"
        # Instances whose consistent code serves frames without a view of theirs.
        self._usable = (features.read("views") > 0) & (self.options["supervision"] != "view")
        self._levels, self.level = np.unique(instances.read("instances/level"), return_inverse=True)
        names = instances.facts["levels"]
        self.levels = [names[level] for level in self._levels]
        self.channels = self._codes.shape[1]

    def uncompressed(self) -> "CodeTargets":
        """Return the same targets as features instead of codes, for methods that learn a compression of their own."""
        other = copy(self)
        other._codes = np.concatenate([self._features.read("supervision"), self._features.read("consistent")])
        other.channels = other._codes.shape[1]
        return other

    @property
    def rows(self) -> Floats:
        """(R, C) codes of all views of all instances."""
        return self._codes[: len(self._instance)]

    def code_rows(self) -> tuple[Floats, Ints]:
        """Return the (R + I, C) codes of R views, then the consistent ones of I instances, and the instance of each."""
        return self._codes, np.concatenate([self._instance, np.arange(len(self.level))])

    def of(self, frame: int) -> Targets:
        """Return the targets of a frame, by its index in frames.zarr."""
        labels, rows = self.labels(frame), self._rows_in(frame)
        usable = torch.from_numpy(rows >= 0).to(self._device)
        by_channel = torch.from_numpy(np.ascontiguousarray(self._codes_of(rows).T)).to(self._device)
        # Label -1 gets the last entry of both, which is empty.
        entries = labels.masked_fill(labels < 0, len(rows) - 1).flatten(1)
        # On a CPU three times as fast as indexing.
        codes = torch.stack([by_channel.index_select(1, level) for level in entries])
        known = torch.stack([usable.index_select(0, level) for level in entries])
        return Targets(codes.unflatten(2, labels.shape[1:]), known.unflatten(1, labels.shape[1:]))

    def at(self, frame: int, pixels: Ints) -> Targets:
        """Return the targets of (P, 2) pixels of a frame, column and row: codes (L, C, P) and known (L, P)."""
        codes, known = self.of_labels(frame, self.labels(frame)[:, pixels[:, 1], pixels[:, 0]])
        return Targets(codes.movedim(-1, 1), known)

    def rows_at(self, frame: int, pixels: Ints) -> Ints:
        """Return the (L, P) row of ``code_rows`` that is the target at the pixels of ``at``, -1 for none. It
        is the view's row, or the instance's where it has no view in the frame."""
        return self._rows_in(frame)[self.labels(frame)[:, pixels[:, 1], pixels[:, 0]].cpu().numpy()]

    def labels(self, frame: int) -> Tensor:
        """(L, H, W) int64 instance of each pixel of a frame, -1 for none."""
        rows = self._instances.row("labels", frame)[self._levels]
        # Half the bytes to copy to a GPU; the labels of nearly all scenes fit.
        small = rows.astype(np.int16) if len(self.level) <= np.iinfo(np.int16).max else rows
        return torch.from_numpy(small).to(self._device).long()

    def of_labels(self, frame: int, labels: Tensor) -> tuple[Tensor, Tensor]:
        """Return the (..., C) target codes of (...) labels in a frame, and (...) whether there is one."""
        rows = self._rows_in(frame)[labels.cpu().numpy()]
        codes, known = (torch.from_numpy(part).to(self._device) for part in (self._codes_of(rows), rows >= 0))
        return codes, known

    def known(self, frame: int) -> Tensor:
        """(L, H, W) bool pixels of a frame with a target."""
        return torch.from_numpy(self._rows_in(frame) >= 0).to(self._device)[self.labels(frame)]

    def _rows_in(self, frame: int) -> Ints:
        """Return the (N + 1,) row of ``code_rows`` of each instance in the frame, -1 for no target; no label is last."""
        # The instance's own row; that of the frame's view replaces it where there is one.
        rows = np.where(self._usable, len(self._instance) + np.arange(len(self.level)), -1)
        rows[self._instance[self._views[frame]]] = self._views[frame]
        return np.append(rows, -1)

    def _codes_of(self, rows: Ints) -> Floats:
        """Return the (..., C) codes of (...) rows, 0 for -1."""
        return np.where(rows[..., None] < 0, np.float32(0), self._codes[rows])


def code_l1(rendered: Tensor, targets: Targets, weight: Tensor | None) -> Tensor:
    """L_F-w with d_F = L1: ``mean over all values of weight |F - F̂|``, 0 where there is no target.
    ``rendered`` is (L, C, H, W) float32, ``weight`` (H, W) in [0, 1], or None for ones."""
    counted = targets.known.to(rendered.dtype)
    if weight is not None:
        counted = counted * weight
    # The mean is over all values, also those of weight 0 (docs/method.md#loss-denominator).
    return ((rendered - targets.codes).abs() * counted[:, None]).mean()


class JointLanguage(Objective):
    """L_RGB-w + L_F-w (the paper's weight is 1); the Gaussians' features are the concatenated codes of all levels, so that their gradients
    reach the geometry, too."""

    def __init__(self, ssim_lambda: float, targets: CodeTargets) -> None:
        """Take the targets of the codes; ``ssim_lambda`` as in ``L1Ssim``."""
        self._colors = L1Ssim(ssim_lambda)
        self._targets = targets
        self.features = len(targets.levels) * targets.channels

    def loss(self, image: Tensor, views: Views, index: int) -> Tensor:
        """See ``egosplat.gaussians.loss.Objective``."""
        targets = self._targets.of(int(views.frame[index]))
        # Channels 0 to 2 are colors; the codes of all levels follow.
        codes = image[..., 3:].permute(2, 0, 1).unflatten(0, targets.codes.shape[:2])
        return self._colors.loss(image, views, index) + code_l1(codes, targets, views.weight(index))
