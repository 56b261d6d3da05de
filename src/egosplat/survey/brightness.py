"""Measure how the brightness of the same surfaces changes over a recording, in stops."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import Array

Gray = NDArray[np.uint8]
Bools = NDArray[np.bool_]

# Darker values are noise, lighter ones may be saturated [gray levels].
_DARKEST, _LIGHTEST = 16, 245
# Display values are about the 2.2nd root of light.
_GAMMA = 2.2
_MIN_PIXELS = 200
# Pixels that are compared in a pair, and the side of their patches [px].
_MAX_SAMPLES, _PATCH = 400, (7, 7)
# Vignetting is fitted with the second and the fourth power of the radius, up to so many stops each.
_POWERS, _ITERATIONS, _MAX_VIGNETTING = 2, 6, 4.0
# Largest mean error of the change between two frames; up to 0.009 in recordings of constant exposure [stops].
_BIAS = 0.01
# Smallest scatter of brightness: rounding [stops].
_MIN_SCATTER = 0.01
# Largest factor between the contrasts of two images, and the smallest contrast that has a factor [gray levels].
_MAX_GAIN, _MIN_CONTRAST = 64.0, 4.0


@dataclass(frozen=True, eq=False)
class Light:
    """The light of S surfaces in two images.

    Attributes:
        change: (S,) float64 logarithm of their ratio [stops].
        vignetting: (S, 2) float64 differences of the second and fourth power of their radius in the image.
    """

    change: Array
    vignetting: Array


def equalize(image: Gray, wanted: Gray, found: Gray) -> Gray:
    """An image with its brightness changed by a gain and an offset.

    Args:
        image: (h, w) uint8.
        wanted, found: (N,) uint8 of the same surfaces, in another image and in this one.
    """
    if len(found) < _MIN_PIXELS:
        return image
    (low, middle, high), (dark, gray, light) = (np.quantile(one, [0.1, 0.5, 0.9]) for one in (wanted, found))
    flat = min(high - low, light - dark) < _MIN_CONTRAST
    gain = 1.0 if flat else np.clip((high - low) / (light - dark), 1 / _MAX_GAIN, _MAX_GAIN)
    table = np.clip(np.rint((np.arange(256) - gray) * gain + middle), 0, 255).astype(np.uint8)
    return table[image]


def compare_light(first: Gray, second: Gray, measured: Bools, radii: tuple[Array, Array]) -> Light | None:
    """Compare the light of the same surfaces in two images.

    Args:
        first, second: (h, w) uint8, aligned.
        measured: (h, w) bool, pixels to compare.
        radii: (h, w) distance of each surface from the center of its own image, as a fraction of half the longest side.

    Returns:
        None with fewer than 200 pixels that are neither dark nor saturated.
    """
    usable = measured & (np.minimum(first, second) >= _DARKEST) & (np.maximum(first, second) <= _LIGHTEST)
    if usable.sum() < _MIN_PIXELS:
        return None
    rows, columns = (axis[:: max(1, len(axis) // _MAX_SAMPLES)] for axis in np.nonzero(usable))
    # Patches: noise and interpolation change single pixels.
    here, there = (
        cv2.blur(one.astype(np.float32), _PATCH)[rows, columns].astype(np.float64) for one in (first, second)
    )
    before, after = (radius[rows, columns] ** 2 for radius in radii)
    return Light(_GAMMA * np.log2(there / here), np.stack([after - before, after**2 - before**2], axis=1))


def exposure_changes(lights: Sequence[Light | None]) -> Array:
    """(P,) exposure of the second image of each pair relative to the first [stops]; NaN if unknown.

    The vignetting that all images share is fitted and taken out: a surface darkens towards the border of the image.
    """
    known = [light for light in lights if light is not None]
    vignetting = np.zeros(_POWERS)
    for _ in range(_ITERATIONS if known else 0):
        normal, slope = np.eye(_POWERS), np.zeros(_POWERS)
        for light in known:
            rest = light.change - light.vignetting @ vignetting
            rest -= np.median(rest)
            scale = max(_MIN_SCATTER, 1.4826 * float(np.median(np.abs(rest))))
            weight = 1.0 / (1.0 + (rest / (2 * scale)) ** 2)
            centered = light.vignetting - np.average(light.vignetting, axis=0, weights=weight)
            normal += np.einsum("ni,nj,n->ij", centered, centered, weight)
            slope += np.einsum("ni,n,n->i", centered, rest, weight)
        vignetting = (vignetting + np.linalg.solve(normal, slope)).clip(-_MAX_VIGNETTING, _MAX_VIGNETTING)
    return np.array(
        [np.nan if one is None else np.median(one.change - one.vignetting @ vignetting) for one in lights],
        np.float64,
    )


def exposure_curve(pairs: NDArray[np.int64], stops: Array) -> dict[int, float]:
    """Exposure by frame, summed along chains of pairs; each chain's median is 0 [stops].

    A steady change that the measurement's bias could make is taken out: over many pairs it would grow.

    Args:
        pairs: (P, 2) frames, ordered by the first.
        stops: (P,) of each pair; NaN if unknown.
    """
    known = stops[np.isfinite(stops)]
    stops = stops - np.clip(known.mean(), -_BIAS, _BIAS) if len(known) else stops
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
