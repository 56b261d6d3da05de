"""Measure how the brightness of the same surfaces changes over a recording, in stops."""

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import Array

Grey = NDArray[np.uint8]
Bools = NDArray[np.bool_]

# Darker values are noise, lighter ones may be saturated [grey levels].
_DARKEST, _LIGHTEST = 16, 245
# Display values are about the 2.2nd root of light.
_GAMMA = 2.2
_MIN_PIXELS = 200


def gain_stops(first: Grey, second: Grey, measured: Bools) -> float | None:
    """Exposure of the second image relative to the first: the median over pixels that show the same surface [stops].

    Args:
        first, second: (h, w) uint8, aligned.
        measured: (h, w) bool, pixels to compare.

    Returns:
        None with fewer than 200 pixels that are neither dark nor saturated.
    """
    usable = measured & (np.minimum(first, second) >= _DARKEST) & (np.maximum(first, second) <= _LIGHTEST)
    if usable.sum() < _MIN_PIXELS:
        return None
    return float(_GAMMA * np.median(np.log2(second[usable] / first[usable].astype(np.float64))))


def exposure_curve(pairs: NDArray[np.int64], stops: Array) -> dict[int, float]:
    """Exposure by frame, summed along chains of pairs; each chain's median is 0 [stops].

    Args:
        pairs: (P, 2) frames, ordered by the first.
        stops: (P,) of each pair; NaN if unknown.
    """
    chains: list[dict[int, float]] = []
    chain_of: dict[int, dict[int, float]] = {}
    for (first, second), change in zip(pairs.tolist(), stops.tolist(), strict=True):
        if np.isnan(change) or second in chain_of:
            continue
        if first not in chain_of:
            chain_of[first] = {first: 0.0}
            chains.append(chain_of[first])
        chain = chain_of[second] = chain_of[first]
        chain[second] = chain[first] + change
    return {
        frame: level - float(np.median(list(chain.values())))
        for chain in chains
        for frame, level in chain.items()
    }


def exposure_range(curve: dict[int, float]) -> float | None:
    """Range that holds 90 % of the frames [stops]; None without any."""
    return float(np.ptp(np.quantile(list(curve.values()), [0.05, 0.95]))) if curve else None
