"""Quantize Gaussians for the scene page, in an order in which neighbors are near each other, and their codes to palettes."""

import warnings

import numpy as np
import torch
from scipy.cluster.vq import kmeans2, vq
from torch.nn import functional

from egosplat.arrays import Bytes, Floats, Ints, Reals
from egosplat.gaussians.initialization import SH_C0
from egosplat.gaussians.model import Gaussians
from egosplat.images import evenly_spaced
from egosplat.language.decoder import Decoder, decode
from egosplat.viewing.html import Arrays, Facts

# Gaussians that share one box for their quantized centers.
BLOCK = 256

# Degree of the spherical harmonics on the page.
SH_DEGREE = 1

# Share of the coefficients above degree 0 that are cut off at the limit: the largest of all would coarsen the others.
_CUT_OFF = 0.001

# Largest number of views on the page, evenly spaced among those of the scene's index.
MOST_VIEWS = 32

# The smallest share of a view that is stored, and of the mean over all views, and the factor between two bytes.
SMALLEST, SMALLEST_MEAN, STEP = 1e-6, 1e-7, 1.06

# Entries of a level's palette, codes that entries are fitted to, and rounds of k-means.
ENTRIES, _SAMPLE, _ROUNDS = 512, 20_000, 10


def keep_largest(gaussians: Gaussians, most: int) -> Ints:
    """Indices of the ``most`` Gaussians that cover most: opacity times the area of the two longest axes."""
    scales = np.sort(gaussians.scales.cpu().numpy(), axis=1)
    cover = gaussians.opacities.cpu().numpy() * scales[:, 1] * scales[:, 2]
    return np.argsort(-cover, kind="stable")[:most]


def spatial_order(means: Floats) -> Ints:
    """Order of (N, 3) centers along a Z-order curve, on which Gaussians of one index range are near each other."""
    low, high = np.quantile(means, [0.01, 0.99], axis=0) if len(means) else (np.zeros(3), np.ones(3))
    cell = np.clip((means - low) / np.maximum(high - low, 1e-9) * 1023, 0, 1023).astype(np.int64)
    code = np.zeros(len(means), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= (cell[:, axis] >> bit & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


def pack_gaussians(gaussians: Gaussians, sh_degree: int) -> tuple[Arrays, Facts]:
    """Quantize N Gaussians, in their final order, to 26 bytes each.

    Centers have 16 bits in the box of their block. A covariance is stored as its rotation and the logarithms of its
    standard deviations, so its error is relative. Colors have spherical harmonics of degree 1, of ``sh_degree`` in use.
    """
    means, opacities = (values.cpu().numpy() for values in (gaussians.means, gaussians.opacities))
    colors = gaussians.sh.cpu().numpy()[:, : (min(sh_degree, SH_DEGREE) + 1) ** 2]
    bands = colors[:, 1:].reshape(len(means), 3 * (colors.shape[1] - 1))
    logs = gaussians.log_scales.cpu().numpy()
    usual = np.median(logs) if logs.size else 0.0
    # An extreme one would coarsen the others.
    log_scale, scale_range = _quantize(logs.clip(usual - 12, usual + 12))
    color, color_range = _quantize(colors[:, 0] * SH_C0 + 0.5)
    limit = float(np.quantile(np.abs(bands), 1 - _CUT_OFF)) if bands.size else 0.0
    quats = functional.normalize(gaussians.quats.cpu(), dim=1, eps=1e-30).numpy()
    arrays = _quantize_centers(means) | {
        "log_scale": log_scale.T,
        "rotation": np.rint(quats * 127).astype(np.int8).T,
        "opacity": np.rint(opacities * 255).astype(np.uint8),
        "color": color.T,
        "bands": np.rint(bands / max(limit, 1e-9) * 127).clip(-127, 127).astype(np.int8).T,
    }
    return arrays, {
        "count": len(means),
        "block": BLOCK,
        "log_scale_range": scale_range,
        "color_range": color_range,
        "band_limit": limit,
        "bands": bands.shape[1] // 3,
    }


def _quantize(values: Reals) -> tuple[Bytes, list[float]]:
    """Bytes for equal steps between the least and the largest value, and these two."""
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    high = max(high, low + 1e-6)
    return np.rint((values - low) / (high - low) * 255).clip(0, 255).astype(np.uint8), [low, high]


def _quantize_centers(means: Floats) -> Arrays:
    """(3, N) uint16 steps within the block, (3, B) float32 lowest corner and step of each block."""
    starts = np.arange(0, len(means), BLOCK)
    low = np.minimum.reduceat(means, starts).astype(np.float32)
    high = np.maximum.reduceat(means, starts).astype(np.float32)
    step = np.maximum((high - low) / 65535, 1e-12).astype(np.float32)
    block = np.arange(len(means)) // BLOCK
    steps = np.rint((means - low[block]) / step[block]).clip(0, 65535).astype(np.uint16)
    return {"position": steps.T, "block_low": low.T, "block_step": step.T}


def pack_visibility(shares: Floats, frame: Ints) -> tuple[Arrays, Facts]:
    """Quantize the (V, N) shares of views that Gaussians fill, on a logarithmic scale.

    ``visible`` (N,) uint8 mean over all views; ``seen`` (W, ceil(N / 8)) uint8 bits, the first of a byte highest, of the
    Gaussians that W of the views, of ``frame``, show; ``seen_share`` uint8 share of each bit that is set, view after view.
    """
    chosen = evenly_spaced(len(frame), MOST_VIEWS)
    shown = shares[chosen] >= SMALLEST
    arrays = {
        "visible": to_bytes(shares.mean(axis=0), SMALLEST_MEAN),
        "seen": np.packbits(shown, axis=1),
        "seen_share": to_bytes(shares[chosen][shown], SMALLEST),
    }
    limits = {"share_step": STEP, "share_smallest": SMALLEST, "mean_smallest": SMALLEST_MEAN}
    return arrays, {"seen_frames": frame[chosen].tolist()} | limits


def to_bytes(values: Floats, smallest: float) -> Bytes:
    """Byte b >= 1 means ``smallest * STEP ** (b - 1)``; 0 means less than ``smallest``."""
    steps = np.log(np.maximum(values, smallest) / smallest) / np.log(STEP)
    return np.where(values >= smallest, np.rint(steps).clip(0, 254) + 1, 0).astype(np.uint8)


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
    # A share above 0 stays above 0: without a share, the Gaussian has no code.
    shares = np.where(share > 0, np.rint(share * 255).clip(1, 255), 0).astype(np.uint8).T
    return {"code_index": index, "code_share": shares, "palette": palette}


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
