"""Film a world: the light of each frame through shutter, exposure and sensor, with the ground truth of its middle."""

from collections.abc import Callable
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from egosplat_apartments.adt_format.sequence import View
from egosplat_apartments.arrays import Array, Floats
from egosplat_apartments.camera.effects import Effects
from egosplat_apartments.camera.exposure import (
    Exposure,
    add_noise,
    auto_exposure,
    expose,
    falloff,
    white_balance,
)
from egosplat_apartments.camera.render import Renderer
from egosplat_apartments.world.world import World, camera_pose

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


_DISPLAY_STREAM, _NOISE_STREAM = 6, 22


class Film:
    """The frames of one recording through one camera."""

    def __init__(self, world: World, renderer: Renderer, seconds: Array, effects: Effects) -> None:
        """Set the exposure of every frame.

        Args:
            seconds: (F,) middle of each frame's exposure, since the start of the recording.
            effects: of the camera. Without any, each frame is a rendering of one instant.
        """
        self._world, self._renderer, self._seconds, self._effects = world, renderer, seconds, effects
        channels = white_balance(effects, world.seed, seconds)
        self.exposures = [
            Exposure(*expose(factor, effects.exposure_s), factor, colors)
            for factor, colors in zip(self._factors(), channels, strict=True)
        ]

    def shoot(self, number: int) -> tuple[NDArray[np.uint8], View, View]:
        """Film a frame, as ``Renderer.shoot``. Its labels and depth are those of the middle of the exposure."""
        world, seconds = self._world, float(self._seconds[number])
        pose, bodies = camera_pose(world, seconds), world.body_poses(seconds)
        rng = np.random.default_rng([world.seed, _DISPLAY_STREAM, number])
        exposure = self.exposures[number]
        if not self._effects.change_light:
            return self._renderer.shoot(pose, bodies, exposure.light, rng)
        with_people, without_people = self._renderer.truth(pose, bodies)
        noise = np.random.default_rng([world.seed, _NOISE_STREAM, number])

        def sensor(light: Floats) -> Floats:
            return add_noise(light, self._effects, exposure.gain, noise) if self._effects.noisy else light

        rgb = self._renderer.develop(self._light(seconds, exposure), exposure.light, rng, sensor)
        return rgb, with_people, without_people

    def _light(self, seconds: float, exposure: Exposure) -> Floats:
        """(N, 3) radiance of the lens's pixels, integrated over the exposure and changed by lens and white balance."""
        world, renderer = self._world, self._renderer
        radiance = integrate(
            renderer,
            lambda times: world.head.world_from_camera(seconds + times),
            lambda time: world.body_poses(seconds + time),
            exposure.open_s,
            self._effects.readout_s,
        )
        return radiance * falloff(renderer.lens.radius, self._effects)[:, None] * exposure.channels

    def _factors(self) -> list[float]:
        """Factor on the light of each frame."""
        world, stops = self._world, self._effects.exposure_stops
        if not stops:
            return [1.0 + 0.05 * float(np.sin(0.9 * time + world.seed)) for time in self._seconds.tolist()]
        brightness = [
            self._renderer.brightness(camera_pose(world, time), world.body_poses(time))
            for time in self._seconds.tolist()
        ]
        return auto_exposure(np.array(brightness), self._seconds, stops).tolist()
