"""Photographs with poses, for training and evaluation, and the role of each frame."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.frames import shown_pixels
from egosplat.artifacts.reader import Artifact
from egosplat.errors import UserError
from egosplat.gaussians.stored_rows import StoredRows, stored_rows
from egosplat.geometry import Camera
from egosplat.images import resize_mask, shrink_image, shrunk_size

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Views:
    """V photographs of one camera.

    Attributes:
        frame: (V,) int64 index of each in frames.zarr.
        pictures: (V, H, W, 3) uint8 sRGB, in CPU memory or read from the artifact at each access.
        camera_to_world: (V, 4, 4) float64, OpenCV axes, meters.
        valid: (H, W) float32, 0 outside the lens circle and 1 inside; None if all pixels are valid.
        transient: (V, H, W) bool, or float16 in [0, 1], like ``pictures``: the paper's M; None if nothing is masked.
        device: device of ``picture``, ``valid`` and ``weight``.
        log_gain: (V, 3) natural logarithm of the gains that a render gets before it is compared; None for 0.
        compression: (1,) of highlights by the camera, see ``egosplat.gaussians.exposure.exposed``; None for 0.
    """

    frame: NDArray[np.int64]
    pictures: Tensor | StoredRows
    camera_to_world: NDArray[np.float64]
    valid: Tensor | None
    transient: Tensor | StoredRows | None
    camera: Camera
    device: torch.device
    log_gain: Tensor | None = None
    compression: Tensor | None = None

    def __len__(self) -> int:
        return len(self.frame)

    def picture(self, index: int) -> Tensor:
        """(H, W, 3) float32 in [0, 1] on ``device``."""
        return self.pictures[index].to(self.device).float().div_(255.0)

    def weight(self, index: int) -> Tensor | None:
        """Return the (H, W) float32 loss weight of each pixel, 1 - M inside the lens circle; None for ones."""
        transient = None if self.transient is None else self.transient[index].to(self.device)
        return pixel_weight(self.valid, transient)


def pixel_weight(valid: Tensor | None, transient: Tensor | None) -> Tensor | None:
    """Return the paper's 1 - M, and 0 outside the lens circle; None for ones.

    Args:
        valid: (H, W) float32; None if all pixels are valid.
        transient: (H, W) bool or floating point, clamped to [0, 1]; None if nothing is masked. A value that is not
            finite has weight 0.
    """
    if transient is None:
        return valid
    # A broken value counts as transient: M = 1.
    static = 1.0 - transient.float().nan_to_num(1.0, 1.0, 1.0).clamp(0.0, 1.0)
    return static if valid is None else valid * static


@dataclass(frozen=True)
class Split:
    """Role of each frame; frames with a role have a pose. (F,) bool each, disjoint.

    Attributes:
        training: frames to train on.
        held_out: evaluation frames outside the training frames; they are scored and decide nothing.
    """

    training: Mask
    held_out: Mask


def split_views(train: Mask, evaluation: Mask, registered: Mask) -> Split:
    """Assign each frame its role.

    Args:
        train, evaluation: (F,) bool of frames.zarr.
        registered: (F,) bool of poses.zarr.

    Raises:
        UserError: no training frame has a pose.
    """
    training = train & registered
    if not training.any():
        raise UserError(
            f"none of {int(train.sum())} training frames has a pose; see the log of the stage poses"
        )
    # With frames.holdout false, evaluation frames are trained on: scores on them would not be held out.
    return Split(training, evaluation & ~train & registered)


def read_views(
    frames: Artifact, poses: Artifact, chosen: Mask, device: torch.device, *, resolution: int | None = None
) -> Views:
    """Read frames, as many as ``stored_rows`` holds in memory. Only what the frames' own masks leave out is masked.

    Args:
        frames, poses: artifacts.
        chosen: (F,) bool frames to read. All have a pose.
        device: of the views.
        resolution: longer side of the views [pixels]; None keeps the size of the frames.
    """
    rows = np.flatnonzero(chosen)
    _, full_height, full_width, _ = frames.shape("rgb")
    width, height = shrunk_size(full_width, full_height, resolution)
    # uint8 takes a quarter of float32's memory; ``Views.picture`` converts one at a time.
    pictures = stored_rows(
        len(rows),
        (height, width, 3),
        "uint8",
        lambda position: shrink_image(frames.row("rgb", rows[position]), resolution),
    )
    # A pixel is valid only if every pixel averaged into it lies inside the lens circle.
    every = frames.read("valid")
    valid = resize_mask(every, width, height)

    def masked(position: int) -> Mask:
        return valid & ~resize_mask(shown_pixels(frames, int(rows[position]), every), width, height)

    camera = Camera.from_matrix(poses.read("intrinsics"), full_width, full_height)
    return Views(
        frame=rows.astype(np.int64),
        pictures=pictures,
        camera_to_world=poses.read("camera_to_world")[rows],
        valid=valid_weight(valid, device),
        transient=stored_rows(len(rows), (height, width), "bool", masked) if frames.has("masked") else None,
        camera=camera.scaled_to(width, height),
        device=device,
    )


def valid_weight(valid: Mask, device: torch.device) -> Tensor | None:
    """Return the (H, W) float32 weight of the lens circle ``valid`` (H, W), 0 outside; None if all pixels are valid."""
    return None if valid.all() else torch.from_numpy(valid).to(device, torch.float32)
