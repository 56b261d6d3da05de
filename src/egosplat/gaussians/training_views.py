"""Photographs with poses, for training and evaluation: the role of each frame, and which pixels are masked."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.arrays import Array, Bools, Ints
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact, open_needed
from egosplat.artifacts.schemas import MASKS, TRANSIENT, shown_pixels
from egosplat.errors import UserError
from egosplat.geometry import Camera
from egosplat.images import resize_mask, shrink_image, shrunk_size

# Memory for the rows of one array [bytes]: 2,000 pictures of 512 x 512 pixels, or 270 of 1408 x 1408.
IN_MEMORY = 1_610_612_736


class StoredRows:
    """Rows of an array, each read when it is first asked for, and kept while there is room in ``IN_MEMORY``."""

    def __init__(self, read: Callable[[int], NDArray]) -> None:
        """Take what returns the row at a position."""
        self._read, self._kept, self._room = read, dict[int, Tensor](), IN_MEMORY

    def __getitem__(self, position: int) -> Tensor:
        """One row on the CPU."""
        row = self._kept.get(position)
        if row is None:
            row = torch.from_numpy(np.array(self._read(position)))
            # Views are visited in random order, once an epoch: which rows are kept does not matter.
            if row.nbytes <= self._room:
                self._kept[position], self._room = row, self._room - row.nbytes
        return row


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
        compression: (1,) of highlights by the camera, see ``egosplat.gaussians.exposure.expose``; None for 0.
        near: tells of (P, 3) points, (P,) bool, whether Gaussians should start there, and not only a few; None for all.
    """

    frame: Ints
    pictures: Tensor | StoredRows
    camera_to_world: Array
    valid: Tensor | None
    transient: Tensor | StoredRows | None
    camera: Camera
    device: torch.device
    log_gain: Tensor | None = None
    compression: Tensor | None = None
    near: Callable[[Array], Bools] | None = None

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
    """Return the paper's 1 - M, (H, W) float32, and 0 outside the lens circle ``valid``; None for ones.
    ``transient`` is bool or floating point, clamped to [0, 1]; a value that is not finite has weight 0."""
    if transient is None:
        return valid
    if transient.dtype == torch.bool:
        static = (~transient).float()
    else:
        # A broken value counts as transient: M = 1.
        static = 1.0 - transient.float().nan_to_num(1.0, 1.0, 1.0).clamp(0.0, 1.0)
    return static if valid is None else valid * static


def split_views(frames: Artifact, poses: Artifact, kept: Bools | None = None) -> tuple[Bools, Bools]:
    """Choose (F,) bool frames with a pose: to train on, among those ``kept``, and held-out ones, which decide
    nothing. UserError if there is none to train on."""
    train, registered = frames.read("train"), poses.read("registered")
    train = train if kept is None else train & kept
    if not (train & registered).any():
        raise UserError(
            f"none of {int(train.sum())} training frames has a pose; see the log of the stage poses"
        )
    # With frames.holdout false, evaluation frames are trained on: scores on them would not be held out.
    return train & registered, frames.read("evaluation") & ~train & registered


def read_views(
    frames: Artifact, poses: Artifact, chosen: Bools, device: torch.device, *, resolution: int | None = None
) -> Views:
    """Read the ``chosen`` (F,) bool frames, all with a pose. Only what the frames' own masks leave out is
    masked. ``resolution`` is the longer side of the views [px]; None keeps the size of the frames."""
    rows = np.flatnonzero(chosen)
    _, full_height, full_width, _ = frames.shape("rgb")
    width, height = shrunk_size(full_width, full_height, resolution)
    # uint8 takes a quarter of float32's memory; ``Views.picture`` converts one at a time.
    pictures = StoredRows(lambda position: shrink_image(frames.row("rgb", rows[position]), resolution))
    # A pixel is valid only if every pixel averaged into it lies inside the lens circle.
    every = frames.read("valid")
    valid = resize_mask(every, width, height)

    def masked(position: int) -> Bools:
        return valid & ~resize_mask(shown_pixels(frames, int(rows[position]), every), width, height)

    camera = Camera.from_matrix(poses.read("intrinsics"), full_width, full_height)
    return Views(
        frame=rows.astype(np.int64),
        pictures=pictures,
        camera_to_world=poses.read("camera_to_world")[rows],
        valid=None if valid.all() else torch.from_numpy(valid).to(device, torch.float32),
        transient=StoredRows(masked) if frames.has("masked") else None,
        camera=camera.scaled_to(width, height),
        device=device,
    )


# Artifact, schema and array, by kind of masking.
_SOURCES = {"initial": ("transient", TRANSIENT, "probability"), "refined": ("masks", MASKS, "refined")}


@dataclass(frozen=True)
class Masking:
    """Probability that a pixel is transient, the paper's M in the weight 1 - M; 1 for pixels that the user masks.

    Attributes:
        artifact, array: transient or masks artifact, None if nothing is transient; name of its (F, H, W) array.
        masked: frames artifact, if masks of single frames came with the recording; else None.
    """

    artifact: Artifact | None
    array: str
    masked: Artifact | None = None

    @property
    def artifacts(self) -> tuple[Artifact, ...]:
        """The artifact, for the provenance of a stage; empty if nothing is transient."""
        return () if self.artifact is None else (self.artifact,)

    def frames(self, rows: NDArray[np.integer]) -> StoredRows | None:
        """Get M of the frames ``rows`` on the CPU: (V, H, W) bool, or float16 in [0, 1]; None if nothing is masked."""
        given = ((self.artifact, self.array), (self.masked, "masked"))
        sources = [(artifact, array) for artifact, array in given if artifact is not None]
        if not sources:
            return None
        dtype = sources[0][0].schema.fields[sources[0][1]].dtype

        def read(position: int) -> NDArray:
            values = [artifact.row(array, rows[position]) for artifact, array in sources]
            return np.maximum.reduce(values, dtype=dtype)

        return StoredRows(read)


def open_masking(kind: str, frames: Artifact, paths: Mapping[str, Path | None]) -> Masking:
    """Open the artifact that a kind of masking needs, of the ``paths`` that a stage is given: ``none``, ``initial`` (M of the
    network) or ``refined`` (M of instances; UserError: the kind is ``auto``, which only the workflow resolves; or the artifact is
    missing, unreadable or made from other frames)."""
    masked = frames if frames.has("masked") else None
    if kind == "none":
        return Masking(None, "", masked)
    if kind == "auto":
        raise UserError(
            "splats.masking = auto: only the workflow resolves it, from survey.json; "
            "here set it to none or refined"
        )
    name, schema, array = _SOURCES[kind]
    [artifact] = open_needed(f"splats.masking = {kind}", (paths.get(f"{name}_path"), schema))
    check_made_from(artifact, frames, axes=("frame", "height", "width"))
    return Masking(artifact, array, masked)
