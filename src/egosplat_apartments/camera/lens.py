"""Rays of a camera's pixels: of Aria's calibrated lens, or of a pinhole."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import ARIA_PIXEL_OFFSET, CLOCKWISE, Camera, rotate
from egosplat_apartments.adt_format.aria import camera_calibration
from egosplat_apartments.arrays import Floats, Rng


@dataclass(frozen=True, eq=False)
class Lens:
    """Rays of a square image.

    Attributes:
        size: its side [px].
        valid: (H, W) bool, within the lens circle.
        directions: (N, 3) float32 unit rays through the centers of the valid pixels, camera axes, row by row.
        right, down: (N, 3) float32 change of the ray to the next pixel in x and in y.
        angle: (N,) float32 angle that a pixel covers [rad].
        radius: (N,) float32 distance from the principal point as a fraction of the circle's radius.
    """

    size: int
    valid: NDArray[np.bool_]
    directions: Floats
    right: Floats
    down: Floats
    angle: Floats
    radius: Floats


@lru_cache(maxsize=4)
def make_lens(size: int) -> Lens:
    """Aria's lens for images of ``size`` x ``size`` pixels."""
    # Cached: projectaria-tools takes microseconds per pixel.
    calibration = camera_calibration(size)
    centers = _centers(size, size) - ARIA_PIXEL_OFFSET
    rays = np.array([calibration.unproject_no_checks(pixel) for pixel in centers.reshape(-1, 2)])
    return _lens(rays.reshape(*centers.shape[:2], 3), _radius(size, centers))


@lru_cache(maxsize=4)
def pinhole_lens(camera: Camera) -> Lens:
    """A square pinhole camera: renders a rectified, upright image without resampling."""
    centers = _centers(camera.width, camera.height)
    focal, middle = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    rays = np.dstack([(centers - middle) / focal, np.ones(centers.shape[:2])])
    # The radius is that of the sensor pixel behind each upright pixel, for the same vignette as Aria's lens.
    sensor = rotate(CLOCKWISE[:3, :3], rays)
    calibration = camera_calibration(camera.width)
    pixels = np.array([calibration.project_no_checks(ray) for ray in sensor.reshape(-1, 3)])
    return _lens(rays, _radius(camera.width, pixels.reshape(centers.shape)))


def _centers(width: int, height: int) -> NDArray[np.float64]:
    """(H + 2, W + 2, 2) pixel centers with a margin of one pixel, so that every pixel has neighbors."""
    return np.stack(np.meshgrid(np.arange(-1, width + 1) + 0.5, np.arange(-1, height + 1) + 0.5), axis=-1)


def _radius(size: int, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of projectaria-tools' pixels from the principal point, as a fraction of the circle's radius."""
    calibration = camera_calibration(size)
    away = np.linalg.norm(pixels - calibration.get_principal_point(), axis=-1)
    return away / calibration.get_valid_radius()


def _lens(rays: NDArray[np.float64], radius: NDArray[np.float64]) -> Lens:
    """A lens of (H + 2, W + 2, 3) rays of any length and (H + 2, W + 2) radii, with a margin of one pixel."""
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    right = 0.5 * (rays[1:-1, 2:] - rays[1:-1, :-2])
    down = 0.5 * (rays[2:, 1:-1] - rays[:-2, 1:-1])
    angle = np.sqrt(np.linalg.norm(right, axis=-1) * np.linalg.norm(down, axis=-1))
    share = radius[1:-1, 1:-1]
    valid = share <= 1.0
    images = (rays[1:-1, 1:-1], right, down, angle, share)
    return Lens(
        len(valid), valid, *(np.ascontiguousarray(image[valid], dtype=np.float32) for image in images)
    )


_EXPOSURE = 1.8
# Standard deviation, as a fraction of the largest display value.
_NOISE = 0.006


def develop(
    radiance: Floats, radius: Floats, gain: float, rng: Rng, sensor: Callable[[Floats], Floats] | None = None
) -> NDArray[np.uint8]:
    """(N, 3) display values of (N, 3) linear radiance.

    Args:
        radius: (N,) distance from the center of the lens circle as a fraction of its radius.
        gain: factor on all light.
        sensor: what a sensor makes of the (N, 3) light that reaches it; None for a perfect one.
    """
    squared = radius * radius
    fourth = squared * squared
    # Products alone: the last bits of a power depend on the processor.
    vignette = 1 - 0.35 * squared - 0.2 * (fourth * fourth)
    light = radiance * (vignette * np.float32(gain))[:, None]
    display = tone(light if sensor is None else sensor(light))
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
