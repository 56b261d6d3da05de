"""The rays of the camera's pixels, as the calibration's own camera model has them."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import to_aria_pixels
from egosplat.synthetic.aria import camera_calibration

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Lens:
    """Rays of a square picture.

    Attributes:
        size: its side [px].
        valid: (H, W) bool, within the lens circle.
        directions: (N, 3) float32 unit rays of the valid pixels' centres, camera axes, row by row.
        right, down: (N, 3) float32 change of the ray to the next pixel's.
        angle: (N,) float32 angle that a pixel covers [rad].
        radius: (N,) float32 distance from the principal point as a share of the circle's radius.
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
    """The rays of pictures of ``size`` x ``size`` pixels; kept, as each takes microseconds to unproject."""
    calibration = camera_calibration(size)
    # A margin of one pixel all around gives every pixel's ray its neighbours.
    steps = np.arange(-1, size + 1) + 0.5
    centres = to_aria_pixels(np.stack(np.meshgrid(steps, steps), axis=-1))
    rays = np.array([calibration.unproject_no_checks(pixel) for pixel in centres.reshape(-1, 2)])
    rays = (rays / np.linalg.norm(rays, axis=1, keepdims=True)).reshape(*centres.shape[:2], 3)
    right = 0.5 * (rays[1:-1, 2:] - rays[1:-1, :-2])
    down = 0.5 * (rays[2:, 1:-1] - rays[:-2, 1:-1])
    distance = np.linalg.norm(centres - calibration.get_principal_point(), axis=-1)[1:-1, 1:-1]
    share = distance / calibration.get_valid_radius()
    valid = share <= 1.0
    angle = np.sqrt(np.linalg.norm(right, axis=-1) * np.linalg.norm(down, axis=-1))
    images = (rays[1:-1, 1:-1], right, down, angle, share)
    return Lens(size, valid, *(np.ascontiguousarray(image[valid], dtype=np.float32) for image in images))
