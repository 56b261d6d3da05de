"""Curves over time without kinks."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline

from egosplat_apartments.arrays import Array

_DEGREE = 5
# Time between control points; also about the length over which the curve blurs them.
STEP_S = 0.25


def control_times(start_s: float, end_s: float) -> Array:
    """Times of the control points of a curve over an interval."""
    count = int(np.ceil((end_s - start_s) / STEP_S)) + 2 * _DEGREE
    return start_s + STEP_S * (np.arange(count) - _DEGREE + 1)


class SmoothTrack:
    """A quintic B-spline: four times continuously differentiable, within the bounds of its control points."""

    def __init__(self, times: Array, values: Array) -> None:
        """Make a curve from control points; it does not pass through them.

        Args:
            times: (K,) from ``control_times``; values: (K, ...) control points.
        """
        knots = times[0] + STEP_S * (np.arange(len(times) + _DEGREE + 1) - (_DEGREE + 1) / 2)
        self._spline = BSpline(knots, values, _DEGREE)

    def __call__(self, times: ArrayLike) -> Array:
        """(N, ...) values at (N,) times [s]."""
        return self._spline(np.asarray(times, dtype=np.float64))


def smoothstep(values: ArrayLike) -> Array:
    """0 below 0, 1 above 1, and twice continuously differentiable in between."""
    t = np.clip(np.asarray(values, dtype=np.float64), 0, 1)
    return t * t * t * (10 - 15 * t + 6 * t**2)


def limited(angles: Array, largest_step: float) -> Array:
    """Follow (K,) angles [rad] the short way round, by at most ``largest_step`` per element."""
    result = np.array(angles, dtype=np.float64)
    for k in range(1, len(result)):
        turn = (angles[k] - result[k - 1] + np.pi) % (2 * np.pi) - np.pi
        result[k] = result[k - 1] + np.clip(turn, -largest_step, largest_step)
    return result
