"""Measure how the brightness of the same surfaces changes over a recording, in stops."""

from collections.abc import Sequence

import cv2
import numpy as np

from egosplat.arrays import Array, Bools, Bytes, Ints

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


Light = tuple[Array, Array]
"""Of S surfaces in two images: (S,) logarithm of the ratio of their light [stops], and (S, 2) differences of the second and
fourth power of their radius in the image."""


def equalize(image: Bytes, wanted: Bytes, found: Bytes) -> Bytes:
    """Change an (h, w) uint8 image by a gain and an offset, so that the (N,) values ``found`` in it become those ``wanted``."""
    if len(found) < _MIN_PIXELS:
        return image
    (low, middle, high), (dark, gray, light) = (np.quantile(one, [0.1, 0.5, 0.9]) for one in (wanted, found))
    flat = min(high - low, light - dark) < _MIN_CONTRAST
    gain = 1.0 if flat else np.clip((high - low) / (light - dark), 1 / _MAX_GAIN, _MAX_GAIN)
    table = np.clip(np.rint((np.arange(256) - gray) * gain + middle), 0, 255).astype(np.uint8)
    return table[image]


def compare_light(first: Bytes, second: Bytes, measured: Bools, radii: Sequence[Array]) -> Light | None:
    """Compare the light of the same surfaces in two aligned (h, w) uint8 images, at (h, w) bool pixels.

    ``radii``: two (h, w) distances of each surface from the center of its own image, as a fraction of half the longest side.
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
    return _GAMMA * np.log2(there / here), np.stack([after - before, after**2 - before**2], axis=1)


def exposure_changes(lights: Sequence[Light | None]) -> Array:
    """(P,) exposure of the second image of each pair relative to the first [stops]; NaN if unknown.

    The vignetting that all images share is fitted and taken out: a surface darkens towards the border of the image.
    """
    known = [light for light in lights if light is not None]
    vignetting = np.zeros(_POWERS)
    for _ in range(_ITERATIONS if known else 0):
        normal, slope = np.eye(_POWERS), np.zeros(_POWERS)
        for change, radial in known:
            rest = change - radial @ vignetting
            rest -= np.median(rest)
            scale = max(_MIN_SCATTER, 1.4826 * float(np.median(np.abs(rest))))
            weight = 1.0 / (1.0 + (rest / (2 * scale)) ** 2)
            centered = radial - np.average(radial, axis=0, weights=weight)
            normal += np.einsum("ni,nj,n->ij", centered, centered, weight)
            slope += np.einsum("ni,n,n->i", centered, rest, weight)
        vignetting = (vignetting + np.linalg.solve(normal, slope)).clip(-_MAX_VIGNETTING, _MAX_VIGNETTING)
    return np.array(
        [np.nan if light is None else np.median(light[0] - light[1] @ vignetting) for light in lights], float
    )


def exposure_curve(pairs: Ints, stops: Array) -> dict[int, float]:
    """Exposure by frame, summed along chains of (P, 2) pairs ordered by the first; each chain's median is 0 [stops].

    A steady change that the bias of the (P,) ``stops``, NaN if unknown, could make is taken out: it would grow.
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
