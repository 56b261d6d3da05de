"""Training views of Gaussians, with target codes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import camera_poses
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, view_of
from egosplat.gaussians.training_views import Masking, pixel_weight, split_views, valid_weight
from egosplat.geometry import Camera
from egosplat.language.centers import Centers, look_at_centers
from egosplat.language.targets import Targets
from egosplat.rasterize.view import View


@dataclass(frozen=True, eq=False)
class CodeViews:
    """V training views of N Gaussians, with the target codes of their pixels.

    Attributes:
        gaussians: they require no gradients.
        frame, camera_to_world, valid: see ``egosplat.gaussians.training_views.Views``.
        targets: returns the targets of a frame; None for a method that learns from tiles.
        masking: transient pixels of each frame.
    """

    gaussians: Gaussians
    settings: RenderSettings
    frame: NDArray[np.int64]
    camera_to_world: NDArray[np.float64]
    camera: Camera
    targets: Callable[[int], Targets] | None
    valid: Tensor | None
    masking: Masking

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def device(self) -> torch.device:
        """Device of Gaussians, targets and weights."""
        return self.gaussians.means.device

    def view(self, index: int) -> View:
        """The Gaussians in a view."""
        return view_of(self.gaussians, self.camera, self.camera_to_world[index], self.settings)

    def centers(self, index: int, median: bool = False) -> Centers:
        """The centers of the Gaussians in a view, see ``look_at_centers``."""
        pose = self.camera_to_world[index]
        return look_at_centers(self.gaussians, self.camera, pose, self.settings, median=median)

    def weight(self, index: int) -> Tensor | None:
        """Return the (H, W) float32 weight of each pixel, the paper's 1 - M inside the lens circle; None for ones."""
        transient = self.masking.frames(self.frame[index : index + 1])
        return pixel_weight(self.valid, None if transient is None else transient[0].to(self.device))

    def weight_at(self, index: int, pixels: NDArray[np.int64]) -> NDArray[np.float32]:
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
    kept: NDArray[np.bool_] | None = None,
) -> CodeViews:
    """All training frames with a pose, of those ``kept`` (F,) bool, with the poses that splats render with; UserError without any."""
    rows = np.flatnonzero(split_views(frames, poses, kept)[0])
    _, height, width, _ = frames.shape("rgb")
    return CodeViews(
        gaussians,
        settings,
        frame=rows.astype(np.int64),
        camera_to_world=camera_poses(poses, splats)[rows],
        camera=Camera.from_matrix(poses.read("intrinsics"), width, height),
        targets=targets,
        valid=valid_weight(frames.read("valid"), gaussians.means.device),
        masking=masking,
    )
