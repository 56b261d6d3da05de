"""Relevancy of features to queries (paper, "Open-Vocabulary Querying"; LERF; docs/method.md#relevancy)."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from egosplat.compute import all_finite
from egosplat.language.decoder import Decoder, decode
from egosplat.query.text import Texts

# Values of the decoder's widest layer held at a time: 1 MiB of float32 fit a processor's cache.
_NUMBERS_AT_ONCE = 2**18


def fold(decoder: Decoder, directions: Tensor) -> tuple[Decoder, Tensor]:
    """Reduce a decoder and (K, D) float32 directions to r = min(D, H + 1) channels, where H is the width of its last hidden layer.

    Inner products stay the same for every code; the (K, r) directions are usually not of unit norm.
    """
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
    widths = (*before, hidden, len(r))
    folded = replace(decoder, widths=widths, values=np.concatenate(values).astype(np.float32))
    projected = directions.double() @ torch.from_numpy(q).to(directions.device)
    return folded, projected.to(directions.dtype)


def relevancy(features: Tensor, queries: Tensor, canonical: Tensor, temperature: float) -> Tensor:
    """(..., Q) float32 relevancy to (Q, D) queries: ``sigmoid(t (s_q - max_c s_c))``, 0.5 where the best of (K, D) canonical
    phrases, K at least 1, fits as well; s are inner products.

    (..., D) features have unit norm; where there is none, zeros or non-finite values, relevancy is 0.
    """
    # Halves would move a relevancy by 0.08 at a temperature of 10,000.
    wide = torch.promote_types(features.dtype, torch.float32)
    features, queries, canonical = features.to(wide), queries.to(wide), canonical.to(wide)
    fits = features @ queries.T - (features @ canonical.T).amax(dim=-1, keepdim=True)
    # The norm is 1 or 0, and a comparison with NaN is false.
    has_feature = (features.square().sum(dim=-1, keepdim=True) - 1.0).abs() < 0.5
    # The paper takes the minimum over canonical phrases c of exp(t s_q) / (exp(t s_q) + exp(t s_c)). The sigmoid of the
    # difference is equal and does not overflow.
    return torch.where(has_feature, torch.sigmoid(temperature * fits), 0.0)


@torch.inference_mode()
def relevancy_maps(codes: Tensor, seen: Tensor, decoder: Decoder, texts: Texts, temperature: float) -> Tensor:
    """(Q, L, H, W) float32 relevancy of rendered (L, H, W, C) codes, divided by their coverage, to Q queries, on the codes'
    device.

    Decodes a few thousand pixels at a time; 0 where (L, H, W) bool ``seen`` is false. ValueError: a code is not finite.
    """
    rows = codes.reshape(-1, codes.shape[-1])
    if not all_finite(rows):
        raise ValueError("codes hold numbers that are not finite")
    count = len(texts.phrases)
    maps = torch.zeros(count, seen.numel(), device=codes.device)
    if count:
        folded, directions = fold(decoder, torch.cat([texts.queries, texts.canonical]).to(codes))
        for chosen in seen.flatten().nonzero()[:, 0].split(_NUMBERS_AT_ONCE // max(folded.widths)):
            features = decode(rows[chosen], folded)
            maps[:, chosen] = relevancy(features, directions[:count], directions[count:], temperature).T
    return maps.reshape(count, *seen.shape)
