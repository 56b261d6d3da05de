"""Which Gaussians the recording's frames show, in bytes."""

import numpy as np
from numpy.typing import NDArray

from egosplat.images import evenly_spaced
from egosplat.viewing.container import Arrays, Facts

# Largest number of views on the page, evenly spaced among those of the scene's index.
MOST_VIEWS = 32

# The smallest share of a view that is stored, and the factor between two bytes.
SMALLEST, STEP = 1e-6, 1.06

# The same for the mean over all views, which may be smaller.
SMALLEST_MEAN = 1e-7


def pack_visibility(shares: NDArray[np.float32], frame: NDArray[np.int64]) -> tuple[Arrays, Facts]:
    """Quantize the shares of views that Gaussians fill, on a logarithmic scale.

    Args:
        shares: (V, N) of ``egosplat.query.scene_query.visible_shares``.
        frame: (V,) frames of the views.

    Returns:
        ``visible`` (N,) uint8 mean over all views; ``seen`` (W, ceil(N / 8)) uint8 bits, the first of a byte highest, of the
        Gaussians that W views show; ``seen_share`` uint8 share of each bit that is set, view after view.
    """
    chosen = evenly_spaced(len(frame), MOST_VIEWS)
    shown = shares[chosen] >= SMALLEST
    arrays = {
        "visible": to_bytes(shares.mean(axis=0), SMALLEST_MEAN),
        "seen": np.packbits(shown, axis=1),
        "seen_share": to_bytes(shares[chosen][shown], SMALLEST),
    }
    facts = {
        "seen_frames": frame[chosen].tolist(),
        "share_step": STEP,
        "share_smallest": SMALLEST,
        "mean_smallest": SMALLEST_MEAN,
    }
    return arrays, facts


def to_bytes(values: NDArray[np.float32], smallest: float) -> NDArray[np.uint8]:
    """Byte b >= 1 means ``smallest * STEP ** (b - 1)``; 0 means less than ``smallest``."""
    steps = np.log(np.maximum(values, smallest) / smallest) / np.log(STEP)
    return np.where(values >= smallest, np.rint(steps).clip(0, 254) + 1, 0).astype(np.uint8)
