"""The error of a closed-loop trajectory: slow drift of the pose, and a clock that differs from the camera's."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from egosplat.geometry import compose, make_pose
from egosplat_apartments.camera.effects import Effects
from egosplat_apartments.camera.smooth_noise import SmoothNoise

Array = NDArray[np.float64]
Times = NDArray[np.int64]
Trajectory = Callable[[Times], Array]

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
        return drift(device_pose(np.clip(times_ns + effects.time_offset_ns, start_ns, end_ns)), times_ns)

    return pose
