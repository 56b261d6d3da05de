"""How well what is seen fits what is asked for (paper, "Open-Vocabulary Querying"; LERF; docs/method.md#relevancy)."""

import numpy as np
import torch
from torch import Tensor

from egosplat.codes.decoder import Decoder, decode
from egosplat.query.text import Texts


def fold(decoder: Decoder, directions: Tensor) -> tuple[Decoder, Tensor]:
    """A decoder of r = min(D, H + 1) channels with the same cosines, for any features that it decodes.

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
    # The last layer maps H numbers h to D channels, f = W [h; 1], so f lies in at most H + 1 dimensions. With W = Q R,
    # where the columns of Q are orthonormal, |f| = |R [h; 1]| and x·f = (Qᵀx)·(R [h; 1]): cosines need r numbers a
    # pixel, 17 in place of 512 for a linear basis of 16 codes.
    *before, hidden, channels = decoder.widths
    last = channels * (hidden + 1)
    weights, biases = np.split(decoder.values[-last:].astype(np.float64), [channels * hidden])
    q, r = np.linalg.qr(np.column_stack([weights.reshape(channels, hidden), biases]))
    values = [decoder.values[:-last], r[:, :hidden].ravel(), r[:, hidden]]
    folded = Decoder((*before, hidden, len(r)), np.concatenate(values).astype(np.float32))
    projected = directions.double() @ torch.from_numpy(q).to(directions.device)
    return folded, projected.to(directions.dtype)


_NUMBERS_AT_ONCE = 2**18
"""Of the widest layer of a decoder, in float32: 1 MiB, which stay in a processor's cache."""


def relevancy(features: Tensor, queries: Tensor, canonical: Tensor, temperature: float) -> Tensor:
    """Relevancy of features to queries: ``sigmoid(t (s_q - max_c s_c))``.

    That is the paper's minimum over the canonical phrases c of exp(t s_q) / (exp(t s_q) + exp(t s_c)), without an
    exponential that could overflow. It is 0.5 where the query fits as well as the best canonical phrase.

    Args:
        features: (..., D) floats of unit norm; zeros, or numbers that are not finite, where there is none. Halves are
            widened: they would move a relevancy by 0.08 at a temperature of 10,000.
        queries: (Q, D) float32; s_q is the inner product.
        canonical: (K, D) float32, K at least 1.
        temperature: t.

    Returns:
        (..., Q) float32 in [0, 1]; 0 where there is no feature.
    """
    wide = torch.promote_types(features.dtype, torch.float32)
    features, queries, canonical = features.to(wide), queries.to(wide), canonical.to(wide)
    fits = features @ queries.T - (features @ canonical.T).amax(dim=-1, keepdim=True)
    # Of unit norm or of none, and a comparison with NaN is false.
    there = (features.square().sum(dim=-1, keepdim=True) - 1.0).abs() < 0.5
    return torch.where(there, torch.sigmoid(temperature * fits), 0.0)


@torch.inference_mode()
def relevancy_maps(codes: Tensor, seen: Tensor, decoder: Decoder, texts: Texts, temperature: float) -> Tensor:
    """Relevancy of rendered codes to all queries; features are never held for more than a few thousand pixels.

    Args:
        codes: (L, H, W, C) float32, of full weight (divided by what they were weighted with).
        seen: (L, H, W) bool, on the same device; other pixels are not decoded.
        decoder: of the codes.
        texts: Q queries and what they are compared with.
        temperature: see ``relevancy``.

    Returns:
        (Q, L, H, W) float32 in [0, 1], on the codes' device; 0 where nothing is seen or a feature vanishes.

    Raises:
        ValueError: a code is not finite, or shapes do not belong together.
    """
    if codes.ndim != 4 or seen.shape != codes.shape[:-1]:
        raise ValueError(f"codes {tuple(codes.shape)} and seen {tuple(seen.shape)} do not belong together")
    if not codes.isfinite().all():
        raise ValueError("codes hold numbers that are not finite")
    count = len(texts.phrases)
    maps = torch.zeros(count, seen.numel(), device=codes.device)
    if not count:
        return maps.reshape(count, *seen.shape)
    folded, directions = fold(decoder, torch.cat([texts.queries, texts.canonical]).to(codes))
    rows = codes.reshape(-1, codes.shape[-1])
    for chosen in seen.flatten().nonzero()[:, 0].split(_NUMBERS_AT_ONCE // max(folded.widths)):
        features = decode(rows[chosen], folded)
        maps[:, chosen] = relevancy(features, directions[:count], directions[count:], temperature).T
    return maps.reshape(count, *seen.shape)
