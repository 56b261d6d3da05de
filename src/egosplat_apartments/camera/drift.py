"""The error of a closed-loop trajectory: slow drift of the pose, and a clock that differs from the camera's."""

import numpy as np
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

from egosplat.geometry import compose, make_pose
from egosplat_apartments.arrays import Array, Rng, Times, Trajectory
from egosplat_apartments.camera.effects import Effects

_DEGREE = 5
# Variance of a quintic B-spline with independent control points of variance 1: the mean over time of the sum of
# the squared basis functions.
_VARIANCE = 655177 / 1663200


class SmoothNoise:
    """Gaussian noise over time with mean 0, standard deviation 1 and correlation exp(-t²/2T²) at a distance t."""

    def __init__(self, rng: Rng, channels: int, correlation_s: float, start_s: float, end_s: float) -> None:
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


_STREAM = 20


class Drift:
    """Position and orientation errors that change slowly; their RMS over a long recording is as asked."""

    def __init__(self, effects: Effects, seed: int, start_ns: int, end_ns: int) -> None:
        """Draw the errors between two moments of device time; outside, they stay as at the ends."""
        rng = np.random.default_rng([seed, _STREAM])
        self._noise = SmoothNoise(rng, 6, effects.drift_s, 0.0, (end_ns - start_ns) * 1e-9)
        # RMS of a vector's length; its three components share it.
        self._sizes = np.repeat([effects.drift_m, effects.drift_rad], 3) / np.sqrt(3)
        self._start_ns = start_ns

    def __call__(self, poses: Array, times_ns: Times) -> Array:
        """(N, 4, 4) estimated from true ``world_from_device``: shifted in the world, turned about the device."""
        seconds = (np.asarray(times_ns, dtype=np.int64) - self._start_ns) * 1e-9
        errors = self._noise(seconds) * self._sizes
        turn = Rotation.from_rotvec(errors[:, 3:]).as_matrix()
        return make_pose(compose(poses[:, :3, :3], turn), poses[:, :3, 3] + errors[:, :3])


def estimated_trajectory(
    device_pose: Trajectory, effects: Effects, drift: Drift, start_ns: int, end_ns: int
) -> Trajectory | None:
    """The closed-loop trajectory of a device that moves along ``device_pose`` from start to end; None if exact."""
    if not (effects.drifts or effects.time_offset_ns):
        return None

    def pose(times_ns: Times) -> Array:
        times_ns = np.asarray(times_ns, dtype=np.int64)
        # The true trajectory is known only within the recording: beyond, the device stands still.
        return drift(
            device_pose(np.clip(times_ns + round(effects.time_offset_ns), start_ns, end_ns)), times_ns
        )

    return pose
