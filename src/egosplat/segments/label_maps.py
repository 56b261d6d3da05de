"""Label maps of a whole video, small enough to hold: compressed, a frame at a time."""

import zlib

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

Labels = NDArray[np.int32]


class LabelMaps:
    """(F, L, H, W) int32 labels, -1 for none; written and read by frame."""

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self._shape = shape
        self._frames: dict[int, bytes] = {}

    def __len__(self) -> int:
        return len(self._frames)

    def __setitem__(self, frame: int, labels: Labels) -> None:
        # Long runs of one value: the fastest level takes them to a hundredth.
        self._frames[frame] = zlib.compress(np.ascontiguousarray(labels, dtype=np.int32).tobytes(), 1)

    def __getitem__(self, frame: int) -> Labels:
        return np.frombuffer(zlib.decompress(self._frames[frame]), dtype=np.int32).reshape(self._shape).copy()

    def state_dict(self) -> dict[int, Tensor]:
        """The compressed frames, as (N,) uint8."""
        return {
            frame: torch.frombuffer(bytearray(packed), dtype=torch.uint8)
            for frame, packed in self._frames.items()
        }

    def load_state_dict(self, state: dict[int, Tensor]) -> None:
        """Take what ``state_dict`` gave in place of all that is there."""
        self._frames = {frame: packed.numpy().tobytes() for frame, packed in state.items()}
