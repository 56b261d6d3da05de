"""Auto-exposure, white balance, and the noise and falloff of a sensor, on linear light."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat_apartments.arrays import Array, Floats, Rng
from egosplat_apartments.camera.drift import SmoothNoise
from egosplat_apartments.camera.effects import Effects
from egosplat_apartments.camera.lens import untone

# Longest exposure of Aria's RGB camera.
LONGEST_S = 0.014
# Time after which auto-exposure has followed 63 % of a change.
_LAG_S = 0.3
# A view of nearly constant brightness: its changes are not amplified more than this.
_MOST_AMPLIFIED = 4.0
# 2^20 is a factor of a million, either way.
_MOST_STOPS = 40.0
_DARKEST = 1e-6
_WHITE_BALANCE_STREAM, _WHITE_BALANCE_S = 21, 5.0


@dataclass(frozen=True)
class Exposure:
    """How one frame is exposed.

    Attributes:
        open_s: exposure time, 0 for an instant.
        gain: amplification, 1 for a middle exposure.
        light: factor on the brightness of the image, by exposure time and gain.
        channels: (3,) float32 factors of red, green and blue.
    """

    open_s: float
    gain: float
    light: float
    channels: NDArray[np.float32]


def auto_exposure(brightness: Array, seconds: Array, stops: float) -> Array:
    """(F,) factors on the light of each frame, around 1: bright views are exposed less, with a lag.

    Args:
        brightness: (F,) mean radiance of each view; seconds: (F,) times of the frames.
        stops: largest over smallest factor, as a power of two. Smaller if the brightness hardly changes.
    """
    wanted = [-math.log2(max(float(value), _DARKEST)) for value in brightness]
    followed = [wanted[0]]
    for value, step in zip(wanted[1:], np.diff(seconds).tolist(), strict=True):
        followed.append(followed[-1] + (1 - math.exp(-step / _LAG_S)) * (value - followed[-1]))
    low, high = min(followed), max(followed)
    scale = min(stops / (high - low), _MOST_AMPLIFIED) if high > low else 0.0
    half = _MOST_STOPS / 2
    return np.array([2.0 ** min(max(scale * (value - (low + high) / 2), -half), half) for value in followed])


def expose(factor: float, nominal_s: float) -> tuple[float, float]:
    """Exposure time [s] and gain whose product is ``factor`` times ``nominal_s``; the gain has what is too long."""
    seconds = min(nominal_s * factor, max(LONGEST_S, nominal_s))
    return (seconds, factor * nominal_s / seconds) if seconds > 0 else (0.0, factor)


def white_balance(effects: Effects, seed: int, seconds: Array) -> NDArray[np.float32]:
    """(F, 3) factors of red, green and blue at (F,) seconds of a recording; green stays 1."""
    rng = np.random.default_rng([seed, _WHITE_BALANCE_STREAM])
    noise = SmoothNoise(rng, 2, _WHITE_BALANCE_S, 0.0, float(seconds[-1]))
    red, blue = np.maximum(0, 1 + effects.white_balance * noise(seconds)).T
    return np.stack([red, np.ones_like(red), blue], axis=-1).astype(np.float32)


# Radiance, after vignetting and exposure, that saturates the display.
WHITE = float(untone(np.ones(1, np.float32))[0])


def add_noise(light: Floats, effects: Effects, gain: float, rng: Rng) -> Floats:
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
