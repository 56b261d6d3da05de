"""Film a world: the light of each frame through shutter, exposure and sensor, with the ground truth of its middle."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from egosplat_apartments.camera.effects import Effects
from egosplat_apartments.camera.exposure import Exposure, auto_exposure, expose, white_balance
from egosplat_apartments.camera.raycasting import Floats
from egosplat_apartments.camera.render import Renderer, Shot
from egosplat_apartments.camera.sensor import add_noise, falloff
from egosplat_apartments.camera.shutter import integrate
from egosplat_apartments.world.world import World, camera_pose

Array = NDArray[np.float64]

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

    def shoot(self, number: int) -> Shot:
        """Film a frame. Its labels and depth are those of the middle of the exposure."""
        world, seconds = self._world, float(self._seconds[number])
        pose, bodies = camera_pose(world, seconds), world.body_poses(seconds)
        rng = np.random.default_rng([world.seed, _DISPLAY_STREAM, number])
        exposure = self.exposures[number]
        if not self._effects.change_light:
            return self._renderer.shoot(pose, bodies, exposure.light, rng)
        with_people, without_people = self._renderer.truth(pose, bodies)
        sensor = self._sensor(number) if self._effects.noisy else None
        rgb = self._renderer.develop(self._light(seconds, exposure), exposure.light, rng, sensor)
        return Shot(rgb, with_people, without_people)

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

    def _sensor(self, number: int) -> Callable[[Floats], Floats]:
        """The noise of a frame."""
        noise = np.random.default_rng([self._world.seed, _NOISE_STREAM, number])
        return lambda light: add_noise(light, self._effects, self.exposures[number].gain, noise)

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
