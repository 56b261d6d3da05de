"""The sensor: vignette, gain, tone curve, noise."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

_EXPOSURE = 1.8
# Standard deviation, as a fraction of the largest display value.
_NOISE = 0.006


def develop(radiance: Floats, radius: Floats, gain: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """(N, 3) display values of (N, 3) linear radiance.

    Args:
        radius: (N,) distance from the centre of the lens circle as a fraction of its radius.
        gain: factor on all light.
    """
    squared = radius * radius
    fourth = squared * squared
    # Products alone: the last bits of a power depend on the processor.
    vignette = 1 - 0.35 * squared - 0.2 * (fourth * fourth)
    display = tone(radiance * (vignette * np.float32(gain))[:, None])
    display += rng.normal(0, _NOISE, display.shape).astype(np.float32)
    return np.clip(display * 255 + 0.5, 0, 255).astype(np.uint8)


def tone(radiance: Floats) -> Floats:
    """Linear light to display values 0..1: highlights compressed, then a square root."""
    exposed = radiance * np.float32(_EXPOSURE)
    return np.sqrt(exposed * (1 + 0.12 * exposed) / (1 + 0.5 * exposed))


def untone(display: Floats) -> Floats:
    """The inverse of ``tone``."""
    squared = display * display
    # With x the exposed radiance and s the square: 0.12 x² + (1 - 0.5 s) x - s = 0.
    b = 1 - 0.5 * squared
    return (-b + np.sqrt(b * b + 0.48 * squared)) / np.float32(0.24 * _EXPOSURE)
