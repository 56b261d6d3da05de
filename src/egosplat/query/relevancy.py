"""Relevancy of features to queries (paper, "Open-Vocabulary Querying"; LERF; docs/method.md#relevancy)."""

from collections.abc import Iterable, Iterator

import torch
from torch import Tensor

from egosplat.compute import all_finite
from egosplat.language.decoder import Decoder, decode, project
from egosplat.query.text import Texts

# Values of the decoder's widest layer held at a time: 1 MiB of float32 fit a processor's cache.
_NUMBERS_AT_ONCE = 2**18

# The (S,) indices of codes, their (S, r) features, and how the best canonical phrase fits these, (S, 1); kept for the last canonical
# phrases.
Decoded = tuple[Tensor, Tensor, Tensor]
Kept = dict[Tensor, list[Decoded]]


def relevancy(features: Tensor, texts: Texts, temperature: float) -> Tensor:
    """(..., Q) float32 relevancy to queries: ``sigmoid(t (s_q - s_c))``, 0.5 where the best canonical phrase c fits as well; s
    are inner products.

    (..., D) features have unit norm; where there is none, zeros or non-finite values, relevancy is 0.
    """
    # Halves would move a relevancy by 0.08 at a temperature of 10,000.
    features = features.to(torch.promote_types(features.dtype, torch.float32))
    usual = _usual(features, texts.canonical.to(features))
    return _over(features @ texts.queries.to(features).T, usual, temperature)


def _usual(features: Tensor, canonical: Tensor) -> Tensor:
    """(..., 1) inner products with the best canonical phrase; infinite where there is no feature."""
    best = (features @ canonical.T).amax(dim=-1, keepdim=True)
    # The norm is 1 or 0, and a comparison with NaN is false.
    has_feature = (features.square().sum(dim=-1, keepdim=True) - 1.0).abs() < 0.5
    return torch.where(has_feature, best, torch.inf)


def _over(fits: Tensor, usual: Tensor, temperature: float) -> Tensor:
    """(..., Q) relevancy by (..., Q) and (..., 1) inner products with queries and the best canonical phrase."""
    # The paper takes the minimum over canonical phrases c of exp(t s_q) / (exp(t s_q) + exp(t s_c)). The sigmoid of the
    # difference is equal and does not overflow.
    return torch.where(usual < torch.inf, torch.sigmoid(temperature * (fits - usual)), 0.0)


@torch.inference_mode()
def relevancy_maps(
    codes: Tensor, seen: Tensor, decoder: Decoder, texts: Texts, temperature: float, kept: Kept | None = None
) -> Tensor:
    """(Q, L, H, W) float32 relevancy of rendered (L, H, W, C) codes, divided by their coverage, to Q queries, on the codes' device;
    0 where (L, H, W) bool ``seen`` is false. ``kept`` keeps what codes decode to, for further queries (ValueError: a code is not finite)."""
    maps = torch.zeros(len(texts.phrases), seen.numel(), device=codes.device)
    if not texts.phrases:
        return maps.reshape(len(texts.phrases), *seen.shape)
    decoded: Iterable[Decoded] = _decoded(codes, seen, decoder, texts)
    if kept is not None and texts.canonical not in kept:
        kept.clear()
        kept[texts.canonical] = [*decoded]
    decoded = decoded if kept is None else kept[texts.canonical]
    queries = project(texts.queries.to(maps), decoder.folded[1])
    for chosen, features, usual in decoded:
        maps.index_copy_(1, chosen, _over(features @ queries.T, usual, temperature).T)
    return maps.reshape(len(texts.phrases), *seen.shape)


def _decoded(codes: Tensor, seen: Tensor, decoder: Decoder, texts: Texts) -> Iterator[Decoded]:
    """Decode what is seen, a few thousand codes at a time."""
    rows, (folded, basis) = codes.reshape(-1, codes.shape[-1]), decoder.folded
    if not all_finite(rows):
        raise ValueError("codes hold numbers that are not finite")
    canonical = project(texts.canonical.to(rows), basis)
    for chosen in seen.flatten().nonzero()[:, 0].split(_NUMBERS_AT_ONCE // max(folded.widths)):
        features = decode(rows[chosen], folded)
        yield chosen, features, _usual(features, canonical)
