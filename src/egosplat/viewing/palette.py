"""A palette of codes: each Gaussian stores which entry is nearest to its code, at every level."""

import warnings

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2, vq

from egosplat.language.decoder import Decoder, decode
from egosplat.viewing.container import Arrays

# Entries of a level.
ENTRIES = 512

# Codes that entries are fitted to, and rounds of k-means.
_SAMPLE, _ROUNDS = 20_000, 10

Floats = NDArray[np.float32]


def pack_codes(code: Floats, share: Floats, decoder: Decoder) -> Arrays:
    """Replace (N, L, C) codes with (N, L) shares by the nearest of at most ``ENTRIES`` codes a level, and decode these.

    Returns:
        ``code_index`` (L, N) uint16, ``code_share`` (L, N) uint8 in 1/255, and ``palette`` (L, ENTRIES, D) float16 features
        of unit norm, 0 where an entry is not used.
    """
    levels = code.shape[1]
    index = np.zeros((levels, len(code)), np.uint16)
    palette = np.zeros((levels, ENTRIES, decoder.widths[-1]), np.float16)
    for level in range(levels):
        used = share[:, level] > 0
        if not used.any():
            continue
        entries = fit_palette(code[used, level])
        index[level, used] = vq(code[used, level], entries)[0]
        palette[level, : len(entries)] = decode(torch.from_numpy(entries), decoder).numpy()
    return {
        "code_index": index,
        # A share above 0 stays above 0: without a share, the Gaussian has no code.
        "code_share": np.where(share > 0, np.rint(share * 255).clip(1, 255), 0).astype(np.uint8).T,
        "palette": palette,
    }


def fit_palette(rows: Floats) -> Floats:
    """At most ``ENTRIES`` float32 K-means centers of (M, C) rows; the distinct rows themselves if there are as few."""
    rng = np.random.default_rng(0)
    sample = rows[rng.permutation(len(rows))[:_SAMPLE]]
    if len(distinct := np.unique(sample, axis=0)) <= ENTRIES and len(sample) == len(rows):
        return distinct
    with warnings.catch_warnings():
        # A center that loses its last row stays where it is.
        warnings.simplefilter("ignore")
        return kmeans2(sample, _spread(sample, rng), _ROUNDS, minit="matrix")[0].astype(np.float32)


def _spread(rows: Floats, rng: np.random.Generator) -> Floats:
    """Rows far from each other, as k-means++ chooses them. SciPy's own takes 40 s for what this does in one."""
    chosen = [rows[rng.integers(len(rows))]]
    distance = ((rows - chosen[0]) ** 2).sum(axis=1)
    while len(chosen) < ENTRIES and distance.sum() > 0:
        chosen.append(rows[rng.choice(len(rows), p=distance / distance.sum())])
        distance = np.minimum(distance, ((rows - chosen[-1]) ** 2).sum(axis=1))
    return np.stack(chosen)
