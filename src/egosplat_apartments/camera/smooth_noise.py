"""Random curves over time that change slowly."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

Array = NDArray[np.float64]

_DEGREE = 5
# Variance of a quintic B-spline with independent control points of variance 1: the mean over time of the sum of
# the squared basis functions.
_VARIANCE = 655177 / 1663200


class SmoothNoise:
    """Gaussian noise over time with mean 0, standard deviation 1 and correlation exp(-t²/2T²) at a distance t."""

    def __init__(
        self, rng: np.random.Generator, channels: int, correlation_s: float, start_s: float, end_s: float
    ) -> None:
        """Draw the curves.

        Args:
            channels: number of independent curves.
            correlation_s: the time T.
            start_s, end_s: outside, the curves keep their values at the ends.
        """
        count = max(1, int(np.ceil((end_s - start_s) / correlation_s))) + _DEGREE
        knots = start_s + correlation_s * (np.arange(count + _DEGREE + 1) - _DEGREE)
        # A B-spline blurs its control points by a Gaussian of 0.7 steps, so its correlation is one of one step.
        values = rng.normal(0, 1 / np.sqrt(_VARIANCE), (count, channels))
        self._spline = BSpline(knots, values, _DEGREE)
        self._span = (start_s, end_s)

    def __call__(self, times: Array) -> Array:
        """(N, channels) values at (N,) times [s]."""
        return self._spline(np.clip(np.asarray(times, dtype=np.float64), *self._span))
