"""Draw the label maps of frames, and hold those of a whole video in memory, compressed."""

import os
import zlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

Labels = NDArray[np.int32]

# By frame: start, length and CRC-32 of its labels in the file of a checkpoint.
LabelState = dict[int, list[int]]

# 128 MiB of float32 logits at the frames' size.
_PIXELS_AT_ONCE = 2**25


class DamagedLabels(Exception):
    """The file of a checkpoint does not hold the labels of its state."""


class LabelMaps:
    """(F, L, H, W) int32 labels, -1 for none; written and read by frame.

    Attributes:
        path: file to which checkpoints append; None without checkpoints.
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self.path: Path | None = None
        self._shape = shape
        self._frames: dict[int, bytes] = {}
        # Frames that the file does not hold yet, and where it holds the others.
        self._changed: set[int] = set()
        self._places: LabelState = {}

    def __len__(self) -> int:
        return len(self._frames)

    def __setitem__(self, frame: int, labels: Labels) -> None:
        self._frames[frame] = pack(labels)
        self._changed.add(frame)

    def leave_empty(self, frames: Iterable[int]) -> None:
        """Let frames have no label."""
        self._frames |= dict.fromkeys(frames, pack(np.full(self._shape, -1, np.int32)))

    def __getitem__(self, frame: int) -> Labels:
        return unpack(self._frames[frame], self._shape)

    def state_dict(self) -> LabelState:
        """Append the frames set since the last call to ``path``: start, length and CRC-32 of each frame in the file."""
        assert self.path is not None, "only labels with a path have checkpoints"
        self.path.parent.mkdir(parents=True, exist_ok=True)
        # What a killed process appended after its last state is cut off.
        end = max((start + length for start, length, _ in self._places.values()), default=0)
        places = dict(self._places)
        with self.path.open("r+b" if end else "wb") as file:
            file.truncate(end)
            file.seek(end)
            for frame in sorted(self._changed):
                packed = self._frames[frame]
                places[frame] = [file.tell(), len(packed), zlib.crc32(packed)]
                file.write(packed)
            file.flush()
            os.fsync(file.fileno())
        self._places, self._changed = places, set()
        return dict(places)

    def load_state_dict(self, state: LabelState) -> None:
        """Replace the content by that of the file when ``state_dict`` returned ``state``; DamagedLabels if it is lost."""
        assert self.path is not None, "only labels with a path have checkpoints"
        content = self.path.read_bytes() if self.path.exists() else b""
        frames = {frame: content[start : start + length] for frame, (start, length, _) in state.items()}
        if any(zlib.crc32(frames[frame]) != crc for frame, (_, _, crc) in state.items()):
            raise DamagedLabels(f"{self.path}: the checkpoint is damaged; the stage starts again")
        self._frames, self._places, self._changed = frames, dict(state), set()


def pack(labels: Labels) -> bytes:
    """Compress label maps."""
    # They have long runs of one value: level 1, the fastest, already reduces them to about 1 %.
    return zlib.compress(np.ascontiguousarray(labels, dtype=np.int32).tobytes(), 1)


def unpack(packed: bytes, shape: tuple[int, int, int]) -> Labels:
    """Get back label maps of a shape."""
    return np.frombuffer(zlib.decompress(packed), dtype=np.int32).reshape(shape).copy()


def paint(
    objects: Iterable[tuple[list[int], Tensor]], valid: NDArray[np.bool_], device: torch.device
) -> Labels:
    """(H, W) int32 object of the highest of its groups' (K, M, M) logits above 0; -1 for none, and where not ``valid``."""
    best = torch.zeros(valid.shape, device=device)
    labels = torch.full(valid.shape, -1, dtype=torch.int32, device=device)
    # Logits are enlarged for a few objects at a time, which bounds the memory.
    step = max(1, _PIXELS_AT_ONCE // valid.size)
    for ids, logits in objects:
        numbers = torch.tensor(ids, dtype=torch.int32, device=device)
        if device.type == "cpu":
            # Most tracked objects are absent from a frame: enlarged, they would paint nothing. A GPU would have to wait.
            present = (logits > 0).flatten(1).any(1)
            numbers, logits = numbers[present], logits[present]
        for first in range(0, len(numbers), step):
            some = logits[first : first + step, None]
            large = F.interpolate(some, valid.shape, mode="bilinear", align_corners=False)[:, 0]
            highest, which = large.max(dim=0)
            better = highest > best  # the first group wins ties
            best = torch.where(better, highest, best)
            labels = torch.where(better, numbers[first : first + step][which], labels)
    labels[torch.from_numpy(~valid).to(device)] = -1
    return labels.cpu().numpy()
