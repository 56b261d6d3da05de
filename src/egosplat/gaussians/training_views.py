"""Photographs with poses: what Gaussians are trained on and measured against."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.reader import Artifact
from egosplat.errors import UserError
from egosplat.gaussians.pixel_weights import Masking
from egosplat.geometry import Camera

Mask = NDArray[np.bool_]

_ASIDE_EVERY = 8
"""The middle one of every eight training frames is set aside, where something is decided by frames not trained on."""


@dataclass(frozen=True)
class Views:
    """V photographs of one camera.

    Attributes:
        frame: (V,) int64 index of each in frames.zarr.
        pictures: (V, H, W, 3) uint8 sRGB, in the CPU's memory.
        camera_to_world: (V, 4, 4) float64, OpenCV axes, metres.
        valid: (H, W) float32, 0 outside the lens circle and 1 inside; None where all pixels are valid.
        transient: (V, H, W) bool, or float16 in [0, 1], in the CPU's memory: the paper's M; None where nothing moves.
        camera: of all photographs.
        device: where ``picture``, ``valid`` and ``weight`` are.
    """

    frame: NDArray[np.int64]
    pictures: Tensor
    camera_to_world: NDArray[np.float64]
    valid: Tensor | None
    transient: Tensor | None
    camera: Camera
    device: torch.device

    def __len__(self) -> int:
        return len(self.frame)

    def picture(self, index: int) -> Tensor:
        """(H, W, 3) float32 in [0, 1] on ``device``."""
        return self.pictures[index].to(self.device).float().div_(255.0)

    def weight(self, index: int) -> Tensor | None:
        """(H, W) float32 weight of each pixel in a loss, 1 - M within the lens circle; None for ones."""
        transient = None if self.transient is None else self.transient[index].to(self.device)
        return pixel_weight(self.valid, transient)


def pixel_weight(valid: Tensor | None, transient: Tensor | None) -> Tensor | None:
    """The paper's 1 - M, and 0 outside the lens circle; None for ones.

    Args:
        valid: (H, W) float32; None where all pixels are valid.
        transient: (H, W) bool or floating point, clamped to [0, 1]; None where nothing moves. What is not finite
            weighs 0.
    """
    if transient is None:
        return valid
    static = 1.0 - transient.float().nan_to_num(1.0, 1.0, 1.0).clamp(0.0, 1.0)
    return static if valid is None else valid * static


@dataclass(frozen=True)
class Split:
    """Which frames do what; all need a pose. (F,) bool each, disjoint.

    Attributes:
        training: are trained on.
        validation: decide when to stop; none without early stopping.
        held_out: evaluation frames that are not training frames: they are measured and decide nothing.
    """

    training: Mask
    validation: Mask
    held_out: Mask


def split_views(train: Mask, evaluation: Mask, registered: Mask, *, validate: bool) -> Split:
    """Give each frame its role.

    Args:
        train, evaluation: (F,) bool of frames.zarr.
        registered: (F,) bool of poses.zarr.
        validate: whether to set training frames aside for validation: every eighth, one at least.

    Raises:
        UserError: no training frame has a pose, or setting one aside would leave none.
    """
    training = train & registered
    validation = np.zeros_like(training)
    rows = np.flatnonzero(training)
    if not len(rows):
        raise UserError(
            f"none of {int(train.sum())} training frames has a pose; look at the log of the stage poses"
        )
    if validate:
        validation = set_aside(training, "splats.patience", "0")
    return Split(training & ~validation, validation, evaluation & ~train & registered)


def set_aside(training: Mask, key: str, instead: str) -> Mask:
    """(F,) bool: every eighth of the training frames (F,), one at least.

    Args:
        training: the frames to choose from.
        key: what asks for it, and ``instead`` what to set it to where it cannot be had, for messages.

    Raises:
        UserError: setting one aside would leave none.
    """
    rows = np.flatnonzero(training)
    if len(rows) < 2:
        raise UserError(
            f"{key}: needs 2 training frames with a pose, there is {len(rows)}; set it to {instead}"
        )
    aside = rows[_ASIDE_EVERY // 2 :: _ASIDE_EVERY]
    chosen = np.zeros_like(training)
    chosen[aside if len(aside) else rows[len(rows) // 2]] = True
    return chosen


def read_views(
    frames: Artifact, poses: Artifact, chosen: Mask, masking: Masking, device: torch.device
) -> Views:
    """Read the frames at ``chosen`` (F,) bool, all of which have a pose, into memory."""
    rows = np.flatnonzero(chosen)
    _, height, width, _ = frames.shape("rgb")
    pictures = np.empty((len(rows), height, width, 3), np.uint8)
    for position, row in enumerate(rows):
        pictures[position] = frames.row("rgb", row)
    return Views(
        frame=rows.astype(np.int64),
        pictures=torch.from_numpy(pictures),
        camera_to_world=poses.read("camera_to_world")[rows],
        valid=read_valid(frames, device),
        transient=masking.frames(rows),
        camera=Camera.from_matrix(poses.read("intrinsics"), width, height),
        device=device,
    )


def read_valid(frames: Artifact, device: torch.device) -> Tensor | None:
    """(H, W) float32, 0 outside the lens circle; None where all pixels are valid."""
    valid = torch.from_numpy(frames.read("valid"))
    return None if bool(valid.all()) else valid.to(device, torch.float32)
