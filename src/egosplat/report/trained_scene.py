"""A scene's trained Gaussians with the poses they were trained with, ready to be drawn."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.splats import SPLATS
from egosplat.gaussians.io import read_gaussians
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import render
from egosplat.geometry import Camera


@dataclass(frozen=True, eq=False)
class TrainedScene:
    """Poses and splats of one scene, and the Gaussians, on the CPU."""

    poses: Artifact
    splats: Artifact
    gaussians: Gaussians

    @property
    def camera(self) -> Camera:
        """The camera of the training views."""
        return Camera(**self.splats.facts["camera"])

    @property
    def near_plane(self) -> float:
        """Nearest camera z that was drawn in training [m]."""
        return self.splats.provenance["options"]["near_plane"]

    @property
    def antialiased(self) -> bool:
        """How Gaussians smaller than a pixel were rendered in training."""
        return self.splats.provenance["options"]["antialiased"]

    @torch.no_grad()
    def picture(self, camera: Camera, camera_to_world: NDArray[np.float64]) -> NDArray[np.float32]:
        """(H, W, 3) float32 sRGB in [0, 1], rendered as in training; a random background is black."""
        white = self.splats.provenance["options"]["background"] == "white"
        image, _, _ = render(
            self.gaussians,
            camera,
            camera_to_world,
            sh_degree=self.splats.facts["sh_degree_in_use"],
            background=torch.ones(3) if white else None,
            near_plane=self.near_plane,
            antialiased=self.antialiased,
            backend="auto",
        )
        return image.clamp(0.0, 1.0).numpy()


def open_trained_scene(poses: Path, splats: Path) -> TrainedScene:
    """Open both.

    Raises:
        UserError: the Gaussians were trained with other poses.
    """
    walk, trained = open_artifact(poses, POSES), open_artifact(splats, SPLATS)
    check_made_from(trained, walk)
    return TrainedScene(walk, trained, read_gaussians(trained))
