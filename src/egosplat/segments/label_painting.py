"""From the logits of many objects to one label a pixel."""

from collections.abc import Iterable

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

_PIXELS_AT_ONCE = 2**25


def paint(
    objects: Iterable[tuple[list[int], Tensor]], valid: NDArray[np.bool_], device: torch.device
) -> NDArray[np.int32]:
    """The object of the highest logit at each pixel, where any is above 0.

    Args:
        objects: numbers of K objects with their (K, M, M) logits, in groups.
        valid: (H, W) bool; other pixels get no label.

    Returns:
        (H, W) int32, -1 for none.
    """
    best = torch.zeros(valid.shape, device=device)
    labels = torch.full(valid.shape, -1, dtype=torch.int32, device=device)
    step = max(1, _PIXELS_AT_ONCE // valid.size)
    for ids, logits in objects:
        numbers = torch.tensor(ids, dtype=torch.int32, device=device)
        for first in range(0, len(ids), step):
            some = logits[first : first + step, None]
            large = F.interpolate(some, valid.shape, mode="bilinear", align_corners=False)[:, 0]
            highest, which = large.max(dim=0)
            better = highest > best
            best = torch.where(better, highest, best)
            labels = torch.where(better, numbers[first : first + step][which], labels)
    labels[torch.from_numpy(~valid).to(device)] = -1
    return labels.cpu().numpy()
