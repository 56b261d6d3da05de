"""Dense features of whole frames that regularise a field: SAM2's image encoder in place of DINO, which LERF uses."""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.models.image_encoder import encode
from egosplat.models.sam2_loader import Sam2
from egosplat.progress import track

# Most principal components that are kept.
COMPONENTS = 64

# Most frames that the principal components are computed from.
_FRAMES = 32


def image_maps(
    sam2: Sam2, images: Callable[[int], NDArray[np.uint8]], rows: NDArray[np.integer]
) -> tuple[NDArray[np.float16], float]:
    """Encode frames at SAM2's coarsest resolution, one sixteenth of its square, and keep the principal components.

    Args:
        images: returns the (H, W, 3) uint8 image of a frame.
        rows: (V,) frames.

    Returns:
        (V, h, w, K) float16: components of the channels, each channel of mean 0 and variance 1 over the scene; and
        the part of the variance that they keep.
    """
    few = rows[np.linspace(0, len(rows) - 1, min(len(rows), _FRAMES)).astype(int)]
    sample = torch.cat([_map(sam2, images(row)).flatten(0, 1) for row in few]).double()
    mean, deviation = sample.mean(dim=0), sample.std(dim=0)
    # A channel that never changes says nothing.
    scale = torch.where(deviation > 1e-6 * (1 + mean.abs()), 1 / deviation.clamp(min=1e-12), 0.0)
    basis, kept = principal_components((sample - mean) * scale, COMPONENTS)
    found = []
    for row in track(rows, "encoding frames with SAM2"):
        values = (_map(sam2, images(row)).double() - mean) * scale
        found.append((values @ basis).numpy().astype(np.float16))
    return np.stack(found), kept


def principal_components(centered: Tensor, count: int) -> tuple[Tensor, float]:
    """(C, K) directions of largest variance of (R, C) float64 rows of mean 0, K <= ``count``, and their part of it."""
    values, vectors = torch.linalg.eigh(centered.T @ centered)
    chosen = vectors.flip(1)[:, :count]
    # The sign of an eigenvector is arbitrary: its largest number is positive.
    largest = chosen.gather(0, chosen.abs().argmax(dim=0, keepdim=True))
    total = float(values.clamp(min=0).sum())
    kept = float(values.clamp(min=0).flip(0)[:count].sum()) / total if total > 0 else 1.0
    return chosen * largest.sign(), kept


def _map(sam2: Sam2, image: NDArray[np.uint8]) -> Tensor:
    """(h, w, C) float32 on the CPU."""
    with sam2.compute.inference():
        return encode(sam2, image).image(-1)[0].permute(1, 2, 0).float().cpu()
