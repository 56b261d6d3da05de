"""A decoder that answers given questions with fewer numbers.

A decoder's last layer makes D channels of H, so that all its features lie in a subspace of at most H + 1 dimensions.
With the QR decomposition of [weights | biases], f = Q (R [h; 1]); the columns of Q are orthonormal, hence
|f| = |R [h; 1]| and x·f = (Qᵀx)·(R [h; 1]). Cosines of features with given directions are thereby had without making
the features: of a linear basis of 16 codes for 512 channels, with 17 numbers a pixel.
"""

import numpy as np
import torch
from torch import Tensor

from egosplat.codes.decoder import Decoder


def fold(decoder: Decoder, directions: Tensor) -> tuple[Decoder, Tensor]:
    """A decoder of r = min(D, H + 1) channels with the same cosines.

    Args:
        decoder: of features of D channels, from H in its last layer.
        directions: (K, D) float32.

    Returns:
        folded: gives (..., r) unit features g of the codes that ``decoder`` gives (..., D) unit features f of.
        projected: (K, r) float32 such that projected · g = directions · f; in general shorter than the directions.

    Raises:
        ValueError: directions are of another length than the features.
    """
    if directions.ndim != 2 or directions.shape[1] != decoder.widths[-1]:
        raise ValueError(f"directions {tuple(directions.shape)} are not of {decoder.widths[-1]} channels")
    if len(decoder.widths) == 1 or decoder.widths[-2] + 1 >= decoder.widths[-1]:
        return decoder, directions
    *before, hidden, channels = decoder.widths
    last = channels * (hidden + 1)
    weights, biases = np.split(decoder.values[-last:].astype(np.float64), [channels * hidden])
    q, r = np.linalg.qr(np.column_stack([weights.reshape(channels, hidden), biases]))
    values = [decoder.values[:-last], r[:, :hidden].ravel(), r[:, hidden]]
    folded = Decoder((*before, hidden, len(r)), np.concatenate(values).astype(np.float32))
    projected = directions.double() @ torch.from_numpy(q).to(directions.device)
    return folded, projected.to(directions.dtype)
