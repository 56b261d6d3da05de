"""Quantize Gaussians for the scene page, in an order in which neighbors are near each other."""

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.gaussians.initialization import SH_C0
from egosplat.gaussians.model import Gaussians
from egosplat.images import evenly_spaced
from egosplat.query.scene import instances_of_gaussians
from egosplat.viewing.container import Arrays, Facts

# Gaussians that share one box for their quantized centers.
BLOCK = 256

# Degree of the spherical harmonics on the page.
SH_DEGREE = 1

# Share of the coefficients above degree 0 that are cut off at the limit: the largest of all would coarsen the others.
_CUT_OFF = 0.001


def keep_largest(gaussians: Gaussians, most: int) -> NDArray[np.int64]:
    """Indices of the ``most`` Gaussians that cover most: opacity times the area of the two longest axes."""
    scales = np.sort(gaussians.scales.cpu().numpy(), axis=1)
    cover = gaussians.opacities.cpu().numpy() * scales[:, 1] * scales[:, 2]
    return np.argsort(-cover, kind="stable")[:most]


def spatial_order(means: NDArray[np.float32]) -> NDArray[np.int64]:
    """Order of (N, 3) centers along a Z-order curve, on which Gaussians of one index range are near each other."""
    low, high = np.quantile(means, [0.01, 0.99], axis=0) if len(means) else (np.zeros(3), np.ones(3))
    cell = np.clip((means - low) / np.maximum(high - low, 1e-9) * 1023, 0, 1023).astype(np.int64)
    code = np.zeros(len(means), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= (cell[:, axis] >> bit & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


def _quantize(values: NDArray[np.floating]) -> tuple[NDArray[np.uint8], list[float]]:
    """Bytes for equal steps between the least and the largest value, and these two."""
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    high = max(high, low + 1e-6)
    return np.rint((values - low) / (high - low) * 255).clip(0, 255).astype(np.uint8), [low, high]


def pack_gaussians(gaussians: Gaussians, sh_degree: int) -> tuple[Arrays, Facts]:
    """Quantize N Gaussians to 26 bytes each.

    Centers have 16 bits in the box of their block. A covariance is stored as its rotation and the logarithms of its
    standard deviations, so its error is relative. Colors have spherical harmonics of degree 1.

    Args:
        gaussians: in their final order.
        sh_degree: degree in use, 0 to 3; higher degrees than 1 are left out.
    """
    means, opacities = (values.cpu().numpy() for values in (gaussians.means, gaussians.opacities))
    log_scales = gaussians.scales.log().cpu().numpy()
    colors = gaussians.sh.cpu().numpy()[:, : (min(sh_degree, SH_DEGREE) + 1) ** 2]
    base, bands = colors[:, 0] * SH_C0 + 0.5, colors[:, 1:].reshape(len(means), -1)
    (log_scale, scale_range), (color, color_range) = _quantize(log_scales), _quantize(base)
    limit = float(np.quantile(np.abs(bands), 1 - _CUT_OFF)) if bands.size else 0.0
    position, block_low, block_step = _quantize_centers(means)
    quats = gaussians.quats.cpu().numpy()
    quats = quats / np.linalg.norm(quats, axis=1, keepdims=True)
    arrays = {
        "position": position,
        "block_low": block_low,
        "block_step": block_step,
        "log_scale": log_scale.T,
        "rotation": np.rint(quats * 127).astype(np.int8).T,
        "opacity": np.rint(opacities * 255).astype(np.uint8),
        "color": color.T,
        "bands": np.rint(bands / max(limit, 1e-9) * 127).clip(-127, 127).astype(np.int8).T,
    }
    facts = {
        "count": len(means),
        "block": BLOCK,
        "log_scale_range": scale_range,
        "color_range": color_range,
        "band_limit": limit,
        "bands": bands.shape[1] // 3,
    }
    return arrays, facts


def _quantize_centers(
    means: NDArray[np.float32],
) -> tuple[NDArray[np.uint16], NDArray[np.float32], NDArray[np.float32]]:
    """(3, N) steps within the block, (3, B) lowest corner and (3, B) step of each block."""
    starts = np.arange(0, len(means), BLOCK)
    low = np.minimum.reduceat(means, starts).astype(np.float32)
    high = np.maximum.reduceat(means, starts).astype(np.float32)
    step = np.maximum((high - low) / 65535, 1e-12).astype(np.float32)
    block = np.arange(len(means)) // BLOCK
    steps = np.rint((means - low[block]) / step[block]).clip(0, 65535).astype(np.uint16)
    return steps.T, low.T, step.T


def pack_instances(instances: Artifact, means: NDArray[np.float32]) -> Arrays:
    """Pack ``instance`` (L, N) uint16: 0 for none, else 1 more than the index; nothing for tracks, which are not in 3D."""
    if not len(means) or not instances.shape("gaussians/xyz")[0]:
        return {}
    owner = instances_of_gaussians(instances, means)
    return {"instance": (owner + 1).clip(0, 65535).astype(np.uint16)}


# Largest number of views on the page, evenly spaced among those of the scene's index.
MOST_VIEWS = 32

# The smallest share of a view that is stored, and the factor between two bytes.
SMALLEST, STEP = 1e-6, 1.06

# The same for the mean over all views, which may be smaller.
SMALLEST_MEAN = 1e-7


def pack_visibility(shares: NDArray[np.float32], frame: NDArray[np.int64]) -> tuple[Arrays, Facts]:
    """Quantize the shares of views that Gaussians fill, on a logarithmic scale.

    Args:
        shares: (V, N) of ``egosplat.query.things.visible_shares``.
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
