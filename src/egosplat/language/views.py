"""Training views of Gaussians, with target codes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from egosplat.arrays import Bools, Floats, Ints
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import camera_poses
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, view_of
from egosplat.gaussians.training_views import Masking, Views, read_views, split_views
from egosplat.language.centers import Centers, look_at_centers
from egosplat.language.targets import Targets
from egosplat.rasterize.view import View


@dataclass(frozen=True, eq=False, kw_only=True)
class CodeViews(Views):
    """V training views of N Gaussians on their device, with the target codes of their pixels.

    Attributes:
        gaussians: they require no gradients.
        targets: returns the targets of a frame; None for a method that learns from tiles.
    """

    gaussians: Gaussians
    settings: RenderSettings
    targets: Callable[[int], Targets] | None

    def view(self, index: int) -> View:
        """The Gaussians in a view."""
        return view_of(self.gaussians, self.camera, self.camera_to_world[index], self.settings)

    def centers(self, index: int) -> Centers:
        """The centers of the Gaussians in a view, see ``look_at_centers``."""
        return look_at_centers(self.gaussians, self.camera, self.camera_to_world[index], self.settings)

    def weight_at(self, index: int, pixels: Ints) -> Floats:
        """Return the (P,) weights of (P, 2) pixels, column and row."""
        weight = self.weight(index)
        if weight is None:
            return np.ones(len(pixels), np.float32)
        return weight.cpu().numpy()[pixels[:, 1], pixels[:, 0]]


def select_code_views(
    frames: Artifact,
    poses: Artifact,
    splats: Artifact,
    targets: Callable[[int], Targets] | None,
    masking: Masking,
    gaussians: Gaussians,
    settings: RenderSettings,
    kept: Bools | None = None,
) -> CodeViews:
    """All training frames with a pose, of those ``kept`` (F,) bool, with the poses that splats render with; UserError without any."""
    views = read_views(frames, poses, split_views(frames, poses, kept)[0], gaussians.means.device)
    given: dict[str, Any] = vars(views) | {"transient": masking.frames(views.frame)}
    given["camera_to_world"] = camera_poses(poses, splats)[views.frame]
    return CodeViews(**given, gaussians=gaussians, settings=settings, targets=targets)
