"""One scene of the viewer: its Gaussians at once, its questions as soon as they are ready."""

import threading
from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from egosplat.errors import UserError
from egosplat.geometry import Array
from egosplat.images import evenly_spaced
from egosplat.viewer.pictures import Painted, browser_camera, draw
from egosplat.viewer.questions import Questions
from egosplat.viewer.scene import ViewedScene

# Number of frames among which the first view is chosen, and side of their pictures [px].
FIRST_VIEWS, FIRST_SIDE = 12, 48

# Vertical field of view of the browser's camera [rad]: wider ones bend the borders.
FIELD_OF_VIEW = 1.2

PREPARING = "The words are being read; questions can be asked in a few seconds."


class World:
    """A scene that is shown to any number of windows.

    Attributes:
        viewed: the scene.
        name: the folder, as the user gave it.
        plain: the Gaussians in their own colors.
        questions: None until they are ready, and where the scene cannot be asked.
        silence: why no question can be asked, or None.
    """

    def __init__(self, viewed: ViewedScene) -> None:
        self.viewed, self.name = viewed, str(viewed.folder)
        self.plain = Painted.of(viewed.trained)
        self.questions: Questions | None = None
        self.silence: str | None = PREPARING
        self.ready = threading.Event()
        self._owners: dict[int, NDArray[np.int64]] = {}

    def load_questions(self, load: Callable[[ViewedScene], Questions]) -> None:
        """Make the scene ready for questions; a user's mistake becomes the reason why there are none."""
        try:
            self.questions = load(self.viewed)
            self.silence = None
        except UserError as error:
            self.silence = f"This scene cannot be asked. {error}"
        finally:
            self.ready.set()

    @property
    def instance_levels(self) -> tuple[str, ...]:
        """Names of the levels whose instances can be shown in colors; none where instances are not known in 3D."""
        instances = self.viewed.instances
        if instances is None or not instances.shape("gaussians/xyz")[0]:
            return ()
        return tuple(instances.facts["levels"])

    def owners(self, level: int) -> NDArray[np.int64]:
        """(N,) instance of each Gaussian at a level, -1 for none: that of the nearest Gaussian of instances.zarr."""
        if level not in self._owners:
            instances = self.viewed.instances
            assert instances is not None, "instance_levels is empty"
            _, nearest = self._nearest(self.plain.gaussians.means.cpu().numpy())
            self._owners[level] = instances.read("gaussians/instance")[nearest, level].astype(np.int64)
        return self._owners[level]

    def instances_at(self, position: Array) -> dict[str, int]:
        """The instance at a place, by name of the level; levels without one are left out."""
        if not self.instance_levels:
            return {}
        assert self.viewed.instances is not None
        _, nearest = self._nearest(np.asarray(position)[None])
        found = self.viewed.instances.read("gaussians/instance")[nearest[0]]
        return {
            name: int(number) for name, number in zip(self.instance_levels, found, strict=True) if number >= 0
        }

    def _nearest(self, points: Array) -> tuple[Array, NDArray[np.int64]]:
        assert self.viewed.instances is not None
        return cKDTree(self.viewed.instances.read("gaussians/xyz")).query(points)

    def depth_ahead(self, pose: Array) -> float:
        """Median depth in the middle of a view, in the unit of the scene; the scene's reach where nothing is there."""
        camera = browser_camera(FIELD_OF_VIEW, FIRST_SIDE, FIRST_SIDE)
        _, depth = draw(self.viewed.trained, self.plain, camera, pose)
        third = FIRST_SIDE // 3
        middle = float(np.median(depth[third:-third, third:-third]))
        return min(middle, self.viewed.reach)

    def point_ahead(self, pose: Array) -> Array:
        """(3,) place on the surface that the middle of a view shows."""
        return pose[:3, 3] + pose[:3, 2] * self.depth_ahead(pose)

    @cached_property
    def first_frame(self) -> int:
        """The frame, among a few, that sees farthest: a view of much of the scene."""
        registered = self.viewed.registered
        places = evenly_spaced(len(registered), FIRST_VIEWS)
        return int(
            max(registered[places], key=lambda frame: self.depth_ahead(self.viewed.camera_to_world[frame]))
        )
