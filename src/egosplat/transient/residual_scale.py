"""Residual of the temporary Gaussians after the warm-up: the unit of the penalty, and the pixels that stand out."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

# A pixel stands out if its squared difference is larger than this many medians of its frame. In ten synthetic apartments
# the median of moving pixels is 3 to 12 medians, and that of static ones 1 (benchmarks/transient/README.md).
STANDS_OUT = 3.5

# Variance of rounding to 8 bits: a smaller residual says nothing about the scene.
LEAST_SCALE = (1 / 255) ** 2 / 12


class ResidualScale:
    """Residuals of V views while the Gaussians are trained on all pixels, those that move too.

    Attributes:
        scale: (V,) float32 median squared difference of each view; NaN if it was not measured.
    """

    def __init__(self, device: torch.device) -> None:
        """Start without views; their number and size follow from the first measurement."""
        self.scale = torch.empty(0, device=device)
        # A bit a pixel: 3,600 views of 1408 x 1408 pixels take 0.9 GB.
        self._stands_out = torch.empty((0, 0), dtype=torch.uint8, device=device)
        self._size = 0, 0
        self._measured: set[int] = set()

    def has(self, index: int) -> bool:
        """Whether view ``index`` was measured."""
        return index in self._measured

    @torch.no_grad()
    def measure(self, index: int, views: int, residual: Tensor, shown: Tensor | None) -> None:
        """Replace the measurement of one view.

        Args:
            index, views: number of the view, and of all views.
            residual: (H, W) squared difference to the render; a value that is not finite is left out.
            shown: (H, W), above 0 where the view shows the scene; None for everywhere.
        """
        if not len(self.scale):
            self.scale = residual.new_full((views,), torch.nan)
            self._stands_out = residual.new_zeros((views, -(-residual.numel() // 8)), dtype=torch.uint8)
            self._size = residual.shape[0], residual.shape[1]
        counts = residual.isfinite() if shown is None else residual.isfinite() & (shown > 0)
        # NaN instead of a selection, whose unknown size would make the CPU wait for a GPU.
        residual = torch.where(counts, residual, torch.nan)
        self.scale[index] = residual.nanmedian()
        self._stands_out[index] = pack(residual > STANDS_OUT * self.scale[index].clamp_min(LEAST_SCALE))
        self._measured.add(index)

    def stands_out(self, index: int) -> NDArray[np.bool_]:
        """(H, W) pixels whose squared difference exceeds ``STANDS_OUT`` scales of their view."""
        height, width = self._size
        bits = np.unpackbits(self._stands_out[index].cpu().numpy(), count=height * width)
        return bits.astype(bool).reshape(height, width)

    def unit(self, index: int) -> Tensor:
        """() residual of static pixels in a view: the median of the view or of all views, whichever is larger.

        A view that is blurred or of another exposure has a larger median, and is not transient as a whole. A view
        that is easy to render has a smaller one, and the scene's median holds.
        """
        # fmax and nanmedian leave out NaN.
        return torch.fmax(self.scale[index], self.scale.nanmedian()).nan_to_num(0.0).clamp_min(LEAST_SCALE)

    def state_dict(self) -> dict[str, Any]:
        """Return the state for ``load_state_dict``."""
        return {
            "scale": self.scale,
            "stands_out": self._stands_out,
            "size": list(self._size),
            "measured": sorted(self._measured),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state from ``state_dict``."""
        self.scale, self._stands_out = state["scale"], state["stands_out"]
        self._size = state["size"][0], state["size"][1]
        self._measured = set(state["measured"])


def pack(flags: Tensor) -> Tensor:
    """(H, W) bool as (ceil(H W / 8),) uint8 on the same device, in the order of ``numpy.packbits``."""
    bits = torch.nn.functional.pad(flags.flatten().to(torch.uint8), (0, -flags.numel() % 8)).reshape(-1, 8)
    places = torch.arange(7, -1, -1, dtype=torch.uint8, device=flags.device)
    return torch.bitwise_left_shift(bits, places).sum(dim=1, dtype=torch.uint8)
