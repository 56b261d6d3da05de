"""Noise of a sensor and the falloff of light that a calibration leaves, on linear light."""

import numpy as np

from egosplat_apartments.camera.effects import Effects
from egosplat_apartments.camera.lens import untone
from egosplat_apartments.camera.raycasting import Floats

# Radiance, after vignetting and exposure, that saturates the display.
WHITE = float(untone(np.ones(1, np.float32))[0])


def add_noise(light: Floats, effects: Effects, gain: float, rng: np.random.Generator) -> Floats:
    """Light with shot noise and read noise, between black and white.

    Shot noise is that of counted photons: its variance grows linearly with the light, and with the gain, because
    amplified light has fewer photons. Read noise is amplified by the gain.

    Args:
        light: (N, 3) float32, exposed and amplified.
    """
    share = np.clip(light / np.float32(WHITE), 0, 1).astype(np.float64)
    deviation = np.sqrt(effects.shot_noise**2 * gain * share + (effects.read_noise * gain) ** 2)
    noisy = share + deviation * rng.normal(size=share.shape)
    return (np.clip(noisy, 0, 1) * WHITE).astype(np.float32)


def falloff(radius: Floats, effects: Effects) -> Floats:
    """(N,) factors on the light at (N,) distances from the middle of the lens circle, as fractions of its radius."""
    return np.maximum(0, 1 - np.float32(effects.vignetting) * (radius * radius))
