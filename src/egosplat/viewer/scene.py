"""Open a scene's folder for the viewer."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.instances import INSTANCES
from egosplat.artifacts.locating import locate
from egosplat.artifacts.masks import MASKS
from egosplat.artifacts.poses import POSES, length_unit
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schema import Schema
from egosplat.artifacts.splats import SPLATS, camera_poses
from egosplat.errors import UserError
from egosplat.geometry import Array, known_poses
from egosplat.pipeline.scene_folder import check_scene_folder
from egosplat.query.scene import TrainedScene, read_trained_scene

# The viewer shows nothing without these.
NEEDED = ("frames", "poses", "splats")


@dataclass(frozen=True, eq=False)
class ViewedScene:
    """A scene that can be looked at.

    Attributes:
        folder: as the user gave it.
        trained: its Gaussians, camera and render settings.
        camera_to_world: (F, 4, 4) float64 poses of the frames, NaN without a pose.
        up: (3,) float64 unit vector against gravity.
        unit: unit of lengths: ``m`` or ``scene units``.
        reach: median distance from a camera to the Gaussians, the size by which markers are drawn.
        frames, poses, splats: its artifacts.
        masks: what moves, or None if nothing does.
        instances: its instances, or None if they are not there.
    """

    folder: Path
    trained: TrainedScene
    camera_to_world: Array
    up: Array
    unit: str
    reach: float
    frames: Artifact
    poses: Artifact
    splats: Artifact
    masks: Artifact | None
    instances: Artifact | None

    @property
    def registered(self) -> NDArray[np.int64]:
        """Indices of the frames that have a pose."""
        return known_poses(self.camera_to_world)

    @property
    def size_of_markers(self) -> float:
        """Radius of a ball that marks a place, in the unit of the scene."""
        return 0.02 * self.reach


def open_scene(folder: Path, backend: str) -> ViewedScene:
    """Open a scene or a variant of one, without its language.

    Args:
        backend: see ``egosplat.rasterize.api.rasterization``.

    Raises:
        UserError: an artifact is missing or damaged, or does not belong to the others; or no frame has a pose.
    """
    check_scene_folder(folder, NEEDED)
    *paths, masks, instances = locate(folder, *NEEDED, MASKS.name, INSTANCES.name)
    frames, poses, splats = map(open_artifact, paths, (FRAMES, POSES, SPLATS))
    check_made_from(poses, frames)
    check_made_from(splats, frames, poses)
    camera_to_world = camera_poses(poses, splats)
    if not np.isfinite(camera_to_world).any():
        raise UserError(f"{poses.path}: no frame has a pose; see the log of the stage poses")
    trained = read_trained_scene(splats, backend)
    return ViewedScene(
        folder=folder,
        trained=trained,
        camera_to_world=camera_to_world,
        up=poses.read("up"),
        unit=length_unit(poses),
        reach=_reach(trained.gaussians.means.cpu().numpy(), camera_to_world),
        frames=frames,
        poses=poses,
        splats=splats,
        masks=_if_there(masks, MASKS, frames),
        instances=_if_there(instances, INSTANCES, frames),
    )


def _if_there(path: Path, schema: Schema, frames: Artifact) -> Artifact | None:
    if not path.exists():
        return None
    artifact = open_artifact(path, schema)
    check_made_from(artifact, frames)
    return artifact


def _reach(means: NDArray[np.float32], camera_to_world: Array) -> float:
    center = np.nanmedian(camera_to_world[:, :3, 3], axis=0)
    return float(np.median(np.linalg.norm(means - center, axis=1)))
