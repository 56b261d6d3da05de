"""Motion blur and rolling shutter: the light of each pixel over the time in which its row is exposed."""

from collections.abc import Callable
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from egosplat_apartments.camera.raycasting import Floats
from egosplat_apartments.camera.render import Renderer

Array = NDArray[np.float64]

# Instants of an exposure that are averaged; each costs a rendering. They are one pixel of blur apart, or more if the
# exposure would need more than MOST of them in every period of this length, or more than MOST_OF_ALL.
SPACING_PX, MOST, PERIOD_S, MOST_OF_ALL = 1.0, 4, 0.014, 16
# Distance at which surfaces count as they move with the camera or by themselves.
_DISTANCE_M = 1.0


def integrate(
    renderer: Renderer,
    camera_poses: Callable[[Array], Array],
    body_poses: Callable[[float], dict[int, Array]],
    exposure_s: float,
    readout_s: float,
) -> Floats:
    """(N, 3) mean radiance of the lens's pixels over the exposure.

    The middle row is exposed around second 0, the first and the last half of the readout before and after.

    Args:
        camera_poses: (T,) seconds -> (T, 4, 4) ``world_from_camera``.
        body_poses: a second -> (4, 4) pose of every moving body. Bodies are posed once per instant, so their own
            motion is blurred but not skewed.
        exposure_s: 0 for an instant.
        readout_s: from the first row to the last, 0 for a global shutter.
    """
    rows = row_times(renderer.lens.size, readout_s) if readout_s else np.zeros(1)
    count = _instants(renderer, camera_poses, body_poses, exposure_s) if exposure_s else 1
    offsets = ((np.arange(count) + 0.5) / count - 0.5) * exposure_s

    def radiance(offset: float) -> Floats:
        poses = camera_poses(offset + rows)
        return renderer.radiance(poses if readout_s else poses[0], body_poses(offset))

    return reduce(np.add, map(radiance, offsets.tolist())) / count


def _instants(
    renderer: Renderer,
    camera_poses: Callable[[Array], Array],
    body_poses: Callable[[float], dict[int, Array]],
    exposure_s: float,
) -> int:
    """Number of instants that show the motion within an exposure."""
    first, last = camera_poses(np.array([-0.5, 0.5]) * exposure_s)
    # The length by which a turn moves the end of a unit vector, at most.
    turned = np.linalg.norm(last[:3, :3] - first[:3, :3]) / np.sqrt(2)
    before, after = body_poses(-0.5 * exposure_s), body_poses(0.5 * exposure_s)
    moved = max(
        (float(np.linalg.norm(after[body][:3, 3] - before[body][:3, 3])) for body in before), default=0
    )
    moved += float(np.linalg.norm(last[:3, 3] - first[:3, 3]))
    pixels = (turned + moved / _DISTANCE_M) / float(renderer.lens.angle.mean(dtype=np.float64))
    most = min(MOST * int(np.ceil(exposure_s / PERIOD_S)), MOST_OF_ALL)
    return int(np.clip(np.ceil(pixels / SPACING_PX), 1, most))


def row_times(size: int, readout_s: float) -> Array:
    """(size,) middle of each row's exposure, relative to that of the middle row [s]."""
    return ((np.arange(size) + 0.5) / size - 0.5) * readout_s
