"""Draw the label maps of frames, and hold those of a whole video in memory, compressed."""

import zlib
from collections.abc import Iterable

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

Labels = NDArray[np.int32]

# 128 MiB of float32 logits at the frames' size.
_PIXELS_AT_ONCE = 2**25


class LabelMaps:
    """(F, L, H, W) int32 labels, -1 for none; written and read by frame."""

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self._shape = shape
        self._frames: dict[int, bytes] = {}

    def __len__(self) -> int:
        return len(self._frames)

    def __setitem__(self, frame: int, labels: Labels) -> None:
        # Label maps have long runs of one value: level 1, the fastest, already reduces them to about 1 %.
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
        """Replace the content by that of a ``state_dict``."""
        self._frames = {frame: packed.numpy().tobytes() for frame, packed in state.items()}


def paint(
    objects: Iterable[tuple[list[int], Tensor]], valid: NDArray[np.bool_], device: torch.device
) -> NDArray[np.int32]:
    """Label each pixel with the object of the highest logit, if that is above 0.

    Args:
        objects: groups of K instance numbers and their (K, M, M) logits.
        valid: (H, W) bool; other pixels get no label.

    Returns:
        (H, W) int32, -1 for none.
    """
    best = torch.zeros(valid.shape, device=device)
    labels = torch.full(valid.shape, -1, dtype=torch.int32, device=device)
    # Logits are enlarged for a few objects at a time, which bounds the memory.
    step = max(1, _PIXELS_AT_ONCE // valid.size)
    for ids, logits in objects:
        numbers = torch.tensor(ids, dtype=torch.int32, device=device)
        for first in range(0, len(ids), step):
            some = logits[first : first + step, None]
            large = F.interpolate(some, valid.shape, mode="bilinear", align_corners=False)[:, 0]
            highest, which = large.max(dim=0)
            better = highest > best  # the first group wins ties
            best = torch.where(better, highest, best)
            labels = torch.where(better, numbers[first : first + step][which], labels)
    labels[torch.from_numpy(~valid).to(device)] = -1
    return labels.cpu().numpy()
